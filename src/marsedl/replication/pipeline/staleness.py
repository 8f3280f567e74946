"""Which products of a build are old: made from something else than they would be made from now, or edited since.

An artifact keeps its recipe in its provenance. For all else, the job writes the digest of the recipe to a file below
`RECORDS` when it ends, with those of its products as it wrote them. So a build knows what it was made from wherever it
is copied, and Snakemake's own records may be lost.
"""

from collections.abc import Iterable
from pathlib import Path

from marsedl.replication.errors import ArtifactError, StaleError
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.sharing import ARTIFACTS
from marsedl.replication.records.recipes import file_digest, read_record, recipe_changes


def reason(products: Products, path: str, folder: Path, *, beside: bool = False) -> str:
    """Say why a product of the build in a folder is not what would be made now; raises ArtifactError if damaged.

    beside: one that was made beside a user's own readings is good, too.
    """
    if not (folder / path).exists():
        return "is missing"
    if path.startswith(ARTIFACTS):
        from marsedl.replication.records.store import PROVENANCE, opened, provenance

        with opened(folder / path) as file:  # not all of its provenance, which takes long to read
            if file[PROVENANCE].attrs.get("recipe") == products.digest(path):
                return ""
        changes = recipe_changes(provenance(folder / path), products.job(path).params)
        return f"was made from something else: {'; '.join(changes)}"
    name, (digest, *_) = products.record(path)
    if not (folder / name).exists():
        return "has no record of what it was made from"
    recipes, files = read_record(folder / name)
    if digest not in recipes[: None if beside else 1]:
        return "was made from other inputs or code"
    for file, written in files.items():
        if (folder / file).exists() and file_digest(folder / file) != written:
            which = "" if file == path else f"goes with {file}, which "
            return f"{which}was edited after its job wrote it"
    return ""


def is_stale(products: Products, path: str, folder: Path) -> bool:
    """Whether a product is there but is not what would be made now; a damaged one speaks for itself when read."""
    try:
        return (folder / path).exists() and bool(reason(products, path, folder))
    except ArtifactError:
        return False


def changed_apart_from_needs(products: Products, path: str, folder: Path) -> str:
    """Say what has changed since an artifact was made, but for the artifacts that it needs."""
    from marsedl.replication.records.store import provenance

    return "; ".join(recipe_changes(provenance(folder / path), {**products.job(path).params, "needs": {}}))


def check(products: Products, targets: Iterable[str], folder: Path, command: str) -> None:
    """Raise StaleError, which names the command to run, if a product or one behind it is not up to date."""
    for path in products.behind(targets):
        if why := reason(products, path, folder, beside=True):
            raise StaleError(f"{folder / path} {why}; the build is not up to date, run '{command}'")
