"""Feedback of the bank angle, and the shapes and the first level of the funnel (robust entry funnels, Sec. 4)."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.funnels.linear import minkowski_shape, slice_jacobians
from marsedl.methods.funnels.recursion import initial_level, largest_feedback
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.linearization import Linearization
from marsedl.replication.artifacts import quantity

GAIN_UNIT = "rad/m, 1, 1, rad s/m, 1, 1"
# Units of the states in which conditions are stated beside those in scales of the regulator.
KILOMETRES = np.array([1e3, 1.0, 1.0, 1e3, 1.0, 1.0])


@dataclass(frozen=True)
class Gains:
    """Regulator, shapes of the slices at all nodes of the fine grid, and the level of the first one.

    V(xb) = 1/2 xb'P xb with P the shape; its unit is one over those of two states.
    """

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid")
    gain: np.ndarray = quantity(GAIN_UNIT, ("steps", 6), "feedback of the deviation on the bank angle, on each step")
    half_gain: np.ndarray = quantity(GAIN_UNIT, ("half", 6), "the same at nodes and half-way between")
    value_matrix: np.ndarray = quantity("SI", ("time", 6, 6), "cost-to-go of the regulator")
    shape: np.ndarray = quantity("SI", ("time", 6, 6), "shape P of the slices")
    initial_level: float = quantity("1", (), "least level rho of the first slice that holds the initial set, Eq. 20")
    condition: np.ndarray = quantity("1", ("time",), "condition number of the shape, in km, s and rad")
    scaled_condition: np.ndarray = quantity("1", ("time",), "the same in scales of the regulator")
    initial_feedback: float = quantity("rad", (), "largest feedback bank angle on the first slice")


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
        condition=np.linalg.cond(shape * np.outer(KILOMETRES, KILOMETRES)),
        scaled_condition=np.linalg.cond(shape * np.outer(scale, scale)),
        initial_feedback=float(largest_feedback(regulator.gains[0], shape[0], first)[0]),
    )
