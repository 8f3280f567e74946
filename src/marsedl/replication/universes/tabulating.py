"""Tables of what universes say of a paper's claims."""

import math
from typing import TYPE_CHECKING

from marsedl.replication.records.tables import Column, table
from marsedl.replication.universes.judging import Judge

if TYPE_CHECKING:
    import pandas as pd


def claims_table(judge: Judge) -> "pd.DataFrame":
    """Return a row for each claim: its value in `corrected`, how often it is true, and what decides."""
    rows = []
    for name in judge.column:
        one = judge.judged(name)
        rows.append(
            (
                *(name, one.component, one.verdict, one.label, ", ".join(one.alone), ", ".join(one.together)),
                *(one.number, one.error or None, one.printed),
                *(one.over_all.count, one.over_all.of, one.over_results.of, one.undetermined.count),
                *(one.over_results.value, one.over_results.low, one.over_results.high),
                *(one.nearest, one.its_universe, one.noise),
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
    for name in judge.column:
        before = judge.verdict(name)
        for one in judge.effects(name):
            if one.counts or one.verdict != before:
                verdict = one.verdict if one.cause == "result" else one.cause
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
