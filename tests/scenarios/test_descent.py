"""The descent flies by its equations, its laws do what their theory says, and its files say what they must."""

from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from scipy.linalg import expm
from scipy.stats import chi2

from marsedl.fly import Lander, Model, fly
from marsedl.methods.covariance_steering.closed_form import SteeringProblem, steer
from marsedl.replication.errors import InputError
from marsedl.scenarios.descent import dynamics
from marsedl.scenarios.descent.dynamics import State, Thrust
from marsedl.scenarios.descent.onboard import PLANE
from marsedl.scenarios.descent.scenario import SCENARIO

ROOT = Path(__file__).parents[2]
FINAL = 41.0  # s, at which the paper ends


@pytest.fixture(scope="module")
def scenario():
    return SCENARIO.load(ROOT)


@pytest.fixture(scope="module")
def laws(scenario):
    return {name: scenario.law(name) for name in scenario.residents}


@pytest.fixture(scope="module")
def calm(scenario):
    """Arguments of `fly` without any dispersion."""
    flight, start = scenario.flight("exact"), scenario.onboard.start
    quiet = replace(flight["flies"], p=flight["flies"].p._replace(noise=0.0))
    places = dict(zip(State._fields, start, strict=False)) | {"mass": 1500.0}
    gusts = dict.fromkeys(("gust_downrange", "gust_crossrange", "gust_vertical"), 0.0)
    return flight | {"flies": quiet, "start": places | gusts}


@pytest.fixture(scope="module")
def undispersed(calm, laws):
    """One flight of each law along the mean, with its history."""
    return {name: fly(**calm, law=law, trials=1, history=0.2) for name, law in laws.items()}


@pytest.fixture(scope="module")
def sampled(scenario, laws):
    """Flights of the closed form in the exact tier."""
    return fly(**scenario.flight("exact"), law=laws["closed_form"], trials=2000, seed=3, history=1.0)


# ---- the equations ---------------------------------------------------------------------------------------------------


def bare(**changed):
    """The equations without actuators or noise, and where they start."""
    p = dynamics.Parameters(gravity=3.71, mass_flow=1.0 / (210.0 * 9.80665), dry_mass=1300.0, noise=0.0)
    return Model(dynamics.FLIGHT, p=p, vehicle=dynamics.Vehicle(1800.0, 18e3)._replace(**changed))


GUSTS = dict.fromkeys(("gust_downrange", "gust_crossrange", "gust_vertical"), 0.0)
START = dict(zip(State._fields, (-100.0, 30.0, 900.0, 20.0, -4.0, 10.0, 1500.0), strict=True))


def test_without_thrust_and_gusts_it_falls_on_a_parabola_and_burns_nothing():
    flown = fly(bare(), START | GUSTS, law=(0.0, 0.0, 0.0), end_time=10.0, trials=1, compiled=False).final
    assert flown["downrange"][0] == pytest.approx(-100.0 + 20.0 * 10.0, rel=1e-13)
    assert flown["crossrange"][0] == pytest.approx(30.0 - 4.0 * 10.0, rel=1e-13)
    assert flown["altitude"][0] == pytest.approx(900.0 + 10.0 * 10.0 - 0.5 * 3.71 * 100.0, rel=1e-13)
    assert flown["vertical_velocity"][0] == pytest.approx(10.0 - 37.1, rel=1e-13)
    assert flown["mass"][0] == 1500.0


