"""Elementary functions against the same in decimal arithmetic of fifty digits, and that loops over them are vectors."""

import re
import subprocess
import sys
from decimal import Decimal, localcontext

import casadi
import numpy as np
import pytest
from numba import njit

from marsedl.elementary import (
    arc_cosine,
    arctangent,
    clip,
    exponential,
    logarithm,
    select,
    sine_cosine,
    sine_cosine_of_turn,
)
from marsedl.methods.linearization import symbols_in_numpy
from marsedl.methods.taylor import Series
from marsedl.montecarlo.lanes import LANES

DIGITS = 50
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899863")


@njit(error_model="numpy")
def logarithms(x, out):
    for group in range(x.shape[0]):
        for lane in range(LANES):
            out[group, lane] = logarithm(x[group, lane])


@njit(error_model="numpy")
def exponentials(x, out):
    for group in range(x.shape[0]):
        for lane in range(LANES):
            out[group, lane] = exponential(x[group, lane])


@njit(error_model="numpy")
def sines_and_cosines(angles, sines, cosines):
    for group in range(angles.shape[0]):
        for lane in range(LANES):
            sines[group, lane], cosines[group, lane] = sine_cosine(angles[group, lane])


@njit(error_model="numpy")
def sines_and_cosines_of_turns(bits, sines, cosines):
    for group in range(bits.shape[0]):
        for lane in range(LANES):
            sines[group, lane], cosines[group, lane] = sine_cosine_of_turn(bits[group, lane])


@njit(error_model="numpy")
def arctangents(y, out):
    """Of every point with the one behind it as x."""
    for group in range(y.shape[0]):
        for lane in range(LANES):
            out[group, lane] = arctangent(y[group, lane], y[group, LANES - 1 - lane])


@njit(error_model="numpy")
def arc_cosines(x, out):
    for group in range(x.shape[0]):
        for lane in range(LANES):
            out[group, lane] = arc_cosine(x[group, lane])


