"""What moved between two readings, builds or universes of a paper: inputs, verdicts, numbers and figures."""

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.inputs.readings import Study
from marsedl.replication.pipeline.catalogue import Paper
from marsedl.replication.records import store
from marsedl.replication.report.one_line import with_unit
from marsedl.replication.universes.table import VERDICTS, Universes, components_of, decoded, half_digit, size_of_change
from marsedl.replication.universes.what_if import Moved

_UNIVERSE = "universe:"
_TEMPLATE = Path(__file__).with_name("compare.html.j2")


class Side(NamedTuple):
    """One of the two that are compared: inputs or choices as they are written, and what the claims give."""

    name: str
    inputs: Mapping[str, str]
    verdicts: Mapping[str, str]
    numbers: Mapping[str, tuple[float, float, float]]  # value, error and limit by component, such as "mean[1]"
    figures: Path | None = None


class Changed(NamedTuple):
    """An input that differs."""

    name: str
    before: str
    after: str


class Difference(NamedTuple):
    """What moved between two sides: inputs that differ, claims that move, claims that only one of them evaluates."""

    before: Side
    after: Side
    inputs: list[Changed]
    moved: list[Moved]
    alone: list[str]


def of_reading(name: str, study: Study, rows: Sequence[Claim], figures: Path) -> Side:
    """Return a reading, or a named point, of a build; rows: the paper's claims; figures: the folder of its figures.

    Raises InputError if its claims are not built.
    """
    results = {row.id: row.readings[name] for row in rows if name in row.readings and row.readings[name].verdict}
    if not results:
        raise InputError(f"the claims of {name} are not built; run 'snakemake report/claims/{study.paper}.json'")
    numbers = {}
    for row in rows:
        if (one := results.get(row.id)) is None:
            continue
        if row.is_statement:
            margin = one.margin
            found = {(): (margin.value, margin.standard_error or 0.0, margin.limit)} if margin else {}
        else:
            values, errors, printed = map(flatten, (one.value, one.standard_error, row.printed))
            places = [at for at in printed if is_number(values.get(at))]
            found = {at: (values[at], errors.get(at) or 0.0, printed[at]) for at in places}
        numbers |= {row.id + "".join(f"[{i + 1}]" for i in at): those for at, those in found.items()}
    sources = study.readings[name].sources.items()
    inputs = {"size": study.size} | {key: with_unit(str(source.written), source.unit) for key, source in sources}
    place = figures if name == CORRECTED else figures / name
    return Side(name, inputs, {name: one.verdict for name, one in results.items()}, numbers, place)


def of_other_build(name: str, study: Study, build: Path) -> Side:
    """Return a reading of a build that other code or other inputs may have made; its artifacts say which inputs.

    Raises InputError if its claims or artifacts are not there.
    """
    side, used = side_of(name, study, build), {}
    own, shared = (json.loads(json.dumps(study.readings[one].inputs.plain())) for one in (name, CORRECTED))
    folders = [build / "data/cache" / study.paper / reading for reading in dict.fromkeys((CORRECTED, name))]
    for path in (path for folder in folders for path in sorted(folder.glob("*.h5"))):
        made = store.provenance(path)
        theirs = path.parent.name == name  # else an artifact of corrected, which tells what the two share
        used |= {key: value for key, value in made["inputs"].items() if theirs or own.get(key) == shared.get(key)}
    if not used:
        raise InputError(f"{folders[-1]} has no artifacts, which say what inputs they were made with; copy them too")
    inputs = study.readings[name].inputs
    other = {key: with_unit(str(value), inputs.unit(key) if key in own else "")
             for key, value in used.items() if own.get(key) != value}  # fmt: skip
    return side._replace(name=f"{build}:{name}", inputs={**side.inputs, **other, "size": made["size"]})


def of_universe(number: int, study: Study, path: Path) -> Side:
    """Return a universe of a build; path: the table of universes. Raises InputError if it is not there."""
    if not path.exists():
        raise InputError(f"{path} is missing; run 'snakemake report/universes/{study.paper}.h5'")
    table = store.load(path, Universes, paper=study.paper)
    places = np.flatnonzero(table.number == number)
    if not places.size:
        first = ", ".join(map(str, table.number[:3]))
        raise InputError(f"{path} has no universe {number}; its numbers begin with {first}")
    if table.assignment.shape[1] != len(study.choices):
        raise InputError(f"{path} has other choices than this project; build it again")
    at = int(places[0])
    values = {name: f"{value:.4g}" if isinstance(value, float) else str(value)
              for name, value in decoded(study.choices, table.assignment[at]).items()}  # fmt: skip
    of = zip(table.component, table.value[at], table.error[at], table.limit[at], strict=True)
    verdicts = {str(name): VERDICTS[code] for name, code in zip(table.claim, table.verdict[at], strict=True)}
    numbers = {str(label): (float(v), float(e), float(m)) for label, v, e, m in of if math.isfinite(v)}
    return Side(f"universe {number}", values, verdicts, numbers)


