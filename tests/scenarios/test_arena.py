"""The arena: made-up laws of a made-up scenario are tuned, ranked, sealed and compared as is said."""

import json
from collections import namedtuple
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
import pandas as pd
import pytest

from marsedl.comparison import comparisons
from marsedl.fly import Model
from marsedl.fly.campaign import Campaign
from marsedl.methods.tvlqr import discrete_regulator
from marsedl.montecarlo.flights import Flight
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline import products
from marsedl.replication.pipeline.products import BLOCK, Products
from marsedl.replication.records import store
from marsedl.results import arena as arena_of_results
from marsedl.scenarios import arena, arenas, costs, load, shown
from marsedl.scenarios.arena import Scores
from marsedl.scenarios.entry.scenario import EntryScenario
from marsedl.scenarios.records import ArenaFlights, gathered, of_scores, scores_of
from marsedl.scenarios.scenario import Resident, Scenario

ROOT = Path(__file__).parents[2]
TRIALS = 2 * BLOCK


def scores(law, trials=range(TRIALS), lost=()):
    """Misses of a made-up law in some trials, the same whatever the others are."""
    rows = [np.random.default_rng([law, trial]).exponential(1.0 + law, 2) for trial in trials]
    miss, saturated = np.array(rows).T
    outcome = np.array(["lost" if trial in lost else "parachute" for trial in trials])
    miss = np.where(outcome == "lost", np.nan, miss)
    return Scores(("miss", "saturated", "inside"), np.array([miss, saturated, (miss < 1.0) * 1.0]), outcome)


def flights(trials, **how):
    return {f"law_{law}": {"dispersed": scores(law, trials, **how)} for law in (0, 1)}


def test_chunks_join_to_the_same_scores(tmp_path):
    parts = []
    for number, trials in enumerate((range(300), range(300, TRIALS))):
        record = of_scores(flights(trials, lost=(7, 400)), trials)
        store.save(tmp_path / f"{number}.h5", record, paper="arena", reading="entry", provenance={})
        parts.append(store.load(tmp_path / f"{number}.h5", ArenaFlights, paper="arena", reading="entry"))
    joined, trials = gathered(parts)
    whole = flights(range(TRIALS), lost=(7, 400))
    assert np.array_equal(trials, np.arange(TRIALS))
    for law, of in whole.items():
        assert joined[law]["dispersed"].digest() == of["dispersed"].digest()
    assert scores_of(parts[0])["law_0"]["dispersed"].outcome[7] == "lost"


def test_a_digest_knows_every_bit():
    one = scores(0)
    values = one.values.copy()
    values[0, 3] = np.nextafter(values[0, 3], np.inf)
    assert one.digest() != one._replace(values=values).digest()
    assert one.digest() != one._replace(outcome=np.where(np.arange(TRIALS) == 3, "lost", one.outcome)).digest()


def test_a_table_tells_places_and_what_is_lost():
    found = arena.table({"b": scores(1, lost=(1, 2)), "a": scores(0)})
    assert found["law"].tolist() == ["a", "b"]
    assert found["best_place"].tolist() == found["best_place_in_box"].tolist() == [1, 2]
    assert found["lost"].tolist() == ["", "2 lost"]
    assert (found["mean_lower"] < found["mean"]).all() and (found["mean"] < found["mean_upper"]).all()
    assert found["inside"][1] == pytest.approx(np.mean(scores(1, lost=(1, 2))["inside"]))


def test_all_numbers_have_intervals():
    """Medians of what is no miss, and the 99th percentile of what is asked for."""
    one = scores(0, range(4 * TRIALS))
    (row,) = arena.table({"a": one}, tails=("saturated",)).to_dict("records")
    for which, level in (("median", 0.5), ("p99", 0.99)):
        assert row[f"{which}_saturated"] == np.quantile(one["saturated"], level)
        assert row[f"{which}_saturated_lower"] < row[f"{which}_saturated"] < row[f"{which}_saturated_upper"]


def test_two_laws_that_are_one_are_a_tie():
    (row,) = arena.pairs({"a": scores(0), "b": scores(0)}).to_dict("records")
    assert row["misses_less"] == "tie"
    assert row["mean"] == 0.0


