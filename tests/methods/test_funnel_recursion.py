from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from dubins_car import dubins
from generators import generator
from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.linear import additive_growth, linear_exact, slice_jacobians
from marsedl.methods.funnels.recursion import (
    Funnel,
    FunnelError,
    StageRule,
    backward,
    forward,
    initial_level,
    largest_feedback,
)
from marsedl.methods.funnels.stage import FunnelStage
from marsedl.methods.sos import verification
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.methods.sos.variety import Spheres
from starts import maximize_from_random_starts as maximize

CALM, WINDY = well_chosen_design(Spheres((3,)), 1), well_chosen_design(Spheres((3, 2)), 1)


def unit(count, size, seed):
    vectors = generator(seed).standard_normal((count, size))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def scalar_loop(rate, disturbances=0, steps=40, duration=1.0):
    """x' = rate(x, u, w) about rest, feedback u = -x."""
    points, time = 2 * steps + 1, np.linspace(0, duration, steps + 1)
    reference = np.zeros((points, 1)), np.zeros((points, 1)), -np.ones((points, 1, 1))
    return ClosedLoop(lambda half_index, x, u, w: (rate(x[0], u[0], w),), time, *reference, disturbances)


@pytest.fixture(scope="module")
def calm():
    return dubins()


@pytest.fixture(scope="module")
def windy():
    return dubins(wind=0.03)


@pytest.fixture(scope="module")
def calm_funnel(calm):
    return forward(*calm, 0.15, CALM)


@pytest.fixture(scope="module")
def windy_funnel(windy):
    return forward(*windy, 0.15, WINDY)


def flights(problem, level, count, seed, additive=None):
    """V at the slices of flights from the boundary of the first one, under a constant disturbance, (N, count)."""
    loop, shapes, slices = problem
    state = np.sqrt(2 * level) * np.linalg.solve(np.linalg.cholesky(shapes[0]).T, unit(count, 3, seed).T)
    disturbance = unit(count, 2, seed + 1).T if loop.disturbances else np.zeros((0, count))
    flight = [state]
    for first, last in pairwise(slices):
        flight.append(np.array(loop.flow(first, last, list(flight[-1]), list(disturbance), additive)))
    return np.einsum("kim,kij,kjm->km", flight, shapes, flight) / 2


def test_initial_level_is_the_least_that_contains_the_initial_set():
    units = np.array([1e3, 1e-4, 30.0])
    root = generator(1).standard_normal((2, 3, 3)) + 2 * np.eye(3)
    shape, initial_set = (matrix @ matrix.T / np.outer(units, units) for matrix in root)
    level = initial_level(shape, initial_set)
    difference = (initial_set - shape / level) * np.outer(units, units)
    eigenvalues = np.linalg.eigvalsh(difference)
    np.testing.assert_allclose(eigenvalues[0], 0, atol=1e-12 * eigenvalues[-1])
    inside = np.sqrt(2) * np.linalg.solve(np.linalg.cholesky(initial_set).T, unit(20_000, 3, 2).T)
    values = np.sum(inside * (shape @ inside), axis=0) / 2
    assert 0.99 * level < values.max() <= level * (1 + 1e-12)
    np.testing.assert_allclose(initial_level(np.diag([8.0, 3.0, 1.0]), np.diag([2.0, 2.0, 1.0])), 4, rtol=1e-14)
    with pytest.raises(ValueError, match="matrix of the initial set is not positive definite"):
        initial_level(shape, -initial_set)


def test_linear_levels_of_the_dubins_car_are_those_of_an_independent_computation():
    """At quarters of the path; those of the funnels are held in tests/papers/test_funnels_dubins.py."""
    loop, shapes, slices = dubins(0.0, 10, 400)
    linear = linear_exact(*slice_jacobians(loop, slices)[:2], shapes, 0.15)
    np.testing.assert_allclose(linear[::10], [0.15, 0.11973, 0.09293, 0.06875, 0.04583], atol=6e-6)


