"""Sec. V.A: both laws with the fixed final time, Figs. 8 and 9."""

import numpy as np

from marsedl.methods.covariance_steering.chance import chance_factor
from marsedl.papers.stochastic_entry.claims.measures import (
    DEADBAND,
    FEASIBLE,
    HISTORY,
    LAW_NAMES,
    LAWS,
    Corrections,
    Dispersions,
    Flights,
    crossrange_interval,
    distance,
    dynamic_pressure,
    finite_count,
)
from marsedl.papers.stochastic_entry.inputs import Design
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    CROSSRANGE,
    DOWNRANGE,
    FLIGHT_PATH_ANGLE,
    STATES,
    TRIGGERS,
    Gains,
    Linearization,
    Nominal,
    Tradeoff,
)
from marsedl.replication.claims.claim import Tolerance
from marsedl.replication.claims.counterexamples import in_reading, scaled, shifted, spread
from marsedl.replication.claims.thresholds import (
    CLOSE,
    MOST,
    MUCH,
    NEARLY_EXACT,
    NEGLIGIBLE,
    ROUNDING,
    SIGMAS,
    SIMILAR,
    VISIBLE,
)
from marsedl.replication.claims.writing import Fails, check, claim, holds, measure, measured, whichever

SILENT_TIME = 15.0  # s, "immediately" after entry
HALF_PEAK = 0.5  # of the dynamic pressure: while it is higher, its "increase" has taken place
WIDTH_98 = 2 * 2.326  # from the 1st to the 99th percentile of a normal distribution, in standard deviations


@claim(by_construction="an identity of the normal distribution")
def chance_sigmas(design: Design):
    return measured(float(chance_factor(design.chance_level)))


@claim(name="altitude_direction", state=ALTITUDE)
@claim(name="gamma_direction", state=FLIGHT_PATH_ANGLE)
def direction(*, state):
    return measured(np.eye(STATES)[state])


@claim(
    "It costs next to nothing: its multiplier is {multiplier:.1g}, with `partition_24` {partition_24.multiplier:.2g}.",
    errata="E12",
    choices="partition",
    counterexample=scaled("gains.stochastic_covariance", at=(0, -1, ALTITUDE, ALTITUDE)),
)
def fig9_altitude_active(design: Design, gains: Gains):
    altitude = SIGMAS * np.sqrt(gains.stochastic_covariance[0, -1, ALTITUDE, ALTITUDE])
    short = 100 * abs(1.0 - altitude / design.altitude_limit)
    return holds(
        measure("distance of three sigma of the final altitude from the limit", short, "%") < 100 * NEARLY_EXACT,
        f"they are {altitude / 1e3:.4f} km",
        three_sigma=altitude / 1e3,
        multiplier=gains.final_multiplier[0, 0],
    )


@claim(
    "Noise alone makes the {at_limit:.0f} m at the printed limit: nothing is left to trade.",
    errata="E12",
    choices="partition",
    counterexample=scaled("tradeoff.deviation", at=(0, -1)),
)
def fig9_altitude_range_tradeoff(design: Design, tradeoff: Tradeoff):
    # At the design of the paper: whether a larger limit of the altitude than the printed one still buys range.
    beyond = np.flatnonzero(tradeoff.altitude_limit >= design.altitude_limit * (1.0 - ROUNDING))
    if len(beyond) < 2:
        raise Fails("the study has no altitude limit beyond that of the design")
    at, largest = beyond[[0, -1]]
    fine, coarse = tradeoff.deviation
    limits = [f"{tradeoff.altitude_limit[k] / 1e3:g}" for k in (at, largest)]
    if not np.isfinite(fine[[at, largest]]).all():
        raise Fails(f"altitude limits of {' and '.join(limits)} km cannot both be kept")
    subject = f"relative change of the range deviation from an altitude limit of {limits[0]} km to {limits[1]} km"
    return holds(
        whichever(
            *(
                measure(f"{subject}, control intervals of {seconds:g} s", of[largest] / of[at] - 1.0) < -ROUNDING
                for of, seconds in zip(tradeoff.deviation, tradeoff.control_interval, strict=True)
            )
        ),
        f"noise alone makes {tradeoff.noise_deviation:.1f} m",
        at_limit=fine[at],
        coarse_interval=tradeoff.control_interval[1],
        three_sigma=SIGMAS * np.array([fine[at], coarse[at]]) / 1e3,
    )


