"""Typed inputs of the powered-descent paper; their values and sources are in `configs/powered_descent.yaml`."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, PlainSerializer

from marsedl.replication.inputs import sections
from marsedl.replication.inputs.sections import (
    ARRAY,
    CountOrNone,
    Drawn,
    Few,
    Fraction,
    Iterations,
    NonNegative,
    Number,
    Positive,
    Section,
    at_most,
    covariance,
    given,
    vector,
)
from marsedl.sections.checks import require_at_most, require_increase
from marsedl.sections.ensemble import Trials
from marsedl.sections.vehicle import Propulsion

STATE_UNIT = "m, m, m/s, m/s"
COVARIANCE_UNIT = "m^2, m^2, (m/s)^2, (m/s)^2"
LARGEST_STEP_COUNT = 1_000_000
COMMAND_SLACK = 1e-9  # relative; a command interval may be that much shorter than a step by rounding
FIT = 1e-9  # relative; a whole number of steps may be that far from one by rounding
HeldIntervals = at_most(1000, "a certificate is a semidefinite program with a matrix for every interval")
# As `ARRAY`, of whole numbers, and written as such.
WHOLE = (ARRAY[0], PlainSerializer(lambda value: value.astype(int).tolist()))
TwoSizes = Annotated[tuple[HeldIntervals, ...], Field(min_length=2, max_length=2), *WHOLE]


class Planet(Section):
    """What pulls the vehicle."""

    gravity: NonNegative = given("m/s^2", "gravitational acceleration of Mars")


class Vehicle(Propulsion):
    """The vehicle and its engines."""

    wet_mass: Positive = given("kg", "mass at the start")
    maximum_thrust: Positive = given("N", "maximum thrust; reported, not enforced")
    mass_flow_constant: Positive | None = given(
        "kg/(N s)", "mass flow per thrust; empty: 1 / (specific impulse x standard gravity)"
    )


class Entry(Section):
    """Where powered descent begins."""

    initial_position: vector(2) = given("m", "mean initial position: downrange, altitude")
    initial_speed: NonNegative = given("m/s", "mean initial speed")
    initial_velocity_angle: Number = given("rad", "mean initial velocity, angle from straight up towards downrange")
    initial_covariance: covariance(4) = given(COVARIANCE_UNIT, "initial covariance")


class Mission(Section):
    """Where the two segments have to end, and when."""

    intermediate_mean: vector(4) = given(STATE_UNIT, "target mean at the end of the first segment")
    intermediate_covariance: covariance(4) = given(COVARIANCE_UNIT, "target covariance at the end of the first segment")
    final_mean: vector(4) = given(STATE_UNIT, "target mean at the end of the second segment")
    final_covariance: covariance(4) = given(COVARIANCE_UNIT, "target covariance at the end of the second segment")
    segment_durations: vector(2, Positive) = given("s", "durations of the two segments")


class Noise(Section):
    """Noise of the thrust."""

    noise_coefficient: Positive = given("thrust_unit sqrt(s)", "the paper's gamma: noise density in units of thrust")
    thrust_unit: Positive = given("N", "unit of thrust in which the noise coefficient is stated")
    coefficient_unit: Literal[
        "newton", "kilonewton", "acceleration", "mars_weight", "earth_weight", "maximum_thrust", "other"
    ] = given("1", "what the unit of thrust is; `thrust_unit` has to be that many newtons, unless it is another")


class Design(Section):
    """How the steering law is computed."""

    boundary_condition: Literal["corrected", "algorithm_1", "eq_46"] = given(
        "1", "form of the covariance boundary condition: corrected, or literally as in Algorithm 1 or Eq. 46"
    )
    design_interval: Positive = given("s", "largest interval of the grid on which gains and mass profile are tabulated")
    mass_profile: Literal["converged", "first_pass", "first_pass_without_feedback"] = given(
        "1", "mass profile that the steering law is designed on: converged, or that of the first pass of the iteration"
    )
    mass_tolerance: Positive = given("kg s", "integrated change of the mass profile at which its iteration stops")
    mass_iterations: Iterations = given("1", "largest number of passes of the mass iteration")


class Simulation(Section):
    """How trials are integrated."""

    integrator: Literal["rk4", "euler_maruyama", "semi_implicit_euler"] = given(
        "1", "scheme of the Monte Carlo simulation"
    )
    time_step: Positive = given("s", "step of the Monte Carlo simulation; it has to fit the stored states")
    command_interval: Positive | None = given(
        "s", "time over which a command is held, from each segment's start; empty: the command is continuous"
    )
    output_interval: Positive = given("s", "largest interval between stored states")


class Ensemble(Trials):
    """How many trials are flown, from which random numbers."""

    large_trials: CountOrNone = given("1", "trials of the large ensembles; 0: none")
    thrust_bins: Few = given("1", "bins of the thrust over time, from which its percentiles are taken")
    thrust_range: Positive = given("1", "largest thrust of these bins, in units of the maximum thrust")
    wide_switch_factor: Positive = given(
        "1", "factor on the covariance at the switch in the flights that begin the second segment too wide"
    )


class Studies(Section):
    """Studies of the methods themselves."""

    fixed_point_tolerance: Positive = given("1", "relative change at which Algorithm 1 stops")
    fixed_point_iterations: Iterations = given("1", "largest number of iterations of Algorithm 1")
    fixed_point_loose_tolerance: Positive = given(
        "1", "absolute change at which Algorithm 1 stops in the run that shows its printed stopping rule"
    )
    density_range: vector(2, Positive) = given("N sqrt(s)", "least and largest noise density of the sweep")
    density_points: Few = given("1", "noise densities of the sweep")
    density_iterations: Iterations = given("1", "largest number of iterations of Algorithm 1 in the sweep")
    critical_density_range: vector(2, Positive) = given(
        "N sqrt(s)", "between which the largest noise density with a singular Riccati solution is sought"
    )
    critical_density_points: Few = given("1", "noise densities between which its sign is compared")
    certificate_intervals: TwoSizes = given("1", "held intervals of the two optimality certificates")


class Drawing(Section):
    """What figures show."""

    ellipses_per_segment: Drawn = given("1", "covariance ellipses drawn along each segment")
    ellipse_sigma: Positive = given("1", "size of the drawn ellipses in standard deviations")
    thrust_percentile: Fraction = given("1", "the upper percentile of the control magnitude")


def check_steps(mission: Mission, design: Design, simulation: Simulation) -> None:
    """Refuse steps that are longer than a segment, too many in one, or others than those that would be flown."""
    steps = {
        "simulation.time_step": simulation.time_step,
        "simulation.output_interval": simulation.output_interval,
        "design.design_interval": design.design_interval,
    }
    for name, step in steps.items():
        if step > min(mission.segment_durations):
            raise ValueError(
                f"{name} ({step:g} s) is longer than a segment ({min(mission.segment_durations):g} s): lower it"
            )
        require_at_most(name, max(mission.segment_durations) / step, "steps in a segment", LARGEST_STEP_COUNT)
    for duration in mission.segment_durations:
        # Between stored states, which divide the segment evenly, lie equal steps: others than asked for if none fits.
        interval = duration / np.ceil(duration / simulation.output_interval - FIT)
        if not _is_whole(interval / simulation.time_step):
            raise ValueError(
                f"simulation.time_step ({simulation.time_step:g} s) does not fit the {interval:g} s between stored "
                f"states of the segment of {duration:g} s: lower it to "
                f"{interval / np.ceil(interval / simulation.time_step):g} s, or give a simulation.output_interval that "
                "is a multiple of it and a part of the segment"
            )


def _is_whole(number: float) -> bool:
    return abs(number - round(number)) <= FIT * max(number, 1.0) and number > 0.5


def check_command(simulation: Simulation, mission: Mission) -> None:
    """Refuse commands that are held for less than a step, for a part of one, or for more than a segment."""
    interval = simulation.command_interval
    if interval is None:
        return
    if interval < simulation.time_step * (1 - COMMAND_SLACK):
        raise ValueError(
            f"simulation.command_interval ({interval:g} s) is shorter than simulation.time_step "
            f"({simulation.time_step:g} s), within which no command can change: lower time_step, or leave "
            "command_interval empty for a continuous command"
        )
    if interval > min(mission.segment_durations):
        raise ValueError(
            f"simulation.command_interval ({interval:g} s) is longer than a segment "
            f"({min(mission.segment_durations):g} s): lower it"
        )
    if not _is_whole(interval / simulation.time_step):
        raise ValueError(
            f"simulation.command_interval ({interval:g} s) is no whole number of simulation.time_step "
            f"({simulation.time_step:g} s), so that commands would be held for "
            f"{int(interval / simulation.time_step) * simulation.time_step:g} s: give a multiple, or another time_step"
        )


def check_thrust_unit(planet: Planet, vehicle: Vehicle, noise: Noise) -> None:
    """Refuse a unit of thrust that is not what the inputs say it is, such as 0.02 of another maximum thrust."""
    wet_mass = vehicle.wet_mass
    units = {
        "newton": ("1 N", 1.0),
        "kilonewton": ("1 kN", 1000.0),
        "acceleration": ("vehicle.wet_mass times 1 m/s^2", wet_mass),
        "mars_weight": ("vehicle.wet_mass times planet.gravity", wet_mass * planet.gravity),
        "earth_weight": ("vehicle.wet_mass times vehicle.standard_gravity", wet_mass * vehicle.standard_gravity),
        "maximum_thrust": ("vehicle.maximum_thrust", vehicle.maximum_thrust),
    }
    if noise.coefficient_unit == "other":
        return
    words, newtons = units[noise.coefficient_unit]
    if abs(noise.thrust_unit - newtons) > 1e-6 * newtons:
        raise ValueError(
            f"noise.thrust_unit is {noise.thrust_unit:g} N, but noise.coefficient_unit '{noise.coefficient_unit}' says "
            f"that it is {words}, {newtons:g} N: set noise.thrust_unit to {newtons:g} so that the noise follows, or "
            "noise.coefficient_unit to 'other' so that it stays as it is"
        )


def check_studies(studies: Studies) -> None:
    """Refuse ranges that are none."""
    require_increase("studies.density_range", studies.density_range)
    require_increase("studies.critical_density_range", studies.critical_density_range)


class Inputs(sections.Inputs):
    """Everything that the powered-descent results depend on."""

    CASES: ClassVar = {
        "closed_loop": "ensemble.trials",
        "open_loop": "ensemble.trials",
        "prior_mass": "ensemble.trials",
        "wide_switch": "ensemble.trials",
        "closed_loop_large": "ensemble.large_trials",
        "open_loop_large": "ensemble.large_trials",
        "prior_mass_large": "ensemble.large_trials",
        "wide_switch_large": "ensemble.large_trials",
    }
    CHECKS: ClassVar = (check_steps, check_command, check_thrust_unit, check_studies)

    planet: Planet
    vehicle: Vehicle
    entry: Entry
    mission: Mission
    noise: Noise
    design: Design
    simulation: Simulation
    ensemble: Ensemble
    studies: Studies
    drawing: Drawing
