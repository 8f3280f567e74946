"""What the door of flights refuses, tells and counts: nothing that is given is silently another flight."""

import hashlib
import warnings
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import norm

from marsedl.fly import (
    MARS,
    Above,
    Below,
    Entry,
    Exponential,
    Flights,
    GainTable,
    Lander,
    Markov,
    Model,
    MultivariateNormal,
    Normal,
    Planet,
    Table,
    Uniform,
    Wind,
    fly,
)
from marsedl.fly.declared import declare
from marsedl.models.density_table import read_density_table
from marsedl.montecarlo.flights import Flight

START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
PAIR = ("altitude", "flight_path_angle")
UNITS = {"altitude": "m", "flight_path_angle": "rad"}
LANDED = {"downrange": 0.0, "altitude": 1000.0, "downrange_velocity": 0.0, "vertical_velocity": -10.0, "mass": 900.0}
LANDER = Lander(largest_thrust=9000.0, specific_impulse=220.0)
TITAN = Planet(8.978e12, 2575e3, 4.56e-6)


class State(NamedTuple):
    altitude: float
    speed: float = -20.0
    bias: float = 0.0


class Told(NamedTuple):
    altitude: float
    speed: float


class Push(NamedTuple):
    up: float


class Gain(NamedTuple):
    gain: float = 0.0


def rates(state, command: Push) -> State:
    return State(state.speed, -0.5 * state.speed - 10.0 + command.up, 0.0)


def sense(state) -> Told:
    return Told(state.altitude + state.bias, state.speed)


def push(speed, law: Gain = Gain()):  # noqa: B008
    return law.gain * speed


def exits(state) -> float:
    return state.altitude - 600.0 if state.altitude > 500.0 else -1.0


def never(state) -> bool:
    return state.altitude > 1e9


def rises(state) -> bool:
    return state.speed > -19.0


UNIT = {"altitude": ("m", "altitude"), "speed": ("m/s", "climb rate"), "bias": ("m", "error of the altitude")}
PROBE = Model(Flight(rates, sense=sense), quantities=UNIT, bounds={"speed": (-1e3, 0.0)})
ENTERS = {"end_time": 420.0, "trigger": Below("velocity", 480.0), "trials": 2}
DROPS = {"end_time": 60.0, "trigger": Below("altitude", 0.0), "law": push, "substeps": 2}


def dropped(start, **options):
    return fly(PROBE, start, **DROPS | options)


@pytest.fixture(scope="module")
def drops():
    return dropped({"altitude": Normal(500.0, 20.0), "bias": Normal(0.0, 5.0)}, trials=1000)


# ---- what is flown is what is given ----------------------------------------------------------------------------------


def titan():
    altitude = np.arange(0.0, 1101e3, 50e3)
    scale = 20e3 + 0.05 * altitude  # which grows, so that no slope at a node is that of another height
    return np.column_stack([altitude, 5.4 * np.exp(-altitude / scale)])


@pytest.mark.parametrize("altitude", [400.0, 800.0])
def test_air_follows_the_rows_of_its_table_to_the_top(altitude):
    rows, start = titan(), {"altitude_km": 1000.0, "velocity": 6500.0, "flight_path_angle_deg": -60.0}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flown = fly(
            Entry(115.0, planet=TITAN, air=Table(rows)), start, **ENTERS | {"trigger": Below("altitude_km", altitude)}
        )
    expected = rows[rows[:, 0] == altitude * 1e3, 1]
    np.testing.assert_allclose(flown.final["density"], np.repeat(expected, 2), rtol=1e-9)


def test_nodes_follow_the_start_the_lowest_row_and_the_finest_rows_and_stay_where_nothing_asks_for_others():
    def nodes(entry, altitude):
        model = entry.model()
        start = dict.fromkeys(("latitude", "longitude", "azimuth"), 0.0) | {"altitude": altitude, "velocity": 5e3}
        p = model.complete(model.p, start)
        return p.bottom, p.bottom + p.spacing * (len(p.cells) - 2), p.spacing

    assert nodes(Entry(115.0), 125e3) == (-5e3, 150e3, 250.0)
    assert nodes(Entry(115.0), 400e3) == (-5e3, 425e3, 250.0)
    fine = np.column_stack([np.arange(-7e3, 200e3, 100.0), np.exp(-np.arange(-7e3, 200e3, 100.0) / 1e4)])
    assert nodes(Entry(115.0, air=Table(fine)), 125e3) == (-7e3, 199.9e3, 100.0)
    with pytest.warns(
        UserWarning, match=r"altitude of 1\.3e\+06 m, beyond the rows of the table of air, 0 to 1\.1e\+06"
    ):
        nodes(Entry(115.0, air=Table(titan())), 1300e3)
    for wrong, told in (((0.0, 1e5), "give altitudes"), ((0.0, 1e5, 1e-3), "at most a million")):
        with pytest.raises(ValueError, match=told):
            Entry(115.0, nodes=wrong).model()


