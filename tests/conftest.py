"""Built copies of the project for the tests of the pipeline, restored for every test.

The smoke build is made once for a state of source and inputs and kept in `.cache/smoke`; every process of a run works
in a copy of it. What is not about the five papers uses a small project with two papers from the templates, in which
Snakemake starts in a second. All of them share compiled kernels, in `.cache/numba`. Where tests are distributed
(`pytest -n 3 --dist loadgroup`), one process makes the smoke build and the others begin with what needs none.
"""

import os
from pathlib import Path

from marsedl.replication.pipeline.numerics import pin_numerics

ROOT = Path(__file__).parents[1]
os.environ.pop("COLUMNS", None)  # xdist says how wide its terminal is; what a test captures is no terminal
pin_numerics(ROOT)  # before numpy is imported; with it, kernels are compiled once for these processes and all jobs
del os.environ["NUMBA_NUM_THREADS"]  # some tests count threads

import contextlib
import fcntl
import hashlib
import json
import re
import runpy
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass, field

import pytest
import yaml
from hypothesis import settings

from marsedl.papers import SLUGS, input_model
from marsedl.replication.checks.scaffold import new_paper
from marsedl.replication.checks.twice import PRODUCTS, TREE, copy_tree, snakemake
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.records.differences import digest
from marsedl.replication.sizes import build_folder

# The same examples in every run, so that chance decides nothing; `pytest --hypothesis-profile=default` draws new ones.
settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")

GLIDE, HOP = "hypersonic_glide", "short_hop"  # of the small project: with Monte Carlo and without
BUILD = Path(__file__).parent / "workflow" / "build.py"
with_kernels = runpy.run_path(str(BUILD))["with_kernels"]
OF_A_BUILD = ("data/cache", "figures", "report", "logs", "benchmarks", ".snakemake")  # all else belongs to the project
_DIGESTS: dict[tuple[str, int, int], str] = {}  # by name, time and size: restored trees keep their times


def paper_of(name: str) -> str:
    """The paper that a rule or a file is named after; none for those of all papers."""
    parts, papers = name.split("/"), (*SLUGS, GLIDE, HOP)
    return next((slug for part in parts for slug in papers if re.match(rf"{slug}([_.]|$)", part)), "")


@pytest.fixture(scope="session")
def own_reading():
    """A function that writes a user's own reading, based on `corrected`, as YAML; inputs without their section."""

    def text(slug: str, name: str, **values: str) -> str:
        of = {key: section for section, inputs in input_model(slug).sections().items() for key in inputs.keys()}  # noqa: SIM118
        sections: dict[str, dict] = {}
        for key, value in values.items():
            sections.setdefault(of[key], {})[key] = {"value": yaml.safe_load(value), "source": "assumed: test"}
        return yaml.safe_dump({slug: {"readings": {name: {"based_on": "corrected", **sections}}}})

    return text


@dataclass
class Plan:
    """What a dry run would do: the output files of every job, by rule."""

    outputs: dict[str, set[str]]

    @property
    def rules(self) -> set[str]:
        return {rule.removeprefix(f"{paper_of(rule)}_") for rule in self.outputs if rule != "all"}

    @property
    def files(self) -> set[str]:
        return {path for paths in self.outputs.values() for path in paths}

    @property
    def artifacts(self) -> set[str]:
        """Artifacts as "reading/name", without those of chunks, which are temporary."""
        cached = [path.removesuffix(".h5").split("/", 3)[3] for path in self.files if path.startswith("data/cache/")]
        return {name for name in cached if "/chunks/" not in name}


