"""What a job does around its science: the pinned environment, declared inputs, loading, failures in one message."""

import errno
import logging
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication.errors import NOTES, MarsedlError, SolverError
from marsedl.replication.inputs.sections import Section, given, vector
from marsedl.replication.pipeline import jobs, numerics
from marsedl.replication.pipeline.libraries import versions_used
from marsedl.replication.pipeline.sharing import artifact_of, artifact_path
from marsedl.replication.records import fields, store
from marsedl.replication.records.recipes import file_digest, read_record, recipe_digest

SOURCE = Path(__file__).parents[3] / "src"
LIBRARIES = versions_used(frozenset({"numpy"}))


@dataclass(frozen=True)
class Thing:
    """A test artifact."""

    value: np.ndarray = fields.quantity("m", (2,), "two numbers")


class Named(list):
    """Stands for Snakemake's named lists: items by name, and all of them in a row."""

    def __init__(self, **items):
        super().__init__(one for item in items.values() for one in (item if isinstance(item, list) else [item]))
        vars(self).update(items)

    def items(self):
        return vars(self).items()

    def get(self, name):
        return vars(self).get(name)


def job_of(tmp_path, *, libraries=LIBRARIES, files=(), **given):
    given = {"inputs": {"a": 1.0}, "code": "abc", "libraries": libraries, **given}
    return SimpleNamespace(
        params=Named(given=given),
        input=Named(artifacts=[*files]),
        output=Named(out=str(tmp_path / "out.h5")),
        wildcards=Named(paper="p", reading="r"),
        log=Named(log=str(tmp_path / "logs" / "gains.log")),
        scriptdir=str(Path.cwd() / "workflow" / "rules" / ".." / "scripts"),  # as Snakemake has it
    )


@pytest.fixture
def pinned(monkeypatch, tmp_path):
    beside = dict.fromkeys(("PYTHONHASHSEED", "NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"), "0")
    for name, value in {**numerics.NUMERIC_ENVIRONMENT, **beside}.items():
        monkeypatch.setenv(name, value)


def save_thing(name, reading="r", value=(1.0, 2.0)):
    path = f"data/cache/p/r/{name}.h5"
    store.save(path, Thing(np.array(value)), paper="p", reading=reading, provenance={})
    return path


# -------------------------------------------------------------------------------------------------------- environment


def test_the_numeric_environment_is_pinned_for_children():
    code = "import os, sys; from pathlib import Path; from marsedl.replication.pipeline import numerics\n"
    code += f"numerics.pin_numerics(Path({str(SOURCE.parent)!r})); numerics.assert_numerics()\n"
    code += "assert 'numpy' not in sys.modules\n"
    code += "assert not {'NUMBA_CPU_NAME', 'NUMBA_DISABLE_JIT', 'GLIBC_TUNABLES'} & {*os.environ}\n"
    code += "print(os.environ['OPENBLAS_CORETYPE'], os.environ['OMP_NUM_THREADS'], os.environ['NUMBA_CACHE_DIR'])"
    clean = {name: value for name, value in os.environ.items() if name not in numerics.NUMERIC_ENVIRONMENT}
    clean |= {"NUMBA_CPU_NAME": "generic", "NUMBA_DISABLE_JIT": "1", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2"}
    process = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, check=True)
    core, threads, cache = process.stdout.split()
    assert (core, threads) == ("Haswell", "1")
    assert Path(cache).parent == SOURCE.parent / ".cache" / "numba"


def test_an_unpinned_environment_is_refused(pinned, monkeypatch):
    numerics.assert_numerics()
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("PYTHONHASHSEED")
    with pytest.raises(MarsedlError, match=r"OMP_NUM_THREADS, PYTHONHASHSEED.*start jobs through snakemake"):
        numerics.assert_numerics()


def test_a_processor_without_avx2_is_refused_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", lambda: {"sse4.2": True, "avx": True})
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    with pytest.raises(MarsedlError, match="has no AVX2 and FMA"):
        numerics.pin_numerics(tmp_path)


# ------------------------------------------------------------------------------------------------- inputs and artifacts


class Plant(Section):
    """A test section."""

    covariance: vector(2) = given("m^2", "two variances")


def test_vectors_of_a_section_are_arrays_of_floats():
    covariance = Plant.from_plain({"covariance": [1, 2]}).covariance
    np.testing.assert_array_equal(covariance, [1.0, 2.0])
    assert covariance.dtype == float


