"""The front door of flights, against closed forms and other integrators, and what it tells of mistakes."""

import pickle
import re
import subprocess
import sys
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.stats import norm

from marsedl.elementary import sine_cosine
from marsedl.fly import (
    MARS,
    Above,
    Below,
    Entry,
    Exponential,
    GainTable,
    Lander,
    Markov,
    MultivariateNormal,
    Normal,
    Table,
    Uniform,
    dynamics,
    fly,
)
from marsedl.fly.campaign import Campaign, _fly_chunk
from marsedl.fly.flights import order_interval
from marsedl.models.atmosphere import tabulated, uniform_cells, uniform_nodes
from marsedl.models.dynamics.entry import entry_rates
from marsedl.papers.random_field import flight as random_field

sys.path.insert(0, __file__.rpartition("/")[0])
from flown_models import ENDS, PROBE, STEERS, Gains, Memory, Push, guide

AIR = Exponential(0.0159, 10.5e3)
START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
ERRORS = START | {"velocity": Normal(5500.0, 10.0), "flight_path_angle_deg": Uniform(-14.2, -13.8)}
CAPSULE = Entry(Normal(115.0, 2.0), 0.24, variation=Markov(0.06, 5e3))
DROP = {
    "start": {"altitude": Normal(500.0, 20.0)},
    "trigger": Below("altitude", 0.0),
    "end_time": 100.0,
    "substeps": 10,
}


class Steering(NamedTuple):
    bank: float = 1.0
    slope: float = 0.0
    gain: float = 0.0


def steer(velocity, range, law: Steering = Steering()):  # noqa: B008
    return law.bank + law.slope * velocity + law.gain * (range - 300e3)


def steered(vehicle, start=START, law=steer, trigger=None, end_time=420.0, **options):
    return fly(vehicle, start, law=law, trigger=trigger or Below("velocity", 480.0), end_time=end_time, **options)


@pytest.fixture(scope="module")
def flights():
    return steered(CAPSULE, ERRORS, trials=2000, seed=7)


# ---- the right numbers -----------------------------------------------------------------------------------------------


def test_without_air_a_flight_is_a_conic():
    planet = MARS._replace(rotation_rate=0.0)
    flown = steered(Entry(100.0, 0.3, planet=planet, air=None), trigger=Below("altitude_km", 60.0), trials=1).final
    r0, r1 = planet.radius + 125e3, planet.radius + 60e3
    angle, mu = np.radians(-14.0), planet.gravitational_parameter
    momentum, energy = r0 * 5500.0 * np.cos(angle), 5500.0**2 / 2 - mu / r0
    np.testing.assert_allclose(flown["velocity"][0], np.sqrt(2 * (energy + mu / r1)), rtol=1e-10)
    np.testing.assert_allclose(r1 * flown["velocity"][0] * np.cos(flown["flight_path_angle"][0]), momentum, rtol=1e-10)
    latus = momentum**2 / mu
    eccentricity = np.sqrt(1 + 2 * energy * momentum**2 / mu**2)
    anomalies = [-np.arccos((latus / r - 1) / eccentricity) for r in (r0, r1)]
    np.testing.assert_allclose(flown["range"][0], planet.radius * (anomalies[1] - anomalies[0]), rtol=1e-7)
    assert abs(flown["crossrange"][0]) < 1e-6


def test_an_entry_agrees_with_another_integrator():
    start = START | {"azimuth_deg": 60.0, "latitude_deg": 20.0, "longitude_deg": -40.0}
    flown = steered(Entry(115.0, 0.24, air=AIR), start, law=partial(steer, law=Steering(0.8)), trials=1, substeps=8)
    factors, planet = (0.5 / 115.0, 0.24 * 0.5 / 115.0), (MARS.gravitational_parameter, MARS.rotation_rate)

    def rates(_, state):
        density = np.exp(AIR.log_density(state[0] - MARS.radius))
        return entry_rates(state, sine_cosine(0.8), density, factors, planet, 1.0)

    def slow(_, state):
        return state[3] - 480.0

    slow.terminal = True
    first = [MARS.radius + 125e3, *np.radians([-40.0, 20.0]), 5500.0, *np.radians([-14.0, 60.0])]
    end = solve_ivp(rates, (0.0, 420.0), first, method="DOP853", rtol=1e-12, atol=1e-12, events=slow)
    radius, longitude, latitude, velocity, path, azimuth = end.y[:, -1]
    final = {name: values[0] for name, values in flown.final.items()}
    np.testing.assert_allclose(final["end_time"], end.t[-1], rtol=1e-7)
    named = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "azimuth")
    expected = (radius - MARS.radius, longitude, latitude, velocity, path, azimuth)
    np.testing.assert_allclose([final[name] for name in named], expected, rtol=1e-6)
    # The distance between two points of a sphere, and the way back along it.
    angle = np.arccos(
        np.sin(first[2]) * np.sin(latitude) + np.cos(first[2]) * np.cos(latitude) * np.cos(longitude - first[1])
    )
    along, across = final["range"] / MARS.radius, final["crossrange"] / MARS.radius
    np.testing.assert_allclose(np.cos(along) * np.cos(across), np.cos(angle), rtol=1e-12)
    assert final["crossrange"] > 1e3  # a positive bank turns to the right


