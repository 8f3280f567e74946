"""A paper in one process: what is computed again, and what is not."""

import sys
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

from marsedl.replication.inputs.sections import Inputs, Number, Section, given
from marsedl.replication.pipeline.catalogue import Flown, Paper, Product, Stage
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records import fields, store

VALUES = {"vehicle.mass": 2.0, "vehicle.speed": -3.0, "drawing.colour": "red"}


class Vehicle(Section):
    """What flies."""

    mass: Number = given("kg", "mass")
    speed: Number = given("m/s", "speed")


class Drawing(Section):
    """What is drawn."""

    colour: str = given("1", "colour of the curve")


class ToyInputs(Inputs):
    """All inputs."""

    vehicle: Vehicle
    drawing: Drawing


@dataclass(frozen=True)
class Nominal:
    """Speed without its sign."""

    speed: np.ndarray = fields.quantity("m/s", ("time",), "speed")


@dataclass(frozen=True)
class Gains:
    """Made from the speed and the mass."""

    energy: float = fields.quantity("J", (), "energy")


@dataclass(frozen=True)
class Flights:
    """One number a trial."""

    energy: np.ndarray = fields.quantity("J", ("trial",), "energy")


def nominal(given: ToyInputs) -> Nominal:
    return Nominal(np.array([abs(given.vehicle.speed)]))


def gains(vehicle: Vehicle, nominal: Nominal) -> Gains:
    return Gains(0.5 * vehicle.mass * float(nominal.speed[0]) ** 2)


def simulate(gains: Gains, *, flown: Flown) -> Flights:
    return Flights(gains.energy * np.arange(flown.trials))


def gather(chunks: list[Flights]) -> Flights:
    return Flights(np.concatenate([chunk.energy for chunk in chunks]))


class Claims:
    """Measure what a paper's claims would."""

    @staticmethod
    def evaluate(given, published):
        values = given.values
        gains, windy, calm = (
            given.artifact(n, t) for n, t in (("gains", Gains), ("windy", Flights), ("calm", Flights))
        )
        return {"energy": gains.energy, "largest": windy.energy.max(), "calm": calm, "colour": values["drawing.colour"]}


def tab1(published, gains: Gains):
    return [[published["energy"], gains.energy]]


@pytest.fixture
def run(monkeypatch):
    """Return a run of a toy paper with some inputs changed; all runs of a test share a memory."""
    for name, functions in {"stages": (nominal, gains, simulate, gather), "tables": (tab1,)}.items():
        module = ModuleType(name)
        vars(module).update({function.__name__: function for function in functions})
        monkeypatch.setitem(sys.modules, f"marsedl.papers.toy.{name}", module)
    monkeypatch.setitem(sys.modules, "marsedl.papers.toy", ModuleType("toy"))
    where = "marsedl.papers.toy.stages"
    flights = f"{where}:simulate", f"{where}:gather"
    stages = {
        "nominal": Stage((f"{where}:nominal",), ("vehicle.speed",), (), "speed"),
        "gains": Stage((f"{where}:gains",), ("vehicle.mass",), ("nominal",), "energy"),
        "montecarlo": Stage(flights, (), ("gains",), "flights"),
    }
    paper = Paper("toy", "", "", "", {}, {"tab1": Product("", needs=("gains",))}, stages=stages)
    shared = Memory()

    def of(trials=4, **changes):
        values = {**VALUES, **{f"vehicle.{name}": value for name, value in changes.items() if name != "colour"}}
        values["drawing.colour"] = changes.get("colour", "red")
        return Run(paper, values, shared, {"windy": trials})

    return of


def computed(run):
    """How many stages a run computes for its claims."""
    before = len(run.memory)
    Claims.evaluate(run.given(), {})
    return len(run.memory) - before


def test_claims_and_tables_come_from_the_records(run):
    assert Claims.evaluate(run().given(), {}) == {"energy": 9.0, "largest": 27.0, "calm": None, "colour": "red"}
    assert run().table("tab1", {"energy": "9 J"}) == [["9 J", 9.0]]


@pytest.mark.parametrize(
    ("changes", "stages"),
    [
        ({}, 0),
        ({"colour": "blue"}, 0),  # only the claims read it
        ({"mass": 3.0}, 2),  # gains and what follows
        ({"speed": 4.0}, 3),
        ({"speed": 3.0}, 1),  # the nominal comes out equal, which stops the chain
        ({"trials": 5}, 1),
    ],
)
def test_a_changed_input_computes_what_follows_from_it(run, changes, stages):
    assert computed(run()) == 3
    assert computed(run(**changes)) == stages


def test_records_are_those_that_a_job_would_load(run, tmp_path):
    record = run().record("nominal")
    store.save(tmp_path / "nominal.h5", Nominal(np.array([3.0])), paper="toy", reading="r", provenance={})
    loaded = store.load(tmp_path / "nominal.h5", Nominal)
    assert store.content_digest(record) == store.content_digest(loaded)
    assert store.content_digest(record) != store.content_digest(Nominal(np.array([-3.0])))
    with pytest.raises(ValueError, match="read-only"):
        record.speed[0] = 1.0


def heavy(vehicle: Vehicle) -> Nominal:
    return Nominal(np.array([vehicle.mass]))


def coloured(given: ToyInputs) -> Nominal:
    return Nominal(np.array([len(given.drawing.colour)]))


@pytest.mark.parametrize(("stage", "read"), [(heavy, "vehicle.mass"), (coloured, "drawing.colour")])
def test_an_input_that_a_stage_was_not_given_is_an_error(run, monkeypatch, stage, read):
    monkeypatch.setattr(sys.modules["marsedl.papers.toy.stages"], "nominal", stage)
    with pytest.raises(AttributeError, match=rf"'{read.split('.')[1]}' was not given: .* reads as '{read}'"):
        run().record("nominal")
