"""The covariance steering program in the unknown of the paper, L = K (I - B K)^-1 (random field, Eqs. 35 to 56).

Written constraint by constraint as the paper prints it, with S^1/2 by eigenvalues. It is slow and meant as an oracle:
the root of S is not causal and can be ill-conditioned, and where P_0 = 0 the first block column of L multiplies zero.
"""

import numpy as np

from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.steering_program import stacked

__all__ = ["feedback_gain", "history_program"]


def feedback_gain(control, history):
    """K = L (I + B L)^-1 (random field, Eq. 37).

    Args:
        control: B of the stacked system, ((N + 1) n, N m).
        history: L, block lower triangular, (N m, (N + 1) n).

    Returns:
        K, (N m, (N + 1) n), with exact zeros above its block diagonal.
    """
    from scipy.linalg import solve_triangular

    # B L is strictly lower triangular.
    matrix = np.eye(len(control)) + control @ history
    return solve_triangular(matrix.T, history.T, lower=False, unit_diagonal=True).T


def history_program(program, cost_unit):
    """Build Eq. 56 (random field) in V and L.

    Args:
        program: `SteeringProgram`.
        cost_unit: the objective is divided by it.

    Returns:
        The problem of CVXPY, its expressions of V (N m,) and L (N m, (N + 1) n), and S ((N + 1) n, (N + 1) n).
    """
    import cvxpy
    from scipy.sparse import csr_array

    system, blocks = program.system, stacked(program.system)
    intervals, n, m = system.control.shape
    covariance = blocks.transition @ system.initial_covariance @ blocks.transition.T
    covariance += blocks.disturbance @ system.disturbance_covariance @ blocks.disturbance.T
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T

    free = np.kron(np.tri(intervals, intervals + 1, dtype=bool), np.ones((m, n), dtype=bool))
    places = np.flatnonzero(free)
    placed = csr_array((np.ones(places.size), (places, np.arange(places.size))), shape=(free.size, places.size))
    history = cvxpy.reshape(placed @ cvxpy.Variable(places.size), free.shape, order="C")
    mean_control = cvxpy.Variable(intervals * m)
    state = (np.eye(len(covariance)) + blocks.control @ history) @ root  # (I + B L) S^1/2
    control = history @ root
    mean = blocks.transition @ system.initial_mean + blocks.control @ mean_control + blocks.affine
    x, u = (
        [slice(k * n, (k + 1) * n) for k in range(intervals + 1)],
        [slice(k * m, (k + 1) * m) for k in range(intervals)],
    )

    cost = 0.0
    for k in range(intervals):
        state_root, control_root = _root(program.state_weight[k]), _root(program.control_weight[k])
        cost += cvxpy.sum_squares(state_root @ state[x[k]]) + cvxpy.sum_squares(control_root @ control[u[k]])
        cost += cvxpy.sum_squares(_root(program.mean_control_weight[k]) @ mean_control[u[k]])
        if program.desired_state is not None:
            cost += cvxpy.sum_squares(state_root @ (mean[x[k]] - program.desired_state[k]))
    if program.percentile_weight > 0:
        cost += program.percentile_weight * cvxpy.maximum(
            *(
                item.offset
                + item.gradient @ mean[x[-1]]
                + upper_quantile(item.probability) * cvxpy.norm(item.gradient @ state[x[-1]])
                for item in (*program.percentiles, program.percentiles[0])
            )
        )

    constraints = []
    for item in program.state_constraints:
        deviation = cvxpy.norm(item.normal @ state[x[item.step]])
        middle = item.normal @ mean[x[item.step]]
        constraints.append(upper_quantile(item.probability) * deviation + middle <= item.bound)
    for item in program.control_constraints:
        deviation = cvxpy.norm(item.normal @ control[u[item.step]])
        middle = item.normal @ mean_control[u[item.step]]
        constraints.append(upper_quantile(item.probability) * deviation + middle <= item.bound)
    if program.final_mean is not None:
        known = ~np.isnan(program.final_mean)
        constraints.append(mean[x[-1]][known] == program.final_mean[known])
    if program.final_covariance is not None:
        values, vectors = np.linalg.eigh(program.final_covariance)
        constraints.append(cvxpy.sigma_max((vectors / np.sqrt(values)) @ vectors.T @ state[x[-1]]) <= 1)
    if program.control_trust is not None:
        reference = np.zeros((intervals, m)) if program.control_reference is None else program.control_reference
        for k in range(intervals):
            constraints.append(cvxpy.norm(mean_control[u[k]] - reference[k], "inf") <= program.control_trust)
    for item in program.state_trust:
        constraints.append(cvxpy.abs(item.row @ mean[x[item.step]] - item.reference) <= item.radius)
    return cvxpy.Problem(cvxpy.Minimize(cost / cost_unit), constraints), mean_control, history, covariance


def _root(weight):
    """F with F'F = Q, one row for every eigenvalue that is not zero."""
    values, vectors = np.linalg.eigh(weight)
    positive = values > 1e-14 * values[-1]
    return np.sqrt(values[positive])[:, None] * vectors[:, positive].T if positive.any() else np.zeros((1, len(weight)))
