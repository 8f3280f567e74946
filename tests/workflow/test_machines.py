"""A machine that pretends to be another one: other bits, the same verdicts, numbers within the tolerances."""

import shutil

import pytest

from marsedl.replication import artifacts, machines
from marsedl.replication.verification import PRODUCTS, digest_tree

pytestmark = pytest.mark.workflow
SLUG = "powered_descent"
TARGET = f"report/claims/{SLUG}.json"


def test_numbers_stay_within_tolerance_without_vector_units(tree, tmp_path):
    pinned = tmp_path / "pinned"
    for name in (f"data/cache/{SLUG}", "report/claims"):
        shutil.copytree(tree.path(name), pinned / name)
    before = digest_tree(pinned, PRODUCTS)
    machine = machines.MACHINES["sse"]

    done = tree.run(TARGET, **machine.environment)
    assert done.returncode == 0, done.stdout[-3000:]

    after = digest_tree(tree.folder, [f"data/cache/{SLUG}/**/*.h5"])
    assert [name for name, digest in after.items() if digest != before[name]], "nothing was switched"
    assert machine.setting() in artifacts.provenance(tree.path(f"data/cache/{SLUG}/corrected/gains.h5"))["code"]
    comparison = machines.compared(pinned, tree.folder, SLUG)
    assert comparison.changes == []
    assert len(comparison.margins) > 500
    assert tree.plan(TARGET).of(SLUG).changed, "pinned again, it would not be built again"
