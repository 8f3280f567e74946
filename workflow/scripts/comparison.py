"""Draw and tabulate one comparison across papers."""

from importlib import import_module

from marsedl.comparison.records import collect
from marsedl.plotting.style import save_figure
from marsedl.replication.jobs import guarded
from marsedl.replication.tables import write_table

with guarded(snakemake) as job:
    stem, params, output = snakemake.wildcards.stem, job.params, snakemake.output
    comparison = import_module(f"marsedl.comparison.{stem}")
    benchmarks = params.benchmarks if params.measured else None
    found = collect(stem, params.reading, params.inputs, params.artifacts, benchmarks)
    save_figure(comparison.figure(found), output.png, output.pdf)
    write_table(comparison.table(found), output.csv, output.md)
