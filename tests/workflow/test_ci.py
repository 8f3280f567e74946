"""What CI runs here and on a hosted runner: the same, with actions of a stated version and without secrets."""

import os
import re
from pathlib import Path

import pytest
import yaml

from marsedl.cli import _COMMANDS

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


def test_ci_lints_and_tests():
    commands = RUN.read_text(encoding="utf-8").splitlines()
    assert "set -euo pipefail" in commands
    assert commands[-3:] == ["make slurm", "make lint", "make test"]
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
    assert {"report/report.zip", "report/claims.json"} <= set(steps[-1]["with"]["path"].split())


def test_the_hosted_workflow_pins_its_actions_and_holds_no_secret(workflow, steps):
    actions = [step["uses"] for step in steps if "uses" in step]
    assert len(actions) == 3
    assert all(re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", action) for action in actions)
    assert "secrets" not in HOSTED.read_text(encoding="utf-8")
    assert workflow["permissions"] == {"contents": "read"}


def test_the_hosted_workflow_says_what_its_steps_are_for():
    lines = HOSTED.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# ")
    assert sum(line.lstrip().startswith("# ") for line in lines) >= 5


def test_the_workflow_catalog_finds_what_it_asks_for():
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text(encoding="utf-8"))["usage"]
    assert usage.keys() == {"mandatory-flags", "software-stack-deployment"}
    assert usage["mandatory-flags"].keys() == {"desc", "flags"}
    deployment = usage["software-stack-deployment"]
    assert deployment["conda"] == (ROOT / "workflow" / "envs" / "marsedl.yaml").exists()
    assert deployment["report"] == ("\nreport:" in (ROOT / "Snakefile").read_text(encoding="utf-8"))
    assert 'include: "../Snakefile"' in (ROOT / "workflow" / "Snakefile").read_text(encoding="utf-8")
    configuration = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", configuration):
        assert (ROOT / "config" / link).exists(), link
    assert {"snakemake", "workflow"} <= set(re.findall(r"\w+", (ROOT / "README.md").read_text("utf-8").lower()))


@pytest.mark.parametrize(
    "path", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem
)
def test_forms_for_issues_name_commands_that_exist(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    if path.stem == "config":
        assert form == {"blank_issues_enabled": True}
        return
    assert {"name", "description", "body"} <= form.keys()
    assert all(field["type"] in ("input", "textarea", "dropdown") for field in form["body"])
    ids = [field["id"] for field in form["body"]]
    assert len(set(ids)) == len(ids)
    named = re.findall(r"`marsedl (\w[\w-]*)", path.read_text(encoding="utf-8"))
    assert set(named) <= set(_COMMANDS)
