"""Figures mark the printed numbers that they are said to; `unmarked` says why of all others."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color

from drawn import labels
from marsedl.papers import SLUGS, catalogue
from marsedl.plotting.style import PURPLE
from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.claims.printed import load_published

COUNTED = ("deterministic", "monte_carlo", "undetermined")
MARKED = [(slug, stem) for slug in SLUGS for stem, one in catalogue(slug).figures.items() if one.published]
NAMES_ONLY = [("desensitized", "fig02")]  # names its curves by printed weights


@cache
def published_of(slug):
    """The printed claims of a paper by id."""
    return {one.id: one for one in load_published(Path(__file__).parents[2] / f"data/published/{slug}.yaml")}


def numbers_of(slug):
    """Printed numbers by the id of the claim."""
    claims = {one.id: flatten(one.printed).values() for one in published_of(slug).values() if one.kind in COUNTED}
    return {id: list(values) for id, values in claims.items() if all(map(is_number, values))}


@pytest.mark.parametrize("slug", SLUGS)
def test_every_printed_number_is_one_of_a_figure_or_says_why_not(slug):
    paper, numbers = catalogue(slug), numbers_of(slug)
    shown = {id for one in paper.figures.values() for id in one.claims if one.published}
    assert numbers.keys() - shown == {*paper.unmarked}
    for one in paper.figures.values():
        assert {*one.shape} <= {*one.claims} <= published_of(slug).keys()
        assert one.published or not (numbers.keys() & {*one.claims}) - paper.unmarked.keys()


@pytest.mark.parametrize(("slug", "stem"), [one for one in MARKED if one not in NAMES_ONLY])
def test_what_a_figure_says_is_printed_is_drawn(request, slug, stem):
    made = request.getfixturevalue({"powered_descent": "pipeline", "stochastic_entry": "entry"}.get(slug, slug))
    product = made.paper.figures[stem]
    figure = made.figure(stem, published=published_of(slug))
    assert any("printed" in label for label in labels(figure))
    lines = [line for axes in figure.axes for line in axes.lines if same_color(line.get_color(), PURPLE)]
    x, y = np.abs(np.concatenate([np.transpose(line.get_data()) for line in lines]).astype(float)).T
    with np.errstate(divide="ignore", invalid="ignore"):
        places, ratios = np.concatenate([x, y]), np.concatenate([y / x, x / y])
    for id in numbers_of(slug).keys() & {*product.claims} - made.paper.unmarked.keys():
        unit, values = published_of(slug)[id].unit, np.abs(numbers_of(slug)[id])
        drawn = ratios if unit == "1" else places
        found = [any(np.isclose(drawn, value * factor).any() for factor in (1e-3, 1.0, 1e3)) for value in values]
        assert any(found) if ", " in unit else all(found), id  # of several quantities, a figure shows some
