"""Files that are written whole or not at all."""

import json
import os
from pathlib import Path
from typing import Any

from marsedl.replication.errors import ArtifactError


def write_json(value: Any, path: str | Path) -> None:
    """Write plain values and pydantic models as JSON; raises ArtifactError for a number that is not finite."""
    try:
        text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False, default=lambda part: part.model_dump())
    except ValueError as error:
        raise ArtifactError(f"{path}: a number is not finite: {error}") from error
    write_text(path, text + "\n")


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text, as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file under a temporary name and rename it, so that a good file is never left half replaced.

    Raises OSError naming the file.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
