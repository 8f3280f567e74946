"""Evaluate every claim of one paper in every reading, and write its verdicts."""

import sys

from marsedl.plotting.headlines import headline_picture
from marsedl.plotting.style import save_figure
from marsedl.replication.claims.printed import load_measured, published_by_id
from marsedl.replication.claims.rows import Evaluations, read_as, unexplained, write_claims, write_table_of_claims
from marsedl.replication.claims.writing import claims_of, judged
from marsedl.replication.pipeline.jobs import guarded

with guarded(snakemake) as job:
    published, output = published_by_id(snakemake.input.published), snakemake.output
    measured = load_measured(snakemake.input.measured, job.paper) if job.params["measured"] else None
    named = read_as(Evaluations, snakemake.input.points)
    rows = judged(claims_of(job.paper), job.readings(), published, named, measured, **job.params["judged"])
    if names := unexplained(rows):
        print(f"{job.paper}: claims that differ or fail without a reason: {', '.join(names)}", file=sys.stderr)
    write_claims(rows, output.claims)
    write_table_of_claims(rows, output.csv, output.md)
    save_figure(headline_picture(rows, job.params["beside"]), output.picture)
