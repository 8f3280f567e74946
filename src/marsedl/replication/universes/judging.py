"""What decides a claim: queries of the table of universes.

Shares of universes depend on how many alternatives each choice lists: they are no probabilities.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
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
from marsedl.replication.universes.designs import DESIGNS, ONE_AT_A_TIME, SPACE_FILLING, Universe, interval_of
from marsedl.replication.universes.table import (
    CAUSES,
    VERDICTS,
    Universes,
    coded,
    components_of,
    decoded,
    half_digit,
    size_of_change,
)

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


class Nearest(NamedTuple):
    """The universe in which a claim's numbers come nearest to what is printed, and the deciding one of them there."""

    universe: int
    number: float
    error: float
    assignment: dict


@dataclass(frozen=True)
class Judged:
    """What the universes say of one claim.

    `stands` is `robust` if the claim reproduces or holds in every universe that decides it, `never` if in none,
    `undecided` if no universe decides it, else `depends` on the choices `on`.
    """

    claim: str
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
    given_deciding: dict[str, dict[Value, Share]]
    nearest: Nearest | None
    indices: tuple[Index, ...]
    noise: float  # share of the variance over universes that is sampling error
    causes: dict[str, int] = field(default_factory=dict)


def wilson(count: int, of: int) -> Share:
    """Return a share with its Wilson interval at 95 %."""
    if not of:
        return Share(0, 0, math.nan, math.nan)
    z, p = 1.959963984540054, count / of
    centre = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return Share(count, of, max(centre - half, 0.0), min(centre + half, 1.0))


