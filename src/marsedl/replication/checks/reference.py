"""Proof of reproducibility: clean builds with equal digests, and regenerated numbers against committed ones."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.committed import (
    COUNTEREXAMPLES,
    MOMENTS,
    PUBLISHED,
    VERDICTS,
    accept_command,
    read_reference,
    reference_file,
)
from marsedl.replication.claims.rows import read_claims, read_counterexamples, unexplained
from marsedl.replication.errors import MarsedlError
from marsedl.replication.files import write_text
from marsedl.replication.inputs.readings import COMMITTED_INPUTS, Study, counted_inputs
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder
from marsedl.replication.terminal import columns

RELATIVE_TOLERANCE = 1e-6  # of the field's root mean square: far above rounding, far below every printed digit
SMALLEST_SCALE = 1e-3  # in the field's own unit: smaller fields are compared as if they were of this size
RESIDUALS = ("_error", "_gap", "_residual")  # fields of this name are zero but for rounding: compared as if of size one
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration
REMEDY = "if the changes are intended, accept them with 'marsedl accept' after a full build"
NOT_TURNED = "not turned"  # of a claim without a counterexample that works
_OF_CLAIMS = ("claims/", PUBLISHED, VERDICTS, COUNTEREXAMPLES)  # before the id of a claim; all else is of artifacts
_NOTHING = "–"  # in a table, where one side has no such claim, verdict or field
_ROWS = 40  # numbers in a table of changes; verdicts and printed claims are all shown


def fingerprints(root: Path, slug: str, cached: Mapping[str, Path]) -> dict[str, dict | str]:
    """Reduce a full build of a paper to the numbers and verdicts that are compared, by name.

    Of every claim what the paper prints, the verdicts by reading, and the values as numbers; of the artifacts, moments
    of every field. cached: files of artifacts by "reading/artifact"; several readings may share one.
    """
    rows = read_claims(_product(root, f"report/claims/{slug}.json"))
    entries: dict[str, dict | str] = {f"{VERDICTS}{row.id}": _verdicts(row) for row in rows}
    entries |= {f"{PUBLISHED}{row.id}": _printed(row) for row in rows}
    for row in rows:
        for reading, result in row.readings.items():
            if result.value is not None and not isinstance(result.value, str):
                entries[f"claims/{row.id}/{reading}"] = _reduced(np.array(result.value))
    reduced = {path: _reduced_fields(path) for path in sorted(set(cached.values())) if path.exists()}
    for artifact, path in cached.items():
        entries |= {f"{artifact}/{name}": numbers for name, numbers in reduced.get(path, {}).items()}
    return entries


def _verdicts(row: Claim) -> dict[str, str]:
    """The verdicts on a claim by reading, without those readings that do not evaluate it."""
    return {reading: result.verdict for reading, result in row.readings.items() if result.verdict}


def _printed(row: Claim) -> str:
    """What the paper prints, as far as a verdict depends on it, in one line."""
    value = str(row.printed).replace("'inf'", "inf")  # which JSON has as a text
    parts = [f"{value} {row.unit}".removesuffix(" 1"), row.kind]
    parts += [f"last digit {row.resolution}"] * (row.resolution is not None)
    parts += [f"{row.trials} trials"] * (row.trials is not None)
    return ", ".join(parts)


def _reduced_fields(path: Path) -> dict[str, dict]:
    """The reduced fields of an artifact that are numbers."""
    from marsedl.replication.records.store import holds_field, opened

    with opened(path) as file:
        fields = {name: file[name] for name in sorted(file) if holds_field(file, name)}
        return {name: _reduced(np.array(field)) for name, field in fields.items() if field.dtype.kind in "fiub"}


def _reduced(array: np.ndarray) -> dict:
    """Shape, kind and a few moments of an array; the weighted mean sees permutations."""
    values = array.astype(float).ravel()
    values = values[np.isfinite(values)]
    if not values.size:
        return {"shape": list(array.shape), "counts": False, "numbers": []}
    largest = np.abs(values).max() or 1.0  # whose square may be beyond all numbers
    numbers = [
        largest * np.sqrt(np.mean((values / largest) ** 2)),
        values.mean(),
        np.average(values, weights=np.linspace(1.0, 2.0, values.size)),
        values.min(),
        values.max(),
    ]
    return {"shape": list(array.shape), "counts": array.dtype.kind in "iub", "numbers": [float(n) for n in numbers]}


def _product(root: Path, name: str) -> Path:
    path = root / name
    if not path.exists():
        raise MarsedlError(f"{path}: there is no full build to compare; run 'snakemake all'")
    return path


def margins_of(name: str, reference: Mapping, values: Mapping) -> np.ndarray:
    """Return how far each number of a field's two reductions moved, in tolerances; infinite for another shape."""
    if reference["shape"] != values["shape"] or len(reference["numbers"]) != len(values["numbers"]):
        return np.array([np.inf])
    a, b = np.array(reference["numbers"]), np.array(values["numbers"])
    if reference["counts"]:
        return np.abs(a - b) / (1.0 + COUNT_TOLERANCE * np.abs(a))
    size = max([*a[:1], 1.0 if name.endswith(RESIDUALS) else SMALLEST_SCALE])
    return np.abs(a - b) / (RELATIVE_TOLERANCE * size)


