"""What flies."""

from marsedl.replication.inputs.sections import Positive, Section, given


class EntryVehicle(Section):
    """A lifting capsule with constant coefficients."""

    ballistic_coefficient: Positive = given("kg/m^2", "ballistic coefficient")
    lift_to_drag: Positive = given("1", "lift-to-drag ratio")


class Propulsion(Section):
    """What thrust costs."""

    specific_impulse: Positive = given("s", "specific impulse of the engines")
    standard_gravity: Positive = given("m/s^2", "gravity in the definition of the specific impulse")
