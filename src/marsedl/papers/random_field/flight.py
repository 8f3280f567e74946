"""Closed-loop flights through samples of the random field: aerocapture (Eq. 71) and the double integrator (Eq. 57).

Both are steered by the law of Eq. 8, whose control is constant on the intervals of a partition and answers the states
at all nodes so far.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from marsedl.models.atmosphere import uniform_cells
from marsedl.models.density_variation import density_factor, is_floored
from marsedl.models.dynamics.planar_entry import planar_entry_rates_from_sines
from marsedl.montecarlo.elementary import exponential, sine_cosine
from marsedl.montecarlo.ensembles import Trajectories, new_trajectories
from marsedl.montecarlo.integrators import runge_kutta_4
from marsedl.montecarlo.lanes import LANES, inline_njit, lane_array
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, fill_normals
from marsedl.papers.random_field import environment
from marsedl.papers.random_field.components import (
    ALTITUDE,
    BANK_COSINE,
    CONTROL,
    DENSITY_VARIATION,
    DYNAMIC_PRESSURE,
    FIELD,
    FINAL,
    FLIGHT_PATH_ANGLE,
    FLOORED,
    HISTORY,
    POINT_HISTORY,
    POINT_STATES,
    POSITION,
    RATE,
    VELOCITY,
)
from marsedl.papers.random_field.inputs import Air, Planet, Simulation, Vehicle

INITIAL_STREAM, FIELD_STREAM = 0, 1

# Aerocapture: the integrated state, and what is observed behind the commanded bank cosine.
RADIUS, SPEED, PATH_ANGLE = range(3)
STATES = 3
BANK_MAGNITUDE = 1
OBSERVED = 2

# What `_look_up` finds, and the steps counted at whose start the density was at its floor.
LOG_DENSITY, VARIATION, FLOOR_COUNT = range(3)
LEAST_LOG_DENSITY, LARGEST_LOG_DENSITY = -600.0, 600.0  # within what `exponential` treats, and no subnormal products

_NUMBERS = (
    *("gravitational_parameter", "planet_radius", "drag_factor", "lift_factor"),
    *("bottom", "cells_per_metre", "field_bottom", "nodes_per_metre"),
    *("density_floor", "variation_mean", "lower_limit", "upper_limit"),
)
_SETTINGS = np.dtype([(name, "f8") for name in _NUMBERS] + [("actual_density", "i8")])


class Law(NamedTuple):
    """The law of Eq. 8: u_k = V_k + sum over l <= k of K_kl (x_l - xbar_l), constant from one node to the next."""

    start: np.ndarray  # (N + 1,), s, the partition, its end included
    control: np.ndarray  # (N,), V
    gain: np.ndarray  # (N, N + 1, n), K; what answers later states, l > k, is not used
    reference: np.ndarray  # (N + 1, n), xbar


class Density(NamedTuple):
    """The density as kernels read it; fields as of `AirTables`, the mean as the cells of `uniform_cells`."""

    cells: np.ndarray
    retention: np.ndarray
    innovation_deviation: np.ndarray
    top_deviation: float
    mean: float
    varied: bool  # or the mean density alone


class Force(NamedTuple):
    """The force on the double integrator: a root of its covariance on a uniform grid of positions."""

    bottom: float  # position of the first node
    nodes_per_unit: float
    root: np.ndarray  # (nodes, normals)
    mean: float
    varied: bool  # or its mean alone


class Schedule(NamedTuple):
    """Integration steps of every interval (N,), their length, s, and how many of them lie between stored states."""

    steps: np.ndarray
    time_step: float
    every: int


class Plant(NamedTuple):
    """What flies an aerocapture, and through which air."""

    settings: np.ndarray  # see `settings`
    air: environment.AirTables


class Stored(NamedTuple):
    """What kernels fill, the trial last: arrays of `Trajectories` by their names there, shorter."""

    history: np.ndarray
    observed: np.ndarray
    largest: np.ndarray  # observed_maximum
    length: np.ndarray
    final: np.ndarray  # final_state


# ---- set-up ----------------------------------------------------------------------------------------------------------


def settings(planet: Planet, air: Air, vehicle: Vehicle, simulation: Simulation, tables):
    """The constants of an aerocapture as a record that compiled code reads by name."""
    drag_factor = 0.5 / vehicle.ballistic_coefficient
    values = {
        "gravitational_parameter": planet.gravitational_parameter,
        "planet_radius": planet.planet_radius,
        "drag_factor": drag_factor,
        "lift_factor": vehicle.lift_to_drag * drag_factor,
        "bottom": tables.bottom,
        "cells_per_metre": 1.0 / tables.spacing,
        "field_bottom": tables.altitude[0],
        "nodes_per_metre": 1.0 / _uniform_spacing(tables.altitude, "altitude"),
        "density_floor": air.density_floor,
        "variation_mean": tables.mean,
        "lower_limit": vehicle.control_limits[0],
        "upper_limit": vehicle.control_limits[1],
        "actual_density": int(simulation.dynamic_pressure_density == "actual"),
    }
    return np.array([tuple(values[name] for name in _SETTINGS.names)], dtype=_SETTINGS)


def plant_of(planet: Planet, air: Air, vehicle: Vehicle, simulation: Simulation) -> Plant:
    """Return the plant of the reading."""
    tables = environment.air_tables(air)
    return Plant(settings(planet, air, vehicle, simulation, tables), tables)


def open_loop(start, control, states=STATES) -> Law:
    """The law without feedback: V alone on the partition `start`."""
    start, control = np.asarray(start, dtype=float), np.asarray(control, dtype=float)
    return Law(start, control, np.zeros((len(control), len(start), states)), np.zeros((len(start), states)))


def _interval_steps(law, every, time_step):
    """Integration steps of every interval; ValueError unless they are whole and `every` divides them."""
    start = np.asarray(law.start, dtype=float)
    if start.ndim != 1 or len(start) < 2 or not (np.diff(start) > 0.0).all():
        raise ValueError(f"the partition must have at least 2 increasing nodes, got {start}")
    if not time_step > 0.0:
        raise ValueError(f"time_step must be positive, got {time_step}")
    exact = np.diff(start) / time_step
    steps = np.round(exact).astype(np.int64)
    for k, (number, ratio) in enumerate(zip(steps, exact, strict=True)):
        if number < 1 or abs(ratio - number) > 1e-9 * number:
            raise ValueError(
                f"the interval from {start[k]:g} to {start[k + 1]:g} s is no whole number of steps of {time_step:g} s; "
                f"choose a time_step that divides every interval"
            )
        if every != int(every) or every < 1 or number % every:
            raise ValueError(
                f"every ({every}) must divide the {number} steps from {start[k]:g} to {start[k + 1]:g} s, so that "
                f"states are stored at all nodes"
            )
    return steps


def outputs(law, every, time_step):
    """Times of the stored states, s: every `every` steps from each node of the partition on, and its end.

    Raises ValueError when an interval is no whole number of steps, or `every` does not divide it.
    """
    steps = _interval_steps(law, every, time_step)
    parts = [start + np.arange(0, n, every) * time_step for start, n in zip(law.start[:-1], steps, strict=True)]
    return np.concatenate([*parts, law.start[-1:]])


def _checked_law(law, states):
    """The law in arrays to compile for, whatever they were; ValueError on shapes."""
    nodes = len(law.start)
    # Copies, as loaded arrays are read-only, for which the kernels would be compiled once more.
    checked = Law(*(np.array(part, dtype=float, order="C") for part in law))
    expected = (nodes - 1,), (nodes - 1, nodes, states), (nodes, states)
    shapes = checked.control.shape, checked.gain.shape, checked.reference.shape
    if shapes != expected:
        raise ValueError(f"control, gain and reference of {nodes} nodes must have shapes {expected}, got {shapes}")
    return checked


def _checked_states(initial_states, states):
    initial_states = np.asarray(initial_states, dtype=float)
    if initial_states.ndim != 2 or initial_states.shape[1] != states or not len(initial_states):
        raise ValueError(f"initial_states must have shape (trials, {states}), got {initial_states.shape}")
    return initial_states


def _uniform_spacing(grid, name):
    """Spacing of a grid; ValueError unless it ascends uniformly."""
    grid = np.asarray(grid, dtype=float)
    steps = np.diff(grid)
    if grid.ndim != 1 or len(grid) < 2 or not (np.abs(steps - steps.mean()) <= 1e-6 * steps.mean()).all():
        raise ValueError(f"{name} must be a uniform ascending grid; the look-ups compute the node from the distance")
    return (grid[-1] - grid[0]) / (len(grid) - 1)


def _checked_process(air):
    """Retention and innovation deviation of the random part as compiled code takes them; ValueError on shapes."""
    retention, deviation = (np.array(part, dtype=float) for part in (air.retention, air.innovation_deviation))
    if not retention.shape == deviation.shape == (len(air.altitude) - 1,):
        raise ValueError(
            f"retention and innovation_deviation must have one value per node but the top one, shape "
            f"{(len(air.altitude) - 1,)}, got {retention.shape} and {deviation.shape}"
        )
    return retention, deviation


# ---- the law, compiled -----------------------------------------------------------------------------------------------


@inline_njit
def _command(interval, law, state, deviation, command):
    """Control of Eq. 8 at the start of an interval, command (LANES,); keeps the deviation there for later ones."""
    control, gain, reference = law.control, law.gain, law.reference
    states = state.shape[0]
    for row in range(states):
        for lane in range(LANES):
            deviation[interval * states + row, lane] = state[row, lane] - reference[interval, row]
    for lane in range(LANES):
        command[lane] = control[interval]
    for node in range(interval + 1):
        for row in range(states):
            factor = gain[interval, node, row]
            for lane in range(LANES):
                command[lane] += factor * deviation[node * states + row, lane]


# ---- aerocapture -----------------------------------------------------------------------------------------------------


@inline_njit
def _look_up(altitude, lane, air, constants):
    """ln of the mean density, and its variation, linear between the nodes of the field and held beyond."""
    cells, variation = air
    # Before the first node and behind the last there is a cell more.
    position = (altitude - constants.bottom) * constants.cells_per_metre + 1.0
    last = np.float64(cells.shape[0] - 1)
    inside = position if position > 0.0 else 0.0  # of NaN, too: there must be a cell to read
    inside = inside if inside < last else last
    cell = np.int32(inside)
    fraction = position - cell
    log_density = cells[cell, 0] + fraction * (cells[cell, 1] + fraction * (cells[cell, 2] + fraction * cells[cell, 3]))

    position = (altitude - constants.field_bottom) * constants.nodes_per_metre
    last = np.float64(variation.shape[0] - 1)
    position = position if position > 0.0 else 0.0
    position = position if position < last else last
    node = np.int32(position)
    node = node if node < variation.shape[0] - 1 else np.int32(variation.shape[0] - 2)
    fraction = position - node
    below = variation[node, lane]
    return log_density, below + fraction * (variation[node + 1, lane] - below)


@inline_njit
def _mean_density(log_density):
    log_density = LEAST_LOG_DENSITY if log_density < LEAST_LOG_DENSITY else log_density  # NaN stays NaN
    log_density = LARGEST_LOG_DENSITY if log_density > LARGEST_LOG_DENSITY else log_density
    return exponential(log_density)


@inline_njit
def _drift(half_index, state, noise, parameters, out):
    air, bank_cosine, looked_up, constants = parameters
    # Look-ups apart: they are no vector code, and would keep the rest from becoming it.
    for lane in range(LANES):
        looked_up[LOG_DENSITY, lane], looked_up[VARIATION, lane] = _look_up(
            state[RADIUS, lane] - constants.planet_radius, lane, air, constants
        )
    if half_index == 0:  # the step's start
        for lane in range(LANES):
            looked_up[FLOOR_COUNT, lane] += is_floored(looked_up[VARIATION, lane], constants.density_floor)
    for lane in range(LANES):
        sin_path, cos_path = sine_cosine(state[PATH_ANGLE, lane])
        density = _mean_density(looked_up[LOG_DENSITY, lane]) * density_factor(
            looked_up[VARIATION, lane], constants.density_floor
        )
        out[RADIUS, lane], out[SPEED, lane], out[PATH_ANGLE, lane] = planar_entry_rates_from_sines(
            state[RADIUS, lane],
            state[SPEED, lane],
            sin_path,
            cos_path,
            bank_cosine[0, lane],
            density,
            constants.drag_factor,
            constants.lift_factor,
            constants.gravitational_parameter,
        )


_advance = runge_kutta_4(_drift)


@njit(error_model="numpy")
def _sample_variations(density, seed, first_trial, variation):
    """Density variations of a group, variation (nodes, LANES), down from the top node, one normal a node."""
    bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
    normal_numbers = lane_array(NORMALS_PER_BLOCK)
    process = lane_array(1)
    top = variation.shape[0] - 1
    for lane in range(LANES):
        process[0, lane] = 0.0
    for number in range(top + 1):
        position, node = number % NORMALS_PER_BLOCK, top - number
        if position == 0:
            fill_normals(seed, FIELD_STREAM, first_trial, number // NORMALS_PER_BLOCK, bits, normal_numbers)
        keep = density.retention[node] if number > 0 else 0.0
        fresh = density.innovation_deviation[node] if number > 0 else density.top_deviation
        for lane in range(LANES):
            process[0, lane] = keep * process[0, lane] + fresh * normal_numbers[position, lane]
            variation[node, lane] = process[0, lane] + density.mean


@njit(error_model="numpy")
def _record(row, state, command, parameters, history, observed):
    air, _, looked_up, constants = parameters
    for lane in range(LANES):
        looked_up[LOG_DENSITY, lane], looked_up[VARIATION, lane] = _look_up(
            state[RADIUS, lane] - constants.planet_radius, lane, air, constants
        )
    for lane in range(LANES):
        met = looked_up[VARIATION, lane] if constants.actual_density else constants.variation_mean
        density = _mean_density(looked_up[LOG_DENSITY, lane]) * density_factor(met, constants.density_floor)
        history[row, ALTITUDE, lane] = state[RADIUS, lane] - constants.planet_radius
        history[row, VELOCITY, lane] = state[SPEED, lane]
        history[row, FLIGHT_PATH_ANGLE, lane] = state[PATH_ANGLE, lane]
        history[row, DENSITY_VARIATION, lane] = looked_up[VARIATION, lane]
        history[row, DYNAMIC_PRESSURE, lane] = 0.5 * density * state[SPEED, lane] * state[SPEED, lane]
        history[row, BANK_COSINE, lane] = command[lane]
        observed[row, 0, lane] = command[lane]
        observed[row, BANK_MAGNITUDE, lane] = abs(command[lane])


@inline_njit
def _finish(lane, state, looked_up, constants, final):
    final[ALTITUDE, lane] = state[RADIUS, lane] - constants.planet_radius
    final[VELOCITY, lane] = state[SPEED, lane]
    final[FLIGHT_PATH_ANGLE, lane] = state[PATH_ANGLE, lane]
    final[FLOORED, lane] = looked_up[FLOOR_COUNT, lane]


@njit(error_model="numpy")
def _fly_group(settings, density, law, schedule, seed, first_trial, initial_state, stored):
    """Fly LANES trials. initial_state: (3, LANES); `stored` is filled."""
    constants, (steps, time_step, every) = settings[0], schedule
    history, observed, largest, length, final = stored
    variation = np.full((len(density.retention) + 1, LANES), density.mean)
    if density.varied:
        _sample_variations(density, seed, first_trial, variation)
    air = (density.cells, variation)
    bank_cosine, looked_up = lane_array(1), lane_array(3)
    parameters = (air, bank_cosine, looked_up, constants)

    state = lane_array(STATES)
    for row in range(STATES):
        for lane in range(LANES):
            state[row, lane] = initial_state[row, lane]
    work = (lane_array(STATES), lane_array(STATES), lane_array(STATES))
    noise = lane_array(0)
    command, flying = np.empty(LANES), np.ones(LANES, np.bool_)
    deviation = np.empty((len(steps) * STATES, LANES))
    for lane in range(LANES):
        looked_up[FLOOR_COUNT, lane] = 0.0
    remaining, row = LANES, 0
    for interval in range(len(steps)):
        _command(interval, law, state, deviation, command)
        for lane in range(LANES):
            if flying[lane]:
                # np.maximum keeps NaN, so a trial that went wrong shows it.
                largest[0, lane] = np.maximum(largest[0, lane], command[lane])
                largest[BANK_MAGNITUDE, lane] = np.maximum(largest[BANK_MAGNITUDE, lane], abs(command[lane]))
            limited = constants.lower_limit if command[lane] < constants.lower_limit else command[lane]
            bank_cosine[0, lane] = constants.upper_limit if limited > constants.upper_limit else limited
        for step in range(steps[interval]):
            if step % every == 0:
                _record(row, state, command, parameters, history, observed)
                row += 1
            _advance(0, time_step, state, noise, parameters, work)
            for lane in range(LANES):
                if flying[lane] and state[RADIUS, lane] < constants.planet_radius:
                    _finish(lane, state, looked_up, constants, final)
                    length[lane] = row
                    flying[lane] = False
                    remaining -= 1
            if remaining == 0:
                return
    _record(row, state, command, parameters, history, observed)
    for lane in range(LANES):
        if flying[lane]:
            _finish(lane, state, looked_up, constants, final)


@inline_njit
def _lanes_of(stored, lanes):
    return Stored(
        stored.history[:, :, lanes],
        stored.observed[:, :, lanes],
        stored.largest[:, lanes],
        stored.length[lanes],
        stored.final[:, lanes],
    )


@njit(parallel=True, cache=True, error_model="numpy")
def _fly(settings, density, law, schedule, seed, first_trial, initial_state, stored):
    for group in prange(initial_state.shape[1] // LANES):
        lanes = slice(group * LANES, (group + 1) * LANES)
        first = first_trial + group * LANES
        _fly_group(settings, density, law, schedule, seed, first, initial_state[:, lanes], _lanes_of(stored, lanes))


def fly(settings, air, law, initial_states, *, time_step, seed, first_trial=0, varied=True, every=1) -> Trajectories:
    """Fly consecutive trials of the aerocapture (Eq. 71) to the end of the partition.

    settings: see `settings`. air: `AirTables`. law: `Law` of the bank cosine, of states radius (m), velocity
    (m/s) and flight path angle (rad). initial_states: (trials, 3). time_step: s, of the integration. seed, first_trial:
    key of the density variations and the number of the first trial. varied: False for the mean density. every:
    integration steps between stored states.

    Returns `Trajectories` with the times of `outputs`. Stored are altitude (m), velocity (m/s), flight path angle,
    relative density variation, dynamic pressure (Pa) and the bank cosine commanded for the interval that begins or goes
    on then, before its limits; observed are this bank cosine and its magnitude, with maxima over all intervals. The
    final state is the first three of these and the number of steps at whose start the density was at its floor.
    Outcomes: CRASHED below the ground, where a trial ends and after which nothing is stored (NaN); NON_FINITE.

    Raises ValueError for shapes that do not fit, grids that are not uniform, an interval that is no whole number of
    steps, or `every` that does not divide it.
    """
    schedule = Schedule(_interval_steps(law, every, time_step), float(time_step), int(every))
    law, states = _checked_law(law, STATES), _checked_states(initial_states, STATES)
    cells = uniform_cells(air.log_density, air.log_density_slope, air.spacing)
    density = Density(cells, *_checked_process(air), float(air.top_deviation), float(air.mean), varied)
    times = int(schedule.steps.sum()) // every + 1
    start = new_trajectories(states.T, times, OBSERVED)
    padded = start.final_state.shape[1]
    history, final = np.empty((times, HISTORY, padded)), np.empty((FINAL, padded))
    stored = Stored(history, start.observed, start.observed_maximum, start.length, final)
    _fly(settings, density, law, schedule, seed, first_trial, start.final_state, stored)
    trajectories = Trajectories(
        history, start.observed, start.observed_maximum, final, start.outcome, start.length
    ).first(len(states))
    trajectories.outcome[trajectories.final_state[ALTITUDE] < 0.0] = CRASHED
    trajectories.outcome[~_finite(trajectories)] = NON_FINITE
    ended = np.arange(times)[:, np.newaxis, np.newaxis] >= trajectories.length
    for stored in (trajectories.history, trajectories.observed):
        np.copyto(stored, np.nan, where=ended)
    return trajectories


def _finite(trajectories):
    """(trials,) bool: the trial's end and its commands are finite."""
    return np.isfinite(trajectories.final_state).all(axis=0) & np.isfinite(trajectories.observed_maximum).all(axis=0)


