"""Chance-constrained linear feedback of least terminal variance (stochastic entry guidance, Problem 1), certified.

Problem 1 is convex in (P_k, K_k P_k). For fixed multipliers its Lagrangian is the cost of an unconstrained LQG problem
(Theorem III.1), so a Riccati sweep evaluates the Lagrange dual, a covariance sweep its gradient, and the dual value
certifies the gains that it finds.

The control is scalar. States may have any unit: with a scalar control the Riccati and covariance sweeps consist of
products, sums of like units and one division, so scaling the states changes nothing but rounding; the multipliers are
updated by factors, so neither does scaling controls or cost.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from marsedl.methods.checks import require_array, require_positive, require_shape
from marsedl.methods.lincov import propagate
from marsedl.methods.linear_system import LinearSystem
from marsedl.summaries import summary

__all__ = [
    "ChanceConstrainedProblem",
    "InfeasibleProblem",
    "Solution",
    "checked",
    "cost_of",
    "limit_ratios",
    "lqg_gains",
    "lqg_gains_as_printed",
    "noise_floor",
    "open_loop_cost",
    "solve",
    "variances",
]

# Sweeps before the limits on the final state are questioned, and before the ascent is given up.
_SWEEPS_BEFORE_DOUBT, _SWEEPS = 400, 50_000
# Exponents of the multiplicative update, first of the final state and of the controls, and how they adapt.
_FINAL_POWER, _CONTROL_POWER, _GROWTH, _SHRINKAGE, _POWER_RANGE = 0.7, 0.5, 1.1, 0.5, (0.1, 1e3)
# Rounding of a cost, relative: where the noise floor is nearly all of it, nothing below can be resolved.
_ROUNDING = 1e-13
# Longest step of the logarithm of a multiplier, of the final state and of the controls.
_FINAL_STEP, _CONTROL_STEP = 0.5, 0.8
# Terms that final limits may add to the Lagrangian, over the cost, before they are taken to have no bound.
_DIVERGED = 1e12
# Excess of a variance over its limit, relative, from which on the limit is questioned.
_ACCEPTED_EXCESS = 1e-3


class InfeasibleProblem(ValueError):
    """No linear feedback meets all limits; the message names the limit and the least that can be attained."""


class ChanceConstrainedProblem(NamedTuple):
    """Minimize Var(a'x_N) + sum_k R_k Var(u_k), u_k = K_k x_k, with std(d_i'x_N) <= D_i and std(u_k) <= U_k."""

    system: LinearSystem  # N intervals, n states, one control; deviations, so that c_k does not count
    initial_covariance: np.ndarray  # P_0, (n, n)
    objective: np.ndarray  # a, (n,)
    control_weight: np.ndarray  # R_k > 0, unit of Var(a'x) per control unit^2, (N,)
    final_directions: np.ndarray  # d_i, (m, n); m may be 0
    final_limits: np.ndarray  # D_i, standard deviations, (m,)
    control_limits: np.ndarray  # U_k, standard deviations, (N,)
    state_scale: np.ndarray  # size of a typical deviation of every state, (n,)

    __repr__ = summary


class Solution(NamedTuple):
    """Optimal feedback with its certificate; multipliers are those of variances, in the units of the problem."""

    gain: np.ndarray  # K_k, (N, n)
    covariance: np.ndarray  # P_k, (N + 1, n, n)
    control_variance: np.ndarray  # Var(u_k), (N,)
    final_multipliers: np.ndarray  # of Var(d_i'x_N) <= D_i^2, (m,)
    control_multipliers: np.ndarray  # of Var(u_k) <= U_k^2, (N,)
    cost: float  # Var(a'x_N) + sum_k R_k Var(u_k)
    dual_value: float  # a lower bound of the cost of any feedback that meets the limits
    gap: float  # (cost - dual_value) / cost
    gap_above_floor: float  # (cost - dual_value) / (cost - noise_floor)
    noise_floor: float  # part of the cost that no feedback can change
    final_ratio: np.ndarray  # std(d_i'x_N) / D_i, (m,)
    control_ratio: np.ndarray  # std(u_k) / U_k, (N,)
    complementarity: float  # largest |multiplier * (limit^2 - variance)|, relative to the cost
    iterations: int  # Riccati and covariance sweeps
    status: str  # "optimal", or a sentence that says what was not reached

    __repr__ = summary


def lqg_gains(system, final_weight, control_weight):
    r"""Feedback of least quadratic cost (stochastic entry guidance, Problem 2 and Eq. 55).

        $\text{minimize} \quad \text{tr}(Q P_N) + \sum_k R_k \, \text{Var}(u_k)$
        $K_k = -\left( B^\top S B + R_k \right)^{-1} B^\top S A, \quad S_N = Q$
        $S_k = \left( A + B K_k \right)^\top S_{k+1} \left( A + B K_k \right) + R_k K_k^\top K_k$

    Eq. 55a lacks the inverse. The sum of squares (Joseph form) equals Eq. 55b, but keeps $S$ positive semidefinite in
    rounded arithmetic.

    Args:
        system: `LinearSystem`.
        final_weight: Q, symmetric positive semidefinite, (n, n).
        control_weight: $R_k$, positive, (N,).

    Returns:
        Gains $K_k$ (N, n), zero where $B_k = 0$, and value matrices $S_k$ (N + 1, n, n).

    Raises:
        ValueError: if shapes do not fit.
    """
    final_weight, control_weight = _weights(system, final_weight, control_weight)
    transition, control = (np.ascontiguousarray(field, dtype=float) for field in system[:2])
    return _riccati(transition, control[:, :, 0], final_weight, control_weight)


def lqg_gains_as_printed(system, final_weight, control_weight):
    r"""The recursion of Eq. 55 (stochastic entry guidance) literally, without the inverse: it grows beyond all bounds.

        $K_k = -\left( B^\top S B + R_k \right) B^\top S A, \quad S_k = A^\top S A - K_k^\top \left( R_k + B^\top S B
          \right) K_k, \quad S_N = Q$

    Args:
        system: `LinearSystem`.
        final_weight: Q, (n, n).
        control_weight: $R_k$, (N,).

    Returns:
        Gains (N, n) and matrices $S_k$ (N + 1, n, n); infinite or nan from where they exceed the range of numbers.

    Raises:
        ValueError: if shapes do not fit.
    """
    final_weight, control_weight = _weights(system, final_weight, control_weight)
    intervals, n, _ = system.control.shape
    gain, value = np.zeros((intervals, n)), np.empty((intervals + 1, n, n))
    value[-1] = final_weight
    with np.errstate(all="ignore"):
        for k in range(intervals - 1, -1, -1):
            transition, control, after = system.transition[k], system.control[k, :, 0], value[k + 1]
            bracket = control @ after @ control + control_weight[k]
            gain[k] = -bracket * (control @ after @ transition)
            value[k] = transition.T @ after @ transition - bracket * np.outer(gain[k], gain[k])
    return gain, value


def noise_floor(system, objective):
    r"""Variance of the objective from the noise of the intervals at the end on which the control has no effect.

        $\sum_k a^\top \Phi(N, k + 1) G_k G_k^\top \Phi(N, k + 1)^\top a \quad \text{over the } k
          \text{ after the last one with } B_k \ne 0$

    No feedback can lower it, so no cost of Problem 1 is smaller.

    Args:
        system: `LinearSystem`.
        objective: a, (n,).

    Returns:
        Variance in the unit of $(a^\top x)^2$; 0 if the last control has an effect.
    """
    adjoint, variance = np.array(objective, dtype=float), 0.0
    for transition, control, noise in zip(*(field[::-1] for field in system[:3]), strict=True):
        if control.any():
            break
        variance += adjoint @ noise @ adjoint
        adjoint = adjoint @ transition
    return float(variance)


def solve(problem, tolerance=1e-8):
    r"""Solve Problem 1 by its Lagrange dual (stochastic entry guidance, Theorem III.1 and Eqs. 85 to 90).

        $\text{maximize over } \xi \ge 0 \text{:} \quad \sum_k \text{tr}\left( S_{k+1} G_k G_k^\top \right) +
          \text{tr}(S_0 P_0) - \sum_i \xi_i D_i^2 - \sum_k \xi_k U_k^2$

    where $S$ solves Eq. 55 with the weights $Q = a a^\top + \sum_i \xi_i d_i d_i^\top$ and $R_k + \xi_k$, which also
    give the gains. The derivative by a multiplier is the excess of its variance; the KKT points are the fixed points of
    $\xi \leftarrow \xi \left( \text{variance} / \text{limit}^2 \right)^q$. Every multiplier has its own $q$, which
    grows while the excess keeps its sign and is halved when it changes: the ascent does not depend on units, and little
    on the size of $R_k$.

    Args:
        problem: `ChanceConstrainedProblem`.
        tolerance: largest excess of a variance over its squared limit, relative; and largest sum of
            $\left| \text{multiplier} \cdot (\text{limit}^2 - \text{variance}) \right|$, relative to the cost above the
            noise floor, or 1e-13 of the whole cost if that is larger.

    Returns:
        `Solution`; its status is "optimal" if the tolerance was reached. It may miss it where a limit equals the least
        deviation that can be attained, and no multiplier is large enough.

    Raises:
        InfeasibleProblem: if the limits on the final state cannot be met with the limits on the control.
        ValueError: if an argument has a wrong shape, is not finite or not positive, or the objective has no variance.
    """
    problem = checked(problem)
    objective_weight = np.outer(problem.objective, problem.objective)
    floor = noise_floor(problem.system, problem.objective)
    final, control, iterations, converged = _ascend(problem, objective_weight, floor, tolerance)
    gain, value = lqg_gains(
        problem.system,
        objective_weight + _spread(problem.final_directions, final),
        problem.control_weight + control,
    )
    covariance, control_variance = variances(problem, gain)
    final_square, control_square = problem.final_limits**2, problem.control_limits**2
    final_ratio, control_ratio = limit_ratios(problem, covariance[-1], control_variance)
    cost = cost_of(problem, covariance[-1], control_variance)
    dual_value = _lagrangian_value(problem, value) - final @ final_square - control @ control_square
    slack = np.concatenate([final * final_square * (1 - final_ratio), control * control_square * (1 - control_ratio)])
    return Solution(
        gain=gain,
        covariance=covariance,
        control_variance=control_variance,
        final_multipliers=final,
        control_multipliers=control,
        cost=cost,
        dual_value=float(dual_value),
        gap=(cost - dual_value) / cost,
        gap_above_floor=(cost - dual_value) / _above_floor(cost, floor),
        noise_floor=floor,
        final_ratio=np.sqrt(final_ratio),
        control_ratio=np.sqrt(control_ratio),
        complementarity=float(np.abs(slack).max() / cost),
        iterations=iterations,
        status="optimal" if converged else f"tolerance {tolerance:g} not reached in {iterations} sweeps",
    )


def _ascend(problem, base_weight, floor, tolerance):
    """Maximize the dual of the cost tr(base_weight P_N) + sum_k R_k Var(u_k), of which feedback cannot change `floor`.

    Returns:
        Multipliers (m,) and (N,), number of sweeps, and whether the tolerance was reached.
    """
    system, m, intervals = problem.system, len(problem.final_limits), len(problem.control_limits)
    square = np.concatenate([problem.final_limits, problem.control_limits]) ** 2
    free = np.concatenate([np.ones(m, bool), system.control.any(axis=(1, 2))])
    multiplier = np.where(free, 1e-3 * open_loop_cost(problem, base_weight) / square, 0.0)
    power = np.repeat([_FINAL_POWER, _CONTROL_POWER], [m, intervals])
    longest = np.repeat([_FINAL_STEP, _CONTROL_STEP], [m, intervals])
    previous, counted = np.zeros(m + intervals), np.empty(m + intervals)
    for sweep in range(1, _SWEEPS + 1):
        gain, _ = _riccati(
            system.transition,
            system.control[:, :, 0],
            base_weight + _spread(problem.final_directions, multiplier[:m]),
            problem.control_weight + multiplier[m:],
        )
        covariance, control_variance = variances(problem, gain)
        cost = np.sum(base_weight * covariance[-1]) + problem.control_weight @ control_variance
        ratio = np.concatenate(limit_ratios(problem, covariance[-1], control_variance))
        terms = multiplier[:m] * square[:m]
        worst, slack = _update(
            multiplier, ratio, square, free, problem.control_weight, cost, power, previous, longest, counted
        )
        enough = max(tolerance * _above_floor(cost, floor), _ROUNDING * cost)
        converged = bool(worst <= 1 + tolerance and slack <= enough)
        if converged or terms.max(initial=0.0) > _DIVERGED * cost:
            break
        if sweep == _SWEEPS_BEFORE_DOUBT and ratio[:m].max(initial=0.0) > 1 + _ACCEPTED_EXCESS:
            _question_limits(problem, terms)
    if m and not converged:
        _question_limits(problem, terms)
    return counted[:m], counted[m:], sweep, converged


@njit(cache=True, error_model="numpy")
def _update(multiplier, ratio, square, free, control_weight, cost, power, previous, longest, counted):
    """One multiplicative update, in place: multipliers, their exponents, and the excess of each variance.

    Fills `counted` with the multipliers before it, those without an effect being zero. Returns the largest ratio, and
    the sum of |multiplier * (limit^2 - variance)|.
    """
    m, worst, slack = len(multiplier) - len(control_weight), -np.inf, 0.0
    smallest, largest = _POWER_RANGE
    for i in range(len(multiplier)):
        # Too small to change the gains, but a multiplier can still return from here; it counts as zero.
        lowest = 1e-12 * cost / square[i] if i < m else 1e-9 * control_weight[i - m]
        lowest = lowest if free[i] else 0.0
        counted[i] = multiplier[i] if multiplier[i] > 2 * lowest else 0.0
        slack += counted[i] * square[i] * abs(1 - ratio[i])
        worst = np.maximum(worst, ratio[i])
        excess = np.log(max(ratio[i], 1e-3))
        power[i] *= _SHRINKAGE if excess * previous[i] < 0 else _GROWTH
        power[i] = min(max(power[i], smallest), largest)
        previous[i] = excess
        step = min(max(power[i] * excess, -longest[i]), longest[i])
        multiplier[i] = max(multiplier[i] * np.exp(step), lowest)
    return worst, slack


def variances(problem, gain):
    """Covariance of the states and variance of the control under a feedback (`lincov.propagate`).

    Args:
        problem: `ChanceConstrainedProblem`.
        gain: K_k, (N, n).

    Returns:
        Tuple of P_k (N + 1, n, n) and Var(u_k) (N,).
    """
    covariance, control_covariance = propagate(problem.system, gain[:, np.newaxis], problem.initial_covariance)
    return covariance, control_covariance[:, 0, 0]


def _question_limits(problem, multipliers):
    """Raise `InfeasibleProblem` if dual bounds prove that the limits on the final state cannot be met.

    First each alone, then together in the proportion of the diverging multipliers.
    """
    limits = problem.final_limits
    for i, (direction, limit) in enumerate(zip(problem.final_directions, limits, strict=True)):
        least = _least_variance(problem, np.outer(direction, direction))
        if least > limit**2:
            raise InfeasibleProblem(
                f"final limit {i} (direction {direction}) cannot be met: the least standard deviation that the control "
                f"limits allow is {np.sqrt(least):.6g}, the limit {limit:.6g}; relax this limit or those on the control"
            )
    share = multipliers / multipliers.sum()
    least = _least_variance(problem, _spread(problem.final_directions, share / limits**2))
    if least > 1:
        raise InfeasibleProblem(
            "the final limits can be met one by one but not together: whatever the feedback, one standard deviation "
            f"is at least {np.sqrt(least):.6g} times its limit; relax the final limits or those on the control"
        )


def _least_variance(problem, weight):
    """Lower bound of tr(weight P_N) over all feedback that meets the limits on the control."""
    intervals, n, _ = problem.system.control.shape
    # The recursion needs a weight of the control; this one can cost 1e-9 of the open-loop variance at most.
    price = 1e-9 * open_loop_cost(problem, weight) / intervals
    bare = problem._replace(
        final_directions=np.empty((0, n)),
        final_limits=np.empty(0),
        control_weight=price / problem.control_limits**2,
    )
    _, control, *_ = _ascend(bare, weight, 0.0, 1e-7)
    _, value = lqg_gains(bare.system, weight, bare.control_weight + control)
    return _lagrangian_value(bare, value) - control @ bare.control_limits**2 - price * intervals


def _lagrangian_value(problem, value):
    """Least cost of the unconstrained problem, sum_k tr(S_{k+1} G_k G_k') + tr(S_0 P_0)."""
    return float(np.sum(value[1:] * problem.system.noise) + np.sum(value[0] * problem.initial_covariance))


def open_loop_cost(problem, weight):
    """Cost tr(weight P_N) of a problem without any control.

    Args:
        problem: `ChanceConstrainedProblem`.
        weight: symmetric, (n, n).

    Returns:
        Cost, in the unit of the weighted variances.
    """
    covariance, _ = variances(problem, np.zeros(problem.system.control.shape[:2]))
    return float(np.sum(weight * covariance[-1]))


def cost_of(problem, final_covariance, control_variance):
    """Var(a'x_N) + sum_k R_k Var(u_k) (Eq. 53) of any feedback, as `lincov.propagate` gives it.

    Args:
        problem: `ChanceConstrainedProblem`.
        final_covariance: P_N, (n, n).
        control_variance: Var(u_k), (N,).

    Returns:
        Cost, in the unit of Var(a'x).
    """
    return float(problem.objective @ final_covariance @ problem.objective + problem.control_weight @ control_variance)


def _above_floor(cost, floor):
    """The part of the cost that feedback decides; never zero, so that a ratio to it is finite."""
    return max(cost - floor, np.finfo(float).eps * cost)


def _spread(directions, weights):
    """sum_i w_i d_i d_i'."""
    return directions.T @ (weights[:, None] * directions)


def limit_ratios(problem, final_covariance, control_variance):
    """Variances over the squares of their limits: at most one where a limit is met.

    Args:
        problem: `ChanceConstrainedProblem`.
        final_covariance: P_N, (n, n).
        control_variance: Var(u_k), (N,).

    Returns:
        Ratios of the final state (m,) and of the controls (N,).
    """
    final = np.einsum("mi,ij,mj->m", problem.final_directions, final_covariance, problem.final_directions)
    return final / problem.final_limits**2, control_variance / problem.control_limits**2


def _weights(system, final_weight, control_weight):
    """Both weights as arrays of the shapes that the system asks for."""
    final_weight = np.ascontiguousarray(final_weight, dtype=float)
    control_weight = np.ascontiguousarray(control_weight, dtype=float)
    intervals, n, _ = system.control.shape
    require_shape("final_weight", final_weight, (n, n), " to fit the system")
    require_shape("control_weight", control_weight, (intervals,), " to fit the system")
    return final_weight, control_weight


def checked(problem):
    """The problem with arrays of floats, after a look at every field.

    Raises:
        ValueError: if a field has a wrong shape, is not finite or not positive, or the objective has no variance.
    """
    system = LinearSystem(*(np.ascontiguousarray(field, dtype=float) for field in problem.system))
    problem_fields = {name: np.ascontiguousarray(getattr(problem, name), dtype=float) for name in problem._fields[1:]}
    require_shape("system.control", system.control, ("N", "n", 1))
    (intervals, n, _), m = system.control.shape, problem_fields["final_limits"].size
    shapes = {
        "system.transition": (intervals, n, n),
        "system.control": (intervals, n, 1),
        "system.noise": (intervals, n, n),
        "initial_covariance": (n, n),
        "objective": (n,),
        "control_weight": (intervals,),
        "final_directions": (m, n),
        "final_limits": (m,),
        "control_limits": (intervals,),
        "state_scale": (n,),
    }
    arrays = {f"system.{name}": field for name, field in system._asdict().items()} | problem_fields
    for name, shape in shapes.items():
        require_array(name, arrays[name], shape, " to fit system.control")
    for name in ("control_weight", "final_limits", "control_limits", "state_scale"):
        require_positive(name, problem_fields[name])
    problem = ChanceConstrainedProblem(system, **problem_fields)
    if not open_loop_cost(problem, np.outer(problem.objective, problem.objective)) > 0:
        raise ValueError("objective: its final variance is zero without any control, so there is nothing to minimize")
    return problem


@njit(cache=True, error_model="numpy")
def _riccati(transition, control, final_weight, control_weight):
    """Gains (N, n) and value matrices (N + 1, n, n) of Eq. 55 in Joseph form."""
    intervals, n = control.shape
    gain, value = np.zeros((intervals, n)), np.empty((intervals + 1, n, n))
    value[intervals] = final_weight
    closed_loop, product, weighted = np.empty((n, n)), np.empty((n, n)), np.empty(n)
    for k in range(intervals - 1, -1, -1):
        after, now = value[k + 1], value[k]
        curvature = control_weight[k]
        effective = False
        for i in range(n):
            effective = effective or control[k, i] != 0.0
            total = 0.0
            for j in range(n):
                total += after[i, j] * control[k, j]
            weighted[i] = total
            curvature += control[k, i] * total
        if effective:
            for j in range(n):
                total = 0.0
                for i in range(n):
                    total += weighted[i] * transition[k, i, j]
                gain[k, j] = -total / curvature
        for i in range(n):
            for j in range(n):
                closed_loop[i, j] = transition[k, i, j] + control[k, i] * gain[k, j]
        for i in range(n):
            for j in range(n):
                total = 0.0
                for l in range(n):
                    total += after[i, l] * closed_loop[l, j]
                product[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = control_weight[k] * gain[k, i] * gain[k, j]
                for l in range(n):
                    total += closed_loop[l, i] * product[l, j]
                now[i, j] = total
                now[j, i] = total
    return gain, value
