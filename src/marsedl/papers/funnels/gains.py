"""Feedback of the bank angle, and the shapes and the first level of the funnel (robust entry funnels, Sec. 4)."""

import numpy as np

from marsedl.methods.funnels.linear import minkowski_shape, slice_jacobians
from marsedl.methods.funnels.recursion import initial_level, largest_feedback
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import STATES_IN_KILOMETRES
from marsedl.papers.funnels.records import Gains, Linearization
from marsedl.replication.catalogue import stage


@stage()
def compute(inputs, linearization: Linearization) -> Gains:
    """Design the regulator and the shapes."""
    scale = environment.state_scale(inputs)
    weight = np.diag(1.0 / scale**2)
    regulator = tvlqr(
        linearization.state_matrix[1::2],
        linearization.control_matrix[1::2, :, np.newaxis],
        np.diff(linearization.time),
        state_weight=weight / inputs.state_cost_time,
        control_weight=np.array([[1.0 / (inputs.scale_bank**2 * inputs.control_cost_time)]]),
        terminal_weight=inputs.terminal_weight * weight,
    )
    half_gain = at_half_steps(regulator.gains)[:, 0]
    shape = regulator.values
    if inputs.shape == "minimum_trace":
        loop = environment.closed_loop(inputs, linearization, half_gain)
        transitions, responses, _ = slice_jacobians(loop, np.arange(len(linearization.time)))
        shape = minkowski_shape(transitions, responses, environment.initial_set(inputs), scale)
    first = initial_level(shape[0], environment.initial_set(inputs))
    return Gains(
        time=linearization.time,
        gain=regulator.gains[:, 0],
        half_gain=half_gain,
        value_matrix=regulator.values,
        shape=shape,
        initial_level=first,
        condition=np.linalg.cond(shape * np.outer(STATES_IN_KILOMETRES, STATES_IN_KILOMETRES)),
        scaled_condition=np.linalg.cond(shape * np.outer(scale, scale)),
        initial_feedback=float(largest_feedback(regulator.gains[0], shape[0], first)[0]),
    )
