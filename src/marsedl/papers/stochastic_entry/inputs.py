"""Typed inputs of the entry-guidance paper; their values and sources are in `configs/stochastic_entry.yaml`."""

import math
from typing import ClassVar, Literal

from pydantic import model_validator

from marsedl.replication.inputs import sections
from marsedl.replication.inputs.sections import (
    Count,
    Drawn,
    Fraction,
    NonNegative,
    Number,
    Positive,
    Section,
    Sign,
    at_most,
    given,
    vector,
)
from marsedl.sections.air import DensityVariance, MeanDensity
from marsedl.sections.checks import require_increase
from marsedl.sections.ensemble import Trials
from marsedl.sections.planet import CentralBody
from marsedl.sections.vehicle import EntryVehicle

LARGEST_CYCLE_COUNT = 100_000
LARGEST_ALTITUDE_COUNT = 100_000
Substeps = at_most(1000, "a flight with steps so short loses more to rounding than it gains")


class Planet(CentralBody):
    """The planet, and the equations of motion that its rotation enters."""

    rotation_rate: Number = given("1/s", "rotation rate of Mars, radians per second")
    atmosphere_altitude: Positive = given("m", "altitude of the edge of the atmosphere, where entry begins")
    heading_rate_form: Literal["corrected", "printed"] = given("1", "signs of the inertial terms of the heading rate")


class Air(MeanDensity, DensityVariance):
    """The mean density and the process that varies it."""

    density_grid_interval: Positive = given("m", "spacing of the altitudes at which densities are tabulated")
    lowest_tabulated_altitude: Number = given("m", "altitude at which that table begins; below, its ends are held")
    highest_tabulated_altitude: Positive = given("m", "altitude at which that table ends; above, its ends are held")
    variance_profile: Literal["exponential", "mars_gram_2010"] = given("1", "relative variance of the density")
    decay_factor: Positive = given("1", "decay rate of the density variation in inverse scale heights")
    diffusion_factor: Positive = given("1", "diffusion of the density variation in variances per scale height")

    @model_validator(mode="after")
    def _process_keeps_its_variance(self):
        if not math.isclose(self.diffusion_factor, 2.0 * self.decay_factor, rel_tol=1e-9):
            raise ValueError(
                f"decay_factor ({self.decay_factor:g}) and diffusion_factor ({self.diffusion_factor:g}) belong "
                "together: the process has the variance asked for only if the second is twice the first (Eq. 10)"
            )
        return self


class Vehicle(EntryVehicle):
    """The vehicle, its aerodynamics and their dispersion."""

    mass: Positive = given("kg", "vehicle mass")
    reference_diameter: Positive = given("m", "diameter of the reference area")
    trim_angle_of_attack: Number = given("rad", "trimmed angle of attack; shown only, as coefficients are inputs")
    trim_interval: vector(2) = given("rad", "interval of the trimmed angle of attack; shown only, like it")
    lift_dispersion: Number = given("1", "change of the lift coefficient at one end of the trim interval")
    drag_dispersion: Number = given("1", "change of the drag coefficient at the same end")


class Mission(Section):
    """Where entry begins, with its dispersion, and where the flight has to end."""

    entry_longitude: Number = given("rad", "mean longitude at entry")
    entry_latitude: Number = given("rad", "mean latitude at entry")
    entry_velocity: Positive = given("m/s", "mean planet-relative velocity at entry")
    entry_flight_path_angle: Number = given("rad", "mean flight path angle at entry")
    entry_azimuth: Number = given("rad", "mean heading azimuth at entry, clockwise from north")
    entry_velocity_three_sigma: NonNegative = given("m/s", "three standard deviations of the velocity")
    entry_flight_path_angle_three_sigma: NonNegative = given("rad", "three standard deviations of the path angle")
    entry_azimuth_three_sigma: NonNegative = given("rad", "three standard deviations of the azimuth")
    entry_downrange_three_sigma: NonNegative = given("m", "three standard deviations of the downrange, on longitude")
    entry_crossrange_three_sigma: NonNegative = given("m", "three standard deviations of the crossrange, on latitude")
    target_longitude: Number = given("rad", "longitude of the target")
    target_latitude: Number = given("rad", "latitude of the target")
    end_velocity: Positive = given("m/s", "velocity at which the nominal flight ends, and that of the trigger")
    time_limit: Positive = given("s", "time at which a flight ends that has not reached the trigger")
    positive_range_error: Literal["long", "short"] = given(
        "1", "which final range error Table 4 counts as positive: beyond the nominal's end, or before it"
    )


