"""Evaluation of every printed claim from the artifacts of one reading, and what is known about those that fail."""

from dataclasses import dataclass
from math import comb

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, HEAT_RATE, KILOMETRE, LEVEL, SPHERES, WATT_PER_CM2
from marsedl.papers.funnels.inputs import FunnelsInputs
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    Dubins,
    DubinsStudy,
    EquationsOfMotion,
    FlightEnsemble,
    Funnel,
    Gains,
    LinearBounds,
    Linearization,
    Monotonicity,
    Nominal,
    Optima,
    Proven,
    StageStudy,
)
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.claims import Declaration, Evaluation

STANDARD_GRAVITY = 9.80665  # m/s^2
MINUTE = 60.0
COMPLEX_STEP = 1e-30

# What the tests of statements call so. Fixed from the words before the first evaluation here; the levels of the funnel
# and of the flights were known in outline.
ROUNDING = 1e-6  # relative; closer than this is equal
SAME_OPTIMUM = 1e-5  # relative difference between bounds of one program by different solvers and forms
SMALL = 0.01  # relative: what an expansion, or a limit that is imposed at nodes, may leave out
WELL_CONDITIONED = 100.0  # condition number: two of sixteen digits
BEGINNING = 0.5  # share of the flight: "at the beginning" is before its middle
END = 0.1  # share of the flight: "near the end"
HIGH = 0.5  # share of the largest deceleration: "high velocity changes"
TIGHT = 1.5  # largest rho over that of the worst flight: widths within 22 % of it
PROHIBITIVE = 3600.0  # s: sixty times what the paper needs by samples
ROUND_TRIP = 1e-3  # relative; backwards and forwards again
FAR_LESS = 0.2  # of a cost: "drastically", "far less" is a fifth of it

STUDIED = (
    *("worst_disturbance_location", "stationary_w_by_newton", "w_gradient_formula"),
    *("stage_condition_bounds_step", "entry_equations", "backward_funnel"),
)


@dataclass(frozen=True)
class Records(Artifacts):
    """What the claims are measured from."""

    nominal: Nominal
    linearization: Linearization
    gains: Gains
    funnel: Funnel
    constant: FlightEnsemble
    redrawn: FlightEnsemble
    adversarial: FlightEnsemble
    optima: Optima | None = None
    linear_bounds: LinearBounds | None = None
    stage_study: StageStudy | None = None
    discretization: Discretization | None = None
    coarse_funnels: CoarseFunnels | None = None
    monotonicity: Monotonicity | None = None
    equations_of_motion: EquationsOfMotion | None = None
    proven: Proven | None = None
    dubins: Dubins | None = None
    dubins_study: DubinsStudy | None = None
    dubins_calm: FlightEnsemble | None = None
    dubins_wind: FlightEnsemble | None = None


def evaluate(
    inputs: FunnelsInputs, records: Records, measured: dict[str, float] | None = None
) -> dict[str, Evaluation | None]:
    """Evaluate every claim in one reading.

    Claims that rest on a study which is not done for the reading are None. What a funnel that ends early has not, is
    not a number, and meets no statement. measured: run times and their ratios, by what they are of.
    """
    linearization, gains, funnel, constant = records.linearization, records.gains, records.funnel, records.constant
    study, coarse_funnels, discretization = records.stage_study, records.coarse_funnels, records.discretization
    laws = {"constant": constant, "redrawn": records.redrawn, "adversarial": records.adversarial}
    return {
        **_stated_inputs(inputs, linearization),
        **_program_claims(inputs, funnel, records.dubins, study, coarse_funnels, records.monotonicity),
        **_set_claims(inputs, gains, funnel),
        **_stage_claims(inputs, study, discretization, coarse_funnels, records.equations_of_motion),
        **_flight_claims(funnel, laws, records.proven),
        **_course_claims(linearization, funnel, constant),
        **_guarantee_claims(inputs, linearization, gains, funnel, records.proven),
        **_heating_claims(inputs, records.nominal, records.optima, funnel, constant),
        "dubins_funnel": records.dubins
        and _dubins_claim(records.dubins, records.dubins_study, records.dubins_calm, records.dubins_wind),
        "four_funnel_solvers": coarse_funnels
        and _four_solvers_claim(
            funnel, records.linear_bounds.exact_level, flown_levels(funnel, constant), coarse_funnels
        ),
        **_cost_claims(measured or {}),
    }


# ---- shared measures -------------------------------------------------------------------------------------------------


def flown_levels(funnel, ensemble):
    """Largest V of the flights of an ensemble at the slices, (slices,)."""
    return ensemble.maximum_over_trials[funnel.step, LEVEL]


