"""Compiled kernels: compiled once by jobs that run together."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline import kernel_cache
from marsedl.replication.pipeline.fingerprints import Fingerprints

SOURCE = Path(__file__).parents[3] / "src"

PROGRAM = """
import sys
import time
from numba import njit


@njit(cache=True)
def inner(x):
    return x + 1.0


@njit(cache=True)
def outer(x):
    return inner(x) * 2.0


time.sleep(max(0.0, float(sys.argv[1]) - time.time()))
print(outer(1.0), sum(outer.stats.cache_misses.values()))
"""
COMPILED, LOADED = ["4.0", "1"], ["4.0", "0"]
ANNOUNCED = "compiling kernels; later runs load them\n"


class Project:
    """A folder with kernels that are run there."""

    def __init__(self, folder: Path):
        self.folder, self.program = folder, folder / "kernels.py"
        self.program.write_text(PROGRAM, encoding="utf-8")

    def start(self, at: float = 0.0, before: str = "") -> subprocess.Popen:
        """Start the kernels as a job does, which waits for a time of the clock."""
        code = f"{before}import os, runpy; from marsedl.replication.pipeline import kernel_cache\n"
        code += f"os.environ['NUMBA_CACHE_DIR'] = {str(self.folder / 'cache')!r}\n"
        code += "os.environ['NUMBA_CACHE_LOCATOR_CLASSES'] = kernel_cache.LOCATOR\n"
        code += f"runpy.run_path({str(self.program)!r})\n"
        command = [sys.executable, "-c", code, str(at)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def run(self, before: str = "") -> tuple[list[str], str]:
        """Result and number of compiled kernels, and what was said."""
        process = self.start(before=before)
        out, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        return out.split(), errors


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A project whose kernels three jobs wanted at once, and how many each of them compiled."""
    project = Project(tmp_path_factory.mktemp("kernels"))
    started = [project.start(time.time() + 3.0) for _ in range(3)]
    try:
        printed = [process.communicate(timeout=120)[0].split() for process in started]
    finally:
        for process in started:
            process.kill()
    return project, printed


def test_of_jobs_that_need_a_kernel_at_once_one_compiles_it(compiled):
    _, printed = compiled
    assert sorted(printed) == [LOADED, LOADED, COMPILED]


def test_kernels_for_other_instructions_are_compiled_beside_those_that_there_are(compiled, monkeypatch):
    project, _ = compiled
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "")
    assert project.run() == (COMPILED, ANNOUNCED)
    monkeypatch.undo()
    assert project.run() == (LOADED, "")


@pytest.mark.parametrize("wide", [True, False])
def test_vectors_of_512_bits_are_asked_for_where_the_processor_has_them(monkeypatch, wide):
    class Features(dict):
        def flatten(self):
            return ",".join(f"{'+' if has else '-'}{name}" for name, has in self.items())

    host = Features(avx2=True, avx512f=wide)
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", lambda: host)
    assert kernel_cache.vector_features() == ("+avx2,+avx512f,-prefer-256-bit" if wide else "")


def test_on_a_file_system_without_locks_kernels_are_compiled_without_turns(tmp_path):
    project = Project(tmp_path)
    before = "import errno, fcntl\ndef flock(*_):\n    raise OSError(errno.ENOLCK, 'no')\nfcntl.flock = flock\n"
    printed, errors = project.run(before)
    assert printed == COMPILED
    warning = f"{tmp_path / 'cache'}: no file locks here, so several jobs may compile the same kernel\n"
    assert errors == warning + ANNOUNCED
    assert project.run(before)[0] == LOADED


# ---------------------------------------------------------------------------------------------- what the folder is of


def fingerprints(source, folder):
    return Fingerprints(folder / "fingerprints.json", source, folder / "none")


def test_every_cached_kernel_is_known(tmp_path):
    """Otherwise an edit of what it reaches would leave it as it was."""
    valid_names = [entry.split(":")[0] for entry in fingerprints(SOURCE, tmp_path).compiled()]
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(SOURCE.rglob("*.py"))}
    cached = [path for path, text in texts.items() if "cache=True" in text or "compiled_when_called" in text]
    names = {".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in cached}
    # Kernels of flights carry the digest of all that they reach in their names, see `test_flight_cache`.
    others = {"marsedl.replication.pipeline.fingerprints", "marsedl.montecarlo.flights.binding", "marsedl.compiling"}
    assert names - others == set(valid_names)
    flown = [path for path in SOURCE.glob("marsedl/papers/*/flight.py") if "Flight(" in path.read_text("utf-8")]
    assert len(valid_names) + len(flown) > 15


def test_an_edit_of_a_kernel_has_another_folder_and_one_of_a_claim_has_not(tmp_path):
    before = fingerprints(SOURCE, tmp_path).kernels()
    copy = shutil.copytree(SOURCE, tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text, same in (
        ("papers/funnels/claims/measures.py", "EDITED = 1", True),
        ("replication/report/contents.py", "EDITED = 1", True),
        ("models/heating.py", "EDITED = 1", True),  # which nothing reaches
        ("elementary.py", "np.seterr(all='raise')", False),
    ):
        with (copy / "marsedl" / name).open("a", encoding="utf-8") as file:
            file.write(f"\n{text}\n")
        assert (fingerprints(copy, tmp_path).kernels() == before) == same


def test_an_edit_of_equations_of_motion_has_another_kernel_of_flights(tmp_path):
    """Their kernels are named by all that they reach, see `binding.digest`."""
    program = """
from marsedl.montecarlo.flights.binding import digest
from marsedl.papers.powered_descent.flight import rates
print(digest(rates))
"""

    def name(source):
        environment = os.environ | {"PYTHONPATH": str(source)}
        return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=True).stdout

    copy = shutil.copytree(SOURCE, tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    before, path = name(copy), copy / "marsedl" / "models" / "dynamics" / "powered_descent.py"
    text = path.read_text(encoding="utf-8")
    path.write_text(text + "\n# A comment.\n", encoding="utf-8")
    assert name(copy) == before == name(SOURCE)
    assert "- gravity" in text
    path.write_text(text.replace("- gravity", "+ gravity"), encoding="utf-8")
    assert name(copy) != before


def test_a_cache_that_cannot_be_written_is_said_in_a_line(tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file of somebody else", encoding="utf-8")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache" / "numba"))
    with pytest.raises(MarsedlError, match=r"numba: cannot be written \(Not a directory\); let all who share"):
        kernel_cache._take_turns.__wrapped__()
