"""What a job does around its science: the pinned environment, declared inputs, loading, failures in one message."""

import errno
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication import artifacts, jobs
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.errors import MarsedlError, SolverError
from marsedl.replication.libraries import versions_used
from marsedl.replication.recipes import recipe_digest
from marsedl.replication.sections import Number, Section, given, vector

SOURCE = Path(__file__).parents[2] / "src"
LIBRARIES = versions_used(frozenset({"numpy"}))


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
        params=Named({"paper": "p", "inputs": {"a": 1.0}, "code": "abc", "libraries": LIBRARIES, **params}),
        input=Named(),
        output=Named(out=str(tmp_path / "out.h5")),
        wildcards=Named(reading="r"),
        log=Named(log=str(tmp_path / "logs" / "job.log")),
        rule="p_stage",
        scriptdir=str(Path.cwd() / "workflow" / "rules" / ".." / "scripts"),  # as Snakemake has it
    )


@pytest.fixture
def pinned(monkeypatch, tmp_path):
    beside = dict.fromkeys(("PYTHONHASHSEED", "NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"), "0")
    for name, value in {**jobs.NUMERIC_ENVIRONMENT, **beside}.items():
        monkeypatch.setenv(name, value)


def save_thing(path, reading="r", value=(1.0, 2.0)):
    artifacts.save(path, Thing(np.array(value)), paper="p", reading=reading, provenance={})
    return str(path)


def made_artifact(folder, name, inputs, *needs, **changes):
    """An artifact that a job saves in a folder, and its recipe as the workflow plans it."""
    snakemake = job_of(folder, build={"size": "smoke", "artifacts": dict(needs)})
    recipe = {"inputs": inputs, "options": {}, "code": "abc", "libraries": LIBRARIES, **changes}
    jobs.Job(snakemake).save(str(folder / name), Thing(np.array([1.0, 2.0])), recipe)
    recipe["needs"] = {Path(path).name: recipe_digest(need[2]) for path, need in needs}
    return str(folder / name), ("p", "r", recipe)


# -------------------------------------------------------------------------------------------------------- environment


def test_the_numeric_environment_is_pinned_for_children():
    code = "import os, sys; from pathlib import Path; from marsedl.replication import jobs\n"
    code += (
        f"jobs.pin_numerics(Path({str(SOURCE.parent)!r})); jobs.assert_numerics(); assert 'numpy' not in sys.modules\n"
    )
    code += "assert not {'NUMBA_CPU_NAME', 'NUMBA_DISABLE_JIT', 'GLIBC_TUNABLES'} & {*os.environ}\n"
    code += "print(os.environ['OPENBLAS_CORETYPE'], os.environ['OMP_NUM_THREADS'], os.environ['NUMBA_CACHE_DIR'])"
    clean = {name: value for name, value in os.environ.items() if name not in jobs.NUMERIC_ENVIRONMENT}
    clean |= {"NUMBA_CPU_NAME": "generic", "NUMBA_DISABLE_JIT": "1", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2"}
    process = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, check=True)
    core, threads, cache = process.stdout.split()
    assert (core, threads) == ("Haswell", "1")
    assert Path(cache).parent == SOURCE.parent / ".cache" / "numba"


def test_an_unpinned_environment_is_refused(pinned, monkeypatch):
    jobs.assert_numerics()
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("PYTHONHASHSEED")
    with pytest.raises(MarsedlError, match=r"OMP_NUM_THREADS, PYTHONHASHSEED.*start jobs through snakemake"):
        jobs.assert_numerics()


def test_a_processor_without_avx2_is_refused_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", lambda: {"sse4.2": True, "avx": True})
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    with pytest.raises(MarsedlError, match="has no AVX2 and FMA"):
        jobs.pin_numerics(tmp_path)


def test_settings_of_numba_in_the_folder_are_refused(monkeypatch, tmp_path):
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MarsedlError, match=r"/\.numba_config\.yaml: numba would read it in every job; move it away"):
        jobs.pin_numerics(tmp_path)


# ------------------------------------------------------------------------------------------------- inputs and artifacts


class Plant(Section):
    """A test section."""

    covariance: vector(2) = given("m^2", "two variances")
    speed: Number = given("m/s", "speed")


def test_a_section_has_the_inputs_that_were_given_and_no_others():
    def stage(plant: Plant):
        """Only its annotations are read."""

    section = jobs.arguments_of(stage, {"plant.covariance": [1, 2]}, None)["plant"]
    np.testing.assert_array_equal(section.covariance, [1.0, 2.0])
    assert section.covariance.dtype == float
    with pytest.raises(AttributeError, match=r"the input 'speed' was not given: .* reads as 'plant\.speed'"):
        _ = section.speed


def artifacts_of(*paths):
    """Params of a job that is given these files."""
    return {"size": "full", "artifacts": {str(path): ("p", "r", {}) for path in paths}}


