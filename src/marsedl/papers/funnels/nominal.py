"""Nominal trajectory of least bank rate under a limit of the heat rate (robust entry funnels, Sec. 4).

The paper names its solver and prints no numbers of the problem. The heat rate is limited at the nodes alone, and that
makes local optima: in each the heat rate peaks half-way between two neighbouring nodes, at both of which it is at the
limit, and every pair of nodes near the peak has one. Finer meshes have more of them, closer together, and let the heat
rate exceed its limit by less.
"""

from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import (
    Condition,
    Guess,
    NotConvergedError,
    Problem,
    Program,
    Solution,
    Variable,
    simulate,
)
from marsedl.methods.funnels.closed_loop import reference_on_half_steps
from marsedl.papers.density import TableExits
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.environment import STATES
from marsedl.papers.funnels.inputs import Guidance, Inputs, Mission, Planet, Vehicle
from marsedl.papers.funnels.records import Nominal
from marsedl.replication.errors import InfeasibleError, MarsedlError, SolverError
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.units import DEGREE, KM

FINE = 5  # integration steps in an interval when the heat rate between the nodes is wanted
SAME = 1e-5  # relative difference of costs below which two solutions are one optimum
NOTHING = 1e-3  # cost in deg^2/s that counts as none
INFEASIBLE = "Infeasible_Problem_Detected"  # as the solver says it
# Flights of constant bank, of which the slowest arrival is taken: their spacing and step.
BANK_SPACING, ARRIVAL_STEP = DEGREE, 0.5
HIGH = 1e4  # m; who climbs so far above the entry altitude does not arrive
# To what the limits are rounded that are given as ratios: a kilometre, and a tenth of W/cm^2.
WHOLE_DOWNRANGE, WHOLE_HEAT_RATE = KM, 1e3


class Limits(NamedTuple):
    """What the nominal has to meet: its final downrange (m), and the largest heat rate at the nodes (W/m^2)."""

    final_downrange: float
    heat_rate: float


# ---- the problem -----------------------------------------------------------------------------------------------------


def problem(given: Inputs, final_time_bounds, limits: Limits) -> Problem:
    """Least integral of the squared bank rate from entry to deployment (robust entry funnels, Sec. 4).

    The bank angle is a state, its rate the control, constant on each interval. The limit is imposed on the logarithm
    of the heat rate, which the solver takes far better than the heat rate itself.
    """
    mission = given.mission
    air = environment.undisturbed_air(given.planet)
    motion = environment.entry_rates(given.planet, given.vehicle, air)
    largest = np.log(limits.heat_rate)

    def rates(*arguments):
        *state, bank, bank_rate = arguments
        return (*motion(None, state, [bank], (0.0, 0.0)), bank_rate)

    def log_heat_rate(*arguments):
        altitude, velocity = arguments[0], arguments[3]
        factor = np.log(given.vehicle.heat_rate_constant / np.sqrt(given.vehicle.nose_radius))
        return factor + 0.5 * environment.log_density(air, altitude) + 3.0 * np.log(velocity)

    slowest, fastest = mission.final_velocity_bounds
    return Problem(
        rates=rates,
        states=(
            Variable("altitude", 1e4, 0.0),
            Variable("longitude", 0.02),
            Variable("latitude", 0.002),
            Variable("velocity", 1e3, mission.least_velocity),
            Variable("flight_path_angle", 0.1),
            Variable("heading", 0.02),
            Variable("bank", 1.0, *mission.bank_bounds),
        ),
        controls=(Variable("bank_rate", 0.01),),
        final_time=Variable("final_time", 100.0, *final_time_bounds),
        initial=dict(zip(STATES, environment.entry_state(mission), strict=True)),
        final={
            "altitude": mission.final_altitude,
            "longitude": mission.entry_longitude + limits.final_downrange / given.planet.planet_radius,
        },
        boundary=(Condition("final velocity", lambda start, end: end["velocity"], slowest, fastest, 1e3),),
        path=(Condition("logarithm of the heat rate", log_heat_rate, -np.inf, largest),),
        running_cost=lambda *arguments: (arguments[-1] / DEGREE) ** 2,
    )


def starts(mission: Mission, guidance: Guidance):
    """Bank angle and final time of every start within their bounds, the guess first, none twice."""
    banks = np.clip(guidance.start_banks, *mission.bank_bounds)
    times = np.clip(guidance.start_final_times, *guidance.final_time_bounds)
    grid = [(bank, time) for bank in banks for time in times]
    return list(dict.fromkeys([(guidance.guess_bank, guidance.guess_final_time), *grid]))


