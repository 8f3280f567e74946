"""The picture of headline claims, and what a paper's texts say of each."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.plotting.headlines import bar_of, headline_picture, limit_of
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.printed import load_published
from marsedl.replication.errors import InputError
from marsedl.replication.report.texts import check_found

ROOT = Path(__file__).parents[2]


def claim(name: str, printed, value, unit: str = "m", headline: int | None = None, margin: dict | None = None) -> Claim:
    """A claim as it is read from a build."""
    kind = "qualitative" if isinstance(printed, bool) else "monte_carlo"
    verdict = ("holds" if value else "fails") if kind == "qualitative" else "differs"
    result = {"value": value, "standard_error": None, "trials": None, "verdict": verdict, "margin": margin}
    given = {"paper": "toy", "id": name, "plain": f"{name} is so", "unit": unit, "kind": kind, "printed": printed}
    judged = {"headline": headline, "verdict": verdict, "reading": "corrected", "readings": {"corrected": result}}
    return Claim.model_validate(given | judged)


def margin(value: float, limit: float) -> dict:
    """The measure that decides a statement."""
    fixed = {"measure": "it", "unit": "kg", "distance": 1.0, "in": "limits", "standard_error": 0.02}
    return fixed | {"value": value, "limit": limit}


def test_every_headline_claim_is_in_the_picture_at_its_numbers():
    rows = [
        claim("range", [-2.0, 3.0], [-1.0, 4.0], headline=1),
        claim("mass", 5.0, 4.0, headline=2),
        claim("small", True, True, headline=3, margin=margin(0.5, 1.0)),
        claim("other", 7.0, 7.0),
    ]
    ends, single, statement = headline_picture(rows, {"Range": {"both ends": "range"}}).axes
    assert [list(line.get_xdata()) for line in ends.lines[:2]] == [[-2.0, 3.0], [-1.0, 4.0]]
    assert list(single.lines[0].get_xdata()) == [5.0, 4.0]
    assert statement.containers[1].lines[0].get_xdata() == pytest.approx([0.5])
    texts = [text.get_text() for ax in (ends, single, statement) for text in ax.texts]
    assert texts == [
        *("both ends", "differs: printed -2 to 3 m, ours -1 to 4 m"),
        *("mass is so", "differs: printed 5 m, ours 4 m"),
        *("small is so", "holds: 0.500 ± 0.020; at most 1 kg", "measure: it"),
    ]
    assert [ax.get_title("left")[:4] for ax in (ends, single, statement)] == ["(a) ", "(b) ", "(c) "]
    assert min(text.get_fontsize() for ax in (ends, single, statement) for text in ax.texts) >= 8


def test_texts_are_as_narrow_as_a_phone_and_none_is_cut_off():
    long = claim("mass", True, True, headline=1, margin=margin(0.5, 1.0) | {"measure": " ".join(["word"] * 40)})
    figure = headline_picture([long.model_copy(update={"plain": "The mass of all of the vehicles " * 4})], {})
    figure.draw_without_rendering()
    (ax,) = figure.axes
    assert figure.get_size_inches()[0] * 80 <= 358, "pixels that a phone has"
    assert " ".join(text.get_text() for text in ax.texts).count("word") == 40
    boxes = [text.get_window_extent() for text in ax.texts]
    assert max(box.x1 for box in boxes) <= figure.bbox.x1
    assert all(above.y0 >= below.y0 for above, below in itertools.pairwise(boxes))


@pytest.mark.parametrize("ratio", [1e-7, 3e6])
def test_a_number_far_from_its_limit_does_not_stretch_the_axis(ratio):
    rows = [claim("small", True, True, headline=1, margin=margin(ratio, 1.0) | {"standard_error": 0.0})]
    (ax,) = headline_picture(rows, {}).axes
    assert ax.get_xlim() == (0.05, 20.0)
    assert ax.containers[1].lines[0].get_marker() == ("<" if ratio < 1.0 else ">")


def test_numbers_of_several_units_are_drawn_over_what_is_printed():
    rows = {"state": claim("state", [4.0, 0.2], [5.0, 0.1], unit="m^2, (m/s)^2", headline=1)}
    (ax,) = headline_picture(rows.values(), {"State": {"place": "state[0]", "velocity": "state[1]"}}).axes
    assert [list(line.get_xdata()) for line in ax.lines if len(line.get_xdata()) == 2] == [[1.0, 1.25], [1.0, 0.5]]
    assert bar_of("velocity", "state[1]", rows).unit == "(m/s)^2"
    with pytest.raises(InputError, match="'stat' is no printed number; did you mean 'state'"):
        bar_of("place", "stat", rows)


@pytest.mark.parametrize(
    ("value", "holds", "above"), [(2.0, True, True), (2.0, False, False), (0.5, True, False), (0.5, False, True)]
)
def test_a_statement_holds_on_the_side_of_its_limit_where_it_was_found_to(value, holds, above):
    one = limit_of(claim("small", True, holds, headline=1, margin=margin(value, 1.0)))
    assert (one.ratio, one.holds_above) == (value, above)
    assert np.isinf(limit_of(claim("small", True, holds, headline=1, margin=margin(value, 0.0))).ratio)


@pytest.mark.parametrize("slug", SLUGS)
def test_the_texts_say_of_each_headline_claim_what_came_out(slug):
    paper = catalogue(slug)
    headline = [one.id for one in load_published(ROOT / f"data/published/{slug}.yaml") if one.headline]
    check_found(paper, headline)
    assert [name for name in headline if f"{{{name}" not in paper.found[name]] == [], "each quotes its own number"
    with pytest.raises(InputError, match=rf"found: nothing on the headline claim '{headline[0]}'"):
        check_found(replace(paper, found={}), headline)
    with pytest.raises(InputError, match="'another' is no headline claim"):
        check_found(replace(paper, found={**paper.found, "another": "x"}), headline)
