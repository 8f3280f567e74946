"""Evaluate every claim of one paper in every reading, and write its verdicts and its tables over all readings."""

import sys
from importlib import import_module

from marsedl.replication import claims
from marsedl.replication.claiming import claims_of
from marsedl.replication.jobs import guarded
from marsedl.replication.tables import claims_table, csv_text, write_table

with guarded(snakemake) as job:
    published = {claim.id: claim for claim in claims.load_published(snakemake.input.published)}
    measured = [claims.load_measured(path, job.paper) for path in snakemake.input.measured] or [None]
    own = claims_of(job.paper)
    evaluations = own.of_readings(job.readings(), published, measured=measured[0])
    rows = claims.collect(list(published.values()), own.declarations, *evaluations, **job.params.made["judged"])
    if names := claims.unexplained(rows):
        print(f"{job.paper}: claims that differ or fail without a reason: {', '.join(names)}", file=sys.stderr)
    claims.write_claims(rows, snakemake.output.claims)
    long, wide = snakemake.output.table
    claims.write_text(long, csv_text(claims_table(rows)))
    claims.write_text(wide, claims.claims_markdown(rows))
    for stem in job.params.summaries:
        table = getattr(import_module(f"marsedl.papers.{job.paper}.tables"), stem)
        write_table(table(job.of_readings(table), published), *snakemake.output[stem])