def over_flown(funnel, ensemble):
    """Level of the funnel over the largest V of the flights at the slices after the first, (slices - 1,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return funnel.level[1:] / flown_levels(funnel, ensemble)[1:]


def sampled_levels(inputs: FunnelsInputs, funnel):
    """V/rho of the points at which the programs of a reading are matched, (slices, samples)."""
    points = funnel.samples[:, : funnel.shape.shape[1]]
    if inputs.recursion.sampling == "raw":
        deviations = np.sqrt(2.0) * np.broadcast_to(
            points * inputs.recursion.raw_units, (len(funnel.level), *points.shape)
        )
    else:
        factor = np.linalg.cholesky(funnel.shape)
        radius = np.sqrt(2.0 * funnel.level)[:, np.newaxis, np.newaxis]
        deviations = radius * (points @ np.linalg.inv(factor))
    values = np.einsum("kmi,kij,kmj->km", deviations, funnel.shape, deviations)
    return values / (2.0 * funnel.level[:, np.newaxis])


def largest(values, default=np.nan):
    """Largest of the numbers among some values."""
    values = np.asarray(values)
    return float(np.max(values, initial=-np.inf, where=np.isfinite(values))) if np.isfinite(values).any() else default


def peaks(values):
    """Numbers of the slices at which a sequence has an inner local maximum."""
    inner = values[1:-1]
    return np.flatnonzero((inner > values[:-2]) & (inner > values[2:])) + 1


def _listed(values, form=".4g"):
    return ", ".join(f"{value:{form}}" if np.isfinite(value) else "none" for value in np.atleast_1d(values))


def _unfinished(funnel):
    return "" if funnel.outcome == COMPLETE else f"; the funnel is not complete: {funnel.outcome}"


# ---- stated inputs ---------------------------------------------------------------------------------------------------


def _stated_inputs(inputs: FunnelsInputs, linearization):
    states = linearization.state.shape[1]
    values = {
        "mc_trajectories": inputs.ensemble.trials,
        "exponent_d": inputs.recursion.exponent_d,
        "state_dimension": states,
        "model_degrees_of_freedom": states // 2,
        "stop_altitude": inputs.mission.final_altitude / KILOMETRE,
        "fig4_step": inputs.studies.fig4_slice,
    }
    return {name: Evaluation(value) for name, value in values.items()}


# ---- sums of squares and samples (Secs. 2 and 3) ---------------------------------------------------------------------


def _program_claims(inputs: FunnelsInputs, funnel, dubins, study, coarse_funnels, monotonicity):
    variables, degree = SPHERES.variables, BASIS_DEGREE
    rows, independent = len(SPHERES.monomials(degree)), SPHERES.basis_dimension(degree)
    states = SPHERES.dimensions[0]
    with_additive = comb(variables + states + degree, degree)
    # Half the degree of (x'x)^d D, if D has the degree of an expansion of some order times one more deviation.
    order = inputs.recursion.taylor_order
    needed = -(-(2 + order + 1) // 2)
    with_exponent = comb(variables + needed, needed)
    counted = SPHERES.sample_count(degree)
    used = len(funnel.samples)
    car = ""
    if dubins:
        car = (
            f"; for the Dubins car {_listed(dubins.samples[[0, -1]])} without and with wind, of rank "
            f"{_listed(dubins.rank[[0, -1]])}"
        )
    violation = largest(funnel.violation)
    return {
        "gram_size": Evaluation(
            rows,
            evidence=f"monomials up to degree {degree} in {variables} variables, of the state and two parameters of "
            f"the density; {independent} of them are independent where the samples are",
            numbers={"independent": independent},
        ),
        "gram_dimension_eq2": Evaluation(
            rows == degree,
            evidence=f"in {variables} variables a polynomial of degree {2 * degree} has {rows} monomials of half its "
            f"degree, {degree}",
            numbers={"rows": rows, "degree": degree},
        ),
        "gram_45_follows_from_d1": Evaluation(
            with_exponent == rows and with_additive == rows,
            evidence=f"with d = 1 an expansion of order {order} asks for degree {2 * needed}, and "
            f"{with_exponent} rows; with six additive disturbances {variables + states} variables make {with_additive}",
            numbers={"with_exponent": with_exponent, "with_additive": with_additive},
        ),
        "taylor_for_nonpolynomial": Evaluation(
            bool(violation < SMALL),
            evidence=f"the largest value found of the integrated motion is up to {100 * violation:.3g} % above the "
            f"bound of the polynomial of order {order}; small is {100 * SMALL:g} %",
            numbers={"violation": 100.0 * violation, "stages": int((funnel.violation > 0.0).sum())},
        ),
        "minimum_samples_computable": Evaluation(
            bool(used == counted and (dubins is None or (dubins.samples == dubins.rank).all())),
            evidence=f"{used} samples are used for the entry and {counted} is the dimension of the polynomials of "
            f"degree {2 * degree} on slice and disturbance{car}",
            numbers={"used": used, **_undersampled(study)},
        ),
        "sampling_equivalence": study and coarse_funnels and _equivalence_claim(study, coarse_funnels),
        "hermite_conditioning": study and _conditioning_claim(study),
        "greedy_needed": Evaluation(
            bool(abs(funnel.memory) > ROUNDING),
            evidence=f"with the first level ten times as large the second one changes by {100 * funnel.memory:.4g} %: "
            "the points of a stage depend on the level before it",
            numbers={"twice": _least_increase(monotonicity)},
        ),
    }


def _undersampled(study):
    """The bound from the most of the samples that were too few, and how many these were."""
    if study is None:
        return {"few": np.nan, "few_bound": np.nan, "enough_bound": np.nan}
    short = study.few_rank < study.samples[list(study.variables).index(SPHERES.variables)]
    return {
        "few": int(study.few_samples[short].max(initial=0)),
        "few_bound": largest(study.few_bound[short]),
        "enough_bound": float(study.form_bound[0]),
    }


def _equivalence_claim(study, coarse_funnels):
    """Bounds of the benchmark stage in all forms, and of a whole funnel in two."""
    apart = largest(np.abs(study.form_bound / study.form_bound[0] - 1.0), np.inf)
    whole = coarse_funnels.multiplier_difference
    return Evaluation(
        bool(apart < SAME_OPTIMUM and whole < SAME_OPTIMUM and np.isfinite(study.form_bound).all()),
        evidence=f"bounds of one stage by samples and by multipliers, from {len(study.form)} programs, differ by "
        f"{apart:.1g} of them, levels of a whole funnel by {whole:.1g}",
        numbers={"apart": apart, "whole": whole, **_undersampled(study)},
    )


def _conditioning_claim(study):
    condition = dict(zip(study.basis, study.basis_condition, strict=True))
    hermite = condition["Hermite, whitened"]
    names = {
        "sphere": "Hermite, whitened",
        "variance": "Hermite, whitened with variance one",
        "monomials": "monomials, whitened",
        "raw": "monomials, m, m/s and rad",
    }
    return Evaluation(
        bool(hermite < WELL_CONDITIONED),
        evidence="condition numbers at the samples: "
        + ", ".join(f"{name} {value:.3g}" for name, value in condition.items())
        + f"; well conditioned is up to {WELL_CONDITIONED:g}",
        numbers={key: condition[name] for key, name in names.items()},
    )


# ---- sets (Sec. 3) ---------------------------------------------------------------------------------------------------


def _set_claims(inputs: FunnelsInputs, gains, funnel):
    states = funnel.shape.shape[1]
    on_slice = sampled_levels(inputs, funnel)
    off = largest(np.abs(on_slice - 1.0), np.inf)
    literal = funnel.literal_level
    low, high = np.nanmin(literal), np.nanmax(literal)
    term = states * np.log(funnel.level) - np.linalg.slogdet(funnel.shape)[1]
    as_volume, as_square = (np.ptp(term - power * funnel.log_volume) for power in (1.0, 2.0))
    drawn = funnel.samples[:, states:]
    rescaled = drawn / np.sqrt(0.5 * np.sum(drawn**2, axis=1, keepdims=True))
    without_matrix = np.sum(rescaled**2, axis=1)  # 1/2 w'Uw with U = 2, the unit disc
    semi_axes = environment.initial_semi_axes(inputs.planet, inputs.uncertainty)
    starts = semi_axes * funnel.samples[:, :states]
    inside = 0.5 * np.einsum("mi,ij,mj->m", starts, gains.shape[0], starts) / funnel.level[0]
    initial_set = environment.initial_set(semi_axes)
    axes = np.sqrt(np.diag(initial_set))
    singular = np.linalg.eigvalsh((initial_set - gains.shape[0] / funnel.level[0]) / np.outer(axes, axes))[0]
    scale = environment.state_scale(inputs.planet, inputs.guidance)
    definite = np.linalg.eigvalsh(funnel.shape * np.outer(scale, scale))[:, 0].min()
    return {
        "bk_is_algebraic_variety": Evaluation(
            bool(definite > 0.0 and (funnel.level > 0.0).all()),
            evidence=f"the zeros of a quadratic polynomial, {states} variables, with a positive definite matrix at all "
            f"{len(funnel.shape)} slices: least eigenvalue {definite:.3g} in the scales of the regulator",
        ),
        "rescaled_points_on_bk": Evaluation(
            bool(max(abs(low - 1.0), abs(high - 1.0)) < ROUNDING),
            evidence=f"V/rho of points by Eq. 26 is {low:.2g} to {high:.2g} in km and rad, "
            f"{np.nanmin(funnel.literal_level_si):.2g} to {np.nanmax(funnel.literal_level_si):.2g} in m and rad",
            numbers={"low": low, "high": high},
        ),
        "rescaled_w_on_boundary": Evaluation(
            bool(np.abs(without_matrix - 1.0).max() < ROUNDING),
            evidence=f"Eq. 34 holds a set where a matrix is needed; without any, 1/2 w'Uw is "
            f"{without_matrix.max():.3g} instead of 1 on the unit disc, with U it is 1",
        ),
        "initial_containment": Evaluation(
            bool(abs(singular) < ROUNDING and inside.max() <= 1.0 + ROUNDING),
            evidence=f"rho_1 = {funnel.level[0]:.6f}: the least eigenvalue of M_1 - P_1/rho_1 is {singular:.1g} in "
            f"units of M_1, and V/rho_1 up to {inside.max():.4f} at {len(inside)} points of the boundary of S_1",
            numbers={"first": funnel.level[0]},
        ),
        "volume_objective": Evaluation(
            bool(as_volume < ROUNDING),
            evidence=f"over the slices the logarithm of rho^n/det P departs from that of the volume by "
            f"{as_volume:.3g}, from that of its square by {as_square:.1g}",
        ),
        "tvlqr_as_lyapunov": _lyapunov_claim(inputs, funnel, definite),
        "fig4_samples_cover_sublevel_set": _sublevel_claim(inputs, funnel, off),
    }


def _lyapunov_claim(inputs: FunnelsInputs, funnel, definite):
    """Not evaluated where slices have another shape."""
    if inputs.recursion.shape != "value_matrix":
        return None
    rising = largest(funnel.rising_undisturbed, np.inf)
    return Evaluation(
        bool(definite > 0.0 and rising == 0.0 and funnel.outcome == COMPLETE),
        evidence=f"positive definite, and without disturbance V grows at {100 * rising:.3g} % of random points of the "
        f"slices{_unfinished(funnel)}",
    )


def _sublevel_claim(inputs: FunnelsInputs, funnel, off):
    """Judged without disturbance, as the caption names none."""
    k = inputs.studies.fig4_slice - 1
    falling = largest(funnel.fig4_circle_rate, np.inf)
    elsewhere = np.mean(funnel.fig4_rate < 0.0)
    still, worst = funnel.rising_undisturbed[k], funnel.rising[k]
    return Evaluation(
        bool(off < ROUNDING and falling < 0.0 and still == 0.0),
        evidence=f"at k = {k + 1} V/rho of the samples departs from 1 by {off:.1g}; without disturbance V "
        f"falls at all but {100 * still:.3g} % of points of the slice and in {100 * elsewhere:.4g} % of the plane that "
        f"is drawn, under the worst one it grows at {100 * worst:.3g} %",
        numbers={"worst": 100.0 * worst, "elsewhere": 100.0 * elsewhere, "most": 100.0 * largest(funnel.rising)},
    )


# ---- the stage condition and the disturbances (Sec. 3, Apps. A and B) ------------------------------------------------


def _stage_claims(inputs: FunnelsInputs, study, discretization, coarse_funnels, equations_of_motion):
    if None in (study, discretization, coarse_funnels, equations_of_motion):
        return dict.fromkeys(STUDIED)
    least, median, most = study.stationary_norm
    return {
        "worst_disturbance_location": Evaluation(
            study.interior_better == 0 and study.stationary_inside == 0,
            evidence=f"for {study.interior_better} of the deviations a disturbance inside of W is worse than all on "
            f"its boundary; {study.stationary_inside} of the points of O lie in W",
            numbers={"inside": study.stationary_inside, "angle": study.gradient_angle},
        ),
        "stationary_w_by_newton": Evaluation(
            bool(study.stationary_converged == 1.0 and study.stationary_inside > 0),
            evidence=f"Newton's method ends in a point of O for {100 * study.stationary_converged:.0f} % of the "
            f"deviations, at norms of {least:.3g} to {most:.3g} (median {median:.3g}) where W ends at 1; "
            f"{study.stationary_inside} lie in W; there the polynomial is up to {study.stationary_value:.3g}, on the "
            f"boundary of W {study.boundary_value:.4g}",
            numbers={
                "share": 100.0 * study.stationary_converged,
                "median": median,
                "inside": study.stationary_inside,
                "asked": study.stationary_value / study.boundary_value,
                "saddles": 100.0 * study.stationary_saddles,
            },
        ),
        "w_gradient_formula": Evaluation(
            bool(study.gradient_deviation < ROUNDING),
            evidence=f"Eq. 35 departs from differences of the rate of V by {study.gradient_deviation:.1g} at most",
        ),
        "stage_condition_bounds_step": _euler_claim(inputs, discretization),
        "entry_equations": _equations_claim(equations_of_motion),
        "backward_funnel": _backward_claim(coarse_funnels),
    }


def _euler_claim(inputs: FunnelsInputs, discretization):
    """At the number of slices of the inputs, and at the least that is studied."""
    spacing = list(discretization.spacing)
    here, coarsest = spacing.index(inputs.recursion.steps_per_slice), int(np.argmax(spacing))
    share, least, most, mean = (
        100.0 * getattr(discretization, name)[here]
        for name in ("unsafe_share", "least_excess", "largest_excess", "mean_excess")
    )
    return Evaluation(
        bool(least >= -100.0 * ROUNDING),
        evidence=f"from the same level the bound of Eq. 22 is below that of the motion in {share:.0f} % of the stages, "
        f"by up to {-least:.2g} %, and up to {most:.2g} % above it elsewhere (mean {mean:+.2g} %)",
        numbers={
            "share": share,
            "worst": -least,
            "most": most,
            "coarsest": spacing[coarsest],
            "coarsest_share": 100.0 * discretization.unsafe_share[coarsest],
            "coarsest_worst": -100.0 * discretization.least_excess[coarsest],
        },
    )


def _equations_claim(equations_of_motion):
    apart = max(equations_of_motion.position_rate_deviation, equations_of_motion.velocity_rate_deviation)
    return Evaluation(
        bool(apart < ROUNDING),
        evidence=f"with the terms of rotation written out the rates depart from inertial motion by {apart:.1g} of them "
        "at random states",
    )


def _backward_claim(coarse_funnels):
    back = of_variant(coarse_funnels, "backward")
    return Evaluation(
        bool(
            np.isfinite(back).all()
            and coarse_funnels.round_trip < ROUND_TRIP
            and coarse_funnels.round_trip_shortfall < ROUNDING
        ),
        evidence=f"from rho = {back[-1]:g} at the end back to {back[0]:.4f} at the first of {len(back)} slices, by up "
        f"to {coarse_funnels.backward_programs.max()} programs a stage; forward again it departs by "
        f"{coarse_funnels.round_trip:.1g}",
        numbers={
            "first": back[0],
            "last": back[-1],
            "programs": coarse_funnels.backward_programs.mean(),
            "trip": coarse_funnels.round_trip,
        },
    )


def of_variant(coarse_funnels, name):
    """Levels of one of the funnels with coarse slices."""
    return coarse_funnels.variant_level[list(coarse_funnels.variant).index(name)]


def _least_increase(monotonicity):
    """Least factor between the levels that a stage reaches from two of which one is twice the other."""
    if monotonicity is None:
        return np.nan
    powers = np.diff(np.log(monotonicity.reached_level)) / np.diff(np.log(monotonicity.studied_level))
    return float(2.0 ** powers.min())


# ---- flights (Sec. 5, Fig. 3) ----------------------------------------------------------------------------------------


def _flight_claims(funnel, laws, proven):
    constant = laws["constant"]
    trials = len(constant.outcome)
    told = [f"{law.outside_at_slices} of {len(law.outcome)} ({name})" for name, law in laws.items()]
    outside = sum(law.outside_at_slices for law in laws.values())
    between = sum(law.outside_between for law in laws.values())
    lost = sum(law.excluded for law in laws.values())
    ratio = over_flown(funnel, constant)
    highest = largest([law.largest_ratio for law in laws.values()], np.inf)
    complete = funnel.outcome == COMPLETE
    numbers = {
        "trials": trials,
        "bound": 100.0 * 3.0 / trials,  # of the probability to leave, at 95 %, if none of them does
        "ratio": constant.largest_ratio,
        "level": largest(funnel.level),
    }
    return {
        "mc_inside_funnel": Evaluation(
            bool(complete and constant.outside_at_slices == 0 and constant.excluded == 0),
            evidence=f"outside at a slice: {'; '.join(told)}; largest V/rho {constant.largest_ratio:.4g} "
            f"under constant disturbance, rho up to {numbers['level']:.4g}{_unfinished(funnel)}",
            numbers=numbers,
        ),
        "interpolation_between_slices": Evaluation(
            bool(complete and between == 0 and lost == 0),
            evidence=f"flights outside between the slices, with rho on lines: {between} under all three kinds of "
            f"disturbance; largest V/rho after the start {highest:.4g}{_unfinished(funnel)}",
            numbers={
                "highest": highest,
                "over_line": np.nan if proven is None else 100.0 * proven.interpolation_excess,
            },
        ),
        "sos_above_mc": Evaluation(
            bool((ratio >= 1.0).all()),
            evidence=f"rho over the largest V of {trials} flights at the slices after the first: {np.min(ratio):.4g} "
            f"to {np.max(ratio):.4g}{_unfinished(funnel)}",
            numbers={"least": np.min(ratio), "most": np.max(ratio)},
        ),
        "no_distribution_assumed": Evaluation(
            bool(complete and outside == 0 and lost == 0),
            evidence="one funnel holds whatever the disturbance does in its set: outside at a slice are "
            + "; ".join(told)
            + _unfinished(funnel),
        ),
        "funnel_is_tight": Evaluation(
            bool((ratio < TIGHT).all()),
            evidence=f"rho over the largest V of the flights: median {np.median(ratio):.3g}, at most "
            f"{np.max(ratio):.3g}; tight is below {TIGHT:g} at all slices",
            numbers={
                "median": np.median(ratio),
                "most": np.max(ratio),
                "width": np.sqrt(np.median(ratio)),
                "program": 100.0 * largest(funnel.tightness),
                "adversary": np.max(flown_levels(funnel, laws["adversarial"])),
                "flown": np.max(flown_levels(funnel, constant)),
            },
        ),
    }


# ---- course of the funnel (Sec. 5, Fig. 3) ---------------------------------------------------------------------------


def _course_claims(linearization, funnel, constant):
    time, duration = funnel.time, funnel.time[-1]
    found = peaks(funnel.level)
    early = found[time[found] <= BEGINNING * duration]
    top = int(np.nanargmax(funnel.level))
    before = np.interp((1.0 - END) * duration, time, funnel.level)
    grown = funnel.log_volume[-1] - np.interp((1.0 - END) * duration, time, funnel.log_volume)
    flown = flown_levels(funnel, constant)
    late = linearization.half_time >= (1.0 - END) * duration
    fastest = linearization.deceleration.max() / STANDARD_GRAVITY
    at_end = np.abs(linearization.deceleration[late]).max() / STANDARD_GRAVITY
    pulse = linearization.half_time[linearization.deceleration.argmax()]
    return {
        "first_peak": Evaluation(
            bool(early.size),
            evidence=f"local maxima of rho at {_listed(time[found], '.0f') if found.size else 'no time'} s of "
            f"{duration:.0f} s, largest level {funnel.level[top]:.4g} at {time[top]:.0f} s; deceleration is largest at "
            f"{pulse:.0f} s",
            numbers={
                "time": time[found[0]] if found.size else np.nan,
                "share": 100.0 * time[found[0]] / duration if found.size else np.nan,
                "pulse": pulse,
                "during": np.interp(1.5 * pulse, time, funnel.level) / funnel.level[0],
            },
        ),
        "end_expansion": Evaluation(
            bool(funnel.level[-1] > before * (1.0 + ROUNDING)),
            evidence=f"rho goes from {before:.4g} to {funnel.level[-1]:.4g} in the last {100 * END:g} % of the time, "
            f"the volume grows by a factor of {np.exp(grown):.3g}, the largest V of the flights goes to "
            f"{flown[-1]:.4g}",
            numbers={"before": before, "last": funnel.level[-1], "volume": np.exp(grown)},
        ),
        "end_high_velocity_changes": Evaluation(
            bool(at_end > HIGH * fastest),
            evidence=f"the deceleration is up to {at_end:.2f} g in the last {100 * END:g} % of the time and "
            f"{fastest:.1f} g at {pulse:.0f} s; high is {100 * HIGH:g} % of that",
            numbers={"end": at_end, "most": fastest},
        ),
    }


# ---- guarantees and accuracy (Abstract, Secs. 1, 5 and 6) ------------------------------------------------------------


def _guarantee_claims(inputs: FunnelsInputs, linearization, gains, funnel, proven):
    exceeded = int(np.count_nonzero(funnel.true_maximum > funnel.growth))
    worst = 100.0 * largest(funnel.violation)
    sought = int(np.count_nonzero(np.isfinite(funnel.true_maximum)))
    excess, covered, told = _against_proof(funnel, proven)
    reach = funnel.half_width[-1, 1:3] * inputs.planet.planet_radius / KILOMETRE
    goal = inputs.mission.goal_lengths / KILOMETRE
    without, under = (
        linear_reach(inputs, linearization, gains, factor * gains.half_gain) / KILOMETRE for factor in (0.0, 1.0)
    )
    first = funnel.half_width[0, 1:3] * inputs.planet.planet_radius / KILOMETRE
    proven_reach = reach if proven is None else proven.half_width[-1, 1:3] * inputs.planet.planet_radius / KILOMETRE
    return {
        "guaranteed_bounds": Evaluation(
            exceeded == 0 and covered,
            evidence=f"motion was found above the level of the next slice in {exceeded} of {sought} stages, beyond the "
            f"bound of the polynomial by up to {worst:.3g} %; {told}",
            numbers={"exceeded": exceeded, "stages": sought, "worst": worst, "excess": excess},
        ),
        "reaches_goal_region": Evaluation(
            bool((np.maximum(reach, proven_reach) <= goal).all()),
            evidence=f"half widths of the last slice {_listed(reach, '.3g')} km downrange and crossrange, of the goal "
            f"{_listed(goal, '.3g')} km" + ("" if proven is None else f"; proven {_listed(proven_reach, '.3g')} km"),
            numbers={"reach": reach, "goal": goal},
        ),
        "increased_landing_accuracy": Evaluation(
            bool(reach.max() < without.max()),
            evidence=f"half widths of the last slice {_listed(reach, '.3g')} km downrange and crossrange, of the first "
            f"{_listed(first, '.3g')} km; from there linear motion reaches {_listed(without, '.3g')} km without "
            f"feedback and {_listed(under, '.3g')} km with it",
            numbers={"reach": reach.max(), "without": without.max(), "under": under.max()},
        ),
    }


def _against_proof(funnel, proven):
    """By how much levels that are proven are higher, in per cent, whether they are nowhere, and this in words."""
    if proven is None:
        return np.nan, False, "its levels are not proven in this reading"
    if not proven.proven:
        return np.nan, False, f"levels are not proven to the end: {proven.outcome}"
    excess = 100.0 * np.max(proven.level / funnel.level - 1.0)
    told = f"levels that are proven for the integrated motion are up to {excess:.3g} % higher"
    return excess, bool((proven.level <= funnel.level).all()), told


def linear_reach(inputs: FunnelsInputs, linearization, gains, half_gain):
    """Largest final downrange and crossrange deviation of linear motion from the first slice, (2,), m.

    Under all constant disturbances; half_gain: feedback at nodes and half-way between, (2 n + 1, 6).
    """
    air = environment.disturbed_air(inputs.planet, inputs.uncertainty)
    loop = environment.closed_loop(inputs.planet, inputs.vehicle, air, linearization, half_gain)
    spread = np.sqrt(2.0 * gains.initial_level) * np.linalg.inv(np.linalg.cholesky(gains.shape[0])).T
    corner = np.zeros((len(spread), loop.disturbances))
    directions = np.block([[spread, corner], [corner.T, np.eye(loop.disturbances)]])
    states, disturbances = np.split(1j * COMPLEX_STEP * directions, [len(spread)])
    final = np.array(loop.flow(0, loop.steps, states, disturbances)).imag / COMPLEX_STEP
    by_start, by_disturbance = np.split(final, [len(spread)], axis=1)
    reached = np.linalg.norm(by_start, axis=1) + np.linalg.norm(by_disturbance, axis=1)
    return (reached * inputs.planet.planet_radius)[1:3]


# ---- heating (Abstract, Sec. 4) --------------------------------------------------------------------------------------


def _heating_claims(inputs: FunnelsInputs, nominal, optima, funnel, constant):
    limit, peak = inputs.mission.heat_rate_limit / WATT_PER_CM2, nominal.peak_heat_rate / WATT_PER_CM2
    at_nodes = nominal.heat_rate.max() / WATT_PER_CM2
    on_funnel = largest(funnel.heat_rate, np.inf) / WATT_PER_CM2
    flown = largest(constant.maximum_over_trials[:, HEAT_RATE]) / WATT_PER_CM2
    meshes, found = np.unique(optima.intervals, return_counts=True) if optima else ([0], [0])
    return {
        "thermal_constraint_nominal": Evaluation(
            bool(at_nodes <= limit * (1.0 + ROUNDING) and peak <= limit * (1.0 + SMALL)),
            evidence=f"heat rate up to {at_nodes:.4f} W/cm^2 at the nodes, where it is limited to {limit:g} W/cm^2, "
            f"and {peak:.3f} W/cm^2 between them; {100 * SMALL:g} % is allowed there",
            numbers={
                "nodes": at_nodes,
                "between": peak,
                "optima": found[0],
                "intervals": meshes[0],
                "more": found[-1],
                "finer": meshes[-1],
            },
        ),
        "thermal_constraint_funnel": Evaluation(
            bool(on_funnel <= limit * (1.0 + SMALL)),
            evidence=f"heat rate up to {on_funnel:.4g} W/cm^2 in the slices, {flown:.4g} W/cm^2 in flights; the limit "
            f"of the nominal is {limit:g} W/cm^2",
            numbers={"funnel": on_funnel, "flown": flown, "limit": limit},
        ),
    }


# ---- solvers (Figs. 2 and 3, Secs. 3 to 5) ---------------------------------------------------------------------------


def _dubins_claim(dubins, dubins_study, calm, wind):
    levels = dict(zip(dubins.funnel, dubins.level, strict=True))
    outside = [run.outside_at_slices + run.excluded for run in (calm, wind)]
    proven = f"; proven levels end at {dubins_study.proven_level[0, -1]:.4g}" if dubins_study else ""
    return Evaluation(
        bool(dubins.sound.all() and not any(outside)),
        evidence=f"{dubins.level.shape[1]} slices in three dimensions; rho from {levels['flow'][0]:.3g} to "
        f"{levels['flow'][-1]:.4g}, with wind to {levels['wind'][-1]:.4g}; outside are {outside[0]} of "
        f"{len(calm.outcome)} runs, with wind {outside[1]} of {len(wind.outcome)}{proven}",
        numbers={"last": levels["flow"][-1], "flown": calm.maximum_over_trials[-1, LEVEL]},
    )


def _four_solvers_claim(funnel, exact, flown, coarse_funnels):
    multipliers = of_variant(coarse_funnels, "multipliers")
    below = int(np.count_nonzero(exact < funnel.level * (1.0 - ROUNDING)))
    return Evaluation(
        bool(
            funnel.outcome == COMPLETE
            and np.isfinite(multipliers).all()
            and np.isfinite(exact).all()
            and np.isfinite(flown).all()
        ),
        evidence=f"final rho {funnel.level[-1]:.4g} by samples, {multipliers[-1]:.4g} by multipliers on "
        f"{len(multipliers)} slices, {flown[-1]:.4g} by flights, {exact[-1]:.4g} by ellipsoids of linear dynamics, "
        f"which lie below the samples' at {below} of {len(exact)} slices",
        numbers={"linear": exact[-1], "level": funnel.level[-1]},
    )


# ---- cost (Secs. 1, 5 and 6) -----------------------------------------------------------------------------------------

BY_SAMPLES = "whole funnel by samples, rank-one"
BY_COEFFICIENTS = tuple(f"whole funnel by coefficients, {solver}" for solver in ("Clarabel", "SCS"))
SAME_SOLVER = "speed of coefficients over samples, Clarabel, a stage"
OVER_FLIGHTS = "cost of the funnel over 10,000 flights"
MINUTE_OVER_FLIGHTS = "cost of the paper's minute over 10,000 flights"
MEASURED = (BY_SAMPLES, *BY_COEFFICIENTS, SAME_SOLVER, OVER_FLIGHTS, MINUTE_OVER_FLIGHTS)


def _cost_claims(measured):
    """Statements on cost, by our own measurements; a row that is missing meets no statement."""
    row = {name: measured.get(name, np.nan) for name in MEASURED}
    missing = [name for name in MEASURED if name not in measured]
    told = f"; not measured: {'; '.join(missing)}" if missing else ""
    samples, multipliers = row[BY_SAMPLES], np.array([row[name] for name in BY_COEFFICIENTS])
    cheapest = np.min(multipliers)
    return {
        "funnel_run_time": Evaluation(
            samples / MINUTE,
            evidence=f"{samples:.3g} s on one core, integrated motion{told}",
            numbers={"seconds": samples},
        ),
        "multiplier_dimension_limit": Evaluation(
            SPHERES.variables,
            evidence=f"{SPHERES.variables} variables, of state and disturbances, as the feedback is none; whole "
            f"funnels by multipliers take {_listed(multipliers, '.3g')} s (Clarabel, SCS){told}",
            numbers={"variables": SPHERES.variables, "cheapest": cheapest},
        ),
        "multiplier_prohibitive": Evaluation(
            bool(cheapest > PROHIBITIVE),
            evidence=f"the whole funnel by multipliers takes {_listed(multipliers, '.3g')} s (Clarabel, SCS); "
            f"prohibitive is beyond {PROHIBITIVE:g} s{told}",
            numbers={"cheapest": cheapest, "samples": samples},
        ),
        "sampling_reduces_cost": Evaluation(
            bool(samples < FAR_LESS * cheapest),
            evidence=f"the whole funnel takes {samples:.3g} s by samples with a solver that uses their structure, "
            f"{_listed(multipliers, '.3g')} s by multipliers; with one solver for both a stage by samples takes "
            f"{row[SAME_SOLVER]:.3g} times as long; far less is {100 * FAR_LESS:g} %{told}",
            numbers={"factor": cheapest / samples, "same_solver": row[SAME_SOLVER]},
        ),
        "cheaper_than_monte_carlo": Evaluation(
            bool(row[OVER_FLIGHTS] < FAR_LESS),
            evidence=f"the funnel takes {row[OVER_FLIGHTS]:.3g} times as long as 10,000 flights, a minute would be "
            f"{row[MINUTE_OVER_FLIGHTS]:.3g} times; far less is {100 * FAR_LESS:g} %{told}",
            numbers={"cost": row[OVER_FLIGHTS], "minute": row[MINUTE_OVER_FLIGHTS]},
        ),
    }


# ---- what is known about them ----------------------------------------------------------------------------------------

WEIGHTS = "the weights of the regulator"
SETS = "the initial set and the disturbances"
NOMINAL = "the nominal trajectory"
THERMAL = "the thermal constraints"
SOLVER = "solver settings and machine"

DECLARATIONS = {
    "exponent_d": Declaration(
        "`corrected` takes d = 0: on the slice itself every d gives the same, and with d = 1 the degrees of both sides "
        "of Eq. 24 differ.",
        errata=("E5", "E14"),
    ),
    "gram_size": Declaration(
        "Six states and two parameters of the density; {independent} rows are independent where the samples are.",
        errata=("E8", "E18"),
    ),
    "gram_dimension_eq2": Declaration("{rows} rows instead of {degree}, in eight variables.", errata=("E12",)),
    "gram_45_follows_from_d1": Declaration(
        "With d = 1 it would be {with_exponent}, with disturbances added to all states {with_additive}; 45 is what the "
        "state and two parameters give without either.",
        errata=("E5", "E7"),
    ),
    "taylor_for_nonpolynomial": Declaration(
        "In {stages} stages motion was found beyond the bound of its expansion, by up to {violation:.2f} %: without a "
        "bound of the remainder this is no proof.",
        errata=("E17",),
    ),
    "minimum_samples_computable": Declaration(
        "{used}. With {few} the program is solved as well, and its bound, {few_bound:.3f} instead of "
        "{enough_bound:.3f}, is too small.",
        errata=("E8",),
    ),
    "sampling_equivalence": Declaration(
        "With as many samples as the rank asks for, and degrees that agree; from {few} samples the bound is "
        "{few_bound:.3f} instead of {enough_bound:.3f}.",
        errata=("E5", "E8"),
    ),
    "rescaled_points_on_bk": Declaration(
        "Neither P_k nor rho_k is in Eq. 26: V/rho is between {low:.0e} and {high:.0e}. In coordinates in which the "
        "slice is a sphere the rescaling is right.",
        errata=("E1",),
    ),
    "greedy_needed": Declaration(
        "And nothing is lost: from twice a level a stage reaches at least {twice:.2f} times as much, so that one stage "
        "after the other also has the least sum.",
        errata=("E21",),
    ),
    "rescaled_w_on_boundary": Declaration("With U in place of W it does.", errata=("E2",)),
    "initial_containment": Declaration(
        "With one half in the definition of S_1, which is not given.", errata=("E9", "E10")
    ),
    "volume_objective": Declaration(
        "Up to a constant it is the square of a volume. Both grow with every rho_k, so that the funnel is the same.",
        errata=("E3",),
    ),
    "stage_condition_bounds_step": Declaration(
        "In {share:.0f} % of the stages it is too small, by up to {worst:.2f} %; with {coarsest} fine steps between "
        "slices in {coarsest_share:.0f} %, by up to {coarsest_worst:.2f} %.",
        errata=("E4", "E13", "E19"),
    ),
    "interpolation_between_slices": Declaration(
        "For flights; the condition itself speaks of slices only. Levels that are proven at all nodes are at most "
        "{over_line:.2g} % above lines between slices.",
        errata=("E16",),
    ),
    "worst_disturbance_location": Declaration(
        "On the boundary: the rates are monotonic in the density, so that O is empty, and that of their expansion has "
        "no point in W.",
        errata=("E6", "E11"),
    ),
    "stationary_w_by_newton": Declaration(
        "It ends in one for {share:.0f} % of the deviations, at a median norm of {median:.0f}, and {inside} of them "
        "lie in W. Samples there would ask for {asked:.1f} times the level.",
        errata=("E6",),
    ),
    "w_gradient_formula": Declaration("The last line; those before it in App. B are misprinted.", errata=("E13",)),
    "hermite_conditioning": Declaration(
        "On the unit sphere {sphere:.0f}, where monomials have {monomials:.0f}; with coordinates of variance one "
        "{variance:.1f}. In SI units monomials have {raw:.0e}.",
    ),
    "entry_equations": Declaration(
        "With Coriolis and centrifugal terms, also of the velocity, written out.", errata=("E15",)
    ),
    "fig4_samples_cover_sublevel_set": Declaration(
        "Without disturbance V falls everywhere but at the reference. Under the worst one it grows at {worst:.2g} % of "
        "the slice, and at up to {most:.0f} % of a later one: it must where rho grows.",
        withheld=("the axes and the disturbance of Fig. 4",),
    ),
    "dubins_funnel": Declaration("", withheld=("all inputs of the Dubins car",)),
    "mc_inside_funnel": Declaration(
        "None of {trials} outside leaves a probability below {bound:.2g} % at 95 %, under our law of start and "
        "disturbance.",
        errata=("E20",),
    ),
    "sos_above_mc": Declaration("Both start from rho_1.", errata=("E20",)),
    "no_distribution_assumed": Declaration("The laws of the flights are ours.", errata=("E20",)),
    "first_peak": Declaration(
        "rho rises through the deceleration and has its first peak at {time:.0f} s, after {share:.0f} % of the flight "
        "({best_nominal[share]:.0f} % around the nominal of least bank rate).",
        errata=("E22",),
        withheld=(WEIGHTS, SETS),
    ),
    "end_expansion": Declaration(
        "rho goes from {before:.2f} to {last:.2f}, though the volume grows by a factor of {volume:.2f}. By the Euler "
        "step it goes from {euler[before]:.2f} to {euler[last]:.2f}, as the text has it.",
        errata=("E4",),
        withheld=(WEIGHTS,),
    ),
    "end_high_velocity_changes": Declaration(
        "{end:.1f} g, of {most:.1f} g before.",
        withheld=(NOMINAL,),
    ),
    "funnel_is_tight": Declaration(
        "rho is {median:.1f} times that of the flights in the median and {most:.1f} times at most. A greedy adversary "
        "reaches {adversary:.2f}, flights under constant disturbance {flown:.2f}. The programs are tight, within "
        "{program:.1g} %: the shape of the slices is not.",
        withheld=(WEIGHTS,),
    ),
    "guaranteed_bounds": Declaration(
        "As stated they are not: motion leaves the level of the next slice in {exceeded} of {stages} stages, by up to "
        "{worst:.2f} % of it. With a bound of the remainder they can be proven, at levels up to {excess:.0f} % higher.",
        errata=("E4", "E16", "E17"),
    ),
    "reaches_goal_region": Declaration("Of our goal.", withheld=("the goal region",)),
    "increased_landing_accuracy": Declaration(
        "Compared with no feedback: it takes what linear motion reaches from {without:.1f} to {under:.1f} km, but the "
        "funnel allows {reach:.1f} km.",
        withheld=("what it is compared with",),
    ),
    "thermal_constraint_nominal": Declaration(
        "{nodes:.2f} W/cm^2 at the nodes, but {between:.2f} W/cm^2 between them. That gap makes local optima, "
        "{optima} on {intervals} intervals and {more} on {finer}: in each the peak lies between another pair of nodes.",
        errata=("E22", "E23"),
    ),
    "thermal_constraint_funnel": Declaration(
        "{funnel:.1f} W/cm^2 on the slices, {flown:.1f} W/cm^2 in flights, and {limit:g} W/cm^2 allowed. The limit of "
        "the nominal would have to be lower.",
        withheld=(THERMAL,),
    ),
    "backward_funnel": Declaration(
        "By a search for the root, {programs:.1f} programs a stage: B_k depends on the unknown level, so that a "
        "maximisation is no program of its own.",
        errata=("E21",),
    ),
    "four_funnel_solvers": Declaration("The one of linear dynamics is no bound: {linear:.2f} against {level:.2f}."),
    "funnel_run_time": Declaration("{seconds:.0f} s on one core.", withheld=(SOLVER,)),
    "multiplier_dimension_limit": Declaration(
        "{variables} variables are no obstacle: a whole funnel takes {cheapest:.0f} s.", withheld=(SOLVER,)
    ),
    "multiplier_prohibitive": Declaration("{cheapest:.0f} s for the whole funnel.", withheld=(SOLVER,)),
    "sampling_reduces_cost": Declaration(
        "A solver made for samples is {factor:.1f} times as fast as multipliers; with one general solver for both, "
        "samples take {same_solver:.0f} times as long.",
        withheld=(SOLVER,),
    ),
    "cheaper_than_monte_carlo": Declaration(
        "The funnel costs {cost:.1f} times as much as 10,000 flights in array code.", withheld=(SOLVER,)
    ),
}
