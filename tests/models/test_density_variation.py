import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from marsedl.models import density_variation as dv
from marsedl.models.atmosphere import log_quadratic

VARIANCE = (0.148, 120e3, 20e3)
GRID = np.linspace(-10e3, 127e3, 1371)


def inverse_scale_height(altitude):
    return -log_quadratic(altitude, -0.0343295, -0.8737816, -4.2342822, 60e3)[1]


def decay_at(altitude):
    return dv.decay_rate(inverse_scale_height(altitude), 2.0)


def covariance_of_samples(sample, count):
    """Exact covariance of a sampler that is linear in its normals: the response to every unit vector."""
    response = sample(np.eye(count))
    return response.T @ response


# ---- variance profiles ----


def test_exponential_variance():
    deviation = np.sqrt(dv.exponential_variance(np.array([0.0, 40e3, 80e3, 120e3, 127e3]), *VARIANCE)[0])
    np.testing.assert_allclose(deviation, [0.0192, 0.0521, 0.1415, 0.3847, 0.3847], atol=5e-5)
    h = np.array([-5e3, 30e3, 119.9e3, 120.1e3])
    low, high = (dv.exponential_variance(h + d, *VARIANCE)[0] for d in (-1.0, 1.0))
    np.testing.assert_allclose((high - low) / 2, dv.exponential_variance(h, *VARIANCE)[1], rtol=1e-7)


def test_mars_gram_2010_deviation():
    h = np.array([0, 5.2, 30, 65, 100, 110, 130, 200]) * 1e3
    expected = [2, 2, 30 * np.exp(-2), 30 * np.exp(-1), 30, 35, 45, 45]
    np.testing.assert_allclose(100 * dv.mars_gram_2010_deviation(h), expected, rtol=1e-12)
    dense = dv.mars_gram_2010_deviation(np.arange(0, 150e3, 1.0))
    assert (np.diff(dense) >= 0).all()
    assert np.diff(dense).max() < 1.01 * 0.3 / 35e3  # no jump: at most the slope times 1 m


@njit
def compiled(altitude, variation):
    zeta, slope = dv.exponential_variance(altitude, 0.148, 120e3, 20e3)
    decay = dv.decay_rate(1 / 8e3, 2.0)
    phi = dv.diffusion(decay, zeta)
    stationary = dv.stationary_variance(phi, decay)
    factor, negative = dv.density_factor(variation), dv.is_floored(variation)
    return zeta, slope, decay, phi, stationary, dv.mars_gram_2010_deviation(altitude), factor, negative


def test_numba_agrees_with_numpy():
    for altitude in (-3e3, 5e3, 60e3, 110e3, 120e3, 140e3):
        for variation in (-1.5, -1.0, 0.3):
            np.testing.assert_allclose(
                compiled(altitude, variation), compiled.py_func(altitude, variation), rtol=5e-15, atol=1e-30
            )


# ---- coefficients ----


def test_coefficients_are_those_of_the_remark():
    scale_height, zeta = 8e3, 0.02
    decay = dv.decay_rate(1 / scale_height, 2.0)
    phi = dv.diffusion(decay, zeta)
    assert phi == pytest.approx(4 * zeta / scale_height, rel=1e-15)
    assert dv.stationary_variance(phi, decay) == pytest.approx(phi * scale_height / 4, rel=1e-15)  # Eq. 10
    assert dv.stationary_variance(phi, decay) == pytest.approx(zeta, rel=1e-15)


def test_variance_against_an_adaptive_integrator():
    phi = dv.diffusion(decay_at(GRID), dv.exponential_variance(GRID, *VARIANCE)[0])
    actual = dv.process_variance(GRID, decay_at(GRID), phi, 0.1)

    def slope(s, variance):
        h = 127e3 - s
        return -2 * decay_at(h) * variance + dv.diffusion(decay_at(h), dv.exponential_variance(h, *VARIANCE)[0])

    every = slice(1370, None, -50)
    solution = solve_ivp(slope, (0, 137e3), [0.1], "DOP853", rtol=1e-10, atol=1e-14, t_eval=127e3 - GRID[every])
    # Two orders in the spacing d: d^2 g (2 lambda + g) / 12 relative, with the growth g = 1 / 20 km and H >= 7.78 km.
    growth = 1 / 20e3
    bound = 100**2 * growth * (4 * inverse_scale_height(80e3) + growth) / 12
    assert bound < 2.4e-5
    np.testing.assert_allclose(actual[every], solution.y[0], rtol=1.05 * bound)  # higher orders