def test_in_the_plane_it_is_the_lander_of_the_front_door():
    """Also where the thrust is cut to both of its limits."""

    def planar(time, altitude):
        return 9000.0 * np.sin(0.7 * time), 6000.0 + 40.0 * altitude * np.cos(time)

    def in_space(time, altitude) -> Thrust:
        downrange, vertical = planar(time, altitude)
        return Thrust(downrange, 0.0, vertical)

    options = {"end_time": 20.0, "period": 0.5, "substeps": 2, "trials": 1, "compiled": False}
    start = START | {"crossrange": 0.0, "crossrange_velocity": 0.0}
    ours = fly(bare(), start | GUSTS, law=in_space, **options).final
    door = Lander(18e3, 210.0, 1800.0, gravity=3.71, dry_mass=1300.0, ground=None)
    plane = {name: value for name, value in start.items() if "crossrange" not in name}
    theirs = fly(door, plane, law=planar, **options).final
    assert theirs["max_command"][0] > 18e3 and theirs["min_command"][0] < 6000.0
    for name in plane:
        assert ours[name][0] == pytest.approx(theirs[name][0], rel=1e-12)
    assert ours["crossrange"][0] == ours["crossrange_velocity"][0] == 0.0


def test_turned_about_the_vertical_it_flies_the_same():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])  # its ratios are those of 3, 4 and 5
    options = {"end_time": 20.0, "trials": 1, "compiled": False}
    level, turned = dict(START), dict(START)
    for ahead, across in (("downrange", "crossrange"), ("downrange_velocity", "crossrange_velocity")):
        turned[ahead], turned[across] = turn @ (START[ahead], START[across])
    straight = fly(bare(), level | GUSTS, law=(4e3, -3e3, 6e3), **options).final
    aside = fly(bare(), turned | GUSTS, law=(*(turn @ (4e3, -3e3)), 6e3), **options).final
    for ahead, across in (("downrange", "crossrange"), ("downrange_velocity", "crossrange_velocity")):
        ends = turn @ (straight[ahead][0], straight[across][0])
        np.testing.assert_allclose((aside[ahead][0], aside[across][0]), ends, rtol=1e-12)
    assert aside["altitude"][0] == pytest.approx(straight["altitude"][0], rel=1e-12)


def test_without_propellant_there_is_no_thrust():
    start = START | {"mass": 1299.0}
    flown = fly(bare(), start | GUSTS, law=(0.0, 0.0, 9e3), end_time=2.0, trials=1, compiled=False).final
    assert flown["vertical_velocity"][0] == pytest.approx(10.0 - 3.71 * 2.0, rel=1e-13)


# ---- laws along the mean flight --------------------------------------------------------------------------------------


def test_the_closed_form_ends_on_the_final_mean_of_the_paper(undispersed, scenario):
    """But for what a hold and a lag leave of a smooth profile."""
    state = undispersed["closed_form"].histories[round(FINAL / 0.2), :6, 0]
    np.testing.assert_allclose(state, scenario.onboard.goal, atol=0.05)


def test_every_law_lands_in_the_box_along_the_mean_and_asks_for_no_truth(undispersed, scenario):
    for name, flights in undispersed.items():
        scores = scenario.scores(flights)
        assert flights.truth == ()
        assert scores["inside"][0] == 1.0 and scores["miss"][0] < 0.5, name
        assert scores["crossrange_miss"][0] == 0.0


def test_the_fuel_optimal_reference_burns_least_and_lies_on_its_limits(undispersed, scenario, laws):
    """As Pontryagin's principle says: between its limits the thrust is only where it switches."""
    burnt = {name: 1500.0 - flights.histories[round(FINAL / 0.2), 6, 0] for name, flights in undispersed.items()}
    assert min(burnt, key=burnt.get) == "fuel_optimal"
    columns = laws["fuel_optimal"].columns
    thrust = np.sqrt(sum(columns[name] ** 2 for name in Thrust._fields))[:-1]
    low, high = 1800.0 + 0.15 * 18e3, (1.0 - 0.15) * 18e3
    between = (thrust > 1.01 * low) & (thrust < 0.99 * high)
    assert between.mean() < 0.1


class Rows(NamedTuple):
    """Of a gain table at the cycles."""

    commands: np.ndarray  # (N, 3)
    states: np.ndarray  # (N, 6)
    gains: np.ndarray  # (N, 3, 6)


