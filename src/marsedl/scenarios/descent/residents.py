"""The laws that live here: how each is designed from what is known on board.

All hold their commands over the same cycle, aim at the paper's final state at its final time, and sink to the ground
from then on in the same way. Laws that divide by the time to go take the same least one.
"""

from collections import namedtuple
from functools import partial
from typing import NamedTuple

import numpy as np

from marsedl.design import reference, steering
from marsedl.fly import Above, Below
from marsedl.methods.collocation import NotConvergedError
from marsedl.methods.covariance_steering.closed_form import steer
from marsedl.papers.powered_descent import segments
from marsedl.scenarios.descent import dynamics
from marsedl.scenarios.descent.dynamics import Forces, State, Thrust
from marsedl.scenarios.descent.onboard import PLANE, in_space
from marsedl.scenarios.scenario import Resident

__all__ = ["RESIDENTS"]

PERIODS = 20  # over each of which the cone program holds a command
CHANCE = 0.001  # with which it may break a limit at one time: a calibration, as with 0.01 flights were seen to topple
ROUNDING = 1e-6  # s

# ---- tables over time ------------------------------------------------------------------------------------------------


def no_feedback(onboard):
    """The paper's mean thrust."""
    commands, states = onboard.reference
    return onboard.table(commands, states, np.zeros((len(commands), 3, 6)))


def closed_form(onboard, middle_deviation=1.0, final_deviation=1.0, downrange_deviation=1.0):
    """Covariance steering of both segments in closed form.

    Factors are on the deviations that it steers to at the switch and at the end, and there on that downrange again.
    """
    divert = segments.divert_of(onboard.given)
    start, middle, end = divert.covariances
    targets = [start, middle_deviation**2 * middle, _scaled(end, final_deviation, downrange_deviation)]
    problems = segments.problems_of(divert._replace(covariances=targets), onboard.linearization)
    planar = np.concatenate([-steer(problem).gain for problem in problems])
    # Of the time at which a command acts, half of a hold and a lag later.
    acts = np.minimum(onboard.time[:-1] + 0.5 * onboard.lander.cycle + onboard.lander.lag, onboard.time[-1])
    at = np.minimum(np.searchsorted(onboard.nominal.time, acts, side="right") - 1, len(planar) - 1)
    return onboard.table(*onboard.reference, _gains_in_space(planar[at]))


def _scaled(covariance, factor, downrange):
    """A covariance of the plane with deviations times a factor, that of the downrange times another one, too."""
    factors = factor * np.array([downrange, 1.0, 1.0, 1.0])
    return covariance * np.outer(factors, factors)


def _gains_in_space(planar):
    """Gains of the plane, (N, 2, 4), with those across the same as downrange, (N, 3, 6)."""
    gains = np.zeros((len(planar), 3, 6))
    gains[:, [[0], [2]], PLANE] = planar
    gains[:, 1, [1, 4]] = planar[:, 0, [0, 2]]
    return gains


def regulator(onboard, position_weight=0.1, velocity_weight=0.1):
    """Time-varying linear-quadratic regulator along the paper's mean trajectory."""
    gains = onboard.regulated(onboard.mass(onboard.time), position_weight, velocity_weight)
    return onboard.table(*onboard.reference, gains)


def fuel_optimal(onboard, margin=0.15, position_weight=0.1, velocity_weight=0.1):
    """Reference of least propellant, a margin of the largest thrust within its limits, and the regulator along it."""
    smallest, largest = onboard.vehicle.smallest_thrust, onboard.vehicle.largest_thrust
    mass = onboard.given.vehicle.wet_mass
    try:
        best = reference.optimal(
            dynamics.rates,
            onboard.p,
            [*onboard.start, mass],
            [*onboard.goal, np.nan],
            onboard.time[-1],
            dynamics.magnitude,
            [
                Above(dynamics.magnitude, smallest + margin * largest),
                Below(dynamics.magnitude, largest - margin * largest),
                Above(_over_the_slope(onboard), 0.0),
            ],
            guess=[0.0, 0.0, mass * onboard.given.planet.gravity],
            intervals=round(onboard.time[-1]),
            vehicle=onboard.vehicle,
            noise=Forces,
        )
    except NotConvergedError as error:
        raise ValueError(f"there is no reference of least propellant: {error}") from None
    profile = np.stack(best.commands, axis=1)
    flown = onboard.flown(onboard.over_cycles(best.time, profile))
    commands = onboard.over_cycles(best.time, profile, onboard.lander.lag)
    return onboard.table(commands, flown[:, :6], onboard.regulated(flown[:, 6], position_weight, velocity_weight))


