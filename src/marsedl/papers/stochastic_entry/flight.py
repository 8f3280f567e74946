"""Closed-loop entry flights: Eqs. 1 under bank commands of one guidance period each (Secs. III and V, Appendix D)."""

from typing import NamedTuple

import numpy as np

from marsedl.elementary import arc_cosine, arctangent, clip, exponential, sine_cosine
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
from marsedl.methods.guidance.targeting import targeting
from marsedl.models.atmosphere import node_below
from marsedl.models.density_variation import density_factor, is_floored
from marsedl.models.dynamics.entry import entry_rates
from marsedl.montecarlo.ensembles import Trajectories
from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.outcomes import CRASHED, ESCAPED, NON_FINITE, NOTHING
from marsedl.montecarlo.streams import normals, uniforms
from marsedl.papers.stochastic_entry import environment
from marsedl.papers.stochastic_entry.dispersions import (
    AERODYNAMICS_STREAM,
    DENSITY_STREAM,
    ENTRY_STREAM,
    Dispersions,
    dispersions_of,
    factors,
)
from marsedl.papers.stochastic_entry.inputs import Inputs
from marsedl.papers.stochastic_entry.records import ALTITUDE, HISTORY

FEATURES = 7  # that a law feeds back: the first fields of `Sensed`
DRAG, ALTITUDE_RATE = 5, 6  # of them, behind radius, velocity, flight path angle, downrange and density
PLACE = 3  # longitude, latitude and azimuth, which only the nominal stores, behind the history
NOMINAL, BY_VELOCITY, BY_TIME = range(3)
HEADING_FORMS = {"corrected": CORRECTED, "printed": PRINTED}


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


NOMINAL_LAW = Law(NOMINAL, np.zeros(2), np.zeros((2, FEATURES)), np.zeros((2, FEATURES)), np.zeros(2), 0.0)


class Settings(NamedTuple):
    """Constants of a flight, SI."""

    gravitational_parameter: float
    rotation_rate: float
    planet_radius: float
    target_longitude: float
    sin_target_latitude: float
    cos_target_latitude: float
    heading_sign: float
    bottom: float
    nodes_per_metre: float
    period: float
    largest_bank_change: float  # in a guidance period
    fast_velocity: float
    slow_velocity: float
    fast_cosine: float
    slow_cosine: float
    deadband_start: float
    deadband_start_width: float
    deadband_end: float
    deadband_end_width: float
    initial_direction: float
    alignment_velocity: float
    alignment_gain: float
    alignment_limit_velocity: float
    alignment_first_limit: float
    alignment_last_limit: float
    end_velocity: float
    alignment_form: int
    limit_as_printed: int


class Tables(NamedTuple):
    """The atmosphere on a uniform grid of altitudes."""

    log_density: np.ndarray  # (nodes,), of kg/m^3, mean
    log_step: np.ndarray  # (nodes,), its rise to the next node
    deviation: np.ndarray  # (nodes,), standard deviation of the relative density variation
    retention: np.ndarray  # (nodes,), correlation of the variation with that at the next node, 0 at the last
    innovation: np.ndarray  # (nodes,), standard deviation of what the variation does not keep


Parameters = NamedTuple("Parameters", [*Settings.__annotations__.items(), *Tables.__annotations__.items()])


class Vehicles(NamedTuple):
    """The dispersed vehicles of some trials."""

    entry_state: np.ndarray  # (trials, 6): radius, longitude, latitude, velocity, path angle, azimuth
    drag_factor: np.ndarray  # (trials,), A C_D / (2 m), m^2/kg
    lift_factor: np.ndarray  # (trials,), A C_L / (2 m), m^2/kg


class Plant(NamedTuple):
    """What the trials of a reading fly in and with."""

    settings: Settings
    atmosphere: environment.Atmosphere
    dispersions: Dispersions


# ---- set-up ----------------------------------------------------------------------------------------------------------


