"""Tables and figures of a scenario, from the flights of all laws."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module

import numpy as np

from marsedl.fly.flights import Flights
from marsedl.plotting.style import save_figure
from marsedl.replication.errors import MarsedlError
from marsedl.replication.files import write_text
from marsedl.replication.pipeline.catalogue import Arena
from marsedl.replication.pipeline.products import BLOCK
from marsedl.replication.records.tables import Column, table, write_table
from marsedl.scenarios import arena
from marsedl.scenarios.arena import Scores
from marsedl.scenarios.ranking import trials_needed
from marsedl.scenarios.scenario import POOLS, Scenario

__all__ = ["TABLES", "Shown", "write"]

STUDIED = 1_000  # trials of the practice pool of which dispersions are told apart
WITH_HISTORY = 100  # of which histories are kept, for pictures
STUDY = "dispersed"  # condition in which that is
PREDICTED = "predicted over flown deviation"
MISSES = ("mean", "p50", "p95", "p99", "p99.9", "tail")
WORDS = {  # meanings of the columns of misses
    "mean": "mean miss",
    "p50": "miss that half of the flights exceed",
    "p95": "miss that 5 % exceed",
    "p99": "miss that 1 % exceed",
    "p99.9": "miss that 0.1 % exceed",
    "tail": "mean miss of the 0.1 % that miss most",
}


@dataclass(frozen=True)
class Shown:
    """All that is shown of a scenario."""

    scenario: Scenario
    scores: Mapping[str, Mapping[str, Scores]]  # by law and condition, of today's flights
    trials: np.ndarray  # their numbers in the pool of proof
    tuned: Mapping[str, list[dict]]  # what was tried for every law, the best first
    world: str  # digest of code and inputs
    sealed: Mapping | None = None  # the sealed table, if there is one

    @cached_property
    def is_sealed(self) -> bool:
        """Whether the sealed table is what tables show: all that is flown today has the same bits in it."""
        whole = self.sealed or {"trials": 0}
        is_sample = self.trials.size < whole["trials"] and self.trials.size % BLOCK == 0
        return is_sample and [*whole["blocks"]] == [*self.scores] and self._differing is None

    @cached_property
    def by_condition(self) -> dict[str, dict[str, Scores]]:
        """Scores by condition and law."""
        conditions = next(iter(self.scores.values()))
        return {condition: {law: of[condition] for law, of in self.scores.items()} for condition in conditions}

    @cached_property
    def ranked(self) -> list[dict]:
        """Rows of the table of ranks, of the sealed table if it is of today's code."""
        if self.is_sealed:
            return self.sealed["ranks"]
        return [
            {"condition": c} | row
            for c, of in self.by_condition.items()
            for row in arena.table(of, tails=self.scenario.tails).to_dict("records")
        ]

    @cached_property
    def paired(self) -> list[dict]:
        """Rows of the table of pairs, of the sealed table if it is of today's code."""
        if self.is_sealed:
            return self.sealed["pairs"]
        return [
            {"condition": c} | row for c, of in self.by_condition.items() for row in arena.pairs(of).to_dict("records")
        ]

    def law(self, name):
        """A law as it was tuned."""
        return self.scenario.law(name, **self.tuned[name][0]["numbers"])

    @property
    def _looked_into(self):
        """Laws that are looked into: one with feedback where few trials show no more than that all works."""
        return [*self.scores] if self.trials.size >= BLOCK else [*self.scores][1:2]

    def _practice(self, trials, history=None) -> dict[str, Flights]:
        """Flights on the practice pool; history: seconds between states, if any are kept."""
        made = {}
        for name in self._looked_into:
            campaign = self.scenario.campaign(self.law(name), STUDY, POOLS["practice"], history)
            made[name] = Flights(campaign, *campaign.fly_all(0, trials, 1, False, True), (1, False, True))
        return made

    @cached_property
    def studied(self) -> dict[str, Flights]:
        """Flights of every law, which may be asked further questions."""
        return self._practice(min(STUDIED, 4 * self.trials.size))

    @cached_property
    def histories(self) -> dict[str, Flights]:
        """Flights of every law with a state every two guidance periods."""
        return self._practice(min(WITH_HISTORY, self.trials.size), 2.0 * self.scenario.flight(STUDY)["period"])

    def blocks(self) -> dict[str, list[str]]:
        """Digests of all bits of each block of trials, by law."""
        found = {}
        for law, of in self.scores.items():
            parts = [slice(first, first + BLOCK) for first in range(0, self.trials.size, BLOCK)]
            digests = [
                [Scores(one.names, one.values[:, part], one.outcome[part]).digest() for one in of.values()]
                for part in parts
            ]
            found[law] = [arena.shortened(" ".join(of_block).encode()) for of_block in digests]
        return found

    @cached_property
    def _differing(self) -> tuple[str, int] | None:
        """Law and first trial of a block that has other bits than in the sealed table."""
        for law, digests in self.blocks().items():
            for number, digest in enumerate(digests):
                first = int(self.trials[number * BLOCK])
                if self.sealed["blocks"][law][first // BLOCK] != digest:
                    return law, first
        return None

    def require_same(self) -> None:
        """Compare what was flown with a sealed table of the same code and inputs.

        Raises MarsedlError naming law and trials that differ.
        """
        if self.sealed and self.sealed["world"] == self.world and not self.is_sealed and self._differing:
            law, first = self._differing
            raise MarsedlError(
                f"{self.scenario.name}: trials {first} to {first + BLOCK - 1} of {law} are others than those of the "
                f"sealed table of the same code and inputs: do libraries or machine differ?"
            )

    def seal(self) -> dict:
        """The sealed table if it is shown, which is of today's code then, or else one of these flights."""
        if self.is_sealed:
            return {**self.sealed, "world": self.world}
        return {
            "world": self.world,
            "trials": int(self.trials.size),
            "tuned": {law: tries[0]["numbers"] for law, tries in self.tuned.items()},
            "tries": self.tuned,
            "blocks": self.blocks(),
            "ranks": self.ranked,
            "pairs": self.paired,
        }


# ---- tables ----------------------------------------------------------------------------------------------------------


def _with_interval(name, unit, digits, meaning):
    """Columns of a number and of the ends of its interval, which readers see in one cell."""
    ends = {f"{name}_{end}": Column(unit, digits, f"{end} end of its interval") for end in ("lower", "upper")}
    return {name: Column(unit, digits, meaning, interval=(*ends,)), **ends}


def ranks(shown: Shown):
    """Every law in every condition."""
    digits = shown.scenario.digits
    columns = {
        "condition": Column(),
        "tier": Column(meaning="exact, dispersed or wrong"),
        "law": Column(),
        "trials": Column(),
        "best_place": Column(meaning="by the mean miss: the best place that the intervals of all pairs leave open"),
        "worst_place": Column(meaning="the worst place that they leave open"),
        "best_place_in_box": Column(meaning="by the share in the box: the best place that they leave open"),
        "worst_place_in_box": Column(meaning="by the share in the box: the worst one"),
    }
    for name in MISSES:
        columns |= _with_interval(name, "m", digits, WORDS[name])
    columns |= _with_interval("inside", "", ".4f", f"share inside of the box: {shown.scenario.box}")
    for name, (unit, meaning) in shown.scenario.columns.items():
        if name not in ("miss", "inside"):
            columns |= _with_interval(f"median_{name}", unit, ".4g", f"median: {meaning}")
        if name in shown.scenario.tails:
            columns |= _with_interval(f"p99_{name}", unit, ".4g", f"exceeded by 1 %: {meaning}")
    columns["lost"] = Column(meaning="flights that did not end as they should, by how they ended")
    tiers = {name: one.tier for name, one in shown.scenario.conditions.items()}
    rows = [{"tier": tiers[row["condition"]], **row} for row in shown.ranked]
    return table([[row[name] for name in columns] for row in rows], columns)


def laws(shown: Shown):
    """The laws, and how they differ."""
    rows = []
    for name, one in shown.scenario.residents.items():
        bounds = [f"{number} from {low:g} to {high:g}" for number, (low, high) in one.tuned.items()]
        best = shown.tuned[name][0]
        rows.append((name, one.words, one.differs, ", ".join(bounds), best["design"], best["command"]))
    columns = {
        "law": Column(),
        "what it is": Column(),
        "differs": Column(meaning="what of limits, partition, linear model or lateral logic is not that of the others"),
        "tuned": Column(meaning="numbers that are tuned, between which bounds"),
        "design": Column(meaning="what it solves and flies, beyond what all laws share: nominal flight, linear model"),
        "command": Column("", ".0f", "operations of a command, and of the actuators that take it"),
    }
    return table(rows, columns)


def pairs(shown: Shown):
    """Differences of two laws in the same trials."""
    columns = {"condition": Column(), "first": Column(), "second": Column()}
    columns |= _with_interval("mean", "m", shown.scenario.digits, "difference of the mean misses")
    columns |= _with_interval("inside", "", ".4f", "difference of the shares inside of the box")
    columns["correlation"] = Column("", ".2f", "of the misses of both laws over the trials")
    columns["misses_less"] = Column(meaning="which law misses less on average")
    return table([[row[name] for name in columns] for row in shown.paired], columns)


def sources(shown: Shown):
    """Variance of range and crossrange by kind of source."""
    rows = []
    for law, flights in shown.studied.items():
        for quantity in shown.scenario.budgeted:
            budget = flights.budget(quantity)
            shares = (
                budget.shares.assign(kind=_kinds(budget.shares, shown.scenario.correlated))
                .groupby("kind")["share"]
                .sum()
            )
            rows += [(law, quantity, kind, 100.0 * share) for kind, share in shares.items()]
            rows.append((law, quantity, PREDICTED, 100.0 * budget.deviation / budget.flown))
    columns = {
        "law": Column(),
        "quantity": Column(),
        "source": Column(meaning="kind of dispersion, or what linear covariance predicts over what is flown"),
        "share": Column("%", ".1f", "of the variance; of the last row of a law the ratio of the deviations"),
    }
    found = table(rows, columns)
    moved = found[found["source"] != PREDICTED].groupby("source")[found.columns[3]].max()
    if dead := [source for source, share in moved.items() if not share > 0.0]:
        raise MarsedlError(f"{shown.scenario.name}: {', '.join(dead)} moves no output of any law: is it plugged in?")
    return found


def _kinds(shares, correlated):
    """Kind of each source in words: all of navigation is one, numbers of start and vehicle stand by their names."""
    words = {"senses": "navigation", "navigation": "navigation", "together": correlated}
    return [
        words.get(kind, source.removeprefix("start_").replace("_", " ") + " at the start" * (kind == "start"))
        for kind, source in zip(shares["kind"], shares["source"], strict=True)
    ]


def explained(shown: Shown):
    """Share of being outside of the box by what was drawn."""
    rows = []
    for law, flights in shown.studied.items():
        outside = shown.scenario.scores(flights)["inside"] < 0.5
        asked = flights.with_quantity("outside", lambda known, outside=outside: outside * 1.0)
        for row in asked.explains("outside").to_dict("records"):
            rows.append((law, row["drawn"], *(100.0 * row[name] for name in ("share", "lower", "upper"))))
    columns = {
        "law": Column(),
        "drawn": Column(meaning="number that was drawn"),
        "share": Column("%", ".1f", "of the variance of whether it misses the box", interval=("lower", "upper")),
        "lower": Column("%", ".1f", "lower end of its interval"),
        "upper": Column("%", ".1f", "upper end of its interval"),
    }
    return table(rows, columns)


def efforts(shown: Shown):
    """What flights ask of the vehicle."""
    rows = []
    for row in (row for row in shown.ranked if row["condition"] == STUDY):
        for name in shown.scenario.tails:
            unit, meaning = shown.scenario.columns[name]
            of = [row[f"{which}_{name}{end}"] for which in ("median", "p99") for end in ("", "_lower", "_upper")]
            rows.append((row["law"], name, f"{meaning} ({unit})" if unit != "1" else meaning, *of, row["trials"]))
    columns = {"law": Column(), "number": Column(), "what": Column(meaning="what it is, with its unit")}
    columns |= _with_interval("median", "", ".4g", "") | _with_interval("p99", "", ".4g", "exceeded by 1 %")
    return table(rows, columns | {"trials": Column()})


def needed(shown: Shown):
    """Trials that an interval of a tenth to each side takes."""
    rows = []
    for row in shown.ranked:
        if row["condition"] == STUDY:
            for name in (*MISSES, "inside"):
                half = 0.5 * (row[f"{name}_upper"] - row[f"{name}_lower"])
                rows.append((row["law"], name, trials_needed(row[name], half, row["trials"])))
    columns = {
        "law": Column(),
        "number": Column(meaning="column of the table of ranks"),
        "trials": Column("", ".3g", "with which its interval is a tenth of it to each side"),
    }
    return table(rows, columns)


def tuning(shown: Shown):
    """What was tried."""
    rows = []
    for law, tries in shown.tuned.items():
        for number, one in enumerate(tries):
            written = [f"{name} {value:.3g}" for name, value in one["numbers"].items()]
            words = ", ".join(written) or "as its authors give it"
            rows.append((law, words, one["mean"], one["saturated"], number == 0))
    columns = {
        "law": Column(),
        "numbers": Column(meaning="that were tried"),
        "mean miss": Column("m", shown.scenario.digits, "on the pool for tuning; a lost flight misses by ten boxes"),
        "saturated": Column("", ".1f", "guidance periods in which limits acted, on average"),
        "chosen": Column(),
    }
    return table(rows, columns)


TABLES = {one.__name__: one for one in (ranks, laws, pairs, efforts, sources, explained, needed, tuning)}


def write(shown: Shown, declared: Arena, output) -> None:
    """Compare with the sealed table, write all figures and tables of a scenario, and the sealed table of today."""
    shown.require_same()
    figures = import_module(f"marsedl.scenarios.{shown.scenario.name}.figures").FIGURES
    for stem, png, pdf in zip(declared.figures, output.png, output.pdf, strict=True):
        save_figure(figures[stem](shown), png, pdf)
    for stem, csv, md in zip(declared.tables, output.csv, output.md, strict=True):
        write_table(TABLES[stem](shown), csv, md)
    write_text(output.sealed, json.dumps(shown.seal(), indent=1) + "\n")
