"""What goes wrong outside of the code: lost, damaged and foreign files, killed processes, full and read-only disks."""

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from marsedl.papers.powered_descent.gains import Gains
from marsedl.replication import artifacts

pytestmark = pytest.mark.workflow

CACHE = "data/cache/powered_descent"
GAINS = f"{CACHE}/corrected/gains.h5"
FIGURE = "figures/powered_descent/fig06a.png"


def failed(tree, *targets) -> str:
    """Run Snakemake, which must fail; returns what it says."""
    process = tree.run(*targets)
    assert process.returncode != 0, process.stdout[-3000:]
    return process.stdout


def works(tree, *targets) -> str:
    process = tree.run(*targets)
    assert process.returncode == 0, process.stdout[-3000:]
    return process.stdout


# ---------------------------------------------------------------------------------------------------------- artifacts


def test_a_lost_artifact_is_rebuilt_alone(tree):
    digests = tree.digests()
    tree.path(GAINS).unlink()
    works(tree, GAINS)
    assert tree.digests() == digests
    assert tree.plan("all").rules == set(), "its content is what it was"


def truncated(path):
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def of_another_reading(path):
    shutil.copyfile(path.parents[1] / "kilonewton_noise" / path.name, path)


def of_another_paper(path):
    gains = artifacts.load(path, Gains)
    artifacts.save(path, gains, paper="random_field", reading="corrected", provenance={})


@pytest.mark.parametrize(
    ("damage", "fragments"),
    [
        (truncated, ["truncated"]),
        (of_another_reading, ["kilonewton_noise", "corrected"]),
        (of_another_paper, ["random_field", "powered_descent"]),
    ],
)
def test_a_damaged_or_foreign_artifact_is_refused_and_rebuilt_when_deleted(tree, damage, fragments):
    digests = tree.digests()
    damage(tree.path(GAINS))
    output = failed(tree, FIGURE)
    for fragment in (GAINS, "delete it and run snakemake again", "logs/powered_descent/fig06a.log", *fragments):
        assert fragment in output
    assert "Traceback" not in output
    tree.path(GAINS).unlink()
    works(tree, FIGURE)
    assert tree.digests() == digests


def sealed(path, edit):
    """Edit an artifact with another tool, and give it the seal of one that was not."""
    with h5py.File(path, "r+") as file:
        edit(file)
    path.write_bytes(artifacts.seal(path.read_bytes()))


def with_flipped_bits(path):
    content, random = bytearray(path.read_bytes()), np.random.default_rng(20170817)
    for place in random.integers(len(content), size=9):
        content[place] ^= 1 << int(random.integers(8))
    path.write_bytes(content)


def of_an_older_schema(path):
    sealed(path, lambda file: file.attrs.modify("schema", "0" * 16))


def with_an_external_link(path):
    def edit(file):
        del file["time"]
        file["time"] = h5py.ExternalLink("/dev/zero", "/")

    sealed(path, edit)


def with_a_huge_dimension(path):
    def edit(file):
        del file["time"]
        file.create_dataset("time", (2**55,), "f8", chunks=(1024,))

    sealed(path, edit)


def with_the_content_of_another_paper(path):
    shutil.copyfile(path.parents[2] / "desensitized" / "corrected" / path.name, path)


# Of every paper, what is damaged and how, what is made from it and by which job, and what is said.
DAMAGED = {
    "powered_descent/corrected/linearization": (
        with_flipped_bits,
        "data/cache/powered_descent/corrected/gains.h5",
        "powered_descent_gains",
        "differ from what was written",
    ),
    "random_field/corrected/nominal": (
        with_an_external_link,
        "data/cache/random_field/corrected/linearization.h5",
        "random_field_linearization",
        "field 'time' is a link to somewhere else (ExternalLink)",
    ),
    "desensitized/corrected/nominal": (
        of_an_older_schema,
        "figures/desensitized/fig01b.png",
        "figure",
        "artifact Nominal was written by another version",
    ),
    "funnels/corrected/linearization": (
        with_the_content_of_another_paper,
        "data/cache/funnels/corrected/gains.h5",
        "funnels_gains",
        "artifact Linearization is of the paper 'desensitized', not 'funnels'",
    ),
    "stochastic_entry/corrected/nominal": (
        with_a_huge_dimension,
        "data/cache/stochastic_entry/corrected/linearization.h5",
        "stochastic_entry_linearization",
        "bytes of values but the file stores 0",
    ),
}


