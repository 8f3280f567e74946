"""Counterexamples: that the least change is told which turns a verdict, and that none is made up."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication.claims.claim import Counterexample
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted, spread
from marsedl.replication.errors import InputError
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.records.fields import Axis, quantity, record

STATE = Axis("state", downrange="m", altitude="m")


@record
class Flights:
    """Toy flights."""

    final_state: np.ndarray = quantity(STATE.unit, ("trials", STATE), "final states")
    outcome: np.ndarray = quantity("1", ("trials",), "outcome", "int64")
    status: str = quantity("1", (), "status")


def flights():
    states = np.stack([np.linspace(-1.0, 1.0, 101), np.full(101, 5.0)], axis=1)
    return Flights(states, np.zeros(101, dtype=int), "optimal")


RECORDS = {"closed": flights(), "closed_large": flights()}
VALUES = {"mission.target": (1.0, 2.0)}


def turned(counterexample, statement):
    def judge(given):
        closed = given.artifact("closed", Flights)
        value = statement(SimpleNamespace(values=given.values, closed=closed, others=given.further))
        if not math.isfinite(value):
            raise ValueError
        return "holds" if value > 0 else "fails", None

    costs = {"measured": {"run, one core": 2.0}}
    return counterexample.turning_point(judge, Arguments(VALUES, lambda name, kind: RECORDS[name], costs))


def test_the_least_change_is_told_and_the_records_stay_as_they_are():
    before = RECORDS["closed"].final_state.copy()
    deviation = RECORDS["closed"].final_state[:, 0].std()
    up = turned(shifted("closed.final_state", "downrange"), lambda g: 0.3 - g.closed.final_state[:, 0].mean())
    assert up.amount == pytest.approx(0.3 / deviation, rel=0.01) and up.to == "fails"
    down = turned(shifted("closed.final_state", "downrange"), lambda g: g.closed.final_state[:, 0].mean() + 0.3)
    assert down.amount == pytest.approx(-0.3 / deviation, rel=0.01)
    wider = turned(spread("closed.final_state", "downrange"), lambda g: 1.5 - np.ptp(g.closed.final_state[:, 0]) / 2)
    assert wider.amount == pytest.approx(1.5, rel=0.01)
    factor = turned(scaled("closed.final_state", "altitude"), lambda g: g.closed.final_state[0, 1] - 1.0)
    assert factor.amount == pytest.approx(0.2, rel=0.01)
    assert np.array_equal(RECORDS["closed"].final_state, before)


def test_other_changes_turn_a_verdict_or_not():
    status = turned(replaced("closed.status", "infeasible"), lambda g: 1.0 if g.closed.status == "optimal" else -1.0)
    assert status == Counterexample(change="replaced", of="closed.status", amount="infeasible", to="fails")
    one = turned(replaced("closed.outcome", 1, at=(0,)), lambda g: 0.5 - g.closed.outcome.sum())
    assert one.to == "fails"
    target = turned(scaled("mission.target", at=(1,)), lambda g: 3.0 - g.values["mission.target"][1])
    assert target.amount == pytest.approx(1.5, rel=0.01) and VALUES["mission.target"] == (1.0, 2.0)
    cost = turned(scaled("measured.run, one core"), lambda g: 3.0 - g.others["measured"]["run, one core"])
    assert cost.amount == pytest.approx(1.5, rel=0.01)


def test_what_does_not_turn_it_is_no_counterexample():
    assert turned(shifted("closed.final_state", "altitude"), lambda g: 0.3 - g.closed.final_state[:, 0].mean()) is None
    # Beyond the bounds of what is tried, and by breaking the claim.
    assert turned(scaled("closed.final_state"), lambda g: 100.0 - g.closed.final_state[0, 1]) is None
    broken = turned(scaled("closed.final_state"), lambda g: 1.0 if g.closed.final_state[0, 1] == 5.0 else math.nan)
    assert broken is None


@pytest.mark.parametrize(
    ("counterexample", "message"),
    [
        (scaled("closed.final_stat"), "final_state"),
        (scaled("closed.final_state", "altitud"), "no component 'altitud'"),
        (scaled("measured.run, two cores"), "run, one core"),
    ],
)
def test_a_target_that_there_is_not_is_refused(counterexample, message):
    with pytest.raises(InputError, match=message):
        turned(counterexample, lambda g: 1.0)