def _over_the_slope(onboard):
    """Function of a state: height over the glide slope, whose cone stands on the ground below the target."""
    slope, target = float(np.tan(onboard.lander.glide_slope)), onboard.goal

    def over_the_slope(state):
        downrange, crossrange = state.downrange - target[0], getattr(state, "crossrange", target[1]) - target[1]
        return state.altitude - slope * np.sqrt(downrange * downrange + crossrange * crossrange + 1.0)

    return over_the_slope


# State (m and m/s), command (N) and white noise in the plane.
Planar = namedtuple("Planar", [State._fields[place] for place in PLANE])
PlanarThrust = namedtuple("PlanarThrust", ("thrust_downrange", "thrust_vertical"))
PlanarForces = namedtuple("PlanarForces", ("downrange", "vertical"))


class Held(NamedTuple):
    """The lander with a mass that stays."""

    mass: float  # kg
    p: dynamics.Parameters
    vehicle: dynamics.Vehicle


def planar_rates(state, command: PlanarThrust, noise: PlanarForces, p) -> Planar:
    """The equations of the lander in the plane, at a mass that stays."""
    moved = dynamics.rates(
        State(state.downrange, 0.0, state.altitude, state.downrange_velocity, 0.0, state.vertical_velocity, p.mass),
        Thrust(command.thrust_downrange, 0.0, command.thrust_vertical),
        Forces(noise.downrange, 0.0, noise.vertical),
        p.vehicle,
        p.p,
    )
    return Planar(moved.downrange, moved.altitude, moved.downrange_velocity, moved.vertical_velocity)


def cone_program(onboard, final_deviation=1.1, downrange_deviation=1.0):
    """Covariance steering by cone programs; factors on the deviations that it may end with, as in the closed form."""
    times = np.linspace(0.0, onboard.time[-1], PERIODS + 1)
    mass = float(onboard.mass(0.5 * onboard.time[-1]))
    covariance = _scaled(onboard.given.mission.final_covariance, final_deviation, downrange_deviation)
    designed = steering.solve(
        planar_rates,
        Held(mass, onboard.p, onboard.vehicle),
        times,
        start=(onboard.start[PLANE], onboard.given.entry.initial_covariance),
        goal=(onboard.goal[PLANE], covariance),
        guess=[0.0, mass * onboard.given.planet.gravity],
        limits=[
            Below(_planar_magnitude, onboard.vehicle.largest_thrust, CHANCE),
            Above(_planar_magnitude, onboard.vehicle.smallest_thrust, CHANCE),
            Above(_over_the_slope(onboard), 0.0, CHANCE),
        ],
        substeps=1,
        iterations=6,  # it converges in two
    )
    # Accelerations as designed: the thrust falls with the mass.
    profile = np.insert(designed.command, 1, 0.0, axis=1) / mass
    commands = onboard.over_cycles(times, profile, onboard.lander.lag) * onboard.mass(onboard.time[:-1])[:, None]
    velocity = np.stack([np.interp(onboard.time, times, part) for part in designed.state[:, 2:].T], axis=1)
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * onboard.lander.cycle, axis=0)
    position = onboard.start[[0, 2]] + np.vstack([np.zeros(2), moved])
    middle = 0.5 * (times[1:] + times[:-1])
    gains = [np.interp(onboard.time[:-1], middle, part) for part in designed.gain.reshape(PERIODS, -1).T]
    planar = np.stack(gains, axis=1).reshape(-1, 2, 4)
    return onboard.table(commands, in_space(np.hstack([position, velocity])), _gains_in_space(planar))


def _planar_magnitude(command):
    """Norm of a thrust in the plane, N."""
    return dynamics.magnitude(Thrust(command.thrust_downrange, 0.0, command.thrust_vertical))


# ---- laws of the time to go ------------------------------------------------------------------------------------------


class Aim(NamedTuple):
    """Where laws of the time to go aim at, and how they sink to the ground afterwards."""

    end_time: float  # s
    least_time_to_go: float  # s
    downrange: float  # m
    altitude: float
    gravity: float  # m/s^2
    sink_speed: float  # m/s
    sink_gain: float  # 1/s
    number: float  # that the law has of its own


def _aim(onboard, number) -> Aim:
    """The paper's final state, which is at rest."""
    lander, goal = onboard.lander, onboard.goal
    place = (float(goal[0]), float(goal[2]))
    sink = (onboard.p.gravity, lander.sink_speed, lander.sink_gain)
    return Aim(float(onboard.time[-1]), lander.least_time_to_go, *place, *sink, float(number))


