"""The committed run of universes: a build recomputes a sample of it."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from marsedl.replication.records import store
from marsedl.replication.universes.judging import COMMITTED, of_one_world
from marsedl.replication.universes.table import Universes

BUILT, WAVES = "report/universes/{}.h5", "report/universes/waves/{}.h5"
TOLERANCE = 1e-6  # of the largest size of a number over all universes


def compare_universes(root: Path, build: Path, slugs: Iterable[str]) -> bool:
    """Compare the universes of a build with those of the same numbers in the committed runs; prints a line a paper.

    A committed run of other inputs or code is named, and fails nothing.
    """
    agree = True
    for slug in slugs:
        committed, built = root / COMMITTED / f"{slug}.h5", build / BUILT.format(slug)
        if not committed.exists() or not built.exists():
            continue
        if not of_one_world(committed, built):
            print(f"{slug}: the committed universes are of other inputs or code; see docs/universes.md to renew them")
            continue
        large, small = (store.load(path, Universes, paper=slug) for path in (committed, built))
        moved = changed(large, small)
        print(f"{slug}: {len(small.number)} universes compared with {len(large.number)} committed, {len(moved)} differ")
        for number, what in moved.items():
            print(f"  {slug}: universe {number}: {what}")
        agree = agree and not moved
    return agree


def changed(large: Universes, small: Universes) -> dict[int, str]:
    """Return the universes of the smaller table that are not as in the larger one, by number, and what differs."""
    places = {int(number): at for at, number in enumerate(large.number)}
    sizes = np.nanmax(np.abs(large.value), axis=0, initial=0.0, where=np.isfinite(large.value))
    found = {}
    for at, number in enumerate(map(int, small.number)):
        if (other := places.get(number)) is None:
            found[number] = "is not among them"
        elif not np.array_equal(large.assignment[other], small.assignment[at], equal_nan=True):
            found[number] = "has other choices"
        elif (where := np.flatnonzero(large.verdict[other] != small.verdict[at])).size:
            found[number] = f"has another verdict on {small.claim[where[0]]}"
        else:
            a, b = large.value[other], small.value[at]
            off = (np.abs(a - b) > TOLERANCE * sizes) | (np.isnan(a) != np.isnan(b))
            if off.any():
                found[number] = f"has another number of {small.component[np.flatnonzero(off)[0]]}"
    return found


def accept_universes(root: Path, build: Path, slugs: Iterable[str]) -> list[Path]:
    """Store the runs of `snakemake multiverse` that are of the build's inputs and code; returns the files."""
    stored = []
    for slug in slugs:
        waves, built, path = build / WAVES.format(slug), build / BUILT.format(slug), root / COMMITTED / f"{slug}.h5"
        if waves.exists() and built.exists() and of_one_world(waves, built):
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(waves, path)
            stored.append(path)
    return stored
