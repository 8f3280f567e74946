"""Funnels on coarse slices by other programs, orders and directions (robust entry funnels, Sec. 5)."""

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError, StageRule, backward
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, SPHERES, finite
from marsedl.papers.funnels.programs import fitted, propagate, samples, solver, stage_at
from marsedl.papers.funnels.records import CoarseFunnels, Discretization, Gains, Linearization
from marsedl.replication.catalogue import stage

LOWER_ORDERS = {1: 1, 2: BASIS_DEGREE}  # than that of the inputs, each with the degree of the basis that it needs
SECOND_SOLVER = "CLARABEL"  # at a few stages; the other solver takes all
FIRST_SOLVER = "SCS"


@stage(claimed_in=("corrected",), priority=1)
def compute(inputs, linearization: Linearization, gains: Gains, discretization: Discretization) -> CoarseFunnels:
    """Funnels of lower order, by multipliers, backwards and back again."""
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    design = samples(inputs)
    spacing = int(inputs.backward_steps_per_slice)
    steps = environment.slices(inputs, spacing)
    found = {"samples": by_samples(inputs, loop, gains, design, discretization)}
    for order, degree in LOWER_ORDERS.items():
        fitting = design if degree == BASIS_DEGREE else samples(inputs, degree=degree)
        found[f"order {order}"] = propagate(inputs, loop, gains, fitting, spacing, order=order)
    levels, states, second = by_multipliers(inputs, loop, gains, spacing)
    found["multipliers"] = levels, _outcome(levels, states)
    back, programs, outcome = backwards(inputs, loop, gains, design, steps)
    found["backward"] = back, outcome
    found["returned"] = (
        propagate(inputs, loop, gains, design, spacing, back[0]) if outcome == COMPLETE else found["backward"]
    )
    returned = found["returned"][0]
    return CoarseFunnels(
        coarse_step=steps,
        variant=np.array(list(found)),
        variant_level=np.array([levels for levels, _ in found.values()]),
        variant_outcome=np.array([outcome for _, outcome in found.values()]),
        multiplier_status=np.array(states),
        multiplier_difference=float(np.abs(levels / found["samples"][0] - 1.0).max()),
        **second,
        backward_programs=programs,
        round_trip=float(np.abs(back / returned - 1.0).max()),
        round_trip_shortfall=float((returned / back - 1.0).max()),
    )


def by_samples(inputs, loop, gains: Gains, design, discretization: Discretization):
    """Levels of the funnel and its outcome: those of the study of the discretization where it has these slices."""
    spacing = int(inputs.backward_steps_per_slice)
    if spacing not in discretization.spacing:
        return propagate(inputs, loop, gains, design, spacing)
    number = list(discretization.spacing).index(spacing)
    count = len(environment.slices(inputs, spacing))
    return discretization.level[0, number, :count], str(discretization.outcome[0, number])


def by_multipliers(inputs, loop, gains: Gains, spacing):
    """Levels by programs with multipliers (robust entry funnels, Sec. 5), and a second solver at a few stages."""
    program = MultiplierProgram(SPHERES.dimensions, solver=FIRST_SOLVER, tolerance=inputs.program_tolerance)
    other = MultiplierProgram(SPHERES.dimensions, solver=SECOND_SOLVER)
    count = len(environment.slices(inputs, spacing)) - 1
    level, levels, states = gains.initial_level, np.full(count + 1, np.nan), ["not solved"] * count
    # The studied slices are counted among those of the inputs; every other one, as the second solver is slow.
    studied = np.unique((inputs.studied_slices[::2].astype(int) - 1) * int(inputs.steps_per_slice) // spacing)
    difference, second_states = np.full(len(studied), np.nan), ["not solved"] * len(studied)
    levels[0] = level
    for k in range(count):
        coefficients, _ = fitted(inputs, stage_at(inputs, loop, gains, k + 1, level, spacing))
        certificate = program.solve(coefficients)
        states[k] = certificate.status
        for i in np.flatnonzero(studied == k):
            second = other.solve(coefficients)
            difference[i], second_states[i] = second.safe_bound / certificate.safe_bound - 1.0, second.status
        level *= certificate.safe_bound
        if not level <= inputs.largest_level:
            break
        levels[k + 1] = level
    return (
        levels,
        states,
        {
            "second_stage": studied + 1,
            "second_difference": finite(difference),
            "second_status": np.array(second_states),
        },
    )


def backwards(inputs, loop, gains: Gains, design, steps):
    """Levels from the last to the first, programs solved for each, and how it ended."""
    try:
        with np.errstate(all="ignore"):
            rule = StageRule(solver=solver(inputs), order=int(inputs.taylor_order))
            found = backward(loop, gains.shape[steps], steps, inputs.backward_level, design, rule)
    except FunnelError as error:
        return np.full(len(steps), np.nan), np.zeros(len(steps) - 1, dtype=int), str(error)
    return found.rho, found.programs, COMPLETE


def _outcome(levels, states):
    return COMPLETE if np.isfinite(levels).all() else f"the funnel ends: {states[np.isfinite(levels).sum() - 1]}"
