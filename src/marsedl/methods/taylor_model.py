"""Taylor models on products of unit balls: polynomials with proven remainders, for robust entry funnels, Sec. 3."""

import functools
import itertools
import math
import numbers
from dataclasses import dataclass

import numpy as np

from marsedl.summaries import summary

__all__ = ["Monomials", "TaylorModel", "variables"]

# Relative rounding of any sum or bound below: at most 3500 additions of half a unit in the last place each.
_ROUNDING = 5e-13
_MOST_MONOMIALS = 3500
_UNDERFLOW = 1e-290


@dataclass(frozen=True, eq=False)
class Monomials:
    """Monomials z^a up to a total degree, of arguments in a product of unit balls, sorted by their degrees.

    Args:
        balls: dimensions of the balls.
        exponents: a, (m, v).
        degree: total degree of every monomial, (m,).
        block_starts: first monomial of every block of equal degrees in the balls, (k,).
        block_degree: total degree of every block, (k,).
        multinomial: product over the balls of the multinomial coefficients of a, (m,).
        left, right: monomials of all products up to the total degree, (p,), sorted by the monomial of the product.
        product_starts: first product of every monomial, (m,).
    """

    balls: tuple
    exponents: np.ndarray
    degree: np.ndarray
    block_starts: np.ndarray
    block_degree: np.ndarray
    multinomial: np.ndarray
    left: np.ndarray
    right: np.ndarray
    product_starts: np.ndarray

    __repr__ = summary

    @classmethod
    @functools.lru_cache(maxsize=16)
    def of(cls, balls, order):
        """All monomials of total degree 0 ... order in balls of the given dimensions (a tuple).

        Raises:
            ValueError: if there are more of them than the allowance for rounding covers.
        """
        count = math.comb(sum(balls) + order, order)
        if order < 1 or count > _MOST_MONOMIALS:
            raise ValueError(
                f"order {order} in {sum(balls)} variables needs {count} monomials; between order 1 and "
                f"{_MOST_MONOMIALS} monomials are possible"
            )
        last = np.cumsum(balls)
        ball_slices = [slice(end - size, end) for size, end in zip(balls, last, strict=True)]

        def degrees(exponent):
            return sum(exponent), *(-sum(exponent[ball]) for ball in ball_slices)

        rows = sorted((e for d in range(order + 1) for e in _exponents(sum(balls), d)), key=lambda e: (degrees(e), e))
        blocks = [degrees(e) for e in rows]
        starts = np.array([i for i, block in enumerate(blocks) if i == 0 or block != blocks[i - 1]])
        exponents = np.array(rows)
        degree = exponents.sum(axis=1)
        weights = [math.prod(_multinomial(e[ball]) for ball in ball_slices) for e in rows]

        left, right = np.nonzero(degree[:, None] + degree[None, :] <= order)
        index_of = {tuple(e): i for i, e in enumerate(rows)}
        product = np.array([index_of[e] for e in map(tuple, (exponents[left] + exponents[right]).tolist())])
        sorting = np.argsort(product, kind="stable")
        return cls(
            balls=balls,
            exponents=exponents,
            degree=degree,
            block_starts=starts,
            block_degree=degree[starts],
            multinomial=np.array(weights, dtype=float),
            left=left[sorting],
            right=right[sorting],
            product_starts=np.searchsorted(product[sorting], np.arange(count)),
        )

    @property
    def order(self):
        """Highest total degree."""
        return int(self.degree[-1])

    def degree_bounds(self, coefficients):
        r"""Bounds of the homogeneous parts of a polynomial, by total degree (order + 1,).

        For equal degrees $d_1, d_2, \ldots$ in the balls, the squares of the monomials with their multinomial weights
        add up to $\left\| z_1 \right\|^{2 d_1} \left\| z_2 \right\|^{2 d_2} \cdots \le 1$, so that by Cauchy-Schwarz

            $\left| \sum_a c_a z^a \right| \le \sqrt{\sum_a \frac{c_a^2}{\text{multinomial}(a)}}$
        """
        squares = np.add.reduceat(coefficients * coefficients / self.multinomial, self.block_starts)
        return np.bincount(self.block_degree, np.sqrt(squares), minlength=self.order + 1) * (1.0 + _ROUNDING)

    def derivative(self, coefficients, variable):
        """Coefficients (m,) of the derivative of a polynomial with respect to one variable."""
        source, lowered, factors = self._lowered[variable]
        out = np.zeros(len(coefficients))
        out[lowered] = factors * coefficients[source]
        return out

    @functools.cached_property
    def _lowered(self):
        """For every variable the monomials that hold it, those with one power less, and the exponents."""
        index_of = {tuple(e): i for i, e in enumerate(self.exponents.tolist())}
        table = []
        for variable, powers in enumerate(self.exponents.T):
            source = np.flatnonzero(powers)
            lowered = self.exponents[source]
            lowered[:, variable] -= 1
            table.append((source, [index_of[tuple(e)] for e in lowered.tolist()], powers[source]))
        return table

    def evaluate(self, points):
        """Values of the monomials (k, m) at points (k, v)."""
        return np.prod(np.asarray(points, dtype=float)[:, None, :] ** self.exponents, axis=2)


