"""Sec. V.B.4: the results of aerocapture, Figs. 12 to 17."""

import numpy as np

from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.models import orbits
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field.claims.measures import (
    OPEN,
    ClosedLoop,
    Laws,
    commanded,
    node_deviations,
    node_rows,
    reach_error,
    share_error,
)
from marsedl.papers.random_field.components import DENSITY_VARIATION, DYNAMIC_PRESSURE, FLIGHT_PATH_ANGLE
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.flight_statistics import LEVEL
from marsedl.papers.random_field.inputs import Guidance, Inputs, Vehicle
from marsedl.papers.random_field.records import (
    BRANCHES,
    CAPTURED,
    Nominal,
)
from marsedl.replication.claims.counterexamples import in_reading, replaced, scaled, shifted
from marsedl.replication.claims.thresholds import CLOSE, CONFIDENCE, MUCH, NEGLIGIBLE, SIGMAS, SIMILAR, SMALL, VISIBLE
from marsedl.replication.claims.writing import claim, listed, measure, measured

WIDE = 0.01  # of the largest deviation of a state: where it is less, a ratio of deviations says nothing of the flight

DIGITS = 6  # of a mean control, beyond which the solver decides
NAME = f"{100 * LEVEL:g}th percentile of delta-v"


# ---- delta-v (Fig. 12) -----------------------------------------------------------------------------------------------


@claim(
    "Choices that are not printed decide it, above all the nominal density.",
    errata="E4 E7 E8 E12",
    choices="mean_density percentile_unit navigation_errors navigation_scale entry_angle feedback_reference",
    counterexample=in_reading("doc_fit"),
)
def acap_dv_p99_closed(laws: ClosedLoop):
    gains = laws.gains
    return _percentile(
        laws,
        laws.last,
        # Of the first iteration, whose linearisation is the guess's.
        condition=gains.condition_number[0],
        first_gain=gains.largest_gain[1],
        designed=gains.design_delta_v_deviation[1],
    )


@claim(
    """Other nominal densities give {exponential.value:.0f} to {doc_fit.value:.0f} m/s, with full correlation
    {doc_fit_correlated.value:.0f} m/s.""",
    errata="E1 E2",
    choices="mean_density density_variance density_growth_length",
    counterexample=in_reading("doc_fit_correlated"),
)
def acap_dv_p99_open(laws: Laws):
    return _percentile(laws, OPEN)


def _percentile(laws, law, **numbers):
    """Percentile of a law with its standard error; NaN if it lies among lost trials."""
    evidence = [f"mean {laws.mean[law]:.1f}, deviation {laws.deviation[law]:.1f} m/s of captured flights"]
    if laws.lost[law]:
        evidence.append(f"of {laws.trials:,} trials: {laws.outcomes(law)}")
    if not np.isfinite(laws.percentile[law]):
        evidence.append(f"more than {100 * (1 - LEVEL):g} % are lost, so there is no {100 * LEVEL:g}th percentile")
    return measured(
        laws.percentile[law],
        laws.error[law],
        laws.trials,
        evidence,
        lost_share=laws.lost[law] / laws.trials,
        **numbers,
    )


@claim(
    "Under the last law the mean lies {offset:.0f} m/s above the predicted one.",
    errata="E7",
    choices="entry_angle kink",
    counterexample=in_reading("angle_printed"),
)
def acap_lc_approximates_dv(laws: ClosedLoop):
    return laws.holds(
        measure(
            "largest difference of the distribution functions of delta-v by linear covariance and of the flights",
            laws.distance,
            error=laws.distance_error,
        )
        < SIMILAR,
        f"they are {listed(laws.distance, '.2f')} (open loop first); deviations of the flights are "
        f"{listed(laws.deviation, '.1f')} m/s, predicted {listed(laws.gains.delta_v_deviation, '.1f')} m/s",
        laws.complete,
        offset=laws.offset[laws.last],
    )


@claim(errata="E7", counterexample=shifted("gains.delta_v_mean", at=(OPEN,)))
def acap_lc_useful_surrogate(laws: ClosedLoop):
    # The percentiles are linear covariance's at the level of those of the flights, whatever the program's p_f is.
    gains = laws.gains
    predicted = gains.delta_v_mean + upper_quantile(1.0 - LEVEL) * gains.delta_v_deviation
    promised, achieved = predicted[OPEN] - predicted[1:], laws.percentile[OPEN] - laws.percentile[1:]
    noise = np.hypot(laws.error[1:], laws.error[OPEN])
    return laws.holds(
        measure(f"reduction of the {NAME} from the open loop's in flights", achieved, "m/s", error=noise)
        > (1.0 - MUCH) * promised,
        f"linear covariance promises {listed(promised, '.0f')} m/s, flights keep {listed(achieved, '.0f')} m/s",
        measure(f"least reduction of the {NAME} in flights", achieved, "m/s", error=noise) > 0.0,
        laws.complete,
    )