def test_tuning_takes_the_best_of_equally_many_tries(monkeypatch):
    """A law whose miss is least at a number; lost flights count as ten boxes."""
    asked = []

    def flown(scenario, law, condition, seed, first, count):
        asked.append((law, condition, seed, first, count))
        misses = np.full(count, abs(np.log(law / 2.0)))
        misses[: 5 if law > 7.0 else 0] = np.nan
        return Scores(("miss", "saturated"), np.array([misses, misses]), np.full(count, "x"))

    monkeypatch.setattr(arena, "flown", flown)
    monkeypatch.setattr(arena.costs, "command_of", lambda campaign: campaign[0])
    scenario = namedtuple("Fake", "onboard largest_miss campaign")(None, 1.0, lambda *given: given)
    resident = Resident("made up", lambda onboard, gain=8.0: gain, {"gain": (0.1, 10.0)})
    tries = arena.tuned(scenario, resident)
    assert len(tries) == arena.TUNING_TRIES
    assert {seed for _, _, seed, _, _ in asked} == {11}
    assert sum(count for *_, count in asked) == arena.TUNING_FLIGHTS
    assert tries[0].mean == min(one.mean for one in tries)
    assert tries[0].command == tries[0].numbers["gain"]  # the cost of the best
    own = next(one for one in tries if not one.numbers)
    count = arena.TUNING_FLIGHTS // arena.TUNING_TRIES
    assert own.mean == pytest.approx(((count - 5) * np.log(4.0) + 5 * 10.0) / count)


def test_a_law_of_the_sealed_table_is_tuned_again(monkeypatch):
    """One of them, drawn by all that was tried; a bit that differs is an error."""
    scenario = namedtuple("Fake", "name residents")("entry", {"law_0": 0, "law_1": 1})
    monkeypatch.setattr(arena, "tuned", lambda scenario, law: [arena.Try({}, 1.0 + law, 0.0, 3.0)])
    known = {f"law_{law}": [arena.Try({}, 1.0 + law, 0.0, 3.0)._asdict()] for law in (0, 1)}
    assert arena.tuned_again(scenario, json.loads(json.dumps(known))) in known
    for law in known:
        known[law][0]["mean"] = np.nextafter(known[law][0]["mean"], np.inf)
    with pytest.raises(MarsedlError, match="is tuned otherwise than in the sealed table"):
        arena.tuned_again(scenario, known)


def test_costs_are_counted():
    """Operations of a command, whatever flies it; and what a design solves."""

    class Command(NamedTuple):
        rate: float

    class State(NamedTuple):
        place: float

    def rates(state, command: Command) -> State:
        return State(command.rate)

    def twice(x):
        return 2.0 * x

    def plain(place):
        return 0.0

    def law(place):
        return -twice(place) * 0.5 if place > -1.0 else 0.0

    def operations(law):
        options = {"end_time": 50.0, "period": 1.0, "substeps": 1, "history": None, "trigger": None}
        return costs.command_of(Campaign(Model(Flight(rates)), {"place": 0.5}, law=law, seed=1, **options))

    assert operations(law) - operations(plain) == 4.0  # two products, a negation and a comparison
    weights = np.eye(1)
    steps = np.ones((3, 1, 1))
    assert costs.design_of(lambda: discrete_regulator(steps, steps, np.ones(3), weights, steps, weights)) == (
        "1 Riccati recursion"
    )


class Sketch(Scenario):
    """A scenario of which nothing flies."""

    name, box, digits = "entry", "near", ".2f"
    conditions: ClassVar = EntryScenario.conditions
    largest_miss = onboard = flight = told = None
    tails = ("saturated",)
    columns: ClassVar = {"miss": ("m", "miss"), "saturated": ("1", "limits"), "inside": ("1", "in the box")}


@pytest.fixture
def sealed():
    """Sealed made-up flights: a table of four blocks, of which two are flown again."""
    tuned = {f"law_{law}": [{"numbers": {}, "mean": 1.0, "saturated": 0.0}] for law in (0, 1)}
    scenario = Sketch(ROOT, {}, None)
    of = range(4 * BLOCK)
    whole = shown.Shown(scenario, flights(of), np.array(of), tuned, "world").seal()
    assert whole["trials"] == 4 * BLOCK
    again = [*range(BLOCK, 2 * BLOCK), *range(3 * BLOCK, 4 * BLOCK)]
    return whole, shown.Shown(scenario, flights(again), np.array(again), tuned, "world", json.loads(json.dumps(whole)))


