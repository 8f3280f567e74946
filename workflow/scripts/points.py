"""Evaluate the claims of a paper in its named readings, in one process with the records that they share."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.rows import Evaluations, write_as
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.universes.table import Evaluator

with guarded(snakemake) as job:
    project = Path(snakemake.params.project).resolve()
    evaluator = Evaluator(catalogue(job.paper), input_model(job.paper), project, job.params["size"], job.params["own"])
    found = {name: evaluator.point(name) for name in job.params["points"]}
    write_as(Evaluations, found, snakemake.output[0])
