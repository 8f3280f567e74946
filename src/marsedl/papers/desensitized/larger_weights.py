"""The last row of Table 3 continued to larger weights: what stands for an infinite weight, and what it costs.

The error of that row does not depend on the weight that stands for infinity; control energy and fuel do, as nothing
but the weight's inverse holds them down. This study shows by how much.
"""

import numpy as np

from marsedl.methods.collocation import Guess, Solution
from marsedl.papers.desensitized import entry_problem, mean_density
from marsedl.papers.desensitized.entry_problem import BANK, WARM, Setup
from marsedl.papers.desensitized.inputs import Design, Mission, Planet, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.records import LargerWeights, Tradeoff
from marsedl.papers.desensitized.tradeoff import ACCEPTED, at_weight, effort, final_error, follow, prepared
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError

THIN = 0.01  # of the largest density times squared velocity of a flight
FULL = 1e-3  # of the bound, by which bank acceleration that counts as the largest may lie below it


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    solver: Solver,
    design: Design,
    simulation: Simulation,
    studies: Studies,
    tradeoff: Tradeoff,
) -> LargerWeights:
    """Continue the row of the largest weight, as far as the solver comes."""
    setup = Setup(planet, vehicle, mission, solver, design)
    extended, transcribed = prepared(setup)
    last = entry_problem.of_rows(tradeoff)[-1]
    guess = Guess(last.state, last.bank_acceleration[:, np.newaxis], float(last.time[-1]))
    first = entry_problem.solve(
        solver,
        "the largest weight of Table 3",
        transcribed,
        extended.guess(guess, entry_problem.given(), solver.scheme),
        weight=tradeoff.weight[-1],
        barrier=WARM,
        accept=ACCEPTED,
    )
    solutions, ended = [first], "at the largest weight wanted"
    for weight in tradeoff.weight[-1] * studies.larger_weight_factors:
        try:
            points, _ = follow(solver, design, transcribed, solutions[-1], [weight])
        except MarsedlError:
            ended = f"between the weights {solutions[-1].given['weight']:g} and {weight:g}: no solution was found there"
            break
        solutions.append(at_weight(points, weight).solution)
    return described(setup, simulation, extended, solutions, ended)


def described(setup: Setup, simulation: Simulation, extended, solutions: list[Solution], ended) -> LargerWeights:
    """Solutions as an artifact."""
    trajectories = [entry_problem.of_solution(solution) for solution in solutions]
    totals = [entry_problem.cumulative(along.time, along.bank_acceleration) for along in trajectories]
    bound = setup.vehicle.bank_acceleration_bound
    return LargerWeights(
        weight=np.array([solution.given["weight"] for solution in solutions]),
        effort=np.array([effort(solution) for solution in solutions]),
        cumulative=np.array(totals),
        propellant=np.array([entry_problem.propellant(setup.vehicle, total) for total in totals]),
        error=np.array([final_error(setup.planet, simulation, extended, solution) for solution in solutions]),
        thin_air_share=np.array([thin_air_share(setup.planet, along) for along in trajectories]),
        reversals=np.array([entry_problem.reversals(along.state[:, BANK]) for along in trajectories]),
        at_bound=np.array([np.mean(np.abs(along.bank_acceleration) > (1.0 - FULL) * bound) for along in trajectories]),
        status=np.array([solution.status for solution in solutions]),
        iterations=np.array([solution.iterations for solution in solutions]),
        ended=ended,
    )


def thin_air_share(planet: Planet, along: entry_problem.Trajectory):
    """Share of the integral of the absolute bank acceleration that is spent where the air hardly turns the flight."""
    middle = (along.state[1:] + along.state[:-1]) / 2.0
    pressure = np.exp(mean_density.profile(planet)(middle[:, 0])[0]) * (middle[:, 3:6] ** 2).sum(axis=1)
    spent = np.abs(along.bank_acceleration) * np.diff(along.time)
    return float(spent[pressure < THIN * pressure.max()].sum() / spent.sum()) if spent.any() else 0.0
