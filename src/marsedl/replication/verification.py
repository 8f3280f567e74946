"""Proof of reproducibility: clean builds with equal digests, and regenerated numbers against committed ones."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from marsedl.replication.claims import read_claims, read_counterexamples, unexplained, write_text
from marsedl.replication.digests import digest_tree
from marsedl.replication.errors import MarsedlError
from marsedl.replication.inputs import COMMITTED_INPUTS, Study, counted_inputs
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder
from marsedl.replication.terminal import columns

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

RELATIVE_TOLERANCE = 1e-6  # of the field's root mean square: far above rounding, far below every printed digit
SMALLEST_SCALE = 1e-3  # in the field's own unit: smaller fields are compared as if they were of this size
RESIDUALS = ("_error", "_gap", "_residual")  # fields of this name are zero but for rounding: compared as if of size one
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration
REMEDY = "if the changes are intended, accept them with 'marsedl accept' after a full build"
# Before the id of a claim; other names have three parts.
_VERDICTS, _PUBLISHED, _COUNTEREXAMPLES = "verdicts/", "published/", "counterexamples/"
NOT_TURNED = "not turned"  # of a claim without a counterexample that works
_MOMENTS = ("root mean square", "mean", "weighted mean", "smallest", "largest")
_NOTHING = "–"  # in a table, where one side has no such claim, verdict or field
_ROWS = 40  # of a table of changes, beside those of claims, which are all shown


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


def fingerprints(root: Path, slug: str, cached: Mapping[str, Path]) -> dict[str, dict | str]:
    """Reduce a full build of a paper to the numbers and verdicts that are compared, by name.

    Of every claim what the paper prints, the verdicts by reading, and the values as numbers; of the artifacts, moments
    of every field. cached: files of artifacts by "reading/artifact"; several readings may share one.
    """
    from marsedl.replication.artifacts import holds_field, opened

    rows = read_claims(_product(root, f"report/claims/{slug}.json"))
    entries = {f"{_VERDICTS}{row['id']}": _verdicts(row) for row in rows}
    entries |= {f"{_PUBLISHED}{row['id']}": _printed(row) for row in rows}
    for row in rows:
        for reading, result in row["readings"].items():
            if result["value"] is not None and not isinstance(result["value"], str):
                entries[f"claims/{row['id']}/{reading}"] = _reduced(np.array(result["value"]))
    reduced: dict[Path, dict[str, dict]] = {}
    for artifact, path in cached.items():
        if path not in reduced and path.exists():
            with opened(path) as file:
                fields = {name: file[name] for name in sorted(file) if holds_field(file, name)}
                numbers = {name: field for name, field in fields.items() if field.dtype.kind in "fiub"}
                reduced[path] = {name: _reduced(np.array(dataset)) for name, dataset in numbers.items()}
        entries |= {f"{artifact}/{name}": numbers for name, numbers in reduced.get(path, {}).items()}
    return entries


def _counterexamples(root: Path, slug: str) -> dict[str, str]:
    """The verdict that each counted claim has after its counterexample."""
    counterexamples = read_counterexamples(_product(root, f"report/counterexamples/{slug}.json"))
    return {
        f"{_COUNTEREXAMPLES}{name}": turned["to"] if turned else NOT_TURNED for name, turned in counterexamples.items()
    }


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


def margin(name: str, reference: dict, values: dict) -> float:
    """Return the largest difference of a field's two reductions in tolerances; infinite for another shape."""
    return float(max(_margins(name, reference, values), default=0.0))