class Guidance(Section):
    """The nominal flight and what all laws share on board."""

    guidance_period: Positive = given("s", "time between bank commands")
    nominal_bank_fast: Number = given("rad", "nominal bank angle above the ramp's velocities")
    nominal_bank_slow: Number = given("rad", "nominal bank angle below the ramp's velocities")
    ramp_velocities: vector(2, Positive) = given("m/s", "velocities between which the bank's cosine ramps linearly")
    bank_rate_limit: Positive = given("rad/s", "largest bank rate from one command to the next; the first is free")
    rate_limit_form: Literal["corrected", "printed"] = given("1", "form of the rate limit: both signs, or as printed")
    deadband_times: vector(2) = given("s", "times between which the crossrange deadband narrows linearly")
    deadband_widths: vector(2, Positive) = given("m", "half widths of the deadband before and after")
    initial_bank_direction: Sign = given("1", "direction of the first bank")
    heading_alignment_form: Literal["corrected", "printed"] = given("1", "form of the heading alignment law")
    heading_alignment_velocity: Positive = given("m/s", "velocity at which heading alignment begins")
    heading_alignment_gain: Positive = given("1", "gain of the heading alignment")
    heading_alignment_limits: vector(2, Positive) = given(
        "rad", "largest bank of the heading alignment, first and then"
    )
    heading_alignment_limit_velocity: Positive = given("m/s", "velocity at which that limit changes")
    apollo_least_drag: NonNegative = given("m/s^2", "drag acceleration below which the Apollo law makes no correction")
    apollo_end: Literal["at_command", "at_passage"] = given(
        "1", "when the Apollo law yields to heading alignment: at the next bank command, or as its velocity is passed"
    )

    @model_validator(mode="after")
    def _in_order(self):
        require_increase("deadband_times", self.deadband_times)
        first, second = self.ramp_velocities
        if first <= second:
            raise ValueError(f"ramp_velocities: {first:g} and {second:g} stand in the wrong order")
        return self


class Design(Section):
    """How the gains of both laws are computed, and the studies of that design."""

    overcontrol: Positive = given("1", "overcontrol gain of the Apollo law")
    apollo_form: Literal["five_state", "drag", "density_blind"] = given("1", "what the Apollo law feeds back")
    apollo_time_adjoint: Literal["time", "velocity"] = given("1", "what the adjoint of the time-triggered law aims at")
    apollo_table_end: Literal["nominal", "held", "extrapolated"] = given(
        "1", "references of the Apollo law beyond its last gain: those of the nominal flight, held, or extrapolated"
    )
    apollo_covariance: Literal["effective_gains", "timed_gains"] = given(
        "1", "linear covariance of the Apollo law: as it is flown, against velocity, or by its gains against time"
    )
    final_weight: vector(5) = given("1", "weight of the final state (radius, velocity, path angle, downrange, density)")
    weight_length: Positive = given("m", "unit of length in which the final weight is stated")
    control_weight: Positive = given("1", "weight of the control variance")
    control_limit: Positive = given("1", "largest deviation of the bank cosine from its nominal value")
    chance_level: Fraction = given("1", "probability with which the limits hold")
    altitude_limit: Positive = given("m", "largest final altitude error")
    flight_path_angle_limit: Positive = given("rad", "largest final flight path angle error")
    partition_interval: Positive = given("s", "time over which a control correction is held in the design")
    gain_equation: Literal["corrected", "printed"] = given("1", "feedback gain: with the inverse, or as printed")
    altitude_limit_study: vector(6, Positive) = given("m", "altitude limits of the study of the trade-off")
    coarse_interval: Positive = given(
        "s", "intervals on which slow formulations are solved and altitude limits compared with the reading's own"
    )

    @model_validator(mode="after")
    def _study_ascends(self):
        require_increase("altitude_limit_study", self.altitude_limit_study)  # as the study compares neighbours
        return self


