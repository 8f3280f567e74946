"""Algorithm 1 of Ridderhof and Tsiotras (powered descent): Lambda(0) by fixed-point iteration, as printed and repaired.

The closed form makes it unnecessary. It is kept to show what the printed algorithm does: its boundary condition has a
wrong power of the noise density, it depends on the unit of the control, and its stopping rule is absolute.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from marsedl.methods.covariance_steering.closed_form import equivalent_squared_noise_density
from marsedl.summaries import summary

__all__ = ["FixedPoint", "fixed_point"]

_BOUNDARIES = ("corrected", "algorithm_1", "eq_46")
_STATUS = (
    "converged",
    "iteration limit reached before the tolerance",
    "diverged: an iterate is not finite",
    "singular: a matrix of the iteration has no inverse",
)


class FixedPoint(NamedTuple):
    """End of the iteration; q_initial and p_initial are in the unit in which it ran, riccati_initial is not."""

    q_initial: np.ndarray  # Q(0), (n, n)
    p_initial: np.ndarray  # P(0), (n, n)
    riccati_initial: np.ndarray  # Lambda(0) = U^2 Q(0)^-1, (n, n); nan where Q(0) has no inverse
    iterations: int
    converged: bool
    last_change: float  # the larger of ||dQ(0)|| and ||dP(0)||, divided by ||Q(0)||, ||P(0)|| if relative
    status: str  # one sentence

    __repr__ = summary


def fixed_point(
    transition,
    gramian,
    covariances,
    noise_density,
    *,
    control_unit=1.0,
    boundary="corrected",
    order="gauss_seidel",
    tolerance=1e-10,
    tolerance_kind="relative",
    maximum_iterations=1_000_000,
):
    r"""Algorithm 1: iterate on $Q(0) = \Lambda(0)^{-1}$ and $P(0) = H(0)^{-1}$, from I and I.

        $P(T) = \Phi P(0) \Phi^\top + M, \quad Q(T) = \left( W_T - P(T)^{-1} \right)^{-1}$
        $Q(0) = \Phi^{-1} \left( Q(T) + M \right) \Phi^{-\top}, \quad P(0) = \left( W_0 - Q(0)^{-1} \right)^{-1}$

    The weights $W$ stand for the boundary condition $P^{-1} + Q^{-1} = W$ at both ends: $\gamma^2 \Sigma^{-1}$
    ("corrected", follows from Eq. 43), $(\gamma \Sigma)^{-1}$ ("algorithm_1", lines 7 and 9) or
    $\gamma^{-2} \Sigma^{-1}$ ("eq_46").

    Args:
        transition: $\Phi(T,0)$, (n, n).
        gramian: $M(T,0)$ of Eq. 48 with the control in the caller's unit (SI), (n, n).
        covariances: $S_0$ and $S_T$, (n, n) each.
        noise_density: $\gamma$, in units of U sqrt(s).
        control_unit: U, caller's unit of control per unit of the iteration (18000 N: fractions of full thrust).
        boundary: "corrected", "algorithm_1" or "eq_46".
        order: "gauss_seidel" uses the new $Q(0)$ for $P(0)$; "jacobi" the old one, as printed.
        tolerance: stop when both changes are below it.
        tolerance_kind: "relative" or "absolute" Frobenius norms; the paper's is absolute, so it depends on units.
        maximum_iterations: limit.

    Returns:
        `FixedPoint`; that it stopped does not prove that it converged to a solution, so check $\Sigma(T)$.

    Raises:
        ValueError: for an unknown option, or matrices that are not of one square shape.
    """
    initial_covariance, final_covariance = covariances
    shapes = [np.shape(matrix) for matrix in (transition, gramian, initial_covariance, final_covariance)]
    if len(set(shapes)) > 1 or len(shapes[0]) != 2 or shapes[0][0] != shapes[0][1]:
        raise ValueError(f"transition, gramian and both covariances must be of one shape (n, n), not {shapes}")
    for name, value, choices in (
        ("boundary", boundary, _BOUNDARIES),
        ("order", order, ("gauss_seidel", "jacobi")),
        ("tolerance_kind", tolerance_kind, ("relative", "absolute")),
    ):
        if value not in choices:
            raise ValueError(f"{name} is {value!r}, must be one of {', '.join(choices)}")
    inverse = np.linalg.inv(transition)
    weight = equivalent_squared_noise_density(noise_density, boundary=boundary)
    q, p, iterations, change, code = _iterate(
        tuple(
            np.array(matrix, float, order="C") for matrix in (transition, np.transpose(transition), inverse, inverse.T)
        ),
        np.asarray(gramian, dtype=float) * control_unit**2,
        (weight * np.linalg.inv(initial_covariance), weight * np.linalg.inv(final_covariance)),
        order == "gauss_seidel",
        tolerance_kind == "relative",
        tolerance,
        maximum_iterations,
    )
    try:
        riccati_initial = control_unit**2 * np.linalg.inv(q)
    except np.linalg.LinAlgError:
        riccati_initial = np.full_like(q, np.nan)
    return FixedPoint(
        q_initial=q,
        p_initial=p,
        riccati_initial=(riccati_initial + riccati_initial.T) / 2,
        iterations=iterations,
        converged=code == 0,
        last_change=change,
        status=_STATUS[code],
    )


@njit(cache=True, error_model="numpy")
def _iterate(transitions, gramian, weights, gauss_seidel, relative, tolerance, maximum_iterations):
    """Run Algorithm 1; the last entry of the result indexes `_STATUS`."""
    q, p, change = np.eye(len(gramian)), np.eye(len(gramian)), np.inf
    for iteration in range(1, maximum_iterations + 1):
        q_new, p_new, regular = _pass(transitions, gramian, weights, gauss_seidel, q, p)
        if not regular:
            return q, p, iteration, change, 3
        q_change, q_size = _difference_and_size(q_new, q)
        p_change, p_size = _difference_and_size(p_new, p)
        change = max(q_change / q_size, p_change / p_size) if relative else max(q_change, p_change)
        q, p = q_new, p_new
        if not np.isfinite(q_change + p_change):
            return q, p, iteration, change, 2
        if change < tolerance:
            return q, p, iteration, change, 0
    return q, p, maximum_iterations, change, 1


@njit(cache=True, error_model="numpy")
def _pass(transitions, gramian, weights, gauss_seidel, q, p):
    """Q(0) and P(0) after a pass, and whether all inverses exist.

    transitions: Phi, Phi' and the inverses of both. weights: at both ends.
    """
    forward, forward_transposed, backward, backward_transposed = transitions
    p_final = forward @ p @ forward_transposed + gramian
    if not np.isfinite(p_final).all():  # diverged, not singular
        return p_final, p_final, True
    p_inverse, p_regular = _inverse(p_final)
    q_final, q_regular = _inverse(weights[1] - p_inverse)
    q_new = backward @ (q_final + gramian) @ backward_transposed
    q_inverse, start_regular = _inverse(q_new if gauss_seidel else q)
    p_new, end_regular = _inverse(weights[0] - q_inverse)
    return q_new, np.ascontiguousarray(p_new), p_regular and q_regular and start_regular and end_regular


@njit(cache=True, error_model="numpy")
def _inverse(matrix):
    """The inverse, and whether there is one; of a matrix with a pivot of zero, or not finite, it is the matrix."""
    if not np.isfinite(matrix).all() or np.linalg.slogdet(matrix)[0] == 0.0:
        return matrix, False
    return np.linalg.inv(matrix), True


@njit(cache=True, error_model="numpy")
def _difference_and_size(new, old):
    """Frobenius norms of new - old and of new."""
    difference, size = 0.0, 0.0
    for i in range(new.shape[0]):
        for j in range(new.shape[1]):
            difference += (new[i, j] - old[i, j]) ** 2
            size += new[i, j] ** 2
    return np.sqrt(difference), np.sqrt(size)
