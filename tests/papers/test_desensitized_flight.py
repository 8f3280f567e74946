"""The flights beside the nominal: against plain numpy, steps, what does not change them, ends."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from equations import landing
from marsedl.models import atmosphere
from marsedl.montecarlo.outcomes import COMPLETED, CRASHED
from marsedl.papers.desensitized import components, entry_problem, flight
from marsedl.papers.desensitized.inputs import Planet, Vehicle

RADIUS, MU = 3397e3, 4.282837e13
INTERVALS, FINAL_TIME = 100, 265.0
STEP = FINAL_TIME / INTERVALS
INPUTS = {
    "planet": Planet.from_plain({"gravitational_parameter": MU, "planet_radius": RADIUS}),
    "vehicle": Vehicle.from_plain(
        {"ballistic_coefficient": 115.0, "lift_to_drag": 0.18, "bank_acceleration_bound": np.radians(5.0)}
    ),
}
SCALES = np.array([RADIUS, 1.0, 1.0, RADIUS / 20, RADIUS / 20, RADIUS / 20, 1.0, 1.0])
GAIN = np.array([-0.06, -0.02, 0.055, -0.03, 0.03, 0.08, 0.0, 0.0]) / SCALES  # keeps trials near the nominal
NARROW = 3.69e-3  # a bound that the nominal keeps and about half the trials reach
# Deviations and density factors (within a tenth of 1) for these.
SPREAD = np.array([100.0, 3e-5, 3e-5, 1.0, 1.0, 1.0, 0.01, 1e-5])
NODES = atmosphere.uniform_nodes(atmosphere.named_profile("temperature_pressure_fit"))
CELLS = atmosphere.uniform_cells(NODES.log_density, NODES.slope, NODES.spacing)


def bank_profile(time):
    """Smooth steps between three bank angles; the angle, its rate and its acceleration."""
    levels = np.radians([-85.5, 38.1, -63.3])
    bank, rate, acceleration = levels[0], 0.0, 0.0
    for rise, switch in zip(np.diff(levels), (61.0, 211.0), strict=True):
        x = np.tanh((time - switch) / 15.0)
        bank = bank + 0.5 * rise * (1.0 + x)
        rate = rate + 0.5 * rise / 15.0 * (1.0 - x**2)
        acceleration = acceleration - rise / 15.0**2 * x * (1.0 - x**2)
    return bank, rate, acceleration


def entry_state(flight_path_angle):
    """On the equator, due east; the angle in degrees."""
    angle = np.radians(flight_path_angle)
    velocity = 6750.0 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    return np.array([126.1e3, 0.0, 0.0, *velocity, *bank_profile(0.0)[:2]])


ENTRY, STEEP = entry_state(-15.2), entry_state(-40.0)
MIDDLES = STEP * (np.arange(INTERVALS) + 0.5)
REFERENCE = flight.Reference(ENTRY, bank_profile(MIDDLES)[2], FINAL_TIME)
OPEN = np.zeros(8)


def perturbed(trials, seed=0, spread=SPREAD):
    return ENTRY + np.random.default_rng(seed).uniform(-1.0, 1.0, (trials, 8)) * spread


def with_bound(bound):
    return {**INPUTS, "vehicle": INPUTS["vehicle"].model_copy(update={"bank_acceleration_bound": bound})}


def fly(initial, gain=OPEN, reference=REFERENCE, inputs=INPUTS, cells=CELLS, nodes=NODES, **options):
    constants = flight.settings(**inputs, nodes=nodes)
    initial = np.atleast_2d(initial)
    return flight.fly(constants, cells, reference, gain, initial, **{"substeps": 5} | options)


def fly_nominal(reference=REFERENCE, substeps=5, inputs=INPUTS):
    start = reference.initial_state
    return fly(start, reference=reference, inputs=inputs, substeps=substeps).history[:, :8, 0]


# ---- the oracle ------------------------------------------------------------------------------------------------------


def _mean_density():
    nodes = NODES.bottom + NODES.spacing * np.arange(len(NODES.log_density))
    curve = CubicHermiteSpline(nodes, NODES.log_density, NODES.slope)
    return lambda altitude: np.exp(curve(altitude))


mean_density = _mean_density()


def pair_rates(_, z, nominal_control, gain, bound, factor=1.0):
    """Of the trial, its integral of |u| and the nominal: z (17, ...)."""
    y, nominal = z[:8], z[9:]
    u = np.clip(nominal_control + np.tensordot(gain, y - nominal, 1), -bound, bound)
    return np.concatenate(
        [
            landing(y, u, factor * mean_density(y[0])),
            [np.abs(u)],
            landing(nominal, nominal_control, mean_density(nominal[0])),
        ]
    )


def pairs(initial):
    """Initial z (17, trials) of initial states (trials, 8)."""
    start = np.broadcast_to(REFERENCE.initial_state[:, np.newaxis], (8, len(initial)))
    return np.concatenate([initial.T, np.zeros((1, len(initial))), start])


def oracle(initial, gain, bound, factor, substeps):
    """z at the ends of all intervals, (intervals + 1, 17, trials), by the same steps in plain numpy."""
    z, h = pairs(initial), STEP / substeps
    states = [z]
    for u in REFERENCE.bank_acceleration:
        rates = partial(pair_rates, 0.0, nominal_control=u, gain=gain, bound=bound, factor=factor)
        for _ in range(substeps):
            k1 = rates(z)
            k2 = rates(z + h / 2 * k1)
            k3 = rates(z + h / 2 * k2)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(z + h * k3))
        states.append(z)
    return np.array(states)


# Relative to these, agreement of states and of the integral is asked.
SIZE = np.array([1e4, 0.01, 0.1, 100.0, 100.0, 100.0, 1.0, 0.01, 0.1])[:, np.newaxis]


# ---- against other formulations --------------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", [np.radians(5.0), NARROW])
def test_flights_are_those_of_plain_numpy(bound):
    initial, factor = perturbed(130), np.random.default_rng(1).uniform(0.9, 1.1, 130)
    trajectories = fly(initial, GAIN, inputs=with_bound(bound), density_factor=factor)
    expected = oracle(initial, GAIN, bound, factor, substeps=5)
    np.testing.assert_allclose(trajectories.history / SIZE, expected[:, :9] / SIZE, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(trajectories.final_state, trajectories.history[-1])
    nominal = fly_nominal(inputs=with_bound(bound))
    np.testing.assert_allclose(nominal.T / SIZE[:8], expected[:, 9:, 0].T / SIZE[:8], rtol=0, atol=1e-11)
    assert (trajectories.outcome == COMPLETED).all() and (trajectories.length == 101).all()
    clipped = (trajectories.observed[:, components.COMMAND_MAGNITUDE] > bound).any(axis=0).mean()
    assert (0.2 < clipped < 0.8) if bound == NARROW else clipped == 0.0


def test_observed_are_the_command_and_what_is_flown_of_it():
    bound, initial = NARROW, perturbed(70, spread=10.0 * SPREAD)
    trajectories = fly(initial, GAIN, inputs=with_bound(bound))
    control = np.append(REFERENCE.bank_acceleration, REFERENCE.bank_acceleration[-1])
    deviation = trajectories.history[:, :8] - fly_nominal(inputs=with_bound(bound))[..., np.newaxis]
    command = control[:, np.newaxis] + np.tensordot(deviation, GAIN, (1, 0))
    acceleration, magnitude = trajectories.observed.swapaxes(0, 1)
    np.testing.assert_allclose(acceleration, np.clip(command, -bound, bound), rtol=0, atol=1e-17)
    np.testing.assert_allclose(magnitude, np.abs(command), rtol=0, atol=1e-17)
    assert (trajectories.observed_maximum >= trajectories.observed.max(axis=0)).all()
    assert (
        trajectories.observed_maximum[components.COMMAND_MAGNITUDE] > trajectories.observed[:, 1].max(axis=0)
    ).any()  # between
    np.testing.assert_allclose(trajectories.observed_maximum, trajectories.observed.max(axis=0), rtol=0.02)
    assert trajectories.observed_maximum[components.BANK_ACCELERATION].max() == bound < magnitude.max()


@pytest.mark.parametrize("bound", [NARROW])
def test_flights_are_those_of_an_adaptive_method(bound):
    """Interval by interval, so that the nominal's control is smooth; by small steps, as of corners at the bound."""
    initial, factor = perturbed(8, spread=10.0 * SPREAD)[[6, 7, 1]], np.array([0.95, 1.0, 1.05])
    trajectories = fly(initial, GAIN, inputs=with_bound(bound), density_factor=factor, substeps=640)
    reached = trajectories.observed_maximum[components.COMMAND_MAGNITUDE] > bound
    np.testing.assert_array_equal(reached, bound == NARROW)
    for trial in range(3):
        z = pairs(initial[trial : trial + 1])[:, 0]
        for u in REFERENCE.bank_acceleration:
            arguments = (u, GAIN, bound, factor[trial])
            options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
            z = solve_ivp(pair_rates, (0.0, STEP), z, args=arguments, **options).y[:, -1]
        np.testing.assert_allclose(
            trajectories.final_state[:, trial] / SIZE[:, 0], z[:9] / SIZE[:, 0], rtol=0, atol=1e-9
        )


