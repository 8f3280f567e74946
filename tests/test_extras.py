"""The library alone needs few packages, and what is missing beyond them is named with the extra that brings it."""

import ast
import re
import subprocess
import sys
import textwrap
import tomllib
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import marsedl
from marsedl.extras import DISTRIBUTIONS, MissingExtra, extra_of

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
LIBRARY = ("models", "methods", "montecarlo")
# As if nothing but the standard library and some modules were installed.
ALONE = """
import sys
from importlib.machinery import PathFinder

class Installed(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        standard = name in sys.stdlib_module_names or name.startswith("_sysconfigdata")
        if path is None and not standard and name not in {installed!r}:
            return None
        return super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Installed
"""


def named(requirements):
    """The packages that requirements ask for, without marsedl itself."""
    return {canonicalize_name(Requirement(text).name) for text in requirements} - {"marsedl"}


def with_what_they_need(packages):
    """Packages and all that they require, as they are installed."""
    needed, pending = set(), set(packages)
    while pending:
        needed |= pending
        texts = [text for name in pending for text in requires(name) or ()]
        required = [need for need in map(Requirement, texts) if not need.marker or need.marker.evaluate({"extra": ""})]
        pending = {canonicalize_name(need.name) for need in required} - needed
    return needed


def library_alone(program):
    """What a program prints, and its last line of errors, where the library was installed without an extra."""
    packages = with_what_they_need(named(PROJECT["dependencies"]))
    modules = packages_distributions()
    installed = sorted(name for name in modules if {canonicalize_name(p) for p in modules[name]} & packages)
    text = ALONE.format(installed={*installed, "marsedl"}) + textwrap.dedent(program)
    process = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    return process.stdout, process.stderr.strip().rpartition("\n")[2]


def imported(path):
    """The top-level modules that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name.partition(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.partition(".")[0]


def test_every_module_of_the_library_imports_with_what_it_requires_alone():
    printed, error = library_alone(
        f"""
        from importlib import import_module
        from pkgutil import walk_packages
        import marsedl
        for wing in {LIBRARY}:
            for module in walk_packages([f"{{marsedl.__path__[0]}}/{{wing}}"], f"marsedl.{{wing}}."):
                import_module(module.name)
                print(module.name)
        import marsedl.replication.artifacts
        """
    )
    assert not error
    assert len(printed.splitlines()) > 50


def test_what_the_library_requires_is_little():
    assert named(PROJECT["dependencies"]) == {"numpy", "scipy", "numba", "h5py", "ddsketch"}
    assert with_what_they_need(named(PROJECT["dependencies"])) - named(PROJECT["dependencies"]) == {"llvmlite", "six"}


@pytest.mark.parametrize(
    ("program", "package", "extra"),
    [
        ("from marsedl.methods.linearization import symbol_kind; symbol_kind(None, 2)", "casadi", "programs"),
        ("import marsedl.plotting.style", "matplotlib", "figures"),
        ("import marsedl.replication.claims", "pydantic", "pipeline"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(program, package, extra):
    _, error = library_alone(program)
    assert error == (
        f"marsedl.extras.MissingExtra: {package} is not installed; "
        f"it comes with the extra '{extra}': pip install 'marsedl[{extra}]'"
    )


def test_the_command_says_in_one_line_what_is_missing():
    _, error = library_alone("import sys; from marsedl.cli import main; sys.exit(main(['list']))")
    assert re.fullmatch(r"marsedl: \w+ is not installed; it comes with the extra 'pipeline': pip install .*", error)


def test_what_probes_for_a_package_is_told_as_by_python():
    """An import that fails on purpose is an ImportError with the name, and outside of marsedl it is Python's own."""
    printed, error = library_alone(
        """
        import marsedl
        from importlib.util import find_spec
        def probe(importer, statement="import casadi"):
            try:
                exec(statement, {"__name__": importer})
            except ImportError as error:
                print(importer, type(error).__name__, error.name)
        probe("marsedl.methods.new")
        probe("somebody.elses")
        probe("marsedlike")
        probe("marsedl.methods.new", "import nowhere_at_all")
        probe("marsedl.methods.new", "import numpy.nowhere_at_all")
        print(find_spec("casadi"))
        """
    )
    assert not error
    assert printed.splitlines() == [
        "marsedl.methods.new MissingExtra casadi",
        "somebody.elses ModuleNotFoundError casadi",
        "marsedlike ModuleNotFoundError casadi",
        "marsedl.methods.new ModuleNotFoundError nowhere_at_all",
        "marsedl.methods.new ModuleNotFoundError numpy.nowhere_at_all",
        "None",
    ]
    assert issubclass(MissingExtra, ModuleNotFoundError)


def test_every_package_that_the_source_imports_is_required_or_comes_with_an_extra():
    used = {name for path in (ROOT / "src").rglob("*.py") for name in imported(path)}
    outside = used - set(sys.stdlib_module_names) - {"marsedl"}
    required = {name for name in outside if DISTRIBUTIONS.get(name, name) in named(PROJECT["dependencies"])}
    assert {"numpy", "numba", "h5py"} <= required
    for name in sorted(outside - required - {"llvmlite", "markupsafe"}):  # which numba and jinja2 bring
        extra = extra_of(name)
        assert DISTRIBUTIONS.get(name, name) in named(EXTRAS[extra]), f"{name}: is it in pyproject.toml?"


def test_the_extras_of_the_pipeline_are_all_that_one_needs_for_it():
    itself = {name: set(re.findall(r"marsedl\[(.*)\]", " ".join(EXTRAS[name]))) for name in EXTRAS}
    assert itself.pop("pipeline") == {"programs,figures,results"}
    assert {name for name, brought in itself.items() if brought == {"pipeline"}} == {"dev", "docs", "crate", "slurm"}
    assert {name for name, brought in itself.items() if not brought} == {"programs", "figures", "results"}


def test_what_may_never_be_asked_for_is_not_loaded():
    program = "import sys; before = {*sys.modules}; import marsedl; print(sorted({*sys.modules} - before))"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = ast.literal_eval(process.stdout)
    assert {name for name in loaded if name.startswith("marsedl")} == {"marsedl", "marsedl.extras"}
    assert len(loaded) < 10


def test_the_version_is_that_of_the_installation():
    assert marsedl.__version__ == PROJECT["version"]
    assert not hasattr(marsedl, "nothing")


def test_others_may_rely_on_the_types():
    assert (Path(marsedl.__path__[0]) / "py.typed").exists()
