"""Iterations, spread of the states, violations, the double integrator, the studies, and what each reading gives."""

import numpy as np

from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field.claims import CONFIDENCE, OPEN, Records, node_deviations, normal_violation
from marsedl.papers.random_field.components import FLOORED
from marsedl.papers.random_field.double_integrator import normals_and_bounds, tail
from marsedl.papers.random_field.flight_statistics import LEVEL, delta_v_percentile, lost, step_violations
from marsedl.papers.random_field.inputs import Air, Guidance, PointMass, RandomFieldInputs, Studies, Vehicle
from marsedl.papers.random_field.records import (
    CLOSED,
    Certificates,
    Convergence,
    DoubleIntegrator,
    DoubleIntegratorFlights,
    FieldStudy,
    FlightEnsemble,
    Gains,
    Regularization,
)
from marsedl.sections.air import MeanDensity

NO_VALUE = "–"
STATES = (("r", 1e-3, "km"), ("v", 1.0, "m/s"), ("gamma", 180.0 / np.pi, "deg"))
VARIANT_NAMES = {
    "one_branch": "as in the paper",
    "both_branches": "both branches in the program",
    "short_end_steps": "short end steps",
}
# Inputs in which readings may differ that only stand for another nominal density.
_DENSITY = (
    *(f"air.{name}" for name in (*MeanDensity.model_fields, "density_beyond_table")),
    *("simulation.trials", "simulation.paper_trials", "simulation.drawn_trials"),
    "point_mass.double_integrator_trials",
)


def _number(value, form):
    return f"{value:{form}}" if np.isfinite(value) else NO_VALUE


def _with_error(value, error, form=".1f"):
    return f"{value:{form}} ± {error:{form}}" if np.isfinite(value) else NO_VALUE


def _share(count, trials, form=".2f"):
    """A share of the trials in per cent with its interval of confidence."""
    low, high = binomial_interval(count, trials, CONFIDENCE)
    return f"{100 * count / trials:{form}} ({100 * low:{form}} to {100 * high:{form}})"


def _signed(value, form):
    """A number with its sign, and none of zero's."""
    return f"{value if abs(value) >= 10.0 ** -int(form) / 2 else 0.0:+.{form}f}"


def _law(number):
    return f"iteration {number}" if number else "open loop"


# ---- aerocapture -----------------------------------------------------------------------------------------------------


def iterations(guidance: Guidance, published, gains: Gains, aerocapture: FlightEnsemble):
    """Every law: what linear covariance predicts, what its flights do."""
    last = len(gains.control) - 1
    printed = {OPEN: published["acap_dv_p99_open"].printed}
    if last > OPEN:
        printed[last] = published["acap_dv_p99_closed"].printed
    trials = aerocapture.outcome.shape[1]
    by_step, at_any = step_violations(aerocapture, gains.partition)
    away = lost(aerocapture)
    sure = f"{100 * CONFIDENCE:g} % interval"
    allotted = 100 * (1.0 - guidance.control_probability)
    rows = [
        (
            "law",
            "predicted mean of delta-v (m/s)",
            "predicted deviation (m/s)",
            "design's deviation (m/s)",
            f"{100 * LEVEL:g}th percentile in the paper (m/s)",
            f"{100 * LEVEL:g}th percentile (m/s)",
            "median (m/s)",
            "mean (m/s)",
            "deviation (m/s)",
            "lost trials",
            "trials at the density's floor",
            f"beyond the control limits at the worst step (%, {sure})",
            f"at any step (%, {sure})",
            "allotted per step (%)",
            "nominal exit apoapsis (r_p)",
            "largest gain (1 km, 100 m/s, 0.01 rad)",
            "trials",
        )
    ]
    for law in range(last + 1):
        delta_v = aerocapture.delta_v[law]
        captured = delta_v[np.isfinite(delta_v)]
        known = len(captured) > 1
        rows.append(
            (
                _law(law),
                _number(gains.delta_v_mean[law], ".1f"),
                _number(gains.delta_v_deviation[law], ".2f"),
                _number(gains.design_delta_v_deviation[law], ".2f"),
                f"{printed[law]:g}" if law in printed else "",
                _with_error(*delta_v_percentile(aerocapture, law, LEVEL), form=".2f"),
                f"{np.median(captured):.1f}" if known else NO_VALUE,
                f"{captured.mean():.1f}" if known else NO_VALUE,
                f"{captured.std(ddof=1):.1f}" if known else NO_VALUE,
                f"{away[law]:,}",
                f"{(aerocapture.final_state[law, :, FLOORED] > 0).sum():,}",
                _share(by_step[law].max(), trials),
                _share(at_any[law], trials),
                f"{allotted:.2f}",
                _number(gains.apoapsis[law], ".3f"),
                f"{gains.largest_gain[law]:.3g}",
                f"{trials:,}",
            )
        )
    return rows


