"""Closed-loop flights through samples of the random field: aerocapture (Eq. 71) and the double integrator (Eq. 57).

Both are steered by the law of Eq. 8, whose control is constant on the intervals of a partition and answers the states
at all nodes so far.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from marsedl.elementary import clip, exponential
from marsedl.models.atmosphere import log_density_in_cells, node_below, uniform_cells
from marsedl.models.density_variation import density_factor, is_floored
from marsedl.models.dynamics.planar_entry import planar_entry_rates
from marsedl.montecarlo.ensembles import Trajectories, pad_to_groups
from marsedl.montecarlo.flights import Flight, Nothing, Schedule
from marsedl.montecarlo.lanes import LANES, lane_array
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE, NOTHING
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, fill_normals
from marsedl.papers.random_field import environment
from marsedl.papers.random_field.components import ALTITUDE, FLIGHT_PATH_ANGLE
from marsedl.papers.random_field.inputs import Inputs

INITIAL_STREAM, FIELD_STREAM = 0, 1


class Law(NamedTuple):
    """The law of Eq. 8: u_k = V_k + sum over l <= k of K_kl (x_l - xbar_l), constant from one node to the next."""

    start: np.ndarray  # (N + 1,), s, the partition, its end included
    control: np.ndarray  # (N,), V
    gain: np.ndarray  # (N, N + 1, n), K; what answers later states, l > k, is not used
    reference: np.ndarray  # (N + 1, n), xbar


class Settings(NamedTuple):
    """Constants of an aerocapture, SI."""

    gravitational_parameter: float
    planet_radius: float
    drag_factor: float
    lift_factor: float
    bottom: float  # of the mean density's nodes
    cells_per_metre: float
    field_bottom: float  # of the variation's nodes
    nodes_per_metre: float
    density_floor: float
    variation_mean: float
    lower_limit: float  # of the bank cosine
    upper_limit: float
    actual_density: int  # whether the dynamic pressure is that of the density met, or of its mean


class Tables(NamedTuple):
    """The density on uniform grids of altitudes."""

    cells: np.ndarray  # see `uniform_cells`: ln of the mean density
    retention: np.ndarray  # (nodes,), what the variation keeps of that at the next node, 0 at the last
    innovation: np.ndarray  # (nodes,), standard deviation of the rest


Parameters = NamedTuple("Parameters", [*Settings.__annotations__.items(), *Tables.__annotations__.items()])


class Plant(NamedTuple):
    """What flies an aerocapture, and through which air."""

    settings: Settings
    air: environment.AirTables


# ---- set-up ----------------------------------------------------------------------------------------------------------


def settings(given: Inputs, tables) -> Settings:
    """The constants of an aerocapture by name."""
    drag_factor = 0.5 / given.vehicle.ballistic_coefficient
    return Settings(
        gravitational_parameter=given.planet.gravitational_parameter,
        planet_radius=given.planet.planet_radius,
        drag_factor=drag_factor,
        lift_factor=given.vehicle.lift_to_drag * drag_factor,
        bottom=tables.bottom,
        cells_per_metre=1.0 / tables.spacing,
        field_bottom=tables.altitude[0],
        nodes_per_metre=_nodes_per_unit(tables.altitude),
        density_floor=given.air.density_floor,
        variation_mean=tables.mean,
        lower_limit=given.vehicle.control_limits[0],
        upper_limit=given.vehicle.control_limits[1],
        actual_density=int(given.simulation.dynamic_pressure_density == "actual"),
    )


def plant_of(given: Inputs) -> Plant:
    """Return the plant of the reading."""
    tables = environment.air_tables(given.air)
    return Plant(settings(given, tables), tables)


def open_loop(start, control, states=3) -> Law:
    """The law without feedback: V alone on the partition `start`."""
    start, control = np.asarray(start, dtype=float), np.asarray(control, dtype=float)
    return Law(start, control, np.zeros((len(control), len(start), states)), np.zeros((len(start), states)))


def schedule(law, every, time_step) -> Schedule:
    """The guidance periods of a law, the intervals of its partition; a state is stored every `every` steps from a node.

    Intervals are whole numbers of `every` steps.
    """
    steps = np.rint(np.diff(law.start) / time_step).astype(np.int64)
    return Schedule(law.start, np.full(len(steps), float(time_step)), steps, int(every))


def outputs(law, every, time_step):
    """Times of the stored states, s: every `every` steps from each node of the partition on, and its end."""
    return schedule(law, every, time_step).times


def _nodes_per_unit(grid):
    """Of a uniform grid."""
    return 1.0 / ((grid[-1] - grid[0]) / (len(grid) - 1))


# ---- aerocapture: the model of one trial -----------------------------------------------------------------------------


class State(NamedTuple):
    """What is integrated, SI and rad."""

    radius: float
    velocity: float
    path_angle: float


class Density(NamedTuple):
    """ln of the mean density (kg/m^3), and its relative variation."""

    log_mean: float
    variation: float


class Variation(NamedTuple):
    """The variation's random part while it is drawn."""

    process: float


