"""The entry as a problem of optimal control: equations, conditions, guesses, and what solutions are measured by."""

from dataclasses import replace
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
from marsedl.methods.desensitization import Desensitized, Gain, Perturbation, column
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.models.reaction_control import bank_propellant
from marsedl.papers.desensitized import mean_density
from marsedl.papers.desensitized.inputs import Design, Inputs, Mission, Planet, Solver, Vehicle
from marsedl.papers.desensitized.records import CHANNELS, Nominal, Tradeoff
from marsedl.replication.errors import MarsedlError, SolverError
from marsedl.replication.units import DEGREE

STATES = (
    *("altitude", "latitude", "longitude", "radial_velocity", "north_velocity", "east_velocity"),
    *("bank", "bank_rate"),
)
POSITIONS, MEASURED = STATES[:3], STATES[:6]
BANK, BANK_RATE = STATES.index("bank"), STATES.index("bank_rate")
LEVEL = 0.5 * DEGREE  # a bank angle below it counts as none when reversals are counted
ROUNDING = 1e-6  # relative, by which an optimiser may leave the bound on the nominal's bank acceleration
WARM = 1e-4  # initial barrier of the solver where the guess is a solution nearby


# ---- the problem -----------------------------------------------------------------------------------------------------


def rates(planet: Planet, vehicle: Vehicle):
    """Equations of motion (Eqs. 1, 2 and 4) as a function of states, control, weight and density factor."""
    log_density = mean_density.log_density(planet)

    def entry_rates(*arguments):
        *motion, bank_acceleration, _, density_factor = arguments
        air = density_factor * np.exp(log_density(motion[0]))
        return velocity_component_entry_rates(
            motion,
            bank_acceleration,
            air,
            (vehicle.ballistic_coefficient, vehicle.lift_to_drag),
            (planet.gravitational_parameter, planet.planet_radius),
        )

    return entry_rates


def entry_state(mission: Mission):
    """State at entry, (8,); bank and bank rate are zero where they are free."""
    speed, climb, heading = mission.entry_velocity, mission.entry_flight_path_angle, mission.entry_azimuth
    horizontal = speed * np.cos(climb)
    return np.array(
        [
            mission.entry_altitude,
            mission.entry_latitude,
            mission.entry_longitude,
            speed * np.sin(climb),
            horizontal * np.cos(heading),
            horizontal * np.sin(heading),
            mission.initial_bank or 0.0,
            mission.initial_bank_rate or 0.0,
        ]
    )


def bank_acceleration_squared(*arguments):
    """Integrand of the control energy J0 (Eq. 3), deg^2/s^4."""
    return (arguments[len(STATES)] / DEGREE) ** 2


class Trajectory(NamedTuple):
    """What is followed, linearised or measured: nodes, states and the bank acceleration between them."""

    time: np.ndarray  # (N + 1,), s
    state: np.ndarray  # (N + 1, 8)
    bank_acceleration: np.ndarray  # (N,), rad/s^2


def of_nominal(nominal: Nominal) -> Trajectory:
    """The nominal as a trajectory."""
    return Trajectory(nominal.time, nominal.state, nominal.bank_acceleration)


def of_rows(tradeoff: Tradeoff) -> list[Trajectory]:
    """The rows of Table 3 as trajectories."""
    return [Trajectory(*row) for row in zip(tradeoff.time, tradeoff.state, tradeoff.bank_acceleration, strict=True)]


def of_solution(solution: Solution) -> Trajectory:
    """A solution without its columns."""
    return Trajectory(solution.time, solution.states[:, : len(STATES)], solution.controls[:, 0])


