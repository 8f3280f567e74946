"""Other solutions than the paper's: those of less control energy, other conditions on the bank, and its branch's fold.

The problem without weight has several local minima. Where the nominal's branch over the weight has a fold, it is
followed through it with the final error given instead: what lies beyond minimises the energy at that error, but no
weighted sum.
"""

from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import SOLVED, BranchEndError, Condition, Guess, Program, Solution, Variable
from marsedl.methods.desensitization import Desensitized, column
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, POSITIONS, WARM, Setup, attempt
from marsedl.papers.desensitized.inputs import Design, Mission, Planet, Simulation, Solver, Vehicle
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import Branches, Nominal, Tradeoff
from marsedl.papers.desensitized.tradeoff import effort
from marsedl.replication.pipeline.catalogue import stage

CURVE_POINTS = 12
FOLD_TOLERANCE = 1e-4  # of the error at a fold; the weight there is known to the square of it
SMALLEST_STEP = 0.05  # of the way to the next value; a branch that needs shorter steps ends
STEP_ITERATIONS = 30  # a step on a branch takes about ten
SAME = 1e-4  # relative difference of control energies below which two solutions are one, or its mirror image


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    solver: Solver,
    design: Design,
    simulation: Simulation,
    nominal: Nominal,
    tradeoff: Tradeoff,
) -> Branches:
    """Look for less control energy, vary the conditions on the bank, and follow the nominal's branch."""
    setup = Setup(planet, vehicle, mission, solver, design)
    solutions = local_minima(setup, nominal, tradeoff)
    curve, fold = nominal_curve(setup, simulation, solutions[0], tradeoff)
    return Branches(
        name=np.array([entry_problem.branch_name(solution.states[:, BANK]) for solution in solutions]),
        effort=np.array([effort(solution) for solution in solutions]),
        **bank_conditions(setup, nominal),
        curve_error=np.array([given_error(simulation, s) for s in curve]),
        curve_effort=np.array([effort(s) for s in curve]),
        curve_weight=np.array([weight_at_error(s) for s in curve]),
        fold_weight=fold[1],
        fold_error=fold[0] * abs(simulation.tabulated_error),
    )


def local_minima(setup: Setup, nominal: Nominal, tradeoff: Tradeoff) -> list[Solution]:
    """Different solutions without weight: the nominal, and those that the rows of Table 3 lead to."""
    solver, declared = setup.solver, entry_problem.problem(setup.planet, setup.vehicle, setup.mission)
    transcribed = entry_problem.program(setup.planet, solver, declared)
    solutions = [entry_problem.solve(solver, "nominal", transcribed, as_guess(nominal), barrier=WARM)]
    for row in entry_problem.of_rows(tradeoff):
        guess = Guess(row.state, row.bank_acceleration[:, np.newaxis], float(row.time[-1]))
        solution = attempt(solver, transcribed, guess, barrier=WARM)
        known = np.array([effort(other) for other in solutions])
        if solution.status == SOLVED and (np.abs(known / effort(solution) - 1.0) > SAME).all():
            solutions.append(solution)
    return solutions


# ---- conditions on the bank ------------------------------------------------------------------------------------------


def bank_conditions(setup: Setup, nominal: Nominal):
    """Solve from the nominal with every choice of the four conditions on the bank.

    What is fixed is so at the inputs' value, or at zero where they leave it free.
    """
    banks = entry_problem.bank_ends(setup.mission)
    fixed = np.array(list(product((False, True), repeat=len(banks))))
    solutions = []
    for choice in fixed:
        ends = entry_problem.BankEnds(
            *((bank or 0.0) if is_fixed else None for bank, is_fixed in zip(banks, choice, strict=True))
        )
        declared = entry_problem.problem(setup.planet, setup.vehicle, setup.mission, ends)
        transcribed = entry_problem.program(setup.planet, setup.solver, declared)
        solutions.append(attempt(setup.solver, transcribed, as_guess(nominal), barrier=WARM))
    solved = np.array([solution.status == SOLVED for solution in solutions])
    totals = [entry_problem.cumulative(solution.time, solution.controls[:, 0]) for solution in solutions]
    return {
        "set_fixed": fixed,
        "set_status": np.array([solution.status for solution in solutions]),
        "set_effort": np.where(solved, [effort(solution) for solution in solutions], np.nan),
        "set_cumulative": np.where(solved, totals, np.nan),
        "set_reversals": np.array([entry_problem.reversals(solution.states[:, BANK]) for solution in solutions]),
    }


# ---- the nominal's branch with the final error given -----------------------------------------------------------------


class ErrorProgram(NamedTuple):
    """Least control energy at a given norm of the radius column, m/m: where a multiplier takes the weight's place."""

    extended: Desensitized
    program: Program


