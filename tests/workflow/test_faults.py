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


def failed(tree, *targets) -> str:
    """Run Snakemake, which must fail; returns what it says."""
    process = tree.run(*targets)
    assert process.returncode != 0, process.stdout[-3000:]
    assert "Traceback" not in process.stdout
    return process.stdout


def works(tree, *targets) -> str:
    process = tree.run(*targets)
    assert process.returncode == 0, process.stdout[-3000:]
    return process.stdout


# ---------------------------------------------------------------------------------------------------------- artifacts


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
    output, log = failed(small, lost, target, f"report/claims/{HOP}.json"), f"logs/{GLIDE}/corrected/certificates.log"
    for fragment in (f"{CACHE}/gains.h5", "delete it and run snakemake again", log, "truncated"):
        assert fragment in output
    for fragment in (f"data/published/{HOP}.yaml", "kindd", "'kind'", f"logs/{HOP}/claims.log"):
        assert fragment in output
    assert digest(small.path(lost)) == digests[lost], "others of the run are made"

    gains.unlink()
    published.write_text(printed, encoding="utf-8")
    works(small, target, f"report/claims/{HOP}.json")
    assert small.digests() == digests
    assert small.plan(GLIDE, HOP).rules == set(), "their content is what it was"


def test_an_artifact_of_another_paper_is_made_again_and_a_damaged_one_is_refused_until_it_is_deleted(tree):
    digests = tree.digests()
    name, target = "data/cache/funnels/corrected/linearization.h5", "data/cache/funnels/corrected/gains.h5"
    shutil.copyfile(tree.path(name.replace("funnels", "desensitized")), tree.path(name))
    works(tree, target)
    assert tree.digests() == digests
    content = tree.path(name).read_bytes()
    tree.path(name).write_bytes(content[: len(content) // 2])
    assert f"{name}: " in failed(tree, target)
    tree.path(name).unlink()
    works(tree, target)
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


def first_job_of(process, seconds=60) -> int | None:
    """Wait until a job of a started Snakemake runs; None if it ended before one was seen."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if jobs := jobs_of(process):
            return jobs[0]
        if process.poll() is not None:
            return None
        time.sleep(0.005)
    raise AssertionError("no job started")


def killed(process):
    """Kill what is left of a started Snakemake."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    for job in jobs_of(process):
        with contextlib.suppress(ProcessLookupError):
            os.kill(job, signal.SIGKILL)
    process.wait()


MOMENTS = np.random.default_rng(20170817).uniform(0.02, 0.98, 12)  # shares of the time that the jobs take
VICTIMS = ("job", "snakemake", "everything")  # the second leaves its jobs running, the third is a power cut
SECONDS = []  # that the lost files take to be made, with nothing that disturbs but what else the machine does


def lose(tree) -> None:
    for name in LOST:
        tree.path(name).unlink(missing_ok=True)


def undisturbed(tree) -> float:
    """Seconds of an undisturbed run, measured once."""
    if not SECONDS:
        lose(tree)
        start = time.monotonic()
        works(tree, *LOST)
        SECONDS.append(time.monotonic() - start)
    return SECONDS[0]


def kill_at(tree, seconds: float, victim: str) -> bool:
    """Start making the lost files and kill after some time; returns whether there still was something to kill."""
    process = tree.start(*LOST)
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
            return False
        if victim == "job":
            job = first_job_of(process)
            if job is None:  # the last job had ended already
                return False
            with contextlib.suppress(ProcessLookupError):
                os.kill(job, signal.SIGKILL)
            process.wait(120)
        elif victim == "snakemake":
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
        else:
            killed(process)
        return True
    finally:
        if victim != "snakemake":
            killed(process)


@pytest.mark.parametrize(
    "number", [pytest.param(n, marks=pytest.mark.long if n >= len(VICTIMS) else ()) for n in range(len(MOMENTS))]
)
def test_a_kill_at_any_moment_loses_nothing(small, number):
    """Whoever is killed, and whenever: the next run makes what an undisturbed one would have made."""
    digests = small.digests()
    victim, seconds = VICTIMS[number % len(VICTIMS)], MOMENTS[number] * undisturbed(small)
    lose(small)
    while not kill_at(small, seconds, victim):  # the machine was faster this time
        seconds /= 2
        lose(small)
    process = small.run(*LOST)  # perhaps beside jobs that nobody waits for any more
    if process.returncode:
        assert "--unlock" in process.stdout, process.stdout[-3000:]
        works(small, "--unlock")
        works(small, *LOST)
    if victim == "snakemake":
        wait_for_orphans(small)
        works(small, *LOST)  # whatever these wrote at last
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
        job = first_job_of(process)
        os.kill(job, signal.SIGSTOP)  # so that the first run cannot end before the second begins
        assert "lock" in failed(small, *LOST).lower()
        os.kill(job, signal.SIGCONT)
        assert process.wait(timeout=300) == 0
    finally:
        killed(process)
    assert small.digests() == digests
    works(small, *LOST)  # no lock is left


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
    nominal = f"data/cache/{GLIDE}/printed/nominal.h5"
    for folder in (cache, figures):
        shutil.rmtree(folder)
        folder.mkdir()
    with small_disk(cache, 12), small_disk(figures, 8):
        others = [folder / "other.txt" for folder in (cache, figures)]
        for other in others:
            other.write_text("Snakemake would remove an empty folder")
        output = failed(small, nominal, f"figures/{HOP}/fig01.png")
        assert f"reading printed, job {GLIDE}_nominal: {nominal}: cannot be written" in output
        assert f"paper {HOP}, reading corrected, job figure: " in output
        assert "(No space left on device): free space and run again" in output, output[-3000:]
        assert [*cache.iterdir(), *figures.iterdir()] == others, "no half-written file stays"
    works(small, GLIDE, HOP, *(name for name in digests if name.startswith(f"data/cache/{GLIDE}/printed")))
    after = small.digests()
    assert {name: after.get(name) for name in digests} == digests
