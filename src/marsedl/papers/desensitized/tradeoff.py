"""Reshaping without feedback: control energy against sensitivity to the radius at entry (Sec. 4.1, Table 3, Fig. 2).

The weight on the sensitivity is raised step by step from the nominal. Where the branch of solutions ends, the solver
finds the next one, and the path goes on there. The rows of Table 3 are points of this path.
"""

from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import ACCEPTABLE, SOLVED, BranchEndError, Program, Solution, resimulate
from marsedl.methods.desensitization import Desensitized
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, STATES, WARM
from marsedl.papers.desensitized.inputs import Design, Inputs, Planet, Simulation, Solver
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import CHANNELS, Nominal, Tradeoff
from marsedl.replication.errors import MarsedlError, SolverError
from marsedl.replication.pipeline.catalogue import stage

SHORTEST = 5e-3  # share of a step between two weights at which a branch is taken to end
# Along flat directions of the objective the solver may stop at its second, acceptable level; the artifact says where.
ACCEPTED = (SOLVED, ACCEPTABLE)
MATCHED = 1e-4  # relative, to which a control energy must be met


class Point(NamedTuple):
    """A solution on the path."""

    solution: Solution
    branch: int


class Fold(NamedTuple):
    """Where a branch ends: the last solution on it, and the first one that the solver found beyond."""

    before: Solution
    beyond: Solution
    barrier: float  # initial one of the solver that found it; NaN: the solver's own choice


class Missing(NamedTuple):
    """Why a printed weight has no row."""

    effort: float  # control energy that was looked for, deg^2/s^3
    reason: str


def columns_in_norm(design: Design):
    """Channels whose columns are in the objective."""
    return CHANNELS if design.sensitivity_columns == "all" else CHANNELS[:1]


def prepared(given: Inputs, channels=None, **options) -> tuple[Desensitized, Program]:
    """The problem of Eq. 6, and its transcription."""
    channels = channels or columns_in_norm(given.design)
    extended = entry_problem.desensitized(
        given, [entry_problem.position_error(given.planet, name) for name in channels]
    )
    declared = entry_problem.weighted(given.planet, given.design, extended, channels)
    return extended, entry_problem.program(given.planet, given.solver, declared, **options)


@stage()
def compute(given: Inputs, nominal: Nominal) -> Tradeoff:
    """Follow the solutions over the weight, and find the rows of Table 3 among them."""
    solver, design = given.solver, given.design
    extended, transcribed = prepared(given)
    first = entry_problem.solve(
        solver,
        "no weight",
        transcribed,
        extended.guess(as_guess(nominal), entry_problem.given(), solver.scheme),
        barrier=WARM,
    )
    weights = {*design.weight_path, *design.infinite_weights}
    if design.weight_rule == "proportional":
        weights |= set(design.weight_factor * design.printed_weights)
    points, folds = follow(solver, design, transcribed, first, sorted(weights))
    between, missing = chosen(solver, design, transcribed, points)
    rows = [
        (0.0, points[0]),
        *between.items(),
        *((np.nan, at_weight(points, c)) for c in design.infinite_weights),
    ]
    return described(given, extended, points, folds, rows, missing)


def follow(solver: Solver, design: Design, transcribed, first, weights) -> tuple[list[Point], list[Fold]]:
    """Continue a solution through increasing weights; at the end of a branch go on from what the solver then finds."""
    points, folds = [Point(first, 0)], []
    tolerance = design.branch_tolerance

    def same_branch(before, after):
        return np.abs(after.state("bank") - before.state("bank")).max() < tolerance

    def keep(solution):
        points.append(Point(solution, len(folds)))

    for weight in weights:
        while points[-1].solution.given["weight"] < weight:
            try:
                transcribed.follow(
                    points[-1].solution,
                    "weight",
                    [weight],
                    same_branch=same_branch,
                    smallest_step=SHORTEST,
                    retries=False,  # they cost a quarter of the path, and find the same fold
                    on_step=keep,
                    barrier=WARM,
                    tolerance=solver.solver_tolerance,
                    iterations=solver.solver_iterations,
                    accept=ACCEPTED,
                )
            except BranchEndError as end:
                fold = Fold(end.solution, end.beyond, WARM) if end.beyond else beyond_branch(solver, transcribed, end)
                folds.append(fold)
                keep(fold.beyond)
    return points, folds


