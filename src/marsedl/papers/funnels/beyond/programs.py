"""Stages and funnels of the entry with points on the slices, whatever the funnel of the reading takes.

Studies compute with them. A funnel that does not exist has its message, and NaN from where it ends.
"""

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError, StageRule, forward
from marsedl.methods.funnels.stage import FunnelStage
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.multiplier_program import polynomial_coefficients
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, SPHERES
from marsedl.papers.funnels.funnel import solver
from marsedl.papers.funnels.inputs import Recursion
from marsedl.papers.funnels.records import Gains

FIT = 13  # stream of random numbers of the fits, keyed by that of the design


def samples(recursion: Recursion, spheres=SPHERES, degree=BASIS_DEGREE):
    """Well chosen samples of the slice and the boundary of the disturbances."""
    return well_chosen_design(spheres, recursion.design_seed, degree)


def stage_at(recursion: Recursion, loop, gains: Gains, number, level, spacing, **options):
    """A stage of any level; number: of its slice, from 1; spacing: fine steps to the next slice."""
    first, last = (int(step) for step in environment.slices(loop, spacing)[number - 1 : number + 1])
    return FunnelStage(
        loop,
        first,
        last,
        gains.shape[first],
        gains.shape[last],
        float(level),
        **{"order": int(recursion.taylor_order)} | options,
    )


def fitted(recursion: Recursion, stage):
    """Coefficients of the polynomial of a stage."""
    return polynomial_coefficients(
        stage.values, SPHERES.variables, 2 * BASIS_DEGREE, (recursion.design_seed, FIT), points=1000
    )[0]


def propagate(recursion: Recursion, loop, gains: Gains, design, spacing, first_level=None, **options):
    """Levels of a funnel, NaN from where it ends, and how it ended.

    Args:
        recursion: program tolerance, Taylor order and largest level.
        loop: closed loop.
        gains: shapes and first level.
        design: samples.
        spacing: fine steps from one slice to the next.
        first_level: instead of that of the gains.
        options: of `StageRule`.

    Returns:
        (levels of all slices, "complete" or a message).
    """
    steps = environment.slices(loop, spacing)
    levels = np.full(len(steps), np.nan)
    levels[0] = gains.initial_level if first_level is None else first_level

    def note(number, level):
        levels[number - 1] = level

    rule = StageRule(**{"solver": solver(recursion), "order": int(recursion.taylor_order)} | options)
    try:
        forward(loop, gains.shape[steps], steps, levels[0], design, rule, limit=recursion.largest_level, progress=note)
    except FunnelError as error:
        return levels, str(error)
    return levels, COMPLETE
