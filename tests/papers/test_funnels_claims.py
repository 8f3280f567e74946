"""Claims of the funnels paper: everything printed has its evaluator, and verdicts follow the numbers.

Funnels and flights are real ones with fewer slices and trials, where most verdicts are those of the whole reading; the
studies beside them are stand-ins with what claims look at.
"""

import json
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.methods.funnels.monte_carlo import fly
from marsedl.papers import catalogue
from marsedl.papers.funnels import environment, montecarlo, open_loop
from marsedl.papers.funnels.claims import measures, sec3_funnels, sec4_entry, sec5_results
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    EquationsOfMotion,
    Monotonicity,
    Proven,
    Regulators,
    StageStudy,
    Stationary,
)
from marsedl.replication.catalogue import Flown
from marsedl.replication.claiming import claims_of
from marsedl.replication.claims import COUNTED_VERDICTS, UNDECIDED, collect, judge, write_claims

PAPER = catalogue("funnels")

READINGS = ("corrected", "printed", "euler")
TRIALS = {"constant": 300, "redrawn": 60, "adversarial": 20}
DECLARATIONS = claims_of("funnels").declarations
ON_STUDIES = {
    *("worst_disturbance_location", "stationary_w_by_newton", "stationary_w_as_samples", "w_gradient_formula"),
    *("stage_condition_bounds_step", "entry_equations", "backward_funnel", "minimum_samples_computable"),
    *("sampling_equivalence", "hermite_conditioning", "four_funnel_solvers", "dubins_funnel"),
    "increased_landing_accuracy",
}
FAILS = {
    *("gram_45_follows_from_d1", "stage_condition_bounds_step", "hermite_conditioning"),
    *("rescaled_points_on_bk", "stationary_w_as_samples"),
    *("first_peak", "end_expansion", "funnel_is_tight", "guaranteed_bounds"),
    "thermal_constraint_funnel",
    *("multiplier_prohibitive", "cheaper_than_monte_carlo"),
}
UNDETERMINED = {"sampling_reduces_cost"}  # a factor of two of the word decides
# What cannot be otherwise: identities, and slips of the paper's text.
BY_CONSTRUCTION = {
    *("gram_size", "gram_dimension_eq2", "gram_45_with_additive_disturbances", "volume_objective"),
    *("initial_containment", "bk_is_algebraic_variety", "rescaled_w_on_boundary", "greedy_needed"),
    *("w_gradient_formula", "no_distribution_assumed", "thermal_constraint_nominal"),
}
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
            stationary_saddles=1.0,
            gradient_angle=1e-13,
            gradient_deviation=1e-10,
        ),
        "discretization": SimpleNamespace(
            spacing=np.array([24, 4]),
            unsafe_share=np.array([0.2, 0.35]),
            least_excess=np.array([-0.016, -0.0056]),
            largest_excess=np.array([0.15, 0.041]),
            mean_excess=np.array([0.02, 0.003]),
        ),
        "equations_of_motion": SimpleNamespace(position_rate_deviation=1e-15, velocity_rate_deviation=1e-15),
        "coarse_funnels": SimpleNamespace(
            multiplier_difference=2e-7,
            variant=np.array(["samples", "multipliers", "backward"]),
            variant_level=np.array([coarse, coarse, coarse + 0.1]),
            round_trip=1e-5,
            round_trip_shortfall=-1e-9,
            backward_programs=np.full(30, 4),
        ),
        "regulators": SimpleNamespace(
            slice_time=funnel.time,
            variant=np.array(
                ["as the reading", "shape of least trace", "weight at the end", "scale of the bank angle"]
            ),
            factor=np.array([1.0, 1.0, 3.0, 3.0]),
            level=np.array(
                [funnel.level, funnel.level, np.linspace(0.2, 21.0, len(funnel.level)), np.nan * funnel.level]
            ),
            outcome=np.array(["complete", "complete", "complete", "the funnel diverges"]),
        ),
        "monotonicity": SimpleNamespace(
            studied_level=np.array([[1.0, 2.0, 4.0]]), reached_level=np.array([[1.2, 2.4, 4.2]])
        ),
        "proven": SimpleNamespace(
            proven=True,
            outcome="complete",
            level=1.1 * funnel.level,
            half_width=np.sqrt(1.1) * funnel.half_width,
            interpolation_excess=1e-3,
        ),
    }


