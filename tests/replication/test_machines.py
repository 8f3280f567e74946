"""What differs on other machines is in the committed table, and docs/reproducibility.md says why."""

import csv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def committed():
    with (ROOT / "data" / "reference" / "machines.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def explained():
    """The first cells of the rows of all tables in the page, without the marks of code."""
    text = (ROOT / "docs" / "reproducibility.md").read_text(encoding="utf-8")
    rows = [line.replace("`", "").strip("|").split("|") for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in row] for row in rows]


def test_verdicts_change_on_another_machine_only_where_the_page_says_why(committed, explained):
    changed = {name for row in committed if row["artifact"] == "verdicts" for name in row["worst"].split("; ") if name}
    assert changed == {row[0] for row in explained if len(row) == 2}


def test_numbers_are_beyond_their_tolerance_only_where_the_page_says_why(committed, explained):
    beyond = {(row["paper"], row["artifact"]) for row in committed if row["margin"] and row["beyond"] != "0"}
    assert beyond == {tuple(row[:2]) for row in explained if len(row) == 4}
