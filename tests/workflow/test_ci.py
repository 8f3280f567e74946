"""What CI runs here and on a hosted runner: the same, with actions of a stated version and without secrets."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from marsedl.cli import COMMANDS

ROOT = Path(__file__).parents[2]
HOSTED = ROOT / ".github" / "workflows" / "ci.yml"


@pytest.mark.parametrize("failing", ["", "lint"])
def test_ci_runs_its_parts_until_one_fails_and_leaves_their_seconds(tmp_path, failing):
    tools, run = tmp_path / "tools", tmp_path / ".ci" / "run"
    for folder in (tools, run.parent):
        folder.mkdir()
    shutil.copy(ROOT / ".ci" / "run", run)
    (tools / "make").write_text(f'#!/bin/sh\necho "made $1 $PYTEST_ADDOPTS"\ntest "$1" != "{failing}"\n')
    for name in ("make", "chromium", "sbatch"):
        (tools / name).touch()
        (tools / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}"}
    process = subprocess.run([run], env=environment, capture_output=True, text=True, check=False)
    assert (process.returncode != 0) == bool(failing)
    parts = ["install", "lint", "test", "sum"]
    done = parts[: parts.index(failing)] if failing else parts
    assert re.findall(r"(?m)^(\w+),\d+$", (tmp_path / "build" / "ci.csv").read_text()) == done
    assert ("made test --durations=30" in process.stdout) == (not failing)


def test_the_hosted_workflow_runs_it_then_the_full_size_and_holds_no_secret():
    workflow = yaml.load(HOSTED.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)  # to which `on` is no truth value
    (job,) = workflow["jobs"].values()
    used = [step.get("uses", step.get("run")) for step in job["steps"]]
    assert [name.partition("@")[0] for name in used] == [
        *("actions/checkout", "actions/setup-python", "bash .ci/run", "make all"),
        *(".venv/bin/marsedl verify --no-rebuild", "actions/upload-artifact"),
    ]
    assert job["steps"][-1]["if"] == "always()"
    assert all(re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", name) for name in used if name.startswith("actions/"))
    assert "secrets" not in HOSTED.read_text(encoding="utf-8")
    assert workflow["permissions"] == {"contents": "read"}


def test_a_clone_with_other_line_ends_has_the_same_bytes(tmp_path):
    """As git makes on Windows, or where a user asks for it."""
    names = ("Makefile", "data/published/funnels.yaml", "data/reference/costs.csv", "docs/images/headlines.png")
    names = [name for name in (*names, "src/marsedl/cli.py") if (ROOT / name).exists()]
    for name in (*names, ".gitattributes"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    git = ("git", "-c", "core.autocrlf=true", "-c", "user.name=a", "-c", "user.email=b@c.invalid")
    for command in (
        ["init", "-q"],
        ["add", "."],
        ["commit", "-qm", "x"],
        ["rm", "-q", *names],
        ["checkout", "-q", "HEAD", "."],
    ):
        subprocess.run([*git, *command], cwd=tmp_path, check=True)
    assert len(names) >= 4
    for name in names:
        assert (tmp_path / name).read_bytes() == (ROOT / name).read_bytes()


def test_the_workflow_catalog_finds_what_it_asks_for():
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text(encoding="utf-8"))["usage"]
    deployment = usage["software-stack-deployment"]
    assert deployment["conda"] == (ROOT / "workflow" / "envs" / "marsedl.yaml").exists()
    assert deployment["report"] == ("\nreport:" in (ROOT / "Snakefile").read_text(encoding="utf-8"))
    assert 'include: "../Snakefile"' in (ROOT / "workflow" / "Snakefile").read_text(encoding="utf-8")


def test_forms_for_issues_name_commands_that_exist():
    for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        assert yaml.safe_load(path.read_text(encoding="utf-8"))
        assert set(re.findall(r"`marsedl (\w[\w-]*)", path.read_text(encoding="utf-8"))) <= set(COMMANDS)
