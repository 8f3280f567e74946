"""The numbers, verdicts and printed claims of a build against the committed ones, or against a user's own."""

import json
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path

import h5py
import numpy as np

from marsedl.replication.claims import committed
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.committed import BUILD, COUNTEREXAMPLES, MOMENTS, PUBLISHED, VERDICTS
from marsedl.replication.claims.counts import plural
from marsedl.replication.claims.moved import Entry, Moved, largest_first, moved, relative
from marsedl.replication.claims.numbers import NOT_EVALUATED, format_number, told_apart
from marsedl.replication.claims.rows import Counterexamples, read_as, read_claims, unexplained
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
# Fields of these names are zero but for rounding: compared as if of size one.
RESIDUALS = ("_error", "gap", "gap_above_floor", "residual", "complementarity")
COUNT_TOLERANCE = 0.02  # of iteration counts, which jump where rounding decides the last iteration
TRUTH_ROUNDING = 1e-9  # of the moments of truth values, which have no tolerance
NOT_TURNED = "not turned"  # of a claim without a counterexample that works
TURNED, TURNED_MARKER = Path("docs/verdicts.md"), "<!-- turned: written by marsedl accept -->"
_TURNED_HEAD = re.compile(rf"{TURNED_MARKER}\n+\|.*\n\|[-|]+\n")  # the marker and the head of its table
_CLAIMS = "claims/"  # of the numbers that claims give; all other numbers are fields of artifacts
_KINDS = {PUBLISHED: "the paper's ", VERDICTS: "verdict of ", _CLAIMS: ""}  # as a table of changes names them
_TEXTS = (PUBLISHED, VERDICTS)  # all others are numbers
_TRUTH, _BY_SHAPE = "true or false", "by shape"  # what is said of numbers
_NONE = np.array([])  # the numbers of a text
_MOST_COMPONENTS = 20  # along the last dimension of a field; more are times or the like
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
    """The reduced fields of an artifact that are numbers, of an ensemble also by component; none if it is missing."""
    if not path.exists():
        return {}
    found = {}
    with opened(path) as file:
        names = list(filter(partial(holds_field, file), sorted(file)))
        is_ensemble = any(TRIALS in file[name].attrs["dimensions"] for name in names)
        for name in (name for name in names if file[name].dtype.kind in "fiub"):
            array = np.array(file[name])
            found[name] = _reduced(array)
            # Beside a mass of a ton, no moment of all states would see a scatter in metres.
            labels = _components(file[name]) if is_ensemble and array.ndim > 1 else []
            found |= {f"{name}[{label}]": _reduced(array[..., place]) for place, label in enumerate(labels)}
    return found


def _components(field: h5py.Dataset) -> list[str]:
    """What entries along the last dimension of a field of an ensemble are called, if they are states or the like."""
    extent, last = field.shape[-1], field.attrs["dimensions"].strip("()").rpartition(", ")[2]
    if last == TRIALS or extent > _MOST_COMPONENTS:
        return []
    names = [scale for scale in field.dims[field.ndim - 1].values() if scale.dtype.kind == "O"]
    return [*names[0].asstr()[()]] if names else [str(place + 1) for place in range(extent)]


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


def _side(entries: Entries, truths: Collection[str], by_shape: Collection[str]) -> dict[str, Entry]:
    """What is committed, or found, as one side of a comparison: texts as verdicts, numbers with their tolerances."""
    side = {}
    for name, of in entries.items():
        if name.startswith(VERDICTS):
            side |= {f"{name}, {reading}": Entry(_NONE, verdict=verdict) for reading, verdict in of.items()}
        elif isinstance(of, str):
            claim, is_turned = name.partition("/")[2], name.startswith(COUNTEREXAMPLES)
            side[f"{VERDICTS}{claim}, counterexample" if is_turned else name] = Entry(_NONE, verdict=of)
        elif name in by_shape:
            side[name] = Entry(_NONE, unit=f"shape {of['shape']}", said=_BY_SHAPE)
        else:
            numbers, unit = np.array(of["numbers"]), f"shape {of['shape']}"
            size = max([*numbers[:1], 1.0 if _field(name).endswith(RESIDUALS) else SMALLEST_SCALE])
            rounding = 1.0 + COUNT_TOLERANCE * np.abs(numbers) if of["counts"] else RELATIVE_TOLERANCE * size
            rounding, said = (TRUTH_ROUNDING, _TRUTH) if name in truths else (rounding, "")
            unit += "" if len(numbers) else ", no finite number"
            side[name] = Entry(numbers, unit=unit, rounding=rounding, said=said)
    return side