@claim(
    "As flown, against velocity, they are {distance:.0f} % apart, with gains against time {timed:.0f} %.",
    errata="E14 E15",
    choices="apollo_covariance apollo_time_adjoint",
    counterexample=scaled("gains.apollo_control_variance", at=1),
)
def fig8_apollo_similar(corrections: Corrections):
    apart = distance(corrections.apollo)
    subject = "mean distance of Apollo's two bounds in per cent of their mean over the range control"
    return holds(
        measure(subject, apart, "%") < 100 * SIMILAR,
        distance=distance(corrections.effective),
        timed=distance(corrections.timed),
    )


@claim(counterexample=scaled("gains.stochastic_control_variance", at=1))
def fig8_stochastic_differs(corrections: Corrections):
    subject = "mean distance of the two stochastic bounds in per cent of their mean over the range control"
    # "Different", beside "similar" in the same sentence: by the same measure, not similar.
    return holds(measure(subject, distance(corrections.stochastic), "%") > 100 * SIMILAR)


@claim()
def fig8_stochastic_inside(gains: Gains, corrections: Corrections):
    reach, is_kept = corrections.reach(corrections.stochastic), gains.control_ratio.max() < 1.0 + FEASIBLE
    return holds(
        measure("nominal cosine plus three sigma", reach) < 1.0 + FEASIBLE,
        by_construction="the chance constraint of the design enforces it" if is_kept else "",
    )


@claim(counterexample=scaled("gains.apollo_control_variance"))
def fig8_apollo_leaves(corrections: Corrections):
    outside = np.abs(corrections.cosine) + corrections.apollo[0] > 1.0
    share = 100 * outside.sum() / len(corrections.time)
    subject = "share of the range control in which nominal cosine plus three sigma exceed 1"
    return holds(measure(subject, share, "%") > 100 * VISIBLE)


@claim(
    "With `partition_24` three sigma are {partition_24.early:.2f} from entry on.",
    errata="E12",
    choices="partition",
    counterexample=shifted("gains.stochastic_control_variance"),
)
def fig8_silent_after_ei(design: Design, corrections: Corrections):
    early = corrections.stochastic[:, corrections.time < SILENT_TIME].max()
    subject = f"largest three sigma of the correction in the first {SILENT_TIME:g} s, in per cent of the control limit"
    return holds(measure(subject, 100 * early / design.control_limit, "%") < 100 * NEGLIGIBLE, early=early)


@claim(
    """For the trigger it is {peak_share_velocity:.0f} % of the time, with `timed_covariance`
    {timed_covariance.peak_share_velocity:.0f} %.""",
    errata="E14 E15",
    choices="apollo_covariance mean_density",
    counterexample=in_reading("timed_covariance"),
)
def fig8_more_aggressive(corrections: Corrections):
    high = corrections.pressure > HALF_PEAK * corrections.pressure.max()
    stronger = 100 * (corrections.stochastic[:, high] > corrections.apollo[0, high]).mean(axis=1)
    subject = "share of the time near the peak of dynamic pressure with stochastic bounds above Apollo's"
    return holds(measure(subject, stronger, "%") > 50, peak_share_velocity=stronger[1])


@claim(counterexample=scaled("stochastic_time.covariance"))
def fig9_large_deviations(
    nominal: Nominal, linearization: Linearization, gains: Gains, flights: Flights, dispersions: Dispersions
):
    after_peak = np.arange(len(gains.time)) >= np.argmax(dynamic_pressure(linearization))
    after_peak &= gains.time < nominal.alignment_time
    apollo, stochastic = (
        np.sqrt((dispersions[law].sampled[after_peak][:, [ALTITUDE, FLIGHT_PATH_ANGLE]] ** 2).mean(axis=0))
        for law in LAWS
    )
    ratio = apollo / stochastic
    subject = "Apollo's deviations of altitude and path angle from peak dynamic pressure to heading alignment"
    return holds(
        # Compared with the other law's in the same figure.
        measure(
            f"{subject} over the stochastic law's",
            ratio,
            error=ratio * np.sqrt(2) * dispersions["stochastic"].relative_error,
        )
        <= MUCH,
        *flights.lost("stochastic_time"),
        trials=flights["stochastic_time"].count,
    )


@claim(
    "The linear bound is largest at {value:.0f} s, that of the flights at {of_trials:.0f} s.",
    choices=f"mean_density {DEADBAND}",
    close=Tolerance(reason="the text says around, of a flat maximum in a figure", absolute=10.0),
    counterexample=scaled("gains.stochastic_covariance", at=(0, slice(150, None), DOWNRANGE, DOWNRANGE)),
)
def fig9_range_error_turns(gains: Gains, flights: Flights, dispersions: Dispersions):
    time, stochastic = gains.time, dispersions["stochastic"]
    in_flight = time[np.argmax(stochastic.sampled[:, DOWNRANGE])]
    return measured(
        float(time[np.argmax(stochastic.predicted[:, DOWNRANGE])]),
        evidence=flights.lost("stochastic_time"),
        of_trials=in_flight,
    )