def test_flights_above_the_highest_node_are_told_as_those_below_the_lowest_are():
    skips = START | {"flight_path_angle_deg": 5.0}
    with pytest.warns(UserWarning, match=r"2 flights went above 150000 m, the highest node of the air"):
        fly(Entry(115.0), skips, **ENTERS | {"end_time": 60.0})
    sinks = {"altitude": 1e3, "velocity": 300.0, "flight_path_angle_deg": -80.0}
    with pytest.warns(UserWarning, match=r"2 flights went below -5000 m, the lowest node of the air"):
        fly(Entry(115.0, ground=None), sinks, **ENTERS | {"end_time": 60.0, "trigger": Below("velocity", 10.0)})


def test_gain_tables_take_degrees_and_kilometres_by_suffix_and_refuse_degrees_without(tmp_path):
    flown = [
        fly(Entry(115.0, 0.24), START, law=GainTable(columns), **ENTERS).final["range"][0]
        for columns in (
            {"velocity": [6e3, 0.0], "bank": [1.2, 0.9], "range": [0.0, 9e5], "bank_per_range": [1e-7, 2e-7]},
            {
                "velocity": [6e3, 0.0],
                "bank_deg": np.degrees([1.2, 0.9]),
                "range_km": [0.0, 900.0],
                "bank_per_range": [1e-7, 2e-7],
            },
        )
    ]
    np.testing.assert_allclose(flown[0], flown[1], rtol=1e-9)
    for columns, against, told in (
        ({"velocity": [6e3, 0.0], "bank": [68.7, 63.0]}, "velocity", "'bank' holds 68.7 rad, .* name it 'bank_deg'"),
        ({"azimuth": [80.0, 90.0], "bank": [1.0, 1.0]}, "azimuth", "'azimuth' holds 90 rad, .* 'azimuth_deg'"),
        (
            {"velocity": [6e3, 0.0], "bank": [1.0, 1.0], "flight_path_angle": [-14.0, -2.0]},
            "velocity",
            "'flight_path_angle' holds 14 rad",
        ),
        ({"velocity_deg": [6e3, 0.0], "bank": [1.0, 1.0]}, "velocity_deg", "velocity is in m/s, not in a unit of _deg"),
        ({"velocity": [6e3, 0.0], "bank": [1, 1], "bank_deg": [5, 5]}, "velocity", "'bank' is given twice"),
    ):
        with pytest.raises(ValueError, match=told):
            fly(Entry(115.0), START, law=GainTable(columns, against), **ENTERS)


@pytest.mark.parametrize(
    "text", ["\ufeffvelocity,bank\n5500,1.2\n480,0.9\n", "# mine\n\nvelocity,bank\n5500,1.2\n480,0.9\n"]
)
def test_gain_tables_and_density_tables_have_one_reader(tmp_path, text):
    (tmp_path / "law.csv").write_text(text, encoding="utf-8")
    table = GainTable(tmp_path / "law.csv")
    assert table.nodes.tolist() == [480.0, 5500.0] and table.columns["bank"].tolist() == [0.9, 1.2]
    air = text.replace("velocity,bank", "altitude_km,density_kg_m3").replace(
        "5500,1.2\n480,0.9", "0,1.2\n20,0.2\n50,1e-2"
    )
    (tmp_path / "air.csv").write_text(air, encoding="utf-8")
    assert read_density_table(tmp_path / "air.csv")[:, 0].tolist() == [0.0, 20e3, 50e3]
    for read, kind in ((GainTable, "gain"), (read_density_table, "density")):
        for name, content, told in (
            ("short.csv", "velocity,bank\n1,2\n3\n", "short.csv, line 3: 1 values for 2 columns"),
            ("semicolon.csv", "velocity;bank\n1;2\n", "semicolon.csv: write numbers under a line of names"),
            ("none.csv", None, f"none.csv: there is no such {kind} table"),
        ):
            if content:
                (tmp_path / name).write_text(content)
            with pytest.raises(ValueError, match=told):
                read(tmp_path / name)
    (tmp_path / "word.csv").write_text("velocity,bank\n1,much\n2,1\n")
    with pytest.raises(ValueError, match=r"word\.csv, line 2: bank is not a number: 'much'"):
        GainTable(tmp_path / "word.csv")


