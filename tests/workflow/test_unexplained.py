"""A claim that differs without a reason stops a build whose verdicts count, and is named in any other."""

import json
import re
from pathlib import Path

import pytest

from marsedl.cli import Project
from marsedl.papers import SLUGS
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.inputs.readings import COMMITTED_INPUTS, committed_inputs, counted_inputs, load_study

pytestmark = pytest.mark.workflow

ROOT = Path(__file__).parents[2]
SLUG, CLAIM = "short_hop", "largest_thrust"
TARGET = f"report/claims/{SLUG}.json"


def reason(tree):
    return next(row.reason for row in read_claims(tree.path(TARGET)) if row.id == CLAIM)


def test_it_is_refused_where_verdicts_count_and_named_elsewhere(small):
    """The only claim differs without an erratum, and its inputs are committed."""
    small.edit(f"data/published/{SLUG}.yaml", "printed: 5.7", "printed: 6.9")
    claims = small.path(f"src/marsedl/papers/{SLUG}/claims/sec1_landing.py")
    text, number = re.subn(r"(?m)^@claim\(.*$", "@claim()", claims.read_text("utf-8"))
    assert number == 1
    claims.write_text(text, "utf-8")
    names: dict = {}
    model = small.path(f"src/marsedl/papers/{SLUG}/inputs.py")
    exec(compile(model.read_text("utf-8"), str(model), "exec"), names)
    digest = counted_inputs(load_study(SLUG, names["Inputs"], small.folder))
    small.path(str(COMMITTED_INPUTS)).write_text(json.dumps({SLUG: digest}), "utf-8")

    assert f"{SLUG}: claims that differ or fail without a reason: {CLAIM}" in small.works(TARGET)
    assert reason(small).startswith("Not explained")

    small.config = []
    said = small.fails(TARGET)
    assert f"{SLUG}: claim {CLAIM}: differs in reading corrected" in said
    assert "without a reason that names an erratum" in said
    assert not small.path(TARGET).exists()

    changed_input = 'initial_velocity: {value: -21.0, unit: m/s, source: "assumed: an input that was changed"}'
    config = small.path(f"configs/{SLUG}.yaml")
    config.write_text(re.sub("initial_velocity: {value: -20.0.*}", changed_input, config.read_text("utf-8")), "utf-8")
    assert f"{SLUG}: claims that differ or fail without a reason: {CLAIM}" in small.works(TARGET)
    assert reason(small).startswith("Not explained")


def test_the_committed_inputs_are_those_of_the_configuration():
    """Otherwise no verdict would need a reason."""
    assert committed_inputs(ROOT) == {slug: counted_inputs(study) for slug, study in Project().studies.items()}
    assert set(committed_inputs(ROOT)) == set(SLUGS)
