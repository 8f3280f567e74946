"""A claim in one line: the number that decides it, and why its verdict is what it is."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from marsedl.replication.claims.claim import Claim, Margin, Tolerance
from marsedl.replication.claims.numbers import flatten, format_number, format_result, is_finite
from marsedl.replication.claims.thresholds import ROUNDING

MOST_WORDS = 12  # of a reason in one line
AGREE = ("reproduced", "close")  # verdicts on a number that the paper may as well have printed
NO_VALUE = "no value"

_CLAUSE = 4  # words; a clause of fewer is no reason
_UNITS = {"1": "", "not given": "", "percent": "%"}  # as they are shown


def shown(row: Claim) -> str:
    """Return the one measured value that decides a claim, with its unit and standard error.

    For example `302.527 ± 0.056 m/s`, `3 of 4 agree`, `0.315 ± 0.016 %` for a statement; empty if its reading evaluates
    nothing, or if a statement is decided by no number.
    """
    result = row.result
    if result.verdict is None or row.kind == "context":
        return ""
    if row.is_statement:
        margin = result.margin
        if margin is None or margin.value is None:
            return ""
        return with_unit(_number(margin.value, margin.limit, margin.standard_error), margin.unit)
    numbers = flatten(result.value)
    if None in numbers.values() or not is_finite(result.value):
        return NO_VALUE if result.verdict == "differs" else ""
    verdicts = [verdict for verdict in flatten(result.components).values() if verdict]
    if len(verdicts) > 2:
        return f"{sum(verdict in AGREE for verdict in verdicts)} of {len(verdicts)} agree"
    texts = ", ".join(format_result(row, row.reading)).split(", ")
    units = [row.unit_of(index) for index in numbers]
    if len(set(units)) > 1:
        texts = [with_unit(*pair) for pair in zip(texts, units, strict=True)]
    line = ", ".join(texts) if len(texts) <= 2 else f"{texts[0]} ... {texts[-1]}"
    return line if len(set(units)) > 1 else with_unit(line, units[0])


def why(
    row: Claim,
    titles: Mapping[str, str],
    meanings: Mapping[str, str] | None = None,
    moves: Mapping[str, float] | None = None,
) -> str:
    """Return why a verdict is what it is, in one line.

    Args:
        row: a claim.
        titles: titles of errata by id.
        meanings: what inputs are, in words, by name; where a claim names nothing but an input, it stands for the name.
        moves: how far each cause that the claim names moves its number, see `Compared.causes`; what moves it most comes
            first, what does not move it is not shown, and what no reading tells comes last.

    Returns:
        A line of about `MOST_WORDS` words; empty for what is not counted, other than what cannot fail.

    """
    margin = row.result.margin
    match row.verdict:
        case "by_construction":
            return _cut(row.by_construction)
        case "undetermined":
            return _cut(_short_doubt(row.result.doubt))
        case "differs":
            return _cause(row, titles, meanings or {}, moves or {}) or "outside rounding and sampling error"
        case "fails":
            return _cause(row, titles, meanings or {}, moves or {}) or _limit(margin) or "a test that is not met"
        case "close":
            return _tolerance(row.close)
        case "reproduced":
            away = _away(margin)
            return f"{away} inside the limit" if away else "within the printed rounding"
        case "holds":
            limit, away = _limit(margin), _away(margin)
            return f"{limit}, {away} away" if away else limit or "a test without a margin"
    return ""


def _cause(row: Claim, titles: Mapping[str, str], meanings: Mapping[str, str], moves: Mapping[str, float]) -> str:
    """The errata or the unprinted inputs that a claim names and that move its number, as many as fit into a line."""

    def moving(names: Iterable[str]) -> list[str]:
        return sorted((name for name in names if moves.get(name, 1.0) > 0.0), key=lambda name: -moves.get(name, 0.0))

    named = [titles[name] for name in moving(row.errata) if titles.get(name)]
    withheld = [label(text, meanings) for text in moving(row.withheld)]
    return _first_of(named) if named else _first_of(withheld, "not printed: ") if withheld else ""


def _first_of(texts: Sequence[str], before: str = "") -> str:
    """As many texts as fit into a line, and the number of the others."""
    for count in range(len(texts), 0, -1):
        remainder = f" and {len(texts) - count} more" if count < len(texts) else ""
        line = f"{before}{'; '.join(texts[:count])}{remainder}"
        if len(line.split()) <= MOST_WORDS:
            return line
    remainder = f" and {len(texts) - 1} more" if len(texts) > 1 else ""
    return f"{before}{_cut(texts[0], MOST_WORDS - len((before + remainder).split()))}{remainder}"


def _limit(margin: Margin | None) -> str:
    if margin is None or margin.limit is None or margin.value is None:
        return ""
    text = _number(margin.limit, margin.value)
    plain = re.sub(r"\.?0+(?=e|$)", "", text) if "." in text else text
    return f"limit {with_unit(plain, margin.unit)}"


def _away(margin: Margin | None) -> str:
    """How far the measure is from its limit, if it is sampled."""
    if margin is None or not margin.sampled or margin.distance is None:
        return ""
    return f"{margin.distance:.{1 if margin.distance < 10 else 0}f} standard errors"


def _tolerance(close: Tolerance | None) -> str:
    if close and close.relative:
        return f"within {100 * close.relative:.3g} %, the tolerance stated beforehand"
    return "within the tolerance stated beforehand"


def _short_doubt(doubt: str) -> str:
    first = doubt.split("; ")
    trials = next((part for part in first if part.startswith("about ")), "")
    if trials:
        return trials.replace(" trials ", " flights ")
    return re.sub(r"the test of '.*'$", "the verdict", first[0])


def _cut(text: str, most: int = MOST_WORDS) -> str:
    """A text of no more words: its first clauses if they have some length, else its first words."""
    words = text.split()
    if len(words) <= most:
        return text
    ends = [count for count in range(_CLAUSE, most + 1) if words[count - 1][-1] in ",;:"]
    return " ".join(words[: ends[-1]]).rstrip(",;:") if ends else f"{' '.join(words[:most])} ..."


def with_unit(text: str, unit: str) -> str:
    """Return a text with a unit behind it, if there is one to show."""
    return f"{text} {shown_unit(unit)}".strip()


def shown_unit(unit: str) -> str:
    """Return a unit as it stands behind a number; empty if there is none."""
    return _UNITS.get(unit, unit)


def _number(value: float, other: float | None, error: float = 0.0) -> str:
    """A number with as many digits as its error allows, or else as tell it from another: three at least."""
    if error > 0:
        return format_number(value, error)
    other = value if other is None else other
    digits = 3
    while digits < 15 and value != other and float(_digits(value, digits)) == float(_digits(other, digits)):
        digits += 1
    return _digits(value, digits)


def _digits(value: float, digits: int) -> str:
    """A number with this many digits, and all of those before the point."""
    if abs(value - round(value)) <= ROUNDING * abs(value) and abs(value) < 1e6:
        return f"{value:.0f}"
    return format_number(value, resolution=10.0 ** (math.floor(math.log10(abs(value))) - digits + 1))


def named_inputs(text: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return the inputs, of these, that a text names as "section.name"."""
    return tuple(name for name in re.findall(r"\b\w+\.\w+\b", text) if name in names)


def first_clause(text: str) -> str:
    """Return what stands before a colon or semicolon."""
    return re.split("[:;]", text)[0]


def label(text: str, meanings: Mapping[str, str]) -> str:
    """What is withheld, in words: without the names of inputs, and the meaning of one that stands alone."""
    if re.fullmatch(r"\w+\.\w+", text):
        meaning = meanings.get(text) or text
        first = first_clause(meaning)
        return first if len(first.split()) > 2 else meaning
    return re.sub(r"\s*\([^()]*\w\.\w[^()]*\)", "", text)
