"""Closed-loop entry flights: Eqs. 1 under bank commands of one guidance period each (Secs. III and V, Appendix D)."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from marsedl.methods.guidance.bank_profile import ramped_bank_cosine
from marsedl.methods.guidance.lateral import (
    CORRECTED,
    PRINTED,
    bank_direction,
    deadband,
    heading_alignment_limit,
    heading_alignment_ratio,
    limited_heading_alignment,
    rate_limited_bank,
    rate_limited_bank_as_printed,
)
from marsedl.methods.guidance.targeting import target_direction_from_sines
from marsedl.models.density_variation import density_factor, is_floored
from marsedl.models.dynamics.entry import entry_rates_from_sines
from marsedl.montecarlo.elementary import arc_cosine, arctangent, exponential, sine_cosine
from marsedl.montecarlo.ensembles import Trajectories, pad_to_groups
from marsedl.montecarlo.integrators import runge_kutta_4
from marsedl.montecarlo.lanes import LANES, inline_njit, lane_array
from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, ESCAPED, NON_FINITE
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, fill_normals, normals, uniforms
from marsedl.papers.stochastic_entry import environment
from marsedl.papers.stochastic_entry.dispersions import (
    AERODYNAMICS_STREAM,
    AZIMUTH,
    DENSITY_STREAM,
    ENTRY_STREAM,
    LATITUDE,
    LONGITUDE,
    PATH_ANGLE,
    RADIUS,
    SPEED,
    Dispersions,
    dispersions_of,
    factors,
)
from marsedl.papers.stochastic_entry.inputs import Air, Guidance, Mission, Planet, Vehicle
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    BANK,
    BANK_CHANGE,
    BANK_COSINE,
    CROSSRANGE,
    END_TIME,
    FINAL,
    HISTORY,
    NEGATIVE_DENSITIES,
    OBSERVED,
    REVERSALS,
    VELOCITY,
)

STATES = 6  # that are integrated
PLACE = (LONGITUDE, LATITUDE, AZIMUTH)  # of them, which only the nominal stores, behind the history
SINE, COSINE, DRAG_FACTOR, LIFT_FACTOR = range(4)  # of the bank angle; of the vehicle

# What a law feeds back.
DRAG, ALTITUDE_RATE = 5, 6  # behind radius, velocity, flight path angle, downrange and density
FEATURES = 7
SIGHTED_CROSSRANGE, DOWNRANGE_ANGLE, CROSSRANGE_ANGLE = range(3)  # of the target: m, rad, rad
SIGHTED = 3
# What the guidance of a trial remembers, and whether it still flies.
DIRECTION, COMMAND, COMMAND_BEFORE, COMMAND_COSINE, FLOWN_BANK, FLOWN_CHANGE, ALIGNING, FLYING, ELAPSED = range(9)
STEERED = 9  # the last: guidance periods from the command before to the next one
NOMINAL, BY_VELOCITY, BY_TIME = range(3)

HEADING_FORMS = {"corrected": CORRECTED, "printed": PRINTED}
TRIGGER_TOLERANCE = 1e-11  # m/s, by which the velocity may miss the trigger at the end of a flight
TRIGGER_ITERATIONS = 60  # more than the few that a smooth flight needs

_NUMBERS = (
    *("gravitational_parameter", "rotation_rate", "planet_radius", "target_longitude", "sin_target_latitude"),
    "cos_target_latitude",
    *("heading_sign", "bottom", "nodes_per_metre", "period", "largest_bank_change"),
    *("fast_velocity", "slow_velocity", "fast_cosine", "slow_cosine"),
    *("deadband_start", "deadband_start_width", "deadband_end", "deadband_end_width", "initial_direction"),
    *("alignment_velocity", "alignment_gain", "alignment_limit_velocity", "alignment_first_limit"),
    *("alignment_last_limit", "end_velocity"),
)
_SETTINGS = np.dtype([(name, "f8") for name in _NUMBERS] + [("alignment_form", "i8"), ("limit_as_printed", "i8")])


class Law(NamedTuple):
    """A range-control law: bank cosine u = u_ref + gain (y - y_ref), tabulated against velocity or time.

    y holds radius, velocity, flight path angle, downrange, density, drag acceleration and altitude rate. Against
    velocity, u_ref is the nominal profile and the table is interpolated; against time, row k holds from k guidance
    periods on, and the last row for ever.
    """

    kind: int  # NOMINAL, BY_VELOCITY or BY_TIME
    velocity: np.ndarray  # (rows,), m/s, ascending; of BY_VELOCITY
    gain: np.ndarray  # (rows, FEATURES)
    reference: np.ndarray  # (rows, FEATURES)
    bank_cosine: np.ndarray  # (rows,), u_ref of BY_TIME
    least_drag: float  # m/s^2, below which BY_VELOCITY does not correct
    ends_within: bool = False  # whether heading alignment begins with the next integration step, not the next period


class Schedule(NamedTuple):
    """When a flight is steered, integrated and stored."""

    velocity_trigger: bool  # else it ends at end_time
    end_time: float  # s; of the velocity trigger: the time limit
    cycles: int  # guidance periods
    substeps: int  # integration steps in one
    every: int  # integration steps between stored states


class Tables(NamedTuple):
    """The atmosphere as the kernel reads it, on a uniform grid of altitudes."""

    log_density: np.ndarray  # (nodes,), of kg/m^3, mean
    log_step: np.ndarray  # (nodes,), its rise to the next node
    deviation: np.ndarray  # (nodes,), standard deviation of the relative density variation
    log_retention: np.ndarray  # (nodes - 1,), logarithm of the variation's correlation between neighbouring nodes


class Group(NamedTuple):
    """Results of some trials, which the kernel fills."""

    history: np.ndarray  # (times, HISTORY, trials), or with len(PLACE) more rows
    observed: np.ndarray  # (times, OBSERVED, trials)
    largest: np.ndarray  # (OBSERVED, trials)
    length: np.ndarray  # (trials,)
    final: np.ndarray  # (FINAL, trials)


NOMINAL_LAW = Law(NOMINAL, np.zeros(2), np.zeros((2, FEATURES)), np.zeros((2, FEATURES)), np.zeros(2), 0.0)


class Vehicles(NamedTuple):
    """The dispersed vehicles of some trials."""

    entry_state: np.ndarray  # (trials, 6): radius, longitude, latitude, velocity, path angle, azimuth
    drag_factor: np.ndarray  # (trials,), A C_D / (2 m), m^2/kg
    lift_factor: np.ndarray  # (trials,), A C_L / (2 m), m^2/kg


class Plant(NamedTuple):
    """What the trials of a reading fly in and with."""

    settings: np.ndarray  # see `settings`
    atmosphere: environment.Atmosphere
    dispersions: Dispersions


# ---- set-up ----------------------------------------------------------------------------------------------------------


def settings(planet: Planet, mission: Mission, guidance: Guidance, atmosphere):
    """The constants of a flight as a record that compiled code reads by name."""
    values = {
        "gravitational_parameter": planet.gravitational_parameter,
        "rotation_rate": planet.rotation_rate,
        "planet_radius": planet.planet_radius,
        "target_longitude": mission.target_longitude,
        "sin_target_latitude": np.sin(mission.target_latitude),
        "cos_target_latitude": np.cos(mission.target_latitude),
        "heading_sign": 1.0 if planet.heading_rate_form == "corrected" else -1.0,
        "bottom": atmosphere.altitude[0],
        "nodes_per_metre": (len(atmosphere.altitude) - 1) / (atmosphere.altitude[-1] - atmosphere.altitude[0]),
        "period": guidance.guidance_period,
        "largest_bank_change": guidance.bank_rate_limit * guidance.guidance_period,
        "fast_velocity": guidance.ramp_velocities[0],
        "slow_velocity": guidance.ramp_velocities[1],
        "fast_cosine": np.cos(guidance.nominal_bank_fast),
        "slow_cosine": np.cos(guidance.nominal_bank_slow),
        "deadband_start": guidance.deadband_times[0],
        "deadband_start_width": guidance.deadband_widths[0],
        "deadband_end": guidance.deadband_times[1],
        "deadband_end_width": guidance.deadband_widths[1],
        "initial_direction": guidance.initial_bank_direction,
        "alignment_velocity": guidance.heading_alignment_velocity,
        "alignment_gain": guidance.heading_alignment_gain,
        "alignment_limit_velocity": guidance.heading_alignment_limit_velocity,
        "alignment_first_limit": guidance.heading_alignment_limits[0],
        "alignment_last_limit": guidance.heading_alignment_limits[1],
        "end_velocity": mission.end_velocity,
        "alignment_form": HEADING_FORMS[guidance.heading_alignment_form],
        "limit_as_printed": int(guidance.rate_limit_form == "printed"),
    }
    return np.array([tuple(values[name] for name in _SETTINGS.names)], dtype=_SETTINGS)


def plant_of(planet: Planet, air: Air, vehicle: Vehicle, mission: Mission, guidance: Guidance) -> Plant:
    """Return what the trials of a reading fly in and with."""
    atmosphere = environment.atmosphere(air)
    constants = settings(planet, mission, guidance, atmosphere)
    return Plant(constants, atmosphere, dispersions_of(planet, vehicle, mission))


def vehicles_of(dispersions: Dispersions, seed, trials) -> Vehicles:
    """The dispersed entry states and aerodynamics of the given trials (Tables 2 and 3)."""
    normal = normals(seed, ENTRY_STREAM, trials, STATES)
    states = dispersions.entry_mean + normal * dispersions.entry_deviations
    error = 2.0 * uniforms(seed, AERODYNAMICS_STREAM, trials, 1)[:, 0] - 1.0
    return Vehicles(states, *factors(dispersions.body, dispersions.drag_error * error, dispersions.lift_error * error))


# ---- the kernel ------------------------------------------------------------------------------------------------------


@inline_njit
def _look_up(altitude, lane, air, constants):
    """ln of the mean density and the factor of its variation at an altitude, linear between the nodes, held beyond."""
    log_density, log_step, factor = air
    position = (altitude - constants.bottom) * constants.nodes_per_metre
    last = np.float64(log_density.shape[0] - 1)
    position = position if position > 0.0 else 0.0  # of NaN, too: there must be a node to read
    position = position if position < last else last
    node = np.int32(position)
    node = node if node < log_density.shape[0] - 1 else np.int32(log_density.shape[0] - 2)
    fraction = position - node
    below = factor[node, lane]
    return log_density[node] + fraction * log_step[node], below + fraction * (factor[node + 1, lane] - below)


@inline_njit
def _rates(lane, radius, latitude, velocity, flight_path_angle, azimuth, log_density, factor, parameters):
    _, aero, _, constants = parameters
    return entry_rates_from_sines(
        radius,
        velocity,
        sine_cosine(latitude),
        sine_cosine(flight_path_angle),
        sine_cosine(azimuth),
        (aero[SINE, lane], aero[COSINE, lane]),
        exponential(log_density) * factor,
        (aero[DRAG_FACTOR, lane], aero[LIFT_FACTOR, lane]),
        (constants.gravitational_parameter, constants.rotation_rate),
        constants.heading_sign,
    )


@inline_njit
def _drift(half_index, state, noise, parameters, out):
    air, _, local, constants = parameters
    # Look-ups apart: they are no vector code, and would keep the rest from becoming it.
    for lane in range(LANES):
        local[0, lane], local[1, lane] = _look_up(state[RADIUS, lane] - constants.planet_radius, lane, air, constants)
    for lane in range(LANES):
        (
            out[RADIUS, lane],
            out[LONGITUDE, lane],
            out[LATITUDE, lane],
            out[SPEED, lane],
            out[PATH_ANGLE, lane],
            out[AZIMUTH, lane],
        ) = _rates(
            lane,
            state[RADIUS, lane],
            state[LATITUDE, lane],
            state[SPEED, lane],
            state[PATH_ANGLE, lane],
            state[AZIMUTH, lane],
            local[0, lane],
            local[1, lane],
            parameters,
        )


_advance = runge_kutta_4(_drift)


@njit(error_model="numpy")
def _step_lane(step, lane, start, parameters, end):
    """One Runge-Kutta step of a single lane; start, end: (6,)."""
    air, _, _, constants = parameters
    slope = np.zeros(STATES)
    for stage in range(4):
        ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        radius = start[RADIUS] + ahead * step * slope[RADIUS]
        log_density, factor = _look_up(radius - constants.planet_radius, lane, air, constants)
        rates = _rates(
            lane,
            radius,
            start[LATITUDE] + ahead * step * slope[LATITUDE],
            start[SPEED] + ahead * step * slope[SPEED],
            start[PATH_ANGLE] + ahead * step * slope[PATH_ANGLE],
            start[AZIMUTH] + ahead * step * slope[AZIMUTH],
            log_density,
            factor,
            parameters,
        )
        weight = step / 6.0 if stage in (0, 3) else step / 3.0
        for row in range(STATES):
            end[row] = (start[row] if stage == 0 else end[row]) + weight * rates[row]
            slope[row] = rates[row]


@njit(error_model="numpy")
def _to_trigger(step, lane, start, parameters, end_velocity, end):
    """Fly the part of a step after which the velocity is the trigger's; returns it. start, end: (6,), end filled.

    Regula falsi between both ends of the step, where an end that is kept twice counts half (Illinois, Dowell and
    Jarratt 1971). end holds the state at the end of the whole step before.
    """
    lower, upper = 0.0, step
    above, below = start[SPEED] - end_velocity, end[SPEED] - end_velocity
    part, last_side = upper, 0
    if above <= 0.0:  # it began below the trigger
        _step_lane(0.0, lane, start, parameters, end)
        return 0.0
    for _ in range(TRIGGER_ITERATIONS):
        part = (lower * below - upper * above) / (below - above)
        _step_lane(part, lane, start, parameters, end)
        excess = end[SPEED] - end_velocity
        if abs(excess) <= TRIGGER_TOLERANCE:
            break
        if excess > 0.0:
            below = 0.5 * below if last_side > 0 else below
            lower, above, last_side = part, excess, 1
        else:
            above = 0.5 * above if last_side < 0 else above
            upper, below, last_side = part, excess, -1
    return part


@inline_njit
def _observe(state, parameters, feature, sight):
    """What laws feed back, feature (FEATURES, LANES), and where the target is, sight (SIGHTED, LANES)."""
    air, aero, local, constants = parameters
    for lane in range(LANES):
        local[0, lane], local[1, lane] = _look_up(state[RADIUS, lane] - constants.planet_radius, lane, air, constants)
    for lane in range(LANES):
        radius, velocity = state[RADIUS, lane], state[SPEED, lane]
        sin_path, cos_path = sine_cosine(state[PATH_ANGLE, lane])
        downrange, crossrange, ahead = target_direction_from_sines(
            radius,
            velocity,
            sine_cosine(state[LATITUDE, lane]),
            sine_cosine(constants.target_longitude - state[LONGITUDE, lane]),
            cos_path,
            sine_cosine(state[AZIMUTH, lane]),
            constants.rotation_rate,
            (constants.sin_target_latitude, constants.cos_target_latitude),
        )
        distance, crossrange_angle = arctangent(*downrange), arctangent(*crossrange)
        downrange_angle = -distance if ahead < 0.0 else distance
        density = exponential(local[0, lane]) * local[1, lane]
        feature[0, lane], feature[1, lane], feature[2, lane] = radius, velocity, state[PATH_ANGLE, lane]
        feature[3, lane], feature[4, lane] = -constants.planet_radius * downrange_angle, density
        feature[DRAG, lane] = aero[DRAG_FACTOR, lane] * density * velocity * velocity
        feature[ALTITUDE_RATE, lane] = velocity * sin_path
        sight[SIGHTED_CROSSRANGE, lane] = constants.planet_radius * crossrange_angle
        sight[DOWNRANGE_ANGLE, lane], sight[CROSSRANGE_ANGLE, lane] = downrange_angle, crossrange_angle


@inline_njit
def _row(velocity, table):
    """Row before a velocity in an ascending table, and the fraction of the way to the next; held at both ends."""
    row = min(max(np.searchsorted(table, velocity, side="right") - 1, 0), len(table) - 2)
    return row, min(max((velocity - table[row]) / (table[row + 1] - table[row]), 0.0), 1.0)


@inline_njit
def _correct_by_velocity(law, feature, constants, steering):
    """Add the feedback of a law against velocity to the bank cosines, where it corrects at all."""
    _, table, gain, reference, _, least_drag, _ = law
    for lane in range(LANES):
        velocity = feature[VELOCITY, lane]
        gravity = constants.gravitational_parameter / (feature[0, lane] * feature[0, lane])
        # Before its peak, too, a velocity stands in the table, whose reference lies behind the peak.
        slowing = feature[DRAG, lane] * velocity > -gravity * feature[ALTITUDE_RATE, lane]
        if slowing and velocity <= table[-1] and feature[DRAG, lane] >= least_drag:
            row, fraction = _row(velocity, table)
            command = steering[COMMAND_COSINE, lane]
            for j in range(FEATURES):
                k = gain[row, j] + fraction * (gain[row + 1, j] - gain[row, j])
                command += k * (
                    feature[j, lane] - reference[row, j] - fraction * (reference[row + 1, j] - reference[row, j])
                )
            steering[COMMAND_COSINE, lane] = command


@inline_njit
def _command_cosine(law, cycle, feature, constants, steering):
    """Bank cosine that a law commands (Eqs. 31, 40, 50), limited to -1 ... 1."""
    kind, _, gain, reference, bank_cosine, _, _ = law
    if kind == BY_TIME:
        row = min(cycle, len(gain) - 1)
        for lane in range(LANES):
            steering[COMMAND_COSINE, lane] = bank_cosine[row]
        for j in range(FEATURES):
            k, expected = gain[row, j], reference[row, j]
            for lane in range(LANES):
                steering[COMMAND_COSINE, lane] += k * (feature[j, lane] - expected)
    else:
        for lane in range(LANES):
            steering[COMMAND_COSINE, lane] = ramped_bank_cosine(
                feature[VELOCITY, lane],
                constants.fast_velocity,
                constants.slow_velocity,
                constants.fast_cosine,
                constants.slow_cosine,
            )
    if kind == BY_VELOCITY:
        _correct_by_velocity(law, feature, constants, steering)
    for lane in range(LANES):
        command = steering[COMMAND_COSINE, lane]
        command = -1.0 if command < -1.0 else command  # NaN stays NaN
        steering[COMMAND_COSINE, lane] = 1.0 if command > 1.0 else command


@inline_njit
def _command_bank(time, feature, sight, constants, steering, final):
    """Bank command from its cosine and the side of the target (Sec. III.D-E); counts reversals."""
    aligning = 0
    for lane in range(LANES):
        slow = feature[VELOCITY, lane] <= constants.alignment_velocity
        steering[ALIGNING, lane] = 1.0 if slow else steering[ALIGNING, lane]
        aligning += steering[ALIGNING, lane] > 0.0
        steering[COMMAND_BEFORE, lane] = steering[COMMAND, lane]
    if aligning < LANES:
        width = deadband(
            time,
            constants.deadband_start,
            constants.deadband_start_width,
            constants.deadband_end,
            constants.deadband_end_width,
        )
        for lane in range(LANES):
            before = steering[DIRECTION, lane]
            turned = bank_direction(before, sight[SIGHTED_CROSSRANGE, lane], width)
            turned = before if steering[ALIGNING, lane] > 0.0 else turned
            reversal = 1.0 if turned != before else 0.0
            final[REVERSALS, lane] += reversal * steering[FLYING, lane]
            steering[DIRECTION, lane] = turned
            steering[COMMAND, lane] = turned * arc_cosine(steering[COMMAND_COSINE, lane])
    if aligning > 0:
        for lane in range(LANES):
            command = _alignment(lane, feature, sight, constants)
            cosine, aligned = sine_cosine(command)[1], steering[ALIGNING, lane] > 0.0
            steering[COMMAND, lane] = command if aligned else steering[COMMAND, lane]
            steering[COMMAND_COSINE, lane] = cosine if aligned else steering[COMMAND_COSINE, lane]


@inline_njit
def _alignment(lane, feature, sight, constants):
    """Bank command of the heading alignment (Eq. 58)."""
    limit = heading_alignment_limit(
        feature[VELOCITY, lane],
        constants.alignment_limit_velocity,
        constants.alignment_first_limit,
        constants.alignment_last_limit,
    )
    ratio = heading_alignment_ratio(
        sight[DOWNRANGE_ANGLE, lane], sight[CROSSRANGE_ANGLE, lane], constants.alignment_form
    )
    return limited_heading_alignment(arctangent(*ratio), constants.alignment_gain, limit, constants.alignment_form)


@inline_njit
def _reached(lane, constants, steering):
    """Bank that is reached at a command (Eq. 71)."""
    command, largest_change = steering[COMMAND, lane], constants.largest_bank_change * steering[ELAPSED, lane]
    if constants.limit_as_printed:
        return rate_limited_bank_as_printed(command, steering[COMMAND_BEFORE, lane], largest_change)
    return rate_limited_bank(command, steering[FLOWN_BANK, lane], largest_change)


@inline_njit
def _passes(lane, state, constants, steering):
    """Whether a trial in range control is slow enough for the heading alignment."""
    steered = steering[FLYING, lane] > 0.0 and steering[ALIGNING, lane] == 0.0
    return steered and state[SPEED, lane] <= constants.alignment_velocity


@njit(error_model="numpy")
def _align_within(share, state, feature, sight, constants, steering, largest, aero):
    """Start the heading alignment of those trials that pass its velocity after a share of a guidance period."""
    for lane in range(LANES):
        if _passes(lane, state, constants, steering):
            steering[ALIGNING, lane], steering[ELAPSED, lane] = 1.0, share
            steering[COMMAND_BEFORE, lane] = steering[COMMAND, lane]
            steering[COMMAND, lane] = _alignment(lane, feature, sight, constants)
            steering[COMMAND_COSINE, lane] = sine_cosine(steering[COMMAND, lane])[1]
            bank, before = _reached(lane, constants, steering), steering[FLOWN_BANK, lane]
            change = abs(bank - before)
            steering[FLOWN_BANK, lane], steering[FLOWN_CHANGE, lane] = bank, change
            steering[ELAPSED, lane] = 1.0 - share
            largest[BANK, lane] = np.maximum(largest[BANK, lane], abs(bank))
            largest[BANK_CHANGE, lane] = np.maximum(largest[BANK_CHANGE, lane], change)
            aero[SINE, lane], aero[COSINE, lane] = sine_cosine(steering[FLOWN_BANK, lane])


@inline_njit
def _limit_rate(cycle, constants, steering, largest):
    """Bank that is flown in a guidance period (Eq. 71)."""
    for lane in range(LANES):
        before = steering[FLOWN_BANK, lane]
        bank = _reached(lane, constants, steering) if cycle > 0 else steering[COMMAND, lane]
        change = abs(bank - before) if cycle > 0 else 0.0
        steering[FLOWN_BANK, lane], steering[FLOWN_CHANGE, lane], steering[ELAPSED, lane] = bank, change, 1.0
        flying = steering[FLYING, lane] > 0.0
        # np.maximum keeps NaN, so a trial that went wrong shows it.
        largest_bank = np.maximum(largest[BANK, lane], abs(bank))
        largest_change = np.maximum(largest[BANK_CHANGE, lane], change)
        largest[BANK, lane] = largest_bank if flying else largest[BANK, lane]
        largest[BANK_CHANGE, lane] = largest_change if flying else largest[BANK_CHANGE, lane]


@njit(error_model="numpy")
def _sample_factors(air_deviation, log_retention, seed, first_trial, factor, final):
    """Density factors of a group, from the top of the atmosphere downwards (Eqs. 5, 8); counts the negative ones."""
    for lane in range(LANES):
        final[NEGATIVE_DENSITIES, lane] = 0.0
    if not air_deviation.any():
        factor[:] = 1.0
        return
    bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
    normal_numbers, process = lane_array(NORMALS_PER_BLOCK), lane_array(2)
    process[:] = 0.0
    top = len(air_deviation) - 1
    for number in range(top + 1):
        position, node = number % NORMALS_PER_BLOCK, top - number
        if position == 0:
            fill_normals(seed, DENSITY_STREAM, first_trial, number // NORMALS_PER_BLOCK, bits, normal_numbers)
        keep = exponential(log_retention[node]) if number > 0 else 0.0
        fresh = np.sqrt(1.0 - keep * keep)
        for lane in range(LANES):
            process[0, lane] = keep * process[0, lane] + fresh * normal_numbers[position, lane]
            variation = air_deviation[node] * process[0, lane]
            process[1, lane] += is_floored(variation)
            factor[node, lane] = density_factor(variation)
    for lane in range(LANES):
        final[NEGATIVE_DENSITIES, lane] = process[1, lane]


@njit(error_model="numpy")
def _fly_group(settings, tables, law, schedule, entry_state, factors, seed, first_trial, group):
    """Fly LANES trials. entry_state: (6, LANES); factors: of drag and lift, (LANES,) each; group is filled."""
    velocity_trigger, end_time, cycles, substeps, every = schedule
    log_density, log_step, deviation, log_retention = tables
    history, _, stored_largest, length, stored_final = group
    drag_factor, lift_factor = factors
    constants = settings[0]
    factor = np.empty((len(log_density), LANES))
    final, largest = lane_array(FINAL), lane_array(OBSERVED)
    _sample_factors(deviation, log_retention, seed, first_trial, factor, final)
    aero = lane_array(4)
    aero[DRAG_FACTOR], aero[LIFT_FACTOR] = drag_factor, lift_factor
    parameters = ((log_density, log_step, factor), aero, lane_array(2), constants)

    state, before, ended = lane_array(STATES), lane_array(STATES), lane_array(STATES)
    state[:] = entry_state
    work = (lane_array(STATES), lane_array(STATES), lane_array(STATES))
    noise, feature, sight, steering = lane_array(0), lane_array(FEATURES), lane_array(SIGHTED), lane_array(STEERED)
    start, end = np.empty(STATES), np.empty(STATES)
    steering[:] = 0.0
    steering[DIRECTION], steering[FLYING] = constants.initial_direction, 1.0
    largest[:] = stored_largest
    final[REVERSALS], final[END_TIME] = 0.0, end_time
    length[:] = history.shape[0]

    step, remaining, flown_steps = 0.0, LANES, 0
    while True:
        over = remaining == 0 or flown_steps == cycles * substeps
        if over:
            for row in range(STATES):
                for lane in range(LANES):
                    state[row, lane] = state[row, lane] if steering[FLYING, lane] > 0.0 else ended[row, lane]
        cycle, substep = flown_steps // substeps, flown_steps % substeps
        time = cycle * constants.period
        passing = 0
        if law.ends_within and substep > 0 and not over:
            for lane in range(LANES):
                passing += _passes(lane, state, constants, steering)
        if over or substep == 0 or flown_steps % every == 0 or passing > 0:
            _observe(state, parameters, feature, sight)
        if passing > 0:
            _align_within(substep / substeps, state, feature, sight, constants, steering, largest, aero)
        if substep == 0 and not over:
            _command_cosine(law, cycle, feature, constants, steering)
            _command_bank(time, feature, sight, constants, steering, final)
            _limit_rate(cycle, constants, steering, largest)
            for lane in range(LANES):
                aero[SINE, lane], aero[COSINE, lane] = sine_cosine(steering[FLOWN_BANK, lane])
            step = (constants.period if velocity_trigger else min(constants.period, end_time - time)) / substeps
        if (over and not velocity_trigger) or (flown_steps % every == 0 and not over):
            row = history.shape[0] - 1 if over else flown_steps // every
            _record(row, state, feature, sight, steering, constants, group)
            for lane in range(LANES):
                steering[FLOWN_CHANGE, lane] = 0.0
        if over:
            break
        for row in range(STATES):
            for lane in range(LANES):
                before[row, lane] = state[row, lane]
        _advance(0, step, state, noise, parameters, work)
        if velocity_trigger:
            for lane in range(LANES):
                if state[SPEED, lane] <= constants.end_velocity and steering[FLYING, lane] > 0.0:
                    for row in range(STATES):
                        start[row], end[row] = before[row, lane], state[row, lane]
                    part = _to_trigger(step, lane, start, parameters, constants.end_velocity, end)
                    final[END_TIME, lane] = time + substep * step + part
                    for row in range(STATES):
                        ended[row, lane] = end[row]
                    length[lane] = flown_steps // every + 1
                    steering[FLYING, lane] = 0.0
                    remaining -= 1
        flown_steps += 1

    for lane in range(LANES):
        final[ALTITUDE, lane] = feature[0, lane] - constants.planet_radius
        for j in range(1, 5):
            final[j, lane] = feature[j, lane]
        final[CROSSRANGE, lane] = sight[SIGHTED_CROSSRANGE, lane]
    stored_final[:], stored_largest[:] = final, largest


@inline_njit
def _record(row, state, feature, sight, steering, constants, group):
    history, observed, _, _, _ = group
    for lane in range(LANES):
        history[row, ALTITUDE, lane] = feature[0, lane] - constants.planet_radius
    for j in range(1, 5):
        for lane in range(LANES):
            history[row, j, lane] = feature[j, lane]
    for lane in range(LANES):
        history[row, CROSSRANGE, lane] = sight[SIGHTED_CROSSRANGE, lane]
        history[row, BANK_COSINE, lane] = steering[COMMAND_COSINE, lane]
        observed[row, BANK, lane] = steering[FLOWN_BANK, lane]
        observed[row, BANK_CHANGE, lane] = steering[FLOWN_CHANGE, lane]
    if history.shape[1] > HISTORY:
        for j, component in enumerate(PLACE):
            for lane in range(LANES):
                history[row, HISTORY + j, lane] = state[component, lane]


@njit(parallel=True, cache=True, error_model="numpy")
def _fly(settings, tables, law, schedule, entry_state, factors, seed, first_trial, results):
    drag_factor, lift_factor = factors
    history, observed, largest, length, final = results
    for number in prange(entry_state.shape[1] // LANES):
        lanes = slice(number * LANES, (number + 1) * LANES)
        group = Group(
            history[:, :, lanes],
            observed[:, :, lanes],
            largest[:, lanes].copy(),
            np.empty(LANES, np.int64),
            np.empty((FINAL, LANES)),
        )
        _fly_group(
            settings,
            tables,
            law,
            schedule,
            entry_state[:, lanes],
            (drag_factor[lanes], lift_factor[lanes]),
            seed,
            first_trial + number * LANES,
            group,
        )
        largest[:, lanes] = group.largest
        final[:, lanes] = group.final
        length[lanes] = group.length


class Stored(NamedTuple):
    """What of a flight is stored."""

    every: int | None = None  # integration steps from one stored state to the next; None: a guidance period
    place: bool = False  # whether longitude, latitude and azimuth (rad) are, too, behind the rest of the history


EVERY_PERIOD = Stored()


def fly(
    settings,
    atmosphere,
    law,
    vehicles,
    *,
    trigger,
    end_time,
    substeps,
    seed,
    first_trial=0,
    stored=EVERY_PERIOD,
) -> Trajectories:
    """Fly consecutive trials to their end.

    settings: see `settings`. atmosphere: `Atmosphere`. law: `Law`. vehicles: `Vehicles` of the trials. trigger: "time"
    or "velocity". end_time: s, the fixed final time, or the time limit of the velocity trigger. substeps: integration
    steps per guidance period. seed, first_trial: key of the density variations and the number of the first trial.
    stored: what of the flights is stored.

    Returns `Trajectories`. Stored are altitude (m), velocity (m/s), flight path angle, downrange (m, negative before
    the target), density (kg/m^3), crossrange (m) and commanded bank cosine at the start of every guidance period, and
    at the fixed final time; observed are the flown bank angle and its last change. The final state is the first six of
    these, then the end time (s), the number of bank reversals and that of tabulated densities set to zero. Outcomes:
    ESCAPED for a trigger not reached within the time limit, CRASHED below the ground.
    """
    every = substeps if stored.every is None else stored.every
    period = float(settings["period"][0])
    cycles = int(np.ceil(end_time / period - 1e-9))
    velocity_trigger = trigger == "velocity"
    times = cycles * substeps // every + (not velocity_trigger)
    trials = len(vehicles.drag_factor)
    state = pad_to_groups(vehicles.entry_state.T)
    padded = state.shape[1]
    flights = Trajectories(
        history=np.empty((times, HISTORY + len(PLACE) * stored.place, padded)),
        observed=np.empty((times, OBSERVED, padded)),
        observed_maximum=np.zeros((OBSERVED, padded)),
        final_state=np.empty((FINAL, padded)),
        outcome=np.full(padded, COMPLETED, np.int8),
        length=np.empty(padded, np.int64),
    )
    _fly(
        settings,
        Tables(
            atmosphere.log_density,
            np.append(np.diff(atmosphere.log_density), 0.0),
            atmosphere.deviation,
            atmosphere.log_retention,
        ),
        # Copies, as loaded arrays are read-only, for which the kernel would be compiled once more.
        Law(law.kind, *(np.array(part) for part in law[1:5]), law.least_drag, law.ends_within),
        Schedule(velocity_trigger, float(end_time), cycles, substeps, every),
        state,
        (pad_to_groups(vehicles.drag_factor), pad_to_groups(vehicles.lift_factor)),
        seed,
        first_trial,
        Group(flights.history, flights.observed, flights.observed_maximum, flights.length, flights.final_state),
    )
    flights = flights.first(trials)
    final = flights.final_state
    if velocity_trigger:
        flights.outcome[final[VELOCITY] > settings["end_velocity"][0] + 1e-6] = ESCAPED
    flights.outcome[final[ALTITUDE] < 0.0] = CRASHED
    flights.outcome[~np.isfinite(final).all(axis=0)] = NON_FINITE
    return flights


def outputs(end_time, period, trigger):
    """Times of the stored states, s."""
    starts = np.arange(int(np.ceil(end_time / period - 1e-9))) * period
    return starts if trigger == "velocity" else np.append(starts, end_time)
