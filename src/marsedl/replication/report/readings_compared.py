"""What decides a verdict, and what errata and unprinted inputs change: computed from the claims alone.

Readings are compared at equal numbers of trials. Where they share random numbers, as they do unless their seeds differ,
the standard error of a difference is smaller than stated here: claims do not hold by how much.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from marsedl.replication.claims.claim import (
    COUNTED_VERDICTS,
    MEASURED,
    REFUTED_VERDICTS,
    STANDING_VERDICTS,
    UNDECIDED,
    Claim,
    Result,
)
from marsedl.replication.claims.numbers import flatten, is_finite, is_number
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.report.one_line import label, named_inputs

# What an erratum changes, from most to least.
NO_RESULT = "no_result"  # a headline number does not exist in a reading that keeps what is printed
HEADLINE = "headline"  # a headline number changes beyond rounding and sampling error
VERDICT = "verdict"  # a verdict changes
NOTHING = "nothing"  # no headline number and no verdict changes: notation
NOT_ISOLATED = "not_isolated"  # no reading keeps this erratum and mends the others
RANKS = (NO_RESULT, HEADLINE, VERDICT, NOTHING, NOT_ISOLATED)

Pair = tuple[str, str]  # a reading, and the one that it is compared with
Key = tuple[str, tuple[int, ...]]  # a measure, empty for the printed number, and the indices of a component, from 0


class Input(NamedTuple):
    """An input of a reading as it is written, and where it comes from."""

    value: str
    source: str


@dataclass(frozen=True)
class Reading:
    """A reading as the report shows it: what it is for, what it starts from, and all of its inputs by name."""

    name: str
    summary: str
    based_on: str | None
    frozen: bool
    inputs: Mapping[str, Input]


@dataclass(frozen=True)
class VerdictChange:
    """A claim, by its id, whose verdict differs between two readings.

    `before` is its verdict in the reading `against`, `after` that in `reading`. `equal_trials`: whether both rest on as
    many trials (or on none).
    """

    claim: str
    reading: str
    against: str
    before: str
    after: str
    equal_trials: bool


@dataclass(frozen=True)
class Change:
    """How a number of a claim differs between two readings.

    `before` is its value in the reading `against`, `after` that in `reading`, and `error` the standard error of
    `difference` (0 without sampling). `size` is |difference| divided by what noise and rounding could explain: three
    standard errors and half a printed digit for a printed number; three standard errors for a sampled measure, and its
    distance from its limit for another.
    """

    claim: str
    measure: str
    component: tuple[int, ...]
    reading: str
    against: str
    before: float
    after: float
    difference: float
    error: float
    unit: str
    size: float
    equal_trials: bool

    @property
    def counts(self) -> bool:
        """Whether the difference is beyond rounding and sampling error."""
        return self.size > 1.0


@dataclass(frozen=True)
class ErratumEffect:
    """What an erratum changes.

    `rank` is one of `RANKS`; `readings` pairs of a reading that keeps what is printed and the nearest of its bases that
    does not. `headline` are the changes of headline numbers, the largest first, one for each claim and reading;
    `no_result` pairs of a headline claim and a reading in which its number does not exist; `verdicts` the verdicts that
    change. `named` are the claims that name the erratum, `refuted` those of them that differ or fail.
    """

    erratum: Erratum
    rank: str
    named: Sequence[str]
    refuted: Sequence[str]
    readings: Sequence[Pair] = ()
    headline: Sequence[Change] = ()
    no_result: Sequence[Pair] = ()
    verdicts: Sequence[VerdictChange] = ()

    @property
    def group(self) -> str:
        """Where the report lists it: ranked, kept together with others that refuted claims name, or notation."""
        if self.rank == NOT_ISOLATED and self.refuted:
            return "together"
        return "notation" if self.rank in (NOT_ISOLATED, NOTHING) else "ranked"


@dataclass(frozen=True)
class OpenInput:
    """An input, or a few that belong together, that the paper needs and does not print.

    `label` says in words what it is, `used` are the values of its `inputs` in the default reading. `changes` are those
    of the deciding number, one for each reading that differs from its `against` in this input alone; `together` names
    the other open inputs that vary with it where no reading varies it alone. `no_result` are the readings of this kind
    in which the number does not exist. `claims` are the refuted claims that name it, of `refuted` in all.
    """

    label: str
    inputs: Sequence[str]
    used: Sequence[str]
    changes: Sequence[Change]
    together: Sequence[str]
    no_result: Sequence[str]
    claims: Sequence[str]
    refuted: int

    @property
    def named(self) -> int:
        """How many refuted claims name it."""
        return len(self.claims)

    @property
    def low(self) -> float | None:
        """The least that the readings make of the deciding number; None if no reading varies the input."""
        return min((value for change in self.changes for value in (change.before, change.after)), default=None)

    @property
    def high(self) -> float | None:
        """The most that they make of it."""
        return max((value for change in self.changes for value in (change.before, change.after)), default=None)


@dataclass(frozen=True)
class Choice:
    """What a reading makes of the deciding number.

    `inputs` are those that differ from the default reading, without numbers of trials; `errata` the ids of those that
    it keeps. `change` is None if the number does not exist in this reading.
    """

    reading: str
    inputs: Sequence[str]
    errata: Sequence[str]
    change: Change | None


@dataclass(frozen=True)
class Deciding:
    """The number that a paper stands or falls with, in the default reading, and what each choice makes of it.

    `printed` is the value of the paper, None for a statement; `limit` the limit of a statement, None for a number.
    `choices` are those with the largest change first; those without a result come last.
    """

    claim: str
    measure: str
    component: tuple[int, ...]
    unit: str
    value: float
    error: float
    trials: int | None
    printed: float | None
    limit: float | None
    choices: Sequence[Choice]


# ---------------------------------------------------------------------------------------------------- two readings


class _Number(NamedTuple):
    """A number of a claim: its value, standard error and unit, and what of a difference from it is nothing."""

    value: float
    error: float
    unit: str
    slack: float  # half a printed digit; of a statement without sampling, the distance from its limit


class _Sample(NamedTuple):
    """What a reading gives for a claim from a number of trials."""

    trials: int | None
    verdict: str
    numbers: dict[Key, _Number]


def _samples(row: Claim, reading: str) -> list[_Sample]:
    """What a reading gives from all of its trials, and from as many as other readings have."""
    result = row.readings.get(reading)
    if result is None or result.verdict is None:
        return []
    results = [result, result.at_equal_trials]
    return [_Sample(one.trials, one.verdict, _numbers(row, one)) for one in results if one]


def _numbers(row: Claim, result: Result) -> dict[Key, _Number]:
    if row.is_statement:
        margin = result.margin
        if margin is None or margin.value is None:
            return {}
        error = margin.standard_error
        slack = 0.0 if error or margin.limit is None else abs(margin.value - margin.limit)
        return {(margin.measure, ()): _Number(margin.value, error, margin.unit, slack)}
    errors, sizes = flatten(result.standard_error), flatten(row.resolution)
    return {
        ("", index): _Number(
            float(value),
            errors.get(index) or 0.0,
            row.unit_of(index),
            0.5 * (sizes.get(index, sizes.get(())) or 0.0),
        )
        for index, value in flatten(result.value).items()
        if is_number(value) and math.isfinite(value)
    }


def _pairs(row: Claim, reading: str, against: str) -> list[tuple[_Sample, _Sample, bool]]:
    """What two readings give, first with equal numbers of trials, and the most of them; and whether they are equal."""
    pairs = [
        (sample, other, sample.trials == other.trials)
        for sample in _samples(row, reading)
        for other in _samples(row, against)
    ]
    return sorted(pairs, key=lambda pair: (-pair[2], -(pair[0].trials or 0), -(pair[1].trials or 0)))


def changes(row: Claim, reading: str, against: str) -> list[Change]:
    """Return how the numbers of a claim differ between two readings: none if they have none in common."""
    for sample, other, equal in _pairs(row, reading, against):
        common = [key for key in sample.numbers if key in other.numbers]
        if common:
            return [
                _change(row, key, reading, against, sample.numbers[key], other.numbers[key], equal) for key in common
            ]
    return []


def _change(row, key, reading, against, number: _Number, other: _Number, equal: bool) -> Change:
    difference = number.value - other.value
    same = equal and number == other  # the same flights
    error = 0.0 if same else math.hypot(number.error, other.error)
    sure = SIGMAS * error + other.slack
    size = abs(difference) / sure if sure else math.inf if difference else 0.0
    values = other.value, number.value, difference, error, other.unit
    return Change(row.id, *key, reading, against, *values, size, equal)


def _change_of(row: Claim, key: Key, reading: str, against: str) -> Change | None:
    return next((c for c in changes(row, reading, against) if (c.measure, c.component) == key), None)


def _verdict_change(row: Claim, reading: str, against: str) -> VerdictChange | None:
    """How the verdict on a claim differs between two readings; what fewer trials alone may leave open is no change."""
    for sample, other, equal in _pairs(row, reading, against)[:1]:
        both = {sample.verdict, other.verdict}
        if len(both) == 2 and both <= set(COUNTED_VERDICTS) and (equal or UNDECIDED not in both):
            return VerdictChange(row.id, reading, against, other.verdict, sample.verdict, equal)
    return None


def _has_no_result(row: Claim, reading: str) -> bool:
    """Whether a reading evaluates a printed number, and finds that it does not exist."""
    result = row.readings.get(reading)
    if row.kind not in MEASURED or result is None or result.verdict is None:
        return False
    return None in flatten(result.value).values() or not is_finite(result.value)


def _is_towards(row: Claim, change: Change) -> bool:
    """Whether a number comes nearer to what is printed, or the measure of a statement goes towards its limit."""
    if row.is_statement:
        limit = row.readings[change.against].margin.limit
        return limit is not None and (limit - change.before) * change.difference > 0.0
    printed = flatten(row.printed).get(change.component)
    return printed is not None and abs(change.after - printed) < abs(change.before - printed)


def _towards(row: Claim, pairs: Iterable[Pair]) -> float | None:
    """How far the number of a claim moves towards what is printed in the first of these readings; None without any."""
    compared = [pair for pair in pairs if _samples(row, pair[0]) and _samples(row, pair[1])]
    # A change beside the default reading says more than one beside another.
    compared = [pair for pair in compared if pair[1] == CORRECTED] or compared
    sizes = []
    for pair in compared:
        verdict = _verdict_change(row, *pair)
        stands = verdict is not None and verdict.after in STANDING_VERDICTS and verdict.before in REFUTED_VERDICTS
        moves = [change.size for change in changes(row, *pair) if change.counts and _is_towards(row, change)]
        sizes.append(math.inf if stands else max(moves, default=0.0))
    return max(sizes, default=None)


# ------------------------------------------------------------------------------------------------------ all readings


class Compared:
    """What the readings of a paper make of its claims, beside the default reading."""

    def __init__(
        self,
        claims: Sequence[Claim],
        errata: Iterable[Erratum],
        readings: Mapping[str, Reading],
        meanings: Mapping[str, str],
    ):
        """Take a paper's claims, errata and readings, and what each of its inputs is, in words."""
        self.claims, self.errata, self.readings, self.meanings = claims, tuple(errata), readings, meanings
        self._headline = sorted((row for row in claims if row.headline), key=lambda row: row.headline)
        self._refuted = [row for row in claims if row.is_refuted]
        default = readings[CORRECTED].inputs if CORRECTED in readings else {}
        self._assumed = {name for name, one in default.items() if is_assumed(one.source)}
        self._withheld = {text: named_inputs(text, meanings) for row in claims for text in row.withheld}
        self._labelled = {name for group in self._withheld.values() for name in group}

    def changed_verdicts(self) -> dict[str, list[VerdictChange]]:
        """Return the verdicts that differ from those of the default reading, by reading; those without are left out."""
        rows = [row for row in self.claims if row.kind != "input"]
        others = dict.fromkeys(name for row in self.claims for name in row.readings if name != CORRECTED)
        found = {name: [c for row in rows if (c := _verdict_change(row, name, CORRECTED))] for name in others}
        return {name: verdicts for name, verdicts in found.items() if verdicts}

    def effects(self) -> list[ErratumEffect]:
        """Return what each erratum changes, by rank and, within `HEADLINE`, by the largest change of a headline number.

        An erratum that is kept only by readings that are not based on the default one (`printed` keeps all at once) is
        `NOT_ISOLATED`.
        """

        def order(effect: ErratumEffect) -> tuple:
            largest = effect.headline[0].size if effect.rank == HEADLINE else 0.0
            return RANKS.index(effect.rank), -largest

        return sorted(map(self._effect, self.errata), key=order)

    def _effect(self, erratum: Erratum) -> ErratumEffect:
        named = [row.id for row in self.claims if erratum.id in row.errata]
        refuted = [row.id for row in self._refuted if erratum.id in row.errata]
        pairs = self._kept(erratum)
        if not pairs:
            return ErratumEffect(erratum, NOT_ISOLATED, named, refuted)
        of_headline = [(row, *pair) for pair in pairs for row in self._headline]
        no_result = [
            (row.id, name)
            for row, name, against in of_headline
            if _has_no_result(row, name) and not _has_no_result(row, against)
        ]
        headline = [max(both, key=lambda c: c.size) for one in of_headline if (both := changes(*one))]
        counted = [row for row in self.claims if row.kind != "input"]
        verdicts = [c for pair in pairs for row in counted if (c := _verdict_change(row, *pair))]
        by_rank = {NO_RESULT: no_result, HEADLINE: [c for c in headline if c.counts], VERDICT: verdicts, NOTHING: True}
        rank = next(rank for rank, found in by_rank.items() if found)
        headline.sort(key=lambda change: -change.size)
        return ErratumEffect(erratum, rank, named, refuted, pairs, headline, no_result, verdicts)

    def causes(self) -> dict[str, dict[str, float]]:
        """Return how far each cause that a refuted claim names moves its number towards what is printed.

        A cause is moved in its own readings: those that keep an erratum, or that vary unprinted inputs alone.

        Returns:
            By claim and cause (id of an erratum, or text on withheld inputs) the largest change, as `Change.size`;
            infinite if the claim then stands, 0 if no reading moves the number beyond rounding and sampling error, or
            only away. A cause that no reading tells anything of is left out.

        """
        pairs = {erratum.id: self._kept(erratum) for erratum in self.errata}
        for text, names in self._withheld.items():
            varied, together = self._varied(names)
            pairs[text] = () if together else varied
        moved = {}
        for row in self._refuted:
            sizes = {name: _towards(row, pairs.get(name, ())) for name in (*row.errata, *row.withheld)}
            moved[row.id] = {name: size for name, size in sizes.items() if size is not None}
        return moved

    def deciding(self) -> Deciding | None:
        """Return the number that a paper stands or falls with, and what each reading makes of it; None without one.

        It is the first headline claim that is a number (of a row the one that decides), else the measure of the first
        headline statement that other readings have as well. Choices are the readings based on the default one.
        """
        if self._number is None:
            return None
        row, key = self._number
        choices = []
        for name in self.readings:
            change = _change_of(row, key, name, CORRECTED)
            if any(self._lineage(name)) and (change or _has_no_result(row, name)):
                kept = tuple(erratum.id for erratum in self.errata if name in erratum.kept_by)
                choices.append(Choice(name, self._differing(name, CORRECTED), kept, change))
        sample = _samples(row, CORRECTED)[0]
        number = sample.numbers[key]
        return Deciding(
            row.id,
            *key,
            number.unit,
            number.value,
            number.error,
            sample.trials,
            None if row.is_statement else flatten(row.printed)[key[1]],
            row.readings[CORRECTED].margin.limit if row.is_statement else None,
            sorted(choices, key=lambda choice: -abs(choice.change.difference) if choice.change else math.inf),
        )

    def open_inputs(self) -> list[OpenInput]:
        """Return the inputs that the paper needs and does not print.

        These are the inputs that claims name as withheld, together as they are named, and all others whose source in
        the default reading says that they are assumed. First come those that most refuted claims name, of these those
        that change the deciding number most.
        """
        groups = {text: (names, *self._varied(names)) for text, names in self._withheld.items()}
        alike: dict[object, list[str]] = {}  # what the same readings vary is one choice
        for name in (name for name in self.meanings if name in self._assumed - self._labelled):
            alike.setdefault(tuple(self._varied((name,))[0]) or name, []).append(name)
        groups |= {names[0]: (names, self._varied(names[:1])[0], ()) for names in alike.values()}
        found = [self._open_input(text, *group) for text, group in groups.items()]
        return sorted(found, key=lambda one: (-one.named, -max((change.size for change in one.changes), default=0.0)))

    def _open_input(self, text: str, names: Sequence[str], pairs: Sequence[Pair], together) -> OpenInput:
        found = [change for pair in pairs if self._number and (change := _change_of(*self._number, *pair))]
        # A change beside the default reading says more than one beside another.
        found = [change for change in found if change.against == CORRECTED] or found
        return OpenInput(
            label(text, self.meanings),
            names,
            [self.readings[CORRECTED].inputs[name].value for name in names],
            sorted(found, key=lambda change: -change.size),
            together,
            [name for name, _ in pairs if self._number and _has_no_result(self._number[0], name)],
            [row.id for row in self._refuted if text in row.withheld],
            len(self._refuted),
        )

    @cached_property
    def _number(self) -> tuple[Claim, Key] | None:
        """The claim with the deciding number, and its measure and component."""
        sampled = [(row, samples[0].numbers) for row in self._headline if (samples := _samples(row, CORRECTED))]
        for row, numbers in sampled:
            margin, printed = row.readings[CORRECTED].margin, flatten(row.printed)
            if row.kind in MEASURED and numbers and margin and margin.value is not None:
                return row, min(numbers, key=lambda key: abs(numbers[key].value - printed[key[1]] - margin.value))
        for row, numbers in sampled:
            if row.is_statement and numbers:
                (key,) = numbers
                if any(_change_of(row, key, name, CORRECTED) for name in self.readings if name != CORRECTED):
                    return row, key
        return None

    def _lineage(self, name: str) -> Iterator[str]:
        """The bases of a reading up to the default one; nothing if it is not based on that."""
        chain = []
        while name != CORRECTED:
            name = self.readings[name].based_on if name in self.readings else None
            if name is None or name in chain:
                return
            chain.append(name)
        yield from chain

    def _kept(self, erratum: Erratum) -> list[Pair]:
        """Readings that keep an erratum, each with the nearest of its bases that does not."""
        bases = (
            (name, next((base for base in self._lineage(name) if base not in erratum.kept_by), None))
            for name in erratum.kept_by
        )
        return [(name, base) for name, base in bases if base]

    def _differing(self, first: str, second: str) -> tuple[str, ...]:
        """Inputs in which two readings differ, without numbers of trials: compared readings have equal ones."""
        names = different(self.readings[first], self.readings[second], self.meanings)
        return tuple(name for name in names if not name.endswith("trials"))

    def _varied(self, names: Sequence[str]) -> tuple[list[Pair], tuple[str, ...]]:
        """The readings that vary these inputs alone; else those that vary others as well.

        Each comes with what it differs from: the default reading, before others that it is based on. Inputs that are
        assumed and that no claim calls withheld may accompany them, such as what is done in a case that has no
        solution. Returns the others, too.
        """
        alone, joint = {}, {}
        for name in self.readings:
            lineage = list(self._lineage(name))
            for against in dict.fromkeys([CORRECTED, *lineage] if lineage else []):
                differing = set(self._differing(name, against))
                unnamed = differing.difference(names)
                if unnamed == differing or not unnamed <= self._assumed | self._labelled:
                    continue
                if not unnamed & self._labelled:
                    alone.setdefault(name, against)
                elif self._labelled.intersection(names):
                    joint.setdefault(name, (against, unnamed & self._labelled))
        if alone:
            return list(alone.items()), ()
        beside = set().union(*(unnamed for _, unnamed in joint.values()))
        return [(name, against) for name, (against, _) in joint.items()], tuple(sorted(beside))


def different(first: Reading, second: Reading, names: Iterable[str]) -> list[str]:
    """Return the inputs, of these, in which two readings differ."""
    return [name for name in names if first.inputs[name].value != second.inputs[name].value]


def is_assumed(source: str) -> bool:
    """Whether the source of an input says that nothing printed gives it."""
    return source.startswith("assumed")
