"""Flights of perturbed entries beside the nominal (Eqs. 1 and 2, with the feedback of Sec. 3).

The nominal's bank acceleration is constant on equal intervals. The nominal is integrated along with every trial, by
the same steps: the feedback answers the difference to it at every stage, and a trial without perturbation is the
nominal to the last bit.
"""

from typing import NamedTuple

import numpy as np

from marsedl.elementary import clip, exponential
from marsedl.models.atmosphere import log_density_in_cells
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.montecarlo.ensembles import Trajectories
from marsedl.montecarlo.flights import Flight, Nothing, Schedule
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE, NOTHING
from marsedl.papers.desensitized.components import STATES, STORED
from marsedl.papers.desensitized.entry_problem import ROUNDING
from marsedl.papers.desensitized.inputs import Planet, Vehicle


class Reference(NamedTuple):
    """The nominal that is flown: its start, and its bank acceleration on equal intervals of time."""

    initial_state: np.ndarray  # (8,), SI and rad
    bank_acceleration: np.ndarray  # (N,), rad/s^2, within its bound
    final_time: float  # s, end of all flights


class Settings(NamedTuple):
    """Constants of a flight, SI."""

    gravitational_parameter: float
    planet_radius: float
    ballistic_coefficient: float
    lift_to_drag: float
    bank_acceleration_bound: float
    bottom: float  # of the density table
    cells_per_metre: float


def settings(planet: Planet, vehicle: Vehicle, nodes) -> Settings:
    """The constants of a flight by name.

    Args:
        planet, vehicle: gravity and radius of the one, aerodynamics and bound of the bank acceleration of the other.
        nodes: altitudes of the density table, with bottom (m) and spacing (m), see `atmosphere.uniform_nodes`.
    """
    return Settings(
        planet.gravitational_parameter,
        planet.planet_radius,
        vehicle.ballistic_coefficient,
        vehicle.lift_to_drag,
        vehicle.bank_acceleration_bound,
        nodes.bottom,
        1.0 / nodes.spacing,
    )


# ---- the model: of one trial -----------------------------------------------------------------------------------------


class Stored(NamedTuple):
    """What is stored of a trial: its state, and the integral of the magnitude of the flown bank acceleration."""

    altitude: float  # m
    latitude: float  # rad
    longitude: float  # rad
    radial_velocity: float  # m/s
    north_velocity: float  # m/s
    east_velocity: float  # m/s
    bank: float  # rad
    bank_rate: float  # rad/s
    cumulative: float  # rad/s


_OF_VEHICLE = list(Stored.__annotations__.items())[:STATES]
State = NamedTuple(
    "State", [*Stored.__annotations__.items(), *((f"nominal_{name}", kind) for name, kind in _OF_VEHICLE)]
)
Gain = NamedTuple("Gain", _OF_VEHICLE)  # K, rad/s^2 per unit of each state


class Parameters(NamedTuple):
    """What all trials fly in and by."""

    settings: Settings
    cells: np.ndarray  # (nodes + 1, 4), cubics of ln of the density (kg/m^3)
    gain: Gain
    nominal_control: np.ndarray  # (N,), rad/s^2


class Density(NamedTuple):
    """ln of the mean density (kg/m^3) around the trial and the nominal."""

    log_mean: float
    nominal_log_mean: float


class Air(NamedTuple):
    """Factor of the density around the trial."""

    factor: float


class Control(NamedTuple):
    """The nominal's bank acceleration u*, rad/s^2."""

    nominal: float


class Observed(NamedTuple):
    """Bank acceleration as flown and magnitude as commanded, or their maxima, rad/s^2."""

    bank_acceleration: float = -np.inf
    command_magnitude: float = -np.inf


def hold_nominal(cycle, p) -> tuple[Control, Nothing]:
    """The nominal's control on an interval."""
    return Control(p.nominal_control[cycle]), ()


def look_up(state, p) -> Density:
    """Densities around the trial and the nominal."""
    bottom, cells_per_metre = p.settings.bottom, p.settings.cells_per_metre
    return Density(
        log_density_in_cells(state.altitude, bottom, cells_per_metre, p.cells),
        log_density_in_cells(state.nominal_altitude, bottom, cells_per_metre, p.cells),
    )


def _commanded(state, control, gain):
    """Bank acceleration u = u* + K (y - y*) before its bound (Sec. 3)."""
    return (
        control.nominal
        + gain.altitude * (state.altitude - state.nominal_altitude)
        + gain.latitude * (state.latitude - state.nominal_latitude)
        + gain.longitude * (state.longitude - state.nominal_longitude)
        + gain.radial_velocity * (state.radial_velocity - state.nominal_radial_velocity)
        + gain.north_velocity * (state.north_velocity - state.nominal_north_velocity)
        + gain.east_velocity * (state.east_velocity - state.nominal_east_velocity)
        + gain.bank * (state.bank - state.nominal_bank)
        + gain.bank_rate * (state.bank_rate - state.nominal_bank_rate)
    )


