from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods.guidance.apollo import adjoint_gains, density_slaved_matrix, drag_form
from marsedl.methods.guidance.longitudinal import linear_model
from marsedl.methods.lincov import discretize
from marsedl.methods.state_trigger import trigger_projection
from marsedl.models.dynamics.longitudinal_entry import longitudinal_entry_rates

DRAG_FACTOR, LIFT_FACTOR, GRAVITATIONAL_PARAMETER = 1 / 270, 0.24 / 270, 4.2828e13
CONSTANTS = (DRAG_FACTOR, LIFT_FACTOR, GRAVITATIONAL_PARAMETER)
DECAY_FACTOR, PLANET_RADIUS, COSINE = 2.0, 3.397e6, 0.6
STATE = np.array([PLANET_RADIUS + 125e3, 5800.0, np.radians(-15.5), 0.0, 0.0])
RANGE = np.array([0.0, 0.0, 0.0, 1.0, 0.0])


def profile(radius):
    """Mean density, 1/H and d(1/H)/dr of ln rho = a + b h + c h^2."""
    altitude = radius - PLANET_RADIUS
    a, b, c = -4.23, -8.7e-5, -1.5e-10
    return np.exp(a + b * altitude + c * altitude**2), -b - 2 * c * altitude, -2 * c + 0 * altitude


def rates(state, cosine=COSINE):
    mean, inverse, _ = profile(state[0])
    return np.array(longitudinal_entry_rates(state, cosine, mean, inverse, DECAY_FACTOR * inverse, *CONSTANTS))


def start():
    state = STATE.copy()
    state[4] = profile(state[0])[0]
    return state


class Reference(NamedTuple):
    """A flight of Eqs. 27 with constant bank, its linear model and discrete systems."""

    state: np.ndarray  # (N + 1, 5)
    transition: np.ndarray  # (N, 5, 5)
    control: np.ndarray  # (N, 5)
    slaved_transition: np.ndarray  # (N, 4, 4)
    slaved_control: np.ndarray  # (N, 4)


@pytest.fixture(scope="module")
def flight():
    """The flight down to 500 m/s as a function of time, and its duration."""

    def slow(t, state):
        return state[1] - 500.0

    slow.terminal = True
    trajectory = solve_ivp(
        lambda t, y: rates(y),
        (0, 400),
        start(),
        method="DOP853",
        rtol=1e-12,
        atol=[1e-5, 1e-8, 1e-12, 1e-5, 1e-17],
        events=slow,
        dense_output=True,
    )
    assert trajectory.status == 1
    return trajectory.sol, float(trajectory.t[-1])


def discrete(flight, intervals, substeps):
    path, duration = flight
    width = duration / intervals
    middles = (np.arange(intervals * substeps) + 0.5) * (width / substeps)
    states = path(middles).T
    count, cosine = len(states), np.full(len(middles), COSINE)
    mean, inverse, slope = profile(states[:, 0])
    matrix, control = linear_model(states, cosine, mean, inverse, slope, DECAY_FACTOR, *CONSTANTS)
    steps = np.full(intervals, width)
    shape = (intervals, substeps)
    full = discretize(matrix.reshape(*shape, 5, 5), control.reshape(*shape, 5, 1), np.zeros((*shape, 5, 5)), steps)
    slaved_matrix = density_slaved_matrix(matrix, inverse, states[:, 4])
    assert slaved_matrix.shape == (count, 4, 4)
    slaved = discretize(
        slaved_matrix.reshape(*shape, 4, 4), control[:, :4].reshape(*shape, 4, 1), np.zeros((*shape, 4, 4)), steps
    )
    nodes = path(np.linspace(0, duration, intervals + 1)).T
    return Reference(nodes, full.transition, full.control[:, :, 0], slaved.transition, slaved.control[:, :, 0])


@pytest.fixture(scope="module")
def reference(flight):
    return discrete(flight, round(flight[1]), 10)


