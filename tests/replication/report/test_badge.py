"""The badge: that it counts what the report counts, in the schema that it is read by."""

from marsedl.replication.claims.claim import COUNTED_VERDICTS, LISTED_VERDICTS
from marsedl.replication.claims.committed import CommittedClaim
from marsedl.replication.report.front_page import badge


def rows(*verdicts):
    kinds = dict.fromkeys(("holds", "fails"), "qualitative")
    return [CommittedClaim(kinds.get(verdict, "deterministic"), verdict, None) for verdict in verdicts]


def test_it_counts_printed_numbers_and_statements_apart():
    assert badge(rows(*COUNTED_VERDICTS, "holds", *LISTED_VERDICTS)) == {
        "schemaVersion": 1,
        "label": "replication",
        "message": "1 of 4 printed numbers; 2 of 3 statements",
        "color": "blue",
    }
    assert badge(rows("fails", "quoted"))["message"] == "0 of 0 printed numbers; 0 of 1 statements"