@dataclass
class Tree:
    """A copy of the project in which Snakemake runs."""

    folder: Path
    config: list[str] = field(default_factory=lambda: ["size=smoke"])

    @property
    def build(self) -> Path:
        """Where the products are of the size that Snakemake is run with."""
        return build_folder(self.folder, dict(entry.split("=", 1) for entry in self.config).get("size", "full"))

    def path(self, name: str) -> Path:
        """A file of the project or, named as in a full build, of the build."""
        return (self.build if name.startswith(OF_A_BUILD) else self.folder) / name

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a text that occurs exactly once in a file."""
        text = self.path(name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name} holds {old!r} {text.count(old)} times"
        self.path(name).write_text(text.replace(old, new), encoding="utf-8")

    def run(self, *arguments: str, configfile: Path | None = None, **environment: str) -> subprocess.CompletedProcess:
        """Run Snakemake with the configuration that the tree was built with."""
        return snakemake(self.folder, *self._arguments(arguments, configfile), **environment)

    def works(self, *arguments: str, configfile: Path | None = None) -> str:
        """Run Snakemake, which must succeed; returns what it says."""
        process = self.run(*arguments, configfile=configfile)
        assert process.returncode == 0, process.stdout[-3000:]
        return process.stdout

    def fails(self, *arguments: str, configfile: Path | None = None) -> str:
        """Run Snakemake, which must fail without a traceback; returns what it says."""
        process = self.run(*arguments, configfile=configfile)
        assert process.returncode != 0, process.stdout[-3000:]
        assert "Traceback" not in process.stdout
        return process.stdout

    def start(self, *arguments: str) -> subprocess.Popen:
        """Start Snakemake in a process group of its own."""
        return subprocess.Popen(
            [sys.executable, "-m", "snakemake", *self._arguments(arguments, None)],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(self.folder / "src")},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def plan(self, *arguments: str, configfile: Path | None = None) -> Plan:
        """Dry run: which jobs would run."""
        outputs, said = {}, self.works(*arguments, "--dry-run", "--quiet", "host", configfile=configfile)
        for block in re.split(r"\n\[[^\n]*\]\n", said):
            rule = re.match(r"(?:local)?(?:rule|checkpoint) (\w+):\n", block)
            if rule:
                listed = re.search(r"\n    output: ([^\n]*)", block)
                paths = [path.removesuffix(" (temp)") for path in listed.group(1).split(", ")] if listed else []
                outputs.setdefault(rule.group(1), set()).update(paths)
        assert bool(outputs) != ("Nothing to be done" in said), said[-3000:]
        return Plan(outputs)

    def digests(self) -> dict[str, str]:
        """Digests of all products; a file of a time and size that was seen before is not read again."""
        files = {name: (name, *state) for name, state in self.state().items()}
        for name, key in files.items():
            if key not in _DIGESTS:
                _DIGESTS[key] = digest(self.build / name)
        return {name: _DIGESTS[key] for name, key in files.items()}

    def state(self) -> dict[str, tuple[int, int]]:
        """Time and size of every product: unchanged exactly if nothing was written."""
        paths = [path for pattern in PRODUCTS for path in self.build.glob(pattern) if path.is_file()]
        return {str(p.relative_to(self.build)): (p.stat().st_mtime_ns, p.stat().st_size) for p in sorted(paths)}

    def marsedl(self, *arguments: str) -> subprocess.CompletedProcess:
        """Run the command `marsedl` in this folder, with this folder's package."""
        return subprocess.run(
            [sys.executable, "-m", "marsedl.cli", *arguments],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(self.folder / "src")},
            capture_output=True,
            text=True,
            check=False,
        )

    def _arguments(self, arguments, configfile):
        configuration = ["--configfile", str(configfile)] if configfile else []
        config = ["--config", *self.config] if self.config else []
        return [*arguments, "--cores", "2", *configuration, *config]


class Spare:
    """A folder and an equal copy, from which what has changed in the folder since is put back."""

    def __init__(self, folder: Path, copy: Path):
        self.folder, self.copy, self.stamps = folder, copy, {}
        self.stamps = self._stamps()

    def restore(self) -> None:
        """Copy files that were written, moved or touched, which their time of change shows, and delete new ones."""
        now = self._stamps()
        for name in sorted(now.keys() - self.stamps.keys(), reverse=True):  # what a folder holds before the folder
            path = self.folder / name
            path.rmdir() if path.is_dir() else path.unlink()
        for name in sorted(name for name, stamp in self.stamps.items() if now.get(name) != stamp):
            if (self.copy / name).is_dir():
                (self.folder / name).mkdir()
            else:
                (self.folder / name).unlink(missing_ok=True)
                shutil.copy2(self.copy / name, self.folder / name)
        self.stamps = self._stamps()

    def _stamps(self) -> dict[Path, tuple]:
        """What changes with a file, by its name; of a folder only that it is one."""
        stamps = {}
        for path in self.folder.rglob("*"):
            state = path.lstat()
            stamp = (state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns, state.st_mode)
            stamps[path.relative_to(self.folder)] = () if path.is_dir() else stamp
        return stamps


@dataclass
class Built:
    """The smoke build that the tests share: its folder, and what was said when it was built and compared."""

    folder: Path
    agree: bool
    output: str
    digests: dict[str, str]


