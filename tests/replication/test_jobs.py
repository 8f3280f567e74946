"""What a job does around its science: the pinned environment, declared inputs, loading, failures in one message."""

import errno
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication import artifacts, jobs
from marsedl.replication.errors import MarsedlError, SolverError

SOURCE = Path(__file__).parents[2] / "src"


@dataclass(frozen=True)
class Thing:
    """A test artifact."""

    value: np.ndarray = artifacts.quantity("m", (2,), "two numbers")


class Named(dict):
    """Stands for Snakemake's named lists: items by name, by position and as attributes."""

    def __getattr__(self, name):
        return self[name]

    def __getitem__(self, key):
        return list(self.values())[key] if isinstance(key, int) else super().__getitem__(key)


def job_of(tmp_path, **params):
    return SimpleNamespace(
        params=Named({"paper": "p", "inputs": {"a": 1.0}, "code": "abc", **params}),
        input=Named(),
        output=Named(out=str(tmp_path / "out.h5")),
        wildcards=Named(reading="r"),
        log=Named(log=str(tmp_path / "logs" / "job.log")),
        rule="p_stage",
        scriptdir=str(Path.cwd() / "workflow" / "scripts"),
    )


@pytest.fixture
def pinned(monkeypatch, tmp_path):
    for name, value in {**jobs.NUMERIC_ENVIRONMENT, "PYTHONHASHSEED": "0", "NUMBA_CACHE_DIR": str(tmp_path)}.items():
        monkeypatch.setenv(name, value)


def saved(path, reading="r", value=(1.0, 2.0)):
    artifacts.save(path, Thing(np.array(value)), paper="p", reading=reading, provenance={})
    return str(path)


# -------------------------------------------------------------------------------------------------------- environment


def test_the_numeric_environment_is_pinned_for_children():
    code = "import os, sys; from pathlib import Path; from marsedl.replication import jobs\n"
    code += (
        f"jobs.pin_numerics(Path({str(SOURCE.parent)!r})); jobs.assert_numerics(); assert 'numpy' not in sys.modules\n"
    )
    code += "assert 'NUMBA_CPU_NAME' not in os.environ, 'whatever a shell says'\n"
    code += "print(os.environ['OPENBLAS_CORETYPE'], os.environ['OMP_NUM_THREADS'], os.environ['NUMBA_CACHE_DIR'])"
    clean = {name: value for name, value in os.environ.items() if name not in jobs.NUMERIC_ENVIRONMENT}
    clean["NUMBA_CPU_NAME"] = "generic"
    done = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, check=True)
    core, threads, cache = done.stdout.split()
    assert (core, threads) == ("Haswell", "1")
    assert Path(cache).parent == SOURCE.parent / ".cache" / "numba"


def test_an_unpinned_environment_is_refused(pinned, monkeypatch):
    jobs.assert_numerics()
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("PYTHONHASHSEED")
    with pytest.raises(MarsedlError, match=r"OMP_NUM_THREADS, PYTHONHASHSEED.*start jobs through snakemake"):
        jobs.assert_numerics()


def test_a_machine_that_pretends_keeps_its_instruction_sets_and_nothing_else(monkeypatch, tmp_path):
    """In a process of its own, as the numerics are pinned for good."""
    code = "import os; from pathlib import Path; from marsedl.replication import jobs\n"
    code += f"jobs.pin_numerics(Path({str(SOURCE.parent)!r})); jobs.assert_numerics()\n"
    code += "print(os.environ.get('OPENBLAS_CORETYPE'), os.environ.get('NPY_DISABLE_CPU_FEATURES'),"
    code += " os.environ['OMP_NUM_THREADS'], jobs.pretended_machine(), sep='|')"
    clean = {name: value for name, value in os.environ.items() if name not in jobs.NUMERIC_ENVIRONMENT}
    given = {"MARSEDL_UNPINNED": "1", "OPENBLAS_CORETYPE": "Prescott", "OMP_NUM_THREADS": "8"}

    def said(environment):
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    assert said({**clean, **given}) == "Prescott|None|1|OPENBLAS_CORETYPE=Prescott"
    assert said({**clean, "MARSEDL_UNPINNED": "1"}) == "None|None|1|this machine's own"
    features = jobs.NUMERIC_ENVIRONMENT["NPY_DISABLE_CPU_FEATURES"]
    assert said({**clean, **given, "MARSEDL_UNPINNED": ""}) == f"Haswell|{features}|1|"


