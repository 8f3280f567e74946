"""The package outside of a clone, with no packages but those that it declares for results."""

import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def of_extras_beside_results():
    """Modules of the packages that other extras bring."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

    def packages(requirements):
        return {re.match(r"[\w-]+", text)[0].lower() for text in requirements}

    extras = {name: packages(requirements) for name, requirements in project["optional-dependencies"].items()}
    others = extras["programs"] | extras["figures"] | extras["pipeline"]
    others -= extras["results"] | packages(project["dependencies"]) | {"marsedl"}
    return {module for module, names in packages_distributions().items() if others & {name.lower() for name in names}}


def printed(folder, program, hidden=(), **environment):
    """What a program prints in a folder where some modules cannot be imported."""
    hide = f"import sys; sys.modules.update(dict.fromkeys({sorted(hidden)!r}))\n"
    process = subprocess.run(
        [sys.executable, "-c", hide + textwrap.dedent(program)],
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr[-2000:]
    return process.stdout.split()


def test_results_need_their_extra_alone():
    hidden = of_extras_beside_results()
    assert {"snakemake", "jinja2", "matplotlib", "casadi"} <= hidden
    program = "from marsedl import results; print(len(results.inputs('powered_descent')))"
    assert int(*printed(ROOT, program, hidden)) > 40


@pytest.fixture
def installed(tmp_path):
    """A folder of packages that holds a copy of this one, and another package beside it."""
    site = tmp_path / "site"
    shutil.copytree(ROOT / "src" / "marsedl", site / "marsedl", ignore=shutil.ignore_patterns("__pycache__"))
    (site / "other.py").write_text("not Python\n")
    shutil.copytree(ROOT / "configs", tmp_path / "build" / "configs")
    return tmp_path


def test_an_installed_package_finds_its_catalogues_and_a_build_and_writes_nothing(installed):
    program = """
        import marsedl
        from marsedl import results
        from marsedl.papers import catalogue
        count = len(results.inputs("powered_descent", build="."))
        print(marsedl.__file__, len(catalogue("powered_descent").stages), count)
    """
    path, stages, inputs = printed(installed / "build", program, PYTHONPATH=str(installed / "site"))
    assert path == str(installed / "site" / "marsedl" / "__init__.py")
    assert int(stages) > 5 and int(inputs) > 40
    written = [*installed.iterdir(), *(installed / "build").iterdir(), *installed.rglob("fingerprints.json")]
    assert sorted(path.name for path in written) == ["build", "configs", "site"]
