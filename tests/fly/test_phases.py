"""The end of one campaign starts the next, trial by trial, with random numbers of its own."""

import pickle
from typing import NamedTuple

import numpy as np
import pytest

from marsedl.fly import Below, Lander, Model, Normal, Uniform, fly
from marsedl.montecarlo.flights import Flight

GRAVITY, TRIALS = 3.71, 12


class State(NamedTuple):
    altitude: float
    speed: float = 0.0


class Gust(NamedTuple):
    up: float


def rates(state) -> State:
    return State(state.speed, -GRAVITY)


def in_gusts(state, noise) -> State:
    return State(state.speed, -GRAVITY + 0.5 * noise.up)


UNITS = {"altitude": ("m", "altitude"), "speed": ("m/s", "climb rate")}
FALL = Model(Flight(rates), quantities=UNITS, bounds={"altitude": (-1.0, 1e4)})
START = {"altitude": Normal(500.0, 20.0), "speed": Uniform(-20.0, 20.0)}
OPTIONS = {"compiled": False, "substeps": 2, "seed": 4}
ON = {"altitude": "altitude", "speed": "speed"}


def high(end_time=40.0, trials=TRIALS):
    return fly(FALL, START, end_time=end_time, trigger=Below("altitude", 300.0), trials=trials, **OPTIONS)


def low(start, **options):
    return fly(FALL, start, **{"end_time": 40.0, "trigger": Below("altitude", 0.0), **OPTIONS, **options})


@pytest.fixture(scope="module")
def first():
    return high()


@pytest.fixture(scope="module")
def cut():
    """Flights of which some do not come down in time."""
    return high(end_time=12.0)


def test_two_phases_are_one_flight_trial_by_trial(first):
    second, whole = low(first.as_start(ON)), low(START, trials=TRIALS)
    assert second.trials == TRIALS and second.outcomes() == {"ended: altitude below 0": TRIALS}
    np.testing.assert_allclose(second.final["speed"], whole.final["speed"], rtol=1e-9)
    np.testing.assert_allclose(first.final["end_time"] + second.final["end_time"], whole.final["end_time"], rtol=1e-9)
    fallen = 2.0 * GRAVITY * first.drawn["start_altitude"] + first.drawn["start_speed"] ** 2
    np.testing.assert_allclose(second.final["speed"] ** 2, fallen, rtol=1e-9)
    np.testing.assert_array_equal(second.drawn["start_speed"], first.final["speed"])
    assert second.replay(5).final == {name: values[5] for name, values in second.final.items()}
    third = low(second.as_start({"altitude": 100.0, "speed": "speed"}))
    np.testing.assert_allclose(third.final["speed"] ** 2, fallen + 200.0 * GRAVITY, rtol=1e-9)


def test_names_have_suffixes_and_functions_give_what_names_cannot(first):
    named = low(first.as_start({"altitude_km": "altitude_km", "speed": "start_speed"}))
    made = low(first.as_start(lambda known: {"altitude": known["altitude"], "speed": known["start_speed"]}))
    np.testing.assert_allclose(named.numbers, made.numbers, rtol=1e-12)


def test_trials_that_failed_before_are_kept_apart_with_their_outcome(cut):
    late = cut.outcome == "out of time"
    assert 0 < late.sum() < TRIALS
    second = low(cut.as_start(ON), history=1.0)
    assert second.outcomes() == {
        "ended: altitude below 0": int((~late).sum()),
        "before: out of time": int(late.sum()),
    }
    for name in second.final:
        np.testing.assert_array_equal(np.isnan(second.final[name]), late)
    assert np.isnan(second.histories[..., late]).all() and np.isnan(second.drawn["start_speed"][late]).all()
    assert [*second.left_out().index] == [*np.flatnonzero(late)]
    assert f"{late.sum()} before: out of time of {TRIALS} flights left out" in second.percentiles("speed")["note"][0]
    with pytest.raises(ValueError, match="has no such flight; before: out of time"):
        second.replay(np.flatnonzero(late)[0])


def test_what_phases_draw_is_independent_and_that_of_a_trial():
    gusty = Model(Flight(in_gusts, noise=Gust), quantities=UNITS)
    trials, options = 400, {"end_time": 0.5, "period": 0.5, "substeps": 1, "compiled": False, "seed": 4}
    first = fly(gusty, {"altitude": Normal(500.0, 20.0)}, trials=trials, **options)
    second = fly(gusty, first.as_start({"altitude": Normal(500.0, 20.0), "speed": 0.0}), **options)
    for name in ("start_altitude", "speed"):
        pair = [(flights.drawn | flights.final)[name] for flights in (first, second)]
        assert abs(np.corrcoef(*pair)[0, 1]) < 4.0 / np.sqrt(trials) and (pair[0] != pair[1]).all()
    again = pickle.loads(pickle.dumps(second.campaign))
    np.testing.assert_array_equal(again.drawn(range(7, 9))[0], second.campaign.drawn(range(trials))[0][:, 7:9])


def test_a_lander_starts_where_something_else_ended(first):
    start = first.as_start({"altitude": "altitude", "vertical_velocity": "speed", "downrange": 0.0,
                            "downrange_velocity": 0.0, "mass": Normal(900.0, 5.0)})  # fmt: skip
    landed = fly(Lander(9000.0, 220.0), start, law=(0.0, 8000.0), end_time=3.0, compiled=False)
    assert landed.outcomes() == {"completed": TRIALS}
    assert {*landed.drawn} == {"start_altitude", "start_vertical_velocity", "start_mass"}


@pytest.mark.parametrize(
    ("start", "told"),
    [
        ({"altitude": "altitud"}, "quantity 'altitud' is unknown"),
        ({"altitude": "altitude", "spead": "speed"}, "start 'spead' is unknown; did you mean 'speed'"),
        ({"speed": "speed"}, "start 'altitude' is missing"),
        (5.0, "as_start: give a mapping"),
        (lambda known: 5.0, "as_start: the function returned float, not a mapping"),
        (lambda known: {"altitude": np.ones(3)}, "start 'altitude': the phase before has 12 trials; give a number for"),
        (lambda known: {"altitude": 20.0 * known["altitude"] ** 1.1}, r"start 'altitude' is .*; it must lie between"),
        (lambda known: {"altitude": known["altitude"] / 0.0}, "start 'altitude' is not finite in trials"),
        (lambda known: {"altitude": np.where(np.arange(12) == 3, 2e4, 100.0)}, "'altitude': the end of trial 3 is 2"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_starts_are_looked_at_where_they_are_given(first, start, told):
    with pytest.raises(ValueError, match=told):
        low(first.as_start(start))


def test_a_phase_has_no_more_trials_than_the_one_before(first, cut):
    for trials in (TRIALS + 1, 100):
        with pytest.raises(ValueError, match=f"has no start, as the phase before has {TRIALS} trials: extend that one"):
            low(first.as_start(ON), trials=trials)
    assert low(first.as_start(ON), trials=3).trials == 3
    with pytest.raises(ValueError, match="no trial ended the phase before as it should"):
        low(high(end_time=1.0, trials=2).as_start(ON))
