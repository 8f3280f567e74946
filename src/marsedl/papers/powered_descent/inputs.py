"""Typed inputs of the powered-descent paper; their values and sources are in `configs/powered_descent.yaml`."""

from typing import ClassVar, Literal

from pydantic import model_validator

from marsedl.replication.inputs import (
    Count,
    CountOrNone,
    Drawn,
    Fraction,
    Inputs,
    Iterations,
    NonNegative,
    Number,
    Positive,
    Seed,
    StudyTrials,
    at_most,
    covariance,
    given,
    vector,
)

STATE_UNIT = "m, m, m/s, m/s"
COVARIANCE_UNIT = "m^2, m^2, (m/s)^2, (m/s)^2"
LARGEST_STEP_COUNT = 1_000_000
HeldIntervals = at_most(1000, "a certificate is a semidefinite program with a matrix for every interval")


class PoweredDescentInputs(Inputs):
    """Everything that the powered-descent results depend on."""

    CASES: ClassVar[dict[str, str]] = {
        "closed_loop": "trials",
        "open_loop": "trials",
        "closed_loop_large": "large_trials",
        "open_loop_large": "large_trials",
    }

    initial_position: vector(2) = given("m", "mean initial position: downrange, altitude")
    initial_speed: NonNegative = given("m/s", "mean initial speed")
    initial_velocity_angle: Number = given("rad", "mean initial velocity, angle from straight up towards downrange")
    initial_covariance: covariance(4) = given(COVARIANCE_UNIT, "initial covariance")
    intermediate_mean: vector(4) = given(STATE_UNIT, "target mean at the end of the first segment")
    intermediate_covariance: covariance(4) = given(COVARIANCE_UNIT, "target covariance at the end of the first segment")
    final_mean: vector(4) = given(STATE_UNIT, "target mean at the end of the second segment")
    final_covariance: covariance(4) = given(COVARIANCE_UNIT, "target covariance at the end of the second segment")
    segment_durations: vector(2, Positive) = given("s", "durations of the two segments")
    wet_mass: Positive = given("kg", "mass at the start")
    maximum_thrust: Positive = given("N", "maximum thrust; reported, not enforced")
    specific_impulse: Positive = given("s", "specific impulse")
    standard_gravity: Positive = given("m/s^2", "gravity in the definition of the specific impulse")
    mass_flow_constant: Positive | None = given(
        "kg/(N s)", "mass flow per thrust; empty: 1 / (specific impulse x standard gravity)"
    )
    gravity: NonNegative = given("m/s^2", "gravitational acceleration of Mars")
    noise_coefficient: Positive = given("thrust_unit sqrt(s)", "the paper's gamma: noise density in units of thrust")
    thrust_unit: Positive = given("N", "unit of thrust in which the noise coefficient is stated")
    boundary_condition: Literal["corrected", "algorithm_1", "eq_46"] = given(
        "1", "form of the covariance boundary condition: corrected, or literally as in Algorithm 1 or Eq. 46"
    )
    integrator: Literal["rk4", "euler_maruyama"] = given("1", "scheme of the Monte Carlo simulation")
    time_step: Positive = given("s", "largest step of the Monte Carlo simulation")
    finest_time_step: Positive = given("s", "step of the reference run in the study of integrator errors")
    output_interval: Positive = given("s", "largest interval between stored states")
    design_interval: Positive = given("s", "largest interval of the grid on which gains and mass profile are tabulated")
    mass_tolerance: Positive = given("kg s", "integrated change of the mass profile at which its iteration stops")
    mass_iterations: Iterations = given("1", "largest number of passes of the mass iteration")
    fixed_point_tolerance: Positive = given("1", "relative change at which Algorithm 1 stops")
    fixed_point_iterations: Iterations = given("1", "largest number of iterations of Algorithm 1")
    certificate_intervals: vector(2, HeldIntervals) = given("1", "held intervals of the two optimality certificates")
    seed: Seed = given("1", "key of the random numbers")
    trials: Count = given("1", "Monte Carlo trials, closed and open loop")
    large_trials: CountOrNone = given("1", "trials of the large ensembles, closed and open loop; 0: none")
    convergence_trials: StudyTrials = given("1", "trials of the study of integrator error against step")
    drawn_trials: Drawn = given("1", "trials drawn in the figures")
    ellipses_per_segment: Drawn = given("1", "covariance ellipses drawn along each segment")
    ellipse_sigma: Positive = given("1", "size of the drawn ellipses in standard deviations")
    thrust_percentile: Fraction = given("1", "the upper percentile of the control magnitude")

    @model_validator(mode="after")
    def _affordable(self):
        for step in ("time_step", "finest_time_step", "output_interval", "design_interval"):
            if getattr(self, step) > min(self.segment_durations):
                raise ValueError(
                    f"{step} ({getattr(self, step):g} s) is longer than a segment ({min(self.segment_durations):g} s): "
                    "lower it"
                )
            steps = max(self.segment_durations) / getattr(self, step)
            if steps > LARGEST_STEP_COUNT:
                raise ValueError(
                    f"{step} makes {steps:.3g} steps in a segment, more than {LARGEST_STEP_COUNT}: raise it"
                )
        return self


MODEL = PoweredDescentInputs