def kept_build(run: str) -> Built:
    """Return the smoke build of this source and these inputs, which one process makes while others wait for it.

    It stays in `.cache/smoke` until something of it is edited. run: names this run of pytest, in which a build that
    failed is not tried again.
    """
    folder = ROOT / ".cache" / "smoke" / _digest_of_sources()
    folder.mkdir(parents=True, exist_ok=True)
    built, failed = folder / "built.json", folder / f"failed.{run}"
    with (folder.parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not built.exists() and not failed.exists():
            for other in folder.parent.iterdir():
                if other.is_dir() and other != folder:
                    shutil.rmtree(other)
            process = subprocess.Popen(
                [sys.executable, str(BUILD), str(folder)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                process_group=0,
            )
            try:
                output = process.communicate()[0]
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
            if process.returncode:
                failed.write_text(output, encoding="utf-8")
    if failed.exists():
        pytest.fail(f"the smoke build failed:\n{failed.read_text(encoding='utf-8')[-5000:]}", pytrace=False)
    said = json.loads(built.read_text(encoding="utf-8"))
    return Built(folder / "project" / "build" / "verify" / "0", **said)


def _digest_of_sources() -> str:
    hasher = hashlib.sha256(sys.version.encode() + (ROOT / "requirements.lock").read_bytes() + BUILD.read_bytes())
    for name in TREE:
        for path in sorted([ROOT / name, *(ROOT / name).rglob("*")]):
            if path.is_file() and "__pycache__" not in path.parts:
                hasher.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes())
    return hasher.hexdigest()[:16]


def needs(item, *fixtures: str) -> bool:
    return any(fixture in getattr(item, "fixturenames", ()) for fixture in fixtures)


def group(item) -> str:
    """What shares a process where tests are distributed: the small project, a paper's stages, a file."""
    if needs(item, "built"):
        return "build"
    if needs(item, "small_build"):
        return "small"
    path = item.path.relative_to(Path(__file__).parent)
    return paper_of(path.name.removeprefix("test_")) or str(path)


# Fixtures that compute the stages of a paper in memory.
STAGES = ("pipeline", "random_field", "desensitized", "funnels", "entry")


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config, items):
    """The test that waits for the smoke build first, those that read it last, and long groups before short ones."""
    for item in items:
        if needs(item, *STAGES):
            item.add_marker(pytest.mark.stages)
        if hasattr(config, "workerinput"):
            item.add_marker(pytest.mark.xdist_group(group(item)))
    yield
    first = {name: number for number, name in enumerate(("build", "small", *SLUGS))}
    items.sort(key=lambda item: (needs(item, "copied") and not needs(item, "built"), first.get(group(item), 99)))


def pytest_runtest_setup(item):
    if hasattr(item.config, "workerinput") and group(item) != "build" and os.nice(0) == 0:
        os.nice(10)  # the build takes longest


def pytest_sessionfinish():
    fingerprints_of(ROOT).save()


@pytest.fixture(scope="session")
def built(request) -> Built:
    """The smoke build, not to be changed."""
    return kept_build(os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid())))


@pytest.fixture(scope="session")
def session_copy(tmp_path_factory) -> Spare:
    """A copy of the smoke build for the tests of this process."""
    kept = kept_build(os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))).folder
    return Spare(shutil.copytree(kept, tmp_path_factory.mktemp("smoke") / "project", symlinks=True), kept)


@pytest.fixture
def copied(session_copy) -> Tree:
    """The smoke build as it was built, to plan, read and run in."""
    session_copy.restore()
    return Tree(session_copy.folder)


@pytest.fixture
def tree(copied) -> Tree:
    """The same."""
    return copied


# -------------------------------------------------------------------------------------------------- the small project

TITLE = (
    "A Study of Gliding & Steering, Which Has {Braces}, a Title That is Far Too Long for One Line, and What Not: Part 2"
)
AUTHORS = "A. O'Author and B. Müller"


def small_project(folder: Path) -> Path:
    """A copy of the project with two new papers in place of the five: it starts at once, and stages take no time."""
    copy_tree(ROOT, folder)
    new_paper(folder, GLIDE, TITLE, AUTHORS)
    new_paper(folder, HOP, TITLE, AUTHORS, monte_carlo=False)
    with (folder / "data" / "published" / f"{HOP}.yaml").open("a", encoding="utf-8") as file:
        file.write("headline: [largest_thrust]\n")
    with (folder / "src" / "marsedl" / "papers" / HOP / "texts.yaml").open("a", encoding="utf-8") as file:
        file.write("found:\n  largest_thrust: The largest thrust is {largest_thrust:.1f}.\n")
    papers, comparison = folder / "src" / "marsedl" / "papers", folder / "src" / "marsedl" / "comparison"
    register = papers / "__init__.py"
    text, number = re.subn(r"(?s)SLUGS = \(.*?\)", f"SLUGS = {(GLIDE, HOP)}", register.read_text(encoding="utf-8"))
    assert number == 1
    register.write_text(text, encoding="utf-8")
    for slug in SLUGS:
        shutil.rmtree(papers / slug)
    for path in comparison.glob("*.py"):
        if path.stem not in ("__init__", "records"):
            path.unlink()
    (comparison / "texts.yaml").write_text("nothing:\n  figure: Nothing.\n  table: Nothing.\n", encoding="utf-8")
    return with_kernels(folder)


@pytest.fixture(scope="session")
def small_build(tmp_path_factory) -> Spare:
    """The smoke build of the small project."""
    base = tmp_path_factory.mktemp("small")
    tree = Tree(small_project(base / "project"))
    tree.works(GLIDE, HOP)
    return Spare(tree.folder, shutil.copytree(tree.folder, base / "spare", symlinks=True))


@pytest.fixture
def small(small_build) -> Tree:
    """The small project as it was built."""
    small_build.restore()
    return Tree(small_build.folder)
