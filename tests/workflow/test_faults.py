"""What goes wrong outside of the code: lost, damaged and foreign files, killed processes, full disks."""

import contextlib
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from marsedl.replication.records.differences import digest

pytestmark = pytest.mark.workflow

GLIDE, HOP = "hypersonic_glide", "short_hop"
CACHE = f"data/cache/{GLIDE}/corrected"
FIGURE = f"figures/{GLIDE}/fig01.png"
# What kills interrupt: a stage, flights, a figure and a table.
LOST = [f"{CACHE}/{name}.h5" for name in ("linearization", "montecarlo.closed_loop")]
LOST += [FIGURE, f"figures/{GLIDE}/touchdown.csv"]


# ---------------------------------------------------------------------------------------------------------- artifacts


def test_papers_may_have_other_numbers_of_headlines(small):
    drawn = {name for name in small.plan("report/claims.json").files if "/universes/headline" in name}
    assert drawn == {f"figures/{HOP}/universes/headline_1_{kind}.png" for kind in ("values", "choices")}


def test_damaged_and_malformed_files_are_refused_in_one_run_and_a_lost_one_is_made_alone(small):
    digests = small.digests()
    gains = small.path(f"{CACHE}/gains.h5")
    content = gains.read_bytes()
    gains.write_bytes(content[: len(content) // 2])
    published = small.path(f"data/published/{HOP}.yaml")
    printed = published.read_text(encoding="utf-8")
    published.write_text(printed.replace("kind: ", "kindd: ", 1), encoding="utf-8")
    lost, target = f"data/cache/{GLIDE}/printed/certificates.h5", f"{CACHE}/certificates.h5"
    small.path(lost).unlink()
    output, log = small.fails(lost, target, f"report/claims/{HOP}.json"), f"logs/{GLIDE}/corrected/certificates.log"
    for fragment in (f"{CACHE}/gains.h5", "delete it and run snakemake again", log, "truncated"):
        assert fragment in output
    for fragment in (f"data/published/{HOP}.yaml", "kindd", "'kind'", f"logs/{HOP}/points.log"):
        assert fragment in output
    assert digest(small.path(lost)) == digests[lost], "others of the run are made"

    gains.unlink()
    published.write_text(printed, encoding="utf-8")
    small.works(target, f"report/points/{HOP}.json", f"report/claims/{HOP}.json")
    assert small.digests() == digests
    assert small.plan(GLIDE, HOP).rules == set(), "their content is what it was"


def test_an_artifact_of_another_paper_is_made_again_and_a_damaged_one_is_refused_until_it_is_deleted(tree):
    digests = tree.digests()
    name, target = "data/cache/funnels/corrected/linearization.h5", "data/cache/funnels/corrected/gains.h5"
    shutil.copyfile(tree.path(name.replace("funnels", "desensitized")), tree.path(name))
    tree.works(target)
    assert tree.digests() == digests
    content = tree.path(name).read_bytes()
    tree.path(name).write_bytes(content[: len(content) // 2])
    assert f"{name}: " in tree.fails(target)
    tree.path(name).unlink()
    tree.works(target)
    assert tree.digests() == digests


# -------------------------------------------------------------------------------------------------- killed processes


def jobs_of(process) -> list[int]:
    """Processes of the session of a started Snakemake that run the script of a job."""
    jobs = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != process.pid:
            with contextlib.suppress(OSError, IndexError):
                session = int((folder / "stat").read_text().rpartition(")")[2].split()[3])
                command = (folder / "cmdline").read_bytes().split(b"\0")
                if session == process.pid and b"python" in command[0] and b"/.snakemake/scripts/" in command[1]:
                    jobs.append(int(folder.name))
    return jobs


def wait_for_jobs(process, number, seconds=120) -> int | None:
    """Wait until a started Snakemake has begun a number of jobs; the last of them, or None if it ended before."""
    end, seen = time.monotonic() + seconds, {}
    while time.monotonic() < end:
        seen |= dict.fromkeys(jobs_of(process))
        if len(seen) >= number:
            return next(reversed(seen), 0)
        if process.poll() is not None:
            return None
        time.sleep(0.05)
    raise AssertionError("no job started")


def killed(process):
    """Kill what is left of a started Snakemake."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    for job in jobs_of(process):
        with contextlib.suppress(ProcessLookupError):
            os.kill(job, signal.SIGKILL)
    process.wait()


DRAW = np.random.default_rng(20170817)
MOMENTS = list(zip(DRAW.integers(0, 4, 12), DRAW.uniform(0.0, 1.0, 12), strict=True))  # jobs begun, seconds after
VICTIMS = ("job", "snakemake", "everything")  # the second leaves its jobs running, the third is a power cut


def lose(tree) -> None:
    for name in LOST:
        tree.path(name).unlink(missing_ok=True)


def kill_at(tree, begun: int, seconds: float, victim: str) -> bool:
    """Start making the lost files and kill at some moment; returns whether there still was something to kill."""
    lose(tree)
    process = tree.start(*LOST)
    try:
        if wait_for_jobs(process, begun) is None:
            return False
        time.sleep(seconds)
        job = wait_for_jobs(process, 1) if victim == "job" else process.pid
        if job is None or process.poll() is not None:
            return False
        if victim == "everything":
            killed(process)
        else:
            with contextlib.suppress(ProcessLookupError):
                os.kill(job, signal.SIGKILL)
            process.wait(120)
        return True
    finally:
        if victim != "snakemake":
            killed(process)


@pytest.mark.parametrize(
    "number", [pytest.param(n, marks=pytest.mark.long if n >= len(VICTIMS) else ()) for n in range(len(MOMENTS))]
)
def test_a_kill_at_any_moment_loses_nothing(small, number):
    """Whoever is killed, and whenever: the next run makes what an undisturbed one would have made."""
    digests, victim = small.digests(), VICTIMS[number % len(VICTIMS)]
    begun, seconds = MOMENTS[number]
    while not kill_at(small, begun, seconds, victim):  # the machine was faster this time
        begun, seconds = begun - 1, seconds / 2
    if victim != "job":  # a killed Snakemake leaves its lock
        small.works("--unlock")
    small.works(*LOST)  # perhaps beside jobs that nobody waits for any more
    if victim == "snakemake":
        wait_for_orphans(small)
        small.works(*LOST)  # whatever these wrote at last
    assert small.digests() == digests
    assert not list(small.build.glob("data/cache/**/.*.partial"))
    assert small.plan(GLIDE).rules == set()


def wait_for_orphans(tree, seconds=120) -> None:
    """Wait until no job of this tree runs, which a killed Snakemake leaves behind."""
    end, scripts = time.monotonic() + seconds, str(tree.path(".snakemake/scripts")).encode()
    while time.monotonic() < end:
        commands = []
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                commands.append(path.read_bytes())
        if not any(scripts in command for command in commands):
            return
        time.sleep(0.1)
    raise AssertionError("a job of a killed Snakemake does not end")


def test_a_second_run_of_the_same_files_is_refused_and_disturbs_nothing(small):
    digests = small.digests()
    lose(small)
    process = small.start(*LOST)
    try:
        job = wait_for_jobs(process, 1)
        os.kill(job, signal.SIGSTOP)  # so that the first run cannot end before the second begins
        assert "lock" in small.fails(*LOST).lower()
        os.kill(job, signal.SIGCONT)
        assert process.wait(timeout=300) == 0
    finally:
        killed(process)
    assert small.digests() == digests
    small.works(*LOST)  # no lock is left


# -------------------------------------------------------------------------------------------------------------- disks


@contextlib.contextmanager
def small_disk(folder, size):
    """Mount a disk of some kB over a folder for the time of a test, or say why it cannot be tested."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", str(folder)]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    if process.returncode:
        pytest.skip(f"NOT TESTED: mounting needs root: {process.stderr.strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_said_and_nothing_else_is_lost(small):
    """Artifacts of a reading lie on a disk that holds none of them, figures on one that holds the beginning of one."""
    digests = small.digests()
    cache, figures = small.path(f"data/cache/{GLIDE}/printed"), small.path(f"figures/{HOP}")
    nominal, figure = f"data/cache/{GLIDE}/printed/nominal.h5", f"figures/{HOP}/fig01.png"
    for name in (nominal, figure):
        small.path(name).unlink()
    with small_disk(cache, 12), small_disk(figures, 8):
        others = [folder / "other.txt" for folder in (cache, figures)]
        for other in others:
            other.write_text("Snakemake would remove an empty folder")
        output = small.fails(nominal, figure)
        full = "[Errno 28] No space left on device"
        assert f"reading printed, job nominal: {full}: '{nominal}'" in output
        assert f"paper {HOP}, reading corrected, job fig01: {full}" in output
        assert [*cache.iterdir(), *figures.iterdir()] == others, "no half-written file stays"
    small.works(nominal, figure)  # on the disk below, which holds everything else
    assert small.digests() == digests