def settings(given: Inputs, atmosphere) -> Settings:
    """The constants of a flight by name."""
    planet, mission, guidance = given.planet, given.mission, given.guidance
    return Settings(
        gravitational_parameter=planet.gravitational_parameter,
        rotation_rate=planet.rotation_rate,
        planet_radius=planet.planet_radius,
        target_longitude=mission.target_longitude,
        sin_target_latitude=np.sin(mission.target_latitude),
        cos_target_latitude=np.cos(mission.target_latitude),
        heading_sign=1.0 if planet.heading_rate_form == "corrected" else -1.0,
        bottom=atmosphere.altitude[0],
        nodes_per_metre=(len(atmosphere.altitude) - 1) / (atmosphere.altitude[-1] - atmosphere.altitude[0]),
        period=guidance.guidance_period,
        largest_bank_change=guidance.bank_rate_limit * guidance.guidance_period,
        fast_velocity=guidance.ramp_velocities[0],
        slow_velocity=guidance.ramp_velocities[1],
        fast_cosine=np.cos(guidance.nominal_bank_fast),
        slow_cosine=np.cos(guidance.nominal_bank_slow),
        deadband_start=guidance.deadband_times[0],
        deadband_start_width=guidance.deadband_widths[0],
        deadband_end=guidance.deadband_times[1],
        deadband_end_width=guidance.deadband_widths[1],
        initial_direction=guidance.initial_bank_direction,
        alignment_velocity=guidance.heading_alignment_velocity,
        alignment_gain=guidance.heading_alignment_gain,
        alignment_limit_velocity=guidance.heading_alignment_limit_velocity,
        alignment_first_limit=guidance.heading_alignment_limits[0],
        alignment_last_limit=guidance.heading_alignment_limits[1],
        end_velocity=mission.end_velocity,
        alignment_form=HEADING_FORMS[guidance.heading_alignment_form],
        limit_as_printed=int(guidance.rate_limit_form == "printed"),
    )


def plant_of(given: Inputs) -> Plant:
    """Return what the trials of a reading fly in and with."""
    atmosphere = environment.atmosphere(given.air)
    constants = settings(given, atmosphere)
    return Plant(constants, atmosphere, dispersions_of(given))


def vehicles_of(dispersions: Dispersions, seed, trials) -> Vehicles:
    """The dispersed entry states and aerodynamics of the given trials (Tables 2 and 3)."""
    normal = normals(seed, ENTRY_STREAM, trials, len(State._fields))
    states = dispersions.entry_mean + normal * dispersions.entry_deviations
    error = 2.0 * uniforms(seed, AERODYNAMICS_STREAM, trials, 1)[:, 0] - 1.0
    return Vehicles(states, *factors(dispersions.body, dispersions.drag_error * error, dispersions.lift_error * error))


# ---- the model: of one trial -----------------------------------------------------------------------------------------


class State(NamedTuple):
    """What is integrated, SI and rad."""

    radius: float
    longitude: float
    latitude: float
    velocity: float
    path_angle: float
    azimuth: float


class Aerodynamics(NamedTuple):
    """Factors A C / (2 m) of the trial, m^2/kg."""

    drag_factor: float
    lift_factor: float


class Variation(NamedTuple):
    """The relative density variation while it is drawn, and how many densities were negative."""

    process: float
    floored: float


class Density(NamedTuple):
    """ln of the mean density (kg/m^3), and the factor of its variation."""

    log_mean: float
    factor: float


class Sensed(NamedTuple):
    """What laws feed back, and where the target is, SI and rad."""

    radius: float
    velocity: float
    path_angle: float
    downrange: float  # negative before the target
    density: float
    drag: float
    altitude_rate: float
    crossrange: float
    downrange_angle: float
    crossrange_angle: float
    nominal_cosine: float  # of the nominal bank profile at the velocity


class Advice(NamedTuple):
    """The bank cosine that a law commands, before its limits."""

    cosine: float


class Bank(NamedTuple):
    """The bank angle that is flown."""

    sine: float
    cosine: float


