"""Independent optimality certificates for covariance steering: convex programs with the control held over intervals.

A held control is admissible in continuous time, so its least cost bounds the cost of the closed form from above, and it
converges to it as the intervals shrink. Neither program uses the Riccati equation.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from marsedl.methods.conic import optimum
from marsedl.summaries import summary

__all__ = ["HeldCovariance", "HeldMean", "covariance_certificate", "mean_certificate"]


class HeldMean(NamedTuple):
    """Least-effort mean control that is constant on each of N intervals."""

    time: np.ndarray  # bounds of the intervals, (N + 1,), s
    control: np.ndarray  # (N, m)
    mean: np.ndarray  # at the bounds, (N + 1, n)
    cost: float  # int |u|^2 dt, control unit^2 s

    __repr__ = summary


class HeldCovariance(NamedTuple):
    """Least-effort covariance steering with a control that is constant on each of N intervals."""

    time: np.ndarray  # bounds of the intervals, (N + 1,), s
    covariance: np.ndarray  # at the bounds, (N + 1, n, n)
    gain: np.ndarray  # u = -gain (x - mean) at the beginning of each interval, (N, m, n)
    cost: float  # int E|u - E u|^2 dt, control unit^2 s
    lossless_gap: float  # largest trace of E[uu'] - K Sigma K', relative to the largest trace of E[uu']: 0 if tight
    status: str  # of the solver
    iterations: int  # of the solver

    __repr__ = summary


def mean_certificate(problem, intervals):
    r"""Steer the mean with a held control: a least-norm problem of linear algebra.

        $\text{minimize} \quad \sum_k h_k \left| u_k \right|^2 \quad \text{subject to} \quad \sum_k W_k u_k = \Phi(0,T)
          \left( x_T - \tilde{c}(T) \right) - x_0$
        $W_k = \int_{\text{interval } k} \Phi(0,s) B(s) \, ds$

    Args:
        problem: `SteeringProblem`.
        intervals: N, intervals of equal length.

    Returns:
        `HeldMean`; its cost exceeds the mean cost of `steer` by a fraction that falls like $N^{-2}$.

    Raises:
        ValueError: if N < 1, or if N held controls cannot reach the target.
    """
    bounds, transition, effect, _ = _held_model(problem, intervals)
    n, m = problem.control_matrix.shape[1:]
    affine = CubicSpline(problem.time, problem.affine_response)(bounds)
    root = np.sqrt(np.diff(bounds))
    target = np.linalg.solve(transition[-1], problem.final_mean - affine[-1]) - problem.initial_mean
    # Unknowns sqrt(h) u; rows scaled, as positions and velocities differ by powers of ten.
    matrix = (effect / root[:, None, None]).transpose(1, 0, 2).reshape(n, intervals * m)
    scale = np.linalg.norm(matrix, axis=1)
    solution, _, rank, _ = np.linalg.lstsq(matrix / scale[:, None], target / scale, rcond=None)
    if rank < n:
        raise ValueError(f"{intervals} held controls cannot steer {n} states to their target")
    control = solution.reshape(intervals, m) / root[:, None]
    displacement = np.vstack([np.zeros(n), np.cumsum(np.einsum("kij,kj->ki", effect, control), axis=0)])
    mean = np.einsum("kij,kj->ki", transition, problem.initial_mean + displacement) + affine
    return HeldMean(time=bounds, control=control, mean=mean, cost=float(solution @ solution))


def covariance_certificate(problem, intervals):
    r"""Steer the covariance with a held linear feedback: a semidefinite program whose relaxation is lossless.

        $\text{minimize} \quad \sum_k h_k \, \text{tr} \, Y_k \quad \text{subject to} \quad Z_k = \left[ \Sigma_k, \,
          U_k^\top; \; U_k, \, Y_k \right] \succeq 0,$
        $\Sigma_{k+1} = \left[ A_k, \, B_k \right] Z_k \left[ A_k, \, B_k \right]^\top + W_k, \quad \Sigma_0 = S_0,
          \quad \Sigma_N = S_T$

    $U = -K \Sigma$ and $Y$ stands for $K \Sigma K^\top$; $(A_k, B_k, W_k)$ is the exact discretization of dynamics and
    noise. Solved with Clarabel in units in which states and controls are of order one.

    Args:
        problem: `SteeringProblem`.
        intervals: N, intervals of equal length.

    Returns:
        `HeldCovariance`; its cost exceeds the covariance cost of `steer` by a fraction that falls like $N^{-1}$.

    Raises:
        ValueError: if N < 1.
        RuntimeError: if the solver's status is not "optimal" (also if N intervals cannot reach the target).
    """
    import cvxpy

    bounds, transition, effect, gramian = _held_model(problem, intervals)
    n, m = problem.control_matrix.shape[1:]
    step = np.diff(bounds)
    later = transition[1:]
    drift = later @ np.linalg.inv(transition[:-1])
    noise = problem.noise_density**2 * later @ np.diff(gramian, axis=0) @ later.swapaxes(1, 2)

    state_unit = np.sqrt((np.diag(problem.initial_covariance) + np.diag(problem.final_covariance)) / 2)
    # The control that a unit of state needs over the whole interval.
    control_unit = 1 / np.linalg.norm(np.sum(later @ effect, axis=0) / state_unit[:, None], axis=0).max()
    both = state_unit[:, None] * state_unit
    model = np.concatenate([drift * state_unit, later @ effect * control_unit], axis=2) / state_unit[:, None]

    moments = [cvxpy.Variable((n + m, n + m), PSD=True) for _ in range(intervals)]
    constraints = [moments[0][:n, :n] == problem.initial_covariance / both]
    for k in range(intervals):
        after = moments[k + 1][:n, :n] if k + 1 < intervals else problem.final_covariance / both
        constraints.append(model[k] @ moments[k] @ model[k].T + noise[k] / both == after)
    cost = sum(step[k] * cvxpy.trace(moments[k][n:, n:]) for k in range(intervals))
    program = cvxpy.Problem(cvxpy.Minimize(cost), constraints)
    iterations = optimum(program, f"covariance program with {intervals} intervals").iterations

    value = np.array([moment.value for moment in moments])
    covariance, cross, effort = value[:, :n, :n], value[:, n:, :n], value[:, n:, n:]
    feedback = np.linalg.solve(covariance, cross.swapaxes(1, 2)).swapaxes(1, 2)  # of the scaled system
    gap = np.trace(effort - feedback @ cross.swapaxes(1, 2), axis1=1, axis2=2)
    return HeldCovariance(
        time=bounds,
        covariance=np.concatenate([covariance * both, problem.final_covariance[None]]),
        gain=-feedback * control_unit / state_unit,
        cost=float(program.value * control_unit**2),
        lossless_gap=float(np.abs(gap).max() / np.trace(effort, axis1=1, axis2=2).max()),
        status=program.status,
        iterations=iterations,
    )


def _held_model(problem, intervals):
    """Bounds of the intervals, Phi(t,0) and N(t) at the bounds, and int Phi(0,s) B(s) ds over every interval."""
    if intervals < 1:
        raise ValueError(f"intervals must be at least 1, not {intervals}")
    time = problem.time
    bounds = np.linspace(time[0], time[-1], intervals + 1)
    control_effect = CubicSpline(time, np.linalg.solve(problem.transition, problem.control_matrix)).antiderivative()
    transition = CubicSpline(time, problem.transition)(bounds)
    gramian = CubicSpline(time, problem.gramian)(bounds)
    return bounds, transition, np.diff(control_effect(bounds), axis=0), gramian
