"""A built copy of the project for the tests of the pipeline: built once in a session, restored for every test.

Builds take most of the time of a session. They run in the background: the smoke builds from its start, then the
full-size build. The tests that need none come first, then those of the smoke builds, last those of the full size. Where
tests are distributed (`pytest -n 3 --dist loadgroup`), one process waits for the builds and has the tests that run jobs
in them, and another one, last, those that read a copy of the build or plan in it. The tests of a paper share a process
too, and so do those of a file. Nothing is built if no selected test needs it.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported; threads would spin beside the builds
os.environ.pop("COLUMNS", None)  # xdist says how wide its terminal is; what a test captures is no terminal

import contextlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml
from hypothesis import settings

from marsedl.papers import SLUGS, input_model
from marsedl.replication.digests import digest
from marsedl.replication.sizes import build_folder, size_of
from marsedl.replication.verification import PRODUCTS, copy_tree, snakemake

# The same examples in every run, so that chance decides nothing; `pytest --hypothesis-profile=default` draws new ones.
settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]
BUILD = Path(__file__).parent / "workflow" / "build.py"
OF_A_BUILD = ("data/cache", "figures", "report", "logs", "benchmarks", ".snakemake")  # all else belongs to the project
_DIGESTS: dict[tuple[str, int, int], str] = {}  # by name, time and size: restored trees keep their times


def paper_of(name: str) -> str:
    """The paper that a rule or a file is named after; none for those of all papers."""
    parts = name.split("/")
    return next((slug for part in parts for slug in SLUGS if re.match(rf"{slug}([_.]|$)", part)), "")


def _short(rule: str) -> str:
    """The name of a rule without its paper; all rules of tables are "table", those of several cases "montecarlo"."""
    name = rule.removeprefix(f"{paper_of(rule)}_")
    name = re.sub(r"^flights(_\d+)?$", "montecarlo", name)
    return "table" if name.startswith("table_") else name


def reading_text(slug: str, name: str, **values: str) -> str:
    """A reading of a user's own, based on `corrected`, as YAML; names of inputs without that of the section."""
    of = {key: section for section, inputs in input_model(slug).sections().items() for key in inputs.keys()}  # noqa: SIM118
    sections: dict[str, dict] = {}
    for key, value in values.items():
        sections.setdefault(of[key], {})[key] = {"value": yaml.safe_load(value), "source": "assumed: test"}
    return yaml.safe_dump({slug: {"readings": {name: {"based_on": "corrected", **sections}}}})


@pytest.fixture(scope="session")
def own_reading():
    """The function `reading_text`."""
    return reading_text


@dataclass
class Plan:
    """What a dry run would do: the output files of every job, by rule."""

    outputs: dict[str, set[str]]
    params_changed: set[str] = field(default_factory=set)

    def of(self, slug: str) -> "Plan":
        """The part of one paper, without what is made for all of them."""
        mine = {rule: {path for path in paths if paper_of(path) == slug} for rule, paths in self._of_papers().items()}
        changed_rules = {rule for rule in self.params_changed if mine.get(rule)}
        return Plan({rule: paths for rule, paths in mine.items() if paths}, changed_rules)

    @property
    def papers(self) -> set[str]:
        return {paper_of(path) for paths in self._of_papers().values() for path in paths} - {""}

    def _of_papers(self) -> dict[str, set[str]]:
        """Without the report, which has a page for each paper but is made for all of them."""
        return {rule: paths for rule, paths in self.outputs.items() if rule != "site"}

    @property
    def rules(self) -> set[str]:
        return {_short(rule) for rule in self.outputs if rule != "all"}

    @property
    def changed_rules(self) -> set[str]:
        """Rules of jobs whose inputs or code have changed, as opposed to those that only depend on such jobs."""
        return {_short(rule) for rule in self.params_changed}

    @property
    def files(self) -> set[str]:
        return {path for paths in self.outputs.values() for path in paths}

    @property
    def artifacts(self) -> set[str]:
        """Artifacts as "reading/name", without those of chunks, which are temporary."""
        cached = [path.removesuffix(".h5").split("/", 3)[3] for path in self.files if path.startswith("data/cache/")]
        return {name for name in cached if "/chunks/" not in name}

    @property
    def stages(self) -> set[str]:
        return {name.split("/")[1].split(".")[0] for name in self.artifacts}

    @property
    def readings(self) -> set[str]:
        return {name.split("/")[0] for name in self.artifacts}

    @property
    def figures(self) -> set[str]:
        """Names of the figures and tables, without those that the claims write."""
        rules = [rule for rule in self.outputs if rule == "figure" or "_table_" in rule]
        return {Path(path).stem for rule in rules for path in self.outputs[rule]}


