"""Rates of named parts as functions of vectors, and the integrator's step with its derivatives, against the engine."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from marsedl.elementary import sine_cosine
from marsedl.fly import Entry, Markov, Model, Normal, Table, dynamics, fly
from marsedl.methods.lincov import propagate
from marsedl.methods.linearization import linearize
from marsedl.methods.step_map import in_vectors, linear_flight, step_map
from marsedl.montecarlo.flights import Flight, Nothing, periods

SPAN = 2.0  # s


class Pendulum(NamedTuple):
    angle: float
    rate: float


class Torque(NamedTuple):
    torque: float


class Gust(NamedTuple):
    gust: float


class Body(NamedTuple):
    length: float = 0.5
    damping: float = 0.1


def swing(state, command: Torque, noise, p) -> Pendulum:
    sine, _ = sine_cosine(state.angle)
    return Pendulum(state.rate, command.torque + 0.3 * noise.gust - p.damping * state.rate - 9.81 / p.length * sine)


def swing_of_branches(state, command: Torque, noise, p) -> Pendulum:
    """The same, as CasADi cannot trace it."""
    return swing(state, command, noise, p) if state.angle > -10.0 else Pendulum(0.0, 0.0)


def pendulum(rates=swing):
    return in_vectors(rates, noise=Gust, p=Body())


class Line(NamedTuple):
    """A linear system, whose maps are known."""

    position: float
    velocity: float


def along_line(state, command: Torque, noise) -> Line:
    return Line(state.velocity, command.torque + noise.gust - 2.0 * state.position - 0.4 * state.velocity)


LINE = np.array([[0.0, 1.0], [-2.0, -0.4]])
PUSH = np.array([[0.0], [1.0]])


def test_names_and_their_order_are_those_of_the_parts():
    rates = pendulum()
    assert rates.names == {"state": ("angle", "rate"), "command": ("torque",), "noise": ("gust",)}
    assert rates(0.3, -0.2, 0.5, 1.0) == swing(Pendulum(0.3, -0.2), Torque(0.5), Gust(1.0), Body())
    varied = in_vectors(swing, noise=Gust(0.0), p=Body)
    assert varied.names == {"state": ("angle", "rate"), "command": ("torque",), "p": ("length", "damping")}
    model = linearize(rates, [[0.3, -0.2]], [[0.5, 0.0]])
    np.testing.assert_allclose(model.control_matrix[0], [[0.0, 0.0], [1.0, 0.3]])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"p": Body()}, r"swing \(.*line \d+\) asks for 'noise', which is not known: annotate it, or give noise="),
        ({"noise": Gust, "p": Body(), "air": 1.0}, "does not ask for 'air': leave it out"),
    ],
)
def test_a_part_that_is_not_known_is_told(given, message):
    with pytest.raises(ValueError, match=message):
        in_vectors(swing, **given)


def hold(p) -> tuple[Torque, Nothing]:
    return Torque(0.4), ()


def calm(state, time, command: Torque, p) -> Pendulum:
    """Without gusts, and a push that changes with time."""
    return swing(state, Torque(command.torque + 0.1 * time), Gust(0.0), p)


def test_the_step_is_that_of_flights_to_the_bit():
    flown = Flight(calm, guide=hold).fly_in_python(Body(), periods(0.5, 0.125, 1), Pendulum([0.3], [-0.2]))
    map_at, state = step_map(in_vectors(calm, p=Body()), 0.125), np.array([0.3, -0.2])
    for k in range(5):
        np.testing.assert_array_equal(state, flown.history[k, :, 0])
        state = map_at([*state, 0.4], 2 * k).end


@pytest.mark.parametrize("rates", [swing, swing_of_branches])
def test_derivatives_are_those_of_the_step(rates):
    numbers = np.array([0.3, -0.2, 0.5, 1.0])
    map_at = step_map(pendulum(rates), 0.1)
    matrix = np.hstack([*map_at(numbers).by.values()])
    assert matrix.shape == (2, 4)
    for column, direction in zip(matrix.T, np.eye(4), strict=True):
        ends = [map_at(numbers + step * direction).end for step in (1e-5, -1e-5)]
        np.testing.assert_allclose(column, (ends[0] - ends[1]) / 2e-5, rtol=0, atol=1e-10)
    by_casadi = np.hstack([*step_map(pendulum(), 0.1)(numbers).by.values()])
    np.testing.assert_allclose(matrix, by_casadi, rtol=1e-14, atol=1e-16)


def test_a_linear_flight_has_the_orders_of_the_integrator():
    """Transition, effect of the held command and end are of fourth order; the noise, held over a step, of second."""
    rates, start, commands = in_vectors(along_line, noise=Gust), np.array([1.0, 0.0]), np.array([[0.5], [-1.0]])
    whole = expm(SPAN * np.block([[LINE, PUSH], [np.zeros((1, 3))]]))
    inner = expm(SPAN * np.block([[-LINE, PUSH @ PUSH.T], [np.zeros((2, 2)), LINE.T]]))  # Van Loan 1978
    noise = inner[2:, 2:].T @ inner[:2, 2:]
    end = whole[:2, :2] @ (whole[:2, :2] @ start + whole[:2, 2] * 0.5) - whole[:2, 2]
    errors = []
    for substeps in (10, 20, 40):
        states, system = linear_flight(rates, start, commands, SPAN, substeps)
        pairs = (
            (system.transition, whole[:2, :2]),
            (system.control, whole[:2, 2:]),
            (states[-1], end),
            (system.noise, noise),
        )
        errors.append([np.abs(one - exact).max() for one, exact in pairs])
        np.testing.assert_array_equal(system.time, [0.0, SPAN, 2 * SPAN])
        assert np.abs(system.affine).max() < 1e-14
    errors = np.array(errors)
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, np.broadcast_to([4, 4, 4, 2], orders.shape), atol=0.25)


def test_the_map_of_a_nonlinear_flight_passes_through_it():
    commands = np.linspace(-1.0, 1.0, 5)[:, np.newaxis]
    states, system = linear_flight(pendulum(), [0.3, -0.2], commands, 0.2, 4)
    mapped = (system.transition @ states[:-1, :, np.newaxis] + system.control @ commands[:, :, np.newaxis])[..., 0]
    np.testing.assert_allclose(mapped + system.affine, states[1:], rtol=0, atol=1e-14)


def test_tables_of_air_are_looked_up():
    """An entry through its table, linearised as it flies: against central differences of the flight."""
    mars = np.array([[0.0, 0.0159], [8e3, 0.008], [25e3, 1.4e-3], [60e3, 2e-5], [125e3, 1e-9]])
    model = Entry(115.0, 0.24, air=Table(mars), variation=Markov(0.06, 5e3)).model()
    air = 0.05 * np.sin(np.arange(model.nodes))
    rates = in_vectors(dynamics.entry_rates, dynamics.look_up, vehicle=model.vehicle, air=air, p=model.p)
    start, size = np.array([40.3e3, 3000.0, -0.2, 1.6, 0.01, 0.02]), np.array([1e4, 3e3, 1.0, 1.0, 1.0, 1.0])
    bank = np.full((3, 1), 1.2)
    _, system = linear_flight(rates, start, bank, 2.0, 2)
    whole = np.linalg.multi_dot(system.transition[::-1])
    for column, step in enumerate(1e-6 * size):
        ends = [linear_flight(rates, start + sign * step * np.eye(6)[column], bank, 2.0, 2)[0][-1] for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(
            whole[:, column] / size, difference / size, rtol=0, atol=1e-8 * size.max() / size[column]
        )


def test_predicted_covariance_is_that_of_flights():
    """Start, gusts and feedback of a pendulum that hangs nearly still."""
    gain = np.tile([[-2.0, -1.0]], (20, 1, 1))
    _, system = linear_flight(pendulum(), [0.0, 0.0], np.zeros((20, 1)), 0.1, 4)
    predicted = propagate(system, gain, np.diag([0.02, 0.1]) ** 2)

    def law(angle, rate) -> Torque:
        return Torque(-2.0 * angle - rate)

    flown = fly(
        Model(Flight(swing, noise=Gust), p=Body()),
        {"angle": Normal(0.0, 0.02), "rate": Normal(0.0, 0.1)},
        law=law,
        end_time=2.0,
        period=0.1,
        substeps=4,
        trials=4000,
    )
    for row, name in enumerate(("angle", "rate")):
        expected = np.sqrt(predicted.covariance[-1, row, row])
        assert abs(flown.final[name].std() / expected - 1.0) < 4.0 / np.sqrt(2 * 4000)


def test_a_step_of_no_length_and_numbers_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="step must be positive, not 0"):
        step_map(pendulum(), 0.0)
    with pytest.raises(ValueError, match="3 numbers do not fit the 4 of state, command, noise"):
        step_map(pendulum(), 0.1)([0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"commands must have shape \(N, 1\), not \(3, 2\)"):
        linear_flight(pendulum(), [0.0, 0.0], np.zeros((3, 2)), 0.1)
