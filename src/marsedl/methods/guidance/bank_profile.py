"""Nominal bank profile: the cosine of the bank angle as a function of velocity (stochastic entry guidance, Sec. V)."""

import numpy as np

from marsedl.compiling import jitable

__all__ = ["ramped_bank_cosine", "ramped_bank_cosine_slope"]


@jitable
def ramped_bank_cosine(velocity, fast_velocity, slow_velocity, fast_cosine, slow_cosine):
    """Nominal bank cosine u(V): one value at high velocity, another at low velocity, a linear ramp between them.

    Args:
        velocity: V, m/s.
        fast_velocity, slow_velocity: bounds of the ramp, fast_velocity > slow_velocity, m/s.
        fast_cosine, slow_cosine: u from fast_velocity on and up to slow_velocity, 1.

    Returns:
        u, 1.
    """
    fast = np.minimum(np.maximum((velocity - slow_velocity) / (fast_velocity - slow_velocity), 0.0), 1.0)
    return fast * fast_cosine + (1.0 - fast) * slow_cosine


@jitable
def ramped_bank_cosine_slope(velocity, fast_velocity, slow_velocity, fast_cosine, slow_cosine):
    """Derivative du/dV of `ramped_bank_cosine`, zero outside the ramp and at its two ends.

    Args:
        velocity: V, m/s.
        fast_velocity, slow_velocity, fast_cosine, slow_cosine: as there.

    Returns:
        du/dV, s/m.
    """
    on_ramp = (velocity > slow_velocity) * (velocity < fast_velocity)
    return on_ramp * ((fast_cosine - slow_cosine) / (fast_velocity - slow_velocity))
