"""The badge counts what the report counts."""

from marsedl.replication.claims.committed import CommittedClaim
from marsedl.replication.claims.names import COUNTED_VERDICTS, LISTED_VERDICTS
from marsedl.replication.report.front_page import badge


def rows(*verdicts):
    kinds = dict.fromkeys(("holds", "fails"), "qualitative")
    return [CommittedClaim(kinds.get(verdict, "deterministic"), verdict, None) for verdict in verdicts]


def test_it_counts_printed_numbers_and_statements_apart():
    counted = badge(rows(*COUNTED_VERDICTS, "holds", *LISTED_VERDICTS))
    assert counted == "1 of 4 printed numbers; 2 of 3 statements"
    assert badge(rows("fails", "quoted")) == "0 of 0 printed numbers; 0 of 1 statements"
