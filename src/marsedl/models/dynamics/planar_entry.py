"""Flight of a gliding point mass in a vertical plane over a spherical planet at rest, Eq. 71 of random field."""

from marsedl.compiling import jitable
from marsedl.elementary import sine_cosine

__all__ = ["planar_entry_rates"]


@jitable
def planar_entry_rates(
    radius,
    velocity,
    flight_path_angle,
    bank_cosine,
    density,
    drag_factor,
    lift_factor,
    gravitational_parameter,
):
    r"""Time derivatives of radius, velocity and flight path angle (random field, Eqs. 71a to 71c).

        $\dot{r} = V \, \sin\gamma$
        $\dot{V} = -k_D \rho V^2 - g \, \sin\gamma$
        $\dot{\gamma} = k_L \rho V u - \left( g - \frac{V^2}{r} \right) \frac{\cos\gamma}{V}, \quad g =
          \frac{\mu}{r^2}$

    The caller looks up the density, random part included: rho = rho_bar(r) (1 + variation), Eq. 72.

    Args:
        radius: r, m.
        velocity: V, m/s.
        flight_path_angle: gamma, rad, positive while climbing.
        bank_cosine: u, cosine of the bank angle, 1.
        density: rho, kg/m^3.
        drag_factor, lift_factor: k_D = 1/(2 B_c) and k_L = (L/D)/(2 B_c) for the ballistic coefficient B_c, m^2/kg.
        gravitational_parameter: mu, m^3/s^2.

    Returns:
        Tuple of the rates of radius (m/s), velocity (m/s^2) and flight path angle (rad/s).
    """
    sin_path, cos_path = sine_cosine(flight_path_angle)
    gravity = gravitational_parameter / (radius * radius)
    mass_flux = density * velocity
    return (
        velocity * sin_path,
        -drag_factor * mass_flux * velocity - gravity * sin_path,
        lift_factor * mass_flux * bank_cosine - (gravity / velocity - velocity / radius) * cos_path,
    )
