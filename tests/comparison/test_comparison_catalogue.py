"""The comparisons ask for what there is: every paper, its stages and inputs, in the types that the stages return."""

import typing
from importlib import import_module

import pytest

from marsedl.comparison import comparisons
from marsedl.comparison.records import COLORS, NAMES
from marsedl.papers import SLUGS, catalogue

COMPARISONS = comparisons()
EVERY = [(stem, slug) for stem, comparison in COMPARISONS.items() for slug in comparison.papers]


def function(stem, slug):
    return getattr(import_module(f"marsedl.comparison.{stem}"), slug)


def artifact_type(slug, need):
    """What the stage that writes an artifact returns."""
    module, name = catalogue(slug).stages[need.split(".")[0]].entries[-1].split(":")
    return typing.get_type_hints(getattr(import_module(module), name))["return"]


def test_every_comparison_is_of_the_same_papers_which_are_told_apart():
    assert len(NAMES) >= 5, "a new paper may join, none may vanish"
    assert set(NAMES) <= set(SLUGS)
    assert len(set(NAMES.values())) == len(set(COLORS.values())) == len(NAMES)
    for comparison in COMPARISONS.values():
        assert set(comparison.papers) == set(NAMES)


@pytest.mark.parametrize(("stem", "slug"), EVERY)
def test_artifacts_have_the_types_that_their_stages_return(stem, slug):
    parameters, hints = COMPARISONS[stem].takes[slug], typing.get_type_hints(function(stem, slug))
    assert parameters.needs, "nothing is said of a paper without its artifacts"
    for need in parameters.needs + parameters.optional:
        kind, hint = artifact_type(slug, need), hints[need.split(".")[-1]]
        assert hint == kind or set(typing.get_args(hint)) == {kind, type(None)}