def test_a_sample_that_agrees_shows_the_sealed_table(sealed):
    whole, again = sealed
    again.require_same()
    assert json.dumps(again.ranked) == json.dumps(whole["ranks"])
    assert json.dumps(again.seal()) == json.dumps(whole)
    assert {row["trials"] for row in again.ranked} == {4 * BLOCK}
    table = shown.TABLES["ranks"](again)
    assert table["law"].tolist() == ["law_0", "law_1"]
    efforts = shown.TABLES["efforts"](again)
    assert efforts["number"].tolist() == ["saturated"] * 2
    assert efforts["p99"].tolist() == [row["p99_saturated"] for row in whole["ranks"]]


def test_a_block_that_differs_is_named(sealed):
    _, again = sealed
    again.sealed["blocks"]["law_1"][3] = "damaged"
    with pytest.raises(MarsedlError, match=f"trials {3 * BLOCK} to {4 * BLOCK - 1} of law_1 are others"):
        again.require_same()


def test_a_table_of_other_code_is_shown_if_that_flies_the_same_bits(sealed):
    whole, again = sealed
    again.sealed["world"] = "another"
    again.require_same()
    assert json.dumps(again.ranked) == json.dumps(whole["ranks"])
    assert again.seal()["world"] == "world"


def test_a_table_of_other_bits_is_not_shown(sealed):
    _, again = sealed
    again.sealed["world"] = "another"
    again.sealed["blocks"]["law_1"][3] = "damaged"
    again.require_same()
    assert {row["trials"] for row in again.ranked} == {2 * BLOCK}


# ---- what the workflow plans -----------------------------------------------------------------------------------------


def planned(**options):
    papers, models = {slug: catalogue(slug) for slug in SLUGS}, {slug: input_model(slug) for slug in SLUGS}
    return Products(ROOT, papers, load_studies(models, ROOT), comparisons(), arenas=arenas(), **options)


def trials_of(plan):
    return plan.job("report/arena/entry.flights").params["chunks"]


def test_trials_are_divided_into_jobs():
    assert trials_of(planned(trials=12_000)) == [[[0, 5000]], [[5000, 5000]], [[10_000, 2000]]]
    assert trials_of(planned(trials=10, chunks=3)) == [[[0, 4]], [[4, 4]], [[8, 2]]]
    needs = planned(trials=12_000).job("figures/arena/entry/ranks.csv").needs
    assert [need for need in needs if need.endswith(".h5")] == [f"report/arena/entry.{k}of3.h5" for k in range(3)]


def test_blocks_of_a_sealed_table_are_drawn(monkeypatch, tmp_path):
    plan = planned()
    monkeypatch.setattr(products, "SEALED", f"{tmp_path}/")
    world = plan.job("report/arena/entry.flights").params["world"]
    (tmp_path / "entry.json").write_text(json.dumps({"world": world, "trials": 20_000}))
    ((first, second),) = trials_of(planned())
    assert first[0] % BLOCK == second[0] % BLOCK == 0
    assert first[0] < second[0] < 20_000
    assert first[1] == second[1] == BLOCK
    (tmp_path / "entry.json").write_text(json.dumps({"world": "another", "trials": 20_000}))
    assert trials_of(planned()) == [[[0, 2 * BLOCK]]]


def test_results_are_one_long_table(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="run 'snakemake arena'"):
        arena_of_results(ROOT / "src")
    folder = tmp_path / "figures/arena/entry"
    folder.mkdir(parents=True)
    (tmp_path / "configs").mkdir()
    row = {"condition": "dispersed", "tier": "dispersed", "law": "a", "trials": 10, "best_place": 1, "worst_place": 1}
    row |= {"best_place_in_box": 1, "worst_place_in_box": 1, "mean (m)": 2.0, "mean_lower (m)": 1.0}
    pd.DataFrame([row | {"mean_upper (m)": 3.0, "lost": ""}]).to_csv(folder / "ranks.csv", index=False)
    (found,) = arena_of_results(tmp_path).to_dict("records")
    assert [found[name] for name in ("number", "unit", "value", "lower", "upper")] == ["mean", "m", 2.0, 1.0, 3.0]


def test_every_scenario_says_all_that_is_shown():
    for name, declared in arenas().items():
        scenario = load(name, ROOT)
        assert {*declared.tables} == {*shown.TABLES}
        assert {"miss", "inside", "saturated"} <= {*scenario.columns}
        assert "dispersed" in scenario.conditions
        assert {one.tier for one in scenario.conditions.values()} == {"exact", "dispersed", "wrong"}
