"""Two builds of the smoke size in separate folders, under different conditions, must give equal digests."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from subprocess import getoutput, getstatusoutput

from marsedl.replication.errors import MarsedlError
from marsedl.replication.records.differences import digest_tree
from marsedl.replication.sizes import build_folder

TREE = (
    *("Snakefile", "CITATION.cff", "profiles", "workflow", "configs", "src"),
    *("data/published", "data/reference", "data/atmosphere"),
)
PRODUCTS = ("data/cache/**/*.h5", "figures/**/*.*", "report/**/*.*")
# Cores, chunks (none: as configured) and variables that must not matter: the order of sets and dictionaries, the date
# and the language.
# The two time zones never have the same date, and are written so that no table of zones is needed.
BUILDS = (
    (2, None, {"PYTHONHASHSEED": "0", "TZ": "NUT11", "LC_ALL": "C"}),
    (3, 3, {"PYTHONHASHSEED": "271828", "TZ": "LINT-14"}),  # and a locale of the machine
)
WHOLE = "powered_descent"  # of which the second build makes everything: the paper of the cheapest stages
_OFFLINE = ("unshare", "--map-root-user", "--net")  # a network namespace of its own, which has no network


def copy_tree(root: Path, destination: Path) -> Path:
    """Copy what a build needs, and none of its products, into an empty folder; returns that folder."""
    if destination.exists():
        shutil.rmtree(destination)
    destination.mkdir(parents=True)
    for name in TREE:
        if (root / name).is_file():
            shutil.copy2(root / name, destination / name)
        elif (root / name).exists():
            shutil.copytree(root / name, destination / name, ignore=shutil.ignore_patterns("__pycache__", "*.partial"))
    return destination


def snakemake(
    folder: Path, *arguments: str, python: Sequence[str] = (sys.executable,), **environment: str | None
) -> subprocess.CompletedProcess:
    """Run Snakemake in a copy of the tree, with that copy's package; returns the finished process with its output.

    python: the command that starts Python. environment: further variables; None removes one.
    """
    variables = {**os.environ, **environment, "PYTHONPATH": str(folder / "src")}
    variables = {name: value for name, value in variables.items() if value is not None}
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.run([*python, "-m", "snakemake", *arguments], cwd=folder, env=variables, check=False, **output)


def build_twice(root: Path) -> bool:
    """Build the smoke size, then a part of it again, both from nothing, and compare the digests of these products.

    The part is one paper whole, and of every other paper the flights and funnels of its corrected reading with all
    that leads to them: nominal trajectory, linearization, gain design. It is built without network, where the machine
    can run a process without it. Prints what differs; a second build without products proves nothing.
    Raises MarsedlError if a build fails.
    """
    offline, found = getstatusoutput(shlex.join([*_OFFLINE, "true"]))[0] == 0, []
    for number, (cores, chunks, variables) in enumerate(BUILDS):
        folder = copy_tree(root, root / "build" / "verify" / str(number))
        settings = {"cores": cores, "chunks": chunks or "as configured", "LC_ALL": _other_locale(), **variables}
        alone, targets = offline and found, _again(found[0]) if found else ["all"]
        network = "without network" if alone else "with the machine's network"
        said = ", ".join(f"{name} {value}" for name, value in settings.items())
        print(f"smoke build in {number} ({said}, {network})", flush=True)
        config = ["size=smoke", *([f"chunks={chunks}"] if chunks else [])]
        process = snakemake(
            *(folder, *targets, "--cores", str(cores), "--config", *config),
            python=(*_OFFLINE, sys.executable) if alone else (sys.executable,),
            **{name: value for name, value in settings.items() if name.isupper()},
        )
        if process.returncode:
            raise MarsedlError(f"the smoke build in {folder} failed:\n{process.stdout[-3000:]}")
        found.append(digest_tree(build_folder(folder, "smoke"), PRODUCTS))
    first, second = found
    unequal = [name for name in second if first.get(name) != second[name]]
    for name in unequal:
        command = f"marsedl diff build/verify/0/build/smoke/{name} build/verify/1/build/smoke/{name}"
        print(f"  differs: {name} (compare with '{command}')")
    print(f"{len(first)} products, {len(second)} of them built twice, {len(unequal)} differ", flush=True)
    return bool(second) and not unequal


def _again(products: Iterable[str]) -> list[str]:
    """What the second build makes of the products of the first."""
    last = [f"data/cache/*/corrected/{name}.h5" for name in ("montecarlo.*", "funnel")]
    found = [name for name in products if any(fnmatchcase(name, pattern) for pattern in last)]
    whole = [f"report/{kind}/{WHOLE}.json" for kind in ("claims", "counterexamples")]
    return [*whole, WHOLE, *(name for name in found if name.split("/")[2] != WHOLE)]


def _other_locale() -> str:
    """A locale of this machine that is not the plain one: the first by name with a language, else any."""
    locales = [name for name in sorted(getoutput("locale -a 2>/dev/null").split()) if name not in ("C", "POSIX")]
    return next((name for name in locales if "_" in name), next(iter(locales), "C.UTF-8"))
