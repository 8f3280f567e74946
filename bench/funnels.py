"""The entry funnels: solvers and forms of a stage and of the whole funnel, flights, proof, the whole paper."""

import time
from functools import partial
from types import SimpleNamespace

import numpy as np
from measuring import inputs_of, interleaved, run, say, sections

from marsedl.methods.funnels.monte_carlo import boundary_deviations, fly, uniform_directions
from marsedl.methods.funnels.recursion import StageRule, forward
from marsedl.methods.funnels.stage import FunnelStage
from marsedl.methods.sos.conic_program import ConicProgram
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.multiplier_program import MultiplierProgram, polynomial_coefficients
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import PAPER, environment, proven
from marsedl.papers.funnels.funnel import BASIS_DEGREE, SPHERES

PIPELINE_LIMIT = 360.0  # CPU s
FIGURE = "fig03"
MINUTE = 60.0  # s, the paper's "approximately one minute"
TRIALS = 10_000
AGREEMENT = 1e-5  # of bounds by different solvers, relative
SCALED_FROM = 3  # stages, evenly over the funnel, where all of them would take minutes
SOLVERS = {"Clarabel": "CLARABEL", "SCS": "SCS"}


# --- what is measured -------------------------------------------------------------------------------------------------


def prepare():
    """Closed loop, shapes, slices, samples and inputs of the corrected reading."""
    paper, i = run(PAPER.slug), inputs_of(PAPER.slug)
    flown, designed, recursion = paper.record("linearization"), paper.record("gains"), i.recursion
    air = environment.disturbed_air(i.planet, i.uncertainty)
    loop = environment.closed_loop(i.planet, i.vehicle, air, flown, designed.half_gain)
    slices = environment.slices(loop, recursion.steps_per_slice)
    return SimpleNamespace(
        recursion=recursion,
        linearization=flown,
        gains=designed,
        loop=loop,
        slices=slices,
        shapes=designed.shape[slices],
        design=well_chosen_design(SPHERES, recursion.design_seed, BASIS_DEGREE),
        slice=environment.slice_at(loop, recursion.steps_per_slice, i.studies.benchmark_slice) - 1,
        level=i.studies.benchmark_level,
    )


def stage(funnel, number, level):
    """A stage from slice `number`, counted from 0."""
    first, last = (int(step) for step in funnel.slices[number : number + 2])
    shape, next_shape = funnel.shapes[number : number + 2]
    return FunnelStage(funnel.loop, first, last, shape, next_shape, float(level), funnel.recursion.taylor_order)


def fitted(funnel, posed):
    """Coefficients of the polynomial of a stage."""
    degree = funnel.recursion.taylor_order + 1
    return polynomial_coefficients(posed.values, SPHERES.variables, degree, funnel.recursion.design_seed)[0]


def programs(funnel):
    """The program of a stage in every form and by every solver; compiled once.

    Returns:
        Tuple of those that take values at the samples, and those that take coefficients, by name.
    """
    tolerance, basis = funnel.recursion.program_tolerance, funnel.design.basis
    sampled = {"rank-one": partial(rank_one, basis=basis, tolerance=tolerance)}
    sampled |= {name: ConicProgram(basis, solver, tolerance).solve for name, solver in SOLVERS.items()}
    matched = {
        name: MultiplierProgram(SPHERES.dimensions, solver=solver, tolerance=tolerance).solve
        for name, solver in SOLVERS.items()
    }
    return sampled, matched


def timed(function):
    """Wall time (s) of one call, and what it returns."""
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def levels_by_samples(funnel, solve):
    """Levels of the whole funnel by programs on the samples."""
    rule = StageRule(order=funnel.recursion.taylor_order, solver=lambda values, basis: solve(values))
    return forward(funnel.loop, funnel.shapes, funnel.slices, funnel.gains.initial_level, funnel.design, rule).rho


def levels_by_coefficients(funnel, solve):
    """Levels of the whole funnel by programs on coefficients."""
    levels = [funnel.gains.initial_level]
    for number in range(len(funnel.slices) - 1):
        bound = solve(fitted(funnel, stage(funnel, number, levels[-1]))).safe_bound
        levels.append(levels[-1] * bound)
    return np.array(levels)


def scaled_seconds(funnel, solve, levels):
    """Wall time of some stages of the funnel by a program on the samples, scaled to all of them."""
    count = len(funnel.slices) - 1
    seconds = 0.0
    for number in np.linspace(0, count - 1, SCALED_FROM).round().astype(int):
        posed = stage(funnel, number, levels[number])
        taken, certificate = timed(lambda posed=posed: solve(posed.values(funnel.design.points)))
        np.testing.assert_allclose(certificate.safe_bound, levels[number + 1] / levels[number], rtol=AGREEMENT)
        seconds += taken
    return seconds * count / SCALED_FROM


