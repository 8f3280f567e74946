"""Funnels of the linearised closed loop, which bound nothing but themselves, and shapes made from them.

Over one slice or fine step the deviation moves by xb+ = Phi xb + Gamma w. Everything here follows from Phi and Gamma
alone: the exact and the triangle recursion of the level, the joint ellipsoid of initial deviation and constant
disturbance, the smallest ellipsoids around the reachable set, and the growth by disturbances that act outside the
sums-of-squares programs.
"""

from itertools import pairwise

import numpy as np

from marsedl.methods.checks import require_positive
from marsedl.methods.funnels.stage import cholesky_factor

__all__ = [
    "additive_growth",
    "linear_exact",
    "linear_triangle",
    "minkowski_shape",
    "slice_jacobians",
    "whitened_step",
]


def slice_jacobians(loop, slices):
    """Jacobians of the flow of the error between the slices, at no deviation and no disturbance.

    Args:
        loop: `ClosedLoop` of n fine steps.
        slices: fine steps at which the slices lie, (N,), increasing.

    Returns:
        Phi (N - 1, nx, nx) by the deviation, Gamma (N - 1, nx, nw) by a constant disturbance, and (N - 1, nx, nx) by
        a constant addition to the rates.
    """
    pairs = [loop.flow_jacobians(first, last) for first, last in pairwise(slices)]
    return tuple(np.array(jacobians) for jacobians in zip(*pairs, strict=True))


def whitened_step(transition, response, shape, next_shape):
    r"""Write a linear step in the coordinates in which both slices are balls of radius $\sqrt{\rho}$.

        $A = L_{k+1}^\top \Phi L_k^{-\top}, \quad B = \frac{L_{k+1}^\top \Gamma}{\sqrt{2}}, \quad V_{k+1} = \left|
          \sqrt{\rho_k} A y + B w \right|^2$

    with $P = L L^\top$, $\left| y \right| = 1$ on the boundary of the slice and $\left| w \right| \le 1$ (robust entry
    funnels, Eqs. 15, 18 and 28).

    Args:
        transition: $\Phi$, (nx, nx).
        response: $\Gamma$, (nx, nw).
        shape: $P_k$, (nx, nx).
        next_shape: $P_{k+1}$, (nx, nx).

    Returns:
        A (nx, nx) and B (nx, nw).

    Raises:
        ValueError: if a shape is not positive definite.
    """
    next_factor = cholesky_factor(next_shape).T
    return (
        np.linalg.solve(cholesky_factor(shape), (next_factor @ transition).T).T,
        next_factor @ response / np.sqrt(2),
    )


def linear_exact(transitions, responses, shapes, initial_level):
    r"""Recursion of the level that is exact for linear dynamics; the least that any bound on $V_{k+1}$ can give.

        $\rho_{k+1} = \max_{\left| y \right| = \left| w \right| = 1} \left| \sqrt{\rho_k} A y + B w \right|^2$
        $\rho_{k+1} = \min_{q > 0} \left\{ \text{largest eigenvalue of } (1 + q) \rho_k A A^\top + (1 + 1 / q) B B^\top
          \right\}$

    The minimum is the Lagrange dual, and equal: a semidefinite program with the two equations
    $\left| y \right| = \left| w \right| = 1$ has a solution of rank one. It is convex in $\ln q$, and every $q$ gives
    an upper bound. For the dynamics themselves the level is not a bound: their nonlinear terms are left out.

    Args:
        transitions: $\Phi$ between slices, (N - 1, nx, nx).
        responses: $\Gamma$ between slices, (N - 1, nx, nw); nw may be 0.
        shapes: $P_k$, (N, nx, nx).
        initial_level: $\rho_1$.

    Returns:
        $\rho_k$, (N,).

    Raises:
        ValueError: if a shape is not positive definite or the lengths do not fit.
    """
    return _recursion(_largest_image, transitions, responses, shapes, initial_level)


def linear_triangle(transitions, responses, shapes, initial_level):
    r"""Recursion of the level by the triangle inequality; sound for linear dynamics, and loose.

        $\sqrt{\rho_{k+1}} = \left| A \right| \sqrt{\rho_k} + \left| B \right| \quad \text{(spectral norms)}$

    Args and Returns as for `linear_exact`, which is never larger.
    """
    return _recursion(
        lambda a, b: (np.linalg.norm(a, 2) + _spectral_norm(b)) ** 2, transitions, responses, shapes, initial_level
    )


