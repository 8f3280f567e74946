"""Levels that a stage reaches from several levels: they must not decrease (robust entry funnels, Eq. 25)."""

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.inputs import Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import samples, solver, stage_at
from marsedl.papers.funnels.records import Gains, Linearization, Monotonicity
from marsedl.replication.catalogue import stage

FACTORS = (0.25, 0.5, 1.0, 2.0)  # of the levels over which a stage is studied


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
    gains: Gains,
) -> Monotonicity:
    """Solve the studied stages from several levels."""
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    design, solve = samples(recursion), solver(recursion)
    spacing = recursion.steps_per_slice
    slices = studies.studied_slices.astype(int)
    levels = np.outer(studies.studied_levels, FACTORS)
    reached = [
        [
            level
            * solve(stage_at(recursion, loop, gains, k, level, spacing).values(design.points), design.basis).safe_bound
            for level in row
        ]
        for k, row in zip(slices, levels, strict=True)
    ]
    return Monotonicity(studied_slice=slices, studied_level=levels, reached_level=np.array(reached))
