"""Compiled kernels: compiled once by jobs that run together, never loaded damaged or as somebody else left them."""

import hmac
import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from marsedl.replication import kernels
from marsedl.replication.code_digest import kernels as kernels_of_source
from marsedl.replication.code_digest import kernels_digest
from marsedl.replication.errors import MarsedlError

SOURCE = Path(__file__).parents[2] / "src"

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


while time.time() < float(sys.argv[1]):
    pass
print(outer(1.0), sum(outer.stats.cache_misses.values()))
"""
COMPILED, LOADED = ["4.0", "1"], ["4.0", "0"]
ANNOUNCED = "compiling kernels; later runs load them\n"


class Project:
    """A folder with kernels, and a user who runs them there."""

    def __init__(self, folder: Path, home: Path):
        self.folder, self.home = folder, home
        self.folder.mkdir(exist_ok=True)
        self.program.write_text(PROGRAM, encoding="utf-8")

    @property
    def program(self) -> Path:
        return self.folder / "kernels.py"

    def start(self, at: float = 0.0) -> subprocess.Popen:
        """Start the kernels as a job does, which waits for a time of the clock."""
        code = "import os, runpy, sys; from pathlib import Path; from marsedl.replication import kernels\n"
        code += f"os.environ['NUMBA_CACHE_DIR'] = str(kernels.cache_folder(Path({str(self.folder)!r}), 'source'))\n"
        code += "os.environ['NUMBA_CACHE_LOCATOR_CLASSES'] = kernels.LOCATOR\n"
        code += f"runpy.run_path({str(self.program)!r})\n"
        return subprocess.Popen(
            [sys.executable, "-c", code, str(at)],
            env={**os.environ, "XDG_CACHE_HOME": str(self.home)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self) -> tuple[list[str], str]:
        """Result and number of compiled kernels, and what was said."""
        process = self.start()
        out, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        return out.split(), errors

    def cached(self, pattern: str) -> list[Path]:
        return sorted((self.folder / ".cache").rglob(pattern))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A project whose kernels three jobs of one user wanted at once, and how many each of them compiled."""
    base = tmp_path_factory.mktemp("kernels")
    project = Project(base / "project", base / "home")
    started = [project.start(time.time() + 3.0) for _ in range(3)]
    try:
        printed = [process.communicate(timeout=120)[0].split() for process in started]
    finally:
        for process in started:
            process.kill()
    return project, printed


@pytest.fixture
def project(compiled, tmp_path):
    """The same where a test may damage it, under the same path, to which numba's files belong."""
    compiled_project, _ = compiled
    shutil.copytree(compiled_project.folder, tmp_path / "kept")
    yield compiled_project
    shutil.rmtree(compiled_project.folder)
    shutil.copytree(tmp_path / "kept", compiled_project.folder)


def test_of_jobs_that_need_a_kernel_at_once_one_compiles_it(compiled):
    _, printed = compiled
    assert sorted(printed) == [LOADED, LOADED, COMPILED]


def test_kernels_for_other_instructions_are_compiled_beside_those_that_there_are(project, monkeypatch):
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
    assert kernels.vector_features() == ("+avx2,+avx512f,-prefer-256-bit" if wide else "")


@pytest.mark.parametrize("pattern", ["*.nbc", "*.nbi"])
def test_a_damaged_file_is_deleted_and_compiled_again(project, pattern):
    assert project.run() == (LOADED, "")
    first, *further_files = project.cached(pattern)
    for path in (first, *further_files):
        path.write_bytes(path.read_bytes()[:100])
    printed, errors = project.run()
    assert printed == COMPILED
    assert errors == (
        f"{first} and {len(further_files)} more: not as it was stored (cut short, edited or copied); it is "
        f"deleted and compiled again\n{ANNOUNCED}"
    )
    assert project.run() == (LOADED, "")


def test_seals_that_are_lost_or_damaged_cost_a_compilation(project):
    (seals,) = project.cached("seals.json")
    for damage in (seals.unlink, lambda: seals.write_text('["a"]'), lambda: seals.write_text('{"a": "µ"')):
        damage()
        assert project.run()[0] == COMPILED
    assert project.run() == (LOADED, "")