@claim(
    "It makes {share:.0f} % of the error of the predicted means.",
    errata="E7",
    counterexample=shifted("gains.delta_v_mean"),
)
def acap_abs_value_error_source(given: Inputs, laws: Laws):
    # Errors of the predicted means, as they are and with the predicted branch continued.
    gains, ensemble = laws.gains, laws.ensemble
    smooth = np.full(len(laws.number), np.nan)
    for law in laws.number:
        sign, captured = _branch(given.mission, given.guidance, gains, law), ensemble.outcome[law] == CAPTURED
        if sign is None or not captured.any():
            continue
        ends = ensemble.final_state[law, captured, : FLIGHT_PATH_ANGLE + 1] + [given.planet.planet_radius, 0.0, 0.0]
        values = orbits.total_delta_v(*ends.T, *targets(given.planet, given.mission), branch=sign)
        smooth[law] = values.mean() - gains.delta_v_mean[law]
    share = 100 * (1.0 - np.abs(smooth).sum() / np.abs(laws.offset).sum())
    return laws.holds(
        measure("share of the errors of the predicted means that the absolute value makes, all laws", share, "%")
        > 100 * VISIBLE,
        f"the trials' means lie {listed(laws.offset, '.1f')} m/s above the predicted ones (open loop first), with the "
        f"predicted branch of the clean-up burn continued {listed(smooth, '.1f')} m/s",
        laws.complete,
        share=share,
    )


def _branch(mission, guidance, gains, law):
    """Sign of the clean-up burn in the prediction of a law; None if its nominal was not captured."""
    both = guidance.clean_up_branch == "both"
    # A program with both branches predicts the one on which its own mean ends, others that of their nominal.
    apoapsis = gains.apoapsis[law if both else max(law - 1, OPEN)]
    if not np.isfinite(apoapsis):
        return None
    sign = int(orbits.branch_of(apoapsis, mission.target_apoapsis, guidance.branch_tolerance))
    return sign or (0 if both else BRANCHES[guidance.clean_up_branch])


@claim(
    "Here the other two iterations fit worse.",
    errata="E7",
    choices="entry_angle kink",
    counterexample=in_reading("both_branches"),
)
def acap_lc_mismatch_iteration_2(laws: ClosedLoop):
    second = min(2, laws.last)
    return laws.holds(
        measure(
            f"largest difference of the distribution functions of delta-v in iteration {second}",
            laws.distance[second],
            error=laws.distance_error,
        )
        > SIMILAR,
        f"of all laws {listed(laws.distance, '.2f')} (open loop first)",
        laws.complete,
    )


@claim(
    "They give {iteration_1:.1f}, {iteration_2:.1f} and {iteration_3:.1f} m/s.",
    errata="E7 E12",
    choices="entry_angle feedback_reference kink",
    counterexample=in_reading("angle_printed"),
)
def acap_p99_decreases_each_iteration(laws: ClosedLoop):
    change = np.diff(laws.percentile)
    noise = np.hypot(laws.error[1:], laws.error[:-1])
    return laws.holds(
        measure(f"change of the {NAME} from iteration to iteration", change, "m/s", error=noise) < 0.0,
        f"of the open loop and of every iteration it is {laws.percentiles()} m/s, the nominal apoapsis "
        f"{listed(laws.gains.apoapsis)} r_p",
        laws.complete,
        **{f"iteration_{law}": laws.percentile[min(law, laws.last)] for law in (1, 2, 3)},
    )


# ---- control (Fig. 13) -----------------------------------------------------------------------------------------------


@claim(name="acap_lift_up_early", late=False, counterexample=shifted("gains.control", at=(1, slice(0, 4))))
@claim(name="acap_lift_down_late", late=True, counterexample=shifted("gains.control", at=(2, slice(6, None))))
def mean_control_moves(nominal: Nominal, laws: ClosedLoop, *, late):
    # Mean control before or after the peak of dynamic pressure, by duration.
    begins, ends, peak = laws.gains.partition[:-1], laws.gains.partition[1:], nominal.time_of_largest_dynamic_pressure
    part = begins >= peak if late else ends <= peak
    duration, control = (ends - begins)[part], laws.gains.control
    course = control[:, part] @ duration / duration.sum() if part.any() else np.full(len(control), np.nan)
    when = "after" if late else "before"
    subject = f"change of the mean control {when} the peak of dynamic pressure at {peak:.1f} s, from law to law"
    change = measure(subject, np.diff(course.round(DIGITS)))
    return laws.holds(change < 0.0 if late else change > 0.0, f"it is {listed(course)} (guess first)")


