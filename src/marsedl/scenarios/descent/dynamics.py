"""Powered descent in three dimensions, with and without gusts: one set of equations for flights and designs.

The plane is a special case: what starts in it and meets no forces across stays in it.
"""

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from marsedl.elementary import clip, select
from marsedl.montecarlo.flights import Flight

__all__ = ["FLIGHT", "Forces", "Parameters", "State", "Thrust", "Vehicle", "magnitude", "rates"]

LOW = 10.0  # m, below which it does not matter from which side the lander comes
SMALLEST_SQUARED_THRUST = 1e-300  # keeps a direction's derivative finite at zero thrust


class State(NamedTuple):
    """Of the lander; downrange, across to the right, and up."""

    downrange: float  # m
    crossrange: float
    altitude: float
    downrange_velocity: float  # m/s
    crossrange_velocity: float
    vertical_velocity: float
    mass: float  # kg, as it is known on board


GUSTS = ("gust_downrange", "gust_crossrange", "gust_vertical")
Gusty = namedtuple("Gusty", (*State._fields, *GUSTS))  # state, and gusts in N


class Thrust(NamedTuple):
    """Command, N."""

    thrust_downrange: float
    thrust_crossrange: float
    thrust_vertical: float


class Forces(NamedTuple):
    """White noise of the thrust."""

    downrange: float
    crossrange: float
    vertical: float


Disturbances = namedtuple("Disturbances", (*Forces._fields, *GUSTS))  # white noise of thrust and gusts


class Parameters(NamedTuple):
    """Of all trials."""

    gravity: float  # m/s^2
    mass_flow: float  # kg/(N s)
    dry_mass: float  # kg, without propellant
    noise: float  # of the thrust, N s^(1/2)
    across: float = 1.0  # of noise and gusts, over those downrange
    gust: float = 0.0  # standard deviation, N
    gust_time: float = 1.0  # s
    target_downrange: float = 0.0  # m
    target_crossrange: float = 0.0


class Vehicle(NamedTuple):
    """Of a trial."""

    smallest_thrust: float  # N
    largest_thrust: float
    thrust_factor: float = 1.0  # true over commanded thrust
    mass_offset: float = 0.0  # kg, true mass minus that known on board


class Watched(NamedTuple):
    """What is told of a whole flight."""

    saturated: float = 0.0  # cycles whose command is beyond the limits of the thrust
    largest_command: float = 0.0  # thrust, N
    widest: float = 0.0  # square of the tangent of the largest angle from the vertical above the target, when above LOW


def magnitude(command):
    """Norm of a thrust, N."""
    level = command.thrust_downrange * command.thrust_downrange + command.thrust_crossrange * command.thrust_crossrange
    return np.sqrt(level + command.thrust_vertical * command.thrust_vertical + SMALLEST_SQUARED_THRUST)


def motion(state, thrust, force, vehicle, p) -> State:
    """Rates under a commanded thrust and forces (downrange, crossrange, vertical), N.

    A command of zero, which has no direction, gives no thrust, whatever the smallest one is; nor is there any without
    propellant.
    """
    wanted = magnitude(thrust)
    given = vehicle.thrust_factor * clip(wanted, vehicle.smallest_thrust, vehicle.largest_thrust)
    scale, inverse = select(state.mass > p.dry_mass, given / wanted, 0.0), 1.0 / (state.mass + vehicle.mass_offset)
    flown = Thrust(scale * thrust.thrust_downrange, scale * thrust.thrust_crossrange, scale * thrust.thrust_vertical)
    return State(
        state.downrange_velocity,
        state.crossrange_velocity,
        state.vertical_velocity,
        (flown.thrust_downrange + force[0]) * inverse,
        (flown.thrust_crossrange + force[1]) * inverse,
        (flown.thrust_vertical + force[2]) * inverse - p.gravity,
        -p.mass_flow * magnitude(flown),
    )


def rates(state, command: Thrust, noise: Forces, vehicle, p) -> State:
    """Without gusts: what designs know."""
    force = (p.noise * noise.downrange, p.noise * p.across * noise.crossrange, p.noise * noise.vertical)
    return motion(state, command, force, vehicle, p)


def gusty_rates(state, command: Thrust, noise, vehicle, p) -> Gusty:
    """With gusts, an Ornstein-Uhlenbeck process in time for each component."""
    force = (
        p.noise * noise.downrange + state.gust_downrange,
        p.noise * p.across * noise.crossrange + state.gust_crossrange,
        p.noise * noise.vertical + state.gust_vertical,
    )
    moved = motion(state, command, force, vehicle, p)
    decay, fresh = 1.0 / p.gust_time, p.gust * np.sqrt(2.0 / p.gust_time)
    gusts = (
        fresh * noise.gust_downrange - decay * state.gust_downrange,
        fresh * p.across * noise.gust_crossrange - decay * state.gust_crossrange,
        fresh * noise.gust_vertical - decay * state.gust_vertical,
    )
    return Gusty(*(moved[:] + gusts))


def sense(state) -> State:
    """All but the gusts."""
    return State(
        state.downrange,
        state.crossrange,
        state.altitude,
        state.downrange_velocity,
        state.crossrange_velocity,
        state.vertical_velocity,
        state.mass,
    )


def watch(watched, state, command, vehicle, p) -> Watched:
    """Count commands beyond the limits; largest command; and how flat the lander is seen from the target."""
    wanted = magnitude(command)
    beyond = wanted < vehicle.smallest_thrust or wanted > vehicle.largest_thrust
    ahead, right = state.downrange - p.target_downrange, state.crossrange - p.target_crossrange
    high = state.altitude if state.altitude > LOW else LOW
    widest = (ahead * ahead + right * right) / (high * high) if state.altitude > LOW else 0.0
    return Watched(
        watched.saturated + (1.0 if beyond else 0.0),
        wanted if wanted > watched.largest_command else watched.largest_command,
        widest if widest > watched.widest else watched.widest,
    )


FLIGHT = Flight(gusty_rates, noise=Disturbances, sense=sense, watch=watch, watch_steps=False)
