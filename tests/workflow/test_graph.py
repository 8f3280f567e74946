"""A paper in one process gives the bits that its jobs give."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.rows import read_claims

pytestmark = pytest.mark.workflow


def in_memory(root, size, slug):
    """What a process of its own, with pinned numerics, finds."""
    command = [sys.executable, str(Path(__file__).with_name("in_memory.py")), str(root), size, slug]
    environment = {**os.environ, "PYTHONPATH": str(root / "src"), "PYTHONHASHSEED": "0"}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]
    return json.loads(process.stdout)


def stages(report):
    return {name.split(".")[0] for name in report["compared"]} | {"montecarlo_chunk", "montecarlo_gather"}


# One paper in every run of the suite: the others take minutes.
@pytest.mark.parametrize("slug", [SLUGS[0], *(pytest.param(slug, marks=pytest.mark.long) for slug in SLUGS[1:])])
def test_every_stage_at_smoke_size(tree, slug):
    report = in_memory(tree.folder, "smoke", slug)
    assert stages(report) == set(catalogue(slug).stages)
    assert report["unequal"] == []
    for row in read_claims(tree.path(f"report/claims/{slug}.json")):
        if isinstance(value := row.readings["corrected"].value, float | bool | int):
            assert report["values"][row.id] == value, row.id
