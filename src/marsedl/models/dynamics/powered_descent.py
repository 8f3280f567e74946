"""Planar powered descent of a point mass with mass flow (Ridderhof and Tsiotras, powered descent; Eqs. 1, 2, 49)."""

import numpy as np

from marsedl.compiling import jitable

__all__ = ["mass_flow_constant", "powered_descent_rates", "thrust_magnitude"]

# Keeps the derivative of the square root finite (zero) at zero thrust; far below rounding for any other thrust.
_SMALLEST_SQUARED_THRUST = 1e-300


def mass_flow_constant(specific_impulse, standard_gravity):
    """Propellant mass per impulse, alpha = 1 / (Isp g0) (Eq. 2 and Sec. V).

    Args:
        specific_impulse: Isp, s.
        standard_gravity: g0, m/s^2.

    Returns:
        alpha, kg/(N s).
    """
    return 1.0 / (specific_impulse * standard_gravity)


@jitable
def thrust_magnitude(thrust_downrange, thrust_vertical):
    """Norm of the thrust, ||u|| (Eq. 2), with the derivative zero at zero thrust.

    Args:
        thrust_downrange, thrust_vertical: u1, u2, N.

    Returns:
        ||u||, N.
    """
    return np.sqrt(thrust_downrange * thrust_downrange + thrust_vertical * thrust_vertical + _SMALLEST_SQUARED_THRUST)


@jitable
def powered_descent_rates(state, thrust, disturbance, gravity, mass_flow_constant):
    r"""Time derivatives of position, velocity and mass (Eqs. 1, 2 and 49).

        $\dot{r} = v, \quad \dot{v} = (0, -g) + \frac{u + d}{m}, \quad \dot{m} = -\alpha \lVert u \rVert$

    The disturbance d (noise held over a step in a simulation) accelerates the vehicle but burns no propellant.

    Args:
        state: downrange and altitude r1, r2 (m), downrange and vertical velocity v1, v2 (upwards positive, m/s) and
            mass m (kg).
        thrust: commanded, downrange and vertical, u1, u2, N.
        disturbance: force, downrange and vertical, d1, d2, N.
        gravity: g > 0, acting downwards, m/s^2.
        mass_flow_constant: alpha, kg/(N s).

    Returns:
        Tuple of the rates of downrange, altitude (m/s), downrange velocity, vertical velocity (m/s^2), mass (kg/s).
    """
    _, _, downrange_velocity, vertical_velocity, mass = state
    thrust_downrange, thrust_vertical = thrust
    disturbance_downrange, disturbance_vertical = disturbance
    inverse_mass = 1.0 / mass  # one division, the slowest operation of a kernel, in place of two
    return (
        downrange_velocity,
        vertical_velocity,
        (thrust_downrange + disturbance_downrange) * inverse_mass,
        (thrust_vertical + disturbance_vertical) * inverse_mass - gravity,
        -mass_flow_constant * thrust_magnitude(thrust_downrange, thrust_vertical),
    )
