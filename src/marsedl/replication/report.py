"""The report: one HTML file that needs no network and has the same bytes in every build."""

from __future__ import annotations

import base64
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from marsedl.replication.claims import (
    COUNTED_VERDICTS,
    LISTED_VERDICTS,
    format_lines,
    format_result,
    reading_names,
    summary,
    write_text,
)
from marsedl.replication.errors import ArtifactError, InputError
from marsedl.replication.inputs import nearest

_TEMPLATES = Path(__file__).parent / "templates"
_ENVIRONMENT_KEYS = ("size", "citation", "rebuild", "notes", "versions", "digests", "benchmarks", "verify")
_MARKS = {
    "reproduced": "✓",
    "holds": "✓",
    "close": "≈",
    "differs": "✗",
    "fails": "✗",
    "undetermined": "?",
    "as_stated": "=",
    "not_as_stated": "≠",
    "quoted": "“”",
}
_MEANINGS = {
    "reproduced": "within the printed rounding or, for Monte Carlo results, within three combined standard errors",
    "close": "within a tolerance that was stated beforehand, with its reason",
    "differs": "neither of these; an erratum or an input that the paper withholds is named",
    "holds": "a computed test decides as the paper states",
    "fails": "a computed test decides against the paper; an erratum or a withheld input is named",
    "undetermined": "the paper's own problem does not fix the number",
    "as_stated": "an input; the reading ‘printed’ uses it as the paper states it (not counted)",
    "not_as_stated": "an input that the reading uses otherwise (not counted)",
    "quoted": "literature quoted by the paper (not evaluated, not counted)",
}


@dataclass(frozen=True)
class ReadingEntry:
    """A reading: what it is for and what it starts from."""

    name: str
    description: str
    based_on: str | None = None
    frozen: bool = False


@dataclass(frozen=True)
class InputValue:
    """An input in one reading, as text, and where it comes from."""

    value: str
    source: str


@dataclass(frozen=True)
class InputEntry:
    """One input in all readings; the readings' differences are read off here."""

    name: str
    unit: str
    values: Mapping[str, InputValue]  # by reading
    meaning: str = ""


@dataclass(frozen=True)
class FigureEntry:
    """A figure: its PNG, caption and alternative text; `files` are relative paths to name, not to open."""

    name: str
    image: Path
    caption: str
    alt: str = ""
    files: tuple[str, ...] = ()
    beyond: bool = False  # not a figure of the paper


@dataclass(frozen=True)
class TableEntry:
    """A generated table; the first row is its header."""

    name: str
    caption: str
    rows: Sequence[Sequence[str]]
    files: tuple[str, ...] = ()
    beyond: bool = False  # not a table of the paper


@dataclass(frozen=True)
class ErratumEntry:
    """A slip of the paper: where, what is printed, what shows it to be wrong, what is used."""

    id: str
    printed: str
    evidence: str
    used: str
    where: str = ""


@dataclass(frozen=True)
class PaperReport:
    """All that the report says about one paper; `claims` are rows of `claims.collect`."""

    slug: str
    title: str
    citation: str
    claims: Sequence[Mapping[str, Any]]
    readings: Sequence[ReadingEntry]
    inputs: Sequence[InputEntry] = ()
    figures: Sequence[FigureEntry] = ()
    tables: Sequence[TableEntry] = ()
    errata: Sequence[ErratumEntry] = ()
    summary: str = ""
    notes: Sequence[str] = field(default=())


def build_report(output: str | Path, papers: Sequence[PaperReport], environment: Mapping[str, Any]) -> None:
    """Write the report of all papers as one self-contained HTML file.

    Args:
        output: the HTML file; replaced as a whole or not at all.
        papers: what to say of each paper, in this order.
        environment: what holds for all of them; every key may be left out:
            `size` (text), `citation` (text), `rebuild` (list of commands), `notes` (list of text),
            `versions` (text by package), `digests` (text by file), and the tables `benchmarks` and `verify`
            (lists of rows of text, the first one the header).

    Raises:
        InputError: an unknown key, a paper or name given twice, or an input without a value in a listed reading.
        ArtifactError: a figure is missing or not a PNG image.

    """
    import jinja2  # slow to import, and only needed here

    for key in environment:
        if key not in _ENVIRONMENT_KEYS:
            raise InputError(f"report: unknown key {key!r}; {nearest(key, _ENVIRONMENT_KEYS)}")
    _refuse_repeats("paper", [paper.slug for paper in papers])
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["words"] = lambda verdict: verdict.replace("_", " ")
    page = templates.get_template("report.html.j2").render(
        papers=[_paper(paper) for paper in papers],
        total=summary([row for paper in papers for row in paper.claims]),
        counted=COUNTED_VERDICTS,
        listed=LISTED_VERDICTS,
        marks=_MARKS,
        meanings=_MEANINGS,
        **{key: environment.get(key) for key in _ENVIRONMENT_KEYS},
    )
    write_text(output, page.strip() + "\n")