def test_damaged_artifacts_of_every_paper_are_refused_in_one_run_until_they_are_deleted(tree):
    digests = tree.digests()
    targets = [target for _, target, _, _ in DAMAGED.values()]
    for name, (damage, *_) in DAMAGED.items():
        damage(tree.path(f"data/cache/{name}.h5"))
    for _ in range(2):  # the second run does not take them either
        output = failed(tree, *targets)
        assert "Traceback" not in output
        for name, (_, _, job, reason) in DAMAGED.items():
            where = f"folder build/smoke, paper {name.split('/')[0]}, reading corrected, job {job}"
            start = f"{where}: data/cache/{name}.h5: "
            refusal = next((line for line in output.splitlines() if line.startswith(start)), "")
            assert reason in refusal, output[-8000:]
            assert "delete it and run snakemake again" in refusal
    for name in DAMAGED:
        tree.path(f"data/cache/{name}.h5").unlink()
    works(tree, *targets)
    assert tree.digests() == digests


def test_a_malformed_file_of_printed_claims_is_refused_by_name(tree):
    digests = tree.digests()
    published = tree.path("data/published/powered_descent.yaml")
    content = published.read_text(encoding="utf-8")
    published.write_text(content.replace("kind: ", "kindd: ", 1), encoding="utf-8")
    output = failed(tree, "report/claims/powered_descent.json")
    for fragment in ("data/published/powered_descent.yaml", "'kindd'", "'kind'", "logs/powered_descent/claims.log"):
        assert fragment in output
    published.write_text(content, encoding="utf-8")
    works(tree, "report/claims/powered_descent.json")
    assert tree.digests() == digests


# ---------------------------------------------------------------------------------------------------- failing stages


def test_a_failing_stage_names_itself_and_leaves_the_others_running(tree):
    tree.set_inputs("kilonewton_noise", mass_iterations="1")
    tree.set_inputs("earth_weight_noise", gravity="3.72")
    before = tree.state()
    output = failed(tree, *(f"{CACHE}/{reading}/gains.h5" for reading in ("kilonewton_noise", "earth_weight_noise")))
    where = "paper powered_descent, reading kilonewton_noise, job powered_descent_nominal: "
    assert where + "the mass iteration still changes" in output
    assert "raise mass_iterations or mass_tolerance" in output
    assert "(log: build/smoke/logs/powered_descent/kilonewton_noise/nominal.log)" in output
    assert "MarsedlError" in tree.path("logs/powered_descent/kilonewton_noise/nominal.log").read_text(encoding="utf-8")
    after = tree.state()
    changed_files = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    finished = {f"{CACHE}/earth_weight_noise/{name}.h5" for name in ("nominal", "linearization", "gains")}
    assert changed_files == {*finished, f"{CACHE}/kilonewton_noise/nominal.h5"}
    assert finished <= after.keys()


# -------------------------------------------------------------------------------------------------- killed processes

CASE = f"{CACHE}/corrected/montecarlo.closed_loop_large.h5"


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


@pytest.fixture
def without_case(tree):
    """The tree without the large closed-loop flights, whose chunks and gathering then have to run."""
    digests = tree.digests()
    tree.path(CASE).unlink()
    return tree, digests


def test_a_killed_stage_is_run_again(without_case):
    tree, digests = without_case
    process = tree.start(CASE)
    try:
        os.kill(first_job_of(process), signal.SIGKILL)
        assert process.wait(timeout=120) != 0
    finally:
        killed(process)
    assert not tree.path(CASE).exists()
    works(tree, CASE)
    assert tree.digests() == digests
    assert tree.plan("all").rules == set()


def test_a_killed_snakemake_can_go_on(without_case):
    tree, digests = without_case
    process = tree.start(CASE)
    try:
        assert first_job_of(process)
    finally:
        killed(process)
    output = failed(tree, CASE)  # the killed one could not take its lock away
    assert "--unlock" in output
    works(tree, "--unlock")
    works(tree, CASE)
    assert tree.digests() == digests
    assert not list(tree.build.glob("data/cache/**/*.partial"))
    assert tree.plan("all").rules == set()


MOMENTS = np.random.default_rng(20170817).uniform(0.02, 0.98, 20)  # shares of the time that the jobs take
VICTIMS = ("job", "snakemake", "everything")  # the second leaves its jobs running, the third is a power cut
USUAL = 5  # of these moments; the others take minutes and are for `pytest -m long`
LOST = [
    *(f"{CACHE}/kilonewton_noise/{name}.h5" for name in ("nominal", "linearization", "gains")),
    CASE,
    FIGURE,
    "figures/powered_descent/eq54.csv",
]


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
    "number", [pytest.param(n, marks=pytest.mark.long if n >= USUAL else ()) for n in range(len(MOMENTS))]
)
def test_a_kill_at_any_moment_loses_nothing(tree, number):
    """Whoever is killed, and whenever: the next run makes what an undisturbed one would have made."""
    digests = tree.digests()
    victim, seconds = VICTIMS[number % len(VICTIMS)], MOMENTS[number] * undisturbed(tree)
    lose(tree)
    while not kill_at(tree, seconds, victim):  # the machine was faster this time
        seconds /= 2
        lose(tree)
    process = tree.run(*LOST)  # perhaps beside jobs that nobody waits for any more
    if process.returncode:
        assert "--unlock" in process.stdout, process.stdout[-3000:]
        works(tree, "--unlock")
        works(tree, *LOST)
    if victim == "snakemake":
        wait_for_orphans(tree)
        works(tree, *LOST)  # whatever these wrote at last
    assert tree.digests() == digests
    assert not list(tree.build.glob("data/cache/**/.*.partial"))


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


