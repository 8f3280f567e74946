"""Truncated power series in one variable: Taylor polynomials along rays, for robust entry funnels, Sec. 3."""

import functools
import numbers

import numpy as np

from marsedl.compiling import compiled_when_called, jitable
from marsedl.methods.checks import require_at_least

__all__ = ["Series"]


class Series(np.lib.mixins.NDArrayOperatorsMixin):
    """Truncated power series a(s) = a_0 + a_1 s + ... + a_n s^n, with the arithmetic of the numbers that it stands for.

    A function written with operators and the universal functions sin, cos, tan, arccos, arctan2, exp, log, sqrt,
    square, reciprocal and power (integer or real constant exponent) of numpy accepts a Series in place of a number and
    returns the series of the composition. Along the ray x_0 + s d, the coefficient i is then the homogeneous part of
    degree i of the multivariate Taylor polynomial at x_0, evaluated at d.

    What decides (comparisons, int, absolute, maximum, minimum, `elementary.select`) decides by the value at s = 0, so
    that the series is that of the branch which is taken there: tables are looked up, and limits hold.

    A series is not changed after its construction. Arrays and numbers of either side of an operator are constants
    that broadcast over the trailing axes.

    Args:
        coefficients: a_i, (n + 1, ...): real, complex, or objects with arithmetic of their own (fractions).
    """

    __slots__ = ("_sine_and_cosine", "coefficients")

    def __init__(self, coefficients):
        """Keep the coefficients."""
        self.coefficients = np.asarray(coefficients)
        if self.coefficients.ndim == 0:
            raise ValueError("the coefficients of a series need a leading axis of length order + 1")
        self._sine_and_cosine = None

    @classmethod
    def along(cls, base, direction, order):
        """The ray base + s direction.

        Args:
            base, direction: numbers or arrays that broadcast against each other, (...).
            order: highest power that is kept, at least 1.

        Returns:
            Series with coefficients (order + 1, ...).
        """
        require_at_least("order", order, 1)
        base, direction = np.broadcast_arrays(base, direction)
        coefficients = np.zeros((order + 1, *base.shape), dtype=np.result_type(base, direction, 0.0))
        coefficients[0] = base
        coefficients[1] = direction
        return cls(coefficients)

    @property
    def order(self):
        """Highest power that is kept, n."""
        return len(self.coefficients) - 1

    def at(self, point):
        """Value of the polynomial, sum of a_i s^i.

        Args:
            point: s, a number or an array that broadcasts over the trailing axes.

        Returns:
            Array (...).
        """
        value = self.coefficients[-1]
        for coefficient in self.coefficients[-2::-1]:
            value = value * point + coefficient
        return value

    @staticmethod
    def chosen(condition, yes, no):
        """What `elementary.select` returns: yes where the condition holds, no elsewhere; one or both are series."""
        like = yes if isinstance(yes, Series) else no
        return Series(np.where(condition, *_aligned(_as_series(yes, like), _as_series(no, like))))

    def __int__(self):
        """Return the whole part of the value at s = 0."""
        return int(self.coefficients[0])

    def __repr__(self):
        """Show the coefficients."""
        return f"Series({self.coefficients!r})"

    def __array_ufunc__(self, function, method, *operands, **options):
        """Find what numpy was called with (operators too, by the mixin) in the table of the functions of a series."""
        if method != "__call__" or options or function not in _FUNCTIONS:
            return NotImplemented
        return _FUNCTIONS[function](*operands)


def _aligned(first, second):
    """Coefficients of two series with trailing axes padded to one number, so that they broadcast."""
    a, b = first.coefficients, second.coefficients
    if len(a) != len(b):
        raise ValueError(f"series of orders {len(a) - 1} and {len(b) - 1} do not combine")
    return _padded(a, b.ndim), _padded(b, a.ndim)


def _padded(coefficients, dimensions):
    missing = dimensions - coefficients.ndim
    if missing <= 0:
        return coefficients
    return coefficients.reshape(len(coefficients), *[1] * missing, *coefficients.shape[1:])


def _recurrence(function):
    """Make a function of arrays of coefficients run compiled where all are floats of one shape, (n + 1, points).

    These are what a closed loop is expanded with at many points at once: numpy takes longer to be called than to add.
    """

    compiled = compiled_when_called(function)

    @functools.wraps(function)
    def run(*arrays):
        shape = arrays[0].shape
        plain = len(shape) == 2 and all(
            a.dtype == np.float64 and a.shape == shape and a.flags.c_contiguous for a in arrays
        )
        (compiled if plain else function)(*arrays)

    return run


