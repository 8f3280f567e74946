"""What decides a paper's results, from its table of universes, as its page shows it."""

import math
from collections.abc import Iterable, Sequence, Set
from functools import cached_property
from typing import NamedTuple

from marsedl.replication.claims.claim import COUNTED_VERDICTS, Claim
from marsedl.replication.inputs.choices import Choice
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.universes.judging import Effect, Judge
from marsedl.replication.universes.table import components_of

RANKS = (  # what an erratum changes, from most to least
    "no_result",  # a headline claim has no result
    "headline",  # a headline number changes beyond rounding and sampling error
    "verdicts",  # a verdict changes
    "named",  # not varied, as "not_varied", but claims that name it differ or fail
    "nothing",  # no headline number and no verdict changes: notation
    "not_varied",  # it changes no input, or no universe keeps it by itself
)
FAILURES = ("infeasible", "refused", "numerical")


class ErratumEffect(NamedTuple):
    """What an erratum changes if it is kept by itself.

    `rank` is one of `RANKS`; `choices` are those that belong to it. `no_result` are the headline claims without a
    result, `headline` is the one whose number changes most, by `effect`, and `verdicts` are the claims whose verdict
    changes. `about` are these and all claims that name the erratum; `refuted` name it, and differ or fail.
    """

    erratum: Erratum
    rank: str
    choices: Sequence[str]
    no_result: Sequence[str]
    headline: Claim | None
    effect: Effect | None
    verdicts: Sequence[str]
    about: Set[str]
    refuted: Sequence[str]


class Number(NamedTuple):
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
    """What a paper leaves open: the choice, and what other values make of the deciding number; NaN: not known."""

    choice: Choice
    low: float
    high: float
    no_result: bool


class Deciding:
    """What decides the claims of a paper."""

    def __init__(self, claims: Sequence[Claim], errata: Iterable[Erratum], judge: Judge | None):
        """Take a paper's claims and errata, and what judges claims by its universes, if it has any."""
        self._claims, self._errata, self.judge = claims, errata, judge
        self._choices = list(judge.choices) if judge else []
        self._judged = [row for row in claims if judge and row.id in judge.column]

    def effects(self) -> list[ErratumEffect]:
        """Return what each erratum changes, by rank, then by the change of a number or the refuted claims."""

        def order(one: ErratumEffect) -> tuple[int, float]:
            if one.rank == "headline":
                return RANKS.index(one.rank), -one.effect.size
            return RANKS.index(one.rank), -len(one.refuted) if one.rank == "named" else 0.0

        return sorted(map(self._effect, self._errata), key=order)

    def _effect(self, erratum: Erratum) -> ErratumEffect:
        choices = [one.name for one in self._choices if one.erratum == erratum.id]
        changed = [(row, e) for row in self._judged for e in self.judge.effects(row.id) if e.choice in choices]
        of_headline = [(row, e) for row, e in changed if row.headline]
        moving = [(row, e) for row, e in of_headline if e.counts]
        headline, effect = max(moving, key=lambda one: one[1].size, default=(None, None))
        found = {
            "no_result": _ids(row for row, e in of_headline if e.cause in FAILURES),
            "headline": headline,
            "verdicts": _ids(row for row, e in changed if is_turned(self.judge.verdict(row.id), e.verdict)),
        }
        named = [row for row in self._claims if erratum.id in row.errata]
        refuted = [row for row in named if row.is_refuted]
        unranked = "nothing" if changed else "named" if refuted else "not_varied"
        rank = next((rank for rank in found if found[rank]), unranked)
        about = {*_ids(named), *found["verdicts"]}
        return ErratumEffect(erratum, rank, choices, **found, effect=effect, about=about, refuted=_ids(refuted))

    def causes(self) -> dict[str, tuple[Choice, str] | None]:
        """Return the choice that is the cause of every claim that differs or fails, with the unit of its number."""
        found = {}
        for row in (row for row in self._judged if row.is_refuted):
            cause = self.judge.judged(row.id).cause
            found[row.id] = cause and (self.judge.choices.by_name[cause.choice], self._unit(row))
        return found

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

        causes = [cause for one in found if (cause := self.judge.judged(one.claim.id).cause)]
        main = max(causes, key=lambda effect: effect.size, default=None)

        def order(one: Number) -> tuple[bool, ...]:
            refuted, moving = one.claim.is_refuted, [e for e in one.effects if e.counts]
            by_main = refuted and any(e.towards and e.choice == main.choice for e in moving) if main else False
            return not by_main, not moving, not refuted, one.claim.is_statement

        return min(found, key=order, default=None)

    def open(self) -> list[Open]:
        """Return what the paper leaves open, first what moves the deciding number furthest."""
        effects = self.judge.effects(self.number.claim.id) if self.number else ()
        failing = {effect.choice for effect in effects if effect.cause in FAILURES}
        choices = [one for one in self._choices if not one.erratum]
        found = [Open(one, *_range(effects, one.name), one.name in failing) for one in choices]
        return sorted(found, key=lambda one: -(one.high - one.low) if one.high > one.low else 0.0)


def _range(effects: Iterable[Effect], choice: str) -> tuple[float, float]:
    """The least and largest number over the values of a choice and in `corrected`."""
    finite = [one for one in effects if one.choice == choice and math.isfinite(one.number)]
    values = [number for one in finite for number in (one.number, one.number - one.difference)]
    return min(values, default=math.nan), max(values, default=math.nan)


def _ids(rows: Iterable[Claim]) -> list[str]:
    return list(dict.fromkeys(row.id for row in rows))


def is_turned(before: str | None, after: str | None) -> bool:
    """Whether a verdict changes to another one, both of which count."""
    return before != after and {before, after} <= {*COUNTED_VERDICTS}
