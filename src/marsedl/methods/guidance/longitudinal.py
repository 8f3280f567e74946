"""Linear model of longitudinal entry and density about a reference flight (stochastic entry guidance, Sec. III.A)."""

import numpy as np

from marsedl.methods.checks import require_shape
from marsedl.methods.linearization import linearize
from marsedl.models.dynamics.longitudinal_entry import longitudinal_entry_rates

__all__ = ["linear_model"]


def _rates_with_profile(drag_factor, lift_factor, gravitational_parameter):
    """Rates with the profile's values at the current radius as further states, so that they are differentiated too."""

    def rates(
        radius,
        velocity,
        flight_path_angle,
        downrange,
        density,
        mean_density,
        inverse_scale_height,
        decay_rate,
        bank_cosine,
    ):
        changes = longitudinal_entry_rates(
            (radius, velocity, flight_path_angle, downrange, density),
            bank_cosine,
            mean_density,
            inverse_scale_height,
            decay_rate,
            drag_factor,
            lift_factor,
            gravitational_parameter,
        )
        return (*changes, 0.0, 0.0, 0.0)

    return rates


def linear_model(
    states,
    bank_cosine,
    mean_density,
    inverse_scale_height,
    inverse_scale_height_slope,
    decay_factor,
    drag_factor,
    lift_factor,
    gravitational_parameter,
):
    r"""Matrices A and B of the deviation from a reference flight (stochastic entry guidance, Eqs. 32 and 33).

        $A = \frac{\partial f}{\partial (z, \rho)}, \quad B = \frac{\partial f}{\partial u}, \quad f = (f_z,
          f_\rho \dot{s})$

    Eq. 33 prints the derivative with respect to z alone, with which A is not square; the density is a state of Eq. 30.
    The atmosphere depends on the radius: d rho_bar/dr = -rho_bar/H, and lambda = decay_factor/H changes with H.

    Args:
        states: radius (m), velocity (m/s), flight path angle (rad), downrange (m), density (kg/m^3), (k, 5).
        bank_cosine: u, (k,).
        mean_density: rho_bar at the radii, kg/m^3, (k,).
        inverse_scale_height: 1/H there, 1/m, (k,).
        inverse_scale_height_slope: d(1/H)/dr there, 1/m^2, (k,).
        decay_factor: lambda H, 1.
        drag_factor, lift_factor: A C / (2 m), m^2/kg.
        gravitational_parameter: m^3/s^2.

    Returns:
        Tuple of A (k, 5, 5) and B (k, 5), 1/s in the units of the states.

    Raises:
        ValueError: if shapes do not fit, or a derivative is not finite at some point.
    """
    states = np.asarray(states, dtype=float)
    require_shape("states", states, ("k", 5), ", one column per longitudinal state")
    along = {
        "bank_cosine": bank_cosine,
        "mean_density": mean_density,
        "inverse_scale_height": inverse_scale_height,
        "inverse_scale_height_slope": inverse_scale_height_slope,
    }
    for name, values in along.items():
        require_shape(name, values, (len(states),), " as there are states")
    cosine, mean, inverse, inverse_slope = (np.asarray(values, dtype=float) for values in along.values())
    model = linearize(
        _rates_with_profile(drag_factor, lift_factor, gravitational_parameter),
        np.column_stack([states, mean, inverse, decay_factor * inverse]),
        cosine[:, np.newaxis],
    )
    profile_slope = np.stack([-mean * inverse, inverse_slope, decay_factor * inverse_slope], axis=1)
    state_matrix = model.state_matrix[:, :5, :5].copy()
    state_matrix[:, :, 0] += np.einsum("kij,kj->ki", model.state_matrix[:, :5, 5:], profile_slope)
    return state_matrix, model.control_matrix[:, :5, 0]
