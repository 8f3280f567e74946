"""What moves if a choice, or an input, is another: two universes in memory, and universes by their numbers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from marsedl.replication.claims.claim import Claim, Result
from marsedl.replication.claims.moved import Entry, Moved, largest_first, moved, standard_errors
from marsedl.replication.claims.names import BY_CONSTRUCTION
from marsedl.replication.claims.numbers import flatten, unit_of
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.choices import Choices, source_of_key
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import Study
from marsedl.replication.pipeline.catalogue import Paper, entry_of, function_of
from marsedl.replication.records import store
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe, numbered
from marsedl.replication.universes.judging import NO_VERDICT, Judge
from marsedl.replication.universes.table import (
    RESULT,
    Evaluator,
    Row,
    Universes,
    components_of,
    held,
    numbers_of,
    table_of,
)


@dataclass(frozen=True)
class Alternative:
    """One of two that are compared: inputs or choices as they are written, and what the claims give.

    Entries are by claim and component: the verdict on a claim of several numbers has the component "", and each number
    its own one.
    """

    name: str
    inputs: Mapping[str, str]
    entries: Mapping[tuple[str, str], Entry]
    figures: Path | None = None

    @property
    def claims(self) -> set[str]:
        """The claims that are judged."""
        return {claim for claim, _ in self.entries}


def entries_of_reading(claim: Claim, result: Result) -> dict[tuple[str, str], Entry]:
    """Return what a reading gives for a claim, by claim and component."""
    found, numbers = {(claim.id, ""): Entry(verdict=result.verdict)}, numbers_of(claim, result)
    margin = result.margin if claim.is_statement else None
    verdicts = flatten(result.components) if result.components is not None else {}
    for label, index, half in components_of(claim):
        unit = margin.unit if margin else unit_of(claim, index)
        verdict = verdicts.get(index) or result.verdict
        triple = numbers.get(label, ())
        found[claim.id, label] = Entry(*triple, verdict=verdict, unit=unit, half=half, test=result.test)
    return found


def entries_of_universe(judge: Judge, number: int) -> dict[tuple[str, str], Entry]:
    """Return what a universe of a table gives for its claims; of each statement the test that decides it there."""
    at, found = int(np.flatnonzero(judge.table.number == number)[0]), {}
    for claim, one in judge.of.items():
        verdict = str(one.verdicts[at])
        if verdict == NO_VERDICT:
            continue
        found[claim, ""] = Entry(verdict=verdict)
        if one.is_statement:
            place = one.tests[at]
            if place >= 0:
                triple = one.numbers[:, at, place].tolist()
                found[claim, ""] = Entry(*triple, verdict=verdict, test=one.labels[place])
            continue
        for label, index, half in components_of(one.claim):
            place = one.labels.index(label)
            of_number = verdict if verdict == BY_CONSTRUCTION else str(one.of_numbers[at, place])
            triple = one.numbers[:, at, place].tolist()
            found[claim, label] = Entry(*triple, verdict=of_number, unit=unit_of(one.claim, index), half=half)
    return found


def moved_claims(before: Alternative, after: Alternative) -> list[Moved]:
    """Return what moves of the claims that both judge: verdicts first, then by what noise and rounding explain.

    Each number has its own verdict. A claim that fails to give a result is told with its sentence.
    """

    def is_told(one: Moved) -> bool:
        # What the last digits do is no move.
        return one.turned or (one.size > 0.0 and not math.isclose(one.before.value, one.after.value))

    both = [one for one in moved(before.entries, after.entries, standard_errors(SIGMAS)) if one.is_on_both]
    return sorted(filter(is_told, both), key=largest_first)


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

    def sides(self) -> tuple[Alternative, Alternative]:
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


def _sides(
    evaluator: Evaluator, rows: Sequence[Row], names: Sequence[str], inputs: Sequence[Mapping]
) -> list[Alternative]:
    """Universes that were computed, the first of them `corrected`, as sides."""
    published = [*evaluator.published.values()]
    judge = Judge(table_of(evaluator, rows), evaluator.study.choices, published, evaluator.claims.declarations)
    sides = []
    for row, name, written in zip(rows, names, inputs, strict=True):
        without = {claim: one for claim, one in row.outcomes.items() if one.cause != RESULT}
        failed = {(claim, ""): Entry(verdict=NO_VERDICT, said=one.sentence) for claim, one in without.items()}
        sides.append(Alternative(name, written, failed | entries_of_universe(judge, row.universe.number)))
    return sides


def figure_entry(paper: Paper, stem: str) -> str:
    """Return the function of a figure, by its name; raises InputError for an unknown figure."""
    if stem not in paper.figures:
        raise InputError(f"{paper.slug} has no figure {shown(stem)}; {nearest(stem, paper.figures)}")
    return entry_of(paper.slug, "figures", stem)


def found(study: Study, number: int, tables: Sequence[Path]) -> tuple[Universe, Path | None]:
    """Return a universe by its number, and the first of some tables that holds it; None if a design alone has it.

    Raises InputError for a number that no table and no design has.
    """
    for path in filter(Path.exists, tables):
        if one := held(store.load(path, Universes, paper=study.paper), study.choices, number, path):
            return one, path
    return numbered(study.choices, number, study.designs.one_at_a_time, study.designs.at_most), None


def judged(evaluator: Evaluator, universe: Universe) -> tuple[Row, Alternative]:
    """Compute a universe, and return it with what its claims give.

    `corrected` is computed too, as its sampling error tells the paper's own.
    """
    universes = {0: Universe(0, ONE_AT_A_TIME, {}), universe.number: universe}
    rows = [evaluator.row(one) for one in universes.values()]
    names = [f"universe {number}" for number in universes]
    values = [evaluator.study.choices.complete(row.universe.assignment) for row in rows]
    return rows[-1], _sides(evaluator, rows, names, values)[-1]