def test_arguments_are_loaded_by_annotation(tmp_path):
    def stage(one: Thing, chunks: list[Thing], maybe: Thing | None = None):
        """Only its annotations are read."""

    files = [save_thing(tmp_path / "one.h5"), *(save_thing(tmp_path / f"{k}.h5", value=(k, k)) for k in range(3))]
    snakemake = job_of(tmp_path, build=artifacts_of(*files))
    snakemake.input = Named(one=files[0], chunks=files[1:])
    loaded = jobs.Job(snakemake).arguments_of(stage)
    assert set(loaded) == {"one", "chunks"}
    np.testing.assert_array_equal(loaded["one"].value, [1.0, 2.0])
    assert [thing.value[0] for thing in loaded["chunks"]] == [0.0, 1.0, 2.0]


def test_many_artifacts_come_as_one_dataclass(tmp_path):
    @dataclass(frozen=True)
    class Records(Artifacts):
        one: Thing
        maybe: Thing | None = None

    def evaluate(records: Records):
        """Only its annotations are read."""

    evaluate.__annotations__["records"] = Records
    Records.__annotations__.update(one=Thing, maybe=Thing | None)
    path = save_thing(tmp_path / "one.h5")
    snakemake = job_of(tmp_path, build=artifacts_of(path))
    snakemake.input = Named(one=path)
    records = jobs.Job(snakemake).arguments_of(evaluate)["records"]
    np.testing.assert_array_equal(records.one.value, [1.0, 2.0])
    assert records.maybe is None


def test_an_artifact_of_another_reading_is_refused(tmp_path):
    def stage(one: Thing):
        """Only its annotations are read."""

    path = save_thing(tmp_path / "one.h5", reading="other")
    snakemake = job_of(tmp_path, build=artifacts_of(path))
    snakemake.input = Named(one=path)
    with pytest.raises(artifacts.ArtifactError, match=r"one\.h5.*other"):
        jobs.Job(snakemake).arguments_of(stage)


def test_saving_keeps_where_a_result_comes_from(tmp_path):
    one = made_artifact(tmp_path, "one.h5", {"a": 1.0})
    two, (_, _, recipe) = made_artifact(tmp_path, "two.h5", {"a": 2.0}, one, options={"case": "closed_loop"})
    provenance = artifacts.provenance(two)
    assert {name: provenance[name] for name in recipe} == recipe
    assert recipe["options"] == {"case": "closed_loop"}
    assert provenance["needs"].keys() == provenance["made_from"].keys() == {"one.h5"}
    assert (provenance["recipe"], provenance["size"]) == (recipe_digest(recipe), "smoke")


# ------------------------------------------------------------------------------------ artifacts that were copied here

ELSEWHERE = {
    "inputs": ({"inputs": {"a": 2.0, "b": [1.0]}}, "a is 2.0, not 1.0; b is [1.0], not None"),
    "code": ({"code": "xyz"}, "other code"),
    "libraries": ({"libraries": "numpy 2.0, scipy 1.16.0"}, "'numpy 2.0, scipy 1.16.0' among the libraries"),
    "options": ({"options": {"trials": 200}}, "trials is 200, not None"),
}


@pytest.mark.parametrize("case", ELSEWHERE)
def test_an_artifact_of_another_build_is_refused_by_what_differs(tmp_path, pinned, capsys, case):
    """As `cp -p` puts it in place: whole, and older than what Snakemake knows of."""
    different, reason = ELSEWHERE[case]
    here, planned = made_artifact(tmp_path, "one.h5", {"a": 1.0})
    there, _ = made_artifact(tmp_path / "there", "one.h5", **{"inputs": {"a": 1.0}, **different})
    shutil.copy2(there, here)
    snakemake = job_of(tmp_path, build={"size": "full", "artifacts": {here: planned}})
    with pytest.raises(SystemExit), jobs.guarded(snakemake):
        pytest.fail("the job must not begin")
    assert (
        f"job p_stage: {here}: comes from another build, of size 'smoke': {reason}: delete it and run snakemake again"
    ) in capsys.readouterr().err


def test_an_artifact_made_from_another_one_is_refused(tmp_path, pinned, capsys):
    """Its own inputs and code are those of here."""
    first = made_artifact(tmp_path, "one.h5", {"a": 1.0})
    second = made_artifact(tmp_path, "two.h5", {"b": 1.0}, first)
    there = made_artifact(tmp_path / "there", "one.h5", {"a": 2.0})
    copied, _ = made_artifact(tmp_path / "there", "two.h5", {"b": 1.0}, there)
    build = {"size": "full", "artifacts": dict([first, second])}
    with jobs.guarded(job_of(tmp_path, build=build)):
        pass
    shutil.copy2(copied, second[0])
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path, build=build)):
        pytest.fail("the job must not begin")
    assert "two.h5: comes from another build, of size 'smoke': another one.h5: delete it" in capsys.readouterr().err


def test_an_artifact_that_says_nothing_of_its_recipe_is_refused(tmp_path, pinned, capsys):
    here, planned = made_artifact(tmp_path, "one.h5", {"a": 1.0})
    save_thing(here)
    with (
        pytest.raises(SystemExit),
        jobs.guarded(job_of(tmp_path, build={"size": "full", "artifacts": {here: planned}})),
    ):
        pytest.fail("the job must not begin")
    assert "one.h5: comes from another build, of size None: a is None, not 1.0; other code" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------------------ failures