class Executed:
    """What runs a command when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_an_edited_file_is_not_executed(project, tmp_path):
    for path in project.cached("*.nbi"):
        path.write_bytes(pickle.dumps(Executed(tmp_path / "executed")))
    assert project.run()[0] == COMPILED
    assert not (tmp_path / "executed").exists()


def test_what_another_user_left_in_a_copied_project_is_not_loaded(project, tmp_path):
    """Its seals fit its files, but they are those of another key."""
    for path in project.cached("*.nbi"):
        path.write_bytes(pickle.dumps(Executed(tmp_path / "executed")))
    other = Project(project.folder, tmp_path / "other")
    assert other.run() == (COMPILED, ANNOUNCED)
    shutil.copy(seals_of(project), seals_of(other))  # even in the right place
    for path in project.cached("*.nbi"):
        path.write_bytes(pickle.dumps(Executed(tmp_path / "executed")))
    assert other.run()[0] == COMPILED
    assert not (tmp_path / "executed").exists()


def seals_of(user: Project) -> Path:
    key = (user.home / "marsedl" / "kernels.key").read_bytes()
    folder = hmac.new(key, b"source", "sha256").hexdigest()[:16]
    return user.folder / ".cache" / "numba" / folder / "seals.json"


# ------------------------------------------------------------------------------------------------------------- the key


def test_the_key_lasts_and_is_private(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    key, path = kernels.private_key(), tmp_path / "marsedl" / "kernels.key"
    assert kernels.private_key() == key == path.read_bytes()
    assert (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert [item.name for item in path.parent.iterdir()] == ["kernels.key"]
    for damage in (path.unlink, lambda: path.write_bytes(key[:8])):
        damage()
        again = kernels.private_key()
        assert len(again) == kernels.KEY_BYTES and again != key
        assert kernels.private_key() == again


def test_a_user_without_a_home_has_a_key(tmp_path, monkeypatch):
    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(kernels.Path, "home", none)
    monkeypatch.setattr(kernels.tempfile, "tempdir", str(tmp_path))
    assert kernels.private_key() == kernels.private_key()


def test_where_the_home_takes_no_key_a_folder_for_temporary_files_does(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(kernels.tempfile, "tempdir", str(tmp_path / "temporary"))
    key = kernels.private_key()
    assert [path.read_bytes() for path in tmp_path.rglob("kernels.key")] == [key]
    monkeypatch.setattr(kernels.os, "getuid", lambda: tmp_path.stat().st_uid + 1)  # everything is someone else's
    with pytest.raises(MarsedlError, match=r"the key .* set XDG_CACHE_HOME to a folder of your own"):
        kernels.private_key()


# ---------------------------------------------------------------------------------------------- what the folder is of


def test_every_cached_kernel_is_known():
    """Otherwise an edit of what it reaches would leave it as it was."""
    valid_names = [entry.split(":")[0] for entry in kernels_of_source()]
    cached = [path for path in sorted(SOURCE.rglob("*.py")) if "cache=True" in path.read_text(encoding="utf-8")]
    names = {".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in cached}
    assert names - {"marsedl.replication.code_digest"} == set(valid_names)
    assert len(valid_names) > 15


def test_an_edit_of_a_kernel_has_another_folder_and_one_of_a_claim_has_not(tmp_path):
    before = kernels_digest(SOURCE)
    copy = shutil.copytree(SOURCE, tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text, same in (
        ("papers/funnels/claims/measures.py", "EDITED = 1", True),
        ("replication/report.py", "EDITED = 1", True),
        ("models/heating.py", "EDITED = 1", True),  # which nothing reaches
        ("models/dynamics/powered_descent.py", "np.seterr(all='raise')", False),
    ):
        with (copy / "marsedl" / name).open("a", encoding="utf-8") as file:
            file.write(f"\n{text}\n")
        assert (kernels_digest(copy) == before) == same