def beyond_branch(solver: Solver, transcribed, end: BranchEndError) -> Fold:
    """The fold at the end of a branch beyond which careful steps find nothing: by ever larger barriers."""
    for barrier in (1e-2, 1.0, None):
        try:
            beyond = entry_problem.solve(
                solver,
                "beyond a branch",
                transcribed,
                end.solution,
                weight=end.target,
                barrier=barrier,
                accept=ACCEPTED,
            )
        except SolverError as error:
            failed = error
        else:
            return Fold(end.solution, beyond, np.nan if barrier is None else barrier)
    raise SolverError(
        f"the continuation in the weight stops at {end.reached:.6g}, and {end.target:.6g} {failed}; give a weight_path "
        "with smaller steps there",
        failed.iterate,
    )


def row_efforts(design: Design, least):
    """Control energies at which the rows of the printed weights are taken, deg^2/s^3; least: without a weight."""
    efforts = np.array(design.matched_efforts)
    if design.infeasible_rows == "printed_ratios":
        return np.where(efforts < least, efforts * least / design.printed_least_effort, efforts)
    return efforts


def chosen(solver: Solver, design: Design, transcribed, points) -> tuple[dict[float, Point], dict[float, Missing]]:
    """The rows of the printed weights between zero and infinity, by these, and why the others have none."""
    if design.weight_rule == "proportional":
        return {c1: at_weight(points, design.weight_factor * c1) for c1 in design.printed_weights}, {}
    least, rows, missing = effort(points[0].solution), {}, {}
    for c1, target in zip(design.printed_weights, row_efforts(design, least), strict=True):
        if target < least:  # beyond the fold another branch may have it
            missing[c1] = Missing(target, f"the control energy {target:g} deg^2/s^3 lies below the least, {least:.4f}")
            continue
        try:
            rows[c1] = at_effort(solver, transcribed, points, target)
        except MarsedlError as error:
            missing[c1] = Missing(target, str(error))
    return rows, missing


def at_weight(points, weight) -> Point:
    """The point of the path at a weight that it was led through."""
    return next(point for point in reversed(points) if point.solution.given["weight"] == weight)


def at_effort(solver: Solver, transcribed, points, target) -> Point:
    """The first point on the path that has a control energy, by solves between two neighbours on one branch."""
    from scipy.optimize import brentq

    efforts = np.array([effort(point.solution) for point in points])
    for k in range(len(points) - 1):
        if points[k].branch == points[k + 1].branch and (efforts[k] - target) * (efforts[k + 1] - target) <= 0.0:
            break
    else:
        raise MarsedlError(
            f"no solution on the path has the control energy {target:g} deg^2/s^3 of matched_efforts; it goes from "
            f"{efforts.min():.4g} to {efforts.max():.4g} in {points[-1].branch + 1} branches: change matched_efforts, "
            "or extend weight_path"
        )
    solutions = {point.solution.given["weight"]: point.solution for point in points[k : k + 2]}

    def excess(weight):
        if weight not in solutions:
            nearest = solutions[min(solutions, key=lambda other: abs(other - weight))]
            case = f"control energy {target:g}"
            solutions[weight] = entry_problem.solve(
                solver, case, transcribed, nearest, weight=weight, barrier=WARM, accept=ACCEPTED
            )
        return effort(solutions[weight]) - target

    weight = brentq(excess, *solutions, xtol=1e-12, rtol=1e-9)
    if abs(excess(weight)) > MATCHED * target:
        raise MarsedlError(
            f"the solutions jump past the control energy {target:g} deg^2/s^3 of matched_efforts at the weight "
            f"{weight:.6g}, to {effort(solutions[weight]):.4g}: give a smaller branch_tolerance, or smaller steps of "
            f"weight_path between {min(solutions):g} and {max(solutions):g}"
        )
    return Point(solutions[weight], points[k].branch)


