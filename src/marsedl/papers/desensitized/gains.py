"""Constant feedback gains, one set per channel, and the laws that are flown (Secs. 4.1 to 4.3).

The control energy does not depend on the gains, and three numbers are to vanish by six gains: the nominal stays, and
the least gains are a choice that does not depend on a solver's path.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.methods import sensitivity_gains
from marsedl.methods.collocation import SOLVED, NotConvergedError, Solution
from marsedl.methods.sensitivity import propagate_columns
from marsedl.montecarlo.streams import normals
from marsedl.papers.desensitized import entry_problem, environment, flight, gain_search
from marsedl.papers.desensitized.entry_problem import MEASURED, STATES, WARM, gain_scale, gain_vector
from marsedl.papers.desensitized.inputs import Design, Ensemble, Inputs, Planet, Vehicle
from marsedl.papers.desensitized.linearization import model, position_columns, position_rows, transitions
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import CHANNELS, LAWS, Gains, Linearization, Nominal, Tradeoff
from marsedl.papers.desensitized.tradeoff import last_finite_row
from marsedl.replication.errors import SolverError
from marsedl.replication.pipeline.catalogue import stage

TUNING_STREAM, START_STREAM = 1, 2  # of the random numbers, the latter of the first channel; flights use others


class Law(NamedTuple):
    """A trajectory to follow and the gains to do it with."""

    time: np.ndarray
    state: np.ndarray
    bank_acceleration: np.ndarray
    scaled_gain: np.ndarray = np.zeros(len(MEASURED))
    iterations: int = 0
    converged: bool = True
    ended: str = "no feedback"


def gain_problem(planet: Planet, design: Design, linearization: Linearization, columns):
    """The final position, in metres per metre, as a function of the gains, for columns (8, c) of the state at entry."""
    scheme = str(linearization.scheme)

    def at_points(values):
        """By the midpoint rule the one point of an interval is no dimension of the problem."""
        return values[:, 0] if scheme == "midpoint" else values

    return sensitivity_gains.GainProblem(
        scheme=scheme,
        state_matrix=at_points(linearization.state_matrix),
        control_matrix=at_points(linearization.control_matrix[..., np.newaxis]),
        step=np.diff(linearization.time),
        columns=columns,
        outputs=position_rows(planet),
        fed_back=np.arange(len(MEASURED)),
        state_scale=gain_scale(planet, design),
    )


@stage()
def compute(given: Inputs, nominal: Nominal, tradeoff: Tradeoff, linearization: Linearization) -> Gains:
    """Design the gains of every law as the inputs say."""
    plain = Law(nominal.time, nominal.state, nominal.bank_acceleration)
    row = last_finite_row(tradeoff)
    laws = [plain, Law(tradeoff.time[row], tradeoff.state[row], tradeoff.bank_acceleration[row])]
    for channel in CHANNELS:
        if given.design.gain_design == "unregularized":
            laws.append(together(given, nominal, channel))
            continue
        laws.append(with_gains(plain, channel_gains(given, linearization, plain, channel)))
    laws.append(for_all_columns(given, nominal, linearization))
    return described(given, laws)


def channel_gains(given: Inputs, linearization: Linearization, plain: Law, channel):
    """Gains against the errors of one channel on the nominal: least, regularised or tuned."""
    planet, design, number = given.planet, given.design, CHANNELS.index(channel)
    if design.gain_design == "regularized":
        problem = gain_problem(planet, design, linearization, position_columns(planet)[:, [number]])
        return gain_search.regularized(problem, design.all_columns_regularization)[-1]
    least = least_gains(given, linearization, channel)
    if design.gain_design != "tuned":
        return least
    lost = least._replace(converged=False, reason="no start of the tuning flies all errors to the end")
    return next(iter(tuned(given, reference(plain), number, least.k)), lost)


def random_starts(design: Design, ensemble: Ensemble, channel):
    """Random starts of the search for least gains of a channel, (starts, 6)."""
    numbers = np.arange(design.gain_start)
    return normals(ensemble.seed, START_STREAM + CHANNELS.index(channel), numbers, len(MEASURED))


def least_gains(given: Inputs, linearization, channel):
    """Least gains that null the final position of a channel's column, a `sensitivity_gains.GainDesign`."""
    design = given.design
    start = design.downrange_gain_start if channel == "downrange" else np.zeros(len(MEASURED))
    if design.gain_start:
        start = random_starts(design, given.ensemble, channel)[design.gain_start - 1]
    return sensitivity_gains.minimum_norm(
        gain_problem(given.planet, design, linearization, position_columns(given.planet)[:, [CHANNELS.index(channel)]]),
        start[np.newaxis],
        step_limit=design.gain_step_limit,
        tolerance=design.gain_tolerance,
        iterations=design.gain_iterations,
    )


def with_gains(law: Law, design) -> Law:
    """A law with the gains of a search, a `sensitivity_gains.GainDesign` or `gain_search.Tuning`."""
    return law._replace(
        scaled_gain=np.ravel(design.k),
        iterations=design.iterations,
        converged=bool(design.converged),
        ended=design.reason,
    )


def reference(law: Law) -> flight.Reference:
    """A law's trajectory as flights take it."""
    return flight.Reference(law.state[0], law.bank_acceleration, float(law.time[-1]))


def simulated_errors(given: Inputs, nominal_reference, channel):
    """Function of scaled gains: flown final errors at the tuning errors of a channel, each divided by its size."""
    air = environment.surroundings(given.planet, given.vehicle)
    sizes = given.design.tuning_errors
    errors = environment.along_channel(channel, sizes)

    def of_gains(scaled_gain):
        gain = gain_vector(given.planet, given.design, np.ravel(scaled_gain))
        final_errors = environment.final_errors(given.planet, given.simulation, air, nominal_reference, gain, errors)
        return (final_errors / np.abs(sizes)[:, np.newaxis]).ravel()

    return of_gains


