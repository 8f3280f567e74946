"""What a user asks Snakemake for: the nearest target of a misspelt one, the owner's file of a shared artifact."""

import difflib
import itertools
import os
from collections.abc import Collection
from pathlib import Path

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.sharing import ARTIFACTS, artifact_of, artifact_path

_PRODUCTS = ("figures/", ARTIFACTS, "report/claims/")  # of what a user may ask for by path


def check_targets(command: list[str], rules: Collection[str], products: Products) -> None:
    """Raise InputError if a word is the file of a reading that shares another's, or is a target that nothing makes.

    Args:
        command: the program and its words. Other programs than Snakemake have words of their own, and what stands
            behind the first option need not be a target.
        rules: the names of all rules.
        products: all products.

    """
    program, words = Path(command[0]), command[1:]
    if program.name != "snakemake" and program.parts[-2:] != ("snakemake", "__main__.py"):
        return
    paths = [os.path.normpath(word) for word in words]
    files = _files(products) if any(path.startswith(_PRODUCTS) for path in paths) else set()
    for path in paths:
        if path.startswith(ARTIFACTS) and path in files:
            paper, reading, name = artifact_of(path)
            if path != (owned := products.shared[paper].file(reading, name)):
                raise InputError(f"{path} is not built: the reading shares {owned}; ask for that")
    for word in itertools.takewhile(lambda word: not word.startswith("-"), words):
        path = os.path.normpath(word)
        if path in rules or path in files or "/chunks/" in path:
            continue
        if "/" not in word:
            names = ["all", "papers", "claims", "arena", "report", *products.papers]
            raise InputError(f"there is no target '{word}'; {nearest(word, names)}")
        if path.startswith(_PRODUCTS):
            near = difflib.get_close_matches(path, files, n=1, cutoff=0.8)
            hint = f"did you mean '{near[0]}'?" if near else "'marsedl list' shows what there is"
            raise InputError(f"nothing makes '{word}'; {hint}")


def _files(products: Products) -> set[str]:
    """The figures, tables and artifacts of all papers and readings, also of those that `all` leaves out."""
    files = {*products.compared(), *products.fought()}
    for slug, paper in products.papers.items():
        files |= {f"report/claims/{slug}.json", *products.shown(slug)}
        stages = [stage for stage in paper.stages if stage != FLIGHTS]
        for name, reading in products.studies[slug].readings.items():
            artifacts = [*stages, *(f"{FLIGHTS}.{case}" for case in reading.trial_counts())]
            files.update(artifact_path(slug, name, artifact) for artifact in artifacts)
            for of_kind, suffixes in ((paper.figures, ("png", "pdf")), (paper.tables, ("csv", "md"))):
                whole = [
                    s for s, p in of_kind.items() if all(products.shared[slug].has(name, need) for need in p.needs)
                ]
                files.update(f"figures/{slug}/{name}/{stem}.{suffix}" for stem in whole for suffix in suffixes)
    return files
