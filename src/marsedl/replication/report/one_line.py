"""A claim in one line: the number that decides it, and texts that fit."""

import math
import re
from collections.abc import Sequence

from marsedl.replication.claims.claim import Cause, Claim, Doubt, Margin
from marsedl.replication.claims.names import AGREEING_VERDICTS
from marsedl.replication.claims.numbers import flatten, format_number, unit_of
from marsedl.replication.claims.rows import format_result
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.report.formulas import with_raised_powers

_MOST_WORDS = 12  # of a reason in one line
_CLAUSE = 4  # words; a shorter clause is no reason
_UNITS = {"1": "", "not given": "", "percent": "%"}  # as they are shown


def shown(row: Claim) -> str:
    """Return the one measured value that decides a claim, with its unit and standard error.

    For example `302.527 ± 0.056 m/s`, `3 of 4 agree`, `0.315 ± 0.016 %` for a statement; empty if its reading evaluates
    nothing, or if a statement is decided by no number.
    """
    result, margin = row.result, row.result.margin
    if row.is_statement:
        if margin is None or margin.value is None:
            return ""
        return with_unit(_number(margin.value, margin.limit, margin.standard_error), margin.unit)
    if None in flatten(result.value).values():
        return "no value" if result.verdict == "differs" else ""
    verdicts = [verdict for verdict in flatten(result.components).values() if verdict]
    if len(verdicts) > 2:
        return f"{sum(verdict in AGREEING_VERDICTS for verdict in verdicts)} of {len(verdicts)} agree"
    texts, units = format_result(row, row.reading), [unit_of(row, index) for index in flatten(result.value)]
    if differ := len(set(units)) > 1:
        texts = [with_unit(*pair) for pair in zip(texts, units, strict=True)]
    line = ", ".join(texts) if len(texts) <= 2 else f"{texts[0]} ... {texts[-1]}"
    return line if differ else with_unit(line, units[0])


def cut(text: str) -> str:
    """Return a text of few words: its first clauses if they have some length, else its first words."""
    words = text.split()
    if len(words) <= _MOST_WORDS:
        return text
    ends = [count for count in range(_CLAUSE, _MOST_WORDS + 1) if words[count - 1][-1] in ",;:"]
    return " ".join(words[: ends[-1]]).rstrip(",;:") if ends else f"{' '.join(words[:_MOST_WORDS])} ..."


def limit(margin: Margin | None) -> str:
    """Return the limit of what decides, with its unit; empty if there is none."""
    if margin is None or None in (margin.limit, margin.value):
        return ""
    text = _number(margin.limit, margin.value)
    return with_unit(re.sub(r"\.?0+(?=e|$)", "", text) if "." in text else text, margin.unit)


def cause(row: Claim) -> str:
    """Return which value of a choice reproduces a claim by itself, or else comes nearest to what is printed."""
    if row.universes is None:
        return ""
    misprint, text = row.universes.misprint, "No choice that we varied by itself explains it"
    if one := row.universes.cause:
        does = _does(row) if one.verdict in AGREEING_VERDICTS else f"comes nearest to {_target(row)}"
        text = f"{_named(one).capitalize()} ({one.why}) {does}"
        if None not in (one.number, one.corrected) and one.number != one.corrected:
            ends = [near(end, one.number - one.corrected) for end in (one.corrected, one.number)]
            text += f": {ends[0]} becomes {with_unit(ends[1], one.unit)}"
    return f"{text}; {_named(misprint)}, which is set apart, {_does(row)}" if misprint else text


def _named(one: Cause) -> str:
    return f"{in_words(one.choice)} = {in_words(one.value)}"


def _does(row: Claim) -> str:
    return "makes it hold" if row.is_statement else "reproduces it"


def _target(row: Claim) -> str:
    return "its limit" if row.is_statement else "print"


def odd_one_out(row: Claim) -> str:
    """Return in how many universes a claim is true if most of enough decide against `corrected`; else empty."""
    one, is_true = row.universes, row.verdict in AGREEING_VERDICTS
    is_decided = one and one.of and one.label != "too_few" and (is_true or row.is_refuted)
    if not is_decided or (2 * one.true > one.of) == is_true:
        return ""
    return f"true in {one.true} of {one.of} universes"


def remark(row: Claim) -> str:
    """Return the stated reason without the errata, choices and tolerance of its declaration, which stand elsewhere."""
    text = re.sub(r"^E\d+(, E\d+)*(\. |$)", "", row.reason.partition("Within the tolerance stated beforehand")[0])
    return "" if text.startswith("Depends on ") and row.choices else text.strip()


def first_sentence(text: str) -> str:
    """Return the first sentence of a caption; the full stop of "Fig. 9" ends none."""
    return re.split(r"\. (?=[A-Z(])", text)[0].removesuffix(".")


def short_doubt(doubts: Sequence[Doubt]) -> str:
    """Return how many flights would settle a doubt, else why there is one."""
    trials = next((doubt.trials for doubt in doubts if doubt.trials), None)
    return f"about {trials:,} flights would settle it" if trials else doubts[0].why


def with_unit(text: str, unit: str) -> str:
    """Return a text with a unit behind it, if there is one to show."""
    return f"{text} {shown_unit(unit)}".strip()


def shown_unit(unit: str) -> str:
    """Return a unit as it is shown behind a number; empty if there is none."""
    return _UNITS.get(unit, with_raised_powers(unit))


def near(value: float, other: float, error: float = 0.0, digits: int = 3) -> str:
    """Return a number with as many digits as its error allows, or else with so many as another one shows."""
    last = 10.0 ** (math.floor(math.log10(abs(other))) - digits + 1) if other else None
    return format_number(value, error, None if error else last)


def _number(value: float, other: float | None, error: float = 0.0) -> str:
    """A number with as many digits as its error allows, or else as tell it from another: three at least."""
    other, digits = value if other is None else other, 3
    while digits < 15 and value != other and float(_digits(value, digits)) == float(_digits(other, digits)):
        digits += 1
    return format_number(value, error) if error else _digits(value, digits)


def _digits(value: float, digits: int) -> str:
    """A number with this many digits, and all of those before the point."""
    whole = abs(value - round(value)) <= ROUNDING * abs(value) and abs(value) < 1e6
    return format_number(value, resolution=1.0) if whole else near(value, value, digits=digits)
