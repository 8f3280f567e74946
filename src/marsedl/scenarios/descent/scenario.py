"""The descent as a scenario: what flies in which conditions, and what is told of every flight."""

from functools import cached_property
from typing import ClassVar

import numpy as np

from marsedl.elementary import arctangent
from marsedl.fly import Below, Error, Model, MultivariateNormal, Normal, Senses
from marsedl.fly.actuators import Actuator
from marsedl.scenarios.descent.dynamics import FLIGHT, Thrust, Vehicle
from marsedl.scenarios.descent.inputs import Inputs
from marsedl.scenarios.descent.onboard import COMMANDS, STATES, Onboard
from marsedl.scenarios.descent.residents import RESIDENTS
from marsedl.scenarios.scenario import Condition, Scenario

__all__ = ["SCENARIO", "DescentScenario"]

TOUCHDOWN = "touchdown"
SUBSTEPS = 2  # in a cycle: twice as many move the touchdown by less than a millimetre
QUANTITIES = {
    "downrange": ("m", "downrange"),
    "crossrange": ("m", "distance to the right of the plane of the mean flight"),
    "altitude": ("m", "altitude above the ground"),
    "downrange_velocity": ("m/s", "downrange velocity"),
    "crossrange_velocity": ("m/s", "velocity to the right"),
    "vertical_velocity": ("m/s", "vertical velocity, positive upwards"),
    "mass": ("kg", "mass as it is known on board"),
    **{f"thrust_{name}": ("N", f"thrust, {name}") for name in ("downrange", "crossrange", "vertical")},
    **{f"gust_{name}": ("N", f"force of gusts, {name}") for name in ("downrange", "crossrange", "vertical")},
    "saturated": ("1", "guidance cycles whose command is beyond the limits of the thrust"),
    "largest_command": ("N", "largest thrust that was commanded"),
    "widest": ("1", "square of the tangent of the largest angle from the vertical above the target"),
}
NO_ERRORS = {
    **dict.fromkeys(("truth.gust_deviation", "truth.thrust_deviation", "truth.mass_deviation"), 0.0),
    **dict.fromkeys((f"navigation.{of}_deviation" for of in ("position", "altitude", "velocity")), 0.0),
    **dict.fromkeys(("navigation.position_noise", "navigation.velocity_noise"), 0.0),
}


class DescentScenario(Scenario):
    """Powered descent to the ground."""

    name, paper, model, residents = "descent", "powered_descent", Inputs, RESIDENTS
    conditions: ClassVar = {
        "exact": Condition("exact", "start and thrust noise alone; laws know the state", NO_ERRORS),
        "dispersed": Condition("dispersed", "all dispersions"),
        "plane": Condition("dispersed", "all dispersions, in the plane of the mean flight", {"truth.across": 0.0}),
        "weak_thrust": Condition("wrong", "the thrust is 5 % lower than commanded", {"truth.thrust_factor": 0.95}),
        "heavy": Condition("wrong", "the mass is 3 % higher than known", {"truth.mass_offset": 45.0}),
        "altitude_bias": Condition("wrong", "3 m are added to the altitude", {"navigation.altitude_offset": 3.0}),
        "velocity_bias": Condition(
            "wrong", "0.5 m/s are added to the downrange velocity", {"navigation.velocity_offset": 0.5}
        ),
        "strong_gusts": Condition("wrong", "gusts are twice as strong", {"truth.gust_deviation": 250.0}),
    }
    columns: ClassVar = {
        "downrange_miss": ("m", "touchdown beyond the target"),
        "crossrange_miss": ("m", "touchdown to the right of the target"),
        "miss": ("m", "distance of the touchdown from the target"),
        "vertical_speed": ("m/s", "downwards at touchdown"),
        "horizontal_speed": ("m/s", "at touchdown"),
        "tilt": ("rad", "angle of the thrust from the vertical at touchdown"),
        "propellant": ("kg", "propellant used"),
        "saturated": ("1", "guidance cycles whose command was beyond the limits of the thrust"),
        "largest_command": ("N", "largest thrust that was commanded, before its limits"),
        "widest_angle": ("rad", "largest angle from the vertical above the target, as long as it is ten metres high"),
        "end_time": ("s", "time of the touchdown"),
        "of_box": ("1", "largest of miss, both speeds and tilt, each over its limit in the box"),
        "inside": ("1", "whether it landed within the box, slowly and upright"),
    }
    tails = (
        *("of_box", "vertical_speed", "horizontal_speed", "tilt", "propellant", "saturated"),
        *("largest_command", "widest_angle"),
    )
    digits, correlated, budgeted = (
        ".2f",
        "position and velocity at the start",
        ("downrange", "crossrange", "vertical_velocity"),
    )
    box = "near the target, slowly in both directions, and upright"

    @property
    def largest_miss(self):
        """That of the box."""
        return self.given.box.miss

    @cached_property
    def onboard(self) -> Onboard:
        """What guidance knows: the paper's inputs and those of the lander."""
        return Onboard(self.known, self.given.lander)

    def flight(self, condition):
        """Arguments of `fly`."""
        given, onboard = self.truth(condition), self.onboard
        truth, lander = given.truth, given.lander
        p = onboard.p._replace(
            noise=truth.noise_factor * onboard.p.noise,
            across=truth.across,
            gust=truth.gust_deviation,
            gust_time=truth.gust_time,
            target_downrange=float(onboard.goal[0]),
            target_crossrange=float(onboard.goal[1]),
        )
        vehicle = Vehicle(
            smallest_thrust=lander.smallest_thrust,
            largest_thrust=given.vehicle.maximum_thrust,
            thrust_factor=Normal(truth.thrust_factor, truth.thrust_deviation),
            mass_offset=Normal(truth.mass_offset, truth.mass_deviation),
        )
        model = Model(
            FLIGHT,
            p=p,
            vehicle=vehicle,
            quantities=QUANTITIES,
            actuators={name: Actuator(lag=lander.lag) for name in COMMANDS},
            failed=_lost(given),
        )
        return {
            "flies": model,
            "start": _start(given, onboard),
            "senses": _senses(given.navigation, truth.across),
            "trigger": {TOUCHDOWN: Below("altitude", 0.0)},
            "end_time": lander.time_limit,
            "period": lander.cycle,
            "substeps": SUBSTEPS,
        }

    def told(self, flights):
        """Numbers at touchdown, and the box: slow, upright and near the target."""
        final, box, onboard = flights.final, self.given.box, self.onboard
        named = {
            "downrange_miss": final["downrange"] - onboard.goal[0],
            "crossrange_miss": final["crossrange"] - onboard.goal[1],
            "vertical_speed": -final["vertical_velocity"],
            "horizontal_speed": _length(final["downrange_velocity"], final["crossrange_velocity"]),
            "tilt": _angles(_length(*(final[name] for name in Thrust._fields[:2])), final["thrust_vertical"]),
            "propellant": onboard.given.vehicle.wet_mass - final["mass"],
            **{name: final[name] for name in ("saturated", "largest_command")},
            "widest_angle": _angles(np.sqrt(final["widest"]), np.ones_like(final["widest"])),
            "end_time": final["end_time"],
        }
        named["miss"] = _length(named["downrange_miss"], named["crossrange_miss"])
        limited = ("miss", "vertical_speed", "horizontal_speed", "tilt")
        return TOUCHDOWN, named, {name: getattr(box, name) for name in limited}


