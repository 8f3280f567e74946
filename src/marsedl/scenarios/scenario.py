"""What a scenario is: one vehicle under many laws, with what they know apart from what is true."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from marsedl.fly.campaign import Campaign
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import Source, inputs_set, source_of_key
from marsedl.replication.inputs.messages import Place, checked
from marsedl.replication.inputs.readings import load_study, typed_inputs
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.inputs.written import written_reading
from marsedl.replication.inputs.yaml_file import read_yaml

__all__ = ["POOLS", "Condition", "Resident", "Scenario"]

POOLS = {"tuning": 11, "proof": 12, "practice": 13}  # seeds: of what laws are tuned on, of the table, and of tries


class Resident(NamedTuple):
    """A law, and how it comes from what is known on board."""

    words: str  # what it is, in a line
    design: Callable  # (onboard, **tuned numbers) -> law, as `marsedl.fly.fly` takes it
    tuned: Mapping[str, tuple[float, float]] = {}  # positive numbers that are tuned: least and largest
    differs: str = ""  # what of limits, partition, linear model or lateral logic is not that of the others


class Condition(NamedTuple):
    """In what a law is flown: one set of inputs of the truth."""

    tier: str  # exact, dispersed or wrong
    words: str
    changed: Mapping[str, object] = {}  # inputs of the truth by "section.key", as in a file


class Scenario(ABC):
    """Base of a scenario. What laws are designed from is `onboard`; the truth of a condition is in `flight`."""

    name: ClassVar[str]
    paper: ClassVar[str]  # whose reading `corrected` gives the inputs that the scenario has no others for
    model: ClassVar[type[Inputs]]  # the paper's, and sections of the scenario's own
    conditions: ClassVar[Mapping[str, Condition]]
    residents: ClassVar[Mapping[str, Resident]]
    columns: ClassVar[Mapping[str, tuple[str, str]]]  # unit and meaning of every number of `scores`
    tails: ClassVar[tuple[str, ...]]  # columns of which the 99th percentile is told, too: what a law asks of a vehicle
    box: ClassVar[str]  # what `inside` means, in words
    digits: ClassVar[str]  # of a miss in m, as readers see it
    correlated: ClassVar[str]  # what is drawn together, in words
    budgeted: ClassVar[tuple[str, ...]]  # quantities whose variance is told apart by its sources

    def __init__(self, root: Path, sources: Mapping[str, Source], place: Place, words: str = ""):
        """Take the sources of all inputs by "section.name"."""
        self.root, self.sources, self.place, self.words = root, sources, place, words

    @classmethod
    def load(cls, root: Path, file: Path | None = None) -> "Scenario":
        """The scenario of the project in a folder, or one of a user's file that is `based_on` it.

        Raises InputError naming file, line, key and remedy.
        """
        sources = dict(load_study(cls.paper, cls.model.__base__, root).readings[CORRECTED].sources)
        words = ""
        for path in (root / f"configs/scenarios/{cls.name}.yaml", *([file] if file else ())):
            place = Place(str(path), read_yaml(path, "check its path and permissions"))
            body = checked(written_reading(cls.model), place.document, place)
            if path == file and body.based_on != cls.name:
                raise InputError(f"{place}: based_on is {body.based_on!r}; write 'based_on: {cls.name}'")
            sources, words = sources | inputs_set(cls.model, body, path.stem, place), body.summary
        return cls(root, sources, place, words)

    @cached_property
    def given(self) -> Inputs:
        """All inputs, where no condition changes them."""
        return typed_inputs(self.model, self.root, self.sources, self.place)

    @cached_property
    def known(self) -> Inputs:
        """Inputs of what is known on board: those of the paper's sections, without any of the truth."""
        model = self.model.__base__
        return model(**{name: getattr(self.given, name) for name in model.sections()})

    def truth(self, condition: str) -> Inputs:
        """Inputs of the truth in a condition."""
        changed = dict(
            source_of_key(self.model, key, value, f"condition {condition}")
            for key, value in self.conditions[condition].changed.items()
        )
        return typed_inputs(self.model, self.root, {**self.sources, **changed}, self.place)

    @property
    @abstractmethod
    def largest_miss(self) -> float:
        """Largest miss inside of the box, m."""

    @property
    @abstractmethod
    def onboard(self):
        """What guidance knows: all that laws may be designed from."""

    @abstractmethod
    def flight(self, condition: str) -> dict:
        """Arguments of `marsedl.fly.fly` but for law, trials and seed: what flies in a condition."""

    @abstractmethod
    def told(self, flights) -> tuple[str, dict[str, np.ndarray], dict[str, float]]:
        """The outcome of flights that end as they should; numbers by name; and the limits of those that the box has."""

    def scores(self, flights) -> dict[str, np.ndarray]:
        """What is told of every flight, each (trials,), by the names of `columns`.

        Among them are `miss` (m), `of_box` (the largest number over its limit in the box), `inside` (of the box, 1 or
        0) and what else the scenario counts; of flights that did not end as they should, all but `inside`, which is 0,
        are NaN.
        """
        outcome, numbers, limits = self.told(flights)
        of_box = np.max([np.abs(numbers[name]) / limit for name, limit in limits.items()], axis=0)
        counted = flights.outcome == outcome
        scores = {name: np.where(counted, values, np.nan) for name, values in (numbers | {"of_box": of_box}).items()}
        scores["inside"] = 1.0 * (counted & (of_box <= 1.0))
        return {name: scores[name] for name in self.columns}

    def campaign(self, law, condition: str, seed: int, history: float | None = None) -> Campaign:
        """The flights of a law in a condition, of which any trials may be flown; history: seconds between states."""
        options = {"history": history, "period": 1.0, "substeps": 4, "trigger": None} | self.flight(condition)
        return Campaign(**options, law=law, seed=seed)

    def law(self, name: str, **tuned: float):
        """A resident's law."""
        return self.residents[name].design(self.onboard, **tuned)