def moved_claims(before: Side, after: Side, published: Sequence[PublishedClaim]) -> list[Moved]:
    """Return what moves of the claims that both evaluate: verdicts first, then by standard errors."""
    nothing, found = (math.nan, 0.0, math.nan), []
    for claim in published:
        old, new = before.verdicts.get(claim.id, "none"), after.verdicts.get(claim.id, "none")
        numbers = []
        for label, index in components_of(claim) if "none" not in (old, new) else ():
            a, b = before.numbers.get(label, nothing), after.numbers.get(label, nothing)
            size = size_of_change(a, b, half_digit(claim, index))
            if old != new or (size > 0.0 and not math.isclose(a[0], b[0])):  # what the last digits do is no move
                numbers.append(Moved(claim.id, label, a[0], b[0], math.hypot(a[1], b[1]), old, new, size))
        numbers.sort(key=_largest_first)
        found += numbers[:1] if old != new else numbers  # of a verdict that changes, the number that moves most
    return sorted(found, key=_largest_first)


def numbers_of(one: Moved, claim: PublishedClaim) -> tuple[str, str]:
    """Return both numbers with so many digits that they differ, and their unit; "no number" for one that is none."""
    units, at = claim.unit.split(", "), [label for label, _ in components_of(claim)].index(one.component)
    unit = units[at % len(units)]
    for digits in (4, 6, 10):
        texts = [f"{number:.{digits}g}" for number in (one.before, one.after)]
        if len({*texts}) == 2:
            break
    first, second = ("no number" if text == "nan" else with_unit(text, unit) for text in texts)
    return first, second


def _largest_first(one: Moved) -> tuple:
    return not one.turned, -np.nan_to_num(one.sigmas), -np.nan_to_num(one.size)


def named(name: str, study: Study) -> tuple[Path | None, str | int]:
    """Return the folder of another build, if a name has one, and the reading or the number of the universe.

    name: "READING", "universe:12", "FOLDER:READING" or "FOLDER:universe:12". Raises InputError if there is no such one.
    """
    folder, is_universe, number = name.rpartition(_UNIVERSE)
    if is_universe:
        if not number.isdecimal() or (folder and not folder.endswith(":")):
            raise InputError(f"'{name}': write universe:NUMBER or FOLDER:universe:NUMBER, such as universe:12")
        return Path(folder[:-1]) if folder else None, int(number)
    folder, _, reading = name.rpartition(":")
    return Path(folder) if folder else None, study.reading(reading).name


def side_of(of: str | int, study: Study, build: Path) -> Side:
    """Return a reading, or a universe by its number; build: the folder with claims, universes and figures."""
    paper = study.paper
    if isinstance(of, int):
        return of_universe(of, study, build / f"report/universes/{paper}.h5")
    path = build / f"report/claims/{paper}.json"
    if not path.exists():
        raise InputError(f"{path} is missing; run 'snakemake report/claims/{paper}.json'")
    return of_reading(of, study, read_claims(path), build / "figures" / paper)


def difference(before: Side, after: Side, published: Sequence[PublishedClaim]) -> Difference:
    """Return what moved between two sides."""
    names = dict.fromkeys([*before.inputs, *after.inputs])
    pairs = [Changed(name, before.inputs.get(name, "-"), after.inputs.get(name, "-")) for name in names]
    changed, alone = [one for one in pairs if one.before != one.after], before.verdicts.keys() ^ after.verdicts.keys()
    return Difference(before, after, changed, moved_claims(before, after, published), sorted(alone))


def write_page(
    path: Path,
    paper: Paper,
    difference: Difference,
    published: Sequence[PublishedClaim],
    is_stale: Callable[[Path], bool],
) -> list[Path]:
    """Write one page, which needs no other file, with what moved and the figures that both have, side by side.

    Returns the pictures that are missing or, by `is_stale`, not up to date: the page leaves their figures out.
    """
    import jinja2  # slow to import, and only needed here

    sides = difference.before, difference.after
    pairs = {
        stem: [side.figures / f"{stem}.png" for side in sides]
        for stem in (paper.figures if all(side.figures for side in sides) else ())
    }
    absent = [one for pair in pairs.values() for one in pair if not one.exists() or is_stale(one)]
    shown = {stem: pair for stem, pair in pairs.items() if not {*pair} & {*absent}}
    template = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(
        _TEMPLATE.read_text(encoding="utf-8")
    )
    text = template.render(
        paper=paper,
        **difference._asdict(),
        printed={one.id: one for one in published},
        pictures={stem: [base64.b64encode(one.read_bytes()).decode() for one in pair] for stem, pair in shown.items()},
        left_out=[stem for stem in pairs if stem not in shown],
        numbers_of=numbers_of,
        words=in_words,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    return absent