def tuned(given: Inputs, nominal_reference, channel, least):
    """Gains tuned to flown errors from the least gains and from random changes of them, best first.

    Starts under which a flight is lost are left out, so that there may be none.
    """
    simulate, design = simulated_errors(given, nominal_reference, channel), given.design
    changes = normals(given.ensemble.seed, TUNING_STREAM, np.arange(1, design.tuning_starts), np.size(least))
    starts = [np.ravel(least), *(np.ravel(least) + design.tuning_spread * changes)]
    results = [
        gain_search.tune(simulate, start, iterations=design.gain_iterations)
        for start in starts
        if np.isfinite(simulate(start)).all()
    ]
    return [results[number] for number in gain_search.rank([result.k for result in results], simulate)]


def together(given: Inputs, nominal: Nominal, channel) -> Law:
    """Trajectory and gains of Eq. 6 in one problem, from the nominal and gains of zero, without regularisation.

    The gains are not determined, and the norm has no derivative where it vanishes: the solve is ended after the
    iterations that the inputs allow, and how it ended is the result.
    """
    planet, solver, design = given.planet, given.solver, given.design
    extended = entry_problem.desensitized(given, [entry_problem.position_error(planet, channel)], gains=True)
    transcribed = entry_problem.program(planet, solver, entry_problem.weighted(planet, design, extended, [channel]))
    guess = extended.guess(as_guess(nominal), entry_problem.given(), solver.scheme)
    weight, most = entry_problem.given(design.feedback_weight), design.unregularized_iterations
    try:
        solution = transcribed.solve(guess, weight, barrier=WARM, tolerance=solver.solver_tolerance, iterations=most)
    except NotConvergedError as error:
        solution = error.solution
    return solved_law(given.vehicle, extended, solution)


def for_all_columns(given: Inputs, nominal: Nominal, linearization: Linearization) -> Law:
    """One set of gains against all three position errors: J0 + |S_p|^2 + w |k|^2 in trajectory and gains, w falling.

    Six gains cannot null nine numbers on a given nominal; together with the trajectory they nearly do. The squared norm
    has derivatives everywhere, and the first, large w keeps the trajectory near the nominal. From gains that are not
    the best ones of the nominal the solver would leave it for a trajectory that depends on rounding.
    """
    planet, solver, design = given.planet, given.solver, given.design
    weights = design.all_columns_regularization
    problem = gain_problem(planet, design, linearization, position_columns(planet))
    fixed = gain_search.regularized(problem, weights[:1], design.downrange_gain_start[np.newaxis])[0].k.ravel()
    extended = entry_problem.desensitized(
        given, [entry_problem.position_error(planet, name) for name in CHANNELS], gains=True
    )
    gains = [gain.parameter for gain in extended.gains]

    def end_cost(start, end, parameters):
        size = sum(parameters[name] ** 2 for name in gains)
        return entry_problem.squared_norm(planet, design, end, CHANNELS) + parameters["weight"] * size

    transcribed = entry_problem.program(planet, solver, replace(extended.problem, end_cost=end_cost))
    free = dict(zip(gains, fixed, strict=True))
    last = extended.guess(as_guess(nominal)._replace(free=free), entry_problem.given(), solver.scheme)
    for weight in weights:
        try:
            most = design.all_columns_iterations
            last = entry_problem.solve(
                solver, "all columns", transcribed, last, weight=weight, barrier=WARM, iterations=most
            )
        except SolverError as error:
            # A set of gains beside the paper's; what stands so far is flown, and the artifact says how it ended.
            ended = f"stopped at a regularisation of {weight:g}: {error}"
            if isinstance(last, Solution):
                return solved_law(given.vehicle, extended, last)._replace(converged=False, ended=ended)
            return Law(nominal.time, nominal.state, nominal.bank_acceleration, fixed, 0, False, ended)
    return solved_law(given.vehicle, extended, last)


def solved_law(vehicle: Vehicle, extended, solution: Solution) -> Law:
    """The law of a solution with gains among its free parameters."""
    scaled_gain = np.array([solution.free[gain.parameter] for gain in extended.gains])
    bound = vehicle.bank_acceleration_bound
    return Law(
        solution.time,
        solution.states[:, : len(STATES)],
        np.clip(solution.controls[:, 0], -bound, bound),  # an unfinished solve may lie beyond it
        scaled_gain,
        solution.iterations,
        solution.status == SOLVED,
        solution.status,
    )


def described(given: Inputs, laws) -> Gains:
    """Laws as an artifact, with the sensitivity that their gains leave."""
    planet, design = given.planet, given.design
    columns, rows, final = position_columns(planet), position_rows(planet), []
    for law in laws:
        linear = model(planet, given.vehicle, given.solver.scheme, law)
        steps = transitions(linear, gain_vector(planet, design, law.scaled_gain))
        final.append(rows @ propagate_columns(steps, columns)[-1])

    def stacked(name):
        return np.array([getattr(law, name) for law in laws])

    return Gains(
        law=np.array(LAWS),
        gain=np.array([gain_vector(planet, design, law.scaled_gain) for law in laws]),
        final=np.array(final),
        effort=np.array([entry_problem.effort(law.time, law.bank_acceleration) for law in laws]),
        **{name: stacked(name) for name in Law._fields},
    )


def flown_law(gains: Gains, number) -> tuple[flight.Reference, np.ndarray]:
    """Trajectory and gains of a law, by its number, as flights take them."""
    time, state, control = gains.time[number], gains.state[number], gains.bank_acceleration[number]
    return flight.Reference(state[0], control, float(time[-1])), gains.gain[number]