def minkowski_shape(transitions, responses, initial_set, scales):
    r"""Shapes $P_k$ that follow the set which linear dynamics reach under a disturbance free at every step.

        $S_{k+1} = (1 + p) \Phi S \Phi^\top + (1 + 1 / p) \Gamma \Gamma^\top, \quad S_1 = 2 M_1^{-1}, \quad P_k = 2
          S_k^{-1}$

    contains the Minkowski sum of the image of $S_k$ and of the disturbances for every $p > 0$; the $p$ used makes the
    sum of the squared semi-axes of $S_{k+1}$ in the scaled states least,
    $p^2 = \text{tr}(T \Gamma \Gamma^\top T) / \text{tr}(T \Phi S \Phi^\top T)$. With linear dynamics the level stays at
    or below $\rho = 1$.

    Args:
        transitions: $\Phi$, (n, nx, nx).
        responses: $\Gamma$, (n, nx, nw); nw may be 0.
        initial_set: $M_1$ of the initial set $\left\{ \bar{x}^\top M_1 \bar{x} / 2 \le 1 \right\}$, (nx, nx).
        scales: deviations of the states that count as equal, $T = \text{diag}(1 / \text{scales})$, (nx,).

    Returns:
        P, (n + 1, nx, nx).

    Raises:
        ValueError: if $M_1$ is not positive definite, or a scale is not positive.
    """
    scales = np.asarray(scales, dtype=float)
    require_positive("scales", scales)
    ellipsoids = [2 * _inverse(initial_set, "the matrix of the initial set")]
    for across, response in zip(transitions, responses, strict=True):
        propagated, pushed = across @ ellipsoids[-1] @ across.T, response @ response.T
        ratio = (np.diag(pushed) / scales**2).sum() / (np.diag(propagated) / scales**2).sum()
        # Without a disturbance p = 0; the floor keeps 1/p finite.
        p = max(np.sqrt(ratio), 1e-9)
        ellipsoids.append((1 + p) * propagated + (1 + 1 / p) * pushed)
    return np.array([2 * _inverse(ellipsoid, f"the ellipsoid of step {k}") for k, ellipsoid in enumerate(ellipsoids)])


def additive_growth(responses, next_shapes, amplitudes):
    r"""Largest V that a disturbance added to the rates, constant over a step, causes by itself.

        $\beta_k = \frac{1}{2} \left| L_{k+1}^\top \Gamma_k \, \text{diag}(\text{amplitudes}) \right|^2 \quad
          \text{(spectral norm)}$

    of the set $\sum_i (a_i / \text{amplitude}_i)^2 \le 1$. Where it acts beside what a stage bounds by $s \rho_k$, the
    triangle inequality in $\sqrt{V}$ gives $\sqrt{\rho_{k+1}} = \sqrt{s \rho_k} + \sqrt{\beta_k}$, but for products of
    $a$ with the deviation and with $w$.

    Args:
        responses: $\Gamma_k$ of the deviation to a constant addition to the rates, (N - 1, nx, nx).
        next_shapes: $P_{k+1}$, (N - 1, nx, nx).
        amplitudes: largest additions, (nx,), unit of the state per second.

    Returns:
        $\beta$, (N - 1,).

    Raises:
        ValueError: if a shape is not positive definite or the lengths do not fit.
    """
    return np.array(
        [
            _spectral_norm(cholesky_factor(shape, f"P of slice {k + 2}").T @ response * amplitudes) ** 2 / 2
            for k, (response, shape) in enumerate(zip(responses, next_shapes, strict=True))
        ]
    )


def _recursion(grow, transitions, responses, shapes, initial_level):
    """Levels of the slices, where `grow` maps (sqrt(rho) A, B) to the next level."""
    levels = [float(initial_level)]
    for k, (across, response) in enumerate(zip(transitions, responses, strict=True)):
        a, b = whitened_step(across, response, shapes[k], shapes[k + 1])
        levels.append(float(grow(np.sqrt(levels[-1]) * a, b)))
    if len(levels) != len(shapes):
        raise ValueError(f"{len(shapes)} shapes need {len(shapes) - 1} steps between them, not {len(levels) - 1}")
    return np.array(levels)


def _largest_image(a, b):
    """The largest |A y + B w|^2 over the two unit spheres, from above."""
    from scipy.optimize import minimize_scalar

    first, second = a @ a.T, b @ b.T
    if not second.any():
        return np.linalg.eigvalsh(first)[-1]
    if not first.any():
        return np.linalg.eigvalsh(second)[-1]

    def bound(log_ratio):
        return np.linalg.eigvalsh(first * (1 + np.exp(log_ratio)) + second * (1 + np.exp(-log_ratio)))[-1]

    # Convex, infinite on both sides, and often with a kink at its minimum: the tolerance must be on the argument.
    start = np.log(np.linalg.norm(b, 2) / np.linalg.norm(a, 2))
    return minimize_scalar(bound, bracket=(start - 1, start + 1), method="brent", options={"xtol": 1e-13}).fun


def _spectral_norm(matrix):
    return np.linalg.norm(matrix, 2) if matrix.size else 0.0


def _inverse(matrix, name):
    """Symmetric inverse of a positive definite matrix, by its Cholesky factor."""
    inverse_factor = np.linalg.inv(cholesky_factor(matrix, name))
    return inverse_factor.T @ inverse_factor
