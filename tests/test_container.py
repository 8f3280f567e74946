"""The container recipe is made of the lock and of files that exist."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECIPE = (ROOT / "container" / "Containerfile").read_text(encoding="utf-8")


def arguments(instruction):
    """What follows an instruction wherever it stands; lines that go on are joined."""
    return re.findall(rf"(?m)^{instruction} (.*)$", re.sub(r" *\\\n *", " ", RECIPE))


def test_the_base_is_the_python_that_the_lock_is_made_for():
    default = re.fullmatch(r"BASE=python:(\d+\.\d+)-slim-\w+", arguments("ARG")[0])[1]
    assert f"--python-version {default} " in (ROOT / "Makefile").read_text(encoding="utf-8")
    required = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert required == f">={default}"


def test_packages_come_from_the_lock_as_in_the_makefile():
    options = ("--require-hashes", "--only-binary :all:", "--no-deps", "-r requirements.lock")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    installs = [run for run in arguments("RUN") if "pip install" in run]
    for option in options:
        assert option in installs[0]
        assert option in makefile
    assert "--no-binary" not in RECIPE
    assert "--no-deps --no-build-isolation -e ." in installs[1]
    assert not re.search(r"https?:|index-url|find-links|apt-get|curl|wget", RECIPE)


def test_what_is_copied_exists_and_is_not_generated():
    for argument in arguments("COPY"):
        source, _ = argument.split()
        assert (ROOT / source).exists()
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split("\n")
    generated = [line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").split()]
    assert {line.removeprefix("**/").strip("/") for line in ignored} >= {".git", *generated}
