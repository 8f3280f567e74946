"""Every counted claim can fail: in the full build its counterexample gives another verdict."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS
from marsedl.replication.checks.reference import NOT_TURNED
from marsedl.replication.claims.claim import COUNTED_VERDICTS, UNDECIDED
from marsedl.replication.claims.committed import committed_verdicts, read_reference
from marsedl.replication.claims.printed import load_published

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("slug", SLUGS)
def test_every_counted_claim_is_turned_by_its_counterexample(slug):
    verdicts, reference = committed_verdicts(ROOT, slug), read_reference(ROOT, slug)
    for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml"):
        verdict = verdicts[claim.id].get("corrected")
        if verdict in COUNTED_VERDICTS and claim.kind != UNDECIDED:
            assert reference.get(f"counterexamples/{claim.id}", NOT_TURNED) != NOT_TURNED, claim.id


@pytest.mark.parametrize("slug", SLUGS)
def test_a_paper_has_a_headline_of_four_or_five_counted_claims(slug):
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    headline = sorted((claim for claim in published if claim.headline), key=lambda claim: claim.headline)
    assert len(headline) in (4, 5)
    verdicts = committed_verdicts(ROOT, slug)
    assert {verdicts[claim.id]["corrected"] for claim in headline} <= set(COUNTED_VERDICTS)