def component(place, row, nav, law):
    command = law.commands[row, place]
    for number in range(6):
        command = command + law.gains[row, place, number] * (nav[number] - law.states[row, number])
    return command


def follow(time, nav, law) -> Thrust:
    row = min(int(5.0 * time + 0.5), len(law.commands) - 1)
    return Thrust(component(0, row, nav, law), component(1, row, nav, law), component(2, row, nav, law))


def rows_of(table):
    names = State._fields[:6]
    gains = [[table.columns[f"{command}_per_{name}"] for name in names] for command in Thrust._fields]
    commands, states = ([table.columns[name] for name in of] for of in (Thrust._fields, names))
    return Rows(np.transpose(commands), np.transpose(states), np.transpose(gains, (2, 0, 1)))


def test_a_table_of_gains_and_a_function_fly_the_same(calm, laws):
    start = calm["start"] | {"downrange": 260.0, "crossrange": -8.0, "vertical_velocity": -15.0}
    options = calm | {"start": start, "trials": 1, "compiled": False}
    by_table = fly(**options, law=laws["regulator"]).final
    by_function = fly(**options, law=partial(follow, law=rows_of(laws["regulator"]))).final
    for name in by_table:
        np.testing.assert_allclose(by_function[name], by_table[name], rtol=1e-9, atol=1e-9, err_msg=name)


# ---- linear covariance -----------------------------------------------------------------------------------------------


def predicted_covariance(scenario, table):
    """Of the six states at the final time: linear, with held commands and the lag of the thrust.

    Beside the states is the thrust that was reached, which goes to its command over each cycle.
    """
    onboard, cycle, lag = scenario.onboard, scenario.given.lander.cycle, scenario.given.lander.lag
    gains = rows_of(table).gains
    for k, time in enumerate(onboard.time[:-1]):
        mass, gain = float(onboard.mass(time + 0.5 * cycle)), gains[k]
        if k == 0:  # the thrust begins where it is first commanded
            begins = np.vstack([np.eye(6), gain])
            covariance = begins @ onboard.start_covariance @ begins.T
        rates = np.zeros((12, 12))  # states, thrust, command
        rates[:3, 3:6] = np.eye(3)
        rates[3:6, 6:9] = np.eye(3) / mass
        rates[6:9, 6:9], rates[6:9, 9:] = -np.eye(3) / lag, np.eye(3) / lag
        commanded = np.vstack([np.eye(9), np.hstack([gain, np.zeros((3, 3))])])
        across = (expm(rates * cycle) @ commanded)[:9]
        intensity = (onboard.p.noise / mass) ** 2
        fresh = np.zeros((9, 9))
        fresh[:3, :3] = intensity * cycle**3 / 3.0 * np.eye(3)
        fresh[:3, 3:6] = fresh[3:6, :3] = intensity * cycle**2 / 2.0 * np.eye(3)
        fresh[3:6, 3:6] = intensity * cycle * np.eye(3)
        covariance = across @ covariance @ across.T + fresh
    return covariance[:6, :6]


def test_where_laws_know_the_state_covariances_are_those_predicted(scenario, laws, sampled):
    """The sum of squared deviations over the predicted ones is chi-square, of all components of all flights."""
    predicted = predicted_covariance(scenario, laws["closed_form"])
    deviations = sampled.histories[round(FINAL), :6] - scenario.onboard.goal[:, None]
    squared = np.sum(deviations * np.linalg.solve(predicted, deviations))
    freedom = deviations.size
    low, high = chi2.ppf([0.001, 0.999], freedom)
    assert low < squared < high


def test_a_law_without_a_table_also_lands_as_linear_covariance_says(scenario, laws):
    """Of flights that move one normal number each, through hold, lag, law and touchdown."""
    flights = fly(**scenario.flight("exact"), law=laws["zem_zev"], trials=1000, seed=6)
    budget = flights.budget("crossrange")
    assert budget.linear and abs(budget.flown - budget.deviation) < 3.0 * budget.flown_error
    shares = budget.shares.groupby("kind")["share"].sum()
    assert shares["noise"] + shares["start"] == pytest.approx(1.0)  # nothing else is dispersed


