"""Write the tables of a reading that one job makes from the same artifacts, as CSV and Markdown."""

from marsedl.replication.claims.printed import published_by_id
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    given, output = job.given(), snakemake.output
    published = published_by_id(snakemake.input.published) if job.params["printed"] else None
    for stem, csv, md in zip(job.params["stems"], output.csv, output.md, strict=True):
        table = function_of(entry_of(job.paper, "tables", stem))
        write_table(given.call(table, published=published), csv, md)
