"""Collect the contents of the report from the catalogues, the readings and the product files."""

import contextlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.quotes import Quotes, by_id, with_numbers
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.catalogue import Paper, Stage, entry_of, function_of
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.pipeline.libraries import library_versions
from marsedl.replication.records import store
from marsedl.replication.records.tables import read_table
from marsedl.replication.report.closeups import CloseUp
from marsedl.replication.report.readings_compared import Input, Reading

LIBRARIES = (
    *("snakemake", "numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py", "pydantic", "matplotlib"),
    "pillow",
)
REBUILD = (
    "make all",
    "snakemake figures/powered_descent/fig07.png",
    "snakemake all --config size=smoke",
    "make verify",
)
CITATION = "The marsedl developers: marsedl, replications of papers on Mars entry, descent and landing, version 0.1.0."


Paths = Mapping[str, Mapping[str, str]]  # files of the artifacts, by reading and name


@dataclass(frozen=True)
class PaperReport:
    """All that the report says about one paper.

    `catalogue` has the numbers of its texts. `units` and `meanings` are those of its inputs. `run_times`, `solvers` and
    `provenance` are rows of text, the first one the header.
    """

    catalogue: Paper
    claims: Sequence[Claim]
    readings: Mapping[str, Reading]
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)
    closeups: Sequence[CloseUp] = ()
    run_times: Sequence[Sequence[str]] = ()
    solvers: Sequence[Sequence[str]] = ()
    provenance: Sequence[Sequence[str]] = ()


def paper_report(
    catalogue: Paper,
    model: type[Inputs],
    readings: Mapping[str, Mapping[str, Any]],
    claims: Sequence[Claim],
    paths: Paths,
    benchmarks: Sequence[Sequence[str]] = (),
) -> PaperReport:
    """Return the contents of the report on one paper.

    Args:
        catalogue: its bill of materials.
        model: its typed inputs.
        readings: by name, summary, based_on, frozen, and inputs as [key, value as written, source].
        claims: its claims.
        paths: its artifacts.
        benchmarks: measured run times of all papers, the first row the header.

    Raises:
        ArtifactError: an artifact is missing or damaged.
        InputError: a text quotes the number of a claim or reading that does not exist.

    """
    files, seed = paths.get(CORRECTED, {}), _seed(readings[CORRECTED]["inputs"])
    names = model.names()
    return PaperReport(
        with_numbers(catalogue, Quotes(by_id(claims), readings)),
        claims,
        {
            name: Reading(**{**body, "name": name, "inputs": {key: _input(key, *body["inputs"][key]) for key in names}})
            for name, body in readings.items()
        },
        {name: model.unit(name) for name in names},
        {name: model.meaning(name) for name in names},
        closeups(catalogue, files),
        run_times(benchmarks, [catalogue.slug]),
        solver_rows(paths),
        provenance_rows(files, catalogue.stages, seed),
    )


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
    with store.opened(path) as file:

        def values(*names):
            present = next((name for name in names if store.holds_field(file, name)), None)
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
        with store.opened(path) as file:
            meaning = file.attrs["meaning"]
        if name in stages:
            provenance = store.provenance(path)
            sources, seed_used, code = provenance["made_from"], _seed(provenance["inputs"]), provenance["code"]
        else:
            sources, seed_used, code = [f"{need}.h5" for need in stages["montecarlo"].needs], seed, "–"
        made_from = ", ".join(Path(source).stem for source in sorted(sources)) or "inputs alone"
        rows.append([name, meaning, made_from, seed_used, code])
    return rows


def claims_by_paper(path: Path) -> dict[str, list[Claim]]:
    """Read the joined claims, by paper."""
    by_paper: dict[str, list[Claim]] = {}
    for row in read_claims(path):
        by_paper.setdefault(row.paper, []).append(row)
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
        return store.load(files[name], kind, paper=catalogue.slug, reading=Path(files[name]).parent.name)

    plots, given = [], Arguments({}, load)
    for name in catalogue.closeups:
        with contextlib.suppress(Missing):
            plots.append(given.call(function_of(entry_of(catalogue.slug, "closeups", name))))
    return plots


def _seed(inputs: Mapping[str, Any]) -> str:
    """The key of the random numbers among inputs by "section.name", as values or as [key, value, source]."""
    seeds = [value for name, value in inputs.items() if name.endswith(".seed")]
    return str(seeds[0][1] if isinstance(seeds[0], list) else seeds[0]) if seeds else "–"


def _input(name: str, key: str, value: object, source: str) -> Input:
    """An input as it is written; with its suffix if it has one."""
    suffix = key.removeprefix(name.rpartition(".")[2]).removeprefix("_")
    text = "–" if value is None else json.dumps(value) if isinstance(value, list) else str(value)
    return Input(f"{text} {suffix}".strip(), source)
