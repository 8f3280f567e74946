"""Collect the contents of the report from the catalogues, the readings and the product files."""

import inspect
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from marsedl.replication import artifacts
from marsedl.replication.catalogue import Paper, Stage
from marsedl.replication.claims import read_claims
from marsedl.replication.closeups import CloseUp
from marsedl.replication.jobs import arguments_of
from marsedl.replication.libraries import library_versions
from marsedl.replication.quotes import Quotes, by_id, with_numbers
from marsedl.replication.report import (
    Comparison,
    FigureEntry,
    InputEntry,
    InputValue,
    PaperReport,
    ReadingEntry,
    TableEntry,
)
from marsedl.replication.sections import Inputs
from marsedl.replication.tables import read_markdown, read_table

LIBRARIES = (
    *("snakemake", "numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py", "pydantic", "matplotlib"),
    "pillow",
)
DEFAULT = "corrected"  # the reading that figures and close-ups show
REBUILD = (
    "make all",
    "snakemake figures/powered_descent/fig07.png",
    "snakemake all --config size=smoke",
    "make verify",
)
CITATION = "The marsedl developers: marsedl, replications of papers on Mars entry, descent and landing, version 0.1.0."


Paths = Mapping[str, Mapping[str, str]]  # files of the artifacts, by reading and name


def paper_report(
    catalogue: Paper,
    model: type[Inputs],
    readings: dict,
    claims: list[dict],
    paths: Paths,
    benchmarks: Sequence[Sequence[str]] = (),
) -> PaperReport:
    """Return the contents of the report on one paper.

    Args:
        catalogue: its bill of materials.
        model: its typed inputs.
        readings: by name, summary, based_on, frozen, and inputs as [key, value as written, source].
        claims: its rows of verdicts.
        paths: its artifacts.
        benchmarks: measured run times of all papers, the first row the header.

    Raises:
        ArtifactError: an artifact is missing or damaged.
        InputError: a text quotes the number of a claim or reading that does not exist.

    """
    catalogue = with_numbers(catalogue, Quotes(by_id(claims), readings))
    folder = Path("figures") / catalogue.slug
    captions = {stem: (product.caption, product.beyond) for stem, product in catalogue.tables.items()}
    captions |= {stem: (caption, True) for stem, caption in catalogue.summaries.items()}
    inputs = [
        InputEntry(
            name,
            model.unit(name),
            {reading: _value(name, *body["inputs"][name]) for reading, body in readings.items()},
            model.meaning(name),
        )
        for name in model.names()
    ]
    default_files = paths.get(DEFAULT, {})
    return PaperReport(
        slug=catalogue.slug,
        title=catalogue.title,
        citation=catalogue.citation,
        claims=claims,
        readings=[
            ReadingEntry(name, body["summary"], body["based_on"], body["frozen"]) for name, body in readings.items()
        ],
        inputs=inputs,
        figures=[
            replace(
                _figure(folder, stem, item.caption, item.beyond),
                described=catalogue.described.get(stem, ""),
                claims=tuple(row["id"] for row in claims if is_about(row["where"], stem)),
            )
            for stem, item in catalogue.figures.items()
        ],
        tables=[_table(folder, stem, *caption_and_beyond) for stem, caption_and_beyond in captions.items()],
        errata=catalogue.errata,
        verdicts=f"report/claims/{catalogue.slug}.json",
        authors=catalogue.authors,
        question=catalogue.question,
        in_short=catalogue.in_short,
        picture=catalogue.picture,
        closeups=closeups(catalogue, default_files),
        run_times=run_times(benchmarks, [catalogue.slug]),
        solvers=solver_rows(paths),
        provenance=provenance_rows(default_files, catalogue.stages, _seed(readings[DEFAULT]["inputs"])),
    )


def comparison(products: Mapping[str, Any]) -> Comparison:
    """Return the contents of the comparison of papers. products: by stem, with the captions `figure` and `table`."""
    folder = Path("figures") / "comparison"
    return Comparison(
        [_figure(folder, stem, product.figure) for stem, product in products.items()],
        [_table(folder, stem, product.table) for stem, product in products.items()],
    )