def problem(given: Inputs) -> Problem:
    """Least control energy between entry and deployment (Eqs. 1 to 4, Table 2), without regard to sensitivities."""
    vehicle, mission = given.vehicle, given.mission
    initial = dict(zip(STATES[:6], entry_state(mission), strict=False))
    final = {
        "altitude": mission.final_altitude,
        "latitude": mission.final_latitude,
        "longitude": mission.final_longitude,
    }
    for conditions, bank, bank_rate in (
        (initial, mission.initial_bank, mission.initial_bank_rate),
        (final, mission.final_bank, mission.final_bank_rate),
    ):
        conditions |= {"bank": bank} if bank is not None else {}
        conditions |= {"bank_rate": bank_rate} if bank_rate is not None else {}
    square = mission.final_velocity**2
    return Problem(
        rates=rates(given.planet, vehicle),
        states=(
            Variable("altitude", 1e5, 0.0),
            Variable("latitude", 0.1),
            Variable("longitude", 0.1),
            *(Variable(name, 1e3) for name in STATES[3:6]),
            Variable("bank"),
            Variable("bank_rate", 0.02, -vehicle.bank_rate_bound, vehicle.bank_rate_bound),
        ),
        controls=(
            Variable("bank_acceleration", 0.002, -vehicle.bank_acceleration_bound, vehicle.bank_acceleration_bound),
        ),
        final_time=Variable("final_time", 100.0, *mission.final_time_bounds),
        initial=initial,
        final=final,
        boundary=(
            Condition(
                "square of the final velocity",
                lambda start, end: sum(end[name] ** 2 for name in STATES[3:6]),
                square,
                square,
                square,
            ),
        ),
        running_cost=bank_acceleration_squared,
        given=("weight", "density_factor"),
    )


def given(weight=0.0):
    """Given parameters of a solve."""
    return {"weight": float(weight), "density_factor": 1.0}


def position_error(planet: Planet, channel) -> Perturbation:
    """A position error of one metre at entry: of radius, crossrange (north) or downrange (east)."""
    state = POSITIONS[CHANNELS.index(channel)]
    return Perturbation(channel, {state: 1.0 if state == "altitude" else 1.0 / planet.planet_radius})


def state_scale(planet: Planet, design: Design):
    """Deviations of the states that count as equally large, (8,): a planet's radius, a radian, and so on."""
    length = planet.planet_radius
    speed = length / design.gain_time
    return np.array([length, 1.0, 1.0, speed, speed, speed, 1e3, 1e2])


def gain_scale(planet: Planet, design: Design):
    """Deviations of the measured states that count as one, (6,)."""
    return state_scale(planet, design)[: len(MEASURED)]


def gain_vector(planet: Planet, design: Design, scaled_gain):
    """Gains on all states, (8,), from those on the scaled measured states."""
    return np.concatenate([np.asarray(scaled_gain) / gain_scale(planet, design), [0.0, 0.0]])


def desensitized(given: Inputs, perturbations, gains=False) -> Desensitized:
    """The problem with columns of the sensitivity among its states, per unit of the perturbations (Eq. 5)."""
    scale = state_scale(given.planet, given.design) / given.planet.planet_radius
    feedback = tuple(
        Gain("bank_acceleration", name, 1.0 / unit)
        for name, unit in zip(MEASURED, state_scale(given.planet, given.design), strict=False)
        if gains
    )
    return Desensitized(
        problem(given),
        tuple(perturbations),
        dict(zip(STATES, scale, strict=True)),
        feedback,
    )


def norm_length(planet: Planet, design: Design):
    """Length that counts as one radian in the norm of the sensitivity, m."""
    return design.sensitivity_length or planet.planet_radius


def squared_norm(planet: Planet, design: Design, end, channels):
    """Squared Frobenius norm of columns of the final position sensitivity (Eq. 6).

    Altitudes are divided by `sensitivity_length`, angles are taken in radians, in rows and columns alike. With the
    planet's radius this is the norm in metres per metre, with a length of 1 m that of the block as it stands.
    """
    length = norm_length(planet, design)
    row = np.array([1.0 / length, 1.0, 1.0])
    unit = {"radius": length, "crossrange": planet.planet_radius, "downrange": planet.planet_radius}
    total = design.norm_smoothing
    for channel in channels:
        for name, scale in zip(POSITIONS, row * unit[channel], strict=True):
            # Downrange and crossrange errors are counted per metre, and reach not every state.
            total = total + (scale * end.get(column(name, channel), 0.0)) ** 2
    return total


