"""Ellipses against their definitions."""

import numpy as np
import pytest

from marsedl.plotting.ellipses import ellipse, probability_inside


@pytest.mark.parametrize("sigma", [1.0, 3.0])
def test_every_point_of_an_ellipse_is_that_many_standard_deviations_away(sigma):
    mean, covariance = np.array([3.0, -1.0]), np.array([[4.0, 1.2], [1.2, 0.5]])
    away = ellipse(mean, covariance, sigma) - mean
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away), sigma**2, rtol=1e-12)
    np.testing.assert_allclose(away[0], away[-1], atol=1e-12)  # closed


def test_the_probability_inside_is_that_of_samples():
    samples = np.random.default_rng(1).standard_normal((200_000, 2))
    for sigma in (0.5, 1.0, 2.4477, 3.0):
        inside = np.mean(np.sum(samples**2, axis=1) < sigma**2)
        assert probability_inside(sigma) == pytest.approx(inside, abs=4 * np.sqrt(0.25 / len(samples)))
    assert probability_inside(np.sqrt(-2 * np.log(0.05))) == pytest.approx(0.95, rel=1e-12)
