"""Turn every counted claim of one paper by its counterexample, and write by how much."""

from marsedl.replication import claims
from marsedl.replication.claiming import claims_of
from marsedl.replication.jobs import guarded

with guarded(snakemake) as job:
    published = {claim.id: claim for claim in claims.load_published(snakemake.input.published)}
    measured = [claims.load_measured(path, job.paper) for path in snakemake.input.measured] or [None]
    [(values, artifact)] = job.readings().values()
    rows = claims.read_claims(snakemake.input.claims)
    turned = claims_of(job.paper).turned(rows, values, artifact, published, measured=measured[0])
    claims.write_json(turned, snakemake.output[0])
