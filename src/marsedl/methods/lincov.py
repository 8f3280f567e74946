"""Linear covariance analysis of a time-varying system with scalar, held control u_k = K_k x_k and white noise."""

from typing import NamedTuple

import numpy as np
from numba import njit

from marsedl.summaries import summary

__all__ = [
    "Covariances",
    "DiscreteSystem",
    "compose",
    "discretize",
    "propagate",
]


class DiscreteSystem(NamedTuple):
    """x_{k+1} = A_k x_k + B_k u_k + G_k w_k over N intervals (stochastic entry guidance, Eq. 35)."""

    transition: np.ndarray  # A_k, (N, n, n)
    control: np.ndarray  # B_k, (N, n)
    noise: np.ndarray  # G_k G_k', (N, n, n)

    __repr__ = summary


class Covariances(NamedTuple):
    """Covariance of the state at the N + 1 bounds, variance of the control in the N intervals."""

    covariance: np.ndarray  # P_k, (N + 1, n, n)
    control_variance: np.ndarray  # Var(u_k), (N,)

    __repr__ = summary


def discretize(state_matrix, control_matrix, noise_intensity, step):
    r"""Integrate x' = A x + B u + G w' over intervals of held control (stochastic entry guidance, Eqs. 37 to 39).

    An interval has s sub-steps of h = step / s, on each of which A, B and GG' keep their value at its middle:

        $\Phi = I + Ah + \frac{(Ah)^2}{2} + \frac{(Ah)^3}{6}, \quad h \left( I + \frac{Ah}{2} + \frac{(Ah)^2}{6}
          \right) B$
        $h \exp\left( \frac{Ah}{2} \right) G G^\top \exp\left( \frac{Ah}{2} \right)^\top$

    Second order in h for matrices that change, third for the transition and the control effect of constant ones.

    Args:
        state_matrix: A in the middle of the sub-steps, (N, s, n, n), 1/s in the units of the states.
        control_matrix: B likewise, (N, s, n).
        noise_intensity: GG' likewise, (N, s, n, n).
        step: lengths of the intervals, (N,), s.

    Returns:
        `DiscreteSystem`; its noise is symmetric to the last bit.

    Raises:
        ValueError: if shapes do not fit, or a step is not positive.
    """
    state_matrix, control_matrix, noise_intensity, step = (
        np.asarray(value, dtype=float) for value in (state_matrix, control_matrix, noise_intensity, step)
    )
    shape = state_matrix.shape
    if len(shape) != 4 or shape[2] != shape[3] or shape[1] < 1:
        raise ValueError(f"state_matrix must have shape (N, s, n, n) with s > 0, not {shape}")
    for name, value, expected in (
        ("control_matrix", control_matrix, shape[:3]),
        ("noise_intensity", noise_intensity, shape),
        ("step", step, shape[:1]),
    ):
        if value.shape != expected:
            raise ValueError(f"{name} must have shape {expected} to fit state_matrix, not {value.shape}")
    if not (step > 0).all():
        raise ValueError(f"step must be positive; entry {np.argmin(step > 0)} is {step[np.argmin(step > 0)]}")

    intervals, substeps, n, _ = shape
    h = step / substeps
    identity = np.eye(n)
    transition = np.tile(identity, (intervals, 1, 1))
    control, noise = np.zeros((intervals, n)), np.zeros((intervals, n, n))
    for j in range(substeps):
        first = state_matrix[:, j] * h[:, None, None]
        second = first @ first
        third = second @ first
        across = identity + first + second / 2 + third / 6
        from_middle = identity + first / 2 + second / 8 + third / 48
        effect = np.einsum("kij,kj->ki", identity + first / 2 + second / 6, control_matrix[:, j] * h[:, None])
        injected = from_middle @ (noise_intensity[:, j] * h[:, None, None]) @ from_middle.swapaxes(1, 2)
        transition = across @ transition
        control = np.einsum("kij,kj->ki", across, control) + effect
        noise = across @ noise @ across.swapaxes(1, 2) + injected
    return DiscreteSystem(transition, control, _symmetric(noise))


