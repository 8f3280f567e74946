"""The nominal aerocapture: entry angle and flight with the guessed control in the mean density (Eq. 71, Sec. V.B.2)."""

import numpy as np

from marsedl.models import orbits
from marsedl.papers.density import TableExits
from marsedl.papers.random_field import environment, flight
from marsedl.papers.random_field.curves import peak
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.inputs import (
    Guidance,
    Inputs,
    Mission,
    Planet,
    Simulation,
    Vehicle,
    correlation_matrix,
)
from marsedl.papers.random_field.partition import partition_fault, steps_between_outputs
from marsedl.papers.random_field.records import Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

CRASHED_APOAPSIS, ESCAPED_APOAPSIS = -1.0, 100.0  # planet radii, what the root finder sees beyond both ends


def initial_state(planet: Planet, vehicle: Vehicle, flight_path_angle):
    """Mean radius, velocity and flight path angle at the start."""
    return np.array([planet.planet_radius + vehicle.entry_altitude, vehicle.entry_velocity, flight_path_angle])


def initial_root(vehicle: Vehicle):
    """A root of the covariance at the start, (3, 3), SI: standard normals times its transpose are deviations."""
    root = np.linalg.cholesky(correlation_matrix(vehicle.initial_correlations))
    return np.array(vehicle.initial_deviations)[:, np.newaxis] * root


def open_loop(mission: Mission, guidance: Guidance):
    """The law of the initial guess: one control throughout, no feedback."""
    return flight.open_loop([0.0, mission.final_time], [guidance.initial_control])


def states_of(planet_radius, nominal: Nominal):
    """Radius, velocity and flight path angle of the nominal at every half integration step, (time, 3)."""
    return np.column_stack([nominal.altitude + planet_radius, nominal.velocity, nominal.flight_path_angle])


def partition_used(mission: Mission):
    """The partition on which laws hold their control, and why it is not the reading's, or an empty text."""
    fault = partition_fault(mission.partition, mission.final_time)
    if fault:
        return np.array([0.0, mission.final_time]), f"the partition {fault}"
    return np.array(mission.partition, dtype=float), ""


def output_steps(mission: Mission, simulation: Simulation):
    """Integration steps from one stored state of a flight to the next."""
    nodes, _ = partition_used(mission)
    return steps_between_outputs(nodes, simulation.time_step, simulation.output_interval)


def output_times(mission: Mission, simulation: Simulation):
    """Times of the stored states of flights."""
    interval = output_steps(mission, simulation) * simulation.time_step
    return np.arange(0.0, mission.final_time + interval / 2, interval)


@stage()
def compute(given: Inputs) -> Nominal:
    """Solve the entry angle if it is not given, and fly.

    Raises MarsedlError if no entry angle of the bracket reaches the target, or if the flight leaves the density table.
    """
    planet, air = given.planet, given.air
    plant = flight.plant_of(given)
    law = open_loop(given.mission, given.guidance)
    angle = given.vehicle.entry_flight_path_angle
    if given.vehicle.entry_angle == "solved":
        angle = _entry_angle(given, plant, law)
    start = initial_state(planet, given.vehicle, angle)
    time, states = flight.propagate_nominal(*plant, law, start, time_step=given.simulation.time_step / 2)
    altitude = states[:, 0] - planet.planet_radius
    environment.require_in_table(air, time, altitude)
    TableExits(air).count(altitude).say("nominal flight")
    density = environment.mean_density(air, altitude)
    pressure = 0.5 * density * states[:, 1] ** 2
    peak_time, largest_pressure = peak(time, pressure)
    target_apoapsis, target_periapsis, gravity = targets(planet, given.mission)
    end = states[-1]
    return Nominal(
        entry_flight_path_angle=float(angle),
        time=time,
        altitude=altitude,
        velocity=states[:, 1],
        flight_path_angle=states[:, 2],
        density=density,
        dynamic_pressure=pressure,
        variation_deviation=environment.deviation(air, altitude),
        time_of_largest_dynamic_pressure=peak_time,
        largest_dynamic_pressure=largest_pressure,
        lowest_altitude=float(altitude.min()),
        apoapsis=finite_or_nan(orbits.apoapsis_radius(*end, gravity) / planet.planet_radius),
        delta_v=finite_or_nan(orbits.total_delta_v(*end, target_apoapsis, target_periapsis, gravity)),
    )


def _entry_angle(given: Inputs, plant, law):
    planet, mission = given.planet, given.mission
    from scipy.optimize import brentq

    step = given.simulation.time_step / 2
    last = round(mission.final_time / given.simulation.time_step * 2)

    def miss(angle):
        start = initial_state(planet, given.vehicle, angle)
        _, states = flight.propagate_nominal(*plant, law, start, time_step=step, every=last)
        radius, velocity, path_angle = states[-1]
        if not radius - planet.planet_radius > mission.least_exit_altitude:
            return CRASHED_APOAPSIS - mission.target_apoapsis
        apoapsis = orbits.apoapsis_radius(radius, velocity, path_angle, planet.gravitational_parameter)
        return min(float(apoapsis) / planet.planet_radius, ESCAPED_APOAPSIS) - mission.target_apoapsis

    steep, shallow = given.vehicle.entry_angle_bracket
    ends = miss(steep), miss(shallow)
    if not ends[0] < 0.0 < ends[1]:
        raise MarsedlError(
            f"no entry angle from {np.rad2deg(steep):g} to {np.rad2deg(shallow):g} deg is sure to reach the target "
            f"apoapsis without control: at these ends it is missed by {ends[0]:.3g} and {ends[1]:.3g} planet radii; "
            "widen entry_angle_bracket, or check density and ballistic_coefficient"
        )
    return brentq(miss, steep, shallow, xtol=1e-13, rtol=1e-13)


def finite_or_nan(value):
    """The number as artifacts can hold it: NaN for what is not finite, such as the apoapsis of an escape."""
    return float(value) if np.isfinite(value) else np.nan
