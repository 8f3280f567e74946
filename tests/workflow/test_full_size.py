"""Numbers and verdicts of the full size against the committed ones, as far as minutes allow.

`marsedl verify` compares all of them after `snakemake all`. Here: every stage of the smoke build that no smaller size
changes, and a paper whole, in memory (another with `-m long`).
"""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.checks.reference import compare, fingerprints, format_changes
from marsedl.replication.claims.committed import read_reference
from marsedl.replication.claims.names import COUNTED_VERDICTS
from marsedl.replication.claims.printed import load_measured, load_published
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.claims.verdicts import Declaration, judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.pipeline.sharing import Shared

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "data" / "reference" / "benchmarks.csv"
READINGS = ("corrected", "printed")  # whose artifacts are made as files
IN_MEMORY = ("powered_descent", pytest.param("stochastic_entry", marks=pytest.mark.long))


def study_of(slug, size="full"):
    return load_study(slug, input_model(slug), ROOT, size=size)


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
    assert {name.split("/")[0] for name in files} == {*READINGS}
    committed = {k: v for k, v in read_reference(ROOT, slug).items() if k.rpartition("/")[0] in files}
    rows = read_claims(copied.build / f"report/claims/{slug}.json")
    found = {k: v for k, v in fingerprints(rows, files).items() if k.rpartition("/")[0] in files}
    both = compare(committed, found, paper.noise)
    assert both
    assert not format_changes(both)


@pytest.mark.parametrize("slug", IN_MEMORY)
def test_a_paper_at_full_size_has_the_committed_verdicts(slug, monkeypatch):
    monkeypatch.chdir(ROOT)
    published = {claim.id: claim for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml")}
    run = Run.of(catalogue(slug), study_of(slug).readings["corrected"].inputs, Memory())
    evaluations = claims_of(slug).evaluate(run.given(), published, measured=load_measured(BENCHMARKS, slug))
    reference, declarations, moved = read_reference(ROOT, slug), claims_of(slug).declarations, {}
    for name, claim in published.items():
        committed = reference[f"verdicts/{name}"].get("corrected")
        if committed in COUNTED_VERDICTS:
            found = judge(claim, evaluations[name], declarations.get(name, Declaration())).verdict
            if found != committed:
                moved[name] = committed, found
    assert moved == {}


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
        assert declarations[claim].errata or declarations[claim].choices, claim
