"""Turn every counted claim of one paper by its counterexample, and write by how much."""

from marsedl.replication.claims.printed import load_measured, published_by_id
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.claims.writing import claims_of, turned
from marsedl.replication.files import write_json
from marsedl.replication.pipeline.jobs import guarded

with guarded(snakemake) as job:
    published = published_by_id(snakemake.input.published)
    measured = load_measured(snakemake.input.measured, job.paper) if job.params["measured"] else None
    [given] = job.readings().values()
    rows = read_claims(snakemake.input.claims)
    found = turned(claims_of(job.paper), rows, given, published, measured=measured)
    write_json(found, snakemake.output[0])
