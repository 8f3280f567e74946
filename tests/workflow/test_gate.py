"""The gate for results of a user's own: its scripts run here as on a hosted runner, in a copy of the project."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
GATE = ROOT / ".github" / "workflows" / "gate.yml"
INPUTS = {"papers": "powered_descent", "configfile": "mine.yaml", "size": "smoke", "targets": "", "reference": "kept"}
READING = """\
chunks: 3  # as the tree is built
powered_descent:
  readings:
    mine:
      based_on: corrected
      noise:
        noise_coefficient: {value: %s, source: "assumed: my engine"}
"""


@pytest.fixture(scope="module")
def workflow():
    return yaml.load(GATE.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)  # to which `on` is no truth value


@pytest.fixture(scope="module")
def steps(workflow):
    (job,) = workflow["jobs"].values()
    return {step.get("name", step.get("uses")): step for step in job["steps"]}


@pytest.fixture
def runner(tree, workflow, steps):
    """A function that runs the script of a step in the built tree; it takes inputs of the workflow by name."""
    (tree.folder / ".venv" / "bin").mkdir(parents=True)
    activate = f'PATH="{Path(sys.executable).parent}:$PATH"\n'
    (tree.folder / ".venv" / "bin" / "activate").write_text(activate, encoding="utf-8")
    (tree.folder / "own").mkdir()
    inputs = {key: re.fullmatch(r"\$\{\{ inputs\.(.+) }}", value)[1] for key, value in workflow["env"].items()}

    def run(name, **given):
        values = {key: {**INPUTS, **given}[of] for key, of in inputs.items()}
        environment = {**os.environ, **values, "PYTHONPATH": str(tree.folder / "src")}
        script = tree.folder / "step.sh"
        script.write_text(steps[name]["run"], encoding="utf-8")
        output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "check": False}
        return subprocess.run(["bash", "-e", str(script)], cwd=tree.folder, env=environment, **output)

    return run


def test_it_can_be_called_and_pins_its_actions(workflow, steps):
    assert set(workflow["on"]) == {"workflow_call"}
    actions = [step["uses"] for step in steps.values() if "uses" in step]
    assert actions
    assert all(re.fullmatch(r"actions/[a-z/-]+@[0-9a-f]{40}", action) for action in actions)
    assert workflow["permissions"] == {"contents": "read"}
    assert "secrets" not in GATE.read_text(encoding="utf-8")


def test_no_input_acts_as_a_command(steps):
    assert not [name for name, step in steps.items() if "${{" in step.get("run", "")]


def test_it_installs_as_everywhere_and_restores_what_it_saves(steps):
    assert steps["Install"]["run"] == "make environment"
    restored, saved = (steps[name]["with"] for name in ("Restore the last build", "Keep the build"))
    assert restored["path"] == saved["path"]
    assert restored["key"] == saved["key"]
    assert saved["key"].startswith(restored["restore-keys"])


def test_the_page_shows_a_caller_and_all_inputs(workflow):
    page = (ROOT / "docs" / "gate.md").read_text(encoding="utf-8")
    inputs = workflow["on"]["workflow_call"]["inputs"]
    (caller,) = (yaml.safe_load(text) for text in re.findall(r"(?ms)^```yaml\n(.*?)^```$", page))
    (job,) = caller["jobs"].values()
    required = {name for name, of in inputs.items() if of.get("required") == "true"}
    assert required <= job["with"].keys() <= inputs.keys()
    assert job["uses"] == f"OWNER/marsedl/{GATE.relative_to(ROOT)}@{job['with']['pipeline-ref']}"
    assert re.findall(r"(?m)^\| `([a-z-]+)` \|", page) == sorted(inputs, key=list(inputs).index)


def of_others(tree):
    """Time and size of the products of all other readings."""
    return {name: state for name, state in tree.state().items() if "/mine/" not in name and name.startswith("data/")}


@pytest.mark.workflow
def test_the_gate_passes_until_a_number_moves(tree, runner):
    own_folder, before = tree.folder / "own", of_others(tree)
    (own_folder / "mine.yaml").write_text(READING % 0.03, encoding="utf-8")
    built = runner("Rebuild what changed")
    assert built.returncode == 0, built.stdout[-3000:]
    compared = runner("Compare with your reference")
    assert compared.returncode == 2
    assert f"write it with 'marsedl accept --reference {own_folder / 'kept'}'" in compared.stdout
    proposed = runner("Propose a reference")
    assert proposed.returncode == 0, proposed.stdout[-3000:]
    shutil.move(tree.folder / "proposed", own_folder / "kept")
    compared = runner("Compare with your reference")
    assert compared.returncode == 0, compared.stdout
    assert "0 numbers beyond tolerance" in compared.stdout

    (own_folder / "mine.yaml").write_text(READING % 0.04, encoding="utf-8")
    built = runner("Rebuild what changed")
    assert built.returncode == 0, built.stdout[-3000:]
    assert of_others(tree) == before
    compared = runner("Compare with your reference")
    assert compared.returncode == 1, compared.stdout
    moved = re.findall(r"(?m)^  (?:verdict of )?(\S+)", compared.stdout)
    assert any("mine" in name for name in moved)
    assert not [name for name in moved if name.startswith(("corrected/", "printed/"))]
    assert "if the changes are intended, run 'marsedl accept --reference" in compared.stdout


@pytest.mark.workflow
def test_an_unknown_paper_is_refused_before_anything_is_built(tree, runner):
    (tree.folder / "own" / "mine.yaml").write_text(READING % 0.03, encoding="utf-8")
    for name in ("Rebuild what changed", "Compare with your reference"):
        refused = runner(name, papers="powered_decent")
        assert refused.returncode
        assert "powered_descent" in refused.stdout
