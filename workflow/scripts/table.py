"""Write one table as CSV and Markdown."""

from importlib import import_module

from marsedl.replication.claims import load_published
from marsedl.replication.jobs import guarded
from marsedl.replication.tables import write_table

with guarded(snakemake) as job:
    function = getattr(import_module(f"marsedl.papers.{job.paper}.tables"), snakemake.wildcards.stem)
    published = {claim.id: claim for claim in load_published(job.params.published)}
    write_table(function(job.inputs, published, **job.arguments(function)), snakemake.output.csv, snakemake.output.md)
