"""Iterations, spread of the states, violations, the double integrator, and the studies."""

import numpy as np

from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field.claims.measures import OPEN, node_deviations, normal_violation
from marsedl.papers.random_field.components import FLOORED
from marsedl.papers.random_field.double_integrator import normals_and_bounds, tail
from marsedl.papers.random_field.flight_statistics import LEVEL, delta_v_percentile, lost, step_violations
from marsedl.papers.random_field.inputs import Guidance, PointMass, Vehicle
from marsedl.papers.random_field.records import (
    CLOSED,
    Certificates,
    Convergence,
    DoubleIntegrator,
    DoubleIntegratorFlights,
    FlightEnsemble,
    Gains,
)
from marsedl.replication.claims.thresholds import CONFIDENCE
from marsedl.replication.records.tables import Column, described, frame, table

PERCENTILE = f"{100 * LEVEL:g}th percentile"
GAIN = Column("", ".3g", "in units of 1 km, 100 m/s, 0.01 rad")
APOAPSIS = Column("planet radii", ".3f", "of the nominal, after the exit")
LOST = Column(meaning="that are not captured")
STATES = (("r", 1e-3, "km"), ("v", 1.0, "m/s"), ("gamma", 180.0 / np.pi, "deg"))


def _share(count, trials):
    """A share of the trials in per cent, and the bounds of its interval of confidence."""
    return 100 * count / trials, *(100 * bound for bound in binomial_interval(count, trials, CONFIDENCE))


def _share_columns(name, digits=".2f", meaning="share of the trials"):
    """The columns of `_share`."""
    bounds = f"{name}: lower bound", f"{name}: upper bound"
    sure = f"of the exact binomial interval of {100 * CONFIDENCE:g} %"
    return {name: Column("%", digits, meaning, interval=bounds), **dict.fromkeys(bounds, Column("%", "", sure))}


def _with_error(name, digits, meaning):
    """The columns of a delta-v and of its standard error."""
    error = f"{name}: standard error"
    return {name: Column("m/s", digits, meaning, error=error), error: Column("m/s")}


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
    rows = []
    for law in range(last + 1):
        delta_v = aerocapture.delta_v[law]
        captured = delta_v[np.isfinite(delta_v)]
        has_spread = len(captured) > 1
        rows.append(
            (
                _law(law),
                gains.delta_v_mean[law],
                gains.delta_v_deviation[law],
                gains.design_delta_v_deviation[law],
                printed.get(law),
                *delta_v_percentile(aerocapture, law, LEVEL),
                *((np.median(captured), captured.mean(), captured.std(ddof=1)) if has_spread else (None,) * 3),
                away[law],
                (aerocapture.final_state[law, :, FLOORED] > 0).sum(),
                *_share(by_step[law].max(), trials),
                *_share(at_any[law], trials),
                100 * (1.0 - guidance.control_probability),
                gains.apoapsis[law],
                gains.largest_gain[law],
                trials,
            )
        )
    return table(
        rows,
        {
            "law": Column(),
            "predicted mean": Column("m/s", ".1f", "of delta-v, by linear covariance"),
            "predicted deviation": Column("m/s", ".2f", "of delta-v, by linear covariance"),
            "design's deviation": Column("m/s", ".2f", "the same with the design's navigation errors"),
            f"{PERCENTILE} in the paper": Column("m/s", "g", "of delta-v"),
            **_with_error(PERCENTILE, ".2f", "of delta-v; lost trials count as worse than any other"),
            "median": Column("m/s", ".1f", "of delta-v, captured trials"),
            "mean": Column("m/s", ".1f", "of delta-v, captured trials"),
            "deviation": Column("m/s", ".1f", "of delta-v, captured trials"),
            "lost trials": LOST,
            "trials at the density's floor": Column(),
            **_share_columns("beyond the control limits at the worst step"),
            **_share_columns("beyond the control limits at any step"),
            "allotted per step": Column("%", ".2f", "share beyond the control limits by Eq. 77"),
            "apoapsis": APOAPSIS,
            "largest gain": GAIN,
            "trials": Column(),
        },
    )


def state_deviations(gains: Gains, aerocapture: FlightEnsemble):
    """Standard deviations of the states at the nodes, flown and predicted, of the open loop and the last law."""
    rows = []
    for law in dict.fromkeys((OPEN, len(gains.control) - 1)):
        both = node_deviations(gains, aerocapture, law)
        for node in range(1, len(gains.partition)):
            cells = []
            for state, (_, factor, _) in enumerate(STATES):
                sampled, predicted = (values[node, state] * factor for values in both)
                cells += [sampled, predicted, predicted / sampled if sampled > 0.0 else None]
            rows.append((_law(law), gains.partition[node], *cells))
    columns = {"law": Column(), "t": Column("s", "g", "from the start")}
    for name, _, unit in STATES:
        columns |= {
            f"{name} flown": Column(unit, ".4g", "standard deviation over the trials"),
            f"{name} predicted": Column(unit, ".4g", "standard deviation by linear covariance"),
            f"{name} ratio": Column("", ".3f", "predicted over flown"),
        }
    return table(rows, columns)