def random_system(intervals=12, n=4, seed=9):
    random = np.random.default_rng(seed)
    transition = np.eye(n) + 0.3 * random.standard_normal((intervals, n, n))
    return transition, random.standard_normal((intervals, n)), random.standard_normal(n), random


# ---- adjoint gains ---------------------------------------------------------------------------------------------------


def test_double_integrator_has_the_gains_of_the_textbook():
    # x'' = u over the rest T of the time: final position x + T x' + T^2/2 u
    step, intervals = 0.5, 8
    transition = np.tile([[1.0, step], [0.0, 1.0]], (intervals, 1, 1))
    control = np.tile([step**2 / 2, step], (intervals, 1))
    gains = adjoint_gains(transition, control, [1.0, 0.0], 3.0)
    remaining_time = step * np.arange(intervals, 0, -1)
    np.testing.assert_allclose(gains.adjoint[:-1], np.stack([remaining_time**0, remaining_time], axis=1), rtol=1e-14)
    np.testing.assert_allclose(gains.control_adjoint, remaining_time**2 / 2, rtol=1e-14)
    np.testing.assert_allclose(
        gains.gain, -3 * np.stack([2 / remaining_time**2, 2 / remaining_time], axis=1), rtol=1e-14
    )


def test_control_of_the_gain_held_to_the_end_cancels_the_final_error():
    transition, control, final_adjoint, random = random_system()
    gains = adjoint_gains(transition, control, final_adjoint, 1.0)
    for first in range(len(control)):
        state = random.standard_normal(4)
        constant_control, size = gains.gain[first] @ state, np.abs(gains.adjoint[first] * state).sum()
        for k in range(first, len(control)):
            state = transition[k] @ state + control[k] * constant_control
        assert abs(final_adjoint @ state) < 1e-12 * size
    np.testing.assert_allclose(adjoint_gains(transition, control, final_adjoint, 5.0).gain, 5 * gains.gain, rtol=1e-15)


# ---- on a flight -----------------------------------------------------------------------------------------------------


def influence_along(flight, intervals, final_adjoint):
    """The adjoint times the rates at the bounds of the intervals; one sub-step each."""
    reference = discrete(flight, intervals, 1)
    adjoint = adjoint_gains(reference.transition, reference.control, final_adjoint, 5.0).adjoint
    return np.einsum("ki,ki->k", adjoint, np.array([rates(state) for state in reference.state]))


def test_adjoint_times_rates_is_constant_along_a_flight_with_constant_bank(flight):
    # The rates solve the linear model, so theta'f keeps its final value: V cos(gamma), or zero with the trigger.
    path, duration = flight
    final_rates = rates(path(duration))
    projected = trigger_projection(final_rates, np.eye(5)[1]).T @ RANGE
    assert abs(projected @ final_rates) < 1e-12 * abs(final_rates[3])
    for final_adjoint, value in ((RANGE, final_rates[3]), (projected, 0.0)):
        errors = []
        for intervals in (1000, 2000, 4000):
            errors.append(np.abs(influence_along(flight, intervals, final_adjoint) - value).max())
        np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.1)
        assert errors[-1] < 1e-5 * final_rates[3]


def test_gains_bring_a_deviating_flight_to_the_target_range(flight, reference):
    # Over-control 1, the control held from entry to the end: what is left of the range error is of second order.
    path, duration = flight
    gains = adjoint_gains(reference.transition, reference.control, RANGE, 1.0)
    largest = np.array([0.0, 2.0, 1e-4, -500.0, 0.0])
    errors = []
    for size in (1.0, 0.5):
        deviation = size * largest
        cosine = COSINE + gains.gain[0] @ deviation
        trajectory = solve_ivp(
            lambda t, y, u=cosine: rates(y, u),
            (0, duration),
            start() + deviation,
            method="DOP853",
            rtol=1e-11,
            atol=[1e-4, 1e-7, 1e-11, 1e-4, 1e-16],
        )
        errors.append(trajectory.y[3, -1] - path(duration)[3])
    assert abs(errors[0]) < 0.05 * abs(gains.adjoint[0] @ largest)
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.4)


