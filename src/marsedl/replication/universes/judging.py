"""What decides a claim: queries of the table of universes.

Shares of universes depend on how many alternatives each choice lists: they are no probabilities.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.replication.claims.claim import BY_CONSTRUCTION, REFUTED_VERDICTS, STANDING_VERDICTS, Standing
from marsedl.replication.claims.printed import PublishedClaim, load_published
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.inputs.choices import Choice, Choices, Value
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.catalogue import Paper
from marsedl.replication.records import store
from marsedl.replication.universes.designs import AGAIN, DESIGNS, ONE_AT_A_TIME, SPACE_FILLING, interval_of
from marsedl.replication.universes.table import CAUSES, VERDICTS, Universes, components_of, decoded, size_of_change

ROBUST, DEPENDS, NEVER, UNDECIDED = "robust", "depends", "never", "undecided"
TRUE = (*STANDING_VERDICTS, BY_CONSTRUCTION)  # verdicts of what is true, also if it cannot be otherwise
PERMUTATIONS = 200
LEVEL = 0.95  # of intervals, and of the index that chance alone gives


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

    `difference` is that of the number that decides, `size` its ratio to what noise and rounding could explain; NaN if
    there is no number. `towards` says whether the number moves nearer to what is printed, or to its limit.
    """

    choice: str
    value: Value
    universe: int
    verdict: str
    cause: str
    number: float
    difference: float
    size: float
    towards: bool

    @property
    def counts(self) -> bool:
        """Whether the change is beyond noise and rounding."""
        return self.size > 1.0


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

    `stands` is `robust` if the claim reproduces or holds in every universe that decides it, `never` if in none,
    `undecided` if no universe decides it, else `depends` on the choices `on`.
    """

    component: str
    verdict: str
    number: float
    error: float
    printed: float
    stands: str
    on: tuple[str, ...]
    effects: tuple[Effect, ...]
    over_all: Share
    over_results: Share
    undetermined: Share
    nearest: float | None  # the number where all of the claim's numbers come nearest to what is printed
    its_universe: int | None  # in which they do
    indices: tuple[Index, ...]
    noise: float  # share of the variance over universes that is sampling error


def wilson(count: int, of: int) -> Share:
    """Return a share with its Wilson interval at 95 %."""
    if not of:
        return Share(0, 0, math.nan, math.nan)
    z, p = 1.959963984540054, count / of
    centre = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return Share(count, of, max(centre - half, 0.0), min(centre + half, 1.0))


def share_of(those: np.ndarray, among: np.ndarray) -> Share:
    """Return the share of some among others; both are masks."""
    return wilson(int((those & among).sum()), int(among.sum()))


class Judge:
    """Judges claims by a paper's table of universes."""

    def __init__(
        self, table: Universes, choices: Choices, published: Sequence[PublishedClaim], *, is_committed: bool = False
    ):
        """Take the table, the paper's choices and what it prints, and whether the table is a committed one."""
        self.table, self.choices, self.is_committed = table, choices, is_committed
        self.published = {one.id: one for one in published}
        self.judged, self.effects = cache(self._judged), cache(self._effects)  # tables and pictures ask for the same
        self.column = {str(name): at for at, name in enumerate(table.claim)}  # of the verdicts of each claim
        self.verdicts = np.array(VERDICTS)[table.verdict]  # (universe, claim), as the next two
        self.stands = np.isin(self.verdicts, TRUE)
        self.decided = self.stands | np.isin(self.verdicts, REFUTED_VERDICTS)
        self.base = int(np.flatnonzero(table.number == 0)[0])  # the place of `corrected`
        self._numbers = np.array([table.value, table.error, table.limit])  # (3, universe, component)
        self._places, halves = {}, []  # columns of the numbers of each claim; half of the last printed digit of each
        for name in self.column:
            found = [half for _, _, half in components_of(self.published[name])]
            self._places[name] = range(len(halves), len(halves) + len(found))
            halves += found
        self._halves = np.array(halves)

    def among(self, design: str) -> np.ndarray:
        """Return which universes are of a design, those apart that are computed again with other random numbers."""
        return (self.table.design == DESIGNS.index(design)) & (self.table.seed == 0)

    def _judged(self, claim: str) -> Judged:
        """Return what the universes say of a claim; raises KeyError for one that is not in the table."""
        at, place = self.column[claim], self.component_place(claim)
        filled, stands, decided = self.among(SPACE_FILLING), self.stands[:, at], self.decided[:, at]
        with_result = filled & (self.table.cause[:, at] == CAUSES.index("result"))
        effects = self.effects(claim)
        pairs = bool(self.published[claim].headline)  # of others they would take most of the time
        indices = self.indices(self.table.value[:, place], filled, at, pairs=pairs)
        of_verdict = self.indices(np.where(decided, stands, np.nan), filled, at, pairs=pairs)
        every = filled | self.among(ONE_AT_A_TIME)
        deciding = stands[every & decided]
        overall = DEPENDS if deciding.any() else NEVER
        if deciding.all():  # also of none
            overall = ROBUST if len(deciding) else UNDECIDED
        return Judged(
            str(self.table.component[place]),
            self.verdict(claim),
            *self._numbers[:, self.base, place].tolist(),
            overall,
            self._depends_on(stands[self.base], effects, (*indices, *of_verdict)) if overall == DEPENDS else (),
            effects,
            share_of(stands, filled),
            share_of(stands, with_result),
            share_of(self.verdicts[:, at] == "undetermined", with_result),
            *self._nearest(claim, every),
            indices,
            self._noise(place, filled),
        )

    def standing(self, claim: str) -> Standing:
        """Return what the universes say of a claim, as it stands beside its verdict."""
        one = self.judged(claim)
        (true, of, low, high), found = one.over_results, cause_of(one.effects)
        cause = found and (found.choice, f"{found.value:g}" if isinstance(found.value, float) else found.value)
        return Standing(stands=one.stands, on=one.on, true=true, of=of, low=low, high=high, cause=cause)

    def component_place(self, claim: str) -> int:
        """Return the column of the number that decides a claim: in `corrected` it is furthest from what is printed."""
        return max(self._places[claim], key=lambda place: self._distances[self.base, place])

    def verdict(self, claim: str) -> str:
        """Return the verdict of a claim in `corrected`, at the numbers of trials of universes."""
        return str(self.verdicts[self.base, self.column[claim]])

    def is_statement(self, claim: str) -> bool:
        """Whether a claim is a statement; others are numbers."""
        return self.published[claim].kind == "qualitative"

    @cached_property
    def _distances(self) -> np.ndarray:
        """How far every number is from what is printed, in half digits and errors; -1 without one."""
        value, error, limit = self._numbers
        scale = np.hypot(SIGMAS * error, self._halves)
        scale = np.where(scale == 0.0, np.abs(limit), scale)
        distances = np.abs(value - limit) / np.where(scale == 0.0, 1.0, scale)
        return np.where(np.isfinite(distances), distances, -1.0)

    @cached_property
    def _alone(self) -> list[tuple[int, str, Value]]:
        """The universes that vary one choice by itself, with it and its value there."""
        found, corrected = [], decoded(self.choices, self.table.assignment[self.base])
        for universe in map(int, np.flatnonzero(self.among(ONE_AT_A_TIME))):
            values = decoded(self.choices, self.table.assignment[universe])
            moved = [one for one in self.choices if values.get(one.name) != corrected.get(one.name)]
            main = [one.name for one in moved if not any(one.name in other.only_if for other in moved)]
            if len(main) == 1:
                found.append((universe, main[0], values[main[0]]))
        return found

    def _effects(self, claim: str) -> tuple[Effect, ...]:
        """Return what each value of each choice changes by itself, the largest change first."""
        place, at, found = self.component_place(claim), self.column[claim], []
        before = self._numbers[:, self.base, place]
        # A statement holds on the side of `corrected`, or on the other one.
        side = np.sign(before[0] - before[2]) * (1.0 if self.verdict(claim) in STANDING_VERDICTS else -1.0)
        for universe, choice, value in self._alone:
            verdict, cause = str(self.verdicts[universe, at]), CAUSES[self.table.cause[universe, at]]
            after = self._numbers[:, universe, place]
            if self.is_statement(claim):
                towards = side * (after[0] - after[2]) > side * (before[0] - before[2])
            else:
                towards = abs(after[0] - after[2]) < abs(before[0] - before[2])
            size = size_of_change(before, after, self._halves[place])
            numbers = float(after[0]), float(after[0] - before[0]), float(size), bool(towards)
            found.append(Effect(choice, value, int(self.table.number[universe]), verdict, cause, *numbers))
        return tuple(sorted(found, key=lambda one: math.inf if math.isnan(one.size) else -one.size))

    def second_seed(self) -> Share:
        """Return how many numbers agree, within three standard errors, with those of other random numbers."""
        again = np.flatnonzero(self.table.seed)
        first = np.searchsorted(self.table.number, self.table.number[again] - AGAIN)
        error = np.hypot(self.table.error[first], self.table.error[again])
        agree = np.abs(self.table.value[first] - self.table.value[again]) <= SIGMAS * error
        return share_of(agree, error > 0.0)

    def _nearest(self, claim: str, among: np.ndarray) -> tuple[float, int] | tuple[None, None]:
        """The deciding number where a claim's numbers, all of them, come nearest to what is printed; the universe."""
        distances = self._distances[:, self._places[claim]].max(axis=1)
        use = among & (self.table.cause[:, self.column[claim]] == CAUSES.index("result")) & (distances >= 0.0)
        if not use.any():
            return None, None
        best = np.argmin(np.where(use, distances, np.inf))
        return float(self.table.value[best, self.component_place(claim)]), int(self.table.number[best])

    def indices(self, values: np.ndarray, among: np.ndarray, key: int = 0, *, pairs: bool = True) -> tuple[Index, ...]:
        """Return the correlation ratio of every choice with a number, the largest first, then of pairs if asked for.

        It is the share of the variance of the number's ranks between the values of the choice (a range in four equal
        parts), among universes with a value. Of a pair it is what both explain together beyond each by itself, and
        only pairs beyond chance are returned. `chance` is what 95 of 100 permutations of the values stay below, with
        all choices at once: of many choices, one would be beyond its own level by chance.
        """
        use = among & np.isfinite(values)
        if use.sum() < 8 or np.ptp(values[use]) == 0.0:
            return ()
        _, ranks = np.unique(values[use], return_inverse=True)  # of values, outliers would decide alone
        generator = np.random.Generator(np.random.Philox(key=key))
        tried = np.array([ranks, *(generator.permutation(ranks) for _ in range(PERMUTATIONS))], dtype=float)
        groups = {one.name: self._groups(one, self.table.assignment[use, k]) for k, one in enumerate(self.choices)}
        groups = {name: group for name, group in groups.items() if len(np.unique(group)) > 1}
        ratios = {name: correlation_ratio(tried, group) for name, group in groups.items()}
        null = np.array([ratio[1:] for ratio in ratios.values()])
        mean, spread = null.mean(axis=1), np.maximum(null.std(axis=1), 1e-12)
        level = np.quantile(((null - mean[:, np.newaxis]) / spread[:, np.newaxis]).max(axis=0), LEVEL)
        chance = dict(zip(ratios, mean + level * spread, strict=True))
        alone = [Index(name, float(ratio[0]), float(chance[name])) for name, ratio in ratios.items()]
        beyond_chance = []
        for first, second in itertools.combinations(groups, 2) if pairs else ():
            both = np.unique(np.array([groups[first], groups[second]]), axis=1, return_inverse=True)[1]
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
    def _depends_on(stands: bool, effects: Iterable[Effect], indices: Iterable[Index]) -> tuple[str, ...]:
        """The choices that turn a verdict by themselves, then those with an index beyond chance."""
        turned = [e.choice for e in effects if e.verdict in TRUE + REFUTED_VERDICTS and (e.verdict in TRUE) != stands]
        beyond = [name for one in indices if one.decides for name in one.choice.split(" x ")]
        return tuple(dict.fromkeys([*turned, *beyond]))

    def _noise(self, place: int, among: np.ndarray) -> float:
        values, errors = self.table.value[among, place], self.table.error[among, place]
        use = np.isfinite(values)
        variance = float(np.var(values[use])) if use.sum() > 1 else 0.0
        return float(min(np.mean(np.nan_to_num(errors[use]) ** 2) / variance, 1.0)) if variance else math.nan


