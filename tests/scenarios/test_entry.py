"""The entry scenario: residents fly as in their paper, air varies as in the papers, every error is plugged in."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from marsedl.fly import Below, Samples, fly
from marsedl.fly.own_air import OwnAir
from marsedl.models import random_field
from marsedl.models.heating import sutton_graves_heat_rate
from marsedl.montecarlo.streams import normals
from marsedl.papers.stochastic_entry import dispersions, environment, flight, gains, montecarlo
from marsedl.papers.stochastic_entry.records import ALTITUDE, DOWNRANGE
from marsedl.replication.errors import InputError
from marsedl.scenarios import arena, load
from marsedl.scenarios.entry import truth
from marsedl.scenarios.entry.guidance import Guided, guide, sensed_of
from marsedl.scenarios.entry.onboard import entry_of, start_of
from marsedl.scenarios.entry.scenario import SUTTON_GRAVES

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def scenario():
    return load("entry", ROOT)


def test_the_nominal_is_that_of_the_paper(scenario):
    onboard = scenario.onboard
    law = partial(guide, law=Guided(onboard.settings, flight.NOMINAL_LAW))
    end = Below("velocity", onboard.given.mission.end_velocity)
    flown = fly(
        onboard.entry,
        start_of(onboard.given),
        law=law,
        trigger=end,
        end_time=400.0,
        substeps=20,
        trials=1,
        compiled=False,
    ).final
    # The look-up of the mean density is cubic there and linear here.
    assert abs(flown["range"][0] - onboard.end["range"]) < 0.1
    assert abs(flown["altitude"][0] - onboard.end["altitude"]) < 0.1


@pytest.mark.parametrize("case", ["apollo_velocity", "stochastic_velocity"])
def test_residents_fly_as_in_their_paper(scenario, case):
    """The same starts, vehicles and densities: a flight differs by the look-up of the density between its nodes."""
    onboard, count = scenario.onboard, 4
    given, seed = onboard.given, onboard.given.simulation.seed
    plant = flight.plant_of(given)
    law = gains.law(given.guidance, onboard.linearization, onboard.gains, case)
    end = montecarlo.end_of(given.mission, onboard.nominal, case)
    theirs = montecarlo.simulator_of(plant, law, end, given.simulation)(0, count).final_state
    vehicles = flight.vehicles_of(plant.dispersions, seed, np.arange(count))
    air = plant.atmosphere
    z = normals(seed, dispersions.DENSITY_STREAM, np.arange(count), air.altitude.size).T
    varied = [z[0]]
    for retention, one in zip(air.retention[::-1], z[1:], strict=True):
        varied.append(retention * varied[-1] + np.sqrt(1.0 - retention**2) * one)
    variation = air.deviation[:, np.newaxis] * np.array(varied[::-1])

    class TheirAir(truth.RandomAir):
        """Their mean density and variations."""

        def own(self):
            spacing = air.altitude[1] - air.altitude[0]
            return OwnAir(
                air.altitude[0], spacing, air.altitude.size, lambda seed, trials, *_: variation[:, trials], None
            )

    start = start_of(given)
    names = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "azimuth")
    drawn = dict(zip(names, vehicles.entry_state.T, strict=True))
    drawn["altitude"] = drawn["altitude"] - given.planet.planet_radius
    drawn |= {"ballistic_coefficient": 0.5 / vehicles.drag_factor}
    drawn |= {"lift_to_drag": vehicles.lift_factor / vehicles.drag_factor}
    ours = fly(
        entry_of(given, air=TheirAir(onboard.entry.air, None, None)),
        start,
        together=Samples(drawn),
        law=partial(guide, law=Guided(onboard.settings, law)),
        trigger=Below("velocity", given.mission.end_velocity),
        end_time=end.time,
        substeps=given.simulation.flight_substeps,
        trials=count,
        compiled=False,
    ).final

    class Nav:
        """What is sensed at the end of a flight."""

    downrange = []
    for trial in range(count):
        nav = Nav()
        vars(nav).update({name: float(values[trial]) for name, values in ours.items()})
        downrange.append(sensed_of(nav, onboard.settings).downrange)
    # The mean density is cubic between its nodes here, and linear there.
    assert np.abs(downrange - theirs[DOWNRANGE]).max() < 1.0
    assert np.abs(ours["altitude"] - theirs[ALTITUDE]).max() < 1.0


@pytest.mark.parametrize("process", ["ornstein_uhlenbeck", "gaussian_random_field"])
def test_air_varies_with_the_covariance_of_its_paper(scenario, process):
    given = scenario.truth("dispersed" if process == "ornstein_uhlenbeck" else "random_field")
    own = truth.random_air(given).own()
    values, altitude = own.sample(5, range(20_000)), own.bottom + own.spacing * np.arange(own.nodes)
    low, high = 60, 70
    sampled = np.cov(values[[low, high]])
    if process == "ornstein_uhlenbeck":
        decay = environment.decay_rate(given.air, np.linspace(altitude[low], altitude[high], 1001))
        kept = np.exp(-np.trapezoid(decay, dx=(altitude[high] - altitude[low]) / 1000))
        deviations = np.sqrt(environment.variance(given.air, altitude[[low, high]]))
        expected = np.outer(deviations, deviations) * np.array([[1.0, kept], [kept, 1.0]])
    else:
        shape = given.air.variance_at_top, given.air.variance_top_altitude, given.air.variance_growth_length
        pair = altitude[[low, high]]
        expected = random_field.altitude_exponential(pair[:, None], pair, *shape, given.truth.correlation_length)
    assert np.abs(sampled / expected - 1.0).max() < 5.0 * np.sqrt(2.0 / 20_000) / (expected[0, 1] / expected[0, 0])


def test_a_trial_is_the_same_alone_and_in_a_chunk(scenario):
    law = scenario.law("apollo")
    together = arena.flown(scenario, law, "dispersed", 3, 4, 3, compiled=False)
    alone = arena.flown(scenario, law, "dispersed", 3, 5, 1, compiled=False)
    assert np.array_equal(together.values[:, 1:2], alone.values, equal_nan=True)
    assert together.digest() != alone.digest()


@pytest.mark.parametrize("condition", ["exact", "dispersed"])
def test_what_is_counted_is_what_histories_show(scenario, condition):
    options = scenario.flight(condition)
    law, step = scenario.law("apollo"), options["period"] / options["substeps"]
    flights = fly(**options, law=law, history=step, trials=1, seed=3, compiled=False)
    stored, scores = flights.to_xarray(), scenario.scores(flights)
    names = ("density", "velocity", "commanded_bank", "altitude")
    density, velocity, command, altitude = (stored[f"{name}_history"].values[:, 0] for name in names)
    flown, time = np.isfinite(altitude), stored["time"].values
    time = np.where(flown, np.minimum(time, scores["end_time"][0]), np.nan)[flown]
    nose = 0.25 * scenario.given.vehicle.reference_diameter
    heat = sutton_graves_heat_rate(density, velocity, nose, SUTTON_GRAVES)[flown]
    held = command[flown][:-1]  # the end has none of its own
    assert scores["peak_heat"][0] == pytest.approx(heat.max())
    assert scores["heat_load"][0] == pytest.approx(np.trapezoid(heat, time))
    assert scores["reversals"][0] == (held[1:] * held[:-1] < 0.0).sum() > 0
    assert scores["bank_moved"][0] == pytest.approx(np.abs(np.diff(held)).sum())


def test_the_box_counts_what_a_trigger_leaves_open(scenario):
    """At the nominal's range the miss is across alone, and altitude and velocity are off; `of_box` holds them all."""
    law, box = scenario.law("no_feedback"), scenario.given.box
    one = arena.flown(scenario, law, "dispersed_range", 3, 0, 8, compiled=False)
    shares = one["miss"] / box.largest_miss, one["altitude_error"] / box.altitude_half_width
    shares = np.abs([*shares, one["velocity_error"] / box.velocity_half_width])
    ended = one.outcome == "parachute"  # those that fall short never come there
    assert 0 < ended.sum() < ended.size
    assert np.array_equal(one["of_box"], shares.max(axis=0), equal_nan=True)
    assert np.abs(one["downrange_miss"][ended]).max() < 1e-3 < np.ptp(one["altitude_error"][ended])
    assert np.array_equal(one["inside"] > 0.5, one["of_box"] <= 1.0)


