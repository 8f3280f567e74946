"""The entry as a problem of optimal control: equations, conditions, guesses, and what solutions are measured by."""

from dataclasses import replace

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
from marsedl.papers import density
from marsedl.replication.errors import MarsedlError, SolverError

DEGREE = np.pi / 180.0
STATES = (
    *("altitude", "latitude", "longitude", "radial_velocity", "north_velocity", "east_velocity"),
    *("bank", "bank_rate"),
)
POSITIONS, MEASURED = STATES[:3], STATES[:6]
CHANNELS = ("radius", "crossrange", "downrange")
BANK, BANK_RATE = STATES.index("bank"), STATES.index("bank_rate")
# Signs of the states of a flight seen in a mirror.
MIRROR = np.array([-1.0 if name in ("latitude", "north_velocity", "bank", "bank_rate") else 1.0 for name in STATES])
LEVEL = 0.5 * DEGREE  # a bank angle below it counts as none when reversals are counted
WARM = 1e-4  # initial barrier of the solver where the guess is a solution nearby


# ---- the problem -----------------------------------------------------------------------------------------------------


def rates(inputs):
    """Equations of motion (Eqs. 1, 2 and 4) as a function of states, control, weight and density factor."""
    log_density = density.log_density(inputs)

    def entry_rates(*arguments):
        *motion, _, density_factor = arguments
        air = density_factor * np.exp(log_density(motion[0]))
        return velocity_component_entry_rates(
            *motion,
            air,
            inputs.ballistic_coefficient,
            inputs.lift_to_drag,
            inputs.gravitational_parameter,
            inputs.planet_radius,
        )

    return entry_rates


def entry_state(inputs):
    """State at entry, (8,); bank and bank rate are zero where they are free."""
    speed, climb, heading = inputs.entry_velocity, inputs.entry_flight_path_angle, inputs.entry_azimuth
    horizontal = speed * np.cos(climb)
    return np.array(
        [
            inputs.entry_altitude,
            inputs.entry_latitude,
            inputs.entry_longitude,
            speed * np.sin(climb),
            horizontal * np.cos(heading),
            horizontal * np.sin(heading),
            inputs.initial_bank or 0.0,
            inputs.initial_bank_rate or 0.0,
        ]
    )


def bank_acceleration_squared(*arguments):
    """Integrand of the control energy J0 (Eq. 3), deg^2/s^4."""
    return (arguments[len(STATES)] / DEGREE) ** 2


