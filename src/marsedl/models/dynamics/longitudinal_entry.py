"""Longitudinal entry with the density as a state of its own (stochastic entry guidance, Eqs. 13, 24 and 27)."""

import numpy as np

from marsedl.compiling import jitable
from marsedl.elementary import sine_cosine
from marsedl.models.dynamics.planar_entry import planar_entry_rates

__all__ = ["density_noise_intensity", "longitudinal_entry_rates"]


@jitable
def longitudinal_entry_rates(
    state,
    bank_cosine,
    mean_density,
    inverse_scale_height,
    decay_rate,
    drag_factor,
    lift_factor,
    gravitational_parameter,
):
    r"""Time derivatives of the longitudinal state and the drift of the density.

    Stochastic entry guidance, Eqs. 27 and 24 with the density's drift of Eq. 13:

        $\dot{r} = V \, \sin\gamma$
        $\dot{V} = -k_D \rho V^2 - g \, \sin\gamma$
        $\dot{\gamma} = k_L \rho V u - \left( g - \frac{V^2}{r} \right) \frac{\cos\gamma}{V}, \quad g =
          \frac{\mu}{r^2}$
        $\dot{R} = V \, \cos\gamma$
        $\dot{\rho} = \left[ \left( \frac{1}{H} - \lambda \right) \rho + \lambda \bar{\rho} \right] \dot{s},
          \quad \dot{s} = -V \, \sin\gamma$

    The planet does not rotate. Mean density, scale height and decay rate are those at the current radius, looked up by
    the caller.

    Args:
        state: radius r (m), velocity V (m/s), flight path angle gamma (rad, positive while climbing), downrange R (m;
            the rates do not depend on it) and density rho (kg/m^3).
        bank_cosine: u, cosine of the bank angle, 1.
        mean_density: rho_bar, kg/m^3.
        inverse_scale_height: 1/H, 1/m.
        decay_rate: lambda of the density variation, 1/m.
        drag_factor, lift_factor: k_D, k_L, m^2/kg.
        gravitational_parameter: mu, m^3/s^2.

    Returns:
        Tuple of the rates of radius (m/s), velocity (m/s^2), flight path angle (rad/s), downrange (m/s) and density
        (kg/(m^3 s)).
    """
    radius, velocity, flight_path_angle, _, density = state
    _, cos_path = sine_cosine(flight_path_angle)
    climb, velocity_rate, path_rate = planar_entry_rates(
        radius, velocity, flight_path_angle, bank_cosine, density, drag_factor, lift_factor, gravitational_parameter
    )
    return (
        climb,
        velocity_rate,
        path_rate,
        velocity * cos_path,
        -((inverse_scale_height - decay_rate) * density + decay_rate * mean_density) * climb,
    )


@jitable
def density_noise_intensity(mean_density, diffusion, radius_rate):
    r"""Variance that the density of a descending vehicle gains per second (stochastic entry guidance, Eqs. 13 and 24).

        $g^2 = \bar{\rho}^2 \varphi \, \max(\dot{s}, 0), \quad \dot{s} = -\dot{r}$

    A climbing vehicle meets densities again that it has seen below, hence no new noise.

    Args:
        mean_density: rho_bar, kg/m^3.
        diffusion: phi of the relative density variation, 1/m.
        radius_rate: r', m/s.

    Returns:
        g^2, (kg/m^3)^2/s.
    """
    return mean_density * mean_density * diffusion * np.maximum(-radius_rate, 0.0)
