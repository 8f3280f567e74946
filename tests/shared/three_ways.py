"""A function of a model as Python and numpy evaluate it, as numba compiles it and as CasADi traces it."""

import casadi
import numpy as np
from numba import njit


def check_three_ways(function, arguments, *, rtol=0.0, atol=1e-15, scaled=True, to_the_bit=True):
    """Assert that a function of numbers, which returns a tuple of them, gives the same however it is evaluated.

    arguments: (number of arguments, points). scaled: tolerances are relative to the largest result of its kind, as
    single rates are differences of larger terms. to_the_bit: compiled code has the bits of Python.
    """
    broadcast = np.array(function(*arguments))
    points, compiled_function = arguments.T.tolist(), njit(function)
    in_python = np.array([function(*point) for point in points]).T
    compiled = np.array([compiled_function(*point) for point in points]).T
    casadi.GlobalOptions.setNumpyMode(-1)
    symbols = casadi.SX.sym("arguments", len(arguments))
    outputs = casadi.vertcat(*function(*casadi.vertsplit(symbols)))
    traced = casadi.Function("traced", [symbols], [outputs]).map(len(points))(arguments).full()
    assert broadcast.shape == traced.shape
    scale = np.abs(broadcast).max(axis=1, keepdims=True) if scaled else 1.0
    for other in (in_python, compiled, traced):
        np.testing.assert_allclose(other / scale, broadcast / scale, rtol=rtol, atol=atol)
    if to_the_bit:
        np.testing.assert_array_equal(compiled, in_python)
