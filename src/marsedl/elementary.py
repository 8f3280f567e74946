"""Elementary functions that know who evaluates them, so that one model serves flights, optimisation and enclosures.

| given | evaluated |
|---|---|
| numbers, in Python or in a compiled flight | the polynomials below, with the same bits on every processor |
| symbols of CasADi, arrays of numpy, Taylor series, Taylor models | by their own `np.sin` and so on |

The polynomials have no branches and calls, so that loops over them become vector code. The compiler cannot vectorise a
loop that calls the mathematics library, and that library rounds differently on processors with and without fused
products. Polynomials and splittings of constants are those of the FreeBSD msun library. A value depends on its argument
alone, not on the loop, lane or processor. Larger errors than in the last digits are told with each function.

Numba is not imported here: it learns of these functions when it compiles something, see `compiling`.
"""

from functools import wraps

import numpy as np

from marsedl.compiling import inlined

__all__ = ["arc_cosine", "arctangent", "clip", "exponential", "logarithm", "select", "sine_cosine"]

_NUMBERS = (float, int, np.floating, np.integer, np.bool_)

# Adding 1.5 * 2^52 rounds a double to an integer, which then stands in the sum's lowest bits, in two's complement.
# Rounding functions and conversions to integers would need instructions that not every processor has as vectors.
_ROUNDER = 1.5 * 2.0**52

# The first two parts have 33 bits: their products with up to 2^20 quarter turns are exact.
_HALF_PI_1 = 1.57079632673412561417e00
_HALF_PI_2 = 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21

_PI_HIGH = 3.14159265358979311600e00
_PI_LOW = 1.22464679914735317636e-16

# The first part has 32 bits.
_LOG_2_HIGH = 6.93147180369123816490e-01
_LOG_2_LOW = 1.90821492927058770002e-10


def _everywhere(of_others):
    """Decorate the function of numbers, which is compiled; of_others: the same of symbols, arrays and series."""

    def decorate(of_numbers):
        @wraps(of_numbers)
        def function(*values):
            if all(isinstance(value, _NUMBERS) for value in values):
                return of_numbers(*values)
            return of_others(*values)

        return inlined(function, lambda: of_numbers)

    return decorate


# ---- choices ---------------------------------------------------------------------------------------------------------


def _select_of_others(condition, yes, no):
    if isinstance(condition, _NUMBERS):
        return yes if condition else no
    if type(condition).__module__.startswith("casadi"):
        import casadi

        return casadi.if_else(condition, yes, no)
    kinds = [type(value) for value in (yes, no) if hasattr(value, "chosen")]  # series choose themselves
    return kinds[0].chosen(condition, yes, no) if kinds else np.where(condition, yes, no)


@_everywhere(_select_of_others)
def select(condition, yes, no):
    """`yes if condition else no`, which a symbol cannot decide, nor an array as a whole.

    Both sides are computed, also the one that is not taken: there Python divides by zero, and numpy warns. So guard
    what goes into a division or a root, not what comes out: `1.0 / select(mass > 0.0, mass, 1.0)`. Compiled flights
    and CasADi have the value of the side that is taken, and CasADi its derivatives.
    """
    return yes if condition else no


@inlined
def clip(x, low, high):
    """Bring x into low ... high; NaN stays NaN."""
    raised = select(x < low, low, x)
    return select(raised > high, high, raised)


# ---- functions -------------------------------------------------------------------------------------------------------


@_everywhere(np.log)
def logarithm(x):
    """Natural logarithm of a normal positive double, error below 1 ulp.

    x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)). Zero, subnormal, infinite and NaN arguments are not treated.
    """
    bits = np.float64(x).view(np.int64)
    exponent = (bits - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    f = float(np.int64(bits - (exponent << np.int64(52))).view(np.float64)) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half_square = 0.5 * f * f
    k = float(exponent)
    low = s * (half_square + even + odd) + k * _LOG_2_LOW
    return k * _LOG_2_HIGH - ((half_square - low) - f)


@_everywhere(np.exp)
def exponential(x):
    """e^x for |x| <= 708, error below 1 ulp; NaN gives NaN.

    e^x = 2^k e^r, k = the integer nearest to x / log 2. Larger |x| are not treated: they need 2^k beyond the normal
    doubles. An infinite x gives NaN.
    """
    x = float(x)  # of numpy's numbers, whose infinities warn
    shifted = x * 1.44269504088896338700e00 + _ROUNDER
    k = shifted - _ROUNDER
    high = x - k * _LOG_2_HIGH
    low = k * _LOG_2_LOW
    r = high - low
    z = r * r
    tail = 6.61375632143793436117e-05 + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08)
    c = r - z * (1.66666666666666019037e-01 + z * (-2.77777777770155933842e-03 + z * tail))
    power_of_2 = np.int64((np.float64(shifted).view(np.int64) + np.int64(1023)) << np.int64(52)).view(np.float64)
    return (1.0 - ((low - (r * c) / (2.0 - c)) - high)) * float(power_of_2)


