from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods import lincov
from marsedl.methods.field_disturbance import (
    condition_number,
    discretize_interval,
    disturbance_covariance,
    disturbance_mean,
    gauss_legendre,
    regularize,
    trapezoid_weights,
)
from marsedl.methods.linearization import linearize

UNITS = np.array([1e3, 100.0, 0.01])
RADIUS, DENSITY_SCALE = 3.397e6, 8e3
# Entry at 70 km: intervals of different lengths, on which the control keeps its value and between which it jumps.
INITIAL_STATE = np.array([RADIUS + 70e3, 6000.0, -0.17])
STARTS, CONTROLS = np.array([0.0, 15.0, 35.0, 60.0]), np.array([0.4, -0.6, 0.9])


def entry_rates(radius, velocity, flight_path_angle, bank_cosine, variation):
    """Planar entry of a capsule at Mars in exponential air whose density varies by a fraction."""
    gravity = 4.2828e13 / radius**2
    drag = 0.02 * np.exp(-(radius - RADIUS) / DENSITY_SCALE) * (1 + variation) / 300 * velocity**2
    return (
        velocity * np.sin(flight_path_angle),
        -drag - gravity * np.sin(flight_path_angle),
        0.2 * drag / velocity * bank_cosine - (gravity / velocity - velocity / radius) * np.cos(flight_path_angle),
    )


def fly(states, control, times, variation=lambda time: 0.0):
    """States at the times, by an adaptive integrator of the nonlinear equations; several trajectories at once."""
    states = np.atleast_2d(states)

    def rates(time, flat):
        return np.ravel(entry_rates(*flat.reshape(3, -1), control, variation(time)))

    solution = solve_ivp(
        rates,
        (times[0], times[-1]),
        states.T.ravel(),
        t_eval=times,
        method="DOP853",
        rtol=1e-13,
        atol=np.repeat(UNITS * 1e-13, len(states)),
    )
    return solution.y.reshape(3, len(states), -1).transpose(2, 1, 0)


class Flight(NamedTuple):
    """The flight above, linearized and discretized with one step."""

    states: list  # on the nodes of each interval, (nodes, 3)
    intervals: list
    weights: list
    times: list  # nodes of each interval
    models: list  # linear model on the half-step grid of each interval

    @property
    def effects(self):
        return [interval.field_effect for interval in self.intervals]

    @property
    def altitudes(self):
        return np.concatenate(self.states)[:, 0] - RADIUS


def discretized_flight(step):
    state, flight = INITIAL_STATE, Flight([], [], [], [], [])
    for start, end, control in zip(STARTS[:-1], STARTS[1:], CONTROLS, strict=True):
        steps = round((end - start) / step)
        half_steps = np.linspace(start, end, 2 * steps + 1)
        states = fly(state, control, half_steps)[:, 0]
        model = linearize(entry_rates, states, np.column_stack([np.full(len(states), control), np.zeros(len(states))]))
        flight.states.append(states[::2])
        flight.times.append(half_steps[::2])
        flight.models.append(model)
        flight.weights.append(trapezoid_weights(steps, step))
        flight.intervals.append(
            discretize_interval(model.state_matrix, model.control_matrix[..., :1], model.control_matrix[..., 1], step)
        )
        state = states[-1]
    return flight


@pytest.fixture(scope="module")
def flight():
    return discretized_flight(0.25)


def central_difference(function, step):
    """Derivative of fourth order at zero."""
    ends = [function(factor * step) for factor in (-2, -1, 1, 2)]
    return (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)


def altitude_kernel(first, second, variance=0.15, growth_length=20e3, correlation_length=11e3):
    """Gaussian Markov field over altitude whose variance grows with altitude."""
    return variance * np.exp(
        np.minimum(first, second) / growth_length - np.abs(first - second) / correlation_length - 6
    )


def pairwise_covariance(kernel, points):
    return kernel(points[:, None], points)


