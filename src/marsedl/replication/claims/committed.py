"""The committed reference of a paper: its numbers, verdicts, printed values and counterexamples."""

import json
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import MarsedlError
from marsedl.replication.inputs import CORRECTED

VERDICTS, PUBLISHED, COUNTEREXAMPLES = "verdicts/", "published/", "counterexamples/"
BUILD = "build"  # what the numbers were made from
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
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        remedy = f"with '{accept_command(folder)}'" if folder else "with 'marsedl accept' after a full build"
        raise MarsedlError(f"{path} is missing; restore it, or write it {remedy}") from None
    except (OSError, TypeError, ValueError) as error:
        name = path.relative_to(root) if path.is_relative_to(root) else path
        problem = f"cannot be read ({error.strerror})" if isinstance(error, OSError) else f"is not JSON ({error})"
        raise MarsedlError(f"{path}: {problem}; restore it with 'git checkout {name}'") from None


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
