"""Feedback of the bank angle, and the shapes and the first level of the funnel (robust entry funnels, Sec. 4)."""

from functools import partial
from typing import NamedTuple

import numpy as np

from marsedl.methods.funnels.linear import minkowski_shape, slice_jacobians
from marsedl.methods.funnels.recursion import initial_level, largest_feedback
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import STATES_IN_KILOMETRES
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Uncertainty, Vehicle
from marsedl.papers.funnels.records import Gains, Linearization
from marsedl.replication.catalogue import stage


class Weights(NamedTuple):
    """What the regulator weighs."""

    scale: np.ndarray  # deviations of the states that cost as much as one another, (6,)
    bank: float  # bank angle that costs as much, rad
    state_cost_time: float  # s
    control_cost_time: float  # s
    terminal: float  # factor of the cost at the end


def weights_of(planet: Planet, guidance: Guidance) -> Weights:
    """Return the weights of the regulator."""
    return Weights(
        environment.state_scale(planet, guidance),
        guidance.scale_bank,
        guidance.state_cost_time,
        guidance.control_cost_time,
        guidance.terminal_weight,
    )


@stage()
def compute(
    planet: Planet,
    vehicle: Vehicle,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    linearization: Linearization,
) -> Gains:
    """Design the regulator and the shapes."""
    air = environment.disturbed_air(planet, uncertainty)
    close = partial(environment.closed_loop, planet, vehicle, air, linearization)
    semi_axes = environment.initial_semi_axes(planet, uncertainty)
    return designed(close, linearization, weights_of(planet, guidance), semi_axes, recursion.shape)


def designed(close, linearization: Linearization, weights: Weights, semi_axes, shape_kind) -> Gains:
    """Return the regulator, and the shapes and the first level of the funnel.

    Args:
        close: function of the gain on the half-step grid that returns the `ClosedLoop`.
        linearization: artifact.
        weights: of the regulator.
        semi_axes: of the initial set, (6,).
        shape_kind: "value_matrix" or "minimum_trace", see the input `shape`.
    """
    scale = weights.scale
    weight = np.diag(1.0 / scale**2)
    regulator = tvlqr(
        linearization.state_matrix[1::2],
        linearization.control_matrix[1::2, :, np.newaxis],
        np.diff(linearization.time),
        state_weight=weight / weights.state_cost_time,
        control_weight=np.array([[1.0 / (weights.bank**2 * weights.control_cost_time)]]),
        terminal_weight=weights.terminal * weight,
    )
    half_gain = at_half_steps(regulator.gains)[:, 0]
    shape, initial_set = regulator.values, environment.initial_set(semi_axes)
    if shape_kind == "minimum_trace":
        transitions, responses, _ = slice_jacobians(close(half_gain), np.arange(len(linearization.time)))
        shape = minkowski_shape(transitions, responses, initial_set, scale)
    first = initial_level(shape[0], initial_set)
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
