"""Proof of reproducibility: two clean builds with equal digests, and regenerated numbers against committed ones."""

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from marsedl.replication.claims import read_claims, unexplained, write_text
from marsedl.replication.digests import digest_tree
from marsedl.replication.errors import MarsedlError
from marsedl.replication.inputs import COMMITTED_INPUTS, Study, counted_inputs
from marsedl.replication.jobs import UNPINNED, pretended_machine
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder, size_of
from marsedl.replication.terminal import columns, printable

TREE = ("Snakefile", "profiles", "workflow", "configs", "data/published", "data/reference", "data/atmosphere", "src")
PRODUCTS = ("data/cache/**/*.h5", "figures/**/*.*", "report/**/*.*")
# What must not matter: cores, chunks, the order of sets and dictionaries, the date and the language. Two time zones in
# which it is never the same day, written so that no table of zones is needed.
BUILDS = (
    {"cores": "2", "chunks": "1", "PYTHONHASHSEED": "0", "TZ": "NUT11", "LC_ALL": "C"},
    {"cores": "3", "chunks": "3", "PYTHONHASHSEED": "271828", "TZ": "LINT-14"},  # and a locale of the machine
)
_OFFLINE = ("unshare", "--map-root-user", "--net")  # a network namespace of its own, which has no network

RELATIVE_TOLERANCE = 1e-6  # of the field's root mean square: far above rounding, far below every printed digit
SMALLEST_SCALE = 1e-3  # in the field's own unit: smaller fields are compared as if they were of this size
RESIDUALS = ("_error", "_gap", "_residual")  # fields of this name are zero but for rounding: compared as if of size one
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration
REMEDY = "what is meant to change is accepted by 'marsedl accept', after a full build"
_VERDICTS, _PUBLISHED = "verdicts/", "published/"  # before the id of a claim; other names have three parts
_MOMENTS = ("root mean square", "mean", "weighted mean", "smallest", "largest")
_NOTHING = "–"  # in a table, where one side has no such claim, verdict or field
_ROWS = 40  # of a table of changes, beside those of claims, which are all shown


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


def snakemake(
    folder: Path,
    *arguments: str,
    nice: int = 0,
    offline: bool = False,
    python: str | None = None,
    **environment: str | None,
) -> subprocess.CompletedProcess:
    """Run Snakemake in a copy of the tree, with that copy's package; returns the finished process with its output.

    nice: by how much it and its jobs give way to other processes, as for the command of this name. offline: without
    network, where `offline_works`. python: another interpreter, whose environment may have other versions of libraries.
    environment: further variables; None takes one away.
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
    """Return whether this machine lets a process go without network."""
    return _said(*_OFFLINE, "true") is not None


def other_locale() -> str:
    """Return a locale of this machine that is not the plain one: the first by name with a language, else any."""
    known = sorted((_said("locale", "-a") or "").split())
    others = [name for name in known if name not in ("C", "POSIX")]
    return next((name for name in others if "_" in name), others[0] if others else "C.UTF-8")


def _said(*command: str) -> str | None:
    """What a command of the system says; nothing if there is no such command, or if it fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


def build_twice(root: Path) -> bool:
    """Build the smoke size twice from nothing and compare the digests of every product; prints what differs."""
    folders = [root / "build" / "verify" / str(number) for number in range(len(BUILDS))]
    language = other_locale()
    builds = [{**build, "LC_ALL": build.get("LC_ALL", language)} for build in BUILDS]
    offline = offline_works()
    for folder, build in zip(folders, builds, strict=True):
        copy_tree(root, folder)
        settings = ", ".join(f"{key} {value}" for key, value in build.items())
        network = "without network" if offline and build is builds[-1] else "with the machine's network"
        print(f"smoke build in {folder.name} ({settings}, {network})", flush=True)
    if not offline:
        print("  no build without network: this machine does not let a process go without it", flush=True)

    def run(folder, build):
        config = ["--config", "size=smoke", f"chunks={build['chunks']}"]
        environment = {key: value for key, value in build.items() if key.isupper()}
        settings = {"nice": 5 * builds.index(build), "offline": offline and build is builds[-1], **environment}
        return snakemake(folder, "all", "--cores", build["cores"], *config, **settings)

    # At the same time, the build of fewer cores before the other: were it the last to end, the other cores would idle.
    with ThreadPoolExecutor() as pool:
        finished = list(pool.map(run, folders, builds))
    for folder, done in zip(folders, finished, strict=True):
        if done.returncode:
            raise MarsedlError(f"the smoke build in {folder} failed:\n{done.stdout[-3000:]}")
    products = [build_folder(folder, "smoke") for folder in folders]
    first, second = (digest_tree(folder, PRODUCTS) for folder in products)
    unequal = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
    for name in unequal:
        shown = f"marsedl diff build/verify/0/build/smoke/{name} build/verify/1/build/smoke/{name}"
        print(f"  differs: {name} (compare with '{shown}')")
    print(f"{len(first)} products in each of two builds, {len(unequal)} differ", flush=True)
    return not unequal


