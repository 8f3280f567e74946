import numpy as np
import pytest
from scipy.stats import kstest

from dubins_car import dubins
from generators import generator
from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.monte_carlo import (
    fly,
    greedy_additive,
    greedy_disturbance,
    quadratic_values,
)
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.sos.variety import Spheres
from marsedl.models.dynamics.dubins_car import dubins_car_rates


def around_zero(rates, time, dimension, disturbances):
    """A loop without control around the origin."""
    points = 2 * len(time) - 1
    states, controls, gains = np.zeros((points, dimension)), np.zeros((points, 1)), np.zeros((points, 1, dimension))
    return ClosedLoop(rates, time, states, controls, gains, disturbances)


def decay(steps=20):
    """x' = -x + w."""
    return around_zero(lambda i, x, u, w: (w[0] - x[0],), np.linspace(0, 1, steps + 1), 1, 1)


def oscillator(half_periods=4, steps=40):
    """x'' = -x + w over half periods of pi."""
    time = np.linspace(0, half_periods * np.pi, half_periods * steps + 1)
    return around_zero(lambda i, x, u, w: (x[1], w[0] - x[0]), time, 2, 1)


def car(steps=400):
    """The Dubins car of the paper's second figure with its regulator."""
    return dubins(0.03, every=1, steps=steps)[:2]


