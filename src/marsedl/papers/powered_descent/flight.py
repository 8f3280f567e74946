"""Flight of the nonlinear plant with mass flow under the scheduled control (Eqs. 1, 2, 24, 49)."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.compiling import jitable
from marsedl.models.dynamics.powered_descent import powered_descent_rates, thrust_magnitude
from marsedl.montecarlo.ensembles import output_count
from marsedl.montecarlo.flights import Flight, Nothing
from marsedl.montecarlo.flights import Schedule as Periods
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4, semi_implicit_euler
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Noise, Planet, Vehicle
from marsedl.papers.powered_descent.records import DEPTH, Gains

INITIAL_STREAM, NOISE_STREAM = 0, 1
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


# ---- the model -------------------------------------------------------------------------------------------------------


class Parameters(NamedTuple):
    """What a segment is flown with."""

    schedule: Schedule
    plant: Plant


class State(NamedTuple):
    """The vehicle's."""

    downrange: float  # m
    altitude: float  # m
    downrange_velocity: float  # m/s
    vertical_velocity: float  # m/s
    mass: float  # kg


class Thrust(NamedTuple):
    """What is commanded, N; and the white noise that it meets, s^(-1/2)."""

    downrange: float
    vertical: float


class Observed(NamedTuple):
    """What is observed over time, and the largest of it."""

    thrust: float = -np.inf  # magnitude, N
    depth: float = -np.inf  # below the ground, m


@jitable
def scheduled_thrust(half_index, state, schedule):
    """u = u_ff - K (x - mean) (Eq. 24)."""
    mean, feedforward = schedule.mean[half_index], schedule.feedforward[half_index]
    k, l = schedule.gain[half_index]
    e1, e2 = state.downrange - mean[0], state.altitude - mean[1]
    e3, e4 = state.downrange_velocity - mean[2], state.vertical_velocity - mean[3]
    return Thrust(
        feedforward[0] - (k[0] * e1 + k[1] * e2 + k[2] * e3 + k[3] * e4),
        feedforward[1] - (l[0] * e1 + l[1] * e2 + l[2] * e3 + l[3] * e4),
    )


def command(half_index, state, p) -> tuple[Thrust, Nothing]:
    """The thrust at the start of a guidance period: a held one, or that of a single step, which is observed."""
    return scheduled_thrust(half_index, state, p.schedule), ()


@jitable
def held_rates(half_index, state, command, noise, p) -> State:
    """Eqs. 1, 2 and 49 under a held thrust, with the vehicle's own mass or the prior one."""
    prior_mass, density = p.schedule.prior_mass, p.plant.noise_density
    mass = state.mass if len(prior_mass) == 0 else prior_mass[half_index]
    return State(
        *powered_descent_rates(
            (state.downrange, state.altitude, state.downrange_velocity, state.vertical_velocity, mass),
            (command.downrange, command.vertical),
            (density * noise.downrange, density * noise.vertical),
            p.plant.gravity,
            p.plant.mass_flow_constant,
        )
    )


def rates(half_index, state, noise, p) -> State:
    """Eqs. 1, 2 and 49 under the thrust of Eq. 24 at every time."""
    return held_rates(half_index, state, scheduled_thrust(half_index, state, p.schedule), noise, p)


@jitable
def observe(state, command) -> Observed:
    """Thrust and depth at a step."""
    return Observed(thrust_magnitude(command.downrange, command.vertical), -state.altitude)


def largest(watched, state, command) -> Observed:
    """The largest thrust and depth so far."""
    now = observe(state, command)
    # np.maximum keeps NaN, so a trial that went wrong in between shows it.
    return Observed(np.maximum(watched.thrust, now.thrust), np.maximum(watched.depth, now.depth))


def _flights(scheme):
    """The flights with a continuous and with a held command; a flight is compiled when it is first flown."""
    options = {"guide": command, "observe": observe, "watch": largest, "watch_steps": True, "noise": Thrust}
    return tuple(Flight(rates_of, integrator=scheme, **options) for rates_of in (rates, held_rates))


FLIGHTS = {
    "rk4": _flights(runge_kutta_4),
    "euler_maruyama": _flights(euler_maruyama),
    "semi_implicit_euler": _flights(semi_implicit_euler(2)),
}
INTEGRATORS = tuple(FLIGHTS)


def periods(control, steps_per_output):
    """Guidance periods of a segment: those of held commands, or its steps."""
    first = np.append(np.arange(0, control.steps, control.steps_per_command or 1), control.steps)
    return Periods(first * control.step, np.full(len(first) - 1, control.step), np.diff(first), steps_per_output)


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
    parts, flown, increment = [], initial_states.T, 0
    for control, every in zip(schedules, steps_per_output, strict=True):
        output_count(control.steps, every)
        if parts and widening != 1.0:
            state = flown.final_state
            state[:4] = control.mean[0, :, np.newaxis] * (1 - np.sqrt(widening)) + np.sqrt(widening) * state[:4]
        flown = FLIGHTS[integrator][control.steps_per_command > 0].fly(
            Parameters(control, plant),
            periods(control, every),
            flown,
            **draws._asdict(),
            first_increment=increment,
            streams=(NOISE_STREAM, NOISE_STREAM),
        )
        if control.steps % (control.steps_per_command or 1) == 0:  # a command is renewed at the end, too
            with np.errstate(over="ignore", invalid="ignore"):
                end = State(*flown.final_state)
                seen = np.array(observe(end, scheduled_thrust(2 * control.steps, end, control)))
            flown.observed[-1] = seen
            np.maximum(flown.observed_maximum, seen, out=flown.observed_maximum)
        parts.append(flown)
        increment += control.steps * draws.increments
    finite = np.isfinite(flown.final_state).all(axis=0) & np.isfinite(flown.observed_maximum).all(axis=0)
    crashed = np.where(flown.observed_maximum[DEPTH] > 0, CRASHED, flown.outcome)
    return replace(
        flown,
        history=np.concatenate([part.history for part in parts]),
        observed=np.concatenate([part.observed for part in parts]),
        outcome=np.where(finite, crashed, NON_FINITE).astype(np.int8),
        length=sum(part.length for part in parts),
    )


def initial_states(start: Start, seed: int, trials: np.ndarray) -> np.ndarray:
    """Gaussian initial states of the given trials with the wet mass, (trials, 5)."""
    deviations = normals(seed, INITIAL_STREAM, trials, 4) @ np.linalg.cholesky(start.covariance).T
    return np.column_stack([start.mean + deviations, np.full(len(deviations), start.wet_mass)])
