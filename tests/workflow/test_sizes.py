"""A size other than the full one lives in a folder of its own, and never touches full results."""

import os
import signal
import time

import pytest

pytestmark = pytest.mark.workflow

HOP = "short_hop"
CLAIMS = f"report/claims/{HOP}.json"
NOMINAL = f"data/cache/{HOP}/corrected/nominal.h5"


def test_a_smoke_build_even_an_interrupted_one_leaves_full_products_alone(small):
    smoke, small.config = small.config, []
    small.works(HOP)
    full = small.state(), small.digests()
    small.config = smoke

    running = small.start(CLAIMS, "--forcerun", NOMINAL)
    try:
        end = time.monotonic() + 120
        while small.path(NOMINAL).exists():  # Snakemake takes it away before its job begins
            assert time.monotonic() < end and running.poll() is None
            time.sleep(0.02)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    small.works("--unlock")
    assert "size smoke: everything is written to build/smoke" in small.works(CLAIMS, NOMINAL)
    assert small.path(NOMINAL).exists()

    small.config = []
    assert (small.state(), small.digests()) == full
    assert small.plan(HOP).rules == set(), "going back to the full size plans no job"