def effort(solution: Solution):
    """Control energy of a solution, deg^2/s^3."""
    return entry_problem.effort(solution.time, solution.controls[:, 0])


def final_error(planet: Planet, simulation: Simulation, extended, solution: Solution, channel=0):
    """Final altitude, crossrange and downrange error for the tabulated error of a channel, (3,), m."""
    return entry_problem.metric(planet, extended.columns(solution)[-1])[:, channel] * simulation.tabulated_error


def last_finite_row(tradeoff: Tradeoff) -> int:
    """The row of the largest finite weight of Table 3."""
    return int(np.flatnonzero(np.isfinite(tradeoff.printed_weight))[-1])


def described(given: Inputs, extended, points, folds, rows, missing) -> Tradeoff:
    """Path, folds and rows, each with its printed weight, as an artifact."""
    path = [point.solution for point in points]
    printed_weights, solutions = [c1 for c1, _ in rows], [row.solution for _, row in rows]

    def bank(solution):
        return solution.states[:, BANK]

    def cumulative(solution):
        return entry_problem.cumulative(solution.time, solution.controls[:, 0])

    def errors(solution):
        return final_error(given.planet, given.simulation, extended, solution)

    firsts = [next(p for p in points if p.branch == number) for number in range(points[-1].branch + 1)]
    ends = [(fold.before, fold.beyond) for fold in folds]
    size = len(STATES)
    return Tradeoff(
        path_weight=np.array([s.given["weight"] for s in path]),
        path_effort=np.array([effort(s) for s in path]),
        path_error=np.array([errors(s) for s in path]),
        path_status=np.array([s.status for s in path]),
        path_branch=np.array([point.branch for point in points]),
        branch=np.array([entry_problem.branch_name(bank(p.solution)) for p in firsts]),
        fold_weight=np.array([[s.given["weight"] for s in pair] for pair in ends]).reshape(-1, 2),
        fold_effort=np.array([[effort(s) for s in pair] for pair in ends]).reshape(-1, 2),
        fold_error=np.array([[np.linalg.norm(errors(s)) for s in pair] for pair in ends]).reshape(-1, 2),
        fold_barrier=np.array([fold.barrier for fold in folds]),
        printed_weight=np.array(printed_weights),
        missing_weight=np.array(list(missing)),
        missing_effort=np.array([one.effort for one in missing.values()]),
        missing_reason=np.array([one.reason for one in missing.values()], dtype=str),
        weight=np.array([s.given["weight"] for s in solutions]),
        time=np.array([s.time for s in solutions]),
        state=np.array([s.states[:, :size] for s in solutions]),
        bank_acceleration=np.array([s.controls[:, 0] for s in solutions]),
        column=np.array([extended.columns(s)[:, :, 0] for s in solutions]),
        effort=np.array([effort(s) for s in solutions]),
        cumulative=np.array([cumulative(s) for s in solutions]),
        propellant=np.array([entry_problem.propellant(given.vehicle, cumulative(s)) for s in solutions]),
        error=np.array([errors(s) for s in solutions]),
        reversals=np.array([entry_problem.reversals(bank(s)) for s in solutions]),
        row_branch=np.array([row.branch for _, row in rows]),
        largest_bank_rate=np.array([np.abs(s.states[:, BANK_RATE]).max() for s in solutions]),
        largest_bank_acceleration=np.array([np.abs(s.controls).max() for s in solutions]),
        miss=np.array([entry_problem.miss(given.planet, given.mission, resimulate(s)[-1]) for s in solutions]),
        status=np.array([s.status for s in solutions]),
        iterations=np.array([s.iterations for s in solutions]),
        solves=len(points) + len(rows),
    )
