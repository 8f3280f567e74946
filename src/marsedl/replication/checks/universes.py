"""The committed run of universes: a build recomputes a sample of it."""

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import ArtifactError
from marsedl.replication.records import store
from marsedl.replication.terminal import summarize
from marsedl.replication.universes.judging import COMMITTED, of_one_world
from marsedl.replication.universes.table import Universes, changed

BUILT, WAVES = "report/universes/{}.h5", "report/universes/waves/{}.h5"


class Compared(NamedTuple):
    """What was compared of a paper's universes, in words, how many, and which of them differ in what.

    `is_old` says that there is a committed run, but of other inputs or code.
    """

    said: str
    universes: int = 0
    moved: Mapping[int, str] = {}
    is_old: bool = False


def compare_universes(root: Path, build: Path, slugs: Iterable[str]) -> bool:
    """Compare the universes of a build with the committed runs; prints what was compared, and what not and why.

    Returns whether some were compared, none differs, and no run is of other inputs or code. Raises as `compared` does.
    """
    found, lines = {slug: compared(root, build, slug) for slug in slugs}, []
    for slug, one in found.items():
        lines.append(f"{slug}: {one.said}")
        lines += [f"  {slug}: universe {number}: {what}" for number, what in one.moved.items()]
    print("\n".join(lines))
    summarize("\n".join(lines))
    return any(one.universes for one in found.values()) and not any(one.moved or one.is_old for one in found.values())


def compared(root: Path, build: Path, slug: str) -> Compared:
    """Compare the universes of a paper's build with those of the same numbers in its committed run.

    A build has a sample of them, or all if `snakemake multiverse` has computed a new run of the same inputs and code.
    Raises ArtifactError, which names file and remedy, if one of the two is damaged or another paper's, or if the build
    has none.
    """
    built, run = build / BUILT.format(slug), root / COMMITTED / f"{slug}.h5"
    small, remedy = store.load(built, Universes, paper=slug), f"restore it with 'git checkout {COMMITTED}/{slug}.h5'"
    if not run.exists():
        return Compared("universes not compared: there is no committed run; see docs/universes.md to make one")
    try:
        with store.opened(run) as file:
            owner = file.attrs["paper"]
    except ArtifactError as error:
        raise ArtifactError(f"{str(error).removesuffix(store.REBUILD)}{remedy}") from None
    if owner != slug:
        raise ArtifactError(f"{run}: is of the paper '{owner}', not '{slug}': {remedy}")
    if not of_one_world(run, built):
        other = "the committed run is of other inputs or code; see docs/universes.md to renew it"
        return Compared(f"universes not compared: {other}", is_old=True)
    whole = build / WAVES.format(slug)
    if whole.exists() and of_one_world(whole, built):
        small = store.load(whole, Universes, paper=slug)
    large = store.load(run, Universes)
    moved = changed(large, small)
    counts = f"{len(small.number)} universes compared with {len(large.number)} committed, {len(moved)} differ"
    return Compared(counts, len(small.number), moved)


def accept_universes(root: Path, build: Path, slugs: Iterable[str]) -> list[Path]:
    """Store the runs of `snakemake multiverse` that are of the build's inputs and code; returns the files.

    A committed run of other code gets the name of today's if the build's universes all have the same bits in it: a
    rewritten function makes no run obsolete that it computes again. Prints which, and which run is not stored and why.
    """
    stored = []
    for slug in slugs:
        waves, built, path = build / WAVES.format(slug), build / BUILT.format(slug), root / COMMITTED / f"{slug}.h5"
        if not built.exists():
            continue
        if waves.exists() and of_one_world(waves, built):
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(waves, path)
            stored.append(path)
            continue
        if waves.exists():
            print(f"{slug}: {waves} is not stored: it is of other inputs or code; run 'snakemake multiverse'")
        if path.exists() and not of_one_world(path, built):
            stored += [path] if _renamed(path, built, slug) else []
    return stored


def _renamed(run: Path, built: Path, slug: str) -> bool:
    """Give a committed run the name of a build's inputs and code, if that has computed some of it to the last bit."""
    large, small = (store.load(path, Universes, paper=slug) for path in (run, built))
    if moved := changed(large, small):
        number, what = next(iter(moved.items()))
        print(
            f"{slug}: the committed run is of other inputs or code: {len(moved)} of {len(small.number)} universes of "
            f"this build differ from it (universe {number} {what}); run 'snakemake multiverse'"
        )
        return False
    print(
        f"{slug}: {len(small.number)} universes of this build have the same bits in the committed run of "
        f"{len(large.number)}, which is of today's code from now on"
    )
    store.save(run, large, paper=slug, reading="universes", provenance=store.provenance(built))
    return True
