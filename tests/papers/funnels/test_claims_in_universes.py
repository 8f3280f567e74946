"""Claims in universes: they cope with lost flights and funnels that end early; a universe is its inputs' reading."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import FlightEnsemble, Funnel
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records.store import content_digest
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe
from marsedl.replication.universes.table import Evaluator

ROOT = Path(__file__).parents[3]
SMALL = {
    "recursion.steps_per_slice": 24,
    "recursion.condition": "euler",
    "studies.fig4_slice": 3,
    "recursion.check_points": 450,
    "recursion.ascent_starts": 20,
    "recursion.tightness_starts": 4,
    "ensemble.trials": 20,
    "studies.stationary_points": 20,
    "studies.fig4_points": 9,
    "car.dubins_fine_steps": 40,
    "car.dubins_trials": 20,
    "car.dubins_wind_trials": 20,
} | {f"recursion.{search}_{what}": 1 for search in ("ascent", "tightness") for what in ("polished", "iterations")}


@pytest.fixture(scope="module")
def evaluator():
    return Evaluator(catalogue("funnels"), Inputs, ROOT)


@pytest.fixture(scope="module")
def run(evaluator):
    """A small universe."""
    return evaluator.run(Universe(0, ONE_AT_A_TIME, {}, inputs=SMALL))


def without_numbers(record, **changes):
    """A record whose numbers are NaN, but for its time."""
    arrays = {one.name: np.asarray(getattr(record, one.name)) for one in fields(record) if one.name != "time"}
    blank = {name: np.full_like(value, np.nan)[()] for name, value in arrays.items() if value.dtype.kind == "f"}
    return replace(record, **{**blank, **changes})


def lost(record):
    """Flights of which none is finite."""
    if not isinstance(record, FlightEnsemble):
        return record
    return without_numbers(record, outcome=np.full_like(record.outcome, 3), excluded=len(record.outcome))


def ended(record):
    """A funnel that has no slice but the first."""
    if not isinstance(record, Funnel):
        return record
    kept = {name: getattr(record, name) for name in ("shape", "samples", "memory")}
    first = {name: getattr(record, name).copy() for name in ("level", "literal_level", "literal_level_si")}
    for values in first.values():
        values[1:] = np.nan
    return without_numbers(record, **kept, **first, outcome="the funnel diverges", sound=False)


REFUTED = {
    lost: ("mc_inside_funnel", "funnel_is_tight", "sos_above_mc", "increased_landing_accuracy"),
    ended: (
        *("mc_inside_funnel", "funnel_is_tight", "sos_above_mc", "end_expansion", "reaches_goal_region"),
        *("guaranteed_bounds", "thermal_constraint_funnel"),
    ),
}


@pytest.mark.filterwarnings("default::RuntimeWarning")  # of numbers that are NaN; a job may warn, but not end
@pytest.mark.parametrize("change", [lambda record: record, lost, ended], ids=["whole", "lost", "ended"])
def test_no_claim_crashes_without_flights_or_funnel(evaluator, run, change, monkeypatch):
    given = run.given

    def changed(names=None):
        found = given(names)
        return found if names else replace(found, artifact=lambda name, kind: change(found.artifact(name, kind)))

    monkeypatch.setattr(run, "given", changed)
    outcomes = evaluator.outcomes(run)
    assert not {name: one.sentence for name, one in outcomes.items() if one.cause not in ("result", "not_asked")}
    assert {outcomes[name].finding for name in REFUTED.get(change, ())} <= {"fails", "undetermined"}


def test_the_universe_corrected_is_the_reading_whatever_came_before(evaluator):
    names = ("nominal", "linearization", "gains", "funnel", "stationary", "dubins", "dubins_wind", "open_loop")

    def digests(run):
        return {name: content_digest(run.record(name)) for name in [*names, *run.flown]}

    def of(assignment):
        found = digests(evaluator.run(Universe(0, ONE_AT_A_TIME, assignment, inputs=SMALL)))
        evaluator.memory.let_go()
        return found

    study = evaluator.study
    limited = study.limited(study.readings["corrected"])
    reading = Run.of(evaluator.paper, Inputs.from_plain(limited.inputs.plain() | SMALL), Memory())
    first, other = of({}), of({"entry_angle": -15.2, "shape": "minimum_trace", "optimum": "of_the_guess"})
    assert first == digests(reading)
    assert {name for name in first if first[name] == other[name]} == {"dubins", "dubins_wind"}
    assert of({}) == first


def test_every_choice_is_at_a_value_in_corrected_and_printed(evaluator):
    study = evaluator.study
    assert all(one.corrected is not None and one.printed is not None for one in study.choices)
    printed, corrected = (study.readings[name].sources for name in ("printed", "corrected"))
    turned = study.choices.applied(corrected, {one.name: one.printed for one in study.choices})
    assert {name for name in printed if turned[name].value != printed[name].value} == set()