def propagate_nominal(settings, air, law, initial_state, *, time_step, every=1):
    """The flight through the mean density: time (k,), s, and states (k, 3), radius, velocity, flight path angle.

    law: `Law`, or its partition and control alone as a pair. initial_state: (3,). Other arguments as of `fly`. A flight
    that crashes is shorter than `outputs`: it ends with the first step below the ground.
    """
    law = law if isinstance(law, Law) else open_loop(*law)
    times = outputs(law, every, time_step)
    trajectories = fly(settings, air, law, [initial_state], time_step=time_step, seed=0, varied=False)
    time, states = outputs(law, 1, time_step), trajectories.history[:, : FLIGHT_PATH_ANGLE + 1, 0].copy()
    steps, crash = np.flatnonzero(np.isin(time, times)), int(trajectories.length[0])
    if crash < len(time):
        states[crash] = trajectories.final_state[: FLIGHT_PATH_ANGLE + 1, 0]
        steps = np.append(steps[steps < crash], crash)
    states[:, ALTITUDE] += settings["planet_radius"][0]
    return time[steps], states[steps]


# ---- double integrator -----------------------------------------------------------------------------------------------


@inline_njit
def _field_at(position, lane, field):
    """The field by cubic Hermite polynomials with finite-difference slopes, held constant beyond its grid."""
    value, slope, bottom, nodes_per_unit = field
    position = (position - bottom) * nodes_per_unit
    last = np.float64(value.shape[0] - 1)
    position = position if position > 0.0 else 0.0  # of NaN, too: there must be a node to read
    position = position if position < last else last
    node = np.int32(position)
    node = node if node < value.shape[0] - 1 else np.int32(value.shape[0] - 2)
    fraction = position - node
    rise = value[node + 1, lane] - value[node, lane]
    first, second = slope[node, lane], slope[node + 1, lane]
    curved = 3.0 * rise - 2.0 * first - second + fraction * (first + second - 2.0 * rise)
    return value[node, lane] + fraction * (first + fraction * curved)


