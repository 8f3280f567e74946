"""Checks of a request to Snakemake before any job is planned: configuration files, targets, folders to write.

Snakemake says little, or shows a traceback, when one of these is wrong. The profiles call `check_configuration`
before Snakemake reads these files, the Snakefile calls `check_request` before any job is planned.
"""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath

from marsedl.replication.catalogue import Paper, Product
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs import SETTINGS, Reading, Study, read_own_file
from marsedl.replication.sharing import Shared
from marsedl.replication.site import site_files

PRODUCTS = ("figures", "data/cache", "report")  # folders of what a user may ask for by path
WRITTEN = (".snakemake", "logs", "benchmarks", *PRODUCTS)
PER_PAPER = ("claims", "counterexamples")  # folders of the report with a file for each paper
REPORT = ("report/claims.json", "report/badge.json", "report/digests.json")  # beside its pages
LEAST_SPACE = 2**20  # bytes; Snakemake's own records need some of it

# Options of Snakemake that are followed by a file, or by all words up to the next option, which are not targets.
_FILE_AFTER = {"--report", "--archive", "--directory", "-d", "--snakefile", "-s"}
_FILES_AFTER = {"--cleanup-metadata", "--cm"}
_DRY = re.compile(r"--dry-?run|-[a-zA-Z]*n[a-zA-Z]*")
_READS_ONLY = {"--lint", "--list", "--list-rules", "-l", "--list-target-rules", "--lt"}


