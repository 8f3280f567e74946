"""Compute a paper's universes, or a chunk of them, in one process with the records that they share; or join chunks."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.designs import design
from marsedl.replication.universes.table import Evaluator, Universes, gathered, held, require_same, tabulated

with guarded(snakemake) as job:
    paper, project = job.paper, Path(snakemake.params.project).resolve()
    committed = {Path(run): store.load(run, Universes, paper=paper) for run in snakemake.input.committed}
    if not (tables := [store.load(path, Universes, paper=paper) for path in snakemake.input.get("chunks", ())]):
        chunk, chunks = int(snakemake.wildcards.get("chunk", 0)), int(snakemake.wildcards.get("chunks", 1))
        evaluator = Evaluator(catalogue(paper), input_model(paper), project, job.params["size"], job.params["own"])
        choices, numbers = evaluator.study.choices, job.params["sample"]
        sample = [held(run, choices, number, path) for path, run in committed.items() for number in numbers]
        universes = sample or design(choices, *job.params["designs"])
        title = f"{paper}, chunk {chunk + 1} of {chunks}"
        tables = [tabulated(evaluator, universes[chunk::chunks], title)]  # as many of each design in every chunk
    table = gathered(tables)
    for path, run in committed.items():
        require_same(run, table, path)
    provenance = {"size": job.params["size"], "world": job.params["world"]}
    store.save(snakemake.output[0], table, paper=paper, reading="universes", provenance=provenance)
