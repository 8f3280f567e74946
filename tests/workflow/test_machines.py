"""A machine that pretends to be another one: other bits, the same verdicts, numbers within the tolerances."""

import shutil

import pytest

from marsedl.replication import artifacts, machines
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import digest_tree

pytestmark = pytest.mark.workflow
SLUG = "powered_descent"
FOLDER = f"data/cache/{SLUG}"
READINGS = ("printed", "corrected")  # the least that a size may have
TARGET = f"report/claims/{SLUG}.json"
CONFIG = f"configs/{SLUG}.yaml"


@pytest.mark.long  # `marsedl machines` measures all of it, and its table is committed
def test_numbers_stay_within_tolerance_without_vector_units(tree, tmp_path):
    """Two readings of one paper are built again; `marsedl machines` does so with all of them."""
    pinned, machine = tmp_path / "pinned", machines.MACHINES["sse"]
    readings = "  smoke:\n    readings: [%s]"
    every = "printed, printed_eq46, corrected, euler, kilonewton_noise"
    tree.edit(CONFIG, readings % every, readings % "printed, corrected")
    assert tree.run(TARGET).returncode == 0
    copy = build_folder(pinned, "smoke")
    for name in (f"data/cache/{SLUG}", "report/claims"):
        shutil.copytree(tree.path(name), copy / name)
    artifacts_of_both = [f"{FOLDER}/{reading}/*.h5" for reading in READINGS]
    before = digest_tree(copy, artifacts_of_both)

    process = tree.run(TARGET, **machine.environment)
    assert process.returncode == 0, process.stdout[-3000:]

    for name in before:
        assert machine.setting() in str(artifacts.provenance(tree.path(name))), name
    after = digest_tree(tree.build, artifacts_of_both)
    assert after.keys() == before.keys()
    assert after != before, "nothing was switched"
    comparison = machines.compare_builds(pinned, tree.folder, SLUG)
    assert comparison.changes == []
    assert len(comparison.margins) > 500

    planned = tree.plan(TARGET).of(SLUG)
    assert planned.changed_rules, "pinned again, what was built with other instruction sets would stay"
    assert planned.readings == set(READINGS)
