"""The published JSON Schema of a build's claims: it is that of the code, takes every kind, and describes every key."""

import json
import math
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from marsedl.replication.claims.claim import Cause, Counterexample, Standing, Tolerance
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.rows import write_claims
from marsedl.replication.claims.verdicts import Declaration, Evaluation, collect
from marsedl.replication.claims.writing import holds, measure
from marsedl.schemas import claims_schema

PUBLISHED = Path(__file__).parents[1] / "docs" / "schemas" / "claims.json"
SCHEMA = claims_schema()


def faults(document):
    """What the schema finds wrong with a document, in words."""
    return [error.message for error in Draft202012Validator(SCHEMA).iter_errors(document)]


def test_the_committed_schema_is_what_is_made():
    assert json.loads(PUBLISHED.read_bytes()) == SCHEMA, "run 'make schemas'"


def test_the_schema_is_one_and_describes_every_key():
    Draft202012Validator.check_schema(SCHEMA)
    keys = {f"{part}.{key}": of for part, one in SCHEMA["$defs"].items() for key, of in one["properties"].items()}
    assert {"Claim.kind", "Standing.cause"} < keys.keys()
    assert [key for key, of in keys.items() if not of.get("description", "").strip()] == []


PLACE = {"paper": "paper", "id": "mass", "where": "Sec. V", "quantity": "final mass", "unit": "kg"}
MASS = PublishedClaim(**PLACE, printed=1349, kind="deterministic", resolution=1)


def like_mass(**changes):
    return MASS.model_copy(update=changes)


CLAIMS = (
    MASS,
    like_mass(id="near"),
    like_mass(id="drawn", kind="monte_carlo", printed=[1.0, 2.0], resolution=[0.1, 0.1], trials=2000),
    like_mass(id="stated", kind="qualitative", printed=True, resolution=None, unit="1"),
    like_mass(id="limit", kind="input", printed=math.inf, resolution=None),
    like_mass(id="open", kind="undetermined", resolution=None),
    like_mass(id="quoted", kind="context", printed="as in [3]", resolution=None, note="of another paper"),
)
DECLARATIONS = {"near": Declaration("Why.", errata=("E1",), close=Tolerance(reason="a digit", relative=0.1))}
EVALUATIONS = {
    "mass": Evaluation(1349.2),
    "near": Evaluation(1340.0),
    "drawn": Evaluation([1.0, 2.0], [0.01, 0.02], 4000),
    "stated": holds(measure("mass", 3.1, "kg", error=0.01) > 3.0, trials=100),
    "limit": Evaluation(math.inf),
    "open": Evaluation([[1.0, math.nan]]),
}


@pytest.fixture
def rows(tmp_path):
    """The claims of every kind in two readings, as they are written."""
    failed = EVALUATIONS | {"mass": Evaluation(math.nan), "near": None, "drawn": Evaluation([math.nan, 1.0], None, 0)}
    evaluations = {"corrected": EVALUATIONS, "printed": failed}
    turned = {"stated": Counterexample(change="scaled", of="flights.final_state", amount=1.1, to="fails")}
    cause = Cause(
        choice="form",
        why="not printed",
        value="odd",
        where="universe 3",
        verdict="holds",
        number=1349.0,
        corrected=None,
    )
    counted = {"true": 3, "undetermined": 1, "deciding": 63, "of": 64, "low": 0.01, "high": math.nan}
    standing = Standing(label="depends", alone=("form",), **counted, cause=cause)
    rows = collect(CLAIMS, DECLARATIONS, evaluations)
    rows = [
        row.model_copy(
            update={"counterexample": turned.get(row.id), "universes": standing if row.id == "mass" else None}
        )
        for row in rows
    ]
    write_claims(rows, tmp_path / "claims.json")
    return json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))


def test_the_claims_of_every_kind_are_valid(rows):
    assert {row["kind"] for row in rows} == set(SCHEMA["$defs"]["Claim"]["properties"]["kind"]["enum"])
    assert [row["universes"]["label"] for row in rows if row["universes"]] == ["depends"]
    assert faults(rows) == []


def test_a_mistake_in_a_claim_is_refused(rows):
    wrong = {"verdict": "wrong", "printed": {"a": 1}, "trials": 0, "resolution": -1, "colour": "red"}
    for key, value in {**wrong, "readings": {"corrected": {"value": 1}}}.items():
        assert faults([rows[0] | {key: value}]), key
    for key in rows[0]:
        assert faults([{name: value for name, value in rows[0].items() if name != key}]), key
