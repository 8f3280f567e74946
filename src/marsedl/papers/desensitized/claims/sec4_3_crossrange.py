"""Sec. 4.3: crossrange errors, Figs. 9 to 11, and the discussion."""

from dataclasses import replace

import numpy as np

from marsedl.papers.desensitized.claims.measures import (
    ALL_LAW,
    CROSSRANGE,
    DOWNRANGE,
    GAINS,
    INFINITY,
    LAW_OF,
    PLAIN,
    RADIUS,
    SCHEME,
    CrossrangeFlight,
    Rows,
    more_for_small_errors,
    needs_feedback,
    significantly_reduced,
    size,
)
from marsedl.papers.desensitized.entry_problem import BANK
from marsedl.papers.desensitized.inputs import Mission
from marsedl.papers.desensitized.records import (
    CHANNELS,
    NO_DOC,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    Responses,
)
from marsedl.replication.claiming import Fails, claim, holds, listed, measure, measured, provided
from marsedl.replication.counterexamples import replaced, scaled, shifted
from marsedl.replication.thresholds import MUCH, NEGLIGIBLE
from marsedl.replication.units import DEGREE

LAW = LAW_OF[CROSSRANGE]
MSL_FUEL = 9.0  # kg, as the paper quotes it


# ---- Fig. 9 ----------------------------------------------------------------------------------------------------------


@claim(counterexample=replaced("gains.final", 1.0, at=(LAW, CROSSRANGE, CROSSRANGE)))
def cr_needs_feedback(linearization: Linearization, gains: Gains):
    return needs_feedback(linearization, gains, CROSSRANGE)


@claim(
    "It is the cosine of the longitude flown, {turn:.6f}.",
    errata="E10",
    counterexample=scaled("responses.tabulated_error", at=(PLAIN, CROSSRANGE, 0)),
)
def cr_sensitivity_nodoc(mission: Mission, responses: Responses):
    error, turn = abs(responses.compared_error[0]), _turn(mission)
    return measured(
        size(responses.tabulated_error[PLAIN, CROSSRANGE, 0]) / error,
        evidence=f"flown with {error:g} m of crossrange error; the cosine of the longitude flown is {turn:.6f}",
        turn=turn,
    )


def _turn(mission):
    """Cosine of the longitude flown."""
    return np.cos(mission.final_longitude - mission.entry_longitude)


@claim(withheld=GAINS, counterexample=replaced("gains.final", 1.0, at=(LAW, CROSSRANGE, CROSSRANGE)))
def fig09_feedback_significantly_reduced(flight: CrossrangeFlight, gains: Gains, responses: Responses):
    return significantly_reduced(flight, gains, responses, CROSSRANGE)


@claim(errata="E13", withheld=GAINS)
def fig09_reduction_factor_1000m(responses: Responses):
    factors = size(responses.tabulated_error[PLAIN, CROSSRANGE]) / size(responses.tabulated_error[LAW, CROSSRANGE])
    evidence = f"{factors[1]:.1f} after {responses.compared_error[1]:+g} m"
    return measured(factors[0], evidence=evidence)


@claim(withheld=GAINS, counterexample=scaled("responses.tabulated_error", at=(LAW, CROSSRANGE)))
def fig09_reduction_larger_for_small_errors(flight: CrossrangeFlight, responses: Responses):
    return more_for_small_errors(flight, responses, CROSSRANGE)


# ---- Figs. 10 and 11 -------------------------------------------------------------------------------------------------


@claim(
    "We find {value:.1f} m; turned with the whole flight, {turned:.2f} m would be left.",
    errata="E10",
    counterexample=scaled("responses.error", at=(PLAIN, CROSSRANGE, -1, CROSSRANGE)),
)
def fig11_nofeedback_crossrange_1000m(mission: Mission, flight: CrossrangeFlight, responses: Responses):
    turned = _turn(mission) * flight.entry_error
    return measured(
        responses.error[PLAIN, CROSSRANGE, -1, CROSSRANGE],
        evidence=f"after {flight.entry_error:g} m; turned with the flight they would be {turned:.2f} m",
        turned=turned,
    )


