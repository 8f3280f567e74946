"""Text for a terminal: columns fit its width, and nothing of a file acts on it; and where a size's products are."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from marsedl.replication.sizes import build_folder
from marsedl.replication.terminal import columns, printable, printable_lines
from marsedl.replication.verification import Change, format_changes

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


@pytest.mark.parametrize("wrap", [True, False])
def test_a_pipe_gets_whole_rows(wrap):
    code = f"from marsedl.replication.terminal import columns; print(columns([('name', 'word ' * 999)], wrap={wrap}))"
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    process = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert process.stdout == f"name  {'word ' * 999}".rstrip() + "\n"


def test_control_characters_are_shown_and_not_printed():
    assert printable("a\x1b[2J\tb\n\u200b\ud800 é–") == r"a\x1b[2J\tb\n\u200b\ud800 é–"
    assert printable_lines("a\x1b\nb\r\n") == "a\\x1b\nb\\r\n"
    assert columns([("a\x1b", "b\nc")], width=20) == r"a\x1b  b\nc"
    _, line = format_changes([Change("corrected/gains/x\x1b[2J\n", "1", "2", 3.0)]).splitlines()
    assert line.split() == [r"corrected/gains/x\x1b[2J\n", "1", "2", "3"]


def test_the_full_size_is_in_the_project_and_others_are_below_build():
    assert build_folder(Path("project"), "full") == Path("project")
    assert build_folder(Path("project"), "smoke") == Path("project/build/smoke")
