from fractions import Fraction

import numpy as np
import pytest

from marsedl.elementary import clip, select
from marsedl.methods.taylor import Series
from marsedl.methods.taylor_model import Monomials, TaylorModel, variables

BALLS = (3, 2)


def points_in_balls(count, seed, balls=BALLS, inside=True):
    """Points of the product of the balls; half of them on the spheres."""
    random = np.random.Generator(np.random.Philox(seed))
    columns = []
    for size in balls:
        block = random.standard_normal((count, size))
        block /= np.linalg.norm(block, axis=1, keepdims=True)
        if inside:
            block[::2] *= random.uniform(0, 1, (len(block[::2]), 1))
        columns.append(block)
    return np.hstack(columns)


def composed(z, radius):
    """A function with everything that a model knows, of arguments scaled by a radius."""
    a, b, c, d, e = (radius * x for x in z)
    return (
        np.exp(np.sin(1.3 + a) - b * c) / (2.0 + np.cos(d - a))
        + np.reciprocal(1.5 - c) * e**3
        - (3.0 - b) ** -2 * np.square(e - 0.2)
        + 0.5 / (1.0 + d * d)
    )


@pytest.mark.parametrize("order", [2, 5])
def test_enclosure_holds_and_is_not_far_from_the_truth(order):
    model = composed(variables(BALLS, order), 0.3)
    points = points_in_balls(5000, 1)
    errors = np.abs(composed(points.T, 0.3) - model.monomials.evaluate(points) @ model.coefficients)
    assert errors.max() <= model.remainder
    assert model.remainder < 25 * errors.max()
    assert np.abs(composed(points.T, 0.3)).max() <= model.bound < 2 * np.abs(composed(points.T, 0.3)).max()


@pytest.mark.parametrize("order", [2, 4])
def test_remainder_shrinks_with_one_order_more_than_the_polynomial(order):
    remainders = [composed(variables(BALLS, order), radius).remainder for radius in (0.02, 0.01)]
    assert np.log2(remainders[0] / remainders[1]) == pytest.approx(order + 1, abs=0.15)


def test_coefficients_are_those_of_the_series_along_a_ray():
    model = composed(variables(BALLS, 4), 0.4)
    points = points_in_balls(50, 2, inside=False)
    series = composed([Series.along(0.0, column, 4) for column in points.T], 0.4)
    monomials = model.monomials
    terms = monomials.evaluate(points) * model.coefficients
    for degree in range(5):
        homogeneous = terms[:, monomials.degree == degree].sum(axis=1)
        np.testing.assert_allclose(homogeneous, series.coefficients[degree], rtol=1e-10, atol=1e-13)


def test_polynomial_within_the_order_leaves_rounding_only():
    x, y, z, u, v = variables(BALLS, 3)
    model = 2 * x * y * u - (z - 0.25) ** 3 + v / 4 + (-x) * (+y) - np.float64(0.5)
    assert model.remainder < 100 * 5e-13  # twenty operations on numbers of size 1 to 5, with their allowance each
    at = np.array([[0.3, -0.4, 0.5, 0.6, -0.2]])
    expected = 2 * 0.3 * -0.4 * 0.6 - 0.25**3 - 0.05 + 0.12 - 0.5
    assert model.monomials.evaluate(at) @ model.coefficients == pytest.approx(expected, rel=1e-14)
    assert (x**0).bound == pytest.approx(1.0, rel=1e-11)


def test_bounds_of_homogeneous_parts():
    direction, other = np.array([0.5, -1.2, 0.3]), np.array([0.7, 0.4])
    z = variables(BALLS, 5)
    along = sum(d * x for d, x in zip(direction, z[:3], strict=True))
    across = sum(d * x for d, x in zip(other, z[3:], strict=True))
    # Powers of linear functions of each ball attain the bound, at the end of the direction.
    for i, j in [(1, 0), (0, 1), (2, 0), (2, 3), (5, 0), (1, 4)]:
        value = np.linalg.norm(direction) ** i * np.linalg.norm(other) ** j
        assert (along**i * across**j).degree_bounds[i + j] == pytest.approx(value, rel=1e-9)
    random = np.random.Generator(np.random.Philox(3))
    monomials = Monomials.of(BALLS, 4)
    coefficients = random.standard_normal(len(monomials.degree))
    terms = monomials.evaluate(points_in_balls(20_000, 4)) * coefficients
    for degree, bound in enumerate(monomials.degree_bounds(coefficients)):
        assert np.abs(terms[:, monomials.degree == degree].sum(axis=1)).max() <= bound


