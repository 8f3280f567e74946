"""Algorithm 2 of Ridderhof and Tsiotras (powered descent) as printed: integrate everything forward from Lambda(0).

It is independent of the closed form (no Phi, no N, other formulas for lambda(0)) and therefore its check; and it
evaluates Eqs. 18, 20 and 23 for any control, to show what completing the square drops.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from marsedl.summaries import summary

__all__ = ["ForwardIntegration", "LinearMotion", "ModifiedIndex", "integrate_forward", "modified_index"]

_SMALLEST = 1e-30  # error that an entry may have which starts from zero, in any unit


class ForwardIntegration(NamedTuple):
    """Solution of the differential equations of Sec. III at the k requested times."""

    time: np.ndarray  # (k,), s
    riccati: np.ndarray  # Lambda(t) (Eq. 21), (k, n, n)
    costate: np.ndarray  # lambda(t) (Eq. 22) from costate_initial_eq39, (k, n)
    mean: np.ndarray  # (Eq. 31), (k, n)
    covariance: np.ndarray  # Sigma(t) (Eq. 40), (k, n, n)
    closed_loop_transition: np.ndarray  # Theta(t, 0) (Eq. 28), (k, n, n)
    adjoint_transition: np.ndarray  # bar Theta(t, 0) (Eq. 27), (k, n, n)
    h_matrix: np.ndarray  # H(t) (Eq. 42) from H(0) of Eq. 43, (k, n, n)
    closed_loop_gramian: np.ndarray  # M~(T, 0) (Eq. 38), (n, n)
    c1: np.ndarray  # (Eq. 35), (n,)
    c2: np.ndarray  # (Eq. 36), (n,)
    costate_initial_eq37: np.ndarray  # lambda(0), (n,)
    costate_initial_eq39: np.ndarray  # lambda(0), (n,)

    __repr__ = summary


class LinearMotion(NamedTuple):
    """x' = A x + B (u + gamma noise) + c from 0 to T, and its start (Eqs. 4, 5)."""

    state_matrix: Callable  # A (n, n) as a function of time
    control_matrix: Callable  # B (n, m) as a function of time
    affine: Callable  # c (n,) as a function of time
    duration: float  # T, s
    initial_mean: np.ndarray  # x0, (n,)
    initial_covariance: np.ndarray  # S0, (n, n)
    noise_density: float  # gamma, control unit times sqrt(s)

    __repr__ = summary


class ModifiedIndex(NamedTuple):
    """The modified index of one control, by four expressions; control unit^2 s."""

    boundary_form: float  # Eq. 18: cost plus the change of E[x' Lambda x - 2 lambda' x] over the interval
    expanded: float  # Eq. 20, with the derivatives of Eqs. 21 and 22
    completed_square: float  # Eq. 23, as printed
    dropped_term: float  # -int (lambda' B B' lambda + 2 lambda' c) dt, missing in Eq. 23; independent of the control
    cost: float  # E int u'u dt (Eq. 10)


