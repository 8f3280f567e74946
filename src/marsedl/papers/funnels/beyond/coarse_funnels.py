"""Funnels on coarse slices by other programs and directions (robust entry funnels, Sec. 5)."""

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError, StageRule, backward
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import COMPLETE, SPHERES
from marsedl.papers.funnels.beyond.programs import fitted, propagate, samples, solver, stage_at
from marsedl.papers.funnels.inputs import Inputs, Recursion
from marsedl.papers.funnels.records import CoarseFunnels, Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage

SOLVER = "SCS"  # of the programs with multipliers: faster than Clarabel


@stage(claimed_in=("corrected",))
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> CoarseFunnels:
    """Funnels by samples, by multipliers, backwards and back again."""
    recursion = given.recursion
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    design = samples(recursion)
    spacing = environment.spacing_of(loop, given.studies.coarse_stages)
    steps = environment.slices(loop, spacing)
    variants = {"samples": propagate(recursion, loop, gains, design, spacing)}
    levels, states = by_multipliers(recursion, loop, gains, spacing)
    variants["multipliers"] = levels, _outcome(levels, states)
    back, programs, outcome = backwards(recursion, loop, gains, design, steps, given.studies.backward_level)
    variants["backward"] = back, outcome
    variants["returned"] = (
        propagate(recursion, loop, gains, design, spacing, back[0]) if outcome == COMPLETE else variants["backward"]
    )
    returned = variants["returned"][0]
    return CoarseFunnels(
        coarse_step=steps,
        variant=np.array(list(variants)),
        variant_level=np.array([levels for levels, _ in variants.values()]),
        variant_outcome=np.array([outcome for _, outcome in variants.values()]),
        multiplier_status=np.array(states),
        multiplier_difference=float(np.abs(levels / variants["samples"][0] - 1.0).max()),
        backward_programs=programs,
        round_trip=float(np.abs(back / returned - 1.0).max()),
        round_trip_shortfall=float((returned / back - 1.0).max()),
    )


def by_multipliers(recursion: Recursion, loop, gains: Gains, spacing):
    """Levels by programs with multipliers (robust entry funnels, Sec. 5), and how their solver ended."""
    program = MultiplierProgram(SPHERES.dimensions, solver=SOLVER, tolerance=recursion.program_tolerance)
    count = len(environment.slices(loop, spacing)) - 1
    level, levels, states = gains.initial_level, np.full(count + 1, np.nan), ["not solved"] * count
    levels[0] = level
    for k in range(count):
        coefficients = fitted(recursion, stage_at(recursion, loop, gains, k + 1, level, spacing))
        certificate = program.solve(coefficients)
        states[k] = certificate.status
        level *= certificate.safe_bound
        if not level <= recursion.largest_level:
            break
        levels[k + 1] = level
    return levels, states


def backwards(recursion: Recursion, loop, gains: Gains, design, steps, last_level):
    """Levels from the last to the first, programs solved for each, and how it ended."""
    rule = StageRule(solver=solver(recursion), order=int(recursion.taylor_order))
    try:
        solution = backward(loop, gains.shape[steps], steps, last_level, design, rule)
    except FunnelError as error:
        return np.full(len(steps), np.nan), np.zeros(len(steps) - 1, dtype=int), str(error)
    return solution.rho, solution.programs, COMPLETE


def _outcome(levels, states):
    return COMPLETE if np.isfinite(levels).all() else f"the funnel ends: {states[np.isfinite(levels).sum() - 1]}"
