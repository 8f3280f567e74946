"""The published JSON Schemas: they are those of the code, they take what marsedl takes, and they name every key."""

import json
import math
import re
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

import marsedl
from marsedl import schemas
from marsedl.papers import SLUGS, input_model
from marsedl.replication.claims.claim import Counterexample, Standing, Tolerance
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.rows import write_claims
from marsedl.replication.claims.verdicts import Declaration, Evaluation, collect
from marsedl.replication.claims.writing import holds, measure
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.inputs.yaml_file import read_yaml

ROOT = Path(__file__).parents[1]
PUBLISHED = ROOT / "docs" / "schemas"
SCHEMAS = schemas.schemas()
OWN = """\
powered_descent:
  readings:
    mine:
      based_on: corrected
      summary: Another engine.
      noise: {noise_coefficient: {value: 0.03, source: "assumed: another engine"}}
      entry:
        source: Eq. 51
        initial_velocity_angle_deg: {value: 70, unit: deg}
        initial_covariance: {value: [40.0, 40.0, 5.0, 5.0]}
size: smoke
chunks: 2
"""
FAULTS = {
    "an unknown section": ("noise:", "noises:"),
    "an unknown input": ("noise_coefficient", "noise_coeficient"),
    "an angle without its unit": ("_angle_deg", "_angle"),
    "another unit": ("unit: deg", "unit: rad"),
    "a text for a number": ("value: 0.03", "value: much"),
    "true for a number": ("value: 0.03", "value: true"),
    "a negative noise": ("value: 0.03", "value: -0.03"),
    "no source": ("source: Eq. 51", ""),
    "an assumption without its reason": ("assumed: another engine", "assumed"),
    "three variances of four": ("[40.0, 40.0, 5.0, 5.0]", "[40.0, 40.0, 5.0]"),
    "an input that is a bare number": ('{value: 0.03, source: "assumed: another engine"}', "0.03"),
    "an unknown key of an input": ("value: 70,", "value: 70, note: steep,"),
    "a name of no reading": ("mine:", "Mine:"),
    "an unknown paper": ("powered_descent", "powered_ascent"),
    "no jobs": ("chunks: 2", "chunks: 0"),
    "inputs outside of a reading": ("  readings:", "  noise: {}\n  readings:"),
}


def faults(name, document):
    """What a schema finds wrong with a document, in words."""
    return [error.message for error in Draft202012Validator(SCHEMAS[name]).iter_errors(document)]


def keys(schema, root, path=""):
    """Every key that a schema has, by the path to it, with its schema; definitions are followed where they are used."""
    if "$ref" in schema:
        target = root
        for name in schema["$ref"].removeprefix("#/").split("/"):
            target = target[name]
        schema = {**target, **schema}
    yield path, schema
    for name, inner in schema.get("properties", {}).items():
        yield from keys(inner, root, f"{path}.{name}")
    named = schema.get("patternProperties", {}).values()
    inside = [schema.get("items"), schema.get("additionalProperties"), *named, *schema.get("anyOf", ())]
    for inner in inside:
        if isinstance(inner, dict) and inner.keys() & {"$ref", "properties", "items"}:
            yield from keys({"description": schema.get("description"), **inner}, root, path)


def test_the_committed_schemas_are_what_is_made(tmp_path):
    schemas.write_schemas(tmp_path)
    assert sorted(path.name for path in PUBLISHED.iterdir()) == sorted(SCHEMAS)
    for path in PUBLISHED.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), f"{path.name}: run 'make schemas'"
        assert json.loads(path.read_bytes()) == SCHEMAS[path.name]


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_is_one_and_describes_every_key(name):
    descriptions = dict(keys(SCHEMAS[name], SCHEMAS[name]))
    assert len(descriptions) > 20
    assert [path for path, schema in descriptions.items() if not (schema.get("description") or "").strip()] == []
    Draft202012Validator.check_schema(SCHEMAS[name])
    assert re.fullmatch(rf"urn:marsedl:schema:{schemas.VERSION}:[a-z_:]+", SCHEMAS[name]["$id"])
    assert f"marsedl {marsedl.__version__};" in SCHEMAS[name]["$comment"]


@pytest.mark.parametrize("slug", SLUGS)
def test_a_papers_configuration_is_valid(slug):
    assert faults(f"configuration_{slug}.json", read_yaml(ROOT / "configs" / f"{slug}.yaml")) == []


def test_a_configuration_of_ones_own_is_valid_for_both(tmp_path):
    assert faults("configuration_own.json", yaml.safe_load(OWN)) == []
    assert "mine" in studies(tmp_path, OWN)["powered_descent"].readings


@pytest.mark.parametrize("fault", FAULTS)
def test_what_a_schema_refuses_marsedl_refuses(fault, tmp_path):
    right, wrong = FAULTS[fault]
    text = OWN.replace(right, wrong)
    assert text != OWN
    assert faults("configuration_own.json", yaml.safe_load(text))
    with pytest.raises(InputError):
        studies(tmp_path, text)


def studies(folder, text):
    """What marsedl makes of a file of a user's own."""
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_studies({slug: input_model(slug) for slug in SLUGS}, ROOT, config_files=[path])


# ----------------------------------------------------------------------------------------------------------- the claims

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
    standing = Standing(stands="depends", on=("form",), true=3, of=64, low=0.01, high=math.nan, cause=("form", "odd"))
    rows = collect(CLAIMS, DECLARATIONS, evaluations)
    rows = [
        row.model_copy(update={"counterexample": turned.get(row.id), "universes": standing if row.headline else None})
        for row in rows
    ]
    write_claims(rows, tmp_path / "claims.json")
    return json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))


def test_the_claims_of_every_kind_are_valid(rows):
    kinds = next(schema for path, schema in keys(SCHEMAS["claims.json"], SCHEMAS["claims.json"]) if path == ".kind")
    assert {row["kind"] for row in rows} == set(kinds["enum"])
    assert faults("claims.json", rows) == []


def test_a_mistake_in_a_claim_is_refused(rows):
    wrong = {"verdict": "wrong", "printed": {"a": 1}, "trials": 0, "resolution": -1, "colour": "red"}
    for key, value in {**wrong, "readings": {"corrected": {"value": 1}}}.items():
        assert faults("claims.json", [rows[0] | {key: value}]), key
    for key in rows[0]:
        assert faults("claims.json", [{name: value for name, value in rows[0].items() if name != key}]), key