def constant_bank(mission: Mission, declared, intervals, bank, final_time) -> Guess:
    """A guess that flies one bank angle.

    Raises RuntimeError if it cannot be flown to its end.
    """
    time = np.linspace(0.0, final_time, intervals + 1)
    still = np.zeros((intervals, 1))
    start = np.array([*environment.entry_state(mission), bank])
    return Guess(simulate(declared, start, still, time, relative_tolerance=1e-7), still, final_time)


def search(given: Inputs, limits: Limits, intervals, guesses):
    """Solve within limits from every start of a list of bank angles and final times.

    Returns:
        List with a `Solution` for every start, or the error with which it ended.
    """
    declared = problem(given, given.guidance.final_time_bounds, limits)
    program = Program(declared, intervals, given.guidance.scheme)
    ends = []
    for bank, final_time in guesses:
        try:
            guess = constant_bank(given.mission, program.problem, intervals, bank, final_time)
            ends.append(
                program.solve(
                    guess, tolerance=given.guidance.nominal_tolerance, iterations=given.guidance.nominal_iterations
                )
            )
        except RuntimeError as error:  # a guess that cannot be flown, or a solve that does not converge
            ends.append(error)
    return ends


# ---- limits ----------------------------------------------------------------------------------------------------------


def limits_of(given: Inputs) -> Limits:
    """Final downrange and limit of the heat rate: as they are given, or by their ratios.

    The peak without a limit is that of the first start that leads to a flight, whichever optimum is taken with one.
    """
    mission = given.mission
    downrange, heat_rate = mission.final_downrange, mission.heat_rate_limit
    if downrange is None:
        slowest = slowest_arrival(given)
        downrange = float(np.round(mission.downrange_ratio * slowest / WHOLE_DOWNRANGE) * WHOLE_DOWNRANGE)
    if heat_rate is None:
        without, ends = Limits(downrange, np.inf), []
        for start in allowed_starts(mission, given.guidance):
            ends += search(given, without, given.guidance.intervals, [start])
            if isinstance(ends[-1], Solution):
                break
        else:
            raise _failure(ends)
        peak = peak_heat_rate(given.planet, given.vehicle, ends[-1])[0]
        heat_rate = float(np.round(mission.heat_rate_ratio * peak / WHOLE_HEAT_RATE) * WHOLE_HEAT_RATE)
    return Limits(downrange, heat_rate)


def slowest_arrival(given: Inputs) -> float:
    """Downrange (m) of that flight under constant bank which is the slowest at the final altitude.

    Of flights a degree apart, a parabola through the slowest and its neighbours is taken. Raises InfeasibleError if no
    flight arrives.
    """
    mission = given.mission
    air = environment.undisturbed_air(given.planet)
    motion = environment.entry_rates(given.planet, given.vehicle, air)
    low, high = mission.bank_bounds
    banks = np.linspace(low, high, round((high - low) / BANK_SPACING) + 1)
    state = np.repeat(environment.entry_state(mission)[:, np.newaxis], len(banks), axis=1)
    arrival, flying = np.full((2, len(banks)), np.nan), np.ones(len(banks), dtype=bool)

    def rates(state):
        return np.array(np.broadcast_arrays(*motion(None, state, (banks,), (0.0, 0.0))))

    for _ in range(round(given.guidance.final_time_bounds[1] / ARRIVAL_STEP)):
        after = runge_kutta(rates, state, ARRIVAL_STEP)
        there = flying & (after[0] <= mission.final_altitude)
        share = (state[0] - mission.final_altitude) / np.where(there, state[0] - after[0], 1.0)
        arrival[:, there] = (state[[1, 3]] + share * (after[[1, 3]] - state[[1, 3]]))[:, there]
        flying &= ~there & (after[0] < mission.entry_altitude + HIGH)
        if not flying.any():
            break
        state = np.where(flying, after, state)
    longitude, velocity = arrival
    if np.isnan(velocity).all():
        raise InfeasibleError("nominal: no flight under constant bank arrives at final_altitude; steepen the entry", {})
    slowest = int(np.nanargmin(velocity))
    near = slice(slowest - 1, slowest + 2)
    place = 0.0
    if 0 < slowest < len(banks) - 1 and np.isfinite(velocity[near]).all():
        before, at, after = velocity[near]
        place = (before - after) / (2.0 * (before - 2.0 * at + after))
    at = float(np.interp(slowest + place, np.arange(len(banks)), longitude)) if place else float(longitude[slowest])
    return (at - mission.entry_longitude) * given.planet.planet_radius