@dataclass
class Tree:
    """A copy of the project in which Snakemake runs."""

    folder: Path
    config: list[str] = field(default_factory=lambda: ["size=smoke", "chunks=3"])

    @property
    def build(self) -> Path:
        """Where the products are of the size that Snakemake is run with."""
        return build_folder(self.folder, size_of(self.config))

    def path(self, name: str) -> Path:
        """A file of the project or, named as in a full build, of the build."""
        return (self.build if name.startswith(OF_A_BUILD) else self.folder) / name

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a text that occurs exactly once in a file."""
        text = self.path(name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name} holds {old!r} {text.count(old)} times"
        self.path(name).write_text(text.replace(old, new), encoding="utf-8")

    def set_inputs(self, reading: str, *, paper: str = "powered_descent", **values: str) -> None:
        """Set inputs (texts of YAML) of a reading that does not set them itself yet; names without the section's."""
        config, sections = self.path(f"configs/{paper}.yaml"), input_model(paper).sections()
        text = config.read_text(encoding="utf-8")
        for name, value in values.items():
            section = next(section for section, of in sections.items() if name in of.keys())  # noqa: SIM118
            body = re.search(rf"(?ms)^  {reading}:\n(.*?)(?=^  [a-z]|^[a-z]|\Z)", text)
            assert body, f"there is no reading {reading}"
            entry = f'      {name}: {{value: {value}, source: "assumed: test"}}\n'
            heading = f"    {section}:\n"
            if heading in body[1]:
                changed_rules = body[1].replace(heading, heading + entry, 1)
            else:
                lines = body[1].rstrip("\n") + "\n"
                changed_rules = lines + heading + entry + body[1][len(lines) :]
            text = text[: body.start(1)] + changed_rules + text[body.end(1) :]
        config.write_text(text, encoding="utf-8")

    def run(self, *arguments: str, configfile: Path | None = None, **environment: str) -> subprocess.CompletedProcess:
        """Run Snakemake with the configuration that the tree was built with."""
        return snakemake(self.folder, *self._arguments(arguments, configfile), **environment)

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
        process = self.run(*arguments, "--dry-run", "--quiet", "host", configfile=configfile)
        assert process.returncode == 0, process.stdout[-3000:]
        outputs = {}
        for block in re.split(r"\n\[[^\n]*\]\n", process.stdout):
            rule = re.match(r"(?:local)?(?:rule|checkpoint) (\w+):\n", block)
            if rule:
                listed = re.search(r"\n    output: ([^\n]*)", block)
                paths = [path.removesuffix(" (temp)") for path in listed.group(1).split(", ")] if listed else []
                outputs.setdefault(rule.group(1), set()).update(paths)
        assert bool(outputs) != ("Nothing to be done" in process.stdout), process.stdout[-3000:]
        listed = re.search(r"\n    params have changed since last execution:\n((?: {8}[^\n]*\n)+)", process.stdout)
        names = listed.group(1).replace("\n", ",").split(",") if listed else []
        return Plan(outputs, {name.strip() for name in names if name.strip()})

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


class Background:
    """Builds beside the tests, in a process group of their own, which does not outlive them."""

    def __init__(self, folder: Path, *tasks: str):
        self.folder, self.log = folder, folder.with_name("builds.log")
        self.copy = folder.with_name("copy")  # of the second build
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, str(BUILD), str(folder), *tasks],
                stdin=subprocess.PIPE,  # which closes when this process ends, in whatever way
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
        unfinished = folder.with_name("process.part")  # another process may be waiting for it
        unfinished.write_text(str(self.process.pid), encoding="ascii")
        unfinished.rename(folder.with_name("process"))

    def smoke(self) -> dict:
        """Wait for the smoke builds; returns what was written of them."""
        result_file = self.folder.with_name("smoke.json")
        while not result_file.exists() and self.runs():
            time.sleep(0.2)
        if not result_file.exists():
            self._fail()
        return json.loads(result_file.read_text(encoding="utf-8"))

    def runs(self) -> bool:
        """Whether they are not at their end."""
        return self.process.poll() is None

    def wait(self) -> None:
        """Wait for all of them."""
        if self.process.wait():
            self._fail()

    def output(self) -> str:
        return self.log.read_text(encoding="utf-8", errors="replace")

    def kill(self) -> None:
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdin.close()

    def _fail(self):
        """Fail the test that needs what could not be built."""
        pytest.fail(f"a build failed; the end of {self.log}:\n{self.output()[-5000:]}", pytrace=False)


