"""Flights of perturbed entries beside the nominal (Eqs. 1 and 2, with the feedback of Sec. 3).

The nominal's bank acceleration is constant on equal intervals. The nominal is integrated along with every trial, by
the same steps: the feedback answers the difference to it at every stage, and a trial without perturbation is the
nominal to the last bit.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates_from_sines
from marsedl.montecarlo.elementary import exponential, sine_cosine
from marsedl.montecarlo.ensembles import Trajectories, new_trajectories, pad_to_groups
from marsedl.montecarlo.integrators import runge_kutta_4
from marsedl.montecarlo.lanes import LANES, inline_njit, lane_array
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.papers.desensitized.components import (
    ALTITUDE,
    BANK,
    BANK_ACCELERATION,
    BANK_RATE,
    COMMAND_MAGNITUDE,
    CUMULATIVE,
    EAST_VELOCITY,
    INTEGRATED,
    LATITUDE,
    LONGITUDE,
    NORTH_VELOCITY,
    OBSERVED,
    RADIAL_VELOCITY,
    STORED,
)
from marsedl.papers.desensitized.entry_problem import ROUNDING
from marsedl.papers.desensitized.inputs import Planet, Vehicle

LEAST_LOG_DENSITY, LARGEST_LOG_DENSITY = -600.0, 600.0  # within what `exponential` treats, and no subnormal products

_SETTINGS = np.dtype(
    [
        (name, "f8")
        for name in (
            *("gravitational_parameter", "planet_radius", "ballistic_coefficient", "lift_to_drag"),
            *("bank_acceleration_bound", "bottom", "cells_per_metre"),
        )
    ]
)


class Reference(NamedTuple):
    """The nominal that is flown: its start, and its bank acceleration on equal intervals of time."""

    initial_state: np.ndarray  # (8,), SI and rad
    bank_acceleration: np.ndarray  # (N,), rad/s^2, within its bound
    final_time: float  # s, end of all flights


class _Followed(NamedTuple):
    """What the kernel flies beside: the nominal's start and control, and the gains."""

    initial_state: np.ndarray  # (8,)
    control: np.ndarray  # (N,), rad/s^2
    gain: np.ndarray  # (8,)


class _Pace(NamedTuple):
    """How the kernel steps and stores."""

    time_step: float  # s
    substeps: int  # in an interval
    every: int  # intervals between stored states


class _Outputs(NamedTuple):
    """Arrays that the kernel fills, see `Trajectories`; `final` holds the initial states before."""

    history: np.ndarray
    observed: np.ndarray
    largest: np.ndarray
    length: np.ndarray
    final: np.ndarray


# ---- set-up ----------------------------------------------------------------------------------------------------------


def settings(planet: Planet, vehicle: Vehicle, nodes):
    """The constants of a flight as a record that compiled code reads by name.

    Args:
        planet, vehicle: gravity and radius of the one, aerodynamics and bound of the bank acceleration of the other.
        nodes: altitudes of the density table, with bottom (m) and spacing (m), see `atmosphere.uniform_nodes`.

    Returns:
        Structured array of shape (1,).
    """
    values = (
        *(planet.gravitational_parameter, planet.planet_radius, vehicle.ballistic_coefficient, vehicle.lift_to_drag),
        *(vehicle.bank_acceleration_bound, nodes.bottom, 1.0 / nodes.spacing),
    )
    return np.array([values], dtype=_SETTINGS)


def _checked_reference(reference, bound):
    """Initial state, bank acceleration and final time as compiled code takes them; ValueError if they do not fit."""
    # Copies, as loaded arrays are read-only, for which the kernels would be compiled once more.
    initial_state = np.array(reference.initial_state, dtype=float)
    control = np.array(reference.bank_acceleration, dtype=float)
    if not (np.isfinite(initial_state).all() and np.isfinite(control).all()):
        raise ValueError("initial_state and bank_acceleration of the reference must be finite")
    largest = int(np.argmax(np.abs(control)))
    if abs(control[largest]) > (1.0 + ROUNDING) * bound:
        raise ValueError(
            f"the reference's bank acceleration on interval {largest}, {control[largest]:g} rad/s^2, is beyond its "
            f"bound, {bound:g}"
        )
    # What an optimiser leaves beyond the bound must not make a difference between the nominal and a trial.
    return initial_state, np.clip(control, -bound, bound), float(reference.final_time)


def _whole(number, name, divided=None):
    """A count as an integer; ValueError unless it is whole and positive and divides `divided`."""
    if number != int(number) or number < 1:
        raise ValueError(f"{name} must be a whole number from 1 on, got {number}")
    if divided is not None and divided % int(number):
        raise ValueError(f"{name} ({number}) must divide the {divided} intervals, so that the end is stored")
    return int(number)