def test_a_profile_of_air_rises_nowhere_and_is_in_metres_in_arrays_as_in_files(tmp_path):
    rising = np.column_stack([[0.0, 20e3, 40e3], [1e-8, 1e-7, 1e-6]])
    kilometres = np.column_stack([[0.0, 60.0, 120.0], [2e-2, 1e-4, 1e-8]])
    for rows, told in ((rising, "the density rises with altitude"), (kilometres, "is the unit right")):
        file = tmp_path / "air.csv"
        file.write_text("altitude_m,density_kg_m3\n" + "".join(f"{a},{d}\n" for a, d in rows))
        for source in (rows, file):
            with pytest.raises(ValueError, match=told):
                fly(Entry(115.0, air=Table(source)), START, **ENTERS)


# ---- dispersions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "covariance",
    [
        [[1e6, 2.0 * 1e3 * 1e-4], [2.0 * 1e3 * 1e-4, 1e-8]],  # a correlation of 2
        [[1e6, 0.09], [0.05, 1e-8]],  # not symmetric, by less than numpy's absolute tolerance
        [[1e6, 0.0], [0.0, -1e-14]],
        [[1e6, 1e-3], [1e-3, 0.0]],
    ],
)
def test_a_covariance_is_looked_at_as_correlations_whatever_its_units(covariance):
    with pytest.raises(ValueError, match="not symmetric with eigenvalues of at least zero"):
        declare({PAIR: MultivariateNormal([1e5, -0.2], covariance)}, UNITS, {}, "start", {})


def test_the_root_of_a_covariance_is_symmetric_so_that_no_library_chooses_its_signs_or_axes():
    covariance = np.array([[1e6, 0.6 * 1e3 * 1e-4], [0.6 * 1e3 * 1e-4, 1e-8]])
    deviations, root = MultivariateNormal([0.0, 0.0], covariance).root()
    assert (root == root.T).all() and (np.linalg.eigvalsh(root) > 0.0).all()
    np.testing.assert_allclose(np.outer(deviations, deviations) * (root @ root), covariance, rtol=1e-12)
    same = declare({PAIR: MultivariateNormal([1e5, -0.2], np.diag([1e6, 1e-8]))}, UNITS, {}, "start", {})
    single = declare({"altitude": Normal(1e5, 1e3), "flight_path_angle": Normal(-0.2, 1e-4)}, UNITS, {}, "start", {})
    np.testing.assert_allclose(same.sample(3, 0, range(50)), single.sample(3, 0, range(50)), rtol=1e-14)


def test_what_is_drawn_beyond_its_bounds_is_refused_with_how_many_before_anything_flies():
    for flies, start, told in (
        (
            Entry(Normal(115.0, 80.0)),
            START,
            r"ballistic_coefficient must be positive, but \d+ of the trials 0 to 255 draw",
        ),
        (Lander(Normal(9e3, 9e3), 220.0), LANDED, r"largest_thrust must be positive, but \d+ of the trials 0 to 255"),
        (LANDER, LANDED | {"mass": Normal(900.0, 600.0)}, r"mass must be positive, but \d+ of the trials 0 to 255"),
        (PROBE, {"altitude": 1e3, "speed": Normal(-1.0, 1.0)}, r"speed must lie between -1000 and 0, but \d+ of"),
        (Entry(-115.0), START, r"vehicle 'ballistic_coefficient' is -115; it must be positive"),
        (LANDER, LANDED | {"mass": -1.0}, r"start 'mass' is -1; it must be positive"),
        (Lander(9e3, 220.0, smallest_thrust=-1.0), LANDED, r"'smallest_thrust' is -1; it must not be negative"),
        (Entry(115.0), START | {"velocity": -5500.0}, r"start 'velocity' is -5500; it must be positive"),
    ):
        with pytest.raises(ValueError, match=told):
            fly(flies, start, end_time=10.0, trials=256)


