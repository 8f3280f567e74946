"""Join the chunks of a paper's universes; those of the committed run have to be the same bits."""

from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.table import Universes, changed, gathered

with guarded(snakemake) as job:
    table = gathered([store.load(path, Universes, paper=job.paper) for path in snakemake.input.chunks])
    for path in snakemake.input.committed:
        if moved := changed(store.load(path, Universes, paper=job.paper), table):
            differing = "; ".join(f"universe {number} {what}" for number, what in moved.items())
            raise MarsedlError(f"{path} is not what this project computes: {differing}; run 'snakemake multiverse'")
    provenance = {"size": job.made["size"], "world": job.made["world"]}
    store.save(snakemake.output[0], table, paper=job.paper, reading="universes", provenance=provenance)