def test_density_slaved_adjoint_is_the_projection_of_the_five_state_one(flight):
    # theta4_r = theta5_r - theta5_rho rho/H: exact in continuous time, as the density of the mean profile stays on it.
    path, duration = flight
    projected = trigger_projection(rates(path(duration)), np.eye(5)[1]).T @ RANGE
    for final_adjoint in (RANGE, projected):
        errors = []
        for substeps in (5, 10, 20):
            trajectory = discrete(flight, round(duration), substeps)
            full = adjoint_gains(trajectory.transition, trajectory.control, final_adjoint, 5.0)
            slaved = adjoint_gains(trajectory.slaved_transition, trajectory.slaved_control, final_adjoint[:4], 5.0)
            _, inverse, _ = profile(trajectory.state[:, 0])
            expected = full.adjoint[:, :4].copy()
            expected[:, 0] -= full.adjoint[:, 4] * trajectory.state[:, 4] * inverse
            by_state = np.abs(slaved.adjoint - expected).max(axis=0) / np.abs(expected).max(axis=0)
            by_control = np.abs(slaved.control_adjoint - full.control_adjoint).max() / full.control_adjoint.max()
            errors.append(max(*by_state, by_control))
        assert errors[1] < 2e-6  # with ten sub-steps per second
        np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.1)


# ---- drag form and slaved density ------------------------------------------------------------------------------------


def test_drag_form_feeds_back_the_same_at_equal_velocity(reference):
    gain = adjoint_gains(reference.transition, reference.control, RANGE, 5.0).gain
    radius, velocity, path_angle, _, density = reference.state[:-1].T
    _, inverse, _ = profile(radius)
    drag = DRAG_FACTOR * density * velocity**2
    form = drag_form(gain, density, drag, 1 / inverse, velocity, path_angle)

    # A deviation along the mean profile, at equal velocity; drag and altitude rate by differences.
    random = np.random.default_rng(10)
    step = 1e-30
    radius_change, angle_change, range_change = random.standard_normal((3, len(gain))) * [[100.0], [1e-3], [500.0]]
    density_change = -density * inverse * radius_change
    drag_change = (DRAG_FACTOR * (density + 1j * step * density_change) * velocity**2).imag / step
    climb_change = (velocity * np.sin(path_angle + 1j * step * angle_change)).imag / step
    deviations = np.stack([radius_change, 0 * radius_change, angle_change, range_change, density_change], axis=1)
    terms = gain * deviations
    fed_back = np.einsum("kj,kj->k", form, np.stack([range_change, drag_change, climb_change], axis=1))
    assert (np.abs(fed_back - terms.sum(axis=1)) < 1e-14 * np.abs(terms).sum(axis=1)).all()


def test_slaved_matrix_is_the_derivative_with_the_density_of_the_altitude():
    random = np.random.default_rng(11)
    count, step = 20, 1e-30
    radius = PLANET_RADIUS + random.uniform(10e3, 90e3, count)
    mean, inverse, slope = profile(radius)
    states = np.stack([radius, random.uniform(500, 5800, count), random.uniform(-0.3, 0, count), radius, mean], axis=1)
    cosine = random.uniform(-1, 1, count)
    matrix, _ = linear_model(states, cosine, mean, inverse, slope, DECAY_FACTOR, *CONSTANTS)
    slaved = density_slaved_matrix(matrix, inverse, mean)

    def slaved_rates(points):
        density, inverse, _ = profile(points[:, 0])
        atmosphere = (density, inverse, DECAY_FACTOR * inverse)
        return np.stack(longitudinal_entry_rates((*points.T, density), cosine, *atmosphere, *CONSTANTS)[:4], axis=1)

    columns = [slaved_rates(states[:, :4] + 1j * step * unit).imag / step for unit in np.eye(4)]
    scale = np.array([1e3, 100.0, 0.01, 1e3])
    difference = (slaved - np.stack(columns, axis=2)) * scale / scale[:, np.newaxis]
    assert np.abs(difference).max() < 1e-14
