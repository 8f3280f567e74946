"""Nominal trajectory of least control energy, without regard to sensitivities ("no-DOC", Sec. 4 and Fig. 1)."""

import numpy as np

from marsedl.methods.collocation import Guess, Solution, resimulate
from marsedl.papers.density import TableExits
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, WARM, Trajectory
from marsedl.papers.desensitized.inputs import Inputs, Solver
from marsedl.papers.desensitized.records import Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs) -> Nominal:
    """Solve for the nominal from the inputs' guess, and check its branch (Eqs. 1 to 4, Table 2)."""
    solver = given.solver
    declared = entry_problem.problem(given)
    guess = entry_problem.profile_guess(
        given.mission, solver, declared, solver.guess_banks, solver.guess_switch_times, solver.guess_final_time
    )
    transcribed = entry_problem.program(given.planet, solver, declared)
    # The adaptive barrier leaves the guess's branch on some meshes.
    solution = entry_problem.solve(solver, "nominal", transcribed, guess, barrier=WARM)
    refuse_other_branch(solver, entry_problem.of_solution(solution))
    TableExits(given.planet).count(solution.states[:, 0]).say("nominal flight")
    return described(given, solution)


def refuse_other_branch(solver: Solver, along: Trajectory) -> None:
    """Refuse a nominal that is not on the branch that the inputs name, by all that tells branches apart at once.

    Raises:
        MarsedlError: its reversals, full rolls or the sign of its first bank angle are others; with their times.
    """
    bank = along.state[:, BANK]
    branch = {
        "nominal_reversals": entry_problem.reversals(bank),
        "nominal_full_rolls": entry_problem.full_rolls(bank),
        "nominal_first_bank": entry_problem.first_bank(bank),
    }
    expected = {
        "nominal_reversals": solver.nominal_reversals,
        "nominal_full_rolls": solver.nominal_full_rolls,
        "nominal_first_bank": solver.nominal_first_bank,
    }
    differences = [
        f"{name} {branch[name]} instead of {expected[name]}" for name in branch if branch[name] != expected[name]
    ]
    if not differences:
        return
    times = ", ".join(f"{time:.1f}" for time in entry_problem.reversal_times(along.time, bank)) or "none"
    energy = entry_problem.effort(along.time, along.bank_acceleration)
    remedy = (
        "Change guess_width first, which is often enough, or give guess_banks and guess_switch_times nearer to the "
        "branch wanted, change other inputs in smaller steps, or name this branch"
    )
    if len(differences) == 1 and differences[0].startswith("nominal_first_bank"):
        remedy = "It is the mirror image: exchange the signs of guess_banks, or name this branch"
    raise MarsedlError(
        f"the nominal lies on another branch: {', '.join(differences)} (reversals at {times} s, control energy "
        f"{energy:.4g} deg^2/s^3). {remedy}"
    )


def described(given: Inputs, solution: Solution) -> Nominal:
    """A solution as an artifact."""
    time, control = solution.time, solution.controls[:, 0]
    states = solution.states[:, : len(entry_problem.STATES)]
    resimulated = resimulate(solution)[:, : len(entry_problem.STATES)]
    total = entry_problem.cumulative(time, control)
    return Nominal(
        time=time,
        state=states,
        bank_acceleration=control,
        effort=entry_problem.effort(time, control),
        cumulative=total,
        propellant=float(entry_problem.propellant(given.vehicle, total)),
        largest_bank_rate=float(np.abs(states[:, BANK_RATE]).max()),
        largest_bank_acceleration=float(np.abs(control).max()),
        reversals=entry_problem.reversals(states[:, BANK]),
        reversal_times=entry_problem.reversal_times(time, states[:, BANK]),
        branch=entry_problem.branch_name(states[:, BANK]),
        flown=resimulated,
        miss=entry_problem.miss(given.planet, given.mission, resimulated[-1]),
        costate=solution.costates[:, : len(entry_problem.STATES)],
        status=solution.status,
        iterations=solution.iterations,
    )


def zero_crossings(time, values):
    """Times at which values at nodes pass zero, by lines between the nodes."""
    before, after = values[:-1], values[1:]
    crossed = np.flatnonzero(before * after < 0.0)
    return time[crossed] - before[crossed] * np.diff(time)[crossed] / (after - before)[crossed]


def as_guess(nominal: Nominal) -> Guess:
    """The nominal as a guess for the solver."""
    return Guess(nominal.state, nominal.bank_acceleration[:, np.newaxis], float(nominal.time[-1]))
