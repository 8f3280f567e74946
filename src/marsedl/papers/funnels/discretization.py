"""Funnels with more and fewer slices, by the integrated motion and by the Euler step (robust entry funnels, Eq. 22)."""

import numpy as np

from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import COMPLETE, CONDITIONS
from marsedl.papers.funnels.programs import propagate, samples, stage_at
from marsedl.papers.funnels.records import Discretization, Funnel, Gains, Linearization
from marsedl.replication.catalogue import stage

EXCESS_TOLERANCE = 1e-5  # of programs whose bounds are compared with others that differ by more than a thousandth


@stage(claimed_in=("corrected",), priority=1)
def compute(inputs, linearization: Linearization, gains: Gains, funnel: Funnel) -> Discretization:
    """Funnels with more and fewer slices; the Euler step at the levels of the motion (robust entry funnels, Eq. 22).

    In a stage the Euler step differs by terms of second order in its length.
    """
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    design = samples(inputs)
    spacings = inputs.studied_spacings.astype(int)
    motion = [of_motion(inputs, loop, gains, design, spacing, funnel) for spacing in spacings]
    euler = [propagate(inputs, loop, gains, design, spacing, condition="euler") for spacing in spacings]
    found = [motion, euler]
    count = max(len(levels) for levels, _ in found[0])
    level = np.array([[_padded(levels, count) for levels, _ in row] for row in found])
    excess = np.array(
        [
            _padded(euler_excess(inputs, loop, gains, design, spacing, levels), count - 1)
            for spacing, (levels, _) in zip(spacings, found[0], strict=True)
        ]
    )
    known = [row[np.isfinite(row)] for row in excess]

    def over_stages(statistic):
        return np.array([statistic(row) if len(row) else np.nan for row in known])

    return Discretization(
        spacing=spacings,
        condition=np.array(CONDITIONS),
        level=level,
        outcome=np.array([[outcome for _, outcome in row] for row in found]),
        final_level=np.array([[levels[-1] for levels, _ in row] for row in found]),
        peak_level=np.array([[levels.max() for levels, _ in row] for row in found]),
        excess=excess,
        unsafe_share=over_stages(lambda row: np.mean(row < 0.0)),
        least_excess=over_stages(np.min),
        largest_excess=over_stages(np.max),
        mean_excess=over_stages(np.mean),
        mean_difference=over_stages(lambda row: np.mean(np.abs(row))),
    )


def of_motion(inputs, loop, gains: Gains, design, spacing, funnel: Funnel):
    """Levels of a funnel of the integrated motion and its outcome: those of the reading where it has this funnel."""
    plain = inputs.condition == "flow" and inputs.sampling != "raw" and not (inputs.inflated or inputs.additive)
    if plain and spacing == inputs.steps_per_slice and funnel.outcome == COMPLETE:
        return funnel.level, funnel.outcome
    return propagate(inputs, loop, gains, design, spacing)


def euler_excess(inputs, loop, gains: Gains, design, spacing, levels):
    """Euler bound over that of the motion at the same level, less one, of all stages of a funnel."""
    excess = np.full(len(levels) - 1, np.nan)
    for k in np.flatnonzero(np.isfinite(levels[:-1] + levels[1:])):
        stage = stage_at(inputs, loop, gains, k + 1, levels[k], int(spacing), condition="euler")
        euler = rank_one(stage.values(design.points), design.basis, tolerance=EXCESS_TOLERANCE).safe_bound
        excess[k] = euler * levels[k] / levels[k + 1] - 1.0
    return excess


def _padded(values, length):
    return np.concatenate([values, np.full(length - len(values), np.nan)])
