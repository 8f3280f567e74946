"""Claims in universes cope with flights that are all lost."""

import contextlib
import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.papers import catalogue, input_model
from marsedl.papers.powered_descent.records import FlightEnsemble, Nominal
from marsedl.papers.random_field import records as random_field
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.records.fields import quantities
from marsedl.replication.universes.table import Evaluator

FEW = {
    "powered_descent": {"ensemble.trials": 30, "ensemble.large_trials": 60, "ensemble.drawn_trials": 2},
    "random_field": {
        **dict.fromkeys(("simulation.trials", "simulation.paper_trials", "point_mass.double_integrator_trials"), 40),
        "simulation.drawn_trials": 2,
        "guidance.iterations": 2,
    },
}
OPEN, LAST = slice(0, 1), slice(-1, None)
NUMBERS_OF_FLIGHTS = ("mean", "covariance", "observed_mean", "maximum_over_trials", "final_state", "observed_maximum")

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")


@cache
def evaluator(slug):
    return Evaluator(catalogue(slug), input_model(slug), Path(__file__).parents[2])


@cache
def run_of(slug, reading):
    of = evaluator(slug)
    values = of.study.readings[reading].inputs.plain() | FEW[slug]
    changed = dataclasses.replace(of.study.readings[reading], inputs=input_model(slug).from_plain(values))
    return of._run(changed).given()


def verdicts(slug, reading, change):
    """The verdicts of all claims on changed records; any error is one of the test."""
    of, given, found = evaluator(slug), run_of(slug, reading), {}
    changed = Arguments(given.values, lambda name, kind: change(given.artifact(name, kind)))
    asked = of.claims.asking(changed, of.published)
    for name in of.asked:
        with contextlib.suppress(Missing):  # a study, which universes go without
            evaluation = of.claims.evaluate_one(name, asked)
            found[name] = judge(of.published[name], evaluation, of.claims.declarations[name]).verdict
    return found


def of_flights(kind, lose):
    return lambda record: lose(record) if isinstance(record, kind) else record


def without_numbers(record):
    """A record with NaN wherever its stage may write it."""
    holes = {name: getattr(record, name) for name, one in quantities(type(record)).items() if one.allow_nan}
    return dataclasses.replace(record, **{name: np.full(np.shape(value), np.nan)[()] for name, value in holes.items()})


@pytest.mark.parametrize(
    ("slug", "reading", "claim"),
    [
        ("powered_descent", "corrected", "mc_final_mean"),
        ("random_field", "corrected", "acap_dv_p99_open"),
        ("random_field", "printed", "acap_dv_p99_open"),
    ],
)
def test_claims_cope_with_records_without_numbers(slug, reading, claim):
    assert verdicts(slug, reading, lambda record: record and without_numbers(record))[claim] == "differs"


@pytest.mark.parametrize("slug", FEW)
def test_dumped_inputs_are_inputs(slug):
    for reading in evaluator(slug).study.readings.values():
        for inputs in (reading.inputs, input_model(slug).from_plain(reading.inputs.plain())):
            dumped = input_model(slug).model_validate(inputs.model_dump(mode="json"))
            assert dumped.plain() == reading.inputs.plain(), reading.name


# ----------------------------------------------------------------------------------------------------- powered descent


def crashed(record):
    return dataclasses.replace(record, outcome=np.full_like(record.outcome, CRASHED))


def not_finite(record):
    none = {name: np.zeros_like(getattr(record, name)) for name in ("histogram", "flying")}
    lost = {"outcome": np.full_like(record.outcome, NON_FINITE), "excluded": len(record.outcome), "count": 0}
    return dataclasses.replace(without_numbers(record), **none, **lost)


def one_left(record):
    """Of all flights one is finite, which has no deviation."""
    lost = not_finite(record)
    state, outcome = lost.final_state.copy(), lost.outcome.copy()
    state[0], outcome[0] = record.final_state[0], 0
    kept = {"final_state": state, "outcome": outcome, "mean": record.mean}
    return dataclasses.replace(lost, **kept, count=1, excluded=len(outcome) - 1)


@pytest.mark.parametrize("lose", [crashed, not_finite, one_left, without_numbers])
def test_claims_cope_with_lost_flights(lose):
    found = verdicts("powered_descent", "corrected", of_flights(FlightEnsemble, lose))
    assert found["mass_iteration_converges"] == "holds" and found["prior_mass_sufficient"] != "holds"


def test_a_mass_iteration_can_fail_to_converge():
    """A pass that changes more than the one before it, as under Eq. 46 with noise in weights on Mars."""
    for changes, verdict in (([1.0, 1.1, 1e-9], "fails"), ([1e-10], "undetermined")):
        change = of_flights(Nominal, lambda one, to=changes: dataclasses.replace(one, integrated_change=np.array(to)))
        assert verdicts("powered_descent", "corrected", change)["mass_iteration_converges"] == verdict


# -------------------------------------------------------------------------------------------------------- random field


def lost(record, laws, outcome, kept=0):
    """An ensemble of which some laws lose all flights, or all but the first ones."""
    fields = {name: np.array(getattr(record, name)) for name in quantities(type(record))}
    fields["outcome"][laws, kept:] = outcome
    for name in ("delta_v", "apoapsis"):
        fields[name][laws, kept:] = np.nan
    if outcome == NON_FINITE:
        for name in NUMBERS_OF_FLIGHTS:
            fields[name][laws] = np.nan
        for name in ("count", "flying", "histogram"):
            fields[name][laws] = 0
        fields["excluded"][laws] = record.outcome.shape[1]
    return random_field.FlightEnsemble(**fields)


@pytest.mark.parametrize("reading", ["corrected", "printed"])  # the latter has no law but the open loop
@pytest.mark.parametrize("laws", [OPEN, LAST, slice(None)])
@pytest.mark.parametrize(("outcome", "kept"), [(CRASHED, 0), (CRASHED, 1), (CRASHED, 2), (NON_FINITE, 0)])
def test_claims_cope_with_lost_laws(reading, laws, outcome, kept):
    change = of_flights(random_field.FlightEnsemble, lambda record: lost(record, laws, outcome, kept))
    found = verdicts("random_field", reading, change)
    expected = ("fails",) if reading == "printed" else ("fails", "undetermined")  # no law; lost flights say nothing
    assert found["acap_lc_better_for_guess_state"] in expected and found["acap_dv_p99_closed"] == "differs"
