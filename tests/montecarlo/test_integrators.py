"""Convergence orders of both schemes on x' = a(t) x - c x^3 + sigma w."""

from typing import NamedTuple

import numpy as np
import pytest

from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.integrators import euler_maruyama, semi_implicit_euler

RK4, EULER = "rk4", "euler"


class X(NamedTuple):
    x: float


class White(NamedTuple):
    w: float


class Parameters(NamedTuple):
    table: np.ndarray  # on the half-step grid
    cubic: float
    sigma: float


def rates(half_index, state, noise, p) -> X:
    x = state.x
    return X(p.table[half_index] * x - p.cubic * x * x * x + p.sigma * noise.w)


FLIGHTS = {
    RK4: Flight(rates, noise=White),
    EULER: Flight(rates, noise=White, integrator=euler_maruyama),
}


def final_values(scheme, trials, steps, step, increments, table, cubic, sigma):
    """States after some steps from 1 on."""
    schedule, parameters = periods(steps * step, steps * step, steps), Parameters(table, cubic, sigma)
    options = {"trials": trials, "seed": 77, "increments": increments}
    return FLIGHTS[scheme].fly(parameters, schedule, X(1.0), **options).final_state[0]


def half_grid(steps, duration):
    return np.linspace(0.0, duration, 2 * steps + 1)


def observed_order(errors):
    """Slope of log error over log step for steps that halve."""
    return -np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0]


@pytest.mark.parametrize(
    ("scheme", "order", "refinements"), [(RK4, 4, (8, 16, 32, 64)), (EULER, 1, (64, 128, 256, 512))]
)
def test_deterministic_order(scheme, order, refinements):
    # x' = cos(t) x, x(0) = 1 has the solution exp(sin t); the table makes a wrong half index lose the order
    errors = [
        abs(final_values(scheme, 1, n, 2.0 / n, 1, np.cos(half_grid(n, 2.0)), 0.0, 0.0)[0] - np.exp(np.sin(2.0)))
        for n in refinements
    ]
    assert observed_order(errors) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("scheme", [RK4, EULER])
def test_strong_order_is_one_with_additive_noise(scheme):
    finest, duration = 1024, 1.0

    def on_the_same_paths(scheme, steps):
        table = -1.0 + 0.5 * half_grid(steps, duration)
        return final_values(scheme, 1024, steps, duration / steps, finest // steps, table, 1.0, 0.8)

    reference = on_the_same_paths(RK4, finest)
    errors = [np.sqrt(np.mean((on_the_same_paths(scheme, n) - reference) ** 2)) for n in (8, 16, 32, 64)]
    assert observed_order(errors) == pytest.approx(1.0, abs=0.1)


def test_runge_kutta_is_far_more_accurate_than_euler_on_the_same_paths():
    reference = final_values(RK4, 512, 1024, 1 / 1024, 1, np.full(2049, -1.0), 1.0, 0.5)
    errors = []
    for scheme in (RK4, EULER):
        values = final_values(scheme, 512, 32, 1 / 32, 32, np.full(65, -1.0), 1.0, 0.5)
        errors.append(abs(np.mean(values - reference)))
    assert errors[0] < errors[1] / 20


def test_weak_order_of_euler_maruyama_is_one():
    # dx = -x dt + sigma dB: mean exp(-T), variance sigma^2 (1 - exp(-2 T)) / 2
    sigma, trials = 1.0, 384_000
    mean_errors, variance_errors = [], []
    for steps in (4, 8, 16):
        values = final_values(EULER, trials, steps, 1.0 / steps, 16 // steps, np.full(2 * steps + 1, -1.0), 0.0, sigma)
        mean_errors.append(np.exp(-1.0) - values.mean())
        variance_errors.append(values.var() - sigma**2 * (1.0 - np.exp(-2.0)) / 2.0)
    assert min(mean_errors + variance_errors) > 0.0
    assert observed_order(mean_errors) == pytest.approx(1.0, abs=0.2)
    assert observed_order(variance_errors) == pytest.approx(1.0, abs=0.2)


class Pendulum(NamedTuple):
    x: float
    v: float


def oscillate(state) -> Pendulum:
    return Pendulum(state.v, -state.x)


@pytest.mark.parametrize(("integrator", "keeps_energy"), [(semi_implicit_euler(1), True), (euler_maruyama, False)])
def test_semi_implicit_euler_is_of_first_order_and_keeps_the_energy_of_an_oscillator(integrator, keeps_energy):
    flight = Flight(oscillate, integrator=integrator)

    def fly(steps, step):
        schedule = periods(steps * step, steps * step, steps)
        return flight.fly((), schedule, Pendulum(1.0, 0.0)).final_state[:, 0]

    errors = [np.abs(fly(n, 1.0 / n) - [np.cos(1.0), -np.sin(1.0)]).max() for n in (64, 128, 256, 512)]
    assert observed_order(errors) == pytest.approx(1.0, abs=0.1)
    position, velocity = fly(10_000, 0.1)  # x' = v with the new v: x^2 + v^2 - h x v stays what it was
    energy = position**2 + velocity**2 - 0.1 * position * velocity
    assert (abs(energy - 1.0) < 1e-9) == keeps_energy
