"""Studies of the funnels paper: one stage in all forms, and funnels computed in other ways.

Expected numbers without another source are those of an independent study of the paper, with a nominal of its own.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.methods.funnels.stage import lyapunov_rate
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment, gains
from marsedl.papers.funnels.basics import SPHERES
from marsedl.papers.funnels.beyond import (
    coarse_funnels,
    equations_of_motion,
    euler_step,
    programs,
    stage_study,
    stationary,
)
from marsedl.replication.records import fields

BENCHMARK = 1.163082
SMALL = {
    "check_points": 500,
    "tightness_polished": 4,
    "stationary_points": 300,
    "studied_samples": np.array([50.0, 200.0, 406.0]),
}


@pytest.fixture(scope="module")
def inputs(funnels):
    """Function that returns inputs, small and some of them changed."""
    return lambda reading="corrected", **changes: funnels.inputs(reading, **(SMALL | changes))


@pytest.fixture(scope="module")
def model(funnels):
    return funnels.linearization()


@pytest.fixture(scope="module")
def regulator(funnels):
    return funnels.gains()


@pytest.fixture(scope="module")
def loop(inputs, model, regulator):
    given = inputs()
    air = environment.disturbed_air(given.planet, given.uncertainty)
    return environment.closed_loop(given.planet, given.vehicle, air, model, regulator.half_gain)


@pytest.fixture(scope="module")
def design(inputs, funnels):
    return programs.samples(inputs().recursion)


@pytest.fixture(scope="module")
def stage_fields(inputs, model, regulator):
    """The fields of the study of a stage."""
    with pytest.MonkeyPatch.context() as patch:
        # Clarabel takes ten times as long; the tests of the programs compare it.
        patch.setattr(stage_study, "CONIC_TOLERANCE", {"SCS": 1e-6})
        return vars(inputs().call(stage_study.compute, model, regulator))


@pytest.fixture(scope="module")
def still(inputs, model, regulator):
    """Stationary disturbances."""
    return inputs().call(stationary.compute, model, regulator)


# --- one stage --------------------------------------------------------------------------------------------------------


def test_counts_are_those_of_formulas_and_of_ranks(stage_fields):
    rows = {
        name: row
        for name, *row in zip(
            *(
                stage_fields[key].tolist()
                for key in ("variety", "monomials", "basis_size", "coefficients", "gram_unknowns", "samples")
            ),
            strict=True,
        )
    }
    assert rows["S^5 x S^1"] == [45, 43, 495, 946, 406]
    assert rows["S^5"] == [28, 27, 210, 378, 182]
    assert rows["S^2"] == [10, 9, 35, 45, 25]
    assert rows["S^1"] == [6, 5, 15, 15, 9]
    assert rows["S^5 x S^7"][0] == 120
    computed = stage_fields["product_rank"] > 0
    assert computed.sum() == 5  # the last variety is counted only
    np.testing.assert_array_equal(stage_fields["product_rank"][computed], stage_fields["samples"][computed])
    np.testing.assert_array_equal(stage_fields["basis_rank"][computed], stage_fields["basis_size"][computed])


def test_all_forms_give_one_bound(stage_fields):
    np.testing.assert_allclose(stage_fields["form_bound"], BENCHMARK, rtol=2e-6)
    np.testing.assert_allclose(stage_fields["form_bound"], stage_fields["form_bound"][0], rtol=1e-7)
    assert (stage_fields["form_safe_bound"] >= stage_fields["form_bound"] - 1e-12).all()
    assert list(stage_fields["form_status"]) == ["optimal"] * 4


def test_too_few_samples_give_a_bound_that_is_too_small(stage_fields):
    np.testing.assert_array_equal(stage_fields["few_rank"], [50, 200, 406])
    assert (stage_fields["few_bound"][:2] < 0.99 * BENCHMARK).all()
    assert stage_fields["few_least_value"][0] < 0.0
    assert stage_fields["few_bound"][2] == pytest.approx(BENCHMARK, rel=2e-6)
    assert stage_fields["few_least_value"][2] > 0.0


def test_bases_condition_as_expected(stage_fields):
    si, km, scaled, whitened, hermite, variance_one, orthonormal = stage_fields["basis_condition"]
    assert si > 1e4 * km > 1e6 * scaled and scaled > 5.0 * whitened
    assert hermite > whitened > 2.0 * variance_one > 2.0 * orthonormal
    assert variance_one < 2.5 and orthonormal == pytest.approx(1.0, abs=1e-12)


# --- stationary disturbances ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def euler_stage(inputs, loop, regulator):
    at = environment.slice_at(loop, 4, inputs().stationary_slice), inputs().stationary_level
    return programs.stage_at(inputs().recursion, loop, regulator, *at, 4, condition="euler")


def test_newton_finds_stationary_points_of_a_cubic():
    centre = np.array([[0.4, -0.3], [2.0, 1.0]])

    def polynomial(w):
        u, v = (np.broadcast_to(w, centre.shape) - centre).T
        hessian = np.moveaxis(np.array([[2.0 + 0.6 * u, 0.0 * u], [0.0 * u, -1.0 + 0.0 * v]]), -1, 0)
        return u**2 + 0.1 * u**3 - v**2 / 2.0, np.stack([2.0 * u + 0.3 * u**2, -v], axis=1), hessian

    point, gradient, start = stationary.newton(polynomial)
    np.testing.assert_allclose(point, centre, atol=1e-12)
    assert np.abs(gradient).max() < 1e-12
    np.testing.assert_array_equal(start, polynomial(np.zeros(2))[1])


def test_newton_takes_no_step_where_the_hessian_vanishes():
    """Of an affine function and a bowl, only the bowl has a lowest point."""
    slope, flat = np.array([[1.0, 2.0], [0.0, 0.0]]), np.array([0.0, 1.0])

    def polynomial(w):
        w = np.broadcast_to(w, (2, 2))
        away = w - 0.5
        value = (slope * w).sum(axis=1) + flat * (away**2).sum(axis=1)
        return value, slope + 2.0 * flat[:, np.newaxis] * away, 2.0 * flat[:, np.newaxis, np.newaxis] * np.eye(2)

    point, gradient, _ = stationary.newton(polynomial)
    np.testing.assert_array_equal(point, [[0.0, 0.0], [0.5, 0.5]])
    np.testing.assert_array_equal(gradient, [[1.0, 2.0], [0.0, 0.0]])


def test_stationary_disturbances_are_saddles_outside_of_the_disc(still):
    assert still.stationary_converged > 0.9
    assert still.stationary_inside == 0 and still.stationary_norm[0] > 1.0 < still.stationary_norm[1] / 100.0
    assert still.stationary_value > 1.5 * still.boundary_value
    assert still.interior_better == 0
    assert still.gradient_deviation < 1e-8


def test_an_additive_disturbance_has_no_stationary_point(inputs, model, regulator):
    given = inputs(density_disturbance="additive").call(stationary.compute, model, regulator)
    # V' is affine in w then: nothing but rounding is left of its Hessian.
    assert given.interior_better == 0 and given.stationary_inside == 0
    assert given.gradient_deviation < 1e-8


def test_the_worst_disturbance_is_one_of_the_two_along_the_gradient_of_the_density(
    inputs, loop, regulator, euler_stage
):
    points = SPHERES.random_points(50, np.random.Generator(np.random.Philox(8)))
    deviations, first = euler_stage.deviations(points), euler_stage.first
    altitude = loop.states[2 * first, 0] + deviations[:, 0]
    along = np.stack([np.full(50, inputs().density_amplitude), inputs().density_slope_amplitude * altitude], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)

    def rate(w):
        return lyapunov_rate(loop, 2 * first, euler_stage.shape, np.zeros((6, 6)), deviations, w)

    best = np.maximum(rate(along), rate(-along))
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    disc = [radius * np.array([np.cos(a), np.sin(a)]) for radius in (0.3, 0.7, 1.0) for a in angle]
    among = np.max([rate(np.broadcast_to(w, (50, 2))) for w in disc], axis=0)
    assert (among <= best + 1e-12).all()
    assert (among > best - 1e-3 * np.abs(best).max()).all()


# --- funnels in other ways --------------------------------------------------------------------------------------------


def test_equations_of_motion_are_those_of_inertial_flight(inputs, monkeypatch):
    deviations = inputs().call(equations_of_motion.compute)
    assert deviations.position_rate_deviation < 1e-14 and deviations.velocity_rate_deviation < 1e-13
    rates = environment.entry_rates

    def banked_left(*given):
        return lambda half, state, control, w: rates(*given)(half, state, [-control[0]], w)

    monkeypatch.setattr(environment, "entry_rates", banked_left)
    assert inputs().call(equations_of_motion.compute).velocity_rate_deviation > 0.1


def test_the_euler_step_differs_in_second_order(inputs, loop, regulator, design):
    first, level = 112, 5.235
    size = []
    for spacing in (4, 2, 1):
        k = first // spacing
        stage = programs.stage_at(inputs().recursion, loop, regulator, k + 1, level, spacing)
        levels = np.full(240 // spacing + 1, np.nan)
        levels[k : k + 2] = level, level * rank_one(stage.values(design.points), design.basis).safe_bound
        excess = euler_step.euler_excess(inputs().recursion, loop, regulator, design, spacing, levels)
        assert np.flatnonzero(np.isfinite(excess)).tolist() == [k]
        size.append(excess[k])
    ratio = np.array([coarse / fine for coarse, fine in pairwise(size)])
    assert size[0] < 0.0  # it is not a bound
    assert (np.abs(ratio - 4.0) < 1.2).all()


@pytest.fixture(scope="module")
def small_of(inputs):
    """Function that returns inputs for the part of the flight between two nodes, in two slices or four."""
    few = {"fine_steps": 16, "steps_per_slice": 4, "coarse_stages": 2, "backward_level": 5.0}
    return lambda **changes: inputs(**(few | changes))


@pytest.fixture(scope="module")
def small(small_of):
    return small_of()


@pytest.fixture(scope="module")
def part(small, model):
    """The reference and the feedback of that part."""
    first, last = 88, 88 + small.fine_steps
    extents = {"time": slice(first, last + 1), "half": slice(2 * first, 2 * last + 1)}
    declared = fields.quantities(type(model)).items()
    parts = {name: getattr(model, name)[extents[of.dims[0]]] for name, of in declared if of.dims[0] in extents}
    lines = replace(model, **parts)
    return lines, small.call(gains.compute, lines)


@pytest.fixture(scope="module")
def coarse(small, part):
    return small.call(coarse_funnels.compute, *part)


def variant(study, name):
    return study.variant_level[list(study.variant).index(name)]


def test_the_funnel_of_the_reading_is_taken_where_it_bounds_the_motion(small, small_of, part):
    given, (lines, regulator) = small, part
    air = environment.disturbed_air(given.planet, given.uncertainty)
    loop = environment.closed_loop(given.planet, given.vehicle, air, lines, regulator.half_gain)
    levels, _ = programs.propagate(given.recursion, loop, regulator, programs.samples(given.recursion), 4)
    excess = small.call(euler_step.compute, *part, SimpleNamespace(level=levels)).excess
    assert len(excess) == 4 and np.isfinite(excess).all()
    for other in ({"inflated": True}, {"condition": "euler"}):
        again = small_of(**other).call(euler_step.compute, *part, SimpleNamespace(level=2.0 * levels))
        np.testing.assert_array_equal(again.excess, excess)


def test_a_division_by_zero_in_a_funnel_is_told(monkeypatch):
    """Only values of a stage's polynomial may leave the range of numbers, and the recursion looks at these."""

    def dividing(*_, **__):
        return np.float64(1.0) / np.float64(0.0)

    recursion = SimpleNamespace(taylor_order=3, program_tolerance=1e-8, largest_level=1.0)
    loop, regulator = SimpleNamespace(steps=4), SimpleNamespace(shape=np.ones((5, 1, 1)), initial_level=1.0)
    monkeypatch.setattr(programs, "forward", dividing)
    monkeypatch.setattr(coarse_funnels, "backward", dividing)
    with pytest.raises(RuntimeWarning, match="divide by zero"):
        programs.propagate(recursion, loop, regulator, None, 2)
    with pytest.raises(RuntimeWarning, match="divide by zero"):
        coarse_funnels.backwards(recursion, loop, regulator, None, np.array([0, 2, 4]), 1.0)


def test_multipliers_and_samples_give_one_funnel(coarse):
    assert coarse.multiplier_difference < 1e-6
    assert coarse.multiplier_status.tolist() == ["optimal"] * 2


def test_the_backward_funnel_returns(coarse):
    back, returned = variant(coarse, "backward"), variant(coarse, "returned")
    assert back[-1] == 5.0 and back[0] == returned[0]
    assert (returned <= back * (1.0 + 1e-12)).all() and coarse.round_trip_shortfall <= 1e-12
    np.testing.assert_allclose(returned, back, rtol=1e-4)
    assert coarse.round_trip == np.abs(back / returned - 1.0).max()
