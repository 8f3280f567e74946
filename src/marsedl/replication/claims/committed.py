"""The committed reference of a paper: its numbers, verdicts, printed values and counterexamples."""

import json
import shlex
from pathlib import Path

from marsedl.replication.errors import MarsedlError

VERDICTS, PUBLISHED, COUNTEREXAMPLES = "verdicts/", "published/", "counterexamples/"
MOMENTS = ("root mean square", "mean", "weighted mean", "smallest", "largest")


def read_reference(root: Path, slug: str, folder: Path | None = None) -> dict[str, dict | str]:
    """Return the reference numbers of a paper; raises MarsedlError if there are none, or if the file is damaged.

    folder: holds the reference; the committed one if not given.
    """
    path = reference_file(root, slug, folder)
    if not path.exists():
        if folder is not None:
            raise MarsedlError(f"{path} is missing; restore it, or write it with '{accept_command(folder)}'")
        raise MarsedlError(f"{path} is missing; restore it, or write it with 'marsedl accept' after a full build")

    def refuse(problem: str) -> MarsedlError:
        name = path.relative_to(root) if path.is_relative_to(root) else path
        return MarsedlError(f"{path}: {problem}; restore it with 'git checkout {name}'")

    try:
        reference = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise refuse(f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise refuse(f"is not JSON ({error})") from None
    if not isinstance(reference, dict):
        raise refuse("holds no numbers by name")
    for name, entry in reference.items():
        if problem := _wrong_in_entry(name, entry):
            raise refuse(f"'{name}' {problem}")
    return reference


def _wrong_in_entry(name: str, entry: object) -> str:
    """What is wrong with an entry of a reference, in words; empty if it has the form of `fingerprints`."""
    if name.startswith((PUBLISHED, COUNTEREXAMPLES)):
        return "" if isinstance(entry, str) else "is not text"
    if not isinstance(entry, dict):
        return "is not a set of keys with values"
    if name.startswith(VERDICTS):
        return ""
    if name.count("/") != 2:
        return "is not a name of three parts"
    numbers = entry.get("numbers")
    if not isinstance(numbers, list) or not all(type(number) in (int, float) for number in numbers):
        return "has no list of numbers under 'numbers'"
    return "" if len(numbers) in (0, len(MOMENTS)) and {"shape", "counts"} <= entry.keys() else "is incomplete"


def committed_verdicts(root: Path, slug: str) -> dict[str, dict[str, str]]:
    """Return the committed verdicts on a paper's claims, by claim and reading; none if nothing is committed."""
    reference = read_reference(root, slug) if reference_file(root, slug).exists() else {}
    return {name.removeprefix(VERDICTS): entry for name, entry in reference.items() if name.startswith(VERDICTS)}


def reference_file(root: Path, slug: str, folder: Path | None = None) -> Path:
    """Return the file of a paper's reference: the committed one, or that of a folder."""
    return (folder or root / "data" / "reference") / f"{slug}.json"


def accept_command(folder: Path) -> str:
    """The command that writes a reference of the user's own."""
    return f"marsedl accept --reference {shlex.quote(str(folder))}"