TYPES = {
    "stage_study": StageStudy,
    "discretization": Discretization,
    "coarse_funnels": CoarseFunnels,
    "monotonicity": Monotonicity,
    "regulators": Regulators,
    "stationary": Stationary,
    "equations_of_motion": EquationsOfMotion,
    "proven": Proven,
}


@pytest.fixture(scope="module")
def records_of(funnels, coarse_funnel):
    """Everything that claims are made from, by reading."""
    shared = ("nominal", "linearization", "gains")  # these readings have the same
    shared_records = {name: funnels.stage(name, "corrected") for name in shared}

    def of(reading):
        if reading == "corrected":
            names = ("funnel", "linear_bounds", "open_loop", "dubins", "dubins_calm", "dubins_wind")
            records = {name: funnels.stage(name, reading) for name in names}
        else:
            records = {"funnel": coarse_funnel(reading)}
        inputs = funnels.stage_inputs(reading, "montecarlo")
        needed = [(shared_records | records)[name] for name in ("linearization", "gains", "funnel")]
        for case, trials in TRIALS.items():
            chunk = inputs.call(montecarlo.simulate, *needed, flown=Flown(case, trials, 1000))
            records[case] = montecarlo.gather([chunk])
        return shared_records | records

    return {reading: of(reading) for reading in READINGS}


@pytest.fixture(scope="module")
def evaluate(funnels, records_of, few_slices):
    """Evaluation of a reading, some artifacts or inputs replaced."""

    def of(reading="corrected", inputs=None, **replaced):
        changes = {"trials": 10_000} | (few_slices if reading != "corrected" else {}) | (inputs or {})
        studies = stand_ins(records_of[reading]["funnel"]) if reading == "corrected" else {}
        records = {"measured": TIMES} | records_of[reading] | studies | replaced
        measured = records.pop("measured")
        return funnels.evaluate(reading, records, changes, measured=measured)

    return of


@pytest.fixture(scope="module")
def evaluations(evaluate):
    return {name: evaluate(name) for name in READINGS}


@pytest.fixture(scope="module")
def rows(funnels, funnels_published, evaluations):
    claim_rows = collect(
        list(funnels_published.values()),
        DECLARATIONS,
        evaluations,
        known_errata={erratum.id for erratum in PAPER.errata},
        left_out=funnels.study.readings.keys() - set(READINGS),
    )
    return {row["id"]: row for row in claim_rows}


# --- everything has its counterpart -----------------------------------------------------------------------------------


def test_every_printed_claim_is_evaluated_in_every_reading(funnels_published, evaluations):
    claim_names = {name for name, claim in funnels_published.items() if claim.kind != "context"}
    assert len(funnels_published) == 51 and len(claim_names) == 49
    for name, of_reading in evaluations.items():
        assert set(of_reading) == claim_names, name
        missing = {claim for claim, evaluation in of_reading.items() if evaluation is None}
        assert missing == (set() if name == "corrected" else ON_STUDIES), name


def test_declarations_name_existing_claims_and_all_errata(funnels_published):
    erratum_ids = [erratum.id for erratum in PAPER.errata]
    assert erratum_ids == [f"E{number}" for number in range(1, 24)]
    assert set(DECLARATIONS) <= set(funnels_published)
    assert {name for declaration in DECLARATIONS.values() for name in declaration.errata} == set(erratum_ids)
    assert not [name for name, declaration in DECLARATIONS.items() if declaration.close]


