"""The comparisons ask for what there is: every paper, its stages and inputs, in the types that the stages return."""

import inspect
import typing
from importlib import import_module

import pytest

from marsedl.comparison import COMPARISONS
from marsedl.comparison.records import COLORS, NAMES
from marsedl.papers import SLUGS, catalogue, input_model

EVERY = [(stem, slug) for stem, comparison in COMPARISONS.items() for slug in comparison.papers]


def function(stem, slug):
    return getattr(import_module(f"marsedl.comparison.{stem}"), slug)


def artifact_type(slug, need):
    """What the stage that writes an artifact returns."""
    module, name = catalogue(slug).entry(need.split(".")[0]).split(":")
    return typing.get_type_hints(getattr(import_module(module), name))["return"]


def test_every_comparison_is_of_the_same_papers_which_are_told_apart():
    assert len(NAMES) >= 5, "a new paper may join, none may vanish"
    assert set(NAMES) <= set(SLUGS)
    assert len(set(NAMES.values())) == len(set(COLORS.values())) == len(NAMES)
    for comparison in COMPARISONS.values():
        assert comparison.papers == tuple(comparison.inputs)
        assert set(comparison.papers) == set(NAMES)


@pytest.mark.parametrize(("stem", "slug"), EVERY)
def test_what_a_comparison_needs_exists(stem, slug):
    comparison, paper, model = COMPARISONS[stem], catalogue(slug), input_model(slug)
    assert set(comparison.inputs[slug]) <= set(model.model_fields)
    assert comparison.needs[slug], "nothing is said of a paper without its artifacts"
    for need in comparison.needs[slug]:
        stage, _, case = need.partition(".")
        assert stage in paper.stages
        assert (case in model.CASES) == (stage == "montecarlo")


@pytest.mark.parametrize(("stem", "slug"), EVERY)
def test_the_function_of_a_paper_takes_what_is_declared(stem, slug):
    comparison = COMPARISONS[stem]
    hints, parameters = typing.get_type_hints(function(stem, slug)), inspect.signature(function(stem, slug)).parameters
    given = [need.split(".")[-1] for need in comparison.needs[slug]]
    assert list(parameters) == ["inputs", *given, *["measured"] * comparison.measured]
    for need, name in zip(comparison.needs[slug], given, strict=True):
        kind = artifact_type(slug, need)
        assert hints[name] == kind or set(typing.get_args(hints[name])) == {kind, type(None)}


@pytest.mark.parametrize("stem", COMPARISONS)
def test_captions_are_sentences(stem):
    for caption in (COMPARISONS[stem].figure, COMPARISONS[stem].table):
        assert caption[0].isupper()
        assert caption.endswith(".")
        assert "  " not in caption
