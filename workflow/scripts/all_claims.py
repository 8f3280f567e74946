"""Join the claims of all papers, and count their verdicts on a badge."""

from marsedl.replication.badge import write_badge
from marsedl.replication.claims import read_claims, write_claims
from marsedl.replication.jobs import guarded

with guarded(snakemake):
    rows = [row for path in snakemake.input for row in read_claims(path)]
    write_claims(rows, snakemake.output.claims)
    write_badge(rows, snakemake.output.badge)