def test_a_second_run_of_the_same_files_is_refused_and_disturbs_nothing(without_case):
    tree, digests = without_case
    process = tree.start(CASE)
    try:
        job = first_job_of(process)
        os.kill(job, signal.SIGSTOP)  # so that the first run cannot end before the second begins
        output = failed(tree, CASE)
        assert "lock" in output.lower()
        os.kill(job, signal.SIGCONT)
        assert process.wait(timeout=300) == 0
    finally:
        killed(process)
    assert tree.digests() == digests
    works(tree, CASE)  # no lock is left


def test_two_runs_at_the_same_moment_do_no_harm(without_case):
    """Of the same files: the lock lets one in, and were both let in, files would still be whole. One of others too."""
    tree, digests = without_case
    other = f"{CACHE}/kilonewton_noise/gains.h5"
    tree.path(other).unlink()
    processes = [tree.start(target) for target in (CASE, CASE, other)]
    try:
        codes = [process.wait(timeout=600) for process in processes]
    finally:
        for process in processes:
            killed(process)
    assert 0 in codes
    finished = tree.run(CASE, other)
    if finished.returncode:
        works(tree, "--unlock")
        works(tree, CASE, other)
    assert tree.digests() == digests


# -------------------------------------------------------------------------------------------------------------- disks


@contextlib.contextmanager
def mounted(*arguments):
    """Mount a file system for the time of a test, or say why it cannot be tested."""
    folder = arguments[-1]
    process = subprocess.run(["mount", *map(str, arguments)], capture_output=True, text=True, check=False)
    if process.returncode:
        pytest.skip(f"NOT TESTED: mounting needs root: {process.stderr.strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_said_and_nothing_else_is_lost(tree):
    """The reading's folder lies on a disk of 64 kB for the time of one run."""
    digests = tree.digests()
    folder, target = tree.path(f"{CACHE}/kilonewton_noise"), f"{CACHE}/kilonewton_noise/gains.h5"
    shutil.rmtree(folder)
    folder.mkdir()
    unaffected = {name: digest for name, digest in digests.items() if "kilonewton_noise" not in name}
    with mounted("-t", "tmpfs", "-o", "size=64k", "tmpfs", folder):
        output = failed(tree, target)
        assert "reading kilonewton_noise, job powered_descent_nominal" in output
        assert f"{CACHE}/kilonewton_noise/nominal.h5: cannot be written, there is no space left" in output
        assert not list(folder.iterdir()), "no half-written file stays"
    assert tree.digests() == unaffected
    works(tree, target)
    assert tree.digests()[target] == digests[target]


def test_a_disk_that_is_full_in_the_middle_of_a_figure_is_said(tree):
    """The pictures of a reading lie on a disk that holds the beginning of one; they are no artifacts."""
    target = "figures/powered_descent/kilonewton_noise/fig06a.png"
    folder = tree.path(target).parent
    folder.mkdir(parents=True, exist_ok=True)
    digests = tree.digests()
    with mounted("-t", "tmpfs", "-o", "size=8k", "tmpfs", folder):
        other = folder / "other.txt"
        other.write_text("Snakemake would remove an empty folder")
        output = failed(tree, target)
        assert "paper powered_descent, reading kilonewton_noise, job figure: " in output
        assert "(No space left on device): free space and run again" in output, output[-3000:]
        assert "Traceback" not in output
        assert list(folder.iterdir()) == [other], "no half-written file stays"
    works(tree, target)
    assert tree.digests().keys() - digests.keys() == {target, target.replace(".png", ".pdf")}


def test_a_limit_of_file_sizes_is_said(tree):
    """As a full disk, but without a disk: the artifact is larger than any file may be."""
    digests = tree.digests()
    size = tree.path(GAINS).stat().st_size
    tree.path(GAINS).unlink()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, hard))  # Python itself ignores the signal
        output = failed(tree, GAINS)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert f"job powered_descent_gains: {GAINS}: cannot be written" in output
    works(tree, GAINS)
    assert tree.digests() == digests


def test_a_read_only_cache_is_said(tree):
    digests = tree.digests()
    folder = tree.path(f"{CACHE}/kilonewton_noise")
    tree.set_inputs("kilonewton_noise", noise_coefficient="0.03")
    with mounted("--bind", folder, folder):
        subprocess.run(["mount", "-o", "remount,ro,bind", str(folder)], check=True)
        output = failed(tree, f"{CACHE}/kilonewton_noise/nominal.h5")
        assert "Write-protected output files" in output
        assert f"{CACHE}/kilonewton_noise/nominal.h5" in output
    assert tree.digests() == digests, "the old files are intact"
