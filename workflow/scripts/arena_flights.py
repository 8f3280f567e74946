"""Fly a chunk of trials of all laws of a scenario in all conditions, as they were tuned."""

import json
from pathlib import Path

from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.sizes import FULL
from marsedl.scenarios import load
from marsedl.scenarios.records import flown_chunk

with guarded(snakemake) as job:
    name, chunk = snakemake.wildcards.scenario, int(snakemake.wildcards.chunk)
    scenario = load(name, Path(snakemake.params.project).resolve())
    tuned = json.loads(Path(snakemake.input.tuned).read_text())
    conditions = None if job.params["size"] == FULL else ["dispersed"]
    flights = flown_chunk(scenario, tuned, job.params["chunks"][chunk], conditions)
    provenance = {"size": job.params["size"], "world": job.params["world"]}
    store.save(snakemake.output[0], flights, paper="arena", reading=name, provenance=provenance)