@claim(counterexample=shifted("responses.error", at=(PLAIN, CROSSRANGE, -1)))
def fig11_nofeedback_only_crossrange(flight: CrossrangeFlight, responses: Responses):
    last = responses.error[PLAIN, CROSSRANGE, -1]
    return holds(
        measure("errors in radius and downrange", np.abs(last[[RADIUS, DOWNRANGE]]), "m")
        <= NEGLIGIBLE * flight.entry_error,
        f"crossrange {last[CROSSRANGE]:.1f} m",
    )


class TwoReversals(CrossrangeFlight):
    """The flight of Figs. 10 and 11, of which the nominal has at least two reversals: they part its phases."""

    @property
    def first(self) -> float:
        """When the first phase ends, s."""
        return float(self.reversal_times[0])

    @property
    def second(self) -> float:
        """When the second phase ends, s."""
        return self.last_reversal


def two_reversals(flight: CrossrangeFlight) -> TwoReversals:
    """Require two reversals of the nominal's bank angle."""
    if len(flight.reversal_times) < 2:
        raise Fails(f"bank reversals of the nominal: {len(flight.reversal_times)}; the statement needs two")
    phases = object.__new__(TwoReversals)
    vars(phases).update(vars(flight))
    return phases


@claim(
    "This statement tells us the sign of the bank angle.",
    errata="E3",
    withheld=GAINS,
    counterexample=shifted("responses.state", at=(LAW, CROSSRANGE, ..., BANK)),
)
def fig10b_phase1_smaller_reversed(flight: TwoReversals):
    return flight.holds(flight.departs(1, 0.0, flight.first, side=-1))


@claim(withheld=GAINS, counterexample=shifted("responses.state", at=(LAW, CROSSRANGE, ..., BANK)))
def fig10b_phase2_larger_positive(flight: TwoReversals):
    return flight.holds(flight.departs(1, flight.first, flight.second, side=1))


@claim(withheld=GAINS, counterexample=shifted("responses.state", at=(LAW, CROSSRANGE, ..., BANK)))
def fig10b_phase3_smaller_reversed(flight: TwoReversals):
    return flight.holds(flight.departs(1, flight.second, flight.end, side=-1))


@claim(withheld=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, ..., CROSSRANGE)))
def fig11_phase1_position_effects(flight: TwoReversals):
    start, early, alone = flight.at(0.0), flight.at(flight.first), flight.without_feedback(flight.first)
    lift = 100 * flight.more_lift(0.0, flight.first)
    return flight.holds(
        measure(f"excess of the mean vertical lift until {flight.first:.1f} s, of all lift", lift, "%") > 0.0,
        measure("then radius and downrange errors", early[[RADIUS, DOWNRANGE]], "m") > 0.0,
        measure("crossrange error", abs(early[CROSSRANGE]), "m") < min(abs(start[CROSSRANGE]), abs(alone[CROSSRANGE])),
        f"it is {alone[CROSSRANGE]:.0f} m without feedback",
    )


@claim(withheld=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, slice(60, 90), CROSSRANGE)))
def fig11_phase2_crossrange_drops(flight: TwoReversals):
    early, late = flight.at(flight.first), flight.at(flight.second)
    return flight.holds(
        measure(f"crossrange error at {flight.second:.1f} s", abs(late[CROSSRANGE]), "m") < abs(early[CROSSRANGE]),
        f"the limit is that at {flight.first:.1f} s",
    )


@claim(
    "Radius goes from {early:.0f} to {late:.0f} m, downrange from {early_downrange:.0f} to {late_downrange:.0f} m.",
    errata="E13",
    withheld=GAINS,
    counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, slice(60, 90))),
)
def fig11_phase2_position_effects(flight: TwoReversals):
    # As in the middle phase of Fig. 4: against the beginning of the phase.
    early, late = flight.at(flight.first), flight.at(flight.second)
    lift = 100 * flight.more_lift(flight.first, flight.second)
    span = f"from {flight.first:.1f} to {flight.second:.1f} s"
    return flight.holds(
        measure(f"excess of the mean vertical lift {span}, of all lift", lift, "%") < 0.0,
        measure("radius error at the end of it", late[RADIUS], "m") < early[RADIUS],
        measure("downrange error", late[DOWNRANGE], "m") < early[DOWNRANGE],
        early=early[RADIUS],
        early_downrange=early[DOWNRANGE],
        late=late[RADIUS],
        late_downrange=late[DOWNRANGE],
    )


