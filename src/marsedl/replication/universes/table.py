"""The table of universes of a paper: what every claim gives in each of them, as numbers.

One artifact holds it, written by jobs that compute chunks of universes in one process. It says nothing of verdicts:
these are judged from it (`judging`), so that words and tolerances may change and the numbers stay. A universe without a
result is kept with the class of its failure and a sentence; it never counts as a verdict.
"""

import contextlib
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from marsedl.replication.claims.claim import Claim, Result
from marsedl.replication.claims.moved import Entry, differing, exact, moved
from marsedl.replication.claims.names import MEASURED
from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.claims.printed import PublishedClaim, load_measured, load_published
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.errors import InadmissibleError, InfeasibleError, InputError, MarsedlError, SolverError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import Choice, Choices, Value
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import Reading, load_study
from marsedl.replication.inputs.sections import Inputs, by_section
from marsedl.replication.pipeline.catalogue import Paper, constraint_of
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.pipeline.products import BENCHMARKS
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records.fields import quantities, quantity, record
from marsedl.replication.sizes import FULL
from marsedl.replication.universes.designs import DESIGNS, ONE_AT_A_TIME, Universe, redrawn

RESULT, NOT_ASKED = "result", "not_asked"  # a claim has a number or finding; it asks for what a universe does not have
EVALUATED = (*MEASURED, "qualitative")  # kinds of claims
Triple = tuple[float, float, float]  # value, standard error and limit of a number
Numbers = Mapping[str, Triple]  # by component: "" of a single number, "[1]" of a row, "test 1" of a statement


@record
class Universes:
    """What every claim of a paper gives in every universe, a row for each of its numbers."""

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
    of: np.ndarray = quantity("1", ("row",), "number of the universe of a row", int)
    claim: np.ndarray = quantity("1", ("row",), "id of the claim", str)
    component: np.ndarray = quantity("1", ("row",), "which of its numbers, as [1]; of a statement which test", str)
    value: np.ndarray = quantity("1", ("row",), "the number, or what a test measures, in its unit", allow_nan=True)
    error: np.ndarray = quantity("1", ("row",), "its standard error", allow_nan=True)
    limit: np.ndarray = quantity("1", ("row",), "what is printed, or the limit of a test", allow_nan=True)
    trials: np.ndarray = quantity("1", ("row",), "number of trials behind the claim; 0: none", int)
    cause: np.ndarray = quantity("1", ("row",), "why there is no result; else `result`", str)
    finding: np.ndarray = quantity(
        "1", ("row",), "what the tests of a statement find, beside the one that decides; whether a number is bound", str
    )


@dataclass(frozen=True)
class Outcome:
    """What one claim gives in one universe: numbers by component, and what its tests find.

    `finding` is "holds", "fails" or "undetermined" of a statement, "by_construction" of what cannot be otherwise in
    this universe, else nothing; it stands in the row of the component that `decides`.
    """

    cause: str
    numbers: Numbers = field(default_factory=dict)
    finding: str = ""
    decides: str = ""
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
        try:
            evaluation = self.claims.evaluate_one(name, asked)
            return outcome_of(self.published[name], evaluation)
        except Missing:
            return Outcome(NOT_ASKED)
        except Exception as error:
            return class_of(error)


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


def outcome_of(claim: PublishedClaim, found: Evaluation) -> Outcome:
    """Return what a claim gives where it is evaluated; raises InputError if its numbers are not those of the paper."""
    if found.value is None:
        return Outcome(NOT_ASKED)
    bound = "by_construction" if found.by_construction and not found.failed else ""
    if claim.kind != "qualitative":
        if flatten(found.value).keys() != flatten(claim.printed).keys():
            raise InputError(f"{claim.id}: {found.value!r} does not have the shape of the printed {claim.printed!r}")
        return Outcome(RESULT, numbers_of(claim, found), bound, components_of(claim)[0][0], trials=found.trials or 0)
    tests = {f"test {at}": one for at, one in enumerate(found.margins, start=1) if one}
    numbers = {name: _triple(one.value, one.standard_error, one.limit) for name, one in tests.items()}
    finding = "undetermined" if found.doubts else "holds" if found.value == claim.printed else "fails"
    decides = next((name for name, one in tests.items() if one is found.margin), "")
    return Outcome(RESULT, numbers, bound or finding, decides, trials=found.trials or 0)


