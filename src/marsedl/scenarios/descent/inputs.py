"""Typed inputs of the descent: those of the powered descent, and what flies beside what is known on board."""

import math

from marsedl.papers.powered_descent import inputs
from marsedl.replication.inputs.sections import NonNegative, Number, Positive, Section, given
from marsedl.sections.checks import require_at_most

__all__ = ["Box", "Inputs", "Lander", "Navigation", "Truth"]

LARGEST_CYCLES = 10_000


class Lander(Section):
    """What is known on board of the vehicle and of its way to the ground, beside the paper's inputs."""

    smallest_thrust: NonNegative = given("N", "smallest thrust of the engines")
    lag: Positive = given("s", "time constant with which the thrust follows its command")
    cycle: Positive = given("s", "guidance cycle, over which a command is held")
    propellant: Positive = given("kg", "propellant at the start")
    ground: Number = given("m", "altitude of the ground where the altitude is counted as in the paper")
    sink_speed: Positive = given("m/s", "speed towards the ground after the paper's final time")
    sink_gain: Positive = given("1/s", "acceleration per error of the velocity after that time")
    least_time_to_go: Positive = given("s", "time to go that laws take for any smaller one")
    time_limit: Positive = given("s", "time at which a flight ends that has not reached the ground")
    glide_slope: Positive = given("rad", "least elevation above the target, for laws that limit it")


class Truth(Section):
    """What flies."""

    start_factor: NonNegative = given("1", "deviations of the start over those of the paper")
    noise_factor: NonNegative = given("1", "noise of the thrust over that of the paper")
    across: NonNegative = given("1", "all deviations across over those downrange; 0: in the plane")
    gust_deviation: NonNegative = given("N", "standard deviation of each component of the force of gusts")
    gust_time: Positive = given("s", "correlation time of the gusts")
    thrust_factor: Positive = given("1", "mean of the true over the commanded thrust")
    thrust_deviation: NonNegative = given("1", "standard deviation of the true over the commanded thrust")
    mass_offset: Number = given("kg", "mean of the true mass minus that known on board")
    mass_deviation: NonNegative = given("kg", "standard deviation of the true mass minus that known on board")


class Navigation(Section):
    """Errors of what is known on board of the state."""

    position_deviation: NonNegative = given("m", "constant error of downrange and crossrange, each")
    altitude_deviation: NonNegative = given("m", "constant error of the altitude")
    velocity_deviation: NonNegative = given("m/s", "constant error of each component of the velocity")
    position_noise: NonNegative = given("m", "of each component of the position, new in every cycle")
    velocity_noise: NonNegative = given("m/s", "of each component of the velocity, new in every cycle")
    altitude_offset: Number = given("m", "mean error of the altitude, the same in all trials")
    velocity_offset: Number = given("m/s", "mean error of the downrange velocity, the same in all trials")


class Box(Section):
    """What counts as landed where and as it should, and what the lander does not survive."""

    miss: Positive = given("m", "largest distance from the target")
    vertical_speed: Positive = given("m/s", "largest vertical speed at touchdown")
    horizontal_speed: Positive = given("m/s", "largest horizontal speed at touchdown")
    tilt: Positive = given("rad", "largest angle of the thrust from the vertical at touchdown")
    broken: Positive = given("1", "factor on these speeds beyond which the lander crashes, or topples")


def check_lander(lander: Lander, vehicle: inputs.Vehicle, mission: inputs.Mission) -> None:
    """Refuse limits that exclude each other, and a cycle or an end that does not fit the flight."""
    if lander.smallest_thrust >= vehicle.maximum_thrust:
        raise ValueError(
            f"lander.smallest_thrust ({lander.smallest_thrust:g} N) is not below vehicle.maximum_thrust "
            f"({vehicle.maximum_thrust:g} N): lower it"
        )
    if lander.propellant >= vehicle.wet_mass:
        raise ValueError(f"lander.propellant ({lander.propellant:g} kg) is the whole of vehicle.wet_mass: lower it")
    duration = float(sum(mission.segment_durations))
    cycles = duration / lander.cycle
    require_at_most("lander.cycle", cycles, "cycles in the flight", LARGEST_CYCLES)
    if abs(cycles - round(cycles)) > 1e-9 * cycles:
        raise ValueError(
            f"lander.cycle ({lander.cycle:g} s) does not divide the {duration:g} s of mission.segment_durations: "
            f"give {duration / math.ceil(cycles):g} s"
        )
    if lander.time_limit <= duration:
        raise ValueError(f"lander.time_limit ({lander.time_limit:g} s) is not after the last segment: raise it")
    if lander.ground >= mission.final_mean[1]:
        raise ValueError(
            f"lander.ground ({lander.ground:g} m) is not below the altitude of mission.final_mean "
            f"({mission.final_mean[1]:g} m): lower it"
        )


class Inputs(inputs.Inputs):
    """All inputs of the scenario."""

    CHECKS = (*inputs.Inputs.CHECKS, check_lander)

    lander: Lander
    truth: Truth
    navigation: Navigation
    box: Box