def test_a_lander_agrees_with_the_rocket_equation():
    start = {"downrange": 0.0, "altitude": 1000.0, "downrange_velocity": 5.0, "vertical_velocity": -50.0, "mass": 900.0}
    lander = Lander(largest_thrust=9000.0, specific_impulse=220.0, thrust_scale=1.02)
    flown = fly(lander, start, law=(0.0, 20e3), end_time=20.0, substeps=10, trials=1)
    final, exhaust = {name: values[0] for name, values in flown.final.items()}, 220.0 * 9.80665
    mass = 900.0 - 1.02 * 9000.0 / exhaust * 20.0
    np.testing.assert_allclose(final["mass"], mass, rtol=1e-12)
    np.testing.assert_allclose(final["vertical_velocity"], -50.0 - 3.71 * 20 + exhaust * np.log(900 / mass), rtol=1e-9)
    np.testing.assert_allclose([final["downrange"], final["end_time"]], [100.0, 20.0], rtol=1e-12)
    assert flown.outcomes() == {"completed": 1}


def test_markov_air_has_its_deviation_and_correlation():
    vehicle = Entry(115.0, variation=Markov(lambda altitude: 0.05 + 1e-6 * altitude, 8e3, spacing=400.0))
    high, low = (
        steered(vehicle, START, trigger=Below("altitude_km", altitude), end_time=60.0, trials=4000)
        for altitude in (70.0, 65.6)
    )
    for flown, altitude in ((high, 70e3), (low, 65.6e3)):
        variation = flown.final["density"] / np.exp(AIR.log_density(altitude)) - 1.0
        np.testing.assert_allclose(variation.std(), 0.05 + 1e-6 * altitude, rtol=4 / np.sqrt(2 * 4000))
        assert abs(variation.mean()) < 4 * 0.12 / np.sqrt(4000)
    expected = np.exp(-4.4 / 8.0)
    correlation = high.against(low, ["density"])["correlation"][0]
    assert abs(correlation - expected) < 4 * (1 - expected**2) / np.sqrt(4000)


def test_a_table_of_air_is_a_monotone_cubic_of_the_logarithm(tmp_path):
    file = tmp_path / "air.csv"
    file.write_text("altitude_km,density_kg_m3\n-10,0.03\n60,1e-4\n200,1e-9\n")
    rows = np.array([[-10e3, 0.03], [60e3, 1e-4], [200e3, 1e-9]])
    for source in (file, rows):
        flown = steered(Entry(115.0, air=Table(source)), trigger=Below("altitude_km", 100.0), trials=1)
        expected = np.exp(PchipInterpolator(rows[:, 0], np.log(rows[:, 1]))(100e3))
        np.testing.assert_allclose(flown.final["density"][0], expected, rtol=1e-9)


def test_air_of_a_table_is_that_of_the_papers_to_the_bit():
    mars = [[0.0, 0.0159], [8e3, 0.008], [25e3, 1.4e-3], [60e3, 2e-5], [125e3, 1e-9]]
    cells = uniform_cells(*uniform_nodes(tabulated(mars))[2:], 1e3)
    paper = random_field.Parameters(
        **dict.fromkeys(random_field.Parameters._fields, 0.0)
        | {"bottom": -10e3, "cells_per_metre": 1.0 / 1e3, "cells": cells}
    )
    stored_as_there, stored_as_here = (
        Entry(115.0, air=Table(np.array(mars)), nodes=nodes).model().p for nodes in ((-10e3, 300e3, 1e3), None)
    )
    for altitude in np.linspace(-15e3, 310e3, 1001):
        state = random_field.State(radius=altitude, velocity=0.0, path_angle=0.0)
        expected = random_field.look_up(state, np.zeros(2), paper).log_mean
        here = dynamics.EntryState(altitude, 5e3, -0.2)
        assert dynamics.look_up(here, np.zeros(2), stored_as_there).log_density == expected
        assert abs(dynamics.look_up(here, np.zeros(2), stored_as_here).log_density - expected) < 1e-11


