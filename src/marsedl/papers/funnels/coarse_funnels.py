"""Funnels on coarse slices by other programs, orders and directions (robust entry funnels, Sec. 5)."""

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError, StageRule, backward
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, SPHERES
from marsedl.papers.funnels.inputs import Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import fitted, propagate, samples, solver, stage_at
from marsedl.papers.funnels.records import CoarseFunnels, Discretization, Gains, Linearization
from marsedl.replication.artifacts import finite
from marsedl.replication.catalogue import stage

LOWER_ORDERS = {1: 1, 2: BASIS_DEGREE}  # than that of the inputs, each with the degree of the basis that it needs
SECOND_SOLVER = "CLARABEL"  # at a few stages; the other solver takes all
FIRST_SOLVER = "SCS"


@stage(claimed_in=("corrected",), priority=1)
def compute(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
    gains: Gains,
    discretization: Discretization,
) -> CoarseFunnels:
    """Funnels of lower order, by multipliers, backwards and back again."""
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    design = samples(recursion)
    spacing = environment.spacing_of(loop, studies.coarse_stages)
    steps = environment.slices(loop, spacing)
    variants = {"samples": by_samples(recursion, loop, gains, design, spacing, discretization)}
    for order, degree in LOWER_ORDERS.items():
        fitting = design if degree == BASIS_DEGREE else samples(recursion, degree=degree)
        variants[f"order {order}"] = propagate(recursion, loop, gains, fitting, spacing, order=order)
    # Every other one of the studied slices, as the second solver is slow.
    fine = recursion.steps_per_slice
    studied = [(environment.slice_at(loop, fine, share) - 1) * fine for share in studies.studied_slices[::2]]
    second_stages = np.unique(np.array(studied) // spacing)
    levels, states, second = by_multipliers(recursion, loop, gains, spacing, second_stages)
    variants["multipliers"] = levels, _outcome(levels, states)
    back, programs, outcome = backwards(recursion, loop, gains, design, steps, studies.backward_level)
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
        **second,
        backward_programs=programs,
        round_trip=float(np.abs(back / returned - 1.0).max()),
        round_trip_shortfall=float((returned / back - 1.0).max()),
    )


def by_samples(recursion: Recursion, loop, gains: Gains, design, spacing, discretization: Discretization):
    """Levels of the funnel and its outcome: those of the study of the discretization where it has these slices."""
    if spacing not in discretization.spacing:
        return propagate(recursion, loop, gains, design, spacing)
    number = list(discretization.spacing).index(spacing)
    count = len(environment.slices(loop, spacing))
    return discretization.level[0, number, :count], str(discretization.outcome[0, number])


def by_multipliers(recursion: Recursion, loop, gains: Gains, spacing, studied):
    """Levels by programs with multipliers (robust entry funnels, Sec. 5), and a second solver at the studied stages."""
    program = MultiplierProgram(SPHERES.dimensions, solver=FIRST_SOLVER, tolerance=recursion.program_tolerance)
    other = MultiplierProgram(SPHERES.dimensions, solver=SECOND_SOLVER)
    count = len(environment.slices(loop, spacing)) - 1
    level, levels, states = gains.initial_level, np.full(count + 1, np.nan), ["not solved"] * count
    difference, second_states = np.full(len(studied), np.nan), ["not solved"] * len(studied)
    levels[0] = level
    for k in range(count):
        coefficients, _ = fitted(recursion, stage_at(recursion, loop, gains, k + 1, level, spacing))
        certificate = program.solve(coefficients)
        states[k] = certificate.status
        for i in np.flatnonzero(studied == k):
            second = other.solve(coefficients)
            difference[i], second_states[i] = second.safe_bound / certificate.safe_bound - 1.0, second.status
        level *= certificate.safe_bound
        if not level <= recursion.largest_level:
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


def backwards(recursion: Recursion, loop, gains: Gains, design, steps, last_level):
    """Levels from the last to the first, programs solved for each, and how it ended."""
    try:
        with np.errstate(all="ignore"):
            rule = StageRule(solver=solver(recursion), order=int(recursion.taylor_order))
            solution = backward(loop, gains.shape[steps], steps, last_level, design, rule)
    except FunnelError as error:
        return np.full(len(steps), np.nan), np.zeros(len(steps) - 1, dtype=int), str(error)
    return solution.rho, solution.programs, COMPLETE


def _outcome(levels, states):
    return COMPLETE if np.isfinite(levels).all() else f"the funnel ends: {states[np.isfinite(levels).sum() - 1]}"