def quadratic(time, nav, law: Aim) -> Thrust:
    r"""Apollo's descent guidance: acceleration quadratic in time, with a given one of the thrust at the end.

    $a = \frac{12}{T^2} (r_f - r) - \frac{6}{T} (v + v_f) + a_f$
    """
    to_go = law.end_time - time
    inverse = 1.0 / (to_go if to_go > law.least_time_to_go else law.least_time_to_go)
    of_place, of_speed = 12.0 * inverse * inverse, 6.0 * inverse
    return thrust_of(
        to_go,
        nav,
        law,
        of_place * (law.downrange - nav.downrange) - of_speed * nav.downrange_velocity,
        -of_place * nav.crossrange - of_speed * nav.crossrange_velocity,
        of_place * (law.altitude - nav.altitude) - of_speed * nav.vertical_velocity + law.number,
    )


def zero_effort(time, nav, law: Aim) -> Thrust:
    r"""Zero-effort miss M and velocity error E, without thrust until the end; n is the law's number.

    $a = \frac{(n + 2)(n + 3)}{T^2} M - \frac{(n + 1)(n + 2)}{T} E$
    """
    to_go, n = law.end_time - time, law.number
    horizon = to_go if to_go > law.least_time_to_go else law.least_time_to_go
    of_miss = (n + 2.0) * (n + 3.0) / (horizon * horizon)
    of_error = (n + 1.0) * (n + 2.0) / horizon
    fall = law.gravity * horizon
    climb = nav.vertical_velocity
    return thrust_of(
        to_go,
        nav,
        law,
        of_miss * (law.downrange - nav.downrange - nav.downrange_velocity * horizon)
        + of_error * nav.downrange_velocity,
        -of_miss * (nav.crossrange + nav.crossrange_velocity * horizon) + of_error * nav.crossrange_velocity,
        of_miss * (law.altitude - nav.altitude - (climb - 0.5 * fall) * horizon) + of_error * (climb - fall),
    )


def thrust_of(to_go, nav, law, downrange, crossrange, vertical) -> Thrust:
    """Thrust of the accelerations that a law asks for, m/s^2; after its end that which sinks to the ground."""
    flies = to_go > ROUNDING
    sinks = law.gravity - law.sink_gain * (nav.vertical_velocity + law.sink_speed)
    return Thrust(
        nav.mass * (downrange if flies else -law.sink_gain * nav.downrange_velocity),
        nav.mass * (crossrange if flies else -law.sink_gain * nav.crossrange_velocity),
        nav.mass * (vertical if flies else sinks),
    )


def apollo(onboard, final_acceleration=None):
    """Apollo's quadratic law; the number is the thrust at the end over the mass, by default the weight's, m/s^2."""
    number = onboard.p.gravity if final_acceleration is None else final_acceleration
    return partial(quadratic, law=_aim(onboard, number))


def zem_zev(onboard, order=0.0):
    """Zero-effort miss and velocity error; the order is n of the least effort over the time to go to the power of n."""
    return partial(zero_effort, law=_aim(onboard, order))


# ---- all of them -----------------------------------------------------------------------------------------------------

ONE_SEGMENT = "no state in the middle, which the paper's two segments have"
LIKE_DOWNRANGE = "gains across are those downrange, as the paper's law is planar and does not couple the axes"
TUNED_REGULATOR = {"position_weight": (1e-3, 10.0), "velocity_weight": (1e-3, 10.0)}
DEVIATIONS = {"middle_deviation": (0.4, 1.5), "final_deviation": (0.6, 1.5), "downrange_deviation": (0.25, 1.0)}
RESIDENTS = {
    "no_feedback": Resident(
        "mean thrust of the powered-descent paper over time", no_feedback, differs="feedback only while it sinks"
    ),
    "closed_form": Resident(
        "covariance steering in closed form, of the powered-descent paper", closed_form, DEVIATIONS, LIKE_DOWNRANGE
    ),
    "cone_program": Resident(
        "covariance steering by cone programs, with chances of thrust and glide slope",
        cone_program,
        {"final_deviation": (1.06, 1.3), "downrange_deviation": (0.25, 1.0)},
        f"{ONE_SEGMENT}; designed in the plane with a mean mass and commands held for 2 s, flown with gains between "
        f"those; {LIKE_DOWNRANGE}",
    ),
    "regulator": Resident(
        "linear-quadratic regulator along the mean trajectory of the powered-descent paper", regulator, TUNED_REGULATOR
    ),
    "fuel_optimal": Resident(
        "least propellant within margins of thrust and glide slope, with a linear-quadratic regulator",
        fuel_optimal,
        {"margin": (0.05, 0.2)} | TUNED_REGULATOR,
        ONE_SEGMENT,
    ),
    "apollo": Resident(
        "Apollo's quadratic law", apollo, {"final_acceleration": (2.0, 8.0)}, f"{ONE_SEGMENT}; feedback of the mass"
    ),
    "zem_zev": Resident(
        "zero-effort miss and velocity error", zem_zev, {"order": (0.01, 0.2)}, f"{ONE_SEGMENT}; feedback of the mass"
    ),
}