def test_dispersions_have_their_distributions_and_keep_their_numbers_when_others_are_added():
    pair = {("velocity", "altitude_km"): MultivariateNormal([5500.0, 125.0], [[100.0, 4.0], [4.0, 0.25]])}
    start = pair | {"flight_path_angle_deg": Uniform(-14.2, -13.8)}
    flown = steered(Entry(115.0), start, end_time=1.0, trials=4000, history=1.0, seed=3)
    first = flown.to_xarray().isel(time=0)
    both = np.cov(first["velocity_history"], first["altitude_history"] / 1e3)
    np.testing.assert_allclose(both, [[100.0, 4.0], [4.0, 0.25]], rtol=0.1)
    angle = np.degrees(first["flight_path_angle_history"])
    assert -14.2 <= angle.min() < -14.199 and -13.801 < angle.max() <= -13.8
    np.testing.assert_allclose(angle.std(), 0.4 / np.sqrt(12), rtol=0.05)
    alone = {"flight_path_angle_deg": Uniform(-14.2, -13.8)}
    alone = steered(Entry(115.0), START | alone, end_time=1.0, trials=5, history=1.0, seed=3)
    np.testing.assert_array_equal(alone.histories[0, 2], first["flight_path_angle_history"][:5])


# ---- the same bits ---------------------------------------------------------------------------------------------------


def test_chunks_processes_single_trials_and_additions_have_the_same_bits(flights, monkeypatch):
    flown = fly(PROBE, law=guide, trials=501, seed=5, **DROP)
    assert (fly(PROBE, law=guide, trials=501, seed=5, processes=2, **DROP).numbers == flown.numbers).all()
    assert (fly(PROBE, law=guide, trials=101, seed=5, **DROP).extended(501).numbers == flown.numbers).all()
    monkeypatch.setattr("marsedl.fly.campaign.CHUNK", 77)
    assert (fly(PROBE, law=guide, trials=501, seed=5, **DROP).numbers == flown.numbers).all()
    assert (steered(CAPSULE, ERRORS, trials=333, seed=7).numbers == flights.numbers[:, :333]).all()


def test_replays_are_the_flights(flights):
    for in_python in (False, True):
        one = flights.replay(1234, in_python)
        assert one.final == {name: values[1234] for name, values in flights.final.items()}
        assert one.outcome == "ended: velocity below 480"
        assert one.history.index[1] == 0.25 and one.history.index[-1] == one.final["end_time"]
    assert one.history.equals(flights.replay(1234).history)


@settings(max_examples=6, deadline=None)
@given(
    st.floats(-20.0, -8.0),
    st.floats(4500.0, 6500.0),
    st.floats(-3.0, 3.0),
    st.floats(-1e-5, 1e-5),
    st.integers(0, 2**40),
)
def test_compiled_flights_equal_flights_in_python(angle, velocity, bank, gain, seed):
    start = START | {"flight_path_angle_deg": Normal(angle, 0.1), "velocity": Normal(velocity, 10.0)}
    law = partial(steer, law=Steering(bank, 1e-4, gain))
    flown = steered(CAPSULE, start, law, end_time=40.0, trials=3, seed=seed)
    for trial in (0, 2):
        one = flown.replay(trial, in_python=True)
        assert one.final == {name: values[trial] for name, values in flown.final.items()}


def test_a_gain_table_flies_as_the_same_law_as_a_function(tmp_path, flights):
    function = partial(steer, law=Steering(0.4, 1e-4, 2e-6))
    expected = steered(CAPSULE, ERRORS, function, trials=100, seed=7)
    file = tmp_path / "law.csv"
    file.write_text("velocity,bank,range,bank_per_range\n6000,1.0,3e5,2e-6\n3000,0.7,3e5,2e-6\n0,0.4,3e5,2e-6\n")
    table = steered(CAPSULE, ERRORS, GainTable(file), trials=100, seed=7)
    np.testing.assert_allclose(table.numbers, expected.numbers, rtol=1e-9, atol=1e-6)
    assert np.ptp(expected.final["range"] - flights.final["range"][:100]) > 100.0  # the law does something
    one = table.replay(3, in_python=True)
    assert one.final == {name: values[3] for name, values in table.final.items()}


