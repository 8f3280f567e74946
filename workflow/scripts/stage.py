"""Run one stage: load the artifacts it needs, call its function, save what it returns."""

from importlib import import_module

from marsedl.replication.jobs import compile_in_turn, guarded

with guarded(snakemake) as job:
    module, name = job.params.entry.split(":")
    function = getattr(import_module(module), name)
    compile_in_turn()
    job.save(function(job.inputs, **job.arguments(function), **job.params.get("options", {})))
