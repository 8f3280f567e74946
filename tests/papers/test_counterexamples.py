"""Every counted claim can fail: its counterexample gives another verdict. What cannot fail does so in no universe."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, input_model
from marsedl.replication.checks.reference import NOT_TURNED
from marsedl.replication.claims.committed import committed_verdicts, read_reference
from marsedl.replication.claims.names import COUNTED_VERDICTS, REFUTED_VERDICTS, UNDECIDED
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.records import store
from marsedl.replication.universes.judging import COMMITTED, Judge
from marsedl.replication.universes.table import Universes

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("slug", SLUGS)
def test_every_counted_claim_is_turned_by_its_counterexample(slug):
    verdicts, reference = committed_verdicts(ROOT, slug), read_reference(ROOT, slug)
    for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml"):
        verdict = verdicts[claim.id].get("corrected")
        if verdict in COUNTED_VERDICTS and claim.kind != UNDECIDED:
            assert reference.get(f"counterexamples/{claim.id}", NOT_TURNED) != NOT_TURNED, claim.id


@pytest.mark.parametrize("slug", SLUGS)
def test_a_paper_has_a_headline_of_four_to_six_counted_claims(slug):
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    headline = sorted((claim for claim in published if claim.headline), key=lambda claim: claim.headline)
    assert len(headline) in (4, 5, 6)
    verdicts = committed_verdicts(ROOT, slug)
    assert {verdicts[claim.id]["corrected"] for claim in headline} <= set(COUNTED_VERDICTS)


@pytest.mark.parametrize("slug", SLUGS)
def test_what_cannot_fail_is_refuted_in_no_reading(slug):
    """In none of the readings of which the reference has verdicts."""
    verdicts = committed_verdicts(ROOT, slug)
    for name, declared in claims_of(slug).declarations.items():
        if declared.by_construction:
            assert not set(verdicts[name].values()) & {*REFUTED_VERDICTS, UNDECIDED}, name


@pytest.mark.parametrize("slug", [path.stem for path in sorted((ROOT / COMMITTED).glob("*.h5"))])
def test_what_cannot_fail_fails_in_no_universe(slug):
    """A claim that fails in one is no construction: it counts, or says on which inputs it rests that it cannot."""
    table = store.load(ROOT / COMMITTED / f"{slug}.h5", Universes, paper=slug)
    published, declarations = load_published(ROOT / "data" / "published" / f"{slug}.yaml"), claims_of(slug).declarations
    judge = Judge(table, load_study(slug, input_model(slug), ROOT).choices, published, declarations)
    bound = {name: one.refuted.sum() for name, one in judge.of.items() if declarations[name].by_construction}
    assert bound and not any(bound.values()), bound
