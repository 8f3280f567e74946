"""Proof of reproducibility: two clean builds with equal digests, and regenerated numbers against committed ones."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from marsedl.replication.claims import UNEXPLAINED, read_claims, write_text
from marsedl.replication.digests import digest_tree
from marsedl.replication.errors import MarsedlError

TREE = ("Snakefile", "profiles", "workflow", "configs", "data/published", "data/reference", "data/atmosphere", "src")
PRODUCTS = ("data/cache/**/*.h5", "figures/**/*.*", "report/**/*.*")
# What must not matter: cores, chunks, and the order of sets and dictionaries.
BUILDS = (
    {"cores": "1", "chunks": "1", "PYTHONHASHSEED": "0"},
    {"cores": "2", "chunks": "3", "PYTHONHASHSEED": "271828"},
)

RELATIVE_TOLERANCE = 1e-6  # of the field's root mean square: far above rounding, far below every printed digit
SMALLEST_SCALE = 1e-3  # in the field's own unit: smaller fields are compared as if they were of this size
RESIDUALS = ("_error", "_gap", "_residual")  # fields of this name are zero but for rounding: compared as if of size one
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration


def copy_tree(root: Path, destination: Path) -> Path:
    """Copy what a build needs, and none of its products, into an empty folder; returns that folder."""
    shutil.rmtree(destination, ignore_errors=True)
    ignore = shutil.ignore_patterns("__pycache__", "*.partial")
    for name in TREE:
        source = root / name
        if source.is_dir():
            shutil.copytree(source, destination / name, ignore=ignore)
        elif source.exists():
            destination.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, destination / name)
    return destination


def snakemake(folder: Path, *arguments: str, nice: int = 0, **environment: str) -> subprocess.CompletedProcess:
    """Run Snakemake in a copy of the tree, with that copy's package; returns the finished process with its output.

    nice: by how much it and its jobs give way to other processes, as for the command of this name.
    """
    environment = {**os.environ, **environment, "PYTHONPATH": str(folder / "src")}
    return subprocess.run(
        ["nice", "-n", str(nice), sys.executable, "-m", "snakemake", *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )


def build_twice(root: Path) -> bool:
    """Build the smoke size twice from nothing and compare the digests of every product; prints what differs."""
    folders = [root / "build" / "verify" / str(number) for number in range(len(BUILDS))]
    for folder, build in zip(folders, BUILDS, strict=True):
        copy_tree(root, folder)
        print(
            f"smoke build in {folder.name} ({', '.join(f'{key} {value}' for key, value in build.items())})", flush=True
        )

    def run(folder, build):
        config = ["--config", "size=smoke", f"chunks={build['chunks']}"]
        settings = {"nice": 5 * BUILDS.index(build), "PYTHONHASHSEED": build["PYTHONHASHSEED"]}
        return snakemake(folder, "all", "--cores", build["cores"], *config, **settings)

    # At the same time, the build of one core before the other: were it the last to end, the other cores would idle.
    with ThreadPoolExecutor() as pool:
        finished = list(pool.map(run, folders, BUILDS))
    for folder, done in zip(folders, finished, strict=True):
        if done.returncode:
            raise MarsedlError(f"the smoke build in {folder} failed:\n{done.stdout[-3000:]}")
    first, second = (digest_tree(folder, PRODUCTS) for folder in folders)
    unequal = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
    for name in unequal:
        print(f"  differs: {name} (compare with 'marsedl diff build/verify/0/{name} build/verify/1/{name}')")
    print(f"{len(first)} products in each of two builds, {len(unequal)} differ", flush=True)
    return not unequal


def fingerprints(root: Path, slug: str, cached: Iterable[Path]) -> dict[str, dict]:
    """Reduce a full build of a paper to numbers: every claim's value, and moments of every field of the artifacts."""
    from marsedl.replication.artifacts import opened

    found = {}
    for row in read_claims(_product(root, f"report/claims/{slug}.json")):
        for reading, result in row["readings"].items():
            if result["value"] is not None and not isinstance(result["value"], str):
                found[f"claims/{row['id']}/{reading}"] = _reduced(np.array(result["value"]))
    for artifact in filter(Path.exists, cached):
        with opened(artifact) as file:
            for name, dataset in sorted(file.items()):
                if hasattr(dataset, "dtype") and dataset.dtype.kind in "fiub":
                    found[f"{artifact.parent.name}/{artifact.stem}/{name}"] = _reduced(np.array(dataset))
    return found


def _product(root: Path, name: str) -> Path:
    path = root / name
    if not path.exists():
        raise MarsedlError(f"{path}: there is no full build to compare; run 'snakemake all'")
    return path