@dataclass(frozen=True)
class Change:
    """What differs between committed and found: what a paper prints, a verdict, or a number beyond its tolerance."""

    name: str
    old: str
    new: str
    margin: float = np.inf  # in tolerances; of a verdict that of its number, infinite where one of the two is missing
    of: str = ""  # PUBLISHED, VERDICTS (and of counterexamples), or a number


@dataclass(frozen=True)
class Comparison:
    """A build and the committed numbers of one paper, compared."""

    changes: list[Change]  # what is printed, then verdicts, then numbers by margin
    margins: dict[str, float]  # of the numbers that both have
    by_shape: set[str]  # those whose numbers are left to rounding

    def of(self, kind: str) -> list[Change]:
        """Return the changes of one kind."""
        return [change for change in self.changes if change.of == kind]


def compare(
    reference: Mapping[str, dict | str], build: Mapping[str, dict | str], noise: Sequence[str] = ()
) -> Comparison:
    """Compare what is committed with what was found, both as `fingerprints` gives them.

    noise: patterns of names of which only the shape is compared.
    """
    names = dict.fromkeys([*reference, *build])
    numbers = [name for name in names if not name.startswith((PUBLISHED, VERDICTS, COUNTEREXAMPLES))]
    both = [name for name in numbers if name in reference and name in build]
    by_shape = {name for name in both if any(fnmatchcase(name, pattern) for pattern in noise)}
    expected = {name: reference[name] for name in both}
    expected |= {name: {**reference[name], "numbers": build[name]["numbers"]} for name in by_shape}
    moved = {name: margins_of(name, expected[name], build[name]) for name in both}
    margins = {name: float(max(each, default=0.0)) for name, each in moved.items()}

    changes = [
        Change(name.removeprefix(PUBLISHED), reference.get(name, _NOTHING), build.get(name, _NOTHING), of=PUBLISHED)
        for name in names
        if name.startswith(PUBLISHED) and reference.get(name) != build.get(name)
    ]
    for name in names:
        if name.startswith(VERDICTS):
            changes += _verdict_changes(name.removeprefix(VERDICTS), reference.get(name), build.get(name), margins)
    for name in names:
        if name.startswith(COUNTEREXAMPLES) and reference.get(name) != build.get(name):
            claim = f"{name.removeprefix(COUNTEREXAMPLES)}, counterexample"
            changes.append(Change(claim, reference.get(name, _NOTHING), build.get(name, _NOTHING), of=VERDICTS))
    beyond = [name for name in numbers if margins.get(name, np.inf) > 1]
    for name in sorted(beyond, key=lambda name: -margins.get(name, np.inf)):
        worst = int(np.argmax(moved.get(name, 0)))
        old, new = _described(reference.get(name), worst), _described(build.get(name), worst)
        changes.append(Change(name, old, new, margins.get(name, np.inf)))
    return Comparison(changes, margins, by_shape)


