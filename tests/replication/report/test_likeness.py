"""How far a figure looks as the paper's own one, by the verdicts on what the paper says of it."""

from pathlib import Path

import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.plotting.curves import printed_mark
from marsedl.plotting.style import new_figure, save_figure
from marsedl.replication.claims.claim import Claim
from marsedl.replication.errors import InputError
from marsedl.replication.pipeline.catalogue import Paper, Product
from marsedl.replication.report.likeness import NOT_COMPARABLE, OTHER, OTHER_SCALE, SAME, likeness
from marsedl.replication.report.pictures import printed_places
from marsedl.replication.report.texts import with_texts

ROOT = Path(__file__).parents[3]


NEAR = "No printed number that it draws is off by more than 5% of its axis."
DIFFER, DIFFERS, AGREE = (f"claims about it {does} with what we find" for does in ("disagree", "disagrees", "agree"))


def claim(name: str, kind: str, verdict: str, printed=5.0, value=None) -> Claim:
    """A claim as it is read from a build."""
    given = {"paper": "toy", "id": name, "plain": f"{name} is so", "kind": kind, "printed": printed, "verdict": verdict}
    result = {"verdict": verdict, "value": value}
    return Claim.model_validate({**given, "reading": "corrected", "readings": {"corrected": result}})


KINDS = {
    "grows": ("qualitative", "holds"),
    "right": ("deterministic", "reproduced"),
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
        (("grows", "close"), SAME, "The claim about it agrees with what we find: “grows is so”."),
        (
            ("grows", "drawn", "right"),
            SAME,
            f"All 2 {AGREE}: “grows is so”; “right is so”.",
        ),
        (("peak",), SAME, f"The claim about it disagrees with what we find: “peak is so”. {NEAR}"),
        (("grows", "peak", "jumps"), OTHER, f"2 of 3 {DIFFER}: “jumps is so”; “peak is so”."),
        (("grows", "blunt"), SAME, f"1 of 2 {DIFFERS}: “blunt is so”. {NEAR}"),
        (("drawn",), NOT_COMPARABLE, "What the paper says of it cannot fail."),
        (("close", "drawn"), NOT_COMPARABLE, "What the paper says of it is undetermined."),
    ],
)
def test_the_shape_is_another_one_if_a_claim_about_it_fails(claims, expected, why):
    assert likeness(Product("", claims=claims, shape=("grows", "jumps")), ROWS) == (expected, why)
    assert likeness(Product("", claims=claims, not_comparable="A sketch."), ROWS) == (NOT_COMPARABLE, "A sketch.")


def drawn(tmp_path, limits, scale="linear", **places):
    """A figure that marks what is printed, as it is stored and read again."""
    figure, axes = new_figure()
    printed_mark(axes, **places)
    axes.set(xscale=scale, yscale=scale, xlim=limits, ylim=limits)
    save_figure(figure, tmp_path / "fig.png")
    return printed_places(tmp_path / "fig.png")


@pytest.mark.parametrize(
    ("printed", "found", "mark", "limits", "scale", "expected"),
    [
        (50.0, 49.81, {"y": 50.0}, (0.0, 500.0), "linear", SAME),  # a difference that no eye sees
        (50.0, 49.81, {"y": 50.0}, (49.0, 51.0), "linear", OTHER_SCALE),
        ([1.0, 50.0], [1.0, 49.81], {"x": 49.5, "y": 50.0}, (49.0, 51.0), "linear", OTHER_SCALE),
        (50.0, 41.0, {"x": -50.0}, (-100.0, 100.0), "linear", SAME),  # drawn with the other sign
        (50.0, 39.0, {"x": -50.0}, (-100.0, 100.0), "linear", OTHER_SCALE),
        (50.0, 10.0, {"y": 51.0}, (0.0, 100.0), "linear", SAME),  # another number is drawn
        (50.0, None, {"y": 50.0}, (0.0, 100.0), "linear", OTHER_SCALE),
        (50.0, 60.0, {"y": 50.0}, (1.0, 1e6), "log", SAME),
        (50.0, 500.0, {"x": 50.0}, (1.0, 1e6), "log", OTHER_SCALE),
    ],
)
def test_the_scale_is_another_one_if_a_number_that_is_drawn_is_visibly_off(
    tmp_path, printed, found, mark, limits, scale, expected
):
    one = claim("height", "deterministic", "differs", printed, found)
    rows, product = {"height": one, "blunt": ROWS["blunt"]}, Product("", claims=("height", "blunt"))
    found = likeness(product, rows, drawn(tmp_path, limits, scale, **mark))
    assert found[0] == expected
    assert found[1].partition(". ")[2][:2] == ("No" if expected == SAME else "A ")


def test_a_figure_without_marks_stores_none(tmp_path):
    assert drawn(tmp_path, (0.0, 2.0), x=0.5) == [(0.5, 2.0)]
    assert drawn(tmp_path, (0.0, 2.0), x=0.5, y=0.25) == [(0.5, 2.0), (0.25, 2.0)]
    assert drawn(tmp_path, (1.0, 10.0), "log", y=0.25) == [(0.25, pytest.approx(0.25 * np.log(10.0), rel=1e-5))]
    assert drawn(tmp_path, (0.0, 1.0)) == [] == printed_places(tmp_path / "missing.png")


def test_a_figure_without_claims_says_why_it_cannot_be_compared(tmp_path):
    for slug in SLUGS:
        for one in catalogue(slug).figures.values():
            assert one.beyond or bool(one.claims) != bool(one.not_comparable)
    path, paper = tmp_path / "texts.yaml", Paper("toy", "", "", "")
    for more, message in {"": "no likeness", "    claims: [mean]\n    not_comparable: A sketch.\n": "has both"}.items():
        path.write_text(f"figures:\n  fig01:\n    caption: A curve.\n    shows: A curve.\n{more}", encoding="utf-8")
        with pytest.raises(InputError, match=rf"figures.fig01: {message}; name the claims about it"):
            with_texts(paper, path)
