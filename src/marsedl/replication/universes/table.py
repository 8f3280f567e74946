"""The table of universes of a paper: what every claim gives in each of them.

One artifact holds it, written by jobs that compute chunks of universes in one process. A universe without a result is
kept with the class of its failure and a sentence; it never counts as a verdict.
"""

import contextlib
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from marsedl.replication.claims.claim import MEASURED, Claim, Result
from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.claims.printed import PublishedClaim, load_measured, load_published
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.claims.verdicts import Evaluation, judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.errors import InadmissibleError, InfeasibleError, InputError, MarsedlError, SolverError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import Choices
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import Reading, load_study
from marsedl.replication.inputs.sections import Inputs, by_section
from marsedl.replication.pipeline.catalogue import Paper, constraint_of
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.pipeline.staleness import BENCHMARKS
from marsedl.replication.records.fields import quantities, quantity, record
from marsedl.replication.records.recipes import recipe_digest
from marsedl.replication.sizes import FULL
from marsedl.replication.universes.designs import DESIGNS, ONE_AT_A_TIME, Universe, redrawn

VERDICTS = ("none", "reproduced", "close", "differs", "holds", "fails", "undetermined", "by_construction")
# Why there is no verdict: it has one; the claim asks for what this universe does not have; four classes of failure.
CAUSES = ("result", "not_asked", "inadmissible", "infeasible", "refused", "numerical")
_OF_NUMBERS = ("universe", "component")
EVALUATED = (*MEASURED, "qualitative")  # kinds of claims
Triple = tuple[float, float, float]  # value, standard error and limit of a number
Numbers = Mapping[str, Triple]  # by claim and component, as in tab4_p99[1]


@record
class Universes:
    """What every claim of a paper gives in every universe."""

    number: np.ndarray = quantity("1", ("universe",), "number of the universe", int)
    design: np.ndarray = quantity("1", ("universe",), "place in `DESIGNS` of the design that it belongs to", "int8")
    seed: np.ndarray = quantity("1", ("universe",), "number of its random streams; 0: those of corrected", int)
    wave: np.ndarray = quantity("1", ("universe",), "wave in which it was computed; 0: before the first", int)
    assignment: np.ndarray = quantity(
        "1", ("universe", "choice"), "value of each choice: the place of the alternative, or the number", allow_nan=True
    )
    tries: np.ndarray = quantity("1", ("universe",), "draws until it was admissible; 0: none were needed", int)
    sentence: np.ndarray = quantity("1", ("universe",), "why it has no result, or not of all claims", str)
    choice: np.ndarray = quantity("1", ("choice",), "names of the choices", str)
    claim: np.ndarray = quantity("1", ("claim",), "ids of the claims", str)
    verdict: np.ndarray = quantity("1", ("universe", "claim"), "place of the verdict in `VERDICTS`", "int8")
    cause: np.ndarray = quantity("1", ("universe", "claim"), "place in `CAUSES` of why there is no verdict", "int8")
    trials: np.ndarray = quantity("1", ("universe", "claim"), "number of trials behind the claim; 0: none", int)
    component: np.ndarray = quantity("1", ("component",), "claim and component, as in tab4_p99[1]", str)
    value: np.ndarray = quantity(
        "1", _OF_NUMBERS, "number of the claim, or of what decides a statement, in its unit", allow_nan=True
    )
    error: np.ndarray = quantity("1", _OF_NUMBERS, "its standard error", allow_nan=True)
    limit: np.ndarray = quantity(
        "1", _OF_NUMBERS, "limit that decides a statement; what is printed of a number", allow_nan=True
    )


@dataclass(frozen=True)
class Outcome:
    """What one claim gives in one universe."""

    cause: str
    verdict: str = "none"
    numbers: Numbers = field(default_factory=dict)
    sentence: str = ""
    trials: int = 0