def test_flights_are_of_fourth_order_in_the_step():
    """In an exponential atmosphere of one cell, which is smooth everywhere."""
    altitude = np.array([0.0, 200e3])
    nodes = atmosphere.UniformNodes(0.0, 200e3, np.log(0.015) - altitude / 9.5e3, np.full(2, -1.0 / 9.5e3))
    cells = atmosphere.uniform_cells(nodes.log_density, nodes.slope, nodes.spacing)
    initial = perturbed(2)
    substeps = (1, 2, 4, 8)
    exact, *final = (
        fly(initial, GAIN, cells=cells, nodes=nodes, substeps=number).final_state for number in (64, *substeps)
    )
    for coarse, fine in pairwise(np.abs(state - exact) for state in final):
        np.testing.assert_allclose(np.log2(coarse / fine), 4.0, atol=0.25)


# ---- the nominal -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [OPEN, GAIN, 1e6 * np.random.default_rng(2).standard_normal(8)])
@pytest.mark.parametrize("start", [ENTRY, perturbed(1)[0]])
def test_without_perturbation_every_gain_flies_the_nominal_to_the_last_bit(gain, start):
    reference = REFERENCE._replace(initial_state=start)
    nominal = fly_nominal(reference)
    trajectories = fly(np.tile(start, (70, 1)), gain, reference)
    np.testing.assert_array_equal(trajectories.history[:, :8], np.repeat(nominal[..., np.newaxis], 70, axis=2))
    control = np.append(reference.bank_acceleration, reference.bank_acceleration[-1])
    np.testing.assert_array_equal(
        trajectories.observed[:, components.BANK_ACCELERATION], np.repeat(control[:, np.newaxis], 70, 1)
    )
    total = np.abs(reference.bank_acceleration).sum() * STEP
    np.testing.assert_allclose(trajectories.final_state[components.CUMULATIVE], total, rtol=1e-13)


