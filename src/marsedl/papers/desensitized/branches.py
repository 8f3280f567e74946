"""Other solutions than those of the paper: minima, conditions on the bank, and branches over the sensitivity.

The problem without weight has several local minima. Each begins a branch of solutions that trade control energy for
sensitivity. Where such a branch has a fold in the weight, it is followed through it with the final error given instead:
what lies beyond minimises the energy at that error, but no weighted sum.
"""

from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import (
    SOLVED,
    BranchEndError,
    Condition,
    Guess,
    Program,
    Solution,
    Variable,
)
from marsedl.methods.desensitization import Desensitized, column
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.montecarlo.streams import normals, uniforms
from marsedl.papers.desensitized import entry_problem, mean_density
from marsedl.papers.desensitized.entry_problem import (
    BANK,
    LEVEL,
    MEASURED,
    MIRROR,
    POSITIONS,
    WARM,
    Setup,
    attempt,
)
from marsedl.papers.desensitized.inputs import Design, Ensemble, Mission, Planet, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import Branches, Nominal, Tradeoff
from marsedl.papers.desensitized.tradeoff import effort, final_error, prepared
from marsedl.replication.catalogue import stage

SEARCH_STREAM, SHAKE_STREAM = 2, 3  # of the random numbers; gains and flights use others
SWITCHES = 4  # most changes of the bank angle in a random guess
SEARCH_ITERATIONS = 150  # a start that has not led to a solution by then seldom does
SHAKE = 2.0 * entry_problem.DEGREE  # standard deviation of what is added to a bank angle to see whether it comes back
CURVE_POINTS = 12
FOLD_TOLERANCE = 1e-4  # of the error at a fold; the weight there is known to the square of it
SMALLEST_STEP = 0.05  # of the way to the next value; a branch that needs shorter steps ends
STEP_ITERATIONS = 30  # a step on a branch takes about ten
BETTER = 1e-3  # of the control energy: a solution that needs less by no more than this does not dominate


class Candidate(NamedTuple):
    """A solution on the branch that begins at a numbered one, with the norm of its final error."""

    number: int
    effort: float
    error: float


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    solver: Solver,
    design: Design,
    simulation: Simulation,
    ensemble: Ensemble,
    studies: Studies,
    nominal: Nominal,
    tradeoff: Tradeoff,
) -> Branches:
    """Collect local minima, vary the conditions on the bank, and follow the branches."""
    setup = Setup(planet, vehicle, mission, solver, design)
    minima = catalogue(setup, ensemble, studies, nominal, tradeoff)
    solutions, number = minima.solutions, minima.nominal
    error_problem = error_program(setup)
    curve, fold = nominal_curve(setup, simulation, error_problem, solutions[number], tradeoff)
    extended, continued = continued_branches(setup, solutions, number, tradeoff)
    errors = np.array([catalogue_error(setup, simulation, solution) for solution in solutions])
    candidates = [
        *(Candidate(k, effort(s), np.linalg.norm(e)) for k, (s, e) in enumerate(zip(solutions, errors, strict=True))),
        *(Candidate(number, effort(s), given_error(simulation, s)) for s in curve),
        *(Candidate(k, effort(s), np.linalg.norm(final_error(planet, simulation, extended, s))) for k, s in continued),
        *at_row_errors(setup, simulation, error_problem, solutions, errors, number, tradeoff),
    ]
    return Branches(
        **described(vehicle, studies, minima, errors),
        **bank_conditions(setup, nominal),
        curve_error=np.array([given_error(simulation, s) for s in curve]),
        curve_effort=np.array([effort(s) for s in curve]),
        curve_weight=np.array([weight_at_error(s) for s in curve]),
        curve_final_bank=np.array([s.states[-1, BANK] for s in curve]),
        fold_weight=fold[1],
        fold_error=fold[0] * abs(simulation.tabulated_error),
        continued_solution=np.array([k for k, _ in continued], dtype=int),
        continued_weight=np.array([s.given["weight"] for _, s in continued]),
        continued_effort=np.array([effort(s) for _, s in continued]),
        continued_cumulative=np.array([cumulative(s) for _, s in continued]),
        continued_error=np.array([final_error(planet, simulation, extended, s) for _, s in continued]).reshape(-1, 3),
        **dominance(tradeoff, candidates),
    )