def _margins(name: str, reference: dict, values: dict) -> np.ndarray:
    """The difference of each number, in tolerances."""
    if reference["shape"] != values["shape"] or len(reference["numbers"]) != len(values["numbers"]):
        return np.array([np.inf])
    a, b = np.array(reference["numbers"]), np.array(values["numbers"])
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
    reference: Mapping[str, dict | str], build: Mapping[str, dict | str], noise: Sequence[str] = ()
) -> Comparison:
    """Compare what is committed with what was found, both as `fingerprints` gives them.

    noise: patterns of names of which only the shape is compared.
    """
    by_shape = {name for name in reference if any(fnmatchcase(name, pattern) for pattern in noise)}
    margins, printed, verdicts, turned, numbers = {}, [], [], [], []
    for name in dict.fromkeys([*reference, *build]):
        old, new = reference.get(name), build.get(name)
        if name.startswith(_VERDICTS):
            verdicts.append(name)
        elif name.startswith(_COUNTEREXAMPLES):
            if old != new:
                claim = f"{name.partition('/')[2]}, counterexample"
                turned.append(Change(claim, old or _NOTHING, new or _NOTHING, np.inf, verdict=True))
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
    verdict_changes = [change for name in verdicts for change in _verdict_changes(name, reference, build, margins)]
    return Comparison([*printed, *verdict_changes, *turned, *numbers], margins, by_shape & margins.keys())


def _verdict_changes(name: str, reference: Mapping, build: Mapping, margins: Mapping[str, float]) -> list[Change]:
    """The readings in which a claim has another verdict; one change for a claim that is new or gone."""
    claim = name.removeprefix(_VERDICTS)
    if name not in reference or name not in build:
        old, new = (", ".join(sorted({*side.get(name, {}).values()})) or _NOTHING for side in (reference, build))
        return [Change(claim, old, new, np.inf, verdict=True)]
    old, new = reference[name], build[name]
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
    """Format changes as a table: name, old, new, margin; all claims, and the first numbers."""
    claims = [change for change in changes if change.printed or change.verdict]
    numbers = [change for change in changes if not (change.printed or change.verdict)]
    rows = [("claim or field", "old", "new", "margin in tolerances")]
    rows += [
        ("the paper's " * c.printed + "verdict of " * c.verdict + c.name, c.old, c.new, f"{c.margin:.3g}")
        for c in [*claims, *numbers[:_ROWS]]
    ]
    more = f"\n  and {len(numbers) - _ROWS} numbers more" if len(numbers) > _ROWS else ""
    return columns(rows, 2) + more


def read_reference(root: Path, slug: str, folder: Path | None = None) -> dict[str, dict | str]:
    """Return the reference numbers of a paper; raises MarsedlError if there are none, or if the file is damaged.

    folder: holds the reference; the committed one if not given.
    """
    path = _reference(root, slug, folder)
    if not path.exists():
        if folder is not None:
            raise MarsedlError(f"{path} is missing; restore it, or write it with '{_accept_command(folder)}'")
        raise MarsedlError(f"{path} is missing; restore it, or write it with 'marsedl accept' after a full build")

    def refuse(problem: str) -> MarsedlError:
        name = path.relative_to(root) if path.is_relative_to(root) else path
        return MarsedlError(f"{path}: {problem}; restore it with 'git checkout {name}'")

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
    """What is wrong with an entry of a reference, in words; empty if it has the form of `fingerprints`."""
    if name.startswith((_PUBLISHED, _COUNTEREXAMPLES)):
        return "" if isinstance(entry, str) else "is not text"
    if not isinstance(entry, dict):
        return "is not a set of keys with values"
    if name.startswith(_VERDICTS):
        return "" if all(isinstance(verdict, str) for verdict in entry.values()) else "holds a verdict that is not text"
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


def _reference(root: Path, slug: str, folder: Path | None = None) -> Path:
    return (folder or root / "data" / "reference") / f"{slug}.json"


def _accept_command(folder: Path) -> str:
    """The command that writes a reference of the user's own."""
    return f"marsedl accept --reference {shlex.quote(str(folder))}"


