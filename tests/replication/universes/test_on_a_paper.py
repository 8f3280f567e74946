"""Universes of a paper: those that are computed are what its readings and the workflow compute."""

from copy import copy
from dataclasses import replace
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records.store import content_digest
from marsedl.replication.universes.deciding import claims_table, effects_table
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe, design
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import Evaluator, gathered, tabulated

ROOT = Path(__file__).parents[3]
SLUG = "powered_descent"
RECORDS = ("nominal", "gains", "montecarlo.closed_loop")
CORRECTED = Universe(0, ONE_AT_A_TIME, {})
CLIMBING = Universe(1, ONE_AT_A_TIME, {"initial_descent": "printed"})

pytestmark = [pytest.mark.stages, pytest.mark.xdist_group(SLUG)]


@pytest.fixture(scope="module")
def evaluator():
    made = Evaluator(catalogue(SLUG), input_model(SLUG), ROOT)
    made.limit_trials(100)
    return made


def digests(run):
    return {name: content_digest(run.record(name)) for name in RECORDS}


def test_the_universe_corrected_is_the_reading_and_another_one_is_the_inputs_that_it_sets(evaluator):
    study = evaluator.study
    reading = study.limited(study.readings["corrected"])
    assert digests(evaluator.run(CORRECTED)) == digests(Run.of(evaluator.paper, reading.inputs, Memory()))
    printed = study.readings["printed"].inputs.entry.initial_velocity_angle
    values = reading.inputs.plain() | {"entry.initial_velocity_angle": printed}
    trials = {case: reading.inputs.get(name) for case, name in reading.inputs.CASES.items()}
    by_hand = Run(evaluator.paper, values, Memory(), {case: number for case, number in trials.items() if number})
    assert digests(evaluator.run(CLIMBING)) == digests(by_hand)


def test_a_universe_is_the_same_after_others_and_memory_stays_flat(evaluator):
    first = evaluator.row(CORRECTED).outcomes
    held = []
    for number, unit in enumerate(("newton", "kilonewton", "mars_weight"), start=2):
        evaluator.row(Universe(number, ONE_AT_A_TIME, {"noise_unit": unit}))
        held.append(len(evaluator.memory))
    again = evaluator.row(CORRECTED).outcomes
    assert [one.numbers for one in again.values()] == [one.numbers for one in first.values()]
    assert held[0] == held[1] == held[2]


def test_chunks_give_the_table_of_one_process_and_what_fails_takes_only_its_claims_along(evaluator):
    universes = [CORRECTED, CLIMBING, Universe(2, ONE_AT_A_TIME, {"equation_46": "printed"})]
    whole = tabulated(evaluator, universes)
    parts = gathered([tabulated(evaluator, universes[chunk::2]) for chunk in range(2)])
    assert content_digest(whole) == content_digest(parts)
    assert {"result", "refused"} <= {*whole.cause[whole.of == 2]}, "the mass iteration burns all of the mass"
    judge = Judge(whole, evaluator.study.choices, list(evaluator.published.values()), evaluator.claims.declarations)
    effects = {(one.choice, one.value): one for one in judge.effects("mc_mean_final_mass")}
    assert effects["initial_descent", "printed"].difference > 5.0, "kg"
    assert not effects["initial_descent", "printed"].towards
    assert set(claims_table(judge)["claim"]) == set(evaluator.asked)
    assert len(effects_table(judge))


def test_every_paper_has_its_readings_at_values_of_them():
    for slug in SLUGS:
        choices = Evaluator(catalogue(slug), input_model(slug), ROOT).study.choices
        assert choices and all(one.corrected is not None for one in choices)
        assert all(one.printed is not None for one in choices if one.erratum and not one.only_if)
        errata = {erratum.id for erratum in catalogue(slug).errata}
        assert {one.erratum for one in choices if one.erratum} <= errata
        universes = design(choices, 8)
        assert len({one.number for one in universes}) == len(universes)


def test_a_named_reading_flies_what_its_inputs_say(evaluator):
    """Unlike a universe with the same values of choices, whose trials are limited."""
    small = copy(evaluator)
    few = ({"ensemble": {"large_trials": 60.0, "trials": 50.0}}, Place("size"))
    limited = replace(evaluator.study, limits=(few,)).limited(evaluator.study.readings["plus_sign"])
    small.study = replace(evaluator.study, readings={**evaluator.study.readings, "plus_sign": limited})
    assert small.point("plus_sign")["mc_mean_final_mass"].trials == 60
    assert evaluator.row(CLIMBING).outcomes["mc_mean_final_mass"].trials == 100


def test_every_erratum_that_changes_an_input_is_kept_by_itself():
    """In the design of a full build for three papers; for the others, whose universes are dear, in a new run."""
    for slug in SLUGS:
        study = load_studies({slug: input_model(slug)}, ROOT, {"universes": 8})[slug]
        assert study.whole == 8
        for designs, allowed in ((study.designs, {"desensitized": {"E7", "E16"}}), ((study.whole, None, None), {})):
            moved = {name for one in design(study.choices, *designs) for name in one.assignment}
            kept = {one.erratum for one in study.choices if one.name in moved}
            assert {one.erratum for one in study.choices if one.erratum} - kept <= allowed.get(slug, set()), slug