# ---- intervals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", range(3))
def test_transition_and_control_are_derivatives_of_the_nonlinear_flight(flight, k):
    start, ends = flight.states[k][0], STARTS[[k, k + 1]]
    by_state = np.array(
        [
            central_difference(lambda d, i=i: fly(start + d * UNITS * np.eye(3)[i], CONTROLS[k], ends)[-1, 0], 0.01)
            for i in range(3)
        ]
    ).T
    by_control = central_difference(lambda d: fly(start, CONTROLS[k] + d, ends)[-1, 0], 0.01)
    transition = flight.intervals[k].transition * UNITS / UNITS[:, None]
    assert transition == pytest.approx(by_state / UNITS[:, None], rel=1e-7, abs=1e-8)
    assert flight.intervals[k].control[:, 0] / UNITS == pytest.approx(by_control / UNITS, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("k", range(3))
def test_field_effect_is_the_response_of_the_nonlinear_flight_to_the_field(flight, k):
    """The response to one field along the nominal, int F(t) psi(t) dt (Eq. 24)."""
    ends = STARTS[[k, k + 1]]

    def psi(time):
        return 1 + np.sin(0.4 * time)

    response = central_difference(
        lambda d: fly(flight.states[k][0], CONTROLS[k], ends, lambda t: d * psi(t))[-1, 0], 0.01
    )
    simpson = 0.25 / 3 * np.concatenate([[1], np.tile([4, 2], (len(flight.times[k]) - 3) // 2), [4, 1]])
    summed = (simpson * psi(flight.times[k])) @ flight.effects[k]
    assert summed / UNITS == pytest.approx(response / UNITS, rel=1e-6, abs=1e-7)
    by_trapezoid = disturbance_mean(flight.effects[k : k + 1], flight.weights[k : k + 1], [psi(flight.times[k])])
    assert by_trapezoid[0] / UNITS == pytest.approx(response / UNITS, rel=1e-3)


def state_matrix(t):
    return np.array([[-0.3, 1.0 + 0.5 * np.sin(t), 0.0], [-1.2, -0.1 * t, 0.4], [0.2 * np.cos(2 * t), 0.0, -0.5]])


def control_matrix(t):
    return np.array([[0.2, 1.0], [np.cos(t), 0.0], [0.3 * t, np.sin(t)]])


def field_matrix(t):
    return np.array([0.3, 0.1 * t, np.exp(-t)])


def sampled(steps, duration=2.0):
    """Arguments of `discretize_interval` for the system above."""
    times = np.linspace(0, duration, 2 * steps + 1)
    matrices = (np.array([function(t) for t in times]) for function in (state_matrix, control_matrix, field_matrix))
    return *matrices, duration / steps


def test_interval_is_of_fourth_order():
    def integrated(start):
        """Transition from the start to 2, and the effect of the control held meanwhile, by an adaptive integrator."""

        def rates(t, flat):
            a, matrix = state_matrix(t), flat.reshape(3, 5)
            return (a @ matrix + np.hstack([np.zeros((3, 3)), control_matrix(t)])).ravel()

        flat = solve_ivp(rates, (start, 2), np.eye(3, 5).ravel(), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return flat.reshape(3, 5)[:, :3], flat.reshape(3, 5)[:, 3:]

    transition, control = integrated(0)
    from_middle, _ = integrated(1)
    errors = []
    for steps in (8, 16, 32):
        interval = discretize_interval(*sampled(steps))
        errors.append(
            [
                np.abs(interval.transition - transition).max(),
                np.abs(interval.control - control).max(),
                np.abs(interval.field_effect[0] - transition @ field_matrix(0)).max(),
                np.abs(interval.field_effect[steps // 2] - from_middle @ field_matrix(1)).max(),
            ]
        )
        assert np.array_equal(interval.field_effect[-1], field_matrix(2))
    errors = np.array(errors)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(4, abs=0.3)
    assert errors[-1].max() < 1e-5


def test_double_integrator_is_exact():
    pair = np.tile([[0.0, 1.0], [0.0, 0.0]], (9, 1, 1))
    interval = discretize_interval(pair, np.tile([[0.0], [1.0]], (9, 1, 1)), np.tile([0.0, 1.0], (9, 1)), 0.25)
    assert interval.transition == pytest.approx(np.array([[1, 1], [0, 1]]), abs=1e-15)
    assert interval.control[:, 0] == pytest.approx([0.5, 1], abs=1e-15)
    to_end = np.array([1, 0.75, 0.5, 0.25, 0])
    assert interval.field_effect == pytest.approx(np.column_stack([to_end, np.ones(5)]), abs=1e-15)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"state_matrix": np.zeros((4, 3, 3))}, r"state_matrix must have shape \(2 s \+ 1, n, n\)"),
        ({"field_matrix": np.full((5, 3), np.nan)}, "field_matrix must be finite"),
        ({"step": 0.0}, "step must be positive, got 0.0"),
    ],
)
def test_bad_samples_are_refused(changes, message):
    good = {
        "state_matrix": np.zeros((5, 3, 3)),
        "control_matrix": np.zeros((5, 3, 1)),
        "field_matrix": np.zeros((5, 3)),
        "step": 0.5,
    }
    with pytest.raises(ValueError, match=message):
        discretize_interval(**(good | changes))


# ---- quadrature ------------------------------------------------------------------------------------------------------


def test_trapezoid_weights_are_exact_for_straight_lines_only():
    weights, nodes = trapezoid_weights(5, 0.4), np.linspace(1, 3, 6)
    assert weights @ (4 * nodes - 1) == pytest.approx(14, rel=1e-14)
    # The error of the composite rule for t^2 is (b - a) h^2 / 6.
    assert weights @ nodes**2 == pytest.approx(26 / 3 + 2 * 0.4**2 / 6, rel=1e-14)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_gauss_legendre_is_exact_up_to_its_degree(order):
    nodes, weights = gauss_legendre(order, 1.0, 3.0)
    assert (np.diff(nodes) > 0).all() and nodes[0] > 1 and nodes[-1] < 3
    for degree in range(2 * order):
        assert weights @ nodes**degree == pytest.approx((3.0 ** (degree + 1) - 1) / (degree + 1), rel=1e-13)
    missed = (3.0 ** (2 * order + 1) - 1) / (2 * order + 1) - weights @ nodes ** (2 * order)
    assert missed > 1e-5


# ---- mean and covariance ---------------------------------------------------------------------------------------------


def test_covariance_and_mean_equal_the_double_sum(flight):
    """Eqs. 25 and 26 entry by entry, on a few nodes of every interval."""
    every = [slice(None, 20), slice(None, None, 16), slice(3, 12)]
    effects, weights, altitudes = (
        [values[at] for values, at in zip(field, every, strict=True)]
        for field in (flight.effects, flight.weights, [states[:, 0] - RADIUS for states in flight.states])
    )
    mean = disturbance_mean(effects, weights, [1e-5 * h for h in altitudes])
    covariance = disturbance_covariance(
        effects, weights, pairwise_covariance(altitude_kernel, np.concatenate(altitudes))
    )
    for k in range(3):
        expected = sum(w * f * 1e-5 * h for w, f, h in zip(weights[k], effects[k], altitudes[k], strict=True))
        assert mean[k] == pytest.approx(expected, rel=1e-13)
        for l in range(3):
            expected = np.zeros((3, 3))
            for wi, fi, hi in zip(weights[k], effects[k], altitudes[k], strict=True):
                for wj, fj, hj in zip(weights[l], effects[l], altitudes[l], strict=True):
                    expected += wi * wj * altitude_kernel(hi, hj) * np.outer(fi, fj)
            block = covariance[3 * k : 3 * k + 3, 3 * l : 3 * l + 3]
            assert block / np.outer(UNITS, UNITS) == pytest.approx(expected / np.outer(UNITS, UNITS), rel=1e-12)


def test_uncorrelated_field_is_the_white_noise_of_the_linear_covariance_analysis():
    """Sigma = delta(t - tau) has the value 1 / weight at a node; the limit is integrated by `lincov` independently."""
    differences = []
    for steps in (20, 40, 80):
        interval, weights = discretize_interval(*sampled(steps)), trapezoid_weights(steps, 2 / steps)
        covariance = disturbance_covariance(
            [interval.field_effect] * 2, [weights] * 2, np.diag(1 / np.concatenate([weights, weights]))
        )
        assert not covariance[:3, 3:].any()
        middles = (np.arange(steps) + 0.5) * 2 / steps
        system = lincov.discretize(
            *([[function(t) for t in middles]] for function in (state_matrix, control_matrix)),
            [[np.outer(field_matrix(t), field_matrix(t)) for t in middles]],
            [2.0],
        )
        differences.append(np.abs(covariance[3:, 3:] - system.noise[0]).max())
    differences = np.array(differences)
    assert np.log2(differences[:-1] / differences[1:]) == pytest.approx(2, abs=0.05)
    assert differences[-1] < 1e-3


def test_field_that_is_the_same_everywhere_makes_one_random_number(flight):
    """Full correlation: Cov(W) = variance E E' with E the response to a field of one."""
    response = disturbance_mean(flight.effects, flight.weights, [np.ones(len(w)) for w in flight.weights]).ravel()
    nodes = len(flight.altitudes)
    covariance = disturbance_covariance(flight.effects, flight.weights, np.full((nodes, nodes), 0.04))
    assert covariance == pytest.approx(0.04 * np.outer(response, response), rel=1e-12)


def test_nominal_is_reproduced_with_a_mean_field(flight):
    """c = f - A x - B u - G mu (Eq. 21) with the mean of w_k added lands on the nominal."""
    mean = 0.1
    state, ends = INITIAL_STATE, STARTS[:2]
    states = fly(state, CONTROLS[0], np.linspace(*ends, 121), lambda time: mean)[:, 0]
    model = linearize(entry_rates, states, np.tile([CONTROLS[0], mean], (len(states), 1)))
    b, g = model.control_matrix[..., :1], model.control_matrix[..., 1]
    interval = discretize_interval(model.state_matrix, b, g, 0.25)
    # The affine term is a control that is held at one.
    affine = discretize_interval(model.state_matrix, model.affine[..., None], g, 0.25).control[:, 0]
    (disturbance,) = disturbance_mean([interval.field_effect], [trapezoid_weights(60, 0.25)], [np.full(61, mean)])
    landed = interval.transition @ state + interval.control[:, 0] * CONTROLS[0] + affine + disturbance
    without = landed - disturbance
    assert np.abs((landed - states[-1]) / UNITS).max() < 1e-4
    assert np.abs((without - states[-1]) / UNITS).max() > 1e-2


def test_bad_field_statistics_are_refused():
    effects, weights = [np.ones((4, 2)), np.ones((3, 2))], [np.ones(4), np.ones(3)]
    with pytest.raises(ValueError, match=r"field_covariance must have shape \(7, 7\).*not \(6, 6\)"):
        disturbance_covariance(effects, weights, np.eye(6))
    for bad in (1e-3, np.nan, np.inf):
        asymmetric = np.eye(7)
        asymmetric[5, 1] = bad
        with pytest.raises(ValueError, match="not finite and symmetric in the rows of interval 1"):
            disturbance_covariance(effects, weights, asymmetric)
    with pytest.raises(ValueError, match="one array for each of the 2 intervals, not 1"):
        disturbance_mean(effects, weights, [np.zeros(4)])
    with pytest.raises(ValueError, match=r"field_mean must have shape \(3,\) in interval 1"):
        disturbance_mean(effects, weights, [np.zeros(4), np.zeros(4)])


# ---- conditioning ----------------------------------------------------------------------------------------------------


def covariance_with(eigenvalues, units=UNITS, seed=2):
    """Covariance of known eigenvalues in the given units."""
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(eigenvalues),) * 2))
    scale = np.tile(units, len(eigenvalues) // len(units))
    matrix = rotation * np.asarray(eigenvalues) @ rotation.T * np.outer(scale, scale)
    return (matrix + matrix.T) / 2


def test_condition_number_is_that_in_the_given_units():
    covariance = covariance_with([4.0, 2.0, 1.0, 1.0, 0.5, 1e-3])
    assert condition_number(covariance, UNITS) == pytest.approx(4000, rel=1e-9)
    to_other_units = np.tile([2.0, 5.0, 0.1], 2)
    again = covariance * np.outer(to_other_units, to_other_units)
    assert condition_number(again, UNITS * to_other_units[:3]) == pytest.approx(4000, rel=1e-9)
    assert condition_number(covariance, np.ones(3)) > 1e8


def test_condition_number_of_singular_covariances():
    assert condition_number(np.ones((6, 6)), np.ones(3)) > 1e15
    assert condition_number(np.diag([1.0, 1.0, -1e-15]), np.ones(3)) == np.inf
    assert condition_number(np.zeros((6, 6)), UNITS) == 1
    one_moves = np.zeros((6, 6))
    one_moves[np.ix_([1, 4], [1, 4])] = [[2, 1], [1, 2]]
    assert condition_number(one_moves, np.ones(3)) == pytest.approx(3, rel=1e-14)


def test_regularization_adds_the_variances_of_every_interval():
    covariance = covariance_with([1.0, 2.0, 3.0, 4.0], units=np.ones(2))
    added = regularize(covariance, [3.0, 0.0]) - covariance
    assert added == pytest.approx(np.diag([9.0, 0, 9.0, 0]), abs=1e-14)
    assert np.array_equal(regularize(covariance, np.zeros(2)), covariance)


def test_bad_covariances_are_refused():
    for function, name in ((condition_number, "units"), (regularize, "deviations")):
        for covariance, values in (
            (np.eye(4), np.ones(3)),
            (np.ones((4, 2)), np.ones(2)),
            (np.eye(4), np.ones((2, 2))),
        ):
            with pytest.raises(ValueError, match=rf"covariance \(N n, N n\) and {name} \(n,\) do not fit"):
                function(covariance, values)
        with pytest.raises(ValueError, match="covariance must be finite"):
            function(np.full((2, 2), np.nan), np.ones(2))
    with pytest.raises(ValueError, match="units must be positive"):
        condition_number(np.eye(4), [1.0, 0.0])
    with pytest.raises(ValueError, match="deviations must not be negative"):
        regularize(np.eye(4), [1.0, -1.0])
    with pytest.raises(ValueError, match="not positive semidefinite: smallest eigenvalue -1"):
        condition_number(np.diag([1.0, 2.0, 3.0, -1.0]), [1.0, 1.0])
