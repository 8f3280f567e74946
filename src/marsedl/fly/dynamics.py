"""The functions of the two models that come with the package: an entry, and a lander; see `montecarlo.flights`."""

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from marsedl.elementary import arctangent, clip, exponential, select, sine_cosine
from marsedl.models.atmosphere import log_density_in_cells, node_below
from marsedl.models.dynamics import entry
from marsedl.models.dynamics.powered_descent import powered_descent_rates, thrust_magnitude
from marsedl.montecarlo.flights import Flight

STANDARD_GRAVITY = 9.80665  # m/s^2
SPENT = 1e-9  # propellant that is none, kg

# ---- entry -----------------------------------------------------------------------------------------------------------


_START = ("altitude", "velocity", "flight_path_angle", "azimuth", "latitude", "longitude")
EntryState = namedtuple("EntryState", _START, defaults=(np.pi / 2, 0.0, 0.0))
EntrySensed = namedtuple("EntrySensed", (*_START, "range", "crossrange", "density", "drag", "lift", "energy"))
EntryVehicle = namedtuple("EntryVehicle", ("ballistic_coefficient", "lift_to_drag"))
EntryWatched = namedtuple("EntryWatched", ("max_load", "min_altitude", "max_altitude"), defaults=(0.0, np.inf, -np.inf))
EntryStored = namedtuple("EntryStored", (*EntrySensed._fields, "bank"))
EntryFinal = namedtuple("EntryFinal", ("end_time", *EntrySensed._fields, *EntryWatched._fields))
Air = namedtuple("Air", ("log_density", "factor"))  # the mean, and the trial's own factor
Drawn = namedtuple("Drawn", ("variation",))  # at the node above, in standard deviations
Bank = namedtuple("Bank", ("bank",))


class EntryParameters(NamedTuple):
    """What all trials of an entry share."""

    gravitational_parameter: float
    radius: float
    rotation_rate: float
    bottom: float  # lowest node of the mean density, m
    spacing: float  # of these nodes, m
    cells: np.ndarray  # cubics of its logarithm between them, (nodes + 1, 4), see `models.atmosphere.uniform_cells`
    varied_from: float  # lowest node of the variation, m
    varied_by: float  # spacing of these nodes, m
    retention: float  # correlation of neighbouring nodes
    deviation: np.ndarray  # of the variation at its nodes
    frame: tuple  # directions to the start, of its heading and to the right of it: three of three numbers each


def vary(node, normal, drawn, p) -> tuple[float, Drawn]:
    """Ornstein-Uhlenbeck over altitude; stationary, as the highest node has the full deviation."""
    below = p.retention * drawn.variation + np.sqrt((1.0 - p.retention) * (1.0 + p.retention)) * normal
    variation = normal if node == len(p.deviation) - 1 else below
    return p.deviation[node] * variation, Drawn(variation)


def look_up(state, air, p) -> Air:
    """Mean density, continued along its end slopes, and the trial's own factor, held beyond its nodes."""
    log_density = log_density_in_cells(state.altitude, p.bottom, 1.0 / p.spacing, p.cells)
    node, fraction = node_below((state.altitude - p.varied_from) / p.varied_by, len(p.deviation))
    factor = 1.0 + air[node] + fraction * (air[node + 1] - air[node])
    return Air(log_density, factor if factor > 0.0 else 0.0)


def entry_rates(state, found, command: Bank, vehicle, p) -> EntryState:
    """Entry of a gliding point mass over a rotating sphere (`models.dynamics.entry`)."""
    drag = 0.5 / vehicle.ballistic_coefficient
    place = (p.radius + state.altitude, state.longitude, state.latitude)
    altitude, longitude, latitude, velocity, flight_path_angle, azimuth = entry.entry_rates(
        (*place, state.velocity, state.flight_path_angle, state.azimuth),
        sine_cosine(command.bank),
        exponential(found.log_density) * found.factor,
        (drag, vehicle.lift_to_drag * drag),
        (p.gravitational_parameter, p.rotation_rate),
        1.0,
    )
    return EntryState(altitude, velocity, flight_path_angle, azimuth, latitude, longitude)


def entry_sense(state, found, vehicle, p) -> EntrySensed:
    """State, aerodynamic accelerations, energy, and distances along and from the great circle of the nominal start."""
    density = exponential(found.log_density) * found.factor
    drag = 0.5 / vehicle.ballistic_coefficient * density * state.velocity * state.velocity
    return sensed_at(state, density, drag, vehicle.lift_to_drag * drag, (p.gravitational_parameter, p.radius), p.frame)


def sensed_at(state, density, drag, lift, planet, frame):
    """What is sensed at a state, of the accelerations of the air there; planet: gravitational parameter and radius."""
    gravitational_parameter, radius = planet
    (sin_latitude, cos_latitude), (sin_longitude, cos_longitude) = (
        sine_cosine(state.latitude),
        sine_cosine(state.longitude),
    )
    x, y, z = cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude
    (a, b, c), (d, e, f), (g, h, i) = frame
    up, ahead, right = a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z
    return EntrySensed(
        state.altitude,
        state.velocity,
        state.flight_path_angle,
        state.azimuth,
        state.latitude,
        state.longitude,
        radius * arctangent(ahead, up),
        radius * arctangent(right, np.sqrt(up * up + ahead * ahead)),
        density,
        drag,
        lift,
        0.5 * state.velocity * state.velocity - gravitational_parameter / (radius + state.altitude),
    )


