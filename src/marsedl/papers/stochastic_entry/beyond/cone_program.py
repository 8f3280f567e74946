"""Problem 1 (stochastic entry guidance) as a semidefinite program, which knows nothing of a Riccati equation."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.conic import optimum
from marsedl.methods.covariance_steering.lqg_dual import checked

__all__ = ["ConeProgram", "solve_cone_program"]


class ConeProgram(NamedTuple):
    """Optimum of the semidefinite program."""

    cost: float
    status: str  # of the solver
    iterations: int  # of the solver


def solve_cone_program(problem, reference):
    r"""Solve Problem 1 as a semidefinite program with Clarabel, without any Riccati equation.

        $\text{minimize} \quad a^\top P_N a + \sum_k R_k z_k \quad \text{subject to} \quad \left[ P_k, \, Y_k^\top; \;
          Y_k, \, z_k \right] \succeq 0, \quad z_k \le U_k^2,$
        $P_{k+1} = A P_k A^\top + A Y_k^\top B^\top + B Y_k A^\top + B z_k B^\top + G G^\top, \quad d_i^\top P_N d_i \le
          D_i^2$

    $Y = K P$, and $z$ bounds $K P K^\top$; the relaxation is lossless. A singular $P_0 = L L^\top$ leaves
    $Y_0 = q^\top L^\top$, $z_0 \ge q^\top q$.

    Args:
        problem: `ChanceConstrainedProblem` of some dozens of intervals.
        reference: `Solution` of the same problem, used only for units: the deviations of $P_k$, and the cost.

    Returns:
        `ConeProgram`; its status may be "optimal_inaccurate".

    Raises:
        RuntimeError: if the solver does not return an optimum.
        ValueError: as `lqg_dual.solve`.
    """
    import cvxpy

    problem = checked(problem)
    n, unit = len(problem.objective), reference.cost
    deviation = np.sqrt(np.diagonal(reference.covariance, axis1=1, axis2=2))
    scale = np.where(deviation > 0, deviation, problem.state_scale)
    rows, columns = np.triu_indices(n)
    limits = problem.control_limits

    covariance, effort, constraints = problem.initial_covariance / np.outer(scale[0], scale[0]), [], []
    for k, (transition, control, noise) in enumerate(zip(*problem.system[:3], strict=True)):
        across = transition * scale[k] / scale[k + 1][:, None]
        effect = control * limits[k] / scale[k + 1][:, None]
        after = across @ covariance @ across.T + noise / np.outer(scale[k + 1], scale[k + 1])
        if control.any():
            if k == 0:
                variances, vectors = np.linalg.eigh(covariance)
                positive = variances > 1e-14 * variances[-1]
                root = vectors[:, positive] * np.sqrt(variances[positive])
                response, variance = cvxpy.Variable((root.shape[1], 1)), cvxpy.Variable((1, 1))
                cross = root @ response
                constraints.append(cvxpy.sum_squares(response) <= variance)
            else:
                moment = cvxpy.Variable((n + 1, n + 1), PSD=True)
                constraints.append(moment[rows, columns] == covariance[rows, columns])
                covariance, cross, variance = moment[:n, :n], moment[:n, n:], moment[n:, n:]
                after = across @ covariance @ across.T + noise / np.outer(scale[k + 1], scale[k + 1])
            mixed = across @ cross @ effect.T
            after = after + mixed + mixed.T + effect @ variance @ effect.T
            constraints.append(variance <= 1)
            effort.append(problem.control_weight[k] * limits[k] ** 2 / unit * variance[0, 0])
        covariance = after
    objective = problem.objective * scale[-1] / np.sqrt(unit)
    directions = problem.final_directions * scale[-1] / problem.final_limits[:, None]
    constraints += [direction @ covariance @ direction <= 1 for direction in directions]
    program = cvxpy.Problem(cvxpy.Minimize(objective @ covariance @ objective + sum(effort)), constraints)
    what = f"semidefinite program of {len(limits)} intervals"
    outcome = optimum(program, what, accept_inaccurate=True)
    return ConeProgram(float(program.value * unit), outcome.status, outcome.iterations)
