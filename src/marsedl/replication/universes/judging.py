"""What decides a claim: verdicts, labels and causes, judged from the numbers of a paper's universes and readings.

Shares of universes depend on how many alternatives each choice lists: they are no probabilities.
"""

import hashlib
import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.replication.claims.claim import Cause, Claim, Result, Standing
from marsedl.replication.claims.committed import committed_verdicts
from marsedl.replication.claims.moved import Entry, standard_errors
from marsedl.replication.claims.names import AGREEING_VERDICTS, BY_CONSTRUCTION, REFUTED_VERDICTS
from marsedl.replication.claims.numbers import unit_of
from marsedl.replication.claims.printed import PublishedClaim, load_published
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.claims.verdicts import Declaration, verdicts_in_universes, worst
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import MISPRINT, SETTING, WITHHELD, Choice, Choices, Value
from marsedl.replication.inputs.readings import Study, load_study
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.catalogue import Paper
from marsedl.replication.pipeline.products import COMMITTED_RUNS
from marsedl.replication.records import store
from marsedl.replication.universes.designs import AGAIN, DESIGNS, ONE_AT_A_TIME, SPACE_FILLING, interval_of
from marsedl.replication.universes.table import (
    NOT_ASKED,
    RESULT,
    Triple,
    Universes,
    components_of,
    decoded,
    numbers_of,
)

ROBUST, DEPENDS, NEVER = "robust", "depends", "never"  # labels
UNDECIDED, FEW, NOT_COMPUTED = "undecided", "too_few", "not_computed"
TRUE = (*AGREEING_VERDICTS, BY_CONSTRUCTION)  # verdicts of what is true, also if it cannot be otherwise
NO_VERDICT = "none"  # where a claim has no result
FEWEST = 20  # space-filling universes that decide a claim; fewer give it no label
PERMUTATIONS = 200
LEVEL = 0.95  # of intervals, and of the index that chance alone gives
NOTHING = (math.nan, 0.0, math.nan)
CLASSES = {WITHHELD: "not printed", MISPRINT: "a possible misprint", SETTING: "a setting left open"}


