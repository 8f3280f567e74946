"""The vehicle and its state at entry: means and dispersions of Tables 1 to 3, and the streams that draw them."""

import numpy as np

from marsedl.models.dynamics.entry import aerodynamic_coefficients, aerodynamic_factor, reference_area

ENTRY_STREAM, DENSITY_STREAM, AERODYNAMICS_STREAM, PROCESS_STREAM = range(4)  # of random numbers; the last is Fig. 2's

RADIUS, LONGITUDE, LATITUDE, SPEED, PATH_ANGLE, AZIMUTH = range(6)  # of the state that flights integrate


def coefficients(inputs):
    """Drag and lift coefficient of the trimmed vehicle, from ballistic coefficient and lift-to-drag ratio."""
    return aerodynamic_coefficients(
        inputs.mass, reference_area(inputs.reference_diameter), inputs.ballistic_coefficient, inputs.lift_to_drag
    )


def factors(inputs, drag_error=0.0, lift_error=0.0):
    """Drag and lift factor A C / (2 m), m^2/kg, with errors of the coefficients."""
    area = reference_area(inputs.reference_diameter)
    drag, lift = coefficients(inputs)
    return (
        aerodynamic_factor(drag + drag_error, area, inputs.mass),
        aerodynamic_factor(lift + lift_error, area, inputs.mass),
    )


def entry_deviations(inputs):
    """Standard deviations of the entry state (Table 2): downrange on the longitude, crossrange on the latitude."""
    three_sigma = (
        0.0,
        inputs.entry_downrange_three_sigma / inputs.planet_radius,
        inputs.entry_crossrange_three_sigma / inputs.planet_radius,
        inputs.entry_velocity_three_sigma,
        inputs.entry_flight_path_angle_three_sigma,
        inputs.entry_azimuth_three_sigma,
    )
    return np.array(three_sigma) / 3.0


def entry_mean(inputs):
    """Mean entry state (Table 2, Eq. 70)."""
    return np.array(
        (
            inputs.planet_radius + inputs.atmosphere_altitude,
            inputs.entry_longitude,
            inputs.entry_latitude,
            inputs.entry_velocity,
            inputs.entry_flight_path_angle,
            inputs.entry_azimuth,
        )
    )