def control_violations(vehicle: Vehicle, guidance: Guidance, gains: Gains, aerocapture: FlightEnsemble):
    """Probability that the command leaves its limits: allotted, predicted and flown, per law and interval."""
    trials = aerocapture.outcome.shape[1]
    by_step, _ = step_violations(aerocapture, gains.partition)
    allotted = 1.0 - guidance.control_probability
    rows = []
    # Without feedback there is nothing to tell, unless there is nothing else.
    for law in range(min(1, len(gains.control) - 1), len(gains.control)):
        for k in range(len(gains.partition) - 1):
            mean, deviations = gains.control[law, k], (gains.control_deviation, gains.design_control_deviation)
            predicted = [float(normal_violation(mean, values[law, k], vehicle.control_limits)) for values in deviations]
            rows.append(
                (
                    _law(law),
                    gains.partition[k],
                    gains.partition[k + 1],
                    mean,
                    *(values[law, k] for values in deviations),
                    100 * allotted,
                    *(100 * value for value in predicted),
                    *_share(by_step[law, k], trials),
                    _against(*binomial_interval(by_step[law, k], trials, CONFIDENCE), allotted),
                    trials,
                )
            )
    return table(
        rows,
        {
            "law": Column(),
            "from": Column("s", "g"),
            "to": Column("s", "g"),
            "mean control": Column("", "+z.3f"),
            "predicted deviation": Column("", ".3g", "of the control, by linear covariance"),
            "design's deviation": Column("", ".3g", "the same with the design's navigation errors"),
            "allotted": Column("%", ".2f", "share beyond the limits by Eq. 77"),
            "predicted": Column("%", ".4f", "share beyond the limits by linear covariance"),
            "predicted by the design": Column("%", ".4f", "the same with the design's navigation errors"),
            **_share_columns("flown", ".3f", "share of the trials beyond the limits"),
            "against what is allotted": Column(meaning="more, less, or not told apart by the interval"),
            "trials": Column(),
        },
    )


def _against(low, high, allotted):
    if low > allotted:
        return "more"
    return "less" if high < allotted else "not told apart"


# ---- double integrator -----------------------------------------------------------------------------------------------


def double_integrator(double_integrator: DoubleIntegrator, double_integrator_flights: DoubleIntegratorFlights):
    """Spread of both states at the nodes, flown and predicted, how far the ellipses reach, and the control."""
    design, flights = double_integrator, double_integrator_flights
    sampled = np.sqrt(np.diagonal(flights.covariance[:, flights.node], axis1=2, axis2=3)[..., :2])
    predicted = np.sqrt(np.diagonal(design.covariance, axis1=2, axis2=3))
    # The last node has no control.
    controls = [
        np.append(values, np.full((2, 1), np.nan), axis=1) for values in (design.control, design.control_deviation)
    ]
    rows = []
    for law, name in ((OPEN, "open loop"), (CLOSED, "feedback")):
        for node, time in enumerate(design.partition):
            rows.append(
                (
                    name,
                    time,
                    *(values[law, node, state] for state in range(2) for values in (sampled, predicted)),
                    *design.support[law, node],
                    *(values[law, node] for values in controls),
                )
            )
    reach = "largest a'x over the ellipse less its bound: above zero it protrudes"
    return table(
        rows,
        {
            "law": Column(),
            "t": Column("", "g"),
            **{
                f"deviation of {state}, {how}": Column("", ".6f", f"standard deviation {of}")
                for state in ("r", "v")
                for how, of in (("flown", "over the trials"), ("predicted", "by linear covariance"))
            },
            **{f"ellipse beyond line {line}": Column("", "+.4f", reach) for line in (1, 2)},
            "mean control": Column("", "+z.6f", "from this node to the next"),
            "deviation of the control": Column("", ".4e", "from this node to the next, by linear covariance"),
        },
    )


