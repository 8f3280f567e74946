"""Flight of the nonlinear plant with mass flow under the scheduled control (Eqs. 1, 2, 24, 49)."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from marsedl.compiling import jitable
from marsedl.models.dynamics.powered_descent import powered_descent_rates, thrust_magnitude
from marsedl.montecarlo.ensembles import Brownian, Segment, new_trajectories, output_count, propagator
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4, semi_implicit_euler
from marsedl.montecarlo.lanes import LANES, inline_njit
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Noise, Planet, Vehicle
from marsedl.papers.powered_descent.records import DEPTH, Gains

INITIAL_STREAM, NOISE_STREAM = 0, 1
NOISES = 2  # components of the thrust noise
OBSERVED = 2  # thrust magnitude, depth below the ground
INTEGRATORS = ("rk4", "euler_maruyama", "semi_implicit_euler")
OWN_MASS = np.empty(0)  # in place of a prior mass profile


class Schedule(NamedTuple):
    """The control of one segment on the half-step grid of its simulation."""

    step: float  # s
    steps: int
    gain: np.ndarray  # (2 steps + 1, 2, 4), N/m and N s/m
    mean: np.ndarray  # (2 steps + 1, 4), m and m/s
    feedforward: np.ndarray  # (2 steps + 1, 2), N
    prior_mass: np.ndarray = OWN_MASS  # (2 steps + 1,), kg, that the plant flies in place of its own; (0,): its own
    steps_per_command: int = 0  # over which a command is held; 0: the command is continuous


class Plant(NamedTuple):
    """Constants of the simulated plant."""

    gravity: float  # m/s^2
    mass_flow_constant: float  # kg/(N s)
    noise_density: float  # N sqrt(s)


class Start(NamedTuple):
    """Distribution of the initial states."""

    mean: np.ndarray  # (4,), m and m/s
    covariance: np.ndarray  # (4, 4)
    wet_mass: float  # kg


class Draws(NamedTuple):
    """Which random numbers trials use."""

    seed: int
    first_trial: int = 0
    increments: int = 1  # Brownian increments per step, so that runs of different steps share their paths


class Outputs(NamedTuple):
    """Arrays that a kernel fills, see `Trajectories`."""

    final_state: np.ndarray
    history: np.ndarray
    observed: np.ndarray
    observed_maximum: np.ndarray


def schedule(time, tables, steps):
    """Sample a segment's control on the half-step grid of `steps` steps.

    Nodes of the design are taken as they are where they fall on the grid; otherwise cubic splines go through them.

    time: local times of the design, uniform, (k,), s. tables: gain (k, 2, 4), mean (k, 4) and feedforward (k, 2), and
    the prior mass (k,) if the plant flies it. Returns a `Schedule`.
    """
    cells, half_steps = len(time) - 1, 2 * steps
    if cells % half_steps == 0:
        tables = [table[:: cells // half_steps] for table in tables]
    else:
        from scipy.interpolate import CubicSpline

        grid = np.linspace(0.0, time[-1], half_steps + 1)
        tables = [CubicSpline(time, table)(grid) for table in tables]
    return Schedule(time[-1] / steps, steps, *(np.ascontiguousarray(table) for table in tables))


def schedules_of(times, gains: Gains, steps, prior_mass=None):
    """Sample the control of the design on the half-step grids of all segments.

    times: nodes of the design from each segment's start, (k,) by segment, s. steps: number of steps by segment.
    prior_mass: the mass profile at the nodes, (nodes,), kg, if the plant flies it in place of its own. Returns
    `Schedule` by segment.
    """
    tables = [gains.gain, gains.mean, gains.feedforward] + ([] if prior_mass is None else [prior_mass])
    parts = segments.split(gains.segment, *tables)
    return [schedule(time, part, number) for time, part, number in zip(times, parts, steps, strict=True)]


def plant_of(planet: Planet, vehicle: Vehicle, noise: Noise) -> Plant:
    """Return the simulated plant with the gravity, mass flow and noise of the reading."""
    return Plant(planet.gravity, segments.mass_flow(vehicle), segments.plant_noise_density(noise))


def with_held_command(schedule, command_interval):
    """Return a schedule whose command is held over whole steps, no longer than `command_interval` (s)."""
    return schedule._replace(steps_per_command=max(1, int(command_interval / schedule.step + 1e-9)))


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
def _command(half_index, state, parameters):
    """Write the thrust that the schedule commands now, (2, LANES)."""
    command = parameters[4]
    for lane in range(LANES):
        command[0, lane], command[1, lane] = _thrust(half_index, state, parameters, lane)


@inline_njit
def _drift(half_index, state, noise, parameters, out):
    gravity, mass_flow, density = parameters[3]
    command, half_steps_per_command, prior_mass = parameters[4], parameters[5], parameters[6]
    if half_steps_per_command == 0:
        _command(half_index, state, parameters)
    if len(prior_mass) == 0:
        for lane in range(LANES):
            out[0, lane], out[1, lane], out[2, lane], out[3, lane], out[4, lane] = powered_descent_rates(
                (state[0, lane], state[1, lane], state[2, lane], state[3, lane], state[4, lane]),
                (command[0, lane], command[1, lane]),
                (density * noise[0, lane], density * noise[1, lane]),
                gravity,
                mass_flow,
            )
    else:
        for lane in range(LANES):
            out[0, lane], out[1, lane], out[2, lane], out[3, lane], out[4, lane] = powered_descent_rates(
                (state[0, lane], state[1, lane], state[2, lane], state[3, lane], prior_mass[half_index]),
                (command[0, lane], command[1, lane]),
                (density * noise[0, lane], density * noise[1, lane]),
                gravity,
                mass_flow,
            )


@inline_njit
def _observe(half_index, state, parameters, out):
    command, half_steps_per_command = parameters[4], parameters[5]
    # The engine observes at the start of every step, which is when a held command is renewed.
    if half_steps_per_command == 0 or half_index % half_steps_per_command == 0:
        _command(half_index, state, parameters)
    for lane in range(LANES):
        out[0, lane] = thrust_magnitude(command[0, lane], command[1, lane])
        out[1, lane] = -state[1, lane]


_runge_kutta = propagator(runge_kutta_4, _drift, _observe)
_euler_maruyama = propagator(euler_maruyama, _drift, _observe)
_semi_implicit_euler = propagator(semi_implicit_euler(2), _drift, _observe)


@njit(parallel=True, cache=True, error_model="numpy")
def _fly_segment(scheme, control, plant, pace, draws, first_increment, outputs):
    """Fly one segment with all trials; `outputs.final_state` holds the initial states."""
    # Named tuples are taken apart here: what a parallel loop writes into an array of a tuple is lost.
    gain, mean, feedforward = control.gain, control.mean, control.feedforward
    prior_mass, half_steps_per_command = control.prior_mass, 2 * control.steps_per_command
    gravity, mass_flow, noise_density = plant
    final_state, history, observed, observed_maximum = outputs
    steps, step, every = pace
    seed, increments = draws.seed, draws.increments
    for group in prange(final_state.shape[1] // LANES):
        lanes = slice(group * LANES, (group + 1) * LANES)
        state = final_state[:, lanes].copy()
        largest = observed_maximum[:, lanes].copy()
        states, observations = history[:, :, lanes], observed[:, :, lanes]
        command, constants = np.empty((2, LANES)), (gravity, mass_flow, noise_density)
        parameters = (gain, mean, feedforward, constants, command, half_steps_per_command, prior_mass)
        segment, first = Segment(steps, step, every), draws.first_trial + group * LANES
        brownian = Brownian(NOISES, seed, NOISE_STREAM, first, first_increment, increments)
        if scheme == 0:
            _runge_kutta(parameters, segment, brownian, state, states, observations, largest)
        elif scheme == 1:
            _euler_maruyama(parameters, segment, brownian, state, states, observations, largest)
        else:
            _semi_implicit_euler(parameters, segment, brownian, state, states, observations, largest)
        final_state[:, lanes] = state
        observed_maximum[:, lanes] = largest


def fly(schedules, plant, initial_states, draws, *, steps_per_output, integrator="rk4", widening=1.0):
    """Fly consecutive trials through the segments.

    Args:
        schedules: `Schedule` by segment.
        plant: `Plant`.
        initial_states: (trials, 5), SI.
        draws: `Draws`.
        steps_per_output: by segment.
        integrator: one of `INTEGRATORS`.
        widening: factor on the covariance where a segment ends and the next begins: deviations from the mean of the
            design are scaled by its square root there.

    Returns:
        `Trajectories`; observed are the thrust magnitude (N) and the depth below altitude zero (m). A trial that comes
        below the ground at any step flies on, as the paper's model does, and has the outcome CRASHED.

    """
    counts = [output_count(s.steps, n) for s, n in zip(schedules, steps_per_output, strict=True)]
    trajectories = new_trajectories(initial_states.T, sum(counts), OBSERVED)
    state = trajectories.final_state
    output, increment = 0, 0
    for control, every, count in zip(schedules, steps_per_output, counts, strict=True):
        if output and widening != 1.0:
            state[:4] = control.mean[0, :, np.newaxis] * (1 - np.sqrt(widening)) + np.sqrt(widening) * state[:4]
        outputs = Outputs(
            state,
            trajectories.history[output : output + count],
            trajectories.observed[output : output + count],
            trajectories.observed_maximum,
        )
        pace = Segment(control.steps, control.step, every)
        _fly_segment(INTEGRATORS.index(integrator), control, plant, pace, draws, increment, outputs)
        output += count
        increment += control.steps * draws.increments
    trajectories.outcome[trajectories.observed_maximum[DEPTH] > 0] = CRASHED
    finite = np.isfinite(state).all(axis=0) & np.isfinite(trajectories.observed_maximum).all(axis=0)
    trajectories.outcome[~finite] = NON_FINITE
    return trajectories.first(len(initial_states))


def initial_states(start: Start, seed: int, trials: np.ndarray) -> np.ndarray:
    """Gaussian initial states of the given trials with the wet mass, (trials, 5)."""
    deviations = normals(seed, INITIAL_STREAM, trials, 4) @ np.linalg.cholesky(start.covariance).T
    return np.column_stack([start.mean + deviations, np.full(len(deviations), start.wet_mass)])
