"""Sec. 4: what the paper states alike about several channels, Figs. 5 to 7, 9 and 10."""

import numpy as np

from marsedl.papers.desensitized.claims.measures import (
    CROSSRANGE,
    DOWNRANGE,
    GAINS,
    LAW_OF,
    PLAIN,
    RADIUS,
    SHAPED,
    CrossrangeFlight,
    DownrangeFlight,
    RadiusFlight,
    remaining,
    size,
)
from marsedl.papers.desensitized.entry_problem import BANK
from marsedl.papers.desensitized.inputs import Planet
from marsedl.papers.desensitized.records import CHANNELS, Gains, Linearization, Responses
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted
from marsedl.replication.claims.thresholds import MUCH
from marsedl.replication.claims.writing import claim, listed, measure, measured

CROSSRANGE_LAW, DOWNRANGE_LAW = LAW_OF[CROSSRANGE], LAW_OF[DOWNRANGE]


class Flights(dict):
    """The flights of the figures by channel."""


def flights(planet: Planet, gains: Gains, responses: Responses) -> Flights:
    """Gather the flights of all channels."""
    kinds = (RadiusFlight, CrossrangeFlight, DownrangeFlight)
    return Flights({flight.channel: flight(planet, gains, responses) for flight in kinds})


def bank_phase(name, channel, sign, phase, side=0, **declared):
    """Claim of a phase in which the bank angle departs to a side, with the nominal one on a given side or any."""
    turned = shifted("responses.state", at=(LAW_OF[channel], channel, ..., BANK))
    options = {"channel": channel, "sign": sign, "phase": phase, "side": side}
    return claim(choices=GAINS, counterexample=turned, name=name, **options, **declared)


@bank_phase("fig05b_phase1_more_reversed", RADIUS, -1, 0)
@bank_phase("fig05b_phase2_larger_positive", RADIUS, 1, 1)
@bank_phase("fig05b_phase3_smaller_reversed", RADIUS, 1, 2, side=-1)
@bank_phase("fig07b_phase1_more_reversed", DOWNRANGE, -1, 0)
@bank_phase(
    "fig10b_phase1_smaller_reversed",
    CROSSRANGE,
    1,
    0,
    side=-1,
    reason="This statement tells us the sign of the bank angle.",
    errata="E3",
)
@bank_phase("fig10b_phase2_larger_positive", CROSSRANGE, 1, 1, side=1)
@bank_phase("fig10b_phase3_smaller_reversed", CROSSRANGE, 1, 2, side=-1)
def bank_angle_departs(flights: Flights, *, channel, sign, phase, side):
    flight = flights[channel]
    bounds = 0.0, flight.first, flight.second, flight.end
    return flight.holds(flight.departs(sign, *bounds[phase : phase + 2], side))


@claim(errata="E13", choices=GAINS, name="fig05b_phase_times", channel=RADIUS)
@claim(errata="E13", choices=GAINS, name="fig07b_phase_times", channel=DOWNRANGE)
def phase_times(flights: Flights, *, channel):
    flight = flights[channel]
    last_reversal = flight.reversal_times[-1] if flight.reversal_times.size else np.nan
    evidence = "first change of sign of the bank angle's deviation, and last reversal of the nominal"
    return measured([flight.first_change, float(last_reversal)], evidence=evidence)


@claim(
    name="cr_needs_feedback",
    channel=CROSSRANGE,
    choices=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(CROSSRANGE_LAW, CROSSRANGE)),
)
@claim(
    name="dr_needs_feedback",
    channel=DOWNRANGE,
    choices=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(DOWNRANGE_LAW, DOWNRANGE)),
)
def needs_feedback(flights: Flights, linearization: Linearization, responses: Responses, *, channel):
    # That no trajectory without feedback reduces it is an identity, so that only what is flown is judged.
    final, sensitivity = size(responses.tabulated_error[:, channel]), size(linearization.final[:, :, channel])
    left = 100 * final[LAW_OF[channel]] / final[[PLAIN, SHAPED]].min(axis=0)
    errors = f"{listed(responses.compared_error, '+g')} m of {CHANNELS[channel]} error"
    apart = np.abs(sensitivity / sensitivity[0] - 1.0).max()
    return flights[channel].holds(
        measure(f"share that feedback leaves of the least final error without it, after {errors}", left, "%")
        < 100 * MUCH,
        f"without feedback the sensitivities of the rows of Table 3 differ by {apart:.1g} of theirs",
        left=left.max(),
    )


@claim(
    name="fig09_feedback_significantly_reduced",
    channel=CROSSRANGE,
    choices=GAINS,
    counterexample=replaced("responses.narrow_error", 100.0, at=(CROSSRANGE_LAW, CROSSRANGE)),
)
@claim(
    name="fig06_feedback_significantly_reduced",
    channel=DOWNRANGE,
    choices=GAINS,
    counterexample=scaled("responses.narrow_error", at=(DOWNRANGE_LAW, DOWNRANGE)),
)
def feedback_significantly_reduced(flights: Flights, responses: Responses, *, channel):
    # As flown: that the gains lower the linear sensitivity is the equation that they solve.
    subject = f"share that feedback leaves of {responses.narrow[channel, -1]:g} m either way"
    left = 100 * remaining_when_small(responses, channel)
    return flights[channel].holds(measure(subject, left, "%") < 100 * MUCH)


@claim(
    name="fig09_reduction_larger_for_small_errors",
    channel=CROSSRANGE,
    choices=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(CROSSRANGE_LAW, CROSSRANGE)),
)
@claim(
    name="fig06b_reduction_larger_for_small_errors",
    channel=DOWNRANGE,
    choices=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(DOWNRANGE_LAW, DOWNRANGE)),
)
def reduction_larger_for_small_errors(flights: Flights, responses: Responses, *, channel):
    small, large = 100 * remaining_when_small(responses, channel), 100 * remaining(responses, channel)
    subject = f"share that feedback leaves of {responses.narrow[channel, -1]:g} m either way"
    return flights[channel].holds(measure(subject, small, "%") < large)


def remaining_when_small(responses: Responses, channel: int) -> np.ndarray:
    """Share of the final error that is left at the ends of the zoomed sweep, each to the side of a compared error."""
    law, ends = LAW_OF[channel], np.where(responses.compared_error > 0.0, -1, 0)
    return size(responses.narrow_error[law, channel][ends]) / size(responses.narrow_error[PLAIN, channel][ends])
