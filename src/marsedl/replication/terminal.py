"""Text for a terminal: tables fit its width, and nothing in a file acts on it."""

import os
import shutil
import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

UNLIMITED = 10**6  # columns of a pipe or a file: one line a row, so that `grep` finds whole rows
NARROWEST = 8  # of a column that is made narrower


def printable(text: object) -> str:
    """Return a text with all control characters but line breaks escaped as in Python, such as \\x1b."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in str(text))


def summarize(text: str, folded: str = "") -> None:
    """Append a text to the summary of a GitHub action, if it runs in one; folded: what is shown after a click."""
    if path := os.environ.get("GITHUB_STEP_SUMMARY"):
        fold = f"\n<details><summary>all of it</summary>\n\n```\n{folded}\n```\n</details>\n" if folded else ""
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(f"```\n{printable(text)}\n```\n{fold}")


def columns(rows: Sequence[Sequence[object]], indent: int = 0, *, wrap: bool = True, width: int | None = None) -> str:
    """Lay out rows of equal length as aligned columns; the first keeps its width, the widest of the others give way.

    indent: spaces before each line; wrap: break what is too long over several lines, otherwise it is cut off
    width: of the whole; that of the terminal unless given, without limit if the output goes elsewhere
    """
    if not rows:
        return ""
    width = width or shutil.get_terminal_size((UNLIMITED, 0)).columns
    cells = [[" ".join(str(cell).split("\n")) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    free = width - indent - 2 * (len(widths) - 1)
    while sum(widths) > free and (wide := [i for i in range(1, len(widths)) if widths[i] > NARROWEST]):
        widths[max(wide, key=widths.__getitem__)] -= 1
    lines = []
    for row in cells:
        parts = [_wrapped(cell, size, wrap) for cell, size in zip(row, widths, strict=True)]
        for line in zip_longest(*parts, fillvalue=""):
            padded = "  ".join(part.ljust(size) for part, size in zip(line, widths, strict=True))
            lines.append((" " * indent + padded).rstrip())
    return "\n".join(lines)


def _wrapped(cell: str, width: int, wrap: bool) -> list[str]:
    """A cell as lines of at most a width."""
    if len(cell) <= width:
        return [cell]
    return textwrap.wrap(cell, width) if wrap else [f"{cell[: width - 1].rstrip()}…"]
