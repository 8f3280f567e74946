"""What the report says, before it is written: papers, readings, inputs, figures, tables, errata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marsedl.replication.catalogue import Erratum
from marsedl.replication.closeups import CloseUp


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
class PaperReport:
    """All that the report says about one paper.

    `claims` are rows of `claims.collect`, `verdicts` the target that judges them again. `question` is what the paper
    asks, `in_short` sentences on what came out, `picture` the name of the figure that shows it. `run_times`, `solvers`
    and `provenance` are rows of text, the first one the header.
    """

    slug: str
    title: str
    citation: str
    claims: Sequence[Mapping[str, Any]]
    readings: Sequence[ReadingEntry]
    inputs: Sequence[InputEntry] = ()
    figures: Sequence[FigureEntry] = ()
    tables: Sequence[TableEntry] = ()
    errata: Sequence[Erratum] = ()
    verdicts: str = ""
    closeups: Sequence[CloseUp] = ()
    run_times: Sequence[Sequence[str]] = ()
    solvers: Sequence[Sequence[str]] = ()
    provenance: Sequence[Sequence[str]] = ()
    authors: str = ""
    question: str = ""
    in_short: Sequence[str] = ()
    picture: str = ""


@dataclass(frozen=True)
class Comparison:
    """Figures and tables on all papers together."""

    figures: Sequence[FigureEntry]
    tables: Sequence[TableEntry]
    slug: str = "comparison"


def is_assumed(value: InputValue) -> bool:
    """Whether an input's source says that nothing printed gives it."""
    return value.source.startswith("assumed")
