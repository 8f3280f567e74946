"""Numbers and verdicts of the full size against the committed ones, as far as minutes allow.

`marsedl verify` compares all of them after `snakemake all`. Here: every stage of the smoke build that no smaller size
changes, and two papers whole, in memory.
"""

from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claiming import claims_of
from marsedl.replication.claims import collect, load_measured, load_published, read_claims, write_claims
from marsedl.replication.graph import Memory, Run
from marsedl.replication.inputs import load_study
from marsedl.replication.sharing import Shared
from marsedl.replication.verification import compare, fingerprints, format_changes, read_reference
from marsedl.schemas import claims_schema

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "data" / "reference" / "benchmarks.csv"
READINGS = ("corrected", "printed")  # which the smoke size builds
IN_MEMORY = ("powered_descent", "stochastic_entry")


def study_of(slug, size="full"):
    return load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml", size=size)


def inputs_behind(paper, stage):
    """The names of the inputs that a stage and those before it read."""
    declared = paper.stages[stage]
    return set(declared.inputs).union(*(inputs_behind(paper, need) for need in declared.needs))


@pytest.mark.parametrize("slug", SLUGS)
def test_stages_that_no_size_changes_have_the_committed_numbers(copied, slug, monkeypatch):
    monkeypatch.chdir(ROOT)
    paper, full, smoke = catalogue(slug), study_of(slug), study_of(slug, "smoke")
    shared, files = Shared(paper, smoke), {}
    for reading in READINGS:
        values, small = full.readings[reading].inputs.plain(), smoke.readings[reading].inputs.plain()
        for stage in paper.stages:
            equal = all(repr(values[name]) == repr(small[name]) for name in inputs_behind(paper, stage))
            if equal and not stage.startswith("montecarlo") and shared.has(reading, stage):
                files[f"{reading}/{stage}"] = copied.build / shared.file(reading, stage)
    assert {"corrected/nominal", "corrected/linearization"} <= files.keys()
    committed = {k: v for k, v in read_reference(ROOT, slug).items() if k.rpartition("/")[0] in files}
    found = {k: v for k, v in fingerprints(copied.build, slug, files).items() if k.rpartition("/")[0] in files}
    comparison = compare(committed, found, paper.noise)
    assert len(comparison.margins) > 10
    assert not comparison.changes, format_changes(comparison.changes)


@pytest.mark.parametrize("slug", IN_MEMORY)
def test_a_paper_at_full_size_has_the_committed_verdicts(slug, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    paper, study, memory, claims = catalogue(slug), study_of(slug), Memory(), claims_of(slug)
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    by_id, measured = {claim.id: claim for claim in published}, load_measured(BENCHMARKS, slug)
    evaluated = {
        name: Run.of(paper, study.readings[name].inputs, memory).evaluations(by_id, measured=measured)
        for name in READINGS
    }
    rows = collect(published, claims.declarations, evaluated, left_out=study.readings.keys() - {*READINGS})
    reference = read_reference(ROOT, slug)
    moved = {
        (row["id"], name): (reference[f"verdicts/{row['id']}"].get(name), row["readings"][name]["verdict"])
        for row in rows
        for name in READINGS
    }
    assert {claim: verdicts for claim, verdicts in moved.items() if verdicts[0] != verdicts[1]} == {}
    write_claims(rows, tmp_path / "claims.json")
    written = read_claims(tmp_path / "claims.json")
    assert not [error.message for error in Draft202012Validator(claims_schema()).iter_errors(written)]


@pytest.mark.parametrize("slug", SLUGS)
def test_every_committed_difference_has_a_reason(slug):
    declarations = claims_of(slug).declarations
    refuted = [
        name.removeprefix("verdicts/")
        for name, verdicts in read_reference(ROOT, slug).items()
        if name.startswith("verdicts/") and verdicts.get("corrected") in ("differs", "fails")
    ]
    assert refuted
    for claim in refuted:
        assert declarations[claim].errata or declarations[claim].withheld, claim
