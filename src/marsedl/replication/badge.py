"""A badge for a page of the project: what came of the printed claims, in the schema of shields.io's endpoint badges."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from marsedl.replication.claims import NUMBERS, STATEMENTS, summary, write_text


def badge(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Count the verdicts on all papers' claims in one line.

    Args:
        rows: dictionaries from `claims.read_claims`.

    Returns:
        The badge. Its colour says nothing: a claim that fails speaks of a paper, not of its replication.

    """
    counts = summary(list(rows))
    numbers, statements = counts[NUMBERS], counts[STATEMENTS]
    message = (
        f"{numbers['reproduced']} of {sum(numbers.values())} printed numbers; "
        f"{statements['holds']} of {sum(statements.values())} statements"
    )
    return {"schemaVersion": 1, "label": "replication", "message": message, "color": "blue"}


def write_badge(rows: Iterable[Mapping[str, Any]], path: str | Path) -> None:
    """Write the badge of some claims as JSON; arguments as for `badge`, and the file."""
    write_text(path, json.dumps(badge(rows), indent=2) + "\n")