def compare_reference(
    root: Path,
    papers: Mapping[str, Shared],
    noise: Mapping[str, Sequence[str]] | None = None,
    size: str = FULL,
    folder: Path | None = None,
) -> bool:
    """Compare a build with reference numbers; prints the changes and the worst margin of every paper.

    papers: whose file each artifact is, by paper; an artifact that readings share is compared with the numbers of each.
    noise: patterns of names, by paper, of which only the shape is compared. size: of the build; its numbers of trials
    have to be those of the reference. folder: holds a reference of the user's own; without it, the build is compared
    with the committed numbers and counterexamples, and is refused as well if a verdict is not explained.

    Returns whether they agree.
    """
    agree, build = True, build_folder(root, size)
    for slug, shared in papers.items():
        reference = read_reference(root, slug, folder)
        entries = _fingerprints(build, slug, _artifacts_of(build, reference, shared), folder)
        comparison = compare(reference, entries, (noise or {}).get(slug, ()))
        names = _unexplained(build, slug) if folder is None else []
        _print_comparison(slug, comparison, names)
        agree = agree and not comparison.changes and not names
    if not agree:
        remedy = REMEDY if folder is None else f"if the changes are intended, run '{_accept_command(folder)}'"
        print(remedy, flush=True)
    return agree


def _fingerprints(build: Path, slug: str, cached: Mapping[str, Path], folder: Path | None) -> dict[str, dict | str]:
    """What is compared with a reference: a user's own, in a folder, holds no counterexamples."""
    return fingerprints(build, slug, cached) | (_counterexamples(build, slug) if folder is None else {})


def _artifacts_of(build: Path, reference: Iterable[str], shared: Shared) -> dict[str, Path]:
    """The files of the artifacts that a reference holds numbers of, by "reading/artifact"."""
    other_prefixes = ("claims/", _PUBLISHED, _VERDICTS, _COUNTEREXAMPLES)
    names = {name.rpartition("/")[0] for name in reference if not name.startswith(other_prefixes)}
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
        f"worst margin {margins.get(worst, 0.0):.3g} tolerances ({worst})"
        + (f"; {rounding} that rounding decides compared by shape" if rounding else "")
        + (f"; {printed} printed claims differ from those accepted" if printed else "")
    )
    if changes:
        print(format_changes(changes))
    for claim in without_reason:
        print(f"  {slug}: claim {claim} differs or fails without a reason that names an erratum")
    sys.stdout.flush()


def accept_inputs(root: Path, studies: Mapping[str, Study]) -> Path:
    """Store the digests of the inputs behind the verdicts: with these inputs, each refuted claim needs a reason."""
    path = root / COMMITTED_INPUTS
    digests = {slug: counted_inputs(study) for slug, study in studies.items()}
    write_text(path, json.dumps(digests, indent=1) + "\n")
    return path


def accept_reference(
    root: Path,
    papers: Mapping[str, Shared],
    noise: Mapping[str, Sequence[str]] | None = None,
    size: str = FULL,
    folder: Path | None = None,
) -> list[Path]:
    """Store the numbers of a build that is up to date as reference; prints what changes, as `compare_reference` does.

    Numbers within tolerance keep their stored digits, so that the files show what moved and nothing else.

    papers, noise, size, folder: as for `compare_reference`.

    Returns the files. Raises MarsedlError, and writes nothing, if a verdict of the committed numbers is not explained.
    """
    for slug in papers if folder is None else ():
        if names := _unexplained(root, slug):
            raise MarsedlError(
                f"{root / 'report' / 'claims' / f'{slug}.json'}: claim {names[0]} differs or fails without a "
                f"reason that names an erratum; state it in src/marsedl/papers/{slug}/claims first"
            )
    return _store(root, build_folder(root, size), papers, noise, folder)


def _store(root, build, papers, noise, folder) -> list[Path]:
    """Write the reference of every paper from a build; nothing is written unless all of them can be."""
    texts = {}
    for slug, shared in papers.items():
        path = _reference(root, slug, folder)
        reference = read_reference(root, slug, folder) if path.exists() else {}
        files = {
            f"{reading}/{name}": build / file
            for reading in sorted(shared.readings)
            for name, file in sorted(shared.claimed(reading).items())
        }
        build_entries = _fingerprints(build, slug, files, folder)
        comparison = compare(reference, build_entries, (noise or {}).get(slug, ()))
        _print_comparison(slug, comparison, ())
        unchanged = {name for name, value in comparison.margins.items() if value <= 1}
        entries = {name: reference[name] if name in unchanged else entry for name, entry in build_entries.items()}
        lines = [f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items()]
        texts[path] = "{\n" + ",\n".join(lines) + "\n}\n"
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return list(texts)
