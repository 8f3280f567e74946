"""A machine that pretends to be another one: other bits, the same verdicts, numbers within the tolerances."""

import shutil

import pytest

from marsedl.replication import artifacts, machines
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import digest_tree

pytestmark = pytest.mark.workflow
SLUG = "powered_descent"
FOLDER = f"data/cache/{SLUG}/corrected"
TARGET = f"report/claims/{SLUG}.json"


def test_numbers_stay_within_tolerance_without_vector_units(tree, tmp_path):
    """One reading of one paper is built again; `marsedl machines` does so with all of them."""
    pinned, machine = tmp_path / "pinned", machines.MACHINES["sse"]
    copy = build_folder(pinned, "smoke")
    for name in (f"data/cache/{SLUG}", "report/claims"):
        shutil.copytree(tree.path(name), copy / name)
    before = digest_tree(copy, [f"{FOLDER}/*.h5"])

    # Without the parameters, which differ in all readings now, what is named is built again and nothing else.
    done = tree.run(TARGET, "--rerun-triggers", "mtime", "input", "--forcerun", *before, TARGET, **machine.environment)
    assert done.returncode == 0, done.stdout[-3000:]

    for name in before:
        assert machine.setting() in str(artifacts.provenance(tree.path(name))), name
    after = digest_tree(tree.build, [f"{FOLDER}/*.h5"])
    assert after.keys() == before.keys()
    assert after != before, "nothing was switched"
    comparison = machines.compared(pinned, tree.folder, SLUG)
    assert comparison.changes == []
    assert len(comparison.margins) > 500

    planned = tree.plan(TARGET).of(SLUG)
    assert planned.changed, "pinned again, what was built with other instruction sets would stay"
    assert planned.readings == {"corrected"}