def test_bound_of_every_stage_is_reached_by_its_polynomial(windy, windy_funnel):
    """The sums-of-squares bound is neither below nor far above the largest value that an ascent finds."""
    loop, shapes, slices = windy
    for k in (0, 7, 13, 19):
        stage = FunnelStage(loop, slices[k], slices[k + 1], shapes[k], shapes[k + 1], windy_funnel.rho[k])
        largest, point = maximize(stage.values, (3, 2), 1, starts=300)
        np.testing.assert_allclose(np.linalg.norm(point[:3]), 1, rtol=1e-12)
        assert largest - 1e-9 < windy_funnel.polynomial_bound[k] < largest + 1e-6


def test_first_order_funnel_is_the_linear_recursion(calm, windy):
    """Without disturbance the growth is the largest eigenvalue; with one, the exact linear level."""
    for problem, design in ((calm, CALM), (windy, WINDY)):
        loop, shapes, slices = problem
        jacobians = slice_jacobians(loop, slices)
        funnel = forward(*problem, 0.15, design, StageRule(order=1))
        np.testing.assert_allclose(funnel.rho, linear_exact(*jacobians[:2], shapes, 0.15), rtol=2e-6)
        if not loop.disturbances:
            moved = np.linalg.inv(shapes[:-1]) @ jacobians[0].swapaxes(1, 2) @ shapes[1:] @ jacobians[0]
            np.testing.assert_allclose(funnel.growth, np.linalg.eigvals(moved).real.max(axis=1), rtol=2e-7)


def test_levels_increase_with_the_initial_set_and_with_the_disturbance(calm, windy, calm_funnel, windy_funnel):
    larger = forward(*windy, 0.16, WINDY)
    assert (larger.rho > windy_funnel.rho).all()
    gust = dubins(wind=0.04)
    assert (forward(*gust, 0.15, WINDY).rho[1:] > windy_funnel.rho[1:]).all()
    assert (windy_funnel.rho[1:] > calm_funnel.rho[1:]).all()
    # Without wind the regulator shrinks every slice.
    assert (np.diff(calm_funnel.rho) < 0).all()


@pytest.mark.parametrize("wind", [0.0, 0.03])
def test_no_flight_leaves_the_funnel_and_some_come_close(wind, calm_funnel, windy_funnel):
    """Neither at the slices nor at the fine steps between, where the level is interpolated."""
    funnel = windy_funnel if wind else calm_funnel
    values = flights(dubins(wind, every=1), 0.15, 2000, seed=3)
    ratios = values.max(axis=1) / np.interp(np.arange(81), funnel.slices, funnel.rho)
    assert ratios.max() <= 1 + 1e-12
    assert ratios.min() > 0.75


def test_inflated_funnel_covers_what_the_truncation_leaves_out(windy):
    """At first order the true map is found above the bound; the inflated funnel is raised to it."""

    def find(stage, bound):
        return maximize(stage.true_values, (3, 2), 1, full_ball=(False, True), starts=100, polished=3)[0]

    plain = forward(*windy, 0.15, WINDY, StageRule(order=1, maximum=find))
    assert (plain.violation > 1e-3).any()
    np.testing.assert_array_equal(plain.growth, plain.polynomial_bound)
    inflated = forward(*windy, 0.15, WINDY, StageRule(order=1, maximum=find, inflate=True))
    np.testing.assert_array_equal(inflated.growth, np.maximum(inflated.polynomial_bound, inflated.true_maximum))
    np.testing.assert_allclose(inflated.rho[1:], inflated.growth * inflated.rho[:-1], rtol=1e-14)
    assert (inflated.rho[1:] > plain.rho[1:]).all()
    third = forward(*windy, 0.15, WINDY, StageRule(maximum=find))
    assert np.abs(third.violation).max() < 0.1 * plain.violation.max()
    with pytest.raises(FunnelError, match="an inflated funnel needs the function `maximum`"):
        forward(*windy, 0.15, WINDY, StageRule(inflate=True))


