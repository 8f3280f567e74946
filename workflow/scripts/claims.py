"""Evaluate every claim of one paper in every reading, and write its verdicts and its tables over all readings."""

import sys
from importlib import import_module

from marsedl.replication import claims
from marsedl.replication.jobs import guarded
from marsedl.replication.tables import write_table

with guarded(snakemake) as job:
    module = import_module(f"marsedl.papers.{job.paper}.claims")
    published = claims.load_published(snakemake.input.published)
    tables = [claims.load_measured(path, job.paper) for path in snakemake.input.measured]
    readings = job.readings(module.evaluate, measured=tables[0] if tables else None)
    evaluations = {name: module.evaluate(**given) for name, given in readings.items()}
    rows = claims.collect(published, module.DECLARATIONS, evaluations, **job.params.judged)
    if names := claims.unexplained(rows):
        print(f"{job.paper}: claims that differ or fail without a reason: {', '.join(names)}", file=sys.stderr)
    claims.write_claims(rows, snakemake.output.claims)
    for path, text in zip(snakemake.output.table, claims.claims_table(rows), strict=True):
        claims.write_text(path, text)
    for stem in job.params.summaries:
        table = getattr(import_module(f"marsedl.papers.{job.paper}.tables"), stem)
        records = {name: (given["inputs"], given["records"]) for name, given in readings.items()}
        write_table(table(records, {claim.id: claim for claim in published}), *snakemake.output[stem])
