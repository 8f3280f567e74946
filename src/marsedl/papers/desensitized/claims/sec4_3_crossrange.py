"""Sec. 4.3: crossrange errors, Figs. 9 to 11, and the discussion."""

from dataclasses import replace

import numpy as np

from marsedl.papers.desensitized.claims.measures import (
    ALL_LAW,
    CROSSRANGE,
    DOWNRANGE,
    GAINS,
    LAW_OF,
    PLAIN,
    RADIUS,
    CrossrangeFlight,
    Rows,
    size,
)
from marsedl.papers.desensitized.inputs import Mission
from marsedl.papers.desensitized.records import CHANNELS, Gains, Nominal, Responses
from marsedl.replication.claims.claim import Doubt
from marsedl.replication.claims.counterexamples import replaced, scaled
from marsedl.replication.claims.thresholds import MUCH, NEGLIGIBLE
from marsedl.replication.claims.writing import claim, holds, measure, measured, provided
from marsedl.replication.units import DEGREE

LAW = LAW_OF[CROSSRANGE]
TURNED = "a flight that begins beside the nominal is that flight turned about the planet's centre"
MSL_FUEL = 9.0  # kg, as the paper quotes it


# ---- Fig. 9 ----------------------------------------------------------------------------------------------------------


@claim(
    "It is the cosine of the longitude flown, {turn:.6f}.",
    errata="E10",
    by_construction=TURNED,
)
def cr_sensitivity_nodoc(mission: Mission, responses: Responses):
    sensitivity = size(responses.tabulated_error[PLAIN, CROSSRANGE, 0]) / abs(responses.compared_error[0])
    return measured(sensitivity, turn=_turn(mission))


def _turn(mission):
    """Cosine of the longitude flown."""
    return np.cos(mission.final_longitude - mission.entry_longitude)


@claim(errata="E13", choices=GAINS)
def fig09_reduction_factor_1000m(responses: Responses):
    factors = size(responses.tabulated_error[PLAIN, CROSSRANGE]) / size(responses.tabulated_error[LAW, CROSSRANGE])
    evidence = f"{factors[1]:.1f} after {responses.compared_error[1]:+g} m"
    return measured(factors[0], evidence=evidence)


# ---- Figs. 10 and 11 -------------------------------------------------------------------------------------------------


@claim(
    "We find {value:.1f} m; turned with the whole flight, {turned:.2f} m would be left.",
    errata="E10",
    by_construction=TURNED,
)
def fig11_nofeedback_crossrange_1000m(mission: Mission, flight: CrossrangeFlight, responses: Responses):
    return measured(
        responses.error[PLAIN, CROSSRANGE, -1, CROSSRANGE],
        evidence=f"after {flight.entry_error:g} m",
        turned=_turn(mission) * flight.entry_error,
    )


@claim(by_construction=TURNED)
def fig11_nofeedback_only_crossrange(flight: CrossrangeFlight, responses: Responses):
    others = np.abs(responses.error[PLAIN, CROSSRANGE, -1, [RADIUS, DOWNRANGE]])
    return holds(measure("errors in radius and downrange", others, "m") <= NEGLIGIBLE * flight.entry_error)


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, ..., CROSSRANGE)))
def fig11_phase1_position_effects(flight: CrossrangeFlight):
    start, early, alone = flight.at(0.0), flight.at(flight.first), flight.without_feedback(flight.first)
    lift = 100 * flight.more_lift(0.0, flight.first)
    return flight.holds(
        measure(f"excess of the mean vertical lift until {flight.first:.1f} s, of all lift", lift, "%") > 0.0,
        measure("then radius and downrange errors", early[[RADIUS, DOWNRANGE]], "m") > 0.0,
        measure("crossrange error", abs(early[CROSSRANGE]), "m") < min(abs(start[CROSSRANGE]), abs(alone[CROSSRANGE])),
    )


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, slice(60, 90), CROSSRANGE)))
def fig11_phase2_crossrange_drops(flight: CrossrangeFlight):
    early, late = flight.at(flight.first), flight.at(flight.second)
    return flight.holds(
        measure(f"crossrange error at {flight.second:.1f} s", abs(late[CROSSRANGE]), "m") < abs(early[CROSSRANGE])
    )