def test_additive_disturbance_adds_to_the_root_of_the_level(calm, calm_funnel):
    loop, shapes, slices = calm
    amplitudes = np.array([0.02, 0.02, 0.01])
    growth = additive_growth(slice_jacobians(loop, slices)[2], shapes[1:], amplitudes)
    funnel = forward(*calm, 0.15, CALM, additive=growth)
    np.testing.assert_allclose(
        np.sqrt(funnel.rho[1:]), np.sqrt(funnel.growth * funnel.rho[:-1]) + np.sqrt(growth), rtol=1e-13
    )
    np.testing.assert_array_equal(forward(*calm, 0.15, CALM, additive=0 * growth).rho, calm_funnel.rho)
    values = flights(calm, 0.15, 4000, seed=5, additive=list(amplitudes[:, None] * unit(4000, 3, 6).T))
    assert (values.max(axis=1)[1:] < funnel.rho[1:]).all()
    assert (values.max(axis=1)[6:] > calm_funnel.rho[6:]).any()
    returned = backward(*calm, funnel.rho[-1], CALM, additive=growth)
    assert (returned.rho <= funnel.rho).all()
    np.testing.assert_allclose(returned.rho, funnel.rho, rtol=1e-4)
    with pytest.raises(FunnelError, match="additive disturbances alone leave slice 21 of 21"):
        backward(*calm, 1e-9, CALM, additive=growth)


def test_backward_funnel_returns_from_the_forward_one(calm, windy, calm_funnel, windy_funnel):
    """Within 1e-6 a stage, and never above: it must not claim a start from which the end is not reached."""
    for problem, design, funnel in ((calm, CALM, calm_funnel), (windy, WINDY, windy_funnel)):
        returned = backward(*problem, funnel.rho[-1], design)
        assert (returned.rho <= funnel.rho).all()
        np.testing.assert_allclose(returned.rho, funnel.rho, rtol=1e-4)
        reached = returned.growth * returned.rho[:-1] / returned.rho[1:]
        assert reached.max() <= 1
        assert reached.min() >= 1 - 1e-6
        assert returned.programs.mean() < 4


def test_backward_funnel_of_a_linear_stage_has_its_closed_form():
    """x' = -x + 0.2 w, P = 1: sqrt(2 rho_1) = (sqrt(2 rho_2) - 0.2 (1 - 1/e)) e, by Runge-Kutta steps of 1/40."""
    loop, design = scalar_loop(lambda x, u, w: u + 0.2 * w[0], disturbances=1), well_chosen_design(Spheres((1, 1)), 1)
    funnel = backward(loop, np.ones((2, 1, 1)), [0, 40], 0.5, design, tolerance=1e-7)
    np.testing.assert_allclose(np.sqrt(2 * funnel.rho[0]), (1 - 0.2 * (1 - np.exp(-1))) * np.e, rtol=2e-7)
    with pytest.raises(FunnelError, match=r"no slice before slice 2 of 2 \(t = 1 s\) at rho = 0.005"):
        backward(loop, np.ones((2, 1, 1)), [0, 40], 0.005, design)