class Bank(NamedTuple):
    """Bank cosine, before its limits and within them."""

    commanded: float
    flown: float


class Watched(NamedTuple):
    """Largest command and magnitude of it; steps at whose start the density was at its floor."""

    command: float = -np.inf
    magnitude: float = -np.inf
    floored: float = 0.0


class Observed(NamedTuple):
    """The bank cosine commanded, and its magnitude."""

    command: float
    magnitude: float


class Row(NamedTuple):
    """What is stored over time, SI and rad."""

    altitude: float
    velocity: float
    path_angle: float
    variation: float
    dynamic_pressure: float
    bank_cosine: float


class Final(NamedTuple):
    """The end of a flight, SI and rad, and the number of steps at whose start the density was at its floor."""

    altitude: float
    velocity: float
    path_angle: float
    floored: float


def vary(node, normal, drawn, p) -> tuple[float, Variation]:
    """Density variations, down from the top node."""
    process = p.retention[node] * drawn.process + p.innovation[node] * normal
    return process + p.variation_mean, Variation(process)


def look_up(state, air, p) -> Density:
    """ln of the mean density, and its variation, linear between the nodes of the field and held beyond."""
    altitude = state.radius - p.planet_radius
    log_mean = log_density_in_cells(altitude, p.bottom, p.cells_per_metre, p.cells)
    node, fraction = node_below((altitude - p.field_bottom) * p.nodes_per_metre, air.shape[0])
    return Density(log_mean, air[node] + fraction * (air[node + 1] - air[node]))


def rates(state, found, command, p) -> State:
    """Eq. 71 in the density of Eq. 72."""
    density = exponential(found.log_mean) * density_factor(found.variation, p.density_floor)
    return State(
        *planar_entry_rates(
            state.radius,
            state.velocity,
            state.path_angle,
            command.flown,
            density,
            p.drag_factor,
            p.lift_factor,
            p.gravitational_parameter,
        )
    )


def _control(cycle, past, law):
    """Control of Eq. 8 at the start of an interval, from the deviations at all nodes so far, n a node."""
    states = law.reference.shape[1]
    control = law.control[cycle]
    for node in range(cycle + 1):
        for row in range(states):
            control += law.gain[cycle, node, row] * past[node * states + row]
    return control


def guide(cycle, state, past, law, p) -> tuple[Bank, Nothing]:
    """Bank cosine of an interval (Eq. 8), within its limits; keeps the deviation for later ones."""
    past[3 * cycle] = state.radius - law.reference[cycle, 0]
    past[3 * cycle + 1] = state.velocity - law.reference[cycle, 1]
    past[3 * cycle + 2] = state.path_angle - law.reference[cycle, 2]
    command = _control(cycle, past, law)
    return Bank(command, clip(command, p.lower_limit, p.upper_limit)), ()


def ended(state, p) -> bool:
    """Whether the trial is below the ground."""
    return state.radius < p.planet_radius


