"""Largest value of a smooth function on a product of unit spheres and balls: many starts, Newton steps on the best.

What is found is the value at a point that can be shown, so it bounds the largest value from below: it tells how tight a
bound from above is, and it shows where one fails. It never proves a bound.
"""

import numpy as np

from marsedl.methods.checks import require_values

__all__ = ["maximize"]

_FRACTIONS = 2.0 ** -np.arange(10)  # of the Newton step, tried all at once
_DIFFERENCE = 2e-4  # step of the differences: rounding of second differences and truncation of first ones are near 1e-8


def maximize(function, dimensions, starts, full_ball=None, polished=10, iterations=12):
    r"""Local maxima of a function on a product of unit spheres and balls by multi-start Newton ascent, and their best.

        $d = \sum_i u_i \frac{u_i^\top g}{\max\left( \left| \lambda_i \right|, \delta \right)}, \quad H = P \left( D^2 f
          - r \right) P = \sum_i \lambda_i u_i u_i^\top$

    $g = P \, Df$ and $H$ are gradient and Hessian along the set ($P$ projects on its tangent space, $r$ holds
    $y^\top Df$ for each sphere and for each ball on whose boundary the function still rises outwards); $d$ rises at
    saddles too, and near a maximum it is Newton's step. Of several fractions of $d$, taken back to the set, the best is
    kept if it is better than the point. Derivatives are central differences, all points of all starts in one call.

    Args:
        function: maps points (m, v) to values (m,), defined near the set too.
        dimensions: of the blocks of variables, with sum v; each block lies on its unit sphere or in its unit ball.
        starts: points of the set from which the best are taken, most often random ones, (count, v).
        full_ball: True for each block that may lie inside its ball; none by default.
        polished: starts that are ascended.
        iterations: Newton steps, at most.

    Returns:
        (best value, best point (v,)).

    Raises:
        ValueError: if blocks, flags, starts or counts make no sense, or the function is not finite at a start.
    """
    blocks, balls = _blocks(dimensions, full_ball)
    points = np.asarray(starts, dtype=float)
    if points.ndim != 2 or points.shape[1] != blocks[-1].stop:
        raise ValueError(f"starts must be rows of {blocks[-1].stop} coordinates, got shape {points.shape}")
    count = len(points)
    if not 1 <= polished <= count or iterations < 0:
        raise ValueError(f"expected 1 <= polished <= starts and iterations >= 0: {polished}, {count}, {iterations}")
    values = np.asarray(function(points), dtype=float)
    require_values("the function", values, count)
    best = np.argsort(-values, kind="stable")[:polished]
    points, values = points[best], values[best]
    for _ in range(iterations):
        steps = _newton_steps(function, points, blocks, balls)
        trials = _retract(points[:, None] + _FRACTIONS[:, None] * steps[:, None], blocks, balls)
        trial_values = np.asarray(function(trials.reshape(-1, points.shape[1]))).reshape(trials.shape[:2])
        trial_values = np.where(np.isfinite(trial_values), trial_values, -np.inf)
        best_trials = np.arange(polished), trial_values.argmax(axis=1)
        better = trial_values[best_trials] > values
        if not better.any():
            break
        points = np.where(better[:, None], trials[best_trials], points)
        values = np.where(better, trial_values[best_trials], values)
    return float(values.max()), points[values.argmax()]


def _blocks(dimensions, full_ball):
    """Slices of the blocks, and which of them are balls."""
    dimensions = tuple(dimensions)
    balls = (False,) * len(dimensions) if full_ball is None else tuple(bool(ball) for ball in full_ball)
    if not dimensions or min(dimensions) < 1 or len(balls) != len(dimensions):
        raise ValueError(f"expected positive dimensions and one flag for each: {dimensions}, {balls}")
    ends = np.cumsum(dimensions)
    return [slice(end - size, end) for size, end in zip(dimensions, ends, strict=True)], balls


def _retract(points, blocks, balls):
    """Points (..., v) taken back to the set along the ray from the centre of each block."""
    points = points.copy()
    for block, ball in zip(blocks, balls, strict=True):
        length = np.linalg.norm(points[..., block], axis=-1, keepdims=True)
        points[..., block] /= np.maximum(length, 1.0) if ball else length
    return points


def _newton_steps(function, points, blocks, balls):
    """Rising tangent steps (m, v) from points of the set (m, v)."""
    gradient, hessian = _derivatives(function, points)
    tangent = np.zeros_like(hessian)
    for block, ball in zip(blocks, balls, strict=True):
        y = points[:, block]
        outward = np.einsum("mi,mi->m", y, gradient[:, block])
        bound = np.full(len(y), True)
        if ball:
            bound = (np.linalg.norm(y, axis=1) > 1 - 1e-9) & (outward > 0)
        identity = np.eye(y.shape[1])
        tangent[:, block, block] = identity - np.where(bound, 1.0, 0.0)[:, None, None] * y[:, :, None] * y[:, None, :]
        hessian[:, block, block] -= np.where(bound, outward, 0.0)[:, None, None] * identity
    gradient = np.einsum("mij,mj->mi", tangent, gradient)
    curvature, axes = np.linalg.eigh(tangent @ hessian @ tangent)
    slope = np.einsum("mji,mj->mi", axes, gradient)
    # A flat function has no Newton step: the floor leaves one that the limit of the length can shorten.
    floor = 1e-6 * (np.abs(curvature).max(axis=1) + np.linalg.norm(slope, axis=1))[:, None] + np.finfo(float).tiny
    steps = np.einsum("mij,mj->mi", axes, slope / np.maximum(np.abs(curvature), floor))
    # The rounding of the slope across the set is divided by the floor: it must not become a step into the ball.
    steps = np.einsum("mij,mj->mi", tangent, steps)
    length = np.linalg.norm(steps, axis=1, keepdims=True)
    return steps / np.maximum(length, 1.0)


def _derivatives(function, points):
    """Gradients (m, v) and Hessians (m, v, v) by central differences: v^2 + v + 1 values for each point."""
    count, size = points.shape
    unit = _DIFFERENCE * np.eye(size)
    i, j = np.triu_indices(size, 1)
    offsets = np.concatenate([np.zeros((1, size)), unit, -unit, unit[i] + unit[j], -unit[i] - unit[j]])
    values = np.asarray(function((points[:, None] + offsets).reshape(-1, size))).reshape(count, -1)
    centre, ahead, behind, both_ahead, both_behind = np.split(values, np.cumsum([1, size, size, i.size]), axis=1)
    gradient = (ahead - behind) / (2 * _DIFFERENCE)
    single = ahead + behind - 2 * centre
    hessian = np.zeros((count, size, size))
    hessian[:, np.arange(size), np.arange(size)] = single
    hessian[:, i, j] = hessian[:, j, i] = (both_ahead + both_behind - 2 * centre - single[:, i] - single[:, j]) / 2
    return gradient, hessian / _DIFFERENCE**2
