"""Discrete linear model of a flight through a Gaussian random field (random field, Eqs. 19 to 28).

Along the nominal trajectory the field is a Gaussian process in time, and over an interval of held control it adds up to
a Gaussian disturbance w_k. All intervals see one and the same field, so their disturbances are correlated.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = [
    "Interval",
    "condition_number",
    "discretize_interval",
    "disturbance_covariance",
    "disturbance_mean",
    "gauss_legendre",
    "regularize",
    "trapezoid_weights",
]

# Negative eigenvalue, over the largest one, that cannot be rounding any more.
_INDEFINITE = 1e-10
# Where the samples of an interval are the start, the middle and the end of its steps.
_IN_STEPS = (slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2))


class Interval(NamedTuple):
    """x_{k+1} = A_k x_k + B_k u_k + c_k + w_k over one interval of s steps (random field, Eq. 23)."""

    transition: np.ndarray  # A_k = Phi(t_{k+1}, t_k), (n, n)
    control: np.ndarray  # B_k, effect of the held control, (n, m)
    field_effect: np.ndarray  # F(t_j) = Phi(t_{k+1}, t_j) G(t_j) at the nodes, per second, (s + 1, n)

    __repr__ = summary


def discretize_interval(state_matrix, control_matrix, field_matrix, step):
    r"""Integrate $\dot{x} = A x + B u + G \Psi + c$ over one interval of held control (random field, Eqs. 22 and 24).

        $A_k = \Phi(t_{k+1}, t_k), \quad B_k = \int \Phi(t_{k+1}, t) B \, dt, \quad F(t) = \Phi(t_{k+1}, t) G(t)$

    Classical Runge-Kutta of order 4. The samples belong to this interval alone, so that a control which jumps at its
    bounds enters both neighbours with its own value.

    Args:
        state_matrix: A at the nodes and the midpoints of the s steps, (2 s + 1, n, n), 1/s in the units of the states.
        control_matrix: B likewise, (2 s + 1, n, m).
        field_matrix: G likewise, (2 s + 1, n); only the nodes are used.
        step: length of a step, s.

    Returns:
        `Interval`.

    Raises:
        ValueError: if shapes do not fit, a sample is not finite, or the step is not positive.
    """
    state_matrix, control_matrix, field_matrix = (
        np.asarray(value, dtype=float) for value in (state_matrix, control_matrix, field_matrix)
    )
    shape = state_matrix.shape
    if len(shape) != 3 or shape[1] != shape[2] or shape[0] < 3 or shape[0] % 2 == 0:
        raise ValueError(
            "state_matrix must have shape (2 s + 1, n, n), sampled at the nodes and midpoints of s > 0 steps, not "
            f"{shape}"
        )
    if control_matrix.ndim != 3 or control_matrix.shape[:2] != shape[:2]:
        raise ValueError(
            f"control_matrix must have shape {(*shape[:2], 'm')} to fit state_matrix, not {control_matrix.shape}"
        )
    if field_matrix.shape != shape[:2]:
        raise ValueError(f"field_matrix must have shape {shape[:2]} to fit state_matrix, not {field_matrix.shape}")
    for name, value in (("state", state_matrix), ("control", control_matrix), ("field", field_matrix)):
        if not np.isfinite(value).all():
            raise ValueError(f"{name}_matrix must be finite; check the trajectory about which the model was linearized")
    _require_positive_step(step)

    identity = np.eye(shape[1])
    start, middle, end = (state_matrix[at] for at in _IN_STEPS)
    first = start
    second = middle @ (identity + step / 2 * first)
    third = middle @ (identity + step / 2 * second)
    fourth = end @ (identity + step * third)
    across = identity + step / 6 * (first + 2 * (second + third) + fourth)

    start_effect, middle_effect, end_effect = (control_matrix[at] for at in _IN_STEPS)
    first = start_effect
    second = middle @ (step / 2 * first) + middle_effect
    third = middle @ (step / 2 * second) + middle_effect
    fourth = end @ (step * third) + end_effect
    held_control_effect = step / 6 * (first + 2 * (second + third) + fourth)

    # Backwards from the end: Phi(t_end, t_j) without an inverse, which a strongly damped state would spoil.
    to_end, control = identity, np.zeros(control_matrix.shape[1:])
    field_effect = np.empty((len(across) + 1, shape[1]))
    field_effect[-1] = field_matrix[-1]
    for j in range(len(across) - 1, -1, -1):
        control += to_end @ held_control_effect[j]
        to_end = to_end @ across[j]
        field_effect[j] = to_end @ field_matrix[2 * j]
    return Interval(to_end, control, field_effect)


def trapezoid_weights(steps, step):
    """Weights of the trapezoidal rule at the nodes of one interval, h (1/2, 1, ..., 1, 1/2).

    The field effect jumps with the control, so every interval has its own two ends. For kernels with a kink on the
    diagonal, such as exp(-|h1 - h2| / H), it is as good as any rule: of second order.

    Args:
        steps: number s of steps of the interval.
        step: h, s.

    Returns:
        Weights, s, (s + 1,).

    Raises:
        ValueError: if there is no step, or its length is not positive.
    """
    if steps < 1:
        raise ValueError(f"steps must be at least 1, not {steps}: an interval has two ends")
    _require_positive_step(step)
    weights = np.full(steps + 1, float(step))
    weights[[0, -1]] = step / 2
    return weights


def gauss_legendre(order, start, end):
    """Nodes and weights of Gauss-Legendre quadrature on one interval, for field effects and kernels that are smooth.

    Exact for polynomials of degree 2 order - 1.

    Args:
        order: number of nodes.
        start, end: bounds of the interval, s.

    Returns:
        Nodes, s, and weights, s, both (order,), nodes ascending.

    Raises:
        ValueError: if there is no node, or the interval is empty.
    """
    if order < 1:
        raise ValueError(f"order must be at least 1, not {order}: it is the number of nodes")
    if not end > start:
        raise ValueError(f"end must be later than start, not {end} after {start}")
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return (start + end) / 2 + (end - start) / 2 * nodes, (end - start) / 2 * weights


def disturbance_mean(field_effects, weights, field_mean):
    r"""Mean of the disturbances (random field, Eq. 25).

        $\text{E}(w_k) = \int F(t) \mu(t) \, dt = \sum_j \text{weight}_j F(t_j) \mu(t_j)$

    The nominal trajectory contains it: there $c_k = x_{k+1} - A_k x_k - B_k u_k - \text{E}(w_k)$.

    Args:
        field_effects: F at the nodes of every interval, list of N arrays (nodes, n).
        weights: quadrature weights there, s, list of N arrays (nodes,).
        field_mean: mean of the field at the nominal position there, list of N arrays (nodes,).

    Returns:
        $\text{E}(w_k)$, (N, n).

    Raises:
        ValueError: if shapes do not fit.
    """
    weighted = _weighted(field_effects, weights)
    if len(field_mean) != len(weighted):
        raise ValueError(
            f"field_mean must have one array for each of the {len(weighted)} intervals, not {len(field_mean)}"
        )
    means = []
    for k, (effect, mean) in enumerate(zip(weighted, field_mean, strict=True)):
        if np.shape(mean) != effect.shape[:1]:
            raise ValueError(
                f"field_mean must have shape {effect.shape[:1]} in interval {k}, one value per node, not "
                f"{np.shape(mean)}"
            )
        means.append(np.asarray(mean, dtype=float) @ effect)
    return np.array(means)


def disturbance_covariance(field_effects, weights, field_covariance):
    r"""Covariance of all disturbances, each with each (random field, Eq. 26).

        $\text{Cov}(w_k, w_l) = \int \int F_k(t) \Sigma(t, \tau) F_l(\tau)^\top \, d\tau \, dt = \sum_{ij}
          \text{weight}_i \, \text{weight}_j F_k(t_i) \Sigma_{ij} F_l(t_j)^\top$

    Positive semidefinite up to rounding, whatever the weights, if $\Sigma$ is.

    Args:
        field_effects: F at the nodes of every interval, list of N arrays (nodes, n).
        weights: quadrature weights there, s, list of N arrays (nodes,).
        field_covariance: covariance of the field between the nominal positions at all nodes of all intervals, in order,
            (J, J). With nodes at the ends of the intervals, the common end of two neighbours stands there twice.

    Returns:
        $\text{Cov}(W)$, (N n, N n), symmetric to the last bit.

    Raises:
        ValueError: if shapes do not fit, or the field covariance is not finite and symmetric.
    """
    weighted = _weighted(field_effects, weights)
    field_covariance = np.asarray(field_covariance, dtype=float)
    bounds = np.cumsum([0, *(len(effect) for effect in weighted)])
    if field_covariance.shape != (bounds[-1], bounds[-1]):
        raise ValueError(
            f"field_covariance must have shape {(int(bounds[-1]),) * 2}, one row for every node of every interval (a "
            f"common end stands twice), not {field_covariance.shape}"
        )
    tolerance = 1e-12 * np.abs(np.diagonal(field_covariance)).max()
    nodes = [slice(*pair) for pair in pairwise(bounds)]
    n = weighted[0].shape[1]
    covariance = np.empty((len(weighted), n, len(weighted), n))
    for k, (rows, effect) in enumerate(zip(nodes, weighted, strict=True)):
        across, down = field_covariance[rows, : bounds[k + 1]], field_covariance[: bounds[k + 1], rows]
        if not np.isfinite(across).all() or not (np.abs(across - down.T) <= tolerance).all():
            raise ValueError(
                f"field_covariance is not finite and symmetric in the rows of interval {k}; both axes must run over "
                "the same nodes in the same order"
            )
        for l, (columns, other) in enumerate(zip(nodes[: k + 1], weighted, strict=False)):
            block = effect.T @ across[:, columns] @ other
            covariance[k, :, l] = (block + block.T) / 2 if l == k else block
            covariance[l, :, k] = covariance[k, :, l].T
    return covariance.reshape(len(weighted) * n, len(weighted) * n)


def regularize(covariance, deviations):
    """Add independent disturbances of equal size in all intervals, Cov(W) + diag(d^2, ..., d^2).

    They stand for an error of the navigation: a law that is designed with them cannot trust its states to the last bit.

    Args:
        covariance: Cov(W), (N n, N n).
        deviations: d, standard deviation per interval of every state, in its unit, (n,).

    Returns:
        Covariance, (N n, N n).

    Raises:
        ValueError: if shapes do not fit, or a deviation is negative.
    """
    covariance, deviations = _covariance_and_states(covariance, "deviations", deviations)
    if not (deviations >= 0).all():
        raise ValueError(f"deviations must not be negative, got {deviations}")
    return covariance + np.diag(np.tile(deviations**2, len(covariance) // len(deviations)))


def condition_number(covariance, units):
    """Ratio of the largest to the smallest eigenvalue of Cov(W) in given units of the states.

    A large one means that some combination of disturbances hardly varies: it can be predicted almost exactly from the
    others. Components without any variance are left out; nothing is learnt from them.

    Args:
        covariance: Cov(W), (N n, N n).
        units: unit in which every state is measured, in that of the covariance (1000 for km if that is in m^2), (n,).

    Returns:
        Condition number, 1; infinite if rounding hides the smallest eigenvalue, 1 if there is no disturbance at all.

    Raises:
        ValueError: if shapes do not fit, a unit is not positive, or the covariance is not positive semidefinite.
    """
    covariance, units = _covariance_and_states(covariance, "units", units)
    if not (units > 0).all():
        raise ValueError(f"units must be positive, got {units}")
    scale = np.tile(units, len(covariance) // len(units))
    disturbed = np.flatnonzero(np.diagonal(covariance))
    if not disturbed.size:
        return 1.0
    eigenvalues = np.linalg.eigvalsh((covariance / np.outer(scale, scale))[np.ix_(disturbed, disturbed)])
    smallest, largest = eigenvalues[[0, -1]]
    if smallest < -_INDEFINITE * largest:
        raise ValueError(
            f"covariance is not positive semidefinite: smallest eigenvalue {smallest:.3g}, largest {largest:.3g} in "
            "the given units; check the covariance function of the field"
        )
    return float(largest / smallest) if smallest > 0 else np.inf


def _weighted(field_effects, weights):
    """Effects times weights, one array (nodes, n) per interval; refuses what does not fit."""
    if not len(field_effects) or len(field_effects) != len(weights):
        raise ValueError(
            "field_effects and weights must have one array per interval and at least one, not "
            f"{len(field_effects)} and {len(weights)}"
        )
    weighted = []
    for k, (effect, weight) in enumerate(zip(field_effects, weights, strict=True)):
        effect, weight = np.asarray(effect, dtype=float), np.asarray(weight, dtype=float)
        if effect.ndim != 2 or not effect.size or weight.shape != effect.shape[:1]:
            raise ValueError(
                f"field_effects (nodes, n) and weights (nodes,) do not fit in interval {k}: shapes {effect.shape} and "
                f"{weight.shape}"
            )
        if weighted and effect.shape[1] != weighted[0].shape[1]:
            raise ValueError(
                f"field_effects must have {weighted[0].shape[1]} states in every interval, not {effect.shape[1]} in "
                f"interval {k}"
            )
        weighted.append(weight[:, None] * effect)
    return weighted


def _covariance_and_states(covariance, name, values):
    """Both as arrays, (N n, N n) and (n,)."""
    covariance, values = np.asarray(covariance, dtype=float), np.asarray(values, dtype=float)
    if (
        values.ndim != 1
        or not values.size
        or covariance.ndim != 2
        or covariance.shape[0] != covariance.shape[1]
        or covariance.shape[0] % values.size
    ):
        raise ValueError(
            f"covariance (N n, N n) and {name} (n,) do not fit: shapes {covariance.shape} and {values.shape}"
        )
    if not np.isfinite(covariance).all():
        raise ValueError("covariance must be finite; check the field effects and the covariance of the field")
    return covariance, values


def _require_positive_step(step):
    if not step > 0:
        raise ValueError(f"step must be positive, got {step}")