# ---- compiled --------------------------------------------------------------------------------------------------------


@inline_njit
def _log_density(altitude, cells, constants):
    """ln of the density: cubics between uniform nodes, and a cell more before the first node and behind the last."""
    position = (altitude - constants.bottom) * constants.cells_per_metre + 1.0
    last = np.float64(cells.shape[0] - 1)
    inside = position if position > 0.0 else 0.0  # of NaN, too: there must be a cell to read
    inside = inside if inside < last else last
    cell = np.int32(inside)
    fraction = position - cell
    logarithm = cells[cell, 0] + fraction * (cells[cell, 1] + fraction * (cells[cell, 2] + fraction * cells[cell, 3]))
    logarithm = LEAST_LOG_DENSITY if logarithm < LEAST_LOG_DENSITY else logarithm  # NaN stays NaN
    return LARGEST_LOG_DENSITY if logarithm > LARGEST_LOG_DENSITY else logarithm


@inline_njit
def _command(state, nominal_control, gain, command):
    """Bank acceleration u = u* + k (y - y*) before its bound, command (1, LANES)."""
    for lane in range(LANES):
        command[0, lane] = nominal_control
    # To a length, not to a constant: the loop would be unrolled, which doubles the time to compile.
    for row in range(len(gain)):
        factor = gain[row]
        for lane in range(LANES):
            command[0, lane] += factor * (state[row, lane] - state[STORED + row, lane])


@inline_njit
def _bounded(command, constants):
    bound = constants.bank_acceleration_bound
    limited = -bound if command < -bound else command
    return bound if limited > bound else limited


@inline_njit
def _drift(half_index, state, noise, parameters, out):
    cells, density_factor, nominal_control, gain, command, applied, log_density, constants = parameters
    # Look-ups apart: they are no vector code, and would keep the rest from becoming it.
    for lane in range(LANES):
        log_density[0, lane] = _log_density(state[ALTITUDE, lane], cells, constants)
        log_density[1, lane] = _log_density(state[STORED + ALTITUDE, lane], cells, constants)
    _command(state, nominal_control, gain, command)
    for lane in range(LANES):
        applied[0, lane], applied[1, lane] = _bounded(command[0, lane], constants), nominal_control
        out[CUMULATIVE, lane] = abs(applied[0, lane])
    # The trial and the nominal, by the same code.
    for vehicle in range(2):
        first = vehicle * STORED
        for lane in range(LANES):
            (
                out[first + ALTITUDE, lane],
                out[first + LATITUDE, lane],
                out[first + LONGITUDE, lane],
                out[first + RADIAL_VELOCITY, lane],
                out[first + NORTH_VELOCITY, lane],
                out[first + EAST_VELOCITY, lane],
                out[first + BANK, lane],
                out[first + BANK_RATE, lane],
            ) = velocity_component_entry_rates_from_sines(
                state[first + ALTITUDE, lane],
                sine_cosine(state[first + LATITUDE, lane]),
                (
                    state[first + RADIAL_VELOCITY, lane],
                    state[first + NORTH_VELOCITY, lane],
                    state[first + EAST_VELOCITY, lane],
                ),
                sine_cosine(state[first + BANK, lane]),
                state[first + BANK_RATE, lane],
                applied[vehicle, lane],
                exponential(log_density[vehicle, lane]) * density_factor[vehicle, lane],
                (constants.ballistic_coefficient, constants.lift_to_drag),
                (constants.gravitational_parameter, constants.planet_radius),
            )


_advance = runge_kutta_4(_drift)


@inline_njit
def _record(row, state, command, constants, history, observed):
    for component in range(history.shape[1]):
        for lane in range(LANES):
            history[row, component, lane] = state[component, lane]
    for lane in range(LANES):
        observed[row, BANK_ACCELERATION, lane] = _bounded(command[0, lane], constants)
        observed[row, COMMAND_MAGNITUDE, lane] = abs(command[0, lane])


@inline_njit
def _update_largest(command, flying, constants, largest):
    for lane in range(LANES):
        if flying[lane]:
            # np.maximum keeps NaN, so a trial that went wrong shows it.
            applied = _bounded(command[0, lane], constants)
            largest[BANK_ACCELERATION, lane] = np.maximum(largest[BANK_ACCELERATION, lane], applied)
            largest[COMMAND_MAGNITUDE, lane] = np.maximum(largest[COMMAND_MAGNITUDE, lane], abs(command[0, lane]))