def test_stand_ins_have_the_fields_of_the_artifacts(records_of):
    for name, stand_in in stand_ins(records_of["corrected"]["funnel"]).items():
        assert set(vars(stand_in)) <= {field.name for field in fields(TYPES[name])}, name


def test_reasons_quote_numbers_that_exist(rows):
    assert not [name for name, row in rows.items() if "{" in row["reason"] or " nan" in row["reason"]]
    assert "by up to 0.56 %. With 24 fine steps" in rows["stage_condition_bounds_step"]["reason"]
    assert "asks for 165 rows. One of first order" in rows["gram_45_follows_from_d1"]["reason"]
    assert "there would be 120 rows" in rows["gram_45_with_additive_disturbances"]["reason"]
    assert "is 61.00 W/cm^2 at the nodes, but 61.1" in rows["thermal_constraint_nominal"]["reason"]
    assert "not built" in rows["first_peak"]["reason"]


# --- verdicts ---------------------------------------------------------------------------------------------------------


def test_verdicts_of_the_corrected_reading(rows):
    for name, row in rows.items():
        if row["kind"] in ("qualitative", "deterministic"):
            expected = "undetermined" if name in UNDETERMINED else "fails" if name in FAILS else "holds"
            assert row["verdict"] == ("by_construction" if name in BY_CONSTRUCTION else expected), name
            assert row["verdict"] != "fails" or row["errata"] or row["withheld"], name
            assert bool(row["by_construction"]) == (name in BY_CONSTRUCTION), name


def test_inputs_are_used_as_stated_but_for_the_slice_of_fig_4(rows, evaluate):
    stated = {name: row["verdict"] for name, row in rows.items() if row["kind"] == "input"}
    assert len(stated) == 6
    assert {name for name, verdict in stated.items() if verdict != "as_stated"} == {"fig4_step"}  # fewer slices here
    assert evaluate(inputs={"fig4_slice": 7})["fig4_step"].value == 7
    assert rows["exponent_d"]["readings"]["corrected"]["verdict"] == "not_as_stated"


def test_the_literal_samples_leave_the_slices_and_the_recursion_without_memory(rows, records_of):
    def verdict(name):
        return rows[name]["readings"]["printed"]["verdict"]

    for name in (
        *("fig4_samples_cover_sublevel_set", "tvlqr_as_lyapunov", "taylor_for_nonpolynomial"),
        *("mc_inside_funnel", "sos_above_mc", "interpolation_between_slices"),  # levels that say nothing hold nothing
    ):
        assert (verdict(name), rows[name]["verdict"]) == ("fails", "holds"), name
    assert (verdict("greedy_needed"), verdict("first_peak")) == ("fails", "fails")
    assert records_of["printed"]["funnel"].level.max() > 1e6
    assert "not compared with the motion" in rows["taylor_for_nonpolynomial"]["readings"]["printed"]["evidence"]


def test_the_euler_step_expands_at_the_end(rows):
    assert rows["end_expansion"]["readings"]["euler"]["verdict"] == "holds"


def test_a_funnel_that_ends_early_meets_no_statement_about_it(records_of, evaluate, funnels_published, tmp_path):
    whole = records_of["corrected"]["funnel"]
    ended = np.arange(len(whole.level)) > 7
    changes = {
        name: np.where(ended if np.ndim(value) == 1 else ended[:, np.newaxis], np.nan, value)
        for name, value in vars(whole).items()
        if name in ("level", "half_width", "log_volume", "feedback", "heat_rate", "rising", "rising_undisturbed")
    }
    new_evaluations = evaluate(funnel=replace(whole, outcome="the funnel diverges", sound=False, **changes))
    for name in ("mc_inside_funnel", "sos_above_mc", "end_expansion", "funnel_is_tight", "reaches_goal_region"):
        assert new_evaluations[name].value is False, name
    assert (
        "the funnel is complete (its outcome is: the funnel diverges): no"
        in new_evaluations["mc_inside_funnel"].evidence
    )
    claim_rows = collect(
        list(funnels_published.values()),
        {},
        {"corrected": new_evaluations, "printed": new_evaluations},
        require_reasons=False,
    )
    write_claims(claim_rows, tmp_path / "claims.json")
    written = {row["id"]: row for row in json.loads((tmp_path / "claims.json").read_text())}
    assert written["sos_above_mc"]["verdict"] == "fails"


