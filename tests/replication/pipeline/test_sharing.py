"""Whose file an artifact is that readings share."""

from pathlib import Path
from typing import ClassVar

import pytest

from marsedl.replication.inputs.readings import Reading, Study
from marsedl.replication.inputs.sections import Count, CountOrNone, Inputs, Number, Section, given
from marsedl.replication.pipeline.catalogue import Paper, Stage
from marsedl.replication.pipeline.sharing import Shared


class Vehicle(Section):
    """What flies."""

    mass: Number = given("kg", "mass")
    speed: Number = given("m/s", "speed")


class Ensemble(Section):
    """How many trials."""

    trials: Count = given("1", "trials")
    more_trials: CountOrNone = given("1", "trials of another case; 0: none")


class ToyInputs(Inputs):
    """All inputs."""

    CASES: ClassVar[dict[str, str]] = {"calm": "ensemble.trials", "windy": "ensemble.more_trials"}

    vehicle: Vehicle
    ensemble: Ensemble


PAPER = Paper(
    *("toy", "", "", "", {}),
    stages={
        "nominal": Stage((), ("vehicle.speed",), (), "path"),
        "gains": Stage((), ("vehicle.mass",), ("nominal",), "gains"),
        "other": Stage((), (), (), "what reads nothing"),
        "study": Stage((), (), ("nominal",), "study", claimed_in=("corrected",)),
        "montecarlo": Stage((), (), ("gains",), "flights"),
    },
)


def shared(chunks=None, **changes):
    """Readings in the order of a file, all alike but for what is changed: values by "section.name" with two dashes."""
    readings = {}
    for name in ("printed", "corrected", "light", "mine"):
        values = {"vehicle.mass": 2.0, "vehicle.speed": 3.0, "ensemble.trials": 4, "ensemble.more_trials": 0}
        values |= {key.replace("__", "."): value for key, value in changes.get(name, {}).items()}
        readings[name] = Reading(name, "", None, "", ToyInputs.from_plain(values), {})
    return Shared(PAPER, Study("toy", readings, chunks or {"calm": 1, "windy": 1}, ("printed", "corrected")))


def owners(whose, name):
    return [whose.owner(reading, name) for reading in ("printed", "corrected", "light", "mine")]


def test_the_corrected_reading_owns_what_all_share():
    assert owners(shared(), "gains") == ["corrected"] * 4
    assert shared().file("mine", "gains") == "data/cache/toy/corrected/gains.h5"


def test_otherwise_the_first_of_the_file_owns_it():
    whose = shared(corrected={"vehicle__mass": 9.0})
    assert owners(whose, "gains") == ["printed", "corrected", "printed", "printed"]


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        ({"vehicle__speed": 5.0}, {"nominal", "gains", "study", "montecarlo.calm"}),
        ({"vehicle__mass": 5.0}, {"gains", "montecarlo.calm"}),
        ({"ensemble__trials": 5}, {"montecarlo.calm"}),
        ({"ensemble__more_trials": 5}, set()),
    ],
)
def test_a_changed_input_moves_what_follows_from_it_alone(changes, moved):
    whose = shared(light=changes)
    names = ("nominal", "gains", "other", "study", "montecarlo.calm")
    assert {name for name in names if whose.owner("light", name) == "light"} == moved
    assert all(owners(whose, name)[3] == "corrected" for name in names)


def test_readings_of_other_numbers_of_trials_share_no_flights():
    whose = shared(light={"ensemble__more_trials": 5}, mine={"ensemble__more_trials": 6})
    assert [whose.owner(name, "montecarlo.windy") for name in ("light", "mine")] == ["light", "mine"]
    assert not whose.has("printed", "montecarlo.windy")
    assert whose.has("mine", "montecarlo.windy")


def test_claims_use_the_studies_of_their_readings_and_the_cases_that_are_flown():
    whose = shared(printed={"ensemble__more_trials": 5})
    assert whose.study.built == ("printed", "corrected")
    stages = {"nominal", "gains", "other"}
    assert whose.claimed("printed").keys() == stages | {"montecarlo.calm", "montecarlo.windy"}
    assert whose.claimed("corrected").keys() == stages | {"study", "montecarlo.calm"}
    assert {Path(file).parts[3] for file in whose.claimed("printed").values()} == {"printed", "corrected"}


def test_cases_of_few_trials_are_flown_by_one_job():
    few = {"ensemble__trials": 9000, "ensemble__more_trials": 10_000}  # in blocks of 1000
    assert shared(light=few, mine=few).flown_together() == {("calm", "windy"): ["light"]}, "mine has those of light"
    assert shared(light={**few, "ensemble__trials": 11_000}).flown_together() == {}
    assert shared({"calm": 4, "windy": 1}, light=few).flown_together() == {}, "calm is scattered"


def test_a_recipe_stands_for_all_that_an_artifact_is_made_from():
    whose = shared({"calm": 4, "windy": 1}, mine={"ensemble__trials": 2500})
    assert whose.chunks("mine", "calm") == ["chunks/calm.0of3", "chunks/calm.1of3", "chunks/calm.2of3"], "three blocks"
    assert whose.recipe("mine", "gains")["inputs"] == {"vehicle.mass": 2.0}
    options = {"case": "calm", "trials": 2500, "block_size": 1000}
    assert whose.recipe("mine", "montecarlo.calm")["options"] == options, "in however many chunks"
    assert list(whose.recipe("mine", "montecarlo.calm")["needs"]) == ["gains.h5"]
    assert whose.recipe("mine", "chunks/calm.1of3")["options"] == options | {"chunk": 1, "chunks": 3}
    changed_shared = shared({"calm": 4, "windy": 1}, mine={"ensemble__trials": 2500, "vehicle__speed": 5.0})
    gathered = whose.recipe("mine", "montecarlo.calm")
    assert changed_shared.recipe("mine", "montecarlo.calm") != gathered, "the nominal is another"