def configuration(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Return Snakemake's settings and configuration files: the words from each option to the next one."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config", "-C", nargs="*", default=[])
    parser.add_argument("--configfile", "--configfiles", nargs="*", default=[])
    snakemake_arguments = arguments[: arguments.index("--")] if "--" in arguments else arguments
    options = parser.parse_known_args(snakemake_arguments)[0]
    return options.config, options.configfile


def check_configuration(arguments: list[str], papers: Iterable[str]) -> None:
    """Exit with one message if a user's own configuration cannot be read, or contains code that Snakemake would run.

    Arguments: those of Snakemake; the slugs of the papers. For the profiles, which Snakemake reads first of all.
    """
    settings, files = configuration(arguments)
    try:
        for setting in settings:
            if "=" not in setting:
                raise InputError(
                    f"--config {setting}: is not NAME=VALUE; if it is a target, write it before --config: "
                    f"snakemake {setting} --config ..."
                )
        for path in files:
            read_own_file(Path(path), (*papers, *SETTINGS))
    except InputError as error:
        sys.exit(f"\nmarsedl: {error}\n")


def check_request(
    arguments: list[str],
    size: str,
    papers: dict[str, Paper],
    studies: dict[str, Study],
    comparisons: Iterable[str],
    rules: Iterable[str],
    root: Path,
) -> None:
    """Reject targets that no rule makes, naming the nearest one that exists, and folders that cannot be written.

    Arguments: those of Snakemake; the size that is built; the papers' catalogues and studies; the names of the
    comparisons and of all rules; the folder in which products are made.
    Raises InputError.
    """
    check_folders(root, arguments)
    for word in first_words(arguments):
        if not word:
            raise InputError("a target is empty (''); name one, such as 'all', or leave it out")
        if "/" not in word and word not in rules:
            raise InputError(f"there is no target '{word}'; {nearest(word, ['all', 'claims', 'report', *papers])}")
    for target in [target for target in asked_for(arguments, root) if target not in rules]:
        check_target(target, size, papers, studies, comparisons)


def first_words(arguments: list[str]) -> list[str]:
    """Return the words before the first option and after "--", which are targets and nothing else."""
    last = arguments[arguments.index("--") + 1 :] if "--" in arguments else []
    end = next((i for i, word in enumerate(arguments) if word.startswith("-")), len(arguments))
    return [*arguments[:end], *last]


def asked_for(arguments: list[str], root: Path) -> list[str]:
    """Return the arguments that name products by path, relative to the folder in which they are made or absolute."""
    own_files = set(configuration(arguments)[1])
    targets = []
    option = ""
    for word in arguments:
        if word.startswith("-"):
            option = word
            continue
        after, option = option, "" if option in _FILE_AFTER else option
        if not word or word in own_files or after in _FILE_AFTER | _FILES_AFTER:
            continue
        path = os.path.relpath(word, root) if word.startswith("/") else os.path.normpath(word)
        if re.match(rf"(build/[^/]+/)?({'|'.join(PRODUCTS)})(/|$)", path):
            targets.append(word if word.startswith("/") else path)
    return targets


def check_target(
    target: str, size: str, papers: dict[str, Paper], studies: dict[str, Study], comparisons: Iterable[str]
) -> None:
    """Reject the path of a product that no rule makes."""
    parts = PurePosixPath(target).parts
    if target.startswith("/"):
        raise InputError(f"{target}: a target cannot be an absolute path; write it relative to the project's folder")
    if parts[0] == "build":
        path = "/".join(parts[2:])
        raise InputError(
            f"{target}: write the target as for the full size, and give the size: "
            f"snakemake {path} --config size={parts[1]}"
        )
    if parts[0] == "report":
        site = site_files({**{slug: paper.figures for slug, paper in papers.items()}, "comparison": comparisons})
        valid_names = [*REPORT, *(f"report/{name}" for name in site)]
        valid_names += [f"report/{kind}/{paper}.json" for kind in PER_PAPER for paper in papers]
        if target not in valid_names:
            raise InputError(f"{target}: nothing makes this file; {nearest(target, valid_names)}")
        return
    folder, names = ("figures", parts[1:]) if parts[0] == "figures" else ("data/cache", parts[2:])
    if not names or not PurePosixPath(target).suffix:
        raise InputError(
            f"{target}: is a folder; name a file in it, or one of the targets {', '.join(['all', *papers])}"
        )
    valid_names = [*papers, *(["comparison"] if folder == "figures" else [])]
    if names[0] not in valid_names:
        raise InputError(f"{target}: there is no paper '{names[0]}'; {nearest(names[0], valid_names)}")
    if names[0] == "comparison":
        _check_name(target, names[1:], dict.fromkeys(comparisons, (".png", ".pdf", ".csv", ".md")), "comparison")
        return
    paper, study = papers[names[0]], studies[names[0]]
    if folder == "figures":
        _check_product(target, names[1:], size, paper, study)
    else:
        _check_artifact(target, names[1:], size, paper, study)


def _check_product(target, names, size, paper, study) -> None:
    """A figure or table, of the default reading or of a named one."""
    reading = _reading(target, names[0] if len(names) > 1 else "corrected", paper, study)
    of_all = dict.fromkeys([*paper.summaries, "claims"], (".csv", ".md"))
    suffixes = dict.fromkeys((*paper.figures, *paper.tables), ())
    for products, endings in ((paper.figures, (".png", ".pdf")), (paper.tables, (".csv", ".md"))):
        for stem in products:
            suffixes[stem] += endings
    stem = PurePosixPath(names[-1]).stem
    if len(names) == 2 and stem in of_all:
        raise InputError(f"{target}: '{stem}' is one table of all readings; ask for figures/{paper.slug}/{names[-1]}")
    _check_name(target, names[-1:] if len(names) < 3 else names[1:], suffixes | of_all, "figure or table")
    for product in (paper.figures.get(stem), paper.tables.get(stem)):
        _check_trials(target, product.needs if product else (), size, paper, reading)


def _check_artifact(target, names, size, paper, study) -> None:
    """An artifact of a stage, a Monte Carlo case or a chunk of one, of a named reading."""
    if len(names) == 1:
        raise InputError(
            f"{target}: artifacts are stored under their reading; ask for data/cache/{paper.slug}/corrected/{names[0]}"
        )
    reading = _reading(target, names[0], paper, study)
    cases = type(reading.inputs).CASES
    if names[1] == "chunks" and len(names) == 3:
        chunk = re.fullmatch(r"(.+)\.(\d+)of(\d+)\.h5", names[2])
        if not chunk or chunk[1] not in cases:
            case = chunk[1] if chunk else names[2]
            raise InputError(
                f"{target}: this is not a chunk of a Monte Carlo case, such as {next(iter(cases))}.0of3.h5; "
                f"{nearest(case, cases)}"
            )
        _check_trials(target, [f"montecarlo.{chunk[1]}"], size, paper, reading)
        number, count = chunk[2], len(Shared(paper, study).chunks(reading.name, chunk[1]))
        if str(int(number)) != number or chunk[3] != str(count) or int(number) >= count:
            last = f"0of{count}" + (f" to {count - 1}of{count}" if count > 1 else "")
            raise InputError(
                f"{target}: the chunks of {chunk[1]} are {last}; name one of these, or set their number with "
                "--config chunks=N"
            )
        return
    stages = [stage for stage in paper.stages if not stage.startswith("montecarlo")]
    artifact_names = dict.fromkeys([*stages, *(f"montecarlo.{case}" for case in cases)], (".h5",))
    _check_name(target, names[1:], artifact_names, "artifact")
    _check_trials(target, [PurePosixPath(names[1]).stem], size, paper, reading)


def _check_name(target, names, endings, kind) -> None:
    """Check the last part of a target: its stem must exist, and be made with this suffix."""
    path = PurePosixPath(*names)
    if len(names) != 1 or path.stem not in endings:
        name = str(path.with_suffix(""))
        raise InputError(f"{target}: there is no {kind} '{name}'; {nearest(name, endings)}")
    if path.suffix not in endings[path.stem]:
        raise InputError(
            f"{target}: '{path.stem}' is written as {' and '.join(endings[path.stem])}; ask for one of these"
        )


def _reading(target, name, paper, study) -> Reading:
    if name not in study.readings:
        raise InputError(
            f"{target}: {paper.slug} has no reading '{name}'; {nearest(name, study.readings)} "
            "(for a reading of your own, give its file with --configfile)"
        )
    return study.readings[name]


def _check_trials(target, needs, size, paper, reading) -> None:
    """Reject a target that needs a Monte Carlo case without trials, itself or through other stages."""
    trials, visited, open_needs = reading.trial_counts(), set(), list(needs)
    while open_needs:
        need = open_needs.pop()
        if need in visited:
            continue
        visited.add(need)
        stage, _, case = need.partition(".")
        if case and case not in trials:
            name = reading.inputs.CASES.get(case, "trials")
            raise InputError(
                f"{target}: needs the Monte Carlo case {case}, which flies no trials in the reading {reading.name} "
                f"(size {size}); set {name} above 0 in a reading of your own, or build the size full"
            )
        if stage in paper.stages:
            open_needs.extend(paper.stages[stage].needs)


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


def check_folders(root: Path, arguments: list[str]) -> None:
    """Reject folders that cannot be written and full disks, on which Snakemake would fail with a traceback."""
    if _READS_ONLY & set(arguments):
        return
    dry = any(_DRY.fullmatch(word) for word in arguments)
    for name in WRITTEN[:1] if dry else WRITTEN:
        path = root / name
        folder = next(p for p in (path, *path.parents) if os.path.lexists(p))
        if not folder.is_dir():
            raise InputError(f"{folder}: is not a folder, but a folder of this name is needed; move it away")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise InputError(f"{folder}: this folder cannot be written; change its permissions, or copy the project")
        disk = os.statvfs(folder)
        free = disk.f_frsize * (disk.f_bavail if os.geteuid() else disk.f_bfree)
        if disk.f_blocks and free < LEAST_SPACE:
            raise InputError(
                f"{folder}: its disk is full ({free} bytes are free); delete something or copy the project"
            )
