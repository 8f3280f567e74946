"""What an artifact is made from: its recipe, so that one which was made from something else is not taken for it.

A recipe holds `inputs` and `options`, as JSON has them; `code` (digests) and `libraries` (versions); and under `needs`
the digests of the recipes of the artifacts that it is made from, so that it stands for all before it.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from marsedl.replication.errors import shown
from marsedl.replication.files import write_text

# What artifacts look like and what jobs do around the science, none of which the digests of code see. Raise it with an
# edit of `fingerprints.MACHINERY` that changes a product: everything is then made again.
FORMAT = 2
NAMED_CHANGES = 3  # at most this many differing inputs are listed


def recipe_digest(recipe: Mapping[str, Any]) -> str:
    """Short digest of a recipe."""
    return hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]


def recipe_changes(stored: Mapping[str, Any], recipe: Mapping[str, Any]) -> Iterator[str]:
    """Say what differs between a recipe that was kept, perhaps not all of it, and another."""
    for key in ("inputs", "options"):
        old, new = stored.get(key, {}), json.loads(json.dumps(recipe[key]))
        names = sorted(name for name in {*old, *new} if old.get(name) != new.get(name))
        yield from (f"{name} is {shown(old.get(name))}, not {shown(new.get(name))}" for name in names[:NAMED_CHANGES])
        if len(names) > NAMED_CHANGES:
            yield f"{len(names) - NAMED_CHANGES} more {key}"
    if stored.get("code") != recipe["code"]:
        yield "other code"
    old, new = (str(side.get("libraries", "")).split(", ") for side in (stored, recipe))
    gone, added = (", ".join(item for item in one if item not in other) for one, other in ((old, new), (new, old)))
    if gone or added:
        yield f"{shown(gone)} among the libraries" if gone else f"no {shown(added)} among the libraries"
    old, new = stored.get("needs", {}), recipe["needs"]
    if changed_needs := sorted(name for name in new if old.get(name) != new[name]):
        yield f"another {', '.join(changed_needs[:NAMED_CHANGES])}"


def file_digest(path: Path) -> str:
    """Short digest of the bytes of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def write_record(record: str | Path, digests: Iterable[str], products: Iterable[str]) -> None:
    """Record what the products of a job are made from: the digests of recipes, then each file with its own.

    The first digest is that of the products' recipe; those behind it are of recipes that give the same to others, see
    `Products.record`.
    """
    lines = [" ".join(digests), *(f"{file_digest(Path(path))} {path}" for path in products)]
    write_text(record, "\n".join(lines) + "\n")


def read_record(record: Path) -> tuple[list[str], dict[str, str]]:
    """Return what `write_record` recorded: digests of recipes, and of files by their paths."""
    first, *others = record.read_text(encoding="utf-8").splitlines() or [""]
    return first.split(), {path: digest for digest, _, path in (line.partition(" ") for line in others)}