def test_a_dispersion_is_refused_by_name_where_none_is_offered():
    wide = Normal(1.0, 0.1)
    for call, told in (
        (lambda: Entry(115.0, planet=wide), r"planet is Normal\("),
        (lambda: Entry(115.0, air=wide), r"air is Normal\("),
        (lambda: Entry(115.0, variation=wide), r"variation is Normal\("),
        (lambda: Entry(115.0, nodes=wide), r"nodes is Normal\("),
        (lambda: Entry(115.0, ground=wide), r"ground is Normal\("),
        (lambda: Entry(115.0, wind=wide), r"wind is Normal\("),
        (lambda: Entry(115.0, wind=Wind(zonal=wide)), r"wind: zonal is Normal\("),
        (lambda: Entry(115.0, wind=Wind(variation=wide)), r"wind: variation is Normal\("),
        (lambda: Entry(115.0, air=Table([[0.0, wide], [1e5, 1e-9]])), r"the table of air is \[\[0.0, Normal\("),
        (lambda: Entry(115.0, air=Exponential(scale_height=wide)), r"Exponential\.scale_height is Normal\("),
        (lambda: Entry(115.0, variation=Markov(wide, 5e3)), r"Markov\.deviation is Normal\("),
        (lambda: Entry(115.0, variation=Markov(0.1, Uniform(1.0, 2.0))), r"Markov\.correlation_length is Uniform\("),
    ):
        with pytest.raises(ValueError, match=told):
            fly(call(), START, **ENTERS)
    with pytest.raises(ValueError, match=r"law\.gain is Normal\("):
        dropped({"altitude": 500.0}, law=partial(push, law=Gain(wide)))
    with pytest.raises(ValueError, match=r"law is Normal\("):
        dropped({"altitude": 500.0}, law=partial(push, law=wide))
    with pytest.raises(ValueError, match=r"the gain table: column 'altitude' is \[0.0, Normal\("):
        GainTable({"altitude": [0.0, wide], "up": [1.0, 1.0]}, against="altitude")
    with pytest.raises(ValueError, match=r"Lander\.gravity is Normal\("):
        fly(Lander(9e3, 220.0, gravity=wide), LANDED, end_time=1.0)
    with pytest.raises(TypeError):
        wide * 2.0  # a tuple would be doubled


# ---- where flights begin and end -------------------------------------------------------------------------------------


def test_trials_that_begin_behind_the_trigger_are_an_outcome_of_their_own():
    for trigger, met in (
        (Below("altitude", 480.0), lambda a: a <= 480.0),
        (Above("altitude", 520.0), lambda a: a >= 520),
    ):
        with pytest.warns(UserWarning, match=r"of 300 flights: trigger met at the start; replay\(\d+\) shows one"):
            flown = dropped({"altitude": Normal(500.0, 20.0)}, trigger=trigger, trials=300, history=30.0)
        behind = met(flown.histories[0, 0])
        assert 0 < behind.sum() < 300
        assert ((flown.outcome == "trigger met at the start") == behind).all()
        assert flown.replay(int(np.flatnonzero(behind)[0])).outcome == "trigger met at the start"


def far(sensed) -> float:
    return 500e3 - sensed.range


def test_triggers_have_names_and_hold_all_that_is_known():
    """A range, a drag, a time and a function: each ends the flights that it should, at the value that it has."""
    steep = START | {"flight_path_angle_deg": Uniform(-16.0, -11.0)}
    triggers = {"slow": Below("velocity", 4500.0), "far": far, "felt": Above("drag", 70.0), "late": Above("time", 95.5)}
    options = {"end_time": 200.0, "trials": 100, "seed": 4}
    flights = fly(Entry(Uniform(80.0, 200.0)), steep, trigger=triggers, **options)
    final, outcome = flights.final, flights.outcome
    assert {*flights.outcomes()} == {*triggers}
    np.testing.assert_allclose(final["velocity"][outcome == "slow"], 4500.0, atol=1e-9)
    np.testing.assert_allclose(final["range"][outcome == "far"], 500e3, atol=1e-6)
    np.testing.assert_allclose(final["drag"][outcome == "felt"], 70.0, atol=1e-9)
    np.testing.assert_allclose(final["end_time"][outcome == "late"], 95.5, atol=1e-9)
    for name, sign, value in (
        ("velocity", 1, 4200.0),
        ("range", -1, 500e3),
        ("drag", -1, 70.0),
        ("end_time", -1, 95.5),
    ):
        assert (sign * (final[name] - value) > -1e-6).all()  # none went on
    for trial in [int(np.flatnonzero(outcome == name)[0]) for name in triggers]:
        alone = flights.replay(trial, in_python=True)
        assert alone.outcome == outcome[trial] and alone.final == flights.replay(trial).final
        assert all(alone.final[name] == final[name][trial] for name in final)
    note = flights.percentiles("range")["note"].iloc[0]
    assert all(name in note for name in ("far", "felt", "late")) and "slow" not in note


