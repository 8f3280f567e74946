"""The funnel of the entry: levels from slice to slice, how far each bound can be trusted, and what lies inside."""

from dataclasses import replace
from functools import partial

import numpy as np

from marsedl.methods.funnels.ascent import maximize
from marsedl.methods.funnels.linear import additive_growth, slice_jacobians
from marsedl.methods.funnels.recursion import FunnelError, StageRule, forward, largest_feedback
from marsedl.methods.funnels.stage import FunnelStage, lyapunov_rate
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.methods.sos.verification import verify
from marsedl.montecarlo.streams import uniforms
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, SLICE, SPHERES, random_points
from marsedl.papers.funnels.environment import Air
from marsedl.papers.funnels.inputs import Inputs, Recursion, Studies, Vehicle
from marsedl.papers.funnels.records import Funnel, Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.records.fields import finite

TIGHTNESS_STAGES = 7  # evenly over the flight; the largest value of a polynomial costs as much as its program
# Streams of random numbers, all keyed by that of the design.
CHECKS, TRUE_MAXIMUM, TIGHTNESS, SLICE_POINTS, RADII = range(1, 6)
ANGLES = 2001  # around the slice, for the heat rate: its maximum is off by less than a millionth
CIRCLE = 72  # points of the slice that are drawn in Fig. 4
MEMORY_FACTOR = 10.0


@stage()
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> Funnel:
    """Propagate the funnel from the initial set to the end, and check every stage of it."""
    recursion = given.recursion
    air = environment.disturbed_air(given.planet, given.uncertainty)
    loop = environment.closed_loop(given.planet, given.vehicle, air, linearization, gains.half_gain)
    design = well_chosen_design(SPHERES, recursion.design_seed, BASIS_DEGREE)
    steps = environment.slices(loop, recursion.steps_per_slice)
    shape = gains.shape[steps]
    amplitudes = environment.additive_amplitudes(given.planet, given.uncertainty)
    library_funnel, outcome = propagate(recursion, loop, gains, design, amplitudes)
    stages = described_stages(library_funnel, len(steps) - 1)
    level = _padded([gains.initial_level] if library_funnel is None else library_funnel.rho, len(steps))
    shape_rate = np.gradient(gains.shape, linearization.time, axis=0)[steps]
    slices = described_slices(given.vehicle, recursion, air, loop, linearization, steps, shape, shape_rate, level)
    plane = fig4(given.studies, air, loop, steps, shape, shape_rate, level)
    return Funnel(
        outcome=outcome,
        step=steps,
        time=linearization.time[steps],
        shape=shape,
        level=level,
        half_width=_padded(np.empty((0, 6)) if library_funnel is None else library_funnel.half_widths, len(steps)),
        log_volume=_padded([] if library_funnel is None else library_funnel.log_volumes, len(steps)),
        literal_level=literal_levels(recursion.raw_units, design, shape, level),
        literal_level_si=literal_levels(np.ones(6), design, shape, level),
        additive_growth=added_growth(loop, shape, steps, amplitudes),
        sound=bool(outcome == COMPLETE and stages["stage_sound"].all()),
        memory=memory(recursion, loop, gains, design),
        samples=design.points,
        **slices,
        **stages,
        **tightness(recursion, loop, design, steps, shape, level, stages["bound"]),
        **plane,
    )


# ---- the recursion ---------------------------------------------------------------------------------------------------


def propagate(recursion: Recursion, loop, gains: Gains, design, amplitudes=None):
    """Levels of all slices (robust entry funnels, Algorithm 1), or of those before the funnel fails.

    Returns:
        Library's `Funnel`, None if not even the first stage is passed, and the outcome, a text.
    """
    steps, reached = environment.slices(loop, recursion.steps_per_slice), [1]

    def until(count, progress=None):
        chosen = steps[:count]
        shape = gains.shape[chosen]
        rule = replace(
            stage_rule(recursion),
            maximum=None if recursion.sampling == "raw" else true_maximum(recursion),
            inflate=recursion.inflated,
            verify=partial(verify, seed=(recursion.design_seed, CHECKS), points=recursion.check_points),
            feedback_limit=recursion.largest_feedback,
        )
        added = added_growth(loop, shape, chosen, amplitudes)
        first, limit = gains.initial_level, recursion.largest_level
        return forward(loop, shape, chosen, first, design, rule, additive=added, limit=limit, progress=progress)

    try:
        return until(len(steps), lambda number, level: reached.append(number)), COMPLETE
    except FunnelError as error:
        return (until(reached[-1]) if reached[-1] > 1 else None), str(error)


def stage_rule(recursion: Recursion):
    """What makes the polynomial of a stage and bounds it."""
    raw_scale = recursion.raw_units if recursion.sampling == "raw" else None
    return StageRule(solver(recursion), recursion.taylor_order, recursion.condition, raw_scale)


