"""The comparisons ask for what there is, in the types that the stages return, and are given it."""

import sys
import types
import typing
from importlib import import_module

import pytest

from marsedl.comparison import comparisons
from marsedl.comparison.records import COLORS, NAMES, collect
from marsedl.papers import SLUGS, catalogue
from marsedl.replication.inputs.sections import Positive, Section, given

COMPARISONS = comparisons()
EVERY = [(stem, slug) for stem, comparison in COMPARISONS.items() for slug in comparison.papers]


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
    function = getattr(import_module(f"marsedl.comparison.{stem}"), slug)
    parameters, hints = COMPARISONS[stem].takes[slug], typing.get_type_hints(function)
    assert parameters.needs, "nothing is said of a paper without its artifacts"
    for need in parameters.needs + parameters.optional:
        kind, hint = artifact_type(slug, need), hints[need.split(".")[-1]]
        assert hint == kind or set(typing.get_args(hint)) == {kind, type(None)}


class Tiny(tuple):
    """An artifact."""


class Body(Section):
    """One input."""

    factor: Positive = given("1", "a factor")


def funnels(body: Body, nominal: Tiny, large: Tiny | None = None):
    return body.factor * sum(nominal), large


def test_artifacts_and_inputs_reach_the_function_of_their_paper(monkeypatch):
    module = types.ModuleType("marsedl.comparison.tiny")
    module.funnels = funnels
    monkeypatch.setitem(sys.modules, "marsedl.comparison.tiny", module)
    stored = {("nominal.h5", Tiny): Tiny([1.0, 2.0]), ("large.h5", Tiny): Tiny([3.0])}

    def collected(factor, **files):
        return collect("tiny", {"funnels": {"body.factor": factor}}, {"funnels": files}, lambda *key: stored[key])

    assert collected(2.0, nominal="nominal.h5") == {"funnels": (6.0, None)}
    assert collected(1.0, nominal="nominal.h5", large="large.h5") == {"funnels": (3.0, Tiny([3.0]))}
