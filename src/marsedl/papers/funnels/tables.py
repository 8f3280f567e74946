"""What the paper withholds, the levels and their checks, the studies beside them, and what each reading gives."""

import numpy as np

from marsedl.papers.funnels.basics import COMPLETE, DEGREE, KILOMETRE, LEVEL, STATES_IN_KILOMETRES, WATT_PER_CM2
from marsedl.papers.funnels.claims import flown_levels, largest, over_flown, peaks
from marsedl.papers.funnels.inputs import Car, FunnelsInputs, Guidance, Mission, Planet, Recursion, Uncertainty, Vehicle
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    Divergence,
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    Gains,
    LinearBounds,
    Optima,
    Proven,
    StageStudy,
)

NO_VALUE = "–"
PAPER = "in the paper"
TIMES = 13  # at which levels are tabulated
# Inputs in which readings may differ that say how much is computed, not what.
_SIZES = (
    *("trials", "redrawn_trials", "adversarial_trials", "dubins_trials", "dubins_wind_trials", "drawn_trials"),
    *("check_points", "ascent_starts", "ascent_polished", "tightness_starts", "tightness_polished", "fig4_points"),
)
NOT_PRINTED = "not printed"
OTHER_PAPER = "not printed; from another paper on the same entry"


def _number(value, form):
    """A number, a dash where there is none; none has more digits than can be read."""
    if value is None or not np.isfinite(value):
        return NO_VALUE
    if form.endswith("f") and abs(value) >= 1e7:
        return f"{value:.3g}"
    return f"{value:{form.replace('.', 'z.', 1) if form.endswith('f') else form}}"


def _list(values, form):
    return ", ".join(_number(value, form) for value in np.atleast_1d(values))


def _yes(value):
    return "yes" if value else "no"


def _ground(radius, widths):
    """Half widths of the six states in km, km, km, m/s, deg and deg."""
    units = np.array([1.0 / KILOMETRE, radius / KILOMETRE, radius / KILOMETRE, 1.0, 1.0 / DEGREE, 1.0 / DEGREE])
    return widths * units


# ---- inputs ----------------------------------------------------------------------------------------------------------


