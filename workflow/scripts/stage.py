"""Run one stage: load the artifacts it needs, call its function, save what it returns."""

from marsedl.replication.pipeline.jobs import guarded

with guarded(snakemake) as job:
    job.run()