def compose(system, starts):
    """Join intervals into coarser ones, over each of which the control is held.

    Args:
        system: `DiscreteSystem` of N intervals.
        starts: fine interval with which each coarse one begins, (M,), strictly increasing from 0.

    Returns:
        `DiscreteSystem` of M intervals that covers the same time.

    Raises:
        ValueError: if starts does not begin with 0, does not increase, or exceeds N - 1.
    """
    starts = np.asarray(starts)
    intervals, n = system.control.shape
    if starts.ndim != 1 or not starts.size or starts[0] != 0 or (np.diff(starts) < 1).any() or starts[-1] >= intervals:
        raise ValueError(f"starts must increase strictly from 0 and stay below the {intervals} intervals of the system")
    transition = np.tile(np.eye(n), (len(starts), 1, 1))
    control, noise = np.zeros((len(starts), n)), np.zeros((len(starts), n, n))
    coarse = -1
    for k in range(intervals):
        if coarse + 1 < len(starts) and starts[coarse + 1] == k:
            coarse += 1
        across = system.transition[k]
        transition[coarse] = across @ transition[coarse]
        control[coarse] = across @ control[coarse] + system.control[k]
        noise[coarse] = across @ noise[coarse] @ across.T + system.noise[k]
    return DiscreteSystem(transition, control, _symmetric(noise))


def propagate(system, gain, initial_covariance):
    r"""Covariance under the feedback u_k = K_k x_k (stochastic entry guidance, Eqs. 42 and 45).

        $P_{k+1} = (A_k + B_k K_k) P_k (A_k + B_k K_k)^\top + G_k G_k^\top, \quad \text{Var}(u_k) = K_k P_k
          K_k^\top$

    Args:
        system: `DiscreteSystem`.
        gain: K_k, (N, n); zeros for the open loop.
        initial_covariance: P_0, (n, n).

    Returns:
        `Covariances`; every matrix is symmetric to the last bit.

    Raises:
        ValueError: if shapes do not fit.
    """
    # One memory layout, one compiled kernel.
    system = DiscreteSystem(*(np.ascontiguousarray(field, dtype=float) for field in system))
    gain, initial_covariance = np.ascontiguousarray(gain, dtype=float), np.asarray(initial_covariance, dtype=float)
    intervals, n = system.control.shape
    if gain.shape != (intervals, n):
        raise ValueError(f"gain must have shape {(intervals, n)} to fit the system, not {gain.shape}")
    if initial_covariance.shape != (n, n):
        raise ValueError(f"initial_covariance must have shape {(n, n)}, not {initial_covariance.shape}")
    return Covariances(*_propagate(*system, gain, _symmetric(initial_covariance)))


def _symmetric(matrix):
    """Half the sum of matrix and transpose: equal to the last bit on both sides of the diagonal."""
    return (matrix + matrix.swapaxes(-1, -2)) / 2


@njit(cache=True, error_model="numpy")
def _propagate(transition, control, noise, gain, initial_covariance):
    """Covariance (N + 1, n, n) and control variance (N,); compiled because the LQG dual calls it a thousand times."""
    intervals, n = control.shape
    covariance, control_variance = np.empty((intervals + 1, n, n)), np.empty(intervals)
    covariance[0] = initial_covariance
    closed_loop, product = np.empty((n, n)), np.empty((n, n))
    for k in range(intervals):
        now, after = covariance[k], covariance[k + 1]
        variance = 0.0
        for i in range(n):
            for j in range(n):
                variance += gain[k, i] * now[i, j] * gain[k, j]
                closed_loop[i, j] = transition[k, i, j] + control[k, i] * gain[k, j]
        # Where states are nearly dependent, rounding can leave less than nothing.
        control_variance[k] = max(variance, 0.0)
        for i in range(n):
            for j in range(n):
                total = 0.0
                for l in range(n):
                    total += now[i, l] * closed_loop[j, l]
                product[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = noise[k, i, j]
                for l in range(n):
                    total += closed_loop[i, l] * product[l, j]
                after[i, j] = total
                after[j, i] = total
    return covariance, control_variance