def test_the_closed_form_reaches_the_covariance_of_the_paper(scenario, sampled):
    """It is designed for continuous commands: a hold and a lag of a fifth of a second leave a few percent."""
    deviations = sampled.histories[round(FINAL), :6].std(axis=1)
    asked = np.sqrt(np.diag(scenario.onboard.goal_covariance))
    np.testing.assert_allclose(deviations, asked, rtol=0.1)


def test_the_mean_of_the_cone_program_is_that_of_the_closed_form_over_one_segment(scenario):
    """Two formulations, where no limit decides; commands that are held for 2 s leave some decimetres."""
    onboard = copy(scenario.onboard)
    onboard.lander = onboard.lander.model_copy(update={"glide_slope": 1e-3})
    time = np.linspace(0.0, FINAL, 2051)
    mass = float(onboard.mass(0.5 * FINAL))
    a, b = np.kron([[0.0, 1.0], [0.0, 0.0]], np.eye(2)), np.kron([[0.0], [1.0 / mass]], np.eye(2))
    problem = SteeringProblem.from_linear_model(
        time,
        (a, b, [0.0, 0.0, 0.0, -3.71]),
        initial_mean=onboard.start[PLANE],
        final_mean=onboard.goal[PLANE],
        initial_covariance=onboard.given.entry.initial_covariance,
        final_covariance=onboard.given.mission.final_covariance,
        noise_density=onboard.p.noise,
    )
    mean = steer(problem).mean[:-1:10]
    designed = rows_of(scenario.residents["cone_program"].design(onboard)).states[:-1][:, PLANE]
    np.testing.assert_allclose(designed, mean, atol=0.5)


def test_a_trial_alone_is_the_trial_of_the_set(scenario, laws):
    campaign = scenario.campaign(laws["apollo"], "dispersed", 5)
    whole = campaign.fly_all(0, 40, 1, False, True)
    alone = campaign.fly_all(17, 18, 1, False, True)
    np.testing.assert_array_equal(alone[0][:, 0], whole[0][:, 17])
    assert alone[1][0] == whole[1][17]


# ---- the scenario ----------------------------------------------------------------------------------------------------


def test_in_the_plane_nothing_leaves_it(scenario, laws):
    flights = fly(**scenario.flight("plane"), law=laws["apollo"], trials=2, seed=4, compiled=False)
    for name in ("crossrange", "gust_crossrange"):
        assert not flights.final[name].any()
    assert flights.final["gust_downrange"].all()


def test_every_condition_flies_and_is_another_one(scenario, laws):
    """No two of them end in the same way."""
    ends, options = {}, {"law": laws["zem_zev"], "trials": 1, "seed": 2}
    for name in scenario.conditions:
        flights = fly(**scenario.flight(name), **options)
        scores = scenario.scores(flights)
        assert {*scores} == {*scenario.columns}
        ends[name] = tuple(flights.final[of][0] for of in ("downrange", "crossrange", "end_time", "mass"))
    assert len({*ends.values()}) == len(ends)


def test_what_is_counted_is_what_histories_show(scenario, laws):
    options = scenario.flight("dispersed")
    flights = fly(**options, law=laws["regulator"], history=options["period"], trials=2, seed=1, compiled=False)
    stored, scores, goal = flights.to_xarray(), scenario.scores(flights), scenario.onboard.goal
    level = [stored[f"{name}_history"].values - goal[row] for row, name in enumerate(("downrange", "crossrange"))]
    high = stored["altitude_history"].values
    angles = np.where(high > 10.0, np.arctan2(np.sqrt(level[0] ** 2 + level[1] ** 2), high), np.nan)
    commands = [stored[f"commanded_{name}_history"].values for name in Thrust._fields]
    np.testing.assert_allclose(scores["widest_angle"], np.nanmax(angles, axis=0))
    # The last state of a history is that of the end, with the command before it.
    np.testing.assert_allclose(
        scores["largest_command"], np.nanmax(np.sqrt(np.sum(np.square(commands), axis=0)), axis=0)
    )
    upright = np.arctan2(
        np.hypot(*(flights.final[name] for name in Thrust._fields[:2])), flights.final["thrust_vertical"]
    )
    np.testing.assert_allclose(scores["tilt"], upright, rtol=1e-14)