# ---- statistics ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("level", "count"), [(0.5, 40), (0.99, 1000), (0.05, 250)])
def test_intervals_hold_the_percentile_as_often_as_they_say(level, count):
    samples = np.random.Generator(np.random.Philox(1)).standard_normal((4000, count))
    ends = np.array([order_interval(row, level) for row in samples])
    coverage = ((ends[:, 0] <= norm.ppf(level)) & (norm.ppf(level) <= ends[:, 1])).mean()
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / 4000) < coverage < 0.985


def test_few_flights_have_no_interval_and_a_note(flights):
    rows = flights.percentiles(["range_km"], [50, 99.5, 99.9]).set_index("percentile")
    assert rows["note"].to_dict() == {50.0: "", 99.5: "", 99.9: "2,000 flights; an interval takes 10,000"}
    assert np.isnan(rows.loc[99.9, ["lower", "upper"]].astype(float)).all()
    assert (rows["lower"] < rows["value"])[:2].all() and (rows["value"] < rows["upper"])[:2].all()
    np.testing.assert_allclose(rows.loc[50.0, "value"], np.median(flights.final["range"]) / 1e3)


def test_flights_that_do_not_end_are_counted_and_left_out():
    flown = fly(PROBE, law=guide, trials=300, seed=5, **DROP | {"end_time": 27.0})
    ended = flown.final["altitude"] < 1e-6
    assert flown.outcomes() == {"out of time": (~ended).sum(), "ended: altitude below 0": ended.sum()} and ended.any()
    (row,) = flown.percentiles("speed", 50).itertuples()
    assert row.note == f"{(~ended).sum()} out of time of 300 flights left out"
    assert row.value == np.median(flown.final["speed"][ended])


def test_differences_are_paired_and_worst_flights_are_found(flights):
    other = steered(CAPSULE, ERRORS, partial(steer, law=Steering(1.05)), trials=2000, seed=7)
    row = other.against(flights, ["range_km"]).iloc[0]
    difference = (other.final["range"] - flights.final["range"]) / 1e3
    np.testing.assert_allclose(row["difference"], difference.mean(), rtol=1e-12)
    np.testing.assert_allclose(row["upper"] - row["lower"], 2 * 1.96 * difference.std() / np.sqrt(2000), rtol=1e-3)
    assert difference.std() < 0.2 * flights.final["range"].std() / 1e3
    worst = flights.worst("range", 5)
    distance = np.abs(flights.final["range"] - np.median(flights.final["range"]))
    assert list(worst.index) == list(np.argsort(-distance)[:5])


def test_until_adds_flights_until_the_interval_is_narrow(flights):
    few = steered(CAPSULE, ERRORS, trials=500, seed=7)
    more = few.until("p99 of range_km within 2.5 km")
    row = more.percentiles("range_km", 99).iloc[0]
    assert more.trials in (1000, 2000) and row["upper"] - row["lower"] <= 5.0
    assert (more.numbers == flights.numbers[:, : more.trials]).all()
    assert more.search.reached and more.search.looks == {1000: 2, 2000: 3}[more.trials]
    with pytest.warns(UserWarning, match=r"is not reached after 2 looks: the half-width is .* m: wanted are 1 m"):
        assert few.until("p99 of range within 1 m", at_most=1000).trials == 1000


def test_arrays_are_labelled(flights):
    data = flights.to_xarray()
    assert data["max_load"].attrs == {
        "units": "m/s^2",
        "long_name": "largest aerodynamic acceleration at the start of a step or the end",
    }
    assert (data["range"].values == flights.final["range"]).all()
    assert flights.to_pandas().loc[7, "altitude"] == flights.final["altitude"][7]
    history = fly(PROBE, law=guide, trials=5, seed=5, history=5.0, **DROP).to_xarray()
    one = fly(PROBE, law=guide, trials=5, seed=5, **DROP).replay(4)
    flown = history["altitude_history"].sel(trial=4).dropna("time")
    *times, last = flown["time"].values
    assert (one.history.loc[times, "altitude"] == flown.values[:-1]).all()
    assert flown.values[-1] == one.final["altitude"] and last == 5.0 * np.ceil(one.final["end_time"] / 5.0)
    assert history["up_history"].sel(trial=4, time=last) == one.history["up"].iloc[-1]
    assert history["time"].attrs["units"] == "s"


