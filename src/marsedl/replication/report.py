"""The report: one HTML file that needs no network and has the same bytes in every build."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marsedl.replication.claims import (
    COUNTED_VERDICTS,
    LISTED_VERDICTS,
    REFUTED_VERDICTS,
    format_lines,
    format_result,
    reading_names,
    summary,
    unexplained,
    write_text,
)
from marsedl.replication.closeups import CloseUp
from marsedl.replication.errors import ArtifactError, InputError, nearest

_TEMPLATES = Path(__file__).parent / "templates"
_ENVIRONMENT_KEYS = ("size", "citation", "rebuild", "versions", "digests", "benchmarks", "machines", "margins")
_CAUSES = 3  # errata of a paper that the overview names
_COLOURS = 256  # of an embedded figure: all that a palette holds
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
_KEYS = {  # how each kind of close-up is used
    "scatter": "Choose quantities, flights and the size of the ellipses above the plot. Point at a trial, or step"
    " through them with N and P; arrow keys move, + and − enlarge and shrink, 0 returns.",
    "tube": "Drag to turn it, or use the arrow keys; + and − enlarge and shrink, 0 returns, N and P go from slice to"
    " slice.",
    "histories": "Choose a quantity above the plot, and show or hide its curves; the left and right arrow keys step"
    " through the iterations, whose values stand below.",
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
    """A figure: its PNG, caption and alternative text; of a figure of the paper also what the paper says of it.

    `files` are relative paths to name, not to open; the first is the target that rebuilds it. `claims` are the ids of
    the paper's claims about it.
    """

    name: str
    image: Path
    caption: str
    alt: str = ""
    files: tuple[str, ...] = ()
    beyond: bool = False  # not a figure of the paper
    described: str = ""
    claims: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableEntry:
    """A generated table; the first row is its header. `files` as of a figure."""

    name: str
    caption: str
    rows: Sequence[Sequence[str]]
    files: tuple[str, ...] = ()
    beyond: bool = False  # not a table of the paper


@dataclass(frozen=True)
class ErratumEntry:
    """A slip of the paper: what is printed, what shows it to be wrong, what is used."""

    id: str
    printed: str
    evidence: str
    used: str


@dataclass(frozen=True)
class PaperReport:
    """All that the report says about one paper.

    `claims` are rows of `claims.collect`, `verdicts` the target that judges them again. `run_times`, `solvers` and
    `provenance` are rows of text, the first one the header.
    """

    slug: str
    title: str
    citation: str
    claims: Sequence[Mapping[str, Any]]
    readings: Sequence[ReadingEntry]
    inputs: Sequence[InputEntry] = ()
    figures: Sequence[FigureEntry] = ()
    tables: Sequence[TableEntry] = ()
    errata: Sequence[ErratumEntry] = ()
    verdicts: str = ""
    closeups: Sequence[CloseUp] = ()
    run_times: Sequence[Sequence[str]] = ()
    solvers: Sequence[Sequence[str]] = ()
    provenance: Sequence[Sequence[str]] = ()


@dataclass(frozen=True)
class Comparison:
    """Figures and tables on all papers together."""

    figures: Sequence[FigureEntry]
    tables: Sequence[TableEntry]
    slug: str = "comparison"


def build_report(
    output: str | Path,
    papers: Sequence[PaperReport],
    environment: Mapping[str, Any],
    comparison: Comparison | None = None,
) -> None:
    """Write the report of all papers as one self-contained HTML file.

    Args:
        output: the HTML file; replaced as a whole or not at all.
        papers: what to say of each paper, in this order.
        comparison: what to say of all of them together.
        environment: what holds for all of them; every key may be left out:
            `size` (text), `citation` (text), `rebuild` (list of commands), `versions` (text by package), `digests`
            (text by file), and the tables `benchmarks`, `machines`, `margins` (rows of text, the first one the header).

    Raises:
        InputError: an unknown key, a paper or name given twice, or an input without a value in a listed reading.
        ArtifactError: a figure is missing or not a PNG image.

    """
    import jinja2  # slow to import, and only needed here

    for key in environment:
        if key not in _ENVIRONMENT_KEYS:
            raise InputError(f"report: unknown key {key!r}; {nearest(key, _ENVIRONMENT_KEYS)}")
    _refuse_repeats("paper", [paper.slug for paper in papers])
    if comparison is not None:
        _refuse_repeats("comparison", [entry.name for entry in comparison.figures])
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["words"] = lambda verdict: verdict.replace("_", " ")
    templates.filters["json"] = _script_json
    templates.filters["code"] = _with_code
    templates.tests["assumed"] = is_assumed
    page = templates.get_template("report.html.j2").render(
        papers=[_paper(paper) for paper in papers],
        comparison=comparison and {"entry": comparison, "figures": _with_images(comparison.figures)},
        readings=list(dict.fromkeys(name for paper in papers for name in reading_names(paper.claims))),
        total=summary([row for paper in papers for row in paper.claims]),
        unexplained=[(paper.slug, name) for paper in papers for name in unexplained(paper.claims)],
        counted=COUNTED_VERDICTS,
        listed=LISTED_VERDICTS,
        marks=_MARKS,
        meanings=_MEANINGS,
        keys=_KEYS,
        most=_CAUSES,
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
    _refuse_repeats(f"{paper.slug}: close-up", [closeup.name for closeup in paper.closeups])
    for reading in paper.readings:
        if reading.based_on is not None and reading.based_on not in names:
            raise InputError(f"report: {paper.slug}: reading {reading.name} is based on unknown {reading.based_on!r}")
        for entry in paper.inputs:
            if reading.name not in entry.values:
                raise InputError(f"report: {paper.slug}: input {entry.name} has no value in reading {reading.name}")
    columns = reading_names(paper.claims)
    rows = [_claim(row, columns) for row in paper.claims]
    verdicts = {row["id"]: row["verdict"] for row in paper.claims}
    named_by = {
        erratum.id: [row["id"] for row in paper.claims if erratum.id in (row["errata"] or ())]
        for erratum in paper.errata
    }
    for entry in paper.figures:
        for claim in entry.claims:
            if claim not in verdicts:
                raise InputError(f"report: {paper.slug}: figure {entry.name} is about unknown claim {claim!r}")
    return {
        "paper": paper,
        "columns": columns,
        "claims": [row for row in rows if row["row"]["verdict"] in COUNTED_VERDICTS],
        "stated": [row for row in rows if row["row"]["verdict"] in LISTED_VERDICTS],
        "summary": summary(paper.claims),
        "by_reading": {name: summary(paper.claims, name) for name in columns},
        "bases": {reading.name: reading.based_on for reading in paper.readings},
        "differences": {reading.name: _differences(reading, paper.inputs) for reading in paper.readings},
        "figures": _with_images(paper.figures),
        "verdicts": verdicts,
        "causes": _causes(paper.errata, named_by, verdicts),
        "named_by": named_by,
        "assumed": {
            reading.name: sum(is_assumed(entry.values[reading.name]) for entry in paper.inputs)
            for reading in paper.readings
        },
    }


def _causes(errata: Sequence[ErratumEntry], named_by: Mapping[str, list[str]], verdicts: Mapping[str, str]) -> list:
    """Errata that stand behind claims which differ or fail, with these claims: those behind most of them first."""
    causes = [(e, [claim for claim in named_by[e.id] if verdicts[claim] in REFUTED_VERDICTS]) for e in errata]
    return sorted((cause for cause in causes if cause[1]), key=lambda cause: -len(cause[1]))


def is_assumed(value: InputValue) -> bool:
    """Whether an input's source says that nothing printed gives it."""
    return value.source.startswith("assumed")


