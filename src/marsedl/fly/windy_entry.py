"""The functions of an entry through wind, whose coefficients, density and planet may be dispersed; see `dynamics`."""

from collections import namedtuple

import numpy as np

from marsedl.elementary import exponential, sine_cosine
from marsedl.fly import dynamics
from marsedl.fly.dynamics import Bank, EntryFinal, EntryParameters, EntrySensed, EntryState, EntryStored
from marsedl.models.atmosphere import node_below
from marsedl.models.dynamics.entry import rates_of_directions
from marsedl.montecarlo.flights import Flight

_FACTORS = ("drag_factor", "lift_factor", "density_factor")
_PLANET = ("gravitational_parameter", "radius", "rotation_rate")
_WIND = ("zonal_wind", "meridional_wind")
WindyVehicle = namedtuple("WindyVehicle", (*dynamics.EntryVehicle._fields, *_FACTORS, *_PLANET))
WindyParameters = namedtuple("WindyParameters", (*EntryParameters._fields, "wind_from", "wind_by"))
WindyAir = namedtuple("WindyAir", (*dynamics.Air._fields, *_WIND))
WindyStored = namedtuple("WindyStored", (*EntryStored._fields, *_WIND))
WindyFinal = namedtuple("WindyFinal", (*EntryFinal._fields, *_WIND))


def look_up(state, air, p) -> WindyAir:
    """As `dynamics.look_up`, and the wind, held beyond its nodes; in `air` it comes after the variations."""
    still = dynamics.look_up(state, air, p)
    nodes = (len(air) - len(p.deviation)) // 2
    node, fraction = node_below((state.altitude - p.wind_from) / p.wind_by, nodes)
    zonal, meridional = len(p.deviation) + node, len(p.deviation) + nodes + node
    return WindyAir(
        still.log_density,
        still.factor,
        air[zonal] + fraction * (air[zonal + 1] - air[zonal]),
        air[meridional] + fraction * (air[meridional + 1] - air[meridional]),
    )


def through_the_air(velocity, path, heading, found):
    """Velocity through the air, up, east and north, m/s; path, heading: sines and cosines."""
    sine, cosine = path
    to_east, to_north = heading
    level = velocity * cosine
    return velocity * sine, level * to_east - found.zonal_wind, level * to_north - found.meridional_wind


def accelerations(airspeed, found, vehicle):
    """Density (kg/m^3), drag and lift (m/s^2) at an airspeed."""
    density = exponential(found.log_density) * found.factor * vehicle.density_factor
    declared = 0.5 / vehicle.ballistic_coefficient * density * airspeed * airspeed
    return density, vehicle.drag_factor * declared, vehicle.lift_factor * vehicle.lift_to_drag * declared


def rates(state, found, command: Bank, vehicle, p) -> EntryState:
    """Entry of a gliding point mass over a rotating sphere whose air moves.

    Drag is opposite to the velocity through the air, and lift is at right angles to it: without bank in its vertical
    plane. Without wind these are the rates of `models.dynamics.entry`.
    """
    path, heading = sine_cosine(state.flight_path_angle), sine_cosine(state.azimuth)
    (sin_path, cos_path), (sin_heading, cos_heading) = path, heading
    altitude, longitude, latitude, velocity, flight_path_angle, azimuth = rates_of_directions(
        vehicle.radius + state.altitude,
        state.velocity,
        sine_cosine(state.latitude),
        path,
        heading,
        (0.0, 1.0),
        0.0,
        (0.0, 0.0),
        (vehicle.gravitational_parameter, vehicle.rotation_rate),
        1.0,
    )
    up, east, north = through_the_air(state.velocity, path, heading, found)
    level = np.sqrt(east * east + north * north)
    airspeed = np.sqrt(up * up + level * level)
    _, drag, lift = accelerations(airspeed, found, vehicle)
    sin_bank, cos_bank = sine_cosine(command.bank)
    drag_of_velocity, raising, turning = drag / airspeed, lift * cos_bank / airspeed, lift * sin_bank / level
    slowing = drag_of_velocity + raising * up / level
    upwards = raising * level - drag_of_velocity * up
    eastwards, northwards = turning * north - slowing * east, -turning * east - slowing * north
    forwards = eastwards * sin_heading + northwards * cos_heading
    to_the_right = eastwards * cos_heading - northwards * sin_heading
    return EntryState(
        altitude,
        velocity + upwards * sin_path + forwards * cos_path,
        flight_path_angle + (upwards * cos_path - forwards * sin_path) / state.velocity,
        azimuth + to_the_right / (state.velocity * cos_path),
        latitude,
        longitude,
    )


def sense(state, found, vehicle, p) -> EntrySensed:
    """As `dynamics.entry_sense`, with the accelerations through the air that moves."""
    up, east, north = through_the_air(
        state.velocity, sine_cosine(state.flight_path_angle), sine_cosine(state.azimuth), found
    )
    airspeed = np.sqrt(up * up + east * east + north * north)
    density, drag, lift = accelerations(airspeed, found, vehicle)
    planet = (vehicle.gravitational_parameter, vehicle.radius)
    return dynamics.sensed_at(state, density, drag, lift, planet, p.frame)


def store(sensed, found, command: Bank) -> WindyStored:
    """As `dynamics.entry_store`, and the wind."""
    own = (command.bank, found.zonal_wind, found.meridional_wind)
    return WindyStored(*(sensed[:] + own))


def finish(time, sensed, found, watched) -> WindyFinal:
    """As `dynamics.entry_finish`, and the wind."""
    whole = dynamics.entry_watch(watched, sensed)
    wind = (found.zonal_wind, found.meridional_wind)
    return WindyFinal(time, *(sensed[:] + whole[:] + wind))


WINDY_ENTRY = Flight(
    rates,
    look_up=look_up,
    sense=sense,
    store=store,
    watch=dynamics.entry_watch,
    finish=finish,
    watch_steps=True,
)