# ---- what is told ----------------------------------------------------------------------------------------------------


class Bank(NamedTuple):
    bank: float


def forgot(velocity):
    velocity * 2.0


def asks_for_more(speed):
    return speed


def needs_parameters(law):
    return law.bank


def misspells(sensed):
    return sensed.speed


def short(sensed, memory) -> tuple[Gains, Gains]:
    return Gains()


def in_degrees(velocity):
    return Bank(70.0)


def remembers(velocity, memory) -> Bank:
    return Bank(0.3)


def noisy(velocity):
    return 1.2 + 0.1 * np.random.normal()  # noqa: NPY002


def recorded(velocity):
    RECORD.append(velocity)
    return 0.3


RECORD = []


MISTAKES = [
    (
        START | {"velocty": 1.0},
        {},
        r"start 'velocty' is unknown; did you mean 'velocity'\? There are: altitude, velocity",
    ),
    ({"altitude": 1e5, "velocity": 5e3}, {}, r"start 'flight_path_angle' is missing"),
    (START | {"velocity_deg": 1.0}, {}, r"velocity is in m/s, not in a unit of _deg; write 'velocity'"),
    (START | {"altitude": 1.0}, {}, r"start 'altitude' is given twice"),
    (START | {"azimuth": 90.0}, {}, r"start 'azimuth' is 90 rad, more than a turn; for degrees write 'azimuth_deg'"),
    (START | {"velocity": np.nan}, {}, r"start 'velocity' is nan; give a finite number"),
    (START | {"velocity": "fast"}, {}, r"start 'velocity' is 'fast'; give a finite number"),
    (START | {"velocity": Normal(5500.0, -1.0)}, {}, r"a deviation is not negative"),
    ({("altitude", "velocity"): 3.0}, {}, r"several names take MultivariateNormal"),
    ({("altitude", "velocity"): MultivariateNormal([1e5, 5e3], [[1.0, 2.0], [2.0, 1.0]])}, {}, r"eigenvalues"),
    ({("altitude", "velocity"): MultivariateNormal([1e5], [[1.0]])}, {}, r"do not fit them"),
    (START, {"trials": 0}, r"trials must be a whole number of at least 1, got 0"),
    (START, {"processes": 1.5}, r"processes must be a whole number of at least 1, got 1.5"),
    (START, {"end_time": -1.0}, r"end_time is -1.0 s; it must be positive"),
    (START, {"substeps": 0}, r"substeps is 0; give the integration steps"),
    (START, {"history": 0.3}, r"history every 0.3 s is no multiple of the integration step, 0.25 s"),
    (START, {"trigger": Below("speed", 450.0)}, r"trigger 'speed' is unknown; .*There are: altitude, velocity"),
    (START, {"trigger": Above("velocity", 450.0)}, r"velocity above 450 is met at the start, where velocity is 5500"),
    (START, {"trigger": ("velocity", 450.0)}, r"give Below\(name, value\), Above\(name, value\) or a function"),
    (START, {"law": asks_for_more}, r"asks_for_more \(.*line \d+\) asks for 'speed', of which it is not told"),
    (START, {"law": needs_parameters}, r"asks for 'law', its parameters: give them as partial\(needs_parameters, law="),
    (START, {"law": "apollo"}, r"law 'apollo' is none: give a function"),
    (START, {"law": partial(in_degrees, 5500.0)}, r"is none: give a function, partial\(function, law=parameters"),
    (START, {"law": (1.0, 2.0)}, r"a constant command is 1 numbers: bank"),
    (START, {"law": forgot}, r"forgot \(.*line \d+\) returned None; it must return bank"),
    (START, {"law": short}, r"short \(.*line \d+\) returned Gains\(gain=0.1\); it must return Gains and Gains"),
    (
        START,
        {"law": misspells},
        r"misspells \(.*line \d+\) asks for sensed.speed, of which it is not told",
    ),
    (
        START,
        {"law": in_degrees},
        r"the law commands 70 at the start of trial 0: bank is 70 rad, more than a turn; give it in radians",
    ),
    (START, {"law": remembers}, r"remembers .* asks for 'memory': annotate it, `-> tuple\[Command, Memory\]`"),
    (START, {"law": noisy}, r"noisy .* reads np.random, whose answers belong to no trial"),
    (START, {"law": recorded}, r"recorded .* reads RECORD, a list whose changes a compiled flight does not see"),
    (START, {"law": 57.0}, r"law 57.0: bank is 57 rad, more than a turn; give it in radians"),
    (START, {"law": GainTable({"speed": [0, 1], "bank": [0, 1]}, "speed")}, r"the law is not told 'speed'"),
    (START, {"law": GainTable({"velocity": [0, 1], "bnk": [0, 1]})}, r"column 'bnk' is unknown; did you mean 'bank'"),
    (START, {"law": GainTable({"velocity": [0, 1], "range": [0, 1]})}, r"column 'bank' is missing"),
]