def numbers_of(claim: PublishedClaim | Claim, found: Evaluation | Result) -> Numbers:
    """Return the numbers of a claim by component; of a statement, those of what decides."""
    if claim.kind == "qualitative":
        one = found.margin
        return {"": _triple(one.value, one.standard_error, one.limit)} if one else {}
    values, errors, printed = map(flatten, (found.value, found.standard_error, claim.printed))
    return {
        label: (values[at], errors.get(at) or 0.0, printed[at])
        for label, at, _ in components_of(claim)
        if is_number(values.get(at)) and is_number(printed[at])
    }


def _triple(*numbers: float | None) -> Triple:
    return tuple(math.nan if number is None else number for number in numbers)


def components_of(claim: PublishedClaim | Claim) -> list[tuple[str, tuple[int, ...], float]]:
    """Return name, index and half of the last printed digit of each number of a claim.

    The name of a single number is empty; else it has indices counted from 1. The half is 0 if no digit is printed.
    """
    numbers = {(): 0.0} if claim.kind == "qualitative" else flatten(claim.printed)
    digits = flatten(claim.resolution)  # one for all, or one for each
    halves = {at: 0.5 * (digits.get(at, digits.get(())) or 0.0) for at in numbers}
    return [("".join(f"[{i + 1}]" for i in at), at, half) for at, half in halves.items()]


def tabulated(evaluator: Evaluator, universes: Sequence[Universe], title: str = "") -> Universes:
    """Compute universes and return their table; with a title, every tenth and the last are told."""
    return table_of(evaluator, list(_rows(evaluator, universes, title)))


def _rows(evaluator: Evaluator, universes: Sequence[Universe], title: str) -> Iterator[Row]:
    """Compute universes one after the other."""
    for count, universe in enumerate(universes, start=1):
        yield evaluator.row(universe)
        if title and (count % 10 == 0 or count == len(universes)):
            print(f"{title}: {count} of {len(universes)} universes", file=sys.stderr)


def table_of(evaluator: Evaluator, rows: Sequence[Row]) -> Universes:
    """Return the table of universes that were evaluated."""
    choices, columns = evaluator.study.choices, []
    for row in rows:
        for name, one in row.outcomes.items():
            # Without a number that decides, what is found has a row of its own.
            numbers = one.numbers if one.decides in one.numbers else {one.decides: _triple(*3 * [None]), **one.numbers}
            for label, triple in numbers.items():
                finding = one.finding if label == one.decides else ""
                columns.append((row.universe.number, name, label, *triple, one.trials, one.cause, finding))
    of, claim, component, value, error, limit, trials, cause, finding = zip(*columns, strict=True)
    numbers = np.array([value, error, limit], dtype=float)
    numbers[~np.isfinite(numbers)] = np.nan
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
        of=np.array(of, dtype=np.int64),
        claim=np.array(claim, dtype=str),
        component=np.array(component, dtype=str),
        value=numbers[0],
        error=numbers[1],
        limit=numbers[2],
        trials=np.array(trials, dtype=np.int64),
        cause=np.array(cause, dtype=str),
        finding=np.array(finding, dtype=str),
    )


def selected(table: Universes, those: np.ndarray) -> Universes:
    """Return some of the universes of a table; those: a mask, or places."""
    rows = np.isin(table.of, table.number[those])
    return replace(table, **{name: getattr(table, name)[rows if along == "row" else those] for name, along in _along()})


def _along() -> list[tuple[str, str]]:
    """The fields of a table that lie along its universes or rows, with which of both; the others are shared."""
    return [(name, one.dims[0]) for name, one in quantities(Universes).items() if one.dims[0] in ("universe", "row")]