def _reduced(array: np.ndarray) -> dict:
    """Shape, kind and a few moments of an array; the weighted mean sees permutations."""
    values = array.astype(float).ravel()
    values = values[np.isfinite(values)]
    if not values.size:
        return {"shape": list(array.shape), "counts": False, "numbers": []}
    weights = np.linspace(1.0, 2.0, values.size)
    largest = np.abs(values).max() or 1.0  # whose square may be beyond all numbers
    numbers = [
        largest * np.sqrt(np.mean((values / largest) ** 2)),
        values.mean(),
        np.average(values, weights=weights),
        values.min(),
        values.max(),
    ]
    return {"shape": list(array.shape), "counts": array.dtype.kind in "iub", "numbers": [float(n) for n in numbers]}


def margin(name: str, reference: dict, found: dict) -> float:
    """Return the largest difference of a field's two reductions in tolerances; infinite for another shape."""
    if reference["shape"] != found["shape"] or len(reference["numbers"]) != len(found["numbers"]):
        return np.inf
    if not reference["numbers"]:
        return 0.0
    a, b = np.array(reference["numbers"]), np.array(found["numbers"])
    if reference["counts"]:
        tolerance = 1.0 + COUNT_TOLERANCE * np.abs(a)
    else:
        tolerance = RELATIVE_TOLERANCE * max(a[0], 1.0 if name.endswith(RESIDUALS) else SMALLEST_SCALE)
    return float(np.max(np.abs(a - b) / tolerance))


def write_reference(root: Path, slugs: Iterable[str]) -> list[Path]:
    """Store the numbers of a full build under data/reference; returns the files."""
    written = []
    for slug in slugs:
        path = root / "data" / "reference" / f"{slug}.json"
        # Those of this build: the cache may hold others, of a user's readings or of earlier versions.
        products = json.loads(_product(root, "report/digests.json").read_text(encoding="utf-8"))
        cached = [root / name for name in sorted(products) if name.startswith(f"data/cache/{slug}/")]
        found = fingerprints(root, slug, cached)
        lines = [f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in found.items()]
        write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")
        written.append(path)
    return written


def compare_reference(
    root: Path,
    slugs: Iterable[str],
    noise: Mapping[str, Iterable[str]] | None = None,
    readings: Mapping[str, Iterable[str]] | None = None,
) -> bool:
    """Compare a full build with the stored numbers by tolerance; prints the worst margin of every paper.

    noise: patterns of names, by paper, of which only the shape is compared. readings: those that were built, by paper;
    all of them if not given. False, too, if a verdict is not explained.
    """
    agree = True
    for slug in slugs:
        path = root / "data" / "reference" / f"{slug}.json"
        if not path.exists():
            raise MarsedlError(f"{path} is missing; restore it, or make it with 'marsedl verify --write-reference'")
        reference = json.loads(path.read_text(encoding="utf-8"))
        if readings is not None:
            built = set(readings[slug])
            reference = {
                name: entry for name, entry in reference.items() if built & {name.split("/")[i] for i in (0, 2)}
            }
        stems = sorted({name.rpartition("/")[0] for name in reference if not name.startswith("claims/")})
        found = fingerprints(root, slug, [root / "data" / "cache" / slug / f"{stem}.h5" for stem in stems])
        missing = sorted(reference.keys() - found.keys())
        patterns = tuple((noise or {}).get(slug, ()))
        margins, left_out = {}, 0
        for name, entry in reference.items():
            if name in found:
                rounding = any(fnmatchcase(name, pattern) for pattern in patterns)
                left_out += rounding
                expected = {**entry, "numbers": found[name]["numbers"]} if rounding else entry
                margins[name] = margin(name, expected, found[name])
        beyond = sorted((name for name, value in margins.items() if value > 1), key=lambda name: -margins[name])
        for name in missing[:20]:
            print(f"  {slug}: not built: {name}")
        for name in beyond[:20]:
            print(f"  {slug}: {name} is off by {margins[name]:.3g} tolerances")
        worst = max(margins, key=margins.get, default="none of them was built")
        print(
            f"{slug}: {len(margins) - left_out} numbers compared with {path.name}, {len(beyond)} beyond tolerance, "
            f"{len(missing)} missing; "
            f"worst margin {margins.get(worst, 0.0):.3g} tolerances ({worst})"
            + (f"; {left_out} that rounding decides compared by shape" if left_out else ""),
            flush=True,
        )
        unexplained = [
            row["id"]
            for row in read_claims(_product(root, f"report/claims/{slug}.json"))
            if row["reason"] == UNEXPLAINED
        ]
        for claim in unexplained:
            print(f"  {slug}: claim {claim} differs or fails without a reason that names an erratum")
        agree = agree and not beyond and not missing and not unexplained
    return agree
