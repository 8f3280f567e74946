"""Claims of the funnels paper: everything printed has its evaluator, and verdicts follow the numbers.

Funnels and flights are real ones with fewer slices and trials, where most verdicts are those of the whole reading; the
studies beside them are stand-ins with what claims look at.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.methods.funnels.monte_carlo import fly
from marsedl.papers import catalogue
from marsedl.papers.funnels import environment, montecarlo
from marsedl.papers.funnels.beyond import open_loop
from marsedl.papers.funnels.claims import measures, sec5_results
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.pipeline.catalogue import Flown

ROOT = Path(__file__).parents[2]
PAPER = catalogue("funnels")

READINGS = ("corrected", "printed")
FEWER = {"steps_per_slice": 8, "ascent_starts": 60, "ascent_polished": 1, "tightness_polished": 1}
TRIALS = {"constant": 300, "redrawn": 60, "adversarial": 20}
DECLARATIONS = claims_of("funnels").declarations
MEASURED = (
    *(sec5_results.BY_SAMPLES, *sec5_results.BY_COEFFICIENTS),
    *(sec5_results.SAME_SOLVER, sec5_results.OVER_FLIGHTS, sec5_results.MINUTE_OVER_FLIGHTS),
)
TIMES = dict(zip(MEASURED, (9.0, 90.0, 20.0, 8.0, 4.0, 30.0), strict=True))
BASES = {
    "monomials, m, m/s and rad": 5.7e12,
    "monomials, whitened": 9.7,
    "Hermite, whitened": 13.9,
    "Hermite, whitened with variance one": 1.6,
}


def stand_ins(funnel):
    """Studies of `corrected`, reduced to what claims look at."""
    coarse = np.linspace(0.18, 9.4, 31)
    return {
        "stage_study": SimpleNamespace(
            variables=np.array([6, 8]),
            samples=np.array([182, 406]),
            product_rank=np.array([182, 406]),
            basis_size=np.array([27, 43]),
            few_samples=np.array([200, 400, 406]),
            few_rank=np.array([200, 400, 406]),
            few_bound=np.array([1.11, 1.14, 1.163081]),
            form=np.array(["samples, rank one", "multipliers, Clarabel"]),
            form_bound=np.array([1.163081, 1.163081 * (1 + 2e-8)]),
            basis=np.array(list(BASES)),
            basis_condition=np.array(list(BASES.values())),
        ),
        "stationary": SimpleNamespace(
            interior_better=0,
            stationary_inside=0,
            stationary_norm=np.array([3.0, 850.0, 3e5]),
            stationary_converged=0.98,
            stationary_value=3.1,
            boundary_value=1.08,
            gradient_deviation=1e-10,
        ),
        "euler_step": SimpleNamespace(excess=np.array([-0.0056, 0.041, np.nan])),
        "equations_of_motion": SimpleNamespace(position_rate_deviation=1e-15, velocity_rate_deviation=1e-15),
        "coarse_funnels": SimpleNamespace(
            multiplier_difference=2e-7,
            variant=np.array(["samples", "multipliers", "backward"]),
            variant_level=np.array([coarse, coarse, coarse + 0.1]),
            round_trip=1e-5,
            round_trip_shortfall=-1e-9,
            backward_programs=np.full(30, 4),
        ),
        "proven": SimpleNamespace(
            proven=True,
            outcome="complete",
            level=1.1 * funnel.level,
            half_width=np.sqrt(1.1) * funnel.half_width,
        ),
    }


@pytest.fixture(scope="module")
def records_of(funnels, coarse_funnel):
    """Everything that claims are made from, by reading."""
    shared = ("nominal", "linearization", "gains")  # these readings have the same
    shared_records = {name: funnels.stage(name, "corrected") for name in shared}

    def of(reading):
        if reading == "corrected":
            names = ("funnel", "linear_bounds", "open_loop", "dubins", "dubins_calm", "dubins_wind")
            records = {name: funnels.stage(name, reading, **FEWER, trials=1000) for name in names}
        else:
            records = {"funnel": coarse_funnel(reading)}
        inputs = funnels.stage_inputs(reading, "montecarlo")
        needed = [(shared_records | records)[name] for name in ("linearization", "gains", "funnel")]
        for case, trials in TRIALS.items():
            chunk = inputs.call(montecarlo.simulate, *needed, flown=Flown(case, trials, 1000))
            records[case] = inputs.call(montecarlo.gather, *needed, [chunk])
        return shared_records | records

    return {reading: of(reading) for reading in READINGS}


@pytest.fixture(scope="module")
def evaluate(funnels, records_of, few_slices):
    """Evaluation of a reading, some artifacts or inputs replaced."""

    def of(reading="corrected", inputs=None, **replaced):
        changes = {"trials": 10_000} | (few_slices if reading != "corrected" else FEWER) | (inputs or {})
        studies = stand_ins(records_of[reading]["funnel"]) if reading == "corrected" else {}
        records = {"measured": TIMES} | records_of[reading] | studies | replaced
        measured = records.pop("measured")
        return funnels.evaluate(reading, records, changes, measured=measured)

    return of


def test_what_was_not_measured_meets_no_statement_on_cost(evaluate):
    new_evaluations = evaluate(measured={})
    assert np.isnan(new_evaluations["funnel_run_time"].value)
    for name in ("multiplier_prohibitive", "sampling_reduces_cost", "cheaper_than_monte_carlo"):
        assert new_evaluations[name].value is False and "not measured" in str(new_evaluations[name].evidence)
    assert evaluate(measured=None)["sampling_reduces_cost"].value is False


# --- the tests of statements can fail, and those that fail can hold ---------------------------------------------------


FLOWN = ("funnel", "constant", "adversarial", "open_loop", "dubins_wind", "nominal")
REAL = (*FLOWN, "mission", "vehicle", "recursion", "measured")


def test_counterexamples_turn_verdicts(funnels, records_of, evaluate):
    """Of claims on funnels and flights; those on studies are turned by the workflow, from whole artifacts."""
    records = records_of["corrected"] | stand_ins(records_of["corrected"]["funnel"])
    found = funnels.turned(records, evaluate(), REAL, measured=TIMES)
    assert len(found) > 12 and not [name for name, change in found.items() if change is None]


def test_bounds_are_judged_by_the_motion_that_passes_them(records_of, evaluate, funnels_published):
    """Fewer proven bounds are no violation; without a proof, the absence of a violation is no guarantee."""
    funnel = records_of["corrected"]["funnel"]
    calm = replace(funnel, true_maximum=0.9 * funnel.growth)
    once = replace(funnel, true_maximum=np.where(np.arange(len(funnel.growth)) == 5, 1.003, 0.9) * funnel.growth)
    proof = stand_ins(funnel)["proven"]
    below = SimpleNamespace(**(vars(proof) | {"level": 0.99 * funnel.level}))
    undone = SimpleNamespace(**(vars(below) | {"proven": False, "outcome": "slice 3 is too large"}))
    for changes, expected in (
        ({"funnel": once, "proven": below}, "fails"),
        ({"funnel": calm}, "undetermined"),
        ({"funnel": calm, "proven": None}, "undetermined"),
        ({"funnel": calm, "proven": undone}, "undetermined"),
        ({"funnel": calm, "proven": below}, "holds"),
    ):
        found = evaluate(**changes)["guaranteed_bounds"]
        assert judge(funnels_published["guaranteed_bounds"], found).verdict == expected, changes
    found = evaluate(funnel=once)["guaranteed_bounds"]
    assert (found.numbers["exceeded"], found.numbers["stages"]) == (1, len(funnel.growth))
    assert found.margin.value == pytest.approx(0.3) == pytest.approx(found.numbers["worst"])


@pytest.mark.parametrize(
    ("name", "with_limit"),
    [
        ("thermal_constraint_funnel", lambda r, times: {"nominal": replace(r, heat_rate_limit=times)}),
        ("reaches_goal_region", lambda r, times: {"inputs": {"goal_lengths": np.full(2, times)}}),
    ],
)
def test_what_the_paper_does_not_print_decides_nothing(
    name, with_limit, funnels, records_of, evaluate, funnels_published
):
    """The limit of the heat rate and the goal are ours: only what half and twice of them leave decides."""
    records, planet = records_of["corrected"], funnels.all_inputs("corrected").planet
    reached = {
        "thermal_constraint_funnel": records["funnel"].heat_rate.max(),
        "reaches_goal_region": np.sqrt(1.1) * records["funnel"].half_width[-1, 1:3].max() * planet.planet_radius,
    }[name]
    for times, expected in ((0.4, "fails"), (0.9, "undetermined"), (1.1, "undetermined"), (2.1, "holds")):
        found = evaluate(**with_limit(records["nominal"], times * reached))[name]
        result = judge(funnels_published[name], found)
        assert result.verdict == expected, (times, result.evidence)
        assert all("the paper" in doubt.why and "ours" in doubt.why for doubt in result.doubts)
        assert bool(result.doubts) == (expected == "undetermined")


@pytest.mark.parametrize(("condition", "expected"), [(5.0, "holds"), (13.9, "undetermined"), (1e9, "fails")])
def test_well_conditioned_is_good_or_better_than_monomials(
    condition, expected, records_of, evaluate, funnels_published
):
    study = stand_ins(records_of["corrected"]["funnel"])["stage_study"]
    study.basis_condition = np.where(study.basis == "Hermite, whitened", condition, study.basis_condition)
    found = evaluate(stage_study=study)["hermite_conditioning"]
    assert judge(funnels_published["hermite_conditioning"], found).verdict == expected


# --- measures ---------------------------------------------------------------------------------------------------------


def test_peaks_are_inner_and_strict():
    assert measures.peaks(np.array([3.0, 1.0, 2.0, 1.0, 1.0, 5.0])).tolist() == [2]
    assert measures.peaks(np.array([1.0, 2.0, 2.0, 1.0])).size == 0
    assert measures.peaks(np.array([1.0, np.nan, 0.5, 0.7, 0.6])).tolist() == [3]


def test_samples_of_a_reading_are_on_its_slices_or_on_a_sphere_of_the_state(funnels, records_of):
    for reading in ("corrected", "printed"):
        inputs, funnel = funnels.all_inputs(reading), records_of[reading]["funnel"]
        levels = measures.sampled_levels(inputs.recursion, funnel)
        if reading == "corrected":
            np.testing.assert_allclose(levels, 1.0, rtol=1e-10)
            continue
        k, m = 3, 17
        x = np.sqrt(2.0) * funnel.samples[m, :6] * [1e3, 1.0, 1.0, 1e3, 1.0, 1.0]
        assert levels[k, m] == pytest.approx(0.5 * x @ funnel.shape[k] @ x / funnel.level[k], rel=1e-12)
        assert levels[k].min() >= funnel.literal_level[k, 0] * (1.0 - 1e-9)


def test_linear_reach_is_what_small_flights_reach(funnels, records_of):
    """The two worst starts, made a thousand times smaller, with the disturbance that is worst for each."""
    inputs, records = funnels.all_inputs("corrected"), records_of["corrected"]
    gains, half_gain = records["gains"], records["gains"].half_gain
    air = environment.disturbed_air(inputs.planet, inputs.uncertainty)
    loop = environment.closed_loop(inputs.planet, inputs.vehicle, air, records["linearization"], half_gain)
    transition, response, _ = loop.flow_jacobians(0, loop.steps)
    spread = 1e-3 * np.sqrt(2.0 * gains.initial_level) * np.linalg.inv(np.linalg.cholesky(gains.shape[0])).T
    rows_of = [1, 2]
    starts = (transition @ spread)[rows_of]
    starts = (spread @ (starts / np.linalg.norm(starts, axis=1, keepdims=True)).T).T
    pushed = 1e-3 * response[rows_of] / np.linalg.norm(response[rows_of], axis=1, keepdims=True)
    final = []
    fly(loop, gains.shape, starts, pushed, observer=lambda node, at, _: final.append(at.copy()))
    reached = 1e3 * inputs.planet.planet_radius * np.diag(final[-1][rows_of])
    linear_reach = open_loop.linear_reach(loop, gains) * inputs.planet.planet_radius
    np.testing.assert_allclose(reached, linear_reach, rtol=2e-3)


# --- few and lost flights ---------------------------------------------------------------------------------------------


def test_the_error_of_few_flights_is_that_of_the_parts_that_have_one(funnels, records_of, evaluate):
    """Of three flights seven parts are empty: no zeros among the largest deviations."""
    records = records_of["corrected"]
    given = funnels.stage_inputs("corrected", "open_loop", trials=3)
    few = given.call(open_loop.compute, records["linearization"], records["gains"])
    assert np.isfinite(few.repeat_half_width).all(axis=1).tolist() == [True] * 3 + [False] * 7
    assert few.repeat_half_width[:3].max(axis=0).tolist() == few.flown_half_width.tolist()
    inputs = funnels.stage_inputs("corrected", "montecarlo")
    needed = [records[name] for name in ("linearization", "gains", "funnel")]
    chunks = [inputs.call(montecarlo.simulate, *needed, flown=Flown("constant", trials, 1000)) for trials in (3, 1)]
    three, one = (inputs.call(montecarlo.gather, *needed, [chunk]) for chunk in chunks)
    ends = np.abs(three.final_state[:, 1:3]).max(axis=1) * funnels.all_inputs("corrected").planet.planet_radius / 1e3
    flown = few.repeat_half_width[:3].max(axis=1) / 1e3
    error = np.sqrt(np.var(ends, ddof=1) + np.var(flown, ddof=1))
    evidence = evaluate(constant=three, open_loop=few)["increased_landing_accuracy"].evidence
    assert f"± {error:.2g} km" in str(evidence)
    spread = measures.largest_error(records["funnel"], three)
    expected = np.std(three.repeat_maximum[:3, records["funnel"].step, 0], axis=0, ddof=1)
    np.testing.assert_array_equal(spread, expected)
    assert np.isnan(measures.largest_error(records["funnel"], one)).all()