@claim(withheld=GAINS, counterexample=scaled("responses.error", at=(LAW, CROSSRANGE, -1)))
def fig11_phase3_position_effects(flight: TwoReversals):
    late, last = (np.abs(flight.at(time))[[RADIUS, DOWNRANGE]] for time in (flight.second, flight.end))
    share = 100 * last / late
    return flight.holds(
        measure(f"share of the radius and downrange errors at {flight.second:.1f} s left at the end", share, "%")
        < 100 * MUCH,
        f"{listed(late, '.0f')} m become {listed(last, '.0f')} m",
    )


# ---- discussion ------------------------------------------------------------------------------------------------------


@claim(
    "They multiply the sensitivities to the other errors by {least:.1f} to {most:.0f}.",
    errata="E14",
    counterexample=scaled("gains.final", at=(slice(LAW_OF[0], ALL_LAW),)),
)
def gains_perturbation_specific(gains: Gains, entry_errors: FlightEnsemble):
    plain = size(gains.final[PLAIN].T)
    final = size(np.moveaxis(gains.final[LAW_OF], 1, 2)) / plain  # law, channel
    own_channel, other_channels = np.diag(final), final[~np.eye(len(CHANNELS), dtype=bool)]
    final_error = size(entry_errors.final_error)
    typical = np.median(np.where(np.isfinite(final_error), final_error, np.inf), axis=1)
    laws = dict(zip(entry_errors.law, typical, strict=True))
    return holds(
        measure("factor of the gains on the sensitivity in their own channel", own_channel) < MUCH,
        measure("in the others", other_channels) > MUCH,
        f"with errors in all channels at random half of the flights end within {laws[NO_DOC]:.0f} m without feedback "
        f"and within {listed([laws[channel] for channel in CHANNELS], '.0f')} m under these gains",
        least=other_channels.min(),
        most=other_channels.max(),
    )


@claim(counterexample=replaced("nominal.propellant", 5.0))
def nominal_fuel_below_msl(nominal: Nominal):
    return holds(
        measure("fuel of the nominal", nominal.propellant, "kg") < MUCH * MSL_FUEL,
        f"the Mars Science Laboratory burns about {MSL_FUEL:g} kg",
    )


@claim(
    "One set of gains against all three errors leaves {left:.0f} % of the flown radius error.",
    errata="E18",
    withheld=GAINS,
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
        f"with gains against one each {listed(singles, '.3f')} deg/s; control energies "
        f"{listed(gains.effort[laws], '.4f')} deg^2/s^3",
        together=together,
        together_effort=gains.effort[ALL_LAW],
        left=100.0 * share,
    )
    # What does not lower the flown errors by much is no fuel "for reducing the sensitivity".
    if not share < MUCH.at(1.0):
        doubt = f"one set of gains leaves {100 * share:.0f} % of the drawn radius error, so that its fuel says nothing"
        return replace(judged, undetermined=doubt)
    return judged


@claim(
    """Finite weights burn at most {finite:.3f} kg, infinite ones {last:.1f} kg, by trapezoids {trapezoid[last]:.1f}
    kg.""",
    errata="E11",
    withheld=(INFINITY, SCHEME),
    counterexample=scaled("tradeoff.propellant", at=(slice(5, None),)),
)
def fuel_not_above_msl(rows: Rows):
    finite, stood_for = rows.propellant[:-1].max(), rows.limits("propellant")
    infinite = measure("fuel of the row of infinite weight, by all weights that stand for it", stood_for, "kg")
    judged = holds(
        measure("fuel of the rows of finite weight", finite, "kg") <= MSL_FUEL,
        infinite <= MSL_FUEL,
        f"{listed(stood_for, '.2f')} kg {rows.stands_for}; the limit is about what the Mars Science Laboratory burns",
        finite=finite,
        last=rows.propellant[-1],
    )
    if finite <= MSL_FUEL and not (stood_for > MSL_FUEL).all():
        doubt = "fuel goes on growing with the weight that stands for infinity, and Eq. 6 does not fix it"
        return replace(judged, undetermined=doubt)
    return judged