def gathered(chunks: Sequence[Universes]) -> Universes:
    """Return the table of all universes of several, in the order of their numbers."""
    order = {
        along: np.argsort(np.concatenate([getattr(chunk, key) for chunk in chunks]), kind="stable")
        for along, key in (("universe", "number"), ("row", "of"))
    }
    joined = {
        name: np.concatenate([getattr(chunk, name) for chunk in chunks])[order[along]] for name, along in _along()
    }
    return replace(chunks[0], **joined)


def held(table: Universes, choices: Choices, number: int, where: object) -> Universe | None:
    """Return a universe of a table, with the choices and the random numbers that it has there, or None.

    Raises InputError if the table is of other choices; where: its file.
    """
    if number not in table.number:
        return None
    if table.choice.tolist() != [one.name for one in choices]:
        raise InputError(f"{where} has other choices than this project; build it again, or give its --configfile")
    at = int(np.flatnonzero(table.number == number)[0])
    values = decoded(choices, table.assignment[at])
    assignment = {name: one for name, one in values.items() if one != choices.default(choices.by_name[name])}
    return Universe(number, DESIGNS[table.design[at]], assignment, int(table.seed[at]), wave=int(table.wave[at]))


def changed(large: Universes, small: Universes) -> dict[int, str]:
    """Return by number which universes of the smaller table have other bits in the larger one, and what differs.

    The same universe is the one of the same choices and random numbers: tables of other designs number it otherwise.
    """
    found = {}
    for row, number in enumerate(map(int, small.number)):
        is_same = (large.seed == small.seed[row]) & _equal_rows(large.assignment, small.assignment[row])
        if not is_same.any():
            found[number] = "is not among them"
            continue
        both = moved(_entries(large, int(large.number[is_same][0])), _entries(small, number), exact)
        if one := next((one for one in both if one.size > 0.0), None):
            what = differing(one.before, one.after) if one.is_on_both else "row"
            found[number] = f"has another {what} of {one.name}"
    return found


def _equal_rows(rows: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Which rows are the same, NaN at the same places."""
    return ((rows == row) | (np.isnan(rows) & np.isnan(row))).all(axis=1)


def require_same(run: Universes, table: Universes, path: Path) -> None:
    """Raise MarsedlError if universes of a table have other bits than in a committed run; path: the run's file."""
    if moved := changed(run, table):
        differing = "; ".join(f"universe {number} {what}" for number, what in moved.items())
        raise MarsedlError(f"{path} is not what this project computes: {differing}; run 'snakemake multiverse'")


def _entries(table: Universes, number: int) -> dict[str, Entry]:
    """The choices of a universe, and its rows: what each number is, and what was found from how many trials."""
    assigned, rows = table.assignment[table.number == number][0], np.flatnonzero(table.of == number)
    entries = {f"choice {name}": Entry(value) for name, value in zip(table.choice, assigned, strict=True)}
    for at in rows:
        found = f"{table.cause[at]}, {table.finding[at]}, {table.trials[at]} trials"
        entry = Entry(table.value[at], table.error[at], table.limit[at], verdict=found)
        entries[f"{table.claim[at]}{table.component[at]}"] = entry
    return entries


def coded(choices: Choices, universe: Universe) -> list[float]:
    """Return the value of every choice as a number: the place of the alternative, or the number of a range."""
    complete = choices.complete(universe.assignment)
    return [_code(one, complete[one.name]) for one in choices]


def _code(choice: Choice, value: Value | None) -> float:
    if value is None:
        return np.nan
    return float(value) if choice.range else float(list(choice.alternatives).index(value))


def decoded(choices: Choices, row: Sequence[float]) -> dict[str, Any]:
    """Return the assignment of a row of the table."""
    return {
        one.name: float(number) if one.range else list(one.alternatives)[int(number)]
        for one, number in zip(choices, row, strict=True)
        if np.isfinite(number)
    }
