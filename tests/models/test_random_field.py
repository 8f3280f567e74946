from functools import partial

import numpy as np
import pytest

from marsedl.models import density_variation as dv
from marsedl.models import random_field as rf

DENSITY = partial(
    rf.altitude_exponential, variance=0.148, upper_altitude=120e3, growth_length=20e3, correlation_length=11.1e3
)
FORCE = partial(rf.locally_periodic, variance=2e-6, period=0.35, periodic_length=0.8, length=1.0)
SMOOTH = partial(rf.squared_exponential, variance=1.7, length=0.6)
# Markov on a line: above upper_altitude the variance is constant, which leaves exp(-|x - x'| / 0.5)
EXPONENTIAL = partial(
    rf.altitude_exponential, variance=1.3, upper_altitude=-10.0, growth_length=1.0, correlation_length=0.5
)
UNEVEN = np.array([20e3, 20.1e3, 23e3, 31e3, 44e3, 45e3, 60e3, 75e3, 90e3, 110e3, 119e3, 120e3, 121e3, 150e3, 260e3])
FINE = np.arange(20e3, 260e3 + 1, 100.0)


def covariance_of_samples(sampler, count):
    """Exact covariance of a sampler that is linear in its normals: the response to every unit vector."""
    response = sampler(np.eye(count))
    return response.T @ response


def recursion(kernel, altitudes):
    coefficients = rf.markov(kernel, altitudes)
    return lambda normals: dv.sample_process(normals, *coefficients)


def assert_same_covariance(actual, expected, relative=1e-12):
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    assert (np.abs(actual - expected) <= relative * scale).all()


# ---- kernels ----


def test_deviation_of_the_density_variation():
    altitudes = np.array([0, 30, 45, 60, 80, 100, 120, 200]) * 1e3
    deviation = np.sqrt(DENSITY(altitudes, altitudes))
    np.testing.assert_allclose(100 * deviation, [1.92, 4.05, 5.90, 8.58, 14.15, 23.33, 38.47, 38.47], atol=5e-3)
    dense = DENSITY(FINE, FINE)
    assert (np.diff(dense) >= 0).all()
    np.testing.assert_array_equal(dense, dv.exponential_variance(FINE, 0.148, 120e3, 20e3)[0])


def test_altitude_that_sets_the_variance():
    low, high = 60e3, 100e3
    decay = np.exp(-40e3 / 11.1e3)
    b_low, b_high = 0.148 * np.exp(-3.0), 0.148 * np.exp(-1.0)
    for at, expected in (("lower", b_low), ("upper", b_high), ("both", np.sqrt(b_low * b_high))):
        for pair in ((low, high), (high, low)):
            assert DENSITY(*pair, correlation_altitude=at) == pytest.approx(expected * decay, rel=1e-14)
        assert DENSITY(low, low, correlation_altitude=at) == pytest.approx(b_low, rel=1e-14)


def test_fully_correlated_field_is_one_number_times_the_deviation():
    kernel = partial(DENSITY, correlation_length=np.inf, correlation_altitude="both")
    deviation = np.sqrt(DENSITY(FINE, FINE))
    normals = np.random.default_rng(1).standard_normal((3, FINE.size))
    np.testing.assert_allclose(recursion(kernel, FINE)(normals), np.outer(normals[:, -1], deviation), rtol=1e-11)
    # With the variance of the lower altitude, what remains is the correlation by the changing variance.
    assert DENSITY(60e3, 100e3, correlation_length=np.inf) / (deviation[400] * deviation[800]) == pytest.approx(
        np.exp(-40e3 / 40e3), rel=1e-12
    )


def test_upper_variance_needs_a_correlation_that_decays_faster():
    upper = partial(DENSITY, correlation_altitude="upper", growth_length=20e3)
    rf.markov(partial(upper, correlation_length=39e3), FINE)
    for call in (lambda k: rf.markov(k, FINE), lambda k: rf.root(rf.covariance_matrix(k, FINE[:600:20]))):
        with pytest.raises(ValueError, match=r"is not a covariance|is not positive semidefinite"):
            call(partial(upper, correlation_length=45e3))


def test_locally_periodic_in_closed_form():
    assert FORCE(0.7, 0.7) == 2e-6
    # a whole period forgets by the distance alone, half a period by the most that the sine allows
    assert FORCE(0.1, 0.45) == pytest.approx(2e-6 * np.exp(-(0.35**2) / 2), rel=1e-14)
    assert FORCE(0.1, 0.275) == pytest.approx(2e-6 * np.exp(-2 / 0.64 - 0.175**2 / 2), rel=1e-14)
    r = np.linspace(-0.4, 1.4, 37)
    covariance = rf.covariance_matrix(FORCE, r)
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_allclose(covariance, rf.covariance_matrix(FORCE, r + 0.123), rtol=1e-12)
    # limits: strictly periodic, and squared exponential
    assert FORCE(0.0, 3 * 0.35 + 0.02, length=1e12) == pytest.approx(FORCE(0.0, 0.02, length=1e12), rel=1e-12)
    np.testing.assert_allclose(FORCE(r, 0.3, period=1e9), rf.squared_exponential(r, 0.3, 2e-6, 1.0), rtol=1e-12)


