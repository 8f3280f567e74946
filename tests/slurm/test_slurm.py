"""The workflow on a real Slurm, brought up on this machine: the same bytes as without it, and jobs sent again.

`pytest tests/slurm` runs what is short, on the small project, after `make slurm` and with Slurm and munge installed.
`pytest -m long tests/slurm` runs the whole smoke pipeline of the papers, and jobs that need more memory.
"""

import contextlib
import importlib.util
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
import yaml

from marsedl.replication.checks.twice import PRODUCTS, copy_tree, snakemake
from marsedl.replication.records.differences import digest_tree

pytestmark = [pytest.mark.slurm, pytest.mark.workflow]

ROOT = Path(__file__).parents[2]
PLUGIN = "snakemake_executor_plugin_slurm"
PROFILE = Path("profiles/slurm")
QUICK = ("--slurm-init-seconds-before-status-checks", "1", "--latency-wait", "10")  # everything is on one machine
# After each look at the queue that finds no finished job, Snakemake waits ten seconds longer; here always one second.
SNAKEMAKE = """
import asyncio
from snakemake.cli import main
from snakemake_interface_executor_plugins.executors.remote import RemoteExecutor
RemoteExecutor.sleep = lambda self: asyncio.sleep(1)
main()
"""
SIZE = ("--config", "chunks=2")
SMOKE = ("--config", "size=smoke", "chunks=3")
ARENA = ("--config", "size=smoke", "trials=9", "chunks=3")
GLIDE, HOP = "hypersonic_glide", "short_hop"
CACHE = f"data/cache/{GLIDE}"
CASE = f"{CACHE}/corrected/montecarlo.closed_loop.h5"  # its design, two chunks, and their gathering
TARGETS = (CASE, *(f"figures/{HOP}/{name}" for name in ("fig01.png", "printed/fig01.png")))
CHUNK = "chunk"
tools = runpy.run_path(str(Path(__file__).parent / "cluster.py"))


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """A Slurm of two cores; the tests are skipped, and that is said aloud, where it is not installed."""
    lacking = tools["missing"]()
    if importlib.util.find_spec(PLUGIN) is None:
        lacking.append(PLUGIN.replace("_", "-"))
    if lacking:
        reason = f"NOT TESTED: the workflow on Slurm, as {', '.join(lacking)} is not installed (docs/scaling.md)"
        warnings.warn(reason, stacklevel=1)
        pytest.skip(reason)
    cluster = tools["Cluster"](tmp_path_factory.mktemp("slurm"))
    try:
        cluster.up()
        yield cluster
    finally:
        cluster.down()


