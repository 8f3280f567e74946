"""Sensitivities along a trajectory that is held on intervals, by the implicit midpoint rule (desensitized, Sec. 4.2).

    S' = A S + F,   A = df/dx + df/du K,   F = df/dp:     S_{k+1} - S_k = h A_k (S_k + S_{k+1})/2 + h F_k

with A_k and F_k in the middle of interval k. Of a flow that obeys the midpoint rule itself these are the exact
derivatives; of the continuous flow they are of second order in h.
"""

import numpy as np

__all__ = ["adjoint_rows", "closed_loop", "midpoint_responses", "midpoint_transitions", "propagate_columns"]


def midpoint_transitions(state_matrix, step):
    """Sensitivity of the end of every interval to its start (desensitized, Sec. 4.2).

        Phi_k = (I - h/2 A_k)^-1 (I + h/2 A_k) = I + (I - h/2 A_k)^-1 h A_k

    The second form keeps the column of a state that enters no rate a column of I to the last bit.

    Args:
        state_matrix: A in the middle of the intervals, (N, n, n), 1/s in the units of the states.
        step: lengths of the intervals, (N,) or one for all, s.

    Returns:
        Phi, (N, n, n).

    Raises:
        ValueError: if shapes do not fit, a value is not finite, a step is not positive, or 2/h is an eigenvalue of A.
    """
    state_matrix, step = _intervals(state_matrix, step)
    return np.eye(state_matrix.shape[1]) + _across(state_matrix, step, state_matrix)


def midpoint_responses(state_matrix, forcing, step):
    """Effect at the end of every interval of a forcing that is constant on it.

        R_k = (I - h/2 A_k)^-1 h F_k

    With F = df/dp these drive the sensitivity to a constant parameter; with F = df/du they are the effect of a control.

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
    implicit = np.eye(state_matrix.shape[1]) - 0.5 * step * state_matrix
    try:
        return np.linalg.solve(implicit, step * right)
    except np.linalg.LinAlgError as error:
        worst = np.argmin(np.abs(np.linalg.det(implicit)))
        raise ValueError(f"step: I - h/2 A is singular in interval {worst}; shorten the intervals") from error


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
        wanted in (None, length) for wanted, length in zip(shape, value.shape, strict=True)
    )
    if not fits:
        expected = ", ".join("any" if wanted is None else str(wanted) for wanted in shape)
        raise ValueError(f"{name} must have shape ({expected}), not {value.shape}")
    if not np.isfinite(value).all():
        raise ValueError(f"{name} has entries that are not finite")
    return value