def problem(inputs) -> Problem:
    """Least control energy between entry and deployment (Eqs. 1 to 4, Table 2), without regard to sensitivities."""
    initial = dict(zip(STATES[:6], entry_state(inputs), strict=False))
    final = {
        "altitude": inputs.final_altitude,
        "latitude": inputs.final_latitude,
        "longitude": inputs.final_longitude,
    }
    for ends, bank, bank_rate in (
        (initial, inputs.initial_bank, inputs.initial_bank_rate),
        (final, inputs.final_bank, inputs.final_bank_rate),
    ):
        ends |= {"bank": bank} if bank is not None else {}
        ends |= {"bank_rate": bank_rate} if bank_rate is not None else {}
    square = inputs.final_velocity**2
    return Problem(
        rates=rates(inputs),
        states=(
            Variable("altitude", 1e5, 0.0),
            Variable("latitude", 0.1),
            Variable("longitude", 0.1),
            *(Variable(name, 1e3) for name in STATES[3:6]),
            Variable("bank"),
            Variable("bank_rate", 0.02, -inputs.bank_rate_bound, inputs.bank_rate_bound),
        ),
        controls=(
            Variable("bank_acceleration", 0.002, -inputs.bank_acceleration_bound, inputs.bank_acceleration_bound),
        ),
        final_time=Variable("final_time", 100.0, *inputs.final_time_bounds),
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


def position_error(inputs, channel) -> Perturbation:
    """A position error of one metre at entry: of radius, crossrange (north) or downrange (east)."""
    state = POSITIONS[CHANNELS.index(channel)]
    return Perturbation(channel, {state: 1.0 if state == "altitude" else 1.0 / inputs.planet_radius})


def state_scale(inputs):
    """Deviations of the states that count as equally large, (8,): a planet's radius, a radian, and so on."""
    length = inputs.planet_radius
    speed = length / inputs.gain_time
    return np.array([length, 1.0, 1.0, speed, speed, speed, 1e3, 1e2])


def desensitized(inputs, perturbations, gains=False) -> Desensitized:
    """The problem with columns of the sensitivity among its states, per unit of the perturbations (Eq. 5)."""
    scale = state_scale(inputs) / inputs.planet_radius
    feedback = tuple(
        Gain("bank_acceleration", name, 1.0 / unit)
        for name, unit in zip(MEASURED, state_scale(inputs), strict=False)
        if gains
    )
    return Desensitized(problem(inputs), tuple(perturbations), dict(zip(STATES, scale, strict=True)), feedback)


def squared_norm(inputs, end, channels):
    """Squared Frobenius norm of columns of the final position sensitivity (Eq. 6).

    Altitudes are divided by `sensitivity_length`, angles are taken in radians, in rows and columns alike. With the
    planet's radius this is the norm in metres per metre, with a length of 1 m that of the block as it stands.
    """
    row = np.array([1.0 / inputs.sensitivity_length, 1.0, 1.0])
    unit = {"radius": inputs.sensitivity_length, "crossrange": inputs.planet_radius, "downrange": inputs.planet_radius}
    total = inputs.norm_smoothing
    for channel in channels:
        for name, scale in zip(POSITIONS, row * unit[channel], strict=True):
            # Downrange and crossrange errors are counted per metre, and reach not every state.
            total = total + (scale * end.get(column(name, channel), 0.0)) ** 2
    return total


def weighted(inputs, extended: Desensitized, channels) -> Problem:
    """The augmented objective J = J0 + c |S_p| (Eq. 6), divided by c / solved_weight_scale where that exceeds one."""
    count = len(extended.problem.states)

    def divisor(weight):
        return np.maximum(1.0, weight / inputs.solved_weight_scale)

    def running_cost(*arguments):
        weight = arguments[-2]
        return (arguments[count] / DEGREE) ** 2 / divisor(weight)

    def end_cost(start, end, parameters):
        weight = parameters["weight"]
        return weight / divisor(weight) * np.sqrt(squared_norm(inputs, end, channels))

    return replace(extended.problem, running_cost=running_cost, end_cost=end_cost)


def program(inputs, declared, intervals=None, scheme=None, hessian="exact") -> Program:
    """A problem transcribed as the inputs say; tables of density are splines, which cannot be expanded."""
    return Program(
        declared,
        intervals or inputs.intervals,
        scheme or inputs.scheme,
        hessian=hessian,
        expand=inputs.density_profile != "table",
    )


# ---- solving ---------------------------------------------------------------------------------------------------------


def solve(inputs, case, transcribed, guess, weight=0.0, **options) -> Solution:
    """Solve one case; what does not converge ends in a message that names it, with the last iterate for inspection."""
    options = {"tolerance": inputs.solver_tolerance, "iterations": inputs.solver_iterations} | options
    try:
        return transcribed.solve(guess, given(weight), **options)
    except NotConvergedError as error:
        raise failure(case, error) from error


def failure(case, error: NotConvergedError) -> SolverError:
    """The message for a case that did not converge, with its last iterate."""
    last = error.solution
    names = [variable.name for variable in last.problem.states]
    held = np.vstack([last.controls, last.controls[-1:]])
    iterate = {"time": last.time, **dict(zip(names, last.states.T, strict=True)), "bank_acceleration": held[:, 0]}
    return SolverError(f"{case}: {error}", iterate)


def profile_guess(inputs, banks, switch_times, final_time, declared=None) -> Guess:
    """A guess that flies a smooth bank profile: from one bank angle to the next, as a hyperbolic tangent."""
    time = np.linspace(0.0, final_time, inputs.intervals + 1)
    changes = list(zip(np.diff(banks), switch_times, strict=True))

    def bank_rate(t):
        shares = (step * (1.0 - np.tanh((t - at) / inputs.guess_width) ** 2) for step, at in changes)
        return sum(shares) / (2.0 * inputs.guess_width)

    start = entry_state(inputs)
    start[BANK] = sum((step * (1.0 + np.tanh(-at / inputs.guess_width)) / 2.0 for step, at in changes), banks[0])
    start[BANK_RATE] = bank_rate(0.0)
    controls = np.diff([bank_rate(t) for t in time])[:, np.newaxis] * inputs.intervals / final_time
    try:
        flown = simulate(declared or problem(inputs), start, controls, time, [0.0, 1.0], relative_tolerance=1e-7)
    except RuntimeError as error:
        raise MarsedlError(
            f"the guess cannot be flown to its end, perhaps it goes far below the ground: {error}; give guess_banks "
            "with more lift up, or an earlier guess_final_time"
        ) from error
    return Guess(flown, controls, final_time)


# ---- measures --------------------------------------------------------------------------------------------------------


def effort(time, bank_acceleration):
    """Control energy J0 (Eq. 3), deg^2/s^3."""
    return float((bank_acceleration / DEGREE) ** 2 @ np.diff(time))


def cumulative(time, bank_acceleration):
    """Integral of the absolute bank acceleration, rad/s; the paper's cumulative bank rate."""
    return float(np.abs(bank_acceleration) @ np.diff(time))


def propellant(inputs, cumulative_bank_acceleration):
    """Propellant of the reaction control system, kg."""
    return bank_propellant(
        cumulative_bank_acceleration,
        inputs.angle_of_attack,
        inputs.roll_inertia,
        inputs.yaw_inertia,
        inputs.roll_arm,
        inputs.yaw_arm,
        inputs.specific_impulse,
        inputs.standard_gravity,
    )


def reversals(bank):
    """How often the bank angle, brought into -180 to 180 degrees, changes its side through zero."""
    wrapped = (np.asarray(bank) + np.pi) % (2.0 * np.pi) - np.pi
    clear = wrapped[np.abs(wrapped) > LEVEL]
    changed = np.sign(clear[1:]) != np.sign(clear[:-1])
    return int(np.count_nonzero(changed & (np.abs(np.diff(clear)) < np.pi)))


def full_rolls(bank):
    """Full turns by which the bank angle moves on from its start."""
    return int((np.max(bank) - np.min(bank)) // (2.0 * np.pi))


def branch_name(bank):
    """What a solution is called by its bank angle: its full rolls, or else its reversals."""
    if rolls := full_rolls(bank):
        return f"{360 * rolls} deg roll"
    number = reversals(bank)
    return f"{number} reversal{'' if number == 1 else 's'}"


def lengths(inputs):
    """Metres per unit of altitude, latitude and longitude."""
    return np.array([1.0, inputs.planet_radius, inputs.planet_radius])


def miss(inputs, end):
    """Altitude, crossrange and downrange by which final states (..., 8) miss the target, m."""
    target = np.array([inputs.final_altitude, inputs.final_latitude, inputs.final_longitude])
    return (end[..., :3] - target) * lengths(inputs)


def metric(inputs, sensitivity):
    """Rows of altitude, latitude and longitude of a sensitivity (..., 8, m) as lengths, m per unit: (..., 3, m)."""
    return sensitivity[..., :3, :] * lengths(inputs)[:, np.newaxis]
