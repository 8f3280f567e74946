r"""Sensitivities along a trajectory that is held on intervals (desensitized, Sec. 4.2).

    $\dot{S} = A S + F, \quad A = \frac{\partial f}{\partial x} + \frac{\partial f}{\partial u} K, \quad F =
      \frac{\partial f}{\partial p}$

By the implicit midpoint rule, with $A_k$ and $F_k$ in the middle of interval $k$:

    $S_{k+1} - S_k = h A_k \frac{S_k + S_{k+1}}{2} + h F_k$

Other schemes of the collocation evaluate the equations at other points of an interval (`POINTS`). Of a flow that obeys
the scheme itself these sensitivities are the exact derivatives; of the continuous flow they have the scheme's order.
"""

import numpy as np

__all__ = [
    "POINTS",
    "adjoint_rows",
    "closed_loop",
    "midpoint_responses",
    "midpoint_transitions",
    "propagate_columns",
    "scheme_columns",
    "scheme_responses",
    "scheme_transitions",
]

# Points of an interval at which a scheme evaluates the equations: its middle; its ends; start, middle and end.
POINTS = {"midpoint": 1, "trapezoid": 2, "hermite_simpson": 3}


def midpoint_transitions(state_matrix, step):
    r"""Sensitivity of the end of every interval to its start (desensitized, Sec. 4.2).

        $\Phi_k = \left( I - \frac{h}{2} A_k \right)^{-1} \left( I + \frac{h}{2} A_k \right) = I + \left( I -
          \frac{h}{2} A_k \right)^{-1} h A_k$

    The second form keeps the column of a state that enters no rate a column of $I$ to the last bit.

    Args:
        state_matrix: A in the middle of the intervals, (N, n, n), 1/s in the units of the states.
        step: lengths of the intervals, (N,) or one for all, s.

    Returns:
        $\Phi$, (N, n, n).

    Raises:
        ValueError: if shapes do not fit, a value is not finite, a step is not positive, or 2/h is an eigenvalue of A.
    """
    state_matrix, step = _intervals(state_matrix, step)
    return np.eye(state_matrix.shape[1]) + _across(state_matrix, step, state_matrix)


def midpoint_responses(state_matrix, forcing, step):
    r"""Effect at the end of every interval of a forcing that is constant on it.

        $R_k = \left( I - \frac{h}{2} A_k \right)^{-1} h F_k$

    With $F = \partial f / \partial p$ these drive the sensitivity to a constant parameter; with
    $F = \partial f / \partial u$ they are the effect of a control.

    Args:
        state_matrix, step: as in `midpoint_transitions`.
        forcing: F in the middle of the intervals, (N, n, m).

    Returns:
        R, (N, n, m).

    Raises:
        ValueError: as `midpoint_transitions`.
    """
    state_matrix, step = _intervals(state_matrix, step)
    forcing = _array("forcing", forcing, (*state_matrix.shape[:2], None))
    return _across(state_matrix, step, forcing)


def scheme_transitions(scheme, matrices, step):
    r"""Sensitivity of the end of every interval to its start, by any scheme of the collocation.

        $\text{trapezoid:} \quad S_1 - S_0 = \frac{h}{2} (A_0 S_0 + A_1 S_1)$
        $\text{Hermite-Simpson:} \quad S_1 - S_0 = \frac{h}{6} (A_0 S_0 + 4 A_\text{m} S_\text{m} + A_1 S_1),$
        $S_\text{m} = \frac{S_0 + S_1}{2} + \frac{h}{8} (A_0 S_0 - A_1 S_1)$

    Args:
        scheme: a key of `POINTS`.
        matrices: A at its points of the intervals, (N, points, n, n), 1/s in the units of the states.
        step: lengths of the intervals, (N,) or one for all, s.

    Returns:
        $\Phi$, (N, n, n); differences from I keep the column of a state that enters no rate to the last bit.

    Raises:
        ValueError: for another scheme, or as `midpoint_transitions`.
    """
    if scheme == "midpoint":
        return midpoint_transitions(_at_points(scheme, matrices)[:, 0], step)
    matrices, step = _points(scheme, matrices, step)
    before, after = _change(scheme, matrices, step)
    return np.eye(matrices.shape[-1]) + _solved(after, before + after)


