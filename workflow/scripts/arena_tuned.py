"""Try every law of a scenario with equally many sets of numbers, on the pool of trials for tuning.

Where the sealed table is of today's code and inputs, its tries are taken, and those of one law are made once more.
"""

import json
from pathlib import Path

from marsedl.replication.files import write_text
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.sizes import FULL
from marsedl.scenarios import arena, load

with guarded(snakemake) as job:
    scenario = load(snakemake.wildcards.scenario, Path(snakemake.params.project).resolve())
    sealed = next((json.loads(Path(p).read_text()) for p in snakemake.input.files if p.endswith(".json")), {})
    full = job.params["size"] == FULL
    if full and sealed.get("world") == snakemake.params.world and "tries" in sealed:
        found = sealed["tries"]
        print(f"{scenario.name}: laws are tuned as in the sealed table; {arena.tuned_again(scenario, found)} once more")
    else:
        few = {} if full else {"flights": 4, "most": 2}
        tries = {name: arena.tuned(scenario, resident, **few) for name, resident in scenario.residents.items()}
        found = {name: [one._asdict() for one in of] for name, of in tries.items()}
    write_text(snakemake.output[0], json.dumps(found, indent=1) + "\n")
