"""Draw and tabulate what came out of a scenario, and compare what was flown with its sealed table."""

import json
from pathlib import Path

from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.scenarios import arenas, load
from marsedl.scenarios.records import ArenaFlights, gathered
from marsedl.scenarios.shown import Shown, write

with guarded(snakemake) as job:
    name, project = snakemake.wildcards.scenario, Path(snakemake.params.project).resolve()
    chunks = [store.load(path, ArenaFlights, paper="arena", reading=name) for path in snakemake.input.flights]
    sealed = next((json.loads(Path(p).read_text()) for p in snakemake.input.files if p.endswith(".json")), None)
    tuned = json.loads(Path(snakemake.input.tuned).read_text())
    shown = Shown(load(name, project), *gathered(chunks), tuned, job.params["world"], sealed)
    write(shown, arenas()[name], snakemake.output)
