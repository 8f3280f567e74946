"""Two builds of the smoke size in separate folders, under different conditions, must give equal digests."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from fnmatch import fnmatchcase
from pathlib import Path

from marsedl.replication.errors import MarsedlError
from marsedl.replication.records.differences import digest_tree
from marsedl.replication.sizes import build_folder

TREE = ("Snakefile", "profiles", "workflow", "configs", "data/published", "data/reference", "data/atmosphere", "src")
PRODUCTS = ("data/cache/**/*.h5", "figures/**/*.*", "report/**/*.*")
# What must not matter: cores, chunks, the order of sets and dictionaries, the date and the language. The two time zones
# never have the same date, and are written so that no table of zones is needed.
BUILDS = (
    {"cores": "2", "chunks": "1", "PYTHONHASHSEED": "0", "TZ": "NUT11", "LC_ALL": "C"},
    {"cores": "3", "chunks": "3", "PYTHONHASHSEED": "271828", "TZ": "LINT-14"},  # and a locale of the machine
)
WHOLE = "powered_descent"  # of which the second build makes everything: the paper of the cheapest stages
_OFFLINE = ("unshare", "--map-root-user", "--net")  # a network namespace of its own, which has no network


def copy_tree(root: Path, destination: Path) -> Path:
    """Copy what a build needs, and none of its products, into an empty folder; returns that folder."""
    if destination.exists():
        shutil.rmtree(destination)
    ignore = shutil.ignore_patterns("__pycache__", "*.partial")
    for name in TREE:
        source = root / name
        if source.is_dir():
            shutil.copytree(source, destination / name, ignore=ignore)
        elif source.exists():
            destination.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, destination / name)
    return destination


def snakemake(
    folder: Path,
    *arguments: str,
    nice: int = 0,
    offline: bool = False,
    python: str | None = None,
    **environment: str | None,
) -> subprocess.CompletedProcess:
    """Run Snakemake in a copy of the tree, with that copy's package; returns the finished process with its output.

    nice: niceness of Snakemake and its jobs. offline: without network, where `offline_works`. python: another
    interpreter, whose libraries may be others. environment: further variables; None removes one.
    """
    environment = {**os.environ, **environment, "PYTHONPATH": str(folder / "src")}
    environment = {name: value for name, value in environment.items() if value is not None}
    around = [*_OFFLINE] * offline
    return subprocess.run(
        [*around, "nice", "-n", str(nice), python or sys.executable, "-m", "snakemake", *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )


def offline_works() -> bool:
    """Return whether this machine can run a process without network."""
    return _output_of(*_OFFLINE, "true") is not None


def other_locale() -> str:
    """Return a locale of this machine that is not the plain one: the first by name with a language, else any."""
    locales = sorted((_output_of("locale", "-a") or "").split())
    languages = [name for name in locales if name not in ("C", "POSIX")]
    return next((name for name in languages if "_" in name), languages[0] if languages else "C.UTF-8")


def _output_of(*command: str) -> str | None:
    """The output of a system command; None if it does not exist or fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


def build_twice(root: Path) -> bool:
    """Build the smoke size, then a part of it again, both from nothing, and compare the digests of these products.

    The part is one paper whole, and of every other paper the flights and funnels of its corrected reading with all
    that leads to them: nominal trajectory, linearization, gain design. Prints what differs. Raises MarsedlError if a
    build fails.
    """
    offline, language, found = offline_works(), other_locale(), []
    if not offline:
        print("  both builds use the network: this machine cannot run a process without it", flush=True)
    for number, build in enumerate(BUILDS):
        folder = copy_tree(root, root / "build" / "verify" / str(number))
        build = {**build, "LC_ALL": build.get("LC_ALL", language)}
        alone = offline and number == len(BUILDS) - 1
        targets = _again(found[0]) if found else ["all"]
        network = "without network" if alone else "with the machine's network"
        settings = ", ".join(f"{key} {value}" for key, value in build.items())
        print(f"smoke build in {number} ({settings}, {network})", flush=True)
        config = ["--config", "size=smoke", f"chunks={build['chunks']}"]
        environment = {key: value for key, value in build.items() if key.isupper()}
        process = snakemake(folder, *targets, "--cores", build["cores"], *config, offline=alone, **environment)
        if process.returncode:
            raise MarsedlError(f"the smoke build in {folder} failed:\n{process.stdout[-3000:]}")
        found.append(digest_tree(build_folder(folder, "smoke"), PRODUCTS))
    first, second = found
    unequal = [name for name in second if first.get(name) != second[name]]
    for name in unequal:
        command = f"marsedl diff build/verify/0/build/smoke/{name} build/verify/1/build/smoke/{name}"
        print(f"  differs: {name} (compare with '{command}')")
    print(f"{len(first)} products, {len(second)} of them built twice, {len(unequal)} differ", flush=True)
    return not unequal


def _again(products: Iterable[str]) -> list[str]:
    """What the second build makes of the products of the first."""
    whole = [*(f"report/{kind}/{WHOLE}.json" for kind in ("claims", "counterexamples")), WHOLE]
    last = [f"data/cache/*/corrected/{name}.h5" for name in ("montecarlo.*", "funnel")]
    found = [name for name in products if any(fnmatchcase(name, pattern) for pattern in last)]
    return [*whole, *(name for name in found if name.split("/")[2] != WHOLE)]