def integrate_forward(motion, riccati_initial, final_mean, *, times=None, relative_tolerance=1e-11):
    r"""Integrate Eqs. 21, 22, 27, 28, 31, 38, 40 and 42 forward from $\Lambda(0)$ (Algorithm 2).

    $c_1$ and $c_2$ (Eqs. 35, 36) and the integral of Eq. 37 are integrated along with them, written as differential
    equations in their upper limit. $\lambda(0)$ is then

        $\text{Eq. 37:} \quad \left[ \int \Theta(T,s) B B^\top \Theta(0,s)^\top \, ds \right]^{-1} \left( x_T -
          \Theta(T,0) x_0 - c_1 - c_2 \right)$
        $\text{Eq. 39:} \quad \Theta(T,0)^\top \widetilde{M}^{-1} \left( x_T - \Theta(T,0) x_0 - c_1 - c_2 \right)$

    and $\lambda(t)$ and the mean follow from it in a second pass.

    Args:
        motion: `LinearMotion`.
        riccati_initial: $\Lambda(0)$, (n, n).
        final_mean: $x_T$, (n,).
        times: times of the answer within [0, T], (k,), s; 0 and T if absent.
        relative_tolerance: of the eighth-order Runge-Kutta method (DOP853).

    Returns:
        `ForwardIntegration`.

    Raises:
        RuntimeError: if the integration fails, as it does when $\Lambda$ escapes in finite time.
    """
    state_matrix, control_matrix, affine, duration, initial_mean, initial_covariance, noise_density = motion
    n = len(initial_mean)
    identity, zeros = np.eye(n), np.zeros((n, n))
    times = np.array([0.0, duration]) if times is None else np.asarray(times, dtype=float)

    def rates(t, y):
        riccati, covariance, theta, adjoint, h, gramian, cross = y[: 7 * n * n].reshape(7, n, n)
        response, c1, c2 = y[7 * n * n :].reshape(3, n)
        a, b, c = state_matrix(t), control_matrix(t), affine(t)
        bb = b @ b.T
        closed = a - bb @ riccati
        matrices = (
            -a.T @ riccati - riccati @ a + riccati @ bb @ riccati,  # Eq. 21
            closed @ covariance + covariance @ closed.T + noise_density**2 * bb,  # Eq. 40
            closed @ theta,  # Eq. 28
            -closed.T @ adjoint,  # Eq. 27
            -h @ a - a.T @ h - h @ bb @ h,  # Eq. 42
            closed @ gramian + gramian @ closed.T + bb,  # Eq. 38
            closed @ cross + bb @ adjoint,  # int_0^t Theta(t,s) B B' Theta(0,s)' ds of Eq. 37
        )
        vectors = (
            -closed.T @ response + riccati @ c,  # inner integral of Eq. 35
            closed @ c1 + bb @ response,  # Eq. 35
            closed @ c2 + c,  # Eq. 36
        )
        return np.concatenate([np.ravel(matrices), np.ravel(vectors)])

    h_initial = noise_density**2 * np.linalg.inv(initial_covariance) - riccati_initial  # Eq. 43
    matrices = (riccati_initial, initial_covariance, identity, identity, h_initial, zeros, zeros)
    path = _solve(rates, duration, (*matrices, *np.zeros((3, n))), times, relative_tolerance)
    riccati, covariance, theta, adjoint, h = (
        path[:-1, i * n * n : (i + 1) * n * n].reshape(-1, n, n) for i in range(5)
    )
    final_theta, gramian, cross = (path[-1, i * n * n : (i + 1) * n * n].reshape(n, n) for i in (2, 5, 6))
    c1, c2 = path[-1, 7 * n * n + n :].reshape(2, n)
    gap = final_mean - final_theta @ initial_mean - c1 - c2
    eq37 = np.linalg.solve(cross, gap)
    eq39 = final_theta.T @ np.linalg.solve(gramian, gap)

    def mean_rates(t, y):
        riccati, (costate, mean) = y[: n * n].reshape(n, n), y[n * n :].reshape(2, n)
        a, b, c = state_matrix(t), control_matrix(t), affine(t)
        bb = b @ b.T
        closed = a - bb @ riccati
        return np.concatenate(
            [
                np.ravel(-a.T @ riccati - riccati @ a + riccati @ bb @ riccati),  # Eq. 21
                -closed.T @ costate + riccati @ c,  # Eq. 22
                closed @ mean + bb @ costate + c,  # Eq. 31
            ]
        )

    path = _solve(mean_rates, duration, (riccati_initial, eq39, initial_mean), times, relative_tolerance)[:-1, n * n :]
    return ForwardIntegration(
        time=times,
        riccati=riccati,
        costate=path[:, :n],
        mean=path[:, n:],
        covariance=covariance,
        closed_loop_transition=theta,
        adjoint_transition=adjoint,
        h_matrix=h,
        closed_loop_gramian=gramian,
        c1=c1,
        c2=c2,
        costate_initial_eq37=eq37,
        costate_initial_eq39=eq39,
    )