def test_directions_are_uniform_on_the_sphere():
    directions = Spheres((3,)).random_points(4000, generator(1))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-14)
    # Archimedes: a coordinate of a uniform point of the sphere in space is uniform.
    for axis in ([1, 0, 0], [0, 0, 1], np.ones(3) / np.sqrt(3)):
        assert kstest(directions @ axis, "uniform", args=(-1, 2)).pvalue > 0.01
    np.testing.assert_array_equal(directions, Spheres((3,)).random_points(4000, generator(1)))
    angle = np.arctan2(*Spheres((2,)).random_points(4000, generator(2)).T)
    assert kstest(angle, "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 0.01


def test_spread_directions_lie_on_the_boundary():
    factor = np.random.default_rng(1).standard_normal((6, 6)) * np.array([1e-3, 1e3, 1e3, 0.1, 100, 100])
    value_matrix = factor.T @ factor
    directions = Spheres((6,)).random_points(300, generator(1))
    deviations = directions @ spread_of(value_matrix, 0.18).T
    values = np.einsum("mi,ij,mj->m", deviations, value_matrix, deviations) / 2
    np.testing.assert_allclose(values, 0.18, rtol=1e-12)
    np.testing.assert_allclose(quadratic_values(value_matrix, deviations.T), 0.18, rtol=1e-12)
    # A point for every direction of the whitened space, and back.
    lower = np.linalg.cholesky(value_matrix)
    np.testing.assert_allclose(deviations @ lower / np.sqrt(0.36), directions, rtol=0, atol=1e-12)


def test_values_of_a_decay_under_a_constant_disturbance():
    loop = decay()
    start, wind = np.array([1.0, -0.5, 0.0]), np.array([0.0, 0.3, 1.0])
    values = fly(loop, np.full((21, 1, 1), 3.0), start[:, None], wind[:, None])
    fading = np.exp(-loop.time)[:, None]
    np.testing.assert_allclose(values, 1.5 * (fading * start + (1 - fading) * wind) ** 2, rtol=0, atol=1e-6)


def test_a_disturbance_drawn_anew_is_held_over_its_segment():
    loop = decay()
    disturbance = np.array([0.5, -1.0, 0.2, 0.0])[:, None, None]
    values = fly(loop, np.full((21, 1, 1), 2.0), [[0.4]], disturbance)
    position, expected = 0.4, [0.16]
    for wind in disturbance.ravel():
        fading = np.exp(-np.arange(1, 6) / 20)
        expected += list((fading * position + (1 - fading) * wind) ** 2)
        position = fading[-1] * position + (1 - fading[-1]) * wind
    np.testing.assert_allclose(values[:, 0], expected, rtol=0, atol=1e-6)
    same = np.tile(np.array([[0.3]]), (4, 1, 1))
    matrices = np.ones((21, 1, 1))
    np.testing.assert_array_equal(fly(loop, matrices, [[0.4]], same), fly(loop, matrices, [[0.4]], same[0]))


def test_the_greedy_adversary_drives_an_oscillator_in_resonance():
    # Pushing along the velocity adds 2 to the amplitude in each half period; a constant push cannot exceed 2 + 1.
    loop = oscillator(half_periods=4)
    matrices = np.tile(np.eye(2), (loop.steps + 1, 1, 1))
    start = np.array([[1.0, 0.0]])
    greedy = fly(loop, matrices, start, greedy_disturbance([[-1.0], [1.0]]))
    # A push that turns one step late loses the square of the step.
    late = 3 * (loop.time[1] - loop.time[0]) ** 2
    assert 9 - late - 1e-4 < np.sqrt(2 * greedy[-1, 0]) < 9 + 1e-4
    constant = fly(loop, matrices, np.repeat(start, 41, axis=0), np.linspace(-1, 1, 41)[:, None])
    assert np.sqrt(2 * constant.max()) == pytest.approx(3.0, rel=1e-4)
    random_disturbance = generator(1).uniform(-1, 1, (40, 500, 1))
    assert fly(loop, matrices, np.repeat(start, 500, axis=0), random_disturbance).max() < 0.5 * greedy[-1, 0]


def test_the_greedy_adversary_takes_the_best_direction_of_every_trajectory():
    loop, matrices = car(steps=40)
    deviation = (Spheres((3,)).random_points(9, generator(1)) @ spread_of(matrices[7], 0.1).T).T
    directions = Spheres((2,)).random_points(16, generator(2))
    chosen = greedy_disturbance(directions)(loop, 7, matrices[7], deviation)
    assert chosen.shape == (2, 9)
    for x, w in zip(deviation.T, chosen.T, strict=True):
        growth = [x @ matrices[7] @ loop.error_rates(14, x, direction) for direction in directions]
        np.testing.assert_array_equal(w, directions[np.argmax(growth)])


def test_the_additive_adversary_takes_the_best_point_of_its_ellipsoid():
    loop, matrices = car(steps=40)
    amplitudes = np.array([0.03, 0.01, 0.002])
    deviation = (Spheres((3,)).random_points(5, generator(1)) @ spread_of(matrices[7], 0.1).T).T
    chosen = greedy_additive(amplitudes)(loop, 7, matrices[7], deviation)
    np.testing.assert_allclose(np.sum((chosen / amplitudes[:, None]) ** 2, axis=0), 1.0, rtol=1e-14)
    growth_of_others = (Spheres((3,)).random_points(20000, generator(3)) * amplitudes) @ matrices[7] @ deviation
    growth = np.einsum("im,ij,jm->m", chosen, matrices[7], deviation)
    assert (growth_of_others.max(axis=0) <= growth).all()
    np.testing.assert_allclose(growth_of_others.max(axis=0), growth, rtol=1e-3)
    np.testing.assert_array_equal(greedy_additive(amplitudes)(loop, 7, matrices[7], np.zeros((3, 2))), 0.0)


def plain_flight(loop, start):
    """State at the end, from the equations of motion and the law of control without any deviation."""

    def rates(half, state):
        control = loop.controls[half] + loop.gains[half] @ (state - loop.states[half])
        return np.array(dubins_car_rates(*state, *control, 1.0))

    state = loop.states[0] + start
    for k, h in enumerate(np.diff(loop.time)):
        one = rates(2 * k, state)
        two = rates(2 * k + 1, state + h / 2 * one)
        three = rates(2 * k + 1, state + h / 2 * two)
        four = rates(2 * k + 2, state + h * three)
        state = state + h / 6 * (one + 2 * two + 2 * three + four)
    return state


def test_a_car_without_wind_comes_back_to_its_path():
    loop, matrices = car()
    start = Spheres((3,)).random_points(1000, generator(1)) @ spread_of(matrices[0], 0.15).T
    values = fly(loop, matrices, start, np.zeros((1000, 2)))
    # Of the linear loop V falls by the running cost; at this size the car is still like it.
    assert (np.diff(values.max(axis=1)) < 0).all()
    end = plain_flight(loop, start[0]) - loop.states[-1]
    assert values[-1, 0] == pytest.approx(end @ matrices[-1] @ end / 2, rel=1e-6)


def test_a_trajectory_does_not_depend_on_the_others():
    loop, matrices = car(steps=80)
    start = Spheres((3,)).random_points(23, generator(1)) @ spread_of(matrices[0], 0.15).T
    wind = Spheres((2,)).random_points(23 * 4, generator(2)).reshape(4, 23, 2)
    together = fly(loop, matrices, start, wind)
    for part in (slice(0, 7), slice(7, 8), slice(8, 23)):
        np.testing.assert_array_equal(fly(loop, matrices, start[part], wind[:, part]), together[:, part])
    adversary = greedy_disturbance(Spheres((2,)).random_points(8, generator(3)))
    together = fly(loop, matrices, start, adversary)
    np.testing.assert_array_equal(fly(loop, matrices, start[5:6], adversary), together[:, 5:6])


def test_a_diverging_trajectory_counts_as_outside_and_leaves_the_others_alone():
    loop = around_zero(lambda i, x, u, w: (x[0] * x[0] * x[0],), np.linspace(0, 4, 81), 1, 0)
    values = fly(loop, np.ones((81, 1, 1)), [[1.0], [0.1]], np.zeros((2, 0)))
    # 1/x^2 = 1/x_0^2 - 2 t: the first ends at t = 1/2.
    assert np.isfinite(values[:8]).all()
    assert (values[40:, 0] == np.inf).all()
    assert values[-1, 1] == pytest.approx(0.5 / (100 - 8), rel=1e-9)