class Memory(NamedTuple):
    """What the guidance of a trial remembers."""

    direction: float  # of the bank, +1 or -1
    command: float = 0.0  # bank, rad
    cosine: float = 0.0  # of the command
    bank: float = 0.0  # flown, rad
    change: float = 0.0  # of it, rad
    aligning: float = 0.0  # whether the heading alignment steers
    elapsed: float = 1.0  # guidance periods since the last command
    reversals: float = 0.0


class Largest(NamedTuple):
    """Largest bank and change of it, rad."""

    bank: float = 0.0
    change: float = 0.0


class Observed(NamedTuple):
    """Bank that is flown, and its change since the last stored state, rad."""

    bank: float
    change: float


class Row(NamedTuple):
    """What is stored over time: the rows of the history, and then the place."""

    altitude: float
    velocity: float
    path_angle: float
    downrange: float
    density: float
    crossrange: float
    cosine: float
    longitude: float
    latitude: float
    azimuth: float


class Final(NamedTuple):
    """The end of a flight."""

    altitude: float
    velocity: float
    path_angle: float
    downrange: float
    density: float
    crossrange: float
    end_time: float
    reversals: float
    negative_densities: float


def vary(node, normal, drawn, p) -> tuple[float, Variation]:
    """Density factors from the top of the atmosphere downwards (Eqs. 5, 8)."""
    process = p.retention[node] * drawn.process + p.innovation[node] * normal
    variation = p.deviation[node] * process
    return density_factor(variation), Variation(process, drawn.floored + is_floored(variation))


def look_up(state, air, p) -> Density:
    """Mean density and the factor of its variation at an altitude, linear between the nodes, held beyond."""
    position = (state.radius - p.planet_radius - p.bottom) * p.nodes_per_metre
    node, fraction = node_below(position, p.log_density.shape[0])
    below = air[node]
    return Density(p.log_density[node] + fraction * p.log_step[node], below + fraction * (air[node + 1] - below))


def rates(state, found, command, vehicle, p) -> State:
    """Eqs. 1."""
    return State(
        *entry_rates(
            state,
            (command.sine, command.cosine),
            exponential(found.log_mean) * found.factor,
            (vehicle.drag_factor, vehicle.lift_factor),
            (p.gravitational_parameter, p.rotation_rate),
            p.heading_sign,
        )
    )


def ended(state, p) -> float:
    """Velocity above that of the trigger, m/s."""
    return state.velocity - p.end_velocity


def sense(state, found, vehicle, p) -> Sensed:
    """What laws feed back (Eqs. 31, 40), and where the target is (Appendix D)."""
    downrange_angle, crossrange_angle = targeting(
        state.longitude,
        state.latitude,
        state.radius,
        state.velocity,
        state.path_angle,
        state.azimuth,
        p.rotation_rate,
        p.target_longitude,
        (p.sin_target_latitude, p.cos_target_latitude),
    )
    density = exponential(found.log_mean) * found.factor
    return Sensed(
        state.radius,
        state.velocity,
        state.path_angle,
        -p.planet_radius * downrange_angle,
        density,
        vehicle.drag_factor * density * state.velocity * state.velocity,
        state.velocity * sine_cosine(state.path_angle)[0],
        p.planet_radius * crossrange_angle,
        downrange_angle,
        crossrange_angle,
        ramped_bank_cosine(state.velocity, p.fast_velocity, p.slow_velocity, p.fast_cosine, p.slow_cosine),
    )


def consult(sensed, law, p) -> Advice:
    """Nominal bank cosine, with the feedback of a law against velocity where it corrects at all (Eq. 31)."""
    velocity, command = sensed.velocity, sensed.nominal_cosine
    if law.kind != BY_VELOCITY:
        return Advice(command)
    gravity = p.gravitational_parameter / (sensed.radius * sensed.radius)
    # Before its peak, too, a velocity stands in the table, whose reference lies behind the peak.
    slowing = sensed.drag * velocity > -gravity * sensed.altitude_rate
    if slowing and velocity <= law.velocity[-1] and sensed.drag >= law.least_drag:
        table, gain, reference = law.velocity, law.gain, law.reference
        row = min(max(np.searchsorted(table, velocity, side="right") - 1, 0), len(table) - 2)
        fraction = min(max((velocity - table[row]) / (table[row + 1] - table[row]), 0.0), 1.0)
        for j in range(FEATURES):
            k = gain[row, j] + fraction * (gain[row + 1, j] - gain[row, j])
            command += k * (sensed[j] - reference[row, j] - fraction * (reference[row + 1, j] - reference[row, j]))
    return Advice(command)


