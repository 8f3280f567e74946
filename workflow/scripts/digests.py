"""Digest every product."""

import json

from marsedl.replication.files import write_text
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.differences import digest

with guarded(snakemake):
    found = {path: digest(path) for path in sorted({*snakemake.input.needs})}
    write_text(snakemake.output[0], json.dumps(found, indent=1) + "\n")
