"""The gate for any table of numbers: the columns name, value, unit and standard_error against a stored reference."""

import csv
import math
import re
from collections.abc import Mapping
from pathlib import Path

from marsedl.replication.claims.committed import entries_text, read_entries
from marsedl.replication.claims.moved import Entry, Moved, moved, standard_errors
from marsedl.replication.claims.numbers import NOT_EVALUATED, format_number
from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.report.one_line import with_unit
from marsedl.replication.terminal import columns, summarize

ROUNDING = 1e-6  # of the accepted value: no tolerance is smaller
GROWN, OUTGROWN = 2.0, 10.0  # a standard error widens the tolerance: growth beyond the first is said, the second fails


_COLUMNS = ("value", "unit", "standard_error")


def read_table(path: Path) -> dict[str, Entry]:
    """Return the numbers of a CSV file by name; raises InputError with file and line if it is malformed."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            if missing := [name for name in ("name", *_COLUMNS) if name not in (rows.fieldnames or ())]:
                raise InputError(f"{path}: no column {', '.join(missing)}; it needs name,value,unit,standard_error")
            found = {}
            for row in rows:
                place, name = f"{path}, line {rows.line_num}", row["name"]
                if None in (*row, *row.values()):
                    raise InputError(f"{place}: must have {len(rows.fieldnames)} cells, as the first line has")
                if not name or name in found:
                    raise InputError(f"{place}: {f'{name} stands there twice' if name else 'a name is missing'}")
                found[name] = _entry(row, f"{place}: {name}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not found:
        raise InputError(f"{path}: holds no numbers")
    return found


def read_reference(path: Path) -> dict[str, Entry]:
    """Return a reference that `accept` wrote; raises InputError with the remedy if it is missing, empty or malformed.

    Raises MarsedlError if it was edited.
    """
    try:
        entries = {name: _entry(entry, f"{path}: {name}") for name, entry in read_entries(path).items()}
    except FileNotFoundError:
        command = f"marsedl accept --numbers TABLE --reference {path}"
        raise InputError(f"{path} is missing; write it with '{command}'") from None
    except (OSError, ValueError, AttributeError, TypeError, KeyError) as error:
        remedy = "restore it, or accept the table again"
        raise InputError(f"{path}: is no reference of numbers ({error}); {remedy}") from None
    if not entries:
        raise InputError(f"{path}: holds no numbers, so nothing would be compared; accept the table again")
    return entries


def _entry(row: Mapping, place: str) -> Entry:
    numbers = []
    for key, text in (("value", row["value"]), ("standard_error", row["standard_error"] or 0.0)):
        try:
            numbers.append(float(text))
        except (TypeError, ValueError):
            raise InputError(f"{place}: {key} must be a number with a decimal point, not '{text}'") from None
    value, error = numbers
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0):
        raise InputError(f"{place}: value and standard_error must be finite, and the error not negative")
    return Entry(value, error, unit=(row["unit"] or "1").strip(), rounding=ROUNDING * abs(value))


def tolerance_of(text: str) -> float:
    """Return how many standard errors "3se", or "3", means; raises InputError if it means none."""
    if not (match := re.fullmatch(r"(\d+(?:\.\d+)?) ?(se)?", text)) or not float(match[1]):
        raise InputError(f"--tolerance {text}: write a number of standard errors, such as 3se")
    return float(match[1])


def accept_numbers(table: Path, path: Path) -> str:
    """Store a table as reference; returns what was written, in a line."""
    found = read_table(table)
    if path.is_dir():
        example = path / "numbers.json"
        raise InputError(f"{path} is a folder; --reference takes a file with --numbers, such as {example}")
    kept = {name: {"value": one.value, "unit": one.unit, "standard_error": one.error} for name, one in found.items()}
    write_text(path, entries_text(kept))
    return f"wrote {path}: {len(found)} numbers of {table}"


def compare_numbers(table: Path, path: Path, count: float) -> bool:
    """Compare a table with its reference; prints what differs, worst first.

    A number may move by some standard errors of the difference, and by rounding. A unit that changes, a number that is
    gone, an exact one that gains a standard error and an error that grows beyond ten times fail, as the table must not
    set its own tolerance; a number that is new is said.
    """
    found, accepted = read_table(table), read_reference(path)
    both = moved(accepted, found, standard_errors(count))
    refused = {one.name: refusal for one in both if one.before and (refusal := _refusal(one))}
    differing = [one for one in both if one.name in refused or (one.before and one.counts)]
    rows = [
        (one.name, _said(one.before), _said(one.after), refused.get(one.name) or _distance(one))
        for one in sorted(differing, key=lambda one: (one.name not in refused, -one.size))
    ]
    notes = [f"{one.name}: new, not guarded before it is accepted" for one in both if not one.before]
    for one in (one for one in both if one.is_on_both and one.after.error > GROWN * one.before.error > 0):
        notes.append(f"{one.name}: its standard error grew from {one.before.error:.2g} to {one.after.error:.2g}")
    limit = f"{count:g} standard errors"
    parts = [f"{table}: {len(accepted)} numbers of {path}, {len(rows)} differ (tolerance: {limit})"]
    if rows:
        parts.append(columns([("name", "accepted", "now", ""), *rows], 2))
    text = "\n".join([*parts, *(f"  note: {note}" for note in notes)])
    print(text)
    summarize(text)
    if rows:
        print(f"if this is meant, run 'marsedl accept --numbers {table} --reference {path}'")
    return not rows


def _said(entry: Entry | None) -> str:
    """A number as a reader would write it."""
    if entry is None:
        return NOT_EVALUATED
    return with_unit(format_number(entry.value, entry.error), entry.unit)


def _distance(one: Moved) -> str:
    """How far a number moved."""
    return f"{one.sigmas:.3g} standard errors apart" if one.error else "it has no standard error"


def _refusal(one: Moved) -> str:
    """Say why a number is refused whatever its value."""
    if not one.after:
        return "it is gone"
    if not one.same_unit:
        return "another unit"
    if one.after.error > 0 == one.before.error:
        return "it was exact"
    return f"its error grew beyond {OUTGROWN:g} times" if one.after.error > OUTGROWN * one.before.error else ""
