"""Typed inputs of the powered-descent paper; their values and sources are in `configs/powered_descent.yaml`."""

from typing import ClassVar, Literal

from marsedl.replication.sections import (
    CountOrNone,
    Drawn,
    Fraction,
    Inputs,
    Iterations,
    NonNegative,
    Number,
    Positive,
    Section,
    StudyTrials,
    at_most,
    covariance,
    given,
    vector,
)
from marsedl.sections.ensemble import Trials
from marsedl.sections.vehicle import Propulsion

STATE_UNIT = "m, m, m/s, m/s"
COVARIANCE_UNIT = "m^2, m^2, (m/s)^2, (m/s)^2"
LARGEST_STEP_COUNT = 1_000_000
HeldIntervals = at_most(1000, "a certificate is a semidefinite program with a matrix for every interval")


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


class Design(Section):
    """How the steering law is computed."""

    boundary_condition: Literal["corrected", "algorithm_1", "eq_46"] = given(
        "1", "form of the covariance boundary condition: corrected, or literally as in Algorithm 1 or Eq. 46"
    )
    design_interval: Positive = given("s", "largest interval of the grid on which gains and mass profile are tabulated")
    mass_tolerance: Positive = given("kg s", "integrated change of the mass profile at which its iteration stops")
    mass_iterations: Iterations = given("1", "largest number of passes of the mass iteration")


class Simulation(Section):
    """How trials are integrated."""

    integrator: Literal["rk4", "euler_maruyama"] = given("1", "scheme of the Monte Carlo simulation")
    time_step: Positive = given("s", "largest step of the Monte Carlo simulation")
    output_interval: Positive = given("s", "largest interval between stored states")


class Ensemble(Trials):
    """How many trials are flown, from which random numbers."""

    large_trials: CountOrNone = given("1", "trials of the large ensembles, closed and open loop; 0: none")


class Studies(Section):
    """Studies of the methods themselves."""

    finest_time_step: Positive = given("s", "step of the reference run in the study of integrator errors")
    convergence_trials: StudyTrials = given("1", "trials of the study of integrator error against step")
    fixed_point_tolerance: Positive = given("1", "relative change at which Algorithm 1 stops")
    fixed_point_iterations: Iterations = given("1", "largest number of iterations of Algorithm 1")
    certificate_intervals: vector(2, HeldIntervals) = given("1", "held intervals of the two optimality certificates")


class Drawing(Section):
    """What figures show."""

    ellipses_per_segment: Drawn = given("1", "covariance ellipses drawn along each segment")
    ellipse_sigma: Positive = given("1", "size of the drawn ellipses in standard deviations")
    thrust_percentile: Fraction = given("1", "the upper percentile of the control magnitude")


def check_steps(mission: Mission, design: Design, simulation: Simulation, studies: Studies) -> None:
    """Refuse steps that are longer than a segment, or too many in one."""
    steps = {
        "simulation.time_step": simulation.time_step,
        "simulation.output_interval": simulation.output_interval,
        "design.design_interval": design.design_interval,
        "studies.finest_time_step": studies.finest_time_step,
    }
    for name, step in steps.items():
        if step > min(mission.segment_durations):
            raise ValueError(
                f"{name} ({step:g} s) is longer than a segment ({min(mission.segment_durations):g} s): lower it"
            )
        count = max(mission.segment_durations) / step
        if count > LARGEST_STEP_COUNT:
            raise ValueError(f"{name} makes {count:.3g} steps in a segment, more than {LARGEST_STEP_COUNT}: raise it")


class PoweredDescentInputs(Inputs):
    """Everything that the powered-descent results depend on."""

    CASES: ClassVar = {
        "closed_loop": "ensemble.trials",
        "open_loop": "ensemble.trials",
        "closed_loop_large": "ensemble.large_trials",
        "open_loop_large": "ensemble.large_trials",
    }
    CHECKS: ClassVar = (check_steps,)

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


MODEL = PoweredDescentInputs
