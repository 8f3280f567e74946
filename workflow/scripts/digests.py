"""Digest every product."""

import json

from marsedl.replication.claims import write_text
from marsedl.replication.digests import digest
from marsedl.replication.jobs import guarded

with guarded(snakemake):
    found = {path: digest(path) for path in sorted(snakemake.input)}
    write_text(snakemake.output[0], json.dumps(found, indent=1) + "\n")
