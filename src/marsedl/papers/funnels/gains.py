"""Feedback of the bank angle, and the shapes and the first level of the funnel (robust entry funnels, Sec. 4)."""

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from marsedl.methods.funnels.linear import minkowski_shape, slice_jacobians
from marsedl.methods.funnels.recursion import initial_level
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage

NO_DISTURBANCE = 1e-9  # least p of a Minkowski sum; it keeps 1/p finite


@stage()
def compute(given: Inputs, linearization: Linearization) -> Gains:
    """Design the regulator and the shapes."""
    guidance = given.guidance
    scale = environment.state_scale(given.planet, guidance)
    weight = np.diag(1.0 / scale**2)
    regulator = tvlqr(
        linearization.state_matrix[1::2],
        linearization.control_matrix[1::2, :, np.newaxis],
        np.diff(linearization.time),
        state_weight=weight / guidance.state_cost_time,
        control_weight=np.array([[1.0 / (guidance.scale_bank**2 * guidance.control_cost_time)]]),
        terminal_weight=guidance.terminal_weight * weight,
    )
    half_gain = at_half_steps(regulator.gains)[:, 0]
    initial_set = environment.initial_set(environment.initial_semi_axes(given.planet, given.uncertainty))
    shape = regulator.values
    if given.recursion.shape != "value_matrix":
        loop = environment.disturbed_loop(given, linearization, half_gain)
        transitions, responses, _ = slice_jacobians(loop, np.arange(len(linearization.time)))
        if given.recursion.shape == "minimum_trace":
            shape = minkowski_shape(transitions, responses, initial_set, scale)
        else:
            shape = least_volume_shape(transitions, responses, initial_set, scale)
    return Gains(
        time=linearization.time,
        half_gain=half_gain,
        shape=shape,
        initial_level=initial_level(shape[0], initial_set),
    )


def least_volume_shape(transitions, responses, initial_set, scale):
    r"""Shapes as those of `minkowski_shape`, but with the $p$ of every step for which the volume is least.

    $\frac{n}{1 + p} = \sum_i \frac{\lambda_i}{p (p + \lambda_i)}, \quad \lambda_i
      \text{ the eigenvalues of } (\Phi S \Phi^\top)^{-1} \Gamma \Gamma^\top$
    """
    units = np.outer(scale, scale)
    ellipsoids = [2.0 * np.linalg.inv(initial_set * units)]
    for across, response in zip(transitions, responses, strict=True):
        step, pushed = across * scale / scale[:, np.newaxis], response / scale[:, np.newaxis]
        propagated, pushed = step @ ellipsoids[-1] @ step.T, pushed @ pushed.T
        values = np.maximum(eigh(pushed, propagated, eigvals_only=True), 0.0)
        p = NO_DISTURBANCE

        def slope(log_p, values=values):  # of the logarithm of the volume, times p; it ascends through zero
            p = np.exp(log_p)
            return len(values) * p / (1.0 + p) - np.sum(values / (p + values + np.finfo(float).tiny))

        if slope(np.log(NO_DISTURBANCE)) < 0.0:
            p = np.exp(brentq(slope, np.log(NO_DISTURBANCE), np.log(1.0 / NO_DISTURBANCE), xtol=1e-12))
        ellipsoids.append((1.0 + p) * propagated + (1.0 + 1.0 / p) * pushed)
    inverse = np.linalg.inv(np.array(ellipsoids))
    return (inverse + inverse.transpose(0, 2, 1)) / units