def _exponents(variables, degree):
    """All exponents of one total degree, as tuples."""
    for factors in itertools.combinations_with_replacement(range(variables), degree):
        exponent = [0] * variables
        for variable in factors:
            exponent[variable] += 1
        yield tuple(exponent)


def _multinomial(exponent):
    return math.factorial(sum(exponent)) // math.prod(math.factorial(e) for e in exponent)


def variables(balls, order):
    """The coordinates of a product of unit balls, as Taylor models.

    Args:
        balls: dimension of every ball.
        order: highest total degree of the polynomials, at least 1.

    Returns:
        List of sum(balls) Taylor models.

    Raises:
        ValueError: if there are more than 3500 monomials.
    """
    monomials = Monomials.of(tuple(balls), order)
    linear = monomials.exponents * (monomials.degree == 1)[:, None]
    return [TaylorModel(column, 0.0, monomials) for column in linear.T.astype(float)]


class TaylorModel(np.lib.mixins.NDArrayOperatorsMixin):
    """Function enclosed by a polynomial and a remainder: f(z) = p(z) + e(z), |e(z)| <= r, norm(z_1), ... <= 1.

    A function that is written with operators, sin, cos, exp, sqrt, reciprocal and integer powers of numpy accepts
    Taylor models (`variables`) in place of numbers and returns an enclosure of itself. What a product leaves out (the
    terms above the order, by the bounds of the homogeneous parts) and what floating point rounds goes into the
    remainder. Elementary functions are expanded at the constant term, with the remainder of Lagrange, or of the
    geometric series for the reciprocal; numpy's values of them at a number are taken as right to 1e-13 relative. A
    comparison, and with it `elementary.select` and `clip`, is decided where it has one answer on the whole domain.

    Args:
        coefficients: of the monomials, (m,).
        remainder: r >= 0.
        monomials: `Monomials`.

    Raises:
        ValueError: if no finite remainder is known, or a comparison has no answer that holds everywhere.
    """

    __slots__ = ("_powers", "coefficients", "degree_bounds", "monomials", "remainder")

    def __init__(self, coefficients, remainder, monomials):
        """Keep the enclosure and bound its homogeneous parts."""
        self.coefficients = coefficients
        self.monomials = monomials
        self.degree_bounds = monomials.degree_bounds(coefficients)
        rounding = _ROUNDING * float(self.degree_bounds.sum())
        self.remainder = (float(remainder) + rounding) * (1.0 + _ROUNDING) + _UNDERFLOW
        self._powers = None
        if not math.isfinite(self.remainder):
            raise ValueError("a Taylor model has no finite remainder: its domain is too large")

    def lifted(self, order):
        """The same function with room for monomials of a higher order."""
        monomials = Monomials.of(self.monomials.balls, order)
        room = len(monomials.degree) - len(self.coefficients)
        return TaylorModel(np.pad(self.coefficients, (0, room)), self.remainder, monomials)

    @property
    def bound(self):
        """Bound of |f|."""
        return float(self.degree_bounds.sum()) + self.remainder

    def __repr__(self):
        """Show the bounds of the homogeneous parts."""
        return f"TaylorModel(degree_bounds={self.degree_bounds}, remainder={self.remainder:.3g})"

    def __array_ufunc__(self, function, method, *operands, **options):
        """Find what numpy was called with (operators too, by the mixin) in the table of the functions of a model."""
        if method != "__call__" or options or function not in _FUNCTIONS:
            return NotImplemented
        if not all(isinstance(operand, TaylorModel | numbers.Real) for operand in operands):
            return NotImplemented
        return _FUNCTIONS[function](*operands)

    def deviation_powers(self):
        """Powers 1, d, ..., d^order of the deviation d = f - f_0 from the constant term, kept for sine and cosine."""
        if self._powers is None:
            one, deviation = np.zeros_like(self.coefficients), self.coefficients.copy()
            one[0], deviation[0] = 1.0, 0.0
            first = TaylorModel(deviation, self.remainder, self.monomials)
            powers = [TaylorModel(one, 0.0, self.monomials), first]
            while len(powers) <= self.monomials.order:
                powers.append(_multiply(powers[-1], first))
            self._powers = powers
        return self._powers


def _add(a, b):
    if not isinstance(a, TaylorModel):
        a, b = b, a
    if isinstance(b, TaylorModel):
        return TaylorModel(a.coefficients + b.coefficients, a.remainder + b.remainder, a.monomials)
    coefficients = a.coefficients.copy()
    coefficients[0] += b
    return TaylorModel(coefficients, a.remainder, a.monomials)


def _negative(a):
    return TaylorModel(-a.coefficients, a.remainder, a.monomials)


def _subtract(a, b):
    return _add(a, _negative(b)) if isinstance(b, TaylorModel) else _add(a, -b)