def fingerprints(root: Path, slug: str, cached: Mapping[str, Path]) -> dict[str, dict | str]:
    """Reduce a full build of a paper to what is compared, by name.

    Of every claim what the paper prints, the verdicts by reading, and the values as numbers; of the artifacts, moments
    of every field. cached: files of artifacts by "reading/artifact"; several readings may share one.
    """
    from marsedl.replication.artifacts import opened

    rows = read_claims(_product(root, f"report/claims/{slug}.json"))
    found = {f"{_VERDICTS}{row['id']}": _verdicts(row) for row in rows}
    found |= {f"{_PUBLISHED}{row['id']}": _printed(row) for row in rows}
    for row in rows:
        for reading, result in row["readings"].items():
            if result["value"] is not None and not isinstance(result["value"], str):
                found[f"claims/{row['id']}/{reading}"] = _reduced(np.array(result["value"]))
    reduced: dict[Path, dict[str, dict]] = {}
    for artifact, path in cached.items():
        if path not in reduced and path.exists():
            with opened(path) as file:
                numbers = {n: d for n, d in sorted(file.items()) if hasattr(d, "dtype") and d.dtype.kind in "fiub"}
                reduced[path] = {name: _reduced(np.array(dataset)) for name, dataset in numbers.items()}
        found |= {f"{artifact}/{name}": numbers for name, numbers in reduced.get(path, {}).items()}
    return found


def _printed(row: Mapping) -> str:
    """What the paper prints, as far as a verdict depends on it, in one line."""
    value = str(row["printed"]).replace("'inf'", "inf")  # which JSON has as a text
    parts = [f"{value} {row['unit']}".removesuffix(" 1"), row["kind"]]
    parts += [f"last digit {row['resolution']}"] * (row["resolution"] is not None)
    parts += [f"{row['trials']} trials"] * (row["trials"] is not None)
    return ", ".join(parts)


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
    return float(max(_margins(name, reference, found), default=0.0))


def _margins(name: str, reference: dict, found: dict) -> np.ndarray:
    """The difference of each number, in tolerances."""
    if reference["shape"] != found["shape"] or len(reference["numbers"]) != len(found["numbers"]):
        return np.array([np.inf])
    a, b = np.array(reference["numbers"]), np.array(found["numbers"])
    if reference["counts"]:
        tolerance = 1.0 + COUNT_TOLERANCE * np.abs(a)
    else:
        size = a[0] if a.size else 0.0
        tolerance = RELATIVE_TOLERANCE * max(size, 1.0 if name.endswith(RESIDUALS) else SMALLEST_SCALE)
    return np.abs(a - b) / tolerance


@dataclass(frozen=True)
class Change:
    """What differs between committed and found: what a paper prints, a verdict, or a number beyond its tolerance."""

    name: str
    old: str
    new: str
    margin: float  # in tolerances; of a verdict that of its number, infinite where one of the two is missing
    verdict: bool = False
    printed: bool = False


@dataclass(frozen=True)
class Comparison:
    """A build beside the committed numbers of one paper."""

    changes: list[Change]  # what is printed, then verdicts, then numbers by margin
    margins: dict[str, float]  # of the numbers that both have
    by_shape: set[str]  # those whose numbers are left to rounding

    @property
    def missing(self) -> list[Change]:
        """What is committed and the build does not hold."""
        return [change for change in self.changes if change.new == _NOTHING]


def compare(
    reference: Mapping[str, dict | str], found: Mapping[str, dict | str], noise: Sequence[str] = ()
) -> Comparison:
    """Compare what is committed with what was found, both as `fingerprints` gives them.

    noise: patterns of names of which only the shape is compared.
    """
    by_shape = {name for name in reference if any(fnmatchcase(name, pattern) for pattern in noise)}
    margins, printed, verdicts, numbers = {}, [], [], []
    for name in dict.fromkeys([*reference, *found]):
        old, new = reference.get(name), found.get(name)
        if name.startswith(_VERDICTS):
            verdicts.append(name)
        elif name.startswith(_PUBLISHED):
            claim = name.removeprefix(_PUBLISHED)
            if old != new:
                printed.append(Change(claim, old or _NOTHING, new or _NOTHING, np.inf, printed=True))
        elif old is None or new is None:
            numbers.append(Change(name, *map(_described, (old, new)), np.inf))
        else:
            expected = {**old, "numbers": new["numbers"]} if name in by_shape else old
            margins[name] = margin(name, expected, new)
            if margins[name] > 1:
                worst = int(np.argmax(_margins(name, expected, new)))
                numbers.append(Change(name, _described(old, worst), _described(new, worst), margins[name]))
    numbers.sort(key=lambda change: -change.margin)
    changed = [change for name in verdicts for change in _verdict_changes(name, reference, found, margins)]
    return Comparison([*printed, *changed, *numbers], margins, by_shape & margins.keys())


