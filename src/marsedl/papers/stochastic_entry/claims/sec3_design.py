"""Sec. III: the design of the law with chance constraints."""

import numpy as np

from marsedl.papers.stochastic_entry.claims.measures import FEASIBLE, Corrections, correlation_of
from marsedl.papers.stochastic_entry.inputs import Design, Guidance
from marsedl.papers.stochastic_entry.records import (
    DENSITY,
    DOWNRANGE,
    FLIGHT_PATH_ANGLE,
    STATES,
    VELOCITY,
    Certificates,
    FlightEnsemble,
    Gains,
    Linearization,
)
from marsedl.replication.claims.counterexamples import scaled, shifted
from marsedl.replication.claims.thresholds import NEARLY_EXACT, NEGLIGIBLE, ROUNDING
from marsedl.replication.claims.writing import Fails, claim, holds, measure, measured


@claim(by_construction="both the trials and the linear model draw the density from this variance")
def initial_density_variance(linearization: Linearization, apollo_time: FlightEnsemble):
    design, entry, trials = linearization.initial_covariance, apollo_time.covariance[0], apollo_time.count
    if trials < 2:
        raise Fails("a variance needs two flights", trials)
    ratio, sampling = entry[DENSITY, DENSITY] / design[DENSITY, DENSITY], np.sqrt(2.0 / (trials - 1))
    return holds(
        measure("relative error of the density's variance at entry", abs(ratio - 1.0), error=sampling) < NEARLY_EXACT,
        trials=trials,
    )


@claim(by_construction="density and state are drawn from streams of their own, and the linear model has zeros there")
def initial_density_uncorrelated(linearization: Linearization, apollo_time: FlightEnsemble):
    design, entry, trials = linearization.initial_covariance, apollo_time.covariance[0], apollo_time.count
    correlations = [abs(correlation_of(entry, state, DENSITY)) for state in (VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE)]
    return holds(
        measure("correlation with the vehicle's state, by magnitude", correlations, error=1 / np.sqrt(trials))
        < NEARLY_EXACT,
        measure("covariance with it in the linear model, by magnitude", np.abs(design[DENSITY, :DENSITY])) <= 0,
        trials=trials,
    )


@claim()
def example_constraint():
    return measured([5.0, 0.01])  # of Sec. III.C, which no result uses


def _optimal(gains, certificates):
    """Tests that the law keeps its limits at the least cost, and that Eq. 55 gives it."""
    excess = np.concatenate([gains.control_ratio.ravel(), gains.final_ratio.ravel()]) - 1.0
    return (
        measure("relative difference of the gains from those of Eq. 55", certificates.weights_gain_error) < ROUNDING,
        measure("excess of a standard deviation over its limit, relative", excess) < FEASIBLE,
        measure("cost above the lower bound, relative", np.abs(gains.gap)) < ROUNDING,
    )


@claim("With the inverse in Eq. 55a.", errata="E3", counterexample=scaled("gains.final_ratio"))
def theorem_lqg(gains: Gains, certificates: Certificates):
    return holds(
        *_optimal(gains, certificates),
        measure("change of the Lagrangian by perturbed gains, relative", certificates.perturbed_cost) > -ROUNDING,
    )


@claim(
    "The paper's search depends on its start: {astray} of {runs} runs go astray.",
    counterexample=scaled("certificates.search_ratio"),
)
def corollary_lqg(gains: Gains, certificates: Certificates):
    # The paper's own route is a search over all weights at once: the best for each trigger that keeps the limits.
    within_limits = certificates.search_worst <= 1.0 + FEASIBLE
    best = np.where(within_limits, certificates.search_ratio, np.inf).min(axis=1)
    astray = int((~within_limits | (certificates.search_ratio > (1.0 + NEARLY_EXACT).at(1.0))).sum())
    cone = np.abs(certificates.cone_ratio - 1.0)
    return holds(
        *_optimal(gains, certificates),
        measure("relative difference of its cost from a cone program's on coarse intervals", cone) < FEASIBLE,
        measure("cost over the optimum by quadratic programming from the best start", best) < 1.0 + NEARLY_EXACT,
        astray=astray,
        runs=within_limits.size,
    )


@claim()
def decision_dimension_gains(gains: Gains):
    return measured(gains.stochastic_gain.shape[-1])


@claim(by_construction="an identity: the formula counts the weights that the design has")
def decision_dimension_weights(gains: Gains):
    intervals = len(gains.partition_start)
    by_formula, count = STATES * (STATES + 1) // 2 + intervals, gains.control_multiplier.shape[1]
    weights = measure("numbers that replace the gains", len(np.triu_indices(STATES)[0]) + count)
    return holds(weights >= by_formula, weights <= by_formula, weights < STATES * intervals)


@claim(
    "Three sigma are {largest:.1f} % of the control limit, with `partition_24` {partition_24.largest:.0f} %.",
    choices="partition",
    counterexample=shifted("gains.stochastic_control_variance"),
)
def lqg_no_feedback_low_q(guidance: Guidance, design: Design, corrections: Corrections):
    thin = corrections.drag < guidance.apollo_least_drag
    thin &= np.arange(len(thin)) < np.argmax(corrections.pressure)
    if not thin.any():
        raise Fails(f"the drag exceeds {guidance.apollo_least_drag:g} m/s^2 from entry on")
    subject = "three sigma of the correction in thin air, in per cent of the control limit"
    share = 100 * corrections.stochastic[:, thin] / design.control_limit
    return holds(measure(subject, share) < 100 * NEGLIGIBLE, largest=share.max())