class Evaluator:
    """Evaluates the claims of a paper in universes, with the records that these share kept in memory."""

    def __init__(self, paper: Paper, model: type[Inputs], root: Path, size: str = FULL, choices: Mapping = {}):
        """Take the catalogue of a paper of the project in a folder, its typed inputs, and the size that is built.

        choices: those of a user, as they are written.
        """
        self.paper, self.claims, self.memory = paper, claims_of(paper.slug), Memory()
        self.study = load_study(paper.slug, model, root, size, choices)
        self.further = {"measured": load_measured(root / BENCHMARKS, paper.slug)} if paper.measured else {}
        published = load_published(root / "data" / "published" / f"{paper.slug}.yaml")
        self.published = {one.id: one for one in published}
        # Those with numbers or statements that a function measures.
        self.asked = [one.id for one in published if one.kind in EVALUATED and one.id in self.claims.declarations]

    def limit_trials(self, most: int) -> None:
        """Let no Monte Carlo case of a universe fly more trials."""
        sections = by_section(dict.fromkeys(self.study.readings[CORRECTED].inputs.CASES.values(), float(most)))
        self.study = replace(self.study, limits=(*self.study.limits, (sections, Place("--trials"))))

    def admitted(self, universe: Universe) -> tuple[Universe, Run, int]:
        """Return a universe, its run and how often some of its choices were drawn again until it was admissible.

        A universe that varies such a choice by itself is taken as it is; one that keeps an erratum by itself is not
        held to the constraint, as it asks what the erratum changes. Raises InadmissibleError if no draw is admissible.
        """
        names = self.study.universes.redrawn
        if universe.design == ONE_AT_A_TIME:
            varied = [self.study.choices.by_name[name] for name in universe.assignment]
            if all(one.erratum for one in varied):
                return universe, self.run(universe, constrained=False), 0
            names = () if any(one.name in names for one in varied) else names
        for attempt in range(self.study.universes.tries if names else 0):
            one = redrawn(self.study.choices, universe, names, attempt) if attempt else universe
            with contextlib.suppress(InadmissibleError):
                return one, self.run(one), attempt
        return universe, self.run(universe), 0

    def run(self, universe: Universe, *, constrained: bool = True) -> Run:
        """Return the run of a universe; raises InadmissibleError if it contradicts what is printed, or itself."""
        try:
            reading = self.study.universe(universe.assignment, universe.inputs, universe.seed)
        except InputError as error:
            raise InadmissibleError(str(error)) from None
        run = self._run(reading)
        if constrained and (constraint := constraint_of(self.paper.slug)):
            run.given().call(constraint)
        return run

    def point(self, name: str) -> dict[str, Evaluation | None]:
        """Return what a named reading gives for each claim; None for one that needs what fails or is not there.

        Unlike a universe, it has the numbers of trials that its inputs say.
        """
        run = self._run(self.study.readings[name])
        found = self.claims.evaluate(run.given(), self.published, **self.further)
        self.memory.let_go()
        return found

    def _run(self, reading: Reading) -> Run:
        """The run of a reading, without the stages that claims use in other readings only."""
        of = self.paper.stages.items()
        unclaimed = [name for name, stage in of if reading.name not in (stage.claimed_in or [reading.name])]
        return Run.of(self.paper, reading.inputs, self.memory, unclaimed)

    def row(self, universe: Universe) -> "Row":
        """Return what all claims give in a universe, each by itself.

        A stage that fails takes only the claims along that ask for what it makes.
        """
        try:
            universe, run, tries = self.admitted(universe)
        except Exception as error:
            return Row(universe, dict.fromkeys(self.asked, class_of(error)), 0)
        return Row(universe, self.outcomes(run), tries)

    def outcomes(self, run: Run) -> dict[str, Outcome]:
        """Return what all claims give in a run, each by itself, and let go of what no other run shares."""
        given = self.claims.asking(run.given(), self.published, **self.further)
        found = {name: self._outcome(name, given) for name in self.asked}
        self.memory.let_go()
        return found

    def _outcome(self, name: str, asked: Arguments) -> Outcome:
        printed = self.published[name]
        try:
            evaluation = self.claims.evaluate_one(name, asked)
            result = judge(printed, evaluation, self.claims.declarations[name])
        except Missing:
            return Outcome("not_asked")
        except Exception as error:
            return class_of(error)
        if result.verdict is None:
            return Outcome("not_asked")
        return Outcome("result", result.verdict, numbers_of(printed, evaluation), trials=result.trials or 0)


