"""Every artifact and claim at full size: every verdict with its reason, the numbers against committed ones."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from jsonschema import Draft202012Validator

from marsedl.papers import SLUGS, catalogue, input_model, rounding_noise
from marsedl.replication.artifacts import opened
from marsedl.replication.claims import (
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    LISTED_VERDICTS,
    UNEXPLAINED,
    load_published,
)
from marsedl.replication.inputs import load_study
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import compare_reference, read_reference
from marsedl.schemas import claims_schema

pytestmark = pytest.mark.workflow
SIZE = "check"
ROOT = Path(__file__).parents[2]
FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}


@pytest.fixture(scope="module")
def studies(full):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(full)
        return {s: load_study(s, input_model(s), full / "configs" / f"{s}.yaml", size=SIZE) for s in SLUGS}


def every_reading(slug):
    """The names of a paper's readings at full size."""
    return load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml").readings.keys()


@pytest.fixture(scope="module")
def rows(full):
    return json.loads((build_folder(full, SIZE) / "report" / "claims.json").read_text(encoding="utf-8"))


def test_the_numbers_agree_with_the_committed_ones(full, studies, capsys):
    built = {slug: study.compared for slug, study in studies.items()}
    shared = {slug: Shared(catalogue(slug), study) for slug, study in studies.items()}
    assert compare_reference(full, shared, rounding_noise(), built, SIZE), capsys.readouterr().out


def test_every_printed_claim_has_a_computed_verdict_and_every_difference_a_reason(full, rows):
    for slug in SLUGS:
        published = load_published(full / "data" / "published" / f"{slug}.yaml")
        mine = {row["id"]: row for row in rows if row["paper"] == slug}
        assert set(mine) == {claim.id for claim in published}
    for row in rows:
        stated = row["kind"] in ("input", "context")
        allowed = LISTED_VERDICTS if stated else (*COUNTED_VERDICTS, BY_CONSTRUCTION)
        assert row["verdict"] in allowed, row["id"]
        assert row["reason"] != UNEXPLAINED, row["id"]
        if row["verdict"] in ("differs", "fails"):
            assert re.search(r"\bE\d+\b", row["reason"]) or "withheld" in row["reason"] or row["withheld"], row["id"]
        assert {"value", "standard_error", "trials"} <= set(row["readings"]["corrected"])


def test_the_claims_are_as_their_published_schema_says(rows):
    assert not [error.message for error in Draft202012Validator(claims_schema()).iter_errors(rows)]


@pytest.mark.parametrize(("slug", "claim"), [(slug, claim) for slug in SLUGS for claim in FACTS[slug]["trials"]])
def test_the_ensembles_have_the_sizes_that_are_claimed(rows, slug, claim):
    expected = FACTS[slug]["trials"][claim]
    readings = next(row for row in rows if (row["paper"], row["id"]) == (slug, claim))["readings"]
    assert expected.keys() - {"others"} <= every_reading(slug), "a reading that does not exist"
    actual = {name: reading["trials"] for name, reading in readings.items()}
    assert actual == {name: expected.get(name, expected["others"]) for name in readings}


@pytest.mark.parametrize("slug", SLUGS)
def test_every_reading_has_all_of_its_trials(full, studies, slug):
    """Counted in the artifacts, those that are not finite included."""
    for name in studies[slug].compared:
        for case, size in input_model(slug).CASES.items():
            if trials := studies[slug].readings[name].inputs.get(size):
                path = Shared(catalogue(slug), studies[slug]).file(name, f"montecarlo.{case}")
                with opened(build_folder(full, SIZE) / path) as file:
                    assert file["outcome"].shape[-1] == trials  # of each law, where there are several
                    assert np.all(file["count"][()] + file["excluded"][()] == trials)


@pytest.mark.parametrize(
    ("slug", "claim", "reading", "verdict"),
    [
        (slug, claim, reading, verdict)
        for slug in SLUGS
        for claim, verdicts in FACTS[slug]["verdicts"].items()
        for reading, verdict in verdicts.items()
    ],
)
def test_what_the_readings_reproduce(slug, claim, reading, verdict):
    """The findings that the documentation rests on, as committed; any of them may only change together with it."""
    assert read_reference(ROOT, slug)[f"verdicts/{claim}"][reading] == verdict
