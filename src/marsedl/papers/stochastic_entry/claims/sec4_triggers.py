"""Sec. IV: flights that end at a trigger."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.state_trigger import trigger_time_variance
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.papers.stochastic_entry.claims.measures import DEADBAND, LAW_NAMES, LAWS, Flights
from marsedl.papers.stochastic_entry.inputs import Planet
from marsedl.papers.stochastic_entry.objective import TRIGGER_NORMAL
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    DOWNRANGE,
    END_TIME,
    FLIGHT_PATH_ANGLE,
    STATES,
    Linearization,
    Nominal,
    errors,
)
from marsedl.replication.claims.counterexamples import shifted, spread
from marsedl.replication.claims.thresholds import ABOUT, CLOSE
from marsedl.replication.claims.writing import Fails, claim, holds, measure

AT_TRIGGER = [ALTITUDE, FLIGHT_PATH_ANGLE, DOWNRANGE]  # what is compared there; the trigger fixes the velocity
ALL_FLYING = 0.999  # share of the trials that must fly where flights are carried on by the linear model


class AtTrigger(NamedTuple):
    """Flights of a law to the velocity trigger, and their moments at t_f."""

    ended: np.ndarray  # which trials came to the trigger
    mean: np.ndarray  # (5,), deviation at t_f
    covariance: np.ndarray  # (5, 5), at t_f


class AtTriggers(dict):
    """Those of both laws by name."""


def at_triggers(planet: Planet, linearization: Linearization, flights: Flights) -> AtTriggers:
    """Moments at t_f of the flights to the velocity trigger, so that the trigger alone is tested, not the design.

    Flights to a trigger do not all pass t_f. Their moments at the last command at which all but a thousandth still fly
    are carried on to t_f by the linear model, which has no control there.
    """
    result, trials = AtTriggers(), flights["apollo_velocity"].count
    for law in LAWS:
        ensemble = flights[f"{law}_velocity"]
        ended = ensemble.outcome == COMPLETED
        if ended.sum() < 2:
            raise Fails(f"fewer than two trials of the {LAW_NAMES[law]} law come to the trigger", trials)
        nodes = np.arange(len(linearization.transition))
        flying = ensemble.flying[nodes] >= ALL_FLYING * max(ensemble.count, 1)
        last = int(nodes[flying].max()) if ensemble.count > 1 else 0
        reference = linearization.state[last].copy()
        reference[0] -= planet.planet_radius
        mean, covariance = ensemble.mean[last, :STATES] - reference, ensemble.covariance[last, :STATES, :STATES]
        for transition, noise in zip(linearization.transition[last:], linearization.noise[last:], strict=True):
            mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        result[law] = AtTrigger(ended, mean, covariance)
    return result


def _trigger_times(flights, trigger, law):
    """Times at which the trigger fired, s, (trials,)."""
    return flights[f"{law}_velocity"].final_state[trigger.ended, END_TIME]


@claim(errata="E4", counterexample=shifted("apollo_velocity.final_state", at=(slice(0, None, 4), END_TIME)))
def trigger_time_gaussian(flights: Flights, at_trigger: AtTriggers):
    from scipy.special import ndtr

    parts = []
    for law, trigger in at_trigger.items():
        time = _trigger_times(flights, trigger, law)
        ordered = np.sort((time - time.mean()) / time.std(ddof=1))
        ranks = np.arange(1, len(ordered) + 1) / len(ordered)
        distance = np.abs(ndtr(ordered) - ranks + 0.5 / len(ordered)).max()
        subject = f"{LAW_NAMES[law]} law: largest distance of the distribution of end times from the normal one"
        parts.append(measure(subject, 100 * distance, "%", error=50 / np.sqrt(len(time))) < 100 * CLOSE)
    return holds(*parts, trials=flights["apollo_velocity"].count)


@claim(
    "Bank reversals move the mean, by {apollo_late:+.2f} (Apollo) and {stochastic_late:+.2f} s (stochastic).",
    errata="E4 E22",
    choices=f"{DEADBAND} aerodynamic_signs",
    counterexample=shifted("apollo_velocity.final_state", component="end_time"),
)
def trigger_time_statistics(nominal: Nominal, linearization: Linearization, flights: Flights, at_trigger: AtTriggers):
    parts, numbers = [], {}
    for law, trigger in at_trigger.items():
        time = _trigger_times(flights, trigger, law)
        expected = np.sqrt(trigger_time_variance(linearization.final_rates, TRIGGER_NORMAL, trigger.covariance))
        late, ratio, count = time.mean() - nominal.end_time, time.std(ddof=1) / expected, len(time)
        numbers[f"{law}_late"] = late
        parts += [
            measure(
                f"{LAW_NAMES[law]} law: distance of the mean from t_f",
                abs(late / expected),
                "deviations",
                error=1 / np.sqrt(count),
            )
            < ABOUT,
            measure("relative error of the predicted deviation", abs(ratio - 1.0), error=1 / np.sqrt(2 * count))
            < ABOUT,
        ]
    return holds(*parts, trials=flights["apollo_velocity"].count, **numbers)


@claim(
    "Bank reversals move the range, by {apollo_offset:+.2f} (Apollo) and {stochastic_offset:+.2f} km (stochastic).",
    errata="E4 E22",
    choices=DEADBAND,
    counterexample=shifted("apollo_velocity.final_state", component="downrange"),
)
def trigger_mean(linearization: Linearization, flights: Flights, at_trigger: AtTriggers):
    parts, numbers = [], {}
    for law, trigger in at_trigger.items():
        error, shift = _ends(flights, trigger, law), (linearization.trigger_projection @ trigger.mean)[AT_TRIGGER]
        spread_of_ends, offset = error.std(axis=0, ddof=1), error.mean(axis=0)
        numbers[f"{law}_offset"] = offset[2] / 1e3
        off, sampling = np.abs(offset - shift) / spread_of_ends, 1 / np.sqrt(len(error))
        subject = f"{LAW_NAMES[law]} law: error of the predicted means"
        parts.append(measure(subject, off, "deviations", error=sampling) < ABOUT)
    return holds(*parts, trials=flights["apollo_velocity"].count, **numbers)


@claim(
    "Ranges deviate by {apollo_deviation:.2f} (Apollo) and {stochastic_deviation:.2f} km (stochastic).",
    errata="E4 E22",
    choices=f"{DEADBAND} aerodynamic_signs",
    counterexample=spread("apollo_velocity.final_state", component="altitude"),
)
def trigger_covariance(linearization: Linearization, flights: Flights, at_trigger: AtTriggers):
    projection, parts, numbers = linearization.trigger_projection, [], {}
    for law, trigger in at_trigger.items():
        error = _ends(flights, trigger, law)
        expected = np.sqrt(np.diag(projection @ trigger.covariance @ projection.T))[AT_TRIGGER]
        deviation = error.std(axis=0, ddof=1)
        numbers[f"{law}_deviation"] = deviation[2] / 1e3
        off, sampling = np.abs(deviation / expected - 1.0), deviation / expected / np.sqrt(2 * len(error))
        subject = f"{LAW_NAMES[law]} law: relative error of the deviations that Eq. 65 predicts"
        parts.append(measure(subject, off, error=sampling) < ABOUT)
    return holds(*parts, trials=flights["apollo_velocity"].count, **numbers)


def _ends(flights, trigger, law):
    """Final errors of altitude, path angle and range of the trials that came to the trigger, (trials, 3)."""
    return errors(flights[f"{law}_velocity"])[trigger.ended][:, AT_TRIGGER]