def test_the_last_row_of_a_history_is_the_end():
    flight = fly(Entry(115.0), START, **ENTERS | {"trials": 1}).replay(0)
    last = flight.history.iloc[-1]
    assert flight.history.index[-1] == flight.final["end_time"]
    assert all(last[name] == flight.final[name] for name in flight.history if name != "bank")
    assert abs(last["velocity"] - 480.0) < 1e-9 and flight.history.index.is_monotonic_increasing
    whole = fly(Entry(115.0), START, end_time=20.0, trials=1).replay(0).history  # that no trigger ends
    assert len(whole) == 20 * 4 + 1


@pytest.mark.parametrize("trigger", [exits, rises])
def test_a_function_that_is_met_at_the_start_is_refused_and_by_some_trials_an_outcome(trigger):
    met = {"altitude": 400.0, "speed": -18.0}
    with pytest.raises(ValueError, match=rf"{trigger.__name__}: this trigger is met at the start; .* positive until"):
        dropped(met, trigger=trigger)
    with pytest.warns(UserWarning, match="trigger met at the start"):
        flown = dropped(
            {"altitude": Normal(650.0, 50.0), "speed": Normal(-20.0, 1.0)}, trigger=trigger, trials=100, history=60.0
        )
    start = flown.histories[0]
    behind = start[0] <= 600.0 if trigger is exits else start[1] > -19.0
    assert 0 < behind.sum() < 100
    assert ((flown.outcome == "trigger met at the start") == behind).all()


def test_the_extremes_of_a_flight_include_its_end():
    final = fly(Entry(115.0), START, **ENTERS).final
    assert (final["min_altitude"] == final["altitude"]).all()
    loaded = fly(Entry(115.0), START, **ENTERS | {"trigger": Below("velocity", 4000.0)}).final  # where the load rises
    assert (loaded["max_load"] == loaded["drag"]).all()
    climbs = START | {"flight_path_angle_deg": 5.0}
    climbed = fly(Entry(115.0), climbs, **ENTERS | {"trigger": Above("altitude_km", 140.0)}).final
    assert (climbed["max_altitude"] == climbed["altitude"]).all()


