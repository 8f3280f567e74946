"""What is asked of Snakemake: a target that nothing makes is refused with the nearest name."""

import difflib
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from marsedl.replication.catalogue import FLIGHTS, Paper, Product
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs import Study
from marsedl.replication.sharing import Shared

PRODUCTS = ("figures/", "data/cache/", "report/claims/")  # of what a user may ask for by path


def words_of(arguments: list[str]) -> list[str]:
    """Return the words after the program in a command line of Snakemake; none if another program runs the workflow."""
    program = Path(arguments[0])
    is_snakemake = program.name == "snakemake" or program.parts[-2:] == ("snakemake", "__main__.py")
    return arguments[1:] if is_snakemake else []


def check_python(executable: str) -> None:
    """Raise InputError if Snakemake could run no job with this Python: it does not quote its path."""
    if " " in executable:
        raise InputError(
            f"{executable}: Snakemake runs no Python whose path has a space; move the project, or its environment"
        )


def check_targets(
    words: list[str], rules: Collection[str], shared: Mapping[str, Shared], studies: Mapping[str, Study], comparisons
) -> None:
    """Raise InputError, with the nearest name, if a word before the first option is a target that nothing makes.

    Args:
        words: after the program, see `words_of`.
        rules: the names of all rules.
        shared: the artifacts of every paper.
        studies: the readings of every paper.
        comparisons: the names of the comparisons across papers.

    """
    end = next((place for place, word in enumerate(words) if word.startswith("-")), len(words))
    for word in words[:end]:
        path = os.path.normpath(word)
        if word in rules or path in rules or "/chunks/" in path:
            continue
        if "/" not in word:
            raise InputError(f"there is no target '{word}'; {nearest(word, ['all', 'claims', 'report', *shared])}")
        if path.startswith(PRODUCTS):
            files = {*_made(shared, studies), *_of_comparisons(comparisons)}
            if path not in files:
                near = difflib.get_close_matches(path, files, n=1, cutoff=0.8)
                hint = f"did you mean '{near[0]}'?" if near else "'marsedl list' shows what there is"
                raise InputError(f"nothing makes '{word}'; {hint}")


def _of_comparisons(comparisons: Iterable[str]) -> Iterator[str]:
    return (f"figures/comparison/{stem}.{suffix}" for stem in comparisons for suffix in ("png", "pdf", "csv", "md"))


def _made(shared: Mapping[str, Shared], studies: Mapping[str, Study]) -> Iterator[str]:
    """The figures, tables and artifacts of all papers and readings, also of those that `all` leaves out."""
    for slug, of in shared.items():
        paper = of.paper
        stages = [stage for stage in paper.stages if not stage.startswith(FLIGHTS)]
        yield f"report/claims/{slug}.json"
        for stem in (*paper.summaries, "claims"):
            yield from (f"figures/{slug}/{stem}.{suffix}" for suffix in ("csv", "md"))
        for reading, read in studies[slug].readings.items():
            for products, suffixes in ((paper.figures, ("png", "pdf")), (paper.tables, ("csv", "md"))):
                names = [s for s, product in products.items() if all(of.has(reading, n) for n in product.needs)]
                for place in ("", f"{reading}/") if reading == "corrected" else (f"{reading}/",):
                    yield from (f"figures/{slug}/{place}{stem}.{suffix}" for stem in names for suffix in suffixes)
            cases = [f"{FLIGHTS}.{case}" for case in read.trial_counts()]
            yield from (f"data/cache/{slug}/{reading}/{name}.h5" for name in (*stages, *cases))


def owned_elsewhere(target: str, shared: Mapping[str, Shared]) -> str:
    """Return the file of the reading that owns an artifact, if it is another one; empty for any other target."""
    match = re.fullmatch(r"data/cache/([^/]+)/([^/]+)/([^/]+)\.h5", os.path.normpath(target) if target else "")
    if not match or match[1] not in shared or not shared[match[1]].has(match[2], match[3]):
        return ""
    path = shared[match[1]].file(match[2], match[3])
    return "" if path == match[0] else path


def tables_of_equal_needs(paper: Paper) -> list[dict[str, Product]]:
    """Return the tables of a paper that are made from the same artifacts, by name."""
    groups: dict[tuple, dict[str, Product]] = {}
    for stem, table in paper.tables.items():
        groups.setdefault((table.needs, table.optional), {})[stem] = table
    return list(groups.values())
