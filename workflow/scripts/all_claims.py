"""Join the claims of all papers."""

from marsedl.replication.claims import read_claims, write_claims
from marsedl.replication.jobs import guarded

with guarded(snakemake):
    write_claims([row for path in snakemake.input for row in read_claims(path)], snakemake.output[0])
