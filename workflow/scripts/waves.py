"""Compute further universes: where all headlines of a paper may be true at once, and between the values of ranges."""

from functools import partial
from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.judging import judge_in
from marsedl.replication.universes.table import Evaluator, Universes, tabulated
from marsedl.replication.universes.waves import Matching, refined

with guarded(snakemake) as job:
    paper, size, project = job.paper, job.params["size"], Path(snakemake.params.project).resolve()
    evaluator = Evaluator(catalogue(paper), input_model(paper), project, size, job.params["own"])
    table = store.load(snakemake.input.table, Universes, paper=paper)
    judge = judge_in(evaluator.study, table)
    compute = partial(tabulated, evaluator, title=f"{paper}, waves")
    table = Matching(judge).extended(compute, evaluator.study.universes.wave)
    table = refined(judge.over(table), compute)
    provenance = {"size": size, "world": job.params["world"]}
    store.save(snakemake.output[0], table, paper=paper, reading="universes", provenance=provenance)
