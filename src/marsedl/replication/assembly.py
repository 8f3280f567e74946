"""Gather what the report says from the catalogues, the readings and the product files."""

import json
from pathlib import Path

from marsedl.replication.artifacts import library_versions
from marsedl.replication.catalogue import Paper
from marsedl.replication.claims import read_claims
from marsedl.replication.inputs import Inputs
from marsedl.replication.report import (
    ErratumEntry,
    FigureEntry,
    InputEntry,
    InputValue,
    PaperReport,
    ReadingEntry,
    TableEntry,
)
from marsedl.replication.tables import read_table

LIBRARIES = ("snakemake", "numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py", "pydantic", "matplotlib")
REBUILD = (
    "make all",
    "snakemake figures/powered_descent/fig07.png",
    "snakemake --config size=smoke all",
    "make verify",
)
CITATION = "The marsedl developers: marsedl, replications of papers on Mars entry, descent and landing, version 0.1.0."


def paper_report(catalogue: Paper, model: type[Inputs], readings: dict, claims: list[dict]) -> PaperReport:
    """Say all there is to say about one paper.

    catalogue: its bill of materials. model: its typed inputs. readings: by name, summary, based_on, frozen, and inputs
    as [key, value as written, source]. claims: its rows of verdicts.
    """
    folder = Path("figures") / catalogue.slug
    figures = [
        FigureEntry(
            stem,
            folder / f"{stem}.png",
            product.caption,
            alt=product.caption,
            files=(f"{folder / stem}.png", f"{folder / stem}.pdf"),
            beyond=product.beyond,
        )
        for stem, product in catalogue.figures.items()
    ]
    captions = {stem: (product.caption, product.beyond) for stem, product in catalogue.tables.items()}
    captions |= {stem: (caption, True) for stem, caption in catalogue.summaries.items()}
    tables = [
        TableEntry(
            stem, caption, read_table(folder / f"{stem}.csv"), (f"{folder / stem}.csv", f"{folder / stem}.md"), new
        )
        for stem, (caption, new) in captions.items()
    ]
    inputs = [
        InputEntry(
            name,
            model.unit(name),
            {reading: _value(name, *body["inputs"][name]) for reading, body in readings.items()},
            model.model_fields[name].description,
        )
        for name in model.model_fields
    ]
    return PaperReport(
        slug=catalogue.slug,
        title=catalogue.title,
        citation=catalogue.citation,
        claims=claims,
        readings=[
            ReadingEntry(name, body["summary"], body["based_on"], body["frozen"]) for name, body in readings.items()
        ],
        inputs=inputs,
        figures=figures,
        tables=tables,
        errata=[ErratumEntry(e.id, e.printed, e.evidence, e.used) for e in catalogue.errata],
    )


def environment(size: str, digests: Path, benchmarks: Path) -> dict:
    """Say what holds for all papers: size, software, digests of the products, and the committed benchmark table."""
    found = {
        "size": size,
        "citation": CITATION,
        "rebuild": list(REBUILD),
        "versions": library_versions(*LIBRARIES),
        "digests": json.loads(digests.read_text(encoding="utf-8")),
    }
    if benchmarks.exists():
        found["benchmarks"] = read_table(benchmarks)
    return found


def claims_by_paper(path: Path) -> dict[str, list[dict]]:
    """Read the joined claims, by paper."""
    by_paper: dict[str, list[dict]] = {}
    for row in read_claims(path):
        by_paper.setdefault(row["paper"], []).append(row)
    return by_paper


def _value(name, key, written, source) -> InputValue:
    """An input as it is written; with its suffix if it has one."""
    suffix = key.removeprefix(name).removeprefix("_")
    shown = "–" if written is None else json.dumps(written) if isinstance(written, list) else str(written)
    return InputValue(f"{shown} {suffix}".strip(), source)