@inline_njit
def _point_drift(half_index, state, noise, parameters, out):
    field, command = parameters
    for lane in range(LANES):
        out[POSITION, lane] = state[RATE, lane]
        out[RATE, lane] = command[lane] + _field_at(state[POSITION, lane], lane, field)


_advance_point = runge_kutta_4(_point_drift)


@njit(error_model="numpy")
def _sample_field(root, seed, first_trial, value, slope):
    """Samples root z of a group and their slopes per cell, value and slope (nodes, LANES).

    The sum runs in the order of the normals: matrix products of the library depend on how many trials are multiplied.
    """
    nodes, count = root.shape
    blocks = -(-count // NORMALS_PER_BLOCK)
    bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
    normal_numbers = np.empty((blocks * NORMALS_PER_BLOCK, LANES))
    for block in range(blocks):
        four = normal_numbers[block * NORMALS_PER_BLOCK : (block + 1) * NORMALS_PER_BLOCK]
        fill_normals(seed, FIELD_STREAM, first_trial, block, bits, four)
    total = lane_array(1)
    for node in range(nodes):
        for lane in range(LANES):
            total[0, lane] = 0.0
        for number in range(count):
            factor = root[node, number]
            for lane in range(LANES):
                total[0, lane] += factor * normal_numbers[number, lane]
        for lane in range(LANES):
            value[node, lane] = total[0, lane]
    for node in range(nodes):
        before, after = max(node - 1, 0), min(node + 1, nodes - 1)
        for lane in range(LANES):
            slope[node, lane] = (value[after, lane] - value[before, lane]) / (after - before)


@njit(error_model="numpy")
def _record_point(row, state, parameters, history, observed):
    field, command = parameters
    for lane in range(LANES):
        history[row, POSITION, lane] = state[POSITION, lane]
        history[row, RATE, lane] = state[RATE, lane]
        history[row, FIELD, lane] = _field_at(state[POSITION, lane], lane, field)
        history[row, CONTROL, lane] = command[lane]
        observed[row, 0, lane] = command[lane]


@njit(error_model="numpy")
def _fly_points(force, law, schedule, seed, first_trial, stored):
    """Fly LANES trials; `stored` is filled, its final states are the initial ones before."""
    bottom, nodes_per_unit, root, mean, varied = force
    steps, time_step, every = schedule
    history, observed, largest, _, final = stored
    value, slope = np.zeros((len(root), LANES)), np.zeros((len(root), LANES))
    if varied:
        _sample_field(root, seed, first_trial, value, slope)
    for node in range(len(root)):
        for lane in range(LANES):
            value[node, lane] += mean
    command = np.empty(LANES)
    parameters = ((value, slope, bottom, nodes_per_unit), command)
    state, noise = lane_array(POINT_STATES), lane_array(0)
    work = (lane_array(POINT_STATES), lane_array(POINT_STATES), lane_array(POINT_STATES))
    deviation = np.empty((len(steps) * POINT_STATES, LANES))
    for component in range(POINT_STATES):
        for lane in range(LANES):
            state[component, lane] = final[component, lane]
    row = 0
    for interval in range(len(steps)):
        _command(interval, law, state, deviation, command)
        for lane in range(LANES):
            largest[0, lane] = np.maximum(largest[0, lane], command[lane])
        for step in range(steps[interval]):
            if step % every == 0:
                _record_point(row, state, parameters, history, observed)
                row += 1
            _advance_point(0, time_step, state, noise, parameters, work)
    _record_point(row, state, parameters, history, observed)
    for component in range(POINT_STATES):
        for lane in range(LANES):
            final[component, lane] = state[component, lane]


@njit(parallel=True, cache=True, error_model="numpy")
def _fly_double_integrator(force, law, schedule, seed, first_trial, stored):
    for group in prange(stored.final.shape[1] // LANES):
        lanes = slice(group * LANES, (group + 1) * LANES)
        _fly_points(force, law, schedule, seed, first_trial + group * LANES, _lanes_of(stored, lanes))


def fly_double_integrator(
    law, field_grid, field_root, initial_states, *, time_step, seed, first_trial=0, every=1, varied=True, mean=0.0
) -> Trajectories:
    """Fly consecutive trials of the double integrator (Eq. 57), r' = v, v' = u + Psi(r), to the end of the partition.

    law: `Law` of states r and v. field_grid: uniform positions, (nodes,). field_root: (nodes, normals), a root of the
    field's covariance on the grid; a sample is the root times standard normals and the mean. initial_states: (trials,
    2). Other arguments as of `fly`. The control is not limited.

    Returns `Trajectories` with the times of `outputs`: stored are position, rate, field at the position and control,
    observed is the control, the final state is position and rate. Outcome: NON_FINITE.

    Raises ValueError as `fly`.
    """
    schedule = Schedule(_interval_steps(law, every, time_step), float(time_step), int(every))
    law, states = _checked_law(law, POINT_STATES), _checked_states(initial_states, POINT_STATES)
    spacing = _uniform_spacing(field_grid, "field_grid")
    root = np.array(field_root, dtype=float, order="C")
    if root.ndim != 2 or len(root) != len(field_grid):
        raise ValueError(f"field_root must have a row per node, shape ({len(field_grid)}, normals), got {root.shape}")
    times = int(schedule.steps.sum()) // every + 1
    start = new_trajectories(states.T, times, 1)
    history = np.empty((times, POINT_HISTORY, start.final_state.shape[1]))
    force = Force(float(field_grid[0]), 1.0 / spacing, root, float(mean), varied)
    stored = Stored(history, start.observed, start.observed_maximum, start.length, start.final_state)
    _fly_double_integrator(force, law, schedule, seed, first_trial, stored)
    trajectories = Trajectories(
        history, start.observed, start.observed_maximum, start.final_state, start.outcome, start.length
    ).first(len(states))
    trajectories.outcome[~_finite(trajectories)] = NON_FINITE
    return trajectories