def _at_peak(nominal, laws):
    """The interval in which the dynamic pressure of the nominal peaks."""
    nodes = laws.gains.partition
    return min(int(np.searchsorted(nodes, nominal.time_of_largest_dynamic_pressure)), len(nodes) - 1) - 1


@claim(
    "It is {lift:+.3f}, in the next interval {after:+.3f}; another density gives {doc_fit.lift:+.2f}.",
    errata="E4 E6",
    choices="percentile_unit mean_density density_variance density_growth_length",
    counterexample=scaled("gains.control", at=(-1, 4)),
)
def acap_zero_lift_at_max_q(nominal: Nominal, laws: ClosedLoop):
    control, nodes = laws.gains.control[laws.last], laws.gains.partition
    k = _at_peak(nominal, laws)
    after = control[min(k + 1, len(control) - 1)]
    span = f"from {nodes[k]:g} to {nodes[k + 1]:g} s, where the dynamic pressure peaks"
    return laws.holds(
        measure(f"mean control {span}, by magnitude", abs(control[k])) < NEGLIGIBLE,
        f"it is {control[k]:+.3f}, in the next interval {after:+.3f}",
        laws.complete,
        lift=round(float(control[k]), 4) + 0.0,
        after=round(float(after), 4) + 0.0,
    )


@claim(errata="E6", choices="percentile_unit", counterexample=scaled("gains.control_deviation", at=(-1, slice(4, 6))))
def acap_control_variance_high_at_max_q(nominal: Nominal, laws: ClosedLoop):
    # In the interval of the peak and its neighbours, against all others.
    deviation, nodes, k = laws.gains.control_deviation[laws.last], laws.gains.partition, _at_peak(nominal, laws)
    near = np.arange(max(k - 1, 0), min(k + 2, len(deviation)))
    widest = near[np.argmax(deviation[near])]
    elsewhere = np.delete(deviation, near).max(initial=0.0)
    span = f"from {nodes[widest]:g} to {nodes[widest + 1]:g} s, beside or at the peak"
    return laws.holds(
        measure(f"predicted three sigma of the control {span}", SIGMAS * deviation[widest]) > SIGMAS * elsewhere,
        measure("magnitude of the mean control there", abs(laws.gains.control[laws.last, widest])) < NEGLIGIBLE,
        laws.complete,
    )


@claim(
    "At the worst interval {worst:.2f} % leave the bounds; Eq. 77 allots {allotted:.2f} %.",
    errata="E6 E16",
    choices="percentile_unit navigation_errors navigation_scale",
    counterexample=scaled("aerocapture.histogram", at=(-1, slice(None), 0, 0)),
)
def acap_control_within_bounds(guidance: Guidance, laws: ClosedLoop):
    nodes, counts = laws.gains.partition, laws.violations[laws.last]
    worst = int(np.argmax(counts))
    flight_count = int(laws.ensemble.count[laws.last] + laws.ensemble.excluded[laws.last])  # all in the counts
    allotted = 1.0 - guidance.control_probability
    low, high = (100 * float(bound) for bound in binomial_interval(int(counts[worst]), flight_count, CONFIDENCE))
    share, noise = 100 * counts / flight_count, 100 * share_error(counts, flight_count)
    span = f"from {nodes[worst]:g} to {nodes[worst + 1]:g} s"
    return laws.holds(
        # Eq. 77 says what is unlikely.
        measure("share of commands beyond the limits in an interval", share, "%", error=noise) <= 100 * allotted,
        f"{span} {counts[worst]:,} of {flight_count:,} flights ({low:.3f} to {high:.3f} % with "
        f"{100 * CONFIDENCE:g} % confidence)",
        laws.complete,
        worst=share[worst],
        allotted=100 * allotted,
    )


@claim(
    "This is the control before it is cut off.",
    errata="E18",
    counterexample=scaled("aerocapture.covariance", component="bank_cosine"),
)
def acap_mc_three_sigma_slightly_outside(vehicle: Vehicle, laws: ClosedLoop):
    mean, spread = commanded(laws.gains, laws.ensemble, laws.last)
    nodes, (lower, upper) = laws.gains.partition, vehicle.control_limits
    outside = np.maximum(mean + SIGMAS * spread - upper, lower - mean + SIGMAS * spread)
    furthest = int(np.argmax(outside))
    error = reach_error(laws.ensemble, laws.last, node_rows(laws.ensemble, nodes[[furthest]])[0])
    span = f"from {nodes[furthest]:g} to {nodes[furthest + 1]:g} s"
    reach = measure(
        f"excess of mean and three sigma of the command over a limit, {span}", outside[furthest], error=error
    )
    return laws.holds(
        reach > 0.0,
        reach < SMALL * upper,
        f"in {(outside > 0.0).sum()} of {len(outside)} intervals they lie beyond",
        laws.complete,
    )


