"""Compute further universes of a paper where all of its headlines may be true at once."""

from functools import partial
from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.table import Evaluator, Universes, tabulated, world_of
from marsedl.replication.universes.waves import Matching

with guarded(snakemake) as job:
    paper, size, project = job.paper, job.made["size"], Path(snakemake.params.project).resolve()
    evaluator = Evaluator(catalogue(paper), input_model(paper), project, size, job.made["own"])
    table = store.load(snakemake.input.table, Universes, paper=paper)
    matching = Matching(evaluator.study.choices, evaluator.published.values())
    compute = partial(tabulated, evaluator, title=f"{paper}, waves")
    table = matching.extended(table, compute, evaluator.study.universes.wave)
    provenance = {"size": size, "world": world_of(job.made)}
    store.save(snakemake.output[0], table, paper=paper, reading="universes", provenance=provenance)
