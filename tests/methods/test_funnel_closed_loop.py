import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods.funnels.closed_loop import ClosedLoop, reference_on_half_steps
from marsedl.methods.taylor import Series
from marsedl.methods.taylor_model import variables
from marsedl.models.dynamics.dubins_car import dubins_car_rates
from marsedl.models.dynamics.vinh_entry import vinh_entry_rates

DURATION = 4.0
CAR_GAIN = np.array([[-0.3, -0.6, -1.2]])
ENTRY_GAIN = np.array([[2e-6, -20.0, 5.0, -1e-4, 0.8, 0.3]])


def turn_rate(times):
    return 0.8 * np.sin(2 * np.pi * np.asarray(times)[..., None] / DURATION)


def car_rates(half_index, state, control, disturbance):
    x, y, turn = dubins_car_rates(*state, *control, 1.0)
    return x + 0.03 * disturbance[0], y + 0.03 * disturbance[1], turn


def car(steps=40):
    """A Dubins car with wind and a constant gain."""
    time = np.linspace(0, DURATION, steps + 1)
    states, controls = reference_on_half_steps(lambda x, u: dubins_car_rates(*x, *u, 1.0), time, turn_rate, [0, 0, 0])
    return ClosedLoop(car_rates, time, states, controls, np.tile(CAR_GAIN, (2 * steps + 1, 1, 1)), 2)


def entry_rates(half_index, state, control, disturbance):
    density = np.exp((-4.259 + 0.05 * disturbance[0]) + (-9.678e-5 + 1e-6 * disturbance[1]) * state[0])
    return vinh_entry_rates(state, control[0], density, 3.3895e6, 1 / 270, 0.24 / 270, 4.2828e13, 7.0882e-5)


def entry(steps=60):
    """An entry at a slowly changing bank with a constant gain."""
    time = np.linspace(0, 240.0, steps + 1)
    start = [125e3, 0.0, 0.0, 5800.0, np.radians(-15.5), 0.0]
    states, controls = reference_on_half_steps(
        lambda x, u: entry_rates(0, x, u, (0.0, 0.0)), time, lambda t: 0.8 + 1e-3 * t[:, None], start
    )
    return ClosedLoop(entry_rates, time, states, controls, np.tile(ENTRY_GAIN, (2 * steps + 1, 1, 1)), 2)


def linear(steps=6):
    """x' = A x + B u + F w around zero on uneven steps."""
    random = np.random.default_rng(8)
    a, b, f = random.standard_normal((3, 3)), random.standard_normal((3, 2)), random.standard_normal((3, 2))
    gain = random.standard_normal((2, 3))
    time = np.cumsum([0.0, *random.uniform(0.05, 0.2, steps)])

    def rates(half_index, state, control, disturbance):
        everything = [*state, *control, *disturbance]
        return tuple(
            sum(c * value for c, value in zip(row, everything, strict=True)) for row in np.hstack([a, b, f]).tolist()
        )

    points = 2 * steps + 1
    loop = ClosedLoop(rates, time, np.zeros((points, 3)), np.zeros((points, 2)), np.tile(gain, (points, 1, 1)), 2)
    return loop, a + b @ gain, f


def random_deviations(count, scale, seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (len(scale), count)) * np.array(scale)[:, None]


ENTRY_SCALE = [500.0, 2e-4, 2e-4, 10.0, 2e-3, 2e-3]


@pytest.mark.parametrize("loop", [car(), entry()])
def test_nothing_comes_of_nothing(loop):
    zeros, still = [0.0] * loop.dimension, [0.0] * loop.disturbances
    assert loop.flow(0, loop.steps, zeros, still) == (0.0,) * loop.dimension
    # As arrays too, whose sines may be computed otherwise, contiguous or not.
    for count in (1, 3, 8, 21):
        for layout in "CF":
            deviation = np.zeros((loop.dimension, count), order=layout)
            flow = loop.flow(0, loop.steps, deviation, np.zeros((loop.disturbances, count), order=layout))
            assert not np.any(flow)


