"""The laws that live here: how each is designed from what is known on board, as a table of gains or a law of its own.

All share limits, partition, linear model and lateral logic, unless their words say otherwise.
"""

from functools import partial

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import lqg_gains
from marsedl.methods.tvlqr import discrete_regulator
from marsedl.papers.stochastic_entry import flight, gains
from marsedl.papers.stochastic_entry.records import STATES
from marsedl.scenarios.entry import cone_program as cone
from marsedl.scenarios.entry import predictor, reshaped
from marsedl.scenarios.entry.guidance import Guided, guide
from marsedl.scenarios.scenario import Resident

__all__ = ["RESIDENTS", "law_of"]

# Of the regulator of the funnels, as its paper's inputs have them: radius, velocity, flight path angle and range that
# cost as much as one another, a bank angle that costs as much, and the time over which they do.
FUNNEL_SCALES = np.array([1e3, 30.0, np.radians(0.6), 2e3])
FUNNEL_BANK, FUNNEL_TIME = np.radians(3.0), 60.0


def law_of(onboard, table: flight.Law):
    """The guidance of a table of gains, as `fly` takes it."""
    return partial(guide, law=Guided(onboard.settings, table))


def no_feedback(onboard):
    """The nominal bank profile, with reversals and heading alignment."""
    return law_of(onboard, flight.NOMINAL_LAW)


def apollo(onboard, overcontrol=None):
    """Adjoint gains against velocity; overcontrol multiplies them in place of the paper's factor."""
    given = onboard.given
    table = gains.law(given.guidance, onboard.linearization, onboard.gains, "apollo_velocity")
    if overcontrol is not None:
        table = table._replace(gain=table.gain * (overcontrol / given.design.overcontrol))
    return law_of(onboard, table)


def stochastic(onboard):
    """Least final range error under chance constraints by the Lagrange dual, against time, for the velocity trigger."""
    table = gains.law(onboard.given.guidance, onboard.linearization, onboard.gains, "stochastic_velocity")
    return law_of(onboard, table)


def regulator(onboard, control_weight=1.0, range_weight=1.0):
    """Linear-quadratic regulator of the linear model: final state over its limits, bank cosine over its limit."""
    posed = gains.problem(onboard.given.guidance, onboard.given.design, onboard.linearization, 1)
    final = posed.final_directions.T @ (posed.final_limits[:, np.newaxis] ** -2 * posed.final_directions)
    final += range_weight * np.outer(posed.objective, posed.objective) / 1e3**2
    gain, _ = lqg_gains(posed.system, final, control_weight / np.maximum(posed.control_limits, 1e-3) ** 2)
    return by_time(onboard, gain)


def cone_program(onboard, control_weight=1.0):
    """Covariance steering by the cone program, with the density as a state: of the history, the present state counts.

    control_weight: over that of the stochastic law.
    """
    posed, _ = cone.problem(onboard, control_weight)
    gain, _ = cone.steered(posed, cone.with_density(posed), onboard.given.design.chance_level)
    return by_time(onboard, gain, cone.INTERVAL)


def cone_program_without_density(onboard, navigation=0.01):
    """The same with the density as a disturbance that is correlated over time; flown is K = Cov(u, x) P^-1.

    navigation: errors that the design adds to states in every interval, in units of 1 km, 100 m/s, 0.01 rad and 1 km.
    """
    posed, slopes = cone.problem(onboard)
    system = cone.without_density(posed, slopes, navigation)
    gain, _ = cone.steered(posed, system, onboard.given.design.chance_level)
    return by_time(onboard, gain, cone.INTERVAL)


def funnel_regulator(onboard, control_weight=1.0, terminal_weight=1.0):
    """The regulator of the funnels: states cost all the way, over the scales that it has there, and density is none.

    The final cost is of the state at the velocity trigger. Weights are over those of the paper.
    """
    model = onboard.linearization
    scaled = np.diag(FUNNEL_SCALES**-2.0)
    projection = model.trigger_projection[: len(scaled), : len(scaled)]
    # A change of the bank angle is one of its cosine over the sine.
    bank_cost = FUNNEL_BANK**2 * (1.0 - model.bank_cosine[:-1] ** 2) * FUNNEL_TIME
    steps = np.diff(model.time)
    designed = discrete_regulator(
        model.slaved_transition,
        model.slaved_control[:, :, np.newaxis],
        steps,
        scaled / FUNNEL_TIME,
        (control_weight * steps / bank_cost)[:, np.newaxis, np.newaxis],
        terminal_weight * projection.T @ scaled @ projection,
    )
    return by_time(onboard, np.pad(designed.gains[:, 0], ((0, 0), (0, 1))), onboard.given.guidance.guidance_period)


