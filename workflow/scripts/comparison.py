"""Draw and tabulate one comparison across papers."""

from importlib import import_module

from marsedl.comparison.records import collect
from marsedl.plotting.style import save_figure
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    stem, params, output = snakemake.wildcards.stem, job.params, snakemake.output
    comparison = import_module(f"marsedl.comparison.{stem}")
    records = collect(stem, params.made["inputs"], params.artifacts, job.load)
    save_figure(comparison.figure(records), output.png, output.pdf)
    write_table(comparison.table(records), output.csv, output.md)
