"""What decides a paper's results, from its table of universes, as its page shows it."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from marsedl.replication.claims.claim import COUNTED_VERDICTS, Claim
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import Choice
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.universes.judging import Effect, Judge, cause_of
from marsedl.replication.universes.table import components_of

# What an erratum changes, from most to least.
NO_RESULT = "no_result"  # a headline claim has no result
HEADLINE = "headline"  # a headline number changes beyond rounding and sampling error
VERDICT = "verdict"  # a verdict changes
NOTHING = "nothing"  # no headline number and no verdict changes: notation
NOT_VARIED = "not_varied"  # it changes no input, or no universe keeps it by itself
RANKS = (NO_RESULT, HEADLINE, VERDICT, NOTHING, NOT_VARIED)
FAILURES = ("infeasible", "refused", "numerical")


class Changed(NamedTuple):
    """A claim that changes, and by what; `before` is its verdict in `corrected`."""

    claim: str
    before: str
    effect: Effect


@dataclass(frozen=True)
class ErratumEffect:
    """What an erratum changes if it is kept by itself.

    `rank` is one of `RANKS`; `choices` are those that belong to it. `headline` are the headline numbers that change,
    the largest change first; `no_result` the headline claims without a result; `verdicts` the verdicts that change.
    `named` are the claims that name the erratum, `refuted` those of them that differ or fail.
    """

    erratum: Erratum
    rank: str
    named: Sequence[str]
    refuted: Sequence[str]
    choices: Sequence[str] = ()
    headline: Sequence[Changed] = ()
    no_result: Sequence[str] = ()
    verdicts: Sequence[Changed] = ()

    @property
    def group(self) -> str:
        """Where the report lists it: ranked, not varied but named by refuted claims, or notation."""
        if self.rank == NOT_VARIED and self.refuted:
            return "named"
        return "notation" if self.rank in (NOT_VARIED, NOTHING) else "ranked"


@dataclass(frozen=True)
class Number:
    """The number that decides a headline claim in `corrected`, and what each choice makes of it by itself.

    `mark` is what is printed, or the limit of a statement. `effects` come with the largest change first.
    """

    claim: Claim
    value: float
    error: float
    mark: float
    unit: str
    effects: Sequence[Effect]


class Open(NamedTuple):
    """What a paper leaves open: the choice, and what other values make of the deciding number."""

    choice: Choice
    low: float | None
    high: float | None
    no_result: bool


class Cause(NamedTuple):
    """The choice that moves a number most towards what is printed, and the range over its values with ours."""

    choice: Choice
    low: float
    high: float
    unit: str


class Deciding:
    """What decides the claims of a paper."""

    def __init__(self, claims: Sequence[Claim], errata: Iterable[Erratum], judge: Judge | None):
        """Take a paper's claims and errata, and what judges claims by its universes, if it has any."""
        self.errata, self.judge = tuple(errata), judge
        self._choices = list(judge.choices) if judge else []
        self._rows = {row.id: row for row in claims}
        self._judged = [row for row in claims if judge and row.id in judge.table.claim]

    def effects(self) -> list[ErratumEffect]:
        """Return what each erratum changes, by rank and, within `HEADLINE`, by the largest change of a number."""

        def order(one: ErratumEffect) -> tuple:
            return RANKS.index(one.rank), -one.headline[0].effect.size if one.rank == HEADLINE else 0.0

        return sorted(map(self._effect, self.errata), key=order)

    def _effect(self, erratum: Erratum) -> ErratumEffect:
        named = [row.id for row in self._rows.values() if erratum.id in row.errata]
        refuted = [name for name in named if self._rows[name].is_refuted]
        choices = [one.name for one in self._choices if one.erratum == erratum.id]
        changed = [
            Changed(row.id, self.judge.verdict(row.id), effect)
            for row in self._judged
            for effect in self.judge.effects(row.id)
            if effect.choice in choices
        ]
        if not changed:
            return ErratumEffect(erratum, NOT_VARIED, named, refuted, choices)
        of_headline = [one for one in changed if self._rows[one.claim].headline]
        no_result = list(dict.fromkeys(one.claim for one in of_headline if one.effect.cause in FAILURES))
        headline = sorted((one for one in of_headline if one.effect.counts), key=lambda one: -one.effect.size)
        verdicts = [
            one
            for one in changed
            if one.effect.verdict != one.before and {one.effect.verdict, one.before} <= {*COUNTED_VERDICTS}
        ]
        by_rank = {NO_RESULT: no_result, HEADLINE: headline, VERDICT: verdicts, NOTHING: True}
        rank = next(rank for rank, found in by_rank.items() if found)
        return ErratumEffect(erratum, rank, named, refuted, choices, headline, no_result, verdicts)

    def causes(self) -> dict[str, Cause | None]:
        """Return the cause of every claim that differs or fails; None if no choice by itself moves it towards print."""
        found = {}
        for row in (row for row in self._judged if row.is_refuted):
            cause, by_name = cause_of(self.judge.effects(row.id)), self.judge.choices.by_name
            found[row.id] = cause and Cause(by_name[cause.choice], *self._range(row, cause.choice), self._unit(row))
        return found

    def _range(self, row: Claim, choice: str) -> tuple[float, float]:
        """The least and largest number over the values of a choice and in `corrected`."""
        effects = [one for one in self.judge.effects(row.id) if one.choice == choice and math.isfinite(one.number)]
        values = [number for one in effects for number in (one.number, one.number - one.difference)]
        return min(values, default=math.nan), max(values, default=math.nan)

    def _unit(self, row: Claim) -> str:
        """The unit of the number that decides a claim."""
        if row.is_statement:
            return row.result.margin.unit if row.result.margin else "1"
        if ", " not in row.unit:
            return row.unit
        component = self.judge.judged(row.id).component
        indices = {label: index for label, index, _ in components_of(self.judge.published[row.id])}
        return row.unit_of(indices.get(component, ()))

    @cached_property
    def number(self) -> Number | None:
        """The number of the first headline claim that differs or fails and that the main choice moves towards print.

        The main choice is the one with the largest such effect over all of them. Else the number of a headline claim
        that any choice moves, or of any headline claim.
        """
        found = []
        for row in sorted((row for row in self._judged if row.headline), key=lambda row: row.headline):
            one = self.judge.judged(row.id)
            if math.isfinite(one.number) and math.isfinite(one.printed):
                effects = [e for e in one.effects if e.cause == "result" and math.isfinite(e.difference)]
                effects.sort(key=lambda effect: -abs(effect.difference))
                found.append(Number(row, one.number, one.error, one.printed, self._unit(row), effects))

        causes = [cause for one in found if one.claim.is_refuted and (cause := cause_of(one.effects))]
        main = max(causes, key=lambda effect: effect.size, default=None)

        def order(one: Number) -> tuple[bool, ...]:
            refuted, moving = one.claim.is_refuted, [e for e in one.effects if e.counts]
            by_main = refuted and any(e.towards and e.choice == main.choice for e in moving) if main else False
            return not by_main, not moving, not refuted, one.claim.is_statement

        return min(found, key=order, default=None)

    def open(self) -> list[Open]:
        """Return what the paper leaves open, first what moves the deciding number furthest."""
        found, all_effects = [], self.judge.effects(self.number.claim.id) if self.number else ()
        for one in self._choices:
            if one.erratum:
                continue
            effects = [e for e in all_effects if e.choice == one.name]
            low, high = self._range(self.number.claim, one.name) if self.number else (math.nan, math.nan)
            found.append(Open(one, low, high, any(e.cause in FAILURES for e in effects)))
        return sorted(found, key=lambda one: -(one.high - one.low) if one.high > one.low else 0.0)


def changed_verdicts(claims: Iterable[Claim]) -> dict[str, list[tuple[str, str, str]]]:
    """Return, by reading, the claims whose verdict is another one than in `corrected`, with both verdicts."""
    found: dict[str, list] = {}
    for row in claims:
        own = row.readings[CORRECTED].verdict
        for name, result in row.readings.items():
            if row.kind != "input" and result.verdict != own and {result.verdict, own} <= {*COUNTED_VERDICTS}:
                found.setdefault(name, []).append((row.id, own, result.verdict))
    return found