@pytest.mark.parametrize(("start", "options", "told"), MISTAKES, ids=[told for _, _, told in MISTAKES])
def test_a_mistake_is_told_in_one_sentence(start, options, told):
    with pytest.raises(ValueError, match=told) as error:
        fly(Entry(115.0), start, **{"end_time": 50.0, "trials": 2} | options)
    assert "\n" not in str(error.value)


def test_mistakes_elsewhere_are_told_in_one_sentence(tmp_path, flights):
    other = steered(CAPSULE, ERRORS, trials=20, seed=8)
    (tmp_path / "european.csv").write_text("velocity;bank\n6000;1\n500;0\n")
    for told, call in {
        r"'capsule' does not fly: give Entry": lambda: fly("capsule", START, end_time=1.0),
        r"vehicle 'ballistic_coefficient' is '115'": lambda: fly(Entry("115"), START, end_time=1.0),
        r"density and scale height must be positive": lambda: fly(
            Entry(1.0, air=Exponential(0.0)), START, end_time=1.0
        ),
        r"there is no such density table": lambda: fly(Entry(1.0, air=Table("none.csv")), START, end_time=1.0),
        r"a table of air has rows of altitude": lambda: fly(Entry(1.0, air=Table([1, 2])), START, end_time=1.0),
        r"correlation_length is 0 m; it must be positive": lambda: Markov(0.1, 0),
        r"top \(0.0 m\) must lie above bottom": lambda: Markov(0.1, 1e3, bottom=0.0, top=0.0),
        r"the deviation must not be negative": lambda: Markov(-0.1, 1e3).deviations(),
        r"none.csv: there is no such gain table": lambda: GainTable("none.csv"),
        r"european.csv: .* separated by commas": lambda: GainTable(tmp_path / "european.csv"),
        r"column 'velocity' is missing; There are: bank": lambda: GainTable({"bank": [0, 1]}),
        r"column 'bank' must hold finite numbers": lambda: GainTable({"velocity": [0, 1], "bank": [0, np.nan]}),
        r"column 'velocity' must strictly rise or fall": lambda: GainTable({"velocity": [0, 0], "bank": [0, 1]}),
        r"the model ends its flights itself": lambda: fly(ENDS, {"altitude": 1.0}, trigger=len, end_time=1.0),
        r"falls \(.*line \d+\) takes no command": lambda: fly(ENDS, {"altitude": 1.0}, law=steer, end_time=1.0),
        r"the model has guidance of its own": lambda: fly(STEERS, {"altitude": 1.0}, law=steer, end_time=1.0),
        r"quantity 'rnge' is unknown; did you mean 'range'": lambda: flights.percentiles("rnge"),
        r"level 100 is no percentage": lambda: flights.percentiles("range", 100),
        r"goal 'p99 range' is not of the form": lambda: flights.until("p99 range"),
        r"range is in m; write '%' or 'm'": lambda: flights.until("p99 of range within 1 mile"),
        r"trial 2000 is not among those flown, 0 to 1,999": lambda: flights.replay(2000),
        r"these are 2,000 flights of seed 7, the others 20 of seed 8": lambda: flights.against(other),
    }.items():
        with pytest.raises(ValueError, match=told):
            call()


class Whole(NamedTuple):
    n: int = 10
    power: int = 1
    push: float = 0.0


def whole(sensed, law: Whole = Whole()):  # noqa: B008
    return 0.1 * scaled(law.n * law.power) + law.push * (1e9 if sensed.speed > -1e9 else 0.0)


def scaled(number):
    return BESIDE * number


BESIDE = 1.0


