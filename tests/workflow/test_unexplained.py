"""A claim that differs without a reason stops a build whose verdicts count, and is named in any other."""

import json
import re
from pathlib import Path

import pytest

from marsedl.cli import _project
from marsedl.papers import SLUGS
from marsedl.replication.claims import read_claims
from marsedl.replication.inputs import COMMITTED_INPUTS, committed_inputs, counted_inputs, load_study
from marsedl.replication.scaffold import new_paper
from marsedl.replication.verification import copy_tree, snakemake

pytestmark = pytest.mark.workflow

ROOT = Path(__file__).parents[2]
SLUG = "drop_test"
CLAIM = "largest_thrust"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The project with a small paper, whose only claim differs without an erratum and whose inputs are committed."""
    root = copy_tree(ROOT, tmp_path_factory.mktemp("unexplained") / "project")
    new_paper(root, SLUG, "A title", "An author", monte_carlo=False)
    published = root / f"data/published/{SLUG}.yaml"
    published.write_text(published.read_text("utf-8").replace("printed: 5.7", "printed: 6.9"), "utf-8")
    claims = root / f"src/marsedl/papers/{SLUG}/claims/sec1_landing.py"
    text, number = re.subn(r"(?m)^@claim\(.*$", "@claim()", claims.read_text("utf-8"))
    assert number == 1
    claims.write_text(text, "utf-8")
    model = root / f"src/marsedl/papers/{SLUG}/inputs.py"
    names: dict = {}
    exec(compile(model.read_text("utf-8"), str(model), "exec"), names)
    digest = counted_inputs(load_study(SLUG, names["MODEL"], root / f"configs/{SLUG}.yaml"))
    committed = root / COMMITTED_INPUTS
    committed.write_text(json.dumps({**json.loads(committed.read_text("utf-8")), SLUG: digest}), "utf-8")
    return root


def build(root, *arguments):
    return snakemake(root, f"report/claims/{SLUG}.json", "--cores", "2", *arguments)


def reason(folder):
    rows = read_claims(folder / f"report/claims/{SLUG}.json")
    return next(row["reason"] for row in rows if row["id"] == CLAIM)


def test_it_is_refused_where_verdicts_count_and_named_elsewhere(project):
    process = build(project)
    assert process.returncode != 0
    assert f"{SLUG}: claim {CLAIM}: differs in reading corrected" in process.stdout
    assert "without a reason that names an erratum" in process.stdout
    assert "Traceback" not in process.stdout
    assert not (project / f"report/claims/{SLUG}.json").exists()

    process = build(project, "--config", "size=smoke")
    assert process.returncode == 0, process.stdout[-3000:]
    assert f"{SLUG}: claims that differ or fail without a reason: {CLAIM}" in process.stdout
    assert reason(project / "build" / "smoke").startswith("Not explained")

    config = project / f"configs/{SLUG}.yaml"
    changed_input = 'initial_velocity: {value: -21.0, unit: m/s, source: "assumed: an input that was changed"}'
    config.write_text(re.sub("initial_velocity: {value: -20.0.*}", changed_input, config.read_text("utf-8")), "utf-8")
    process = build(project)
    assert process.returncode == 0, process.stdout[-3000:]
    assert f"{SLUG}: claims that differ or fail without a reason: {CLAIM}" in process.stdout
    assert reason(project).startswith("Not explained")


def test_the_committed_inputs_are_those_of_the_configuration():
    """Otherwise no verdict would need a reason."""
    assert committed_inputs(ROOT) == {slug: counted_inputs(study) for slug, study in _project().studies.items()}
    assert set(committed_inputs(ROOT)) == set(SLUGS)