class Simulation(Trials):
    """How flights are integrated, and how many trials are flown from which random numbers."""

    nominal_substeps: Substeps = given("1", "integration steps per guidance period of the nominal flight, even")
    flight_substeps: Substeps = given("1", "integration steps per guidance period of the Monte Carlo flights")
    paper_trials: Count = given("1", "the first of these, as many as the paper flies")

    @model_validator(mode="after")
    def _as_many_as_the_paper(self):
        if not self.trials >= self.paper_trials:
            raise ValueError(f"trials ({self.trials}) must not be fewer than paper_trials ({self.paper_trials})")
        return self

    @model_validator(mode="after")
    def _steps_in_pairs(self):
        if self.nominal_substeps % 2:
            raise ValueError(
                f"nominal_substeps ({self.nominal_substeps}) must be even: the linear model takes the midpoints of "
                f"pairs of steps; write {self.nominal_substeps + 1}"
            )
        return self


class Drawing(Section):
    """What figures show."""

    drawn_densities: Drawn = given("1", "density samples drawn in the figures")
    fewest_flying: Count = given("1", "trials that must still fly for statistics over time to be shown")


def check_altitudes(planet: Planet, air: Air) -> None:
    """Refuse a table of densities that does not reach from the ground to entry, or is too coarse or too fine."""
    lowest, highest = air.lowest_tabulated_altitude, air.highest_tabulated_altitude
    if lowest > 0 or highest < planet.atmosphere_altitude:
        raise ValueError(
            f"air.lowest_tabulated_altitude ({lowest:g} m) and air.highest_tabulated_altitude ({highest:g} m) must "
            f"hold the ground and planet.atmosphere_altitude ({planet.atmosphere_altitude:g} m), where flights begin: "
            "beyond them the density is held, which the linear model does not know; widen them"
        )
    altitudes = (highest - lowest) / air.density_grid_interval
    if not 1 <= altitudes <= LARGEST_ALTITUDE_COUNT:
        raise ValueError(
            f"air.density_grid_interval makes {altitudes:.3g} altitudes from air.lowest_tabulated_altitude to "
            f"air.highest_tabulated_altitude; give one that makes 1 to {LARGEST_ALTITUDE_COUNT}"
        )


def check_velocities(mission: Mission, guidance: Guidance) -> None:
    """Refuse a heading alignment that no flight has between entry and its end."""
    if not mission.end_velocity < guidance.heading_alignment_velocity < mission.entry_velocity:
        raise ValueError(
            f"guidance.heading_alignment_velocity ({guidance.heading_alignment_velocity:g} m/s) must lie between "
            f"mission.end_velocity ({mission.end_velocity:g} m/s) and mission.entry_velocity "
            f"({mission.entry_velocity:g} m/s)"
        )


def check_periods(mission: Mission, guidance: Guidance, design: Design) -> None:
    """Refuse intervals that are longer than a flight may last, or too many in one."""
    cycles = mission.time_limit / guidance.guidance_period
    if cycles > LARGEST_CYCLE_COUNT:
        raise ValueError(
            f"mission.time_limit makes {cycles:.3g} guidance periods, more than {LARGEST_CYCLE_COUNT}: lower it, or "
            "raise guidance.guidance_period"
        )
    intervals = {
        "guidance.guidance_period": guidance.guidance_period,
        "design.partition_interval": design.partition_interval,
    }
    for name, interval in intervals.items():
        if interval > mission.time_limit:
            raise ValueError(
                f"{name} ({interval:g} s) is longer than mission.time_limit ({mission.time_limit:g} s): lower it"
            )


def check_partitions(guidance: Guidance, design: Design) -> None:
    """Refuse a partition of the design whose intervals do not begin with a guidance period."""
    refuse_partial_periods("design.partition_interval", [design.partition_interval], guidance.guidance_period)


def refuse_partial_periods(name: str, intervals, period: float) -> None:
    """Raise ValueError unless all intervals (s) of an input are multiples of the guidance period (s).

    The intervals of a study are checked by its stage, so that a reading which does not ask for it need not fit it.
    """
    for interval in map(float, intervals):
        if not math.isfinite(interval / period) or round(interval / period) * period != interval:
            raise ValueError(
                f"{name}: {interval:g} s; intervals must be multiples of guidance.guidance_period ({period:g} s)"
            )


class Inputs(sections.Inputs):
    """Everything that the entry-guidance results depend on."""

    CASES: ClassVar = dict.fromkeys(
        ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity"), "simulation.trials"
    )
    CHECKS: ClassVar = (check_altitudes, check_velocities, check_periods, check_partitions)

    planet: Planet
    air: Air
    vehicle: Vehicle
    mission: Mission
    guidance: Guidance
    design: Design
    simulation: Simulation
    drawing: Drawing
