"""Every table of a build is data: plain `pandas.read_csv` gives the types that the table says it has."""

import re

import pandas as pd
import pytest

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue
from marsedl.replication.records.tables import TYPES

pytestmark = pytest.mark.workflow
FOLDERS = {slug: catalogue(slug).tables for slug in SLUGS}
NAMES = [f"{folder}/{stem}" for folder, stems in (FOLDERS | {"comparison": comparisons()}).items() for stem in stems]
NUMBERS = ("value", "standard_error", "printed")


def stated_types(markdown):
    """Type and unit of every column, by its head, as the table says below."""
    lines = markdown.partition("\n\n")[2].splitlines()
    cells = [re.split(r"(?<!\\) \| ", line.removeprefix("| ").removesuffix(" |")) for line in lines]
    return {head.replace("\\|", "|"): (kind, unit) for head, unit, kind, _ in cells[2:]}


def test_tables_have_the_types_and_units_that_they_state(copied):
    for name in NAMES:
        path = copied.path(f"figures/{name}.csv")
        stated = stated_types(path.with_suffix(".md").read_text(encoding="utf-8"))
        frame = pd.read_csv(path)
        assert list(frame) == list(stated) and len(frame), name
        for head, (kind, unit) in stated.items():
            dtype = str(frame[head].dtype)
            assert kind == TYPES[dtype] or (kind == TYPES["Int64"] and dtype in ("float64", "int64")), (name, head)
            assert not unit or head.endswith(f" ({unit})"), (name, head)


def test_claims_are_numbers(copied):
    for slug in SLUGS:
        frame = pd.read_csv(copied.path(f"figures/{slug}/claims.csv"))
        assert all(frame[column].dtype == float for column in NUMBERS), slug
        assert frame["trials"].dtype in (float, int), slug
        assert set(frame["paper"]) == {slug} and frame[["claim", "unit"]].notna().all(axis=None)