def test_variance_is_exact_for_constant_coefficients_and_second_order_otherwise():
    decay, phi = 2 / 8e3, 1e-5
    h = np.array([0.0, 3e3, 4e3, 20e3])
    stationary = phi / (2 * decay)
    exact = stationary + (0.3 - stationary) * np.exp(-2 * decay * (20e3 - h))
    np.testing.assert_allclose(dv.process_variance(h, decay, phi, 0.3), exact, rtol=1e-14)
    np.testing.assert_allclose(dv.process_variance(h, 0.0, phi, 0.3), 0.3 + phi * (20e3 - h), rtol=1e-14)  # Brownian

    def at_10_km(nodes):
        grid = np.linspace(10e3, 50e3, nodes)
        return dv.process_variance(grid, decay_at(grid), phi * (1 + grid / 1e4) ** 2, 0.3)[0]

    errors = [at_10_km(n) - at_10_km(6401) for n in (101, 201, 401)]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4, rtol=0.02)


def test_eq_11_overshoots_the_desired_variance():
    zeta = dv.exponential_variance(GRID, *VARIANCE)[0]
    decay = decay_at(GRID)
    ratio = np.sqrt(dv.process_variance(GRID, decay, dv.diffusion(decay, zeta), zeta[-1]) / zeta)
    at = {h: ratio[np.argmin(np.abs(GRID - h * 1e3))] for h in (20, 40, 60, 80, 100)}
    # Closed form where 1/H is constant, once the start at 120 km is forgotten: 1 / (1 - H / (4 L))
    np.testing.assert_allclose([at[80], at[60]], (1 - 1 / (4 * 20e3 * inverse_scale_height(80e3))) ** -0.5, rtol=2e-4)
    # From an adaptive integration of the variance (DOP853, relative tolerance 1e-11). A forward Euler march in steps of
    # 1 km would give 1.0511, 1.0511, 1.0511, 1.0569 and 1.0651.
    reference = [1.05246, 1.05247, 1.05247, 1.05841, 1.06685]
    np.testing.assert_allclose([at[h] for h in (100, 80, 60, 40, 20)], reference, rtol=2.5e-5)


# ---- samplers ----


def test_covariance_of_the_process_sampler_in_closed_form():
    grid = np.array([0.0, 1e3, 1.5e3, 4e3, 9e3])
    decay = 2 / np.array([9e3, 8.9e3, 8.8e3, 8.5e3, 8e3])
    phi = dv.diffusion(decay, np.array([0.01, 0.012, 0.013, 0.02, 0.03]))
    retention = dv.retention(grid, decay)
    deviation = np.sqrt(dv.innovation_variance(grid, decay, phi))
    actual = covariance_of_samples(lambda z: dv.sample_process(z, retention, deviation, 0.2), 5)
    variance = dv.process_variance(grid, decay, phi, 0.04)
    np.testing.assert_allclose(np.diag(actual), variance, rtol=1e-14)
    for low in range(5):
        for high in range(low, 5):
            # the past enters through the upper node alone
            expected = np.prod(retention[low:high]) * variance[high]
            assert actual[low, high] == pytest.approx(expected, rel=1e-13)


def test_covariance_of_the_exact_sampler_in_closed_form():
    decay, deviation = decay_at(GRID), np.sqrt(dv.exponential_variance(GRID, *VARIANCE)[0])
    actual = covariance_of_samples(lambda z: dv.sample_exact(z, dv.retention(GRID, decay), deviation), GRID.size)
    np.testing.assert_allclose(np.diag(actual), deviation**2, rtol=1e-12)
    accumulated = np.concatenate([[0], np.cumsum(np.diff(GRID) * (decay[:-1] + decay[1:]) / 2)])
    correlation = np.exp(-np.abs(accumulated[:, np.newaxis] - accumulated))
    np.testing.assert_allclose(actual, correlation * np.outer(deviation, deviation), rtol=1e-10)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dv.retention([0.0, 2.0, 1.0], 0.1), "altitudes must be a grid .*strictly increasing"),
        (lambda: dv.sample_exact(np.zeros((2, 3)), np.ones(2), 1.0), "one value per node, shape \\(3,\\), got \\(\\)"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()