def test_flow_is_the_difference_of_two_flights_to_fourth_order():
    deviation, wind = np.array([0.1, -0.2, 0.3]), np.array([0.6, -0.8])

    def together(time, y):
        control = turn_rate(time)
        feedback = control + CAR_GAIN @ (y[3:] - y[:3])
        return np.concatenate([car_rates(0, y[:3], control, (0, 0)), car_rates(0, y[3:], feedback, wind)])

    start = np.concatenate([np.zeros(3), deviation])
    truth = solve_ivp(together, (0, DURATION), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    expected = truth[3:] - truth[:3]
    errors = [np.abs(car(n).flow(0, n, deviation, wind) - expected).max() for n in (10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-6
    np.testing.assert_allclose(orders, 4.0, atol=0.35)


def test_linear_flow_is_the_runge_kutta_polynomial_of_the_matrix():
    loop, closed, forcing = linear()
    transition, response, added = np.eye(3), np.zeros((3, 2)), np.zeros((3, 3))
    for h in np.diff(loop.time):
        z = h * closed
        # 1 + z + z^2/2 + z^3/6 + z^4/24, and the same less its first term over z for a held input.
        integral = h * (np.eye(3) + z @ (np.eye(3) + z @ (np.eye(3) + z / 4) / 3) / 2)
        across = np.eye(3) + integral @ closed
        transition, response, added = (
            across @ transition,
            across @ response + integral @ forcing,
            across @ added + integral,
        )
    for value, expected in zip(loop.flow_jacobians(0, loop.steps), (transition, response, added), strict=True):
        np.testing.assert_allclose(value, expected, rtol=0, atol=1e-14 * np.abs(expected).max())
    deviation, disturbance, additive = (np.random.default_rng(3).standard_normal(n) for n in (3, 2, 3))
    flow = loop.flow(0, loop.steps, deviation, disturbance, additive)
    expected = transition @ deviation + response @ disturbance + added @ additive
    np.testing.assert_allclose(flow, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("loop", "first", "last"), [(car(), 3, 17), (entry(), 18, 30)])
def test_jacobians_are_those_of_a_complex_step(loop, first, last):
    nx, nw = loop.dimension, loop.disturbances
    step = 1e-30
    columns = []
    for direction in np.eye(2 * nx + nw):
        inputs = 1j * step * direction
        flow = loop.flow(first, last, inputs[:nx], inputs[nx : nx + nw], inputs[nx + nw :])
        columns.append(np.array(flow).imag / step)
    jacobian = np.hstack(loop.flow_jacobians(first, last))
    # Each column has units of its own, each row too.
    expected = np.transpose(columns)
    size = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(jacobian / size, expected / size, rtol=1e-11, atol=1e-13)


def test_rates_of_a_car_are_those_of_the_trigonometric_sums():
    loop = car()
    deviation, wind = random_deviations(50, [0.2, 0.2, 0.4]), random_deviations(50, [1.0, 1.0], seed=2)
    for half_index in (0, 1, 37, 80):
        heading, turn = loop.states[half_index, 2], deviation[2]
        expected = [
            np.cos(heading) * (np.cos(turn) - 1) - np.sin(heading) * np.sin(turn) + 0.03 * wind[0],
            np.sin(heading) * (np.cos(turn) - 1) + np.cos(heading) * np.sin(turn) + 0.03 * wind[1],
            (CAR_GAIN @ deviation)[0],
        ]
        np.testing.assert_allclose(loop.error_rates(half_index, deviation, wind), expected, rtol=0, atol=1e-15)


def test_a_power_series_is_the_flow_up_to_its_order():
    loop = entry()
    deviation, disturbance = random_deviations(6, ENTRY_SCALE), random_deviations(6, [1.0, 1.0], seed=2)
    rays = [Series.along(np.zeros(6), row, 3) for row in (*deviation, *disturbance)]
    series = loop.flow(16, 20, rays[:6], rays[6:])
    sizes = np.array([1.0, 0.5, 0.25])
    errors = []
    for size in sizes:
        polynomial = np.array([value.at(size) for value in series])
        true = np.array(loop.flow(16, 20, size * deviation, size * disturbance))
        errors.append(np.abs((polynomial - true) / np.abs(true).max(axis=1, keepdims=True)).max() * size)
    # Relative to the deviation, which is proportional to the size, third order; times the size, fourth.
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.3)


def test_rates_may_depend_on_the_half_step():
    points = np.zeros((7, 1))
    loop = ClosedLoop(lambda i, x, u, w: (float(i**2) * w[0],), [0, 1, 2, 3], points, points, points[:, None], 1)
    # Simpson's rule is exact for the squares of the half steps: integral of (2 t)^2 from 0 to 3.
    assert loop.flow(0, 3, [0.0], [1.0])[0] == pytest.approx(36.0, rel=1e-15)


def test_models_of_a_box_as_components_enclose_the_flow():
    loop, radius = car(), 1e-9
    center = np.array([*random_deviations(1, [0.1, 0.1, 0.1])[:, 0], 0.3, 0.4])
    box = [value + radius * coordinate for value, coordinate in zip(center, variables((1,) * 5, 1), strict=True)]
    enclosure = loop.flow(0, 10, box[:3], box[3:])
    for corner in (-1.0, 0.0, 1.0):
        moved = center + radius * corner
        for model, value in zip(enclosure, loop.flow(0, 10, moved[:3], moved[3:]), strict=True):
            linear = (model.monomials.evaluate(np.full((1, 5), corner)) @ model.coefficients)[0]
            assert abs(value - linear) <= model.remainder < 1e-11
            assert 1e-10 < model.degree_bounds[1] < 1e-8


def test_reference_converges_with_fourth_order():
    def error(steps):
        nodes = np.linspace(0, 4, steps + 1) ** 2 / 4
        states, controls = reference_on_half_steps(
            lambda x, u: dubins_car_rates(*x, *u, 1.0), nodes, turn_rate, [0, 0, 0]
        )
        assert states.shape == (2 * steps + 1, 3)
        times = np.interp(np.arange(2 * steps + 1) / 2, np.arange(steps + 1), nodes)
        np.testing.assert_allclose(controls, turn_rate(times), rtol=0, atol=1e-15)
        heading = 0.8 * 4 / (2 * np.pi) * (1 - np.cos(2 * np.pi * times / 4))
        return np.abs(states[:, 2] - heading).max()

    errors = [error(n) for n in (10, 20, 40)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.3)
