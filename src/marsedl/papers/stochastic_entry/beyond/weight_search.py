"""The paper's own route to Problem 1 (stochastic entry guidance): a search over the weights of an LQG problem."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import (
    checked,
    cost_of,
    limit_ratios,
    lqg_gains,
    noise_floor,
    open_loop_cost,
    variances,
)
from marsedl.summaries import summary

__all__ = ["WeightSearch", "bryson_weights", "solve_over_weights"]

ACCEPTED_EXCESS = 1e-3  # over a limit, relative, with which the end of a search still counts as a solution


class WeightSearch(NamedTuple):
    """End of the search over LQG weights; it may have failed."""

    gain: np.ndarray  # K_k, (N, n)
    cost: float
    worst_ratio: float  # largest standard deviation over its limit
    evaluations: int  # Riccati and covariance sweeps
    success: bool  # the optimizer converged and no limit is exceeded by more than 0.1 %
    status: str  # the optimizer's message

    __repr__ = summary


def bryson_weights(problem):
    """Weights by Bryson's rule: every variance divided by its squared limit, that of the objective by its noise floor.

    Args:
        problem: `ChanceConstrainedProblem`; without a noise floor the open-loop value of its objective stands for it.

    Returns:
        Q (n, n) and R (N,).
    """
    directions = problem.final_directions
    objective_weight = np.outer(problem.objective, problem.objective)
    final_weight = directions.T @ (problem.final_limits[:, np.newaxis] ** -2 * directions)
    return objective_weight / _cost_unit(problem) + final_weight, problem.control_limits**-2


def solve_over_weights(problem, start=None):
    """Search for the LQG weights that solve Problem 1 by sequential quadratic programming (Corollary III.2).

    Unknowns: Q = T D T' for states divided by `state_scale`, T unit lower triangular with plain entries, D = 10^q
    diagonal, which are n (n + 1) / 2 numbers, and log10 R_k where B_k != 0. Gains follow from Eq. 55, derivatives from
    forward differences. The search is not convex: from unlucky starts it ends far from the optimum, or outside the
    limits.

    Args:
        problem: `ChanceConstrainedProblem` of some dozens of intervals.
        start: Q (n, n) and R (N,) to begin with; `bryson_weights` without it.

    Returns:
        `WeightSearch`: the gains at which the search ended, whether it succeeded or not.

    Raises:
        ValueError: as `lqg_dual.solve`.
    """
    from scipy.optimize import minimize

    problem = checked(problem)
    system, scale = problem.system, problem.state_scale
    intervals, n, _ = system.control.shape
    free, lower = system.control.any(axis=(1, 2)), np.tril_indices(n, -1)
    unit = _cost_unit(problem)
    start = bryson_weights(problem) if start is None else start
    evaluations = 0

    def weights(unknown):
        factor, control_weight = np.eye(n), np.ones(intervals)
        factor[lower] = unknown[n : n + len(lower[0])]
        control_weight[free] = 10 ** unknown[n + len(lower[0]) :]
        return (factor * 10 ** unknown[:n]) @ factor.T / np.outer(scale, scale), control_weight

    def evaluate(unknown):
        nonlocal evaluations
        evaluations += 1
        gain, _ = lqg_gains(system, *weights(unknown))
        covariance, control_variance = variances(problem, gain)
        cost = cost_of(problem, covariance[-1], control_variance)
        return gain, cost, np.concatenate(limit_ratios(problem, covariance[-1], control_variance))

    # The optimizer asks for the cost, the limits and their derivatives one after the other at the same point.
    @lru_cache(maxsize=2)
    def outputs(key):
        _, cost, ratios = evaluate(np.frombuffer(key))
        return np.concatenate([[cost / unit], 1 - ratios])

    @lru_cache(maxsize=2)
    def derivatives(key):
        unknown, base = np.frombuffer(key), outputs(key)
        steps = np.sqrt(np.finfo(float).eps) * np.maximum(np.abs(unknown), 1)
        perturbed = [outputs((unknown + row).tobytes()) for row in np.diag(steps)]
        # SciPy 1.17's SLSQP misreads a Jacobian that is not in C order.
        return np.ascontiguousarray((np.array(perturbed) - base).T / steps)

    weight, control_weight = np.asarray(start[0]) * np.outer(scale, scale), np.asarray(start[1], dtype=float)
    # A singular start has no logarithm.
    triangular = np.linalg.cholesky(weight + 1e-9 * np.trace(weight) * np.eye(n))
    root = np.diag(triangular)
    unknown = np.concatenate([2 * np.log10(root), (triangular / root)[lower], np.log10(control_weight[free])])
    result = minimize(
        lambda unknown: outputs(unknown.tobytes())[0],
        unknown,
        jac=lambda unknown: derivatives(unknown.tobytes())[0],
        constraints={
            "type": "ineq",
            "fun": lambda unknown: outputs(unknown.tobytes())[1:],
            "jac": lambda unknown: derivatives(unknown.tobytes())[1:],
        },
        # Wide enough for every reasonable weight, and without overflow.
        bounds=[(entry - 15, entry + 15) for entry in unknown],
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-7},
    )
    gain, cost, ratios = evaluate(result.x)
    worst = float(np.sqrt(ratios.max()))
    success = bool(result.success) and worst <= 1 + ACCEPTED_EXCESS
    return WeightSearch(gain, cost, worst, evaluations, success, str(result.message))


def _cost_unit(problem):
    """The noise floor of the objective, or its open-loop value where there is no floor."""
    objective_weight = np.outer(problem.objective, problem.objective)
    return noise_floor(problem.system, problem.objective) or open_loop_cost(problem, objective_weight)
