"""Draw one figure."""

from importlib import import_module

from marsedl.plotting.style import save_figure
from marsedl.replication.claims import load_published
from marsedl.replication.jobs import guarded

with guarded(snakemake) as job:
    function = getattr(import_module(f"marsedl.papers.{job.paper}.figures"), snakemake.wildcards.stem)
    arguments = job.arguments(function)
    if job.params.get("printed"):
        arguments["published"] = {claim.id: claim for claim in load_published(job.params.published)}
    save_figure(function(job.inputs, **arguments), *snakemake.output)
