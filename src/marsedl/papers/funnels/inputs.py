"""Typed inputs of the funnels paper; their values and sources are in `configs/funnels.yaml`."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, PlainSerializer, Strict, model_validator

from marsedl.replication.inputs import sections
from marsedl.replication.inputs.sections import (
    ARRAY,
    Count,
    Few,
    NonNegative,
    Number,
    Positive,
    Section,
    Seed,
    StudyTrials,
    given,
    vector,
)
from marsedl.sections.air import MeanDensity
from marsedl.sections.checks import require_increase, require_inside, require_multiples
from marsedl.sections.ensemble import Trials
from marsedl.sections.planet import CentralBody
from marsedl.sections.vehicle import EntryVehicle

# As `ARRAY`, of whole numbers, and written as such.
WHOLE = (ARRAY[0], PlainSerializer(lambda value: value.astype(int).tolist()))

Intervals = Annotated[int, Strict(), Field(ge=10, le=5000)]
FineSteps = Annotated[int, Strict(), Field(ge=2, le=5000)]
Order = Annotated[int, Strict(), Field(ge=1, le=3)]
Exponent = Annotated[int, Strict(), Field(ge=0, le=10)]
Flag = Annotated[bool, Strict()]
Coordinate = Annotated[int, Strict(), Field(ge=1, le=6)]
Points = Annotated[int, Strict(), Field(ge=3, le=2001)]
Starts = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=50), *ARRAY]

Share = Annotated[float, Strict(), Field(ge=0, lt=1)]  # of the flight
Samples = Annotated[int, Strict(), Field(ge=43, le=406)]


class Planet(CentralBody, MeanDensity):
    """The planet and its air, whose mean density is one exponential: ln rho = a + b h."""

    rotation_rate: Number = given("1/s", "rotation rate of Mars, radians per second")
    density_profile: Literal["exponential", "log_quadratic", "temperature_pressure_fit", "two_exponential", "table"] = (
        given("1", "mean density: the exponential that is given, or a profile through whose logarithm a line is fitted")
    )
    log_density_at_surface: Number = given("1", "of exponential: a in ln rho = a + b h, rho in kg/m^3")
    log_density_slope: Annotated[float, Strict(), Field(lt=0, allow_inf_nan=False)] = given(
        "1/m", "of exponential: b in the same"
    )
    density_window: vector(2) = given("m", "of the other profiles: altitudes between which the line is fitted")

    @model_validator(mode="after")
    def _window(self):
        require_increase("density_window", self.density_window)
        return self


class Vehicle(EntryVehicle):
    """The vehicle: its motion in the air, and its heating."""

    nose_radius: Positive = given("m", "nose radius in the law of Sutton and Graves for the heat rate")
    heat_rate_constant: Positive = given("kg^0.5/m", "constant of that law")


class Mission(Section):
    """From where to where the nominal flies, and within what limits."""

    entry_altitude: Positive = given("m", "altitude at entry")
    entry_longitude: Number = given("rad", "longitude at entry")
    entry_latitude: Number = given("rad", "latitude at entry")
    entry_velocity: Positive = given("m/s", "planet-relative velocity at entry")
    entry_flight_path_angle: Number = given("rad", "flight path angle at entry, positive while climbing")
    entry_heading: Number = given("rad", "heading at entry, counter-clockwise from east")
    final_altitude: Positive = given("m", "altitude at parachute deployment, where the flight ends")
    final_downrange: Positive | None = given(
        "m", "distance flown to the east, over the planet's radius the change of longitude; empty: by downrange_ratio"
    )
    downrange_ratio: Positive = given(
        "1", "that distance, in whole km, over the one that the slowest arrival under constant bank flies"
    )
    final_velocity_bounds: vector(2, Positive) = given("m/s", "between which the final velocity must lie")
    least_velocity: Positive = given("m/s", "velocity below which the solver does not look")
    bank_bounds: vector(2) = given("rad", "between which the bank angle must lie")
    heat_rate_limit: Positive | None = given(
        "W/m^2", "largest heat rate, imposed at the nodes; empty: by heat_rate_ratio"
    )
    heat_rate_ratio: Positive = given(
        "1", "that limit, in tenths of W/cm^2, over the largest heat rate of the nominal without a limit"
    )
    goal_lengths: vector(2, Positive) = given("m", "half widths of the goal region: downrange and crossrange")

    @model_validator(mode="after")
    def _limits(self):
        require_increase("final_velocity_bounds", self.final_velocity_bounds)
        require_increase("bank_bounds", self.bank_bounds)
        if self.final_altitude >= self.entry_altitude:
            raise ValueError("final_altitude is not below entry_altitude: exchange them")
        if self.least_velocity > self.final_velocity_bounds[0]:
            raise ValueError("least_velocity lies above the first of final_velocity_bounds: lower it")
        return self


class Guidance(Section):
    """How the nominal trajectory and the regulator around it are computed."""

    intervals: Intervals = given("1", "intervals of constant bank rate, one less than the nodes")
    scheme: Literal["midpoint", "trapezoid", "hermite_simpson"] = given("1", "transcription of the equations of motion")
    final_time_bounds: vector(2, Positive) = given("s", "between which the solver looks for the final time")
    nominal_tolerance: Positive = given("1", "tolerance of the solver on scaled equations and optimality")
    nominal_iterations: Few = given("1", "largest number of iterations of a solve")
    guess_bank: Positive = given("rad", "constant bank angle of the guess")
    guess_final_time: Positive = given("s", "final time of the guess")
    start_banks: Starts = given("rad", "constant bank angles of the further starts, drawn into bank_bounds")
    start_final_times: Starts = given(
        "s", "final times of the further starts, each with every bank angle, drawn into final_time_bounds"
    )
    nominal_choice: Literal["guess", "best_of_starts"] = given(
        "1", "optimum that is flown: the one that the guess leads to, or that of least bank rate"
    )
    scale_lengths: vector(3, Positive) = given(
        "m", "altitude, downrange and crossrange that cost as much as one another"
    )
    scale_velocity: Positive = given("m/s", "velocity that costs as much")
    scale_angles: vector(2, Positive) = given("rad", "flight path angle and heading that cost as much")
    scale_bank: Positive = given("rad", "bank angle that costs as much, as feedback")
    state_cost_time: Positive = given("s", "time over which such a state costs as much as it does at the end")
    control_cost_time: Positive = given("s", "time over which such a bank angle does")
    terminal_weight: Positive = given("1", "factor of the cost at the end")
    fine_steps: FineSteps = given("1", "integration steps of reference, regulator and flights")

    @model_validator(mode="after")
    def _final_times(self):
        require_increase("final_time_bounds", self.final_time_bounds)
        require_inside("guess_final_time", self.guess_final_time, self.final_time_bounds)
        return self


class Uncertainty(Section):
    """Set of the states at entry, and sets of the disturbances.

    The density has two disturbances w, in the unit disc: of its level, at all altitudes, and of its slope.
    """

    initial_lengths: vector(3, Positive) = given("m", "semi-axes of the initial set: altitude, downrange, crossrange")
    initial_velocity: Positive = given("m/s", "its semi-axis of velocity")
    initial_angles: vector(2, Positive) = given("rad", "its semi-axes of flight path angle and heading")
    initial_scale: Positive = given("1", "factor of all of these semi-axes")
    density_disturbance: Literal["parametric", "additive"] = given(
        "1", "how the disturbance w enters: in the exponent of the density, or added to it, in shares of its mean"
    )
    density_amplitude: NonNegative = given("1", "largest change of ln rho, or share of rho, at all altitudes")
    density_slope_amplitude: NonNegative = given("1/m", "largest change of the slope of ln rho, or of that share")
    additive: Flag = given("1", "whether disturbances are added to all rates as well")
    additive_velocities: vector(3, Positive) = given("m/s", "largest of them: altitude, downrange, crossrange")
    additive_acceleration: Positive = given("m/s^2", "largest of them: velocity")
    additive_turn_rates: vector(2, Positive) = given("1/s", "largest of them: flight path angle and heading, rad per s")


class Recursion(Section):
    """How the funnel goes from slice to slice, and how its stages are checked."""

    steps_per_slice: Few = given("1", "fine steps from one slice of the funnel to the next")
    shape: Literal["value_matrix", "minimum_trace", "minkowski"] = given(
        "1",
        "shape of the slices: that of the regulator's cost, or of least trace or, of Minkowski sums, least volume "
        "around what linear dynamics reach",
    )
    condition: Literal["flow", "euler"] = given("1", "what a stage bounds: the integrated motion, or the Euler step")
    sampling: Literal["whitened", "raw"] = given(
        "1", "where the points of Eq. 26 lie: on the slice, or on a sphere of the state itself, as printed"
    )
    raw_units: vector(6, Positive) = given("m, rad, rad, m/s, rad, rad", "of raw: units in which the state is taken")
    taylor_order: Order = given("1", "order of the expansion of the motion in deviation and disturbance together")
    exponent_d: Exponent = given(
        "1", "exponent d of the factor (x'x)^d in Eq. 24; it enters no stage, as the factor is equal at all samples"
    )
    design_seed: Seed = given("1", "key of the random points from which the samples are chosen")
    program_tolerance: Positive = given("1", "tolerance of the semidefinite programs, relative to the range of values")
    largest_level: Positive = given("1", "level above which a funnel is said to diverge")
    largest_feedback: Positive | None = given(
        "rad", "feedback bank on a slice above which the expansion is not trusted; empty: any"
    )
    inflated: Flag = given("1", "whether a level is raised to the largest value found of the motion itself")
    ascent_starts: Few = given("1", "random points among which that value is sought")
    ascent_polished: Few = given("1", "how many of them, the best, are improved")
    ascent_iterations: Few = given("1", "steps of improvement")
    check_points: Few = given("1", "fresh points on which every certificate is checked")
    tightness_starts: Few = given("1", "the same three numbers for the largest value of the polynomial:")
    tightness_polished: Few = given("1", "points improved, of the polynomial")
    tightness_iterations: Few = given("1", "steps of improvement, of the polynomial")

    @model_validator(mode="after")
    def _polished(self):
        for name, polished, starts in (
            ("ascent", self.ascent_polished, self.ascent_starts),
            ("tightness", self.tightness_polished, self.tightness_starts),
        ):
            if polished > starts:
                raise ValueError(f"{name}_polished ({polished}) is above {name}_starts ({starts})")
        return self


class Ensemble(Trials):
    """How many flights there are, and under which disturbances."""

    trials: Count = given("1", "flights with constant disturbance")
    redrawn_trials: Count = given("1", "flights whose disturbance is drawn again and again")
    redraw_steps: Few = given("1", "fine steps after which it is, or the nearest number that divides all of them")
    adversarial_trials: Count = given("1", "flights against the disturbance that raises V fastest")
    adversarial_directions: Annotated[int, Strict(), Field(ge=3, le=1000)] = given(
        "1", "directions among which that is chosen"
    )


class Car(Section):
    """The Dubins car."""

    dubins_speed: Positive = given("m/s", "speed of the Dubins car")
    dubins_start: vector(3) = given("m, m, rad", "where its path begins: x, y and heading")
    dubins_duration: Positive = given("s", "duration of its path")
    dubins_turn_rate: NonNegative = given("1/s", "amplitude of its turn rate, a sine over time, radians per second")
    dubins_mean_turn_rate: Number = given("1/s", "turn rate about which that sine swings, radians per second")
    dubins_periods: Positive = given("1", "periods of that sine over the path")
    dubins_state_weight: vector(3, Positive) = given("1", "weights on x, y and heading, SI units")
    dubins_control_weight: Positive = given("1", "weight on the turn rate, SI units")
    dubins_terminal_weight: vector(3, Positive) = given("1", "weights at the end")
    dubins_fine_steps: FineSteps = given("1", "integration steps of its path")
    dubins_steps_per_slice: Few = given("1", "fine steps from one of its slices to the next")
    dubins_level: Positive = given("1", "level rho of the first of them")
    dubins_wind: Positive = given("m/s", "largest wind on it, in any direction")
    dubins_trials: StudyTrials = given("1", "runs of the Dubins car")
    dubins_wind_trials: StudyTrials = given("1", "runs of the Dubins car in constant wind")

    @model_validator(mode="after")
    def _slices(self):
        steps = (self.dubins_fine_steps,)
        require_multiples("dubins_fine_steps", steps, "dubins_steps_per_slice", self.dubins_steps_per_slice)
        return self


class Studies(Section):
    """Studies of the methods, and the plane of Fig. 4."""

    benchmark_slice: Share = given("1", "slice whose stage is solved in all forms, as a share of the flight")
    benchmark_level: Positive = given("1", "level rho of that slice then")
    studied_samples: Annotated[tuple[Samples, ...], Field(min_length=2, max_length=20), *WHOLE] = given(
        "1", "numbers of random samples from which that stage is bounded"
    )
    stationary_slice: Share = given("1", "slice where stationary disturbances are sought, as a share of the flight")
    stationary_level: Positive = given("1", "level rho of that slice then")
    stationary_points: Few = given("1", "deviations for which they are sought")
    backward_level: Positive = given("1", "level rho of the last slice from which the funnel is computed backwards")
    coarse_stages: Few = given(
        "1",
        "stages of the coarse funnels, all of which have the same slices. We take the nearest number that divides "
        "fine_steps",
    )
    fig4_slice: Few = given("1", "slice of Fig. 4, counted from 1")
    fig4_coordinates: Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=2), *WHOLE] = given(
        "1", "whitened coordinates that span its plane, counted from 1"
    )
    fig4_extent: Positive = given("1", "largest coordinate in it; the slice is the unit circle")
    fig4_points: Points = given("1", "grid points along each of its axes")

    @model_validator(mode="after")
    def _studied(self):
        if self.fig4_coordinates[0] == self.fig4_coordinates[1]:
            raise ValueError("fig4_coordinates: two different ones span a plane")
        return self


def check_banks(mission: Mission, guidance: Guidance) -> None:
    """Refuse a guess of the bank angle that lies outside of its bounds."""
    require_inside("guidance.guess_bank", guidance.guess_bank, mission.bank_bounds)


def check_steps(guidance: Guidance, recursion: Recursion) -> None:
    """Refuse stages that do not consist of whole fine steps."""
    steps = (guidance.fine_steps,)
    require_multiples("guidance.fine_steps", steps, "recursion.steps_per_slice", recursion.steps_per_slice)


def check_slice(guidance: Guidance, recursion: Recursion, studies: Studies) -> None:
    """Refuse a slice of Fig. 4 from which no stage begins."""
    slices = guidance.fine_steps // recursion.steps_per_slice + 1
    if studies.fig4_slice >= slices:
        raise ValueError(
            f"studies.fig4_slice: no stage begins at slice {studies.fig4_slice}, as there are {slices}; give an "
            "earlier one, or fewer recursion.steps_per_slice"
        )


class Inputs(sections.Inputs):
    """Everything that the funnels depend on."""

    CASES: ClassVar = {
        "constant": "ensemble.trials",
        "redrawn": "ensemble.redrawn_trials",
        "adversarial": "ensemble.adversarial_trials",
    }
    CHECKS: ClassVar = (check_banks, check_steps, check_slice)

    planet: Planet
    vehicle: Vehicle
    mission: Mission
    guidance: Guidance
    uncertainty: Uncertainty
    recursion: Recursion
    ensemble: Ensemble
    car: Car
    studies: Studies
