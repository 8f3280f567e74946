"""The nominal aerocapture: entry angle and flight without control in the mean density (Eq. 71, Sec. V.B.2)."""

import numpy as np

from marsedl.models import orbits
from marsedl.papers.random_field import environment, flight
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.inputs import Air, Mission, Planet, Simulation, Vehicle
from marsedl.papers.random_field.records import Nominal
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError

CRASHED_APOAPSIS, ESCAPED_APOAPSIS = -1.0, 100.0  # planet radii, what the root finder sees beyond both ends


def initial_state(planet: Planet, vehicle: Vehicle, flight_path_angle):
    """Mean radius, velocity and flight path angle at the start."""
    return np.array([planet.planet_radius + vehicle.entry_altitude, vehicle.entry_velocity, flight_path_angle])


def open_loop(mission: Mission):
    """The law of the initial guess: zero control, no feedback."""
    return flight.open_loop([0.0, mission.final_time], [0.0])


def states_of(planet_radius, nominal: Nominal):
    """Radius, velocity and flight path angle of the nominal at every half integration step, (time, 3)."""
    return np.column_stack([nominal.altitude + planet_radius, nominal.velocity, nominal.flight_path_angle])


def output_times(mission: Mission, simulation: Simulation):
    """Times of the stored states of flights."""
    return np.arange(0.0, mission.final_time + simulation.output_interval / 2, simulation.output_interval)


@stage()
def compute(planet: Planet, air: Air, vehicle: Vehicle, mission: Mission, simulation: Simulation) -> Nominal:
    """Solve the entry angle if it is not given, and fly.

    Raises MarsedlError if no entry angle of the bracket reaches the target, or if the flight leaves the density table.
    """
    plant = flight.plant_of(planet, air, vehicle, simulation)
    law = open_loop(mission)
    angle = vehicle.entry_flight_path_angle
    if vehicle.entry_angle == "solved":
        angle = _entry_angle(planet, vehicle, mission, simulation, plant)
    start = initial_state(planet, vehicle, angle)
    time, states = flight.propagate_nominal(*plant, law, start, time_step=simulation.time_step / 2)
    altitude = states[:, 0] - planet.planet_radius
    environment.require_in_table(air, time, altitude)
    density = np.exp(environment.profile(air)(altitude)[0])
    pressure = 0.5 * density * states[:, 1] ** 2
    peak_time, peak = _peak(time, pressure)
    target_apoapsis, target_periapsis, gravity = targets(planet, mission)
    end = states[-1]
    burns = orbits.burns(*end, target_apoapsis, target_periapsis, gravity)
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
        largest_dynamic_pressure=peak,
        lowest_altitude=float(altitude.min()),
        apoapsis=finite_or_nan(orbits.apoapsis_radius(*end, gravity) / planet.planet_radius),
        delta_v=finite_or_nan(orbits.total_delta_v(*end, target_apoapsis, target_periapsis, gravity)),
        clean_up_burn=finite_or_nan(burns.apoapsis_change),
    )


def _entry_angle(planet: Planet, vehicle: Vehicle, mission: Mission, simulation: Simulation, plant: flight.Plant):
    from scipy.optimize import brentq

    law, step = open_loop(mission), simulation.time_step / 2
    last = round(mission.final_time / simulation.time_step * 2)

    def miss(angle):
        start = initial_state(planet, vehicle, angle)
        _, states = flight.propagate_nominal(*plant, law, start, time_step=step, every=last)
        radius, velocity, path_angle = states[-1]
        if not radius - planet.planet_radius > mission.least_exit_altitude:
            return CRASHED_APOAPSIS - mission.target_apoapsis
        apoapsis = orbits.apoapsis_radius(radius, velocity, path_angle, planet.gravitational_parameter)
        return min(float(apoapsis) / planet.planet_radius, ESCAPED_APOAPSIS) - mission.target_apoapsis

    steep, shallow = vehicle.entry_angle_bracket
    ends = miss(steep), miss(shallow)
    if not ends[0] < 0.0 < ends[1]:
        raise MarsedlError(
            f"no entry angle from {np.rad2deg(steep):g} to {np.rad2deg(shallow):g} deg is sure to reach the target "
            f"apoapsis without control: at these ends it is missed by {ends[0]:.3g} and {ends[1]:.3g} planet radii; "
            "widen entry_angle_bracket, or check density and ballistic_coefficient"
        )
    return brentq(miss, steep, shallow, xtol=1e-13, rtol=1e-13)


def _peak(values, pressure):
    """Place and height of the largest value, of the parabola through it and its neighbours."""
    k = min(max(int(np.argmax(pressure)), 1), len(pressure) - 2)
    before, middle, after = pressure[k - 1 : k + 2]
    curvature = before - 2.0 * middle + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(values[k] + shift * (values[k + 1] - values[k])), float(middle - 0.25 * (before - after) * shift)


def finite_or_nan(value):
    """The number as artifacts can hold it: NaN for what is not finite, such as the apoapsis of an escape."""
    return float(value) if np.isfinite(value) else np.nan