def exact(coefficients, monomials, point):
    """Value of a polynomial in rational arithmetic."""
    total = Fraction(0)
    for coefficient, exponent in zip(coefficients, monomials.exponents.tolist(), strict=True):
        term = Fraction(float(coefficient))
        for x, power in zip(point, exponent, strict=True):
            term *= Fraction(x) ** power
        total += term
    return total


def test_rounding_is_in_the_remainder():
    random = np.random.Generator(np.random.Philox(5))
    linear, full = Monomials.of((2,), 2), Monomials.of((2,), 4)
    point = (Fraction(3, 5), Fraction(-4, 5))
    for _ in range(5):
        scales = 10.0 ** random.uniform(-8, 8, (2, len(linear.degree)))
        a, b = (TaylorModel(row, 0.0, linear) for row in scales * random.standard_normal((2, len(linear.degree))))
        product = a.lifted(4) * b.lifted(4)
        truth = exact(a.coefficients, linear, point) * exact(b.coefficients, linear, point)
        assert abs(truth - exact(product.coefficients, full, point)) <= Fraction(product.remainder)
        assert product.remainder < 1e-11 * a.bound * b.bound
    (x,) = variables((1,), 1)
    lost = (1e16 + x / 3) - 1e16
    assert abs(lost.coefficients[0]) + abs(lost.coefficients[1] - 1 / 3) <= lost.remainder


@pytest.mark.parametrize("order", [1, 3])
def test_a_root_is_enclosed_with_one_order_more(order):
    def root(x, radius):
        return np.sqrt(2.0 + radius * x[0] - radius**2 * x[4] * x[1])

    points = points_in_balls(5000, 8)
    models = [root(variables(BALLS, order), radius) for radius in (0.4, 0.2)]
    errors = [
        np.abs(root(points.T, radius) - model.monomials.evaluate(points) @ model.coefficients).max()
        for radius, model in zip((0.4, 0.2), models, strict=True)
    ]
    assert all(error <= model.remainder < 30 * error for error, model in zip(errors, models, strict=True))
    assert np.log2(models[0].remainder / models[1].remainder) > order + 0.9
    with pytest.raises(ValueError, match="has no root: its domain is too large"):
        root(variables(BALLS, order), 2.0)


def test_a_comparison_is_decided_where_one_answer_holds_everywhere():
    x = variables(BALLS, 2)[0]
    assert (x > -1.001) and (x < 1.001) and not (x >= 1.001) and (x < 2.0) and not (x <= -1.5)
    assert clip(x, -3.0, 3.0) is x and clip(x, 4.0, 5.0) == 4.0
    for undecided in (0.0, 0.999, -1.0):
        with pytest.raises(ValueError, match="lies on both sides of a branch: its domain is too large"):
            select(x > undecided, x, 0.0)


def test_elementary_functions_are_right_at_the_constant_term():
    arguments = np.random.Generator(np.random.Philox(6)).uniform(-20, 20, 20_000)
    for function in (np.sin, np.cos, np.exp):
        precise = function(arguments.astype(np.longdouble))
        assert np.abs(function(arguments) / precise - 1).max() < 1e-13


def test_derivative_of_a_polynomial():
    monomials = Monomials.of(BALLS, 3)
    coefficients = np.random.Generator(np.random.Philox(7)).standard_normal(len(monomials.degree))
    point = np.array([0.2, -0.5, 0.3, 0.1, 0.7])
    for variable in range(5):
        step = np.zeros(5)
        step[variable] = 1e-4
        ahead, behind = monomials.evaluate([point + step, point - step]) @ coefficients
        derivative = monomials.evaluate([point]) @ monomials.derivative(coefficients, variable)
        # The difference quotient of a cubic errs by its cubic coefficient times 1e-8.
        assert derivative == pytest.approx((ahead - behind) / 2e-4, abs=1e-7)