def is_about(where: str, stem: str) -> bool:
    """Whether the place of a claim, such as "Sec. V, discussion of Figs. 3 and 5b", names the figure of this stem.

    A figure named without its letter is all of its parts, and a part of a figure that is drawn whole is that figure.
    """
    label = re.fullmatch(r"fig0*(\d+)([a-z]?)", stem)
    if not label:
        return False
    lists = re.findall(r"Figs?\. ((?:\d+[a-z]?(?:, | and )?)+)", where)
    figures = [part for text in lists for part in re.findall(r"(\d+)([a-z]?)", text)]
    return any(number == label[1] and (letter == label[2] or not letter or not label[2]) for number, letter in figures)


def _figure(folder: Path, stem: str, caption: str, beyond: bool = False) -> FigureEntry:
    image = folder / f"{stem}.png"
    return FigureEntry(stem, image, caption, caption, (f"{image}", f"{folder / stem}.pdf"), beyond)


def _table(folder: Path, stem: str, caption: str, beyond: bool = False) -> TableEntry:
    path = folder / f"{stem}.md"
    return TableEntry(stem, caption, read_markdown(path), (f"{folder / stem}.csv", f"{path}"), beyond)


def environment(size: str, digests: Path) -> dict:
    """Return what concerns all papers: size, software and digests."""
    return {
        "size": size,
        "citation": CITATION,
        "rebuild": list(REBUILD),
        "versions": library_versions(*LIBRARIES),
        "digests": json.loads(digests.read_text(encoding="utf-8")),
    }


def measurements(path: Path) -> list[list[str]]:
    """A committed table of measurements, the first row its header; empty if nothing was measured."""
    return read_table(path) if path.exists() else []


def run_times(benchmarks: Sequence[Sequence[str]], papers: Iterable[str]) -> list[list[str]]:
    """The measurements of these papers, under a header without the column of the paper; empty if there are none.

    A column of notes without any note is left out.
    """
    papers = set(papers)
    rows = [list(row[1:]) for row in benchmarks[1:] if row[0] in papers]
    if not rows:
        return []
    header = list(benchmarks[0][1:])
    kept = [column for column, name in enumerate(header) if name != "note" or any(row[column] for row in rows)]
    return [[row[column] for column in kept] for row in [header, *rows]]


def solver_rows(paths: Paths) -> list[list[str]]:
    """How the iterative solvers of all readings ended: a row for each field that records it, the first row the header.

    A field `status` or `<what>_status` says in words how each solve ended; `converged` or `<what>_converged` whether.
    Fields `iterations` and `residual` of the same name say after how many steps, and with what error.
    """
    endings: dict[tuple[str, str], Counter] = {}
    where: dict[tuple[str, str], dict[str, set]] = {}
    steps: dict[tuple[str, str], list] = {}
    errors: dict[tuple[str, str], list] = {}
    for name, path in dict.fromkeys(item for files in paths.values() for item in files.items()):  # shared ones once
        reading = Path(path).parent.name
        for what, states, iterations, residual in _solves(Path(path)):
            key = (name, what)
            endings.setdefault(key, Counter()).update(states)
            for state in states:
                where.setdefault(key, {}).setdefault(state, set()).add(reading)
            steps.setdefault(key, []).extend(iterations)
            errors.setdefault(key, []).extend(residual)
    if not endings:
        return []
    rows = [["stage", "solved", "how it ended, over all readings", "solves", "iterations", "largest residual"]]
    for key, states in endings.items():
        usual = states.most_common(1)[0][0]
        outcomes = [f"{states[usual]} {usual}"]
        outcomes += [
            f"{count} {state} ({', '.join(name for name in paths if name in where[key][state])})"
            for state, count in states.items()
            if state != usual
        ]
        least, most = (min(steps[key]), max(steps[key])) if steps[key] else (None, None)
        iterations_range = "–" if least is None else f"{least:,}" if least == most else f"{least:,} to {most:,}"
        residual = f"{max(errors[key]):.1e}" if errors[key] else "–"
        rows.append([*key, "; ".join(outcomes), f"{states.total():,}", iterations_range, residual])
    return rows