def test_a_law_that_is_another_one_compiled_or_reads_other_numbers_than_before_is_refused(monkeypatch):
    """The helper of the law is plain; one kernel serves all."""
    start = DROP | {"trigger": None, "end_time": 5.0}
    flown = fly(PROBE, law=whole, trials=2, **start)
    assert flown.replay(1, in_python=True).final == {name: values[1] for name, values in flown.final.items()}
    with pytest.raises(ValueError, match=r"the law commands .* at the start of trial 0 in Python, compiled .*floats"):
        fly(PROBE, law=partial(whole, law=Whole(power=2**62)), trials=2, **start)  # more than 64 bits
    with pytest.warns(UserWarning, match=r"the law commands nan at the start of trial 0: up must be finite"):
        fly(PROBE, law=partial(whole, law=Whole(push=np.nan)), trials=2, **start)
    array = np.array([1.0])
    kept = Campaign(PROBE, start["start"], partial(whole, law=array), None, 5.0, 1.0, 4, None, 0)
    monkeypatch.setattr(sys.modules[__name__], "BESIDE", 2.0)
    array[0] = 2.0
    for again in (lambda: flown.replay(0), lambda: flown.extended(4), lambda: kept.fly(range(1), None)):
        with pytest.raises(ValueError, match=r"reads other numbers than when these flights were declared: call fly"):
            again()


def test_a_law_is_not_refused_for_what_it_does_with_numbers_that_no_flight_meets():
    """At the nominal start, which dispersed flights need not meet, and where the law was once told a density of 1."""

    def bind(law):
        return Campaign(Entry(115.0), START, law, Below("velocity", 480.0), 420.0, 1.0, 4, None, 0)

    def looks_up(density):
        return [0.3, 0.5][int(1e4 * density)]

    def searches(density, velocity):
        while density > 1e-3:
            density = density * 1.0
        return 0.3

    def divides(velocity):
        return {1.0: 0.3}[velocity / (velocity - 5500.0)]

    for law in (looks_up, searches, divides):
        assert bind(law).law.kind[1] is law


LOCAL = """
from __future__ import annotations

from typing import NamedTuple


def law_of_a_test():
    class Command(NamedTuple):
        bank: float

    class Memory(NamedTuple):
        sign: float = 1.0

    def law(sensed, memory) -> tuple[Command, Memory]:
        {returned}

    {given}
"""


@pytest.mark.parametrize("returned", ["return Command(0.3), Memory(-memory.sign)", "return (0.3,), memory"])
def test_a_law_whose_annotations_are_strings_may_stand_within_a_function(returned):
    space = {"bind": lambda law: Campaign(Entry(115.0), START, law, None, 420.0, 1.0, 4, None, 0)}
    exec(LOCAL.format(returned=returned, given="return bind(law)"), space)
    assert space["law_of_a_test"]().flight().parts["memory"]._fields == ("sign",)


def test_flights_are_bound_once(monkeypatch):
    """Binding checks and digests all of them, which every flight would wait for again."""
    bound, bind = [], Campaign.__init__
    monkeypatch.setattr(Campaign, "__init__", lambda self, *given: bound.append(given) or bind(self, *given))
    fly(PROBE, start={"altitude": 500.0}, law=guide, end_time=8.0, trials=2, compiled=False)
    assert len(bound) == 1


def test_a_law_that_remembers_asks_by_name_as_one_that_does_not():
    def told_all(sensed, memory, time) -> tuple[Push, Memory]:
        return Push(0.1 * sensed.speed - 1e-3 * time), Memory(memory.error + sensed.altitude)

    def by_name(speed, altitude, memory, time) -> tuple[Push, Memory]:
        return Push(0.1 * speed - 1e-3 * time), Memory(memory.error + altitude)

    drop = {"start": {"altitude": 500.0}, "end_time": 8.0, "trials": 2, "compiled": False}
    both = [fly(PROBE, law=law, **drop).final["altitude"] for law in (told_all, by_name)]
    np.testing.assert_array_equal(*both)


AROUND = """
from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from elsewhere import Sensed


class Command(NamedTuple):
    of: float
    another: float


def around():
    class Command(NamedTuple):
        bank: float

    class Memory(NamedTuple):
        sign: float = 1.0

    def law(sensed: Sensed, memory: Memory) -> tuple[Command, Memory]:
        return Command(0.3), Memory(-memory.sign)

    return law
"""