def weighted(planet: Planet, design: Design, extended: Desensitized, channels) -> Problem:
    """The augmented objective J = J0 + c |S_p| (Eq. 6), divided by c / solved_weight_scale where that exceeds one."""
    count = len(extended.problem.states)

    def divisor(weight):
        return np.maximum(1.0, weight / design.solved_weight_scale)

    def running_cost(*arguments):
        weight = arguments[-2]
        return (arguments[count] / DEGREE) ** 2 / divisor(weight)

    def end_cost(start, end, parameters):
        weight = parameters["weight"]
        return weight / divisor(weight) * np.sqrt(squared_norm(planet, design, end, channels))

    return replace(extended.problem, running_cost=running_cost, end_cost=end_cost)


def program(planet: Planet, solver: Solver, declared, hessian="exact") -> Program:
    """A problem transcribed as the inputs say; tables of density are splines, which cannot be expanded."""
    expand = planet.density_profile != "table"
    return Program(declared, solver.intervals, solver.scheme, hessian=hessian, expand=expand)


# ---- solving ---------------------------------------------------------------------------------------------------------


def solve(solver: Solver, case, transcribed, guess, weight=0.0, **options) -> Solution:
    """Solve one case; what does not converge ends in a message that names it, with the last iterate for inspection."""
    options = {"tolerance": solver.solver_tolerance, "iterations": solver.solver_iterations} | options
    try:
        return transcribed.solve(guess, given(weight), **options)
    except NotConvergedError as error:
        raise failure(case, error) from error


def attempt(solver: Solver, transcribed, guess, parameters=None, **options) -> Solution:
    """Solve; where that fails, the last iterate with its status. parameters: those given, no weight if None."""
    options = {"tolerance": solver.solver_tolerance, "iterations": solver.solver_iterations} | options
    try:
        return transcribed.solve(guess, parameters or given(), **options)
    except NotConvergedError as error:
        return error.solution


def failure(case, error: NotConvergedError) -> SolverError:
    """The message for a case that did not converge, with its last iterate."""
    last = error.solution
    names = [variable.name for variable in last.problem.states]
    control = np.vstack([last.controls, last.controls[-1:]])
    iterate = {"time": last.time, **dict(zip(names, last.states.T, strict=True)), "bank_acceleration": control[:, 0]}
    return SolverError(f"{case}: {error}", iterate)


def profile_guess(mission: Mission, solver: Solver, declared: Problem, banks, switch_times, final_time) -> Guess:
    """A guess that flies a smooth bank profile: from one bank angle to the next, as a hyperbolic tangent.

    declared: the problem whose equations are flown.
    """
    time = np.linspace(0.0, final_time, solver.intervals + 1)
    changes = list(zip(np.diff(banks), switch_times, strict=True))

    def bank_rate(t):
        shares = (step * (1.0 - np.tanh((t - at) / solver.guess_width) ** 2) for step, at in changes)
        return sum(shares) / (2.0 * solver.guess_width)

    start = entry_state(mission)
    start[BANK] = sum((step * (1.0 + np.tanh(-at / solver.guess_width)) / 2.0 for step, at in changes), banks[0])
    start[BANK_RATE] = bank_rate(0.0)
    controls = np.diff([bank_rate(t) for t in time])[:, np.newaxis] * solver.intervals / final_time
    try:
        states = simulate(declared, start, controls, time, [0.0, 1.0], relative_tolerance=1e-7)
    except RuntimeError as error:
        raise MarsedlError(
            f"the guess cannot be flown to its end, perhaps it goes far below the ground: {error}; give guess_banks "
            "with more lift up, or an earlier guess_final_time"
        ) from error
    return Guess(states, controls, final_time)


# ---- measures --------------------------------------------------------------------------------------------------------


def effort(time, bank_acceleration):
    """Control energy J0 (Eq. 3), deg^2/s^3."""
    return float((bank_acceleration / DEGREE) ** 2 @ np.diff(time))


def cumulative(time, bank_acceleration):
    """Integral of the absolute bank acceleration, rad/s; the paper's cumulative bank rate."""
    return float(np.abs(bank_acceleration) @ np.diff(time))


