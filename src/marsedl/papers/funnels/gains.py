"""Feedback of the bank angle, and the shapes and the first level of the funnel (robust entry funnels, Sec. 4)."""

import numpy as np

from marsedl.methods.funnels.linear import minkowski_shape, slice_jacobians
from marsedl.methods.funnels.recursion import initial_level
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Uncertainty, Vehicle
from marsedl.papers.funnels.records import Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage


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
    scale = environment.state_scale(planet, guidance)
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
    initial_set = environment.initial_set(environment.initial_semi_axes(planet, uncertainty))
    shape = regulator.values
    if recursion.shape == "minimum_trace":
        air = environment.disturbed_air(planet, uncertainty)
        loop = environment.closed_loop(planet, vehicle, air, linearization, half_gain)
        transitions, responses, _ = slice_jacobians(loop, np.arange(len(linearization.time)))
        shape = minkowski_shape(transitions, responses, initial_set, scale)
    return Gains(
        time=linearization.time,
        half_gain=half_gain,
        shape=shape,
        initial_level=initial_level(shape[0], initial_set),
    )