def test_annotations_mean_what_stands_around_a_law_and_those_for_a_type_checker_alone_need_not_exist():
    space = {"__name__": "a_module_of_a_user"}
    exec(AROUND, space)
    campaign = Campaign(Entry(115.0), START, space["around"](), None, 420.0, 1.0, 4, None, 0)
    assert campaign.flight().parts["command"]._fields == ("bank",)


def test_a_trigger_is_not_refused_for_a_nominal_start_that_no_trial_has():
    def height(state) -> float:
        return [1.0, 2.0][int(1e6 / (state.altitude - 500.0) ** 2)]

    start = {"altitude": Normal(500.0, 20.0)}
    assert Campaign(PROBE, start, guide, height, 5.0, 1.0, 4, None, 0).ends.names[0] == "ended: height"


UNGUARDED = """
from marsedl.fly import Entry, fly

START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.2}


def law(velocity):
    return 0.3


def main():
    return fly(Entry(115.0), START, law=LAW, end_time=50.0, trials=64, processes=2)


main()
"""


@pytest.mark.parametrize(
    ("law", "how", "told"),
    [
        (
            "law",
            ["unguarded.py"],
            r"processes import .*unguarded.py again: call fly below `if __name__",
        ),
        ("0.3", ["-m", "unguarded"], r"processes import .*unguarded.py again: call fly below `if __name__"),
        ("law", ["-"], r"processes cannot import <stdin>: write the program to a file, or leave processes out"),
        ("law", ["-c", "TEXT"], r"processes cannot import what a notebook defines: put the law into a file"),
        (
            "lambda: 0.3",
            ["-c", "TEXT"],
            r"processes: .*lambda.*; define it at the top of a file",
        ),
    ],
)
def test_processes_that_could_not_find_the_law_are_refused_in_one_sentence(tmp_path, law, how, told):
    text = UNGUARDED.replace("LAW", law)
    (tmp_path / "unguarded.py").write_text(text)
    command = [sys.executable, *(text if part == "TEXT" else part for part in how)]
    done = subprocess.run(command, input=text, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stderr.count("Traceback") == 1
    assert re.search(f"^ValueError: {told}", done.stderr, re.MULTILINE), done.stderr


def test_a_process_that_reads_other_numbers_or_does_not_find_the_law_says_so(monkeypatch):
    def law(velocity):
        return RECORD

    here = sys.modules[__name__]
    monkeypatch.setattr(here, "RECORD", 0.3)
    monkeypatch.setattr(here, "below_the_guard", law, raising=False)
    law.__qualname__ = law.__name__ = "below_the_guard"
    campaign = Campaign(Entry(115.0), START, law, None, 50.0, 1.0, 4, None, 0)
    pickled = pickle.dumps(campaign)
    monkeypatch.setattr(here, "RECORD", 0.5)  # as a process does that does not pass `if __name__`
    with pytest.raises(ValueError, match=r"reads other numbers .* below `if __name__`: set that above"):
        _fly_chunk((pickled, range(1), 1))
    monkeypatch.delattr(here, "below_the_guard")
    with pytest.raises(ValueError, match=r"below_the_guard.*: processes import the script; define the law above"):
        _fly_chunk((pickled, range(1), 1))


def test_flights_under_the_air_are_told():
    start = {"altitude": 1e3, "velocity": 300.0, "flight_path_angle_deg": -80.0}
    with pytest.warns(UserWarning, match=r"2 flights went below -5000 m"):
        steered(Entry(115.0, ground=None), start, trigger=Below("velocity", 10.0), end_time=60.0, trials=2)


def test_what_may_be_meant_otherwise_is_told(flights):
    with pytest.warns(UserWarning, match=r"levels are per cent: for 99% write 99"):
        flights.percentiles("range", 0.99)
    with pytest.warns(UserWarning, match=r"flights start at velocity 5500, beyond the gain table, whose nearest row"):
        steered(CAPSULE, START, law=GainTable({"velocity": [5000.0, 500.0], "bank": [1.0, 0.0]}), trials=2)


def command(velocity) -> Bank:
    return Bank(0.3)


def test_a_law_may_return_its_command_as_one(flights):
    number, whole = (steered(CAPSULE, ERRORS, law=law, trials=3) for law in (0.3, command))
    assert (number.values("range") == whole.values("range")).all()


def test_the_door_opens_without_compiling_anything():
    code = "import sys, marsedl.fly; print('numba' in sys.modules, 'pandas' in sys.modules)"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "False"]
