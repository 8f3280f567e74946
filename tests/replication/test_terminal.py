"""Text for a terminal: columns fit its width, and nothing of a file acts on it; and where a size's products are."""

from pathlib import Path

from marsedl.replication.sizes import build_folder
from marsedl.replication.terminal import columns, printable

ROWS = [("mass", "kg", "of the vehicle with its fuel"), ("altitude_at_entry", "m", "above the datum")]


def test_columns_are_aligned_and_as_wide_as_they_need():
    assert columns(ROWS, 2, width=100).splitlines() == [
        "  mass               kg  of the vehicle with its fuel",
        "  altitude_at_entry  m   above the datum",
    ]
    assert columns([]) == ""


def test_long_cells_are_broken_and_names_are_not():
    assert columns(ROWS, width=36).splitlines() == [
        "mass               kg  of the",
        "                       vehicle with",
        "                       its fuel",
        "altitude_at_entry  m   above the",
        "                       datum",
    ]


def test_long_cells_are_cut_where_every_row_has_one_line():
    assert columns(ROWS, width=36, wrap=False).splitlines() == [
        "mass               kg  of the vehic…",
        "altitude_at_entry  m   above the da…",
    ]


def test_the_widest_column_gives_way_first():
    line = columns([("name", "x" * 60, "y" * 24)], width=60, wrap=False)
    assert line == f"name  {'x' * 27}…  {'y' * 24}"
    assert columns([("name" * 20, "x" * 60)], width=40, wrap=False) == f"{'name' * 20}  xxxxxxx…", "no less than that"


def test_control_characters_are_shown_and_not_printed():
    assert printable("a\x1b[2J\tb\n\u200b\ud800 é–") == "a\\x1b[2J\\tb\n\\u200b\\ud800 é–"
    assert columns([("a", "b\nc")], width=20) == "a  b c"


def test_the_full_size_is_in_the_project_and_others_are_below_build():
    assert build_folder(Path("project"), "full") == Path("project")
    assert build_folder(Path("project"), "smoke") == Path("project/build/smoke")
