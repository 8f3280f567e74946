"""What decides a verdict, and what errata and unprinted inputs change: computed from the rows of verdicts alone.

Readings are compared at equal numbers of trials. Where they share random numbers, as they do unless their seeds differ,
the standard error of a difference is smaller than stated here: the rows do not hold by how much.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from marsedl.replication.catalogue import Erratum
from marsedl.replication.claims import (
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    DEFAULT_READING,
    REFUTED_VERDICTS,
    STANDING_VERDICTS,
    UNDECIDED,
    format_number,
    format_result,
    is_finite,
)
from marsedl.replication.report import InputEntry, ReadingEntry, is_assumed
from marsedl.replication.thresholds import ROUNDING, SIGMAS

MOST_WORDS = 12  # of a reason in one line
AGREE = ("reproduced", "close")  # verdicts on a number that the paper may as well have printed
NO_VALUE = "no value"

_CLAUSE = 4  # words; a clause of fewer is no reason
_UNITS = {"1": "", "not given": "", "percent": "%"}  # as they are shown

# What an erratum changes, from most to least.
NO_RESULT = "no_result"  # a headline number does not exist in a reading that keeps what is printed
HEADLINE = "headline"  # a headline number changes beyond rounding and sampling error
VERDICT = "verdict"  # a verdict changes
NOTHING = "nothing"  # no headline number and no verdict changes: notation
NOT_ISOLATED = "not_isolated"  # no reading keeps this erratum and mends the others
RANKS = (NO_RESULT, HEADLINE, VERDICT, NOTHING, NOT_ISOLATED)

Row = Mapping[str, Any]  # one claim of `report/claims.json`


@dataclass(frozen=True)
class VerdictChange:
    """A claim whose verdict differs between two readings.

    `claim` is its id. `before` and `after` are its verdicts in the reading `against` and in `reading`. `equal_trials`:
    whether both rest on as many trials (or on none).
    """

    claim: str
    reading: str
    against: str
    before: str
    after: str
    equal_trials: bool


@dataclass(frozen=True)
class Change:
    """How a number differs between two readings.

    `claim` is the id of the claim that it belongs to, `measure` what it is: empty for the number that the paper prints,
    else the measure that decides a statement. `component` are the indices of one number of a row, from 0, and empty for
    a single number. `before` and `after` are the values in the reading `against` and in `reading`, `difference` is
    `after - before`, `error` its standard error (0 without sampling, and at most this where readings share random
    numbers); all have the unit `unit`. `size` is |difference| divided by what noise and rounding could explain: three
    standard errors and half a printed digit for a printed number; three standard errors for a sampled measure, and its
    distance from its limit for another. A change counts if it exceeds 1. `equal_trials`: whether both rest on as many
    trials (or on none).
    """

    claim: str
    measure: str
    component: tuple[int, ...]
    reading: str
    against: str
    before: float
    after: float
    difference: float
    error: float
    unit: str
    size: float
    equal_trials: bool

    @property
    def counts(self) -> bool:
        """Whether the difference is beyond rounding and sampling error."""
        return self.size > 1.0


@dataclass(frozen=True)
class ErratumEffect:
    """What an erratum changes.

    `rank` is one of `RANKS`. `readings` are pairs of a reading that keeps what is printed and the reading that it is
    compared with: the nearest one of its bases that does not keep it. `headline` are the changes of headline numbers,
    the largest first, one for each claim and reading; `no_result` pairs of a headline claim and a reading in which its
    number does not exist; `verdicts` the verdicts that change.
    """

    id: str
    title: str
    rank: str
    readings: tuple[tuple[str, str], ...] = ()
    headline: tuple[Change, ...] = ()
    no_result: tuple[tuple[str, str], ...] = ()
    verdicts: tuple[VerdictChange, ...] = ()


@dataclass(frozen=True)
class OpenInput:
    """An input, or a few that belong together, that the paper needs and does not print.

    `label` says in words what it is. `inputs` are names as "section.name", `used` their values in the default reading
    as text. `changes` are those of the deciding number (see `deciding`), one for each reading that differs from its
    `against` in this input alone; `together` names the other open inputs that vary with it where no reading varies it
    alone. `low` and `high` bound the number over these readings, in its unit; None without any. `no_result` are the
    readings of this kind in which the number does not exist. `named` of the `refuted` claims that differ or fail name
    this input; `claims` are their ids.
    """

    label: str
    inputs: tuple[str, ...]
    used: tuple[str, ...]
    changes: tuple[Change, ...]
    together: tuple[str, ...]
    low: float | None
    high: float | None
    no_result: tuple[str, ...]
    claims: tuple[str, ...]
    named: int
    refuted: int


@dataclass(frozen=True)
class Choice:
    """What a reading makes of the deciding number.

    `inputs` are those that differ from the default reading, without numbers of trials; `errata` the ids of those that
    it keeps. `change` is None if the number does not exist in this reading.
    """

    reading: str
    inputs: tuple[str, ...]
    errata: tuple[str, ...]
    change: Change | None


@dataclass(frozen=True)
class Deciding:
    """The number that a paper stands or falls with, and what each choice makes of it.

    It belongs to the claim with id `claim`; `measure`, `component` and `unit` are as in `Change`. `value`, `error`
    (standard error) and `trials` are those of the default reading with all of its trials. `printed` is the value of the
    paper, None for a statement; `limit` the limit of a statement, None for a number. `choices` are those with the
    largest change first; those without a result come last.
    """

    claim: str
    measure: str
    component: tuple[int, ...]
    unit: str
    value: float
    error: float
    trials: int | None
    printed: float | None
    limit: float | None
    choices: tuple[Choice, ...]


@dataclass(frozen=True)
class Changing:
    """Where verdicts differ from those of the default reading.

    `claims` has the changes of each claim for which there are any, by id; `same` are the readings that change none.
    """

    claims: Mapping[str, tuple[VerdictChange, ...]]
    same: tuple[str, ...]


# ------------------------------------------------------------------------------------------------------ one claim


def shown(row: Row, reading: str | None = None) -> str:
    """Return the one measured value that decides a claim, with its unit and standard error.

    Args:
        row: a row of verdicts.
        reading: the reading; by default the one that gives the verdict.

    Returns:
        For example `302.527 ± 0.056 m/s`, `3 of 4 agree`, `0.315 ± 0.016 %` for a statement; empty if the reading
        evaluates nothing, or if a statement is decided by no number.

    """
    reading = reading or row["reading"]
    result = row["readings"].get(reading)
    if result is None or result["verdict"] is None or row["kind"] == "context":
        return ""
    if row["kind"] == "qualitative":
        margin = result["margin"]
        if not margin or margin["value"] is None:
            return ""
        return _with_unit(_number(margin["value"], margin["limit"], margin["standard_error"]), margin["unit"])
    numbers = _leaves(result["value"])
    if None in numbers.values() or not is_finite(result["value"]):
        return NO_VALUE if result["verdict"] == "differs" else ""
    verdicts = [verdict for verdict in _leaves(result["components"]).values() if verdict]
    if len(verdicts) > 2:
        return f"{sum(verdict in AGREE for verdict in verdicts)} of {len(verdicts)} agree"
    texts = ", ".join(format_result(row, reading)).split(", ")
    units = [_unit(row["unit"], index) for index in numbers]
    if len(set(units)) > 1:
        texts = [_with_unit(*pair) for pair in zip(texts, units, strict=True)]
    line = ", ".join(texts) if len(texts) <= 2 else f"{texts[0]} ... {texts[-1]}"
    return line if len(set(units)) > 1 else _with_unit(line, units[0])


def why(
    row: Row,
    titles: Mapping[str, str],
    meanings: Mapping[str, str] | None = None,
    moves: Mapping[str, float] | None = None,
) -> str:
    """Return why a verdict is what it is, in one line.

    Args:
        row: a row of verdicts.
        titles: titles of errata by id.
        meanings: what inputs are, in words, by name; where a claim names nothing but an input, it stands for the name.
        moves: how far each cause that the claim names moves its number, see `causes`; what moves it most comes first,
            what does not move it is not shown, and what no reading tells comes last.

    Returns:
        A line of about `MOST_WORDS` words; empty for what is not counted, other than what cannot fail.

    """
    result = row["readings"].get(row["reading"], {})
    verdict, margin = row["verdict"], result.get("margin")
    if verdict == BY_CONSTRUCTION:
        return _cut(row["by_construction"])
    if verdict == UNDECIDED:
        return _cut(_short_doubt(result.get("doubt", "")))
    if verdict in REFUTED_VERDICTS:
        return _cause(row, titles, meanings or {}, moves or {}) or _outside(row, margin)
    if verdict == "close":
        return _tolerance(row["close"])
    if verdict == "reproduced":
        return _rounding(margin)
    if verdict == "holds":
        return _inside(margin)
    return ""


def _cause(row: Row, titles: Mapping[str, str], meanings: Mapping[str, str], moves: Mapping[str, float]) -> str:
    """The errata or the unprinted inputs that a claim names and that move its number, as many as fit into a line."""

    def moving(names: Iterable[str]) -> list[str]:
        return sorted((name for name in names if moves.get(name, 1.0) > 0.0), key=lambda name: -moves.get(name, 0.0))

    named = [titles[name] for name in moving(row["errata"]) if titles.get(name)]
    if named:
        return _first_of(named)
    withheld = [_label(text, meanings) for text in moving(row["withheld"])]
    return _first_of(withheld, "not printed: ") if withheld else ""


def _first_of(texts: Sequence[str], before: str = "") -> str:
    """As many texts as fit into a line, and the number of the others."""
    for count in range(len(texts), 0, -1):
        remainder = f" and {len(texts) - count} more" if count < len(texts) else ""
        line = f"{before}{'; '.join(texts[:count])}{remainder}"
        if len(line.split()) <= MOST_WORDS:
            return line
    remainder = f" and {len(texts) - 1} more" if len(texts) > 1 else ""
    return f"{before}{_cut(texts[0], MOST_WORDS - len((before + remainder).split()))}{remainder}"


def _outside(row: Row, margin: Mapping | None) -> str:
    if row["kind"] != "qualitative":
        return "outside rounding and sampling error"
    return _limit(margin) or "a test that is not met"


def _inside(margin: Mapping | None) -> str:
    limit, away = _limit(margin), _away(margin)
    return f"{limit}, {away} away" if away else limit or "a test without a margin"


def _limit(margin: Mapping | None) -> str:
    if not margin or margin["limit"] is None or margin["value"] is None:
        return ""
    text = _number(margin["limit"], margin["value"])
    plain = re.sub(r"\.?0+(?=e|$)", "", text) if "." in text else text
    return f"limit {_with_unit(plain, margin['unit'])}"


def _away(margin: Mapping | None) -> str:
    """How far the measure is from its limit, if it is sampled."""
    if not margin or margin["in"] != "standard errors" or margin["distance"] is None:
        return ""
    distance = margin["distance"]
    return f"{distance:.{1 if distance < 10 else 0}f} standard errors"


def _rounding(margin: Mapping | None) -> str:
    away = _away(margin)
    return f"{away} inside the limit" if away else "within the printed rounding"


def _tolerance(close: Mapping | None) -> str:
    if close and close["relative"]:
        return f"within {100 * close['relative']:.3g} %, the tolerance stated beforehand"
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


def _with_unit(text: str, unit: str) -> str:
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


# ---------------------------------------------------------------------------------------------------- two readings


class _Number(NamedTuple):
    """A number of a claim: its value, standard error and unit, and what of a difference from it is nothing."""

    value: float
    error: float
    unit: str
    slack: float  # half a printed digit; of a statement without sampling, the distance from its limit


class _Sample(NamedTuple):
    """What a reading gives for a claim from a number of trials."""

    trials: int | None
    verdict: str | None
    numbers: dict[tuple[str, tuple[int, ...]], _Number]  # by measure and component


def _samples(row: Row, reading: str) -> list[_Sample]:
    """What a reading gives from all of its trials, and from as many as other readings have."""
    result = row["readings"].get(reading)
    if result is None or result["verdict"] is None:
        return []
    results = [result, result["at_equal_trials"]]
    return [_Sample(one["trials"], one["verdict"], _numbers(row, one)) for one in results if one]


def _numbers(row: Row, result: Mapping[str, Any]) -> dict[tuple[str, tuple[int, ...]], _Number]:
    if row["kind"] == "qualitative":
        margin = result.get("margin")
        if not margin or margin["value"] is None:
            return {}
        error = margin["standard_error"]
        slack = 0.0 if error or margin["limit"] is None else abs(margin["value"] - margin["limit"])
        return {(margin["measure"], ()): _Number(margin["value"], error, margin["unit"], slack)}
    errors, sizes = _leaves(result["standard_error"]), _leaves(row["resolution"])
    return {
        ("", index): _Number(
            float(value),
            errors.get(index) or 0.0,
            _unit(row["unit"], index),
            0.5 * (sizes.get(index, sizes.get(())) or 0.0),
        )
        for index, value in _leaves(result["value"]).items()
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    }


def _pairs(row: Row, reading: str, against: str) -> list[tuple[_Sample, _Sample, bool]]:
    """What two readings give, first with equal numbers of trials, and the most of them; and whether they are equal."""
    pairs = [
        (sample, other, sample.trials == other.trials)
        for sample in _samples(row, reading)
        for other in _samples(row, against)
    ]
    return sorted(pairs, key=lambda pair: (-pair[2], -(pair[0].trials or 0), -(pair[1].trials or 0)))


def _changes(row: Row, reading: str, against: str) -> list[Change]:
    """How the numbers of a claim differ between two readings: none if they have none in common."""
    for sample, other, equal in _pairs(row, reading, against):
        common = [key for key in sample.numbers if key in other.numbers]
        if common:
            return [
                _change(row, key, reading, against, sample.numbers[key], other.numbers[key], equal) for key in common
            ]
    return []


def _change(row, key, reading, against, number: _Number, other: _Number, equal: bool) -> Change:
    difference = number.value - other.value
    same = equal and number == other  # the same flights
    error = 0.0 if same else math.hypot(number.error, other.error)
    sure = SIGMAS * error + other.slack
    size = abs(difference) / sure if sure else math.inf if difference else 0.0
    values = other.value, number.value, difference, error, other.unit
    return Change(row["id"], *key, reading, against, *values, size, equal)


def _unit(unit: str, component: tuple[int, ...]) -> str:
    """The unit of one number of a row: units that differ are listed with commas."""
    units = unit.split(", ")
    return units[component[-1]] if component and component[-1] < len(units) > 1 else unit


def _verdict_change(row: Row, reading: str, against: str) -> VerdictChange | None:
    """How the verdict on a claim differs between two readings; what fewer trials alone may leave open is no change."""
    for sample, other, equal in _pairs(row, reading, against)[:1]:
        both = {sample.verdict, other.verdict}
        if len(both) == 2 and both <= set(COUNTED_VERDICTS) and (equal or UNDECIDED not in both):
            return VerdictChange(row["id"], reading, against, other.verdict, sample.verdict, equal)
    return None


def _has_no_result(row: Row, reading: str) -> bool:
    """Whether a reading evaluates a printed number, and finds that it does not exist."""
    result = row["readings"].get(reading)
    return bool(
        row["kind"] in ("deterministic", "monte_carlo")
        and result
        and result["verdict"] is not None
        and (None in _leaves(result["value"]).values() or not is_finite(result["value"]))
    )


# -------------------------------------------------------------------------------------------------------- readings


def _lineage(name: str, readings: Mapping[str, ReadingEntry]) -> Iterator[str]:
    """The bases of a reading up to the default one; nothing if it is not based on that."""
    chain = []
    while name != DEFAULT_READING:
        name = readings[name].based_on if name in readings else None
        if name is None or name in chain:
            return
        chain.append(name)
    yield from chain


def _differing(inputs: Sequence[InputEntry], first: str, second: str) -> tuple[str, ...]:
    """Inputs in which two readings differ, without numbers of trials, which are equal where readings are compared."""
    return tuple(
        entry.name
        for entry in inputs
        if entry.values[first].value != entry.values[second].value and not entry.name.endswith("trials")
    )


def _headline(rows: Iterable[Row]) -> list[Row]:
    """The headline claims, in their order."""
    return sorted((row for row in rows if row.get("headline")), key=lambda row: row["headline"])


# ---------------------------------------------------------------------------------------------------------- results


def errata_effects(
    rows: Sequence[Row], errata: Iterable[Erratum], readings: Sequence[ReadingEntry]
) -> list[ErratumEffect]:
    """Return what each erratum changes, those that change most first.

    Args:
        rows: the rows of verdicts of one paper.
        errata: those of its catalogue.
        readings: its readings.

    Returns:
        One effect for each erratum, by rank and, within `HEADLINE`, by the largest change of a headline number; else
        in the order of the catalogue. An erratum that is kept only by readings that are not based on the default one
        (`printed` keeps all at once) is `NOT_ISOLATED`.

    """
    by_name = {reading.name: reading for reading in readings}
    effects = [_erratum_effect(rows, erratum, by_name) for erratum in errata]
    return sorted(effects, key=lambda e: (RANKS.index(e.rank), -_largest(e) if e.rank == HEADLINE else 0.0))


def _largest(effect: ErratumEffect) -> float:
    return max((change.size for change in effect.headline), default=0.0)


def _kept_pairs(erratum: Erratum, readings: Mapping[str, ReadingEntry]) -> list[tuple[str, str]]:
    """Readings that keep an erratum, each with the nearest of its bases that does not."""
    bases = {
        name: next((base for base in _lineage(name, readings) if base not in erratum.kept_by), None)
        for name in erratum.kept_by
    }
    return [(name, against) for name, against in bases.items() if against]


def _erratum_effect(rows: Sequence[Row], erratum: Erratum, readings: Mapping[str, ReadingEntry]) -> ErratumEffect:
    pairs = _kept_pairs(erratum, readings)
    if not pairs:
        return ErratumEffect(erratum.id, erratum.title, NOT_ISOLATED)
    headline = _headline(rows)
    no_result = [
        (row["id"], name)
        for name, against in pairs
        for row in headline
        if _has_no_result(row, name) and not _has_no_result(row, against)
    ]
    changes = [
        max(both, key=lambda change: change.size)
        for name, against in pairs
        for row in headline
        if (both := _changes(row, name, against))
    ]
    verdicts = [
        change
        for name, against in pairs
        for row in rows
        if row["kind"] != "input" and (change := _verdict_change(row, name, against))
    ]
    by_rank = {NO_RESULT: no_result, HEADLINE: [c for c in changes if c.counts], VERDICT: verdicts, NOTHING: True}
    return ErratumEffect(
        erratum.id,
        erratum.title,
        next(rank for rank, changes in by_rank.items() if changes),
        tuple(pairs),
        tuple(sorted(changes, key=lambda change: -change.size)),
        tuple(no_result),
        tuple(verdicts),
    )


def causes(
    rows: Sequence[Row], errata: Iterable[Erratum], inputs: Sequence[InputEntry], readings: Sequence[ReadingEntry]
) -> dict[str, dict[str, float]]:
    """Return how far each cause that a refuted claim names moves its number towards what is printed.

    A cause is moved in its own readings: those that keep an erratum, or that vary unprinted inputs alone.

    Args:
        rows: the rows of verdicts of one paper.
        errata: those of its catalogue.
        inputs: its inputs, with their values in all readings.
        readings: its readings.

    Returns:
        By claim and cause (id of an erratum, or text on withheld inputs) the largest change, as `Change.size`; infinite
        if the claim then stands, 0 if no reading moves the number beyond rounding and sampling error, or only away. A
        cause that no reading tells anything of is left out.

    """
    by_name = {reading.name: reading for reading in readings}
    pairs = {erratum.id: _kept_pairs(erratum, by_name) for erratum in errata}
    pairs |= {text: varied for text, (_, varied, together) in _withheld(rows, inputs, by_name).items() if not together}
    moved: dict[str, dict[str, float]] = {}
    for row in rows:
        if row["verdict"] in REFUTED_VERDICTS:
            sizes = {name: _towards(row, pairs.get(name, ())) for name in (*row["errata"], *row["withheld"])}
            moved[row["id"]] = {name: size for name, size in sizes.items() if size is not None}
    return moved


def _towards(row: Row, pairs: Iterable[tuple[str, str]]) -> float | None:
    """How far the number of a claim moves towards what is printed in the first of these readings; None without any."""
    compared = [pair for pair in pairs if _samples(row, pair[0]) and _samples(row, pair[1])]
    # A change beside the default reading says more than one beside another.
    compared = [pair for pair in compared if pair[1] == DEFAULT_READING] or compared
    sizes = []
    for name, against in compared:
        verdict = _verdict_change(row, name, against)
        stands = verdict is not None and verdict.after in STANDING_VERDICTS and verdict.before in REFUTED_VERDICTS
        changes = [change for change in _changes(row, name, against) if change.counts and _is_towards(row, change)]
        sizes.append(math.inf if stands else max((change.size for change in changes), default=0.0))
    return max(sizes, default=None)


def _is_towards(row: Row, change: Change) -> bool:
    if row["kind"] == "qualitative":
        limit = row["readings"][change.against]["margin"]["limit"]
        return limit is not None and (limit - change.before) * change.difference > 0.0
    printed = _leaves(row["printed"]).get(change.component)
    return printed is not None and abs(change.after - printed) < abs(change.before - printed)


def deciding(
    rows: Sequence[Row], readings: Sequence[ReadingEntry], inputs: Sequence[InputEntry], errata: Iterable[Erratum]
) -> Deciding | None:
    """Return the number that a paper stands or falls with, and what each reading makes of it.

    It is the first headline claim that is a number (of a row the one that decides), else the measure of the first
    headline statement that other readings have as well.

    Args:
        rows: the rows of verdicts of one paper.
        readings: its readings.
        inputs: its inputs, with their values in all readings.
        errata: those of its catalogue.

    Returns:
        The number with a choice for each reading that is based on the default one; None if there is no such number.

    """
    number = _deciding_number(rows, readings)
    if number is None:
        return None
    row, key = number
    by_name = {reading.name: reading for reading in readings}
    listed_errata = list(errata)
    choices = []
    for name in by_name:
        if name == DEFAULT_READING or not any(_lineage(name, by_name)):
            continue
        change = _change_of(row, key, name, DEFAULT_READING)
        if change is None and not _has_no_result(row, name):
            continue
        names = _differing(inputs, name, DEFAULT_READING)
        choices.append(Choice(name, names, tuple(e.id for e in listed_errata if name in e.kept_by), change))
    sample = _samples(row, DEFAULT_READING)[0]
    number, statement = sample.numbers[key], row["kind"] == "qualitative"
    return Deciding(
        row["id"],
        *key,
        number.unit,
        number.value,
        number.error,
        sample.trials,
        None if statement else _leaves(row["printed"])[key[1]],
        row["readings"][DEFAULT_READING]["margin"]["limit"] if statement else None,
        tuple(sorted(choices, key=lambda choice: -abs(choice.change.difference) if choice.change else math.inf)),
    )


def _deciding_number(rows: Sequence[Row], readings: Sequence[ReadingEntry]) -> tuple[Row, tuple] | None:
    """The claim with the deciding number, and its measure and component."""
    headline = _headline(rows)
    for row in headline:
        if row["kind"] in ("deterministic", "monte_carlo") and (samples := _samples(row, DEFAULT_READING)):
            numbers, margin = samples[0].numbers, row["readings"][DEFAULT_READING]["margin"]
            printed = _leaves(row["printed"])
            if numbers and margin and margin["value"] is not None:
                return row, min(numbers, key=lambda key: abs(numbers[key].value - printed[key[1]] - margin["value"]))
    for row in headline:
        if row["kind"] == "qualitative" and (samples := _samples(row, DEFAULT_READING)) and samples[0].numbers:
            (key,) = samples[0].numbers
            other_readings = [r.name for r in readings if r.name != DEFAULT_READING]
            if any(_change_of(row, key, name, DEFAULT_READING) for name in other_readings):
                return row, key
    return None


def _change_of(row: Row, key: tuple, reading: str, against: str) -> Change | None:
    return next((c for c in _changes(row, reading, against) if (c.measure, c.component) == key), None)


def open_inputs(rows: Sequence[Row], inputs: Sequence[InputEntry], readings: Sequence[ReadingEntry]) -> list[OpenInput]:
    """Return the inputs that the paper needs and does not print.

    These are the inputs that claims name as withheld, together as they are named, and all others whose source in the
    default reading says that they are assumed.

    Args:
        rows: the rows of verdicts of one paper.
        inputs: its inputs, with their values in all readings.
        readings: its readings.

    Returns:
        First those that most refuted claims name, of these those that change the deciding number most.

    """
    by_name = {reading.name: reading for reading in readings}
    entries = {entry.name: entry for entry in inputs}
    named = _withheld(rows, inputs, by_name)
    groups, varied = {text: one[0] for text, one in named.items()}, {text: one[1:] for text, one in named.items()}
    assumed, labelled = _assumed(inputs), {name for names in groups.values() for name in names}
    together: dict[Any, list[str]] = {}
    for name in (name for name in entries if name in assumed - labelled):
        pairs, _ = _varied((name,), inputs, by_name, assumed, labelled)
        together.setdefault(tuple(pairs) or name, []).append(name)
        varied[name] = pairs, ()
    groups |= {names[0]: tuple(names) for names in together.values()}
    refuted = [row for row in rows if row["verdict"] in REFUTED_VERDICTS]
    number = _deciding_number(rows, readings)
    open_ones = [_open_input(text, names, entries, *varied[text], number, refuted) for text, names in groups.items()]
    return sorted(open_ones, key=lambda one: (-one.named, -max((change.size for change in one.changes), default=0.0)))


def _assumed(inputs: Sequence[InputEntry]) -> set[str]:
    return {entry.name for entry in inputs if is_assumed(entry.values[DEFAULT_READING])}


def _withheld(rows: Sequence[Row], inputs: Sequence[InputEntry], readings: Mapping[str, ReadingEntry]) -> dict:
    """By the texts of what claims name as withheld: the inputs, and what `_varied` returns of them."""
    names = {entry.name: entry for entry in inputs}
    groups = {text: _named_inputs(text, names) for row in rows for text in row["withheld"]}
    labelled, assumed = {name for group in groups.values() for name in group}, _assumed(inputs)
    return {text: (group, *_varied(group, inputs, readings, assumed, labelled)) for text, group in groups.items()}


def _open_input(text, names, entries, pairs, together, number, refuted) -> OpenInput:
    changes = [change for pair in pairs if number and (change := _change_of(*number, *pair))]
    # A change beside the default reading says more than one beside another.
    changes = [change for change in changes if change.against == DEFAULT_READING] or changes
    values = [value for change in changes for value in (change.before, change.after)]
    claims = tuple(row["id"] for row in refuted if text in row["withheld"])
    return OpenInput(
        _label(text, {name: entry.meaning for name, entry in entries.items()}),
        names,
        tuple(entries[name].values[DEFAULT_READING].value for name in names),
        tuple(sorted(changes, key=lambda change: -change.size)),
        together,
        min(values, default=None),
        max(values, default=None),
        tuple(name for name, _ in pairs if number and _has_no_result(number[0], name)),
        claims,
        len(claims),
        len(refuted),
    )


def _varied(names, inputs, readings, assumed, labelled) -> tuple[list[tuple[str, str]], tuple[str, ...]]:
    """The readings that vary these inputs alone, each with what it differs from; else those that vary others as well.

    The default reading comes before others that a reading is based on. Inputs that are assumed and that no claim calls
    withheld may accompany them, such as what is done in a case that has no solution. Returns the others, too.
    """
    alone, joint = {}, {}
    for name in readings:
        lineage = list(_lineage(name, readings))
        for against in dict.fromkeys([DEFAULT_READING, *lineage] if lineage else []):
            differing = set(_differing(inputs, name, against))
            unnamed = differing.difference(names)
            if unnamed == differing or not unnamed <= assumed | labelled:
                continue
            if not unnamed & labelled:
                alone.setdefault(name, against)
            elif labelled.intersection(names):
                joint.setdefault(name, (against, unnamed & labelled))
    if alone:
        return list(alone.items()), ()
    beside = set().union(*(unnamed for _, unnamed in joint.values()))
    return [(name, against) for name, (against, _) in joint.items()], tuple(sorted(beside))


def changing(rows: Sequence[Row]) -> Changing:
    """Return where verdicts differ from those of the default reading, and the readings that change none."""
    other_readings = dict.fromkeys(name for row in rows for name in row["readings"] if name != DEFAULT_READING)
    claims = {}
    for row in rows:
        if row["kind"] == "input":
            continue
        changes = tuple(c for name in other_readings if (c := _verdict_change(row, name, DEFAULT_READING)))
        if changes:
            claims[row["id"]] = changes
    changing_readings = {change.reading for changes in claims.values() for change in changes}
    return Changing(claims, tuple(name for name in other_readings if name not in changing_readings))


# ------------------------------------------------------------------------------------------------------------- words


def _named_inputs(text: str, names: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(name for name in re.findall(r"\b\w+\.\w+\b", text) if name in names)


def _label(text: str, meanings: Mapping[str, str]) -> str:
    """What is withheld, in words: without the names of inputs, and the meaning of one that stands alone."""
    if re.fullmatch(r"\w+\.\w+", text):
        first, *_ = re.split(r"[:;]", meanings.get(text) or text)
        return first if len(first.split()) > 2 else meanings.get(text) or text
    return re.sub(r"\s*\([^()]*\w\.\w[^()]*\)", "", text)


def _leaves(value: Any) -> dict[tuple[int, ...], Any]:
    """The entries of a nested list by their indices, from 0; a single one has no index."""
    return dict(np.ndenumerate(np.array(value, dtype=object)))
