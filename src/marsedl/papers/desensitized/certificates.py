"""How solutions depend on scheme and mesh, and the column of the longitude under all of them.

The cases that are studied are the nominal and the row of the largest finite weight of Table 3.
"""

from math import ceil
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import SCHEMES, SOLVED, Guess, Problem, Solution
from marsedl.methods.desensitization import Desensitized
from marsedl.methods.sensitivity import propagate_columns
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.papers.desensitized import entry_problem, environment, flight
from marsedl.papers.desensitized.entry_problem import STATES, WARM, Setup, Trajectory, attempt
from marsedl.papers.desensitized.inputs import Design, Mission, Planet, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.linearization import model, position_columns, position_rows, transitions
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import Certificates, Nominal, Tradeoff
from marsedl.papers.desensitized.tradeoff import columns_in_norm, effort, last_finite_row
from marsedl.replication.pipeline.catalogue import stage

DIFFERENCE = 1e-3  # of the radius error of Table 3, half the distance of differences of flights


class Case(NamedTuple):
    """A solution that is studied: its weight, and the solution on the inputs' mesh."""

    weight: float
    guess: Guess


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    solver: Solver,
    design: Design,
    simulation: Simulation,
    studies: Studies,
    nominal: Nominal,
    tradeoff: Tradeoff,
) -> Certificates:
    """Solve both cases by every scheme on all meshes, and take the longitude's column there and in the rows."""
    setup = Setup(planet, vehicle, mission, solver, design)
    last = last_finite_row(tradeoff)
    cases = [Case(0.0, as_guess(nominal)), Case(float(tradeoff.weight[last]), row_guess(tradeoff, last))]
    numbers = np.array(studies.studied_intervals, dtype=int)
    runs = [[refined(setup, studies, case, scheme) for scheme in SCHEMES] for case in cases]
    studied = _stacked([[meshes(setup, simulation, studies, run, numbers) for run in by_scheme] for by_scheme in runs])
    rows = [sensitivities(planet, vehicle, solver.scheme, row) for row in entry_problem.of_rows(tradeoff)]
    return Certificates(
        weight=np.array([case.weight for case in cases]),
        scheme=np.array(SCHEMES),
        intervals=numbers,
        **{f"mesh_{name}": values for name, values in studied.items()},
        miss_order=orders(studied["miss"], numbers),
        error_order=orders(studied["error"] - studied["flown_error"], numbers),
        row_longitude_deviation=np.array([longitude_deviation(planet, design, row) for row in rows]),
    )


def _stacked(nested):
    """Fields of nested lists of dictionaries as arrays."""
    if isinstance(nested, dict):
        return nested
    inner = [_stacked(item) for item in nested]
    return {name: np.array([item[name] for item in inner]) for name in inner[0]}


def row_guess(tradeoff: Tradeoff, row) -> Guess:
    """A row of Table 3 as a guess for the solver."""
    time, control = tradeoff.time[row], tradeoff.bank_acceleration[row]
    return Guess(tradeoff.state[row], control[:, np.newaxis], float(time[-1]))


# ---- meshes ----------------------------------------------------------------------------------------------------------


def declared(setup: Setup, weight) -> tuple[Desensitized | None, Problem]:
    """The problem of a case, and what extends guesses for it; without weight no sensitivity is solved for."""
    if weight == 0.0:
        return None, entry_problem.problem(setup.planet, setup.vehicle, setup.mission)
    channels = columns_in_norm(setup.design)
    extended = entry_problem.desensitized(
        setup, [entry_problem.position_error(setup.planet, name) for name in channels]
    )
    return extended, entry_problem.weighted(setup.planet, setup.design, extended, channels)


def refined(setup: Setup, studies: Studies, case: Case, scheme) -> dict[int, Solution]:
    """What a case comes to by a scheme, by the number of intervals: on the inputs' mesh and on those studied.

    From the inputs' mesh outwards, each from the one before: from meshes far away the solver does not converge.
    """
    planet, solver = setup.planet, setup.solver
    extended, problem = declared(setup, case.weight)

    def solved(intervals, guess):
        start = Guess(guess.states[:, : len(STATES)], guess.controls, guess.final_time)
        start = extended.guess(start, entry_problem.given(), scheme) if extended else start
        transcribed = entry_problem.program(planet, solver, problem, intervals, scheme)
        return attempt(solver, transcribed, start, entry_problem.given(case.weight), barrier=WARM)

    nominal_intervals, studied = solver.intervals, [int(number) for number in studies.studied_intervals]
    solutions = {nominal_intervals: solved(nominal_intervals, case.guess)}
    for numbers in (
        [n for n in studied if n > nominal_intervals],
        [n for n in reversed(studied) if n < nominal_intervals],
    ):
        last = solutions[nominal_intervals]
        for number in numbers:
            solutions[number] = solved(number, last.guess(number))
            if solutions[number].status == SOLVED:
                last = solutions[number]
    return solutions


