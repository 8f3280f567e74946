"""The arithmetic of compiled code in flights in Python: where Python raises, it goes on with nan or inf.

Compiled, 1 / 0 is inf, and the logarithm of -1 nan. NumPy's numbers do the same, and flights in Python fly these.
Numbers that a function writes itself, and functions of `math`, are Python's own, which raise ZeroDivisionError,
OverflowError or ValueError. `answer` then asks the function again with those of NumPy in their place.
"""

import inspect
import types
import warnings
from traceback import extract_tb

import numpy as np

from marsedl.montecarlo.flights.binding import codes, float_fields, is_foreign


def answer(function, arguments, told=None):
    """What a function of a model returns, as compiled where Python's own numbers would raise.

    Args:
        function: as it is written. arguments: in order.
        told: function of a sentence on what Python said, and where; by default nobody is told.

    Raises:
        Exception: of the function, if it raises with numbers of NumPy, too.
    """
    try:
        return function(*arguments)
    except FloatingPointError:  # which the user asks for, by `numpy.errstate`
        raise
    except (ArithmeticError, ValueError) as error:
        again = _with_numpy(function, {})
        try:
            with np.errstate(all="ignore"):
                result = again(*(numpy_numbers(argument, whole=True) for argument in arguments))
        except Exception:
            raise error from None
        if told:
            place = extract_tb(error.__traceback__)[-1]
            told(f"{function.__name__} ({place.filename}, line {place.lineno}): {error}")
        return result


def numpy_numbers(value, whole=False):
    """Numbers in nested tuples as those of NumPy; integers only if they are annotated as floats, or if whole.

    So compiled parameters are: see `columns.flat`.
    """
    if isinstance(value, tuple):
        floats = float_fields(type(value)) if hasattr(value, "_fields") else (False,) * len(value)
        members = [float(part) if is_float else part for part, is_float in zip(value, floats, strict=True)]
        numbers = [numpy_numbers(part, whole) for part in members]
        return type(value)(*numbers) if hasattr(value, "_fields") else tuple(numbers)
    if type(value) is float:
        return np.float64(value)
    return np.int64(value) if whole and type(value) is int and abs(value) < 2**63 else value


def warn(sentence, time, trial):
    """Warn of what Python said, at a time of a trial."""
    warnings.warn(f"{sentence}, at {time:g} s of trial {trial}; as compiled, it goes on with nan or inf", stacklevel=2)


def _with_numpy(value, made):
    """A function that computes with numbers of NumPy, and all that it calls; any other value likewise.

    made: functions that are made already, by those that they stand for.
    """
    value = getattr(value, "py_func", value)
    if inspect.isfunction(value) and not is_foreign(value):
        return made[value] if value in made else _copy(value, made)
    if inspect.isbuiltin(value) and value.__module__ == "math":
        return _without_errors(value)
    if inspect.ismodule(value) and not is_foreign(value):
        return _Members(value, made)
    return numpy_numbers(value, whole=True)


def _copy(function, made):
    space, cells = dict(function.__globals__), tuple(types.CellType() for _ in function.__closure__ or ())
    code = _code_with_numpy(function.__code__)
    copy = made[function] = types.FunctionType(code, space, function.__name__, function.__defaults__, cells)
    copy.__kwdefaults__ = function.__kwdefaults__
    for name in {name for part in codes(function.__code__) for name in part.co_names} & {*space}:
        space[name] = _with_numpy(space[name], made)
    for cell, original in zip(cells, function.__closure__ or (), strict=True):
        cell.cell_contents = _with_numpy(original.cell_contents, made)
    return copy


def _code_with_numpy(code):
    constants = (
        _code_with_numpy(constant) if inspect.iscode(constant) else numpy_numbers(constant, whole=True)
        for constant in code.co_consts
    )
    return code.replace(co_consts=tuple(constants))


class _Members:
    """The members of a module, with numbers of NumPy."""

    def __init__(self, module, made):
        self._module, self._made = module, made

    def __getattr__(self, name):
        return _with_numpy(getattr(self._module, name), self._made)


def _without_errors(function):
    """A function of `math` that returns what NumPy's of the same name does, where it would raise."""

    def call(*arguments):
        try:
            return numpy_numbers(function(*arguments))
        except (ValueError, OverflowError):
            return getattr(np, function.__name__)(*arguments)

    return call