def scheme_responses(scheme, matrices, forcing, step):
    """Effect at the end of every interval of forcings at the points of the scheme, one by one.

    Their sum is the effect of a parameter; of df/du at the points they are the effects of a control.

    Args:
        scheme, matrices, step: as of `scheme_transitions`.
        forcing: F at the points, (N, points, n, m).

    Returns:
        R, (N, points, n, m).

    Raises:
        ValueError: as `scheme_transitions`.
    """
    if scheme == "midpoint":
        matrices, forcing = _at_points(scheme, matrices)[:, 0], _at_points(scheme, forcing, "forcing")[:, 0]
        return midpoint_responses(matrices, forcing, step)[:, np.newaxis]
    matrices, step = _points(scheme, matrices, step)
    forcing = _at_points(scheme, forcing, "forcing")
    first, last = step / 2.0 * forcing[:, 0], step / 2.0 * forcing[:, -1]
    parts = [first, last]
    if scheme == "hermite_simpson":
        through_middle = step**2 / 12.0 * matrices[:, 1]
        parts = [
            first / 3.0 + through_middle @ forcing[:, 0],
            2.0 / 3.0 * step * forcing[:, 1],
            last / 3.0 - through_middle @ forcing[:, 2],
        ]
    after = _change(scheme, matrices, step)[1]
    return np.stack([_solved(after, part) for part in parts], axis=1)


def scheme_columns(scheme, matrices, sensitivity, step, forcing=None):
    """Columns of the sensitivity at the points of the scheme, from those at the nodes.

    Args:
        scheme, matrices, step: as of `scheme_transitions`.
        sensitivity: S at the nodes, (N + 1, n, m).
        forcing: F at the points, (N, points, n, m), or None for zero.

    Returns:
        S at the points, (N, points, n, m).
    """
    start, end = sensitivity[:-1], sensitivity[1:]
    middle = (end + start) / 2.0
    if scheme == "midpoint":
        return middle[:, np.newaxis]
    if scheme == "trapezoid":
        return np.stack([start, end], axis=1)
    matrices, step = _points(scheme, matrices, step)
    slopes = matrices[:, 0] @ start - matrices[:, 2] @ end
    if forcing is not None:
        slopes += forcing[:, 0] - forcing[:, 2]
    return np.stack([start, middle + step / 8.0 * slopes, end], axis=1)


def propagate_columns(transitions, columns, responses=None):
    """Carry columns of the sensitivity forward, S_{k+1} = Phi_k S_k + R_k.

    Args:
        transitions: Phi, (N, n, n).
        columns: S_0, one column per perturbation, (n, m); zero for that of a parameter.
        responses: R, (N, n, m), or None for zero.

    Returns:
        S at the nodes, (N + 1, n, m).

    Raises:
        ValueError: if shapes do not fit or a value is not finite.
    """
    transitions = _square("transitions", transitions)
    intervals, n, _ = transitions.shape
    columns = _array("columns", columns, (n, None))
    if responses is not None:
        responses = _array("responses", responses, (intervals, *columns.shape))
    sensitivity = np.empty((intervals + 1, *columns.shape))
    sensitivity[0] = columns
    for k in range(intervals):
        np.matmul(transitions[k], sensitivity[k], out=sensitivity[k + 1])
        if responses is not None:
            sensitivity[k + 1] += responses[k]
    return sensitivity


def adjoint_rows(transitions, rows):
    """Carry outputs of the final state backward, L_k = L_{k+1} Phi_k.

    Row by row L_k S_k is the part of the final outputs that comes from node k; without forcing it is the same at all.

    Args:
        transitions: Phi, (N, n, n).
        rows: L_N, one row per output, (r, n).

    Returns:
        L at the nodes, (N + 1, r, n).

    Raises:
        ValueError: if shapes do not fit or a value is not finite.
    """
    transitions = _square("transitions", transitions)
    intervals, n, _ = transitions.shape
    rows = _array("rows", rows, (None, n))
    adjoint = np.empty((intervals + 1, *rows.shape))
    adjoint[-1] = rows
    for k in reversed(range(intervals)):
        np.matmul(adjoint[k + 1], transitions[k], out=adjoint[k])
    return adjoint


