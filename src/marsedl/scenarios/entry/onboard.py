"""What guidance knows before the flight: vehicle, planet, mean density and the nominal flight, without any error."""

from functools import cached_property

import numpy as np

from marsedl.fly import Entry, Planet, Table
from marsedl.fly.dynamics import EntryState, frame_of, sensed_at
from marsedl.papers.stochastic_entry import dispersions, environment, flight, gains, linearization, nominal
from marsedl.papers.stochastic_entry.inputs import Inputs

__all__ = ["Onboard", "entry_of", "start_of"]


class Onboard:
    """The entry guidance's own inputs, and what is computed from them when it is asked for.

    Laws are designed from it alone: it knows nothing of the truth of a trial.
    """

    def __init__(self, given: Inputs):
        """Take its inputs."""
        self.given = given

    @cached_property
    def nominal(self):
        """The nominal flight."""
        return nominal.compute(self.given)

    @cached_property
    def linearization(self):
        """The linear model about it, with the density as a state."""
        return linearization.compute(self.given, self.nominal)

    @cached_property
    def gains(self):
        """Gains of the Apollo law and of the stochastic law."""
        return gains.compute(self.given.guidance, self.given.design, self.linearization)

    @cached_property
    def settings(self) -> flight.Settings:
        """Constants of the guidance."""
        return flight.settings(self.given, environment.undisturbed(environment.atmosphere(self.given.air)))

    @property
    def entry(self) -> Entry:
        """The vehicle in its mean air."""
        return entry_of(self.given)

    @cached_property
    def end(self) -> dict[str, float]:
        """End of the nominal flight, where the box is: range and crossrange as laws are told them, and more."""
        names = ("altitude", "velocity", "flight_path_angle", "azimuth", "latitude", "longitude")
        state = {name: float(getattr(self.nominal, name)[-1]) for name in names}
        start, planet = start_of(self.given), self.given.planet
        pull = (planet.gravitational_parameter, planet.planet_radius)
        sensed = sensed_at(EntryState(**state), 0.0, 0.0, 0.0, pull, frame_of(start))
        place = {"range": sensed.range, "crossrange": sensed.crossrange, "energy": sensed.energy}
        return state | place | {"end_time": float(self.nominal.end_time)}


def entry_of(given: Inputs, **changed) -> Entry:
    """The vehicle of these inputs; changed: arguments of `Entry` in place of theirs."""
    air = environment.atmosphere(given.air)
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    planet = given.planet
    arguments = {
        "ballistic_coefficient": 0.5 / drag_factor,
        "lift_to_drag": lift_factor / drag_factor,
        "planet": Planet(planet.gravitational_parameter, planet.planet_radius, planet.rotation_rate),
        "air": Table(np.column_stack([air.altitude, np.exp(air.log_density)])),
    }
    return Entry(**arguments | changed)


def start_of(given: Inputs) -> dict[str, float]:
    """Mean state at the entry interface, SI and rad."""
    mean = dispersions.entry_mean(given.planet, given.mission)
    names = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "azimuth")
    return dict(zip(names, map(float, mean - np.eye(6)[0] * given.planet.planet_radius), strict=True))
