"""The numbers, verdicts and printed claims of a build against the committed ones, or against a user's own."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path

import numpy as np

from marsedl.replication.claims import committed
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.committed import BUILD, COUNTEREXAMPLES, MOMENTS, PUBLISHED, VERDICTS
from marsedl.replication.claims.counts import plural
from marsedl.replication.claims.rows import read_claims, read_counterexamples, unexplained
from marsedl.replication.errors import InputError, MarsedlError, shown
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.readings import COMMITTED_INPUTS, Study, counted_inputs
from marsedl.replication.pipeline.catalogue import Paper
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.pipeline.libraries import versions_used
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.records.fields import TRIALS
from marsedl.replication.records.recipes import recipe_digest
from marsedl.replication.records.store import holds_field, opened
from marsedl.replication.terminal import columns, summarize

RELATIVE_TOLERANCE = 1e-6  # of the field's root mean square: far above rounding, far below every printed digit
SMALLEST_SCALE = 1e-3  # in the field's own unit: smaller fields are compared as if they were of this size
RESIDUALS = ("_error", "_gap", "_residual")  # fields of this name are zero but for rounding: compared as if of size one
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration
TRUTH_ROUNDING = 1e-9  # of the moments of truth values, which have no tolerance
NOT_TURNED = "not turned"  # of a claim without a counterexample that works
_NOTHING = "–"  # in a table, where one side has no such claim, verdict or field
TURNED, TURNED_MARKER = Path("docs/verdicts.md"), "<!-- turned: written by marsedl accept -->"
_TURNED_HEAD = re.compile(rf"{TURNED_MARKER}\n+\|.*\n\|[-|]+\n")  # the marker and the head of its table
_CLAIMS = "claims/"  # of the numbers that claims give; all other numbers are fields of artifacts
_TEXTS = (PUBLISHED, VERDICTS, COUNTEREXAMPLES)  # all others are numbers
_ROWS = 40  # numbers in a table of changes, unless all are asked for; verdicts and printed claims are all shown

Entries = Mapping[str, dict | str]  # by name, as the committed files hold them
Papers = Mapping[str, Shared]  # which file each artifact is, by paper
Made = Mapping[str, dict]  # what each paper is made from, see `made_from`


def fingerprints(rows: Sequence[Claim], cached: Mapping[str, Path]) -> dict[str, dict | str]:
    """Reduce a build of a paper to what is compared, by name: of artifacts, the moments of every field.

    rows: the paper's claims. cached: files of artifacts by "reading/artifact"; several readings may share one.
    """
    fields = cache(_reduced_fields)
    verdicts, published, numbers = {}, {}, {}
    for row in rows:
        published[f"{PUBLISHED}{row.id}"] = _printed(row)
        verdicts[f"{VERDICTS}{row.id}"] = {name: of.verdict for name, of in row.readings.items() if of.verdict}
        for reading, result in row.readings.items():
            if result.value is not None and not isinstance(result.value, str):
                numbers[f"{_CLAIMS}{row.id}/{reading}"] = _reduced(np.array(result.value))
    entries = verdicts | published | numbers
    for artifact, path in cached.items():
        entries |= {f"{artifact}/{name}": numbers for name, numbers in fields(path).items()}
    return entries


def made_from(root: Path, paper: Paper, study: Study, size: str) -> dict:
    """Return what a paper's build is made from, as its reference stores it.

    Holds the size, the inputs by reading as they are written (of others than `corrected`, those that differ from it),
    digests of the code behind the stages and the claims, and the versions of the libraries.
    """
    base = {key: source.written for key, source in study.readings[CORRECTED].sources.items()}
    inputs = {CORRECTED: base}
    for name, reading in study.readings.items():
        written = {key: source.written for key, source in reading.sources.items()}
        inputs.setdefault(name, {key: one for key, one in written.items() if key not in base or base[key] != one})
    sources, entries = fingerprints_of(root), {name: stage.entries for name, stage in paper.stages.items()}
    entries["claims"] = [*sources.functions(f"marsedl.papers.{paper.slug}.claims")]
    code = {name: recipe_digest([sources.code(entry) for entry in of]) for name, of in entries.items()}
    libraries = frozenset().union(*(sources.libraries(entry) for of in entries.values() for entry in of))
    made = {"size": size, "inputs": inputs, "code": code, "libraries": versions_used(libraries)}
    return json.loads(json.dumps(made))


def causes(old: Mapping, new: Mapping) -> list[str]:
    """Say which inputs, code and libraries differ between what two builds were made from."""
    lines, bases = [], [side["inputs"][CORRECTED] for side in (old, new)]
    for reading in (name for name in new["inputs"] if name in old["inputs"]):
        sides = [side["inputs"][reading] for side in (old, new)]
        for name in dict.fromkeys([*sides[0], *sides[1]]):
            before, after = (side.get(name, base.get(name)) for side, base in zip(sides, bases, strict=True))
            if before != after:
                lines.append(f"{reading}: {name} {shown(before)} -> {shown(after)}")
    if changed := [name for name, digest in new["code"].items() if old["code"].get(name) != digest]:
        lines.append(f"code behind {', '.join(changed)}")
    before, after = (side["libraries"].split(", ") for side in (old, new))
    lines += [f"library {name}" for name in after if name not in before]
    return lines


def _printed(row: Claim) -> str:
    """What the paper prints, as far as a verdict depends on it, in one line."""
    value = str(row.printed).replace("'inf'", "inf")  # which JSON has as a text
    parts = [f"{value} {row.unit}".removesuffix(" 1"), row.kind]
    parts += [f"last digit {row.resolution}"] * (row.resolution is not None)
    parts += [f"{row.trials} trials"] * (row.trials is not None)
    return ", ".join(parts)


def _reduced_fields(path: Path) -> dict[str, dict]:
    """The reduced fields of an artifact that are numbers; none of one that is missing."""
    if not path.exists():
        return {}
    found = {}
    with opened(path) as file:
        for name in filter(partial(holds_field, file), sorted(file)):
            field = file[name]
            if field.dtype.kind not in "fiub":
                continue
            array = np.array(field)
            found[name] = _reduced(array)
            # Of single trials by component: beside a mass of a ton, no moment of all would see a scatter in metres.
            scales = field.dims[array.ndim - 1].values() if TRIALS in field.attrs["dimensions"] else ()
            labels = [label for scale in scales if scale.dtype.kind == "O" for label in scale.asstr()[()]]
            found |= {f"{name}[{label}]": _reduced(array[..., place]) for place, label in enumerate(labels)}
    return found


def _reduced(array: np.ndarray) -> dict:
    """Shape, kind and a few moments of an array; the weighted mean sees permutations."""
    kind = {"counts": array.dtype.kind in "iub", **({"truth": True} if array.dtype.kind == "b" else {})}
    values = array.astype(float).ravel()
    values = values[np.isfinite(values)]
    if not values.size:
        return {"shape": list(array.shape), "counts": False, "numbers": []}
    largest = np.abs(values).max() or 1.0  # whose square may be beyond all numbers
    root_mean_square = largest * np.sqrt(np.mean((values / largest) ** 2))
    weighted = np.average(values, weights=np.linspace(1.0, 2.0, values.size))
    numbers = [float(n) for n in (root_mean_square, values.mean(), weighted, values.min(), values.max())]
    return {"shape": list(array.shape), **kind, "numbers": numbers}


def _field(name: str) -> str:
    """The field of a component."""
    return name.partition("[")[0]


def margins_of(name: str, reference: Mapping, values: Mapping) -> np.ndarray:
    """Return how far each number of a field moved, in tolerances; infinite for another shape or truth value."""
    if reference["shape"] != values["shape"] or len(reference["numbers"]) != len(values["numbers"]):
        return np.array([np.inf])
    a, b = np.array(reference["numbers"]), np.array(values["numbers"])
    if "truth" in {*reference, *values}:
        return np.where(np.abs(a - b) > TRUTH_ROUNDING, np.inf, 0.0)
    size = max([*a[:1], 1.0 if _field(name).endswith(RESIDUALS) else SMALLEST_SCALE])
    tolerance = 1.0 + COUNT_TOLERANCE * np.abs(a) if reference["counts"] else RELATIVE_TOLERANCE * size
    return np.abs(a - b) / tolerance


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
    """A build and the reference of one paper, compared."""

    changes: list[Change]  # numbers last, by their margin
    margins: dict[str, float]  # of the numbers that both have
    by_shape: set[str]  # those whose numbers are left to rounding

    def of(self, kind: str) -> list[Change]:
        """Return the changes of one kind."""
        return [change for change in self.changes if change.of == kind]


def compare(reference: Entries, build: Entries, noise: Sequence[str] = ()) -> Comparison:
    """Compare what is committed with what was found, both as `fingerprints` gives them.

    noise: patterns of names of which only the shape is compared.
    """
    names, numbers, margins, by_shape, changes = dict.fromkeys([*reference, *build]), [], {}, set(), []
    for name in (name for name in names if not name.startswith(_TEXTS)):
        old, new, moved = reference.get(name), build.get(name), np.array([np.inf])
        if old and new:
            expected = old
            if any(fnmatchcase(_field(name), pattern) for pattern in noise):
                by_shape.add(name)
                expected = {**old, "numbers": new["numbers"]}
            moved = margins_of(name, expected, new)
            margins[name] = float(moved.max(initial=0.0))
        if (moved > 1).any():
            worst = int(np.argmax(moved))
            numbers.append(Change(name, _described(old, worst), _described(new, worst), float(moved[worst])))
    for name in (name for name in names if name.startswith(_TEXTS)):
        old, new = _texts(name, reference.get(name)), _texts(name, build.get(name))
        kind = PUBLISHED if name.startswith(PUBLISHED) else VERDICTS
        for label in old | new:
            before, now = old.get(label, _NOTHING), new.get(label, _NOTHING)
            if before != now:
                margin = margins.get(_CLAIMS + label.replace(", ", "/"), np.inf)
                changes.append(Change(label, before, now, margin, kind))
    return Comparison([*changes, *sorted(numbers, key=lambda change: -change.margin)], margins, by_shape)


def _texts(name: str, entry: Mapping[str, str] | str | None) -> Mapping[str, str]:
    """What is printed of a claim, or the verdicts on it, by what they are called in a table of changes."""
    claim = name.partition("/")[2]
    if isinstance(entry, Mapping):
        return {f"{claim}, {reading}": verdict for reading, verdict in entry.items()}
    return {} if entry is None else {claim if name.startswith(PUBLISHED) else f"{claim}, counterexample": entry}


def _described(entry: Mapping | None, moment: int) -> str:
    """A reduced field in a few words: its number, the moment of an array that moved most, or its shape."""
    if entry is None:
        return _NOTHING
    if moment >= len(entry["numbers"]):
        return f"shape {entry['shape']}, no finite number"
    number = f"{entry['numbers'][moment]:.10g}"
    if entry.get("truth") and not entry["shape"]:
        return "true" if entry["numbers"][moment] else "false"
    return f"shape {entry['shape']}, {MOMENTS[moment]} {number}" if entry["shape"] else number


def format_changes(comparison: Comparison, rows: Sequence[Claim] = (), *, all_of_them: bool = True) -> str:
    """Format changes as a table: name, old, new, how far apart; internals are counted unless all are asked for.

    rows: the claims of the build, which say what they are about. The distance of two of a claim's single numbers is in
    standard errors, any other in tolerances.
    """
    words = {row.id: (row.plain or row.quantity).rstrip(".") for row in rows}
    errors = {f"{_CLAIMS}{row.id}/{name}": of.standard_error for row in rows for name, of in row.readings.items()}
    kinds, numbers = {PUBLISHED: "the paper's ", VERDICTS: "verdict of ", "": ""}, comparison.of("")
    claims = [change for change in numbers if change.name.startswith(_CLAIMS)]
    inner = [change for change in numbers if not change.name.startswith(_CLAIMS)]
    shown_ones = [*claims, *inner] if all_of_them else claims[:_ROWS]
    lines = [("claim or field", "accepted", "now", "apart")]
    for change in [*comparison.of(PUBLISHED), *comparison.of(VERDICTS), *shown_ones]:
        apart, error = "", errors.get(change.name)
        if np.isfinite(change.margin) and error and isinstance(error, int | float):
            off = abs(float(change.new) - float(change.old)) / float(np.sqrt(2.0) * error)
            apart = f"{off:.3g} standard errors"
        elif change.of and change.margin == 0.0:
            apart = "same number"
        elif np.isfinite(change.margin):
            apart = f"{change.margin:.3g} tolerances"
        name = change.name.removeprefix(_CLAIMS)
        said = words.get(re.split("[/,]", name)[0]) if change.of or name != change.name else ""
        named = f"{said} ({kinds[change.of]}{name})" if said else kinds[change.of] + name
        lines.append((named, change.old, change.new, apart))
    parts = [columns(lines, 2)] if len(lines) > 1 else []
    artifacts = len({change.name.rpartition("/")[0] for change in inner})
    folded = [f"{plural(len(claims) - _ROWS, 'number')} of claims more"] * (len(claims) > _ROWS)
    folded += [f"{plural(len(inner), 'number')} of {plural(artifacts, 'artifact')}"] * bool(inner)
    if folded and not all_of_them:
        parts.append(f"  and {' and '.join(folded)}; --all shows them")
    return "\n".join(parts)


def check_size(root: Path, slugs: Iterable[str], folder: Path | None, size: str) -> None:
    """Raise InputError if a reference, as far as it is there, was accepted at another size."""
    for slug in slugs:
        path = committed.reference_file(root, slug, folder)
        of = committed.read_reference(root, slug, folder).get(BUILD) if path.exists() else None
        if of and of["size"] != size:
            raise InputError(f"{path} was accepted at size {of['size']}; you compare {size}")


def compare_reference(
    root: Path, build: Path, papers: Papers, made: Made, folder: Path | None = None, *, all_of_them: bool = False
) -> bool:
    """Compare a build with reference numbers; prints what changed before it, then the claims and the worst margin.

    folder: holds a reference of the user's own; without it, the build is compared with the committed numbers and
    counterexamples, and is refused as well if a verdict is not explained.
    Readings of the build's claims that no configuration names are left out, and said.
    Raises InputError if the reference has readings that no configuration names, or no verdict at all.
    """
    reasons, tables, details, agree = [], [], [], True
    for slug, shared in papers.items():
        reference = committed.read_reference(root, slug, folder)
        rows, found, refused = _found(build, shared, folder)
        if accepted := reference.pop(BUILD, None):
            reasons += [f"  {slug}, {line}" for line in causes(accepted, made[slug])]
        known, path = shared.study.readings, committed.reference_file(root, slug, folder)
        if not _readings_of(reference):
            raise InputError(f"{path} holds no verdict, so nothing would be compared; restore it, or accept again")
        if lost := _readings_of(reference) - known.keys():
            has = f"{path} has {', '.join(sorted(lost))}, which is not configured here"
            raise InputError(f"{has}; give the --configfile that holds it, or accept")
        new = (_readings_of(found) - _readings_of(reference)) & shared.study.own_readings
        comparison = compare(reference, _without(found, new), shared.paper.noise)
        lines = [_summary(slug, comparison), *(f"  {text}" for text in refused)]
        lines += [f"  note: reading {name} has no reference yet; 'marsedl accept' stores it" for name in sorted(new)]
        beside = dict.fromkeys(name for row in rows for name in row.readings if name not in known)
        lines += [f"  note: reading {name} is not configured here, and not compared" for name in beside]
        if comparison.changes:
            lines.append(format_changes(comparison, rows, all_of_them=all_of_them))
            details.append(format_changes(comparison, rows))
        tables.append("\n".join(lines))
        agree = agree and not comparison.changes and not refused
    head = ["changed since these numbers were accepted:", *reasons] if reasons else []
    text = "\n".join([*head, *tables])
    print(text)
    summarize(text, "\n".join(details))
    if not agree:
        own = folder and f"run '{committed.accept_command(folder)}' with the options of this check"
        print("if the changes are intended,", own or "accept them with 'marsedl accept' after a full build", flush=True)
    return agree


def _readings_of(entries: Entries) -> set[str]:
    """The readings that have a verdict."""
    return {reading for name, of in entries.items() if name.startswith(VERDICTS) for reading in of}


def _without(entries: Entries, readings: Iterable[str]) -> Entries:
    """Entries without all that is of some readings."""
    left = {}
    for name, entry in entries.items():
        if name.startswith(VERDICTS):
            left[name] = {reading: verdict for reading, verdict in entry.items() if reading not in readings}
        elif name.split("/")[2 if name.startswith(_CLAIMS) else 0] not in readings:
            left[name] = entry
    return left


def accept_reference(root: Path, build: Path, papers: Papers, made: Made, folder: Path | None = None) -> list[Path]:
    """Store the numbers of a build that is up to date as reference; prints what changes, as `compare_reference` does.

    Of a first reference, or one of another size, it prints how many verdicts and numbers it holds. Numbers within
    tolerance keep their stored digits, so that the files show what moved and nothing else. The page on verdicts gets a
    row for each verdict of `corrected` that turned.
    Returns the files. Raises MarsedlError, and writes nothing, if a verdict of the committed numbers is not explained.
    """
    texts, turned = {}, []
    for slug, shared in papers.items():
        path, (rows, found, refused) = committed.reference_file(root, slug, folder), _found(build, shared, folder)
        if refused:
            raise MarsedlError(f"{refused[0]}; state it in src/marsedl/papers/{slug}/claims first")
        reference = committed.read_reference(root, slug, folder) if path.exists() else {}
        accepted = reference.pop(BUILD, None)
        if accepted and accepted["size"] != made[slug]["size"]:
            reference = {}
        comparison = compare(reference, found, shared.paper.noise)
        if reference:
            print(_summary(slug, comparison))
            if comparison.changes:
                print(format_changes(comparison, rows, all_of_them=False))
        else:
            verdicts = sum(len(entry) for name, entry in found.items() if name.startswith(VERDICTS))
            numbers = sum(not name.startswith(_TEXTS) for name in found)
            print(f"{slug}: first reference of size {made[slug]['size']}: {verdicts} verdicts, {numbers} numbers")
        kept = [name for name, margin in comparison.margins.items() if margin <= 1]
        found |= {name: reference[name] for name in kept if reference[name].keys() == found[name].keys()}
        texts[path] = committed.entries_text({BUILD: made[slug], **found})
        changes = [change for change in comparison.of(VERDICTS) if change.old != _NOTHING]
        turned += [(slug, change) for change in changes if change.name.endswith(f", {CORRECTED}")]
    if turned and folder is None and (root / TURNED).exists():
        texts[root / TURNED] = _with_turned((root / TURNED).read_text(encoding="utf-8"), turned)
    for path, text in texts.items():  # of all papers or of none
        write_text(path, text)
    return list(texts)


def _with_turned(page: str, turned: Iterable[tuple[str, Change]]) -> str:
    """The page on verdicts with a row for each that turned, newest first; a row written before keeps its reason."""
    head = _TURNED_HEAD.search(page)
    if not head:
        raise MarsedlError(f"{TURNED} has no table below '{TURNED_MARKER}'; restore it with 'git checkout {TURNED}'")
    table, rows = page[head.end() :].partition("\n\n")[0], ""
    for slug, change in turned:
        claim = f"| {slug}, `{change.name.removesuffix(f', {CORRECTED}')}` |"
        row = f"{claim} {change.old} | {change.new} |"
        if not (claim + table.partition(claim)[2]).startswith(row):
            rows += f"{row} why not said yet: write it here |\n"
    return page[: head.end()] + rows + page[head.end() :]


def accept_inputs(root: Path, studies: Mapping[str, Study]) -> Path:
    """Store the digests of the inputs behind the verdicts: with these inputs, each refuted claim needs a reason."""
    digests = {slug: counted_inputs(study) for slug, study in studies.items()}
    write_text(root / COMMITTED_INPUTS, json.dumps(digests, indent=1) + "\n")
    return root / COMMITTED_INPUTS


def _found(build: Path, shared: Shared, folder: Path | None) -> tuple[list[Claim], dict[str, dict | str], list[str]]:
    """A build's claims, what of it is compared with a reference, and which verdicts are refused.

    Readings that no configuration names are not compared: who builds with one of their own leaves them in the claims.

    With the committed reference, what each counterexample turns a verdict into is compared, too, and verdicts without
    the reason that they need are refused.
    """
    slug, files = shared.paper.slug, {}
    rows = read_claims(build / f"report/claims/{slug}.json")
    for reading in sorted(shared.study.built):
        files |= {f"{reading}/{name}": build / file for name, file in sorted(shared.claimed(reading).items())}
    entries = fingerprints(rows, files)
    entries = _without(entries, _readings_of(entries) - shared.study.readings.keys())
    if folder is not None:
        return rows, entries, []
    turned = read_counterexamples(build / f"report/counterexamples/{slug}.json")
    entries |= {f"{COUNTEREXAMPLES}{name}": each.to if each else NOT_TURNED for name, each in turned.items()}
    reason = "differs or fails without a reason that names an erratum"
    return rows, entries, [f"{slug}: claim {claim} {reason}" for claim in unexplained(rows)]


def _summary(slug: str, comparison: Comparison) -> str:
    """What was compared and how much of it differs, in a line."""
    margins, rounding, printed = comparison.margins, len(comparison.by_shape), len(comparison.of(PUBLISHED))
    worst = max(margins, key=margins.get, default="none of them was built")
    beyond = sum(margin > 1 for margin in margins.values())
    furthest = f"worst margin {margins.get(worst, 0.0):.3g} tolerances ({worst})"
    if np.isinf(margins.get(worst, 0.0)):
        furthest = f"another truth value or shape ({worst})"
    moved = furthest if any(margins.values()) or not margins else "every number as accepted"
    return (
        f"{slug}: {len(margins) - rounding} numbers compared with {slug}.json, "
        f"{plural(len(comparison.of(VERDICTS)), 'verdict')} changed, "
        f"{plural(beyond, 'number')} beyond tolerance, "
        f"{sum(change.new == _NOTHING for change in comparison.changes)} missing; {moved}"
        + f"; {rounding} that rounding decides compared by shape" * bool(rounding)
        + f"; {plural(printed, 'printed claim')} not as accepted" * bool(printed)
    )
