"""Five vehicles that no paper has, each as a user writes it down once: for steering and for whatever else designs."""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from marsedl.elementary import exponential, sine_cosine
from marsedl.fly import Above, Below


class Case(NamedTuple):
    """What `steering.solve` takes."""

    rates: Any
    p: tuple
    times: np.ndarray
    start: tuple
    goal: tuple
    guess: list
    limits: list = []  # noqa: RUF012 (not changed)
    options: dict = {}  # noqa: RUF012

    def asked(self):
        """Arguments of `steering.solve`, by name but for the first three."""
        return {"start": self.start, "goal": self.goal, "guess": self.guess, "limits": self.limits, **self.options}


# ---- double integrator -----------------------------------------------------------------------------------------------


class Line(NamedTuple):
    position: float
    velocity: float


class Push(NamedTuple):
    push: float


class Gust(NamedTuple):
    gust: float


class Pushed(NamedTuple):
    gusts: float = 0.05  # m/s^(3/2)


def line_rates(state, command: Push, noise: Gust, p) -> Line:
    return Line(state.velocity, command.push + p.gusts * noise.gust)


LINE = Case(
    line_rates,
    Pushed(),
    np.linspace(0.0, 10.0, 21),
    ([10.0, 0.0], [0.5, 0.1]),
    ([0.0, 0.0], [0.2, 0.1]),
    [0.0],
    [Below(lambda command: np.abs(command.push), 0.6, 0.01), Above("velocity", -1.7, 0.02)],
)

# ---- lander with three components of thrust --------------------------------------------------------------------------


Descent = namedtuple("Descent", "x y z vx vy vz mass")
Thrust = namedtuple("Thrust", "tx ty tz")


class Lander(NamedTuple):
    gravity: float = 3.71  # m/s^2
    exhaust: float = 2157.0  # m/s
    gusts: float = 150.0  # N s^(1/2)


def thrust_of(command):
    return np.sqrt(command.tx * command.tx + command.ty * command.ty + command.tz * command.tz + 1e-9)


def glide_slope(state):
    return state.z - 0.1 * np.sqrt(state.x * state.x + state.y * state.y + 1.0)


def lander_rates(state, command: Thrust, noise: Thrust, p) -> Descent:
    a, burnt = 1.0 / state.mass, -thrust_of(command) / p.exhaust
    ax, ay = (command.tx + p.gusts * noise.tx) * a, (command.ty + p.gusts * noise.ty) * a
    az = (command.tz + p.gusts * noise.tz) * a - p.gravity
    return Descent(state.vx, state.vy, state.vz, ax, ay, az, burnt)


LANDER = Case(
    lander_rates,
    Lander(),
    np.linspace(0.0, 45.0, 16),
    ([-800.0, 300.0, 1500.0, 60.0, -10.0, -70.0, 1900.0], [40.0, 40.0, 20.0, 2.0, 2.0, 2.0, 1e-3]),
    ([0.0, 0.0, 0.0, 0.0, 0.0, -1.0, np.nan], [5.0, 5.0, 2.0, 1.0, 1.0, 0.5, 50.0]),
    [0.0, 0.0, 7000.0],
    [Below(thrust_of, 16e3, 0.001), Above(glide_slope, -5.0, 0.001)],
)

# ---- capsule that flies by its angle of attack's lift ----------------------------------------------------------------


Entry = namedtuple("Entry", "altitude velocity flight_path_angle downrange")
Lift = namedtuple("Lift", "lift_to_drag")
Density = namedtuple("Density", "density")


class Capsule(NamedTuple):
    ballistic_coefficient: float = 115.0  # kg/m^2
    surface_density: float = 0.0159  # kg/m^3
    scale_height: float = 11.1e3  # m
    density_noise: float = 0.05  # of the density, s^(1/2)


def capsule_rates(state, command: Lift, noise: Density, p) -> Entry:
    sine, cosine = sine_cosine(state.flight_path_angle)
    disturbed = 1.0 + p.density_noise * noise.density
    density = p.surface_density * exponential(-state.altitude / p.scale_height) * disturbed
    drag = 0.5 * density * state.velocity * state.velocity / p.ballistic_coefficient
    falling = (state.velocity / 3396e3 - 3.71 / state.velocity) * cosine
    turn = command.lift_to_drag * drag / state.velocity + falling
    return Entry(state.velocity * sine, -drag - 3.71 * sine, turn, state.velocity * cosine)


CAPSULE = Case(
    capsule_rates,
    Capsule(),
    np.linspace(0.0, 150.0, 16),
    ([60e3, 5300.0, np.radians(-10.0), 0.0], [400.0, 10.0, np.radians(0.05), 1000.0]),
    ([np.nan, np.nan, np.nan, 400e3], [2500.0, 60.0, np.radians(6.0), 1200.0]),
    [0.14],
    [Below("lift_to_drag", 0.3, 0.01), Above("lift_to_drag", -0.05, 0.01)],
)

# ---- car on a plane --------------------------------------------------------------------------------------------------


Car = namedtuple("Car", "east north heading speed")
Pedals = namedtuple("Pedals", "curvature acceleration")
Wheels = namedtuple("Wheels", "slip push")


class Road(NamedTuple):
    slip: float = 0.01  # rad/s^(1/2)
    push: float = 0.1  # m/s^(3/2)


def car_rates(state, command: Pedals, noise: Wheels, p) -> Car:
    sine, cosine = sine_cosine(state.heading)
    turn = state.speed * command.curvature + p.slip * noise.slip
    return Car(state.speed * cosine, state.speed * sine, turn, command.acceleration + p.push * noise.push)


CAR = Case(
    car_rates,
    Road(),
    np.linspace(0.0, 10.0, 21),
    ([0.0, 0.0, 0.0, 8.0], [0.3, 0.3, 0.02, 0.2]),
    ([80.0, 20.0, 0.0, 10.0], [0.5, 0.3, 0.03, 0.3]),
    [0.0, 0.2],
    [Below(lambda state: state.north, 21.0, 0.01), Below(lambda command: np.abs(command.acceleration), 1.5, 0.01)],
    {"weights": [1e3, 1.0]},
)

# ---- satellite that meets another one --------------------------------------------------------------------------------


Relative = namedtuple("Relative", "radial along radial_rate along_rate")
Jets = namedtuple("Jets", "jet_radial jet_along")


class Orbit(NamedTuple):
    motion: float = 0.00113  # rad/s
    noise: float = 2e-4  # m/s^(3/2)


def satellite_rates(state, command: Jets, noise: Jets, p) -> Relative:
    radial = 3.0 * p.motion * p.motion * state.radial + 2.0 * p.motion * state.along_rate
    along = -2.0 * p.motion * state.radial_rate
    pushed = radial + command.jet_radial + p.noise * noise.jet_radial
    return Relative(state.radial_rate, state.along_rate, pushed, along + command.jet_along + p.noise * noise.jet_along)


SATELLITE = Case(
    satellite_rates,
    Orbit(),
    np.linspace(0.0, 1200.0, 13),
    ([-400.0, -2000.0, 0.0, 0.7], [20.0, 20.0, 0.05, 0.05]),
    ([0.0, -100.0, 0.0, 0.0], [3.0, 3.0, 0.02, 0.02]),
    [0.0, 0.0],
    [Below(lambda command: np.sqrt(command.jet_radial**2 + command.jet_along**2), 0.0055, 0.01)],
)

CASES = {"line": LINE, "lander": LANDER, "capsule": CAPSULE, "car": CAR, "satellite": SATELLITE}
