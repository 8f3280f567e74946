"""Evaluate every claim of one paper in every reading, and write its verdicts and its tables over all readings."""

import sys

from marsedl.replication.claims.printed import load_measured, published_of
from marsedl.replication.claims.rows import unexplained, write_claims, write_table_of_claims
from marsedl.replication.claims.verdicts import collect
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.jobs import guarded, parameter_of
from marsedl.replication.records.tables import write_table

with guarded(snakemake) as job:
    [published], output = published_of(snakemake.input).values(), snakemake.output
    measured = [load_measured(path, job.paper) for path in snakemake.input.measured] or [None]
    own = claims_of(job.paper)
    evaluations = own.of_readings(job.readings(), published, measured=measured[0])
    rows = collect(list(published.values()), own.declarations, evaluations, **job.made["judged"])
    if names := unexplained(rows):
        print(f"{job.paper}: claims that differ or fail without a reason: {', '.join(names)}", file=sys.stderr)
    write_claims(rows, output.claims)
    write_table_of_claims(rows, output.csv, output.md)
    for csv, md in zip(output.summaries[::2], output.summaries[1::2], strict=True):
        table = function_of(entry_of(job.paper, "tables", parameter_of(csv)))
        write_table(table(job.of_readings(table), published), csv, md)