def watch(watched, ending, found, command, p) -> Watched:
    """Largest commands, and the steps at whose start the density was at its floor."""
    # np.maximum keeps NaN, so a trial that went wrong shows it.
    return Watched(
        np.maximum(watched.command, command.commanded),
        np.maximum(watched.magnitude, abs(command.commanded)),
        watched.floored + (0.0 if ending > 0.0 else 1.0 * is_floored(found.variation, p.density_floor)),
    )


def observe(command) -> Observed:
    """The command of the interval that begins or goes on."""
    return Observed(command.commanded, abs(command.commanded))


def store(state, found, command, p) -> Row:
    """The history; see `fly`."""
    met = found.variation if p.actual_density else p.variation_mean
    density = exponential(found.log_mean) * density_factor(met, p.density_floor)
    pressure = 0.5 * density * state.velocity * state.velocity
    altitude = state.radius - p.planet_radius
    return Row(altitude, state.velocity, state.path_angle, found.variation, pressure, command.commanded)


def finish(state, watched, p) -> Final:
    """The end of a flight; see `fly`."""
    return Final(state.radius - p.planet_radius, state.velocity, state.path_angle, watched.floored)


AEROCAPTURE = Flight(
    rates,
    look_up=look_up,
    vary=vary,
    guide=guide,
    ended=ended,
    watch=watch,
    watch_steps=True,
    store=store,
    observe=observe,
    finish=finish,
)


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

    Raises ValueError for states that are not finite.
    """
    tables = Tables(
        uniform_cells(air.log_density, air.log_density_slope, air.spacing),
        np.append(air.retention, 0.0),
        np.append(air.innovation_deviation, air.top_deviation),
    )
    nodes = len(air.altitude)
    trajectories = AEROCAPTURE.fly(
        Parameters(*settings, *tables),
        schedule(law, every, time_step),
        State(*np.transpose(initial_states)),
        law=law,
        seed=seed,
        first_trial=first_trial,
        nodes=nodes,
        air=None if varied else np.full((nodes, len(initial_states)), air.mean),
        streams=(INITIAL_STREAM, FIELD_STREAM),
        past=3 * len(law.control),
    )
    trajectories = replace(trajectories, observed_maximum=trajectories.observed_maximum[:2])
    trajectories.outcome[trajectories.ended != NOTHING] = CRASHED
    trajectories.outcome[~trajectories.finite] = NON_FINITE
    return trajectories.cleared()


def propagate_nominal(settings, air, law, initial_state, *, time_step, every=1):
    """The flight through the mean density: time (k,), s, and states (k, 3), radius, velocity, flight path angle.

    initial_state: (3,). Other arguments as of `fly`. A flight that crashes is shorter than `outputs`: it ends with the
    first step below the ground.
    """
    times = outputs(law, every, time_step)
    trajectories = fly(settings, air, law, [initial_state], time_step=time_step, seed=0, varied=False)
    time, states = outputs(law, 1, time_step), trajectories.history[:, : FLIGHT_PATH_ANGLE + 1, 0].copy()
    steps, crash = np.flatnonzero(np.isin(time, times)), int(trajectories.length[0])
    if crash < len(time):
        states[crash] = trajectories.final_state[: FLIGHT_PATH_ANGLE + 1, 0]
        steps = np.append(steps[steps < crash], crash)
    states[:, ALTITUDE] += settings.planet_radius
    return time[steps], states[steps]


# ---- double integrator: the model of one trial -----------------------------------------------------------------------


class Point(NamedTuple):
    """What is integrated."""

    position: float
    rate: float


class Force(NamedTuple):
    """The field on a uniform grid of positions."""

    bottom: float  # position of the first node
    nodes_per_unit: float
    mean: float


class Field(NamedTuple):
    """The field at the position."""

    value: float


class Control(NamedTuple):
    """The control of an interval."""

    value: float


class PointRow(NamedTuple):
    """What is stored over time."""

    position: float
    rate: float
    field: float
    control: float


class LargestControl(NamedTuple):
    """Largest control of all intervals."""

    control: float = -np.inf


def field_at(state, air, p) -> Field:
    """The field by cubic Hermite polynomials with finite-difference slopes, held constant beyond its grid."""
    last = air.shape[0] - 1
    node, fraction = node_below((state.position - p.bottom) * p.nodes_per_unit, air.shape[0])
    value, following = air[node], air[node + 1]
    # Slopes per cell, one-sided at both ends of the grid.
    first = (following - air[max(node - 1, 0)]) * (0.5 if node > 0 else 1.0)
    second = (air[min(node + 2, last)] - value) * (0.5 if node + 1 < last else 1.0)
    value, following = value + p.mean, following + p.mean
    rise = following - value
    curved = 3.0 * rise - 2.0 * first - second + fraction * (first + second - 2.0 * rise)
    return Field(value + fraction * (first + fraction * curved))


def point_rates(state, found, command) -> Point:
    """Eq. 57."""
    return Point(state.rate, command.value + found.value)


def guide_point(cycle, state, past, law) -> tuple[Control, Nothing]:
    """Control of an interval (Eq. 8); keeps the deviation for later ones."""
    past[2 * cycle] = state.position - law.reference[cycle, 0]
    past[2 * cycle + 1] = state.rate - law.reference[cycle, 1]
    return Control(_control(cycle, past, law)), ()


def watch_point(watched, command) -> LargestControl:
    """Largest control."""
    return LargestControl(np.maximum(watched.control, command.value))


def observe_point(command) -> Control:
    """The control of the interval that begins or goes on."""
    return command


def store_point(state, found, command) -> PointRow:
    """The history; see `fly_double_integrator`."""
    return PointRow(state.position, state.rate, found.value, command.value)


DOUBLE_INTEGRATOR = Flight(
    point_rates, look_up=field_at, guide=guide_point, watch=watch_point, store=store_point, observe=observe_point
)


@njit(error_model="numpy", cache=True)
def _sample_fields(root, seed, first_trial, fields):
    """Samples root z of the field for whole groups of trials, into fields, (nodes, trials).

    The sum runs in the order of the normals: matrix products of the library depend on how many trials are multiplied.
    """
    nodes, count = root.shape
    bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
    drawn, total = lane_array(-(-count // NORMALS_PER_BLOCK) * NORMALS_PER_BLOCK), lane_array(1)
    for first in range(0, fields.shape[1], LANES):
        for number in range(0, count, NORMALS_PER_BLOCK):
            block = drawn[number : number + NORMALS_PER_BLOCK]
            fill_normals(seed, FIELD_STREAM, first_trial + first, number // NORMALS_PER_BLOCK, bits, block)
        for node in range(nodes):
            for lane in range(LANES):
                total[0, lane] = 0.0
            for number in range(count):
                for lane in range(LANES):
                    total[0, lane] += root[node, number] * drawn[number, lane]
            for lane in range(LANES):
                fields[node, first + lane] = total[0, lane]


def fly_double_integrator(
    law, field_grid, field_root, initial_states, *, time_step, seed, first_trial=0, every=1, varied=True, mean=0.0
) -> Trajectories:
    """Fly consecutive trials of the double integrator (Eq. 57), r' = v, v' = u + Psi(r), to the end of the partition.

    law: `Law` of states r and v. field_grid: uniform positions, (nodes,). field_root: (nodes, normals), a root of the
    field's covariance on the grid; a sample is the root times standard normals and the mean. initial_states: (trials,
    2). Other arguments as of `fly`. The control is not limited.

    Returns `Trajectories` with the times of `outputs`: stored are position, rate, field at the position and control,
    observed is the control, the final state is position and rate. Outcome: NON_FINITE.
    """
    start = pad_to_groups(initial_states.T)
    fields = np.zeros((len(field_root), start.shape[1]))
    if varied:
        _sample_fields(np.ascontiguousarray(field_root), seed, first_trial, fields)
    trajectories = DOUBLE_INTEGRATOR.fly(
        Force(field_grid[0], _nodes_per_unit(field_grid), mean),
        schedule(law, every, time_step),
        Point(*start),
        law=law,
        air=fields,
        past=2 * len(law.control),
    ).first(len(initial_states))
    trajectories.outcome[~trajectories.finite] = NON_FINITE
    return trajectories