@pytest.fixture
def build(tmp_path, monkeypatch):
    """The folder that is built in, whose files have the paths of artifacts."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_arguments_are_loaded_by_annotation(build):
    def stage(one: Thing, calm: Thing, chunks: list[Thing], maybe: Thing | None = None):
        """Only its annotations are read."""

    snakemake = job_of(build)
    chunks = [save_thing(f"chunks/calm.{k}of3", value=(k, k)) for k in range(3)]
    snakemake.input = Named(artifacts=[save_thing("one"), save_thing("montecarlo.calm", value=(9, 9))], chunks=chunks)
    loaded = jobs.Job(snakemake).given().of(stage)
    assert set(loaded) == {"one", "calm", "chunks"}
    np.testing.assert_array_equal(loaded["one"].value, [1.0, 2.0])
    assert loaded["calm"].value[0] == 9.0
    assert [thing.value[0] for thing in loaded["chunks"]] == [0.0, 1.0, 2.0]


def test_an_artifact_of_another_reading_is_refused(build):
    def stage(one: Thing):
        """Only its annotations are read."""

    with pytest.raises(store.ArtifactError, match=r"one\.h5.*other"):
        jobs.Job(job_of(build, files=[save_thing("one", reading="other")])).given().of(stage)


def doubled(one: Thing) -> Thing:
    """A stage."""
    return Thing(2.0 * one.value)


def test_a_stage_is_saved_with_what_it_was_made_from(build):
    recipe = {"inputs": {"a": 2.0}, "options": {}, "code": "abc", "libraries": LIBRARIES, "needs": {"one.h5": "xyz"}}
    stage = {"entries": (f"{__name__}:doubled",), "recipes": [recipe], "size": "smoke"}
    snakemake = job_of(build, files=[save_thing("one")], **stage)
    jobs.Job(snakemake).run()
    np.testing.assert_array_equal(store.load(snakemake.output[0], Thing).value, [2.0, 4.0])
    provenance = store.provenance(snakemake.output[0])
    assert {name: provenance[name] for name in recipe} == recipe
    assert (provenance["recipe"], provenance["size"]) == (recipe_digest(recipe), "smoke")


def test_a_job_records_what_its_products_were_made_from_if_it_comes_to_its_end(tmp_path, pinned):
    record = tmp_path / "recipes" / "fig01.txt"
    snakemake = job_of(tmp_path, record=(str(record), ["abc", "def"]))
    (product,) = map(Path, snakemake.output)
    with jobs.guarded(snakemake) as job:
        assert (job.paper, job.reading) == ("p", "r")
        product.write_text("one", encoding="utf-8")
    assert read_record(record) == (["abc", "def"], {str(product): file_digest(product)})
    assert (tmp_path / "logs" / "gains.log").read_text(encoding="utf-8") == ""
    before = record.read_bytes()
    with pytest.raises(SystemExit), jobs.guarded(snakemake):
        product.write_text("half of another", encoding="utf-8")
        raise MarsedlError("no")
    assert record.read_bytes() == before, "no job takes a record away, be it its own or another's"
    assert read_record(record)[1][str(product)] != file_digest(product), "what a failed job left is not that"


@pytest.mark.parametrize("users", [True, False])
def test_what_a_reading_does_is_in_the_log_and_a_user_is_told_of_their_own(tmp_path, pinned, capsys, users):
    with jobs.guarded(job_of(tmp_path, users=users)):
        logging.getLogger(NOTES).warning("flights leave the table")
    assert (tmp_path / "logs" / "gains.log").read_text(encoding="utf-8") == "flights leave the table\n"
    assert capsys.readouterr().err == ("flights leave the table\n" if users else "")


@pytest.mark.parametrize("above", ["", "a/", ".snakemake/storage/s3/bucket/"])
def test_an_artifact_is_known_by_the_end_of_its_path(above):
    path = artifact_path("powered_descent", "mine", "chunks/closed_loop.0of4")
    assert artifact_of(above + path) == ("powered_descent", "mine", "chunks/closed_loop.0of4")


# ------------------------------------------------------------------------------------------------------------- starts


@pytest.mark.parametrize("name", [".numba_config.yaml", "ipopt.opt"])
def test_settings_of_a_library_in_the_working_directory_are_refused(tmp_path, monkeypatch, failing, name):
    """The second changes optimal trajectories without a word."""
    monkeypatch.chdir(tmp_path)
    numerics.check_start()
    (tmp_path / name).write_text("max_iter 3\n", encoding="utf-8")
    with pytest.raises(MarsedlError, match=f"{name}: changes the settings of .*; move it to another folder"):
        numerics.check_start()
    assert f"{name}: changes the settings" in failing()


@pytest.mark.parametrize("python", [["-OO"], []])
def test_a_python_without_docstrings_is_refused_in_a_line(python):
    environment = os.environ | {"PYTHONPATH": str(SOURCE)} | ({} if python else {"PYTHONOPTIMIZE": "2"})
    command = [sys.executable, *python, "-m", "marsedl.cli", "list"]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr.startswith("marsedl: Python drops docstrings") and process.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "folder", ["my study", "R&D", "it's", 'a"b', "a$b", "{a,b}", "a*", "a;b", "a`b", "a\\b", "a:b"]
)
def test_a_path_that_bash_does_not_take_is_refused(monkeypatch, folder):
    monkeypatch.setattr(sys, "executable", f"/home/{folder}/.venv/bin/python")
    with pytest.raises(MarsedlError, match=r"Snakemake runs no Python whose path has .*; move the project"):
        numerics.check_start()


@pytest.mark.parametrize("folder", ["étude", "a-b_c.d,e+f=g@h%"])
def test_a_path_that_bash_takes_is_accepted(monkeypatch, folder):
    monkeypatch.setattr(sys, "executable", f"/home/{folder}/.venv/bin/python")
    numerics.check_start()


# ------------------------------------------------------------------------------------------------------------ failures


@pytest.fixture
def failing(tmp_path, pinned, capsys):
    """A function that runs a job which raises an error, or must not begin; returns what it says."""

    def run(error=None, **given):
        with pytest.raises(SystemExit) as caught, jobs.guarded(job_of(tmp_path, **given)):
            raise error or AssertionError("the body must not run")
        assert caught.value.code == 1
        return capsys.readouterr().err

    return run


def test_a_refusal_ends_in_one_message_with_job_and_log(tmp_path, failing):
    log, message = tmp_path / "logs" / "gains.log", failing(MarsedlError("it does not converge: raise its limit"))
    assert "paper p, reading r, job gains: it does not converge: raise its limit" in message
    assert f"(log: {log})" in message
    assert "Traceback" not in message
    assert "Traceback" in log.read_text(encoding="utf-8")
    assert jobs.failure(log) == message.strip("\n") + "\n"
    assert jobs.failure(tmp_path / "logs" / "another.log") == ""


def test_the_last_iterate_of_a_solver_is_kept_beside_the_log(tmp_path, failing):
    iterate_file, iterate = tmp_path / "logs" / "gains.iterate.csv", {"time": [0.0, 0.5], "bank": [1 / 3, np.nan]}
    assert "job gains: nominal: there is no solution\n" in failing(SolverError("nominal: there is no solution", {}))
    assert not iterate_file.exists()
    said = "paper p, reading r, job gains: nominal: off by 3 m (its last iterate"
    assert f"{said}: {iterate_file})" in failing(SolverError("nominal: off by 3 m", iterate))
    stored = np.loadtxt(iterate_file, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(stored, [[0.0, 1 / 3], [0.5, np.nan]])
    iterate_file.unlink()
    iterate_file.mkdir()
    message = failing(SolverError("nominal: off by 3 m", iterate))
    assert f"{said} could not be saved: Is a directory)" in message


def test_an_unexpected_error_shows_its_traceback(failing):
    message = failing(ZeroDivisionError("by zero"))
    assert "Traceback" in message
    assert "paper p, reading r, job gains: ZeroDivisionError: by zero" in message


def test_a_full_disk_is_said_without_a_traceback(failing):
    message = failing(OSError(errno.ENOSPC, "No space left on device", "fig07.png"))
    assert "paper p, reading r, job gains: [Errno 28] No space left on device: 'fig07.png'" in message
    assert "Traceback" not in message


def test_a_job_without_the_pinned_environment_or_with_other_libraries_than_planned_does_not_start(failing, monkeypatch):
    planned = LIBRARIES.replace("numpy ", "numpy 1")
    message = f"the job would run with {LIBRARIES}, but was planned with {planned}: start snakemake in the environment"
    assert message in failing(libraries=planned)
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    assert "OPENBLAS_CORETYPE" in failing()
