"""What moves if a choice, or an input, is another: two universes in memory, and universes by their numbers."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from marsedl.replication.claims.claim import BY_CONSTRUCTION, Claim, Result
from marsedl.replication.claims.numbers import flatten
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.choices import Choices, source_of_key
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import Study
from marsedl.replication.pipeline.catalogue import Paper, entry_of, function_of
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe, numbered
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import (
    RESULT,
    Evaluator,
    Row,
    components_of,
    held,
    numbers_of,
    size_of_change,
    table_of,
)

_IN_TEXT = re.compile(r"-?\d[\d.e+-]*")  # a number in the words of a test


class Number(NamedTuple):
    """A number of a claim; `verdict` is its own, of a statement that on the claim, `test` which test it is of."""

    value: float
    error: float
    limit: float
    verdict: str
    test: str = ""


@dataclass(frozen=True)
class Side:
    """One of two that are compared: inputs or choices as they are written, and what the claims give.

    `verdicts` are by claim, `numbers` by claim and component, `failures` sentences by claims without a result.
    """

    name: str
    inputs: Mapping[str, str]
    verdicts: Mapping[str, str]
    numbers: Mapping[tuple[str, str], Number]
    figures: Path | None = None
    failures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Moved:
    """A number of a claim on two sides, with the number's own verdicts; `size` is as `size_of_change` gives it.

    `same_test` is false if two different tests of a statement decide: then no difference of the numbers means anything.
    """

    claim: str
    component: str
    before: float
    after: float
    error: float
    verdict_before: str
    verdict_after: str
    size: float
    limit_before: float = math.nan
    limit_after: float = math.nan
    same_test: bool = True
    sentence: str = ""

    @property
    def turned(self) -> bool:
        """Whether the verdict changes."""
        return self.verdict_before != self.verdict_after

    @property
    def sigmas(self) -> float:
        """How many standard errors the two numbers are apart; NaN without any, or if they are of two tests."""
        return abs(self.after - self.before) / self.error if self.same_test and self.error > 0.0 else math.nan

    @property
    def counts(self) -> bool:
        """Whether the verdict changes, or the number by more than its error."""
        return self.turned or self.size > 1.0


def numbers_of_reading(row: Claim, result: Result) -> dict[tuple[str, str], Number]:
    """Return the numbers of a claim in a reading, by claim and component."""
    places = {label: at for label, at, _ in components_of(row)}
    own = flatten(result.components) if result.components is not None else {}
    test = _IN_TEXT.sub("#", result.margin.measure) if row.is_statement and result.margin else ""
    return {
        (row.id, label): Number(*triple, own.get(places[label]) or result.verdict, test)
        for label, triple in numbers_of(row, result).items()
    }


def side_of_universe(judge: Judge, number: int, name: str, inputs: Mapping[str, str]) -> Side:
    """Return a universe of a table as a side; of each statement the test that decides it there."""
    at, numbers = int(np.flatnonzero(judge.table.number == number)[0]), {}
    verdicts = {claim: str(judge.verdicts[at, column]) for claim, column in judge.column.items()}
    for place, (claim, label) in enumerate(judge.component):
        triple, verdict, is_statement = judge.numbers[:, at, place].tolist(), verdicts[claim], judge.is_statement(claim)
        is_told = not is_statement or place == judge.tests[at, judge.column[claim]]  # of several tests, what decides
        if not is_told or not math.isfinite(triple[0]):
            continue
        own = verdict if is_statement or verdict == BY_CONSTRUCTION else str(judge.of_numbers[at, place])
        key = (claim, "") if is_statement else (claim, label)
        numbers[key] = Number(*triple, own, label if is_statement else "")
    return Side(name, inputs, verdicts, numbers)


def moves_of(claim: PublishedClaim, before: Side, after: Side) -> Iterator[Moved]:
    """Yield all numbers of a claim that both sides judge, by component."""
    for label, _, half in components_of(claim):
        old, new = (
            side.numbers.get((claim.id, label), Number(math.nan, 0.0, math.nan, side.verdicts[claim.id]))
            for side in (before, after)
        )
        same = _of_one_test(old, new)
        yield Moved(
            *(claim.id, claim.id + label, old.value, new.value, math.hypot(*np.nan_to_num([old.error, new.error]))),
            *(old.verdict, new.verdict, size_of_change(old[:3], new[:3], half) if same else math.nan),
            *(old.limit, new.limit, same),
        )


def _of_one_test(old: Number, new: Number) -> bool:
    """Whether two numbers are of one test; a table numbers tests, a reading has their words, so limits tell."""
    if old.test.startswith("test ") == new.test.startswith("test ") or "" in (old.test, new.test):
        return "" in (old.test, new.test) or old.test == new.test
    return math.isclose(old.limit, new.limit, rel_tol=1e-6)


def changes_of(texts: Iterable[str], choices: Choices) -> tuple[dict[str, object], dict[str, object]]:
    """Return values of choices, and inputs by "section.key", from texts such as "noise_unit=newton".

    Raises InputError for a text without a value, or one that names neither a choice nor an input.
    """
    assignment, inputs = {}, {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not value:
            raise InputError(f"{shown(text)}: write NAME=VALUE, such as {next(iter(choices.by_name), 'a.b')}=...")
        if "." in name:
            inputs[name] = yaml.safe_load(value)
        else:
            assignment[name] = value
    return choices.checked(assignment), inputs


class WhatIf:
    """A reading, and the same with other values of choices and inputs."""

    def __init__(
        self,
        evaluator: Evaluator,
        assignment: Mapping[str, object],
        inputs: Mapping[str, object],
        name: str = CORRECTED,
    ):
        """Take what is set; nothing is computed yet.

        inputs: by "section.key", as they are written in a configuration; name: of the reading

        Raises InputError for an unknown reading, choice, value or input, and for inputs that do not fit together.
        """
        self.evaluator, study = evaluator, evaluator.study
        base = study.reading(name)
        if name != CORRECTED:  # whose values of choices are then those that an assignment leaves out
            choices = study.choices.placed(study.readings[PRINTED].sources, base.sources, Place("choices"))
            choices = replace(choices, base=study.choices.base)
            study = replace(study, choices=choices, readings={**study.readings, CORRECTED: base})
            evaluator.study = study
        old = {key: study.choices.default(study.choices.by_name[key]) for key in assignment}
        old |= {key: base.sources[source_of_key(type(base.inputs), key, new)[0]].written for key, new in inputs.items()}
        self.set = {key: (str(old[key]), str(value)) for key, value in {**assignment, **inputs}.items()}
        self.names = name, ", ".join(f"{key} = {value}" for key, (_, value) in self.set.items())
        # What is asked for is computed though it may contradict what is printed: no choice is drawn again.
        self.universes = Universe(0, ONE_AT_A_TIME, {}), Universe(1, ONE_AT_A_TIME, dict(assignment), inputs=inputs)
        self.runs = [evaluator.run(one, constrained=False) for one in self.universes]
        self.trials = study.universe(assignment, inputs).trial_counts()

    def sides(self) -> tuple[Side, Side]:
        """Compute both, and return what their claims give."""
        pairs = zip(self.universes, self.runs, strict=True)
        rows = [Row(one, self.evaluator.outcomes(run)) for one, run in pairs]
        inputs = [{key: pair[at] for key, pair in self.set.items()} for at in range(2)]
        before, after = _sides(self.evaluator, rows, self.names, inputs)
        return before, after

    def drawn(self, stem: str) -> dict:
        """Return a figure of both by title; raises InputError for an unknown one."""
        function, published = function_of(figure_entry(self.evaluator.paper, stem)), self.evaluator.published
        return {
            name: run.given().call(function, published=published)
            for name, run in zip(self.names, self.runs, strict=True)
        }


def _sides(evaluator: Evaluator, rows: Sequence[Row], names: Sequence[str], inputs: Sequence[Mapping]) -> list[Side]:
    """Universes that were computed, the first of them `corrected`, as sides."""
    published = [*evaluator.published.values()]
    judge = Judge(table_of(evaluator, rows), evaluator.study.choices, published, evaluator.claims.declarations)
    return [
        replace(
            side_of_universe(judge, row.universe.number, name, written),
            failures={claim: one.sentence for claim, one in row.outcomes.items() if one.cause != RESULT},
        )
        for row, name, written in zip(rows, names, inputs, strict=False)
    ]


def figure_entry(paper: Paper, stem: str) -> str:
    """Return the function of a figure, by its name; raises InputError for an unknown figure."""
    if stem not in paper.figures:
        raise InputError(f"{paper.slug} has no figure {shown(stem)}; {nearest(stem, paper.figures)}")
    return entry_of(paper.slug, "figures", stem)


def found(study: Study, number: int, tables: Sequence[Path]) -> tuple[Universe, Path | None]:
    """Return a universe by its number, and the first of some tables that holds it; None if a design alone has it.

    Raises InputError for a number that no table and no design has.
    """
    for path in tables:
        if one := held(path, study, number):
            return one, path
    return numbered(study.choices, number, study.designs.one_at_a_time, study.designs.at_most), None


def judged(evaluator: Evaluator, universe: Universe) -> tuple[Row, Side]:
    """Compute a universe, and return it with what its claims give.

    `corrected` is computed too, as its sampling error tells the paper's own.
    """
    universes = {0: Universe(0, ONE_AT_A_TIME, {}), universe.number: universe}
    rows = [evaluator.row(one) for one in universes.values()]
    values = evaluator.study.choices.complete(rows[-1].universe.assignment)
    return rows[-1], _sides(evaluator, rows, ("corrected", f"universe {universe.number}")[: len(rows)], [{}, values])[
        -1
    ]