def test_a_refusal_ends_in_one_message_with_job_and_log(tmp_path, pinned, capsys):
    snakemake = job_of(tmp_path)
    with pytest.raises(SystemExit) as caught, jobs.guarded(snakemake):
        raise MarsedlError("the iteration does not converge: raise its limit")
    assert caught.value.code == 1
    message = capsys.readouterr().err
    assert "paper p, reading r, job p_stage: the iteration does not converge: raise its limit" in message
    assert f"(log: {tmp_path / 'logs' / 'job.log'})" in message
    assert "Traceback" not in message
    assert "Traceback" in (tmp_path / "logs" / "job.log").read_text(encoding="utf-8")


def failed_solve(tmp_path, capsys):
    """What a job says whose solver came to no solution."""
    iterate = {"time": np.array([0.0, 0.5, 1.0]), "bank": np.array([1 / 3, np.nan, -2e-20])}
    with pytest.raises(SystemExit) as caught, jobs.guarded(job_of(tmp_path)):
        raise SolverError("nominal: off by 3 m", iterate)
    assert caught.value.code == 1
    message = capsys.readouterr().err
    assert "paper p, reading r, job p_stage: nominal: off by 3 m (its last iterate" in message
    assert f"(log: {tmp_path / 'logs' / 'job.log'})" in message
    assert "Traceback" not in message
    assert "SolverError" in (tmp_path / "logs" / "job.log").read_text(encoding="utf-8")
    return message


def test_the_last_iterate_of_a_solver_is_kept_beside_the_log(tmp_path, pinned, capsys):
    message = failed_solve(tmp_path, capsys)
    iterate_file = tmp_path / "logs" / "job.iterate.csv"
    assert f"(its last iterate: {iterate_file})" in message
    assert iterate_file.read_text(encoding="utf-8").splitlines()[0] == "time,bank"
    np.testing.assert_array_equal(
        np.loadtxt(iterate_file, delimiter=",", skiprows=1), [[0.0, 1 / 3], [0.5, np.nan], [1.0, -2e-20]]
    )


def test_an_iterate_that_cannot_be_kept_does_not_hide_the_message(tmp_path, pinned, capsys):
    (tmp_path / "logs" / "job.iterate.csv").mkdir(parents=True)
    assert "(its last iterate could not be saved: Is a directory)" in failed_solve(tmp_path, capsys)


def test_a_full_disk_does_not_hide_the_message_of_a_solver(tmp_path, pinned, capsys, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savetxt", full)
    assert "(its last iterate could not be saved: No space left on device)" in failed_solve(tmp_path, capsys)


def test_other_failures_keep_no_iterate(tmp_path, pinned, capsys):
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise MarsedlError("no")
    assert "iterate" not in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "logs").iterdir()] == ["job.log"]


def test_an_unexpected_error_shows_its_traceback(tmp_path, pinned, capsys):
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise ZeroDivisionError("by zero")
    message = capsys.readouterr().err
    assert "Traceback" in message
    assert "paper p, reading r, job p_stage: ZeroDivisionError: by zero" in message


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "(No space left on device): free space and run again"),
        (errno.EDQUOT, ": free space and run again"),
        (errno.EROFS, "(Read-only file system): change its permissions and run again"),
    ],
)
def test_a_disk_that_takes_no_more_is_said_without_a_traceback(tmp_path, pinned, capsys, number, remedy):
    for path, named in ((tmp_path / "fig07.png", tmp_path / "fig07.png"), (None, "out")):
        with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
            raise OSError(number, os.strerror(number), path and str(path))
        message = capsys.readouterr().err
        assert f"paper p, reading r, job p_stage: {named}: cannot be written or read " in message
        assert remedy in message
        assert "Traceback" not in message


def test_a_log_that_cannot_be_written_is_said(tmp_path, pinned, capsys, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "logs/job.log")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        raise AssertionError("must not begin")
    message = capsys.readouterr().err
    assert (
        "paper p, reading r, job p_stage: logs/job.log: cannot be written or read (No space left on device)" in message
    )
    assert "Traceback" not in message


def test_a_job_without_the_pinned_environment_does_not_start(tmp_path, pinned, monkeypatch, capsys):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path)):
        pytest.fail("the body must not run")
    assert "OPENBLAS_CORETYPE" in capsys.readouterr().err


def test_a_job_with_other_libraries_than_planned_does_not_start(tmp_path, pinned, capsys):
    planned = LIBRARIES.replace("numpy ", "numpy 1")
    with pytest.raises(SystemExit), jobs.guarded(job_of(tmp_path, libraries=planned)):
        pytest.fail("the body must not run")
    message = f"the job would run with {LIBRARIES}, but was planned with {planned}: start snakemake in the environment"
    assert message in capsys.readouterr().err


def test_a_good_job_leaves_an_empty_log(tmp_path, pinned):
    with jobs.guarded(job_of(tmp_path)) as job:
        assert (job.paper, job.reading) == ("p", "r")
    assert (tmp_path / "logs" / "job.log").read_text(encoding="utf-8") == ""
