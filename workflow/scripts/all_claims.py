"""Join the claims of all papers with counterexamples and what universes say."""

from marsedl.replication.claims.rows import Counterexamples, read_as, read_claims, write_claims
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.universes.deciding import Decided

with guarded(snakemake):
    rows = []
    files = snakemake.input
    for claims, *beside in zip(files.claims, files.counterexamples, files.universes, strict=True):
        turned, standings = read_as(Counterexamples, beside[0]), read_as(Decided, beside[1]).standings
        rows += [
            row.model_copy(update={"counterexample": turned.get(row.id), "universes": standings.get(row.id)})
            for row in read_claims(claims)
        ]
    write_claims(rows, snakemake.output[0])
