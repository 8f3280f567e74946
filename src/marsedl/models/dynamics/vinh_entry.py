"""Entry over a rotating spherical planet with the heading counted from east, Eq. 37 of robust entry funnels."""

import numpy as np

from marsedl.compiling import jitable
from marsedl.models.dynamics.entry import rates_of_directions

__all__ = ["vinh_entry_rates"]


@jitable
def vinh_entry_rates(
    state,
    bank,
    density,
    planet_radius,
    drag_factor,
    lift_factor,
    gravitational_parameter,
    rotation_rate,
):
    r"""Time derivatives of the entry state, heading counter-clockwise from east (robust entry funnels, Eq. 37).

        $\dot{h} = V \, \sin\gamma$
        $\dot{\theta} = \frac{V \, \cos\gamma \, \cos\psi}{r \, \cos\phi}, \quad \dot{\phi} = \frac{V \, \cos\gamma
          \, \sin\psi}{r}$
        $\dot{V} = -\frac{D}{m} - g \, \sin\gamma + W^2 r \, \cos\phi (\sin\gamma \, \cos\phi - \cos\gamma \, \sin\phi
          \, \sin\psi)$
        $V \dot{\gamma} = \frac{L \, \cos\sigma}{m} - g \, \cos\gamma + \frac{V^2 \, \cos\gamma}{r} + 2 W V \, \cos\phi
          \, \cos\psi + a_\gamma$
        $a_\gamma = W^2 r \, \cos\phi (\cos\gamma \, \cos\phi + \sin\gamma \, \sin\phi \, \sin\psi)$
        $V \dot{\psi} = -\frac{L \, \sin\sigma}{m \, \cos\gamma} - \frac{V^2 \, \cos\gamma \, \cos\psi \, \tan\phi}{r} +
          a_\psi$
        $a_\psi = 2 W V (\tan\gamma \, \cos\phi \, \sin\psi - \sin\phi) - \frac{W^2 r \, \sin\phi \, \cos\phi
          \, \cos\psi}{\cos\gamma}$

    with r = R + h, g = mu/r^2, D/m = k_D rho V^2, L/m = k_L rho V^2, W the rotation rate. The paper abbreviates the
    Coriolis and centrifugal terms and leaves out that of V'. They are those of `entry_rates`, whose azimuth
    is pi/2 - psi.

    Args:
        state: altitude h (m), longitude theta (rad; the rates do not depend on it), latitude phi (rad), planet-relative
            velocity V (m/s), flight path angle gamma (positive while climbing, rad) and heading psi (counter-clockwise
            from east, rad): six scalars or arrays in a tuple or along a first axis.
        bank: sigma, rad; a positive bank turns right, that is, lowers psi.
        density: rho, kg/m^3.
        planet_radius: R, m.
        drag_factor, lift_factor: k_D = 1/(2 B_c) and k_L = (L/D)/(2 B_c) for the ballistic coefficient B_c, m^2/kg.
        gravitational_parameter: mu, m^3/s^2.
        rotation_rate: W, rad/s.

    Returns:
        Tuple of the rates of altitude (m/s), longitude, latitude (rad/s), velocity (m/s^2), flight path angle and
        heading (rad/s).
    """
    altitude, _, latitude, velocity, flight_path_angle, heading = state
    climb, longitude_rate, latitude_rate, velocity_rate, path_rate, azimuth_rate = rates_of_directions(
        planet_radius + altitude,
        velocity,
        (np.sin(latitude), np.cos(latitude)),
        (np.sin(flight_path_angle), np.cos(flight_path_angle)),
        (np.cos(heading), np.sin(heading)),
        (np.sin(bank), np.cos(bank)),
        density,
        (drag_factor, lift_factor),
        (gravitational_parameter, rotation_rate),
        1.0,
    )
    return climb, longitude_rate, latitude_rate, velocity_rate, path_rate, -azimuth_rate
