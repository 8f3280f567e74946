"""The planet."""

from marsedl.replication.inputs.sections import Positive, Section, given


class CentralBody(Section):
    """A sphere and its gravity."""

    gravitational_parameter: Positive = given("m^3/s^2", "gravitational parameter of Mars")
    planet_radius: Positive = given("m", "radius of Mars; altitudes and distances on the ground are measured from it")
