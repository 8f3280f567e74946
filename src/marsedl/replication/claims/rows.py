"""The claims of a build: files, tables and counts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from marsedl.replication.claims.claim import UNEXPLAINED, Claim, Counterexample
from marsedl.replication.claims.numbers import NOT_EVALUATED, flatten, format_lines, unit_of
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.errors import ArtifactError
from marsedl.replication.files import write_json, write_text
from marsedl.replication.records.tables import Column, csv_text, markdown, table

if TYPE_CHECKING:
    import pandas as pd

# What jobs of claims hand on, as types of `write_as` and `read_as`.
Evaluations = dict[str, dict[str, Evaluation | None]]  # by reading and claim
Counterexamples = dict[str, Counterexample | None]  # by claim


def write_claims(rows: Iterable[Claim], path: str | Path) -> None:
    """Write claims as JSON, papers in alphabetical order, the claims of a paper in the order given.

    Raises ArtifactError if a number is not finite; a good file is then left alone.
    """
    write_json(sorted(rows, key=lambda row: row.paper), path)


def read_claims(path: str | Path) -> list[Claim]:
    """Read what `write_claims` wrote; raises ArtifactError if the file is missing, damaged, or no list of claims."""
    return read_as(list[Claim], path)


def write_as(kind: Any, value: Any, path: str | Path) -> None:
    """Write what `read_as` reads as a type; numbers that are not finite stay so."""
    adapter = TypeAdapter(kind, config=ConfigDict(ser_json_inf_nan="constants"))
    write_text(path, adapter.dump_json(value, indent=1).decode() + "\n")


def read_as(kind: Any, path: str | Path) -> Any:
    """Read what a job of claims wrote, as a type; raises ArtifactError if it is missing, damaged, or of another one."""
    try:
        return TypeAdapter(kind).validate_json(Path(path).read_bytes())
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read ({error.strerror}); run 'snakemake claims'") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        problem = ": ".join(filter(None, [".".join(map(str, first["loc"])), first["msg"]]))
        raise ArtifactError(f"{path}: {problem}; delete the file and run 'snakemake claims'") from None


def claims_table(rows: Iterable[Claim]) -> pd.DataFrame:
    """Return claims as a long table: a row for each component of a claim in each reading.

    The columns are paper, claim, component (its place, counted from 1: "[2]", "[2,1]" in a matrix; none of a single
    number), reading, value, standard_error, printed, verdict (on this component in that reading), claim_verdict (on the
    whole claim), trials, unit (of value, standard error and printed). Of statements, value and printed are 1 for true
    and 0 for false.
    """
    cells = []
    for row in rows:
        printed = flatten(row.printed)
        for reading, result in row.readings.items():
            values, errors, verdicts = map(flatten, (result.value, result.standard_error, result.components))
            for place in max((values, printed), key=len):
                numbers = (part.get(place, part.get(())) for part in (values, errors, printed))
                cells.append(
                    (
                        row.paper,
                        row.id,
                        f"[{','.join(str(index + 1) for index in place)}]" if place else None,
                        reading,
                        *(None if number is None else float(number) for number in numbers),
                        verdicts.get(place, result.verdict) if place else result.verdict,
                        result.verdict,
                        result.trials,
                        unit_of(row, place),
                    )
                )
    names = ("paper", "claim", "component", "reading", "value", "standard_error", "printed", "verdict", "claim_verdict")
    return table(cells, dict.fromkeys((*names, "trials", "unit"), Column()))


def write_table_of_claims(rows: Sequence[Claim], long: str | Path, wide: str | Path) -> None:
    """Write a paper's claims as a table: `long` with a row for each number (CSV), `wide` for each claim (Markdown).

    The wide one is for readers: what is printed, every reading's value and verdict, the reason.
    """
    write_text(long, csv_text(claims_table(rows)))
    shown = ["paper", "id", "where", "quantity", "unit", "kind"]
    readings = list(rows[0].readings)
    # not "printed", which is the name of a reading
    header = [*shown, "in the paper", *(text for name in readings for text in (name, f"{name} verdict"))]
    lines = [[*header, "verdict", "reason"]]
    for row in rows:
        cells = [getattr(row, key) for key in shown]
        cells.append("; ".join(format_lines(row.printed, resolution=row.resolution)))
        for name in readings:
            cells += ["; ".join(format_result(row, name)), row.readings[name].verdict or NOT_EVALUATED]
        lines.append([*cells, row.verdict, row.reason])
    write_text(wide, markdown(lines))


def format_result(row: Claim, reading: str) -> list[str]:
    """Write what a reading gives for a claim; without a standard error, with two digits more than the paper prints."""
    result = row.readings.get(reading)
    if result is None or result.value is None:
        return ["not finite"] if result and result.verdict == "differs" else [NOT_EVALUATED]
    finer = row.resolution
    if row.kind == "input":
        # What another value of an input is must be seen, however few digits the paper prints.
        finer = finer if result.verdict == "as_stated" else None
    elif finer is not None:
        finer = [0.01 * size for size in finer] if isinstance(finer, list) else 0.01 * finer
    return format_lines(result.value, result.standard_error, finer)


def unexplained(rows: Iterable[Claim]) -> list[str]:
    """Return the ids of claims that differ or fail without an erratum or a choice."""
    return [row.id for row in rows if row.reason == UNEXPLAINED]