# ------------------------------------------------------------------------------------------------- inputs and artifacts


def test_a_slice_holds_declared_inputs_only():
    inputs = jobs.Slice({"covariance": [[1, 0], [0, 1]], "speed": 3.0, "scheme": "rk4", "nothing": None})
    np.testing.assert_array_equal(inputs.covariance, np.eye(2))
    assert inputs.covariance.dtype == float
    assert (inputs.speed, inputs.scheme, inputs.nothing) == (3.0, "rk4", None)
    with pytest.raises(AttributeError, match="'gravity' is not declared for this stage"):
        _ = inputs.gravity


def test_arguments_are_loaded_by_annotation(tmp_path):
    def stage(inputs, one: Thing, many: list[Thing], maybe: Thing | None = None):
        """Only its annotations are read."""

    snakemake = job_of(tmp_path)
    snakemake.input = Named(
        one=saved(tmp_path / "one.h5"), many=[saved(tmp_path / f"{k}.h5", value=(k, k)) for k in range(3)]
    )
    loaded = jobs.Job(snakemake).arguments(stage)
    assert set(loaded) == {"one", "many"}
    np.testing.assert_array_equal(loaded["one"].value, [1.0, 2.0])
    assert [thing.value[0] for thing in loaded["many"]] == [0.0, 1.0, 2.0]


def test_an_artifact_of_another_reading_is_refused(tmp_path):
    def stage(inputs, one: Thing):
        """Only its annotations are read."""

    snakemake = job_of(tmp_path)
    snakemake.input = Named(one=saved(tmp_path / "one.h5", reading="other"))
    with pytest.raises(artifacts.ArtifactError, match=r"one\.h5.*other"):
        jobs.Job(snakemake).arguments(stage)


def test_saving_keeps_where_a_result_comes_from(tmp_path):
    snakemake = job_of(tmp_path, options={"case": "closed_loop"})
    snakemake.input = Named(one=saved(tmp_path / "one.h5"))
    jobs.Job(snakemake).save(Thing(np.array([3.0, 4.0])))
    kept = artifacts.provenance(tmp_path / "out.h5")
    assert kept["inputs"] == {"a": 1.0}
    assert kept["code"] == "abc"
    assert kept["options"] == {"case": "closed_loop"}
    assert set(kept["made_from"]) == {"one.h5"}
    assert {"numpy", "numba"} <= set(kept["versions"])


# ------------------------------------------------------------------------------------------------------------ failures


def test_a_refusal_ends_in_one_message_with_job_and_log(tmp_path, pinned, capsys):
    snakemake = job_of(tmp_path)
    with pytest.raises(SystemExit) as caught, jobs.guarded(snakemake):
        raise MarsedlError("the iteration does not converge: raise its limit")
    assert caught.value.code == 1
    said = capsys.readouterr().err
    assert "paper p, reading r, job p_stage: the iteration does not converge: raise its limit" in said
    assert f"(log: {tmp_path / 'logs' / 'job.log'})" in said
    assert "Traceback" not in said
    assert "Traceback" in (tmp_path / "logs" / "job.log").read_text(encoding="utf-8")


def failed_solve(tmp_path, capsys):
    """What a job says whose solver came to no solution."""
    iterate = {"time": np.array([0.0, 0.5, 1.0]), "bank": np.array([1 / 3, np.nan, -2e-20])}
    with pytest.raises(SystemExit) as caught, jobs.guarded(job_of(tmp_path)):
        raise SolverError("nominal: off by 3 m", iterate)
    assert caught.value.code == 1
    said = capsys.readouterr().err
    assert "paper p, reading r, job p_stage: nominal: off by 3 m (its last iterate" in said
    assert f"(log: {tmp_path / 'logs' / 'job.log'})" in said
    assert "Traceback" not in said
    assert "SolverError" in (tmp_path / "logs" / "job.log").read_text(encoding="utf-8")
    return said


