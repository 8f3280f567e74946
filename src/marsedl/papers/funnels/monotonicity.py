"""Levels that a stage reaches from several levels: they must not decrease (robust entry funnels, Eq. 25)."""

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.programs import samples, solver, stage_at
from marsedl.papers.funnels.records import Gains, Linearization, Monotonicity
from marsedl.replication.catalogue import stage

FACTORS = (0.25, 0.5, 1.0, 2.0)  # of the levels over which a stage is studied


@stage(claimed_in=("corrected",))
def compute(inputs, linearization: Linearization, gains: Gains) -> Monotonicity:
    """Solve the studied stages from several levels."""
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    design, solve = samples(inputs), solver(inputs)
    slices = inputs.studied_slices.astype(int)
    levels = np.outer(inputs.studied_levels, FACTORS)
    reached = [
        [
            level * solve(stage_at(inputs, loop, gains, k, level).values(design.points), design.basis).safe_bound
            for level in row
        ]
        for k, row in zip(slices, levels, strict=True)
    ]
    return Monotonicity(studied_slice=slices, studied_level=levels, reached_level=np.array(reached))
