"""Try every law of a scenario with equally many sets of numbers, on the pool of trials for tuning."""

import json
from pathlib import Path

from marsedl.replication.files import write_text
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.sizes import FULL
from marsedl.scenarios import arena, load

with guarded(snakemake) as job:
    scenario = load(snakemake.wildcards.scenario, Path(snakemake.params.project).resolve())
    few = {} if job.params["size"] == FULL else {"flights": 4, "most": 2}
    found = {}
    for name, resident in scenario.residents.items():
        found[name] = [one._asdict() for one in arena.tuned(scenario, resident, **few)]
    write_text(snakemake.output[0], json.dumps(found, indent=1) + "\n")
