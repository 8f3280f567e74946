"""Turn every counted claim of one paper by its counterexample, and write by how much."""

from marsedl.replication.claims.printed import load_measured, published_of
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.claims.writing import claims_of, turned
from marsedl.replication.files import write_json
from marsedl.replication.pipeline.jobs import guarded

with guarded(snakemake) as job:
    [published] = published_of(snakemake.input).values()
    measured = [load_measured(path, job.paper) for path in snakemake.input.measured] or [None]
    [given] = job.readings().values()
    rows = read_claims(snakemake.input.claims)
    found = turned(claims_of(job.paper), rows, given, published, measured=measured[0])
    write_json(found, snakemake.output[0])
