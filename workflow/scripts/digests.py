"""Digest every product."""

import json

from marsedl.replication.claims import write_text
from marsedl.replication.digests import digest
from marsedl.replication.jobs import guarded

with guarded(snakemake):
    products = sorted(set(snakemake.input) - {snakemake.input.changed})
    found = {path: digest(path) for path in products}
    write_text(snakemake.output[0], json.dumps(found, indent=1) + "\n")
