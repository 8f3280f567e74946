"""Typed inputs of the random-field paper; their values and sources are in `configs/random_field.yaml`."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, Strict, model_validator

from marsedl.papers.random_field.partition import partition_fault
from marsedl.replication.inputs import sections
from marsedl.replication.inputs.sections import (
    ARRAY,
    Count,
    Drawn,
    NonNegative,
    Number,
    Positive,
    Section,
    Sign,
    StudyTrials,
    given,
    vector,
)
from marsedl.sections.air import DensityVariance, MeanDensity
from marsedl.sections.checks import require_at_most, require_increase, require_inside, require_multiples
from marsedl.sections.ensemble import Trials
from marsedl.sections.planet import CentralBody
from marsedl.sections.vehicle import EntryVehicle

LARGEST_STEP_COUNT = 100_000
LARGEST_NODE_COUNT = 100_000
STEPS = "integration steps"

Partition = Annotated[tuple[Number, ...], Field(min_length=2, max_length=201), *ARRAY]
Examples = Annotated[tuple[Number, ...], Field(min_length=1, max_length=100), *ARRAY]
Tail = Annotated[float, Strict(), Field(gt=0, lt=0.5)]  # beyond one half the constraint is not convex
Level = Annotated[float, Strict(), Field(gt=0.5, lt=1)]
Iterations = Annotated[int, Strict(), Field(gt=0, le=1000)]
Correlation = Annotated[float, Strict(), Field(gt=-1, lt=1)]
SMALLEST_EIGENVALUE = 1e-12  # of a correlation matrix that counts as positive definite


def _require_nodes(name, bounds, spacing):
    lowest, highest = bounds
    if not highest - lowest >= spacing:
        raise ValueError(f"{name}: {spacing:g} does not fit between {lowest:g} and {highest:g}")
    require_at_most(name, (highest - lowest) / spacing, "nodes", LARGEST_NODE_COUNT)


class Planet(CentralBody):
    """What the vehicle orbits."""


class Air(MeanDensity, DensityVariance):
    """The density: its mean, and its variation over altitude (Eqs. 73-74)."""

    density_beyond_table: Literal["refuse", "continue"] = given(
        "1", "when a nominal leaves the density table: refuse, or continue along the table's end slopes"
    )
    variance_growth_sign: Sign = given("1", "1: the variance grows up to that altitude; -1: as printed")
    correlation_length: Positive = given("m", "distance in altitude over which the correlation falls by e")
    correlation_altitude: Literal["lower", "upper", "both"] = given(
        "1",
        "altitude whose variance enters Eq. 73: the lower one as printed, the upper, or both (geometric mean)",
    )
    variation_mean: Number = given("1", "mean of the relative density variation, the same at all altitudes")
    density_floor: NonNegative = given("1", "least ratio of the density to its mean; Gaussian variations know none")
    field_altitudes: vector(2) = given("m", "altitudes between which the variation is sampled; it is constant beyond")
    field_interval: Positive = given("m", "spacing of the sampled altitudes")

    @model_validator(mode="after")
    def _consistent(self):
        _require_nodes("field_interval", self.field_altitudes, self.field_interval)
        # The variance of the altitude that enters must not fall faster than the correlation does.
        falls = self.correlation_altitude == {1: "upper", -1: "lower"}[self.variance_growth_sign]
        if falls and self.correlation_length > 2.0 * self.variance_growth_length:
            raise ValueError(
                f"correlation_length: {self.correlation_length:g} m makes no covariance with variance_growth_sign "
                f"{self.variance_growth_sign} and correlation_altitude '{self.correlation_altitude}': twice "
                f"variance_growth_length ({self.variance_growth_length:g} m) is the most"
            )
        if not self.variation_mean > -1.0:
            raise ValueError(f"variation_mean: {self.variation_mean:g} leaves no density: it must be above -1")
        return self


class Vehicle(EntryVehicle):
    """The vehicle, and the state in which it enters the atmosphere."""

    control_limits: vector(2) = given("1", "least and largest bank cosine")
    entry_altitude: Positive = given("m", "mean altitude at the start")
    entry_velocity: Positive = given("m/s", "mean velocity at the start")
    entry_flight_path_angle: Number = given("rad", "mean flight path angle at the start, if it is given")
    entry_angle: Literal["solved", "given"] = given(
        "1", "whether the entry angle is solved, so that zero control reaches the target apoapsis, or given"
    )
    entry_angle_bracket: vector(2) = given("rad", "entry angles between which the solution is sought")
    initial_deviations: vector(3, NonNegative) = given(
        "m, m/s, rad", "standard deviations of radius, velocity and flight path angle at the start"
    )
    initial_correlations: vector(3) = given(
        "1", "their correlations: radius and velocity, radius and path angle, velocity and path angle"
    )

    @model_validator(mode="after")
    def _consistent(self):
        require_increase("entry_angle_bracket", self.entry_angle_bracket)
        require_increase("control_limits", self.control_limits)
        if not np.linalg.eigvalsh(correlation_matrix(self.initial_correlations)).min() > SMALLEST_EIGENVALUE:
            raise ValueError(
                f"initial_correlations: {', '.join(f'{value:g}' for value in self.initial_correlations)} belong to no "
                "covariance: give smaller ones"
            )
        return self


class Mission(Section):
    """The orbit that is aimed at, and the times of the flight."""

    target_apoapsis: Positive = given("1", "target apoapsis in radii of the planet")
    target_periapsis: Positive = given("1", "target periapsis in radii of the planet")
    least_exit_altitude: Number = given("m", "a flight that ends lower has not left the atmosphere")
    final_time: Positive = given("s", "end of the atmospheric flight")
    partition: Partition = given("s", "times at which the control changes, from 0 to the final time")
    invalid_partition: Literal["refuse", "report"] = given(
        "1", "what to do with a partition that does not increase: refuse it, or report it and make no design"
    )

    @model_validator(mode="after")
    def _consistent(self):
        fault = partition_fault(self.partition, self.final_time)
        if fault and self.invalid_partition == "refuse":
            raise ValueError(f"partition: {fault}")
        return self


class Guidance(Section):
    """How covariance steering computes its laws."""

    percentile_tail: Tail = given("1", "p_f, probability with which delta-v exceeds the percentile that is minimised")
    percentile_unit: Literal["km/s", "m/s"] = given("1", "unit in which delta-v enters the cost")
    percentile_weight: NonNegative = given("1", "weight of the delta-v percentile in the cost")
    control_variance_weight: NonNegative = given("1", "weight of the control variance in the cost")
    mean_control_weight: NonNegative = given("1", "weight of the squared mean control in the cost")
    control_probability: Level = given("1", "probability with which the control lies between its limits, at each step")
    control_trust: Positive = given("1", "Delta_u, largest change of the mean control in one iteration")
    control_trust_weight: Positive = given("1", "M_u, weight of that change's square, whose root Delta_u limits")
    initial_control: Number = given("1", "mean control of the first nominal trajectory, the same in all intervals")
    feedback_reference: Literal["mean", "expansion_point", "propagated_mean"] = given(
        "1",
        "states from which the feedback takes deviations: the mean of the linear model, the trajectory about which it "
        "is linearised, or the nominal trajectory of the new mean control",
    )
    apoapsis_trust: Positive = given("1", "largest change of the linearised apoapsis in one iteration, planet radii")
    clean_up_branch: Literal["mean", "undershoot", "overshoot", "both"] = given(
        "1", "derivative of the clean-up burn where it vanishes: of either side, their mean, or both in the program"
    )
    branch_tolerance: NonNegative = given("1", "relative distance of the apoapsis from its target taken for none")
    navigation_deviations: vector(3, NonNegative) = given(
        "m, m/s, rad", "standard deviations of an independent disturbance per interval that the design adds"
    )
    ill_conditioned: Literal["refuse", "report"] = given(
        "1", "what to do when the gains are unbounded: refuse the design, or make it and report the gains"
    )
    iterations: Iterations = given("1", "iterations of Algorithm 1")
    convergence_tolerances: vector(2, Positive) = given(
        "1, m/s", "changes of nominal apoapsis (planet radii) and predicted percentile that count as none"
    )


class Simulation(Trials):
    """How trials are integrated, how many, and from which random numbers."""

    time_step: Positive = given("s", "integration step")
    output_interval: Positive = given("s", "largest time between stored states; it becomes one that all nodes share")
    dynamic_pressure_density: Literal["nominal", "actual"] = given("1", "density in the dynamic pressure that is shown")
    paper_trials: Count = given("1", "the first of these, as many as the paper flies")

    @model_validator(mode="after")
    def _consistent(self):
        if not self.output_interval >= self.time_step:
            raise ValueError(
                f"output_interval ({self.output_interval:g}) must not be below time_step ({self.time_step:g})"
            )
        if not self.trials >= self.paper_trials:
            raise ValueError(f"trials ({self.trials}) must not be fewer than paper_trials ({self.paper_trials})")
        return self


class Studies(Section):
    """Studies beside the paper."""

    convergence_iterations: Iterations = given("1", "iterations of the study of convergence")


class PointMass(Section):
    """The double integrator of Sec. V.A, which a locally periodic force disturbs."""

    double_integrator_initial_mean: vector(2) = given("1", "mean initial position and velocity")
    double_integrator_initial_three_sigma: vector(2, Positive) = given("1", "three standard deviations of the two")
    double_integrator_initial_correlation: Correlation = given("1", "correlation of the two")
    double_integrator_force_mean: Number = given("1", "mean of the random force, the same at all positions")
    double_integrator_kernel: Literal["locally_periodic", "squared_exponential"] = given(
        "1", "covariance of the random force: that of Eq. 59, or its factor that is not periodic alone"
    )
    double_integrator_variance: Positive = given("1", "variance of the random force")
    double_integrator_period: Positive = given("1", "its period over position")
    double_integrator_periodic_length: Positive = given("1", "its periodic length scale")
    double_integrator_length: Positive = given("1", "length over which the periodicity decays")
    double_integrator_partition: Partition = given("1", "times at which the control changes")
    double_integrator_final_mean: vector(2) = given("1", "mean final position and velocity")
    double_integrator_final_three_sigma: vector(2, Positive) = given(
        "1", "three standard deviations that bound the final covariance"
    )
    double_integrator_final_correlation: Correlation = given("1", "correlation of the bound")
    double_integrator_first_normal: vector(2) = given("1", "normal of the first half plane")
    double_integrator_second_normal: vector(2) = given("1", "normal of the second half plane")
    double_integrator_bounds: vector(2) = given("1", "right-hand sides of both half planes")
    double_integrator_probability: Level = given(
        "1", "probability of lying between the lines, at each constrained step"
    )
    double_integrator_constrained: Literal["all", "before_last"] = given("1", "steps at which the lines constrain")
    double_integrator_weights: vector(2, NonNegative) = given("1", "weights of control variance and mean control")
    double_integrator_state_weights: vector(2, NonNegative) = given("1", "weights Q of position and velocity")
    double_integrator_percentile_weight: NonNegative = given("1", "weight eta of the percentile of the final state")
    double_integrator_percentile_direction: vector(2) = given("1", "xi, along which that percentile is taken (Eq. 13)")
    double_integrator_percentile_tail: Tail = given("1", "p_f, probability of exceeding that percentile")
    double_integrator_iterations: Iterations = given("1", "iterations of Algorithm 1")
    double_integrator_initial_control: Number = given("1", "mean control of the first nominal trajectory")
    double_integrator_field_positions: vector(2) = given("1", "positions between which the force is sampled")
    double_integrator_field_interval: Positive = given("1", "spacing of these positions")
    double_integrator_quadrature: Annotated[int, Strict(), Field(ge=2, le=64)] = given(
        "1", "Gauss-Legendre nodes per interval"
    )
    double_integrator_time_step: Positive = given("1", "integration step")
    double_integrator_output_interval: Positive = given("1", "time between stored states")
    double_integrator_trials: StudyTrials = given("1", "Monte Carlo trials of open and closed loop")
    ellipse_probability: Level = given("1", "probability content of the drawn ellipses")

    @model_validator(mode="after")
    def _consistent(self):
        nodes, output = self.double_integrator_partition, self.double_integrator_output_interval
        step = self.double_integrator_time_step
        if fault := partition_fault(nodes, nodes[-1]):
            raise ValueError(f"double_integrator_partition: {fault}")
        require_multiples("double_integrator_partition", nodes, "double_integrator_output_interval", output)
        require_multiples("double_integrator_output_interval", (output,), "double_integrator_time_step", step)
        require_at_most("double_integrator_time_step", nodes[-1] / step, STEPS, LARGEST_STEP_COUNT)
        positions, spacing = self.double_integrator_field_positions, self.double_integrator_field_interval
        _require_nodes("double_integrator_field_interval", positions, spacing)
        return self


class Drawing(Section):
    """What figures show, Figs. 1 and 2 with fields of their own."""

    drawn_samples: Drawn = given("1", "samples of random fields drawn in the figures")
    delta_v_window: vector(2, Positive) = given("m/s", "delta-v interval shown for the closed loop")
    example_length: Positive = given("1", "length scale of the fields of Figs. 1 and 2, whose variance is one")
    example_extent: Positive = given("1", "coordinates from 0 to this are drawn")
    example_positions: Examples = given("1", "positions of the measurements of Fig. 1")
    example_values: Examples = given("1", "their values")
    example_noise: NonNegative = given("1", "standard deviation of their noise")
    example_edge: Number = given("1", "value to which the edge of Fig. 2 is conditioned")

    @model_validator(mode="after")
    def _consistent(self):
        require_increase("delta_v_window", self.delta_v_window)
        if len(self.example_positions) != len(self.example_values):
            raise ValueError("example_values: must be as many as example_positions")
        return self


def correlation_matrix(correlations) -> np.ndarray:
    """Return the matrix (3, 3) of the correlations of first and second, first and third, second and third component."""
    matrix = np.eye(3)
    for (row, column), value in zip(((0, 1), (0, 2), (1, 2)), correlations, strict=True):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def check_times(mission: Mission, simulation: Simulation) -> None:
    """Refuse partitions whose times are no whole numbers of integration steps, and too many steps."""
    step = simulation.time_step
    require_at_most("simulation.time_step", mission.final_time / step, STEPS, LARGEST_STEP_COUNT)
    require_multiples("mission.final_time", (mission.final_time,), "simulation.time_step", step)
    require_multiples("mission.partition", mission.partition, "simulation.time_step", step)


def check_guess(vehicle: Vehicle, guidance: Guidance) -> None:
    """Refuse a first nominal control beyond the limits."""
    limits = "vehicle.control_limits"
    require_inside("guidance.initial_control", guidance.initial_control, vehicle.control_limits, limits)


class Inputs(sections.Inputs):
    """Everything that the random-field results depend on."""

    CASES: ClassVar = {"aerocapture": "simulation.trials"}
    CHECKS: ClassVar = (check_times, check_guess)

    planet: Planet
    air: Air
    vehicle: Vehicle
    mission: Mission
    guidance: Guidance
    simulation: Simulation
    point_mass: PointMass
    studies: Studies
    drawing: Drawing