@claim(counterexample=replaced("aerocapture.observed_maximum", -1.0))
def acap_control_saturated(laws: ClosedLoop, published):
    # Flights always fly the limit where they command more. Whether the paper's would do so at all can be otherwise.
    flown = published["acap_trials"].printed
    beyond = np.fmax.reduce(laws.ensemble.observed_maximum[laws.last, :, 1])
    count = laws.any_violations[laws.last]
    share, noise = 100 * count / laws.trials, 100 * share_error(count, laws.trials)
    return laws.holds(
        measure("share of the flights that command beyond the limits in some interval", share, "%", error=noise)
        > 100 / flown,
        f"the limit is one of the paper's {flown:,} flights; these fly at most {beyond:.3g} less than their command",
    )


# ---- linear covariance against flights (Figs. 12 and 14 to 17) -------------------------------------------------------


def state_error(gains, ensemble, law) -> float:
    """Root mean square relative error of the predicted deviations over nodes after the first and states.

    Without those at which a state deviates next to nothing; NaN if there are no others, as where all flights are lost.
    """
    sampled, predicted = (values[1:] for values in node_deviations(gains, ensemble, law))
    wide = sampled > WIDE * sampled.max(axis=0)
    ratio = np.divide(predicted, sampled, out=np.full_like(sampled, np.nan), where=wide)
    return float(np.sqrt(np.nanmean((ratio - 1.0) ** 2))) if wide.any() else np.nan


@claim(errata="E12", choices="feedback_reference", counterexample=scaled("gains.covariance", at=(OPEN,)))
def acap_lc_better_for_guess_state(laws: ClosedLoop):
    guess, best = (state_error(laws.gains, laws.ensemble, law) for law in (OPEN, laws.last))
    # As if all deviations were one, which they nearly are: they are strongly correlated.
    sampling = np.sqrt(2.0) / np.sqrt(2.0 * laws.trials)
    return laws.holds(
        measure(
            "root mean square error of the predicted deviations of the states, last iteration less guess",
            100 * (best - guess),
            "%",
            error=100 * sampling,
        )
        > 0.0,
        f"for the last iteration {100 * best:.1f} %, for the guess {100 * guess:.1f} %",
        laws.complete,
    )


@claim(
    "Distribution functions are compared, as deviations depend on the side taken (E7).",
    errata="E7",
    choices="kink entry_angle",
    counterexample=in_reading("angle_printed"),
)
def acap_lc_better_for_guess_dv(laws: ClosedLoop):
    return laws.holds(
        measure(
            "difference of the distribution functions of delta-v in the last iteration less that for the guess",
            laws.distance[laws.last] - laws.distance[OPEN],
            error=np.sqrt(2.0) * laws.distance_error,
        )
        > 0.0,
        f"they are {laws.distance[laws.last]:.2f} and {laws.distance[OPEN]:.2f}",
        laws.complete,
        guess_predicted=laws.gains.delta_v_deviation[OPEN],
    )


@claim(
    errata="E17",
    choices="dynamic_pressure_density",
    counterexample=shifted("aerocapture.covariance", at=(-1, slice(None), DYNAMIC_PRESSURE, DYNAMIC_PRESSURE)),
)
def acap_q_deviation_grows(laws: ClosedLoop):
    variance = laws.ensemble.covariance[[OPEN, laws.last], :, DYNAMIC_PRESSURE, DYNAMIC_PRESSURE]
    without, closed = np.sqrt(np.maximum(variance.mean(axis=1), 0.0))
    # As if the deviations of all times were one, which makes the error largest.
    noise = np.hypot(without, closed) / np.sqrt(2.0 * laws.trials)
    subject = "deviation of the dynamic pressure with feedback less that without, root mean square over time"
    return laws.holds(
        measure(subject, closed - without, "Pa", error=noise) > 0.0,
        f"it is {closed:.1f} and {without:.1f} Pa",
        laws.complete,
    )


@claim(
    "The two are at most {most:.1f} % apart.",
    counterexample=scaled("gains.variation_deviation", at=(-1,)),
)
def acap_density_lc_agrees(laws: ClosedLoop):
    variance = laws.ensemble.covariance[laws.last, :, DENSITY_VARIATION, DENSITY_VARIATION]
    ratio = laws.gains.variation_deviation[laws.last] / np.sqrt(variance)
    departure = np.abs(ratio - 1.0)
    return laws.holds(
        measure(
            "departure from 1 of the deviation of the density variation along the nominal over that met in flight",
            departure,
            error=1.0 / np.sqrt(2.0 * laws.trials),
        )
        < CLOSE,
        f"from {ratio.min():.3f} to {ratio.max():.3f}, furthest off at {laws.gains.time[np.argmax(departure)]:g} s",
        laws.complete,
        most=100 * departure.max(),
    )