def rates(state, found, command, vehicle, p) -> State:
    """The trial, its integral of |u|, and the nominal."""
    bound, constants = p.settings.bank_acceleration_bound, p.settings
    flown = clip(_commanded(state, command, p.gain), -bound, bound)
    density, around_nominal = exponential(found.log_mean) * vehicle.factor, exponential(found.nominal_log_mean)
    body = constants.ballistic_coefficient, constants.lift_to_drag
    planet = constants.gravitational_parameter, constants.planet_radius
    trial = velocity_component_entry_rates(state[:STATES], flown, density, body, planet)
    nominal = velocity_component_entry_rates(state[STORED:], command.nominal, around_nominal, body, planet)
    return State(*trial, abs(flown), *nominal)


def ended(state) -> bool:
    """Whether the trial is below the ground."""
    return state.altitude < 0.0


def observe(state, command, p) -> Observed:
    """Bank acceleration as flown, and the magnitude of the one commanded."""
    commanded = _commanded(state, command, p.gain)
    bound = p.settings.bank_acceleration_bound
    return Observed(clip(commanded, -bound, bound), abs(commanded))


def watch(watched, state, command, p) -> Observed:
    """Maxima of what is observed."""
    # np.maximum keeps NaN, so a trial that went wrong shows it.
    now = observe(state, command, p)
    return Observed(
        np.maximum(watched.bank_acceleration, now.bank_acceleration),
        np.maximum(watched.command_magnitude, now.command_magnitude),
    )


def store(state) -> Stored:
    """The trial without the nominal."""
    return Stored(*state[:STORED])


FLIGHT = Flight(
    rates,
    look_up=look_up,
    guide=hold_nominal,
    ended=ended,
    watch=watch,
    watch_steps=True,
    store=store,
    observe=observe,
    finish=store,
)


# ---- flights ---------------------------------------------------------------------------------------------------------


def _checked_control(reference, bound):
    """The reference's bank acceleration within its bound; ValueError if it is beyond by more than rounding."""
    control = reference.bank_acceleration
    largest = int(np.argmax(np.abs(control)))
    if abs(control[largest]) > (1.0 + ROUNDING) * bound:
        raise ValueError(
            f"the reference's bank acceleration on interval {largest}, {control[largest]:g} rad/s^2, is beyond its "
            f"bound, {bound:g}"
        )
    # What an optimiser leaves beyond the bound must not make a difference between the nominal and a trial.
    return np.clip(control, -bound, bound)


def fly(constants, cells, reference, gain, initial_states, *, density_factor=1.0, substeps, every=1) -> Trajectories:
    """Fly perturbed entries to the nominal's final time (Eqs. 1 and 2) by the feedback law of Sec. 3.

        u = u* + K (y - y*), within its bound

    u* is the nominal's bank acceleration, constant on N intervals of equal length; y* is the nominal as integrated
    here, not as an optimiser discretised it. Classical Runge-Kutta steps; the feedback acts at every stage. Nothing
    keeps the bank rate within a bound.

    Args:
        constants: see `settings`.
        cells: (nodes + 1, 4), ln of the density (kg/m^3), see `atmosphere.uniform_cells`.
        reference: `Reference`, the nominal.
        gain: (8,), K, rad/s^2 per unit of each state; zeros for a flight without feedback.
        initial_states: (trials, 8): altitude (m), latitude, longitude (rad), radial, north and east velocity (m/s),
            bank (rad), bank rate (rad/s).
        density_factor: scalar or (trials,), by which the density around the trial, not the nominal, is multiplied.
        substeps: integration steps per interval.
        every: intervals between stored states; divides N.

    Returns:
        `Trajectories` with N / every + 1 times, start and end included. What is stored, and the final state, are the 8
        states and the integral of |u| (rad/s). Observed are the bank acceleration flown (rad/s^2) and the magnitude of
        the one commanded, before its bound, both for the interval that begins then, and at the end for the last one.
        Their maxima are over the starts of all steps and the end. Outcomes: CRASHED below altitude zero, where a trial
        ends and after which nothing is stored (NaN); NON_FINITE.

    Raises:
        ValueError: for a reference beyond the bound on the bank acceleration, or initial states that are not finite.
    """
    control = _checked_control(reference, constants.bank_acceleration_bound)
    intervals = len(control)
    end, length = float(reference.final_time), float(reference.final_time) / intervals
    schedule = Schedule(
        np.append(np.arange(intervals) * length, end),
        np.full(intervals, length / substeps),
        np.full(intervals, substeps),
        every * substeps,
    )
    trajectories = FLIGHT.fly(
        Parameters(constants, np.asarray(cells, dtype=float), Gain(*gain), control),
        schedule,
        State(*np.transpose(initial_states), 0.0, *reference.initial_state),
        vehicle=Air(density_factor),
    )
    trajectories.outcome[trajectories.ended != NOTHING] = CRASHED
    trajectories.outcome[~trajectories.finite] = NON_FINITE
    return trajectories.cleared()