def test_squared_exponential_on_a_line_and_in_the_plane():
    assert SMOOTH(0.3, 0.9) == pytest.approx(1.7 * np.exp(-0.5), rel=1e-14)
    points = np.random.default_rng(2).uniform(size=(6, 2))
    actual = rf.covariance_matrix(partial(rf.squared_exponential, variance=1.7, length=(0.5, 0.2)), points)
    for i, first in enumerate(points):
        for j, second in enumerate(points):
            x, y = first - second
            assert actual[i, j] == pytest.approx(1.7 * np.exp(-(x**2) / 0.5 - y**2 / 0.08), rel=1e-13)


# ---- covariance matrices ----


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.ones((2, 3)), "must be a square matrix, not of shape \\(2, 3\\)"),
        ([[1.0, 0.2], [0.1, 1.0]], "is not symmetric: .* up to 1.0e-01 of the largest"),
        (
            [[1.0, 3.0], [3.0, 1.0]],
            "is not positive semidefinite: its smallest eigenvalue is -5.0e-01 of the largest",
        ),
        (np.diag([1.0, -1e-9]), "smallest eigenvalue is -1.0e-09"),
    ],
)
def test_matrices_that_are_no_covariance_are_refused(matrix, message):
    with pytest.raises(ValueError, match=message):
        rf.root(matrix)


# ---- samples ----


@pytest.mark.parametrize(
    ("kernel", "points"),
    [(FORCE, np.linspace(-0.4, 1.4, 181)), (DENSITY, UNEVEN), (SMOOTH, np.array([0.0, 0.0, 1.0]))],
)
def test_root_is_symmetric_and_squares_to_the_covariance(kernel, points):
    covariance = rf.covariance_matrix(kernel, points)
    root = rf.root(covariance)
    np.testing.assert_array_equal(root, root.T)
    assert np.abs(root @ root - covariance).max() < 1e-13 * covariance.max()
    assert np.linalg.eigvalsh(root)[0] > -1e-13 * np.linalg.eigvalsh(root)[-1]
    actual = covariance_of_samples(lambda normals: rf.sample(normals, root), len(points))
    assert np.abs(actual - covariance).max() < 1e-13 * covariance.max()


def test_a_sample_is_the_product_and_does_not_depend_on_the_others():
    root = rf.root(rf.covariance_matrix(FORCE, np.linspace(-0.4, 1.4, 181)))
    normals = np.random.default_rng(4).standard_normal((70, 181))
    together = rf.sample(normals, root)
    np.testing.assert_allclose(together, normals @ root.T, atol=1e-13 * np.sqrt(2e-6))
    np.testing.assert_array_equal(rf.sample(normals[33:34], root)[0], together[33])


# ---- the recursion ----


@pytest.mark.parametrize(
    "kernel",
    [
        DENSITY,
        partial(DENSITY, growth_sign=-1),
        partial(DENSITY, correlation_altitude="upper"),
        partial(DENSITY, correlation_altitude="both"),
        partial(DENSITY, correlation_length=np.inf),
    ],
)
def test_recursion_has_exactly_the_covariance_of_the_kernel(kernel):
    for altitudes in (UNEVEN, FINE[:1301]):
        actual = covariance_of_samples(recursion(kernel, altitudes), altitudes.size)
        assert_same_covariance(actual, rf.covariance_matrix(kernel, altitudes))


def hidden_far_apart(first, second):
    """Deviates from the density field only where two altitudes are 30 km and more apart."""
    far = np.abs(first - second) >= 30e3
    return DENSITY(first, second) * np.where(far, 0.9, 1.0)


def hidden_nearby(first, second):
    """Deviates from the density field only 200 m apart, and only in a layer of 2 km."""
    pair = (np.abs(np.abs(first - second) - 200.0) < 1.0) & (np.abs(first - 31e3) < 1e3)
    return DENSITY(first, second) * np.where(pair, 0.9, 1.0)


@pytest.mark.parametrize(
    ("kernel", "altitudes"),
    [
        (partial(rf.squared_exponential, variance=0.1, length=10e3), UNEVEN),
        (partial(rf.locally_periodic, variance=0.1, period=3e3, periodic_length=1.0, length=20e3), FINE),
        (lambda first, second: DENSITY(first, second) + 1e-6, FINE),
        (hidden_far_apart, FINE),
        (hidden_nearby, FINE),
    ],
)
def test_kernels_that_are_not_markov_are_refused(kernel, altitudes):
    with pytest.raises(ValueError, match=r"not Markov .* sample it by the `root` of its covariance matrix"):
        rf.markov(kernel, altitudes)


# ---- conditioning ----

POINTS = np.linspace(0, 2, 9)
MEASURED, VALUES, NOISE = (
    np.array([0.3, 0.85, 1.6, 1.7]),
    np.array([0.5, -1.0, 0.2, 2.0]),
    np.array([0.1, 0.2, 0.05, 0.3]),
)


