"""What the weights of the regulator and the shape of the slices do to the course of rho (text on Fig. 3)."""

from functools import partial

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels import gains as gains_stage
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import propagate, samples
from marsedl.papers.funnels.records import Linearization, Regulators
from marsedl.replication.catalogue import stage

SHAPES = {"value_matrix": "as the reading", "minimum_trace": "shape of least trace"}


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
) -> Regulators:
    """Funnels with one weight changed at a time, on coarse slices."""
    air, weights = environment.disturbed_air(planet, uncertainty), gains_stage.weights_of(planet, guidance)
    semi_axes = environment.initial_semi_axes(planet, uncertainty)
    close = partial(environment.closed_loop, planet, vehicle, air, linearization)
    factors = {
        "scales of the states": ("scale", studies.regulator_state_factors),
        "scale of the bank angle": ("bank", studies.regulator_bank_factors),
        "time of the running cost of the states": ("state_cost_time", studies.regulator_time_factors),
        "weight at the end": ("terminal", studies.regulator_terminal_factors),
    }
    variants = [(name, 1.0, weights, shape) for shape, name in SHAPES.items()] + [
        (name, factor, weights._replace(**{weight: factor * getattr(weights, weight)}), "value_matrix")
        for name, (weight, several) in factors.items()
        for factor in several
    ]
    design, levels, outcomes = samples(recursion), [], []
    for _, _, other_weights, shape in variants:
        gains = gains_stage.designed(close, linearization, other_weights, semi_axes, shape)
        loop = close(gains.half_gain)
        spacing = environment.spacing_of(loop, studies.coarse_stages)
        level, outcome = propagate(recursion, loop, gains, design, spacing)
        levels.append(level)
        outcomes.append(outcome)
    return Regulators(
        slice_time=linearization.time[environment.slices(loop, spacing)],
        variant=np.array([name for name, *_ in variants]),
        factor=np.array([factor for _, factor, *_ in variants]),
        level=np.array(levels),
        outcome=np.array(outcomes),
    )
