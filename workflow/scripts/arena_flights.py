"""Fly a chunk of trials of all laws of a scenario in all conditions, as they were tuned."""

import json
from pathlib import Path

import numpy as np

from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.sizes import FULL
from marsedl.scenarios import load
from marsedl.scenarios.arena import flown, joined
from marsedl.scenarios.records import of_scores
from marsedl.scenarios.scenario import POOLS

with guarded(snakemake) as job:
    name, chunk = snakemake.wildcards.scenario, int(snakemake.wildcards.chunk)
    scenario = load(name, Path(snakemake.params.project).resolve())
    tuned, ranges = json.loads(Path(snakemake.input.tuned).read_text()), job.params["chunks"][chunk]
    conditions = [*scenario.conditions] if job.params["size"] == FULL else ["dispersed"]
    scores = {}
    for law in scenario.residents:
        flies = scenario.law(law, **tuned[law][0]["numbers"])
        scores[law] = {
            condition: joined([flown(scenario, flies, condition, POOLS["proof"], *trials) for trials in ranges])
            for condition in conditions
        }
        print(f"{name}, chunk {chunk + 1} of {len(job.params['chunks'])}: {law} is flown", flush=True)
    trials = np.concatenate([np.arange(first, first + count) for first, count in ranges])
    provenance = {"size": job.params["size"], "world": job.params["world"]}
    flights = of_scores(scores, trials)
    store.save(snakemake.output[0], flights, paper="arena", reading=name, provenance=provenance)
