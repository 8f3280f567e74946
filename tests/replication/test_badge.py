"""The badge: that it counts what the report counts, in the schema that it is read by."""

import json

from marsedl.replication.badge import badge, write_badge
from marsedl.replication.claims import COUNTED_VERDICTS, LISTED_VERDICTS


def rows(*verdicts):
    return [{"paper": "a", "id": str(k), "verdict": verdict} for k, verdict in enumerate(verdicts)]


def test_it_counts_what_reproduces_or_holds_of_what_is_counted():
    assert badge(rows(*COUNTED_VERDICTS, "holds", *LISTED_VERDICTS)) == {
        "schemaVersion": 1,
        "label": "replication",
        "message": "3 of 7 counted claims reproduce or hold",
        "color": "blue",
    }
    assert badge(rows("fails", "quoted"))["message"] == "0 of 1 counted claims reproduce or hold"


def test_the_same_claims_give_the_same_bytes(tmp_path):
    path = tmp_path / "badge.json"
    write_badge(rows("holds"), path)
    first = path.read_bytes()
    assert json.loads(first)["message"] == "1 of 1 counted claims reproduce or hold"
    write_badge(iter(rows("holds")), path)
    assert path.read_bytes() == first
