"""Linear covariance analysis: systems over intervals of held control, white noise, feedback u_k = K_k x_k."""

import numpy as np
from numba import njit

from marsedl.methods.linear_system import Covariances, LinearSystem

__all__ = ["compose", "discretize", "propagate"]


def discretize(state_matrix, control_matrix, noise_intensity, step):
    r"""Integrate x' = A x + B u + G w' over intervals of held control (stochastic entry guidance, Eqs. 37 to 39).

    An interval has s sub-steps of h = step / s, on each of which A, B and GG' keep their value at its middle:

        $\Phi = I + Ah + \frac{(Ah)^2}{2} + \frac{(Ah)^3}{6}, \quad h \left( I + \frac{Ah}{2} + \frac{(Ah)^2}{6}
          \right) B$
        $h \exp\left( \frac{Ah}{2} \right) G G^\top \exp\left( \frac{Ah}{2} \right)^\top$

    Second order in h for matrices that change, third for the transition and the control effect of constant ones.

    Args:
        state_matrix: A in the middle of the sub-steps, (N, s, n, n), 1/s in the units of the states.
        control_matrix: B likewise, (N, s, n, m).
        noise_intensity: GG' likewise, (N, s, n, n).
        step: lengths of the intervals, (N,), s.

    Returns:
        `LinearSystem` of deviations, whose time begins with 0; its noise is symmetric to the last bit.

    Raises:
        ValueError: if shapes do not fit, or a step is not positive.
    """
    state_matrix, control_matrix, noise_intensity, step = (
        np.asarray(value, dtype=float) for value in (state_matrix, control_matrix, noise_intensity, step)
    )
    shape = state_matrix.shape
    if len(shape) != 4 or shape[2] != shape[3] or shape[1] < 1:
        raise ValueError(f"state_matrix must have shape (N, s, n, n) with s > 0, not {shape}")
    if control_matrix.ndim != 4:
        raise ValueError(f"control_matrix must have shape (N, s, n, m), not {control_matrix.shape}")
    _, substeps, n, m = control_matrix.shape
    for name, value, expected in (
        ("control_matrix", control_matrix, (*shape[:3], m)),
        ("noise_intensity", noise_intensity, shape),
        ("step", step, shape[:1]),
    ):
        if value.shape != expected:
            raise ValueError(f"{name} must have shape {expected} to fit state_matrix, not {value.shape}")
    if not (step > 0).all():
        raise ValueError(f"step must be positive; entry {np.argmin(step > 0)} is {step[np.argmin(step > 0)]}")

    h = np.repeat(step / substeps, substeps)
    first = state_matrix.reshape(-1, n, n) * h[:, None, None]
    second = first @ first
    third = second @ first
    identity = np.eye(n)
    from_middle = identity + first / 2 + second / 8 + third / 48
    transition = identity + first + second / 2 + third / 6
    held = control_matrix.reshape(-1, n, m) * h[:, None, None]
    control = np.einsum("kij,kjm->kim", identity + first / 2 + second / 6, held)
    noise = from_middle @ (noise_intensity.reshape(-1, n, n) * h[:, None, None]) @ from_middle.swapaxes(1, 2)
    time = np.concatenate([[0.0], np.cumsum(h)])
    fine = LinearSystem(transition, control, noise, np.zeros((len(h), n)), time)
    return compose(fine, np.arange(0, len(h), substeps))


def compose(system, starts):
    """Join intervals into coarser ones, over each of which the control is held.

    Args:
        system: `LinearSystem` of N intervals.
        starts: fine interval with which each coarse one begins, (M,), strictly increasing from 0.

    Returns:
        `LinearSystem` of M intervals that covers the same time.

    Raises:
        ValueError: if starts does not begin with 0, does not increase, or exceeds N - 1.
    """
    starts = np.asarray(starts)
    intervals, n, m = system.control.shape
    if starts.ndim != 1 or not starts.size or starts[0] != 0 or (np.diff(starts) < 1).any() or starts[-1] >= intervals:
        raise ValueError(f"starts must increase strictly from 0 and stay below the {intervals} intervals of the system")
    transition = np.tile(np.eye(n), (len(starts), 1, 1))
    control, noise = np.zeros((len(starts), n, m)), np.zeros((len(starts), n, n))
    affine = np.zeros((len(starts), n))
    coarse = -1
    for k in range(intervals):
        if coarse + 1 < len(starts) and starts[coarse + 1] == k:
            coarse += 1
        across = system.transition[k]
        transition[coarse] = across @ transition[coarse]
        control[coarse] = np.einsum("ij,jm->im", across, control[coarse]) + system.control[k]
        noise[coarse] = across @ noise[coarse] @ across.T + system.noise[k]
        affine[coarse] = across @ affine[coarse] + system.affine[k]
    return LinearSystem(transition, control, _symmetric(noise), affine, system.time[np.append(starts, intervals)])


def propagate(system, gain, initial_covariance):
    r"""Covariance under the feedback u_k = K_k x_k (stochastic entry guidance, Eqs. 42 and 45).

        $P_{k+1} = (A_k + B_k K_k) P_k (A_k + B_k K_k)^\top + W_k, \quad \text{Cov}(u_k) = K_k P_k K_k^\top$

    Args:
        system: `LinearSystem`.
        gain: K_k, (N, m, n); zeros for the open loop.
        initial_covariance: P_0, (n, n).

    Returns:
        `Covariances`; every matrix is symmetric to the last bit.

    Raises:
        ValueError: if shapes do not fit.
    """
    # One memory layout, one compiled kernel.
    transition, control, noise, gain = (np.ascontiguousarray(field, dtype=float) for field in (*system[:3], gain))
    initial_covariance = np.asarray(initial_covariance, dtype=float)
    intervals, n, m = control.shape
    if gain.shape != (intervals, m, n):
        raise ValueError(f"gain must have shape {(intervals, m, n)} to fit the system, not {gain.shape}")
    if initial_covariance.shape != (n, n):
        raise ValueError(f"initial_covariance must have shape {(n, n)}, not {initial_covariance.shape}")
    return Covariances(*_propagate(transition, control, noise, gain, _symmetric(initial_covariance)))


def _symmetric(matrix):
    """Half the sum of matrix and transpose: equal to the last bit on both sides of the diagonal."""
    return (matrix + matrix.swapaxes(-1, -2)) / 2


@njit(cache=True, error_model="numpy")
def _propagate(transition, control, noise, gain, initial_covariance):
    """Covariances of states and controls; compiled because the LQG dual calls it a thousand times."""
    intervals, n, m = control.shape
    covariance, control_covariance = np.empty((intervals + 1, n, n)), np.empty((intervals, m, m))
    covariance[0] = initial_covariance
    closed_loop, product = np.empty((n, n)), np.empty((n, n))
    for k in range(intervals):
        now, after = covariance[k], covariance[k + 1]
        for a in range(m):
            for b in range(a + 1):
                total = 0.0
                for i in range(n):
                    for j in range(n):
                        total += gain[k, a, i] * now[i, j] * gain[k, b, j]
                # Where states are nearly dependent, rounding can leave a variance of less than nothing.
                control_covariance[k, a, b] = control_covariance[k, b, a] = max(total, 0.0) if a == b else total
        for i in range(n):
            for j in range(n):
                closed_loop[i, j] = transition[k, i, j]
                for a in range(m):
                    closed_loop[i, j] += control[k, i, a] * gain[k, a, j]
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
    return covariance, control_covariance
