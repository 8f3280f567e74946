"""The vehicle and its state at entry: means and dispersions of Tables 1 to 3, and the streams that draw them."""

from typing import NamedTuple

import numpy as np

from marsedl.models.dynamics.entry import aerodynamic_coefficients, aerodynamic_factor, reference_area
from marsedl.papers.stochastic_entry.inputs import Inputs, Mission, Planet, Vehicle

ENTRY_STREAM, DENSITY_STREAM, AERODYNAMICS_STREAM, PROCESS_STREAM = range(4)  # of random numbers; the last is Fig. 2's

RADIUS, LONGITUDE, LATITUDE, SPEED, PATH_ANGLE, AZIMUTH = range(6)  # of the state that flights integrate


class Body(NamedTuple):
    """The trimmed vehicle without errors."""

    mass: float  # kg
    area: float  # m^2
    drag_coefficient: float
    lift_coefficient: float


class Dispersions(NamedTuple):
    """What trials are drawn from."""

    entry_mean: np.ndarray  # (6,): radius, longitude, latitude, velocity, path angle, azimuth
    entry_deviations: np.ndarray  # (6,), standard deviations
    body: Body
    drag_error: float  # of the drag coefficient, at one end of the trim interval
    lift_error: float  # of the lift coefficient, at the same end


def dispersions_of(given: Inputs) -> Dispersions:
    """Return the distribution of entry states and vehicles."""
    return Dispersions(
        entry_mean(given.planet, given.mission),
        entry_deviations(given.planet, given.mission),
        body_of(given.vehicle),
        given.vehicle.drag_dispersion,
        given.vehicle.lift_dispersion,
    )


def body_of(vehicle: Vehicle) -> Body:
    """Return the trimmed vehicle, its coefficients from ballistic coefficient and lift-to-drag ratio."""
    area = reference_area(vehicle.reference_diameter)
    coefficients = aerodynamic_coefficients(vehicle.mass, area, vehicle.ballistic_coefficient, vehicle.lift_to_drag)
    return Body(vehicle.mass, area, *coefficients)


def factors(body: Body, drag_error=0.0, lift_error=0.0):
    """Drag and lift factor A C / (2 m), m^2/kg, with errors of the coefficients."""
    return (
        aerodynamic_factor(body.drag_coefficient + drag_error, body.area, body.mass),
        aerodynamic_factor(body.lift_coefficient + lift_error, body.area, body.mass),
    )


def entry_deviations(planet: Planet, mission: Mission):
    """Standard deviations of the entry state (Table 2): downrange on the longitude, crossrange on the latitude."""
    three_sigma = (
        0.0,
        mission.entry_downrange_three_sigma / planet.planet_radius,
        mission.entry_crossrange_three_sigma / planet.planet_radius,
        mission.entry_velocity_three_sigma,
        mission.entry_flight_path_angle_three_sigma,
        mission.entry_azimuth_three_sigma,
    )
    return np.array(three_sigma) / 3.0


def entry_mean(planet: Planet, mission: Mission):
    """Mean entry state (Table 2, Eq. 70)."""
    return np.array(
        (
            planet.planet_radius + planet.atmosphere_altitude,
            mission.entry_longitude,
            mission.entry_latitude,
            mission.entry_velocity,
            mission.entry_flight_path_angle,
            mission.entry_azimuth,
        )
    )
