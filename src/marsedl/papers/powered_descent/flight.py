"""Flight of the nonlinear plant with mass flow under the scheduled control (Eqs. 1, 2, 24, 49)."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from marsedl.compiling import jitable
from marsedl.models.dynamics.powered_descent import powered_descent_rates, thrust_magnitude
from marsedl.montecarlo.ensembles import CRASHED, NON_FINITE, new_trajectories, output_count, propagator
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4
from marsedl.montecarlo.lanes import LANES, inline_njit
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import segments

INITIAL_STREAM, NOISE_STREAM = 0, 1
NOISES = 2  # components of the thrust noise
OBSERVED = 2  # thrust magnitude, depth below the ground
THRUST, DEPTH = 0, 1


class Schedule(NamedTuple):
    """The control of one segment on the half-step grid of its simulation."""

    step: float  # s
    steps: int
    gain: np.ndarray  # (2 steps + 1, 2, 4), N/m and N s/m
    mean: np.ndarray  # (2 steps + 1, 4), m and m/s
    feedforward: np.ndarray  # (2 steps + 1, 2), N


class Plant(NamedTuple):
    """Constants of the simulated plant."""

    gravity: float  # m/s^2
    mass_flow_constant: float  # kg/(N s)
    noise_density: float  # N sqrt(s)


def schedule(time, gain, mean, feedforward, steps):
    """Sample a segment's control on the half-step grid of `steps` steps.

    Nodes of the design are taken as they are where they fall on the grid; otherwise cubic splines go through them.

    time: local times of the design, uniform, (k,), s. gain: (k, 2, 4). mean: (k, 4). feedforward: (k, 2). Returns a
    `Schedule`.
    """
    cells, half_steps = len(time) - 1, 2 * steps
    if cells % half_steps == 0:
        tables = [table[:: cells // half_steps] for table in (gain, mean, feedforward)]
    else:
        from scipy.interpolate import CubicSpline

        grid = np.linspace(0.0, time[-1], half_steps + 1)
        tables = [CubicSpline(time, table)(grid) for table in (gain, mean, feedforward)]
    return Schedule(time[-1] / steps, steps, *(np.ascontiguousarray(table) for table in tables))


def schedules_of(inputs, gains, steps):
    """Sample the control of the design on the half-step grids of all segments.

    inputs: segment_durations and design_interval are read. gains: `Gains`. steps: number of steps by segment. Returns
    `Schedule` by segment.
    """
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    parts = segments.split(gains.segment, gains.gain, gains.mean, gains.feedforward)
    return [schedule(time, *part, number) for time, part, number in zip(times, parts, steps, strict=True)]


def plant_of(inputs):
    """The simulated plant with the gravity, mass flow and noise of the reading's inputs; returns `Plant`."""
    return Plant(inputs.gravity, segments.mass_flow(inputs), segments.plant_noise_density(inputs))


def open_loop(closed_loop):
    """The schedule without feedback."""
    return closed_loop._replace(gain=np.zeros_like(closed_loop.gain))


def step_count(duration, time_step, output_interval):
    """Steps of a segment and steps between outputs: neither longer than asked, outputs at the segment's end."""
    outputs = int(np.ceil(duration / output_interval - 1e-9))
    steps_per_output = max(1, int(np.ceil(duration / outputs / time_step - 1e-9)))
    return outputs * steps_per_output, steps_per_output


@jitable
def scheduled_thrust(error_1, error_2, error_3, error_4, gain_1, gain_2, gain_3, gain_4, feedforward):
    """One component of u = u_ff - K (x - mean) (Eq. 24)."""
    return feedforward - (gain_1 * error_1 + gain_2 * error_2 + gain_3 * error_3 + gain_4 * error_4)


@inline_njit
def _thrust(half_index, state, parameters, lane):
    gain, mean, feedforward = parameters[0], parameters[1], parameters[2]
    error_1 = state[0, lane] - mean[half_index, 0]
    error_2 = state[1, lane] - mean[half_index, 1]
    error_3 = state[2, lane] - mean[half_index, 2]
    error_4 = state[3, lane] - mean[half_index, 3]
    k = gain[half_index]
    errors = (error_1, error_2, error_3, error_4)
    return (
        scheduled_thrust(*errors, k[0, 0], k[0, 1], k[0, 2], k[0, 3], feedforward[half_index, 0]),
        scheduled_thrust(*errors, k[1, 0], k[1, 1], k[1, 2], k[1, 3], feedforward[half_index, 1]),
    )