def _solves(path: Path) -> list[tuple[str, list[str], list[int], list[float]]]:
    """The solves recorded in an artifact: name, how each ended, numbers of iterations, residuals."""
    solves = []
    with artifacts.opened(path) as file:

        def values(*names):
            present = next((name for name in names if artifacts.holds_field(file, name)), None)
            return np.asarray(file[present][()]).ravel().tolist() if present else []

        for name in sorted(file):
            prefix, _, last = name.rpartition("_")
            if last not in ("status", "converged") or (last == "converged" and file[name].dtype != bool):
                continue
            if last == "status":
                states = [value.decode() or "not solved" for value in values(name)]
            else:
                states = ["converged" if value else "not converged" for value in values(name)]
            beside = f"{prefix}_" if prefix else ""
            more = () if prefix else ("solver_iterations", "worst_residual")
            iterations = values(f"{beside}iterations", *more[:1])
            residuals = [value for value in values(f"{beside}residual", *more[1:]) if math.isfinite(value)]
            solves.append((prefix.replace("_", " ") or path.stem, states, iterations, residuals))
    return solves


def provenance_rows(files: Mapping[str, str], stages: Mapping[str, Stage], seed: str) -> list[list[str]]:
    """What each artifact was made from, the first row the header: other artifacts, a seed, and code by its digest.

    Trials of a Monte Carlo case are scattered into any number of jobs, and its own provenance speaks of these: what
    stands here are the needs of its stage and the `seed` of the reading.
    """
    if not files:
        return []
    rows = [["artifact", "meaning", "made from", "seed", "digests of script and code"]]
    for name, path in files.items():
        with artifacts.opened(path) as file:
            meaning = file.attrs["meaning"]
        if name in stages:
            provenance = artifacts.provenance(path)
            sources, seed_used, code = provenance["made_from"], _seed(provenance["inputs"]), provenance["code"]
        else:
            sources, seed_used, code = [f"{need}.h5" for need in stages["montecarlo"].needs], seed, "–"
        made_from = ", ".join(Path(source).stem for source in sorted(sources)) or "inputs alone"
        rows.append([name, meaning, made_from, seed_used, code])
    return rows


def claims_by_paper(path: Path) -> dict[str, list[dict]]:
    """Read the joined claims, by paper."""
    by_paper: dict[str, list[dict]] = {}
    for row in read_claims(path):
        by_paper.setdefault(row["paper"], []).append(row)
    return by_paper


def closeups(catalogue: Paper, files: Mapping[str, str]) -> list[CloseUp]:
    """Draw the plots of a paper that a reader can look into; those whose artifacts are not built are left out.

    Args:
        catalogue: the paper's bill of materials.
        files: the artifacts of the reading that is shown, by name.

    Raises:
        ArtifactError: an artifact is damaged, or not what its name says.

    """

    def load(name: str, kind: type) -> Any:
        if name not in files:
            return None
        return artifacts.load(files[name], kind, paper=catalogue.slug, reading=Path(files[name]).parent.name)

    plots = []
    for name in catalogue.closeups:
        function = getattr(import_module(f"marsedl.papers.{catalogue.slug}.closeups"), name)
        arguments = arguments_of(function, {}, load)
        if arguments.keys() == inspect.signature(function).parameters.keys():
            plots.append(function(**arguments))
    return plots


def _seed(inputs: Mapping[str, Any]) -> str:
    """The key of the random numbers among inputs by "section.name", as values or as [key, value, source]."""
    seeds = [value for name, value in inputs.items() if name.endswith(".seed")]
    return str(seeds[0][1] if isinstance(seeds[0], list) else seeds[0]) if seeds else "–"


def _value(name, key, value, source) -> InputValue:
    """An input as it is written; with its suffix if it has one."""
    suffix = key.removeprefix(name.rpartition(".")[2]).removeprefix("_")
    text = "–" if value is None else json.dumps(value) if isinstance(value, list) else str(value)
    return InputValue(f"{text} {suffix}".strip(), source)