def test_what_was_not_measured_meets_no_statement_on_cost(evaluate):
    new_evaluations = evaluate(measured={})
    assert np.isnan(new_evaluations["funnel_run_time"].value)
    for name in ("multiplier_prohibitive", "sampling_reduces_cost", "cheaper_than_monte_carlo"):
        assert new_evaluations[name].value is False and "not measured" in new_evaluations[name].evidence
    assert evaluate(measured=None)["sampling_reduces_cost"].value is False


# --- the tests of statements can fail, and those that fail can hold ---------------------------------------------------


def of(stage, **functions):
    """A change of fields of an artifact."""

    def make(records):
        old = records[stage]
        new = {name: function(getattr(old, name)) for name, function in functions.items()}
        if isinstance(old, SimpleNamespace):
            return {stage: SimpleNamespace(**(vars(old) | new))}
        return {stage: replace(old, **new)}

    return make


def at(index, value, times=False):
    """A change of one entry of an array."""

    def make(array):
        array = np.array(array)
        array[index] = array[index] * value if times else value
        return array

    return make


def measured(**changes):
    names = {"whole": MEASURED[0], "clarabel": MEASURED[1], "scs": MEASURED[2], "flights": MEASURED[4]}
    return lambda records: {"measured": TIMES | {names[key]: value for key, value in changes.items()}}