@inline_njit
def _finish(lane, state, final):
    for row in range(final.shape[0]):
        final[row, lane] = state[row, lane]


@njit(error_model="numpy")
def _fly_group(constants, cells, followed, pace, density_factor, outputs):
    """Fly LANES trials. outputs.final: (9, LANES), the initial state, replaced by the final one."""
    nominal_state, control, gain = followed
    time_step, substeps, every = pace
    history, observed, largest, length, final = outputs
    command, applied, log_density, noise = lane_array(1), lane_array(2), lane_array(2), lane_array(0)
    state = lane_array(INTEGRATED)
    for row in range(final.shape[0]):
        for lane in range(LANES):
            state[row, lane] = final[row, lane]
    for row in range(len(nominal_state)):
        for lane in range(LANES):
            state[STORED + row, lane] = nominal_state[row]
    work = (lane_array(INTEGRATED), lane_array(INTEGRATED), lane_array(INTEGRATED))
    factor = lane_array(2)
    for lane in range(LANES):
        factor[0, lane], factor[1, lane] = density_factor[lane], 1.0
    flying = np.ones(LANES, np.bool_)
    remaining, row = LANES, 0
    for interval in range(len(control)):
        parameters = (cells, factor, control[interval], gain, command, applied, log_density, constants)
        for substep in range(substeps):
            _command(state, control[interval], gain, command)
            _update_largest(command, flying, constants, largest)
            if substep == 0 and interval % every == 0:
                _record(row, state, command, constants, history, observed)
                row += 1
            _advance(0, time_step, state, noise, parameters, work)
            for lane in range(LANES):
                if flying[lane] and state[ALTITUDE, lane] < 0.0:
                    _finish(lane, state, final)
                    length[lane] = row
                    flying[lane] = False
                    remaining -= 1
            if remaining == 0:
                return
    _command(state, control[len(control) - 1], gain, command)
    _update_largest(command, flying, constants, largest)
    _record(row, state, command, constants, history, observed)
    for lane in range(LANES):
        if flying[lane]:
            _finish(lane, state, final)


@njit(parallel=True, cache=True, error_model="numpy")
def _fly(settings, cells, followed, pace, density_factor, outputs):
    # Named tuples are taken apart here: what a parallel loop writes into an array of a tuple is lost.
    nominal_state, control, gain = followed
    time_step, substeps, every = pace
    history, observed, largest, length, final = outputs
    for group in prange(final.shape[1] // LANES):
        lanes = slice(group * LANES, (group + 1) * LANES)
        part = _Outputs(history[:, :, lanes], observed[:, :, lanes], largest[:, lanes], length[lanes], final[:, lanes])
        followed_here, pace_here = _Followed(nominal_state, control, gain), _Pace(time_step, substeps, every)
        _fly_group(settings[0], cells, followed_here, pace_here, density_factor[lanes], part)


# ---- flights ---------------------------------------------------------------------------------------------------------


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
        ValueError: for a reference that is not finite or beyond the bound on the bank acceleration, or numbers of steps
            that are not whole.
    """
    bound = float(constants["bank_acceleration_bound"][0])
    nominal_state, control, final_time = _checked_reference(reference, bound)
    cells, gain = np.array(cells, dtype=float, order="C"), np.array(gain, dtype=float)
    states = np.asarray(initial_states, dtype=float)
    factor = np.broadcast_to(np.asarray(density_factor, dtype=float), len(states))
    substeps, every = _whole(substeps, "substeps"), _whole(every, "every", len(control))
    start = np.vstack([states.T, np.zeros(len(states))])
    trajectories = new_trajectories(start, len(control) // every + 1, OBSERVED)
    followed, pace = (
        _Followed(nominal_state, control, gain),
        _Pace(final_time / len(control) / substeps, substeps, every),
    )
    outputs = _Outputs(
        trajectories.history,
        trajectories.observed,
        trajectories.observed_maximum,
        trajectories.length,
        trajectories.final_state,
    )
    _fly(constants, cells, followed, pace, pad_to_groups(factor), outputs)
    trajectories = trajectories.first(len(states))
    trajectories.outcome[trajectories.final_state[ALTITUDE] < 0.0] = CRASHED
    finite = np.isfinite(trajectories.final_state).all(axis=0) & np.isfinite(trajectories.observed_maximum).all(axis=0)
    trajectories.outcome[~finite] = NON_FINITE
    ended = np.arange(len(trajectories.history))[:, np.newaxis, np.newaxis] >= trajectories.length
    for stored in (trajectories.history, trajectories.observed):
        np.copyto(stored, np.nan, where=ended)
    return trajectories
