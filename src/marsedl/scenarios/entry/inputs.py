"""Typed inputs of the entry: those of the stochastic entry guidance, and what is true without being known on board."""

from typing import Literal

from marsedl.papers.stochastic_entry import inputs
from marsedl.papers.stochastic_entry.inputs import Substeps
from marsedl.replication.inputs.sections import NonNegative, Number, Positive, Section, given, vector

__all__ = ["Box", "Flown", "Inputs", "Navigation", "Truth"]


class Truth(Section):
    """What flies."""

    density_process: Literal["ornstein_uhlenbeck", "gaussian_random_field", "none"] = given(
        "1", "variation of the density: of the stochastic entry guidance, of the aerocapture paper, or none"
    )
    correlation_length: Positive = given("m", "of the Gaussian random field")
    density_factor: Positive = given("1", "true mean density over that known on board")
    vehicle_errors: NonNegative = given("1", "errors of lift and drag coefficient, in those of the paper")
    mass_deviation: NonNegative = given("1", "standard deviation of the mass, over the mass")
    wind_deviation: NonNegative = given("m/s", "standard deviation of each component of the wind")
    wind_length: Positive = given("m", "correlation length of the wind over altitude")
    bank_rate: Positive = given("rad/s", "largest rate of the bank angle")
    bank_acceleration: Positive | None = given("rad/s^2", "largest acceleration of the bank angle; empty: no limit")
    delay: NonNegative = given("s", "time after which a command begins to act")
    trigger: Literal["velocity", "time", "range"] = given(
        "1", "what ends the flight, at the nominal's end: its velocity, its time, or its distance flown"
    )
    substeps: Substeps = given("1", "integration steps in a guidance period")


class Navigation(Section):
    """Errors of what is known on board; all zero: nothing is navigated, and laws know the state and the density."""

    position_deviation: NonNegative = given("m", "constant error of altitude, downrange and crossrange, each")
    velocity_deviation: NonNegative = given("m/s", "constant error of the velocity in three directions, each")
    drag_scale_deviation: NonNegative = given("1", "constant error of the sensed drag and lift, over these")
    drag_noise: NonNegative = given("m/s^2", "of the sensed drag, new in every guidance period")
    least_drag: Positive = given("m/s^2", "drag below which the sensed density is not believed")
    altitude_offset: Number = given("m", "mean error of the altitude, the same in all trials")
    downrange_offset: Number = given("m", "mean error of the downrange, the same in all trials")


class Box(Section):
    """Where the parachute may open, about the end of the nominal flight."""

    largest_miss: Positive = given("m", "largest horizontal distance")
    altitude_half_width: Positive = given("m", "largest difference of the altitude")
    velocity_half_width: Positive = given("m/s", "largest difference of the velocity")


class Flown(Section):
    """What is known of the entry of the Mars Science Laboratory on 6 August 2012, with which flights are compared."""

    altitude: Positive = given("m", "a minute after the entry interface")
    loads: vector(2) = given("m/s^2", "least and largest of what was told of the largest deceleration")
    load_time: Positive = given("s", "time of the largest deceleration after the entry interface")
    reversals: NonNegative = given("1", "of the bank angle, before the heading alignment")
    parachute: vector(2) = given("SI", "altitude, m, and velocity, m/s, at which the parachute was expected to open")


class Inputs(inputs.Inputs):
    """All inputs of the scenario."""

    truth: Truth
    navigation: Navigation
    box: Box
    flown: Flown