@claim(
    "Radius goes from {early:.0f} to {late:.0f} m, downrange from {early_downrange:.0f} to {late_downrange:.0f} m.",
    errata="E13",
    choices=GAINS,
    counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, slice(60, 90))),
)
def fig11_phase2_position_effects(flight: CrossrangeFlight):
    # As in the middle phase of Fig. 4: against the beginning of the phase.
    early, late = flight.at(flight.first), flight.at(flight.second)
    lift = 100 * flight.more_lift(flight.first, flight.second)
    return flight.holds(
        measure("excess of the mean vertical lift in this phase, of all lift", lift, "%") < 0.0,
        measure("radius error at the end of it", late[RADIUS], "m") < early[RADIUS],
        measure("downrange error", late[DOWNRANGE], "m") < early[DOWNRANGE],
        early=early[RADIUS],
        early_downrange=early[DOWNRANGE],
        late=late[RADIUS],
        late_downrange=late[DOWNRANGE],
    )


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, -1)))
def fig11_phase3_position_effects(flight: CrossrangeFlight):
    late, last = (np.abs(flight.at(time))[[RADIUS, DOWNRANGE]] for time in (flight.second, flight.end))
    subject = f"share of the radius and downrange errors at {flight.second:.1f} s left at the end"
    return flight.holds(measure(subject, 100 * last / late, "%") < 100 * MUCH)


# ---- discussion ------------------------------------------------------------------------------------------------------


@claim(
    "They multiply the sensitivities to the other errors by {least:.1f} to {most:.0f}.",
    errata="E14",
    counterexample=scaled("gains.final", at=(slice(LAW_OF[0], ALL_LAW),)),
)
def gains_perturbation_specific(gains: Gains):
    plain = size(gains.final[PLAIN].T)
    final = size(np.moveaxis(gains.final[LAW_OF], 1, 2)) / plain  # law, channel
    own_channel, other_channels = np.diag(final), final[~np.eye(len(CHANNELS), dtype=bool)]
    return holds(
        measure("factor of the gains on the sensitivity in their own channel", own_channel) < MUCH,
        measure("in the others", other_channels) > MUCH,
        least=other_channels.min(),
        most=other_channels.max(),
    )


@claim(counterexample=replaced("nominal.propellant", 5.0))
def nominal_fuel_below_msl(nominal: Nominal):
    return holds(measure("fuel of the nominal", nominal.propellant, "kg") < MUCH * MSL_FUEL)


@claim(
    "One set of gains against all errors leaves {left:.0f} % of the flown radius error.",
    errata="E18",
    choices=GAINS,
    counterexample=scaled("responses.error", at=(ALL_LAW, RADIUS, -1)),
)
def more_perturbations_more_fuel(gains: Gains, responses: Responses):
    laws = [*LAW_OF, ALL_LAW]
    *singles, together = responses.nominal_cumulative[laws] / DEGREE
    share = (size(responses.error[ALL_LAW, :, -1]) / size(responses.error[PLAIN, :, -1]))[RADIUS]
    judged = holds(
        provided("all gains converge", gains.converged[laws]),
        measure("cumulative bank rate of the nominal with one set of gains against all three errors", together, "deg/s")
        > max(singles),
        together=together,
        together_effort=gains.effort[ALL_LAW],
        left=100.0 * share,
    )
    if not gains.converged[ALL_LAW]:
        return replace(judged, doubts=(Doubt(why=f"the search for one set of gains ended: {gains.ended[ALL_LAW]}"),))
    # What does not lower the flown errors by much is no fuel "for reducing the sensitivity".
    if not share < MUCH.at(1.0):
        doubt = f"one set of gains leaves {100 * share:.0f} % of the drawn radius error, so that its fuel says nothing"
        return replace(judged, doubts=(Doubt(why=doubt),))
    return judged


@claim(
    "Finite weights burn {finite:.3f} kg at most, infinite ones {last:.1f} kg, by trapezoids {trapezoid.last:.1f} kg.",
    errata="E11",
    choices="scheme",
    counterexample=scaled("tradeoff.propellant", at=(slice(5, None),)),
)
def fuel_not_above_msl(rows: Rows):
    finite, stood_for = rows.propellant[:-1].max(), rows.limits("propellant")
    judged = holds(
        measure("fuel of the rows of finite weight", finite, "kg") <= MSL_FUEL,
        measure("by all weights that stand for an infinite one", stood_for, "kg") <= MSL_FUEL,
        finite=finite,
        last=rows.propellant[-1],
    )
    if finite <= MSL_FUEL and not (stood_for > MSL_FUEL).all():
        doubt = "fuel goes on growing with the weight that stands for infinity, and Eq. 6 does not fix it"
        return replace(judged, doubts=(Doubt(why=doubt),))
    return judged