def _multiply(a, b):
    if not isinstance(a, TaylorModel):
        a, b = b, a
    if not isinstance(b, TaylorModel):
        return TaylorModel(a.coefficients * b, a.remainder * abs(b), a.monomials)
    table = a.monomials
    products = a.coefficients[table.left] * b.coefficients[table.right]
    coefficients = np.add.reduceat(products, table.product_starts)
    # Terms of degree i + j > order are left out: every degree i of a times all degrees above order - i of b.
    above = np.cumsum(b.degree_bounds[::-1])[:-1]
    left_out = float(a.degree_bounds[1:] @ above)
    size_a, size_b = float(a.degree_bounds.sum()), float(b.degree_bounds.sum())
    remainder = left_out + a.remainder * (size_b + b.remainder) + size_a * (b.remainder + _ROUNDING * size_b)
    return TaylorModel(coefficients, remainder, table)


def _square(a):
    return _multiply(a, a)


def _composition(a, coefficients, left_out):
    """Sum of f_k d^k with the Taylor coefficients f_k at the constant term; |f - sum| <= left_out |d|^(order + 1)."""
    powers = a.deviation_powers()
    weights = np.array(coefficients, dtype=float)
    total = weights @ np.array([power.coefficients for power in powers])
    bounds = np.abs(weights) @ np.array([(power.remainder, _ROUNDING * power.bound) for power in powers])
    leftover = left_out * powers[1].bound ** len(coefficients)
    return TaylorModel(total, bounds.sum() + leftover, a.monomials)


def _sine_of_shifted(a, quarter_turns):
    """Sine of a + quarter_turns pi/2: every derivative is the sine one quarter turn on, none exceeds 1."""
    order, center = a.monomials.order, a.coefficients[0]
    cycle = [np.sin(center), np.cos(center), -np.sin(center), -np.cos(center)]
    terms = [cycle[(k + quarter_turns) % 4] / math.factorial(k) for k in range(order + 1)]
    return _composition(a, terms, 1.0 / math.factorial(order + 1))


def _exp(a):
    order = a.monomials.order
    value, largest = np.exp(a.coefficients[0]), np.exp(a.coefficients[0] + a.deviation_powers()[1].bound)
    terms = [value / math.factorial(k) for k in range(order + 1)]
    return _composition(a, terms, largest / math.factorial(order + 1))


def _reciprocal(a):
    """1/(c + d) = sum of (-d)^k / c^(k+1); the rest of the geometric series is (-d/c)^(order + 1)/(c + d)."""
    order, center = a.monomials.order, float(a.coefficients[0])
    least = abs(center) - a.deviation_powers()[1].bound
    if not least > 0.0:
        raise ValueError("a Taylor model that may vanish has no reciprocal: its domain is too large")
    terms = [(-1.0) ** k / center ** (k + 1) for k in range(order + 1)]
    return _composition(a, terms, 1.0 / (least * abs(center) ** (order + 1)))


def _sqrt(a):
    """Binomial series at the constant term; the derivatives of the root are largest where the model is least."""
    order, center = a.monomials.order, float(a.coefficients[0])
    least = center - a.deviation_powers()[1].bound
    if not least > 0.0:
        raise ValueError("a Taylor model that may vanish or be negative has no root: its domain is too large")
    binomials = [1.0]
    for k in range(order + 1):
        binomials.append(binomials[-1] * (0.5 - k) / (k + 1))
    terms = [binomial * center ** (0.5 - k) for k, binomial in enumerate(binomials[:-1])]
    return _composition(a, terms, abs(binomials[-1]) * least ** (-0.5 - order))


def _divide(a, b):
    return _multiply(a, _reciprocal(b)) if isinstance(b, TaylorModel) else _multiply(a, 1.0 / b)


def _power(a, exponent):
    if not isinstance(a, TaylorModel) or isinstance(exponent, TaylorModel) or not float(exponent).is_integer():
        raise ValueError("the exponent of a Taylor model is one whole number")
    factors = [a] * abs(int(exponent))
    power = functools.reduce(_multiply, factors[1:], factors[0]) if factors else 0.0 * a + 1.0
    return power if exponent >= 0 else _reciprocal(power)


def _decided(comparison):
    """A comparison that holds, or fails, everywhere: what branches on it is one function, and enclosed as such."""

    def decide(a, b):
        difference = a - b
        middle = float(difference.coefficients[0])
        if not difference.deviation_powers()[1].bound < abs(middle):
            raise ValueError("a Taylor model lies on both sides of a branch: its domain is too large")
        return bool(comparison(middle, 0.0))

    return decide


_FUNCTIONS = {
    **{one: _decided(one) for one in (np.less, np.less_equal, np.greater, np.greater_equal)},
    np.add: _add,
    np.subtract: _subtract,
    np.multiply: _multiply,
    np.divide: _divide,
    np.power: _power,
    np.square: _square,
    np.reciprocal: _reciprocal,
    np.negative: _negative,
    np.positive: lambda a: a,
    np.exp: _exp,
    np.sqrt: _sqrt,
    np.sin: lambda a: _sine_of_shifted(a, 0),
    np.cos: lambda a: _sine_of_shifted(a, 1),
}