@jitable
def _convolution(a, b, k, start):
    """Sum over j = start ... k of a_j b_{k-j}, of arrays of coefficients."""
    total = a[start] * b[k - start]
    for j in range(start + 1, k + 1):
        total = total + a[j] * b[k - j]
    return total


def _empty_like(first, *further):
    if all(a.shape == first.shape and a.dtype == np.float64 for a in (first, *further)):
        return np.empty(first.shape)  # what the general rule takes ten times as long to say
    arrays = (first, *further)
    return np.empty(np.broadcast_shapes(*(a.shape for a in arrays)), dtype=np.result_type(*arrays, 0.0))


def _times_index(a):
    """Coefficients j a_j of s da/ds."""
    return np.arange(len(a)).reshape(-1, *[1] * (a.ndim - 1)) * a


def _add(a, b):
    if not isinstance(a, Series):
        a, b = b, a
    if isinstance(b, Series):
        x, y = _aligned(a, b)
        return Series(x + y)
    return _shifted(a.coefficients, b)


def _shifted(coefficients, constant):
    """Series plus a constant."""
    constant = np.asarray(constant)
    padded = _padded(coefficients, constant.ndim + 1)
    first = np.asarray(padded[0] + constant)
    out = np.empty((len(padded), *first.shape), dtype=first.dtype)
    out[0] = first
    out[1:] = padded[1:]
    return Series(out)


def _subtract(a, b):
    if isinstance(a, Series) and isinstance(b, Series):
        x, y = _aligned(a, b)
        return Series(x - y)
    return _shifted(a.coefficients, -np.asarray(b)) if isinstance(a, Series) else _shifted(-b.coefficients, a)


def _multiply(a, b):
    if not isinstance(a, Series):
        a, b = b, a
    if not isinstance(b, Series):
        b = np.asarray(b)
        return Series(_padded(a.coefficients, b.ndim + 1) * b)
    x, y = _aligned(a, b)
    product = _empty_like(x, y)
    _fill_product(x, y, product)
    return Series(product)


@_recurrence
def _fill_product(x, y, product):
    for k in range(len(x)):
        product[k] = _convolution(x, y, k, 0)


def _square(a):
    return _multiply(a, a)


def _reciprocal(a):
    return _divide(1.0, a)


def _divide(a, b):
    """From q b = a: q_k = (a_k - sum over j = 1 ... k of b_j q_{k-j}) / b_0."""
    if not isinstance(b, Series):
        b = np.asarray(b)
        return Series(_padded(a.coefficients, b.ndim + 1) / b)
    if isinstance(a, Series):
        x, y = _aligned(a, b)
    else:
        constant = np.asarray(a)
        y = _padded(b.coefficients, constant.ndim + 1)
        x = np.zeros((len(y), *[1] * (y.ndim - 1 - constant.ndim), *constant.shape), dtype=constant.dtype)
        x[0] = constant
    quotient = _empty_like(x, y)
    _fill_quotient(x, y, quotient)
    return Series(quotient)


@_recurrence
def _fill_quotient(x, y, quotient):
    inverse = 1.0 / y[0]
    quotient[0] = x[0] * inverse
    for k in range(1, len(y)):
        quotient[k] = (x[k] - _convolution(y, quotient, k, 1)) * inverse


def _exp(a):
    """From e' = a' e: k e_k = sum over j = 1 ... k of j a_j e_{k-j}."""
    a = a.coefficients
    out = _empty_like(a)
    out[0] = np.exp(a[0])
    _fill_exp(_times_index(a), out)
    return Series(out)


@_recurrence
def _fill_exp(slopes, out):
    for k in range(1, len(out)):
        out[k] = _convolution(slopes, out, k, 1) / k


def _log(a):
    """From a l' = a': k a_0 l_k = k a_k - sum over j = 1 ... k - 1 of a_j (k - j) l_{k-j}."""
    a = a.coefficients
    slopes, out = _times_index(a), _empty_like(a)
    out[0] = np.log(a[0])
    inverse = 1.0 / a[0]
    for k in range(1, len(a)):
        total = slopes[k]
        for j in range(1, k):
            total = total - (k - j) * a[j] * out[k - j]
        out[k] = total * inverse / k
    return Series(out)