def compare(reference: Entries, build: Entries, noise: Sequence[str] = ()) -> list[Moved]:
    """Compare what is committed with what was found, both as `fingerprints` gives them.

    noise: patterns of names of which only the shape is compared.
    """
    every = reference | build
    by_shape = {name for name in every if any(fnmatchcase(_field(name), pattern) for pattern in noise)}
    truths = {name for one in (reference, build) for name, of in one.items() if isinstance(of, dict) and "truth" in of}
    both = moved(*(_side(one, truths, by_shape) for one in (reference, build)), relative)
    # A truth value has no tolerance.
    return [one._replace(size=math.inf) if one.name in truths and one.size > 1.0 else one for one in both]


def changes(both: Iterable[Moved], kind: str) -> list[Moved]:
    """Return what differs of one kind: PUBLISHED, VERDICTS (and of counterexamples), or else numbers, largest first."""
    if kind:
        return [one for one in both if one.counts and one.name.startswith(kind)]
    return sorted((one for one in both if one.counts and not one.name.startswith(_TEXTS)), key=largest_first)


def sizes_of(both: Iterable[Moved]) -> dict[str, float]:
    """Return how far each number that both sides have moved, in tolerances; infinite for another shape or truth."""
    return {one.name: one.size for one in both if one.is_on_both and not one.name.startswith(_TEXTS)}


def _furthest(one: Moved) -> int:
    """The place of the moment that moved most, if both sides have the same moments."""
    if one.is_on_both and one.same_unit and len(one.before.value):
        return int(np.argmax(np.abs(one.before.value - one.after.value) / one.before.rounding))
    return 0


def _described(one: Moved) -> list[str]:
    """Both sides in a few words: a text; a number, the moment of an array that moved most, or its shape."""
    at = _furthest(one)

    def text(entry: Entry | None, other: Entry | None) -> str:
        if entry is None:
            return NOT_EVALUATED
        if not len(entry.value):
            return entry.verdict or entry.unit
        if other is not None and len(other.value):
            number, _ = told_apart(entry.value[at], other.value[at])
        else:
            number = format_number(entry.value[at])
        if entry.unit != "shape []":
            return f"{entry.unit}, {MOMENTS[at]} {number}"
        return {"1": "true", "0": "false"}.get(number, number) if entry.said == _TRUTH else number

    return [text(one.before, one.after), text(one.after, one.before)]


def format_changes(both: Sequence[Moved], rows: Sequence[Claim] = (), *, all_of_them: bool = True) -> str:
    """Format changes as a table: name, old, new, how far apart; internals are counted unless all are asked for.

    rows: the claims of the build, which say what they are about. The distance of two of a claim's single numbers is in
    standard errors, any other in tolerances.
    """
    words = {row.id: (row.plain or row.quantity).rstrip(".") for row in rows}
    errors = {f"{_CLAIMS}{row.id}/{name}": of.standard_error for row in rows for name, of in row.readings.items()}
    numbers, sizes = changes(both, ""), sizes_of(both)
    claims = [one for one in numbers if one.name.startswith(_CLAIMS)]
    inner = [one for one in numbers if not one.name.startswith(_CLAIMS)]
    shown_ones = [*claims, *inner] if all_of_them else claims[:_ROWS]
    lines = [("claim or field", "accepted", "now", "apart")]
    for one in [*changes(both, PUBLISHED), *changes(both, VERDICTS), *shown_ones]:
        kind = next((kind for kind in _KINDS if one.name.startswith(kind)), "")
        name, (old, new), error = one.name.removeprefix(kind), _described(one), errors.get(one.name)
        is_text = one.name.startswith(_TEXTS)
        size = sizes.get(_CLAIMS + name.replace(", ", "/"), math.inf) if is_text else one.size
        apart = f"{size:.3g} tolerances" if np.isfinite(size) else ""
        if is_text and size == 0.0:
            apart = "same number"
        elif apart and error and isinstance(error, int | float):
            at = _furthest(one)
            off = abs(one.after.value[at] - one.before.value[at]) / (math.sqrt(2.0) * error)
            apart = f"{off:.3g} standard errors"
        said = words.get(re.split("[/,]", name)[0]) if kind else ""
        named = _KINDS.get(kind, "") + name
        lines.append((f"{said} ({named})" if said else named, old, new, apart))
    parts = [columns(lines, 2)] if len(lines) > 1 else []
    artifacts = len({one.name.rpartition("/")[0] for one in inner})
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
        later = _later(reference, found)
        compared = {name: of for name, of in _without(found, new).items() if name not in later}
        both = compare(reference, compared, shared.paper.noise)
        lines = [_summary(slug, both), *(f"  {text}" for text in refused)]
        if later:
            lines.append(
                f"  note: {len(later)} numbers of single states have no reference yet; 'marsedl accept' stores them"
            )
        lines += [f"  note: reading {name} has no reference yet; 'marsedl accept' stores it" for name in sorted(new)]
        beside = dict.fromkeys(name for row in rows for name in row.readings if name not in known)
        lines += [f"  note: reading {name} is not configured here, and not compared" for name in beside]
        changed = format_changes(both, rows, all_of_them=all_of_them)
        if changed:
            lines.append(changed)
            details.append(format_changes(both, rows))
        tables.append("\n".join(lines))
        agree = agree and not changed and not refused
    head = ["changed since these numbers were accepted:", *reasons] if reasons else []
    text = "\n".join([*head, *tables])
    print(text)
    summarize(text, "\n".join(details))
    if not agree:
        own = folder and f"run '{committed.accept_command(folder)}' with the options of this check"
        print("if the changes are intended,", own or "accept them with 'marsedl accept' after a full build", flush=True)
    return agree


