"""What CI runs here and on a hosted runner: the same, with actions of a stated version and without secrets."""

import os
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
RUN = ROOT / ".ci" / "run"
HOSTED = ROOT / ".github" / "workflows" / "ci.yml"


@pytest.fixture(scope="module")
def workflow():
    return yaml.load(HOSTED.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)  # to which `on` is no truth value


@pytest.fixture(scope="module")
def steps(workflow):
    (job,) = workflow["jobs"].values()
    return job["steps"]


def test_ci_lints_tests_and_audits():
    commands = RUN.read_text(encoding="utf-8").splitlines()
    assert "set -euo pipefail" in commands
    assert commands[-4:] == ["make slurm", "make lint", "make test", ".venv/bin/marsedl audit"]
    assert os.access(RUN, os.X_OK)


def test_the_hosted_workflow_runs_it_first_of_all(workflow, steps):
    assert {"push", "pull_request"} == set(workflow["on"])
    used = [step.get("uses", step.get("run")) for step in steps]
    assert [name.partition("@")[0] for name in used[:2]] == ["actions/checkout", "actions/setup-python"]
    assert steps[1]["with"]["python-version"] == "3.11"
    assert used[2] == "bash .ci/run"


def test_the_hosted_workflow_compares_the_full_size_and_keeps_the_report(steps):
    used = [step.get("uses", step.get("run")).partition("@")[0] for step in steps]
    assert used[3:] == ["make all", ".venv/bin/marsedl verify --no-rebuild", "actions/upload-artifact"]
    assert steps[-1]["if"] == "always()"
    assert {"report/index.html", "report/claims.json"} <= set(steps[-1]["with"]["path"].split())


def test_the_hosted_workflow_pins_its_actions_and_holds_no_secret(workflow, steps):
    actions = [step["uses"] for step in steps if "uses" in step]
    assert len(actions) == 3
    assert all(re.fullmatch(r"actions/[a-z-]+@v\d+", action) for action in actions)
    assert "secrets" not in HOSTED.read_text(encoding="utf-8")
    assert workflow["permissions"] == {"contents": "read"}


def test_the_hosted_workflow_says_what_its_steps_are_for():
    lines = HOSTED.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# ")
    assert sum(line.lstrip().startswith("# ") for line in lines) >= 5
