"""Entry: the vehicle of the stochastic entry guidance from its interface to a parachute box, under any law."""

from functools import cached_property
from typing import ClassVar

import numpy as np

from marsedl.scenarios.entry import truth
from marsedl.scenarios.entry.inputs import Inputs
from marsedl.scenarios.entry.onboard import Onboard, entry_of
from marsedl.scenarios.entry.residents import RESIDENTS
from marsedl.scenarios.entry.watched import watching
from marsedl.scenarios.scenario import Condition, Scenario

__all__ = ["SCENARIO", "EntryScenario"]

SUTTON_GRAVES = 1.9027e-4  # kg^(1/2)/m, of the atmosphere of Mars
_EXACT = {
    "truth.vehicle_errors": 0.0,
    "truth.mass_deviation": 0.0,
    "truth.wind_deviation": 0.0,
    "truth.bank_acceleration_deg_s2": None,
    "truth.delay": 0.0,
    "navigation.position_deviation": 0.0,
    "navigation.velocity_deviation": 0.0,
    "navigation.drag_scale_deviation": 0.0,
    "navigation.drag_noise": 0.0,
}
_TABLE = {"air.density_profile": "table", "air.density_table": "data/atmosphere/mars_density.csv#marsgram_2021a_sample"}


class EntryScenario(Scenario):
    """What flies is declared in `truth`; laws are designed from `Onboard`."""

    name, paper, model, residents = "entry", "stochastic_entry", Inputs, RESIDENTS
    box = "at most 2.5 km from the nominal end, within 2 km of its altitude and 50 m/s of its velocity"
    tails = ("of_box", "max_load", "saturated", "reversals", "bank_moved", "peak_heat", "heat_load")
    digits, correlated, budgeted = ".0f", "lift and drag coefficients", ("range", "crossrange")
    conditions: ClassVar = {
        "exact": Condition("exact", "start and density dispersed, and both known", _EXACT),
        "dispersed": Condition("dispersed", "all errors; ends at a velocity"),
        "dispersed_time": Condition("dispersed", "all errors; ends at a time", {"truth.trigger": "time"}),
        "dispersed_range": Condition(
            "dispersed",
            "all errors; ends at a range: the miss is across alone, and who falls short is lost, so compare the box",
            {"truth.trigger": "range"},
        ),
        "random_field": Condition(
            "dispersed",
            "all errors, the density a Gaussian random field",
            {"truth.density_process": "gaussian_random_field"},
        ),
        "thin_air": Condition("wrong", "mean density 10 % lower than known", {"truth.density_factor": 0.9}),
        "thick_air": Condition("wrong", "mean density 10 % higher than known", {"truth.density_factor": 1.1}),
        "thicker_air": Condition("wrong", "mean density 30 % higher than known", {"truth.density_factor": 1.3}),
        "other_air": Condition("wrong", "mean density a table of MarsGRAM 2021a", _TABLE),
        "stuck_navigation": Condition(
            "wrong", "downrange navigated 2 km too far in all trials", {"navigation.downrange_offset_km": 2.0}
        ),
    }
    columns: ClassVar = {
        "downrange_miss": ("m", "end of the flight beyond that of the nominal"),
        "crossrange_miss": ("m", "end of the flight to the right of that of the nominal"),
        "miss": ("m", "horizontal distance from the end of the nominal"),
        "altitude_error": ("m", "altitude at the end above that of the nominal"),
        "velocity_error": ("m/s", "velocity at the end over that of the nominal"),
        "end_time": ("s", "time at the end"),
        "max_load": ("m/s^2", "largest aerodynamic load"),
        "saturated": ("1", "guidance periods in which the limits kept the bank angle from its command"),
        "reversals": ("1", "changes of sign of the commanded bank angle"),
        "bank_moved": ("rad", "way of the commanded bank angle"),
        "peak_heat": ("W/m^2", "largest heat rate, of a nose whose radius is a quarter of the diameter"),
        "heat_load": ("J/m^2", "heat of this nose over the flight"),
        "of_box": ("1", "largest of miss, altitude and velocity error, each over its limit in the box"),
        "inside": ("1", "whether it ended inside of the box"),
    }

    @property
    def largest_miss(self):
        """That of the box."""
        return self.given.box.largest_miss

    @cached_property
    def onboard(self) -> Onboard:
        """What guidance knows."""
        return Onboard(self.known)

    def flight(self, condition):
        """Arguments of `fly`."""
        given = self.truth(condition)
        flies = entry_of(
            given,
            air=truth.random_air(given),
            bank_rate=given.truth.bank_rate,
            bank_acceleration=given.truth.bank_acceleration,
            initial_bank=given.guidance.initial_bank_direction * given.guidance.nominal_bank_fast,
            delay=given.truth.delay,
            **truth.vehicle_errors(given),
        )
        return {
            "flies": watching(flies.model()),
            "start": truth.start_of(given),
            "together": truth.together_of(given),
            "senses": truth.senses_of(given),
            "trigger": truth.trigger_of(given, self.onboard.end),
            "end_time": given.mission.time_limit,
            "period": given.guidance.guidance_period,
            "substeps": given.truth.substeps,
        }

    def told(self, flights):
        """Numbers at the end, and the box about that of the nominal."""
        final, end, box = flights.final, self.onboard.end, self.given.box
        named = {
            "downrange_miss": final["range"] - end["range"],
            "crossrange_miss": final["crossrange"] - end["crossrange"],
            "altitude_error": final["altitude"] - end["altitude"],
            "velocity_error": final["velocity"] - end["velocity"],
            "end_time": final["end_time"],
            "max_load": final["max_load"],
            "saturated": final["saturated_bank"],
        }
        named["miss"] = np.sqrt(named["downrange_miss"] ** 2 + named["crossrange_miss"] ** 2)
        named |= {name: final[name] for name in ("reversals", "bank_moved")}
        nose = SUTTON_GRAVES / np.sqrt(0.25 * self.given.vehicle.reference_diameter)
        named |= {name: nose * final[name] for name in ("peak_heat", "heat_load")}
        limits = {
            "miss": box.largest_miss,
            "altitude_error": box.altitude_half_width,
            "velocity_error": box.velocity_half_width,
        }
        return "parachute", named, limits


SCENARIO = EntryScenario
