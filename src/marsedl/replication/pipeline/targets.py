"""The nearest target of a misspelt one, and the owner's file for that of a reading that shares it."""

import difflib
import os
import re
from collections.abc import Collection, Mapping
from pathlib import Path

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.pipeline.staleness import Recipes

PRODUCTS = ("figures/", "data/cache/", "report/claims/")  # of what a user may ask for by path


def words_of(arguments: list[str]) -> list[str]:
    """Return the words after the program in a command line of Snakemake; none if another program runs the workflow."""
    program = Path(arguments[0])
    is_snakemake = program.name == "snakemake" or program.parts[-2:] == ("snakemake", "__main__.py")
    return arguments[1:] if is_snakemake else []


def check_targets(words: list[str], rules: Collection[str], recipes: Recipes) -> None:
    """Raise InputError, with the nearest name, if a word before the first option is a target that nothing makes.

    Args:
        words: after the program, see `words_of`.
        rules: the names of all rules.
        recipes: those of all products.

    """
    end = next((place for place, word in enumerate(words) if word.startswith("-")), len(words))
    for word in words[:end]:
        path = os.path.normpath(word)
        if path in rules or "/chunks/" in path:
            continue
        if "/" not in word:
            targets = ["all", "claims", "report", *recipes.papers]
            raise InputError(f"there is no target '{word}'; {nearest(word, targets)}")
        if path.startswith(PRODUCTS) and path not in (files := _files(recipes)):
            near = difflib.get_close_matches(path, files, n=1, cutoff=0.8)
            hint = f"did you mean '{near[0]}'?" if near else "'marsedl list' shows what there is"
            raise InputError(f"nothing makes '{word}'; {hint}")


def _files(recipes: Recipes) -> set[str]:
    """The figures, tables and artifacts of all papers and readings, also of those that `all` leaves out."""
    files = {*recipes.compared()}
    for slug, shared in recipes.shared.items():
        files |= {f"report/claims/{slug}.json", *recipes.products(slug)}
        products = [(recipes.papers[slug].figures, ("png", "pdf")), (recipes.papers[slug].tables, ("csv", "md"))]
        stages = [stage for stage in recipes.papers[slug].stages if not stage.startswith(FLIGHTS)]
        for name, reading in recipes.studies[slug].readings.items():
            artifacts = [*stages, *(f"{FLIGHTS}.{case}" for case in reading.trial_counts())]
            files.update(f"data/cache/{slug}/{name}/{artifact}.h5" for artifact in artifacts)
            for of_kind, suffixes in products:
                made = (s for s, product in of_kind.items() if all(shared.has(name, need) for need in product.needs))
                files.update(f"figures/{slug}/{name}/{stem}.{suffix}" for stem in made for suffix in suffixes)
    return files


def owned_elsewhere(target: str, shared: Mapping[str, Shared]) -> str:
    """Return the file of the reading that owns an artifact, if it is another one; empty for any other target."""
    match = re.fullmatch(r"data/cache/([^/]+)/([^/]+)/([^/]+)\.h5", os.path.normpath(target) if target else "")
    if not match or match[1] not in shared or not shared[match[1]].has(match[2], match[3]):
        return ""
    path = shared[match[1]].file(match[2], match[3])
    return "" if path == match[0] else path
