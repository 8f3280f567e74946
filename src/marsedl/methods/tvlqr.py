"""Time-varying linear-quadratic regulator along a trajectory (robust entry funnels, Sec. 4)."""

from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = ["Regulator", "at_half_steps", "discrete_regulator", "tvlqr"]


class Regulator(NamedTuple):
    """Feedback u = K_k x on step k and cost-to-go x'P_k x / 2 at the nodes."""

    gains: np.ndarray  # K_k, (n, nu, nx)
    values: np.ndarray  # P_k, (n + 1, nx, nx), symmetric

    __repr__ = summary


def tvlqr(state_matrices, control_matrices, steps, state_weight, control_weight, terminal_weight):
    r"""Feedback that minimises a quadratic cost of a linear time-varying system (robust entry funnels, Sec. 4).

    On every step $A$ and $B$ are constant and the control is held, $x_{k+1} = A_k x_k + B_k u_k$ with

        $\left[ A_k, \, B_k; \; 0, \, I \right] = \exp\left( h \left[ A, \, B; \; 0, \, 0 \right] \right)$

    and the cost is $J = \frac{1}{2} x_n^\top Q_f x_n + \frac{1}{2} \sum_k h (x_k^\top Q x_k + u_k^\top R u_k)$.
    Backwards from $P_n = Q_f$, $S = P_{k+1}$:

        $K_k = -(h R + B_k^\top S B_k)^{-1} B_k^\top S A_k$
        $P_k = h Q + h K_k^\top R K_k + (A_k + B_k K_k)^\top S (A_k + B_k K_k)$

    This form of $P_k$ is a sum of squares: it stays positive whatever the rounding of the gain.

    Args:
        state_matrices: A in the middle of the steps, (n, nx, nx), 1/s in the units of the states.
        control_matrices: B in the middle of the steps, (n, nx, nu).
        steps: lengths h, (n,), s.
        state_weight: Q, (nx, nx), per second; positive semidefinite.
        control_weight: R, (nu, nu), per second; positive definite.
        terminal_weight: $Q_f$, (nx, nx); positive semidefinite.

    Returns:
        `Regulator`.

    Raises:
        ValueError: if shapes do not fit, a value is not finite, a step is not positive, or a weight is not symmetric or
            not positive (semi)definite.
    """
    from scipy.linalg import expm

    state_matrices = np.asarray(state_matrices, dtype=float)
    control_matrices = np.asarray(control_matrices, dtype=float)
    steps = np.asarray(steps, dtype=float)
    if state_matrices.ndim != 3 or control_matrices.ndim != 3 or state_matrices.shape[1] != state_matrices.shape[2]:
        raise ValueError(
            "state_matrices (n, nx, nx) and control_matrices (n, nx, nu) must have three axes, not shapes "
            f"{state_matrices.shape} and {control_matrices.shape}"
        )
    (count, nx, _), nu = state_matrices.shape, control_matrices.shape[2]
    if control_matrices.shape[:2] != (count, nx) or steps.shape != (count,):
        raise ValueError(
            f"control_matrices {control_matrices.shape} and steps {steps.shape} do not fit state_matrices "
            f"{state_matrices.shape}"
        )
    for name, value in (("state_matrices", state_matrices), ("control_matrices", control_matrices), ("steps", steps)):
        if not np.isfinite(value).all():
            raise ValueError(f"{name} must be finite")
    if not (steps > 0).all():
        raise ValueError(f"steps must be positive; entry {np.argmin(steps > 0)} is {steps[np.argmin(steps > 0)]}")
    state_weight = _weight("state_weight", state_weight, nx)
    control_weight = _weight("control_weight", control_weight, nu, definite=True)
    terminal_weight = _weight("terminal_weight", terminal_weight, nx)

    joint = np.zeros((count, nx + nu, nx + nu))
    joint[:, :nx] = np.concatenate([state_matrices, control_matrices], axis=2) * steps[:, None, None]
    across = expm(joint)
    transitions, effects = across[:, :nx, :nx], across[:, :nx, nx:]

    return discrete_regulator(
        transitions, effects, steps, state_weight, steps[:, None, None] * control_weight, terminal_weight
    )


def discrete_regulator(transitions, effects, steps, state_weight, control_weights, terminal_weight):
    """The recursion of `tvlqr` for steps that are discrete already.

    Args:
        transitions, effects: $A_k$ (n, nx, nx) and $B_k$ (n, nx, nu) of the steps.
        steps: lengths h, (n,), s.
        state_weight: Q, (nx, nx), per second. control_weights: h R of every step, (n, nu, nu).
        terminal_weight: $Q_f$, (nx, nx).

    Returns:
        `Regulator`.
    """
    count, nx, nu = np.shape(effects)
    gains, values = np.empty((count, nu, nx)), np.empty((count + 1, nx, nx))
    values[-1] = terminal_weight
    for k in reversed(range(count)):
        value, effect, weight = values[k + 1], effects[k], control_weights[k]
        gains[k] = -np.linalg.solve(weight + effect.T @ value @ effect, effect.T @ value @ transitions[k])
        closed = transitions[k] + effect @ gains[k]
        value_here = steps[k] * state_weight + gains[k].T @ weight @ gains[k] + closed.T @ value @ closed
        values[k] = (value_here + value_here.T) / 2
    return Regulator(gains, values)


def at_half_steps(gains):
    """Gains at the nodes and half-way between, from one gain a step.

    Node k has the gain of step k, the last node that of the last step; half-way the neighbouring nodes are averaged.

    Args:
        gains: (n, nu, nx).

    Returns:
        Array (2 n + 1, nu, nx).
    """
    gains = np.asarray(gains, dtype=float)
    nodes = np.concatenate([gains, gains[-1:]])
    halves = np.empty((2 * len(gains) + 1, *gains.shape[1:]))
    halves[::2] = nodes
    halves[1::2] = (nodes[:-1] + nodes[1:]) / 2
    return halves


def _weight(name, value, size, definite=False):
    """A symmetric matrix without eigenvalues below zero."""
    value = np.asarray(value, dtype=float)
    if value.shape != (size, size):
        raise ValueError(f"{name} must have shape ({size}, {size}), not {value.shape}")
    if not np.isfinite(value).all() or not np.allclose(value, value.T, rtol=1e-12, atol=0):
        raise ValueError(f"{name} must be finite and symmetric")
    # With the diagonal scaled to one, as states differ in their units by orders of magnitude.
    scale = np.sqrt(np.where(np.diag(value) > 0, np.diag(value), 1.0))
    least = np.linalg.eigvalsh(value / np.outer(scale, scale))[0]
    if least <= 0 if definite else least < -size * np.finfo(float).eps:
        kind = "definite" if definite else "semidefinite"
        raise ValueError(f"{name} must be positive {kind}; with unit diagonal its least eigenvalue is {least:.3g}")
    return value