def _verdict_changes(claim: str, old: Mapping | None, new: Mapping | None, margins: Mapping) -> list[Change]:
    """The readings in which a claim has another verdict; one change for a claim that is new or gone."""
    if old is None or new is None:
        listed = (", ".join(sorted({*(side or {}).values()})) or _NOTHING for side in (old, new))
        return [Change(claim, *listed, of=VERDICTS)]
    return [
        Change(
            f"{claim}, {reading}",
            old.get(reading, _NOTHING),
            new.get(reading, _NOTHING),
            margins.get(f"claims/{claim}/{reading}", np.inf),
            VERDICTS,
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
    return f"shape {entry['shape']}, {MOMENTS[moment]} {number}" if entry["shape"] else number


def format_changes(comparison: Comparison) -> str:
    """Format changes as a table: name, old, new, margin; all claims, and the first numbers."""
    kinds, numbers = {PUBLISHED: "the paper's ", VERDICTS: "verdict of ", "": ""}, comparison.of("")
    shown = [*comparison.of(PUBLISHED), *comparison.of(VERDICTS), *numbers[:_ROWS]]
    rows = [("claim or field", "old", "new", "margin in tolerances")]
    rows += [(kinds[change.of] + change.name, change.old, change.new, f"{change.margin:.3g}") for change in shown]
    more = f"\n  and {len(numbers) - _ROWS} numbers more" if len(numbers) > _ROWS else ""
    return columns(rows, 2) + more


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
        names = sorted({name.rpartition("/")[0] for name in reference if not name.startswith(_OF_CLAIMS)})
        files = {name: build / shared.file(*name.split("/")) for name in names if shared.has(*name.split("/"))}
        comparison = compare(reference, _fingerprints(build, slug, files, folder), (noise or {}).get(slug, ()))
        without_reason = _unexplained(build, slug) if folder is None else []
        _print_comparison(slug, comparison, without_reason)
        agree = agree and not comparison.changes and not without_reason
    if not agree:
        remedy = REMEDY if folder is None else f"if the changes are intended, run '{accept_command(folder)}'"
        print(remedy, flush=True)
    return agree


def _fingerprints(build: Path, slug: str, files: Mapping[str, Path], folder: Path | None) -> dict[str, dict | str]:
    """What is compared with a reference: with the committed one, also what each counterexample turns a verdict into."""
    entries = fingerprints(build, slug, files)
    if folder is None:
        counterexamples = read_counterexamples(_product(build, f"report/counterexamples/{slug}.json"))
        entries |= {
            f"{COUNTEREXAMPLES}{n}": turned.to if turned else NOT_TURNED for n, turned in counterexamples.items()
        }
    return entries


def _unexplained(root: Path, slug: str) -> list[str]:
    return unexplained(read_claims(_product(root, f"report/claims/{slug}.json")))


def _print_comparison(slug: str, comparison: Comparison, without_reason: Iterable[str]) -> None:
    margins, rounding, printed = comparison.margins, len(comparison.by_shape), len(comparison.of(PUBLISHED))
    worst = max(margins, key=margins.get, default="none of them was built")
    missing = sum(change.new == _NOTHING for change in comparison.changes)
    print(
        f"{slug}: {len(margins) - rounding} numbers compared with {slug}.json, "
        f"{len(comparison.of(VERDICTS))} verdicts changed, "
        f"{sum(value > 1 for value in margins.values())} numbers beyond tolerance, {missing} missing; "
        f"worst margin {margins.get(worst, 0.0):.3g} tolerances ({worst})"
        + (f"; {rounding} that rounding decides compared by shape" if rounding else "")
        + (f"; {printed} printed claims differ from those accepted" if printed else "")
    )
    if comparison.changes:
        print(format_changes(comparison))
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
    build, texts = build_folder(root, size), {}
    for slug, shared in papers.items():
        path = reference_file(root, slug, folder)
        reference = read_reference(root, slug, folder) if path.exists() else {}
        files = {
            f"{reading}/{name}": build / file
            for reading in sorted(shared.readings)
            for name, file in sorted(shared.claimed(reading).items())
        }
        entries = _fingerprints(build, slug, files, folder)
        comparison = compare(reference, entries, (noise or {}).get(slug, ()))
        _print_comparison(slug, comparison, ())
        entries |= {name: reference[name] for name, value in comparison.margins.items() if value <= 1}
        lines = [f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items()]
        texts[path] = "{\n" + ",\n".join(lines) + "\n}\n"
    for path, text in texts.items():  # of all papers or of none
        write_text(path, text)
    return list(texts)