class Submitted:
    """A Snakemake that gives its jobs to the cluster."""

    def __init__(self, cluster, folder, *arguments, size=SIZE, profile=PROFILE):
        self.cluster, self.folder, self.size, self.before = cluster, folder, size, set(cluster.jobs())
        self.log = folder / "submitted.log"
        with self.log.open("w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", SNAKEMAKE, *arguments, "--workflow-profile", str(profile), *QUICK, *size],
                cwd=folder,
                env={**os.environ, **cluster.environment, "PYTHONPATH": str(folder / "src")},
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """Leave nothing behind, whatever happened."""
        if self.process.poll() is None:
            self.kill()
            snakemake(self.folder, "--unlock", *self.size)
        for job in self.jobs("pending,running"):
            self.cluster.command("scancel", str(job))

    def kill(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def output(self):
        return self.log.read_text(encoding="utf-8", errors="replace")

    def jobs(self, states="all"):
        return {job: state for job, state in self.cluster.jobs(states).items() if job not in self.before}

    def works(self, seconds=1800):
        assert self.process.wait(timeout=seconds) == 0, self.output()[-5000:]
        return self.output()

    def running(self, rule, seconds=180):
        """Wait until a job of a rule runs; returns its number."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for job in self.jobs("running"):
                if self._rule(job) == rule:
                    return job
            assert self.process.poll() is None, f"Snakemake ended before:\n{self.output()[-5000:]}"
            time.sleep(0.05)
        raise AssertionError(f"not seen in {seconds} s:\n{self.output()[-5000:]}")

    def _rule(self, job):
        process = self.cluster.command("squeue", "--noheader", f"--jobs={job}", "--format=%k")  # the comment
        return re.sub(r"_wildcards_.*", "", process.stdout.strip()).removeprefix("rule_")


def is_whole(folder, expected, *targets):
    """Everything is there with the right content, nothing is left half-written, and nothing would run again."""
    assert digest_tree(folder, PRODUCTS) == expected
    assert not list(folder.glob("data/cache/**/*.partial"))
    plan = snakemake(folder, *(targets or [CASE]), "--cores", "2", *SIZE, "--dry-run")
    assert "Nothing to be done" in plan.stdout, plan.stdout[-3000:]


# ----------------------------------------------------------------------------------------------------- the same bytes


@pytest.fixture(scope="module")
def project(small_build):
    """The small project with a few products as they are without Slurm, and their digests."""
    small_build.restore()
    process = snakemake(small_build.folder, *TARGETS, "--cores", "2", *SIZE)
    assert process.returncode == 0, process.stdout[-3000:]
    return small_build.folder, digest_tree(small_build.folder, PRODUCTS)


def test_products_through_slurm_are_the_same_as_without_it(project, cluster):
    """The design and scattered flights of one paper, stages and figures of another, from nothing."""
    folder, expected = project
    for name in ("data/cache", "figures"):
        shutil.rmtree(folder / name)
    with Submitted(cluster, folder, *TARGETS) as run:
        output = run.works()
        jobs = run.jobs()
    assert set(jobs.values()) == {"COMPLETED"}
    assert len(jobs) < output.count("Finished jobid"), "figures went together"
    is_whole(folder, expected, *TARGETS)


@pytest.mark.long
def test_the_smoke_pipeline_through_slurm_is_the_same_as_without_it(cluster, tmp_path):
    folder = copy_tree(ROOT, tmp_path / "local")
    process = snakemake(folder, "all", "--cores", "2", *SMOKE)
    assert process.returncode == 0, process.stdout[-3000:]
    other = copy_tree(ROOT, tmp_path / "slurm")
    with Submitted(cluster, other, "all", size=SMOKE) as run:
        run.works(seconds=7200)
        assert set(run.jobs().values()) == {"COMPLETED"}
    assert digest_tree(other / "build/smoke", PRODUCTS) == digest_tree(folder / "build/smoke", PRODUCTS)


@pytest.mark.long
def test_the_arena_through_slurm_is_the_same_whatever_dies(cluster, tmp_path):
    """Scattered flights of all laws: a job is cancelled, then Snakemake is killed, then it starts again."""
    target, flights = "figures/arena/descent/ranks.csv", "arena_flights"
    folder = copy_tree(ROOT, tmp_path / "local")
    process = snakemake(folder, target, "--cores", "2", *ARENA)
    assert process.returncode == 0, process.stdout[-3000:]
    other = copy_tree(ROOT, tmp_path / "slurm")
    with Submitted(cluster, other, target, size=ARENA) as run:
        job = run.running(flights, seconds=1800)
        cluster.command("scancel", str(job))
        while run.running(flights) == job:
            time.sleep(0.1)  # and leave: Snakemake is killed while jobs run
    with Submitted(cluster, other, target, "--rerun-incomplete", size=ARENA) as run:
        run.works(seconds=3600)
    assert digest_tree(other / "build/smoke", PRODUCTS) == digest_tree(folder / "build/smoke", PRODUCTS)


# ------------------------------------------------------------------------------------------------------------- faults


@pytest.fixture
def undone(project):
    """The folder without the flights, whose chunks and gathering have to run; the design stays."""
    folder, expected = project
    (folder / CASE).unlink(missing_ok=True)
    shutil.rmtree(folder / CACHE / "corrected" / "chunks", ignore_errors=True)
    return folder, expected


def profile_with(folder, **resources):
    """The profile in a folder with other resources of the chunks; on the command line they would replace all others."""
    profile = yaml.safe_load((folder / PROFILE / "config.yaml").read_text(encoding="utf-8"))
    profile["set-resources"][CHUNK] = {**profile["default-resources"], **resources}
    path = folder / "profiles" / "other" / "config.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(yaml.safe_dump(profile), encoding="utf-8")
    return path.parent.relative_to(folder)


def test_a_job_cancelled_by_hand_is_sent_again(undone, cluster):
    folder, expected = undone
    with Submitted(cluster, folder, CASE) as run:
        job = run.running(CHUNK)
        cluster.command("scancel", str(job))
        output = run.works()
        assert run.jobs()[job] == "CANCELLED"
    assert f"SLURM-job '{job}' failed, SLURM status is: 'CANCELLED'" in output
    is_whole(folder, expected)


@pytest.mark.long
def test_a_job_over_its_memory_is_killed_and_gets_more(undone, cluster):
    folder, expected = undone
    profile = profile_with(folder, mem_mb="120 if attempt == 1 else 1500")
    with Submitted(cluster, folder, CASE, profile=profile) as run:
        run.works()
        jobs = run.jobs()
    assert sorted(jobs.values()) == ["COMPLETED"] * 3 + ["FAILED"] * 2
    logs = {int(path.stem): path.read_text("utf-8") for path in folder.glob(".snakemake/slurm_logs/**/*.log")}
    killed = {job for job, state in jobs.items() if state == "FAILED"}
    assert {job for job in killed if "exceeded memory limit" in logs[job]} == killed
    is_whole(folder, expected)