def meshes(setup: Setup, simulation: Simulation, studies: Studies, run, numbers):
    """The fields of the studied meshes, stacked."""
    return _stacked([_mesh(setup, simulation, studies, run[number]) for number in numbers])


def _mesh(setup: Setup, simulation: Simulation, studies: Studies, solution):
    """The fields of one mesh; NaN where it was not solved."""
    planet = setup.planet
    fields = {"status": solution.status, "iterations": solution.iterations}
    if solution.status != SOLVED:
        unknown = dict.fromkeys(("effort", "cumulative", "longitude_deviation"), np.nan)
        return fields | unknown | dict.fromkeys(("error", "flown_error", "miss"), np.full(3, np.nan))
    along = entry_problem.of_solution(solution)
    sensitivity = sensitivities(planet, setup.vehicle, solution.scheme, along)
    miss, flown_error = flight_errors(setup, simulation, studies, along)
    return fields | {
        "effort": effort(solution),
        "cumulative": entry_problem.cumulative(along.time, along.bank_acceleration),
        "error": (position_rows(planet) @ sensitivity[-1] @ position_columns(planet))[:, 0]
        * simulation.tabulated_error,
        "flown_error": flown_error,
        "miss": miss,
        "longitude_deviation": longitude_deviation(planet, setup.design, sensitivity),
    }


def flight_errors(setup: Setup, simulation: Simulation, studies: Studies, along: Trajectory):
    """Miss of the target, and final error for the radius error of Table 3 by central differences; (3,) each, m.

    The step of the flights is that of `substeps` on the finest mesh, so that their errors are the same on all meshes;
    the look-up of the density leaves about 1e-5 m.
    """
    planet, mission = setup.planet, setup.mission
    finest = max(setup.solver.intervals, *studies.studied_intervals)
    step = DIFFERENCE * simulation.tabulated_error
    reference = flight.Reference(along.state[0], along.bank_acceleration, float(along.time[-1]))
    starts = environment.displaced(planet, along.state[0], environment.along_channel(0, [0.0, step, -step]))
    trials = flight.fly(
        *environment.surroundings(planet, setup.vehicle),
        reference,
        np.zeros(len(STATES)),
        starts,
        substeps=ceil(simulation.substeps * finest / len(along.bank_acceleration)),
        every=len(along.bank_acceleration),
    )
    final = np.where(trials.outcome == COMPLETED, trials.final_state[: len(STATES)], np.nan).T
    target = np.array([mission.final_altitude, mission.final_latitude, mission.final_longitude])
    miss = entry_problem.position_errors(final[0], target, planet.planet_radius)
    change = entry_problem.position_errors(final[1], final[2], planet.planet_radius)
    return miss, change * (simulation.tabulated_error / (2.0 * step))


def orders(errors, intervals):
    """Orders of convergence of vectors (..., meshes, 3) from mesh to mesh: (..., meshes - 1)."""
    size = np.linalg.norm(errors, axis=-1)
    return np.log(size[..., :-1] / size[..., 1:]) / np.log(intervals[1:] / intervals[:-1])


def sensitivities(planet: Planet, vehicle: Vehicle, scheme, along: Trajectory):
    """Sensitivity at the nodes to the state at entry, exact for the equations of the scheme, (N + 1, 8, 8)."""
    return propagate_columns(transitions(model(planet, vehicle, scheme, along)), np.eye(len(STATES)))


def longitude_deviation(planet: Planet, design: Design, sensitivity):
    """Largest deviation of the longitude column from a unit vector at any node, states in the scales of the gains."""
    scale, longitude = entry_problem.state_scale(planet, design), STATES.index("longitude")
    column = sensitivity[:, :, longitude] / scale * scale[longitude]
    return np.abs(column - np.eye(len(STATES))[longitude]).max()