def test_flights_that_do_not_land_are_named_and_have_no_scores(scenario, laws):
    flights = fly(**scenario.flight("dispersed"), law=laws["no_feedback"], trials=2000, seed=1)
    scores, landed = scenario.scores(flights), flights.outcome == "touchdown"
    assert {*flights.outcomes()} == {"touchdown", "crashed", "toppled", "out of time"}
    for name, values in scores.items():
        assert (np.isfinite(values) == (landed | (name == "inside"))).all()
    assert not scores["inside"][~landed].any()
    high = flights.outcome == "out of time"
    assert (flights.final["altitude"][high] > 0.0).all()
    for name in ("gust_downrange", "gust_crossrange"):  # which do not change when the flight ends
        assert flights.final[name].std() == pytest.approx(125.0, rel=4.0 / np.sqrt(2.0 * flights.trials))


def written(path, **sections):
    """A user's file; all of its inputs are assumed."""
    sourced = {
        section: {key: {"value": value, "source": "assumed: test"} for key, value in inputs.items()}
        for section, inputs in sections.items()
    }
    path.write_text(yaml.safe_dump({"based_on": "descent", **sourced}))
    return SCENARIO.load(ROOT, path)


def test_another_lander_of_a_users_own_flies_by_the_same_laws(tmp_path):
    own = written(
        tmp_path / "heavy.yaml",
        vehicle={"wet_mass": 1700.0},
        lander={"propellant": 260.0, "cycle": 0.5},
        truth={"start_factor": 0.0, "noise_factor": 0.0},
    )
    for name in ("closed_form", "fuel_optimal", "apollo"):
        flights = fly(**own.flight("exact"), law=own.law(name), trials=1, compiled=False)
        assert own.scores(flights)["inside"][0] == 1.0, name


def test_propellant_ends_a_flight_under_its_name(tmp_path):
    own = written(tmp_path / "dry.yaml", lander={"propellant": 100.0})
    flights = fly(**own.flight("exact"), law=own.law("apollo"), trials=1, compiled=False)
    assert flights.outcomes() == {"out of propellant": 1}


@pytest.mark.parametrize(
    ("section", "inputs", "message"),
    [
        ("lander", {"cycle": 0.3}, "does not divide the 41 s"),
        ("lander", {"smallest_thrust": 2e4}, "is not below vehicle.maximum_thrust"),
        ("lander", {"propellant": 1500.0}, "the whole of vehicle.wet_mass"),
        ("lander", {"time_limit": 40.0}, "is not after the last segment"),
        ("lander", {"ground": 50.0}, "is not below the altitude of mission.final_mean"),
        ("lander", {"cycle": 1e-3}, "cycles in the flight, more than"),
    ],
)
def test_inputs_that_do_not_fit_together_are_refused(tmp_path, section, inputs, message):
    with pytest.raises(InputError, match=message):
        _ = written(tmp_path / "own.yaml", **{section: inputs}).given


def test_every_law_is_designed_between_its_bounds_and_twice_in_the_same_way(scenario):
    for name, resident in scenario.residents.items():
        for corner in (0, 1):
            numbers = {number: bounds[corner] for number, bounds in resident.tuned.items()}
            law = resident.design(scenario.onboard, **numbers)
            if name == "fuel_optimal":
                again = resident.design(scenario.onboard, **numbers)
                np.testing.assert_array_equal(rows_of(again).gains, rows_of(law).gains)
