"""Claims in universes cope with flights that are lost and with what does not exist; a universe is its own inputs'."""

from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from marsedl.montecarlo.outcomes import CRASHED, ESCAPED, NON_FINITE
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.papers.desensitized import records as desensitized
from marsedl.papers.funnels import records as funnels
from marsedl.papers.powered_descent import records as powered_descent
from marsedl.papers.random_field import records as random_field
from marsedl.papers.stochastic_entry import records as stochastic_entry
from marsedl.papers.stochastic_entry.admissible import admissible
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.errors import InadmissibleError, InfeasibleError, MarsedlError
from marsedl.replication.inputs.sections import by_section
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.pipeline.runner import computed
from marsedl.replication.records.fields import quantities
from marsedl.replication.records.store import content_digest
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe
from marsedl.replication.universes.table import Evaluator, class_of

ROOT = Path(__file__).parents[2]
FEW = {
    "powered_descent": {"ensemble.trials": 30, "ensemble.large_trials": 60, "ensemble.drawn_trials": 2},
    "random_field": {
        **dict.fromkeys(("simulation.trials", "simulation.paper_trials", "point_mass.double_integrator_trials"), 40),
        "simulation.drawn_trials": 2,
        "guidance.iterations": 2,
    },
    "stochastic_entry": {"simulation.trials": 64, "simulation.paper_trials": 64},
    "desensitized": {
        "solver.intervals": 60,
        "design.weight_path": [0.03, 0.5, 6.0, 60.0, 600.0],
        "design.infinite_weights": [3e3, 1e4],
        "design.all_columns_regularization": [0.1],
        "simulation.sweep_points": 9,
        "ensemble.trials": 10,
        "ensemble.drawn_trials": 2,
    },
    "funnels": {
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
        **{
            f"recursion.{search}_{what}": 1 for search in ("ascent", "tightness") for what in ("polished", "iterations")
        },
    },
}

# Of numbers that are NaN: a job may warn, but not end.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")


@cache
def evaluator(slug):
    return Evaluator(catalogue(slug), input_model(slug), ROOT)


@cache
def run_of(slug, reading):
    """The run of a reading with few trials, without the studies of `corrected`, as a universe has it."""
    of = evaluator(slug)
    inputs = input_model(slug).model_validate(by_section(of.study.readings[reading].inputs.plain() | FEW[slug]))
    return of._run(replace(of.study.readings[reading], name="few", inputs=inputs))


def verdicts(slug, reading, change):
    """The verdict of every claim on changed records, change(name, record), or the MarsedlError that it raises."""
    of, given, found = evaluator(slug), run_of(slug, reading).given(), {}
    changed = Arguments(given.values, lambda name, kind: change(name, given.artifact(name, kind)))
    asked = of.claims.asking(changed, of.published)
    for name in of.asked:
        try:
            evaluation = of.claims.evaluate_one(name, asked)
            found[name] = judge(of.published[name], evaluation, of.claims.declarations[name]).verdict
        except Missing:  # a study, which universes go without
            continue
        except MarsedlError as error:
            found[name] = error
    return found


# --- what can be lost -------------------------------------------------------------------------------------------------


def of_kind(kind, change, names=None):
    """A change of the records of a kind, or of some of them by name."""
    return lambda name, one: change(one) if isinstance(one, kind) and name in (names or [name]) else one


def without_numbers(record, **changes):
    """A record with NaN wherever its stage may write it."""
    holes = {name: getattr(record, name) for name, one in quantities(type(record)).items() if one.allow_nan}
    return replace(record, **{name: np.full(np.shape(value), np.nan)[()] for name, value in holes.items()} | changes)


def everything_lost(name, record):
    return record and without_numbers(record)


def ended(outcome, kept=0):
    """Of an ensemble all flights but the first end otherwise than they should, if they are finite at all."""

    def change(one):
        changed = (one.outcome != NON_FINITE) & (np.arange(len(one.outcome)) >= kept)
        return replace(one, outcome=np.where(changed, outcome, one.outcome).astype(np.int8))

    return change


