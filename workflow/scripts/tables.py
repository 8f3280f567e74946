"""Write the tables of a reading that need the same artifacts, as CSV and Markdown."""

from importlib import import_module

from marsedl.replication.jobs import guarded, published_of
from marsedl.replication.tables import write_table

with guarded(snakemake) as job:
    module, published = import_module(f"marsedl.papers.{job.paper}.tables"), published_of(job.params)
    for number, stem in enumerate(job.params.made["stems"]):
        table = getattr(module, stem)
        write_table(table(**job.arguments_of(table, **published)), *snakemake.output[2 * number : 2 * number + 2])