def solver(recursion: Recursion):
    """Solver of the programs."""
    return partial(rank_one, tolerance=recursion.program_tolerance)


def true_maximum(recursion: Recursion):
    """The search for the largest value of the integrated motion on a slice, under any disturbance of the unit disc."""
    seed, count = recursion.design_seed, recursion.ascent_starts
    starts = random_points(SPHERES, seed, TRUE_MAXIMUM, count)
    # The area of a disc grows with the square of the radius.
    starts[:, SLICE.variables :] *= np.sqrt(uniforms(seed, RADII, range(count), 1))

    def search(stage, _):
        try:
            return maximize(
                stage.true_values,
                SPHERES.dimensions,
                starts,
                full_ball=(False, True),
                polished=recursion.ascent_polished,
                iterations=recursion.ascent_iterations,
            )[0]
        except ValueError as error:
            raise FunnelError(f"the motion from fine step {stage.first} on is not finite: {error}") from error

    return search


def added_growth(loop, shape, steps, amplitudes):
    """Growth of V by disturbances that are added to the rates, (stages,); zero where a reading has none."""
    if amplitudes is None:
        return np.zeros(len(steps) - 1)
    return additive_growth(slice_jacobians(loop, steps)[2], shape[1:], amplitudes)


def memory(recursion: Recursion, loop, gains: Gains, design):
    """Relative change of the second level when the first is ten times as large; NaN if there is none then."""
    steps = environment.slices(loop, recursion.steps_per_slice)[:2]
    rule = stage_rule(recursion)

    def next_level(level):
        return forward(loop, gains.shape[steps], steps, level, design, rule, limit=np.inf).rho[1]

    try:
        return float(next_level(MEMORY_FACTOR * gains.initial_level) / next_level(gains.initial_level) - 1.0)
    except FunnelError:
        return np.nan


# ---- stages ----------------------------------------------------------------------------------------------------------


def described_stages(library_funnel, count):
    """Fields of all stages; NaN, and not sound, are those that the funnel does not reach."""
    checks, status = [], []
    if library_funnel is not None:
        checks, status = library_funnel.verifications, list(library_funnel.status)

    def of_funnel(name, fill=np.nan):
        return _padded([] if library_funnel is None else getattr(library_funnel, name), count, fill)

    def of_checks(name, fill=np.nan):
        return _padded([getattr(check, name) for check in checks], count, fill)

    bound = of_funnel("polynomial_bound")
    return {
        "bound": bound,
        **{name: of_funnel(name) for name in ("growth", "true_maximum", "violation")},
        **{name: of_funnel(name) / bound for name in ("gap", "residual")},
        "iterations": of_funnel("iterations", 0),
        "status": np.array([*status, *["not solved"] * (count - len(status))]),
        "stage_sound": of_checks("sound", False),
        **{name: of_checks(name) for name in ("identity_error", "least_value", "least_eigenvalue", "rounding_margin")},
    }


def tightness(recursion: Recursion, loop, design, steps, shape, level, bound):
    """How far the polynomials of some stages stay below their bounds.

    The samples of the design determine a polynomial on the slices: there it is evaluated by its coefficients.
    """
    rule = stage_rule(recursion)
    exponents = SPHERES.quotient_monomials(2 * BASIS_DEGREE)
    at_samples = SPHERES.evaluate(exponents, design.points)
    count = len(steps) - 1
    studied = np.unique(np.linspace(0, count - 1, TIGHTNESS_STAGES).round().astype(int))
    below = np.full(len(studied), np.nan)
    for i, k in enumerate(studied):
        if np.isfinite(bound[k]):
            first, last = int(steps[k]), int(steps[k + 1])
            polynomial = rule.order, rule.condition, rule.raw_scale
            stage = FunnelStage(loop, first, last, shape[k], shape[k + 1], level[k], *polynomial)
            coefficients = np.linalg.solve(at_samples, stage.values(design.points))
            largest = largest_polynomial(
                recursion, lambda points, c=coefficients: SPHERES.evaluate(exponents, points) @ c
            )
            below[i] = 1.0 - largest / bound[k]
    return {"tightness": below, "tightness_stage": studied + 1}


def largest_polynomial(recursion: Recursion, polynomial):
    """Largest value found of the polynomial of a stage on slice and boundary of the disturbances."""
    value, _ = maximize(
        polynomial,
        SPHERES.dimensions,
        random_points(SPHERES, recursion.design_seed, TIGHTNESS, recursion.tightness_starts),
        polished=recursion.tightness_polished,
        iterations=recursion.tightness_iterations,
    )
    return value