def not_finite(record):
    none = {name: np.zeros_like(getattr(record, name)) for name in ("histogram", "flying")}
    lost = {"outcome": np.full_like(record.outcome, NON_FINITE), "excluded": len(record.outcome), "count": 0}
    return without_numbers(record, **none, **lost)


def one_left(record):
    """Of all flights one is finite, which has no deviation."""
    lost = not_finite(record)
    state, outcome = lost.final_state.copy(), lost.outcome.copy()
    state[0], outcome[0] = record.final_state[0], 0
    kept = {"final_state": state, "outcome": outcome, "mean": record.mean}
    return replace(lost, **kept, count=1, excluded=len(outcome) - 1)


def laws_lost(laws, outcome, kept=0):
    """Some laws lose all flights, or all but the first ones."""

    def change(record):
        values = {name: np.array(getattr(record, name)) for name in quantities(type(record))}
        values["outcome"][laws, kept:] = outcome
        for name in ("delta_v", "apoapsis"):
            values[name][laws, kept:] = np.nan
        if outcome == NON_FINITE:
            for name in (
                "mean",
                "covariance",
                "observed_mean",
                "maximum_over_trials",
                "final_state",
                "observed_maximum",
            ):
                values[name][laws] = np.nan
            for name in ("count", "flying", "histogram"):
                values[name][laws] = 0
            values["excluded"][laws] = record.outcome.shape[1]
        return type(record)(**values)

    return of_kind(random_field.FlightEnsemble, change)


def under_gains_that_are_not_finite(cases):
    """Flights as the stage writes them; if those of the stochastic law are lost, it does not exist either."""

    def change(name, record):
        run = run_of("stochastic_entry", "corrected")
        gains, given = run.record("gains"), run.given()
        none = {table: np.full_like(getattr(gains, table), np.nan) for table in ("stochastic_gain", "table_gain")}
        if name == "gains" and cases == STOCHASTIC:
            return without_numbers(gains)
        if name not in cases:
            return record
        records = {"gains": replace(gains, **none)}
        changed = Arguments(run.values, lambda name, kind: records.get(name) or given.artifact(name, kind))
        return computed(run.paper.stages["montecarlo"].entries, changed, run.flown[f"montecarlo.{name}"])

    return change


def gains_lost(name, record):
    """Gains of which no search ended, with flights that are lost under them."""
    if isinstance(record, desensitized.Gains):
        return replace(record, converged=np.zeros_like(record.converged))
    return without_numbers(record) if isinstance(record, desensitized.Responses) else record


def without_rows(*weights, effort=0.1):
    """Tables of which some printed weights have no row, as no solution has their control energy."""

    def change(name, record):
        if not isinstance(record, desensitized.Tradeoff | desensitized.Linearization):
            return record
        kept = ~np.isin(record.printed_weight, weights)
        by_row = [name for name, one in quantities(type(record)).items() if one.dims[:1] == ("rows",)]
        rows = {name: getattr(record, name)[kept] for name in by_row}
        if isinstance(record, desensitized.Tradeoff):
            rows |= {"missing_weight": np.array(weights), "missing_effort": np.full(len(weights), effort)}
            rows |= {"missing_reason": np.array(["nominal: the solver ended with Restoration_Failed"] * len(weights))}
        return replace(record, **rows)

    return change


def blank(record, **changes):
    """A record whose numbers are NaN, but for its time."""
    arrays = {one.name: np.asarray(getattr(record, one.name)) for one in fields(record) if one.name != "time"}
    numbers = {name: np.full_like(value, np.nan)[()] for name, value in arrays.items() if value.dtype.kind == "f"}
    return replace(record, **numbers | changes)


def first_slice(record):
    """A funnel that has no slice but the first."""
    kept = {name: getattr(record, name) for name in ("shape", "samples", "memory")}
    first = {name: getattr(record, name).copy() for name in ("level", "literal_level", "literal_level_si")}
    for values in first.values():
        values[1:] = np.nan
    return blank(record, **kept, **first, outcome="the funnel diverges", sound=False)


def no_flight(record):
    return blank(record, outcome=np.full_like(record.outcome, 3), excluded=len(record.outcome))


