"""What the Euler step of a stage leaves out, at the levels of the motion (robust entry funnels, Eq. 22)."""

import numpy as np

from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.beyond.programs import propagate, samples, stage_at
from marsedl.papers.funnels.inputs import Inputs, Recursion
from marsedl.papers.funnels.records import EulerStep, Funnel, Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage

EXCESS_TOLERANCE = 1e-5  # of programs whose bounds are compared with others that differ by more than a thousandth


@stage(claimed_in=("corrected",))
def compute(given: Inputs, linearization: Linearization, gains: Gains, funnel: Funnel) -> EulerStep:
    """Bound every stage of the funnel by the Euler step, which differs by terms of second order in its length."""
    recursion = given.recursion
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    design, spacing = samples(recursion), recursion.steps_per_slice
    of_motion = recursion.condition == "flow" and recursion.sampling != "raw"
    of_motion = of_motion and not (recursion.inflated or given.uncertainty.additive)
    levels = funnel.level if of_motion else propagate(recursion, loop, gains, design, spacing)[0]
    return EulerStep(excess=euler_excess(recursion, loop, gains, design, spacing, levels))


def euler_excess(recursion: Recursion, loop, gains: Gains, design, spacing, levels):
    """Euler bound over that of the motion at the same level, less one, of all stages of a funnel."""
    excess = np.full(len(levels) - 1, np.nan)
    for k in np.flatnonzero(np.isfinite(levels[:-1] + levels[1:])):
        stage = stage_at(recursion, loop, gains, k + 1, levels[k], int(spacing), condition="euler")
        euler = rank_one(stage.values(design.points), design.basis, tolerance=EXCESS_TOLERANCE).safe_bound
        excess[k] = euler * levels[k] / levels[k + 1] - 1.0
    return excess
