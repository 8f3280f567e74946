"""Compute a chunk of a paper's universes, in one process with the records that they share."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.designs import design
from marsedl.replication.universes.judging import COMMITTED
from marsedl.replication.universes.table import Evaluator, held, tabulated

with guarded(snakemake) as job:
    chunk, chunks = (int(snakemake.wildcards[name]) for name in ("chunk", "chunks"))
    project = Path(snakemake.params.project).resolve()
    evaluator = Evaluator(catalogue(job.paper), input_model(job.paper), project, job.made["size"], job.made["own"])
    if "sample" in job.made:
        run = project / COMMITTED / f"{job.paper}.h5"
        universes = [held(run, evaluator.study, number) for number in job.made["sample"]]
    else:
        universes = design(evaluator.study.choices, *job.made["designs"])
    universes = universes[chunk::chunks]  # as many of each design in every chunk
    table = tabulated(evaluator, universes, f"{job.paper}, chunk {chunk + 1} of {chunks}")
    store.save(snakemake.output[0], table, paper=job.paper, reading="universes", provenance={})
