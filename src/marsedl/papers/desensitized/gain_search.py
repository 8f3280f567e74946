"""Searches for gains that this paper compares with its own: by size, and by errors that are flown (Secs. 4.1 to 4.3).

The smallest gains that null the errors are `methods.sensitivity_gains.minimum_norm`.
"""

from typing import NamedTuple

import numpy as np

from marsedl.methods.sensitivity_gains import GainDesign, final_errors, linearized
from marsedl.summaries import summary

__all__ = ["Tuning", "rank", "regularized", "tune"]


class Tuning(NamedTuple):
    """Tuned gains, the simulated errors that they leave, and how the search for them ended."""

    k: np.ndarray  # of the shape of the start
    errors: np.ndarray  # simulated errors, (r,)
    iterations: int
    converged: bool
    reason: str  # why the search ended, in a sentence

    __repr__ = summary


def regularized(problem, weights, start=0.0, tolerance=1e-10, iterations=500):
    """Gains of min |r|^2 + w |k|^2 for a sequence of weights, each search from the gains of the one before.

    Errors that cannot all vanish, for instance of several columns at once, are traded against the size of the gains.

    Args:
        problem: `GainProblem`.
        weights: w > 0, usually falling.
        start: first k of the first weight, (m, f), or one number for all.
        tolerance: relative change of k that ends a search.
        iterations: most trial steps of a search.

    Returns:
        List of `GainDesign`, one per weight; converged if the search came to an end, whatever the errors that remain.

    Raises:
        ValueError: if the errors of the start are not finite, or as `final_errors` for the start.
    """

    def errors(k):
        return final_errors(problem, k).ravel()

    def linear(k):
        return linearized(problem, k)

    k = np.broadcast_to(np.asarray(start, dtype=float), problem.gain_shape).ravel()
    if not np.isfinite(errors(k)).all():
        raise ValueError("start: the errors are not finite, for the closed loop is unstable")
    designs = []
    for weight in weights:
        found = _least_squares(errors, linear, k, weight, tolerance, iterations)
        k = found.k
        design = k.reshape(problem.gain_shape), final_errors(problem, k)
        designs.append(GainDesign(*design, found.iterations, found.converged, found.reason))
    return designs


def tune(simulated_errors, start, difference=1e-5, tolerance=1e-8, iterations=100):
    """Gains of least squares of simulated errors, by central differences of the simulation.

    Trial steps whose errors are not finite are shortened. What is found is a local minimum, which depends on the start.

    Args:
        simulated_errors: function of k that returns the errors of a simulation under these gains, (r,).
        start: first k, of any shape.
        difference: half the distance of the differences; the cube root of the relative rounding of the errors is best.
        tolerance: relative change of k that ends the search.
        iterations: most trial steps.

    Returns:
        `Tuning`.

    Raises:
        ValueError: if the start or its errors are not finite.
    """
    start = np.asarray(start, dtype=float)
    if not np.isfinite(start).all():
        raise ValueError("start has entries that are not finite")

    def errors(k):
        return np.asarray(simulated_errors(k.reshape(start.shape)), dtype=float)

    def linear(k):
        apart = difference * np.eye(k.size)
        errors_around = np.array([errors(point) for point in np.concatenate([[k], k + apart, k - apart])])
        return errors_around[0], (errors_around[1 : k.size + 1] - errors_around[k.size + 1 :]).T / (2 * difference)

    first = errors(start.ravel())
    if first.ndim != 1 or not np.isfinite(first).all():
        raise ValueError("simulated_errors must return a vector, and a finite one at the start")
    tuning = _least_squares(errors, linear, start.ravel(), 0.0, tolerance, iterations)
    return tuning._replace(k=tuning.k.reshape(start.shape))


def rank(candidates, simulated_errors):
    """Order candidates by the norm of their simulated errors; those with errors that are not finite come last.

    The linear sensitivity does not tell gains apart that all null it; the size of their linear domain does.

    Args:
        candidates: sequence of gains.
        simulated_errors: function of one candidate that returns its errors.

    Returns:
        Indices of the candidates, best first; candidates of equal norm keep their order.
    """
    norms = np.full(len(candidates), np.inf)
    for i, candidate in enumerate(candidates):
        errors = np.asarray(simulated_errors(candidate), dtype=float)
        if np.isfinite(errors).all():
            norms[i] = np.linalg.norm(errors)
    return np.argsort(norms, kind="stable")


class _NotFiniteError(Exception):
    """Errors beside a point of the search are not finite, so that it cannot be linearised there."""


def _least_squares(errors, linear, start, weight, tolerance, iterations):
    """Minimise |r|^2 + w |k|^2 from errors(k) = r and linear(k) = (r, dr/dk); the gains are one vector."""
    from scipy.optimize import least_squares

    penalty = np.sqrt(weight)
    points = [start.copy()]

    def derivative(k):
        slope = linear(k)[1]
        if not np.isfinite(slope).all():
            raise _NotFiniteError
        if (k != points[-1]).any():
            points.append(k.copy())
        return np.concatenate([slope, penalty * np.eye(k.size)])

    try:
        result = least_squares(
            lambda k: np.concatenate([errors(k), penalty * k]),
            start,
            jac=derivative,
            xtol=tolerance,
            ftol=None,
            gtol=None,
            max_nfev=iterations,
        )
    except _NotFiniteError:
        converged, reason = False, f"errors beside the gains of step {len(points) - 1} are not finite"
    else:
        converged = result.status > 0
        reason = (
            f"the gains change by less than {tolerance:.3g} of their norm"
            if converged
            else f"the gains still change after {iterations} trial steps"
        )
    return Tuning(points[-1], errors(points[-1]), len(points) - 1, converged, reason)
