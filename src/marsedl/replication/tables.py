"""Small tables as CSV and Markdown."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from marsedl.replication.claims import write_text


def write_table(rows: Sequence[Sequence[str]], csv_path: str | Path, markdown_path: str | Path) -> None:
    """Write rows of text, the first one the header, as CSV and as Markdown."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(csv_path, text.getvalue())
    lines = ["| " + " | ".join(str(cell).replace("|", r"\|") for cell in row) + " |" for row in rows]
    lines.insert(1, "|" + " --- |" * len(rows[0]))
    write_text(markdown_path, "\n".join(lines) + "\n")


def read_table(csv_path: str | Path) -> list[list[str]]:
    """Read back the rows of `write_table`."""
    with Path(csv_path).open(newline="", encoding="utf-8") as stream:
        return list(csv.reader(stream))