def test_the_last_iterate_of_a_solver_is_kept_beside_the_log(tmp_path, pinned, capsys):
    said = failed_solve(tmp_path, capsys)
    kept = tmp_path / "logs" / "job.iterate.csv"
    assert f"(its last iterate: {kept})" in said
    assert kept.read_text(encoding="utf-8").splitlines()[0] == "time,bank"
    np.testing.assert_array_equal(
        np.loadtxt(kept, delimiter=",", skiprows=1), [[0.0, 1 / 3], [0.5, np.nan], [1.0, -2e-20]]
    )


def test_an_iterate_that_cannot_be_kept_does_not_hide_the_message(tmp_path, pinned, capsys):
    (tmp_path / "logs" / "job.iterate.csv").mkdir(parents=True)
    assert "(its last iterate could not be kept: Is a directory)" in failed_solve(tmp_path, capsys)


def test_a_full_disk_does_not_hide_the_message_of_a_solver(tmp_path, pinned, capsys, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savetxt", full)
    assert "(its last iterate could not be kept: No space left on device)" in failed_solve(tmp_path, capsys)


def test_other_failures_keep_no_iterate(tmp_path, pinned, capsys):
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise MarsedlError("no")
    assert "iterate" not in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "logs").iterdir()] == ["job.log"]


def test_an_unexpected_error_shows_its_traceback(tmp_path, pinned, capsys):
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise ZeroDivisionError("by zero")
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "paper p, reading r, job p_stage: ZeroDivisionError: by zero" in said


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "(No space left on device): free space and run again"),
        (errno.EDQUOT, ": free space and run again"),
        (errno.EROFS, "(Read-only file system): give yourself permission to write there and run again"),
    ],
)
def test_a_disk_that_takes_no_more_is_said_without_a_traceback(tmp_path, pinned, capsys, number, remedy):
    for path, named in ((tmp_path / "fig07.png", tmp_path / "fig07.png"), (None, "out")):
        with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
            raise OSError(number, os.strerror(number), path and str(path))
        said = capsys.readouterr().err
        assert f"paper p, reading r, job p_stage: {named}: cannot be written or read " in said
        assert remedy in said
        assert "Traceback" not in said


def test_a_log_that_cannot_be_written_is_said(tmp_path, pinned, capsys, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "logs/job.log")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise AssertionError("must not begin")
    said = capsys.readouterr().err
    assert "paper p, reading r, job p_stage: logs/job.log: cannot be written or read (No space left on device)" in said
    assert "Traceback" not in said


def test_a_job_without_the_pinned_environment_does_not_start(tmp_path, pinned, monkeypatch, capsys):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        pytest.fail("the body must not run")
    assert "OPENBLAS_CORETYPE" in capsys.readouterr().err


def test_a_good_job_leaves_an_empty_log(tmp_path, pinned):
    with jobs.guarded(job_of(tmp_path)) as job:
        assert (job.paper, job.reading) == ("p", "r")
    assert (tmp_path / "logs" / "job.log").read_text(encoding="utf-8") == ""


KERNELS = """
import sys
import time
from numba import njit
from marsedl.replication.jobs import compile_in_turn

compile_in_turn()


@njit(cache=True)
def inner(x):
    return x + 1.0


@njit(cache=True)
def outer(x):
    return inner(x) * 2.0


while time.time() < float(sys.argv[1]):
    pass
outer(1.0)
print(sum(outer.stats.cache_misses.values()))
"""


def test_of_jobs_that_need_a_kernel_at_once_one_compiles_it(tmp_path, pinned):
    script = tmp_path / "kernels.py"
    script.write_text(KERNELS, encoding="utf-8")
    together = str(time.time() + 3.0)
    command = [sys.executable, str(script), together]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    try:
        said = [process.communicate(timeout=120) for process in started]
    finally:
        for process in started:
            process.kill()
    announced = "compiling kernels, once: the next run loads them\n"  # once for the two that it compiles
    assert sorted(said) == [("0\n", ""), ("0\n", ""), ("1\n", announced)]