def entry_watch(watched, sensed) -> EntryWatched:
    """Largest aerodynamic load, lowest and highest altitude."""
    load = np.sqrt(sensed.drag * sensed.drag + sensed.lift * sensed.lift)
    return EntryWatched(
        load if load > watched.max_load else watched.max_load,
        sensed.altitude if sensed.altitude < watched.min_altitude else watched.min_altitude,
        sensed.altitude if sensed.altitude > watched.max_altitude else watched.max_altitude,
    )


def entry_store(sensed, command: Bank) -> EntryStored:
    """What laws are told, which is the true state here, and what they command."""
    return EntryStored(*(sensed[:] + command[:]))


def entry_finish(time, sensed, watched) -> EntryFinal:
    """The end, which the largest load and the lowest and highest altitude include."""
    whole = entry_watch(watched, sensed)
    return EntryFinal(time, *(sensed[:] + whole[:]))


def frame_of(start):
    """Directions to a start, of its heading and to the right of it, as three tuples; x to the prime meridian."""
    (sin_b, sin_l, sin_a), (cos_b, cos_l, cos_a) = (
        function([start["latitude"], start["longitude"], start["azimuth"]]) for function in (np.sin, np.cos)
    )
    up = np.array([cos_b * cos_l, cos_b * sin_l, sin_b])
    ahead = cos_a * np.array([-sin_b * cos_l, -sin_b * sin_l, cos_b]) + sin_a * np.array([-sin_l, cos_l, 0.0])
    return tuple(tuple(map(float, direction)) for direction in (up, ahead, np.cross(ahead, up)))


ENTRY = Flight(
    entry_rates,
    look_up=look_up,
    vary=vary,
    sense=entry_sense,
    store=entry_store,
    watch=entry_watch,
    finish=entry_finish,
    watch_steps=True,
)

# ---- lander ----------------------------------------------------------------------------------------------------------


_STATE = ("downrange", "altitude", "downrange_velocity", "vertical_velocity", "mass")
LanderState = namedtuple("LanderState", _STATE)
LanderVehicle = namedtuple("LanderVehicle", ("specific_impulse", "smallest_thrust", "largest_thrust", "thrust_scale"))
LanderParameters = namedtuple("LanderParameters", ("gravity", "thrust_noise", "dry_mass"))
LanderWatched = namedtuple("LanderWatched", ("max_command", "min_command"), defaults=(0.0, np.inf))
Thrust = namedtuple("Thrust", ("thrust_downrange", "thrust_vertical"))
Engine = namedtuple("Engine", ("thrust", "tilt"))
Disturbance = namedtuple("Disturbance", ("downrange", "vertical"))


def lander_rates(state, before, step, command: Thrust, vehicle, noise, p) -> LanderState:
    """Powered descent over flat ground (`models.dynamics.powered_descent`), the thrust within its limits.

    In the step in which the propellant runs out, the thrust is the mean one that burns what is left. So no step burns
    more, and the speed that the last of it gives is that of the rocket equation. Without propellant there is no thrust.
    """
    burning_all = (before.mass - p.dry_mass) * (1.0 / step) * (vehicle.specific_impulse * STANDARD_GRAVITY)
    most = select(burning_all > 0.0, burning_all, 0.0)
    wanted = thrust_magnitude(command.thrust_downrange, command.thrust_vertical)
    thrust = vehicle.thrust_scale * clip(wanted, vehicle.smallest_thrust, vehicle.largest_thrust)
    scale = select(thrust > most, most, thrust) / wanted
    changes = powered_descent_rates(
        state,
        (scale * command.thrust_downrange, scale * command.thrust_vertical),
        (p.thrust_noise * noise.downrange, p.thrust_noise * noise.vertical),
        p.gravity,
        1.0 / (vehicle.specific_impulse * STANDARD_GRAVITY),
    )
    return LanderState(*changes)


def engine_of(command: Thrust) -> Engine:
    """Thrust and its tilt, which is zero without thrust."""
    thrust = np.sqrt(
        command.thrust_downrange * command.thrust_downrange + command.thrust_vertical * command.thrust_vertical
    )
    return Engine(thrust, arctangent(command.thrust_downrange, command.thrust_vertical))


def thrust_of(engine: Engine, vehicle) -> Thrust:
    """Components of the thrust, which is within its limits until it is off."""
    given = clip(engine.thrust, vehicle.smallest_thrust, vehicle.largest_thrust) if engine.thrust > 0.0 else 0.0
    sine, cosine = sine_cosine(engine.tilt)
    return Thrust(given * sine, given * cosine)


def lander_watch(watched, command) -> LanderWatched:
    """Largest and smallest thrust that was commanded, before its limits."""
    wanted = thrust_magnitude(command.thrust_downrange, command.thrust_vertical)
    return LanderWatched(
        wanted if wanted > watched.max_command else watched.max_command,
        wanted if wanted < watched.min_command else watched.min_command,
    )


LANDER = Flight(lander_rates, watch=lander_watch, noise=Disturbance)
