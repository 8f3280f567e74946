"""Evidence for the funnel: other programs, directions, orders, numbers of slices, and what makes it diverge.

All funnels here have points on the slices themselves, and the integrated motion as condition unless they say otherwise,
whatever the reading takes. A funnel that does not exist has its message, and NaN from where it ends.
"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np

from marsedl.methods.funnels.monte_carlo import boundary_deviations, fly, uniform_directions
from marsedl.methods.funnels.recursion import FunnelError, backward, forward
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.papers.funnels import environment
from marsedl.papers.funnels import gains as gains_stage
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, CONDITIONS, SLICE, SPHERES, finite
from marsedl.papers.funnels.records import Certificates, Gains, Linearization
from marsedl.papers.funnels.stage_study import fitted, stage_at

LOWER_ORDERS = {1: 1, 2: BASIS_DEGREE}  # than that of the inputs, each with the degree of the basis that it needs
FACTORS = (0.25, 0.5, 1.0, 2.0)  # of the levels over which a stage is studied
SECOND_SOLVER = "CLARABEL"  # at a few stages; the other solver takes all
FIRST_SOLVER = "SCS"
EXCESS_TOLERANCE = 1e-5  # of programs whose bounds are compared with others that differ by more than a thousandth
RANDOM_STATES = 1000
FLIGHTS, STATES = 21, 22  # streams of random numbers, keyed by that of the design
COMPLEX_STEP = 1e-30


def compute(inputs, linearization: Linearization, gains: Gains) -> Certificates:
    """Compute the funnel in other ways."""
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    design = well_chosen_design(SPHERES, inputs.design_seed, BASIS_DEGREE)
    spacings = {int(spacing) for spacing in (*inputs.studied_spacings, inputs.backward_steps_per_slice)}
    found = {spacing: propagate(inputs, loop, gains, design, spacing) for spacing in sorted(spacings)}
    return Certificates(
        **numbers_of_slices(inputs, loop, gains, design, found),
        **coarse_funnels(inputs, loop, gains, design, found[int(inputs.backward_steps_per_slice)]),
        **undisturbed(inputs, loop, gains),
        **over_levels(inputs, loop, gains, design),
        **changes(inputs, linearization, design),
        **equations(inputs),
    )


def propagate(inputs, loop, gains: Gains, design, spacing, first_level=None, **options):
    """Levels of a funnel, NaN from where it ends, and how it ended.

    Args:
        inputs: program tolerance, Taylor order and largest level.
        loop: closed loop.
        gains: shapes and first level.
        design: samples.
        spacing: fine steps from one slice to the next.
        first_level: instead of that of the gains.
        options: of `forward`.

    Returns:
        (levels of all slices, "complete" or a message).
    """
    steps = environment.slices(inputs, int(spacing))
    levels = np.full(len(steps), np.nan)
    levels[0] = gains.initial_level if first_level is None else first_level

    def note(number, level):
        levels[number - 1] = level

    settings = {"order": int(inputs.taylor_order), "limit": inputs.largest_level, "solver": solver(inputs)}
    try:
        with np.errstate(all="ignore"):  # a funnel that diverges leaves the range of the equations
            forward(loop, gains.shape[steps], steps, levels[0], design, progress=note, **settings | options)
    except FunnelError as error:
        return levels, str(error)
    return levels, COMPLETE


def solver(inputs):
    """Solver of the programs as the funnel takes it."""
    return partial(rank_one, tolerance=inputs.program_tolerance)


# ---- numbers of slices, and the Euler step ---------------------------------------------------------------------------


def numbers_of_slices(inputs, loop, gains: Gains, design, of_motion):
    """Funnels with more and fewer slices; the Euler step at the levels of the motion (robust entry funnels, Eq. 22).

    In a stage the Euler step differs by terms of second order in its length.
    """
    spacings = inputs.studied_spacings.astype(int)
    euler = [propagate(inputs, loop, gains, design, spacing, condition="euler") for spacing in spacings]
    found = [[of_motion[spacing] for spacing in spacings], euler]
    count = max(len(levels) for levels, _ in found[0])
    level = np.array([[_padded(levels, count) for levels, _ in row] for row in found])
    excess = np.array(
        [
            _padded(euler_excess(inputs, loop, gains, design, spacing, levels), count - 1)
            for spacing, (levels, _) in zip(spacings, found[0], strict=True)
        ]
    )
    known = [row[np.isfinite(row)] for row in excess]

    def over_stages(statistic):
        return np.array([statistic(row) if len(row) else np.nan for row in known])

    return {
        "spacing": spacings,
        "condition": np.array(CONDITIONS),
        "level": level,
        "outcome": np.array([[outcome for _, outcome in row] for row in found]),
        "final_level": np.array([[levels[-1] for levels, _ in row] for row in found]),
        "peak_level": np.array([[_peak(levels) for levels, _ in row] for row in found]),
        "excess": excess,
        "unsafe_share": over_stages(lambda row: np.mean(row < 0.0)),
        "least_excess": over_stages(np.min),
        "largest_excess": over_stages(np.max),
        "mean_excess": over_stages(np.mean),
        "mean_difference": over_stages(lambda row: np.mean(np.abs(row))),
    }


def euler_excess(inputs, loop, gains: Gains, design, spacing, levels):
    """Euler bound over that of the motion at the same level, less one, of all stages of a funnel."""
    excess = np.full(len(levels) - 1, np.nan)
    for k in np.flatnonzero(np.isfinite(levels[:-1] + levels[1:])):
        stage = stage_at(inputs, loop, gains, k + 1, levels[k], int(spacing), condition="euler")
        euler = rank_one(stage.values(design.points), design.basis, tolerance=EXCESS_TOLERANCE).safe_bound
        excess[k] = euler * levels[k] / levels[k + 1] - 1.0
    return excess


# ---- coarse slices ---------------------------------------------------------------------------------------------------


def coarse_funnels(inputs, loop, gains: Gains, design, by_samples):
    """Funnels of lower order, by multipliers, backwards and back again."""
    spacing = int(inputs.backward_steps_per_slice)
    steps = environment.slices(inputs, spacing)
    found = {"samples": by_samples}
    for order, degree in LOWER_ORDERS.items():
        fitting = design if degree == BASIS_DEGREE else well_chosen_design(SPHERES, inputs.design_seed, degree)
        found[f"order {order}"] = propagate(inputs, loop, gains, fitting, spacing, order=order)
    levels, states, second = by_multipliers(inputs, loop, gains, spacing)
    found["multipliers"] = levels, _outcome(levels, states)
    back, programs, outcome = backwards(inputs, loop, gains, design, steps)
    found["backward"] = back, outcome
    found["returned"] = (
        propagate(inputs, loop, gains, design, spacing, back[0]) if outcome == COMPLETE else found["backward"]
    )
    returned = found["returned"][0]
    return {
        "coarse_step": steps,
        "variant": np.array(list(found)),
        "variant_level": np.array([levels for levels, _ in found.values()]),
        "variant_outcome": np.array([outcome for _, outcome in found.values()]),
        "multiplier_status": np.array(states),
        "multiplier_difference": float(np.abs(levels / found["samples"][0] - 1.0).max()),
        **second,
        "backward_programs": programs,
        "round_trip": float(np.abs(back / returned - 1.0).max()),
        "round_trip_shortfall": float((returned / back - 1.0).max()),
    }


def by_multipliers(inputs, loop, gains: Gains, spacing):
    """Levels by programs with multipliers (robust entry funnels, Sec. 5), and a second solver at a few stages."""
    program = MultiplierProgram(SPHERES.dimensions, solver=FIRST_SOLVER, tolerance=inputs.program_tolerance)
    other = MultiplierProgram(SPHERES.dimensions, solver=SECOND_SOLVER)
    count = len(environment.slices(inputs, spacing)) - 1
    level, levels, states = gains.initial_level, np.full(count + 1, np.nan), ["not solved"] * count
    # The studied slices are counted among those of the inputs; every other one, as the second solver is slow.
    studied = np.unique((inputs.studied_slices[::2].astype(int) - 1) * int(inputs.steps_per_slice) // spacing)
    difference, second_states = np.full(len(studied), np.nan), ["not solved"] * len(studied)
    levels[0] = level
    for k in range(count):
        coefficients, _ = fitted(inputs, stage_at(inputs, loop, gains, k + 1, level, spacing))
        certificate = program.solve(coefficients)
        states[k] = certificate.status
        for i in np.flatnonzero(studied == k):
            second = other.solve(coefficients)
            difference[i], second_states[i] = second.safe_bound / certificate.safe_bound - 1.0, second.status
        level *= certificate.safe_bound
        if not level <= inputs.largest_level:
            break
        levels[k + 1] = level
    return (
        levels,
        states,
        {
            "second_stage": studied + 1,
            "second_difference": finite(difference),
            "second_status": np.array(second_states),
        },
    )


def backwards(inputs, loop, gains: Gains, design, steps):
    """Levels from the last to the first, programs solved for each, and how it ended."""
    try:
        with np.errstate(all="ignore"):
            found = backward(
                loop,
                gains.shape[steps],
                steps,
                inputs.backward_level,
                design,
                solver=solver(inputs),
                order=int(inputs.taylor_order),
            )
    except FunnelError as error:
        return np.full(len(steps), np.nan), np.zeros(len(steps) - 1, dtype=int), str(error)
    return found.rho, found.programs, COMPLETE


def undisturbed(inputs, loop, gains: Gains):
    """The funnel without disturbance, on the slices of the inputs."""
    still = replace(
        loop,
        rates=lambda half, state, control, _: loop.rates(half, state, control, (0.0,) * environment.DISTURBANCES),
        disturbances=0,
    )
    design = well_chosen_design(SLICE, inputs.design_seed, BASIS_DEGREE)
    levels, outcome = propagate(inputs, still, gains, design, inputs.steps_per_slice)
    return {"undisturbed_level": levels, "undisturbed_outcome": outcome}


def over_levels(inputs, loop, gains: Gains, design):
    """Levels that a stage reaches from several levels: they must not decrease (robust entry funnels, Eq. 25)."""
    slices = inputs.studied_slices.astype(int)
    levels = np.outer(inputs.studied_levels, FACTORS)
    reached = [
        [
            level
            * solver(inputs)(stage_at(inputs, loop, gains, k, level).values(design.points), design.basis).safe_bound
            for level in row
        ]
        for k, row in zip(slices, levels, strict=True)
    ]
    return {"studied_slice": slices, "studied_level": levels, "reached_level": np.array(reached)}


# ---- what makes a funnel diverge -------------------------------------------------------------------------------------


def changes(inputs, linearization: Linearization, design):
    """Cheaper feedback, wider density and larger initial sets, each with a funnel and with flights."""
    cases = [
        *(("scale of the bank angle", f, ("scale_bank",)) for f in inputs.studied_bank_factors),
        *(
            ("disturbance of the density", f, ("density_amplitude", "density_slope_amplitude"))
            for f in inputs.studied_density_factors
        ),
        *(
            ("initial set", f, ("initial_lengths", "initial_velocity", "initial_angles"))
            for f in inputs.studied_initial_factors
        ),
    ]
    rows = [_changed(inputs, linearization, design, factor, names) for _, factor, names in cases]
    first, levels, outcome, flown, lost = (list(column) for column in zip(*rows, strict=True))
    return {
        "change": np.array([name for name, _, _ in cases]),
        "change_factor": np.array([factor for _, factor, _ in cases]),
        "change_initial_level": np.array(first),
        "change_level": np.array(levels),
        "change_outcome": np.array(outcome),
        "change_flown": finite(flown),
        "change_lost": np.array(lost),
    }


def _changed(inputs, linearization, design, factor, names):
    """First level, levels, how the funnel ended, largest V of flights from its first slice, and flights lost."""
    changed = SimpleNamespace(**vars(inputs) | {name: factor * getattr(inputs, name) for name in names})
    gains = gains_stage.compute(changed, linearization)
    loop = environment.closed_loop(changed, linearization, gains.half_gain)
    levels, outcome = propagate(changed, loop, gains, design, inputs.backward_steps_per_slice)
    generator = np.random.Generator(np.random.Philox((inputs.design_seed, FLIGHTS)))
    count = int(inputs.studied_trials)
    start = boundary_deviations(
        gains.shape[0], gains.initial_level, uniform_directions(generator, count, SLICE.variables)
    )
    values = fly(loop, gains.shape, start, uniform_directions(generator, count, environment.DISTURBANCES)).max(axis=0)
    alive = np.isfinite(values)
    flown = values[alive].max() if alive.any() else np.nan
    return gains.initial_level, levels, outcome, flown, int(np.count_nonzero(~alive))


# ---- equations of motion ---------------------------------------------------------------------------------------------


def equations(inputs):
    """Eq. 37 at random states against gravity, lift and drag on inertial position and velocity, by the complex step."""
    generator = np.random.Generator(np.random.Philox((inputs.design_seed, STATES)))
    low = np.array([0.0, -3.0, -1.2, 400.0, -1.2, -3.0, -3.0])
    high = np.array([inputs.entry_altitude, 3.0, 1.2, inputs.entry_velocity, 1.2, 3.0, 3.0])
    *state, bank = generator.uniform(low, high, (RANDOM_STATES, len(low))).T
    rates = np.array(environment.entry_rates(inputs)(None, state, (bank,), (0.0,) * environment.DISTURBANCES))
    moved = np.array(state) + 1j * COMPLEX_STEP * rates
    position, velocity = inertial(inputs, 1j * COMPLEX_STEP, moved)
    expected = acceleration(inputs, position.real, velocity.real, state[0], bank)

    def deviation(found, truth):
        return float((np.linalg.norm(found - truth, axis=0) / np.linalg.norm(truth, axis=0)).max())

    return {
        "position_rate_deviation": deviation(position.imag / COMPLEX_STEP, velocity.real),
        "velocity_rate_deviation": deviation(velocity.imag / COMPLEX_STEP, expected),
    }


def inertial(inputs, time, state):
    """Inertial position and velocity, (3, m) each; planet-fixed and inertial axes agree at time 0."""
    altitude, longitude, latitude, speed, path, heading = state
    radius, angle = inputs.planet_radius + altitude, longitude + inputs.rotation_rate * time
    sin_a, cos_a, sin_l, cos_l = np.sin(angle), np.cos(angle), np.sin(latitude), np.cos(latitude)
    east = np.array([-sin_a, cos_a, 0.0 * sin_a])
    north = np.array([-sin_l * cos_a, -sin_l * sin_a, cos_l])
    up = np.array([cos_l * cos_a, cos_l * sin_a, sin_l])
    relative = speed * (np.cos(path) * (np.cos(heading) * east + np.sin(heading) * north) + np.sin(path) * up)
    return radius * up, relative + inputs.rotation_rate * radius * cos_l * east


def acceleration(inputs, position, velocity, altitude, bank):
    """Inertial acceleration by gravity, drag, and lift turned to the right by the bank angle, (3, m)."""
    spin = np.array([[0.0], [0.0], [inputs.rotation_rate]])
    relative = velocity - np.cross(spin, position, axis=0)
    speed = np.linalg.norm(relative, axis=0)
    forward_axis = relative / speed
    right = np.cross(forward_axis, position, axis=0)
    right /= np.linalg.norm(right, axis=0)
    above = np.cross(right, forward_axis, axis=0)
    drag = np.exp(environment.log_density(inputs, altitude)) * speed**2 / (2.0 * inputs.ballistic_coefficient)
    lift = inputs.lift_to_drag * drag * (np.cos(bank) * above + np.sin(bank) * right)
    gravity = inputs.gravitational_parameter * position / np.linalg.norm(position, axis=0) ** 3
    return lift - drag * forward_axis - gravity


def _padded(values, length):
    return np.concatenate([values, np.full(length - len(values), np.nan)])


def _peak(levels):
    """Largest level of a complete funnel."""
    return levels.max()


def _outcome(levels, states):
    return COMPLETE if np.isfinite(levels).all() else f"the funnel ends: {states[np.isfinite(levels).sum() - 1]}"