RANGE_BY_ADVICE, RANGE_BY_TIME, HEADING = 0.0, 1.0, 2.0  # phases: which function steers


def phase(sensed, memory, law, p) -> float:
    """Heading alignment from its velocity on, for ever; range control before."""
    if memory.aligning > 0.0 or sensed.velocity <= p.alignment_velocity:
        return HEADING
    return RANGE_BY_TIME if law.kind == BY_TIME else RANGE_BY_ADVICE


def interrupts(state, memory, law, p) -> bool:
    """Whether the heading alignment is due within a guidance period."""
    return law.ends_within and memory.aligning == 0.0 and state.velocity <= p.alignment_velocity


def _controlled(cosine, time, cycle, sensed, memory, p):
    """Bank from its cosine, limited to -1 ... 1, and the side of the target (Sec. III.D)."""
    cosine = clip(cosine, -1.0, 1.0)
    width = deadband(time, p.deadband_start, p.deadband_start_width, p.deadband_end, p.deadband_end_width)
    direction = bank_direction(memory.direction, sensed.crossrange, width)
    reversals = memory.reversals + (1.0 if direction != memory.direction else 0.0)
    return _flown(direction * arc_cosine(cosine), cosine, direction, 0.0, reversals, cycle, 0.0, memory, p)


def _flown(command, cosine, direction, aligning, reversals, cycle, share, memory, p):
    """Bank that is reached at a command (Eq. 71).

    The first command is flown at once: the paper names no bank before it from which its rate could be limited.
    """
    largest_change = p.largest_bank_change * (share if share > 0.0 else memory.elapsed)
    limited = rate_limited_bank(command, memory.bank, largest_change)
    as_printed = rate_limited_bank_as_printed(command, memory.command, largest_change)
    first = cycle == 0 and share == 0.0
    reached = as_printed if p.limit_as_printed else limited
    bank = command if first else reached
    change = 0.0 if first else abs(bank - memory.bank)
    remembered = Memory(direction, command, cosine, bank, change, aligning, 1.0 - share, reversals)
    return Bank(*sine_cosine(bank)), remembered


def control_range(time, cycle, sensed, advice, memory, p) -> tuple[Bank, Memory]:
    """Range control by the nominal bank cosine, corrected or not against velocity (Eq. 31)."""
    return _controlled(advice.cosine, time, cycle, sensed, memory, p)


def control_range_by_time(time, cycle, sensed, memory, law, p) -> tuple[Bank, Memory]:
    """Range control by a law against time (Eqs. 40, 50)."""
    row = min(cycle, len(law.gain) - 1)
    cosine = law.bank_cosine[row]
    for j in range(FEATURES):
        cosine += law.gain[row, j] * (sensed[j] - law.reference[row, j])
    return _controlled(cosine, time, cycle, sensed, memory, p)


def align_heading(cycle, share, sensed, memory, p) -> tuple[Bank, Memory]:
    """Bank command of the heading alignment (Eq. 58)."""
    limit = heading_alignment_limit(
        sensed.velocity, p.alignment_limit_velocity, p.alignment_first_limit, p.alignment_last_limit
    )
    ratio = heading_alignment_ratio(sensed.downrange_angle, sensed.crossrange_angle, p.alignment_form)
    command = limited_heading_alignment(arctangent(*ratio), p.alignment_gain, limit, p.alignment_form)
    cosine = sine_cosine(command)[1]
    return _flown(command, cosine, memory.direction, 1.0, memory.reversals, cycle, share, memory, p)


