"""Sec. 4.1: radius errors with feedback, Figs. 3 to 5."""

import numpy as np

from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.claims.measures import (
    CROSSRANGE,
    DOWNRANGE,
    GAINS,
    LAW_OF,
    PLAIN,
    RADIUS,
    SHAPED,
    RadiusFlight,
    size,
)
from marsedl.papers.desensitized.inputs import Planet
from marsedl.papers.desensitized.records import Gains, Responses
from marsedl.replication.claims.counterexamples import scaled, shifted
from marsedl.replication.claims.thresholds import MOST, MUCH, ROUNDING, SIMILAR, VISIBLE
from marsedl.replication.claims.writing import check, claim, holds, measure, measured
from marsedl.replication.units import DEGREE

LAW = LAW_OF[RADIUS]
LINEAR = 0.1  # of the final error without feedback: by less a final error departs from its tangent while it is linear


def _final(responses):
    """Final errors of no-DOC, of DOC without feedback and of DOC with feedback after the error drawn, m."""
    return size(responses.error[[PLAIN, SHAPED, LAW], RADIUS, -1])


def _swept(values, errors):
    """Final errors of the same three laws over a sweep, m, without its middle."""
    return size(values[[PLAIN, SHAPED, LAW], RADIUS][:, np.abs(errors[RADIUS]) > 0.0])


# ---- Figs. 3 and 4 ---------------------------------------------------------------------------------------------------


@claim(
    "The smallest gains leave {left:.1f} % of the flown error, tuned ones {feedback_tuned.left:.1f} %.",
    errata="E13",
    choices=GAINS,
    counterexample=scaled("responses.error", at=(LAW, RADIUS, -1)),
)
def feedback_radius_greatly_reduced(flight: RadiusFlight, responses: Responses):
    without, _, with_feedback = _final(responses)
    # As flown: that the gains lower the linear sensitivity is the equation that they solve.
    left = 100 * with_feedback / without
    subject = f"share that feedback leaves of the final error after {flight.entry_error:g} m of radius error"
    return flight.holds(measure(subject, left, "%") < 100 * MUCH, left=left, metres=with_feedback)


@claim(counterexample=scaled("responses.wide_error", at=(SHAPED, RADIUS)))
def fig03_nofeedback_below_nodoc(responses: Responses):
    without, reshaped, _ = _swept(responses.wide_error, responses.wide)
    subject = f"final errors of DOC without feedback, up to {responses.wide[RADIUS, -1]:g} m of radius error either way"
    return holds(measure(subject, reshaped, "m") < without)


@claim(
    "The linear domain ends at {domain:.0f} m, with tuned gains at {feedback_tuned.domain:.0f} m.",
    errata="E13",
    choices=GAINS,
    counterexample=scaled("responses.wide_error", at=(LAW, RADIUS)),
)
def fig03a_feedback_smaller_linear_domain(flight: RadiusFlight, gains: Gains, responses: Responses):
    domains = [linear_domain(gains, responses, law, RADIUS) for law in (PLAIN, SHAPED, LAW)]
    return flight.holds(
        measure("largest radius error whose final error is near its tangent, with feedback", domains[2], "m")
        < MUCH * min(domains[:2]),
        f"near is within {100 * LINEAR:g} % of the final error without feedback",
        domain=domains[2],
    )


def linear_domain(gains: Gains, responses: Responses, law: int, channel: int) -> float:
    """Largest error at entry up to which the flown final errors keep to their tangent at zero, m.

    They do while they are apart from it by less than `LINEAR` of what the sensitivity without feedback gives.
    """
    errors = np.concatenate([responses.wide[channel], responses.narrow[channel]])
    final_errors = np.concatenate([responses.wide_error[law, channel], responses.narrow_error[law, channel]])
    apart = size(final_errors - errors[:, np.newaxis] * gains.final[law, :, channel])
    within = apart <= LINEAR * np.abs(errors) * size(gains.final[PLAIN, :, channel])
    lost = np.abs(errors[~within])  # NaN is not within
    inside = np.abs(errors) < lost.min(initial=np.inf)
    return float(np.abs(errors[inside]).max(initial=0.0))


@claim(choices=GAINS, counterexample=scaled("responses.narrow_error", at=(LAW, RADIUS)))
def fig03b_feedback_best_small_errors(flight: RadiusFlight, responses: Responses):
    narrow = _swept(responses.narrow_error, responses.narrow)
    best = narrow[2] / narrow[:2].min(axis=0)
    subject = f"share of the smaller final error without feedback, up to {responses.narrow[RADIUS, -1]:g} m either way"
    return flight.holds(measure(subject, 100 * best, "%") < 100 * MUCH)


@claim(counterexample=scaled("responses.error", at=(PLAIN, RADIUS, -1, DOWNRANGE)))
def fig04_nodoc_downrange_200m(flight: RadiusFlight, responses: Responses):
    evidence = f"flown without feedback after {flight.entry_error:g} m of radius error"
    return measured(responses.error[PLAIN, RADIUS, -1, DOWNRANGE], evidence=evidence)


@claim(counterexample=scaled("responses.error", at=(PLAIN, RADIUS, -1, DOWNRANGE)))
def fig04_nodoc_mainly_downrange(responses: Responses):
    without, downrange = _final(responses)[0], responses.error[PLAIN, RADIUS, -1, DOWNRANGE]
    subject = f"share of the final error of {without:.0f} m that is not downrange"
    return holds(measure(subject, 100 * (1.0 - abs(downrange) / without), "%") <= 100 * MOST)