def _paper(paper: PaperReport) -> dict[str, Any]:
    """Prepare what the template shows of one paper."""
    names = [reading.name for reading in paper.readings]
    _refuse_repeats(f"{paper.slug}: reading", names)
    _refuse_repeats(f"{paper.slug}: claim", [row["id"] for row in paper.claims])
    _refuse_repeats(f"{paper.slug}: figure or table", [entry.name for entry in (*paper.figures, *paper.tables)])
    _refuse_repeats(f"{paper.slug}: erratum", [erratum.id for erratum in paper.errata])
    for reading in paper.readings:
        if reading.based_on is not None and reading.based_on not in names:
            raise InputError(f"report: {paper.slug}: reading {reading.name} is based on unknown {reading.based_on!r}")
        for entry in paper.inputs:
            if reading.name not in entry.values:
                raise InputError(f"report: {paper.slug}: input {entry.name} has no value in reading {reading.name}")
    columns = reading_names(paper.claims)
    rows = [_claim(row, columns) for row in paper.claims]
    return {
        "paper": paper,
        "columns": columns,
        "claims": [row for row in rows if row["row"]["verdict"] in COUNTED_VERDICTS],
        "stated": [row for row in rows if row["row"]["verdict"] in LISTED_VERDICTS],
        "summary": summary(paper.claims),
        "by_reading": {name: summary(paper.claims, name) for name in columns},
        "bases": {reading.name: reading.based_on for reading in paper.readings},
        "differences": {reading.name: _differences(reading, paper.inputs) for reading in paper.readings},
        "figures": [(figure, *_inline_png(figure.image)) for figure in paper.figures],
        "errata": {erratum.id for erratum in paper.errata},
    }


def _claim(row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """Write out a claim's numbers."""
    results = []
    for name in columns:
        result = row["readings"].get(name) or {"verdict": None, "evidence": "", "trials": None, "z": None}
        results.append({**result, "reading": name, "lines": format_result(row, name), "z": _deviation(result["z"])})
    return {
        "row": row,
        "printed": format_lines(row["printed"], resolution=row["resolution"]),
        "results": results,
        "evidence": next((result["evidence"] for result in results if result["reading"] == row["reading"]), ""),
    }


def _deviation(z: Mapping[str, Any] | None) -> str:
    if z is None or z["largest"] is None:
        return ""
    place = f" (component {', '.join(map(str, z['component']))})" if z["component"] else ""
    return f"z = {z['largest']:+.1f}{place}"


def _differences(
    reading: ReadingEntry, inputs: Sequence[InputEntry]
) -> list[tuple[InputEntry, InputValue, InputValue]]:
    """Return the inputs whose value differs from that of the reading's base: the input, the base's value, its own."""
    if reading.based_on is None:
        return []
    pairs = [(entry, entry.values[reading.based_on], entry.values[reading.name]) for entry in inputs]
    return [(entry, base, own) for entry, base, own in pairs if base.value != own.value]


def _inline_png(path: Path) -> tuple[str, int, int]:
    """Return a PNG as base64 text with its width and height in pixels."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ArtifactError(f"{path}: figure cannot be read: {error.strerror}") from error
    if content[:8] != b"\x89PNG\r\n\x1a\n" or content[12:16] != b"IHDR" or len(content) < 24:
        raise ArtifactError(f"{path}: not a PNG image")
    width, height = struct.unpack(">II", content[16:24])
    return base64.b64encode(content).decode("ascii"), width, height


def _refuse_repeats(what: str, names: Sequence[str]) -> None:
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        raise InputError(f"report: {what} given twice: {', '.join(repeated)}")
