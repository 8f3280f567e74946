"""Write the report: its pages, pictures and the zip of them."""

from pathlib import Path

from marsedl.comparison import comparisons
from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.report import assembly
from marsedl.replication.report.pages import build_site
from marsedl.replication.universes.judging import judge_of

with guarded(snakemake) as job:
    claims = read_claims(snakemake.input.claims)
    project, papers = Path(snakemake.params.project).resolve(), []
    for (slug, readings), universes in zip(job.made["readings"].items(), snakemake.input.universes, strict=True):
        given = catalogue(slug), input_model(slug)
        judge = judge_of(*given, project, job.made["size"], job.made["own"][slug], universes, claims)
        papers.append(assembly.paper_report(*given, readings, claims, snakemake.params.artifacts[slug], judge))
    folder, citation = Path(snakemake.output[0]).parent, project / "CITATION.cff"
    build_site(folder, papers, job.made["size"], citation, comparisons())
