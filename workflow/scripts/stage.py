"""Run one stage: load the artifacts it needs, call its function, save what it returns."""

from importlib import import_module

from marsedl.replication.jobs import guarded

with guarded(snakemake) as job:
    module, name = job.params.entry.split(":")
    function = getattr(import_module(module), name)
    job.save(function(job.inputs, **job.arguments(function), **job.params.get("options", {})))