def double_integrator_cost(point_mass: PointMass, double_integrator: DoubleIntegrator):
    """What the state constraints of the double integrator cost."""
    design, bound = double_integrator, np.array(point_mass.double_integrator_final_three_sigma) / 3.0
    cost = design.objective, design.unconstrained_objective
    return table(
        [(*bound, *cost, cost[0] / cost[1], design.status)],
        {
            "bound of the final deviation of r": Column("", ".6f"),
            "bound of the final deviation of v": Column("", ".6f"),
            "cost": Column("", ".5e"),
            "cost without state constraints": Column("", ".5e"),
            "factor that the state constraints cost": Column("", ".3f"),
            "solver": Column(meaning="its status"),
        },
    )


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
    beyond_line = ndtr((design.mean @ normals.T - bounds) / spread)
    allotted = tail(point_mass), 1.0 - point_mass.double_integrator_probability
    first, last, rows = flights.paper_trials, len(design.partition) - 1, []
    for law, name in ((OPEN, "open loop"), (CLOSED, "feedback")):
        trials = int(flights.count[law] + flights.excluded[law])
        paper = np.column_stack([flights.paper_violations[law], flights.paper_any_violations[law]])
        whole = np.column_stack([flights.violations[law], flights.any_violations[law]])
        # Both lines are never crossed at once but at their apex, which is left out of the prediction.
        predicted = np.column_stack([beyond_line[law], beyond_line[law].sum(axis=1)])
        for node, time in enumerate(design.partition):
            is_constrained = law == CLOSED and (point_mass.double_integrator_constrained == "all" or node < last)
            for column, beyond in enumerate(("line 1", "line 2", "either line")):
                limit = allotted[column // 2]
                rows.append(
                    (
                        name,
                        time,
                        beyond,
                        is_constrained,
                        100 * limit,
                        100 * min(predicted[node, column], 1.0),
                        *_share(paper[node, column], first),
                        first,
                        *_share(whole[node, column], trials),
                        _against(*binomial_interval(whole[node, column], trials, CONFIDENCE), limit),
                        trials,
                    )
                )
    return table(
        rows,
        {
            "law": Column(),
            "t": Column("", "g"),
            "beyond": Column(),
            "constrained": Column(meaning="whether the law's program holds this node"),
            "allotted": Column("%", ".3f"),
            "predicted": Column("%", ".3f", "by linear covariance"),
            **_share_columns("first trials", ".3f", "share of as many trials as the paper flies"),
            "number of the first trials": Column(),
            **_share_columns("all trials", ".3f"),
            "all trials against what is allotted": Column(meaning="more, less, or not told apart by the interval"),
            "trials": Column(),
        },
    )


# ---- studies ---------------------------------------------------------------------------------------------------------


def certificates(certificates: Certificates):
    """The first program against other formulations and another solver, and its disturbances against samples."""

    def apart(other):
        objective = certificates.objective
        return abs(other - objective) / max(abs(other), abs(objective))

    checks = frame(
        certificates,
        objective=Column(digits=".10f", label="least cost of the first program"),
        history_gain_difference=Column(digits=".1e", label="history form: largest difference of a gain"),
        identity_residual=Column(digits=".1e", label="identity residual of (I + B L)(I - B K)"),
        triangular_residual=Column(digits=".1e", label="K and L above their block diagonals"),
        control_covariance_residual=Column(digits=".1e", label="Cov(U) from the gains against the innovations"),
        mean_shift=Column(digits=".1e", label="change of the deviations with the mean control"),
        gain_shift=Column(digits=".1e", label="change of the mean with the gains"),
        convexity=Column(digits="+.1e", label="least excess of chords over the cost"),
        samples=Column(label="sampled fields"),
        process_score=Column(digits=".1f", label="covariance along the nominal, in standard errors"),
        disturbance_score=Column(digits=".1f", label="covariance of the disturbances, in standard errors"),
        normality_score=Column(digits=".1f", label="normality of the disturbances, in standard errors"),
        largest_correlation=Column(digits=".3f", label="largest correlation of disturbances"),
        deviation_ratio=Column(digits=".1f", label="largest over smallest deviation of a disturbance"),
        history_information=Column(digits=".2f", label="share that the earlier states explain"),
        other_solver=Column(label="other solver"),
    )
    differences = {
        "history form: difference of the cost": [apart(certificates.history_objective)],
        "other solver: difference of the cost": [apart(certificates.other_objective)],
    }
    relative = dict.fromkeys(differences, Column("", ".1e", "relative"))
    return table({**checks, **differences}, described(checks) | relative)


def convergence_history(guidance: Guidance, convergence: Convergence):
    """Histories of the iteration: as designed, and with short end steps."""
    variants = [str(variant).replace("_", " ") for variant in convergence.variant]
    return frame(
        convergence,
        coordinates={
            "variant": ("variant", variants),
            "laws": ("law", [_law(law) for law in range(convergence.apoapsis.shape[1])]),
        },
        apoapsis=Column("planet radii", ".4f"),
        nominal_delta_v=".2f",
        predicted=Column(
            digits=".2f",
            label="predicted percentile",
            meaning=f"by the program, at the tail p_f = {guidance.percentile_tail:g}",
        ),
        percentile=Column(digits=".2f", label=f"flown {PERCENTILE}", error="percentile_error"),
        percentile_error="",
        lost=Column(label="lost trials"),
        control_change=Column(digits=".4f", label="largest change of the mean control"),
        outcome=Column(label="end of the iteration", meaning="converged, cycling, or stopped without either"),
        period=Column(label="period of the cycle"),
    )
