"""Join the claims of all papers with their counterexamples, and count their verdicts on a badge."""

from marsedl.replication.claims import read_claims, read_counterexamples, with_counterexamples, write_claims
from marsedl.replication.front_page import write_badge
from marsedl.replication.jobs import guarded

with guarded(snakemake):
    files = zip(snakemake.input.claims, snakemake.input.counterexamples, strict=True)
    rows = [
        row
        for claims, counterexamples in files
        for row in with_counterexamples(read_claims(claims), read_counterexamples(counterexamples))
    ]
    write_claims(rows, snakemake.output.claims)
    write_badge(rows, snakemake.output.badge)