def _with_code(text: str) -> Any:
    """The text as HTML, with what stands between backticks as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _script_json(data: Any) -> str:
    """JSON that may stand inside of a <script>: no text in it can end the element."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _with_images(figures: Sequence[FigureEntry]) -> list[tuple[FigureEntry, str, int, int]]:
    """Return each figure with its image as base64 text, width and height in pixels."""
    return [(figure, *_inline_png(figure.image)) for figure in figures]


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
    from PIL import Image, UnidentifiedImageError  # slow to import, and only needed here

    try:
        content = Path(path).read_bytes()
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            smaller = _palette_png(image)
            size = image.size
    except UnidentifiedImageError as error:
        raise ArtifactError(f"{path}: not a PNG image") from error
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise ArtifactError(f"{path}: figure cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return base64.b64encode(min(content, smaller, key=len)).decode("ascii"), *size


def _palette_png(image: Any) -> bytes:
    """The image as a PNG with a palette, which is a third of the size; transparent ones as they are.

    Maximum coverage keeps rare colours, as those of thin lines; one pass of k-means (the threshold ends it) then moves
    each colour to the mean of its pixels.
    """
    from PIL import Image

    if "A" in image.getbands() and image.getchannel("A").getextrema() != (255, 255):
        reduced = image
    else:
        reduced = image.convert("RGB").quantize(
            _COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=image.width * image.height, dither=Image.Dither.NONE
        )
    content = io.BytesIO()
    reduced.save(content, "PNG", compress_level=6)  # the best takes six times as long, for a tenth of the size
    return content.getvalue()


def _refuse_repeats(what: str, names: Sequence[str]) -> None:
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        raise InputError(f"report: {what} given twice: {', '.join(repeated)}")