def evaluated(kernel, x, results=1):
    """Values of a kernel, (results, x.size)."""
    padded = np.resize(x, (-(-x.size // LANES), LANES))
    out = np.empty((results, *padded.shape))
    kernel(padded, *out)
    return out.reshape(results, -1)[:, : x.size]


def exact_sine_cosine(angle):
    """(sine, cosine) of a Decimal as Decimals, by Taylor series after exact removal of quarter turns."""
    quarter = int((angle * 2 / PI).to_integral_value())
    x = angle - quarter * PI / 2
    values, term, square = [Decimal(0), Decimal(0)], Decimal(1), x * x
    for start, first in ((0, x), (1, Decimal(1))):
        term, order = first, 2 - start
        while abs(term) > Decimal(10) ** -DIGITS * abs(first):
            values[start] += term
            term *= -square / (order * (order + 1))
            order += 2
    sine, cosine = values
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[quarter % 4]


def exact_arctangent(y, x):
    """Angle of (x, y) as a Decimal: a double near it, corrected by the sine of what is left."""
    angle = Decimal(float(np.arctan2(float(y), float(x))))
    for _ in range(3):
        sine, cosine = exact_sine_cosine(angle)
        angle += (y * cosine - x * sine) / (x * cosine + y * sine)
    return angle


def errors_in_ulp(values, exact):
    """Distances of doubles from exact Decimals, in units of the spacing of the doubles there."""
    spacings = np.spacing(np.abs([float(e) for e in exact]))
    return np.array([float((Decimal(v) - e) / Decimal(s)) for v, e, s in zip(values, exact, spacings, strict=True)])


def arguments(scale, seed=1):
    """A dense grid and random numbers within [-scale, scale], and small ones."""
    rng = np.random.default_rng(seed)
    small = scale * 10.0 ** rng.uniform(-20, 0, 300) * rng.choice([-1, 1], 300)
    return np.concatenate([np.linspace(-scale, scale, 1501), rng.uniform(-scale, scale, 1500), small])


@pytest.mark.parametrize("scale", [1.0, 10.0, 1e4, 1e6])
def test_sine_and_cosine_are_accurate(scale):
    angles = arguments(scale)
    # Multiples of pi / 4 and their neighbours, where the remainder cancels or the quarter changes.
    turns = np.unique(np.rint(np.linspace(-scale, scale, 400) * 4 / np.pi)) * (np.pi / 4)
    angles = np.concatenate([angles, turns, np.nextafter(turns, np.inf), np.nextafter(turns, -np.inf)])
    with localcontext(prec=DIGITS + 30):
        exact = np.array([exact_sine_cosine(Decimal(angle)) for angle in angles]).T
        for actual, expected in zip(evaluated(sines_and_cosines, angles, 2), exact, strict=True):
            error = np.abs(errors_in_ulp(actual, expected)).max()
            assert 0.5 < error <= 1.5


@pytest.mark.parametrize("scale", [1.0, 20.0, 708.0])
def test_exponential_is_accurate(scale):
    x = arguments(scale)
    changes = (np.rint(np.linspace(-scale, scale, 200) / np.log(2.0)) + 0.5) * np.log(2.0)  # where 2^k changes
    x = np.concatenate([x, np.clip(changes, -708.0, 708.0), [0.0, -708.0, 708.0]])
    with localcontext(prec=DIGITS):
        error = np.abs(errors_in_ulp(evaluated(exponentials, x)[0], [Decimal(v).exp() for v in x])).max()
    assert 0.5 < error < 1.0


def test_logarithm_is_accurate():
    rng = np.random.default_rng(2)
    x = np.concatenate([2.0 ** -rng.uniform(0, 53, 3000), 1.0 - rng.integers(0, 2**20, 500) * 2.0**-53, [2.0**-53]])
    x = np.concatenate([x, 10.0 ** rng.uniform(-307, 308, 500)])
    with localcontext(prec=DIGITS):
        exact = [Decimal(v).ln() for v in x]
        actual = evaluated(logarithms, x)[0]
        assert (actual[x == 1.0] == 0.0).all()
        error = np.abs(errors_in_ulp(actual[x != 1.0], [e for e in exact if e != 0])).max()
    assert 0.5 < error < 1.0


def test_sine_and_cosine_of_a_turn_are_accurate():
    rng = np.random.default_rng(3)
    bits = rng.integers(0, 2**64, 3000, dtype=np.uint64)
    bits &= np.uint64(2**64 - 2**11)  # the leading 53 bits, which the function keeps
    bits[:9] = np.concatenate([np.arange(8, dtype=np.uint64) << np.uint64(61), np.array([2**64 - 2**11], np.uint64)])
    with localcontext(prec=DIGITS + 30):
        exact = np.array([exact_sine_cosine(2 * PI * int(b) / 2**64) for b in bits]).T
        actual = evaluated(sines_and_cosines_of_turns, bits, 2)
        for values, expected in zip(actual, exact, strict=True):
            expected = [Decimal(0) if abs(e) < Decimal("1e-45") else e for e in expected]
            assert 0.5 < np.abs(errors_in_ulp(values[9:], expected[9:])).max() < 2.0
            np.testing.assert_allclose(values[:9], np.array(expected[:9], float), rtol=3e-16, atol=0)


def points():
    """(y, x): all directions, near the axes, and at the changes between the reduced arguments, at several scales."""
    rng = np.random.default_rng(5)
    angles = rng.uniform(-np.pi, np.pi, 1500)
    ratios = np.concatenate([np.array([7, 11, 19, 39]) / 16 * (1 + k * 2.0**-52) for k in range(-3, 4)])
    y = np.concatenate([np.sin(angles), ratios, -ratios, 10.0 ** rng.uniform(-150, 0, 200)])
    x = np.concatenate([np.cos(angles), np.ones(2 * ratios.size), rng.choice([-1.0, 1.0], 200)])
    scale = 10.0 ** rng.uniform(-100, 100, y.size)
    return y * scale, x * scale


def test_arctangent_is_accurate():
    y, x = points()
    values = np.array([arctangent(*point) for point in zip(y, x, strict=True)])
    with localcontext(prec=DIGITS + 30):
        exact = [exact_arctangent(Decimal(a), Decimal(b)) for a, b in zip(y, x, strict=True)]
        error = np.abs(errors_in_ulp(values, exact)).max()
    assert 0.5 < error < 1.5


def test_arc_cosine_is_accurate():
    rng = np.random.default_rng(6)
    near_one = 1.0 - 10.0 ** rng.uniform(-16, 0, 500)
    x = np.concatenate([rng.uniform(-1, 1, 1000), near_one, -near_one])
    with localcontext(prec=DIGITS + 30):
        exact = [exact_arctangent((1 - Decimal(v) ** 2).sqrt(), Decimal(v)) for v in x]
        error = np.abs(errors_in_ulp(np.array([arc_cosine(v) for v in x]), exact)).max()
    assert 0.5 < error < 2.5
    assert [arc_cosine(v) for v in (1.0, 0.0, -1.0)] == [0.0, np.pi / 2, np.pi]


def test_not_a_number_and_infinite_arguments():
    for angle in (np.nan, np.inf, -np.inf):
        assert np.isnan(sine_cosine(angle)).all()
        assert np.isnan(exponential(angle))
    assert np.isnan([arctangent(np.nan, 1.0), arctangent(1.0, np.nan), arc_cosine(np.nan)]).all()
    # and they do not spoil the lanes beside them
    angles = np.linspace(-3.0, 3.0, LANES)
    angles[::2] = np.nan
    actual = evaluated(sines_and_cosines, angles, 2)
    assert np.isnan(actual[:, ::2]).all() and np.isfinite(actual[:, 1::2]).all()


def compiled_alone(function):
    """The scalar code of a function, for one value at a time."""

    @njit(error_model="numpy")
    def call(*values):
        return function(*values)

    return call


def in_vectors_and_alone(angles, powers, positive, cosines, sides, bits, way):
    """Pairs of what vectors give and what `way` of each function gives for one value after the other."""
    opposite = sides.reshape(-1, LANES)[:, ::-1].ravel()
    functions = sine_cosine, exponential, logarithm, arc_cosine, arctangent, sine_cosine_of_turn
    sine_and_cosine, power_of_e, log, arccos, arctan, of_turn = map(way, functions)
    return [
        (evaluated(sines_and_cosines, angles, 2).T, [sine_and_cosine(angle) for angle in angles]),
        (evaluated(exponentials, powers)[0], [power_of_e(power) for power in powers]),
        (evaluated(logarithms, positive)[0], [log(x) for x in positive]),
        (evaluated(arc_cosines, cosines)[0], [arccos(x) for x in cosines]),
        (evaluated(arctangents, sides)[0], [arctan(*pair) for pair in zip(sides, opposite, strict=True)]),
        (evaluated(sines_and_cosines_of_turns, bits, 2).T, [of_turn(b) for b in bits]),
    ]


def test_vectors_give_the_bits_of_single_values():
    angles, powers, positive = arguments(1e4)[::20], arguments(708.0)[::20], np.abs(arguments(1e4)[::20]) + 1e-300
    bits = np.random.default_rng(4).integers(0, 2**64, 150, dtype=np.uint64)
    cosines, sides = arguments(1.0)[::20], np.random.default_rng(7).normal(size=4 * LANES)
    for together, alone in in_vectors_and_alone(angles, powers, positive, cosines, sides, bits, compiled_alone):
        np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize(
    "kernel", [logarithms, exponentials, sines_and_cosines, sines_and_cosines_of_turns, arctangents, arc_cosines]
)
def test_loops_are_vectorised(kernel):
    results = 2 if kernel in (sines_and_cosines, sines_and_cosines_of_turns) else 1
    evaluated(kernel, np.ones(LANES, np.uint64 if kernel is sines_and_cosines_of_turns else float), results)
    (code,) = kernel.inspect_llvm().values()
    assert re.search(r"fmul <\d+ x double>", code)
    assert not re.search(r"call double @(sin|cos|exp|log|a?tan2?|acos|llvm\.(sin|cos|exp|log))", code)


def test_plain_python_has_the_bits_of_vectors():
    random, count = np.random.default_rng(8), 50_000
    angles = np.concatenate([random.uniform(-10, 10, count // 2), random.normal(0.0, 1e4, count // 2)])
    powers = np.concatenate([random.uniform(-708, 708, count // 2), random.uniform(-2, 2, count // 2)])
    positive, cosines = 10.0 ** random.uniform(-300, 300, count), random.uniform(-1, 1, count)
    bits = random.integers(0, 2**64, count, dtype=np.uint64)
    bits[:8] = np.arange(8, dtype=np.uint64) << np.uint64(61)
    sides = np.resize(angles, -(-count // LANES) * LANES)
    pairs = in_vectors_and_alone(angles, powers, positive, cosines, sides, bits, lambda function: function)
    for compiled, plain in pairs:
        np.testing.assert_array_equal(compiled.view(np.uint64), np.array(plain).view(np.uint64))


def test_arrays_symbols_and_series_have_functions_of_their_own():
    array = np.array([0.1, 0.3])
    for function, own in ((exponential, np.exp), (logarithm, np.log), (arc_cosine, np.arccos)):
        np.testing.assert_array_equal(function(array), own(array))
        series = function(Series.along(array, 1.0, 3))
        np.testing.assert_array_equal(series.coefficients[0], own(array))
        x = casadi.SX.sym("x")
        with symbols_in_numpy(casadi):
            traced = casadi.Function("f", [x], [function(x), casadi.jacobian(function(x), x)])
        value, slope = traced(0.3)
        assert float(value) == pytest.approx(own(0.3), rel=1e-15)
        assert float(slope) == pytest.approx(series.coefficients[1, 1], rel=1e-14)
    np.testing.assert_array_equal(sine_cosine(array), [np.sin(array), np.cos(array)])
    np.testing.assert_array_equal(arctangent(array, -array), np.arctan2(array, -array))
    angle = arctangent(Series.along(array, 1.0, 3), Series.along(-1.0, array, 3))
    exact = np.arctan2(array + 1e-3, -1.0 + 1e-3 * array)
    np.testing.assert_allclose(angle.at(1e-3), exact, rtol=1e-12)


def test_choices_are_those_of_python_numpy_and_casadi():
    x, numbers = casadi.SX.sym("x"), [-2.0, 0.5, 3.0]
    clipped = casadi.Function("clipped", [x], [clip(x, -1.0, 1.0)])
    assert [clip(number, -1.0, 1.0) for number in numbers] == [-1.0, 0.5, 1.0]
    assert clip(np.array(numbers), -1.0, 1.0).tolist() == [-1.0, 0.5, 1.0]
    assert [float(clipped(number)) for number in numbers] == [-1.0, 0.5, 1.0]
    assert [njit(lambda x: clip(x, -1.0, 1.0))(number) for number in numbers] == [-1.0, 0.5, 1.0]
    assert np.isnan(clip(np.nan, -1.0, 1.0))
    along = Series.along(np.array(numbers), 2.0, 1)
    assert clip(along, -1.0, 1.0).coefficients.tolist() == [[-1.0, 0.5, 1.0], [0.0, 2.0, 0.0]]
    assert clip(Series.along(5.0, 2.0, 1), -1.0, 1.0) == 1.0
    assert select(True, "yes", "no") == "yes" and select(np.False_, x, 1.0) == 1.0


def test_numba_is_not_imported():
    program = "import sys; from marsedl.elementary import sine_cosine; sine_cosine(1.0); print('numba' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert shown.split() == ["False"]