@claim(counterexample=scaled("gains.stochastic_covariance"))
def fig9_lc_close(flights: Flights, dispersions: Dispersions):
    # "Most" of the curves: so many of the closest that the rest is at most that share.
    most = int(np.ceil(len(HISTORY) * (1.0 - MOST).at(1.0)))
    within = [100 * np.sort(dispersions[law].apart)[most - 1] for law in LAWS]
    subject = f"distance within which {most} of {len(HISTORY)} curves of a law are, of the largest bound"
    sampling = 100 * max(dispersions[law].relative_error for law in LAWS)
    return holds(
        measure(subject, within, "%", error=sampling) < 100 * CLOSE,
        *flights.lost("stochastic_time"),
        trials=flights["stochastic_time"].count,
    )


@claim(
    "Relative to the prediction the final range is worse: {end_ratio:.1f} times it.",
    errata="E22",
    choices=DEADBAND,
    counterexample=scaled("gains.stochastic_covariance", at=(0, slice(None), DOWNRANGE, DOWNRANGE)),
)
def fig9_lc_worst_gamma(flights: Flights, dispersions: Dispersions):
    parts = []
    for law in LAWS:
        apart = 100 * dispersions[law].apart
        subject = f"distance of the {LAW_NAMES[law]} law's curves of the flight path angle, of the largest bound"
        largest_other = np.delete(apart, FLIGHT_PATH_ANGLE).max()
        sampling = 100 * np.sqrt(2) * dispersions[law].relative_error
        parts.append(measure(subject, apart[FLIGHT_PATH_ANGLE], "%", error=sampling) >= largest_other)
    return holds(
        *parts,
        *flights.lost("stochastic_time"),
        trials=flights["stochastic_time"].count,
        end_ratio=dispersions["stochastic"].end_ratio[DOWNRANGE],
    )


@claim(counterexample=scaled("stochastic_time.covariance", component="crossrange"))
def lateral_dispersion_increases(flights: Flights, dispersions: Dispersions):
    apollo, stochastic = largest = np.array([dispersions[law].crossrange.max() / 1e3 for law in LAWS])
    sampling = np.hypot(*(largest * [dispersions[law].relative_error for law in LAWS]))
    subject = "largest standard deviation of the crossrange under the stochastic law"
    return holds(
        measure(subject, stochastic, "km", error=sampling) > apollo,
        f"under the Apollo law {apollo:.2f} km",
        *flights.lost("stochastic_time"),
        trials=flights["stochastic_time"].count,
    )


@claim(
    """Left are {remaining:.0f} %, with the velocity trigger {remaining_velocity:.1f}, with `same_sign`
    {same_sign.remaining:.0f} %.""",
    errata="E5 E8",
    choices=f"{DEADBAND} mean_density aerodynamic_signs",
    counterexample=spread("stochastic_time.final_state", component="crossrange"),
)
def crossrange_nulled(flights: Flights):
    (remaining, sampling), (with_trigger, _) = (_crossrange_left(flights, trigger) for trigger in TRIGGERS)
    subject = "crossrange that the stochastic law has beyond Apollo's at the end, in per cent of that in flight"
    return holds(
        measure(subject, remaining, "%", error=sampling) < 100 * NEGLIGIBLE
        if np.isfinite([remaining, with_trigger]).all()
        else check("the stochastic law adds crossrange in flight", False),
        *flights.lost("stochastic_time"),
        trials=flights["stochastic_time"].count,
        interval=crossrange_interval(flights["apollo_time"])[0] / 1e3,
        remaining=remaining,
        remaining_velocity=with_trigger,
    )


def _crossrange_left(flights, trigger):
    """Additional interval of the final crossrange, % of that in flight, and its error; NaN if none is added there."""
    pairs = [crossrange_interval(flights[f"{law}_{trigger}"]) for law in LAWS]
    (apollo, apollo_error), (stochastic, stochastic_error) = pairs
    variances = (flights[f"{law}_{trigger}"].covariance[:, CROSSRANGE, CROSSRANGE] for law in LAWS)
    largest = [np.sqrt(np.fmax.reduce(variance)) for variance in variances]  # of the times at which trials fly
    added = WIDTH_98 * (largest[1] - largest[0])
    if not added > 0.0:  # nothing that could be left
        return np.nan, np.nan
    share = (stochastic - apollo) / added
    of_added = WIDTH_98 * np.hypot(*largest) / np.sqrt(2 * finite_count(flights[f"stochastic_{trigger}"]))
    return 100 * float(share), 100 * float(np.hypot(np.hypot(apollo_error, stochastic_error), share * of_added) / added)
