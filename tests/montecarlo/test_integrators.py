"""Convergence orders of both schemes on x' = a(t) x - c x^3 + sigma w."""

import numpy as np
import pytest
from numba import njit

from marsedl.montecarlo.ensembles import Brownian, Segment, propagator
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4, semi_implicit_euler
from marsedl.montecarlo.lanes import LANES, inline_njit

RK4, EULER = "rk4", "euler"


@inline_njit
def observe_nothing(half_index, state, parameters, out):
    pass


@inline_njit
def drift(half_index, state, noise, parameters, out):
    table, cubic, sigma = parameters
    rate = table[half_index]
    for lane in range(LANES):
        x = state[0, lane]
        out[0, lane] = rate * x - cubic * x * x * x + sigma * noise[0, lane]


def kernel_of(scheme):
    propagate = propagator(scheme, drift, observe_nothing)

    @njit(error_model="numpy")
    def kernel(groups, start, steps, step, increments_per_step, table, cubic, sigma):
        final = np.empty((groups, LANES))
        history, observed, maximum = np.empty((2, 1, LANES)), np.empty((2, 0, LANES)), np.empty((0, LANES))
        for group in range(groups):
            state = np.full((1, LANES), start)
            propagate(
                parameters=(table, cubic, sigma),
                segment=Segment(steps, step, steps),
                brownian=Brownian(1, 77, 1, group * LANES, 0, increments_per_step),
                state=state,
                history=history,
                observed=observed,
                observed_maximum=maximum,
            )
            final[group] = state[0]
        return final.ravel()

    return kernel


KERNELS = {RK4: kernel_of(runge_kutta_4), EULER: kernel_of(euler_maruyama)}


def final_values(scheme, *arguments):
    return KERNELS[scheme](*arguments)


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
        abs(final_values(scheme, 1, 1.0, n, 2.0 / n, 1, np.cos(half_grid(n, 2.0)), 0.0, 0.0)[0] - np.exp(np.sin(2.0)))
        for n in refinements
    ]
    assert observed_order(errors) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("scheme", [RK4, EULER])
def test_strong_order_is_one_with_additive_noise(scheme):
    finest, duration = 1024, 1.0

    def on_the_same_paths(scheme, steps):
        table = -1.0 + 0.5 * half_grid(steps, duration)
        return final_values(scheme, 16, 1.0, steps, duration / steps, finest // steps, table, 1.0, 0.8)

    reference = on_the_same_paths(RK4, finest)
    errors = [np.sqrt(np.mean((on_the_same_paths(scheme, n) - reference) ** 2)) for n in (8, 16, 32, 64)]
    assert observed_order(errors) == pytest.approx(1.0, abs=0.1)


def test_runge_kutta_is_far_more_accurate_than_euler_on_the_same_paths():
    reference = final_values(RK4, 8, 1.0, 1024, 1 / 1024, 1, np.full(2049, -1.0), 1.0, 0.5)
    errors = []
    for scheme in (RK4, EULER):
        values = final_values(scheme, 8, 1.0, 32, 1 / 32, 32, np.full(65, -1.0), 1.0, 0.5)
        errors.append(abs(np.mean(values - reference)))
    assert errors[0] < errors[1] / 20


def test_weak_order_of_euler_maruyama_is_one():
    # dx = -x dt + sigma dB: mean exp(-T), variance sigma^2 (1 - exp(-2 T)) / 2
    sigma, groups = 1.0, 6000
    mean_errors, variance_errors = [], []
    for steps in (4, 8, 16):
        values = final_values(
            EULER, groups, 1.0, steps, 1.0 / steps, 16 // steps, np.full(2 * steps + 1, -1.0), 0.0, sigma
        )
        mean_errors.append(np.exp(-1.0) - values.mean())
        variance_errors.append(values.var() - sigma**2 * (1.0 - np.exp(-2.0)) / 2.0)
    assert min(mean_errors + variance_errors) > 0.0
    assert observed_order(mean_errors) == pytest.approx(1.0, abs=0.2)
    assert observed_order(variance_errors) == pytest.approx(1.0, abs=0.2)


@inline_njit
def oscillate(half_index, state, noise, parameters, out):
    for lane in range(LANES):
        out[0, lane] = state[1, lane]
        out[1, lane] = -state[0, lane]


semi_implicit = propagator(semi_implicit_euler(1), oscillate, observe_nothing)
explicit = propagator(euler_maruyama, oscillate, observe_nothing)


@pytest.mark.parametrize(("propagate", "keeps_energy"), [(semi_implicit, True), (explicit, False)])
def test_semi_implicit_euler_is_of_first_order_and_keeps_the_energy_of_an_oscillator(propagate, keeps_energy):
    @njit(error_model="numpy")
    def fly(steps, step):
        state = np.zeros((2, LANES))
        state[0] = 1.0
        history, observed, maximum = np.empty((2, 2, LANES)), np.empty((2, 0, LANES)), np.empty((0, LANES))
        brownian = Brownian(0, 0, 0, 0, 0, 1)
        propagate((0.0,), Segment(steps, step, steps), brownian, state, history, observed, maximum)
        return state[:, 0]

    errors = [np.abs(fly(n, 1.0 / n) - [np.cos(1.0), -np.sin(1.0)]).max() for n in (64, 128, 256, 512)]
    assert observed_order(errors) == pytest.approx(1.0, abs=0.1)
    position, velocity = fly(10_000, 0.1)  # x' = v with the new v: x^2 + v^2 - h x v stays what it was
    energy = position**2 + velocity**2 - 0.1 * position * velocity
    assert (abs(energy - 1.0) < 1e-9) == keeps_energy