def test_a_nominal_at_its_bound_is_flown_and_one_beyond_is_refused():
    """An optimiser leaves bounds by its tolerance, which must not turn into a difference to the nominal."""
    bound = np.abs(REFERENCE.bank_acceleration).max() / (1.0 + 1e-8)
    nominal = fly_nominal(inputs=with_bound(bound))
    trajectories = fly(ENTRY, 1e3 * GAIN, inputs=with_bound(bound))
    np.testing.assert_array_equal(trajectories.history[:, :8, 0], nominal)
    assert trajectories.observed_maximum[components.COMMAND_MAGNITUDE, 0] == bound
    worst = np.argmax(np.abs(REFERENCE.bank_acceleration))
    with pytest.raises(ValueError, match=f"bank acceleration on interval {worst}.*beyond its bound"):
        fly(ENTRY, inputs=with_bound(0.999 * bound))


# ---- shifts, symmetries, densities -----------------------------------------------------------------------------------


def other_controls(seed):
    """A nominal that rolls about, to a time at which it is still above the ground."""
    control = np.random.default_rng(seed).uniform(-1.0, 1.0, INTERVALS) * 0.01
    return REFERENCE._replace(bank_acceleration=control, final_time=200.0)


@pytest.mark.parametrize("reference", [REFERENCE, other_controls(0), other_controls(1)])
@pytest.mark.parametrize("distance", [200.0, -1000.0])
def test_a_downrange_error_without_feedback_stays_what_it_is(reference, distance):
    nominal = fly_nominal(reference)
    shifted = ENTRY.copy()
    shifted[components.LONGITUDE] += distance / RADIUS
    states = fly(shifted, reference=reference).history[:, :8, 0]
    not_longitude = np.arange(8) != components.LONGITUDE
    np.testing.assert_array_equal(states[:, not_longitude], nominal[:, not_longitude])
    errors = entry_problem.position_errors(states, nominal, RADIUS)
    # Rounding of 500 steps.
    np.testing.assert_allclose(errors, np.broadcast_to([0.0, 0.0, distance], errors.shape), rtol=0, atol=1e-9)


# ---- bad ends and bad input ------------------------------------------------------------------------------------------


def test_trials_end_below_the_ground():
    initial = perturbed(70)
    steep = np.arange(70) % 3 == 1
    initial[steep] = STEEP
    mixed = fly(initial, GAIN)
    np.testing.assert_array_equal(mixed.outcome, np.where(steep, CRASHED, COMPLETED))
    final = mixed.final_state[:, steep]
    # It is frozen where it came below: within a step of the surface, not an interval.
    depth, largest = -final[components.ALTITUDE], STEP / 5 * -final[components.RADIAL_VELOCITY]
    assert (depth > 0.0).all() and (depth < largest).all()
    length, stored = mixed.length[1], mixed.history[:, :, 1]
    assert 1 < length < 101 and (stored[:length, components.ALTITUDE] >= 0.0).all()
    assert np.isfinite(stored[:length]).all() and np.isnan(stored[length:]).all()