def _sine_and_cosine(a):
    """From s' = a' c and c' = -a' s, both at once and kept, for they come in pairs."""
    if a._sine_and_cosine is None:
        coefficients = a.coefficients
        slopes, sine, cosine = _times_index(coefficients), _empty_like(coefficients), _empty_like(coefficients)
        sine[0], cosine[0] = np.sin(coefficients[0]), np.cos(coefficients[0])
        _fill_sine_and_cosine(slopes, sine, cosine)
        a._sine_and_cosine = Series(sine), Series(cosine)
    return a._sine_and_cosine


@_recurrence
def _fill_sine_and_cosine(slopes, sine, cosine):
    for k in range(1, len(slopes)):
        sine[k] = _convolution(slopes, cosine, k, 1) / k
        cosine[k] = -_convolution(slopes, sine, k, 1) / k


def _sin(a):
    return _sine_and_cosine(a)[0]


def _cos(a):
    return _sine_and_cosine(a)[1]


def _tan(a):
    return _divide(*_sine_and_cosine(a))


def _sqrt(a):
    """From r r = a: 2 r_0 r_k = a_k - sum over j = 1 ... k - 1 of r_j r_{k-j}."""
    a = a.coefficients
    out = _empty_like(a)
    out[0] = np.sqrt(a[0])
    inverse = 0.5 / out[0]
    for k in range(1, len(a)):
        total = a[k]
        for j in range(1, k):
            total = total - out[j] * out[k - j]
        out[k] = total * inverse
    return Series(out)


def _power(a, exponent):
    """Integer powers by repeated products (the base may vanish), real ones from a p' = c a' p."""
    if not isinstance(a, Series) or not isinstance(exponent, numbers.Real):
        raise ValueError("the exponent of a series is one real number")
    if float(exponent).is_integer():
        power = _integer_power(a, abs(int(exponent)))
        return power if exponent >= 0 else _reciprocal(power)
    a = a.coefficients
    out = _empty_like(a)
    out[0] = a[0] ** exponent
    inverse = 1.0 / a[0]
    for k in range(1, len(a)):
        total = exponent * k * a[k] * out[0]
        for j in range(1, k):
            total = total + (exponent * j - (k - j)) * a[j] * out[k - j]
        out[k] = total * inverse / k
    return Series(out)


def _integer_power(a, exponent):
    if exponent == 0:
        return 0.0 * a + 1.0
    if exponent == 1:
        return a
    half = _integer_power(a, exponent // 2)
    square = _multiply(half, half)
    return square if exponent % 2 == 0 else _multiply(square, a)


def _as_series(value, like):
    """A number or array as the series that is constant, of the order of another one."""
    if isinstance(value, Series):
        return value
    value = np.asarray(value)
    coefficients = np.zeros((like.order + 1, *value.shape), np.result_type(value, 0.0))
    coefficients[0] = value
    return Series(coefficients)


def _arctan2(y, x):
    """From t' = (x y' - y x') / (x x + y y)."""
    like = y if isinstance(y, Series) else x
    y, x = _as_series(y, like), _as_series(x, like)
    along_y, along_x = (Series(_times_index(part.coefficients)) for part in (y, x))
    out = ((x * along_y - y * along_x) / (x * x + y * y)).coefficients
    out[0] = np.arctan2(y.coefficients[0], x.coefficients[0])
    for k in range(2, len(out)):
        out[k] /= k
    return Series(out)


def _by_value(function):
    """A function that decides by the values at s = 0."""
    return lambda *operands: function(*(a.coefficients[0] if isinstance(a, Series) else a for a in operands))


_FUNCTIONS = {
    **{f: _by_value(f) for f in (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)},
    np.maximum: lambda a, b: Series.chosen(a > b, a, b),
    np.minimum: lambda a, b: Series.chosen(a < b, a, b),
    np.absolute: lambda a: Series.chosen(a < 0.0, -a, a),
    np.arctan2: _arctan2,
    np.arccos: lambda a: _arctan2(_sqrt((1.0 - a) * (1.0 + a)), a),
    np.add: _add,
    np.subtract: _subtract,
    np.multiply: _multiply,
    np.divide: _divide,
    np.power: _power,
    np.square: _square,
    np.reciprocal: _reciprocal,
    np.negative: lambda a: Series(-a.coefficients),
    np.positive: lambda a: a,
    np.exp: _exp,
    np.log: _log,
    np.sin: _sin,
    np.cos: _cos,
    np.tan: _tan,
    np.sqrt: _sqrt,
}