def modified_index(motion, riccati_initial, costate_initial, *, feedback, feedforward, relative_tolerance=1e-11):
    """Evaluate Eqs. 18, 20 and 23 under any affine control u = f(t) - F(t) x, which need not steer anywhere.

    With Eqs. 21 and 22 the integrand of Eq. 20 minus that of Eq. 23 is -(lambda' B B' lambda + 2 lambda' c). Eq. 23
    leaves it out; as it does not depend on u, the minimizer is the same.

    Args:
        motion: `LinearMotion`.
        riccati_initial: Lambda(0), (n, n).
        costate_initial: lambda(0), (n,).
        feedback, feedforward: functions of time giving F (m, n) and f (m,).
        relative_tolerance: of the integration.

    Returns:
        `ModifiedIndex`.

    Raises:
        RuntimeError: if the integration fails.
    """
    state_matrix, control_matrix, affine, duration, initial_mean, initial_covariance, noise_density = motion
    n = len(initial_mean)

    def rates(t, y):
        (riccati, covariance), (costate, mean) = y[: 2 * n * n].reshape(2, n, n), y[2 * n * n : -4].reshape(2, n)
        a, b, c = state_matrix(t), control_matrix(t), affine(t)
        gain, mean_control = feedback(t), feedforward(t) - feedback(t) @ mean
        bb, open_loop = b @ b.T, a - b @ gain
        riccati_rate = -a.T @ riccati - riccati @ a + riccati @ bb @ riccati  # Eq. 21
        costate_rate = -(a - bb @ riccati).T @ costate + riccati @ c  # Eq. 22
        mean_rate = a @ mean + b @ mean_control + c
        second_moment = covariance + np.outer(mean, mean)  # E[x x']
        effort = mean_control @ mean_control + np.trace(gain @ covariance @ gain.T)  # E[u'u]
        noise = noise_density**2 * np.trace(riccati @ bb)
        # E[(A x + B u + c)' Lambda x], where u - E u = -F (x - E x)
        drift = mean_rate @ riccati @ mean + np.trace(riccati @ open_loop @ covariance)
        expanded = (
            effort
            + np.trace(riccati_rate @ second_moment)
            - 2 * costate_rate @ mean
            + 2 * drift
            - 2 * costate @ mean_rate
            + noise
        )
        deviation = mean_control + b.T @ (riccati @ mean - costate)
        spread = b.T @ riccati - gain
        square = deviation @ deviation + np.trace(spread @ covariance @ spread.T) + noise
        dropped = -(costate @ bb @ costate + 2 * costate @ c)
        covariance_rate = open_loop @ covariance + covariance @ open_loop.T + noise_density**2 * bb
        return np.concatenate(
            [
                np.ravel((riccati_rate, covariance_rate)),
                costate_rate,
                mean_rate,
                [expanded, square, dropped, effort],
            ]
        )

    parts = (riccati_initial, initial_covariance, costate_initial, initial_mean, *np.zeros((4, 1)))
    start, end = _joined(parts), _solve(rates, duration, parts, np.array([duration]), relative_tolerance)[-1]

    def potential(y):  # E[x' Lambda x - 2 lambda' x] (Eqs. 16, 17)
        (riccati, covariance), (costate, mean) = y[: 2 * n * n].reshape(2, n, n), y[2 * n * n : -4].reshape(2, n)
        return np.trace(riccati @ covariance) + mean @ riccati @ mean - 2 * costate @ mean

    expanded, square, dropped, effort = (float(value) for value in end[-4:])
    return ModifiedIndex(
        boundary_form=effort + float(potential(end) - potential(start)),
        expanded=expanded,
        completed_square=square,
        dropped_term=dropped,
        cost=effort,
    )


def _joined(parts):
    return np.concatenate([np.ravel(part) for part in parts])


def _solve(rates, duration, parts, times, relative_tolerance):
    """Solution from matrices and vectors at the given times, with the one at the duration as an extra last row."""
    start = _joined(parts)
    # Entries differ by many powers of ten and some start from zero, so their errors are relative. Those that a problem
    # leaves uncoupled hold the rounding error of the others of their matrix, and must not set the step.
    reached = np.maximum(np.abs(start), duration * np.abs(rates(0.0, start)))
    ends = np.cumsum([np.size(part) for part in parts])[:-1]
    scale = np.concatenate([np.full(len(entries), entries.max()) for entries in np.split(reached, ends)])
    floor = np.maximum(np.finfo(float).eps * scale, _SMALLEST)
    solution = solve_ivp(
        rates, (0.0, duration), start, method="DOP853", rtol=relative_tolerance, atol=floor, dense_output=True
    )
    if not solution.success or not np.isfinite(solution.y[:, -1]).all():
        raise RuntimeError(f"forward integration stopped at t = {solution.t[-1]:.6g} s: {solution.message}")
    return np.vstack([solution.sol(times).T, solution.y[:, -1]])
