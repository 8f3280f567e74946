"""Write the tables of a reading that need the same artifacts, as CSV and Markdown."""

from marsedl.replication.claims.printed import published_of
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    given, published = job.given(), published_of(job.params)
    for number, stem in enumerate(job.params.made["stems"]):
        table = given.call(function_of(entry_of(job.paper, "tables", stem)), **published)
        write_table(table, *snakemake.output[2 * number : 2 * number + 2])