class Share(NamedTuple):
    """In how many of some universes a claim reproduces or holds, with the Wilson interval of that share."""

    count: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share; NaN of none."""
        return self.count / self.of if self.of else math.nan


class Effect(NamedTuple):
    """What one value of a choice changes by itself, beside `corrected`.

    `where` names the universe, or the reading, that has the value; it is compared with `corrected` at its number of
    trials. `difference` is that of the number that decides, `size` its ratio to what noise and rounding could explain;
    NaN if there is no number, or if another test decides. `towards` says whether the number moves nearer to what is
    printed, or to its limit, and `beyond` whether it ends on the other side of what is printed.
    """

    choice: str
    value: Value
    where: str
    verdict: str
    cause: str
    number: float
    difference: float
    missing: float  # how far the number is from what is printed, or a statement from holding; negative where it holds
    size: float
    towards: bool
    beyond: bool

    @property
    def counts(self) -> bool:
        """Whether the change is beyond noise and rounding."""
        return self.size > 1.0

    @property
    def is_true(self) -> bool:
        """Whether the claim reproduces or holds there."""
        return self.verdict in TRUE

    @property
    def is_decided(self) -> bool:
        """Whether the claim is true or false there."""
        return self.is_true or self.verdict in REFUTED_VERDICTS


class Index(NamedTuple):
    """The correlation ratio of a choice, or of a pair ("a x b"), and what chance alone gives."""

    choice: str
    ratio: float
    chance: float

    @property
    def decides(self) -> bool:
        """Whether the ratio is beyond chance."""
        return self.ratio > self.chance


@dataclass(frozen=True)
class Judged:
    """What the universes say of one claim.

    `label` is `robust` if the claim reproduces or holds in every universe and reading with a result, `never` if it is
    false in all of them, `depends` if it is true in some and false in others, `undecided` if those that decide agree
    and others are undetermined, `too_few` if fewer than `FEWEST` universes decide it, `not_computed` if none has a
    result. `alone` are the choices that turn or move it by themselves, `together` those that only matter with others.
    """

    component: str
    verdict: str
    number: float
    error: float
    printed: float
    label: str
    alone: tuple[str, ...]
    together: tuple[str, ...]
    effects: tuple[Effect, ...]
    cause: Effect | None
    misprint: Effect | None  # that would make it true
    over_all: Share
    over_results: Share
    undetermined: Share
    deciding: int  # space-filling universes in which it is true or false
    nearest: float | None  # the number where all of the claim's numbers come nearest to what is printed
    its_universe: int | None  # in which they do
    indices: tuple[Index, ...]
    noise: float  # share of the variance over universes that is sampling error


def share(count: int, of: int) -> Share:
    """Return a share with its Wilson interval."""
    from scipy.stats import binomtest  # slow to import

    if not of:
        return Share(0, 0, math.nan, math.nan)
    return Share(count, of, *map(float, binomtest(count, of).proportion_ci(LEVEL, method="wilson")))


def share_of(those: np.ndarray, among: np.ndarray) -> Share:
    """Return the share of some among others, with its Wilson interval; both are masks."""
    return share(int((those & among).sum()), int(among.sum()))


@dataclass(frozen=True, eq=False)
class Findings:
    """What all universes give for one claim, in the order of their table, and the verdicts on it.

    `labels` name its numbers, such as "[1]", or the tests of a statement; `halves` are half of their last printed
    digits, 0 if none is printed. `numbers` holds value, standard error and limit (3, universe, label). `cause`,
    `trials` and `verdicts` are those of the claim (universe,), `of_numbers` are the verdicts on its numbers (universe,
    label). `tests` is the place of the test that decides a statement (universe,), -1 if none does. `base` is the place
    of `corrected` among the universes.
    """

    claim: PublishedClaim
    base: int
    labels: list[str]
    halves: np.ndarray
    numbers: np.ndarray
    cause: np.ndarray
    trials: np.ndarray
    verdicts: np.ndarray
    of_numbers: np.ndarray
    tests: np.ndarray

    @property
    def is_statement(self) -> bool:
        """Whether the claim is a statement; others are numbers."""
        return self.claim.kind == "qualitative"

    @property
    def has_result(self) -> np.ndarray:
        """In which universes the claim has a result, (universe,) as all that follow."""
        return self.cause == RESULT

    @cached_property
    def agrees(self) -> np.ndarray:
        """Where it reproduces or holds, though it could be otherwise."""
        return np.isin(self.verdicts, AGREEING_VERDICTS)

    @cached_property
    def refuted(self) -> np.ndarray:
        """Where it differs or fails."""
        return np.isin(self.verdicts, REFUTED_VERDICTS)

    @property
    def is_true(self) -> np.ndarray:
        """Where it reproduces or holds, also if it cannot be otherwise."""
        return np.isin(self.verdicts, TRUE)

    @property
    def decided(self) -> np.ndarray:
        """Where it is true or false."""
        return self.is_true | self.refuted

    @cached_property
    def distances(self) -> np.ndarray:
        """How far every number is from what is printed, in half digits and errors of `corrected`; -1 without one."""
        value, error, limit = self.numbers
        scale = np.hypot(SIGMAS * np.nan_to_num(error[self.base]), self.halves)
        scale = np.where(scale == 0.0, np.abs(limit), scale)
        distances = np.abs(value - limit) / np.where(scale == 0.0, 1.0, scale)
        return np.where(np.isfinite(distances), distances, -1.0)

    @cached_property
    def deciding(self) -> int:
        """The place of the number that decides in `corrected`.

        Of a row of numbers that is the one furthest from what is printed; of a statement, what its deciding test
        measures, and never what another one does.
        """
        if self.is_statement:
            test = int(self.tests[self.base])
            return test if test >= 0 else int(self.tests.max())
        return int(np.argmax(self.distances[self.base]))

    def number(self, universe: int) -> Triple:
        """Return the number that decides, in the universe at a place of the table."""
        return tuple(self.numbers[:, universe, self.deciding].tolist())


class Judge:
    """Judges claims by a paper's table of universes and by what its readings give; `of` has its findings by claim."""

    def __init__(
        self,
        table: Universes,
        choices: Choices,
        published: Sequence[PublishedClaim],
        declarations: Mapping[str, Declaration],
        rows: Sequence[Claim] = (),
        points: Mapping[str, tuple[str, Value]] = {},
        *,
        is_committed: bool = False,
        computed: int = 0,
    ):
        """Take what is judged and by what.

        Args:
            table: the universes.
            choices: those of the paper.
            published: what it prints.
            declarations: what its code states about each claim, by id.
            rows: its claims with what every reading gives.
            points: the readings that vary one choice by itself, with it and its value there.
            is_committed: whether the table is a committed one.
            computed: how many of its universes the build has computed, to the same bits.

        """
        self.table, self.choices, self.is_committed, self.computed = table, choices, is_committed, computed
        self.published = {one.id: one for one in published if one.id in declarations}
        self.rows, self.points = {row.id: row for row in rows}, points
        self._words = published, declarations, rows, points
        self.judged, self.effects = cache(self._judged), cache(self._effects)  # tables and pictures ask for the same
        self.base = int(np.flatnonzero(table.number == 0)[0])  # the place of `corrected`
        self._places = {int(number): place for place, number in enumerate(table.number)}
        rows_of = defaultdict(list)
        for row, name in enumerate(table.claim.tolist()):
            rows_of[name].append(row)
        self.of = {
            name: self._findings(self.published[name], declarations[name], np.array(those))
            for name, those in rows_of.items()
            if name in self.published
        }

    def _findings(self, claim: PublishedClaim, declared: Declaration, rows: np.ndarray) -> Findings:
        """Judge a claim in all universes by the rules of `verdicts`; rows: those of the table that are of the claim."""
        table, universes = self.table, len(self.table.number)
        is_statement, half_of = claim.kind == "qualitative", {label: half for label, _, half in components_of(claim)}
        # All numbers of a claim, also those that no universe has.
        every = {*table.component[rows].tolist(), *(() if is_statement else half_of)}
        labels = sorted(every, key=lambda label: (len(label), label))
        at = np.array([self._places[number] for number in table.of[rows].tolist()])
        place = np.array([labels.index(label) for label in table.component[rows].tolist()])
        numbers = np.full((3, universes, len(labels)), np.nan)
        numbers[:, at, place] = table.value[rows], table.error[rows], table.limit[rows]
        cause, finding = np.full(universes, NOT_ASKED, "<U16"), np.full(universes, "", "<U16")
        trials, tests = np.zeros(universes, dtype=np.int64), np.full(universes, -1)
        cause[at], trials[at] = table.cause[rows], table.trials[rows]
        told = table.finding[rows] != ""
        finding[at[told]], tests[at[told]] = table.finding[rows][told], place[told]
        verdicts, of_numbers = finding, np.full(numbers.shape[1:], NO_VERDICT, "<U16")
        if not is_statement:
            printed = [labels.index(label) for label in half_of]
            value, error, _ = numbers[:, :, printed]
            judged = verdicts_in_universes(claim, declared.close, value, error, trials, self.base)
            verdicts = worst(judged)
            of_numbers[:, printed] = np.where(cause[:, np.newaxis] == RESULT, judged, NO_VERDICT)
        bound = finding == BY_CONSTRUCTION
        confirmed = np.isin(verdicts, (*AGREEING_VERDICTS, "undetermined"))
        bound = (bound | bool(declared.by_construction)) & confirmed | (is_statement & bound)
        verdicts = np.where(cause == RESULT, np.where(bound, BY_CONSTRUCTION, verdicts), NO_VERDICT)
        halves = np.array([half_of.get(label, 0.0) for label in labels])
        return Findings(claim, self.base, labels, halves, numbers, cause, trials, verdicts, of_numbers, tests)

    def agrees(self, claims: Sequence[str]) -> np.ndarray:
        """Return in which universes claims reproduce or hold (universe, claim)."""
        found = [self.of[name].agrees for name in claims]
        return np.array(found, dtype=bool).reshape(len(claims), len(self.table.number)).T

    def over(self, table: Universes) -> "Judge":
        """Return what judges another table of the same paper by the same words."""
        return Judge(table, self.choices, *self._words)

    def among(self, design: str) -> np.ndarray:
        """Return which universes are of a design, those apart that are computed again with other random numbers."""
        return (self.table.design == DESIGNS.index(design)) & (self.table.seed == 0)

    def _judged(self, claim: str) -> Judged:
        """Return what the universes say of a claim; raises KeyError for one that is not in the table."""
        one, filled = self.of[claim], self.among(SPACE_FILLING)
        with_result = filled & one.has_result
        effects = self.effects(claim)
        pairs = bool(one.claim.headline)  # of others they would take most of the time
        indices = self.indices(one.numbers[0][:, one.deciding], filled, claim, pairs=pairs)
        of_verdict = self.indices(np.where(one.decided, one.is_true, np.nan), filled, claim, pairs=pairs)
        label, in_readings = self._label(claim), self._in_readings(claim)
        by_itself = (*effects, *in_readings)
        if label == DEPENDS:
            alone, together = self._depends_on(one.is_true[self.base], by_itself, (*indices, *of_verdict))
        else:
            alone, together = self._turning(one.is_true[self.base], by_itself), ()
        number, error, printed = one.number(self.base)
        cause, misprint = self._causes(claim, in_readings)
        nearest, its_universe = self._nearest(claim, filled | self.among(ONE_AT_A_TIME))
        return Judged(
            component=one.labels[one.deciding],
            verdict=self.verdict(claim),
            number=number,
            error=error,
            printed=printed,
            label=label,
            alone=alone,
            together=together,
            effects=effects,
            cause=cause,
            misprint=misprint,
            over_all=share_of(one.is_true, filled),
            over_results=share_of(one.is_true, with_result),
            undetermined=share_of(one.verdicts == "undetermined", with_result),
            deciding=int((filled & one.decided).sum()),
            nearest=nearest,
            its_universe=its_universe,
            indices=indices,
            noise=_noise(*one.numbers[:2, filled, one.deciding]),
        )

    def _label(self, claim: str) -> str:
        """Return what all universes and readings that have a result say together, see `Judged`."""
        one = self.of[claim]
        if not one.has_result.any():
            return NOT_COMPUTED
        if (self.among(SPACE_FILLING) & one.decided).sum() < FEWEST:
            return FEW
        verdicts = {*one.verdicts[one.has_result].tolist()}
        verdicts |= {one.verdict for one in self.rows[claim].readings.values()} if claim in self.rows else set()
        true, false = verdicts & {*TRUE}, verdicts & {*REFUTED_VERDICTS}
        if true and false:
            return DEPENDS
        if "undetermined" in verdicts:
            return UNDECIDED
        return ROBUST if true else NEVER

    def standing(self, claim: str) -> Standing:
        """Return what the universes say of a claim, as it is shown beside its verdict."""
        one = self.judged(claim)
        true, of, low, high = one.over_results
        return Standing(
            label=one.label,
            alone=one.alone,
            together=one.together,
            true=true,
            undetermined=one.undetermined.count,
            deciding=one.deciding,
            of=of,
            low=low,
            high=high,
            cause=self._as_cause(claim, one.cause),
            misprint=self._as_cause(claim, one.misprint),
        )

    def _as_cause(self, claim: str, one: Effect | None) -> Cause | None:
        if one is None:
            return None
        choice = self.choices.by_name[one.choice]
        return Cause(
            choice=one.choice,
            why=f"erratum {choice.erratum}" if choice.erratum else CLASSES[choice.kind],
            value=f"{one.value:g}" if isinstance(one.value, float) else str(one.value),
            where=one.where,
            verdict=one.verdict,
            number=one.number,
            corrected=one.number - one.difference,
            unit=self.unit(claim),
        )

    def unit(self, claim: str) -> str:
        """Return the unit of the number that decides a claim."""
        one = self.of[claim]
        if one.is_statement:
            margin = self.rows[claim].result.margin if claim in self.rows else None
            return margin.unit if margin else ""
        indices = {label: index for label, index, _ in components_of(one.claim)}
        return unit_of(one.claim, indices[one.labels[one.deciding]])

    def verdict(self, claim: str) -> str:
        """Return the verdict of a claim in `corrected`, at the numbers of trials of universes."""
        return str(self.of[claim].verdicts[self.base])

    @cached_property
    def _alone(self) -> list[tuple[int, str, Value]]:
        """The places of universes that vary one choice by itself, with it and its value there."""
        found, corrected = [], decoded(self.choices, self.table.assignment[self.base])
        for at in map(int, np.flatnonzero(self.among(ONE_AT_A_TIME))):
            values = decoded(self.choices, self.table.assignment[at])
            if name := only_moved(self.choices, values, corrected):
                found.append((at, name, values[name]))
        return found

    def _effects(self, claim: str) -> tuple[Effect, ...]:
        """Return what each value of each choice changes by itself in universes, the largest change first."""
        one, found = self.of[claim], []
        for at, choice, value in self._alone:
            varied = choice, value, f"universe {self.table.number[at]}"
            numbers = one.number(self.base), one.number(at)
            verdicts = self.verdict(claim), str(one.verdicts[at])
            found.append(self._effect(claim, varied, numbers, verdicts, str(one.cause[at])))
        return tuple(sorted(found, key=lambda one: math.inf if math.isnan(one.size) else -one.size))

    def _in_readings(self, claim: str) -> list[Effect]:
        """The same of the named readings that vary one choice by itself: they fly more than universes."""
        if (row := self.rows.get(claim)) is None:
            return []
        corrected, found = row.readings[CORRECTED], []
        label = "" if row.is_statement else self.of[claim].labels[self.of[claim].deciding]
        for name, (choice, value) in self.points.items():
            result = row.readings.get(name)
            if result is None or None in (result.verdict, corrected.verdict):
                continue
            sides = [numbers_of(row, one).get(label, NOTHING) for one in (corrected, result)]
            if row.is_statement and len({one.margin and one.margin.measure for one in (corrected, result)}) > 1:
                sides[1] = NOTHING  # of another test
            verdicts = corrected.verdict, result.verdict
            found.append(self._effect(claim, (choice, value, f"reading {name}"), sides, verdicts, RESULT))
        return found

    def _effect(
        self, claim: str, varied: tuple, numbers: Sequence[Triple], verdicts: tuple[str, str], cause: str
    ) -> Effect:
        """The effect of a choice's value in a place, from the numbers and verdicts of `corrected` and of this place."""
        (before, after), one = numbers, self.of[claim]
        missing = [self._missing(claim, side, verdicts[0] == "fails", before) for side in numbers]
        crosses = not one.is_statement and (after[0] - after[2]) * (before[0] - before[2]) < 0.0
        size = standard_errors(SIGMAS)(Entry(*before, half=one.halves[one.deciding]), Entry(*after))
        choice, value, where = varied
        return Effect(
            choice=choice,
            value=value,
            where=where,
            verdict=verdicts[1],
            cause=cause,
            number=float(after[0]),
            difference=float(after[0] - before[0]),
            missing=float(missing[1]),
            size=float(size),
            towards=bool(missing[1] < missing[0]),
            beyond=crosses and verdicts[1] in REFUTED_VERDICTS,
        )

    def _missing(self, claim: str, of: Triple, fails: bool, corrected: Triple) -> float:
        """How far a number is from what is printed, or a statement from holding, in the unit of the number."""
        distance = of[0] - of[2]
        if not self.of[claim].is_statement:
            return abs(distance)
        # A statement holds on the side of `corrected`, or on the other one.
        return distance * float(np.sign(corrected[0] - corrected[2])) * (1.0 if fails else -1.0)

    def _causes(self, claim: str, in_readings: Sequence[Effect]) -> tuple[Effect | None, Effect | None]:
        """Return the value of a choice that by itself makes a refuted claim true, or else nearest to true.

        Misprints, values set apart, what is undetermined, and what ends beyond the printed value are no causes; one of
        the first two that makes the claim true is returned beside.
        """
        row = self.rows.get(claim)
        if (row.verdict if row else self.verdict(claim)) not in REFUTED_VERDICTS:
            return None, None
        known = {(one.choice, one.value) for one in in_readings}
        effects = [*in_readings, *(one for one in self.effects(claim) if (one.choice, one.value) not in known)]
        admitted, apart = [], []
        for one in (one for one in effects if one.is_decided):
            choice = self.choices.by_name[one.choice]
            (apart if choice.kind == MISPRINT or one.value in choice.apart else admitted).append(one)
        true = [one for one in admitted if one.is_true]
        near = [one for one in admitted if one.counts and one.towards and not one.beyond]
        return _nearest_of(true or near), _nearest_of([one for one in apart if one.is_true])

    def second_seed(self) -> Share:
        """Return how many numbers agree, within three standard errors, with those of other random numbers."""
        again = np.flatnonzero(self.table.seed)
        first = np.searchsorted(self.table.number, self.table.number[again] - AGAIN)
        value, error, _ = np.concatenate([one.numbers for one in self.of.values()], axis=2)
        both = np.hypot(error[first], error[again])
        agree = np.abs(value[first] - value[again]) <= SIGMAS * both
        return share_of(agree, both > 0.0)

    def _nearest(self, claim: str, among: np.ndarray) -> tuple[float, int] | tuple[None, None]:
        """The deciding number where a claim's numbers, all of them, come nearest to what is printed; the universe."""
        one = self.of[claim]
        distances = one.distances[:, one.deciding] if one.is_statement else one.distances.max(axis=1)
        use = among & one.has_result & (distances >= 0.0)
        if not use.any():
            return None, None
        best = np.argmin(np.where(use, distances, np.inf))
        return one.number(best)[0], int(self.table.number[best])

    def indices(
        self, values: np.ndarray, among: np.ndarray, claim: str = "", *, pairs: bool = True
    ) -> tuple[Index, ...]:
        """Return the correlation ratio of every choice with a number, the largest first, then of pairs if asked for.

        It is the share of the variance of the number's ranks between the values of the choice (a range in four equal
        parts), among universes with a value. Of a pair it is what both explain together beyond each by itself, and
        only pairs beyond chance are returned. `chance` is what 95 of 100 permutations of the values stay below, with
        all choices at once: of many choices, one would be beyond its own level by chance. claim: whose name seeds the
        permutations.
        """
        use = among & np.isfinite(values)
        if use.sum() < 8 or np.ptp(values[use]) == 0.0:
            return ()
        _, ranks = np.unique(values[use], return_inverse=True)  # of values, outliers would decide alone
        key = int.from_bytes(hashlib.sha256(claim.encode()).digest()[:8], "little")
        generator = np.random.Generator(np.random.Philox(key=key))
        tried = np.array([ranks, *(generator.permutation(ranks) for _ in range(PERMUTATIONS))], dtype=float)
        groups = {one.name: self._groups(one, self.table.assignment[use, k]) for k, one in enumerate(self.choices)}
        groups = {name: np.unique(group, return_inverse=True)[1] for name, group in groups.items()}
        groups = {name: group for name, group in groups.items() if group.any()}
        ratios = {name: correlation_ratio(tried, group) for name, group in groups.items()}
        null = np.array([ratio[1:] for ratio in ratios.values()])
        mean, spread = null.mean(axis=1), np.maximum(null.std(axis=1), 1e-12)
        level = np.quantile(((null - mean[:, np.newaxis]) / spread[:, np.newaxis]).max(axis=0), LEVEL)
        chance = dict(zip(ratios, mean + level * spread, strict=True))
        alone = [Index(name, float(ratio[0]), float(chance[name])) for name, ratio in ratios.items()]
        beyond_chance = []
        for first, second in itertools.combinations(groups, 2) if pairs else ():
            both = groups[first] * len(tried[0]) + groups[second]
            beyond = correlation_ratio(tried, both) - ratios[first] - ratios[second]
            found = Index(f"{first} x {second}", float(beyond[0]), float(beyond[1:].max()))
            beyond_chance += [found] if found.decides else []
        return (*sorted(alone, key=lambda one: -one.ratio), *sorted(beyond_chance, key=lambda one: -one.ratio))

    @staticmethod
    def _groups(choice: Choice, numbers: np.ndarray) -> np.ndarray:
        if choice.range is None:
            return np.nan_to_num(numbers, nan=-1.0)
        shares = np.array([choice.range.share(number) if np.isfinite(number) else -1.0 for number in numbers])
        return np.where(shares < 0, -1, interval_of(shares, 4))

    @staticmethod
    def _turning(is_true: bool, effects: Iterable[Effect]) -> tuple[str, ...]:
        """The choices that turn a verdict by themselves."""
        return tuple(dict.fromkeys(one.choice for one in effects if one.is_decided and one.is_true != is_true))

    def _depends_on(
        self, is_true: bool, effects: Sequence[Effect], indices: Iterable[Index]
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The choices that decide by themselves, those that turn the verdict first, and those that do with others."""
        moving = {one.choice for one in effects if one.counts}
        beyond = [name for one in indices if one.decides for name in one.choice.split(" x ")]
        alone = dict.fromkeys([*self._turning(is_true, effects), *(name for name in beyond if name in moving)])
        return tuple(alone), tuple(dict.fromkeys(name for name in beyond if name not in alone))


def _noise(values: np.ndarray, errors: np.ndarray) -> float:
    """The share of the variance of some numbers that is sampling error; NaN if they do not vary."""
    use = np.isfinite(values)
    variance = float(np.var(values[use])) if use.sum() > 1 else 0.0
    return float(min(np.mean(np.nan_to_num(errors[use]) ** 2) / variance, 1.0)) if variance else math.nan


def correlation_ratio(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the share of the variance of values (..., count) that lies between groups (count,)."""
    order = np.argsort(groups, kind="stable")
    starts = np.flatnonzero(np.diff(groups[order], prepend=np.nan) != 0)
    centred = values - values.mean(axis=-1, keepdims=True)
    sums = np.add.reduceat(centred[..., order], starts, axis=-1)
    between = (sums**2 / np.diff([*starts, len(groups)])).sum(axis=-1)
    total = (centred**2).sum(axis=-1)
    return between / np.where(total > 0, total, 1.0)


def _nearest_of(effects: Sequence[Effect]) -> Effect | None:
    """The effect in which least is missing."""
    return min(effects, key=lambda one: math.inf if math.isnan(one.missing) else one.missing, default=None)


def only_moved(choices: Choices, values: Mapping[str, object], before: Mapping[str, object]) -> str:
    """The one choice that is varied, with those that it needs; nothing if there are none or several."""
    moved = [one for one in choices if values.get(one.name) != before.get(one.name)]
    main = [one.name for one in moved if not any(one.name in other.only_if for other in moved)]
    return main[0] if len(main) == 1 else ""


def single_points(study: Study) -> dict[str, tuple[str, Value]]:
    """The named readings that vary one choice by itself, with it and its value; trials may differ too."""
    base, found = study.readings[CORRECTED], {}
    for name in study.points:
        of = study.readings[name].sources
        values = {one.name: one.value_in(of, base.sources) for one in study.choices}
        varied = only_moved(study.choices, values, {one.name: one.corrected for one in study.choices})
        if not varied or values[varied] is None:
            continue
        applied = study.choices.applied(base.sources, {varied: values[varied]})
        apart = {key for key, one in of.items() if one.value != applied[key].value}
        if apart <= {*base.inputs.CASES.values()}:
            found[name] = varied, values[varied]
    return found


COMMITTED = Path(COMMITTED_RUNS)  # a file for each paper


def of_one_world(first: str | Path, second: str | Path) -> bool:
    """Whether two tables of universes were computed from the same inputs and code."""
    return store.provenance(first)["world"] == store.provenance(second)["world"]


def judge_in(study: Study, table: Universes, rows: Sequence[Claim] = (), **more: object) -> Judge:
    """Return what judges a table of a paper's universes by its printed claims; rows, more: as of `Judge`."""
    published = load_published(study.root / "data" / "published" / f"{study.paper}.yaml")
    points = single_points(study) if rows else {}
    return Judge(table, study.choices, published, claims_of(study.paper).declarations, rows, points, **more)


def judge_of(
    paper: Paper,
    model: type[Inputs],
    root: Path,
    size: str,
    choices: Mapping[str, object],
    path: str | Path,
    rows: Sequence[Claim],
) -> Judge:
    """Return what judges the claims of a paper by a table of universes in a file.

    That is the committed run instead, which has more universes, if it was computed from the same inputs and code.
    choices: those of a user, as they are written; rows: claims, of which those of the paper count.
    """
    study = load_study(paper.slug, model, root, size, choices)
    large = root / COMMITTED / f"{paper.slug}.h5"
    is_committed = large.exists() and of_one_world(large, path)
    built = store.load(path, Universes, paper=paper.slug)
    table = store.load(large, Universes, paper=paper.slug) if is_committed else built
    of_paper = [row for row in rows if row.paper == paper.slug]
    return judge_in(study, table, of_paper, is_committed=is_committed, computed=len(built.number))


def committed_judge(slug: str, model: type[Inputs], root: Path) -> Judge:
    """Return what judges a paper's committed universes, with the committed verdicts of its readings.

    Raises MarsedlError if one of them is missing.
    """
    study, published = load_study(slug, model, root), load_published(root / "data" / "published" / f"{slug}.yaml")
    committed, rows = committed_verdicts(root, slug), []
    for one in published:
        if CORRECTED in (verdicts := committed.get(one.id, {})):
            given = {key: getattr(one, key) for key in ("paper", "id", "kind", "printed", "headline")}
            readings = {name: Result(verdict=verdict) for name, verdict in verdicts.items()}
            rows.append(Claim(**given, verdict=verdicts[CORRECTED], reading=CORRECTED, readings=readings))
    table = store.load(root / COMMITTED / f"{slug}.h5", Universes, paper=slug)
    return judge_in(study, table, rows, is_committed=True)