def state_deviations(gains: Gains, aerocapture: FlightEnsemble):
    """Standard deviations of the states at the nodes, flown and predicted, of the open loop and the last law."""
    laws = list(dict.fromkeys((OPEN, len(gains.control) - 1)))
    found = {law: node_deviations(gains, aerocapture, law) for law in laws}
    header = ["t (s)"]
    for law in laws:
        for name, _, unit in STATES:
            header += [f"{_law(law)}: {name} ({unit}), flown", f"{_law(law)}: {name}, predicted", "ratio"]
    rows = [tuple(header)]
    for node in range(1, len(gains.partition)):
        cells = [f"{gains.partition[node]:g}"]
        for law in laws:
            for state, (_, factor, _) in enumerate(STATES):
                flown, predicted = (values[node, state] * factor for values in found[law])
                ratio = predicted / flown if flown > 0.0 else np.nan
                cells += [_number(flown, ".4g"), _number(predicted, ".4g"), _number(ratio, ".3f")]
        rows.append(tuple(cells))
    return rows


def control_violations(vehicle: Vehicle, guidance: Guidance, gains: Gains, aerocapture: FlightEnsemble):
    """Probability that the command leaves its limits: allotted, predicted and flown, per law and interval."""
    trials = aerocapture.outcome.shape[1]
    by_step, _ = step_violations(aerocapture, gains.partition)
    allotted = 1.0 - guidance.control_probability
    rows = [
        (
            "law",
            "from (s)",
            "to (s)",
            "mean control",
            "predicted deviation",
            "design's deviation",
            "allotted (%)",
            "predicted (%)",
            "predicted by the design (%)",
            f"flown (%, {100 * CONFIDENCE:g} % interval)",
            "against what is allotted",
            "trials",
        )
    ]
    # Without feedback there is nothing to tell, unless there is nothing else.
    for law in range(min(1, len(gains.control) - 1), len(gains.control)):
        for k in range(len(gains.partition) - 1):
            mean, deviations = gains.control[law, k], (gains.control_deviation, gains.design_control_deviation)
            predicted = [float(normal_violation(mean, values[law, k], vehicle.control_limits)) for values in deviations]
            low, high = binomial_interval(by_step[law, k], trials, CONFIDENCE)
            rows.append(
                (
                    _law(law),
                    f"{gains.partition[k]:g}",
                    f"{gains.partition[k + 1]:g}",
                    _signed(mean, 3),
                    *(f"{values[law, k]:.3g}" for values in deviations),
                    f"{100 * allotted:.2f}",
                    *(f"{100 * value:.4f}" for value in predicted),
                    _share(by_step[law, k], trials, ".3f"),
                    _against(low, high, allotted),
                    f"{trials:,}",
                )
            )
    return rows


def _against(low, high, allotted):
    if low > allotted:
        return "more"
    return "less" if high < allotted else "not told apart"


# ---- double integrator -----------------------------------------------------------------------------------------------