def watch(watched, memory) -> Largest:
    """Largest bank and largest change of it."""
    # np.maximum keeps NaN, so a trial that went wrong shows it.
    return Largest(np.maximum(watched.bank, abs(memory.bank)), np.maximum(watched.change, memory.change))


def observe(guided, memory) -> Observed:
    """The flown bank, and its change where it has just changed."""
    return Observed(memory.bank, memory.change if guided > 0.0 else 0.0)


def _flown_so_far(sensed, p):
    """What is stored of a flight over time and of its end."""
    altitude = sensed.radius - p.planet_radius
    return altitude, sensed.velocity, sensed.path_angle, sensed.downrange, sensed.density, sensed.crossrange


def store(state, sensed, memory, p) -> Row:
    """The history and the place; see `fly`."""
    return Row(*_flown_so_far(sensed, p), memory.cosine, state.longitude, state.latitude, state.azimuth)


def finish(time, sensed, memory, drawn, p) -> Final:
    """The end of a flight; see `fly`."""
    return Final(*_flown_so_far(sensed, p), time, memory.reversals, drawn.floored)


FLIGHT = Flight(
    rates,
    look_up=look_up,
    vary=vary,
    sense=sense,
    consult=consult,
    phase=phase,
    guide=(control_range, control_range_by_time, align_heading),
    interrupts=interrupts,
    ended=ended,
    watch=watch,
    store=store,
    observe=observe,
    finish=finish,
)


# ---- flights ---------------------------------------------------------------------------------------------------------


def schedule(end_time, period, trigger, substeps=1, every=None):
    """Guidance periods to the fixed end time, which is stored, or to the time limit of the velocity trigger."""
    fixed = trigger == "time"
    return periods(end_time, period, substeps, every=every, stores_end=fixed, cut=fixed)


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
    every=None,
    place=False,
) -> Trajectories:
    """Fly consecutive trials to their end.

    settings: see `settings`. atmosphere: `Atmosphere`. law: `Law`. vehicles: `Vehicles` of the trials. trigger: "time"
    or "velocity". end_time: s, the fixed final time, or the time limit of the velocity trigger. substeps: integration
    steps per guidance period. seed, first_trial: key of the density variations and the number of the first trial.
    every: integration steps from one stored state to the next, by default a guidance period. place: whether longitude,
    latitude and azimuth (rad) are stored, too, behind the rest.

    Returns `Trajectories`. Stored are altitude (m), velocity (m/s), flight path angle, downrange (m, negative before
    the target), density (kg/m^3), crossrange (m) and commanded bank cosine at the start of every guidance period, and
    at the fixed final time; observed are the flown bank angle and its last change. The final state is the first six of
    these, then the end time (s), the number of bank reversals and that of tabulated densities set to zero. Outcomes:
    ESCAPED for a trigger not reached within the time limit, CRASHED below the ground.
    """
    velocity_trigger = trigger == "velocity"
    rises = np.append(np.diff(atmosphere.log_density), 0.0)
    retention = np.append([exponential(value) for value in atmosphere.log_retention], 0.0)
    innovation = np.sqrt(1.0 - retention * retention)
    air = Tables(atmosphere.log_density, rises, atmosphere.deviation, retention, innovation)
    constants = settings if velocity_trigger else settings._replace(end_velocity=-np.inf)
    flights = FLIGHT.fly(
        Parameters(*constants, *air),
        schedule(end_time, settings.period, trigger, substeps, every),
        State(*vehicles.entry_state.T),
        vehicle=Aerodynamics(vehicles.drag_factor, vehicles.lift_factor),
        law=law,
        memory=Memory(settings.initial_direction),
        seed=seed,
        first_trial=first_trial,
        nodes=len(atmosphere.log_density),
        streams=(0, DENSITY_STREAM),
        stored=HISTORY + PLACE * place,
    )
    final = flights.final_state
    if velocity_trigger:
        flights.outcome[flights.ended == NOTHING] = ESCAPED
    flights.outcome[final[ALTITUDE] < 0.0] = CRASHED
    flights.outcome[~np.isfinite(final).all(axis=0)] = NON_FINITE
    return flights
