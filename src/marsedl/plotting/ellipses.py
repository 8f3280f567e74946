"""Covariance ellipses."""

import numpy as np


def ellipse(mean, covariance, sigma, points: int = 100):
    """Return the curve (points, 2) at `sigma` standard deviations around a mean (2,) with a covariance (2, 2)."""
    angle = np.linspace(0.0, 2 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return (np.asarray(mean)[:, np.newaxis] + sigma * np.linalg.cholesky(covariance) @ circle).T


def probability_inside(sigma):
    """Return the probability that a Gaussian in the plane lies inside its `sigma` ellipse: 1 - exp(-sigma^2 / 2)."""
    return 1.0 - np.exp(-(sigma**2) / 2)
