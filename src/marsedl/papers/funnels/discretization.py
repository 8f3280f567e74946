"""Funnels with more and fewer slices, by the integrated motion and by the Euler step (robust entry funnels, Eq. 22)."""

import numpy as np

from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import COMPLETE, CONDITIONS
from marsedl.papers.funnels.inputs import Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import propagate, samples, stage_at
from marsedl.papers.funnels.records import Discretization, Funnel, Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage

EXCESS_TOLERANCE = 1e-5  # of programs whose bounds are compared with others that differ by more than a thousandth


@stage(claimed_in=("corrected",), priority=1)
def compute(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
    gains: Gains,
    funnel: Funnel,
) -> Discretization:
    """Funnels with more and fewer slices; the Euler step at the levels of the motion (robust entry funnels, Eq. 22).

    In a stage the Euler step differs by terms of second order in its length.
    """
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    design = samples(recursion)
    studied = (environment.spacing_of(loop, stages) for stages in studies.studied_stages)
    spacings = np.array(sorted({*studied, int(recursion.steps_per_slice)}, reverse=True))
    # The funnel of the reading, where it is one of these.
    plain = recursion.condition == "flow" and recursion.sampling != "raw"
    plain = plain and not (recursion.inflated or uncertainty.additive)
    motion = [
        (funnel.level, funnel.outcome)
        if plain and spacing == recursion.steps_per_slice and funnel.outcome == COMPLETE
        else propagate(recursion, loop, gains, design, spacing)
        for spacing in spacings
    ]
    euler = [propagate(recursion, loop, gains, design, spacing, condition="euler") for spacing in spacings]
    funnels = [motion, euler]
    count = max(len(levels) for levels, _ in motion)
    level = np.array([[_padded(levels, count) for levels, _ in row] for row in funnels])
    excess = np.array(
        [
            _padded(euler_excess(recursion, loop, gains, design, spacing, levels), count - 1)
            for spacing, (levels, _) in zip(spacings, motion, strict=True)
        ]
    )
    existing = [row[np.isfinite(row)] for row in excess]

    def over_stages(statistic):
        return np.array([statistic(row) if len(row) else np.nan for row in existing])

    return Discretization(
        spacing=spacings,
        condition=np.array(CONDITIONS),
        level=level,
        outcome=np.array([[outcome for _, outcome in row] for row in funnels]),
        final_level=np.array([[levels[-1] for levels, _ in row] for row in funnels]),
        peak_level=np.array([[levels.max() for levels, _ in row] for row in funnels]),
        excess=excess,
        unsafe_share=over_stages(lambda row: np.mean(row < 0.0)),
        least_excess=over_stages(np.min),
        largest_excess=over_stages(np.max),
        mean_excess=over_stages(np.mean),
        mean_difference=over_stages(lambda row: np.mean(np.abs(row))),
    )


def euler_excess(recursion: Recursion, loop, gains: Gains, design, spacing, levels):
    """Euler bound over that of the motion at the same level, less one, of all stages of a funnel."""
    excess = np.full(len(levels) - 1, np.nan)
    for k in np.flatnonzero(np.isfinite(levels[:-1] + levels[1:])):
        stage = stage_at(recursion, loop, gains, k + 1, levels[k], int(spacing), condition="euler")
        euler = rank_one(stage.values(design.points), design.basis, tolerance=EXCESS_TOLERANCE).safe_bound
        excess[k] = euler * levels[k] / levels[k + 1] - 1.0
    return excess


def _padded(values, length):
    return np.concatenate([values, np.full(length - len(values), np.nan)])
