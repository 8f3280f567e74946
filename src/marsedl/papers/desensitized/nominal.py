"""Nominal trajectory of least control energy, without regard to sensitivities ("no-DOC", Sec. 4 and Fig. 1)."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.collocation import Guess, Solution, resimulate
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, STATE_UNIT, WARM
from marsedl.replication.artifacts import quantity
from marsedl.replication.errors import MarsedlError


@dataclass(frozen=True)
class Nominal:
    """The solution of least control energy on the wanted branch, and the same controls flown again."""

    time: np.ndarray = quantity("s", ("time",), "nodes of the transcription")
    state: np.ndarray = quantity(
        STATE_UNIT, ("time", 8), "altitude, latitude, longitude, radial, north and east velocity, bank and its rate"
    )
    bank_acceleration: np.ndarray = quantity("rad/s^2", ("intervals",), "bank acceleration, constant on each interval")
    effort: float = quantity("deg^2/s^3", (), "control energy J0")
    cumulative: float = quantity("rad/s", (), "integral of the absolute bank acceleration")
    propellant: float = quantity("kg", (), "propellant of the reaction control system")
    largest_bank_rate: float = quantity("rad/s", (), "largest bank rate, either way")
    largest_bank_acceleration: float = quantity("rad/s^2", (), "largest bank acceleration, either way")
    reversals: int = quantity("1", (), "bank reversals")
    reversal_times: np.ndarray = quantity("s", ("reversals",), "when the bank angle passes zero")
    branch: str = quantity("1", (), "what the solution is called by its bank angle", "str")
    flown: np.ndarray = quantity(STATE_UNIT, ("time", 8), "the same controls flown by a method of order eight")
    miss: np.ndarray = quantity("m", (3,), "altitude, crossrange and downrange by which that flight misses the target")
    costate: np.ndarray = quantity("SI", ("intervals", 8), "multipliers of the equations of motion")
    status: str = quantity("1", (), "how the solver ended", "str")
    iterations: int = quantity("1", (), "iterations of the solver")
    worst_residual: float = quantity("SI", (), "largest violation of an equation or bound")


def compute(inputs) -> Nominal:
    """Solve for the nominal from the inputs' guess, and check its branch (Eqs. 1 to 4, Table 2)."""
    guess = entry_problem.profile_guess(inputs, inputs.guess_banks, inputs.guess_switch_times, inputs.guess_final_time)
    transcribed = entry_problem.program(inputs, entry_problem.problem(inputs))
    # The adaptive barrier leaves the guess's branch on some meshes.
    solution = entry_problem.solve(inputs, "nominal", transcribed, guess, barrier=WARM)
    bank = solution.state("bank")
    if entry_problem.reversals(bank) != inputs.nominal_reversals:
        found = entry_problem.effort(solution.time, solution.controls[:, 0])
        raise MarsedlError(
            f"the nominal has {entry_problem.branch_name(bank)}, not the {inputs.nominal_reversals} of "
            f"nominal_reversals, at a control energy of {found:.4g} deg^2/s^3: it lies on another branch; change the "
            "inputs in smaller steps, give guess_banks and guess_switch_times nearer to the branch wanted, or set "
            "nominal_reversals to what was found"
        )
    return described(inputs, solution)


def described(inputs, solution: Solution) -> Nominal:
    """A solution as an artifact."""
    time, control = solution.time, solution.controls[:, 0]
    states = solution.states[:, : len(entry_problem.STATES)]
    flown = resimulate(solution)[:, : len(entry_problem.STATES)]
    total = entry_problem.cumulative(time, control)
    return Nominal(
        time=time,
        state=states,
        bank_acceleration=control,
        effort=entry_problem.effort(time, control),
        cumulative=total,
        propellant=float(entry_problem.propellant(inputs, total)),
        largest_bank_rate=float(np.abs(states[:, BANK_RATE]).max()),
        largest_bank_acceleration=float(np.abs(control).max()),
        reversals=entry_problem.reversals(states[:, BANK]),
        reversal_times=zero_crossings(time, states[:, BANK]),
        branch=entry_problem.branch_name(states[:, BANK]),
        flown=flown,
        miss=entry_problem.miss(inputs, flown[-1]),
        costate=solution.costates[:, : len(entry_problem.STATES)],
        status=solution.status,
        iterations=solution.iterations,
        worst_residual=solution.residual.value,
    )


def zero_crossings(time, values):
    """Times at which values at nodes pass zero, by lines between the nodes."""
    before, after = values[:-1], values[1:]
    crossed = np.flatnonzero(before * after < 0.0)
    return time[crossed] - before[crossed] * np.diff(time)[crossed] / (after - before)[crossed]


def as_guess(nominal: Nominal) -> Guess:
    """The nominal as a guess for the solver."""
    return Guess(nominal.state, nominal.bank_acceleration[:, np.newaxis], float(nominal.time[-1]))
