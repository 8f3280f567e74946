"""Join the claims of all papers with counterexamples and what universes say."""

from marsedl.replication.claims.rows import read_claims, read_counterexamples, write_claims
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.universes.deciding import read_decided

with guarded(snakemake):
    rows = []
    files = snakemake.input
    for claims, *beside in zip(files.claims, files.counterexamples, files.universes, strict=True):
        turned, standings = read_counterexamples(beside[0]), read_decided(beside[1]).standings
        rows += [
            row.model_copy(update={"counterexample": turned.get(row.id), "universes": standings.get(row.id)})
            for row in read_claims(claims)
        ]
    write_claims(rows, snakemake.output[0])