@inlined
def _of_quarter_turns(quarter, x):
    """(sine, cosine) of quarter pi / 2 + x, quarter: int64, of which the last two bits count; x in [-pi/4, pi/4]."""
    z = x * x
    sine_tail = -1.98412698298579493134e-04 + z * (
        2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    )
    sine = x + x * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * sine_tail))
    cosine_tail = 2.48015872894767294178e-05 + z * (
        -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    tail = z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * cosine_tail))
    leading = 1.0 - 0.5 * z
    cosine = leading + (((1.0 - leading) - 0.5 * z) + tail)
    swap = (quarter & 1) != 0
    first = cosine if swap else sine
    second = sine if swap else cosine
    first = -first if (quarter & 2) != 0 else first
    second = -second if ((quarter + 1) & 2) != 0 else second
    return first, second


@_everywhere(lambda angle: (np.sin(angle), np.cos(angle)))
def sine_cosine(angle):
    """(sine, cosine) of an angle in radians, each with an error of at most 1.5 ulp for |angle| up to 1e6.

    The nearest quarter turn is subtracted in three parts (Cody, Waite 1980). Beyond 1e6 the subtraction is not exact:
    the error grows to the spacing of the doubles at the angle, and beyond 1e15 the result means nothing. An infinite
    angle or NaN gives NaN.
    """
    angle = float(angle)
    shifted = angle * 6.36619772367581382433e-01 + _ROUNDER
    n = shifted - _ROUNDER
    reduced = angle - n * _HALF_PI_1
    x = reduced - n * _HALF_PI_2
    # With what the second subtraction rounded away, so that the argument is rounded once.
    x = x + (((reduced - x) - n * _HALF_PI_2) - n * _HALF_PI_3)
    return _of_quarter_turns(np.float64(shifted).view(np.int64), x)


@inlined
def sine_cosine_of_turn(bits):
    """(sine, cosine) of the angle 2 pi bits / 2^64, bits: uint64.

    The nearest quarter turn is removed exactly in integers. The angle keeps its 53 leading bits.
    """
    quarter = np.int64(((bits >> np.uint64(61)) + np.uint64(1)) >> np.uint64(1))
    remainder = np.uint64(bits << np.uint64(2)).view(np.int64) >> np.int64(13)
    return _of_quarter_turns(quarter, float(remainder) * (2.0**-53 * 6.283185307179586))


@_everywhere(np.arctan2)
def arctangent(y, x):
    """Angle of the point (x, y) in radians, from -pi to pi, error below 1.5 ulp; NaN gives NaN.

    tan(angle - angle of (b, a)) = (a y' - b x') / (a x' + b y') with x' = |x|, y' = |y| and one of four points (b, a)
    near by, so that one division serves all. The signs of zeros do not count: the angle of (0, 0) is 0, that of a
    negative x alone pi. Infinite components give NaN; products with 2.5 must not overflow, quotients not underflow.
    """
    x, y = float(x), float(y)
    ahead, up = abs(x), abs(y)
    first, second, third = 16.0 * up < 7.0 * ahead, 16.0 * up < 11.0 * ahead, 16.0 * up < 19.0 * ahead
    fourth = 16.0 * up < 39.0 * ahead
    numerator = up - 1.5 * ahead if fourth else -ahead
    denominator = ahead + 1.5 * up if fourth else up
    high = 9.82793723247329054082e-01 if fourth else 1.57079632679489655800e00
    low = 1.39033110312309984516e-17 if fourth else 6.12323399573676603587e-17
    numerator = up - ahead if third else numerator
    denominator = up + ahead if third else denominator
    high = 7.85398163397448278999e-01 if third else high
    low = 3.06161699786838301793e-17 if third else low
    numerator = 2.0 * up - ahead if second else numerator
    denominator = 2.0 * ahead + up if second else denominator
    high = 4.63647609000806093515e-01 if second else high
    low = 2.26987774529616870924e-17 if second else low
    numerator = up if first else numerator
    denominator = ahead if first else denominator
    high = 0.0 if first else high
    low = 0.0 if first else low
    origin = ahead + up == 0.0
    t = (0.0 if origin else numerator) / (1.0 if origin else denominator)
    z = t * t
    w = z * z
    odd = 6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)
    odd = 1.42857142725034663711e-01 + w * (9.09088713343650656196e-02 + w * odd)
    odd = z * (3.33333333333329318027e-01 + w * odd)
    even = -7.69187620504482999495e-02 + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02)
    even = w * (-1.99999999998764832476e-01 + w * (-1.11111104054623557880e-01 + w * even))
    angle = high - ((t * (odd + even) - low) - t)
    angle = 0.0 if origin else angle
    angle = _PI_HIGH - (angle - _PI_LOW) if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@_everywhere(np.arccos)
def arc_cosine(x):
    """Angle in [0, pi] whose cosine is x, for |x| <= 1, error below 2.5 ulp; NaN gives NaN."""
    x = float(x)
    return arctangent(np.sqrt((1.0 - x) * (1.0 + x)), x)
