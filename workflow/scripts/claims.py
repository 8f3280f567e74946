"""Evaluate every claim of one paper in every reading, and write its verdicts and its tables over all readings."""

import sys

from marsedl.replication.claims.printed import load_measured, load_published
from marsedl.replication.claims.rows import unexplained, write_claims, write_table_of_claims
from marsedl.replication.claims.verdicts import collect
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    published = {claim.id: claim for claim in load_published(snakemake.input.published)}
    measured = [load_measured(path, job.paper) for path in snakemake.input.measured] or [None]
    own = claims_of(job.paper)
    evaluations = own.of_readings(job.readings(), published, measured=measured[0])
    rows = collect(list(published.values()), own.declarations, *evaluations, **job.params.made["judged"])
    if names := unexplained(rows):
        print(f"{job.paper}: claims that differ or fail without a reason: {', '.join(names)}", file=sys.stderr)
    write_claims(rows, snakemake.output.claims)
    write_table_of_claims(rows, *snakemake.output.table)
    for stem in job.params.summaries:
        table = function_of(entry_of(job.paper, "tables", stem))
        write_table(table(job.of_readings(table), published), *snakemake.output[stem])
