"""Flight of the nonlinear plant with mass flow under the scheduled control (Eqs. 1, 2, 24, 49)."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.models.dynamics.powered_descent import powered_descent_rates, thrust_magnitude
from marsedl.montecarlo.ensembles import pad_to_groups
from marsedl.montecarlo.flights import Flight, Nothing
from marsedl.montecarlo.flights import Schedule as Periods
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4, semi_implicit_euler
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.papers.powered_descent.records import DEPTH, Gains

INITIAL_STREAM, NOISE_STREAM = 0, 1
OBSERVED = 2  # thrust magnitude, depth below the ground
OWN_MASS = np.full(1, np.nan)  # in place of a prior mass profile


class Schedule(NamedTuple):
    """The control of one segment on the half-step grid of its simulation."""

    step: float  # s
    steps: int
    gain: np.ndarray  # (2 steps + 1, 2, 4), N/m and N s/m
    mean: np.ndarray  # (2 steps + 1, 4), m and m/s
    feedforward: np.ndarray  # (2 steps + 1, 2), N
    prior_mass: np.ndarray = OWN_MASS  # (2 steps + 1,), kg, that the plant flies in place of its own; (1,): its own
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


def plant_of(given: Inputs) -> Plant:
    """Return the simulated plant with the gravity, mass flow and noise of the reading."""
    return Plant(given.planet.gravity, segments.mass_flow(given.vehicle), segments.plant_noise_density(given.noise))


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


def scheduled_thrust(half_index, state, schedule):
    """u = u_ff - K (x - mean) (Eq. 24)."""
    i, k, mean, feedforward = half_index, schedule.gain, schedule.mean, schedule.feedforward
    e1, e2 = state.downrange - mean[i, 0], state.altitude - mean[i, 1]
    e3, e4 = state.downrange_velocity - mean[i, 2], state.vertical_velocity - mean[i, 3]
    return Thrust(
        feedforward[i, 0] - (k[i, 0, 0] * e1 + k[i, 0, 1] * e2 + k[i, 0, 2] * e3 + k[i, 0, 3] * e4),
        feedforward[i, 1] - (k[i, 1, 0] * e1 + k[i, 1, 1] * e2 + k[i, 1, 2] * e3 + k[i, 1, 3] * e4),
    )


def command(half_index, state, p) -> tuple[Thrust, Nothing]:
    """The thrust at the start of a guidance period: a held one, or that of a single step, which is observed."""
    return scheduled_thrust(half_index, state, p.schedule), ()


def held_rates(half_index, state, command, noise, p) -> State:
    """Eqs. 1, 2 and 49 under a held thrust, with the vehicle's own mass or the prior one."""
    prior_mass, density = p.schedule.prior_mass, p.plant.noise_density
    prior = prior_mass[min(half_index, len(prior_mass) - 1)]
    mass = state.mass if len(prior_mass) == 1 else prior
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


def observe(state, command) -> Observed:
    """Thrust and depth at a step."""
    return Observed(thrust_magnitude(command.downrange, command.vertical), -state.altitude)


def largest(watched, state, command) -> Observed:
    """The largest thrust and depth so far."""
    now = observe(state, command)
    # np.maximum keeps NaN, so a trial that went wrong in between shows it.
    return Observed(np.maximum(watched.thrust, now.thrust), np.maximum(watched.depth, now.depth))


def _flight(rates, scheme):
    return Flight(
        rates, integrator=scheme, noise=Thrust, guide=command, observe=observe, watch=largest, watch_steps=True
    )


_SCHEMES = {"rk4": runge_kutta_4, "euler_maruyama": euler_maruyama, "semi_implicit_euler": semi_implicit_euler(2)}
# Flights are compiled when they are first flown. Euler-Maruyama asks for rates at starts of steps alone, where the
# thrust is that which a step holds.
HELD = {name: _flight(held_rates, scheme) for name, scheme in _SCHEMES.items()}
CONTINUOUS = {**HELD, **{name: _flight(rates, _SCHEMES[name]) for name in ("rk4", "semi_implicit_euler")}}


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
        integrator: a name in `CONTINUOUS`.
        widening: factor on the covariance where a segment ends and the next begins: deviations from the mean of the
            design are scaled by its square root there.

    Returns:
        `Trajectories`; observed are the thrust magnitude (N) and the depth below altitude zero (m). A trial that comes
        below the ground at any step flies on, as the paper's model does, and has the outcome CRASHED.

    """
    counts = [s.steps // n + 1 for s, n in zip(schedules, steps_per_output, strict=True)]
    flown = pad_to_groups(initial_states.T)
    history, observed = (np.empty((sum(counts), size, flown.shape[1])) for size in (len(flown), OBSERVED))
    output, increment = 0, 0
    for control, every, count in zip(schedules, steps_per_output, counts, strict=True):
        if output and widening != 1.0:
            state = flown.final_state
            state[:4] = control.mean[0, :, np.newaxis] * (1 - np.sqrt(widening)) + np.sqrt(widening) * state[:4]
        flights = HELD if control.steps_per_command else CONTINUOUS
        flown = flights[integrator].fly(
            Parameters(control, plant),
            periods(control, every),
            flown,
            **draws._asdict(),
            first_increment=increment,
            into=(history[output : output + count], observed[output : output + count]),
        )
        if control.steps % (control.steps_per_command or 1) == 0:  # a command is renewed at the end, too
            end = State(*flown.final_state)
            with np.errstate(over="ignore", invalid="ignore"):
                flown.observed[-1] = observe(end, scheduled_thrust(2 * control.steps, end, control))
            np.maximum(flown.observed_maximum, flown.observed[-1], out=flown.observed_maximum)
        output += count
        increment += control.steps * draws.increments
    flown.outcome[flown.observed_maximum[DEPTH] > 0] = CRASHED
    flown.outcome[~flown.finite] = NON_FINITE
    length = np.full_like(flown.length, output)
    return replace(flown, history=history, observed=observed, length=length).first(len(initial_states))


def initial_states(start: Start, seed: int, trials: np.ndarray) -> np.ndarray:
    """Gaussian initial states of the given trials with the wet mass, (trials, 5)."""
    deviations = normals(seed, INITIAL_STREAM, trials, 4) @ np.linalg.cholesky(start.covariance).T
    return np.column_stack([start.mean + deviations, np.full(len(deviations), start.wet_mass)])
