"""Stages at several slices: over levels, and with linear motion, whose largest value is known otherwise.

From a higher level a stage must reach a higher one (robust entry funnels, Eq. 25).
"""

import numpy as np

from marsedl.methods.funnels.linear import linear_exact, slice_jacobians, whitened_step
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import SLICE, SPHERES
from marsedl.papers.funnels.inputs import Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import samples, solver, stage_at
from marsedl.papers.funnels.records import Gains, Linearization, Monotonicity
from marsedl.replication.catalogue import stage

FACTORS = (0.25, 0.5, 1.0, 2.0)  # of the levels over which a stage is studied


@stage(claimed_in=("printed", "corrected", "euler", "inflated", "additive"))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
    gains: Gains,
) -> Monotonicity:
    """Solve the studied stages from several levels, and with linear motion."""
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    design, solve = samples(recursion), solver(recursion)
    spacing = recursion.steps_per_slice
    slices = np.array([environment.slice_at(loop, spacing, share) for share in studies.studied_slices])
    levels = np.outer(studies.studied_levels, FACTORS)
    reached = [
        [
            level
            * solve(stage_at(recursion, loop, gains, k, level, spacing).values(design.points), design.basis).safe_bound
            for level in row
        ]
        for k, row in zip(slices, levels, strict=True)
    ]
    return Monotonicity(
        studied_slice=slices,
        studied_level=levels,
        reached_level=np.array(reached),
        **linear_stages(recursion, loop, gains, design, slices, studies.studied_levels),
    )


def linear_stages(recursion: Recursion, loop, gains: Gains, design, slices, levels):
    """Stages with linear motion, whose largest value is known otherwise (robust entry funnels, Eq. 22)."""
    small, still = (samples(recursion, spheres, 1) for spheres in (SPHERES, SLICE))
    solve, rows = solver(recursion), []
    for number, level in zip(slices, levels, strict=True):
        stage = stage_at(recursion, loop, gains, number, level, recursion.steps_per_slice, order=1)
        shapes = np.array([stage.shape, stage.next_shape])
        transitions, responses, _ = slice_jacobians(loop, [stage.first, stage.last])
        alone = np.hstack([still.points, np.zeros((len(still.points), environment.DISTURBANCES))])
        rows.append(
            (
                solve(stage.values(small.points), small.basis).safe_bound,
                solve(stage.values(design.points), design.basis).safe_bound,
                linear_exact(transitions, responses, shapes, level)[1] / level,
                solve(stage.values(alone), still.basis).safe_bound,
                np.linalg.norm(whitened_step(transitions[0], responses[0], *shapes)[0], 2) ** 2,
            )
        )
    small_bound, large_bound, exact, still_bound, still_exact = np.transpose(rows)
    return {
        "linear_slice": slices,
        "linear_level": levels,
        "linear_small_bound": small_bound,
        "linear_large_bound": large_bound,
        "linear_exact": exact,
        "linear_still_bound": still_bound,
        "linear_still_exact": still_exact,
        "linear_gram_size": small.basis.shape[1],
        "linear_samples": len(small.points),
    }