# ---- local minima ----------------------------------------------------------------------------------------------------


class Catalogue(NamedTuple):
    """Different solutions of the problem without weight, sorted by control energy, and how they were found."""

    solutions: list[Solution]
    start_counts: list[int]  # random starts that led to each
    nominal: int
    returned: list[float]
    failed_starts: int
    roll_status: list[str]


def catalogue(setup: Setup, ensemble: Ensemble, studies: Studies, nominal: Nominal, tradeoff: Tradeoff) -> Catalogue:
    """Solve without weight from the nominal, the rows of Table 3, guesses with full rolls, and random guesses."""
    solver, declared = setup.solver, entry_problem.problem(setup.planet, setup.vehicle, setup.mission)
    transcribed = entry_problem.program(setup.planet, solver, declared)
    first = entry_problem.solve(solver, "nominal", transcribed, as_guess(nominal), barrier=WARM)
    groups = [[first, 0]]
    rows = zip(tradeoff.state, tradeoff.bank_acceleration, tradeoff.time, strict=True)
    for states, control, time in rows:
        solution = attempt(solver, transcribed, Guess(states, control[:, np.newaxis], float(time[-1])), barrier=WARM)
        enter(setup, groups, transcribed, solution, 0)
    middle, status = nominal.time[-1] / 2.0, []
    for turn in studies.roll_banks:
        guess = descent(setup, [0.0, turn], [middle], solver.intervals)
        solution = attempt(solver, transcribed, guess, iterations=SEARCH_ITERATIONS)
        enter(setup, groups, transcribed, solution, 0)
        status.append(solution.status)
    different, failed = searched(setup, ensemble, studies, float(nominal.time[-1]))
    for solution, count in different:
        failed += enter(setup, groups, transcribed, solution, count)
    groups.sort(key=lambda group: effort(group[0]))
    solutions = [solution for solution, _ in groups]
    return Catalogue(
        solutions,
        [count for _, count in groups],
        next(number for number, solution in enumerate(solutions) if solution is first),
        [returned(solver, ensemble, transcribed, solution, number) for number, solution in enumerate(solutions)],
        failed,
        status,
    )


def enter(setup: Setup, groups, transcribed, solution: Solution, count) -> int:
    """Solve on the full mesh, and count to the known solution that this is like, or enter it as a new one.

    groups: lists of a solution and a count, changed here. Returns how many of the `count` starts came to nothing: all
    if the solver failed.
    """
    if solution.status != SOLVED:
        return count
    mission, solver = setup.mission, setup.solver
    polished = attempt(solver, transcribed, oriented(mission, solution.guess(solver.intervals)), barrier=WARM)
    if polished.status != SOLVED:
        return count
    for group in groups:
        if alike(mission, setup.design, group[0], polished):
            group[1] += count
            return 0
    groups.append([polished, count])
    return 0