def _later(reference: Entries, found: Entries) -> set[str]:
    """Components of fields that a reference has only as a whole: it was written before they were told apart."""
    new = (name for name in found if name not in reference)
    return {name for name in new if _field(name) != name and _field(name) in reference}


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
        both = compare(reference, found, shared.paper.noise)
        if reference:
            print(_summary(slug, both))
            if changed := format_changes(both, rows, all_of_them=False):
                print(changed)
        else:
            verdicts = sum(len(entry) for name, entry in found.items() if name.startswith(VERDICTS))
            numbers = sum(isinstance(entry, Mapping) and not name.startswith(_TEXTS) for name, entry in found.items())
            print(f"{slug}: first reference of size {made[slug]['size']}: {verdicts} verdicts, {numbers} numbers")
        kept = [name for name, size in sizes_of(both).items() if size <= 1.0]
        found |= {name: reference[name] for name in kept if reference[name].keys() == found[name].keys()}
        texts[path] = committed.entries_text({BUILD: made[slug], **found})
        changed = [one for one in changes(both, VERDICTS) if one.before]
        turned += [(slug, one) for one in changed if one.name.endswith(f", {CORRECTED}")]
    if turned and folder is None and (root / TURNED).exists():
        texts[root / TURNED] = _with_turned((root / TURNED).read_text(encoding="utf-8"), turned)
    for path, text in texts.items():  # of all papers or of none
        write_text(path, text)
    return list(texts)


def _with_turned(page: str, turned: Iterable[tuple[str, Moved]]) -> str:
    """The page on verdicts with a row for each that turned, newest first; a row written before keeps its reason."""
    head = _TURNED_HEAD.search(page)
    if not head:
        raise MarsedlError(f"{TURNED} has no table below '{TURNED_MARKER}'; restore it with 'git checkout {TURNED}'")
    table, rows = page[head.end() :].partition("\n\n")[0], ""
    for slug, one in turned:
        name = one.name.removeprefix(VERDICTS).removesuffix(f", {CORRECTED}")
        claim = f"| {slug}, `{name}` |"
        row = f"{claim} {' | '.join(_described(one))} |"
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
    turned = read_as(Counterexamples, build / f"report/counterexamples/{slug}.json")
    entries |= {f"{COUNTEREXAMPLES}{name}": each.to if each else NOT_TURNED for name, each in turned.items()}
    reason = "differs or fails without a reason that names an erratum"
    return rows, entries, [f"{slug}: claim {claim} {reason}" for claim in unexplained(rows)]


def _summary(slug: str, both: Sequence[Moved]) -> str:
    """What was compared and how much of it differs, in a line."""
    sizes, printed = sizes_of(both), len(changes(both, PUBLISHED))
    rounding = sum(one.is_on_both and one.before.said == _BY_SHAPE for one in both)
    worst = max(sizes, key=sizes.get, default="none of them was built")
    beyond = sum(size > 1.0 for size in sizes.values())
    furthest = f"worst margin {sizes.get(worst, 0.0):.3g} tolerances ({worst})"
    if np.isinf(sizes.get(worst, 0.0)):
        furthest = f"another truth value or shape ({worst})"
    furthest = furthest if any(sizes.values()) or not sizes else "every number as accepted"
    text = (
        f"{slug}: {len(sizes) - rounding} numbers compared with {slug}.json, "
        f"{plural(len(changes(both, VERDICTS)), 'verdict')} changed, "
        f"{plural(beyond, 'number')} beyond tolerance, "
        f"{sum(one.after is None for one in both)} missing; {furthest}"
    )
    text += f"; {rounding} that rounding decides compared by shape" if rounding else ""
    return text + (f"; {plural(printed, 'printed claim')} not as accepted" if printed else "")