def double_integrator(
    point_mass: PointMass,
    double_integrator: DoubleIntegrator,
    double_integrator_flights: DoubleIntegratorFlights,
):
    """Spread of both states at the nodes, flown and predicted, how far the ellipses reach, and the cost."""
    design, flights = double_integrator, double_integrator_flights
    header = ["t"]
    for name in ("open loop", "feedback"):
        for state in ("r", "v"):
            header += [f"{name}: deviation of {state}, flown", f"{name}: deviation of {state}, predicted"]
        header += [f"{name}: ellipse beyond line 1", f"{name}: ellipse beyond line 2"]
    header += ["mean control", "deviation of the control"]
    rows = [tuple(header)]
    flown = np.sqrt(np.diagonal(flights.covariance[:, flights.node], axis1=2, axis2=3)[..., :2])
    predicted = np.sqrt(np.diagonal(design.covariance, axis1=2, axis2=3))
    for node, time in enumerate(design.partition):
        cells = [f"{time:g}"]
        for law in (OPEN, CLOSED):
            for state in range(2):
                cells += [f"{flown[law, node, state]:.6f}", f"{predicted[law, node, state]:.6f}"]
            cells += [f"{value:+.4f}" for value in design.support[law, node]]
        if node < len(design.partition) - 1:
            cells += [_signed(design.control[CLOSED, node], 6), f"{design.control_deviation[CLOSED, node]:.4e}"]
        else:
            cells += ["", ""]
        rows.append(tuple(cells))
    bound = np.array(point_mass.double_integrator_final_three_sigma) / 3.0
    width = len(header)
    for name, value in (
        ("bound of the final deviations of r and v", f"{bound[0]:.6f}, {bound[1]:.6f}"),
        ("cost", f"{design.objective:.5e} ({design.status})"),
        ("cost without state constraints", f"{design.unconstrained_objective:.5e}"),
        ("factor that the state constraints cost", f"{design.objective / design.unconstrained_objective:.3f}"),
    ):
        rows.append((name, value, *[""] * (width - 2)))
    return rows


