"""Evidence for the solutions: meshes, identities, symmetries, stationarity, other derivatives, flights.

The cases that are studied are the nominal and the row of the largest finite weight of Table 3.
"""

from math import ceil
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import (
    ACCEPTABLE,
    SCHEMES,
    SOLVED,
    Guess,
    Problem,
    Program,
    Solution,
)
from marsedl.methods.desensitization import Desensitized, column
from marsedl.methods.sensitivity import adjoint_rows, propagate_columns, scheme_change
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.papers.desensitized import entry_problem, environment, flight, mean_density
from marsedl.papers.desensitized.entry_problem import MIRROR, STATES, WARM, Setup, Trajectory, attempt
from marsedl.papers.desensitized.inputs import Design, Mission, Planet, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.linearization import model, position_columns, position_rows, transitions
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import (
    APPROXIMATED,
    CHANNELS,
    EXACT,
    UNEXPANDED,
    VARIANTS,
    Certificates,
    Nominal,
    Tradeoff,
)
from marsedl.papers.desensitized.tradeoff import columns_in_norm, effort, last_finite_row, norm, prepared
from marsedl.replication.catalogue import stage

FRACTIONS = (0.01, 0.1, 1.0)  # of the radius error of Table 3, flown either way
DIFFERENCE = 1e-3  # of that error, half the distance of differences of flights
NEIGHBOUR = 1e-3  # relative distance of the weights between which a slope is taken
STATE_DIFFERENCE = 1e-8  # of the scales of the states, half the distance of differences of the discrete flow
NEWTON_STEPS = 4  # with a matrix that is off by the difference only, each gains some digits
LONGITUDE_SHIFT = 1.0  # rad


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
    """Study both cases on meshes, in flights and by other derivatives, and the rows of Table 3 by their identities."""
    setup = Setup(planet, vehicle, mission, solver, design)
    last = last_finite_row(tradeoff)
    cases = [Case(0.0, as_guess(nominal)), Case(float(tradeoff.weight[last]), row_guess(tradeoff, last))]
    numbers = np.array(studies.studied_intervals, dtype=int)
    runs = [[refined(setup, studies, case, scheme) for scheme in SCHEMES] for case in cases]
    studied = _stacked([[meshes(setup, simulation, studies, run, numbers) for run in by_scheme] for by_scheme in runs])
    rows = [_row(setup, simulation, tradeoff, number) for number in range(len(tradeoff.weight))]
    finite = [n for n in range(len(tradeoff.weight)) if np.isfinite(tradeoff.printed_weight[n]) and tradeoff.weight[n]]
    variants = [variants_from_profile(setup), variants_from_row(setup, tradeoff, last)]
    sizes = simulation.tabulated_error * np.array([sign * size for size in FRACTIONS for sign in (1.0, -1.0)])
    flights = [against_flights(setup, simulation, case, sizes) for case in cases]
    return Certificates(
        weight=np.array([case.weight for case in cases]),
        scheme=np.array(SCHEMES),
        intervals=numbers,
        **{f"mesh_{name}": values for name, values in studied.items()},
        miss_order=orders(studied["miss"], numbers),
        error_order=orders(studied["error"] - studied["flown_error"], numbers),
        flow_deviation=np.array([[flow_deviation(setup, run[solver.intervals]) for run in row] for row in runs]),
        row_weight=tradeoff.weight,
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
        slope_weight=tradeoff.weight[finite],
        slope_deviation=slopes(setup, tradeoff, finite),
        variant=np.array(VARIANTS),
        variant_status=np.array([[s.status for s in row] for row in variants]),
        variant_iterations=np.array([[s.iterations for s in row] for row in variants]),
        variant_effort=np.array([[effort(s) for s in row] for row in variants]),
        variant_reversals=np.array([[entry_problem.reversals(s.state("bank")) for s in row] for row in variants]),
        radius_error=sizes,
        linear_error=np.array([linear for linear, _ in flights]),
        flown_error=np.array([flown_error for _, flown_error in flights]),
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
    on_own_mesh = run[setup.solver.intervals]
    return _stacked([_mesh(setup, simulation, studies, run[number], on_own_mesh) for number in numbers])


def _mesh(setup: Setup, simulation: Simulation, studies: Studies, solution, on_own_mesh):
    """The fields of one mesh."""
    planet = setup.planet
    fields = {"status": solution.status, "iterations": solution.iterations}
    if solution.status != SOLVED:
        numbers = ("effort", "cumulative", "bank_change", "longitude_deviation", "crossrange_deviation")
        unknown = dict.fromkeys((*numbers, "solver_deviation"), np.nan)
        return fields | unknown | dict.fromkeys(("error", "flown_error", "miss"), np.full(3, np.nan))
    along = entry_problem.of_solution(solution)
    sensitivity = sensitivities(planet, setup.vehicle, solution.scheme, along)[0]
    share = on_own_mesh.time / on_own_mesh.final_time
    bank = np.interp(share, solution.time / solution.final_time, solution.state("bank"))
    miss, flown_error = flight_errors(setup, simulation, studies, along)
    return fields | {
        "effort": effort(solution),
        "cumulative": entry_problem.cumulative(along.time, along.bank_acceleration),
        "bank_change": np.abs(bank - on_own_mesh.state("bank")).max(),
        "error": final_position(planet, sensitivity)[:, 0] * simulation.tabulated_error,
        "flown_error": flown_error,
        "miss": miss,
        "longitude_deviation": longitude_deviation(planet, setup.design, sensitivity),
        "crossrange_deviation": crossrange_deviation(planet, along, sensitivity),
        "solver_deviation": solver_deviation(solution, sensitivity),
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


# ---- the discrete flow and its derivative ----------------------------------------------------------------------------


def motion(planet: Planet, vehicle: Vehicle, states, bank_acceleration):
    """Rates of states (..., 8) by numpy, beside those that the solver has traced: (..., 8)."""
    log_density = mean_density.profile(planet)(states[..., 0])[0]
    rates = velocity_component_entry_rates(
        np.moveaxis(states, -1, 0),
        bank_acceleration,
        np.exp(log_density),
        (vehicle.ballistic_coefficient, vehicle.lift_to_drag),
        (planet.gravitational_parameter, planet.planet_radius),
    )
    return np.stack(np.broadcast_arrays(*rates), axis=-1)


def change(planet: Planet, vehicle: Vehicle, scheme, start, end, bank_acceleration, step):
    """What a scheme takes for the change of the state over an interval; all (..., 8), (...) and (..., 1)."""

    def rates(states):
        return motion(planet, vehicle, states, bank_acceleration)

    if scheme == "midpoint":
        return step * rates((start + end) / 2.0)
    first, last = rates(start), rates(end)
    if scheme == "trapezoid":
        return step * (first + last) / 2.0
    middle = (start + end) / 2.0 + step * (first - last) / 8.0
    return step * (first + 4.0 * rates(middle) + last) / 6.0


def sensitivities(planet: Planet, vehicle: Vehicle, scheme, along: Trajectory):
    """Sensitivity at the nodes to the state at entry (N + 1, 8, 8), transitions, and d change / d end, (N, 8, 8) each.

    Exact for the equations of the scheme; for the midpoint rule the recursion of Sec. 4.2. As differences from the
    unit matrix the transitions keep the column of an ignorable state to the last bit.
    """
    linear = model(planet, vehicle, scheme, along)
    steps = transitions(linear)
    after = scheme_change(scheme, linear.state_matrix, np.diff(along.time))[1]
    return propagate_columns(steps, np.eye(len(STATES))), steps, after


def flow_deviation(setup: Setup, solution: Solution):
    """Largest difference, relative to the largest entry, of the sensitivity from differences of the discrete flow.

    The equations of every interval are solved again for perturbed starts, by Newton steps with the matrix of the
    unperturbed interval. States are counted in the scales of the gains.
    """
    if solution.status != SOLVED:
        return np.nan
    planet, vehicle = setup.planet, setup.vehicle
    along, size = entry_problem.of_solution(solution), len(STATES)
    scale = entry_problem.state_scale(planet, setup.design)
    sensitivity, _, after = sensitivities(planet, vehicle, solution.scheme, along)
    apart = STATE_DIFFERENCE * np.diag(scale)
    moved = along.state[0] + np.concatenate([apart, -apart])
    for k, step in enumerate(np.diff(along.time)):
        start, moved = moved, moved + along.state[k + 1] - along.state[k]
        for _ in range(NEWTON_STEPS):
            increment = change(planet, vehicle, solution.scheme, start, moved, along.bank_acceleration[k], step)
            moved = moved - np.linalg.solve(np.eye(size) - after[k], (moved - start - increment).T).T
    differences = (moved[:size] - moved[size:]).T / (2.0 * STATE_DIFFERENCE) / scale[:, np.newaxis]
    expected = sensitivity[-1] * scale / scale[:, np.newaxis]
    return np.abs(differences - expected).max() / np.abs(expected).max()


# ---- identities ------------------------------------------------------------------------------------------------------


def final_position(planet: Planet, sensitivity):
    """Final radius, crossrange and downrange per metre at entry, (3, 3)."""
    return position_rows(planet) @ sensitivity[-1] @ position_columns(planet)


def turned_flight(along: Trajectory):
    """Final position per metre of crossrange at entry, exact for the equations of motion, (3,).

    Another latitude at entry turns the whole flight about the axis in the equator a quarter turn west of its start:

        (0, cos(theta_f - theta_0), tan(phi_f) sin(theta_f - theta_0))
    """
    latitude, travelled = along.state[-1, 1], along.state[-1, 2] - along.state[0, 2]
    return np.array([0.0, np.cos(travelled), np.tan(latitude) * np.sin(travelled)])


def longitude_deviation(planet: Planet, design: Design, sensitivity):
    """Largest deviation of the longitude column from a unit vector at any node, states in the scales of the gains."""
    scale, longitude = entry_problem.state_scale(planet, design), STATES.index("longitude")
    column = sensitivity[:, :, longitude] / scale * scale[longitude]
    return np.abs(column - np.eye(len(STATES))[longitude]).max()


def crossrange_deviation(planet: Planet, along: Trajectory, sensitivity):
    """Largest deviation of the final crossrange column from that of the turned flight."""
    return np.abs(final_position(planet, sensitivity)[:, 1] - turned_flight(along)).max()


def solver_deviation(solution: Solution, sensitivity):
    """`column_deviation` of the radius column that a solver found; NaN for a problem without columns."""
    names = [variable.name for variable in solution.problem.states]
    rows = [row for row, state in enumerate(STATES) if column(state, CHANNELS[0]) in names]
    columns = [names.index(column(STATES[row], CHANNELS[0])) for row in rows]
    return column_deviation(solution.states[:, columns], sensitivity[:, rows]) if rows else np.nan


def column_deviation(column, sensitivity):
    """Largest difference of a radius column (N + 1, n) to the sensitivity's, relative to the largest of each state."""
    expected = sensitivity[:, :, 0]
    largest = np.abs(expected).max(axis=0)
    reached = largest > 0.0
    return (np.abs(column - expected).max(axis=0)[reached] / largest[reached]).max()


def defect(setup: Setup, scheme, along: Trajectory):
    """Largest defect of the equations of an interval, in the scales of the states."""
    planet, vehicle = setup.planet, setup.vehicle
    scale = [variable.scale for variable in entry_problem.problem(planet, vehicle, setup.mission).states]
    start, end, step = along.state[:-1], along.state[1:], np.diff(along.time)[:, np.newaxis]
    return np.abs(
        (end - start - change(planet, vehicle, scheme, start, end, along.bank_acceleration, step)) / scale
    ).max()


def _row(setup: Setup, simulation: Simulation, tradeoff, number):
    """The fields of one row of Table 3."""
    planet, vehicle, scheme = setup.planet, setup.vehicle, setup.solver.scheme
    along = Trajectory(tradeoff.time[number], tradeoff.state[number], tradeoff.bank_acceleration[number])
    mirrored = along._replace(state=along.state * MIRROR, bank_acceleration=-along.bank_acceleration)
    moved = np.zeros(len(STATES))
    moved[STATES.index("longitude")] = LONGITUDE_SHIFT
    shifted = along._replace(state=along.state + moved)
    sensitivity, steps, _ = sensitivities(planet, vehicle, scheme, along)
    position = final_position(planet, sensitivity)
    backward = adjoint_rows(steps, position_rows(planet))[0] @ position_columns(planet)
    expected = np.sum(position[:, 0] ** 2) + 1.0 + np.sum(turned_flight(along) ** 2)

    def error(other):
        return (
            final_position(planet, sensitivities(planet, vehicle, scheme, other)[0])[:, 0] * simulation.tabulated_error
        )

    expected_error = position[:, 0] * simulation.tabulated_error
    return {
        "row_longitude_deviation": longitude_deviation(planet, setup.design, sensitivity),
        "row_crossrange_deviation": crossrange_deviation(planet, along, sensitivity),
        "row_solver_deviation": column_deviation(tradeoff.column[number], sensitivity),
        "row_adjoint_deviation": np.abs(backward - position).max(),
        "row_frobenius_deviation": abs(np.sum(position**2) / expected - 1.0),
        "row_defect": defect(setup, scheme, along),
        "mirrored_defect": defect(setup, scheme, mirrored),
        "shifted_defect": defect(setup, scheme, shifted),
        "mirrored_error_deviation": np.abs(error(mirrored) * MIRROR[:3] - expected_error).max(),
        "shifted_error_deviation": np.abs(error(shifted) - expected_error).max(),
    }


# ---- stationarity, other derivatives, flights ------------------------------------------------------------------------


def slopes(setup: Setup, tradeoff, rows):
    """Relative deviation of dJ0/d(norm) from minus the weight at rows of Table 3, by solves at weights beside them."""
    planet, solver, design = setup.planet, setup.solver, setup.design
    extended, transcribed = prepared(setup)
    deviations = []
    for row in rows:
        start, weight = extended.guess(row_guess(tradeoff, row), entry_problem.given()), tradeoff.weight[row]
        beside = [
            attempt(solver, transcribed, start, entry_problem.given(weight * (1.0 + sign * NEIGHBOUR)), barrier=WARM)
            for sign in (-1.0, 1.0)
        ]
        efforts, norms = [effort(s) for s in beside], [norm(planet, design, extended, s) for s in beside]
        solved = all(s.status == SOLVED for s in beside)
        deviations.append(np.diff(efforts)[0] / np.diff(norms)[0] / -weight - 1.0 if solved else np.nan)
    return np.array(deviations)


def variants_from_profile(setup: Setup) -> list[Solution]:
    """The nominal from the guess of the inputs, by every variant."""
    _, problem = declared(setup, 0.0)
    solver = setup.solver
    guess = entry_problem.profile_guess(
        setup.mission, solver, problem, solver.guess_banks, solver.guess_switch_times, solver.guess_final_time
    )
    return _variants(setup.planet, solver, problem, guess, 0.0, barrier=None)


def variants_from_row(setup: Setup, tradeoff, row) -> list[Solution]:
    """A row of Table 3 from the row before it, by every variant."""
    extended, problem = declared(setup, tradeoff.weight[row])
    guess = extended.guess(row_guess(tradeoff, row - 1), entry_problem.given())
    return _variants(setup.planet, setup.solver, problem, guess, tradeoff.weight[row])


def _variants(planet: Planet, solver: Solver, problem, guess, weight, **options):
    """Solutions by every variant; where second derivatives are approximated, an acceptable level is all that is met."""
    expand = planet.density_profile != "table"  # splines cannot be expanded
    programs = {
        EXACT: Program(problem, solver.intervals, solver.scheme, expand=expand),
        UNEXPANDED: Program(problem, solver.intervals, solver.scheme, expand=False),
        APPROXIMATED: Program(problem, solver.intervals, solver.scheme, expand=expand, hessian="limited-memory"),
    }
    options = {"barrier": WARM, "accept": (SOLVED, ACCEPTABLE)} | options
    return [attempt(solver, programs[variant], guess, entry_problem.given(weight), **options) for variant in VARIANTS]


def against_flights(setup: Setup, simulation: Simulation, case: Case, sizes):
    """Final errors for radius errors at entry, by the sensitivity and as flown; (sizes, 3) each, m."""
    planet, vehicle = setup.planet, setup.vehicle
    states, controls, final_time = case.guess.states, case.guess.controls[:, 0], case.guess.final_time
    along = Trajectory(np.linspace(0.0, final_time, len(states)), states, controls)
    position = final_position(planet, sensitivities(planet, vehicle, setup.solver.scheme, along)[0])
    flown_errors = environment.final_errors(
        planet,
        simulation,
        environment.surroundings(planet, vehicle),
        flight.Reference(states[0], controls, final_time),
        np.zeros(len(STATES)),
        environment.along_channel(0, sizes),
    )
    return sizes[:, np.newaxis] * position[:, 0], flown_errors