def searched(setup: Setup, ensemble: Ensemble, studies: Studies, final_time):
    """Different solutions from random bank profiles, on half the intervals.

    Returns pairs of a solution and the number of starts that led to it, and the number of starts that failed.
    """
    mission, solver = setup.mission, setup.solver
    declared = entry_problem.problem(setup.planet, setup.vehicle, mission)
    coarse = entry_problem.program(setup.planet, solver, declared, intervals=solver.intervals // 2)
    iterations = min(SEARCH_ITERATIONS, solver.solver_iterations)
    groups, failed = [], 0
    for banks, switch_times in random_profiles(ensemble, studies, final_time):
        guess = descent(setup, banks, switch_times, solver.intervals // 2)
        solution = attempt(solver, coarse, guess, iterations=iterations)
        same = next((group for group in groups if alike(mission, setup.design, group[0], solution)), None)
        if solution.status != SOLVED:
            failed += 1
        elif same:
            same[1] += 1
        else:
            groups.append([solution, 1])
    return groups, failed


def random_profiles(ensemble: Ensemble, studies: Studies, final_time):
    """Bank angles and the times of the changes between them: one to four changes, any bank angle, any time."""
    uniform_rows = uniforms(ensemble.seed, SEARCH_STREAM, np.arange(studies.search_starts), 2 * SWITCHES + 2)
    for number, *uniform_numbers in uniform_rows:
        switches = 1 + int(SWITCHES * number)
        banks = np.pi * (2.0 * np.array(uniform_numbers[: switches + 1]) - 1.0)
        yield banks, np.sort(uniform_numbers[SWITCHES + 1 : SWITCHES + 1 + switches]) * final_time


def descent(setup: Setup, banks, switch_times, intervals) -> Guess:
    """A guess that flies a bank profile down to the altitude of deployment, wherever and whenever that is.

    Random profiles may be far below the ground at the time at which another one arrives.

    Args:
        setup: of the study.
        banks: bank angles, one after the other, rad. switch_times: of the changes between them, s.
        intervals: of the guess.
    """
    from scipy.integrate import solve_ivp

    planet, vehicle, mission, solver = setup.planet, setup.vehicle, setup.mission, setup.solver
    log_density = mean_density.profile(planet)
    steps, switch_times = np.diff(banks), np.asarray(switch_times)

    def turned(time):
        return np.tanh((np.expand_dims(time, -1) - switch_times) / solver.guess_width)

    def bank(time):
        return banks[0] + (1.0 + turned(time)) @ steps / 2.0

    def bank_rate(time):
        return (1.0 - turned(time) ** 2) @ steps / (2.0 * solver.guess_width)

    def rates(time, motion):
        motion_rates = velocity_component_entry_rates(
            (*motion, bank(time), 0.0),
            0.0,
            np.exp(log_density(motion[0])[0]),
            (vehicle.ballistic_coefficient, vehicle.lift_to_drag),
            (planet.gravitational_parameter, planet.planet_radius),
        )
        return motion_rates[: len(MEASURED)]

    def above(_, motion):
        return motion[0] - mission.final_altitude

    above.terminal, above.direction = True, -1.0
    earliest, latest = mission.final_time_bounds
    start = entry_problem.entry_state(mission)[: len(MEASURED)]
    solution = solve_ivp(rates, (0.0, latest), start, events=above, rtol=1e-6, atol=1e-6, dense_output=True)
    time = np.linspace(0.0, max(solution.t[-1], earliest), intervals + 1)
    motion = solution.sol(np.minimum(time, solution.t[-1])).T
    control = np.diff(bank_rate(time)) / np.diff(time)
    return Guess(np.column_stack([motion, bank(time), bank_rate(time)]), control[:, np.newaxis], float(time[-1]))


def symmetric(mission: Mission):
    """Whether a solution seen in a mirror, north and south exchanged, is another one."""
    banks = entry_problem.bank_ends(mission)
    aside = [mission.entry_latitude, mission.final_latitude, *(value or 0.0 for value in banks)]
    north = np.cos(mission.entry_azimuth)
    return not any(aside) and abs(north) < 1e-12  # an azimuth of 90 degrees is rounded


def oriented(mission: Mission, guess: Guess) -> Guess:
    """The same flight with its first bank angle within half a turn, and negative where the mirror image serves."""
    states, controls = guess.states.copy(), guess.controls
    states[:, BANK] -= 2.0 * np.pi * np.round(states[0, BANK] / (2.0 * np.pi))
    clear = states[np.abs(states[:, BANK]) > LEVEL, BANK]
    if symmetric(mission) and clear.size and clear[0] > 0.0:
        states *= MIRROR
        controls = -controls
    return guess._replace(states=states, controls=controls)


def alike(mission: Mission, design: Design, first: Solution, second: Solution):
    """Whether two solutions on one mesh are the same, up to whole turns and, where it serves, the mirror."""
    for sign in (1.0, -1.0) if symmetric(mission) else (1.0,):
        apart = sign * second.states[:, BANK] - first.states[:, BANK]
        apart -= 2.0 * np.pi * np.round(np.median(apart) / (2.0 * np.pi))
        if np.abs(apart).max() < design.branch_tolerance:
            return True
    return False


def returned(solver: Solver, ensemble: Ensemble, transcribed, solution: Solution, number):
    """Largest change of the bank angle after it was shaken smoothly and solved again; a saddle would be left."""
    x = np.linspace(0.0, 1.0, len(solution.time))
    shapes = SHAKE * np.array([np.ones_like(x), 2.0 * x - 1.0, np.sin(np.pi * x)])
    states = solution.states.copy()
    states[:, BANK] += normals(ensemble.seed, SHAKE_STREAM, [number], len(shapes))[0] @ shapes
    again = attempt(solver, transcribed, solution.guess()._replace(states=states), barrier=WARM)
    return np.abs(again.states[:, BANK] - solution.states[:, BANK]).max() if again.status == SOLVED else np.nan


def cumulative(solution: Solution):
    """Integral of the absolute bank acceleration of a solution, rad/s."""
    return entry_problem.cumulative(solution.time, solution.controls[:, 0])


def catalogue_error(setup: Setup, simulation: Simulation, solution: Solution):
    """Final altitude, crossrange and downrange error of a solution of the problem without sensitivities, (3,), m."""
    planet = setup.planet
    extended = entry_problem.desensitized(setup, [entry_problem.position_error(planet, "radius")])
    end = extended.guess(solution).states[-1]
    names = [variable.name for variable in extended.problem.states]
    final = np.array([end[names.index(column(name, "radius"))] for name in POSITIONS])
    return final * entry_problem.lengths(planet) * simulation.tabulated_error


def described(vehicle: Vehicle, studies: Studies, minima: Catalogue, errors):
    """The fields of the local minima."""
    solutions = minima.solutions
    banks = np.array([solution.states[:, BANK] for solution in solutions])
    totals = np.array([cumulative(solution) for solution in solutions])
    return {
        "name": np.array([entry_problem.branch_name(bank) for bank in banks]),
        "effort": np.array([effort(solution) for solution in solutions]),
        "cumulative": totals,
        "propellant": np.array([entry_problem.propellant(vehicle, total) for total in totals]),
        "final_time": np.array([solution.final_time for solution in solutions]),
        "reversals": np.array([entry_problem.reversals(bank) for bank in banks]),
        "rolls": np.array([entry_problem.full_rolls(bank) for bank in banks]),
        "error": errors,
        "time": np.array([solution.time for solution in solutions]),
        "bank": banks,
        "found": np.array(minima.start_counts),
        "returned": np.array(minima.returned),
        "nominal": minima.nominal,
        "starts": int(studies.search_starts),
        "failed_starts": minima.failed_starts,
        "roll": studies.roll_banks,
        "roll_status": np.array(minima.roll_status),
    }


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
    return {
        "set_fixed": fixed,
        "set_status": np.array([solution.status for solution in solutions]),
        "set_effort": np.where(solved, [effort(solution) for solution in solutions], np.nan),
        "set_cumulative": np.where(solved, [cumulative(solution) for solution in solutions], np.nan),
        "set_reversals": np.array([entry_problem.reversals(solution.states[:, BANK]) for solution in solutions]),
    }


# ---- branches with the final error given -----------------------------------------------------------------------------


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


def followed(solver: Solver, design: Design, transcribed, first: Solution, name, values) -> list[Solution]:
    """The solutions on a branch while a given parameter goes through values, those in between included.

    It ends where the branch does: what was reached is the result.
    """
    points = [first]

    def same_branch(before, after):
        return np.abs(after.states[:, BANK] - before.states[:, BANK]).max() < design.branch_tolerance

    with suppress(BranchEndError):
        transcribed.follow(
            first,
            name,
            values,
            same_branch=same_branch,
            smallest_step=SMALLEST_STEP,
            on_step=points.append,
            tolerance=solver.solver_tolerance,
            iterations=STEP_ITERATIONS,
            barrier=WARM,
        )
    return points


def nominal_curve(
    setup: Setup, simulation: Simulation, error_problem: ErrorProgram, solution: Solution, tradeoff: Tradeoff
):
    """The nominal's branch from its own error downwards, through a fold if there is one: solutions, and the fold.

    Where the path over the weight has lost the nominal's branch, the curve goes twice as far; else to the rows' errors.
    """
    first = held_at_own_error(setup.planet, setup.solver, error_problem, solution)
    if first.status != SOLVED:
        return [], (np.nan, np.nan)
    top = first.given["norm"]
    if len(tradeoff.fold_error):
        bottom = 2.0 * tradeoff.fold_error[0, 0] / abs(simulation.tabulated_error) - top
    else:
        bottom = row_errors(tradeoff)[0].min() / abs(simulation.tabulated_error)
    # The weight rises steeply at first: short steps there.
    values = top - max(top - bottom, 0.0) * (np.arange(1, CURVE_POINTS + 1) / CURVE_POINTS) ** 2
    points = followed(setup.solver, setup.design, error_problem.program, first, "norm", values)
    return with_fold(setup.solver, error_problem, points)


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


# ---- other branches over the weight, and comparison ------------------------------------------------------------------


def row_errors(tradeoff: Tradeoff):
    """Norms of the final errors (m) and control energies of the rows of Table 3 with a finite weight."""
    finite = np.isfinite(tradeoff.printed_weight)
    return np.linalg.norm(tradeoff.error[finite], axis=1), tradeoff.effort[finite]


def continued_branches(setup: Setup, solutions, nominal_number, tradeoff: Tradeoff):
    """The branches beside the nominal's over the weights of the rows, as pairs of the beginning's number and a point.

    Returns the problem with sensitivities that they solve, and the pairs.
    """
    solver, design = setup.solver, setup.design
    extended, transcribed = prepared(setup)
    weights = np.unique(tradeoff.weight[np.isfinite(tradeoff.printed_weight)])
    pairs = []
    for number, solution in enumerate(solutions):
        if number == nominal_number:
            continue
        first = attempt(solver, transcribed, extended.guess(solution), barrier=WARM)
        if first.status == SOLVED:
            pairs += [(number, point) for point in followed(solver, design, transcribed, first, "weight", weights)]
    return extended, pairs


def at_row_errors(
    setup: Setup,
    simulation: Simulation,
    error_problem: ErrorProgram,
    solutions,
    errors,
    nominal_number,
    tradeoff: Tradeoff,
):
    """Candidates at exactly the rows' errors, on the branches beside the nominal's that might need less there."""
    row_norms, efforts = row_errors(tradeoff)
    candidates = []
    for number, solution in enumerate(solutions):
        below = (row_norms < np.linalg.norm(errors[number])) & (efforts > effort(solution))
        if number == nominal_number or not below.any():
            continue
        first = held_at_own_error(setup.planet, setup.solver, error_problem, solution)
        if first.status == SOLVED:
            values = -np.sort(-row_norms[below]) / abs(simulation.tabulated_error)
            points = followed(setup.solver, setup.design, error_problem.program, first, "norm", values)
            candidates += [Candidate(number, effort(point), given_error(simulation, point)) for point in points]
    return candidates


def dominance(tradeoff: Tradeoff, candidates):
    """The fields that say whether a row of Table 3 has the least control energy found at its error."""
    row_norms, efforts = row_errors(tradeoff)
    least, numbers = efforts.copy(), np.full(len(efforts), -1)
    for row, (error, row_effort) in enumerate(zip(row_norms, efforts, strict=True)):
        below = [candidate for candidate in candidates if candidate.error <= error * (1.0 + 1e-9)]
        best = min(below, key=lambda candidate: candidate.effort, default=None)
        if best is not None and best.effort < row_effort * (1.0 - BETTER):
            least[row], numbers[row] = best.effort, best.number
    return {
        "row_weight": tradeoff.printed_weight[np.isfinite(tradeoff.printed_weight)],
        "row_error": row_norms,
        "row_effort": efforts,
        "least_effort": least,
        "least_solution": numbers,
    }
