"""A probe under its parachute, with a law that remembers: a user's own model, for the tests and their processes."""

from typing import NamedTuple

from marsedl.fly import Model, Normal
from marsedl.montecarlo.flights import Flight


class State(NamedTuple):
    altitude: float
    speed: float = -20.0


class Push(NamedTuple):
    up: float


class Probe(NamedTuple):
    drag: float


class Parameters(NamedTuple):
    gravity: float = 3.71


class Gust(NamedTuple):
    up: float


class Memory(NamedTuple):
    error: float = 0.0


class Gains(NamedTuple):
    gain: float = 0.1


def rates(state, vehicle, command: Push, noise, p) -> State:
    return State(state.speed, vehicle.drag * state.speed * state.speed - p.gravity + 0.5 * noise.up + command.up)


def guide(sensed, memory, law: Gains = Gains()) -> tuple[Push, Memory]:  # noqa: B008
    error = 0.8 * memory.error + 0.2 * (-15.0 - sensed.speed)
    return Push(law.gain * error), Memory(error)


def falls(state) -> State:
    return State(state.speed, -3.71)


def ended(state) -> float:
    return state.altitude


ENDS, STEERS = Flight(falls, ended=ended), Flight(rates, guide=guide)
PROBE = Model(
    Flight(rates, noise=Gust),
    Parameters(),
    Probe(Normal(0.0093, 0.0005)),
    {"altitude": ("m", "altitude"), "speed": ("m/s", "climb rate")},
)
