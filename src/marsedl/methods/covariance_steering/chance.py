"""Chance constraints on Gaussian variables as limits of their standard deviations."""

import numpy as np

__all__ = ["chance_factor"]


def chance_factor(level):
    """Half-width of the interval that a Gaussian variable stays in with a given probability, in standard deviations.

    sqrt(2) erfinv(level), by which Eqs. 82 and 84 (stochastic entry guidance) divide; level is 1 - p.

    Args:
        level: probability in (0, 1), scalar or array.

    Returns:
        Factor of the standard deviation; 3.0000 for 0.9973.

    Raises:
        ValueError: if a level is not in (0, 1).
    """
    from scipy.special import erfinv

    level = np.asarray(level, dtype=float)
    if not ((level > 0) & (level < 1)).all():
        raise ValueError(f"level must lie strictly between 0 and 1, not {level}: it is the probability 1 - p")
    return np.sqrt(2) * erfinv(level)
