"""The laws that live here: how each is designed from what is known on board, as a table of gains or a law of its own.

All share limits, partition, linear model and lateral logic, unless their words say otherwise.
"""

from functools import partial

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import lqg_gains
from marsedl.papers.stochastic_entry import flight, gains
from marsedl.papers.stochastic_entry.records import STATES
from marsedl.scenarios.entry.guidance import Guided, guide
from marsedl.scenarios.scenario import Resident

__all__ = ["RESIDENTS", "law_of"]


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


def by_time(onboard, gain):
    """The law of gains on the linear model's state, held over the intervals of the partition, (intervals, 5)."""
    given, model = onboard.given, onboard.linearization
    starts = gains.partition_starts(given.guidance, given.design, len(model.control))
    whole = np.zeros((len(model.control) + 1, flight.FEATURES))
    whole[:-1, :STATES] = gain[np.searchsorted(starts, np.arange(len(model.control)), side="right") - 1]
    stochastic_table = gains.law(given.guidance, model, onboard.gains, "stochastic_velocity")
    return law_of(onboard, stochastic_table._replace(gain=whole))


RESIDENTS = {
    "no_feedback": Resident("the nominal bank profile", no_feedback),
    "apollo": Resident("Apollo final phase", apollo, {"overcontrol": (1.0, 10.0)}),
    "stochastic": Resident("stochastic entry guidance", stochastic),
    "regulator": Resident(
        "linear-quadratic regulator", regulator, {"control_weight": (1e-3, 1e3), "range_weight": (1e-3, 1e3)}
    ),
}