def withheld(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    car: Car,
):
    """What the paper needs and does not print: what is used here, and where it is from."""

    def lengths(values):
        return _list(np.asarray(values) / KILOMETRE, "g")

    def degrees(values):
        return _list(np.asarray(values) / DEGREE, "g")

    scale_height = -1.0 / planet.log_density_slope / KILOMETRE
    initial = (
        lengths(uncertainty.initial_lengths),
        f"{uncertainty.initial_velocity:g}",
        degrees(uncertainty.initial_angles),
    )
    scales = (lengths(guidance.scale_lengths), f"{guidance.scale_velocity:g}", degrees(guidance.scale_angles))
    entry = [mission.entry_flight_path_angle, mission.entry_heading]
    times = [guidance.state_cost_time, guidance.control_cost_time]
    slices = guidance.fine_steps // recursion.steps_per_slice + 1
    return [
        ("input", "here", "unit", "source"),
        ("ballistic coefficient", f"{vehicle.ballistic_coefficient:g}", "kg/m^2", OTHER_PAPER),
        ("lift over drag", f"{vehicle.lift_to_drag:g}", "1", OTHER_PAPER),
        (
            "density at altitude zero",
            f"{np.exp(planet.log_density_at_surface):.6g}",
            "kg/m^3",
            "line through one",
        ),
        ("its scale height", f"{scale_height:.6g}", "km", "line through one"),
        ("nose radius", f"{vehicle.nose_radius:g}", "m", NOT_PRINTED),
        ("altitude at entry", f"{mission.entry_altitude / KILOMETRE:g}", "km", OTHER_PAPER),
        ("velocity at entry", f"{mission.entry_velocity:g}", "m/s", OTHER_PAPER),
        ("flight path angle, heading at entry", degrees(entry), "deg", OTHER_PAPER),
        ("downrange", f"{mission.final_downrange / KILOMETRE:g}", "km", NOT_PRINTED),
        ("final velocity, between", _list(mission.final_velocity_bounds, "g"), "m/s", NOT_PRINTED),
        ("bank angle, between", degrees(mission.bank_bounds), "deg", NOT_PRINTED),
        ("cost of the nominal", "integral of the squared bank rate", "", NOT_PRINTED),
        ("limit of the heat rate", f"{mission.heat_rate_limit / WATT_PER_CM2:g}", "W/cm^2", NOT_PRINTED),
        ("weights of the regulator: equal deviations", "; ".join(scales), "km, m/s, deg", NOT_PRINTED),
        ("bank angle that costs as much", degrees(guidance.scale_bank), "deg", NOT_PRINTED),
        ("times of running costs of state and bank angle", _list(times, "g"), "s", NOT_PRINTED),
        ("weight at the end", f"{guidance.terminal_weight:g}", "1", NOT_PRINTED),
        ("number of slices", f"{slices}", "1", NOT_PRINTED),
        ("initial set: semi-axes", "; ".join(initial), "km, m/s, deg", NOT_PRINTED),
        (
            "disturbance of ln density at altitude zero",
            f"{uncertainty.density_amplitude:g}",
            "1",
            "not printed; MarsGRAM",
        ),
        (
            "disturbance of its slope",
            f"{uncertainty.density_slope_amplitude * KILOMETRE:g}",
            "1/km",
            "not printed; MarsGRAM",
        ),
        (
            "disturbances added to the rates, where there are any",
            f"{_list(uncertainty.additive_velocities, 'g')}; {uncertainty.additive_acceleration:g}; "
            f"{_list(uncertainty.additive_turn_rates, 'g')}",
            "m/s, m/s^2, rad/s",
            NOT_PRINTED,
        ),
        ("order of the expansion", f"{recursion.taylor_order}", "1", "what 45 rows represent"),
        ("laws of start and disturbance of the flights", "uniform on their boundaries", "", NOT_PRINTED),
        ("goal: half widths downrange and crossrange", lengths(mission.goal_lengths), "km", "not defined"),
        ("Dubins car: speed", f"{car.dubins_speed:g}", "m/s", NOT_PRINTED),
        ("Dubins car: largest turn rate", f"{car.dubins_turn_rate:g}", "rad/s", NOT_PRINTED),
        ("Dubins car: first level", f"{car.dubins_level:g}", "1", NOT_PRINTED),
        ("Dubins car: wind", f"{car.dubins_wind:g}", "m/s", NOT_PRINTED),
    ]


def optima(optima: Optima):
    """Local optima of the nominal problem, by mesh and cost."""
    rows = [
        (
            "intervals",
            "integral of the squared bank rate (deg^2/s)",
            "final time (s)",
            "final velocity (m/s)",
            "largest heat rate between the nodes (W/cm^2)",
            "its time (intervals from the start)",
            "starts that lead there",
        )
    ]
    for number, intervals in enumerate(optima.intervals):
        rows.append(
            (
                f"{intervals}",
                _number(optima.cost[number] / DEGREE**2, ".4f"),
                _number(optima.final_time[number], ".3f"),
                _number(optima.final_velocity[number], ".2f"),
                _number(optima.peak_heat_rate[number] / WATT_PER_CM2, ".4f"),
                _number(optima.peak_position[number], ".3f"),
                f"{optima.starts[number]} of {len(optima.start_bank)}",
            )
        )
    return rows


# ---- the funnel ------------------------------------------------------------------------------------------------------


