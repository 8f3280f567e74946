"""Write the report: its pages, pictures and the zip of them."""

from pathlib import Path

from marsedl.comparison import comparisons
from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.report import assembly
from marsedl.replication.report.pages import build_site

with guarded(snakemake) as job:
    claims, benchmarks = read_claims(snakemake.input.claims), Path(snakemake.input.benchmarks)
    papers = [
        assembly.paper_report(
            catalogue(slug), input_model(slug), readings, claims, snakemake.params.artifacts[slug], benchmarks
        )
        for slug, readings in job.made["readings"].items()
    ]
    around = assembly.environment(job.made["size"], Path(snakemake.input.digests))
    build_site(Path(snakemake.output[0]).parent, papers, around, comparisons())