@claim(counterexample=scaled("responses.error", at=(SHAPED, RADIUS, -1)))
def fig04_nofeedback_somewhat_below(flight: RadiusFlight, responses: Responses):
    without, reshaped, _ = _final(responses)
    subject = f"share of no-DOC's final error that DOC without feedback saves after {flight.entry_error:g} m"
    return holds(measure(subject, 100 * (1.0 - reshaped / without), "%") >= 100 * VISIBLE)


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, RADIUS, -1)))
def fig04_ordering(flight: RadiusFlight, responses: Responses):
    without, reshaped, with_feedback = _final(responses)
    subject = f"final error with feedback after {flight.entry_error:g} m of radius error"
    return flight.holds(measure(subject, with_feedback, "m") < MUCH * min(reshaped, without))


@claim(by_construction="both are drawn from one flight")
def fig04_fig05_same_trajectory(planet: Planet, flight: RadiusFlight, responses: Responses):
    errors = entry_problem.position_errors(responses.state[LAW, RADIUS], responses.nominal[LAW], planet.planet_radius)
    drawn, tolerance = responses.error[LAW, RADIUS], ROUNDING * flight.entry_error
    same = np.allclose(errors, drawn, rtol=0.0, atol=tolerance, equal_nan=True)
    return holds(check("the errors of Fig. 4 are those of the flight of Fig. 5", same))


# ---- Fig. 5 ----------------------------------------------------------------------------------------------------------


@claim(choices=GAINS, counterexample=scaled("responses.acceleration", at=(LAW, RADIUS)))
def fig05a_comparable_acceleration(flight: RadiusFlight, responses: Responses):
    largest = np.abs(responses.acceleration[LAW, RADIUS]).max() / DEGREE
    nominal = np.abs(responses.nominal_acceleration[LAW]).max() / DEGREE
    subject = f"largest bank acceleration after {flight.entry_error:g} m of radius error, difference from the nominal's"
    return flight.holds(measure(subject, 100 * abs(largest / nominal - 1.0), "%") <= 100 * SIMILAR)


@claim(choices=GAINS, counterexample=scaled("responses.cumulative", at=(LAW, RADIUS)))
def fig05a_no_excessive_fuel(flight: RadiusFlight, responses: Responses):
    fuel, nominal = responses.cumulative[LAW, RADIUS] / DEGREE, responses.nominal_cumulative[LAW] / DEGREE
    subject = f"cumulative bank rate after {flight.entry_error:g} m of radius error, excess over the nominal's"
    return flight.holds(measure(subject, 100 * (fuel / nominal - 1.0), "%") <= 100 * SIMILAR)


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, RADIUS, ..., CROSSRANGE)))
def fig04_phase1_position_effects(flight: RadiusFlight):
    start, early, alone = flight.at(0.0), flight.at(flight.first), flight.without_feedback(flight.first)
    drag = 100 * flight.more_drag(0.9 * flight.first, flight.first)
    return flight.holds(
        measure(f"crossrange at {flight.first:g} s, further out than the nominal", flight.outward(flight.first), "m")
        >= VISIBLE * flight.entry_error,
        measure("radius error", early[RADIUS], "m") < min(start[RADIUS], alone[RADIUS]),
        measure("excess of drag over the nominal's just before", drag, "%") > 0.0,
        measure("downrange error", abs(early[DOWNRANGE]), "m") < abs(alone[DOWNRANGE]),
    )


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, RADIUS, slice(60, 90), DOWNRANGE)))
def fig04_phase2_position_effects(flight: RadiusFlight):
    # As in the middle phase of Fig. 11: against the beginning of the phase.
    early, late = flight.at(flight.first), flight.at(flight.second)
    return flight.holds(
        measure(f"radius error at {flight.second:g} s", late[RADIUS], "m") < early[RADIUS],
        measure("downrange error", late[DOWNRANGE], "m") < early[DOWNRANGE],
    )


@claim(
    "It goes from {early:.0f} to {late:.0f} m; the last phase corrects it to {last:.0f} m.",
    errata="E13",
    choices=GAINS,
    counterexample=scaled("responses.error", at=(LAW, RADIUS, slice(60, 90), CROSSRANGE)),
)
def fig04_phase2_crossrange_corrected(flight: RadiusFlight):
    early, late, last = (flight.at(time) for time in (flight.first, flight.second, flight.end))
    return flight.holds(
        measure(f"crossrange error at {flight.second:g} s", abs(late[CROSSRANGE]), "m") < abs(early[CROSSRANGE]),
        early=early[CROSSRANGE],
        late=late[CROSSRANGE],
        last=last[CROSSRANGE],
    )


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, RADIUS, -1)))
def fig04_phase3_position_effects(flight: RadiusFlight):
    late, last = flight.at(flight.second), flight.at(flight.end)
    return flight.holds(
        measure("radius error at the end", abs(last[RADIUS]), "m") < MUCH * abs(late[RADIUS]),
        measure("downrange error at the end", abs(last[DOWNRANGE]), "m") < MUCH * abs(late[DOWNRANGE]),
    )


@claim(
    "Lift exceeds the nominal's by {lift:.0f} % of all lift; drag differs by {drag:+.2f} %.",
    errata="E13",
    choices=GAINS,
    counterexample=shifted("responses.state", at=(LAW, RADIUS, ..., 0)),
)
def fig04_phase3_lift_and_drag(flight: RadiusFlight):
    lift, drag = 100 * flight.more_lift(flight.second, flight.end), 100 * flight.more_drag(flight.second, flight.end)
    return flight.holds(
        measure(f"excess of the mean vertical lift from {flight.second:g} s on, of all lift", lift, "%") > 0.0,
        measure("excess of the mean drag over the nominal's", drag, "%") < 0.0,
        lift=lift,
        drag=drag,
    )