def test_laws_are_told_no_truth(scenario):
    for name in scenario.residents:
        assert scenario.campaign(scenario.law(name), "dispersed", 1).truth == ()


def test_onboard_knows_nothing_of_the_truth(scenario):
    assert not {"truth", "navigation", "box"} & {*type(scenario.onboard.given).model_fields}


def test_every_condition_flies(scenario):
    law = scenario.law("no_feedback")
    ended = {name: arena.flown(scenario, law, name, 3, 0, 1, compiled=False) for name in scenario.conditions}
    assert {one.outcome[0] for one in ended.values()} == {"parachute"}
    misses = [one["miss"][0] for one in ended.values()]
    # Stuck navigation and another trigger's end do not move the range of a law without feedback.
    assert len(set(misses)) >= len(misses) - 1


def test_what_is_unplugged_is_caught(scenario, monkeypatch):
    """A dispersion whose flights are all the same."""
    law = scenario.law("no_feedback")
    exact = scenario.campaign(law, "exact", 3)
    assert "drag_factor" not in exact.vehicle.dispersed()
    assert {"drag_factor", "lift_factor"} <= {*scenario.campaign(law, "dispersed", 3).vehicle.dispersed()}


MINE = """
based_on: entry
summary: A heavier capsule.
vehicle:
  ballistic_coefficient: {value: 150.0, source: "assumed: mine"}
box:
  largest_miss_km: {value: 5.0, source: "assumed: mine"}
"""


def test_a_scenario_of_a_user(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(MINE)
    mine = load("entry", ROOT, file)
    assert mine.onboard.given.vehicle.ballistic_coefficient == 150.0
    assert mine.given.box.largest_miss == 5000.0
    assert mine.words == "A heavier capsule."


@pytest.mark.parametrize(
    ("was", "becomes", "says"),
    [
        ("based_on: entry", "based_on: descent", "based_on is 'descent'; write 'based_on: entry'"),
        ("largest_miss_km", "largest_miss_deg", "has the wrong unit suffix"),
        ("box:", "boxes:", "boxes"),
        ("150.0", "-150.0", "greater than 0"),
    ],
)
def test_a_wrong_scenario_is_refused(tmp_path, was, becomes, says):
    file = tmp_path / "mine.yaml"
    file.write_text(MINE.replace(was, becomes))
    with pytest.raises(InputError, match=says):
        load("entry", ROOT, file).given  # noqa: B018


def test_an_unknown_scenario_is_refused():
    with pytest.raises(InputError, match="did you mean 'entry'"):
        load("entri", ROOT)