def test_flights_end_on_the_ground_unless_told_otherwise():
    low = {"altitude": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
    crashed = fly(Entry(115.0), low, **ENTERS | {"end_time": 2.0})
    assert crashed.outcomes() == {"on the ground": 2}
    np.testing.assert_allclose(crashed.final["altitude"], 0.0, atol=1e-9)
    lost = crashed.percentiles("range")  # they were to reach their velocity
    assert lost["value"].isna().all() and lost["note"].str.endswith("2 on the ground of 2 flights left out").all()
    landed = fly(replace(LANDER, ground=900.0), LANDED, end_time=20.0, trials=2)
    assert landed.outcomes() == {"on the ground": 2}
    np.testing.assert_allclose(landed.final["altitude"], 900.0, atol=1e-9)
    assert landed.percentiles("vertical_velocity")["value"].notna().all()  # they were to reach nothing else
    with pytest.raises(
        ValueError, match=r"altitude below 900 is met at the start, .* the model has this end, such as its ground"
    ):
        fly(replace(LANDER, ground=900.0), LANDED | {"altitude": 800.0}, end_time=20.0, trials=2)
    with pytest.warns(UserWarning, match=r"2 flights went below the ground at 0 m, down to -[\d.]+ m: a trigger"):
        fly(Entry(115.0), low, **ENTERS | {"trigger": never, "end_time": 2.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fly(replace(LANDER, ground=None), LANDED, end_time=20.0, trials=2)
        fly(Entry(115.0, ground=-9e3), low, **ENTERS | {"end_time": 2.0})


@pytest.mark.parametrize("dry_mass", [0.0, 700.0])
def test_a_lander_without_propellant_has_no_thrust_and_is_an_outcome(dry_mass):
    start, lander = LANDED | {"altitude": 9e4}, replace(LANDER, dry_mass=dry_mass, ground=None)
    with pytest.warns(UserWarning, match=r"3 of 3 flights: out of propellant; replay\(0\)"):
        flown = fly(lander, start, law=(0.0, 9e3), end_time=400.0, substeps=10, trials=3)
    assert flown.outcomes() == {"out of propellant": 3}
    np.testing.assert_allclose(flown.final["mass"], dry_mass, rtol=1e-9, atol=2e-9)
    if dry_mass:  # Tsiolkovsky's equation
        speed = 220.0 * 9.80665 * np.log(900.0 / dry_mass) - 3.71 * 400.0 - 10.0
        np.testing.assert_allclose(flown.final["vertical_velocity"], speed, rtol=1e-10)
        assert flown.replay(0).history["mass"].min() >= dry_mass * (1.0 - 1e-9)
        assert flown.replay(0, in_python=True).final == flown.replay(0).final
    with (
        pytest.raises(ValueError, match="start 'mass' is 600; it must be at least 700")
        if dry_mass
        else warnings.catch_warnings()
    ):
        fly(lander, start | {"mass": 600.0}, law=(0.0, 0.0), end_time=1.0, trials=1)


def test_results_hold_the_state_and_what_is_sensed_under_names_of_its_own(drops):
    assert drops.outcomes() == {"ended: altitude below 0": 1000}
    np.testing.assert_allclose(drops.final["altitude"], 0.0, atol=1e-9)
    sensed, bias = drops.final["sensed_altitude"], drops.final["bias"]
    np.testing.assert_allclose(sensed - drops.final["altitude"], bias, atol=1e-9)
    assert bias.std() > 4.0
    data = dropped({"altitude": 500.0, "bias": 3.0}, trials=1, history=1.0).to_xarray()
    np.testing.assert_array_equal(data["sensed_altitude_history"] - data["altitude_history"], data["bias_history"])
    assert data["sensed_altitude"].attrs == {"units": "m", "long_name": "altitude, as laws are told"}
    assert not [name for name in fly(Entry(115.0), START, **ENTERS).final if name.startswith("sensed_")]


# ---- arguments -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"seed": -1}, r"seed is -1; give"),
        ({"seed": None}, r"seed is None; give"),
        ({"seed": 1.5}, r"seed is 1.5; give"),
        ({"end_time": "420"}, r"end_time is '420' s; it must be positive"),
        ({"period": None}, r"period is None s; it must be positive"),
        ({"end_time": np.inf}, r"end_time is inf s"),
        ({"substeps": "4"}, r"substeps is '4'; give the integration steps"),
        ({"history": "1"}, r"history is '1'; give the seconds"),
        ({"trigger": Below("altitude", np.nan)}, r"its value must be a finite number"),
        ({"trigger": Above("altitude", "high")}, r"its value must be a finite number"),
        ({"law": np.nan}, r"law nan: a constant command is 1 numbers: up; they are finite"),
        ({"law": (Normal(1.0, 1.0),)}, r"a constant command is 1 numbers: up; they are finite"),
        ({"start": [500.0, -20.0]}, r"start is of type list: give a mapping from names to numbers"),
        ({"start": np.ones(2)}, r"start is of type ndarray: give a mapping"),
    ],
)
def test_arguments_are_looked_at_where_they_are_given(options, told):
    with pytest.raises(ValueError, match=told) as error:
        fly(PROBE, **{"start": {"altitude": 500.0}} | DROPS | options)
    assert "\n" not in str(error.value)


def test_numbers_of_numpy_are_numbers_and_seeds_may_be_of_any_size():
    start, options = {"altitude": Normal(500.0, 9.0)}, {"trials": 2, "end_time": np.float32(60.0)}
    constants = [
        dropped(start, law=law, seed=2**63 - 1, **options).numbers for law in (1.0, np.float32(1.0), np.int64(1))
    ]
    assert (constants[0] == constants[1]).all() and (constants[0] == constants[2]).all()
    starts = {seed: dropped(start, seed=seed, **options) for seed in (2**63 - 1, 2**63, np.uint64(2**63), 2**100)}
    assert len({flights.drawn["start_altitude"][1] for flights in starts.values()}) == 3
    hashed = int(hashlib.sha256(str(2**100).encode()).hexdigest()[:16], 16)
    key = int.from_bytes(hashed.to_bytes(8, "big"), "little") // 2
    assert starts[2**100].campaign.seed == key < 2**63
    assert (dropped(start, seed=key, **options).numbers == starts[2**100].numbers).all()


@pytest.mark.parametrize(
    ("planet", "start", "told"),
    [
        (Planet(42828.0, 3389.5, 7.0882e-5), {}, r"give m\^3/s\^2, m and rad/s"),
        (MARS._replace(radius=3389.5), {}, r"give m\^3/s\^2, m and rad/s"),
        (MARS._replace(rotation_rate=np.degrees(MARS.rotation_rate)), {}, r"give m\^3/s\^2, m and rad/s"),
        (MARS, {"flight_path_angle": 5.0}, r"is 5; it must lie between -1.571 and 1.571; for degrees write"),
        (MARS, {"latitude": 5.0}, r"is 5; it must lie between -1.571 and 1.571; for degrees write 'latitude_deg'"),
        (MARS, {"latitude_deg": 100.0}, r"is 100; it must lie between -90 and 90"),
    ],
)
def test_numbers_in_other_units_are_told(planet, start, told):
    start = {"altitude": 125e3, "velocity": 5500.0, "flight_path_angle": -0.24} | start
    with pytest.raises(ValueError, match=told):
        fly(Entry(115.0, planet=planet), start, **ENTERS)


def test_a_velocity_in_kilometres_a_second_is_told():
    with pytest.warns(UserWarning, match=r"flights start at a velocity of 5.5 m/s: is it in km/s\?"):
        fly(Entry(115.0), START | {"velocity": 5.5}, **ENTERS | {"trigger": Below("altitude_km", 100.0)})


def test_questions_to_flights_are_looked_at(drops):
    for call, told in (
        (lambda: drops.extended(1000), "extended takes more trials than the 1,000 that are flown, got 1,000"),
        (lambda: drops.extended(1e4), "trials must be a whole number"),
        (lambda: drops.percentiles("altitude", confidence=95), "confidence is 95; give a share between 0 and 1"),
        (lambda: drops.against(drops, confidence=95), "confidence is 95; give a share"),
        (lambda: drops.percentiles("altitude", ["p99"]), "give numbers of per cent, such as 99"),
        (
            lambda: drops.percentiles([drops.final["speed"]]),
            "quantity of type ndarray: give a name; of numbers of your",
        ),
        (lambda: drops.percentiles(drops.final["speed"]), "quantity of type float64: give a name"),
        (lambda: drops.against("these"), "against takes Flights, not str"),
        (lambda: drops.worst("speed", -1), "count must be a whole number of at least 1"),
        (lambda: drops.until(99), "goal 99 is not of the form"),
        (lambda: drops.until("p100 of speed within 1 %"), "level 100 is no percentage"),
        (lambda: dropped(drops), "start is of type Flights: give a mapping"),
    ):
        with pytest.raises(ValueError, match=told):
            call()


# ---- statistics ------------------------------------------------------------------------------------------------------


def test_until_says_what_it_takes_and_keeps_what_is_flown(drops):
    with pytest.raises(ValueError, match=r"an interval of p99.9 takes 10,000 flights; at_most is 5,000"):
        drops.until("p99.9 of bias within 5 %", at_most=5000)
    goal = "p50 of end_time within 1e-6 %"
    told = r"not reached after 2 looks: the half-width is .* s: wanted is .* s; of a value of .* s ask for a width in s"
    with pytest.warns(UserWarning, match=told):
        more = drops.until(goal, at_most=2000)
    assert more.trials == 2000 and (more.numbers[:, :1000] == drops.numbers).all()
    assert (more.search.goal, more.search.reached, more.search.looks) == (goal, False, 2)
    assert f"{goal!r} is not reached after 2 looks" in repr(more)
    assert more.percentiles("end_time", 50)["note"].iloc[0] == "`until` looked 2 times"
    assert more.extended(2001).search is None, "a number chosen beforehand"


def test_until_tells_that_no_percentage_can_be_had_about_zero(drops):
    centred = drops.with_quantity("off", lambda known: known["bias"] - np.median(drops.final["bias"]), "m")
    with pytest.warns(UserWarning, match=r"about zero a percentage takes more than 1,000,000 flights: ask for a wid"):
        told = centred.until("p50 of off within 1 %")
    assert told.trials == 1000 and not told.search.reached
    assert centred.until("p50 of off within 1e3 m").search.reached


@pytest.mark.parametrize(("count", "confidence"), [(5, 0.95), (2, 0.9), (30, 0.95)])
def test_differences_of_few_flights_have_intervals_that_hold_as_often_as_they_say(drops, count, confidence):
    repeats, rng = 4000, np.random.Generator(np.random.Philox(4))
    place, held = [*drops.final].index("speed"), 0

    def of(numbers):
        table = np.repeat(drops.numbers[:, :1], count, axis=1)
        table[place] = numbers
        return Flights(drops.campaign, table, drops.outcome[:count], None, drops.how)

    for first, second in rng.standard_normal((repeats, 2, count)):
        row = of(first + 0.3).against(of(second), ["speed"], confidence).iloc[0]
        held += row["lower"] <= 0.3 <= row["upper"]
    assert abs(held / repeats - confidence) < 4 * np.sqrt(confidence * (1 - confidence) / repeats)


@pytest.mark.parametrize(("count", "level"), [(200, 0.95), (300, 0.05), (1500, 0.99)])
def test_three_errors_of_a_percentile_hold_it_at_the_edge_of_its_tail(count, level):
    from marsedl.montecarlo.statistics import order_interval, percentile

    samples = np.random.Generator(np.random.Philox(6)).standard_normal((4000, count))
    values, errors = np.array([percentile(row, level) for row in samples]).T
    beyond = np.mean(np.abs(values - norm.ppf(level)) > 3.0 * errors)
    assert beyond < 0.0027 + 3 * np.sqrt(0.0027 / 4000)
    for few in (199, 200):  # an error, or an interval: both or neither
        assert np.isnan(percentile(samples[0, :few], 0.95)[1]) == np.isnan(order_interval(samples[0, :few], 0.95)[0])


@pytest.mark.parametrize(
    "triggers",
    [
        [Above("drag", 20.0), Above("range_km", 60.0), Above("density", 1e-4), Below("energy", 2e6)],
        [Above("time", 12.5), Below("altitude_km", 50.0), Above("latitude_deg", 0.3)],
    ],
)
def test_flights_end_by_all_that_is_known_and_those_on_the_same_kind_of_quantity_share_a_kernel(triggers):
    start, kinds = START | {"altitude_km": 60.0, "azimuth_deg": 45.0}, set()
    for trigger in triggers:
        flown = fly(Entry(115.0), start, trigger=trigger, law=0.0, end_time=60.0, trials=1, substeps=2, compiled=False)
        (outcome,) = flown.outcomes()
        assert outcome.startswith(f"ended: {trigger.quantity} ")
        at_end = flown.final["end_time"] if trigger.quantity == "time" else flown.values(trigger.quantity)
        np.testing.assert_allclose(at_end, trigger.value, rtol=1e-9)
        kinds.add(flown.campaign.ends.kind)
    assert len(kinds) == 1


def test_flights_end_by_their_energy_which_laws_are_told():
    def energy(numbers):
        return numbers["velocity"] ** 2 / 2.0 - MARS.gravitational_parameter / (MARS.radius + numbers["altitude"])

    options = {"end_time": 300.0, "trials": 1, "compiled": False, "substeps": 2}
    still, start = MARS._replace(rotation_rate=0.0), START | {"altitude_km": 60.0}
    conserved = fly(Entry(115.0, planet=still, air=None), start, law=0.0, **options | {"end_time": 20.0}).final
    begun = {"velocity": 5500.0, "altitude": 60e3}
    np.testing.assert_allclose(conserved["energy"], energy(begun), rtol=1e-9)
    braked = fly(Entry(115.0), start, law=lambda energy: 1.0 if energy > 1e6 else -1.0, history=1.0,
                 trigger=Below("energy", -1e6), **options)  # fmt: skip
    assert braked.outcomes() == {"ended: energy below -1e+06": 1}
    np.testing.assert_allclose(energy(braked.final), -1e6, atol=1e-3)
    history = braked.to_xarray().isel(trial=0).dropna("time")
    assert (history["bank_history"] == np.where(history["energy_history"] > 1e6, 1.0, -1.0)).all()
    assert history["energy_history"].attrs["units"] == "m^2/s^2" and (history["bank_history"] < 0.0).any()
