"""The committed reference of a paper: its numbers, verdicts, printed values and counterexamples."""

import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import MarsedlError
from marsedl.replication.inputs import CORRECTED

VERDICTS, PUBLISHED, COUNTEREXAMPLES = "verdicts/", "published/", "counterexamples/"
BUILD = "build"  # what the numbers were made from
_DIGEST = ""  # the name, which nothing else has, of the digest of all other entries
MOMENTS = ("root mean square", "mean", "weighted mean", "smallest", "largest")


class CommittedClaim(NamedTuple):
    """A claim with its committed verdict, None if none is committed; `counted` like claims of a build."""

    kind: str
    verdict: str | None
    headline: int | None


def read_reference(root: Path, slug: str, folder: Path | None = None) -> dict[str, dict | str]:
    """Return the reference of a paper, that of a folder if given; raises MarsedlError if it cannot be read."""
    path = reference_file(root, slug, folder)
    try:
        return read_entries(path)
    except FileNotFoundError:
        remedy = f"with '{accept_command(folder)}'" if folder else "with 'marsedl accept' after a full build"
        raise MarsedlError(f"{path} is missing; restore it, or write it {remedy}") from None
    except (OSError, TypeError, ValueError) as error:
        name = path.relative_to(root) if path.is_relative_to(root) else path
        problem = f"cannot be read ({error.strerror})" if isinstance(error, OSError) else f"is not JSON ({error})"
        raise MarsedlError(f"{path}: {problem}; restore it with 'git checkout {name}'") from None


def entries_text(entries: Mapping[str, object]) -> str:
    """Return named entries as JSON, one a line; the last is the digest of all others."""
    lines = [f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items()]
    lines.append(f" {json.dumps(_DIGEST)}: {json.dumps(_digest(entries))}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_entries(path: Path) -> dict:
    """Read what `entries_text` gave; raises MarsedlError if it was edited, OSError or ValueError if it is malformed."""
    entries = dict(json.loads(path.read_text(encoding="utf-8")))
    digest = entries.pop(_DIGEST, None)
    if digest not in (None, _digest(entries)):
        raise MarsedlError(
            f"{path} was edited after 'marsedl accept' wrote it; restore it, or delete and accept it again"
        )
    return entries


def _digest(entries: Mapping[str, object]) -> str:
    return f"sha256 {hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()[:16]}"


def committed_verdicts(root: Path, slug: str) -> dict[str, dict[str, str]]:
    """Return the committed verdicts on a paper's claims, by claim and reading; none if nothing is committed."""
    reference = read_reference(root, slug) if reference_file(root, slug).exists() else {}
    return {name.removeprefix(VERDICTS): entry for name, entry in reference.items() if name.startswith(VERDICTS)}


def with_committed(root: Path, slug: str, printed: Iterable[tuple[str, str, int | None]]) -> list[CommittedClaim]:
    """Return claims of a paper, by id, kind and place among the headline, with their committed verdicts."""
    verdicts = committed_verdicts(root, slug)
    return [CommittedClaim(kind, verdicts.get(name, {}).get(CORRECTED), headline) for name, kind, headline in printed]


def reference_file(root: Path, slug: str, folder: Path | None = None) -> Path:
    """Return the file of a paper's reference: the committed one, or that of a folder."""
    return (folder or root / "data" / "reference") / f"{slug}.json"


def accept_command(folder: Path) -> str:
    """The command that writes a reference of the user's own."""
    return f"marsedl accept --reference {shlex.quote(str(folder))}"