def _verdict_changes(name: str, reference: Mapping, found: Mapping, margins: Mapping[str, float]) -> list[Change]:
    """The readings in which a claim has another verdict; one change for a claim that is new or gone."""
    claim = name.removeprefix(_VERDICTS)
    if name not in reference or name not in found:
        old, new = (", ".join(sorted({*side.get(name, {}).values()})) or _NOTHING for side in (reference, found))
        return [Change(claim, old, new, np.inf, verdict=True)]
    old, new = reference[name], found[name]
    return [
        Change(
            f"{claim}, {reading}",
            old.get(reading, _NOTHING),
            new.get(reading, _NOTHING),
            margins.get(f"claims/{claim}/{reading}", np.inf),
            verdict=True,
        )
        for reading in dict.fromkeys([*old, *new])
        if old.get(reading) != new.get(reading)
    ]


def _described(entry: Mapping | None, moment: int = 0) -> str:
    """A reduced field in a few words: its number, the moment of an array that moved most, or its shape."""
    if entry is None:
        return _NOTHING
    if moment >= len(entry["numbers"]):
        return f"shape {entry['shape']}, no finite number"
    number = f"{entry['numbers'][moment]:.10g}"
    return f"shape {entry['shape']}, {_MOMENTS[moment]} {number}" if entry["shape"] else number


def format_changes(changes: Sequence[Change]) -> str:
    """Lay changes out as a table: what, old, new, margin; all claims, and as many numbers as one looks at."""
    claims = [change for change in changes if change.printed or change.verdict]
    numbers = [change for change in changes if not (change.printed or change.verdict)]
    rows = [("claim or field", "old", "new", "margin in tolerances")]
    rows += [
        ("the paper's " * c.printed + "verdict of " * c.verdict + c.name, c.old, c.new, f"{c.margin:.3g}")
        for c in [*claims, *numbers[:_ROWS]]
    ]
    more = f"\n  and {len(numbers) - _ROWS} numbers more" if len(numbers) > _ROWS else ""
    return columns(rows, 2) + more


