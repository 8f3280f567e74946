"""Entry of a gliding point mass over a rotating spherical planet, Eqs. 1-3 of stochastic entry guidance."""

import numpy as np

from marsedl.compiling import jitable
from marsedl.elementary import sine_cosine

__all__ = [
    "aerodynamic_coefficients",
    "aerodynamic_factor",
    "entry_rates",
    "reference_area",
]


def reference_area(diameter):
    """Area of a circle, A = pi d^2 / 4 (stochastic entry guidance, Table 1).

    Args:
        diameter: d, m.

    Returns:
        A, m^2.
    """
    return np.pi * diameter**2 / 4.0


def aerodynamic_coefficients(mass, reference_area, ballistic_coefficient, lift_to_drag):
    r"""Drag and lift coefficient from ballistic coefficient and lift-to-drag ratio (stochastic entry, Table 1).

        $C_D = \frac{m}{BC \, A}, \quad C_L = \frac{L}{D} C_D$

    Args:
        mass: m, kg.
        reference_area: A, m^2.
        ballistic_coefficient: BC, kg/m^2.
        lift_to_drag: L/D, 1.

    Returns:
        Tuple of C_D and C_L, 1.
    """
    drag_coefficient = mass / (ballistic_coefficient * reference_area)
    return drag_coefficient, lift_to_drag * drag_coefficient


@jitable
def aerodynamic_factor(coefficient, reference_area, mass):
    """Factor k of an aerodynamic acceleration k rho V^2, k = A C / (2 m) (stochastic entry guidance, Eqs. 2 and 3).

    Args:
        coefficient: C_D or C_L, 1.
        reference_area: A, m^2.
        mass: m, kg.

    Returns:
        k, m^2/kg.
    """
    return 0.5 * reference_area * coefficient / mass


@jitable
def entry_rates(state, bank, density, aerodynamics, planet, heading_sign):
    r"""Time derivatives of the entry state in planet-relative coordinates (stochastic entry guidance, Eqs. 1a to 1f).

        $\dot{r} = V \, \sin\gamma$
        $\dot{\theta} = \frac{V \, \cos\gamma \, \sin\psi}{r \, \cos\phi}, \quad \dot{\phi} = \frac{V \, \cos\gamma
          \, \cos\psi}{r}$
        $\dot{V} = -\frac{D}{m} - g \, \sin\gamma + W^2 r \, \cos\phi (\sin\gamma \, \cos\phi - \cos\gamma \, \sin\phi
          \, \cos\psi)$
        $V \dot{\gamma} = \frac{L \, \cos\sigma}{m} - g \, \cos\gamma + \frac{V^2 \, \cos\gamma}{r} + 2 W V \, \cos\phi
          \, \sin\psi + a_\gamma$
        $a_\gamma = W^2 r \, \cos\phi (\cos\gamma \, \cos\phi + \sin\gamma \, \sin\phi \, \cos\psi)$
        $V \dot{\psi} = \frac{L \, \sin\sigma}{m \, \cos\gamma} + s \left( \frac{V^2 \, \cos\gamma \, \sin\psi \,
          \tan\phi}{r} + a_\psi \right)$
        $a_\psi = -2 W V (\tan\gamma \, \cos\phi \, \cos\psi - \sin\phi) + \frac{W^2 r \, \sin\phi \, \cos\phi
          \, \sin\psi}{\cos\gamma}$

    with g = mu/r^2, D/m = k_D rho V^2, L/m = k_L rho V^2, W the rotation rate. The azimuth runs clockwise from north,
    as theta' and phi' show, so s = +1. Eq. 1f prints s = -1, for which vacuum flight keeps neither inertial energy nor
    angular momentum.

    Args:
        state: radius r (m), longitude theta (rad; the rates do not depend on it), latitude phi (rad), planet-relative
            velocity V (m/s), flight path angle gamma (rad, planet-relative, positive while climbing) and azimuth psi
            (rad, the planet-relative heading, clockwise from north).
        bank: sine and cosine of sigma, which a flight computes once a command; a positive bank turns the heading
            clockwise.
        density: rho, kg/m^3.
        aerodynamics: drag and lift factor k_D, k_L, m^2/kg (`aerodynamic_factor`).
        planet: gravitational parameter mu, m^3/s^2, and rotation rate W, rad/s.
        heading_sign: s, +1, or -1 as printed.

    Returns:
        Tuple of the rates of radius (m/s), longitude, latitude (rad/s), velocity (m/s^2), flight path angle and azimuth
        (rad/s).
    """
    radius, _, latitude, velocity, flight_path_angle, azimuth = state
    return rates_of_directions(
        radius,
        velocity,
        sine_cosine(latitude),
        sine_cosine(flight_path_angle),
        sine_cosine(azimuth),
        bank,
        density,
        aerodynamics,
        planet,
        heading_sign,
    )


@jitable
def rates_of_directions(
    radius, velocity, latitude, flight_path_angle, azimuth, bank, density, aerodynamics, planet, heading_sign
):
    """The rates of `entry_rates`, of sines and cosines in place of angles, whatever an azimuth is counted from.

    No function is called and every quotient shares a reciprocal, so that a loop over trials becomes vector code.
    """
    sin_latitude, cos_latitude = latitude
    sin_flight_path_angle, cos_flight_path_angle = flight_path_angle
    sin_azimuth, cos_azimuth = azimuth
    sin_bank, cos_bank = bank
    drag_factor, lift_factor = aerodynamics
    gravitational_parameter, rotation_rate = planet
    inverse_radius = 1.0 / radius
    inverse_velocity = 1.0 / velocity
    inverse_cos_latitude = 1.0 / cos_latitude
    inverse_cos_path = 1.0 / cos_flight_path_angle

    gravity = gravitational_parameter * inverse_radius * inverse_radius
    mass_flux = density * velocity
    climb = velocity * sin_flight_path_angle
    angular_speed = velocity * cos_flight_path_angle * inverse_radius
    eastward = angular_speed * sin_azimuth
    centrifugal = rotation_rate * rotation_rate * radius * cos_latitude
    northward_sine = sin_latitude * cos_azimuth

    velocity_rate = (
        -drag_factor * mass_flux * velocity
        - gravity * sin_flight_path_angle
        + centrifugal * (sin_flight_path_angle * cos_latitude - cos_flight_path_angle * northward_sine)
    )
    path_rate = (
        lift_factor * mass_flux * cos_bank
        + angular_speed
        - gravity * cos_flight_path_angle * inverse_velocity
        + 2.0 * rotation_rate * cos_latitude * sin_azimuth
        + centrifugal
        * (cos_flight_path_angle * cos_latitude + sin_flight_path_angle * northward_sine)
        * inverse_velocity
    )
    inertial_heading_rate = (
        eastward * sin_latitude * inverse_cos_latitude
        - 2.0 * rotation_rate * (sin_flight_path_angle * inverse_cos_path * cos_latitude * cos_azimuth - sin_latitude)
        + centrifugal * sin_latitude * sin_azimuth * inverse_cos_path * inverse_velocity
    )
    heading_rate = lift_factor * mass_flux * sin_bank * inverse_cos_path + heading_sign * inertial_heading_rate
    return (
        climb,
        eastward * inverse_cos_latitude,
        angular_speed * cos_azimuth,
        velocity_rate,
        path_rate,
        heading_rate,
    )