def propellant(vehicle: Vehicle, cumulative_bank_acceleration):
    """Propellant of the reaction control system, kg."""
    return bank_propellant(
        cumulative_bank_acceleration,
        vehicle.angle_of_attack,
        vehicle.roll_inertia,
        vehicle.yaw_inertia,
        vehicle.roll_arm,
        vehicle.yaw_arm,
        vehicle.specific_impulse,
        vehicle.standard_gravity,
    )


def _wrapped(bank):
    """The bank angle, brought into -180 to 180 degrees, and the nodes at which it is clear of zero."""
    wrapped = (np.asarray(bank) + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped, np.flatnonzero(np.abs(wrapped) > LEVEL)


def _reversals(bank):
    """Nodes beside each reversal, the last clear one before it and the first one after it: (reversals, 2)."""
    wrapped, clear = _wrapped(bank)
    angles = wrapped[clear]
    crossed = (np.sign(angles[1:]) != np.sign(angles[:-1])) & (np.abs(np.diff(angles)) < np.pi)
    return np.column_stack([clear[:-1][crossed], clear[1:][crossed]])


def reversals(bank):
    """How often the bank angle, brought into -180 to 180 degrees, changes its side through zero."""
    return len(_reversals(bank))


def reversal_times(time, bank):
    """When it does, by lines between the nodes, (reversals,), s."""
    times = []
    for before, after in _reversals(bank):
        turns = np.round((bank[before] + bank[after]) / (4.0 * np.pi))
        angles = np.asarray(bank[before : after + 1]) - 2.0 * np.pi * turns
        k = int(np.argmax(angles[:-1] * angles[1:] <= 0.0))
        step = time[before + k + 1] - time[before + k]
        times.append(time[before + k] - angles[k] * step / (angles[k + 1] - angles[k]))
    return np.array(times)


def full_rolls(bank):
    """Full turns by which the bank angle moves on from its start."""
    return int((np.max(bank) - np.min(bank)) // (2.0 * np.pi))


def first_bank(bank):
    """Sign of the first bank angle that is clear of zero: negative or positive; level if there is none."""
    wrapped, clear = _wrapped(bank)
    if not clear.size:
        return "level"
    return "negative" if wrapped[clear[0]] < 0.0 else "positive"


def branch_name(bank):
    """What a solution is called by its bank angle: its full rolls, or else its reversals."""
    if rolls := full_rolls(bank):
        return f"{360 * rolls} deg roll"
    number = reversals(bank)
    return f"{number} reversal{'' if number == 1 else 's'}"


def lengths(planet: Planet):
    """Metres per unit of altitude, latitude and longitude."""
    return np.array([1.0, planet.planet_radius, planet.planet_radius])


def miss(planet: Planet, mission: Mission, end):
    """Altitude, crossrange and downrange by which final states (..., 8) miss the target, m."""
    target = np.array([mission.final_altitude, mission.final_latitude, mission.final_longitude])
    return (end[..., :3] - target) * lengths(planet)


def metric(planet: Planet, sensitivity):
    """Rows of altitude, latitude and longitude of a sensitivity (..., 8, m) as lengths, m per unit: (..., 3, m)."""
    return sensitivity[..., :3, :] * lengths(planet)[:, np.newaxis]


def position_errors(states, nominal_states, planet_radius):
    """Position errors in metres, as the paper's figures show them (Sec. 4).

        (delta h, r_m delta phi, r_m delta theta)

    With one radius r_m from start to end, a downrange error without feedback stays what it is.

    Args:
        states: (..., n), altitude (m), latitude and longitude (rad) first; `Trajectories` have the trial last, so move
            their dimension 1 to the end.
        nominal_states: (..., n), likewise, broadcast against them.
        planet_radius: r_m, m.

    Returns:
        (..., 3), errors in radius, crossrange (north) and downrange (east), m.
    """
    position, nominal = (np.asarray(part, dtype=float)[..., : len(POSITIONS)] for part in (states, nominal_states))
    return (position - nominal) * np.array([1.0, planet_radius, planet_radius])
