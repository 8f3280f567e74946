"""Write the report: its pages, pictures and the zip of them."""

from pathlib import Path

from marsedl.comparison import comparisons
from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.rows import read_as, read_claims
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.report import assembly
from marsedl.replication.report.pages import build_site
from marsedl.replication.universes.deciding import Decided
from marsedl.scenarios import arenas

with guarded(snakemake) as job:
    claims, papers = read_claims(snakemake.input.claims), []
    for (slug, readings), path in zip(job.params["readings"].items(), snakemake.input.universes, strict=True):
        given = catalogue(slug), input_model(slug), readings, claims, snakemake.params.artifacts[slug]
        papers.append(assembly.paper_report(*given, read_as(Decided, path)))
    folder, citation = Path(snakemake.output[0]).parent, Path(snakemake.params.project).resolve() / "CITATION.cff"
    build_site(folder, papers, job.params["size"], citation, comparisons(), arenas=arenas())