class Begun(Background):
    """The builds that another process has begun."""

    def __init__(self, folder: Path):
        self.folder, self.log, self.copy = folder, folder.with_name("builds.log"), folder.with_name("copy")
        while not (number := folder.with_name("process")).exists():
            time.sleep(0.2)
        self.process = int(number.read_text(encoding="ascii"))

    def runs(self) -> bool:
        return Path(f"/proc/{self.process}").exists()

    def wait(self) -> None:
        while self.runs():
            time.sleep(0.2)

    def kill(self) -> None:
        """They belong to the other process."""


class Spare:
    """A copy of a folder, from which what has changed there since is put back."""

    def __init__(self, folder: Path, copy: Path):
        self.folder, self.copy = folder, copy
        shutil.copytree(folder, copy)  # keeps file times, on which the compiled kernels depend
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
    """Two smoke builds: what was said of them, and their products' digests and their logs."""

    agree: bool
    output: str
    digests: tuple[dict[str, str], ...]
    logs: tuple[set[str], ...]
    spare: Spare  # of the second one


def needs(item, fixture: str) -> bool:
    return fixture in getattr(item, "fixturenames", ())


def distributed(config) -> bool:
    return hasattr(config, "workerinput")


def group(item) -> str:
    """What shares a process where tests are distributed."""
    if needs(item, "built"):
        return "builds"
    if needs(item, "copied"):
        return "copies"
    path = item.path.relative_to(Path(__file__).parent)
    return paper_of(path.name.removeprefix("test_")) or str(path)


# Fixtures that compute the stages of a paper in memory.
STAGES = ("pipeline", "random_field", "desensitized", "funnels", "entry")


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config, items):
    for item in items:
        if any(needs(item, fixture) for fixture in STAGES):
            item.add_marker(pytest.mark.stages)
    if not distributed(config):
        yield
        order = ("copied", "built", "full")
        items.sort(key=lambda item: sum(needs(item, name) for name in order))  # otherwise in their order
        return
    for item in items:
        item.add_marker(pytest.mark.xdist_group(group(item)))
    yield
    longest = ["builds", *SLUGS]  # which have to begin first
    place = {name: number for number, name in enumerate(longest)} | {"copies": len(longest) + 1}
    items.sort(key=lambda item: place.get(group(item), len(longest)))
    items.sort(key=lambda item: needs(item, "full") - needs(item, "built"))


def pytest_runtest_setup(item):
    if distributed(item.config) and group(item) != "builds" and os.nice(0) == 0:
        os.nice(10)  # the builds and their tests take longest


@pytest.fixture(scope="session")
def background(request, tmp_path_factory):
    """The builds beside the tests, of the sizes that selected tests need."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if distributed(request.config) else base) / "builds"
    try:
        folder.mkdir()
    except FileExistsError:
        yield Begun(folder / "project")
        return
    full = any(needs(item, "full") for item in request.session.items)
    builds = Background(copy_tree(ROOT, folder / "project"), *["full"] * full)
    yield builds
    builds.kill()


@pytest.fixture(scope="session", autouse=True)
def early(request):
    """Begin the builds before the first test; where tests are distributed, the process that needs them begins so."""
    builds = ("built", "copied")
    if not distributed(request.config) and any(needs(item, b) for item in request.session.items for b in builds):
        request.getfixturevalue("background")


@pytest.fixture(scope="session")
def built(background) -> Built:
    """The smoke size built twice, as `marsedl verify` does."""
    smoke = background.smoke()
    tree = Tree(background.folder / "build" / "verify" / "1")
    _DIGESTS.update({(name, *state): smoke["digests"][1][name] for name, state in tree.state().items()})
    logs = tuple(set(names) for names in smoke["logs"])
    spare = Spare(tree.folder, background.folder / "spare")
    return Built(smoke["agree"], background.output(), tuple(smoke["digests"]), logs, spare)


@pytest.fixture(scope="session")
def spare_copy(background) -> Spare:
    """A copy of the second smoke build, beside the one in which jobs are run."""
    background.smoke()
    return Spare(background.copy, background.copy.with_name("spare copy"))


@pytest.fixture
def copied(spare_copy) -> Tree:
    """The second build in another place, to be read or planned in; a job would compile its kernels anew there."""
    spare_copy.restore()
    return Tree(spare_copy.folder)


@pytest.fixture
def project(tmp_path) -> Tree:
    """A copy of the project in which nothing is built."""
    return Tree(copy_tree(ROOT, tmp_path / "project"))


@pytest.fixture
def tree(built) -> Tree:
    """The second build as it was built, in its own place: compiled kernels are bound to their path."""
    built.spare.restore()
    return Tree(built.spare.folder)


@pytest.fixture(scope="session")
def full(built, background) -> Path:
    """The tree in which the size `check` is built: the full numbers of trials, in fewer readings, without figures."""
    background.wait()
    return background.folder / "build" / "verify" / "0"