def error_program(setup: Setup) -> ErrorProgram:
    """Build it.

    Conditions know no given parameters. So the norm demanded is the mean rate of a further state, which starts at zero
    and whose rate it is.
    """
    planet = setup.planet
    extended = entry_problem.desensitized(setup, [entry_problem.position_error(planet, "radius")])
    base = extended.problem
    states, added = len(base.states), (Variable("elapsed", 100.0), Variable("demanded", 1000.0))

    def rates(*arguments):
        demanded = arguments[-2]
        return (*base.rates(*arguments[:states], *arguments[states + len(added) :]), 1.0, demanded)

    def running_cost(*arguments):
        return (arguments[states + len(added)] / entry_problem.DEGREE) ** 2

    condition = Condition(
        "norm of the radius column",
        lambda start, end: radius_norm(planet, end) - end["demanded"] / end["elapsed"],
    )
    declared = replace(
        base,
        rates=rates,
        states=(*base.states, *added),
        initial={**base.initial, **{variable.name: 0.0 for variable in added}},
        running_cost=running_cost,
        boundary=(*base.boundary, condition),
        given=("norm", "density_factor"),
    )
    return ErrorProgram(extended, entry_problem.program(planet, setup.solver, declared))


def radius_norm(planet: Planet, end):
    """Norm of the final position in metres against the radius at entry, from states by name."""
    parts = zip(POSITIONS, entry_problem.lengths(planet), strict=True)
    return np.sqrt(sum((length * end[column(name, "radius")]) ** 2 for name, length in parts))


def held_at_own_error(planet: Planet, solver: Solver, error_problem: ErrorProgram, solution: Solution) -> Solution:
    """A solution of the problem without weight as one at its own final error, where the multiplier vanishes."""
    guess = error_problem.extended.guess(solution)
    end = dict(zip([v.name for v in error_problem.extended.problem.states], guess.states[-1], strict=True))
    norm = float(radius_norm(planet, end))
    states = np.column_stack([guess.states, solution.time, norm * solution.time])
    return attempt(
        solver,
        error_problem.program,
        guess._replace(states=states),
        {"norm": norm, "density_factor": 1.0},
        barrier=WARM,
    )


def nominal_curve(setup: Setup, simulation: Simulation, solution: Solution, tradeoff: Tradeoff):
    """The nominal's branch from its own error downwards, through a fold if there is one: solutions, and the fold.

    Where the path over the weight has lost the nominal's branch, the curve goes twice as far; else to the rows' errors.
    """
    solver, error_problem = setup.solver, error_program(setup)
    first = held_at_own_error(setup.planet, solver, error_problem, solution)
    if first.status != SOLVED:
        return [], (np.nan, np.nan)
    top = first.given["norm"]
    if len(tradeoff.fold_error):
        bottom = 2.0 * tradeoff.fold_error[0, 0] / abs(simulation.tabulated_error) - top
    else:
        rows = tradeoff.error[np.isfinite(tradeoff.printed_weight)]
        bottom = np.linalg.norm(rows, axis=1).min() / abs(simulation.tabulated_error)
    # The weight rises steeply at first: short steps there.
    values = top - max(top - bottom, 0.0) * (np.arange(1, CURVE_POINTS + 1) / CURVE_POINTS) ** 2
    points = [first]

    def same_branch(before, after):
        return np.abs(after.states[:, BANK] - before.states[:, BANK]).max() < setup.design.branch_tolerance

    with suppress(BranchEndError):  # what was reached is the result
        error_problem.program.follow(
            first,
            "norm",
            values,
            same_branch=same_branch,
            smallest_step=SMALLEST_STEP,
            on_step=points.append,
            tolerance=solver.solver_tolerance,
            iterations=STEP_ITERATIONS,
            barrier=WARM,
        )
    return with_fold(solver, error_problem, points)


def with_fold(solver: Solver, error_problem: ErrorProgram, points):
    """Points with further ones around the largest weight, and the norm and the weight of the fold.

    It is found by Brent's method between the neighbours of the point of the largest weight; NaN where that lies at an
    end.
    """
    from scipy.optimize import minimize_scalar

    points = sorted(points, key=lambda point: point.given["norm"])
    highest = int(np.argmax([weight_at_error(point) for point in points]))
    if highest in (0, len(points) - 1):
        return points[::-1], (np.nan, np.nan)
    solved_points = {point.given["norm"]: point for point in points}

    def loss(norm):
        norm = float(norm)
        if norm not in solved_points:
            nearest = min(solved_points.values(), key=lambda point: abs(point.given["norm"] - norm))
            given = {"norm": norm, "density_factor": 1.0}
            further = attempt(solver, error_problem.program, nearest, given, barrier=WARM, iterations=STEP_ITERATIONS)
            if further.status != SOLVED:
                return np.inf
            solved_points[norm] = further
        return -weight_at_error(solved_points[norm])

    bracket = [point.given["norm"] for point in points[highest - 1 : highest + 2]]
    minimize_scalar(loss, bracket, method="brent", options={"xtol": FOLD_TOLERANCE})
    top = max(solved_points.values(), key=weight_at_error)
    return sorted(solved_points.values(), key=lambda point: -point.given["norm"]), (
        top.given["norm"],
        weight_at_error(top),
    )


def weight_at_error(solution: Solution):
    """Weight of the sum of which a solution at a given error is a stationary point, deg^2/s^3."""
    return -solution.boundary_multipliers["norm of the radius column"]


def given_error(simulation: Simulation, solution: Solution):
    """Norm of the final error at which a solution was held, m."""
    return solution.given["norm"] * abs(simulation.tabulated_error)
