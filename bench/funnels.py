"""The entry funnels: the program of a stage, whole funnels by samples and by coefficients, flights."""

import time
from functools import partial

import numpy as np
from measuring import inputs_of, interleaved, run

from marsedl.methods.funnels.monte_carlo import fly
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.sos.conic_program import ConicProgram
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.methods.sos.variety import Spheres
from marsedl.papers.funnels import PAPER, environment
from marsedl.papers.funnels.basics import SPHERES
from marsedl.papers.funnels.beyond.programs import fitted, propagate, samples, solver, stage_at

FIGURE = "fig03"
MINUTE = 60.0  # s, the paper's "approximately one minute"
TRIALS = 10_000
AGREEMENT = 1e-5  # of bounds by different solvers, relative
SOLVERS = ("Clarabel", "SCS")


def by_coefficients(recursion, name):
    """The program of a stage with multipliers, compiled for a solver."""
    return MultiplierProgram(SPHERES.dimensions, solver=name.upper(), tolerance=recursion.program_tolerance)


def compare_stage(row, loop, gains, design):
    """The benchmark stage by samples and by coefficients; all bounds agree."""
    studies, recursion = inputs_of(PAPER.slug).studies, inputs_of(PAPER.slug).recursion
    spacing, basis = recursion.steps_per_slice, design.basis
    number = environment.slice_at(loop, spacing, studies.benchmark_slice)
    posed = stage_at(recursion, loop, gains, number, studies.benchmark_level, spacing)
    values, coefficients = posed.values(design.points), fitted(recursion, posed)
    conic = ConicProgram(basis, "CLARABEL", recursion.program_tolerance)
    multipliers = by_coefficients(recursion, "Clarabel")
    solves = {
        "samples, rank-one": lambda: solver(recursion)(values, basis),
        "samples, Clarabel": lambda: conic.solve(values),
        "coefficients, Clarabel": lambda: multipliers.solve(coefficients),
    }
    bounds = [solve().safe_bound for solve in solves.values()]
    np.testing.assert_allclose(bounds, bounds[0], rtol=AGREEMENT)
    taken = interleaved(list(solves.values()), 3)
    for name, each in zip(solves, taken, strict=True):
        row(f"a stage by {name}", each, "s")
    row("speed of coefficients over samples, Clarabel, a stage", taken[1] / taken[2], "ratio")


def compare_funnels(row, loop, gains, design):
    """The whole funnel by samples and by coefficients, and flights."""
    recursion = inputs_of(PAPER.slug).recursion
    random, spacing = np.random.Generator(np.random.Philox(recursion.design_seed)), recursion.steps_per_slice
    directions = Spheres((len(environment.STATES),)).random_points(TRIALS, random)
    starts = directions @ spread_of(gains.shape[0], gains.initial_level).T
    disturbances = Spheres((environment.DISTURBANCES,)).random_points(TRIALS, random)
    funnel = partial(propagate, recursion, loop, gains, design, spacing)
    levels, outcome = funnel()
    assert np.isfinite(levels).all(), outcome
    fast, flights = interleaved([funnel, partial(fly, loop, gains.shape, starts, disturbances)], 3)
    row("whole funnel by samples, rank-one", fast, "s", below=MINUTE)
    for name in SOLVERS:
        program, found, start = by_coefficients(recursion, name), [gains.initial_level], time.perf_counter()
        for number in range(1, len(levels)):
            posed = stage_at(recursion, loop, gains, number, found[-1], spacing)
            found.append(found[-1] * program.solve(fitted(recursion, posed)).safe_bound)
        slow = time.perf_counter() - start
        np.testing.assert_allclose(found, levels, rtol=len(levels) * AGREEMENT)
        row(f"whole funnel by coefficients, {name}", slow, "s")
        row(f"speed of rank-one over {name} by coefficients, whole funnel", slow / fast, "ratio")
    row(f"Monte Carlo, {TRIALS:,} flights", flights, "s")
    row(f"cost of the funnel over {TRIALS:,} flights", fast / flights, "ratio")
    row(f"cost of the paper's minute over {TRIALS:,} flights", MINUTE / flights, "ratio")


def measure(row):
    """Measure everything of this paper; row: `measuring.add_row` for it."""
    paper, i = run(PAPER.slug), inputs_of(PAPER.slug)
    gains, design, air = paper.record("gains"), samples(i.recursion), environment.disturbed_air(i.planet, i.uncertainty)
    loop = environment.closed_loop(i.planet, i.vehicle, air, paper.record("linearization"), gains.half_gain)
    compare_stage(row, loop, gains, design)
    compare_funnels(row, loop, gains, design)
