"""The gate for results of a user's own: its scripts run here as on a hosted runner, in a copy of the small project."""

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
SLUG = "hypersonic_glide"
INPUTS = {"papers": SLUG, "configfile": "mine.yaml", "size": "smoke", "targets": "", "reference": "kept"}
READING = """\
hypersonic_glide:
  readings:
    mine:
      based_on: corrected
      design:
        noise_density: {value: %s, source: "assumed: my engine"}
"""


@pytest.fixture(scope="module")
def workflow():
    return yaml.load(GATE.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)  # to which `on` is no truth value


@pytest.fixture(scope="module")
def steps(workflow):
    (job,) = workflow["jobs"].values()
    return {step.get("name", step.get("uses")): step for step in job["steps"]}


@pytest.fixture
def runner(small, workflow, steps):
    """A function that runs the script of a step in the built project; it takes inputs of the workflow by name."""
    (small.folder / ".venv" / "bin").mkdir(parents=True)
    activate = f'PATH="{Path(sys.executable).parent}:$PATH"\n'
    (small.folder / ".venv" / "bin" / "activate").write_text(activate, encoding="utf-8")
    (small.folder / "own").mkdir()
    inputs = {key: re.fullmatch(r"\$\{\{ inputs\.(.+) }}", value)[1] for key, value in workflow["env"].items()}

    def run(name, **given):
        values = {key: {**INPUTS, **given}[of] for key, of in inputs.items()}
        environment = {**os.environ, **values, "PYTHONPATH": str(small.folder / "src")}
        script = small.folder / "step.sh"
        script.write_text(steps[name]["run"], encoding="utf-8")
        output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "check": False}
        return subprocess.run(["bash", "-e", str(script)], cwd=small.folder, env=environment, **output)

    return run


def test_it_can_be_called_and_takes_no_input_as_a_command(workflow, steps):
    assert set(workflow["on"]) == {"workflow_call"}
    assert workflow["permissions"] == {"contents": "read"}
    actions = [step["uses"] for step in steps.values() if "uses" in step]
    assert all(re.fullmatch(r"actions/[a-z/-]+@[0-9a-f]{40}", action) for action in actions)
    assert not [name for name, step in steps.items() if "${{" in step.get("run", "")]
    restored, saved = (steps[name]["with"] for name in ("Restore the last build", "Keep the build"))
    assert restored["path"] == saved["path"]
    assert saved["key"].startswith(restored["restore-keys"])


def test_the_page_shows_a_caller_and_all_inputs(workflow):
    page = (ROOT / "docs" / "gate.md").read_text(encoding="utf-8")
    inputs = workflow["on"]["workflow_call"]["inputs"]
    caller, _ = (yaml.safe_load(text) for text in re.findall(r"(?ms)^```yaml\n(.*?)^```$", page))
    (job,) = caller["jobs"].values()
    required = {name for name, of in inputs.items() if of.get("required") == "true"}
    assert required <= job["with"].keys() <= inputs.keys()
    assert job["uses"] == f"OWNER/marsedl/{GATE.relative_to(ROOT)}@{job['with']['pipeline-ref']}"
    assert re.findall(r"(?m)^\| `([a-z-]+)` \|", page) == sorted(inputs, key=list(inputs).index)


@pytest.mark.workflow
def test_the_gate_passes_until_a_number_moves(small, runner):
    own_folder, before = small.folder / "own", small.state()
    (own_folder / "mine.yaml").write_text(READING % 0.03, encoding="utf-8")
    refused = runner("Rebuild what changed", papers="hypersonic_gilde")
    assert refused.returncode and SLUG in refused.stdout
    assert small.state() == before
    built = runner("Rebuild what changed")
    assert built.returncode == 0, built.stdout[-3000:]
    compared = runner("Compare with your reference")
    assert compared.returncode == 2
    assert f"write it with 'marsedl accept --reference {own_folder / 'kept'}'" in compared.stdout
    proposed = runner("Propose a reference")
    assert proposed.returncode == 0, proposed.stdout[-3000:]
    shutil.move(small.folder / "proposed", own_folder / "kept")
    compared = runner("Compare with your reference")
    assert compared.returncode == 0, compared.stdout
    assert "0 numbers beyond tolerance" in compared.stdout

    claims, reference = small.path(f"report/claims/{SLUG}.json"), own_folder / "kept" / f"{SLUG}.json"
    older = claims.read_bytes()

    (own_folder / "mine.yaml").write_text(READING % 0.04, encoding="utf-8")
    built = runner("Rebuild what changed")
    assert built.returncode == 0, built.stdout[-3000:]
    after = small.state()
    assert {name for name in before if before[name] != after[name] and name.startswith("data/")} == set()
    compared = runner("Compare with your reference")
    assert compared.returncode == 1, compared.stdout
    moved = re.findall(r"(?m)^  (?:.* \()?(?:verdict of )?(\S+)", compared.stdout)
    assert any("mine" in name for name in moved)
    assert not [name for name in moved if name.startswith(("corrected/", "printed/"))]
    assert "if the changes are intended, run 'marsedl accept --reference" in compared.stdout

    # What is edited, or copied over, is said to be, and is neither a result nor a reference.
    newer = claims.read_bytes()
    for content in (older, newer.replace(b'"reproduced"', b'"close"')):
        claims.write_bytes(content)
        compared = runner("Compare with your reference")
        assert compared.returncode == 3
        assert f"report/claims/{SLUG}.json was edited after its job wrote it" in compared.stdout
    claims.write_bytes(newer)
    text = reference.read_text(encoding="utf-8")
    reference.write_text(text.replace('"mine": "', '"mine": "not_'), encoding="utf-8")
    compared = runner("Compare with your reference")
    assert compared.returncode == 2
    assert f"{SLUG}.json was edited after 'marsedl accept' wrote it; restore it" in compared.stdout
