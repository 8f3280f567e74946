"""The environment is that of the hashed locks: nothing else is fetched, and nothing is built but the project itself.

So it is in an environment of conda, in the container, and in that of the Makefile.
"""

import os
import re
import shutil
import subprocess
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
LOCKS = ("requirements.lock", "requirements-slurm.lock")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
EXCLUDED = PYPROJECT["tool"]["uv"]["exclude-dependencies"]
FROM_A_LOCK = {"--require-hashes", "--only-binary", ":all:", "--no-deps", "-r"}
THE_PROJECT = {"--no-deps", "--no-build-isolation", "-e", "."}


def locked(name: str) -> list[Requirement]:
    """The pinned packages of a lock."""
    lines = (ROOT / name).read_text("utf-8").splitlines()
    return [Requirement(line.removesuffix(" \\")) for line in lines if not line.startswith((" ", "#"))]


@pytest.mark.parametrize("folder", [".", "build/smoke"])
def test_an_environment_of_conda_takes_the_lock_and_nothing_else(tmp_path, folder):
    (tmp_path / LOCKS[0]).touch()
    (tmp_path / "python").write_text('#!/bin/sh\nfor last; do :; done; test -e "$last" && echo "$@"\n')
    (tmp_path / "python").chmod(0o755)
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    script = ROOT / "workflow" / "envs" / "marsedl.post-deploy.sh"
    process = subprocess.run(
        ["sh", script], cwd=tmp_path / folder, env=environment, capture_output=True, text=True, check=True
    )
    assert {*process.stdout.split()} > FROM_A_LOCK
    assert "pip:" not in script.with_name("marsedl.yaml").read_text("utf-8")


@pytest.mark.parametrize(("name", "extras"), [(LOCKS[0], ("dev", "docs")), (LOCKS[1], ("slurm",))])
def test_a_lock_pins_and_hashes_everything_that_is_installed_and_has_no_address(name, extras):
    text, packages = (ROOT / name).read_text("utf-8"), locked(name)
    assert all(re.fullmatch(r"==[^*,]+", str(package.specifier)) for package in packages)
    for entry in re.split(r"(?m)^(?=[a-z])", text)[1:]:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry), entry.splitlines()[0]
    assert "://" not in text
    assert "--index" not in text
    optional = PYPROJECT["project"]["optional-dependencies"]
    extras = {*extras, "pipeline", *Requirement(optional["pipeline"][0]).extras}
    asked = [*PYPROJECT["project"]["dependencies"], *(need for extra in extras for need in optional[extra])]
    assert {Requirement(need).name for need in asked} - {"marsedl"} <= {package.name for package in packages}


def test_the_locks_agree_in_their_versions():
    first, second = ({(p.name, str(p.marker)): str(p.specifier) for p in locked(name)} for name in LOCKS)
    both = first.keys() & second.keys()
    assert len(both) > 40
    assert [key for key in both if first[key] != second[key]] == []


def test_every_requirement_of_a_locked_package_is_locked_or_excluded():
    """What `pip check` says, but for what pyproject.toml excludes: the locks are installed without asking for more."""
    names = {canonicalize_name(package.name) for name in LOCKS for package in locked(name)}
    assert not names & set(EXCLUDED)
    missing = set()
    for package in distributions():
        if canonicalize_name(package.name) in names:
            required = [Requirement(text) for text in package.requires or ()]
            required = [need for need in required if need.marker is None or need.marker.evaluate({"extra": ""})]
            missing |= {canonicalize_name(need.name) for need in required} - names
    assert missing == set(EXCLUDED), "exclude what nothing imports, and nothing else"


# ------------------------------------------------------------------------------------------------------- the container

RECIPE = (ROOT / "container" / "Containerfile").read_text("utf-8")
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")


def arguments(instruction):
    """What follows an instruction of the recipe wherever it stands; lines that go on are joined."""
    return re.findall(rf"(?m)^{instruction} (.*)$", re.sub(r" *\\\n *", " ", RECIPE))


def test_the_base_is_the_python_that_the_lock_is_made_for():
    default = re.fullmatch(r"BASE=python:(\d+\.\d+)-slim-\w+", arguments("ARG")[0])[1]
    assert f"--python-version {default} " in MAKEFILE
    assert PYPROJECT["project"]["requires-python"] == f">={default}"


def test_packages_come_from_the_lock_as_in_the_makefile():
    of_the_lock, of_the_project = ({*run.split()} for run in arguments("RUN") if "pip install" in run)
    assert of_the_lock >= FROM_A_LOCK | {LOCKS[0]}
    assert of_the_project >= THE_PROJECT
    assert {*MAKEFILE.split()} >= FROM_A_LOCK | THE_PROJECT
    assert not re.search(r"https?:|index-url|find-links|apt-get|curl|wget|--no-binary", RECIPE)


def test_what_is_copied_exists_and_is_not_generated():
    assert all((ROOT / argument.split()[0]).exists() for argument in arguments("COPY"))
    ignored = (ROOT / ".dockerignore").read_text("utf-8").splitlines()
    generated = [line.strip("/") for line in (ROOT / ".gitignore").read_text("utf-8").split()]
    assert {line.removeprefix("**/").strip("/") for line in ignored} >= {".git", *generated}


@pytest.mark.long
def test_make_builds_the_environment_of_the_lock_and_nothing_more(tmp_path):
    """Needs a package index; a few minutes."""
    for name in ("Makefile", "pyproject.toml", "README.md", "LICENSE", LOCKS[0]):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "src", tmp_path / "src")
    process = subprocess.run(["make", "environment"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout[-3000:] + process.stderr[-3000:]
    ask = "from importlib.metadata import distributions as d; print(*{p.name + '==' + p.version for p in d()})"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    output = subprocess.check_output([tmp_path / ".venv/bin/python", "-c", ask], env=environment, text=True)
    installed = {canonicalize_name(name): version for name, version in (item.split("==") for item in output.split())}
    expected = {
        canonicalize_name(package.name): str(package.specifier).removeprefix("==")
        for package in locked(LOCKS[0])
        if package.marker is None or package.marker.evaluate()
    }
    assert {name: version for name, version in installed.items() if name not in ("marsedl", "pip")} == expected