def slower_iteration(changes):
    return of_kind(powered_descent.Nominal, lambda one: replace(one, integrated_change=np.array(changes)))


CASES, APOLLO, STOCHASTIC = (stochastic_entry.CASES[part] for part in (slice(None), slice(2), slice(2, None)))
OPEN, LAST, ALL = slice(0, 1), slice(-1, None), slice(None)
FLIGHTS, ENTRIES = powered_descent.FlightEnsemble, stochastic_entry.FlightEnsemble
MASS_ITERATION = {"mass_iteration_converges": "holds", "prior_mass_sufficient": "fails undetermined"}
NO_LAW = {"acap_lc_better_for_guess_state": "fails", "acap_dv_p99_closed": "differs"}
LOST_LAWS = NO_LAW | {"acap_lc_better_for_guess_state": "fails undetermined"}
OUTSIDE = dict.fromkeys(("mc_inside_funnel", "funnel_is_tight", "sos_above_mc"), "fails undetermined")
LOST = [  # paper, reading, change of records, the verdicts of some claims
    *(
        ("powered_descent", "corrected", of_kind(FLIGHTS, lose), MASS_ITERATION)
        for lose in (ended(CRASHED), not_finite, one_left, without_numbers)
    ),
    ("powered_descent", "corrected", slower_iteration([1.0, 1.1, 1e-9]), {"mass_iteration_converges": "fails"}),
    ("powered_descent", "corrected", slower_iteration([1e-10]), {"mass_iteration_converges": "undetermined"}),
    ("powered_descent", "corrected", everything_lost, {"mc_final_mean": "differs"}),
    ("random_field", "corrected", everything_lost, {"acap_dv_p99_open": "differs"}),
    ("random_field", "printed", everything_lost, {"acap_dv_p99_open": "differs"}),
    ("random_field", "corrected", laws_lost(OPEN, CRASHED), LOST_LAWS),
    ("random_field", "corrected", laws_lost(LAST, CRASHED, 1), LOST_LAWS),
    ("random_field", "corrected", laws_lost(ALL, CRASHED, 2), LOST_LAWS),
    ("random_field", "corrected", laws_lost(LAST, NON_FINITE), LOST_LAWS),
    ("random_field", "corrected", laws_lost(ALL, NON_FINITE), LOST_LAWS),
    ("random_field", "printed", laws_lost(ALL, CRASHED), NO_LAW),  # it has no law but the open loop
    ("random_field", "printed", laws_lost(ALL, NON_FINITE), NO_LAW),
    ("stochastic_entry", "corrected", of_kind(ENTRIES, ended(CRASHED), APOLLO), {"trigger_covariance": "fails"}),
    ("stochastic_entry", "corrected", of_kind(ENTRIES, ended(ESCAPED), STOCHASTIC), {"trigger_covariance": "fails"}),
    ("stochastic_entry", "corrected", of_kind(ENTRIES, ended(ESCAPED, 1)), {"trigger_covariance": "fails"}),
    (
        "stochastic_entry",
        "corrected",
        of_kind(ENTRIES, ended(ESCAPED, 2)),
        {"trigger_covariance": "fails undetermined"},
    ),
    ("stochastic_entry", "printed", of_kind(ENTRIES, ended(ESCAPED, 2)), {"trigger_covariance": "fails"}),
    *(
        (
            *("stochastic_entry", "corrected", under_gains_that_are_not_finite(cases)),
            {"headline_range_reduction": "differs", "halved_velocity_p1": "fails"},
        )
        for cases in (APOLLO, STOCHASTIC, CASES)
    ),
    ("desensitized", "corrected", of_kind(desensitized.Responses, without_numbers), {"dr_needs_feedback": "fails"}),
    ("desensitized", "corrected", gains_lost, {"dr_needs_feedback": "fails"}),
    ("funnels", "corrected", of_kind(funnels.FlightEnsemble, no_flight), OUTSIDE),
    (
        *("funnels", "corrected", of_kind(funnels.Funnel, first_slice)),
        OUTSIDE | dict.fromkeys(("reaches_goal_region", "guaranteed_bounds"), "fails undetermined"),
    ),
]


