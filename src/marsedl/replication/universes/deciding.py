"""What decides a paper's results: all that its pages show of its universes, judged once for all of them."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from marsedl.replication.claims.claim import Claim, Standing
from marsedl.replication.claims.counts import capital
from marsedl.replication.claims.names import AGREEING_VERDICTS, COUNTED_VERDICTS, REFUTED_VERDICTS
from marsedl.replication.inputs.choices import Choice, Value, in_words
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.records.tables import Column, table
from marsedl.replication.universes.designs import SPACE_FILLING, interval_of
from marsedl.replication.universes.joint import Joint, joint
from marsedl.replication.universes.judging import Effect, Judge, Share
from marsedl.replication.universes.table import RESULT
from marsedl.replication.universes.waves import Matching

if TYPE_CHECKING:
    import pandas as pd

RANKS = (  # what an erratum changes, from most to least
    "no_result",  # a headline claim has no result
    "headline",  # a headline number changes beyond rounding and sampling error
    "verdicts",  # a verdict changes
    "named",  # not varied, as "not_varied", but claims that name it differ or fail
    "nothing",  # no headline number and no verdict changes: notation
    "not_varied",  # it changes no input, or no universe keeps it by itself
)
FAILURES = ("infeasible", "refused", "numerical")
PARTS = 4  # into which the explorer divides a range


class ErratumEffect(NamedTuple):
    """What an erratum changes if it is kept by itself; claims and errata by their ids.

    `rank` is one of `RANKS`; `choices` are those that belong to it. `no_result` are the headline claims without a
    result, `headline` is the one whose number changes most, by `effect`, and `verdicts` are the claims whose verdict
    changes. `about` are these and all claims that name the erratum; `refuted` name it, and differ or fail.
    """

    erratum: str
    rank: str
    choices: tuple[str, ...]
    no_result: tuple[str, ...]
    headline: str | None
    effect: Effect | None
    verdicts: tuple[str, ...]
    about: tuple[str, ...]
    refuted: tuple[str, ...]


class Number(NamedTuple):
    """The number that decides a headline claim in `corrected`, and what each choice makes of it by itself.

    `mark` is what is printed, or the limit of a statement. `effects` come with the largest change first.
    """

    claim: str
    value: float
    error: float
    mark: float
    unit: str
    effects: tuple[Effect, ...]


class Open(NamedTuple):
    """What a paper leaves open: a choice, our answer and others, and what these make of the deciding number.

    `low` and `high` are NaN if that is not known; `is_late` says that it was entered after results had been seen.
    """

    choice: str
    asks: str
    is_late: bool
    ours: str
    others: str
    low: float
    high: float
    no_result: bool


class Run(NamedTuple):
    """How many universes there are, of which so many fill the space, and whether they are those of a committed run.

    The build has `computed` universes itself; `seeds` is the share of numbers that agree with those of other random
    numbers.
    """

    universes: int
    filling: int
    is_committed: bool
    computed: int
    seeds: Share


class Decided(NamedTuple):
    """All that pages show of a paper's universes.

    `number` is that of the headline which the main choice moves; `explorer` is what the script of the pages explores.
    """

    standings: dict[str, Standing]
    errata: tuple[ErratumEffect, ...]
    number: Number | None
    open: tuple[Open, ...]
    joint: Joint
    run: Run
    explorer: dict[str, Any]


def decided(claims: Sequence[Claim], errata: Iterable[Erratum], judge: Judge, matching: Matching) -> Decided:
    """Return what decides a paper's claims.

    Args:
        claims: those of the paper, with what every reading gives.
        errata: those of the paper.
        judge: of its claims by its universes.
        matching: the waves towards its headlines.

    """
    standings = {name: judge.standing(name) for name in judge.of}
    judged = [row for row in claims if row.id in judge.of]
    effects = [_of_erratum(one, claims, judged, judge) for one in errata]
    number = _deciding_number(judged, judge)
    run = Run(
        universes=len(judge.table.number),
        filling=int(judge.among(SPACE_FILLING).sum()),
        is_committed=judge.is_committed,
        computed=judge.computed,
        seeds=judge.second_seed(),
    )
    ranked = tuple(sorted(effects, key=_by_rank))
    of_all = joint(judge, matching)
    return Decided(standings, ranked, number, _left_open(number, judge), of_all, run, _explorer(judged, judge))


# ------------------------------------------------------------------------------------------------------------- errata


def _by_rank(one: ErratumEffect) -> tuple[int, float]:
    """What changes most first: by rank, then by the change of a number or the refuted claims."""
    if one.rank == "headline":
        return RANKS.index(one.rank), -one.effect.size
    return RANKS.index(one.rank), -len(one.refuted) if one.rank == "named" else 0.0


def _of_erratum(erratum: Erratum, claims: Sequence[Claim], judged: Sequence[Claim], judge: Judge) -> ErratumEffect:
    choices = tuple(one.name for one in judge.choices if one.erratum == erratum.id)
    changed = [(row, e) for row in judged for e in judge.effects(row.id) if e.choice in choices]
    of_headline = [(row, e) for row, e in changed if row.headline]
    moving = [(row, e) for row, e in of_headline if e.counts]
    headline, effect = max(moving, key=lambda one: one[1].size, default=(None, None))
    found = {
        "no_result": _ids(row for row, e in of_headline if e.cause in FAILURES),
        "headline": headline and headline.id,
        "verdicts": _ids(row for row, e in changed if is_turned(judge.verdict(row.id), e.verdict)),
    }
    named = [row for row in claims if erratum.id in row.errata]
    refuted = _ids(row for row in named if row.is_refuted)
    if ranks := [rank for rank in found if found[rank]]:
        rank = ranks[0]
    elif changed:
        rank = "nothing"
    else:
        rank = "named" if refuted else "not_varied"
    about = tuple(dict.fromkeys([*_ids(named), *found["verdicts"]]))
    return ErratumEffect(erratum.id, rank, choices, **found, effect=effect, about=about, refuted=refuted)


def _ids(rows: Iterable[Claim]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.id for row in rows))


def is_turned(before: str | None, after: str | None) -> bool:
    """Whether a verdict changes to another one, both of which count."""
    return before != after and {before, after} <= {*COUNTED_VERDICTS}


# ------------------------------------------------------------------------------------------------------ what is open


def _deciding_number(judged: Sequence[Claim], judge: Judge) -> Number | None:
    """The number of the first headline claim that differs or fails and that the main choice moves towards print.

    The main choice is the one with the largest such effect over all of them. Else the number of a headline claim that
    any choice moves, or of any headline claim.
    """
    found = {}
    for row in sorted((row for row in judged if row.headline), key=lambda row: row.headline):
        one = judge.judged(row.id)
        if math.isfinite(one.number) and math.isfinite(one.printed):
            known = (e for e in one.effects if e.cause == RESULT and math.isfinite(e.difference))
            effects = tuple(sorted(known, key=lambda effect: -abs(effect.difference)))
            found[row.id] = row, Number(row.id, one.number, one.error, one.printed, judge.unit(row.id), effects)
    causes = [cause for name in found if (cause := judge.judged(name).cause)]
    main = max(causes, key=lambda effect: effect.size, default=None)

    def order(name: str) -> tuple[bool, ...]:
        row, number = found[name]
        moving = [e for e in number.effects if e.counts]
        by_main = row.is_refuted and main and any(e.towards and e.choice == main.choice for e in moving)
        return not by_main, not moving, not row.is_refuted, row.is_statement

    return found[min(found, key=order)][1] if found else None


def _left_open(number: Number | None, judge: Judge) -> tuple[Open, ...]:
    """What the paper leaves open, first what moves the deciding number furthest."""
    effects = judge.effects(number.claim) if number else ()
    failing = {effect.choice for effect in effects if effect.cause in FAILURES}
    found = []
    for one in (one for one in judge.choices if not one.erratum):
        low, high = _range(effects, one.name)
        left = Open(
            choice=one.name,
            asks=one.asks,
            is_late=bool(one.entered),
            ours=in_words(one.corrected),
            others=_others(one),
            low=low,
            high=high,
            no_result=one.name in failing,
        )
        found.append(left)
    return tuple(sorted(found, key=lambda one: -(one.high - one.low) if one.high > one.low else 0.0))


def _others(choice: Choice) -> str:
    """The values of a choice that `corrected` does not have, in words."""
    if choice.range is None:
        return ", ".join(in_words(value) for value in choice.alternatives if value != choice.corrected)
    return f"{choice.range.low:.4g} to {choice.range.high:.4g}{' times' if choice.range.is_factor else ''}"


def _range(effects: Iterable[Effect], choice: str) -> tuple[float, float]:
    """The least and largest number over the values of a choice and in `corrected`."""
    finite = [one for one in effects if one.choice == choice and math.isfinite(one.number)]
    values = [number for one in finite for number in (one.number, one.number - one.difference)]
    return min(values, default=math.nan), max(values, default=math.nan)


# ------------------------------------------------------------------------------------------------------ the explorer


def _explorer(judged: Sequence[Claim], judge: Judge) -> dict[str, Any]:
    """What a reader may ask of the universes, but for those that are computed again with other random numbers.

    It has the `numbers` of universes; `verdicts` with whether claims stand or are refuted with them; `knobs`, the
    choices, with values as a command takes them and in words, and the place of each universe's value among them, of
    which that of `corrected` is `ours`; and `answers`, of each claim what is printed or its limit (`mark`, null if
    universes do not agree on it), and by universe value, error and the place of the verdict.
    """
    same_streams = np.flatnonzero(judge.table.seed == 0)
    verdicts = sorted({verdict for one in judge.of.values() for verdict in one.verdicts.tolist()})
    assignment = zip(judge.choices, judge.table.assignment[same_streams].T, strict=True)
    ordered = sorted(judged, key=lambda row: (not row.headline, row.headline or 0))
    computed = [row for row in ordered if judge.of[row.id].has_result[same_streams].any()]
    return {
        "numbers": judge.table.number[same_streams].tolist(),
        "verdicts": [[in_words(one), one in AGREEING_VERDICTS, one in REFUTED_VERDICTS] for one in verdicts],
        "knobs": [_knob(one, judge.choices.default(one), assigned) for one, assigned in assignment],
        "answers": [_answer(row, judge, same_streams, verdicts) for row in computed],
    }


def _knob(choice: Choice, default: Value, assigned: np.ndarray) -> dict[str, Any]:
    """A choice; a range is divided into equal parts, of which a command takes the middle, after the value of ours."""
    knob = {"choice": choice.name, "said": capital(in_words(choice.name)), "ours": 0}
    if choice.range is None:
        names = [*choice.alternatives]
        knob["ours"] = names.index(default)
        places = np.where(np.isfinite(assigned), np.nan_to_num(assigned), knob["ours"])
        return knob | {"values": [[name, in_words(name)] for name in names], "places": places.astype(int).tolist()}
    ends = [f"{choice.range.at(part / PARTS):.3g}" for part in range(PARTS + 1)]
    values = [[f"{default:g}", f"{default:g}"]]
    for part in range(PARTS):
        values.append([f"{choice.range.at((part + 0.5) / PARTS):.4g}", f"{ends[part]} to {ends[part + 1]}"])
    is_ours = ~np.isfinite(assigned) | (assigned == default)
    shares = np.array([choice.range.share(float(one)) for one in np.where(is_ours, choice.range.low, assigned)])
    return knob | {"values": values, "places": np.where(is_ours, 0, 1 + interval_of(shares, PARTS)).tolist()}


def _answer(row: Claim, judge: Judge, same_streams: np.ndarray, verdicts: Sequence[str]) -> dict[str, Any]:
    found = judge.of[row.id]
    value, error, limit = found.numbers[:, same_streams, found.deciding]
    is_told, error = found.has_result[same_streams] & np.isfinite(value), np.nan_to_num(error)
    marks = np.unique(limit[np.isfinite(limit)]).tolist()
    return {
        "claim": row.id,
        "said": capital(row.plain or row.quantity),
        "is_statement": row.is_statement,
        "unit": judge.unit(row.id),
        "mark": marks[0] if len(marks) == 1 else None,
        "values": [float(f"{one:.4g}") if told else None for one, told in zip(value, is_told, strict=True)],
        "errors": [float(f"{one:.2g}") for one in error] if error.any() else None,
        "verdicts": [verdicts.index(one) for one in found.verdicts[same_streams]],
    }


# ------------------------------------------------------------------------------------------------------------- tables


def claims_table(judge: Judge) -> "pd.DataFrame":
    """Return a row for each claim: its value in `corrected`, how often it is true, and what decides."""
    rows = []
    for name in judge.of:
        one = judge.judged(name)
        rows.append(
            (
                name,
                one.component,
                one.verdict,
                one.label,
                ", ".join(one.alone),
                ", ".join(one.together),
                one.number,
                one.error or None,
                one.printed,
                one.over_all.count,
                one.over_all.of,
                one.over_results.of,
                one.undetermined.count,
                one.over_results.value,
                one.over_results.low,
                one.over_results.high,
                one.nearest,
                one.its_universe,
                one.noise,
                f"{one.cause.choice}: {one.cause.value}" if one.cause else "",
            )
        )
    return table(
        rows,
        {
            "claim": Column(),
            "component": Column(meaning="the number of it that decides"),
            "verdict": Column(meaning="in corrected, at the numbers of trials of universes"),
            "label": Column(meaning="robust, depends, never, undecided, too_few, or not_computed"),
            "alone": Column(meaning="the choices that it depends on by themselves, those that turn it first"),
            "together": Column(meaning="the choices that it depends on only in combination with others"),
            "value": Column(error="error"),
            "error": Column(meaning="standard error of the value"),
            "printed": Column(meaning="what is printed, or the limit of a statement"),
            "true": Column(meaning="space-filling universes in which it reproduces or holds"),
            "universes": Column(meaning="of the space-filling design"),
            "with a result": Column(meaning="of these"),
            "undetermined": Column(meaning="of these"),
            "share": Column(digits=".2f", interval=("lower", "upper"), meaning="true of those with a result"),
            "lower": Column(digits=".2f", meaning="of the Wilson interval of the share at 95 %"),
            "upper": Column(digits=".2f", meaning="of the same interval"),
            "nearest": Column(meaning="the value nearest to what is printed that any universe attains"),
            "its universe": Column(),
            "noise": Column(digits=".2f", meaning="share of the variance over universes that is sampling error"),
            "cause": Column(
                meaning="the value of a choice that makes it true, or else comes nearest to what is printed"
            ),
        },
    )


def effects_table(judge: Judge) -> "pd.DataFrame":
    """Return a row for each value of each choice, by itself, and each claim that it changes."""
    rows = []
    for name in judge.of:
        before = judge.verdict(name)
        for one in judge.effects(name):
            if one.counts or one.verdict != before:
                verdict = one.verdict if one.cause == RESULT else one.cause
                size = one.size if math.isfinite(one.size) else None
                numbers = one.number, one.difference, size
                rows.append((name, one.choice, str(one.value), one.where, verdict, *numbers, one.towards))
    return table(
        rows,
        {
            "claim": Column(),
            "choice": Column(),
            "its value": Column(),
            "where": Column(meaning="the universe, or the reading, that has it"),
            "verdict": Column(meaning="or why there is none"),
            "number": Column(meaning="of the component that decides in corrected"),
            "difference": Column(meaning="from corrected"),
            "size": Column(digits=".3g", meaning="of the difference, in what noise and rounding could explain"),
            "towards": Column(meaning="whether it is towards what is printed"),
        },
    )
