"""Compute a chunk of a paper's universes, in one process with the records that they share in memory."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.designs import design, part
from marsedl.replication.universes.table import Evaluator, tabulated

with guarded(snakemake) as job:
    chunk, chunks = (int(snakemake.wildcards[name]) for name in ("chunk", "chunks"))
    project = Path(snakemake.params.project).resolve()
    evaluator = Evaluator.of(catalogue(job.paper), input_model(job.paper), project, job.made["size"])
    universes = part(design(evaluator.study.choices, job.made["space_filling"], job.made["alone"]), chunk, chunks)
    table = tabulated(evaluator, universes, f"{job.paper}, chunk {chunk + 1} of {chunks}")
    store.save(snakemake.output[0], table, paper=job.paper, reading="universes", provenance={})
