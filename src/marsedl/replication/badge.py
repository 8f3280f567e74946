"""A badge for a page of the project: what came of the printed claims, in the schema of shields.io's endpoint badges."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from marsedl.replication.claims import summary, write_text

_CONFIRMED = ("reproduced", "holds")


def badge(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Count the verdicts on all papers' claims in one line.

    Args:
        rows: dictionaries from `claims.read_claims`.

    Returns:
        The badge. Its colour says nothing: a claim that fails speaks of a paper, not of its replication.

    """
    counted = summary(list(rows))["counted"]
    confirmed, total = sum(counted[verdict] for verdict in _CONFIRMED), sum(counted.values())
    message = f"{confirmed} of {total} counted claims reproduce or hold"
    return {"schemaVersion": 1, "label": "replication", "message": message, "color": "blue"}


def write_badge(rows: Iterable[Mapping[str, Any]], path: str | Path) -> None:
    """Write the badge of some claims as JSON; arguments as for `badge`, and the file."""
    write_text(path, json.dumps(badge(rows), indent=2) + "\n")