@inline_njit
def _drift(half_index, state, noise, parameters, out):
    gravity, mass_flow, density = parameters[3]
    for lane in range(LANES):
        thrust_1, thrust_2 = _thrust(half_index, state, parameters, lane)
        out[0, lane], out[1, lane], out[2, lane], out[3, lane], out[4, lane] = powered_descent_rates(
            state[0, lane],
            state[1, lane],
            state[2, lane],
            state[3, lane],
            state[4, lane],
            thrust_1,
            thrust_2,
            density * noise[0, lane],
            density * noise[1, lane],
            gravity,
            mass_flow,
        )


@inline_njit
def _observe(half_index, state, parameters, out):
    for lane in range(LANES):
        thrust_1, thrust_2 = _thrust(half_index, state, parameters, lane)
        out[0, lane] = thrust_magnitude(thrust_1, thrust_2)
        out[1, lane] = -state[1, lane]


_runge_kutta = propagator(runge_kutta_4, _drift, _observe)
_euler_maruyama = propagator(euler_maruyama, _drift, _observe)


@njit(parallel=True, cache=True, error_model="numpy")
def _fly_segment(
    use_runge_kutta,
    gain,
    mean,
    feedforward,
    gravity,
    mass_flow_constant,
    noise_density,
    steps,
    step,
    steps_per_output,
    increments,
    seed,
    first_trial,
    first_increment,
    final_state,
    history,
    observed,
    observed_maximum,
):
    """Fly one segment with all trials; `final_state` holds the initial states."""
    for group in prange(final_state.shape[1] // LANES):
        lanes = slice(group * LANES, (group + 1) * LANES)
        state = final_state[:, lanes].copy()
        largest = observed_maximum[:, lanes].copy()
        states, observations = history[:, :, lanes], observed[:, :, lanes]
        parameters = (gain, mean, feedforward, (gravity, mass_flow_constant, noise_density))
        first = first_trial + group * LANES
        if use_runge_kutta:
            _runge_kutta(
                parameters, steps, step, steps_per_output, NOISES, seed, NOISE_STREAM, first, first_increment,
                increments, state, states, observations, largest,
            )  # fmt: skip
        else:
            _euler_maruyama(
                parameters, steps, step, steps_per_output, NOISES, seed, NOISE_STREAM, first, first_increment,
                increments, state, states, observations, largest,
            )  # fmt: skip
        final_state[:, lanes] = state
        observed_maximum[:, lanes] = largest


def fly(schedules, plant, initial_states, *, steps_per_output, seed, first_trial=0, integrator="rk4", increments=1):
    """Fly consecutive trials through the segments.

    schedules: `Schedule` by segment. plant: `Plant`. initial_states: (trials, 5), SI. steps_per_output: by segment.
    seed, first_trial: key of the random numbers and the number of the first trial. integrator: "rk4" or
    "euler_maruyama". increments: fine Brownian increments per step, so that runs of different steps share their paths.

    Returns `Trajectories`; observed are the thrust magnitude (N) and the depth below altitude zero (m). A trial that
    comes below the ground at any step flies on, as the paper's model does, and has the outcome CRASHED.
    """
    counts = [output_count(s.steps, n) for s, n in zip(schedules, steps_per_output, strict=True)]
    flown = new_trajectories(initial_states.T, sum(counts), OBSERVED)
    output, increment = 0, 0
    for control, every, count in zip(schedules, steps_per_output, counts, strict=True):
        _fly_segment(
            integrator == "rk4",
            control.gain,
            control.mean,
            control.feedforward,
            plant.gravity,
            plant.mass_flow_constant,
            plant.noise_density,
            control.steps,
            control.step,
            every,
            increments,
            seed,
            first_trial,
            increment,
            flown.final_state,
            flown.history[output : output + count],
            flown.observed[output : output + count],
            flown.observed_maximum,
        )
        output += count
        increment += control.steps * increments
    flown.outcome[flown.observed_maximum[DEPTH] > 0] = CRASHED
    finite = np.isfinite(flown.final_state).all(axis=0) & np.isfinite(flown.observed_maximum).all(axis=0)
    flown.outcome[~finite] = NON_FINITE
    return flown.first(len(initial_states))


def initial_states(mean, covariance, wet_mass, seed, trials):
    """Gaussian initial states of the given trials with the wet mass, (trials, 5)."""
    deviations = normals(seed, INITIAL_STREAM, trials, 4) @ np.linalg.cholesky(covariance).T
    return np.column_stack([mean + deviations, np.full(len(deviations), wet_mass)])