def correlation_ratio(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the share of the variance of values (..., count) that lies between groups (count,)."""
    of_group = np.equal.outer(np.unique(groups), groups).astype(float)  # (group, count)
    sizes = of_group.sum(axis=1)
    centred = values - values.mean(axis=-1, keepdims=True)
    between = ((centred @ of_group.T) ** 2 / sizes).sum(axis=-1)
    total = (centred**2).sum(axis=-1)
    return between / np.where(total > 0, total, 1.0)


def cause_of(effects: Iterable[Effect]) -> Effect | None:
    """Return the largest effect towards what is printed; None if nothing moves the number there."""
    moving = (one for one in effects if one.counts and one.towards and one.cause == "result")
    return max(moving, key=lambda one: one.size, default=None)


COMMITTED = Path("data/reference/universes")  # large runs, a file for each paper


def of_one_world(first: str | Path, second: str | Path) -> bool:
    """Whether two tables of universes were computed from the same inputs and code."""
    return store.provenance(first)["world"] == store.provenance(second)["world"]


def judge_of(
    paper: Paper, model: type[Inputs], root: Path, size: str, choices: Mapping[str, object], path: str | Path
) -> Judge:
    """Return what judges the claims of a paper by a table of universes in a file.

    That is the committed run instead, which has more universes, if it was computed from the same inputs and code.
    choices: those of a user, as they are written.
    """
    study = load_study(paper.slug, model, root, size, choices)
    published = load_published(root / "data" / "published" / f"{paper.slug}.yaml")
    large = root / COMMITTED / f"{paper.slug}.h5"
    is_committed = large.exists() and of_one_world(large, path)
    table = store.load(large if is_committed else path, Universes, paper=paper.slug)
    return Judge(table, study.choices, published, is_committed=is_committed)