def desensitized(onboard, sensitivity_weight=1.0, gain_weight=1.0):
    """The reference that errors move least, with constant gains that are chosen with it; see `reshaped`."""
    return law_of(onboard, reshaped.table(onboard, reshaped.reshaped(onboard, sensitivity_weight, gain_weight)))


def desensitized_without_feedback(onboard, sensitivity_weight=0.3):
    """The reference that errors move least, flown without feedback; see `reshaped`."""
    return law_of(onboard, reshaped.table(onboard, reshaped.reshaped(onboard, sensitivity_weight)))


def predictor_corrector(onboard, filtering=0.2, last_cosine=0.7):
    """Integration of the equations of motion every period; see `predictor`."""
    return predictor.predicting(onboard, filtering, last_cosine)


def by_time(onboard, gain, interval=None):
    """The law of gains on the linear model's state, held over the intervals of a partition, (intervals, 5).

    interval: of the partition, s; by default that of the stochastic law.
    """
    given, model = onboard.given, onboard.linearization
    periods = len(model.control)
    starts = gains.partition_starts(given.guidance, given.design, periods, interval)[: len(gain)]
    whole = np.zeros((periods + 1, flight.FEATURES))
    whole[:-1, :STATES] = gain[np.searchsorted(starts, np.arange(periods), side="right") - 1]
    stochastic_table = gains.law(given.guidance, model, onboard.gains, "stochastic_velocity")
    return law_of(onboard, stochastic_table._replace(gain=whole))


RESIDENTS = {
    "no_feedback": Resident("the nominal bank profile", no_feedback),
    "apollo": Resident("Apollo final phase", apollo, {"overcontrol": (1.0, 10.0)}),
    "stochastic": Resident("stochastic entry guidance", stochastic),
    "regulator": Resident(
        "linear-quadratic regulator", regulator, {"control_weight": (1e-3, 1e3), "range_weight": (1e-3, 1e3)}
    ),
    "cone_program": Resident(
        "covariance steering by the cone program of the aerocapture",
        cone_program,
        {"control_weight": (1.0, 1e9)},
        "the design holds the control for 5 s, that of the others for a guidance period",
    ),
    "cone_program_without_density": Resident(
        "the same program, to which the density is a correlated disturbance",
        cone_program_without_density,
        {"navigation": (3e-3, 0.1)},
        "density is no state of the linear model; the design holds the control for 5 s; of its feedback of all past "
        "states the regression on the present state is flown",
    ),
    "desensitized": Resident(
        "reference that errors move less, with constant gains",
        desensitized,
        {"sensitivity_weight": (1e-2, 1.0), "gain_weight": (1.0, 1e5)},
        "a reference of its own; density is a constant factor; no limits of control and final state",
    ),
    "desensitized_without_feedback": Resident(
        "reference that errors move less",
        desensitized_without_feedback,
        {"sensitivity_weight": (1e-2, 1.0)},
        "a reference of its own; density is a constant factor",
    ),
    "funnel_regulator": Resident(
        "regulator of the funnels, whose certificates hold for bounded errors of their own vehicle and not here",
        funnel_regulator,
        {"control_weight": (1e-2, 1e2), "terminal_weight": (1e-1, 1e4)},
        "density is no state of the linear model; states cost all the way; no limits of control and final state",
    ),
    "predictor_corrector": Resident(
        "numerical predictor-corrector of the FNPEG kind",
        predictor_corrector,
        {"filtering": (0.02, 1.0), "last_cosine": (0.4, 0.95)},
        "no linear model: it integrates the equations of motion; no limits of the final state",
    ),
}
