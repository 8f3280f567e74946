"""Join the chunks of a paper's universes, and of its named readings."""

from marsedl.replication.claims.rows import read_evaluations, write_evaluations
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.universes.table import Universes, gathered, world_of

with guarded(snakemake) as job:
    points = {name: of for path in snakemake.input.points for name, of in read_evaluations(path).items()}
    write_evaluations({name: points[name] for name in job.made["points"]}, snakemake.output.points)
    table = gathered([store.load(path, Universes, paper=job.paper) for path in snakemake.input.chunks])
    provenance = {"size": job.made["size"], "world": world_of(job.made)}
    store.save(snakemake.output.table, table, paper=job.paper, reading="universes", provenance=provenance)
