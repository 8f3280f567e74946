"""Typed inputs of the desensitized-landing paper; their values and sources are in `configs/desensitized.yaml`."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, Strict, model_validator

from marsedl.replication.inputs import sections
from marsedl.replication.inputs.sections import (
    ARRAY,
    Few,
    Iterations,
    NonNegative,
    Number,
    Positive,
    Section,
    given,
    vector,
)
from marsedl.sections.air import FittedDensity
from marsedl.sections.checks import require_increase
from marsedl.sections.ensemble import Trials
from marsedl.sections.planet import CentralBody
from marsedl.sections.vehicle import EntryVehicle, Propulsion

Angle = Number | None
Intervals = Annotated[int, Strict(), Field(ge=10, le=5000)]
Substeps = Annotated[int, Strict(), Field(gt=0, le=1000)]
Points = Annotated[int, Strict(), Field(ge=3, le=10_001)]
Weights = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=200)]
Rows = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=50), *ARRAY]
Profile = Annotated[tuple[Number, ...], Field(min_length=1, max_length=20)]
Switches = Annotated[tuple[Positive, ...], Field(max_length=19)]

GAIN_UNIT = "rad/s^2 per scaled state"


def _no_zero(name, values):
    if not np.all(values):
        raise ValueError(f"{name} has a zero, an error that changes nothing: give its size, positive or negative")


class Planet(CentralBody, FittedDensity):
    """The planet and the mean density of its air."""


class Vehicle(EntryVehicle, Propulsion):
    """The vehicle, and what turns it."""

    aeroshell_diameter: Positive = given("m", "diameter of the aeroshell; enters no equation")
    cone_angle: Positive = given("rad", "sphere-cone angle of the aeroshell; enters no equation")
    angle_of_attack: NonNegative = given("rad", "trim angle of attack; enters the propellant only")
    roll_inertia: Positive = given("kg m^2", "moment of inertia about the roll axis")
    yaw_inertia: Positive = given("kg m^2", "moment of inertia about the yaw axis")
    roll_arm: Positive = given("m", "arm of the roll thrusters")
    yaw_arm: Positive = given("m", "arm of the yaw thrusters")
    bank_rate_bound: Positive = given("rad/s", "largest bank rate, either way")
    bank_acceleration_bound: Positive = given("rad/s^2", "largest bank acceleration, either way")


class Mission(Section):
    """From entry to the deployment of the parachute."""

    entry_altitude: Positive = given("m", "altitude at entry")
    entry_velocity: Positive = given("m/s", "velocity at entry")
    entry_longitude: Number = given("rad", "longitude at entry")
    entry_latitude: Number = given("rad", "latitude at entry")
    entry_flight_path_angle: Number = given("rad", "flight path angle at entry, positive while climbing")
    entry_azimuth: Number = given("rad", "heading at entry, clockwise from north")
    final_altitude: Positive = given("m", "altitude at parachute deployment")
    final_velocity: Positive = given("m/s", "velocity at parachute deployment")
    final_longitude: Number = given("rad", "longitude at parachute deployment")
    final_latitude: Number = given("rad", "latitude at parachute deployment")
    initial_bank: Angle = given("rad", "bank angle at entry; empty: free")
    initial_bank_rate: Angle = given("rad/s", "bank rate at entry; empty: free")
    final_bank: Angle = given("rad", "bank angle at deployment; empty: free")
    final_bank_rate: Angle = given("rad/s", "bank rate at deployment; empty: free")
    final_time_bounds: vector(2, Positive) = given("s", "between which the solver looks for the final time")

    @model_validator(mode="after")
    def _goes_down(self):
        require_increase("final_time_bounds", self.final_time_bounds)
        if self.final_altitude >= self.entry_altitude:
            raise ValueError("final_altitude is not below entry_altitude: exchange them")
        return self


class Solver(Section):
    """The transcription, its solver, and the guess that decides on which branch the nominal is."""

    intervals: Intervals = given("1", "intervals of constant bank acceleration, one less than the nodes")
    scheme: Literal["midpoint", "trapezoid", "hermite_simpson"] = given("1", "transcription of the equations of motion")
    solver_tolerance: Positive = given("1", "tolerance of the solver on scaled equations and optimality")
    solver_iterations: Iterations = given("1", "largest number of iterations of a solve")
    guess_banks: Profile = given("rad", "bank angles of the first guess, one after the other")
    guess_switch_times: Switches = given("s", "when the guess goes from one to the next")
    guess_width: Positive = given("s", "width of these changes")
    guess_final_time: Positive = given("s", "final time of the guess")
    nominal_reversals: Annotated[int, Strict(), Field(ge=0, le=1000)] = given(
        "1", "bank reversals that the nominal must have; we refuse a solution with others, which is on another branch"
    )
    nominal_full_rolls: Annotated[int, Strict(), Field(ge=0, le=1000)] = given(
        "1", "full turns of its bank angle, likewise"
    )
    nominal_first_bank: Literal["negative", "positive"] = given("1", "sign of its first bank angle, likewise")

    @model_validator(mode="after")
    def _guess_fits_together(self):
        if len(self.guess_switch_times) != len(self.guess_banks) - 1:
            raise ValueError(
                f"guess_switch_times has {len(self.guess_switch_times)} values for {len(self.guess_banks)} "
                "guess_banks; give one less than there are banks"
            )
        require_increase("guess_switch_times", self.guess_switch_times)
        return self


class Design(Section):
    """What makes flights insensitive: the weight on the sensitivity, and the gains of the feedback."""

    printed_weights: Rows = given("1", "the paper's c1 between zero and infinity, a row for each")
    weight_rule: Literal["matched", "proportional"] = given(
        "1", "weight of a row: such that it has the printed control energy, or in proportion to the printed weight"
    )
    matched_efforts: Rows = given("deg^2/s^3", "control energies of these rows, for matched")
    weight_factor: Positive = given("1", "weight per printed weight, for proportional")
    infinite_weights: Rows = given("deg^2/s^3", "weights that stand for an infinite one, a row for each")
    weight_path: Weights = given("1", "weights through which the solutions are continued, beside those of the rows")
    infeasible_rows: Literal["no_value", "printed_ratios"] = given(
        "1",
        "rows whose control energy lies below the least one: without a value, or at the least one times the ratio of "
        "theirs to printed_least_effort",
    )
    printed_least_effort: Positive = given(
        "deg^2/s^3", "control energy of the first row as printed, for printed_ratios"
    )
    sensitivity_length: Positive | None = given(
        "m", "length that counts as one radian in the norm of the sensitivity; empty: the planet's radius"
    )
    sensitivity_columns: Literal["radius", "all"] = given(
        "1", "columns of the position sensitivity in the norm: that of the radius, or all three"
    )
    norm_smoothing: NonNegative = given("1", "added to the squared norm, so that it has a derivative where it is zero")
    branch_tolerance: Positive = given("rad", "largest change of the bank angle between neighbours on a branch")
    solved_weight_scale: Positive = given("1", "weight above which the objective is divided by weight / this")
    gain_design: Literal["minimum_norm", "regularized", "unregularized", "tuned"] = given(
        "1",
        "constant gains: smallest ones that null the column on the fixed nominal; regularised least squares of it; "
        "solved for with the trajectory, not regularised; or tuned to flown errors",
    )
    gain_start: Annotated[int, Strict(), Field(ge=0, le=10_000)] = given(
        "1",
        "start of the search for the smallest gains: 0 from none, or downrange_gain_start; n from the n-th random one",
    )
    gain_time: Positive = given("s", "the norm of gains scales velocities by the planet's radius over this time")
    gain_step_limit: Positive = given("1", "largest change of the gains in one iteration")
    gain_tolerance: Positive = given("1", "change of the gains at which their iteration stops")
    gain_iterations: Iterations = given("1", "largest number of iterations of the gains")
    downrange_gain_start: vector(6) = given(GAIN_UNIT, "gains at which the iteration starts that has to null downrange")
    all_columns_regularization: Weights = given("1", "weights on the squared gains, in turn, for all columns together")
    feedback_weight: Positive = given("1", "weight on the norm when trajectory and gains are solved for together")
    unregularized_iterations: Iterations = given("1", "iterations after which that solve is ended")
    all_columns_iterations: Iterations = given(
        "1", "iterations after which one for gains against all columns is given up"
    )
    tuning_errors: Annotated[tuple[Number, ...], Field(min_length=2, max_length=50)] = given(
        "m", "initial errors whose flown final errors tuned gains make small"
    )
    tuning_starts: Few = given("1", "starts of the tuning: the least gains, and random changes of them")
    tuning_spread: Positive = given("1", "standard deviation of these changes")

    @model_validator(mode="after")
    def _fits_together(self):
        for name in ("printed_weights", "infinite_weights", "weight_path"):
            require_increase(name, getattr(self, name))
        efforts, weights = len(self.matched_efforts), len(self.printed_weights)
        if self.weight_rule == "matched" and efforts != weights:
            raise ValueError(
                f"weight_rule is 'matched', and matched_efforts has {efforts} values for {weights} printed_weights: "
                "give a control energy for each weight"
            )
        if 0.0 in self.tuning_errors:
            raise ValueError("tuning_errors has a zero, without which gains have nothing to do: leave it out")
        return self


class Simulation(Section):
    """Flights with given position errors at entry, and how all flights are integrated."""

    tabulated_error: Number = given("m", "radius error of Table 3, either way")
    compared_errors: vector(2) = given(
        "m", "errors at entry in each channel after which flights with and without feedback are compared, either way"
    )
    drawn_errors: vector(3) = given("m", "radius, crossrange and downrange error of the histories, either way")
    wide_errors: vector(3, Positive) = given("m", "largest radius, crossrange and downrange error of the sweeps")
    narrow_errors: vector(3, Positive) = given("m", "the same of the zoomed ones")
    sweep_points: Points = given("1", "initial errors in a sweep")
    substeps: Substeps = given("1", "Runge-Kutta steps in an interval of the nominal")

    @model_validator(mode="after")
    def _errors_are_errors(self):
        for name in ("tabulated_error", "compared_errors", "drawn_errors"):
            _no_zero(name, getattr(self, name))
        return self


class Ensemble(Trials):
    """Flights with random position errors at entry."""

    initial_deviations: vector(3, NonNegative) = given(
        "m", "standard deviations of radius, crossrange and downrange at entry"
    )


class Studies(Section):
    """Studies of what the paper leaves open."""

    fuel_bounds: vector(2, Positive) = given("rad/s^2", "bounds of the bank acceleration in the problems of least fuel")
    low_heights: vector(2, Positive) = given(
        "m", "heights above deployment between which lie the altitudes that count as low"
    )

    @model_validator(mode="after")
    def _rises(self):
        require_increase("low_heights", self.low_heights)
        return self


def check_bank_rates(vehicle: Vehicle, mission: Mission) -> None:
    """Refuse bank rates at the ends that the vehicle may not have."""
    bound = vehicle.bank_rate_bound
    for name, rate in (("initial_bank_rate", mission.initial_bank_rate), ("final_bank_rate", mission.final_bank_rate)):
        if rate is not None and abs(rate) > bound:
            raise ValueError(f"mission.{name} lies beyond vehicle.bank_rate_bound: {abs(rate):g} above {bound:g} rad/s")


class Inputs(sections.Inputs):
    """Everything that the desensitized-landing results depend on."""

    CASES: ClassVar = {"entry_errors": "ensemble.trials"}
    CHECKS: ClassVar = (check_bank_rates,)

    planet: Planet
    vehicle: Vehicle
    mission: Mission
    solver: Solver
    design: Design
    simulation: Simulation
    ensemble: Ensemble
    studies: Studies
