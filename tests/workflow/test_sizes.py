"""A size other than the full one lives in a folder of its own, and never touches full results."""

import os
import signal
import time

import pytest

from marsedl.replication.claims import read_claims

pytestmark = pytest.mark.workflow

FULL = tuple(f"figures/powered_descent/{name}" for name in ("fig02.png", "fig06a.png", "fig07.png", "eq54.csv"))
CLAIMS = "report/claims/powered_descent.json"
NOMINAL = "data/cache/powered_descent/corrected/nominal.h5"


@pytest.fixture
def both(tree):
    """The tree with full-size products of one paper beside the whole smoke build, and their digests."""
    smoke, tree.config = tree.config, []
    process = tree.run(*FULL)
    assert process.returncode == 0, process.stdout[-3000:]
    full = tree.state(), tree.digests()
    tree.config = smoke
    return tree, full


def test_a_smoke_build_even_an_interrupted_one_leaves_full_products_alone(both):
    tree, full = both
    running = tree.start(CLAIMS, "--forcerun", NOMINAL)
    try:
        end = time.monotonic() + 120
        while tree.path(NOMINAL).exists():  # Snakemake takes it away before its job begins
            assert time.monotonic() < end and running.poll() is None
            time.sleep(0.05)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    process = tree.run("--unlock")
    assert process.returncode == 0, process.stdout
    process = tree.run(CLAIMS, NOMINAL)
    assert process.returncode == 0, process.stdout[-3000:]
    assert "size smoke: everything is written to build/smoke" in process.stdout
    assert tree.path(NOMINAL).exists()

    tree.config = []
    assert (tree.state(), tree.digests()) == full
    assert tree.plan(*FULL).rules == set(), "going back to the full size plans no job"


def test_a_smoke_build_says_so(tree):
    assert {row["size"] for row in read_claims(tree.path("report/claims.json"))} == {"smoke"}
    page = tree.path("report/index.html").read_text(encoding="utf-8")
    assert "This report comes from a run of size smoke." in page