# --- measuring --------------------------------------------------------------------------------------------------------


def compare_stage(row, funnel, sampled, matched):
    """The benchmark stage in every form; all bounds agree."""
    posed = stage(funnel, funnel.slice, funnel.level)
    values, coefficients = posed.values(funnel.design.points), fitted(funnel, posed)
    solves = {f"a stage by samples, {name}": partial(solve, values) for name, solve in sampled.items()}
    solves |= {f"a stage by coefficients, {name}": partial(solve, coefficients) for name, solve in matched.items()}
    bounds = [solve().safe_bound for solve in solves.values()]
    np.testing.assert_allclose(bounds, bounds[0], rtol=AGREEMENT)
    functions = [*solves.values(), lambda: posed.values(funnel.design.points)]
    *seconds, jets = interleaved(functions, 3)
    taken = dict(zip(solves, seconds, strict=True))
    for name, value in taken.items():
        row(name, value, "s")
    best = taken["a stage by samples, rank-one"]
    for form in ("samples", "coefficients"):
        for name in SOLVERS:
            row(
                f"speed of rank-one over {name} by {form}, a stage", taken[f"a stage by {form}, {name}"] / best, "ratio"
            )
    for name in SOLVERS:
        ratio = taken[f"a stage by samples, {name}"] / taken[f"a stage by coefficients, {name}"]
        row(f"speed of coefficients over samples, {name}, a stage", ratio, "ratio")
    row("values at the samples, share of a stage", jets / (jets + best), "1")


def compare_funnels(row, funnel, sampled, matched):
    """The whole funnel in every form, where that takes no more than two minutes, and flights.

    Returns:
        Wall time of the funnel by samples and the rank-one solver, s.
    """
    random = np.random.Generator(np.random.Philox(funnel.recursion.design_seed))
    starts = boundary_deviations(
        funnel.shapes[0], funnel.gains.initial_level, uniform_directions(random, TRIALS, len(environment.STATES))
    )
    disturbances = uniform_directions(random, TRIALS, environment.DISTURBANCES)
    levels = levels_by_samples(funnel, sampled["rank-one"])
    design, fast, flights = interleaved(
        (
            lambda: well_chosen_design(SPHERES, funnel.recursion.design_seed, BASIS_DEGREE),
            lambda: levels_by_samples(funnel, sampled["rank-one"]),
            lambda: fly(funnel.loop, funnel.gains.shape, starts, disturbances),
        ),
        3,
    )
    row("design of the samples", design, "s")
    row("whole funnel by samples, rank-one", fast, "s", below=MINUTE)
    for name in SOLVERS:
        slow, found = timed(partial(levels_by_coefficients, funnel, matched[name]))
        np.testing.assert_allclose(found, levels, rtol=len(levels) * AGREEMENT)
        row(f"whole funnel by coefficients, {name}", slow, "s")
        row(f"speed of rank-one over {name} by coefficients, whole funnel", slow / fast, "ratio")
    for name in SOLVERS:
        slow = scaled_seconds(funnel, sampled[name], levels)
        row(f"whole funnel by samples, {name}, from {SCALED_FROM} stages", slow, "s")
        row(f"speed of rank-one over {name} by samples, whole funnel", slow / fast, "ratio")
    row(f"Monte Carlo, {TRIALS:,} flights", flights, "s")
    row(f"cost of the funnel over {TRIALS:,} flights", fast / flights, "ratio")
    row(f"cost of the paper's minute over {TRIALS:,} flights", MINUTE / flights, "ratio")
    return fast


def measure(row):
    """Measure everything of this paper; row: of `measuring.Rows`."""
    say("funnels: reference, regulator and samples")
    funnel = prepare()
    sampled, matched = programs(funnel)
    say("funnels: a stage in every form")
    compare_stage(row, funnel, sampled, matched)
    say("funnels: whole funnels and flights")
    fast = compare_funnels(row, funnel, sampled, matched)
    say("funnels: proof")
    taken = sections(PAPER.slug, proven.compute)
    seconds, found = timed(lambda: proven.compute(**taken, linearization=funnel.linearization, gains=funnel.gains))
    assert found.proven, found.outcome
    row("proven funnel", seconds, "s")
    row("cost of the proven funnel over the funnel", seconds / fast, "ratio")
