"""How far a figure looks as the paper's own one, by the verdicts on what the paper says of it."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.claim import Claim
from marsedl.replication.errors import InputError
from marsedl.replication.pipeline.catalogue import Paper, Product
from marsedl.replication.report.likeness import NOT_COMPARABLE, OTHER, OTHER_SCALE, SAME, likeness
from marsedl.replication.report.texts import with_texts

ROOT = Path(__file__).parents[3]


def claim(name: str, kind: str, verdict: str) -> Claim:
    """A claim as it is read from a build."""
    given = {"paper": "toy", "id": name, "plain": f"{name} is so", "kind": kind, "printed": 5.0, "verdict": verdict}
    return Claim.model_validate({**given, "reading": "corrected", "readings": {"corrected": {"verdict": verdict}}})


KINDS = {
    "grows": ("qualitative", "holds"),
    "jumps": ("qualitative", "fails"),
    "peak": ("deterministic", "differs"),
    "blunt": ("qualitative", "fails"),
    "drawn": ("qualitative", "by_construction"),
    "close": ("qualitative", "undetermined"),
}
ROWS = {name: claim(name, *kind) for name, kind in KINDS.items()}


@pytest.mark.parametrize(
    ("claims", "expected", "why"),
    [
        (("grows", "close"), SAME, "It stands: grows is so"),
        (("grows", "peak"), OTHER_SCALE, "1 of 2 claims on it does not stand: peak is so"),
        (("grows", "peak", "jumps"), OTHER, "2 of 3 claims on it do not stand: jumps is so"),
        (("grows", "blunt"), OTHER_SCALE, "1 of 2 claims on it does not stand: blunt is so"),
        (("drawn",), NOT_COMPARABLE, "What the paper says of it cannot fail."),
        (("close", "drawn"), NOT_COMPARABLE, "What the paper says of it is undetermined."),
    ],
)
def test_the_shape_is_another_one_if_a_claim_about_it_fails_and_the_scale_if_another_does(claims, expected, why):
    assert likeness(Product("", claims=claims, shape=("grows", "jumps")), ROWS) == (expected, why)
    assert likeness(Product("", claims=claims, not_comparable="A sketch."), ROWS) == (NOT_COMPARABLE, "A sketch.")


def test_a_figure_without_claims_says_why_it_cannot_be_compared(tmp_path):
    for slug in SLUGS:
        for one in catalogue(slug).figures.values():
            assert one.beyond or bool(one.claims) != bool(one.not_comparable)
    path, paper = tmp_path / "texts.yaml", Paper("toy", "", "", "")
    for more, message in {"": "no likeness", "    claims: [mean]\n    not_comparable: A sketch.\n": "has both"}.items():
        path.write_text(f"figures:\n  fig01:\n    caption: A curve.\n    shows: A curve.\n{more}", encoding="utf-8")
        with pytest.raises(InputError, match=rf"figures.fig01: {message}; name the claims about it"):
            with_texts(paper, path)
