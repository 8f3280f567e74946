"""Least fuel: the integral of the absolute bank acceleration, which the paper gives up for that of its square (Eq. 3).

The fuel is, by a constant, the integral of |u|. Its minimum thrusts at the bound or not at all, which the square does
not; from the nominal, the cost is led over from one to the other.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import SOLVED, BranchEndError, Guess, Program, Solution, Variable
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, STATES, WARM, attempt
from marsedl.papers.desensitized.inputs import Design, Inputs, Solver, Vehicle
from marsedl.papers.desensitized.records import SOLUTIONS, MinimumFuel, Nominal
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.units import DEGREE

SHARES = (0.5, 0.8, 0.9, 0.97, 0.99, 0.997, 0.999, 1.0)  # of the fuel in the cost
CLEAR = 1e-3  # of the bound: less counts as coasting, and so little below it as at the bound
SMALLEST_STEP = 0.05  # of the way to the next share; a branch that needs shorter steps ends
STEP_ITERATIONS = 100  # a step on a branch takes about ten, one onto another branch several times as many


class Way(NamedTuple):
    """From least energy to least fuel: the last solution, and the last one on the nominal's branch."""

    last: Solution
    on_branch: Solution


@stage(claimed_in=("corrected",))
def compute(given: Inputs, nominal: Nominal) -> MinimumFuel:
    """Minimise the fuel under each bound."""
    of_bounds = [under_bound(given, nominal, float(bound)) for bound in given.studies.fuel_bounds]
    return MinimumFuel(
        bound=given.studies.fuel_bounds,
        solution=np.array(SOLUTIONS),
        **{name: np.array([fields[name] for fields in of_bounds]) for name in of_bounds[0]},
    )


def under_bound(given: Inputs, nominal: Nominal, bound):
    """The fields of one bound."""
    transcribed = fuel_program(given, nominal, bound)
    first = attempt(given.solver, transcribed, split(nominal), share(0.0), barrier=WARM)
    way = to_fuel(given.solver, given.design, transcribed, first)
    reached = way.last.status == SOLVED and way.last.given["weight"] == 1.0
    beside = attempt(given.solver, transcribed, way.last, share(0.0), barrier=WARM) if reached else way.last
    solutions = (first, way.last, beside)
    solved = (first.status == SOLVED, reached, reached and beside.status == SOLVED)
    status = [solution.status for solution in solutions]
    if first.status == SOLVED and not reached:
        status[1:] = [f"stopped at a share of {way.last.given['weight']:.4g}"] * 2
    fields = [described(given.vehicle, bound, *pair) for pair in zip(solutions, solved, strict=True)]
    function = np.where(reached, -way.last.costates[:, BANK_RATE] * DEGREE, np.nan)
    return {
        "status": status,
        **{name: [field[name] for field in fields] for name in fields[0]},
        "switching": function,
        "switching_violation": violation(function, thrust(way.last), bound),
        "branch_share": way.on_branch.given["weight"] if first.status == SOLVED else np.nan,
    }


def fuel_program(given: Inputs, nominal: Nominal, bound) -> Program:
    """Energy and fuel in shares, with the bank acceleration as a difference of two that are not negative.

        minimise  integral (1 - s) (p^2 + n^2) / e + s (p + n) dt,   u = p - n

    in degrees; at most one of p and n differs from zero, as both cost. The scale e makes the two parts equal at the
    nominal. The share s takes the place of the weight.
    """
    base = entry_problem.problem(given)
    count = len(STATES)
    scale = nominal.effort / (nominal.cumulative / DEGREE) if nominal.cumulative else 1.0

    def rates(*arguments):
        positive, negative = arguments[count : count + 2]
        return base.rates(*arguments[:count], positive - negative, *arguments[count + 2 :])

    def running_cost(*arguments):
        positive, negative = (value / DEGREE for value in arguments[count : count + 2])
        fuel_share = arguments[-2]
        return (1.0 - fuel_share) * (positive**2 + negative**2) / scale + fuel_share * (positive + negative)

    controls = tuple(Variable(f"{sign}_bank_acceleration", 0.002, 0.0, bound) for sign in ("positive", "negative"))
    declared = replace(base, rates=rates, controls=controls, running_cost=running_cost)
    return entry_problem.program(given.planet, given.solver, declared)