def levels(
    funnel: Funnel,
    linear_bounds: LinearBounds,
    constant: FlightEnsemble,
    redrawn: FlightEnsemble,
    adversarial: FlightEnsemble,
):
    """Level of the funnel at equally spaced slices, beside that of linear dynamics and of flights."""
    head = (
        *("k", "time (s)", "rho", "logarithm of the volume (m^2 rad^4/s)"),
        *("linear dynamics, exact", "linear dynamics, triangle inequality"),
        f"largest V of {len(constant.outcome):,} flights, constant disturbance",
        "its standard deviation, from ten parts",
        f"of {len(redrawn.outcome):,}, redrawn",
        f"of {len(adversarial.outcome):,}, adversarial",
        "rho over that of constant disturbance",
    )
    ratio = np.concatenate([[1.0], over_flown(funnel, constant)])
    parts = constant.repeat_maximum[:, funnel.step, LEVEL]
    # The maximum of all varies as that of a tenth does, at most.
    spread = parts.std(axis=0, ddof=1)
    shown = np.unique(np.linspace(0, len(funnel.time) - 1, TIMES).round().astype(int))
    return [
        head,
        *(
            (
                f"{k + 1}",
                _number(funnel.time[k], ".2f"),
                *(_number(v[k], ".5g") for v in (funnel.level, funnel.log_volume)),
                *(_number(v[k], ".5g") for v in (linear_bounds.exact_level, linear_bounds.triangle_level)),
                _number(flown_levels(funnel, constant)[k], ".5g"),
                _number(spread[k], ".2g"),
                *(_number(flown_levels(funnel, law)[k], ".5g") for law in (redrawn, adversarial)),
                _number(ratio[k], ".4g"),
            )
            for k in shown
        ),
    ]


def half_widths(planet: Planet, funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble):
    """Largest deviations of the states at the first slice, at that of the largest level, and at the last."""
    names = ("altitude (km)", "downrange (km)", "crossrange (km)", "velocity (m/s)")
    rows = [("slice", "of", *names, "flight path angle (deg)", "heading (deg)", "bank angle of the feedback (deg)")]
    top = int(np.argmax(np.where(np.isfinite(funnel.level), funnel.level, -np.inf)))
    flown = np.abs(constant.final_state[:, : funnel.half_width.shape[1]])
    for name, k in (("first", 0), ("of the largest rho", top), ("last", len(funnel.level) - 1)):
        at = f"{name}, {funnel.time[k]:.1f} s"
        sets = [
            ("funnel", funnel.half_width[k], funnel.feedback[k]),
            ("linear dynamics, same shape", linear_bounds.exact_half_width[k], None),
            ("ellipsoid of least trace, linear", linear_bounds.reachable_half_width[funnel.step[k]], None),
        ]
        if k == len(funnel.level) - 1:
            sets.append((f"{len(flown):,} flights", [largest(column) for column in flown.T], None))
        for what, widths, feedback in sets:
            cells = [_number(value, ".4g") for value in _ground(planet.planet_radius, np.asarray(widths))]
            bank = "" if feedback is None else _number(feedback / DEGREE, ".4g")
            rows.append((at, what, *cells, bank))
    return rows


def verification(funnel: Funnel):
    """Every stage: its program, the checks of its certificate, and what the motion itself does."""
    rows = [
        (
            *("k", "rho", "bound over rho", "factor taken", "by additive disturbances (rho)"),
            *("duality gap", "violation of the equations", "iterations", "solver"),
            *("error of the sum of squares", "least distance to the bound", "least eigenvalue", "rounding of it"),
            *("sound", "largest of the motion over rho", "beyond the bound (%)", "polynomial below its bound"),
        )
    ]
    tight = dict(zip(funnel.tightness_stage, funnel.tightness, strict=True))
    for k, bound in enumerate(funnel.bound):
        rows.append(
            (
                f"{k + 1}",
                _number(funnel.level[k], ".6g"),
                _number(bound, ".7f"),
                _number(funnel.growth[k], ".7f"),
                _number(funnel.additive_growth[k], ".3g"),
                _number(funnel.gap[k], ".1e"),
                _number(funnel.residual[k], ".1e"),
                f"{funnel.iterations[k]}",
                str(funnel.status[k]),
                _number(funnel.identity_error[k], ".1e"),
                _number(funnel.least_value[k], ".2e"),
                _number(funnel.least_eigenvalue[k], ".1e"),
                _number(funnel.rounding_margin[k], ".1e"),
                _yes(funnel.stage_sound[k]),
                _number(funnel.true_maximum[k], ".7f"),
                _number(100.0 * funnel.violation[k], "+.4f"),
                _number(tight.get(k + 1), ".1e") if k + 1 in tight else "",
            )
        )
    return rows


