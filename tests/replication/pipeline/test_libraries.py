"""Versions of libraries: those that a stage's code uses, so that an upgrade reruns its users and nothing else."""

import importlib.metadata
import re
import subprocess
import sys
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.pipeline import libraries
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.pipeline.libraries import COMPANIONS, DISTRIBUTIONS, library_versions, versions_used
from marsedl.replication.records.recipes import recipe_changes

ROOT = Path(__file__).parents[3]
STAGE = fingerprints_of(ROOT).libraries("stage.py")
USED = {
    f"{slug}/{name}": frozenset(
        [*STAGE, *(used for entry in stage.entries for used in fingerprints_of(ROOT).libraries(entry))]
    )
    for slug in SLUGS
    for name, stage in catalogue(slug).stages.items()
}
# Which stages solve a cone program, and so depend on the version of its solver, which no code imports.
CONE_PROGRAMS = {
    *("powered_descent/certificates", "random_field/gains", "random_field/certificates", "random_field/convergence"),
    "random_field/double_integrator",
    *("funnels/stage_study", "funnels/coarse_funnels", "stochastic_entry/certificates"),
}
NO_SCIPY = {
    *("random_field/double_integrator_flights", "funnels/dubins_calm", "funnels/dubins_wind"),
}


@pytest.fixture
def upgraded(tmp_path, monkeypatch):
    """Upgrade a library; returns the stages whose versions change."""

    def now():
        versions_used.cache_clear()
        libraries._version.cache_clear()
        return {stage: versions_used(used) for stage, used in USED.items()}

    def upgrade(name):
        before, metadata = now(), tmp_path / f"{name}-99.0.dist-info" / "METADATA"  # as its installer leaves it
        metadata.parent.mkdir()
        metadata.write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 99.0\n", encoding="utf-8")
        after = now()
        changes = {stage for stage in USED if before[stage] != after[stage]}
        assert all(f"{name} 99.0" in after[stage] for stage in changes)
        return changes

    monkeypatch.syspath_prepend(tmp_path)
    yield upgrade
    monkeypatch.undo()
    now()


@pytest.mark.parametrize(
    ("name", "stages"),
    [
        ("clarabel", CONE_PROGRAMS),
        ("scipy", USED.keys() - NO_SCIPY),
        ("numpy", USED.keys()),
        ("matplotlib", set()),
        ("pyyaml", set()),
        ("snakemake", set()),
    ],
)
def test_an_upgrade_changes_the_stages_that_use_the_library(upgraded, name, stages):
    assert upgraded(name) == stages


def test_versions_are_told_in_words():
    message = versions_used(frozenset({"numba", "PIL", "yaml"}))
    python = f"python {sys.version_info.major}.{sys.version_info.minor}"
    names = ("llvmlite", "numba", "pillow")
    assert message == ", ".join([python, *(f"{name} {importlib.metadata.version(name)}" for name in names)])
    assert library_versions("no-such-thing", "h5py") == {
        "h5py": importlib.metadata.version("h5py"),
        "no-such-thing": "not installed",
    }


def test_companions_are_what_a_library_itself_requires():
    for name, companions in COMPANIONS.items():
        required = {re.match(r"[\w-]+", line)[0].lower() for line in importlib.metadata.requires(name)}
        assert required >= set(companions)


def test_every_library_that_some_code_uses_is_installed_under_the_name_by_which_it_is_looked_up():
    scripts = [path.name for path in (ROOT / "workflow" / "scripts").glob("*.py")]
    used = set().union(*USED.values(), *map(fingerprints_of(ROOT).libraries, scripts))
    used -= {"yaml"}
    assert used >= {"PIL", "casadi", "cvxpy", "jinja2", "matplotlib", "numba", "numpy", "scipy"}
    assert "not installed" not in library_versions(*(DISTRIBUTIONS.get(name, name) for name in used)).values()


def test_planning_looks_versions_up_without_importing_the_libraries():
    program = "import sys; from marsedl.replication.pipeline.libraries import versions_used\n"
    program += "versions_used(frozenset({'numpy'}))\n"
    program += "print('numpy' in sys.modules)"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "False"


def test_a_library_that_is_gone_changed_or_new_is_told_by_its_name():
    def told(before, now):
        recipe = {"inputs": {}, "options": {}, "code": "a", "needs": {}}
        return list(recipe_changes(recipe | {"libraries": before}, recipe | {"libraries": now}))

    assert told("python 3.11, numba 1", "python 3.11, numba 2") == ["'numba 1' among the libraries"]
    assert told("python 3.11", "python 3.11, numba 2") == ["no 'numba 2' among the libraries"]
    assert told("python 3.11, numba 2", "python 3.11") == ["'numba 2' among the libraries"]
    assert told("python 3.11", "python 3.11") == []
