"""Draw one figure."""

from importlib import import_module

from marsedl.plotting.style import save_figure
from marsedl.replication.jobs import guarded, published_of

with guarded(snakemake) as job:
    function = getattr(import_module(f"marsedl.papers.{job.paper}.figures"), *job.params.made["stems"])
    save_figure(function(**job.arguments_of(function, **published_of(job.params))), *snakemake.output)