def runge_kutta(rates, state, step):
    """A step of the classical method of fourth order."""
    first = rates(state)
    second = rates(state + 0.5 * step * first)
    third = rates(state + 0.5 * step * second)
    return state + step / 6.0 * (first + 2.0 * (second + third) + rates(state + step * third))


def allowed_starts(mission: Mission, guidance: Guidance):
    """The guess, or all starts, as the inputs say."""
    return starts(mission, guidance)[: 1 if guidance.nominal_choice == "guess" else None]


def best(given: Inputs, limits: Limits) -> Solution:
    """The solution from the guess, or the cheapest of all starts, as the inputs say."""
    guesses = allowed_starts(given.mission, given.guidance)
    ends = search(given, limits, given.guidance.intervals, guesses)
    solutions = distinct(ends)
    if not solutions:
        raise _failure(ends)
    return solutions[0]


# ---- the stage -------------------------------------------------------------------------------------------------------


@stage()
def compute(given: Inputs) -> Nominal:
    """Solve from the guess, or from every start for the best, as the inputs say."""
    TableExits(given.planet).count(np.array(given.planet.density_window)).say(
        "density_window, over which the density is fitted"
    )
    limits = limits_of(given)
    return described(given.planet, given.vehicle, best(given, limits), limits)


def distinct(ends):
    """The different solutions among some ends of solves, by ascending cost."""
    solutions = []
    for solution in sorted((end for end in ends if isinstance(end, Solution)), key=lambda end: end.objective):
        if not (solutions and _same(solutions[-1], solution)):
            solutions.append(solution)
    return solutions


def _same(one, other):
    return abs(one.objective - other.objective) <= SAME * max(abs(other.objective), NOTHING)


def described(planet: Planet, vehicle: Vehicle, solution, limits: Limits) -> Nominal:
    """A solution as an artifact."""
    state = solution.states[:, : len(STATES)]
    return Nominal(
        time=solution.time,
        state=state,
        bank=solution.state("bank"),
        bank_rate=solution.controls[:, 0],
        cost=float(solution.objective * DEGREE**2),
        heat_rate=environment.heat_rate(vehicle, environment.undisturbed_air(planet), state[:, 0], state[:, 3]),
        peak_heat_rate=peak_heat_rate(planet, vehicle, solution)[0],
        heat_rate_limit=limits.heat_rate,
        final_downrange=limits.final_downrange,
        status=solution.status,
        iterations=solution.iterations,
    )


def peak_heat_rate(planet: Planet, vehicle: Vehicle, solution):
    """Largest heat rate of a solution, flown on a fine grid, and its time: (W/m^2, s).

    The logarithm of the heat rate is taken as a parabola through the largest of the grid and its neighbours.
    """
    air = environment.undisturbed_air(planet)
    motion, bank = environment.entry_rates(planet, vehicle, air), solution.state("bank")
    states, _ = reference_on_half_steps(
        lambda state, control: motion(None, state, control, (0.0, 0.0)),
        np.linspace(0.0, solution.final_time, (len(bank) - 1) * FINE + 1),
        lambda time: np.interp(time, solution.time, bank)[:, np.newaxis],
        solution.states[0, : len(STATES)],
    )
    heat = np.log(environment.heat_rate(vehicle, air, states[:, 0], states[:, 3]))
    spacing = solution.final_time / (len(states) - 1)
    top = int(np.clip(np.argmax(heat), 1, len(heat) - 2))
    before, at, after = heat[top - 1 : top + 2]
    curvature, slope = before - 2.0 * at + after, (after - before) / 2.0
    return float(np.exp(at - slope**2 / (2.0 * curvature))), float(spacing * (top - slope / curvature))


def _failure(ends):
    """The error for a nominal that was not found, with the last iterate from the guess if there is one."""
    which = "the guess leads to no solution" if len(ends) == 1 else f"none of {len(ends)} starts leads to a solution"
    message = (
        f"nominal: {which}; from the guess, {ends[0]}; give another guess_bank or guess_final_time, or a larger "
        "heat_rate_limit or heat_rate_ratio"
    )
    if not isinstance(ends[0], NotConvergedError):  # the guess itself could not be flown
        return MarsedlError(message)
    last = ends[0].solution
    names = [variable.name for variable in last.problem.states]
    kind = InfeasibleError if all(_is_infeasible(end) for end in ends) else SolverError
    return kind(message, {"time": last.time, **dict(zip(names, last.states.T, strict=True))})


def _is_infeasible(end):
    """Whether a solve ended as its constraints contradict each other."""
    return isinstance(end, NotConvergedError) and end.solution.status == INFEASIBLE