def test_backward_funnel_finds_the_edge_of_attraction():
    """x' = u + 2 x^3 with u = -x: |x| < 1/sqrt 2 returns to rest, and however large the end, no slice reaches beyond.

    x^2 = 1 / (2 + (1/x_0^2 - 2) exp(2 t)), and the level is x^2 / 2. The terms that the truncation leaves out are
    positive here: with order three the first slice is too large, by an amount proportional to the step.
    """
    loop, errors = scalar_loop(lambda x, u, w: u + 2 * x**3), []
    start = 0.5 / (2 + (1 / 0.2 - 2) * np.exp(-2))
    for every, order in ((2, 9), (2, 3), (1, 3)):
        slices = np.arange(0, 41, every)
        design = well_chosen_design(Spheres((1,)), 1, degree=(order + 1) // 2)
        funnel = backward(loop, np.ones((len(slices), 1, 1)), slices, 0.1, design, StageRule(order=order))
        errors.append(funnel.rho[0] / start - 1)
    assert abs(errors[0]) < 1e-4
    assert errors[2] > 0
    np.testing.assert_allclose(errors[1] / errors[2], 2, atol=0.15)


def test_stages_are_verified_and_one_that_fails_its_check_makes_no_funnel(calm):
    loop, shapes, slices = calm
    checked = forward(loop, shapes[:4], slices[:4], 0.15, CALM, StageRule(verify=partial(verification.verify, seed=3)))
    assert all(check.sound and check.identity_error < 1e-6 for check in checked.verifications)
    strict = partial(verification.verify, seed=3, tolerance=0.0)  # no identity of floating point numbers is exact
    with pytest.raises(FunnelError, match=r"stage from slice 1 of 4 .* fails its check: its identity is off by"):
        forward(loop, shapes[:4], slices[:4], 0.15, CALM, StageRule(verify=strict))


def test_half_widths_and_volumes_of_slices():
    shapes = np.array([np.diag([4.0, 1.0, 0.25]), np.eye(3)])
    nothing = np.zeros(1)
    funnel = Funnel(np.array([0, 10]), shapes, np.array([0.5, 2.0]), *[nothing] * 8, ("optimal",), ())
    np.testing.assert_allclose(funnel.half_widths, [[0.5, 1, 2], [2, 2, 2]])
    np.testing.assert_allclose(np.exp(funnel.log_volumes), [4 / 3 * np.pi, 4 / 3 * np.pi * 8])
    tilted = replace(funnel, shapes=np.array([[[2.0, 1.0], [1.0, 2.0]]] * 2))
    boundary = np.sqrt(2 * 0.5) * np.linalg.solve(np.linalg.cholesky(tilted.shapes[0]).T, unit(20_000, 2, 1).T)
    np.testing.assert_allclose(tilted.half_widths[0], boundary.max(axis=1), rtol=1e-6)
    np.testing.assert_allclose(np.exp(tilted.log_volumes[0]), np.pi / np.sqrt(3))
    gain = np.array([[1.0, -2.0], [0.0, 3.0]])
    np.testing.assert_allclose(largest_feedback(gain, tilted.shapes[0], 0.5), (gain @ boundary).max(axis=1), rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"first_level": 0.5, "rule": StageRule(feedback_limit=0.3)},
            r"slice 1 of 21 .* deviation 1.\d+ of control 1, .* 0.3; the",
        ),
        (
            {"rule": StageRule(solver=partial(rank_one, iterations=2))},
            r"stage from slice 1 of 21 .* not closed: not converged .*\(gap",
        ),
        (
            {"rule": StageRule(order=4)},
            "basis of degree 2 cannot carry the polynomial of degree 5 of a stage of order 4",
        ),
    ],
)
def test_errors_name_slice_and_cause(calm, changes, message):
    loop, shapes, slices = calm
    arguments = {"loop": loop, "shapes": shapes, "slices": slices, "first_level": 0.15, "design": CALM} | changes
    with pytest.raises(FunnelError, match=message):
        forward(**arguments)


def test_a_diverging_funnel_says_where_and_in_what():
    loop, design = scalar_loop(lambda x, u, w: u + 2 * x**3, duration=4.0), well_chosen_design(Spheres((1,)), 1)
    slices = np.arange(41)
    with pytest.raises(FunnelError, match=r"diverges: rho = .* exceeds 10 at slice \d+ of 41 .* state 1 of 1 has grow"):
        forward(loop, np.ones((41, 1, 1)), slices, 0.4, design, limit=10.0)
    assert forward(loop, np.ones((41, 1, 1)), slices, 0.2, design, limit=10.0).rho[-1] < 0.01


def test_euler_condition_with_too_long_a_step_is_refused():
    """x' = -x over a step of 4: V - 4 x^2 is negative, and no slice is."""
    loop, design = scalar_loop(lambda x, u, w: u, duration=4.0), well_chosen_design(Spheres((1,)), 1)
    with pytest.raises(FunnelError, match=r"the euler condition leaves no slice after slice 1 of 2 .* -7 rho_k"):
        forward(loop, np.ones((2, 1, 1)), [0, 40], 0.3, design, StageRule(condition="euler"))