class Row(NamedTuple):
    """A universe, what every claim gives in it, and how often some of its choices were drawn again."""

    universe: Universe
    outcomes: Mapping[str, Outcome]
    tries: int = 0


def class_of(error: Exception) -> Outcome:
    """Return the outcome of what a universe, or a stage, raises; raises again what is a fault of the machine."""
    if isinstance(error, OSError | MemoryError):
        raise error
    is_ours = isinstance(error, MarsedlError)
    classes = {InadmissibleError: "inadmissible", InfeasibleError: "infeasible", SolverError: "numerical"}
    other = "refused" if is_ours else "numerical"
    cause = next((name for kind, name in classes.items() if isinstance(error, kind)), other)
    text = str(error) if is_ours else f"{type(error).__name__}: {error}"
    return Outcome(cause, sentence=" ".join(text.split()))


def numbers_of(claim: PublishedClaim | Claim, found: Evaluation | Result) -> Numbers:
    """Return the numbers of a claim; of a statement, those of what decides."""
    if claim.kind == "qualitative":
        of = found.margin and (found.margin.value, found.margin.standard_error, found.margin.limit)
        return {claim.id: tuple(math.nan if number is None else number for number in of)} if of else {}
    values, errors, printed = map(flatten, (found.value, found.standard_error, claim.printed))
    return {
        label: (values[at], errors.get(at) or 0.0, printed[at])
        for label, at, _ in components_of(claim)
        if is_number(values.get(at)) and is_number(printed[at])
    }


def components_of(claim: PublishedClaim | Claim) -> list[tuple[str, tuple[int, ...], float]]:
    """Return name, index and half of the last printed digit of each number of a claim.

    Indices are counted from 1 in the names; the half is 0 if no digit is printed.
    """
    numbers = {(): 0.0} if claim.kind == "qualitative" else flatten(claim.printed)
    digits = flatten(claim.resolution)  # one for all, or one for each
    halves = {at: 0.5 * (digits.get(at, digits.get(())) or 0.0) for at in numbers}
    return [(claim.id + "".join(f"[{i + 1}]" for i in at), at, half) for at, half in halves.items()]


def size_of_change(before: Triple, after: Triple, half: float) -> float:
    """Return how large a change is against what noise and rounding could explain; NaN without two numbers.

    That is three standard errors and `half` of the last printed digit; of what has neither, its distance from its
    limit.
    """
    difference = abs(after[0] - before[0])
    noise = SIGMAS * math.hypot(*np.nan_to_num([before[1], after[1]])) + half or abs(before[0] - before[2])
    if not math.isfinite(difference) or difference == 0.0:
        return difference if difference == 0.0 else math.nan
    return difference / noise if noise > 0.0 else math.inf


def tabulated(evaluator: Evaluator, universes: Sequence[Universe], title: str = "") -> Universes:
    """Compute universes and return their table; with a title, every tenth is told on standard error."""
    return table_of(evaluator, list(_rows(evaluator, universes, title)))


def _rows(evaluator: Evaluator, universes: Sequence[Universe], title: str) -> Iterator[Row]:
    """Compute universes one after the other."""
    for count, universe in enumerate(universes, start=1):
        yield evaluator.row(universe)
        if title and count % 10 == 0:
            print(f"{title}: {count} of {len(universes)} universes", file=sys.stderr)


def chunk_of(
    evaluator: Evaluator, universes: Sequence[Universe], chunk: int, chunks: int, title: str
) -> tuple[Universes, dict[str, dict[str, Evaluation | None]]]:
    """Compute one of so many chunks of universes; returns their table, and what named readings give.

    A named reading is evaluated next to the universe with its values of choices, with which it shares records.
    """
    own, study = universes[chunk::chunks], evaluator.study  # dealt out in turn: each has as many of each design
    beside = {name: [u for u in universes if u.assignment == study.assignment_of(name)][:1] for name in study.points}
    others = [name for name, first in beside.items() if not first][chunk::chunks]
    rows, found = [], {}
    for universe, row in zip(own, _rows(evaluator, own, title), strict=True):
        rows.append(row)
        found |= {name: evaluator.point(name) for name, first in beside.items() if universe in first}
    found |= {name: evaluator.point(name) for name in others}
    return table_of(evaluator, rows), found


