import itertools
import math

import numpy as np
import pytest

from marsedl.elementary import sine_cosine
from marsedl.methods.taylor import Series
from marsedl.models.dynamics.entry import entry_rates


def factorials(order):
    return np.array([math.factorial(k) for k in range(order + 1)], dtype=float)


def line(base, order=7):
    """The variable itself around a base point, base + s."""
    return Series.along(base, 1.0, order)


# Closed forms: (function of the variable, base point, coefficients of s^0 ... s^7).
EXP_OF_SIN = np.array([1, 1, 1, 0, -3, -8, -3, 56]) / factorials(7)
SIN_OF_EXP_MINUS_ONE = np.array([0, 1, 1, 0, -5, -23, -74, -161]) / factorials(7)
SIGNS = (-1.0) ** np.arange(8)
CLOSED_FORMS = {
    "exp(sin s)": (lambda s: np.exp(np.sin(s)), 0.0, EXP_OF_SIN),
    "sin(exp(s) - 1)": (lambda s: np.sin(np.exp(s) - 1), 0.0, SIN_OF_EXP_MINUS_ONE),
    "1 / (1 + s)": (lambda s: 1 / (1 + s), 0.0, SIGNS),
    "reciprocal": (np.reciprocal, 2.0, SIGNS / 2.0 ** np.arange(1, 9)),
    "s / (1 - s)": (lambda s: s / (1 - s), 0.0, np.array([0, 1, 1, 1, 1, 1, 1, 1])),
    "log": (np.log, 1.0, np.array([0, 1, -1 / 2, 1 / 3, -1 / 4, 1 / 5, -1 / 6, 1 / 7])),
    "sqrt": (
        np.sqrt,
        4.0,
        2 * np.array([1, 1 / 8, -1 / 128, 1 / 1024, -5 / 32768, 7 / 262144, -21 / 4194304, 33 / 33554432]),
    ),
    "s ** 0.5": (lambda s: s**0.5, 1.0, np.array([1, 1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256, -21 / 1024, 33 / 2048])),
    "s ** -1.5": (
        lambda s: s**-1.5,
        1.0,
        np.array([math.prod(-1.5 - j for j in range(k)) / math.factorial(k) for k in range(8)]),
    ),
    "tan": (np.tan, 0.0, np.array([0, 1, 0, 1 / 3, 0, 2 / 15, 0, 17 / 315])),
    "cos": (np.cos, 0.0, np.array([1, 0, -1 / 2, 0, 1 / 24, 0, -1 / 720, 0])),
    "s ** 3, vanishing base": (lambda s: s**3, 0.0, np.array([0, 0, 0, 1, 0, 0, 0, 0])),
    "s ** 5": (lambda s: s**5, 2.0, np.array([32, 80, 80, 40, 10, 1, 0, 0])),
    "s ** -2": (lambda s: s**-2, 1.0, SIGNS * np.arange(1, 9)),
    "s ** 0": (lambda s: s**0, 0.0, np.array([1, 0, 0, 0, 0, 0, 0, 0])),
    "square": (np.square, 3.0, np.array([9, 6, 1, 0, 0, 0, 0, 0])),
    "-(+s)": (lambda s: -(+s), 3.0, np.array([-3, -1, 0, 0, 0, 0, 0, 0])),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_closed_forms(name):
    function, base, coefficients = CLOSED_FORMS[name]
    np.testing.assert_allclose(function(line(base)).coefficients, coefficients, rtol=1e-13, atol=1e-15)


def test_constants_on_either_side_broadcast_over_the_trailing_axes():
    scalar, vector = Series([1.0, 2.0, 3.0]), Series(np.arange(1.0, 13.0).reshape(3, 4))
    weights = np.array([1.0, -2.0, 3.0, 0.5])
    tail = np.zeros((2, 4))
    for series in (scalar, vector):
        full = np.broadcast_to(series.coefficients.reshape(3, -1), (3, 4))
        first = np.vstack([weights, tail])
        expected = {
            "+": (series + weights, weights + series, full + first),
            "*": (series * weights, weights * series, full * weights),
            "float": (2.5 * series, series * np.float64(2.5), 2.5 * series.coefficients),
        }
        for left, right, value in expected.values():
            np.testing.assert_array_equal(left.coefficients, value)
            np.testing.assert_array_equal(right.coefficients, value)
        np.testing.assert_array_equal((series - weights).coefficients, full - first)
        np.testing.assert_array_equal((weights - series).coefficients, first - full)
        np.testing.assert_allclose((series / weights).coefficients, full / weights)
        np.testing.assert_allclose((weights / series * series).coefficients, first, atol=1e-13)
    np.testing.assert_array_equal((scalar * vector).coefficients, (vector * scalar).coefficients)
    np.testing.assert_allclose((scalar / vector * vector).coefficients.T, [[1, 2, 3]] * 4, atol=1e-12)
    column = np.array([[1.0], [2.0]])
    assert (vector * column).coefficients.shape == (vector + column).coefficients.shape == (3, 2, 4)
    assert (column / vector).coefficients.shape == (3, 2, 4)


def test_coefficients_are_the_homogeneous_parts_of_a_multivariate_polynomial():
    random = np.random.default_rng(5)
    exponents = [e for e in itertools.product(range(4), repeat=3) if sum(e) <= 3]
    weights = random.standard_normal(len(exponents))
    points = random.standard_normal((3, 50))

    def polynomial(x, degrees):
        terms = [
            c * x[0] ** e[0] * x[1] ** e[1] * x[2] ** e[2]
            for c, e in zip(weights, exponents, strict=True)
            if sum(e) in degrees
        ]
        return sum(terms[1:], terms[0])

    along = polynomial([Series.along(0.0, x, 3) for x in points], range(4))
    parts = np.array([polynomial(points, [degree]) * np.ones(50) for degree in range(4)])
    np.testing.assert_allclose(along.coefficients, parts, rtol=1e-12, atol=1e-13)
    stretched = polynomial([Series.along(0.0, 1.7 * x, 3) for x in points], range(4))
    np.testing.assert_allclose(stretched.coefficients, (1.7 ** np.arange(4))[:, None] * parts, rtol=1e-12, atol=1e-12)


SCALES = np.array([1e4, 0.05, 100.0, 0.1, 0.1, 0.2])


def rates(deviation):
    """Entry rates of a state, with an exponential density, at a deviation from a fixed point in units of SCALES."""
    base = [3.41e6, 0.1, 3000.0, -0.15, 1.2, 0.9]
    radius, latitude, velocity, path, azimuth, bank = (
        b + s * d for b, s, d in zip(base, SCALES, deviation, strict=True)
    )
    density = 0.0158 * np.exp((3389.5e3 - radius) / 9354.5)
    state = radius, 0.0, latitude, velocity, path, azimuth
    return entry_rates(state, sine_cosine(bank), density, (3.7e-3, 9e-4), (4.2828e13, 7.0882e-5), 1.0)


def test_entry_rates_to_first_order_are_the_jacobian():
    series = rates([Series.along(0.0, row, 1) for row in np.eye(6)])
    complex_step = np.array(rates(list(1e-30j * np.eye(6)))).imag / 1e-30
    np.testing.assert_allclose([r.coefficients[1] for r in series], complex_step, rtol=1e-12, atol=1e-16)


def test_truncation_error_of_entry_rates_has_the_order_of_the_first_term_left_out():
    direction = np.random.default_rng(8).standard_normal((6, 40))
    direction /= np.linalg.norm(direction, axis=0)
    series = rates([Series.along(0.0, d, 5) for d in direction])
    radii = np.array([0.1, 0.05])
    for component in (0, 3, 4, 5):
        cubic = Series(series[component].coefficients[:4])
        errors = np.array([rates(radius * direction)[component] - cubic.at(radius) for radius in radii])
        slope = np.log2(np.abs(errors[0]).max() / np.abs(errors[1]).max())
        assert slope == pytest.approx(4.0, abs=0.1)
        # The term left out is most of the error, and has its sign.
        leading = series[component].coefficients[4] * radii[1] ** 4
        np.testing.assert_allclose(errors[1], leading, rtol=0, atol=0.1 * np.abs(errors[1]).max())