def double_integrator_violations(
    point_mass: PointMass,
    double_integrator: DoubleIntegrator,
    double_integrator_flights: DoubleIntegratorFlights,
):
    """Probability of lying beyond either line at every node: allotted, predicted, and over few and all trials."""
    from scipy.special import ndtr

    design, flights = double_integrator, double_integrator_flights
    normals, bounds = normals_and_bounds(point_mass)
    spread = np.sqrt(np.einsum("ci,lkij,cj->lkc", normals, design.covariance, normals))
    each = ndtr((design.mean @ normals.T - bounds) / spread)
    allotted = tail(point_mass), 1.0 - point_mass.double_integrator_probability
    first, sure = flights.paper_trials, f"{100 * CONFIDENCE:g} % interval"
    rows = [
        (
            "law",
            "t",
            "beyond",
            "constrained",
            "allotted (%)",
            "predicted (%)",
            f"first {first:,} trials (%, {sure})",
            f"all trials (%, {sure})",
            "all trials against what is allotted",
            "trials",
        )
    ]
    last = len(design.partition) - 1
    for law, name in ((OPEN, "open loop"), (CLOSED, "feedback")):
        trials = int(flights.count[law] + flights.excluded[law])
        paper = np.column_stack([flights.paper_violations[law], flights.paper_any_violations[law]])
        whole = np.column_stack([flights.violations[law], flights.any_violations[law]])
        # Both lines are never crossed at once but at their apex, which is left out of the prediction.
        predicted = np.column_stack([each[law], each[law].sum(axis=1)])
        for node, time in enumerate(design.partition):
            held = law == CLOSED and (point_mass.double_integrator_constrained == "all" or node < last)
            for column, beyond in enumerate(("line 1", "line 2", "either line")):
                limit = allotted[column // 2]
                low, high = binomial_interval(whole[node, column], trials, CONFIDENCE)
                rows.append(
                    (
                        name,
                        f"{time:g}",
                        beyond,
                        "yes" if held else "no",
                        f"{100 * limit:.3f}",
                        f"{100 * min(predicted[node, column], 1.0):.3f}",
                        _share(paper[node, column], first, ".3f"),
                        _share(whole[node, column], trials, ".3f"),
                        _against(low, high, limit),
                        f"{trials:,}",
                    )
                )
    return rows


# ---- studies ---------------------------------------------------------------------------------------------------------


def certificates(certificates: Certificates):
    """The first program against other formulations and another solver, and its disturbances against samples."""
    found = certificates

    def apart(other):
        return f"{abs(other - found.objective) / max(abs(other), abs(found.objective)):.1e}"

    return [
        ("check of the first program", "value"),
        ("least cost, innovations form, Clarabel", f"{found.objective:.10f}"),
        ("printed form in the history of states: relative difference of the cost", apart(found.history_objective)),
        ("the same: largest difference of a gain (1 km, 100 m/s, 0.01 rad)", f"{found.history_gain_difference:.1e}"),
        (f"{found.other_solver}: relative difference of the cost", apart(found.other_objective)),
        ("largest entry of (I + B L)(I - B K) - I", f"{found.identity_residual:.1e}"),
        ("largest entry of K and L above their block diagonals", f"{found.triangular_residual:.1e}"),
        ("Cov(U) from the gains against the innovations", f"{found.control_covariance_residual:.1e}"),
        ("change of the deviations with the mean control, relative", f"{found.mean_shift:.1e}"),
        ("change of the mean with the gains, relative", f"{found.gain_shift:.1e}"),
        ("least excess of chords over the cost, relative", f"{found.convexity:+.1e}"),
        ("sampled fields", f"{found.samples:,}"),
        ("covariance along the nominal, largest deviation in standard errors", f"{found.process_score:.1f}"),
        ("covariance of the disturbances, likewise", f"{found.disturbance_score:.1f}"),
        ("skewness and excess kurtosis of the disturbances, likewise", f"{found.normality_score:.1f}"),
        ("largest correlation of disturbances of different intervals", f"{found.largest_correlation:.3f}"),
        ("largest over smallest deviation of a disturbance", f"{found.deviation_ratio:.1f}"),
        (
            "share of a state's remaining variance that the state before the last explains",
            f"{found.history_information:.2f}",
        ),
    ]


def convergence_history(guidance: Guidance, convergence: Convergence):
    """Histories of the iteration: as in the paper, with both branches in the program, with short end steps."""
    rows = [
        (
            "variant",
            "law",
            "nominal exit apoapsis (r_p)",
            "nominal delta-v (m/s)",
            f"percentile predicted by the program, p_f = {guidance.percentile_tail:g} (m/s)",
            f"flown {100 * LEVEL:g}th percentile (m/s)",
            "lost trials",
            "largest change of the mean control",
            "the iteration has",
        )
    ]
    for number, variant in enumerate(convergence.variant):
        period = int(convergence.period[number])
        outcome = str(convergence.outcome[number])
        ending = {"cycling": f"ended in a cycle of {period}", "stopped": "neither converged nor cycled"}
        for law in range(convergence.apoapsis.shape[1]):
            last = law == convergence.apoapsis.shape[1] - 1
            rows.append(
                (
                    VARIANT_NAMES.get(str(variant), str(variant)),
                    _law(law),
                    _number(convergence.apoapsis[number, law], ".4f"),
                    _number(convergence.nominal_delta_v[number, law], ".2f"),
                    _number(convergence.predicted[number, law], ".2f"),
                    _with_error(
                        convergence.percentile[number, law], convergence.percentile_error[number, law], form=".2f"
                    ),
                    f"{convergence.lost[number, law]:,}",
                    f"{convergence.control_change[number, law]:.4f}",
                    ending.get(outcome, outcome) if last else "",
                )
            )
    return rows


def navigation_errors(studies: Studies, regularization: Regularization):
    """What the navigation errors of the design do to gains, predictions and flights."""
    study, trials = regularization, studies.study_trials
    rows = [
        (
            "factor",
            "position error per interval (m)",
            "condition number",
            "largest gain (1 km, 100 m/s, 0.01 rad)",
            "predicted deviation of delta-v (m/s)",
            "design's deviation (m/s)",
            "flown deviation (m/s)",
            f"{100 * LEVEL:g}th percentile (m/s)",
            "beyond the control limits at the worst step (%)",
            "at any step (%)",
            "lost trials",
            "trials",
        )
    ]
    for k, factor in enumerate(study.factor):
        rows.append(
            (
                f"{factor:g}",
                f"{study.position_error[k]:g}",
                f"{study.condition_number[k]:.2e}",
                f"{study.largest_gain[k]:.3g}",
                f"{study.predicted_deviation[k]:.2f}",
                f"{study.design_deviation[k]:.2f}",
                _number(study.flown_deviation[k], ".1f"),
                _with_error(study.percentile[k], study.percentile_error[k], form=".2f"),
                _share(study.worst_step[k], trials),
                _share(study.saturated[k], trials),
                f"{study.lost[k]:,}",
                f"{trials:,}",
            )
        )
    return rows


def other_fields(air: Air, published, field_study: FieldStudy):
    """Open-loop delta-v in other random fields beside the printed percentile."""
    study, printed = field_study, published["acap_dv_p99_open"].printed
    rows = [
        (
            "field",
            "largest variance",
            "deviation at 45 km (%)",
            f"{100 * LEVEL:g}th percentile (m/s)",
            "share of the printed one",
            "lost trials",
            "trials",
        ),
        ("in the paper", "", "", f"{printed:g}", "1", "", f"{published['acap_dv_p99_open'].trials:,}"),
    ]

    def row(name, variance, low, percentile, error, away):
        rows.append(
            (
                name,
                f"{variance:g}",
                f"{100 * low:.2f}",
                _with_error(percentile, error),
                _number(percentile / printed, ".3f"),
                f"{away:,}",
                f"{study.trials:,}",
            )
        )

    for k, hypothesis in enumerate(study.hypothesis):
        name = str(hypothesis) if k == 0 else f"{hypothesis} (hypothesis)"
        values = study.deviation_at_45_km[k], study.percentile[k], study.percentile_error[k], study.lost[k]
        row(name, air.variance_at_top, *values)
    # The deviation grows with the root of the variance, everywhere.
    own = study.deviation_at_45_km[0] / np.sqrt(air.variance_at_top)
    for k, variance in enumerate(study.variance):
        values = study.variance_percentile[k], study.variance_percentile_error[k], study.variance_lost[k]
        row(f"{variance / air.variance_at_top:g} times the variance", variance, own * np.sqrt(variance), *values)
    return rows


# ---- over all readings -----------------------------------------------------------------------------------------------


def densities(readings: dict[str, tuple[RandomFieldInputs, Records]], published):
    """Readings that differ in the nominal density alone, against the printed numbers that depend on it."""
    reference = readings["corrected"][0]
    chosen = [name for name, (inputs, _) in readings.items() if only_density(inputs, reference)]
    printed = [
        published[name].printed
        for name in ("acap_entry_fpa", "acap_time_max_q", "acap_dv_p99_open", "acap_dv_p99_closed")
    ]
    percentile = f"{100 * LEVEL:g}th percentile"
    rows = [
        (
            "nominal density",
            "entry flight path angle (deg)",
            "less the printed (deg)",
            "time of largest dynamic pressure (s)",
            "less the printed (s)",
            "lowest altitude (km)",
            f"open loop: {percentile} (m/s)",
            "over the printed",
            f"last iteration: {percentile} (m/s)",
            "over the printed (last)",
            f"best iteration: {percentile} (m/s)",
            "trials",
        ),
        (
            "in the paper",
            *(cell for value in printed[:2] for cell in (f"{value:g}", "")),
            "",
            *(cell for value in printed[2:] for cell in (f"{value:g}", "")),
            "",
            f"{published['acap_dv_p99_open'].trials:,}",
        ),
    ]
    values = []
    for name in chosen:
        nominal, ensemble = readings[name][1].nominal, readings[name][1].aerocapture
        found = [delta_v_percentile(ensemble, law, LEVEL) for law in range(len(ensemble.delta_v))]
        best = min((pair for pair in found[1:] if np.isfinite(pair[0])), default=(np.nan, np.nan))
        angle = float(np.degrees(nominal.entry_flight_path_angle))
        time = nominal.time_of_largest_dynamic_pressure
        values.append((angle, time, found[OPEN][0], found[-1][0]))
        rows.append(
            (
                name,
                f"{angle:.4f}",
                f"{angle - printed[0]:+.4f}",
                f"{time:.2f}",
                f"{time - printed[1]:+.2f}",
                f"{nominal.lowest_altitude / 1e3:.2f}",
                _with_error(*found[OPEN]),
                _number(found[OPEN][0] / printed[2], ".3f"),
                _with_error(*found[-1]),
                _number(found[-1][0] / printed[3], ".3f"),
                _with_error(*best),
                f"{ensemble.outcome.shape[1]:,}",
            )
        )
    return [*rows, *_identified(chosen, np.array(values), np.array(printed))]


def _identified(names, values, printed):
    """What the printed numbers say of the density: how far the readings lie apart, and which comes closest."""
    spread, miss = np.ptp(values, axis=0), np.abs(values - printed)
    apart, closest = [], []
    for k, form in enumerate((".4f", ".2f", ".1f", ".1f")):
        known = np.isfinite(miss[:, k])
        best = int(np.argmin(np.where(known, miss[:, k], np.inf)))
        apart += [_number(spread[k], form), ""]
        closest += [f"{names[best]}: {miss[best, k]:{form}}" if known.any() else NO_VALUE, ""]
    return [
        (name, *cells[:4], "", *cells[4:], "", "")
        for name, cells in (("largest less least", apart), ("distance of the closest", closest))
    ]


def only_density(inputs: RandomFieldInputs, reference: RandomFieldInputs):
    """Whether two sets of inputs differ in nothing but the nominal density, and in how many trials are flown."""
    return all(np.array_equal(inputs.get(name), reference.get(name)) for name in inputs.names() if name not in _DENSITY)


def readings(readings: dict[str, tuple[RandomFieldInputs, Records]], published):
    """What each reading gives."""
    percentile = f"{100 * LEVEL:g}th percentile"
    rows = [
        (
            "reading",
            f"open loop: {percentile} (m/s)",
            f"every iteration: {percentile} (m/s)",
            "lost trials of every law",
            "the iteration has",
            "nominal exit apoapsis of every iteration (r_p)",
            "mean control near the peak of dynamic pressure",
            f"last iteration: beyond the control limits at the worst step (%, {100 * CONFIDENCE:g} % interval)",
            "largest gain of the last iteration (1 km, 100 m/s, 0.01 rad)",
            "trials",
        ),
        (
            "in the paper",
            f"{published['acap_dv_p99_open'].printed:g}",
            f"{published['acap_dv_p99_closed'].printed:g} (the last)",
            *[""] * 6,
            f"{published['acap_trials'].printed:,}",
        ),
    ]
    for name, (_, records) in readings.items():
        gains, ensemble, nominal = records.gains, records.aerocapture, records.nominal
        laws = range(len(gains.control))
        found = [_with_error(*delta_v_percentile(ensemble, law, LEVEL), form=".2f") for law in laws]
        trials = ensemble.outcome.shape[1]
        designed = len(laws) > 1
        k = int(np.searchsorted(gains.partition, nominal.time_of_largest_dynamic_pressure)) - 1
        after = gains.control[-1, min(k + 1, len(gains.partition) - 2)]
        by_step, _ = step_violations(ensemble, gains.partition)
        rows.append(
            (
                name,
                found[OPEN],
                ", ".join(found[1:]) if designed else f"no law: {gains.refused}",
                ", ".join(f"{count:,}" for count in lost(ensemble)),
                gains.outcome,
                ", ".join(_number(value, ".3f") for value in gains.apoapsis[1:]) or NO_VALUE,
                f"{_signed(gains.control[-1, k], 3)}, then {_signed(after, 3)}" if designed else NO_VALUE,
                _share(by_step[-1].max(), trials) if designed else NO_VALUE,
                f"{gains.largest_gain[-1]:.3g}" if designed else NO_VALUE,
                f"{trials:,}",
            )
        )
    return rows
