"""Range control of the Apollo final phase by adjoint gains (stochastic entry guidance, Sec. III.B)."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.checks import require_shape
from marsedl.summaries import summary

__all__ = ["AdjointGains", "adjoint_gains", "density_slaved_matrix", "drag_form"]


class AdjointGains(NamedTuple):
    """Feedback gains and the influence functions that they come from."""

    gain: np.ndarray  # K_k, (N, n), 1 per unit of the states
    adjoint: np.ndarray  # theta_k, (N + 1, n), final error per unit of the states
    control_adjoint: np.ndarray  # theta_u,k, (N,), final error per unit of a control held from k to the end

    __repr__ = summary


def adjoint_gains(transition, control, final_adjoint, overcontrol):
    r"""Gains that cancel the predicted final error by a control held to the end (stochastic entry, Eqs. 46 to 50).

        $\theta_k = A_k^\top \theta_{k+1}, \quad \theta_{u,k} = \theta_{u,k+1} + B_k^\top \theta_{k+1}, \quad
          K_k = -K_\text{oc} \frac{\theta_k^\top}{\theta_{u,k}}$

    marched backwards from theta_N = theta_f, theta_u,N = 0: Eq. 49 with the transition over each interval. Shortly
    before the last interval with a control effect theta_u is small and the gains are large; where no effect is left
    (theta_u = 0) the gain is zero.

    Args:
        transition: A_k, (N, n, n).
        control: B_k, (N, n).
        final_adjoint: theta_f, weights of the final deviation that make the final error, (n,).
        overcontrol: K_oc, 1.

    Returns:
        `AdjointGains`.

    Raises:
        ValueError: if shapes do not fit.
    """
    transition, control, final_adjoint = (
        np.asarray(value, dtype=float) for value in (transition, control, final_adjoint)
    )
    count, n = control.shape if control.ndim == 2 else (-1, -1)
    if transition.shape != (count, n, n) or final_adjoint.shape != (n,):
        raise ValueError(
            "transition (N, n, n), control (N, n) and final_adjoint (n,) do not fit: "
            f"shapes {transition.shape}, {control.shape} and {final_adjoint.shape}"
        )
    gain, adjoint, control_adjoint = np.zeros((count, n)), np.empty((count + 1, n)), np.empty(count)
    adjoint[count] = final_adjoint
    effect = 0.0
    for k in reversed(range(count)):
        effect += adjoint[k + 1] @ control[k]
        adjoint[k] = transition[k].T @ adjoint[k + 1]
        control_adjoint[k] = effect
        if effect != 0.0:
            gain[k] = -overcontrol * adjoint[k] / effect
    return AdjointGains(gain, adjoint, control_adjoint)


def drag_form(gain, density, drag, scale_height, velocity, flight_path_angle):
    r"""Gains of range, drag and altitude rate that feed back, at equal velocity, what the five-state gains do.

        $K_R = K_R, \quad K_D = K_\rho \frac{\rho}{D} - K_r \frac{H}{D}, \quad K_{\dot{h}} = \frac{K_\gamma}{V
          \, \cos\gamma}$

    A drag deviation at the reference velocity is a density deviation, D~/D = rho~/rho. It is taken for one along the
    mean profile, hence for an altitude deviation too, r~ = -H D~/D. (Stochastic entry guidance, end of Sec. III.B,
    names this form without equations.)

    Args:
        gain: of radius, velocity, flight path angle, downrange and density, (N, 5).
        density: rho of the reference, kg/m^3, (N,).
        drag: D, drag acceleration of the reference, m/s^2, (N,).
        scale_height: H, m, (N,).
        velocity: V, m/s, (N,).
        flight_path_angle: gamma, rad, (N,).

    Returns:
        Gains of downrange (1/m), drag acceleration (s^2/m) and altitude rate (s/m), (N, 3).

    Raises:
        ValueError: if the gain does not have five columns.
    """
    gain = np.asarray(gain, dtype=float)
    require_shape("gain", gain, ("N", 5), ", one column per longitudinal state")
    by_radius, _, by_path_angle, by_downrange, by_density = gain.T
    return np.column_stack(
        [
            by_downrange,
            (by_density * density - by_radius * scale_height) / drag,
            by_path_angle / (velocity * np.cos(flight_path_angle)),
        ]
    )


def density_slaved_matrix(state_matrix, inverse_scale_height, density):
    r"""State matrix of radius, velocity, flight path angle and downrange alone, density being one of altitude.

        $A_4 = A_{1:4,1:4} + A_{1:4,\rho} \frac{d\rho}{dr} e_r^\top, \quad \frac{d\rho}{dr} = -\frac{\rho}{H}$

    (the model of the original derivation, stochastic entry guidance, Sec. III.B: no density state).

    Args:
        state_matrix: A of the five-state model, 1/s in the units of the states, (k, 5, 5).
        inverse_scale_height: 1/H, 1/m, (k,).
        density: $\rho$ of the reference, kg/m^3, (k,).

    Returns:
        $A_4$, (k, 4, 4).

    Raises:
        ValueError: if the shape of the matrix is another one.
    """
    state_matrix = np.asarray(state_matrix, dtype=float)
    require_shape("state_matrix", state_matrix, ("k", 5, 5))
    slaved = state_matrix[:, :4, :4].copy()
    density_slope = -np.asarray(density) * inverse_scale_height
    slaved[:, :, 0] += state_matrix[:, :4, 4] * density_slope[:, np.newaxis]
    return slaved