class Judge:
    """Judges claims by a paper's table of universes."""

    def __init__(
        self, table: Universes, choices: Choices, published: Sequence[PublishedClaim], *, is_committed: bool = False
    ):
        """Take the table, the paper's choices and what it prints, and whether the table is a committed one.

        Raises ValueError if the table has no universe `corrected`.
        """
        self.table, self.choices, self.is_committed = table, choices, is_committed
        self.published = {one.id: one for one in published}
        self.judged, self.effects = cache(self._judged), cache(self._effects)  # tables and pictures ask for the same
        self._claims = {str(name): at for at, name in enumerate(table.claim)}
        self._components = {str(name): at for at, name in enumerate(table.component)}
        self.base = int(np.flatnonzero((table.design == DESIGNS.index(ONE_AT_A_TIME)) & ~self._moved.any(axis=1))[0])

    @cached_property
    def _corrected(self) -> np.ndarray:
        """The values of `corrected`, as in the table."""
        return np.array(coded(self.choices, Universe(0, ONE_AT_A_TIME, {})), dtype=float)

    @cached_property
    def _moved(self) -> np.ndarray:
        """Which choices of a universe are not as in `corrected` (universe, choice)."""
        rows, base = self.table.assignment, self._corrected
        return ~((rows == base) | (np.isnan(rows) & np.isnan(base)))

    def _in(self, design: str) -> np.ndarray:
        return (self.table.design == DESIGNS.index(design)) & (self.table.seed == 0)

    def _judged(self, claim: str) -> Judged:
        """Return what the universes say of a claim; raises KeyError for one that is not in the table."""
        at = self._claims[claim]
        filled = self._in(SPACE_FILLING)
        verdicts = np.array(VERDICTS)[self.table.verdict[:, at]]
        has_result = self.table.cause[:, at] == CAUSES.index("result")
        stands = np.isin(verdicts, TRUE)
        decided = stands | np.isin(verdicts, REFUTED_VERDICTS)
        component = self._deciding_component(claim)
        place = self._components.get(component)
        effects = self.effects(claim)
        pairs = bool(self.published[claim].headline)  # of others they would take most of the time
        values = np.full(len(filled), np.nan) if place is None else self.table.value[:, place]
        indices = self.indices(values, filled, at, pairs=pairs)
        of_verdict = self.indices(np.where(decided, stands, np.nan), filled, at, pairs=pairs)
        on = self._depends_on(stands, effects, (*indices, *of_verdict))
        every = filled | self._in(ONE_AT_A_TIME)
        causes, counts = np.unique(self.table.cause[every, at], return_counts=True)
        overall = self._stands(stands[every & decided])
        return Judged(
            claim,
            component,
            verdicts[self.base],
            *self._numbers(place),
            overall,
            on if overall == DEPENDS else (),
            effects,
            wilson(int(stands[filled].sum()), int(filled.sum())),
            wilson(int(stands[filled & has_result].sum()), int((filled & has_result).sum())),
            wilson(int((verdicts == "undetermined")[filled & has_result].sum()), int((filled & has_result).sum())),
            {name: self._given(self.choices.by_name[name], stands, has_result & filled) for name in on[:1]},
            self.nearest(claim, every),
            indices,
            self._noise(place, filled),
            {CAUSES[code]: int(count) for code, count in zip(causes, counts, strict=True)},
        )

    @staticmethod
    def _stands(stands: np.ndarray) -> str:
        if not len(stands):
            return UNDECIDED
        return ROBUST if stands.all() else DEPENDS if stands.any() else NEVER

    def standing(self, claim: str) -> Standing:
        """Return what the universes say of a claim, as it stands beside its verdict."""
        judged = self.judged(claim)
        cause, share = cause_of(judged.effects), judged.over_results
        return Standing(
            stands=judged.stands,
            on=judged.on,
            true=share.count,
            of=share.of,
            low=share.low,
            high=share.high,
            cause=cause and (cause.choice, f"{cause.value:g}" if isinstance(cause.value, float) else cause.value),
        )

    def claim_place(self, claim: str) -> int:
        """Return the column of a claim's verdicts."""
        return self._claims[claim]

    def component_place(self, claim: str) -> int | None:
        """Return the column of the number that decides a claim; None if it has none."""
        return self._components.get(self._deciding_component(claim))

    def verdict(self, claim: str) -> str:
        """Return the verdict of a claim in `corrected`, at the numbers of trials of universes."""
        return VERDICTS[self.table.verdict[self.base, self._claims[claim]]]

    def is_statement(self, claim: str) -> bool:
        """Whether a claim is a statement; others are numbers."""
        return self.published[claim].kind == "qualitative"

    # ------------------------------------------------------------------------------------------------------- numbers

    def _deciding_component(self, claim: str) -> str:
        """The component of a claim that is furthest from what is printed in `corrected`, in half digits and errors."""
        parts = components_of(self.published[claim])
        return max((label for label, _ in parts), key=lambda label: self._distance(label, self.base), default="")

    def _half(self, label: str) -> float:
        claim = self.published[label.partition("[")[0]]
        return half_digit(claim, dict(components_of(claim))[label])

    def _distance(self, label: str, universe: int) -> float:
        at = self._components[label]
        value, error, limit = (getattr(self.table, name)[universe, at] for name in ("value", "error", "limit"))
        scale = math.hypot(SIGMAS * error, self._half(label)) or abs(limit) or 1.0
        distance = abs(value - limit) / scale
        return distance if math.isfinite(distance) else -1.0

    def _numbers(self, place: int | None) -> tuple[float, float, float]:
        if place is None:
            return math.nan, math.nan, math.nan
        return tuple(float(getattr(self.table, name)[self.base, place]) for name in ("value", "error", "limit"))

    def _effects(self, claim: str) -> tuple[Effect, ...]:
        """Return what each value of each choice changes by itself, the largest change first."""
        component = self._deciding_component(claim)
        place, at = self._components.get(component), self._claims[claim]
        found = []
        for universe in np.flatnonzero(self._in(ONE_AT_A_TIME)):
            moved = np.flatnonzero(self._moved[universe])
            named = [list(self.choices)[k] for k in moved]
            main = [one for one in named if not any(one.name in other.only_if for other in named)]
            if len(main) != 1:
                continue
            value = decoded(self.choices, self.table.assignment[universe])[main[0].name]
            verdict = VERDICTS[self.table.verdict[universe, at]]
            cause = CAUSES[self.table.cause[universe, at]]
            numbers = self._change(component, place, int(universe)) if place is not None else (math.nan,) * 3 + (False,)
            found.append(Effect(main[0].name, value, int(self.table.number[universe]), verdict, cause, *numbers))
        return tuple(sorted(found, key=lambda one: math.inf if math.isnan(one.size) else -one.size))

    def second_seed(self) -> Share:
        """Return how many numbers agree, within three standard errors, with those of other random numbers."""
        table, pairs = self.table, []
        for again in np.flatnonzero(table.seed != 0):
            same = (table.assignment == table.assignment[again]) | np.isnan(table.assignment[again])
            pairs += [(again, k) for k in np.flatnonzero(same.all(axis=1) & (table.seed == 0))[:1]]
        first, second = np.array(pairs, dtype=int).reshape(-1, 2).T
        error = np.hypot(table.error[first], table.error[second])
        use = error > 0.0
        agree = np.abs(table.value[first] - table.value[second]) <= SIGMAS * error
        return wilson(int(agree[use].sum()), int(use.sum()))

    def _change(self, label: str, place: int, universe: int) -> tuple[float, float, float, bool]:
        names = ("value", "error", "limit")
        before, after = (tuple(getattr(self.table, n)[at, place] for n in names) for at in (self.base, universe))
        claim = label.partition("[")[0]
        if self.is_statement(claim):  # the side on which it holds is that of `corrected`, or the other
            side = np.sign(before[0] - before[2]) * (1.0 if self.verdict(claim) in STANDING_VERDICTS else -1.0)
            towards = side * (after[0] - after[2]) > side * (before[0] - before[2])
        else:
            towards = abs(after[0] - after[2]) < abs(before[0] - before[2])
        size = size_of_change(before, after, self._half(label))
        return float(after[0]), float(after[0] - before[0]), float(size), bool(towards)

    def nearest(self, claim: str, among: np.ndarray) -> Nearest | None:
        """Return the universe in which a claim's numbers, all of them, come nearest to what is printed."""
        labels = [label for label, _ in components_of(self.published[claim])]
        distances = {
            int(universe): max((self._distance(label, universe) for label in labels), default=-1.0)
            for universe in np.flatnonzero(among)
            if self.table.cause[universe, self._claims[claim]] == 0
        }
        distances = {universe: distance for universe, distance in distances.items() if distance >= 0.0}
        if not distances:
            return None
        best = min(distances, key=lambda universe: (distances[universe], universe))
        at = self._components[self._deciding_component(claim)]
        return Nearest(
            int(self.table.number[best]),
            float(self.table.value[best, at]),
            float(self.table.error[best, at]),
            decoded(self.choices, self.table.assignment[best]),
        )

    # ------------------------------------------------------------------------------------------------------- indices

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

    def _depends_on(self, stands, effects, indices) -> tuple[str, ...]:
        """The choices that turn a verdict by themselves, then those with an index beyond chance."""
        base = stands[self.base]
        turned = [e.choice for e in effects if e.verdict in TRUE + REFUTED_VERDICTS and (e.verdict in TRUE) != base]
        beyond = [name for one in indices if one.decides for name in one.choice.split(" x ")]
        return tuple(dict.fromkeys([*turned, *beyond]))

    def _given(self, choice: Choice, stands: np.ndarray, among: np.ndarray) -> dict[Value, Share]:
        """The share at each value of a choice (a range in four equal parts, named by their middles)."""
        k = [one.name for one in self.choices].index(choice.name)
        groups = self._groups(choice, self.table.assignment[:, k])
        names = [choice.range.at((q + 0.5) / 4) for q in range(4)] if choice.range else list(choice.alternatives)
        return {
            name: wilson(int(stands[among & (groups == q)].sum()), int((among & (groups == q)).sum()))
            for q, name in enumerate(names)
        }

    def _noise(self, place: int | None, among: np.ndarray) -> float:
        if place is None:
            return math.nan
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


def judge_of(
    paper: Paper, model: type[Inputs], root: Path, size: str, choices: Mapping[str, object], path: str | Path
) -> Judge:
    """Return what judges the claims of a paper by a table of universes in a file.

    That is the committed run instead, which has more universes, if it was computed from the same inputs and code.

    Args:
        paper: the catalogue.
        model: its typed inputs.
        root: the project's folder.
        size: the size that is built.
        choices: those of a user, as they are written.
        path: of the table.

    """
    study = load_study(paper.slug, model, root, size, choices)
    published = load_published(root / "data" / "published" / f"{paper.slug}.yaml")
    large = root / COMMITTED / f"{paper.slug}.h5"
    is_committed = large.exists() and store.provenance(large)["world"] == store.provenance(path)["world"]
    table = store.load(large if is_committed else path, Universes, paper=paper.slug)
    return Judge(table, study.choices, published, is_committed=is_committed)
