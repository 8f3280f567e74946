"""A user's law against residents: what `marsedl fly` flies, prints and writes."""

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from marsedl.replication.errors import InputError, MarsedlError, nearest
from marsedl.replication.files import write_text
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.products import SEALED
from marsedl.scenarios import SCENARIOS, arena, load
from marsedl.scenarios.own_law import own_law, told_in_a_sentence
from marsedl.scenarios.scenario import POOLS, Scenario

__all__ = ["Contest", "law_digest", "looks", "new_law", "scenario_of"]

PRINT = partial(print, sep="\n")
RESIDENTS_ALONE = "residents"  # folder of what is flown without a law of one's own


def scenario_of(root: Path, named: str) -> Scenario:
    """The scenario of a name, or of a user's file. Raises InputError naming file, line, key and remedy."""
    if not named.endswith((".yaml", ".yml")):
        return load(named, root)
    document = read_yaml(Path(named), "check the path")
    base = document.get("based_on") if isinstance(document, Mapping) else None
    if base not in [*SCENARIOS]:
        raise InputError(f"{named}: based_on is {base!r}, which is no scenario; {nearest(str(base), SCENARIOS)}")
    return load(base, root, Path(named))


def new_law(name: str, scenario: str, folder: Path) -> Path:
    """Write a small law of a scenario that lands, as the start of one's own.

    Raises InputError for a name that is none, a scenario that there is not, or a file that exists.
    """
    path = folder / f"{name}.py"
    if not name.isidentifier():
        raise InputError(f"'{name}' is no name of a law: write letters, digits and underscores, such as my_law")
    if scenario not in SCENARIOS:
        raise InputError(f"there is no scenario '{scenario}'; {nearest(scenario, SCENARIOS)}")
    if path.exists():
        raise InputError(f"{path} exists already; give another name")
    write_text(path, (Path(__file__).parent / scenario / "first_law.py").read_text(encoding="utf-8"))
    return path


def law_digest(scenario: Scenario, law, condition: str) -> str:
    """Digest of a law's code, of all that it reaches in modules beside it, and of its parameters."""
    from marsedl.montecarlo.flights.binding import digest

    return digest(*scenario.campaign(law, condition, POOLS["practice"]).law)


def looks(path: Path, place: str, law: str, digest: str) -> tuple[int, int]:
    """Count a look at the sealed pool in a file, a line each; returns how many this law and all laws have had there.

    Args:
        path: CSV file. place: scenario and condition. law: its name. digest: of the law, by which it is known again.
    """
    import pandas as pd

    columns = ["place", "law", "digest"]
    known = pd.read_csv(path, dtype=str) if path.exists() else pd.DataFrame(columns=columns)
    known.loc[len(known)] = place, law, digest
    write_text(path, known.to_csv(index=False, lineterminator="\n"))
    there = known[known["place"] == place]
    return int((there["digest"] == digest).sum()), len(there)


