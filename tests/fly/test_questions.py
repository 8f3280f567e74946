"""What may be asked of flights that are flown: what they drew, what that explains, derived quantities, shares."""

from math import exp
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binomtest

from marsedl.fly import Below, Error, Model, MultivariateNormal, Normal, Senses, fly
from marsedl.fly.shares import explained_share
from marsedl.montecarlo.flights import Flight


class State(NamedTuple):
    altitude: float
    speed: float
    bias: float = 0.0


class Push(NamedTuple):
    up: float


def rates(state, command: Push) -> State:
    return State(state.speed, -0.5 * state.speed - 10.0 + command.up, 0.0)


def brake(speed) -> Push:
    return Push(-0.5 * (speed + 10.0))


PROBE = Model(Flight(rates), quantities={"altitude": ("m", "altitude"), "speed": ("m/s", "climb rate")})

SECONDS, START = 4.0, {"altitude": Normal(500.0, 20.0), "speed": Normal(-20.0, 6.0), "bias": 3.0}
FACTOR = 2.0 * (1.0 - exp(-0.5 * SECONDS))  # of the speed at the start, in the altitude at the end: drag is linear
SHARE = 400.0 / (400.0 + (6.0 * FACTOR) ** 2)  # of the altitude at the start


@pytest.fixture(scope="module")
def falls():
    return fly(PROBE, START, law=0.0, end_time=SECONDS, trials=4000, seed=2)


def test_what_was_drawn_is_what_the_motion_starts_from(falls):
    drawn = falls.drawn
    assert list(drawn) == ["start_altitude", "start_speed"], "the bias is no dispersion"
    calm = -20.0  # m/s, at which drag and gravity balance
    expected = drawn["start_altitude"] + FACTOR * (drawn["start_speed"] - calm) + calm * SECONDS
    np.testing.assert_allclose(falls.final["altitude"], expected, rtol=1e-6)
    one = falls.replay(7)
    assert one.drawn == {name: values[7] for name, values in drawn.items()}
    assert one.drawn["start_altitude"] == one.history["altitude"].iloc[0]
    row = falls.worst("altitude", 1, side="low").iloc[0]
    assert (
        row["altitude"] == falls.final["altitude"].min() and row["start_altitude"] == drawn["start_altitude"][row.name]
    )
    assert falls.worst("altitude", 1, side="high").iloc[0]["altitude"] == falls.final["altitude"].max()
    data = falls.to_xarray()["start_speed"]
    assert data.attrs == {"units": "m/s", "long_name": "climb rate, at the start"}
    assert falls.extended(4100).drawn["start_speed"][:4000].tolist() == drawn["start_speed"].tolist()


def test_the_shares_of_a_linear_motion_are_those_of_its_variance(falls):
    table = falls.explains("altitude").set_index("drawn")
    assert list(table.index) == ["start_altitude", "start_speed", "all else"][:: 1 if SHARE > 0.5 else -1]
    for name, share in (("start_altitude", SHARE), ("start_speed", 1.0 - SHARE)):
        row = table.loc[name]
        assert row["lower"] < share < row["upper"] and abs(row["share"] - share) < 0.02
    assert abs(table.loc["all else", "share"]) < 0.01
    tail = falls.explains("altitude", percentile=95).set_index("drawn")["share"]
    highest = float(np.quantile(falls.final["altitude"], 0.95))
    beyond = falls.explains(f"altitude > {highest!r}").set_index("drawn")["share"]
    assert tail.to_dict() == beyond.to_dict() and tail["all else"] > 0.2, "a tail takes both"
    assert fly(PROBE, START, law=0.0, end_time=SECONDS, trials=100).explains("altitude")["share"].isna().all()


@pytest.mark.parametrize("count", [400, 1000, 4000])
def test_intervals_of_shares_hold_them_as_often_as_they_say(count):
    """Of a normal number in a sum, of one that does nothing, of one whose square counts, of a uniform one in a sine."""
    random, held = np.random.default_rng(count), np.zeros(4)
    for _ in range(100):
        a, b, c = random.normal(size=(3, count))
        u = random.uniform(size=count)
        wave = np.sin(6.0 * u)
        variance = 0.5 - np.sin(12.0) / 24.0 - ((1.0 - np.cos(6.0)) / 6.0) ** 2
        cases = (
            (a, 2.0 * a + b + 0.5 * c, 4.0 / 5.25),
            (c, 2.0 * a + b, 0.0),
            (a, a * a + b, 2.0 / 3.0),
            (u, wave + 0.3 * a, variance / (variance + 0.09)),
        )
        for row, (drawn, result, share) in enumerate(cases):
            _, lower, upper = explained_share(drawn, result)
            held[row] += lower <= share <= upper
    assert (held >= 88).all(), "of 100, less four standard errors"