# ---- slices ----------------------------------------------------------------------------------------------------------


def described_slices(
    vehicle: Vehicle, recursion: Recursion, air: Air, loop, linearization, steps, shape, shape_rate, level
):
    """Feedback, heat rate and rate of V on every slice."""
    points = random_points(SLICE, recursion.design_seed, SLICE_POINTS, recursion.check_points)
    feedback, heat_rate, rising = [], [], []
    for step, matrix, rate, rho in zip(steps, shape, shape_rate, level, strict=True):
        gain = loop.gains[2 * step]
        feedback.append(largest_feedback(gain, matrix, rho)[0])
        heat_rate.append(largest_heat_rate(vehicle, air, linearization.state[2 * step], matrix, rho))
        rates = lyapunov_rates(air, loop, step, matrix, rate, rho, points)
        rising.append([np.nan if np.isnan(values).any() else np.mean(values > 0.0) for values in rates])
    undisturbed, worst = np.transpose(rising)
    return {
        "feedback": np.array(feedback),
        "heat_rate": np.array(heat_rate),
        "rising": worst,
        "rising_undisturbed": undisturbed,
    }


def largest_heat_rate(vehicle: Vehicle, air: Air, state, shape, level):
    """Largest heat rate (W/m^2) in a slice, under any disturbance of the density.

    Of the slice only its shadow on altitude and velocity matters, an ellipse, and as q grows with the velocity its
    largest value is on the outline.
    """
    among = np.ix_([0, 3], [0, 3])
    half_axes = np.linalg.cholesky(np.linalg.inv(shape)[among])
    angle = np.linspace(0.0, 2.0 * np.pi, ANGLES)
    outline = np.sqrt(2.0 * level) * half_axes @ np.array([np.cos(angle), np.sin(angle)])
    altitude, velocity = state[[0, 3], np.newaxis] + outline
    with np.errstate(over="ignore", invalid="ignore"):  # a wide slice leaves the range of the equations: not finite
        worst = environment.densest(air, altitude)
        return finite(environment.heat_rate(vehicle, air, altitude, velocity, worst).max())


def lyapunov_rates(air: Air, loop, step, shape, shape_rate, level, points):
    """Rate of V at whitened points (m, 6) of a slice, without disturbance and under the worst one, (2, m), 1/s.

    The rates are affine in the density and w is in nothing else: V' is monotonic in rho, and the worst w makes the
    density largest or least.
    """
    deviations = points @ (np.sqrt(2.0 * level) * np.linalg.inv(np.linalg.cholesky(shape)))
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # a wide slice leaves the equations' range
        end = environment.densest(air, loop.states[2 * step, 0] + deviations[:, 0]).T
        still, most, least = (
            lyapunov_rate(loop, 2 * step, shape, shape_rate, deviations, w) for w in (np.zeros_like(end), end, -end)
        )
    return np.array([finite(still), finite(np.maximum(most, least))])


def literal_levels(units, design, shape, level):
    """Least and largest V/rho of points with x'x = 2 (robust entry funnels, Eq. 26) on every slice, (slices, 2)."""
    points = np.sqrt(2.0) * design.points[:, : len(units)] * units
    values = np.einsum("mi,kij,mj->km", points, shape, points) / (2.0 * level[:, np.newaxis])
    return np.stack([values.min(axis=1), values.max(axis=1)], axis=1)


def fig4(studies: Studies, air: Air, loop, steps, shape, shape_rate, level):
    """Rate of V in a plane of whitened coordinates through the slice of Fig. 4, on a grid and along the slice."""
    k = studies.fig4_slice - 1
    first, second = (int(number) - 1 for number in studies.fig4_coordinates)
    axis = np.linspace(-studies.fig4_extent, studies.fig4_extent, studies.fig4_points)
    angle = 2.0 * np.pi * np.arange(CIRCLE) / CIRCLE
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def rates(coordinates):
        points = np.zeros((len(coordinates), 6))
        points[:, [first, second]] = coordinates
        return lyapunov_rates(air, loop, steps[k], shape[k], shape_rate[k], level[k], points)

    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    still, worst = rates(grid.reshape(-1, 2)).reshape(2, len(axis), len(axis))
    circle_still, circle_worst = rates(circle)
    return {
        "fig4_coordinate": axis,
        "fig4_rate": still,
        "fig4_worst_rate": worst,
        "fig4_circle": circle,
        "fig4_circle_rate": circle_still,
        "fig4_circle_worst_rate": circle_worst,
    }


def _padded(values, length, fill=np.nan):
    """Values with as many more at the end as are missing."""
    values = np.asarray(values)
    missing = np.full((length - len(values), *values.shape[1:]), fill)
    return np.concatenate([values.astype(missing.dtype), missing])