@dataclass
class Contest:
    """Laws that are flown in the same trials of a condition.

    Args:
        scenario, condition: in which they fly. say: called with lines that a user reads.
    """

    scenario: Scenario
    condition: str
    say: Callable = PRINT
    laws: dict = field(default_factory=dict)  # by name, as `marsedl.fly.fly` takes them
    refused: dict = field(default_factory=dict)  # residents that cannot fly here, and why
    path: Path | None = None  # of the user's own law
    name: str = RESIDENTS_ALONE  # of it

    def __post_init__(self):
        """Refuse a condition that there is not."""
        conditions = self.scenario.conditions
        if self.condition not in conditions:
            raise InputError(f"there is no condition '{self.condition}'; {nearest(self.condition, conditions)}")

    @property
    def place(self) -> str:
        """Name of the scenario, or of the file of a user's own."""
        return Path(str(self.scenario.place)).stem

    def enter(self, path: Path, tuning_flights: int = 0) -> None:
        """Take a user's law: design it, tune it if asked for, and fly the first trial in Python.

        Raises InputError, in one sentence with file and line, for whatever goes wrong in its file.
        """
        resident, self.path = own_law(path), Path(path).absolute()
        self.name = f"my_{path.stem}" if path.stem in self.scenario.residents else path.stem
        law = resident.design(self.scenario.onboard)
        self.say(f"{self.name}: {resident.words}; the first trial flies in Python, where errors have lines")
        with told_in_a_sentence(self.path):
            arena.flown(self.scenario, law, self.condition, POOLS["practice"], 0, 1, compiled=False)
            if tuning_flights:
                if not resident.tuned:
                    raise InputError(f"{path}: nothing says what is tuned; write TUNED = {{'gain': (0.1, 10.0)}}")
                numbers = arena.tuned(self.scenario, resident, self.condition, tuning_flights)[0].numbers
                found = ", ".join(f"{name} = {number:.4g}" for name, number in numbers.items())
                self.say(f"{self.name}: tuned by {tuning_flights:,} flights: {found or 'as it is written'}")
                law = resident.design(self.scenario.onboard, **numbers)
        self.laws[self.name] = law

    def against(self, names: list[str] | None = None) -> None:
        """Take residents as they were tuned, by default all; who cannot be designed here is kept with the reason."""
        residents, sealed = self.scenario.residents, self.scenario.root / SEALED / f"{self.scenario.name}.json"
        tuned = json.loads(sealed.read_text(encoding="utf-8"))["tuned"] if sealed.exists() else {}
        for name in residents if names is None else names:
            if name not in residents:
                raise InputError(f"there is no resident '{name}'; {nearest(name, residents)}")
            try:
                self.laws[name] = self.scenario.law(name, **tuned.get(name, {}))
                self.scenario.campaign(self.laws[name], self.condition, POOLS["practice"])
            except (ValueError, MarsedlError) as error:
                self.laws.pop(name, None)
                self.refused[name] = str(error)

    def fly(self, seed: int, trials: int) -> dict[str, arena.Scores]:
        """Scores of all laws in the first trials of a pool, by name.

        Residents that cannot fly are kept with the reason. Raises InputError if the user's own law cannot.
        """
        scores = {}
        for name, law in [*self.laws.items()]:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    with told_in_a_sentence(self.path or Path(name)):
                        scores[name] = arena.flown(self.scenario, law, self.condition, seed, 0, trials, progress=None)
                except InputError as error:
                    if name == self.name:
                        raise
                    self.refused[name] = str(error)
                    del self.laws[name]
            if name == self.name:
                self.say(*(f"{name}: {sentence}" for sentence in dict.fromkeys(str(one.message) for one in caught)))
        return scores

    def told(self, title: str, scores: Mapping[str, arena.Scores], folder: Path, stem: str) -> None:
        """Print the ranked table of a pool, and write it with pairs, trials and a figure, their names with a stem."""
        import pandas as pd

        ranks = arena.table(scores)
        self.say("", title, *lines_of(ranks), *(f"{name} cannot fly here: {why}" for name, why in self.refused.items()))
        for row, (name, why) in enumerate(self.refused.items(), len(ranks)):
            ranks.loc[row, ["law", "lost"]] = name, why
        trials = []
        for law, one in scores.items():
            numbers = pd.DataFrame(one.values.T, columns=one.names)
            trials.append(numbers.assign(law=law, trial=range(one.outcome.size), outcome=one.outcome))
        tables = {"ranks": ranks, "pairs": arena.pairs(scores), "trials": pd.concat(trials)}
        for name, data in tables.items():
            write_text(folder / f"{stem}_{name}.csv", data.to_csv(index=False, lineterminator="\n"))
        self.draw(scores, folder, stem)

    def draw(self, scores: Mapping[str, arena.Scores], folder: Path, stem: str) -> None:
        """Draw ranks with intervals, and where flights ended, as the project's figures of the scenario do."""
        from marsedl.plotting.style import save_figure
        from marsedl.scenarios.shown import STUDY, Shown

        drawn = import_module(f"marsedl.scenarios.{self.scenario.name}.figures").FIGURES
        trials = np.arange(next(iter(scores.values())).outcome.size)
        # The footprint of the project is that of one condition: it is drawn of this one under its name.
        for name, condition in (("ranks", self.condition), ("footprint", STUDY)):
            shown = Shown(self.scenario, {law: {condition: one} for law, one in scores.items()}, trials, {}, "")
            save_figure(drawn[name](shown), folder / f"{stem}_{name}.png")

    def proof(self, file: Path) -> tuple[str, int]:
        """Count a look at the sealed pool; returns the sentence on it, and the seed of the law's own fresh pool."""
        if not self.path:
            return "the sealed pool", 0
        digest = law_digest(self.scenario, self.laws[self.name], self.condition)
        mine, all_laws = looks(file, f"{self.place} {self.condition}", self.name, digest)
        return f"the sealed pool: look {mine} of this law, {all_laws} of all laws flown here", int(digest, 16)


def number_of(value: float) -> str:
    """A number in a table for reading."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def cell_of(row, name: str, factor: float = 1.0) -> str:
    """A number with its interval, if that is known."""
    value, lower, upper = (factor * row[key] for key in (name, f"{name}_lower", f"{name}_upper"))
    return number_of(value) + (f" [{number_of(lower)}, {number_of(upper)}]" if np.isfinite(lower) else "")


def lines_of(ranks) -> list[str]:
    """Lines of a ranked table: places that are left open, misses with intervals, share inside, trials lost."""
    rows = [["place", "law", "mean miss, m", "50 %", "99 %", "inside, %", "lost"]]
    for row in ranks.to_dict("records"):
        best, worst = row["best_place"], row["worst_place"]
        misses = [cell_of(row, name) for name in ("mean", "p50", "p99")]
        inside = cell_of(row, "inside", 100.0)
        rows.append([str(best) if best == worst else f"{best}-{worst}", row["law"], *misses, inside, row["lost"]])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
