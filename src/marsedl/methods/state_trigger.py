"""Linear theory of flights that a state ends, or whose law is indexed by one: both shift the nominal in time."""

import numpy as np

__all__ = ["trigger_projection", "trigger_time_variance", "velocity_indexed_gain"]


def trigger_projection(rates, normal):
    r"""Deviation at the stopping time T of a state trigger from that at the nominal final time t_f.

        $x(T) - \bar{x}(t_f) = Z_f \tilde{x}(t_f), \quad Z_f = I - \frac{f \nu^\top}{\nu^\top f}$

    (stochastic entry guidance, Eqs. 64 and 67). A final weight a at T becomes Z_f' a at t_f (Eq. 68).

    Args:
        rates: f, time derivatives of the nominal state at t_f, (n,).
        normal: nu, the flight stops when nu'x falls to its bound, (n,).

    Returns:
        Z_f, (n, n).

    Raises:
        ValueError: if nu'f = 0 (the nominal does not cross the trigger surface), or shapes differ.
    """
    rates, normal, approach = _crossing(rates, normal)
    return np.eye(len(rates)) - np.outer(rates, normal) / approach


def trigger_time_variance(rates, normal, covariance):
    """Variance of the stopping time of a state trigger, Var(T) = nu' P nu / (nu' f)^2.

    To first order T - t_f = -nu' xtilde(t_f) / (nu' f) (stochastic entry guidance, Eqs. 62 and 63).

    Args:
        rates, normal: f and nu of `trigger_projection`, (n,).
        covariance: P of the deviation at the nominal final time, (n, n).

    Returns:
        Var(T), s^2.

    Raises:
        ValueError: as `trigger_projection`.
    """
    _, normal, approach = _crossing(rates, normal)
    return float(normal @ covariance @ normal) / approach**2


def velocity_indexed_gain(gain, rates, velocity_index, control_slope):
    r"""Gain in time of a law that is flown against velocity, u = u(V) + K(V) (x - x_ref(V)).

    A velocity deviation also shifts the reference that is looked up, by f / Vdot per unit of velocity:

        $K_\text{eff} = K \left( I - \frac{f e_V^\top}{\dot{V}} \right) + \frac{du}{dV} e_V^\top$

    Args:
        gain: K on the reference, (N, n).
        rates: f, time derivatives of the reference, (N, n).
        velocity_index: index of V in the state.
        control_slope: du/dV of the reference control u(V), (N,).

    Returns:
        K_eff, (N, n); its rows are only (du/dV) e_V' where K is zero.

    Raises:
        ValueError: if shapes do not fit, or if Vdot = 0 where K feeds back a moving state.
    """
    gain, rates, control_slope = (np.asarray(value, dtype=float) for value in (gain, rates, control_slope))
    if gain.ndim != 2 or rates.shape != gain.shape or control_slope.shape != gain.shape[:1]:
        raise ValueError(
            "gain (N, n), rates (N, n) and control_slope (N,) do not fit: "
            f"shapes {gain.shape}, {rates.shape} and {control_slope.shape}"
        )
    along, acceleration = np.einsum("ki,ki->k", gain, rates), rates[:, velocity_index]
    moving = along != 0
    if (moving & (acceleration == 0)).any():
        raise ValueError(
            f"rates: the velocity is stationary at point {np.argmax(moving & (acceleration == 0))}, where a reference "
            "against velocity does not exist; set the gain to zero there"
        )
    effective = gain.copy()
    effective[:, velocity_index] += control_slope - np.divide(
        along, acceleration, out=np.zeros_like(along), where=moving
    )
    return effective


def _crossing(rates, normal):
    """Both vectors as arrays, and nu'f, the rate at which the trigger surface is approached."""
    rates, normal = np.asarray(rates, dtype=float), np.asarray(normal, dtype=float)
    if rates.ndim != 1 or rates.shape != normal.shape:
        raise ValueError(f"rates and normal must be vectors of one length, not of shapes {rates.shape}, {normal.shape}")
    approach = normal @ rates
    if approach == 0:
        raise ValueError("normal' rates is zero: the nominal does not cross the trigger surface, so no time is defined")
    return rates, normal, approach
