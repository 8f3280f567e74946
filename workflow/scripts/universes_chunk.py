"""Compute a chunk of a paper's universes and named readings, in one process with the records that they share."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.rows import write_evaluations
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.designs import design
from marsedl.replication.universes.table import Evaluator, chunk_of

with guarded(snakemake) as job:
    chunk, chunks = (int(snakemake.wildcards[name]) for name in ("chunk", "chunks"))
    project = Path(snakemake.params.project).resolve()
    evaluator = Evaluator(catalogue(job.paper), input_model(job.paper), project, job.made["size"], job.made["own"])
    universes = design(evaluator.study.choices, *job.made["designs"])
    table, points = chunk_of(evaluator, universes, chunk, chunks, f"{job.paper}, chunk {chunk + 1} of {chunks}")
    write_evaluations(points, snakemake.output.points)
    store.save(snakemake.output.table, table, paper=job.paper, reading="universes", provenance={})
