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
from marsedl.replication.universes.judging import Effect, Judge
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
    """What a paper leaves open: the choice, what other values make of the deciding number, the claims that name it."""

    choice: Choice
    low: float | None
    high: float | None
    no_result: bool
    claims: Sequence[str]


class Deciding:
    """What decides the claims of a paper."""

    def __init__(self, claims: Sequence[Claim], errata: Iterable[Erratum], judge: Judge | None):
        """Take a paper's claims and errata, and what judges claims by its universes, if it has any."""
        self.errata, self.judge = tuple(errata), judge
        self._choices = list(judge.choices) if judge else []
        self._rows = {row.id: row for row in claims}
        self._refuted = [row for row in claims if row.is_refuted]
        self._headline = sorted((row for row in claims if row.headline), key=lambda row: row.headline)
        self._judged = [row.id for row in claims if judge and row.id in judge.table.claim]

    def effects(self) -> list[ErratumEffect]:
        """Return what each erratum changes, by rank and, within `HEADLINE`, by the largest change of a number."""

        def order(one: ErratumEffect) -> tuple:
            return RANKS.index(one.rank), -one.headline[0].effect.size if one.rank == HEADLINE else 0.0

        return sorted(map(self._effect, self.errata), key=order)

    def _effect(self, erratum: Erratum) -> ErratumEffect:
        named = [row.id for row in self._rows.values() if erratum.id in row.errata]
        refuted = [row.id for row in self._refuted if erratum.id in row.errata]
        choices = [one.name for one in self._choices if one.erratum == erratum.id]
        changed = [
            Changed(name, self.judge.verdict(name), effect)
            for name in self._judged
            for effect in self.judge.effects(name)
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

    @cached_property
    def number(self) -> Number | None:
        """The number of the first headline claim that is one, else the measure of the first headline statement."""
        judged = [row for row in self._headline if row.id in self._judged]
        for row in sorted(judged, key=lambda row: row.is_statement):
            one = self.judge.judged(row.id)
            if math.isfinite(one.number) and math.isfinite(one.printed):
                place = dict(components_of(self.judge.published[row.id]))[one.component]
                unit = row.result.margin.unit if row.is_statement and row.result.margin else row.unit_of(place)
                effects = [e for e in one.effects if e.cause == "result" and math.isfinite(e.difference)]
                effects.sort(key=lambda effect: -abs(effect.difference))
                return Number(row, one.number, one.error, one.printed, unit, effects)
        return None

    def open(self) -> list[Open]:
        """Return what the paper leaves open, first what most refuted claims name."""
        number = self.number
        found = []
        for one in self._choices:
            if one.erratum:
                continue
            effects = [e for e in self.judge.effects(number.claim.id) if e.choice == one.name] if number else []
            values = [e.number for e in effects if math.isfinite(e.number)]
            low, high = (min([*values, number.value]), max([*values, number.value])) if values else (None, None)
            claims = [row.id for row in self._refuted if one.name in row.choices]
            found.append(Open(one, low, high, any(e.cause in FAILURES for e in effects), claims))
        return sorted(found, key=lambda one: -len(one.claims))


def changed_verdicts(claims: Iterable[Claim]) -> dict[str, list[tuple[str, str, str]]]:
    """Return, by reading, the claims whose verdict is another one than in `corrected`, with both verdicts."""
    found: dict[str, list] = {}
    for row in claims:
        own = row.readings[CORRECTED].verdict
        for name, result in row.readings.items():
            if row.kind != "input" and result.verdict != own and {result.verdict, own} <= {*COUNTED_VERDICTS}:
                found.setdefault(name, []).append((row.id, own, result.verdict))
    return found
