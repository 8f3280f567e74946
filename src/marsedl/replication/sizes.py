"""Where a build of each size lives: sizes do not share files."""

from pathlib import Path

FULL = "full"


def build_folder(root: Path, size: str) -> Path:
    """Return the folder that holds the products of a size: the project's own for the full one, else `build/SIZE`."""
    return root if size == FULL else root / "build" / size