def share(of_fuel):
    """Given parameters for a share of the fuel in the cost."""
    return entry_problem.given(of_fuel)


def split(nominal: Nominal) -> Guess:
    """The nominal as a guess, its bank acceleration in two parts that are not negative."""
    control = nominal.bank_acceleration
    parts = np.column_stack([np.maximum(control, 0.0), np.maximum(-control, 0.0)])
    return Guess(nominal.state, parts, float(nominal.time[-1]))


def thrust(solution: Solution):
    """Bank acceleration of a solution, (N,), rad/s^2."""
    return solution.controls[:, 0] - solution.controls[:, 1]


def to_fuel(solver: Solver, design: Design, transcribed, first: Solution) -> Way:
    """Lead the cost over to the fuel; where the branch ends, go on with what the solver finds, if anything."""
    last, on_branch, off_branch = first, first, first.status != SOLVED
    if off_branch:
        return Way(first, first)

    def same_branch(before, after):
        return np.abs(after.states[:, BANK] - before.states[:, BANK]).max() < design.branch_tolerance

    def keep(solution):
        nonlocal last, on_branch
        last = solution
        on_branch = on_branch if off_branch else solution

    options = {"tolerance": solver.solver_tolerance, "iterations": STEP_ITERATIONS, "barrier": WARM}
    for share in SHARES:
        while last.given["weight"] < share:
            try:
                transcribed.follow(
                    last,
                    "weight",
                    [share],
                    same_branch=same_branch,
                    smallest_step=SMALLEST_STEP,
                    on_step=keep,
                    **options,
                )
            except BranchEndError as end:
                if end.beyond is None:
                    return Way(last, on_branch)
                off_branch = True
                keep(end.beyond)
    return Way(last, on_branch)


def described(vehicle: Vehicle, bound, solution: Solution, solved):
    """The fields of one solution; NaN where it was not solved."""
    bank, control = solution.states[:, BANK], thrust(solution)
    cumulative = entry_problem.cumulative(solution.time, control)
    fields = {
        "time": solution.time,
        "bank": bank,
        "bank_acceleration": control,
        "effort": entry_problem.effort(solution.time, control),
        "cumulative": cumulative,
        "propellant": float(entry_problem.propellant(vehicle, cumulative)),
        "coasting": np.mean(np.abs(control) < CLEAR * bound),
        "at_bound": np.mean(np.abs(control) > (1.0 - CLEAR) * bound),
    }
    counted = {"reversals": entry_problem.reversals(bank), "bursts": bursts(control, bound)}
    if not solved:
        fields = {name: np.full_like(value, np.nan, dtype=float) for name, value in fields.items()}
        counted = dict.fromkeys(counted, -1)
    return fields | counted


def bursts(control, bound):
    """How many times thrust begins, or changes its sign."""
    sign = np.where(np.abs(control) < CLEAR * bound, 0.0, np.sign(control))
    begun = (sign != 0.0) & (sign != np.concatenate([[0.0], sign[:-1]]))
    return int(np.count_nonzero(begun))


def violation(function, control, bound):
    """Largest contradiction of thrust and switching function; NaN where there is none.

    Without thrust it lies between -1 and 1, at the bound beyond the sign of the thrust, and on that in between.
    """
    size, along = np.abs(control), np.sign(control) * function
    coasting, full = size < CLEAR * bound, size > (1.0 - CLEAR) * bound
    apart = np.abs(along - 1.0)
    apart = np.where(full, np.maximum(1.0 - along, 0.0), apart)
    apart = np.where(coasting, np.maximum(np.abs(function) - 1.0, 0.0), apart)
    return float(apart.max())
