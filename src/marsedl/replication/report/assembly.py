"""Collect the contents of the report from the catalogues, the readings and the product files."""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.quotes import Quotes, with_numbers
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.catalogue import Paper, Solve
from marsedl.replication.records import store
from marsedl.replication.universes.deciding import Decided

_ENDINGS = {True: "converged", False: "not converged", b"": "not solved"}  # other texts are shown as they are

Paths = Mapping[str, Mapping[str, str]]  # files of the artifacts, by reading and name
Reading = Mapping[str, Any]  # `summary`, `based_on`, `frozen`, and of its `inputs` by name: key, written value, source


def written(reading: Reading, name: str) -> str:
    """Return an input of a reading as it is written; with its suffix if it has one."""
    key, value, _ = reading["inputs"][name]
    suffix = key.removeprefix(name.rpartition(".")[2]).removeprefix("_")
    text = json.dumps(value) if isinstance(value, list) else str(value)
    if value is None:
        text = "–"
    return f"{text} {suffix}".strip()


@dataclass(frozen=True)
class PaperReport:
    """All that the report says about one paper, whose catalogue has the numbers of its texts.

    `decided` is what its universes say, `inputs` have unit and meaning by name, `solves` and `provenance` are rows of
    text.
    """

    catalogue: Paper
    claims: Sequence[Claim]
    readings: Mapping[str, Reading]
    decided: Decided | None = None
    inputs: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    solves: Sequence[Sequence[str]] = ()
    provenance: Sequence[Sequence[str]] = ()


def paper_report(
    catalogue: Paper,
    model: type[Inputs],
    readings: Mapping[str, Reading],
    claims: Iterable[Claim],
    paths: Paths,
    decided: Decided,
) -> PaperReport:
    """Return the contents of the report on one paper, of the `claims` of all papers; `paths` are its artifacts.

    Raises ArtifactError if an artifact is missing or damaged, InputError if a text quotes a number that does not exist.
    """
    claims = [row for row in claims if row.paper == catalogue.slug]
    return PaperReport(
        catalogue=with_numbers(catalogue, Quotes(claims, readings)),
        claims=claims,
        readings=readings,
        decided=decided,
        inputs={name: (model.unit(name), model.meaning(name)) for name in model.names()},
        solves=[one for solve in catalogue.solves if (one := solved(solve, paths))],
        provenance=provenance(paths[CORRECTED]),
    )


def solved(solve: Solve, paths: Paths) -> list[str]:
    """Return how a solver ended in the artifacts of all readings, as a row of text; empty if there are none.

    It has the stage, what is solved, how it ended (most often, then otherwise, with the readings of that), the numbers
    of solves and of iterations, and the largest residual.
    """
    endings, numbers = defaultdict(list), {name: [] for name in (solve.iterations, solve.residual)}
    for path in dict.fromkeys(Path(files[solve.artifact]) for files in paths.values() if solve.artifact in files):
        with store.opened(path) as file:
            for ending in np.ravel(file[solve.ended][()]).tolist():
                endings[_ENDINGS[ending] if ending in _ENDINGS else ending.decode()].append(path.parent.name)
            for name in filter(None, numbers):
                numbers[name] += np.ravel(file[name][()]).tolist()
    if not endings:
        return []
    solves, usual = sum(map(len, endings.values())), max(endings, key=lambda ending: len(endings[ending]))
    ended = [f"{len(endings.pop(usual))} {usual}"]
    ended += [f"{len(names)} {ending} ({', '.join(dict.fromkeys(names))})" for ending, names in endings.items()]
    iterations = sorted(numbers[solve.iterations])
    ends = " to ".join(f"{number:,}" for number in dict.fromkeys([*iterations[:1], *iterations[-1:]])) or "–"
    residual = max((value for value in numbers[solve.residual] if np.isfinite(value)), default=None)
    largest = "–" if residual is None else f"{residual:.1e}"
    return [solve.artifact, solve.what or solve.artifact, "; ".join(ended), f"{solves:,}", ends, largest]


def provenance(files: Mapping[str, str]) -> list[list[str]]:
    """Return what each artifact was made from: name, meaning, other artifacts, a seed, and code by its digest."""
    rows = []
    for name, path in files.items():
        with store.opened(path) as file:
            meaning = file.attrs["meaning"]
        stored = store.provenance(path)
        made_from = ", ".join(sorted(need.removesuffix(".h5") for need in stored["needs"])) or "inputs alone"
        seed = next((str(value) for key, value in stored["inputs"].items() if key.endswith(".seed")), "–")
        rows.append([name, meaning, made_from, seed, stored["code"]])
    return rows
