"""Draw and tabulate one comparison across papers."""

from importlib import import_module

from marsedl.comparison.records import collect
from marsedl.plotting.style import save_figure
from marsedl.replication.pipeline.jobs import guarded, parameter_of
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    stem, inputs, output = snakemake.wildcards.stem, job.params["inputs"], snakemake.output
    files = {slug: {parameter_of(p): p for p in snakemake.input.artifacts if f"/{slug}/" in p} for slug in inputs}
    comparison = import_module(f"marsedl.comparison.{stem}")
    records = collect(stem, inputs, files, job.load)
    save_figure(comparison.figure(records), output.png, output.pdf)
    write_table(comparison.table(records), output.csv, output.md)
