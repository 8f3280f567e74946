"""Convective heating of a blunt body in hypersonic flight."""

import numpy as np

from marsedl.compiling import jitable

__all__ = ["sutton_graves_heat_rate"]


@jitable
def sutton_graves_heat_rate(density, velocity, nose_radius, constant):
    r"""Convective heat rate at the stagnation point by the law of Sutton and Graves.

        $q = k \sqrt{\frac{\rho}{R_n}} V^3$

    Args:
        density: rho, kg/m^3.
        velocity: V, m/s.
        nose_radius: R_n, m.
        constant: k of the gas, kg^(1/2)/m; 1.9027e-4 for the atmosphere of Mars.

    Returns:
        q, W/m^2.
    """
    return constant * np.sqrt(density / nose_radius) * (velocity * velocity * velocity)