def conditions(gains: Gains):
    """Regulator and shape at a few times."""
    rows = [
        (
            "time (s)",
            "diagonal of the cost-to-go (km, s and rad)",
            "condition number of the shape (km, s and rad)",
            "in scales of the regulator",
        )
    ]
    last = len(gains.time) - 1
    for k in (0, last // 2, last):
        rows.append(
            (
                _number(gains.time[k], ".2f"),
                _list(np.diag(gains.value_matrix[k]) * STATES_IN_KILOMETRES**2, ".5g"),
                _number(gains.condition[k], ".3g"),
                _number(gains.scaled_condition[k], ".4g"),
            )
        )
    return rows


# ---- studies ---------------------------------------------------------------------------------------------------------


def forms(stage_study: StageStudy):
    """The benchmark stage in all forms of its program."""
    study, reference = stage_study, stage_study.form_bound[0]
    rows = [
        (
            *("form and solver", "bound over rho", "less that of the first, relative"),
            *("safe bound", "duality gap", "violation of the equations", "iterations", "ended"),
        )
    ]
    for number, name in enumerate(study.form):
        rows.append(
            (
                str(name),
                _number(study.form_bound[number], ".8f"),
                _number(study.form_bound[number] / reference - 1.0, "+.1e"),
                _number(study.form_safe_bound[number], ".8f"),
                _number(study.form_gap[number], ".1e"),
                _number(study.form_residual[number], ".1e"),
                f"{study.form_iterations[number]}",
                str(study.form_status[number]),
            )
        )
    for name, value in (
        ("largest value found of the polynomial, boundaries", study.polynomial_maximum),
        ("the same, disturbances inside as well", study.disc_maximum),
        ("of the motion itself", study.true_maximum),
    ):
        rows.append((name, _number(value, ".8f"), _number(value / reference - 1.0, "+.1e"), *[""] * 5))
    return rows


def counts(stage_study: StageStudy):
    """Monomials, rows of the Gram matrix and samples, by formula and by rank."""
    study = stage_study
    rows = [
        (
            *("spheres", "variables", "monomials up to degree 2", "independent", "rank at samples"),
            *("monomials up to degree 4", "entries of the Gram matrix", "least number of samples", "rank of products"),
        )
    ]

    def rank(value):
        return f"{value}" if value else "not computed"

    for k, name in enumerate(study.variety):
        rows.append(
            (
                str(name),
                *(f"{values[k]}" for values in (study.variables, study.monomials, study.basis_size)),
                rank(study.basis_rank[k]),
                *(f"{values[k]}" for values in (study.coefficients, study.gram_unknowns, study.samples)),
                rank(study.product_rank[k]),
            )
        )
    return rows


def samples_and_bases(stage_study: StageStudy):
    """Bounds of the benchmark stage by too few samples, exponents, bases and designs."""
    study = stage_study
    rows = [("what", "which", "bound over rho", "rank or condition number", "least distance to fresh points")]
    for count, bound, rank, least in zip(
        study.few_samples, study.few_bound, study.few_rank, study.few_least_value, strict=True
    ):
        rows.append(("random samples", f"{count}", _number(bound, ".6f"), f"{rank}", _number(least, "+.1e")))
    for k, exponent in enumerate(study.exponent):
        whitened, raw = study.exponent_whitened_bound[k], study.exponent_bound[k]
        rows.append(("factor (y'y)^d", f"d = {exponent}", _number(whitened, ".6f"), "", ""))
        rows.append(("factor (x'x)^d, by the samples taken", f"d = {exponent}", _list(raw, ".4g"), "", ""))
    for name, condition in zip(study.basis, study.basis_condition, strict=True):
        rows.append(("basis", str(name), "", _number(condition, ".4g"), ""))
    for name, condition, bound in zip(study.design, study.design_condition, study.design_bound, strict=True):
        rows.append(("samples", str(name), _number(bound, ".8f"), _number(condition, ".4g"), ""))
    for name, bound in zip(study.invariance, study.invariance_bound, strict=True):
        rows.append(("change", str(name), _number(bound, ".8f"), "", ""))
    return rows


def numbers_of_slices(discretization: Discretization):
    """Funnels with fewer and more slices by both conditions, and what the Euler step leaves out."""
    found = discretization
    rows = [
        (
            *("fine steps between slices", "condition", "largest rho", "last rho", "outcome"),
            *("stages where the Euler step is too small (%)", "by at most (%)", "too large by at most (%)"),
            *("mean (%)", "mean magnitude (%)"),
        )
    ]
    for k, spacing in enumerate(found.spacing):
        for c, condition in enumerate(found.condition):
            compared = [""] * 5
            if condition == "euler":
                compared = [
                    _number(100.0 * found.unsafe_share[k], ".1f"),
                    _number(-100.0 * found.least_excess[k], ".3f"),
                    _number(100.0 * found.largest_excess[k], ".3f"),
                    _number(100.0 * found.mean_excess[k], "+.3f"),
                    _number(100.0 * found.mean_difference[k], ".3f"),
                ]
            rows.append(
                (
                    f"{spacing}",
                    str(condition),
                    _number(found.peak_level[c, k], ".5g"),
                    _number(found.final_level[c, k], ".5g"),
                    str(found.outcome[c, k]),
                    *compared,
                )
            )
    return rows


def variants(coarse_funnels: CoarseFunnels):
    """Funnels with coarse slices by other programs, orders and directions."""
    found = coarse_funnels
    shown = np.unique(np.linspace(0, found.variant_level.shape[1] - 1, 7).round().astype(int))
    rows = [("funnel", *(f"rho at fine step {found.coarse_step[k]}" for k in shown), "outcome")]
    for name, values, outcome in zip(found.variant, found.variant_level, found.variant_outcome, strict=True):
        rows.append((str(name), *(_number(values[k], ".6g") for k in shown), str(outcome)))
    return rows


def divergence(divergence: Divergence):
    """Whether funnels still exist with other weights, disturbances and initial sets, and where flights stay."""
    found = divergence
    rows = [
        (
            *("changed", "factor", "first rho", "largest rho", "last rho", "outcome"),
            *("largest V of flights", "flights lost"),
        )
    ]
    for k, name in enumerate(found.change):
        rows.append(
            (
                str(name),
                f"{found.change_factor[k]:g}",
                _number(found.change_initial_level[k], ".4g"),
                _number(largest(found.change_level[k]), ".4g"),
                _number(found.change_level[k, -1], ".4g"),
                str(found.change_outcome[k]),
                _number(found.change_flown[k], ".4g"),
                f"{found.change_lost[k]}",
            )
        )
    return rows


def proof(funnel: Funnel, proven: Proven):
    """Proven levels beside those by samples, and what their bounds consist of."""
    rows = [
        (
            *("k", "time (s)", "proven rho", "over that by samples", "proven bound over rho", "of its polynomial"),
            *("known terms of higher degree", "remainder", "inside of the slice"),
        )
    ]
    shown = np.unique(np.linspace(0, len(proven.step) - 1, TIMES).round().astype(int))
    for k in shown:
        parts = [""] * 5
        if k < len(proven.bound):
            parts = [_number(values[k], ".7f") for values in (proven.bound, proven.polynomial_bound)]
            parts += [_number(values[k], ".2e") for values in (proven.truncation, proven.remainder, proven.rise)]
        rows.append(
            (
                f"{k + 1}",
                _number(proven.time[k], ".2f"),
                _number(proven.level[k], ".6g"),
                _number(proven.level[k] / funnel.level[k], ".5f"),
                *parts,
            )
        )
    return rows


def dubins_levels(
    dubins: Dubins,
    dubins_study: DubinsStudy,
    dubins_calm: FlightEnsemble,
    dubins_wind: FlightEnsemble,
):
    """Levels of the Dubins car at the quarters of its path by all solvers."""
    last = dubins.level.shape[1] - 1
    shown = np.unique(np.linspace(0, last, 5).round().astype(int))
    rows = [("funnel", "by", *(f"rho at {dubins.slice_time[k]:g} s" for k in shown), "largest difference (relative)")]

    def row(funnel, by, values, difference=""):
        rows.append((funnel, by, *(_number(values[k], ".5f") for k in shown), difference))

    study = dubins_study
    runs = {"flow": dubins_calm, "wind": dubins_wind}
    proven = dict(zip(study.proven_funnel, study.proven_level, strict=True))
    for number, name in enumerate(dubins.funnel):
        row(str(name), "samples", dubins.level[number])
        difference = _number(study.multiplier_difference[number], ".1e")
        row(str(name), "multipliers", study.multiplier_level[number], difference)
        row(str(name), "linear dynamics, exact", study.linear_level[number])
        if name in runs:
            flown = runs[name].maximum_over_trials[dubins.slice_step, LEVEL]
            row(str(name), f"{len(runs[name].outcome):,} runs", flown)
        if name in proven:
            row(str(name), "proven", proven[name])
    row(str(dubins.funnel[0]), "samples, backwards", study.backward_level, _number(study.round_trip, ".1e"))
    return rows


# ---- over all readings -----------------------------------------------------------------------------------------------


def readings(readings, published):
    """What each reading gives; readings: inputs and `Records` by reading."""
    rows = [
        (
            *("reading", "inputs that differ from corrected (SI)", "first rho", "largest rho", "at (s)", "last rho"),
            *("local maxima of rho (s)", "last downrange and crossrange half width (km)"),
            *("rho over the largest V of flights: median", "most"),
            *("flights outside, of all kinds", "flights"),
            *("stages beyond whose bound motion was found, additive disturbances apart", "by at most (%)"),
            *("largest heat rate in it (W/cm^2)", "largest feedback (deg)"),
            *("certificates sound", "samples on the slices", "outcome"),
        )
    ]
    default = readings["corrected"][0]
    for name, (inputs, records) in readings.items():
        funnel, constant = records.funnel, records.constant
        laws = (constant, records.redrawn, records.adversarial)
        ratio = over_flown(funnel, constant)
        top = int(np.argmax(np.where(np.isfinite(funnel.level), funnel.level, -np.inf)))
        exceeded = np.count_nonzero(funnel.true_maximum > funnel.growth)
        sought = np.isfinite(funnel.true_maximum).any()
        outside = sum(law.outside_at_slices + law.outside_between for law in laws)
        found = peaks(funnel.level)
        rows.append(
            (
                name,
                _differences(inputs, default),
                *(_number(value, ".5g") for value in (funnel.level[0], funnel.level[top])),
                _number(funnel.time[top], ".0f"),
                _number(funnel.level[-1], ".5g"),
                _list(funnel.time[found], ".0f") if found.size else "none",
                _list(_ground(inputs.planet.planet_radius, funnel.half_width[-1])[1:3], ".4g"),
                *(_number(value, ".3g") for value in (np.median(ratio), np.max(ratio))),
                f"{outside}",
                f"{sum(len(law.outcome) for law in laws):,}",
                f"{exceeded} of {len(funnel.bound)}" if sought else NO_VALUE,
                _number(100.0 * largest(funnel.violation), ".3f"),
                _number(largest(funnel.heat_rate) / WATT_PER_CM2, ".4g"),
                _number(largest(funnel.feedback) / DEGREE, ".4g"),
                _yes(funnel.stage_sound.all()),
                _yes(inputs.recursion.sampling == "whitened"),
                "complete" if funnel.outcome == COMPLETE else funnel.outcome,
            )
        )
    return rows


def _differences(inputs: FunnelsInputs, default: FunnelsInputs):
    """Inputs that differ from the default reading's, with their values where these are short."""
    told = []
    for name, key in sorted((key.partition(".")[2], key) for key in inputs.names()):
        value = inputs.get(key)
        if name in _SIZES or np.array_equal(value, default.get(key)):
            continue
        short = not isinstance(value, np.ndarray)
        text = "any" if value is None else value if isinstance(value, str) else f"{value:.6g}" if short else ""
        told.append(f"{name} {text}".strip())
    return ", ".join(told)
