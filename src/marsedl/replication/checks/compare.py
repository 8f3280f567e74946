"""What moved between two readings, builds or universes of a paper: inputs, verdicts, numbers and figures."""

import base64
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.claims.moved import Moved
from marsedl.replication.claims.numbers import told_apart
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.inputs.readings import Study
from marsedl.replication.pipeline.catalogue import Paper
from marsedl.replication.records import store
from marsedl.replication.report.one_line import with_unit
from marsedl.replication.universes.judging import judge_in
from marsedl.replication.universes.table import Universes, held
from marsedl.replication.universes.what_if import Alternative, entries_of_reading, entries_of_universe, moved_claims

_TEMPLATE = Path(__file__).with_name("compare.html.j2")


class Difference(NamedTuple):
    """What moved between two sides: inputs that differ, claims that move, claims that only one of them evaluates."""

    before: Alternative
    after: Alternative
    inputs: dict[str, tuple[str, str]]
    moved: list[Moved]
    alone: list[str]


def side_of(name: str | int, study: Study, build: Path) -> Alternative:
    """Return a reading, a named point, or a universe by its number; build: with claims, universes and figures.

    Raises InputError if its claims, or universes, are not built.
    """
    if isinstance(name, int):
        return of_universe(name, study, build / f"report/universes/{study.paper}.h5")
    path, figures = build / f"report/claims/{study.paper}.json", build / "figures" / study.paper
    if not path.exists():
        raise InputError(f"{path} is missing; run 'snakemake report/claims/{study.paper}.json'")
    rows = read_claims(path)
    results = {row.id: row.readings[name] for row in rows if name in row.readings and row.readings[name].verdict}
    if not results:
        raise InputError(f"the claims of {name} are not built; run 'snakemake report/claims/{study.paper}.json'")
    found = {}
    for row in (row for row in rows if row.id in results):
        found |= entries_of_reading(row, results[row.id])
    sources = study.readings[name].sources.items()
    inputs = {"size": study.size} | {key: with_unit(str(source.written), source.unit) for key, source in sources}
    place = figures if name == CORRECTED else figures / name
    return Alternative(name, inputs, found, place)


def of_other_build(name: str, study: Study, build: Path) -> Alternative:
    """Return a reading of a build that other code or other inputs may have made; its artifacts say which inputs.

    Raises InputError if its claims or artifacts are not there.
    """
    side, used = side_of(name, study, build), {}
    ours, default = (json.loads(json.dumps(study.readings[one].inputs.plain())) for one in (name, CORRECTED))
    folders = [build / "data/cache" / study.paper / reading for reading in dict.fromkeys((CORRECTED, name))]
    for path in (path for folder in folders for path in sorted(folder.glob("*.h5"))):
        stored = store.provenance(path)
        theirs = path.parent.name == name  # else an artifact of corrected, which tells what the two share
        used |= {key: value for key, value in stored["inputs"].items() if theirs or ours.get(key) == default.get(key)}
    if not used:
        raise InputError(f"{folders[-1]} has no artifacts, which say what inputs they were made with; copy them too")
    inputs = study.readings[name].inputs
    other = {key: with_unit(str(value), inputs.unit(key) if key in ours else "")
             for key, value in used.items() if ours.get(key) != value}  # fmt: skip
    return replace(side, name=f"{build}:{name}", inputs={**side.inputs, **other, "size": stored["size"]})


def of_universe(number: int, study: Study, path: Path) -> Alternative:
    """Return a universe of a build; path: the table of universes.

    Raises InputError if there is no table, if it has no such universe, or if it is of other choices.
    """
    if not path.exists():
        raise InputError(f"{path} is missing; run 'snakemake report/universes/{study.paper}.h5'")
    table = store.load(path, Universes, paper=study.paper)
    if (universe := held(table, study.choices, number, path)) is None:
        first = ", ".join(map(str, table.number[:3]))
        raise InputError(f"{path} has no universe {number}; its numbers begin with {first}")
    values = study.choices.complete(universe.assignment).items()
    written = {name: f"{value:.4g}" if isinstance(value, float) else str(value) for name, value in values}
    return Alternative(f"universe {number}", written, entries_of_universe(judge_in(study, table), number))


def in_numbers(one: Moved) -> tuple[str, str]:
    """Return both numbers with so many digits that they differ, with units; empty where only verdicts are compared."""
    rows = one.before, one.after
    if not any(row.is_number for row in rows):
        return "", ""
    texts = told_apart(*(row.value for row in rows))
    first, second = (
        with_unit(text, row.unit) if row.is_number else "no number" for text, row in zip(texts, rows, strict=True)
    )
    if not one.same_test:  # of which no difference means anything
        first, second = f"{first} (limit {one.before.limit:.4g})", f"{second} (limit {one.after.limit:.4g})"
    return first, second


def apart(one: Moved) -> str:
    """Return how far two numbers are apart, in words."""
    if not one.same_test:
        return "another test decides"
    if not (one.before.is_number and one.after.is_number):
        return ""
    distance = "no sampling error" if math.isnan(one.sigmas) else f"{one.sigmas:.1f} standard errors"
    return f"{distance}, turns within noise" if one.turned and one.sigmas < SIGMAS else distance


def named(name: str, study: Study) -> tuple[Path | None, str | int]:
    """Return the folder of another build, if a name has one, and the reading or the number of the universe.

    name: "READING", "universe:12", "FOLDER:READING" or "FOLDER:universe:12". Raises InputError if there is no such one.
    """
    folder, is_universe, number = name.rpartition("universe:")
    if is_universe:
        if not number.isdecimal() or (folder and not folder.endswith(":")):
            raise InputError(f"'{name}': write universe:NUMBER or FOLDER:universe:NUMBER, such as universe:12")
        return Path(folder[:-1]) if folder else None, int(number)
    folder, _, reading = name.rpartition(":")
    return Path(folder) if folder else None, study.reading(reading).name


def difference(before: Alternative, after: Alternative) -> Difference:
    """Return what moved between two sides."""
    names = dict.fromkeys([*before.inputs, *after.inputs])
    pairs = {name: (before.inputs.get(name, "-"), after.inputs.get(name, "-")) for name in names}
    changed = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    return Difference(before, after, changed, moved_claims(before, after), sorted(before.claims ^ after.claims))


def write_page(
    path: Path, paper: Paper, difference: Difference, published: Sequence[PublishedClaim], is_stale: Callable[..., bool]
) -> list[Path]:
    """Write one page, which needs no other file, with what moved and the figures that both have, side by side.

    Returns the pictures that are missing or, by `is_stale`, not up to date: the page leaves their figures out.
    """
    import jinja2  # slow to import, and only needed here

    sides = difference.before, difference.after
    drawn = paper.figures if all(side.figures for side in sides) else ()  # universes have no figures
    pairs = {stem: [side.figures / f"{stem}.png" for side in sides] for stem in drawn}
    absent = [one for pair in pairs.values() for one in pair if not one.exists() or is_stale(one)]
    shown = {stem: pair for stem, pair in pairs.items() if not {*pair} & {*absent}}
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    text = environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        paper=paper,
        **difference._asdict(),
        printed={one.id: one for one in published},
        pictures={stem: [base64.b64encode(one.read_bytes()).decode() for one in pair] for stem, pair in shown.items()},
        left_out=[stem for stem in pairs if stem not in shown],
        in_numbers=in_numbers,
        apart=apart,
        words=in_words,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    return absent
