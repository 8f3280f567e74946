"""The JSON Schema of `report/claims.json`, made from the type of a claim.

`make schemas` writes it to `docs/schemas/claims.json`; `docs/formats.md` says what it is for.
"""

import json
import sys
from pathlib import Path

from pydantic import TypeAdapter

from marsedl.replication.claims.claim import Claim

VERSION = 3  # of the format: one more when a file that was valid no longer is, or a key means something else


def claims_schema() -> dict:
    """Return the JSON Schema of `report/claims.json`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:marsedl:schema:{VERSION}:claims",
        "title": "Claims of a build",
        "description": "Papers in alphabetical order, a paper's claims in the order of its file.",
        **TypeAdapter(list[Claim]).json_schema(mode="serialization"),
    }


if __name__ == "__main__":
    text = json.dumps(claims_schema(), ensure_ascii=False, indent=1)
    Path(sys.argv[1]).write_text(f"{text}\n", encoding="utf-8", newline="\n")