def table_of(evaluator: Evaluator, rows: Sequence[Row]) -> Universes:
    """Return the table of universes that were evaluated."""
    choices, asked = evaluator.study.choices, evaluator.asked
    components = [(name, label) for name in asked for label, *_ in components_of(evaluator.published[name])]
    numbers = np.full((3, len(rows), len(components)), np.nan)
    for at, row in enumerate(rows):
        for place, (name, label) in enumerate(components):
            numbers[:, at, place] = row.outcomes[name].numbers.get(label, np.nan)
    numbers[~np.isfinite(numbers)] = np.nan

    def of_claims(read: Callable[[Outcome], int], kind: type) -> np.ndarray:
        found = [[read(row.outcomes[name]) for name in asked] for row in rows]
        return np.array(found, dtype=kind).reshape(len(rows), len(asked))

    sentences = [[one.sentence for one in row.outcomes.values()] for row in rows]  # of what fails
    return Universes(
        number=np.array([row.universe.number for row in rows], dtype=np.int64),
        design=np.array([DESIGNS.index(row.universe.design) for row in rows], dtype=np.int8),
        seed=np.array([row.universe.seed for row in rows], dtype=np.int64),
        wave=np.array([row.universe.wave for row in rows], dtype=np.int64),
        assignment=np.array([coded(choices, row.universe) for row in rows]).reshape(len(rows), len(choices)),
        tries=np.array([row.tries for row in rows], dtype=np.int64),
        sentence=np.array(["; ".join(dict.fromkeys(filter(None, those))) for those in sentences], dtype=str),
        choice=np.array([choice.name for choice in choices], dtype=str),
        claim=np.array(asked, dtype=str),
        verdict=of_claims(lambda one: VERDICTS.index(one.verdict), np.int8),
        cause=of_claims(lambda one: CAUSES.index(one.cause), np.int8),
        trials=of_claims(lambda one: one.trials, np.int64),
        component=np.array([label for _, label in components], dtype=str),
        value=numbers[0],
        error=numbers[1],
        limit=numbers[2],
    )


def world_of(made: Mapping[str, Any]) -> str:
    """Return the digest of what universes are computed from, whichever they are; made: what their job is given.

    Of the code, that is all claims and stages, and not the script that computes them.
    """
    same = {name: value for name, value in made.items() if name not in ("designs", "record", "points")}
    _, _, science = made["code"].partition(" ")
    return recipe_digest(same | {"inputs": made["inputs"][CORRECTED], "code": science})


def selected(table: Universes, those: np.ndarray) -> Universes:
    """Return some of the universes of a table; those: a mask, or places."""
    return replace(table, **{name: getattr(table, name)[those] for name in _along()})


def _along() -> list[str]:
    """The fields of a table that lie along its universes; these share all others."""
    return [name for name, one in quantities(Universes).items() if "universe" in one.dims]


def gathered(chunks: Sequence[Universes]) -> Universes:
    """Return the table of all universes of several, in the order of their numbers."""
    order = np.argsort(np.concatenate([chunk.number for chunk in chunks]), kind="stable")
    joined = {name: np.concatenate([getattr(chunk, name) for chunk in chunks])[order] for name in _along()}
    return replace(chunks[0], **joined)


def coded(choices: Choices, universe: Universe) -> list[float]:
    """Return the value of every choice as a number: the place of the alternative, or the number of a range."""
    complete = choices.complete(universe.assignment)
    return [
        np.nan if (value := complete[one.name]) is None
        else float(value) if one.range else float(list(one.alternatives).index(value))
        for one in choices
    ]  # fmt: skip


def decoded(choices: Choices, row: Sequence[float]) -> dict[str, Any]:
    """Return the assignment of a row of the table."""
    return {
        one.name: float(number) if one.range else list(one.alternatives)[int(number)]
        for one, number in zip(choices, row, strict=True)
        if np.isfinite(number)
    }