def test_a_condition_has_its_share_and_interval_and_says_what_is_left_out():
    start = {"altitude": Normal(60.0, 20.0), "speed": -20.0}
    flights = fly(PROBE, start, law=0.0, trigger=Below("altitude", 0.0), end_time=4.0, trials=500)
    counted = flights.outcome == "ended: altitude below 0"
    assert 0 < counted.sum() < 500
    found = flights.probability("start_altitude < 50 and abs(speed + 20) < 1")
    true = int((flights.drawn["start_altitude"][counted] < 50.0).sum())
    interval = binomtest(true, int(counted.sum())).proportion_ci(0.95)
    assert (found["value"], found["lower"], found["upper"]) == (true / counted.sum(), interval.low, interval.high)
    assert (found["flights"], found["left_out"]) == (counted.sum(), 500 - counted.sum())
    assert found.round(2).attrs["note"] == f"{(~counted).sum()} out of time of 500 flights left out"
    assert found.round(2)["lower"] == round(interval.low, 2)
    assert flights.left_out().index.tolist() == np.flatnonzero(~counted).tolist()
    assert (flights.left_out()["outcome"] == "out of time").all()
    shares = flights.explains("start_altitude")
    assert (shares["note"] == found.attrs["note"]).all() or counted.sum() < 400


def test_a_derived_quantity_is_asked_as_others_are(falls):
    more = falls.with_quantity("miss", "sqrt((altitude_km - 0.42)**2)", "km")
    expected = np.abs(falls.final["altitude"] / 1e3 - 0.42)
    np.testing.assert_allclose(more.values("miss"), expected, rtol=1e-12)
    row = more.percentiles("miss", 50).iloc[0]
    assert row["unit"] == "km" and abs(row["value"] - np.median(expected)) < 1e-12
    same = falls.with_quantity("miss", lambda known: np.abs(known["altitude"] / 1e3 - 0.42))
    np.testing.assert_allclose(same.values("miss"), expected, rtol=1e-12)
    assert more.extended(4100).values("miss")[:4000].tolist() == more.values("miss").tolist()
    assert more.worst("miss", 1)["miss"].iloc[0] == more.values("miss")[more.worst("miss", 1).index[0]]
    assert more.with_quantity("double", "2 * miss").values("double").tolist() == (2 * more.values("miss")).tolist()


def test_errors_of_senses_are_drawn_and_explain_what_they_do():
    senses = Senses(speed=Error(bias=Normal(0.0, 2.0), noise=0.1))
    flights = fly(PROBE, START, law=brake, senses=senses, end_time=SECONDS, trials=2000)
    assert list(flights.drawn) == ["start_altitude", "start_speed", "speed_bias"]
    one = flights.replay(7)
    errors = (one.history["nav_speed"] - one.history["speed"]).loc[[0.0, 1.0, 2.0, 3.0]]  # when the law is asked
    assert np.abs(errors - one.drawn["speed_bias"]).max() < 0.5 < abs(one.drawn["speed_bias"]), "less five deviations"
    shares = flights.explains("speed").set_index("drawn")["share"]
    assert shares["speed_bias"] > 0.9 > 0.05 > max(shares["start_speed"], shares["start_altitude"])


def test_correlated_numbers_are_drawn_by_name():
    covariance = [[400.0, 30.0], [30.0, 9.0]]
    pair = {("altitude", "speed"): MultivariateNormal([500.0, -20.0], covariance)}
    drawn = fly(PROBE, pair, law=0.0, end_time=1.0, trials=4000).drawn
    found = np.cov(drawn["start_altitude"], drawn["start_speed"])
    np.testing.assert_allclose(found, covariance, rtol=0.1)


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (lambda f: f.probability("altitude"), "is a number; give a condition"),
        (lambda f: f.probability("altitude <"), "is no expression in quantities"),
        (lambda f: f.probability("height < 3"), "quantity 'height' is unknown"),
        (lambda f: f.probability("altitude_deg < 3"), "altitude is in m, not in a unit of _deg"),
        (lambda f: f.probability("__import__('os').getcwd() == ''"), "is no expression in quantities"),
        (lambda f: f.probability(3), "is no expression in quantities"),
        (lambda f: f.explains("altitude < 400", percentile=5, confidence=2), "confidence is 2"),
        (lambda f: f.explains("altitude", percentile=100), "is no percentage"),
        (lambda f: f.explains("altitude < 400", percentile=5), "has a share and no percentile"),
        (lambda f: f.worst("altitude", side="left"), "give 'both', 'high' or 'low'"),
        (lambda f: f.with_quantity("altitude", "speed"), "give a new name"),
        (lambda f: f.with_quantity("two words", "speed"), "give a new name"),
        (lambda f: f.with_quantity("mean", lambda known: known["speed"].mean()), "a number for each flight"),
    ],
)
def test_a_question_that_cannot_be_answered_is_told_in_one_sentence(falls, ask, told):
    with pytest.raises(ValueError, match=told) as error:
        ask(falls)
    assert "\n" not in str(error.value)
