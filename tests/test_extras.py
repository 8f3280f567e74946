"""The library alone needs few packages; what else the source imports comes with the extras of pyproject.toml."""

import ast
import re
import subprocess
import sys
import textwrap
import tomllib
from importlib.metadata import packages_distributions, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import marsedl
from marsedl.replication.pipeline.libraries import DISTRIBUTIONS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
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


def library_alone(program):
    """What a program prints, and its last line of errors, where the library was installed without an extra."""
    needed, pending = set(), named(PROJECT["dependencies"])
    while pending:
        needed |= pending
        required = [Requirement(text) for name in pending for text in requires(name) or ()]
        required = [need for need in required if not need.marker or need.marker.evaluate({"extra": ""})]
        pending = {canonicalize_name(need.name) for need in required} - needed
    modules = packages_distributions()
    installed = sorted(name for name in modules if {canonicalize_name(p) for p in modules[name]} & needed)
    text = ALONE.format(installed={*installed, "marsedl"}) + textwrap.dedent(program)
    process = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    return process.stdout, process.stderr.strip().rpartition("\n")[2]


def test_every_module_of_the_library_imports_with_what_it_requires_alone():
    printed, error = library_alone(
        """
        from importlib import import_module
        from pkgutil import walk_packages
        import marsedl
        for wing in ("models", "methods", "montecarlo", "fly", "design"):
            for module in walk_packages([f"{marsedl.__path__[0]}/{wing}"], f"marsedl.{wing}."):
                import_module(module.name)
                print(module.name)
        import marsedl.replication.records.store
        """
    )
    assert not error
    assert len(printed.splitlines()) > 40


def test_a_plain_installation_flies_and_gives_percentiles():
    printed, error = library_alone(
        f"""
        import runpy
        runpy.run_path({str(ROOT / "docs/examples/lander.py")!r}, run_name="__main__")
        """
    )
    assert "Error" not in error
    assert re.search(r"quantity +unit +percentile", printed) and re.search(r"\d+ +mass +kg +99\.0", printed)


def test_what_needs_an_extra_says_so_in_one_sentence():
    _, error = library_alone("from marsedl import results")
    assert error.endswith(" is not installed; run: pip install 'marsedl[results]'")
    _, error = library_alone(
        """
        from types import SimpleNamespace
        from marsedl.fly.flights import Flights
        Flights.to_xarray(SimpleNamespace())
        """
    )
    assert error == "ModuleNotFoundError: xarray is not installed; run: pip install 'marsedl[results]'"


def test_the_command_says_in_one_line_what_is_missing():
    _, error = library_alone("import sys; from marsedl.cli import main; sys.exit(main(['list']))")
    assert error == "marsedl: yaml is not installed; run: pip install 'marsedl[pipeline]'"


def test_every_package_that_the_source_imports_is_required_or_comes_with_an_extra():
    used = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                used |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                used.add(node.module.partition(".")[0])
    outside = {DISTRIBUTIONS.get(name, name) for name in used - set(sys.stdlib_module_names) - {"marsedl"}}
    brought = named([*PROJECT["dependencies"], *(text for name in EXTRAS for text in EXTRAS[name])])
    assert outside - {"llvmlite", "markupsafe"} <= brought  # which numba and jinja2 bring


def test_importing_marsedl_loads_nothing_else():
    program = "import sys; before = {*sys.modules}; import marsedl; print(sorted({*sys.modules} - before))"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ast.literal_eval(process.stdout) == ["marsedl"]


def test_the_version_is_that_of_the_installation():
    assert marsedl.__version__ == PROJECT["version"]
    assert not hasattr(marsedl, "nothing")
    assert (Path(marsedl.__path__[0]) / "py.typed").exists()