def read_reference(root: Path, slug: str) -> dict[str, dict | str]:
    """Return the committed numbers of a paper; raises MarsedlError if there are none, or if the file is damaged."""
    path = _reference(root, slug)
    if not path.exists():
        raise MarsedlError(f"{path} is missing; restore it, or make it with 'marsedl accept' after a full build")

    def refuse(problem: str) -> MarsedlError:
        return MarsedlError(f"{path}: {problem}; restore it with 'git checkout {path.relative_to(root)}'")

    try:
        reference = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise refuse(f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise refuse(f"is not JSON ({error})") from None
    if not isinstance(reference, dict):
        raise refuse("holds no numbers by name")
    for name, entry in reference.items():
        if problem := _wrong_in_entry(name, entry):
            raise refuse(f"'{name}' {problem}")
    return reference


def _wrong_in_entry(name: str, entry: object) -> str:
    """What is wrong with an entry of a reference, in words; nothing if it is as `fingerprints` gives it."""
    if name.startswith(_PUBLISHED):
        return "" if isinstance(entry, str) else "is no text"
    if not isinstance(entry, dict):
        return "is not a set of keys with values"
    if name.startswith(_VERDICTS):
        return "" if all(isinstance(verdict, str) for verdict in entry.values()) else "holds a verdict that is no text"
    if name.count("/") != 2:
        return "is not a name of three parts"
    shape, numbers = entry.get("shape"), entry.get("numbers")
    if not isinstance(shape, list) or not all(isinstance(size, int) for size in shape):
        return "has no list of whole numbers under 'shape'"
    if not isinstance(entry.get("counts"), bool):
        return "has neither true nor false under 'counts'"
    if not isinstance(numbers, list) or not all(type(number) in (int, float) for number in numbers):
        return "has no list of numbers under 'numbers'"
    return "" if len(numbers) in (0, len(_MOMENTS)) else f"has {len(numbers)} of {len(_MOMENTS)} numbers"


def committed_verdicts(root: Path, slug: str) -> dict[str, dict[str, str]]:
    """Return the committed verdicts on a paper's claims, by claim and reading; none if nothing is committed."""
    reference = read_reference(root, slug) if _reference(root, slug).exists() else {}
    return {name.removeprefix(_VERDICTS): entry for name, entry in reference.items() if name.startswith(_VERDICTS)}


def built_verdicts(root: Path, slug: str) -> dict[str, dict[str, str]]:
    """Return the verdicts of a build on a paper's claims, by claim and reading; none if nothing is built."""
    path = root / "report" / "claims" / f"{slug}.json"
    return {row["id"]: _verdicts(row) for row in read_claims(path)} if path.exists() else {}


def _verdicts(row: Mapping) -> dict[str, str]:
    """The verdicts on a claim by reading, without those readings that do not evaluate it."""
    return {reading: result["verdict"] for reading, result in row["readings"].items() if result["verdict"]}


def _reference(root: Path, slug: str) -> Path:
    return root / "data" / "reference" / f"{slug}.json"


def compare_reference(
    root: Path,
    papers: Mapping[str, Shared],
    noise: Mapping[str, Sequence[str]] | None = None,
    readings: Mapping[str, Iterable[str]] | None = None,
    size: str = FULL,
) -> bool:
    """Compare a build with the committed numbers; prints the changes and the worst margin of every paper.

    papers: whose file each artifact is, by paper; an artifact that readings share is compared with the numbers of each.
    noise: patterns of names, by paper, of which only the shape is compared. readings: those that were built, by paper;
    all of them if not given. size: of the build; its numbers of trials have to be the full ones. False, too, if a
    verdict is not explained.
    """
    agree, build = True, build_folder(root, size)
    for slug, shared in papers.items():
        reference = read_reference(root, slug)
        if readings is not None:
            reference = _of_readings(reference, set(readings[slug]))
        found = fingerprints(build, slug, _artifacts_of(build, reference, shared))
        comparison = compare(reference, found, (noise or {}).get(slug, ()))
        names = _unexplained(build, slug)
        _print_comparison(slug, comparison, names)
        agree = agree and not comparison.changes and not names
    if not agree:
        print(REMEDY, flush=True)
    return agree


def _of_readings(reference: Mapping[str, dict | str], built: set[str]) -> dict[str, dict | str]:
    """The part of a reference that belongs to the readings that were built."""
    kept = {}
    for name, entry in reference.items():
        if name.startswith(_PUBLISHED):
            kept[name] = entry
        elif name.startswith(_VERDICTS):
            kept[name] = {reading: verdict for reading, verdict in entry.items() if reading in built}
        elif built & {name.split("/")[i] for i in (0, 2)}:
            kept[name] = entry
    return kept


def _artifacts_of(build: Path, reference: Iterable[str], shared: Shared) -> dict[str, Path]:
    """The files of the artifacts that a reference holds numbers of, by "reading/artifact"."""
    others = ("claims/", _PUBLISHED, _VERDICTS)
    names = {name.rpartition("/")[0] for name in reference if not name.startswith(others)}
    of_readings = [(name, *name.split("/")) for name in sorted(names)]
    return {
        name: build / shared.file(reading, artifact)
        for name, reading, artifact in of_readings
        if shared.has(reading, artifact)
    }


def _unexplained(root: Path, slug: str) -> list[str]:
    return unexplained(read_claims(_product(root, f"report/claims/{slug}.json")))


def _print_comparison(slug: str, comparison: Comparison, without_reason: Iterable[str]) -> None:
    margins, changes = comparison.margins, comparison.changes
    printed, verdicts = sum(change.printed for change in changes), sum(change.verdict for change in changes)
    worst = max(margins, key=margins.get, default="none of them was built")
    rounding = len(comparison.by_shape)
    print(
        f"{slug}: {len(margins) - rounding} numbers compared with {slug}.json, {verdicts} verdicts changed, "
        f"{sum(value > 1 for value in margins.values())} numbers beyond tolerance, {len(comparison.missing)} missing; "
        f"worst margin {margins.get(worst, 0.0):.3g} tolerances ({printable(worst)})"
        + (f"; {rounding} that rounding decides compared by shape" if rounding else "")
        + (f"; {printed} printed claims are not those that were accepted" if printed else "")
    )
    if changes:
        print(format_changes(changes))
    for claim in without_reason:
        print(f"  {slug}: claim {claim} differs or fails without a reason that names an erratum")
    sys.stdout.flush()


def planned_files(root: Path, *arguments: str) -> dict[str, dict[str, str]]:
    """Return Snakemake's summary of all files behind some targets: by path their `rule`, `status` and `plan`.

    arguments: the targets, and other arguments of Snakemake. Paths are below the folder of the size that is built.
    Raises MarsedlError with what it said if it cannot plan.
    """
    done = snakemake(root, *arguments, "--summary")
    lines = done.stdout.splitlines()
    start = next((number for number, line in enumerate(lines) if line.startswith("output_file\t")), None)
    if done.returncode or start is None:
        raise MarsedlError(f"the workflow cannot be planned; Snakemake says:\n{done.stdout[-3000:]}")
    rows = csv.DictReader(lines[start:], delimiter="\t", quoting=csv.QUOTE_NONE)
    return {row["output_file"]: row for row in rows if row["plan"]}


def built_artifacts(root: Path, *config: str) -> list[str]:
    """Return the artifacts behind the claims of a build that is whole and up to date, as paths below its folder.

    config: what was given with `--config` if it is not the plain full-size build.

    Raises MarsedlError that says what is missing or not up to date.
    """
    return sorted(name for name in built_files(root, "claims", *config) if name.startswith("data/cache/"))


def built_files(root: Path, target: str, *config: str) -> dict[str, dict[str, str]]:
    """Return the files behind a target of a build that is whole and up to date, as `planned_files` does.

    Snakemake itself decides, by the rules of reruns: files, inputs in the configuration, code. So a build of an edited
    configuration is not taken for the plain one, and files of other builds are left out.

    config: what was given with `--config` if it is not the plain full-size build.

    Raises MarsedlError that says what is missing or not up to date.
    """
    files = planned_files(root, target, *(["--config", *config] if config else []))
    files = {name: file for name, file in files.items() if "/chunks/" not in name}  # which are temporary
    # A lost file that nothing needs any more is no reason for Snakemake to plan an update.
    pending = sorted(name for name, file in files.items() if file["plan"] != "no update" or file["status"] == "missing")
    if pending:
        name = pending[0]
        size = size_of(config)
        command = " ".join(["snakemake all", *(["--config", *config] if config else [])])
        raise MarsedlError(
            f"there is no build of size {size} that is up to date with configuration and code: {len(pending)} of "
            f"{len(files)} files are missing or older, the first is {build_folder(root, size) / name} "
            f"({files[name]['status']}); run '{command}'"
        )
    return files


def accept_inputs(root: Path, studies: Mapping[str, Study]) -> Path:
    """Commit the digests of the inputs that verdicts are found with: with these, each refuted claim needs a reason."""
    path = root / COMMITTED_INPUTS
    digests = {slug: counted_inputs(study) for slug, study in studies.items()}
    write_text(path, json.dumps(digests, indent=1) + "\n")
    return path


def accept_reference(
    root: Path, papers: Mapping[str, Shared], noise: Mapping[str, Sequence[str]] | None = None
) -> list[Path]:
    """Make the numbers of a full build the committed ones; prints what changes, as `compare_reference` does.

    Numbers within tolerance keep their committed digits, so that the files show what moved and nothing else.

    papers, noise: as for `compare_reference`.

    Returns the files. Raises MarsedlError, and writes nothing, without a full build that is up to date, if a verdict is
    not explained, or if this machine pretends to be another one.
    """
    if machine := pretended_machine():
        raise MarsedlError(
            f"the committed numbers are those of the pinned instruction sets; unset {UNPINNED} ({machine})"
        )
    built, accepted = set(built_artifacts(root)), {}
    for slug, shared in papers.items():
        if names := _unexplained(root, slug):
            raise MarsedlError(
                f"{root / 'report' / 'claims' / f'{slug}.json'}: claim {names[0]} differs or fails without a "
                f"reason that names an erratum; state it in src/marsedl/papers/{slug}/claims.py first"
            )
        path = _reference(root, slug)
        reference = read_reference(root, slug) if path.exists() else {}
        claimed = {
            f"{reading}/{name}": root / file
            for reading in sorted(shared.readings)
            for name, file in sorted(shared.claimed(reading).items())
            if file in built
        }
        found = fingerprints(root, slug, claimed)
        comparison = compare(reference, found, (noise or {}).get(slug, ()))
        _print_comparison(slug, comparison, ())
        kept = {name for name, value in comparison.margins.items() if value <= 1}
        entries = {name: reference[name] if name in kept else entry for name, entry in found.items()}
        lines = [f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items()]
        accepted[path] = "{\n" + ",\n".join(lines) + "\n}\n"
    for path, text in accepted.items():
        write_text(path, text)
    return list(accepted)