def closed_loop(state_matrix, control_matrix, gain):
    """State matrix under the feedback u = u* + K (x - x*), A + B K (desensitized, Eq. 5).

    Args:
        state_matrix: A, (N, n, n).
        control_matrix: B, (N, n, m).
        gain: K, constant, (m, n).

    Returns:
        A + B K, (N, n, n).

    Raises:
        ValueError: if shapes do not fit or a value is not finite.
    """
    state_matrix = _square("state_matrix", state_matrix)
    control_matrix = _array("control_matrix", control_matrix, (*state_matrix.shape[:2], None))
    return state_matrix + control_matrix @ _array("gain", gain, (control_matrix.shape[2], state_matrix.shape[1]))


def _across(state_matrix, step, right):
    """(I - h/2 A)^-1 h right of every interval."""
    return _solved(0.5 * step * state_matrix, step * right)


def _change(scheme, matrices, step):
    """Derivatives of the change over every interval with respect to its start and its end, (N, n, n) each."""
    if scheme == "midpoint":
        half = step / 2.0 * matrices[:, 0]
        return half, half
    if scheme == "trapezoid":
        return step / 2.0 * matrices[:, 0], step / 2.0 * matrices[:, 1]
    first, middle, last = matrices.swapaxes(0, 1)
    half = np.eye(matrices.shape[-1]) / 2.0
    return (
        step / 6.0 * (first + 4.0 * middle @ (half + step / 8.0 * first)),
        step / 6.0 * (last + 4.0 * middle @ (half - step / 8.0 * last)),
    )


def _solved(after, right):
    """(I - after)^-1 right of every interval."""
    implicit = np.eye(after.shape[1]) - after
    try:
        return np.linalg.solve(implicit, right)
    except np.linalg.LinAlgError as error:
        worst = np.argmin(np.abs(np.linalg.det(implicit)))
        raise ValueError(f"step: I - h/2 A is singular in interval {worst}; shorten the intervals") from error


def _at_points(scheme, values, name="matrices"):
    """Finite arrays at the points of a known scheme."""
    if scheme not in POINTS:
        raise ValueError(f"scheme: '{scheme}' is none of {', '.join(POINTS)}")
    values = _array(name, values, (None, None, None, None))
    if values.shape[1] != POINTS[scheme]:
        raise ValueError(f"{name} must have shape (N, {POINTS[scheme]}, n, m) by {scheme}, not {values.shape}")
    return values


def _points(scheme, matrices, step):
    """Matrices at the points of a scheme and the step, both checked, the step as (N, 1, 1)."""
    matrices = _at_points(scheme, matrices)
    return matrices, _intervals(matrices[:, 0], step)[1]


def _intervals(state_matrix, step):
    """Both checked, the step as (N, 1, 1)."""
    state_matrix = _square("state_matrix", state_matrix)
    step = np.asarray(step, dtype=float)
    if step.shape not in ((), state_matrix.shape[:1]):
        raise ValueError(f"step must be one number or have shape {state_matrix.shape[:1]}, not {step.shape}")
    if not (np.isfinite(step) & (step > 0)).all():
        raise ValueError("step must be positive and finite")
    return state_matrix, np.broadcast_to(step, state_matrix.shape[:1])[:, None, None]


def _square(name, value):
    """An array of square matrices, one per interval."""
    value = _array(name, value, (None, None, None))
    if value.shape[1] != value.shape[2]:
        raise ValueError(f"{name} must have shape (N, n, n), not {value.shape}")
    return value


def _array(name, value, shape):
    """A finite array of this shape, None standing for any length."""
    value = np.asarray(value, dtype=float)
    fits = value.ndim == len(shape) and all(
        extent in (None, length) for extent, length in zip(shape, value.shape, strict=True)
    )
    if not fits:
        expected = ", ".join("any" if extent is None else str(extent) for extent in shape)
        raise ValueError(f"{name} must have shape ({expected}), not {value.shape}")
    if not np.isfinite(value).all():
        raise ValueError(f"{name} has entries that are not finite")
    return value