CHANGED = {
    # that hold
    "taylor_for_nonpolynomial": of("funnel", violation=at(3, 0.06)),
    "minimum_samples_computable": of("stage_study", product_rank=at(1, 405)),
    "sampling_equivalence": of("stage_study", form_bound=at(1, 1.1631)),
    "stationary_w_by_newton": of("stationary", stationary_converged=lambda _: 0.6),
    "increased_landing_accuracy": of("open_loop", flown_half_width=lambda w: 0.5 * w),
    "end_high_velocity_changes": lambda _: {"inputs": {"lift_to_drag": 0.4}},
    "tvlqr_as_lyapunov": of("funnel", rising_undisturbed=at(5, 0.001)),
    "fig4_samples_cover_sublevel_set": of("funnel", fig4_circle_rate=at(2, 1e-9)),
    "worst_disturbance_location": of("stationary", interior_better=lambda _: 1),
    "entry_equations": of("equations_of_motion", velocity_rate_deviation=lambda _: 1e-5),
    "backward_funnel": of("coarse_funnels", round_trip_shortfall=lambda _: 1e-4),
    "mc_inside_funnel": of("constant", outside_at_slices=lambda _: 1),
    "interpolation_between_slices": of("adversarial", outside_between=lambda _: 1),
    "sos_above_mc": of("constant", maximum_over_trials=at((24, 0), 10.0, times=True)),
    "dubins_funnel": of("dubins_wind", outside_at_slices=lambda _: 1),
    "reaches_goal_region": of("proven", half_width=at((-1, 2), 10.1e3 / 3389.5e3)),
    "four_funnel_solvers": of("coarse_funnels", variant_level=at((1, -1), np.nan)),
    # that fail
    "stage_condition_bounds_step": of("discretization", least_excess=at(1, 0.0)),
    "rescaled_points_on_bk": of("funnel", literal_level=np.ones_like),
    "stationary_w_as_samples": of("stationary", stationary_inside=lambda _: 2000),
    "hermite_conditioning": of("stage_study", basis_condition=at(1, 14.0)),
    "first_peak": of("funnel", level=at(6, 50.0)),
    "end_expansion": of("funnel", level=at(-1, 1.1, times=True)),
    "funnel_is_tight": of("constant", maximum_over_trials=lambda largest: np.full_like(largest, 10.0)),
    "thermal_constraint_funnel": of("funnel", heat_rate=lambda q: np.minimum(q, 6.1e5)),
    "multiplier_prohibitive": measured(clarabel=1e5, scs=1e4),
    "sampling_reduces_cost": measured(whole=15.0),
    "cheaper_than_monte_carlo": measured(flights=0.1),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_statement_follows_its_numbers(records_of, evaluate, evaluations, name):
    records = records_of["corrected"] | stand_ins(records_of["corrected"]["funnel"])
    assert evaluations["corrected"][name].value is (name not in FAILS)
    assert evaluate(**CHANGED[name](records))[name].value is (name in FAILS)


def test_counted_claims_have_counterexamples(rows):
    counted = {name for name, row in rows.items() if row["verdict"] in COUNTED_VERDICTS and row["kind"] != UNDECIDED}
    with_counterexample = {name for name, marked in claims_of("funnels").claims.items() if marked.counterexample}
    assert with_counterexample == counted


REAL = ("funnel", "constant", "adversarial", "open_loop", "dubins_wind")


def test_counterexamples_turn_verdicts(funnels, records_of, rows, funnels_published):
    """Of claims on funnels and flights; those on studies are turned by the workflow, from whole artifacts."""
    records = records_of["corrected"] | stand_ins(records_of["corrected"]["funnel"])
    claims = claims_of("funnels")
    values = funnels.study.readings["corrected"].inputs.plain()
    judged = [
        row
        for name, row in rows.items()
        if (marked := claims.claims.get(name)) and marked.counterexample and row["verdict"] in COUNTED_VERDICTS
        if marked.counterexample.target.partition(".")[0] in (*REAL, "mission", "vehicle", "recursion", "measured")
    ]
    turned = claims.turned(judged, values, lambda name, _: records.get(name), funnels_published, measured=TIMES)
    assert len(turned) > 12 and not [name for name, change in turned.items() if change is None]


def test_bounds_are_guaranteed_where_no_motion_exceeds_levels_that_are_proven(records_of, evaluate):
    records = records_of["corrected"]
    calm = of("funnel", true_maximum=lambda m: 0.9 * m)(records)
    proof = stand_ins(records["funnel"])["proven"]
    below = SimpleNamespace(**(vars(proof) | {"level": 0.99 * records["funnel"].level}))
    undone = SimpleNamespace(**(vars(below) | {"proven": False, "outcome": "slice 3 is too large"}))
    for changes, expected in (
        (calm, False),
        (calm | {"proven": below}, True),
        (calm | {"proven": undone}, False),
    ):
        assert evaluate(**changes)["guaranteed_bounds"].value is expected


def test_a_gram_matrix_of_other_size_would_differ(evaluate, funnels_published, monkeypatch):
    monkeypatch.setattr(sec4_entry, "BASIS_DEGREE", 1)
    new_evaluations = evaluate()
    assert new_evaluations["gram_size"].value == 9
    assert judge(funnels_published["gram_size"], new_evaluations["gram_size"])[0] == "differs"


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


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_linear_reach_is_what_small_flights_reach(funnels, records_of, factor):
    """The two worst starts, made a thousand times smaller, with the disturbance that is worst for each."""
    inputs, records = funnels.all_inputs("corrected"), records_of["corrected"]
    gains, half_gain = records["gains"], factor * records["gains"].half_gain
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


def test_the_least_increase_is_that_of_doubled_levels():
    level = np.array([[1.0, 2.0, 4.0]])
    stand_in = SimpleNamespace(studied_level=level, reached_level=np.array([[2.0, 4.0, 7.0]]))
    assert sec3_funnels._least_increase(stand_in) == pytest.approx(1.75)
    assert sec3_funnels._least_increase(SimpleNamespace(studied_level=level, reached_level=3.0 * level**0.5)) < 2.0
    assert np.isnan(sec3_funnels._least_increase(None))