def test_conditioning_by_the_precision_of_the_joint_vector():
    # x | y from blocks of the inverse: covariance (L_xx)^-1, mean -(L_xx)^-1 L_xy y
    joint = rf.covariance_matrix(EXPONENTIAL, np.concatenate([POINTS, MEASURED])) + np.diag([0.0] * 9 + list(NOISE))
    precision = np.linalg.inv(joint)
    covariance = np.linalg.inv(precision[:9, :9])
    mean = 0.4 - covariance @ precision[:9, 9:] @ (VALUES - 0.4)
    found_mean, found_covariance = rf.condition(EXPONENTIAL, POINTS, MEASURED, VALUES, NOISE, mean=0.4)
    np.testing.assert_allclose(found_mean, mean, rtol=1e-11)
    np.testing.assert_allclose(found_covariance, covariance, atol=1e-12)
    np.testing.assert_array_equal(found_covariance, found_covariance.T)


@pytest.mark.parametrize("kernel", [SMOOTH, EXPONENTIAL])
def test_noise_free_conditioning_interpolates(kernel):
    points = np.concatenate([MEASURED, POINTS, [50.0]])
    mean, covariance = rf.condition(kernel, points, MEASURED, VALUES, 0.0, mean=0.25)
    prior = rf.covariance_matrix(kernel, points)
    weight = np.abs(np.linalg.inv(prior[:4, :4]) @ (VALUES - 0.25)).max()
    assert np.abs(mean[:4] - VALUES).max() <= 1.001e-10 * prior[0, 0] * weight
    deviation = np.sqrt(covariance.diagonal())
    assert (deviation[:4] <= 1.001e-5 * np.sqrt(prior[0, 0])).all()
    assert (deviation[4:-1] <= np.sqrt(prior[0, 0])).all()
    assert deviation[4] > 0.1  # 0.3 before the first measurement
    assert mean[-1] == 0.25  # far away nothing is learnt
    assert covariance[-1, -1] == prior[0, 0]


def test_conditioned_samples_have_exactly_the_conditional_covariance():
    prior_root = rf.root(rf.covariance_matrix(SMOOTH, np.concatenate([POINTS, MEASURED])))

    def conditioned(normals):
        samples = 0.4 + rf.sample(normals[:, :13], prior_root)
        return rf.condition_samples(SMOOTH, POINTS, MEASURED, VALUES, NOISE, samples, normals[:, 13:])

    mean, covariance = rf.condition(SMOOTH, POINTS, MEASURED, VALUES, NOISE, mean=0.4)
    np.testing.assert_allclose(conditioned(np.zeros((1, 17)))[0], mean, rtol=1e-11)
    actual = covariance_of_samples(lambda normals: conditioned(normals) - mean, 17)
    np.testing.assert_allclose(actual, covariance, atol=1e-12)


# ---- use of a sample ----


def test_interpolation_against_one_row_after_the_other():
    rng = np.random.default_rng(8)
    values = rng.standard_normal((7, UNEVEN.size))
    positions = np.concatenate([rng.uniform(0, 300e3, 40), UNEVEN, [-1e9, 1e9]])
    actual = rf.interpolate(positions, UNEVEN, values)
    np.testing.assert_allclose(actual, [np.interp(positions, UNEVEN, row) for row in values], atol=1e-13)
    np.testing.assert_array_equal(rf.interpolate(UNEVEN, UNEVEN, values), values)
    np.testing.assert_array_equal(rf.interpolate([0.0, 20e3, 260e3, np.inf], UNEVEN, values), values[:, [0, 0, -1, -1]])
    row_by_row = rf.interpolate(positions[:7, np.newaxis], UNEVEN, values)[:, 0]
    np.testing.assert_array_equal(row_by_row, actual[range(7), range(7)])
    np.testing.assert_array_equal(rf.interpolate(positions[3], UNEVEN, values), actual[:, 3])
    np.testing.assert_array_equal(rf.interpolate(positions, UNEVEN, values[2]), actual[2])
    assert np.isnan(rf.interpolate(np.nan, UNEVEN, values)).all()


# ---- errors ----

EYE2 = np.eye(2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SMOOTH(0.0, 1.0, variance=-1.0), "variance must not be negative, got -1"),
        (lambda: rf.covariance_matrix(SMOOTH, [1.0, np.nan]), "kernel is not finite"),
        (lambda: rf.sample(np.ones((2, 3)), EYE2), "do not fit: shapes \\(2, 3\\) and \\(2, 2\\)"),
        (lambda: rf.markov(DENSITY, UNEVEN[::-1]), "altitudes must be at least 2 finite, strictly increasing"),
        (lambda: rf.markov(lambda a, b: -DENSITY(a, b), UNEVEN), "kernel is not a covariance: at 20000 m"),
        (lambda: rf.interpolate(1.0, [0.0, 1.0], [1.0, 1.0, 1.0]), "one entry per node, shape \\(..., 2\\)"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()
