"""Stages and funnels of the entry with points on the slices, whatever the funnel of the reading takes.

Studies compute with them. A funnel that does not exist has its message, and NaN from where it ends.
"""

from functools import partial

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError, StageRule, forward
from marsedl.methods.funnels.stage import FunnelStage
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.multiplier_program import polynomial_coefficients
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, SPHERES
from marsedl.papers.funnels.records import Gains

FIT = 13  # stream of random numbers of the fits, keyed by that of the design


def samples(inputs, spheres=SPHERES, degree=BASIS_DEGREE):
    """Well chosen samples of the slice and the boundary of the disturbances."""
    return well_chosen_design(spheres, inputs.design_seed, degree)


def solver(inputs):
    """Solver of the programs as the funnel takes it."""
    return partial(rank_one, tolerance=inputs.program_tolerance)


def stage_at(inputs, loop, gains: Gains, number, level, spacing=None, **options):
    """A stage of any level; number: of its slice, from 1; spacing: fine steps to the next slice."""
    first, last = (int(step) for step in environment.slices(inputs, spacing)[number - 1 : number + 1])
    return FunnelStage(
        loop,
        first,
        last,
        gains.shape[first],
        gains.shape[last],
        float(level),
        **{"order": int(inputs.taylor_order)} | options,
    )


def fitted(inputs, stage):
    """Coefficients of the polynomial of a stage, and the error of their fit."""
    return polynomial_coefficients(
        stage.values, SPHERES.variables, 2 * BASIS_DEGREE, (inputs.design_seed, FIT), points=1000
    )


def propagate(inputs, loop, gains: Gains, design, spacing, first_level=None, **options):
    """Levels of a funnel, NaN from where it ends, and how it ended.

    Args:
        inputs: program tolerance, Taylor order and largest level.
        loop: closed loop.
        gains: shapes and first level.
        design: samples.
        spacing: fine steps from one slice to the next.
        first_level: instead of that of the gains.
        options: of `StageRule`.

    Returns:
        (levels of all slices, "complete" or a message).
    """
    steps = environment.slices(inputs, int(spacing))
    levels = np.full(len(steps), np.nan)
    levels[0] = gains.initial_level if first_level is None else first_level

    def note(number, level):
        levels[number - 1] = level

    rule = StageRule(**{"solver": solver(inputs), "order": int(inputs.taylor_order)} | options)
    try:
        with np.errstate(all="ignore"):  # a funnel that diverges leaves the range of the equations
            forward(loop, gains.shape[steps], steps, levels[0], design, rule, limit=inputs.largest_level, progress=note)
    except FunnelError as error:
        return levels, str(error)
    return levels, COMPLETE
