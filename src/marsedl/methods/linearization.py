"""Exact linear models x' = A x + B u + c of any equation set along a trajectory, by automatic differentiation."""

import re
import traceback
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = ["LinearModel", "linearize", "linearize_intervals"]


class LinearModel(NamedTuple):
    """Affine time-varying model x' = A x + B u + c at k points; units follow those of state and control."""

    state_matrix: np.ndarray  # A = df/dx, (k, n, n)
    control_matrix: np.ndarray  # B = df/du, (k, n, m)
    affine: np.ndarray  # c = f - A x - B u, (k, n)

    __repr__ = summary


@contextmanager
def symbols_in_numpy(casadi):
    """Let functions of numbers take symbols: `np.sqrt` and the like return plain ones (CasADi 3.8 warns otherwise).

    Raises TypeError with file and line for what asks a symbol for its value: a branch, `min`, an index.
    """
    options = casadi.GlobalOptions
    has_mode = hasattr(options, "setNumpyMode")  # 3.7 has no such option
    before = has_mode and options.getNumpyMode()
    if has_mode:
        options.setNumpyMode(-1)
    try:
        yield
    except RuntimeError as error:
        if not re.search("truth value|to_int not defined", str(error)):
            raise
        raise _untraceable(error) from None
    finally:
        if has_mode:
            options.setNumpyMode(before)


def _untraceable(error):
    frames = traceback.extract_tb(error.__traceback__)
    frame = [frame for frame in frames if "casadi" not in Path(frame.filename).parts][-1]
    return TypeError(
        f"{frame.filename}, line {frame.lineno}, in {frame.name}: `{frame.line}` asks a symbol of CasADi for its "
        "value; choose by select(condition, a, b) or clip(x, low, high) of marsedl.elementary in place of a branch, "
        "by np.minimum and np.maximum in place of min and max, and look tables up outside"
    )


def symbol_kind(rates, arguments):
    """The kind of CasADi symbols that can be traced through a function: SX, or MX where it goes through a table."""
    import casadi

    try:
        with symbols_in_numpy(casadi):
            rates(*casadi.vertsplit(casadi.SX.sym("argument", arguments)))
    except RuntimeError as error:
        if "eval_sx" not in str(error):
            raise
        return casadi.MX
    return casadi.SX


def linearize(rates, states, controls, parameters=()):
    r"""Linearize equations of motion about given states and controls.

        $A = \frac{\partial f}{\partial x}, \quad B = \frac{\partial f}{\partial u}, \quad c = f(x, u) - A x - B
          u$

    The derivatives are exact (CasADi), not finite differences.

    Args:
        rates: plain function of scalars, `rates(*state, *control, *parameters)`, returning the n time derivatives as a
            tuple. It may use arithmetic, `np.*` and `marsedl.elementary` only (`math.*` and branches cannot
            be traced).
        states: states along the trajectory, (k, n).
        controls: controls along the trajectory, (k, m); m may be 0.
        parameters: sequence of further arguments of `rates`, each a scalar or an array (k,) along the trajectory.

    Returns:
        `LinearModel` of arrays A (k, n, n), B (k, n, m), c (k, n).

    Raises:
        ValueError: if shapes do not fit, or if a rate or derivative is not finite at some point.
        TypeError: for a branch that cannot be traced, with its file and line.
    """
    import casadi

    states = np.asarray(states, dtype=float)
    controls = np.asarray(controls, dtype=float)
    if states.ndim != 2 or controls.ndim != 2 or len(states) != len(controls):
        raise ValueError(f"states (k, n) and controls (k, m) do not fit: shapes {states.shape} and {controls.shape}")
    (count, n), m = states.shape, controls.shape[1]
    try:
        along = [np.broadcast_to(np.asarray(value, dtype=float), (count,)) for value in parameters]
    except ValueError as error:
        raise ValueError(f"every entry of parameters must be a scalar or have shape ({count},)") from error

    kind = symbol_kind(rates, n + m + len(along))
    state, control, parameter = kind.sym("state", n), kind.sym("control", m), kind.sym("parameter", len(along))
    with symbols_in_numpy(casadi):
        outputs = rates(*casadi.vertsplit(casadi.vertcat(state, control, parameter)))
    if len(outputs) != n:
        raise ValueError(f"rates returned {len(outputs)} values for a state of {n} components")
    rate = casadi.vertcat(*outputs)
    function = casadi.Function(
        "linear_model",
        [state, control, parameter],
        [casadi.densify(value) for value in (casadi.jacobian(rate, state), casadi.jacobian(rate, control), rate)],
    )
    stacked = np.array(along).reshape(len(along), count)
    a, b, f = (value.full() for value in function.map(count)(states.T, controls.T, stacked))
    state_matrix = a.reshape(n, count, n).transpose(1, 0, 2)
    control_matrix = b.reshape(n, count, m).transpose(1, 0, 2)
    affine = f.T - np.einsum("kij,kj->ki", state_matrix, states) - np.einsum("kij,kj->ki", control_matrix, controls)
    for name, value in (("state", state_matrix), ("control", control_matrix), ("rates themselves", affine)):
        bad = ~np.isfinite(value).reshape(count, -1).all(axis=1)
        if bad.any():
            raise ValueError(f"not finite at point {np.argmax(bad)} of {count}: derivative or value, {name}")
    return LinearModel(state_matrix, control_matrix, affine)


def linearize_intervals(rates, states, controls, step, scheme, parameters=()):
    r"""Linearize equations of motion where a scheme of the collocation evaluates them (`sensitivity.POINTS`).

        $\text{midpoint:} \quad \frac{x_0 + x_1}{2}$
        $\text{trapezoid:} \quad x_0, \quad x_1$
        $\text{Hermite-Simpson:} \quad x_0, \quad \frac{x_0 + x_1}{2} + \frac{h}{8} (f_0 - f_1), \quad x_1$

    Args:
        rates, parameters: as of `linearize`.
        states: at the nodes, (N + 1, n).
        controls: constant on the intervals, (N, m).
        step: lengths of the intervals, (N,) or one for all, s.
        scheme: "midpoint", "trapezoid" or "hermite_simpson".

    Returns:
        `LinearModel` of arrays A (N, points, n, n), B (N, points, n, m), c (N, points, n).

    Raises:
        ValueError: for another scheme, or as `linearize`.
    """
    states, controls = np.asarray(states, dtype=float), np.asarray(controls, dtype=float)
    start, end = states[:-1], states[1:]
    middle = (end + start) / 2.0

    def model(points):
        return linearize(rates, points, controls, parameters)

    if scheme == "midpoint":
        models = [model(middle)]
    elif scheme in ("trapezoid", "hermite_simpson"):
        models = [model(start), model(end)]
    else:
        raise ValueError(f"scheme: '{scheme}' is none of midpoint, trapezoid, hermite_simpson")
    if scheme == "hermite_simpson":
        first, last = (
            (of.state_matrix @ x[..., None] + of.control_matrix @ controls[..., None])[..., 0] + of.affine
            for of, x in zip(models, (start, end), strict=True)
        )
        models.insert(1, model(middle + np.reshape(step, (-1, 1)) / 8.0 * (first - last)))
    return LinearModel(*(np.stack(parts, axis=1) for parts in zip(*models, strict=True)))