def _length(first, second):
    """Length of a level vector."""
    return np.sqrt(first * first + second * second)


def _angles(across, up):
    """Angles from the vertical, rad, with the same bits on every machine."""
    return np.array([*map(arctangent, across.tolist(), up.tolist())])


def _lost(given: Inputs):
    """Outcomes of flights that did not land as they should, as `Model` takes them."""
    dry_mass = given.vehicle.wet_mass - given.lander.propellant
    box, limit = given.box, given.lander.time_limit

    def failed(p, final):
        down = final["end_time"] < limit
        speed = _length(final["downrange_velocity"], final["crossrange_velocity"])
        return {
            "toppled": down & (speed > box.broken * box.horizontal_speed),
            "crashed": down & (-final["vertical_velocity"] > box.broken * box.vertical_speed),
            "out of propellant": final["mass"] <= dry_mass,  # the last one that holds names the flight
        }

    return failed


def _start(given: Inputs, onboard: Onboard) -> dict:
    """Dispersed start with the gusts of the first moment."""
    truth = given.truth
    covariance = truth.start_factor**2 * onboard.start_covariance
    scale = np.array([1.0, truth.across, 1.0, 1.0, truth.across, 1.0])
    gusts = {
        "gust_downrange": Normal(0.0, truth.gust_deviation),
        "gust_crossrange": Normal(0.0, truth.across * truth.gust_deviation),
        "gust_vertical": Normal(0.0, truth.gust_deviation),
    }
    spread = MultivariateNormal(onboard.start, covariance * np.outer(scale, scale))
    return {STATES: spread, "mass": given.vehicle.wet_mass} | gusts


def _senses(nav, across) -> Senses:
    """What laws know with errors; across: factor on those across."""

    def error(deviation, noise, offset=0.0):
        return Error(bias=Normal(offset, deviation), noise=noise)

    return Senses(
        downrange=error(nav.position_deviation, nav.position_noise),
        crossrange=error(across * nav.position_deviation, across * nav.position_noise),
        altitude=error(nav.altitude_deviation, nav.position_noise, nav.altitude_offset),
        downrange_velocity=error(nav.velocity_deviation, nav.velocity_noise, nav.velocity_offset),
        crossrange_velocity=error(across * nav.velocity_deviation, across * nav.velocity_noise),
        vertical_velocity=error(nav.velocity_deviation, nav.velocity_noise),
    )


SCENARIO = DescentScenario
