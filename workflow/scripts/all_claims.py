"""Join the claims of all papers with their counterexamples, and count their verdicts on a badge."""

from marsedl.replication.claims.rows import read_claims, read_counterexamples, write_claims
from marsedl.replication.files import write_json
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.report.front_page import badge

with guarded(snakemake):
    rows = []
    for claims, counterexamples in zip(snakemake.input.claims, snakemake.input.counterexamples, strict=True):
        turned = read_counterexamples(counterexamples)
        rows += [row.model_copy(update={"counterexample": turned.get(row.id)}) for row in read_claims(claims)]
    write_claims(rows, snakemake.output.claims)
    write_json(badge(rows), snakemake.output.badge)
