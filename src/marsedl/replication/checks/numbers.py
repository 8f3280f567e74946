"""The gate for any table of numbers: the columns name, value, unit and standard_error against a stored reference."""

import csv
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.claims.committed import entries_text, read_entries
from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.terminal import columns, summarize

ROUNDING = 1e-6  # of the accepted value: no tolerance is smaller
GROWN, OUTGROWN = 2.0, 10.0  # a standard error widens the tolerance: growth beyond the first is said, the second fails


class Entry(NamedTuple):
    """A number with its unit and standard error, 0 if it is exact."""

    value: float
    unit: str
    standard_error: float

    def __str__(self) -> str:
        """Return it as a reader would write it."""
        error = f" ± {self.standard_error:.2g}" if self.standard_error else ""
        return f"{self.value:.6g}{error} {self.unit}".removesuffix(" 1").rstrip()


def read_table(path: Path) -> dict[str, Entry]:
    """Return the numbers of a CSV file by name; raises InputError with file and line if it is malformed."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            if missing := [name for name in ("name", *Entry._fields) if name not in (rows.fieldnames or ())]:
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
    return Entry(value, (row["unit"] or "1").strip(), error)


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
    write_text(path, entries_text({name: entry._asdict() for name, entry in found.items()}))
    return f"wrote {path}: {len(found)} numbers of {table}"


def compare_numbers(table: Path, path: Path, standard_errors: float) -> bool:
    """Compare a table with its reference; prints what differs, worst first.

    A number may move by some standard errors of the difference, and by rounding. A unit that changes, a number that is
    gone, an exact one that gains a standard error and an error that grows beyond ten times fail, as the table must not
    set its own tolerance; a number that is new is said.
    """
    found, accepted, moved, notes = read_table(table), read_reference(path), [], []
    for name, old in accepted.items():
        new = found.get(name)
        if refused := _refusal(old, new):
            moved.append((math.inf, (name, str(old), str(new or "–"), refused)))
            continue
        error, floor = math.hypot(old.standard_error, new.standard_error), ROUNDING * abs(old.value)
        apart, far = abs(new.value - old.value), max(standard_errors * error, floor)
        if apart > far:
            share = f"{apart / error:.3g} standard errors apart" if error else "it has no standard error"
            moved.append((apart / far if far else math.inf, (name, str(old), str(new), share)))
        if new.standard_error > GROWN * old.standard_error > 0:
            notes.append(f"{name}: its standard error grew from {old.standard_error:.2g} to {new.standard_error:.2g}")
    notes += [f"{name}: new, not guarded before it is accepted" for name in found if name not in accepted]
    limit = f"{standard_errors:g} standard errors"
    parts = [f"{table}: {len(accepted)} numbers of {path}, {len(moved)} differ (tolerance: {limit})"]
    if moved:
        rows = [row for _, row in sorted(moved, key=lambda one: -one[0])]
        parts.append(columns([("name", "accepted", "now", ""), *rows], 2))
    text = "\n".join([*parts, *(f"  note: {note}" for note in notes)])
    print(text)
    summarize(text)
    if moved:
        print(f"if this is meant, run 'marsedl accept --numbers {table} --reference {path}'")
    return not moved


def _refusal(old: Entry, new: Entry | None) -> str:
    """Say why a number is refused whatever its value."""
    if new is None:
        return "it is gone"
    if new.unit != old.unit:
        return "another unit"
    if new.standard_error > 0 == old.standard_error:
        return "it was exact"
    return f"its error grew beyond {OUTGROWN:g} times" * (new.standard_error > OUTGROWN * old.standard_error)
