"""The Makefile: what it says while it sets itself up. What is installed is left to `make all` itself, which CI runs."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STAND_IN = """\
#!/bin/sh
echo "$(basename "$0") $*"
case "$*" in *venv*) mkdir -p .venv/bin && cp "$0" .venv/bin/python;; esac
"""  # of uv, and of a Python with pip: says what it was asked for, and makes an environment of itself


def without_make():
    """The environment without what `make test` adds, by which another make would say where it is."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}


@pytest.mark.parametrize("installer", ["uv", "pip"])
def test_every_step_of_the_installation_is_announced_and_shown(tmp_path, installer):
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in ("uv", "python-of-mine") if installer == "uv" else ("python-of-mine",):
        (tools / name).write_text(STAND_IN)
        (tools / name).chmod(0o755)
    for name in ("sh", "make", "echo", "touch", "test", "mkdir", "cp", "basename", "tr", "grep"):
        (tools / name).symlink_to(shutil.which(name))
    for name in ("Makefile", "requirements.lock", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path / name)
    command = ["make", "environment", "PYTHON=python-of-mine"]
    environment = without_make()
    environment["PATH"] = str(tools)
    process = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    announced = [line for line in process.stdout.splitlines() if not line.startswith(("uv ", "python"))]
    assert announced == [
        "Making an environment in .venv",
        "Installing the packages of requirements.lock into it; this takes some minutes",
        "Installing marsedl itself",
        "The environment is ready; enter it with: . .venv/bin/activate",
    ]
    installs = [line for line in process.stdout.splitlines() if " install " in line]
    assert [line.rpartition(" ")[2] for line in installs] == ["requirements.lock", "."]
    assert not any(" -q" in line or "--quiet" in line for line in installs), "the installer shows how far it is"
    assert all(line.startswith("uv " if installer == "uv" else "python -m pip ") for line in installs)


def test_quick_selects_the_tests_that_compute_no_stage():
    options = {"cwd": ROOT, "env": without_make(), "capture_output": True, "text": True, "check": True}
    recipe = subprocess.run(["make", "-n", "quick"], **options)
    (selection,) = re.findall(r'pytest .* -m "(.+)"', recipe.stdout)
    files = ["tests/test_makefile.py", "tests/workflow/test_reruns.py", "tests/papers/test_powered_descent_design.py"]
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:xdist", "-m", selection, *files]
    collected = subprocess.run(command, **options).stdout
    assert set(re.findall(r"(?m)^(tests/\S+\.py)", collected)) == {"tests/test_makefile.py"}
