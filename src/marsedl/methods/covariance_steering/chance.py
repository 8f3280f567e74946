"""Chance constraints on Gaussian variables as limits of their standard deviations."""

import numpy as np

__all__ = ["chance_factor", "upper_quantile"]


def upper_quantile(probability):
    r"""The number of standard deviations that a Gaussian exceeds with a given probability.

        $\text{cdfn}^{-1}(1 - p) \quad \text{(random field, Eqs. 44, 45 and 52)}$

    Args:
        probability: p in (0, 1), scalar or array.

    Returns:
        Factor of the standard deviation.
    """
    from scipy.special import ndtri

    return -ndtri(np.asarray(probability, dtype=float))


def chance_factor(level):
    """Half-width of the interval that a Gaussian variable stays in with a given probability, in standard deviations.

    sqrt(2) erfinv(level), by which Eqs. 82 and 84 (stochastic entry guidance) divide; level is 1 - p, and half
    of p lies on either side.

    Args:
        level: probability in (0, 1), scalar or array.

    Returns:
        Factor of the standard deviation; 3.0000 for 0.9973.

    Raises:
        ValueError: if a level is not in (0, 1).
    """
    level = np.asarray(level, dtype=float)
    if not ((level > 0) & (level < 1)).all():
        raise ValueError(f"level must lie strictly between 0 and 1, not {level}: it is the probability 1 - p")
    return upper_quantile((1 - level) / 2)
