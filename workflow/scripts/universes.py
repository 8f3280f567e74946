"""Compute a paper's universes, or a chunk of them, in one process with the records that they share; or join chunks."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.designs import design
from marsedl.replication.universes.table import Evaluator, Universes, gathered, held, require_same, tabulated

with guarded(snakemake) as job:
    paper, project = job.paper, Path(snakemake.params.project).resolve()
    committed = list(map(Path, snakemake.input.committed))
    tables = [store.load(path, Universes, paper=paper) for path in snakemake.input.get("chunks", ())]
    if not tables:
        chunk, chunks = int(snakemake.wildcards.get("chunk", 0)), int(snakemake.wildcards.get("chunks", 1))
        evaluator = Evaluator(catalogue(paper), input_model(paper), project, job.made["size"], job.made["own"])
        sample = [held(run, evaluator.study, one) for run in committed for one in job.made["sample"]]
        universes = sample or design(evaluator.study.choices, *job.made["designs"])
        title = f"{paper}, chunk {chunk + 1} of {chunks}"
        tables = [tabulated(evaluator, universes[chunk::chunks], title)]  # as many of each design in every chunk
    table = gathered(tables)
    for run in committed:
        require_same(run, table, paper)
    provenance = {"size": job.made["size"], "world": job.made["world"]}
    store.save(snakemake.output[0], table, paper=paper, reading="universes", provenance=provenance)