@pytest.mark.parametrize(("slug", "reading", "change", "expected"), LOST)
def test_claims_cope_with_what_is_lost(slug, reading, change, expected):
    found = verdicts(slug, reading, change)
    assert not {name: one for name, one in found.items() if isinstance(one, Exception)}
    assert not {name: found[name] for name, words in expected.items() if found[name] not in words.split()}


@pytest.mark.parametrize("change", [without_rows(0.001, 0.01, 0.1, 1.0), without_rows(0.001, 1.0, effort=9.0)])
def test_no_claim_crashes_where_rows_are_missing(change):
    assert {"dr_needs_feedback", "more_fuel_when_desensitized"} <= verdicts("desensitized", "corrected", change).keys()


def test_a_row_that_no_solution_has_has_no_value():
    """Before, another branch was judged as the row, or its claims failed."""
    found = verdicts("desensitized", "corrected", without_rows(0.001))
    missing = {name for name, one in found.items() if isinstance(one, Exception)}
    assert missing == {"tab03_c0p001", "fuel_increases_except_first_step"}
    assert all("c1 = 0.001 lies below the least" in str(found[name]) for name in missing)
    assert {class_of(found[name]).cause for name in missing} == {"infeasible"}
    elsewhere = verdicts("desensitized", "corrected", without_rows(0.001, effort=1.0))["tab03_c0p001"]
    assert class_of(elsewhere).cause == "refused" and not isinstance(elsewhere, InfeasibleError)
    assert str(elsewhere) == "c1 = 0.001 has no row: nominal: the solver ended with Restoration_Failed"


def test_a_universe_whose_nominal_differs_from_the_text_is_inadmissible():
    nominal = run_of("stochastic_entry", "corrected").record("nominal")
    admissible(nominal)
    for change in ({"reversal_time": nominal.reversal_time[:2]}, {"downrange": nominal.downrange - 6e3}):
        with pytest.raises(InadmissibleError, match=r"the nominal has [23] reversals and ends 1[06]\.\d km uprange"):
            admissible(replace(nominal, **change))


# --- inputs and universes ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slug", SLUGS)
def test_dumped_inputs_are_inputs(slug):
    for reading in evaluator(slug).study.readings.values():
        dumped = input_model(slug).model_validate(reading.inputs.model_dump(mode="json"))
        assert dumped.plain() == reading.inputs.plain(), reading.name


@pytest.mark.parametrize(("slug", "different"), [("desensitized", {"ensemble.trials"}), ("funnels", set())])
def test_every_choice_is_at_a_value_in_corrected_and_printed(slug, different):
    study = evaluator(slug).study
    assert all(one.corrected is not None and one.printed is not None for one in study.choices)
    printed, corrected = (study.readings[name].sources for name in ("printed", "corrected"))
    turned = study.choices.applied(corrected, {one.name: one.printed for one in study.choices})
    assert {name for name in printed if turned[name].value != printed[name].value} == different


@pytest.mark.stages
@pytest.mark.parametrize(
    ("slug", "names", "other", "same"),
    [
        ("desensitized", ("nominal", "tradeoff"), {"planet_radius": 3390.0, "branch": "one_reversal"}, set()),
        (
            *("funnels", ("nominal", "linearization", "gains", "funnel", "stationary", "dubins", "open_loop")),
            {"entry_angle": -15.2, "shape": "minimum_trace", "optimum": "of_the_guess"},
            {"dubins"},
        ),
    ],
)
def test_a_universe_does_not_depend_on_what_came_before(slug, names, other, same):
    of, small = evaluator(slug), {name: value for name, value in FEW[slug].items() if name != "design.weight_path"}

    def digests(assignment):
        run = of.run(Universe(0, ONE_AT_A_TIME, assignment, inputs=small))
        found = {name: content_digest(run.record(name)) for name in names}
        of.memory.let_go()
        return found

    first, between = digests({}), digests(other)
    assert {name for name in names if first[name] == between[name]} == same
    assert digests({}) == first
