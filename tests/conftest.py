"""A built copy of the project for the tests of the pipeline: built once in a session, restored for every test."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from marsedl.papers import SLUGS
from marsedl.replication.digests import digest
from marsedl.replication.verification import PRODUCTS, build_twice, copy_tree, snakemake

ROOT = Path(__file__).parents[1]
_DIGESTS: dict[tuple[str, int, int], str] = {}  # by name, time and size: restored trees keep their times


def paper_of(name: str) -> str:
    """The paper that a rule or a file is named after; none for those of all papers."""
    return next((slug for slug in SLUGS if re.search(rf"(^|/){slug}[_/.]", name)), "")


@dataclass
class Plan:
    """What a dry run would do: the output files of every job, by rule."""

    outputs: dict[str, set[str]]
    params_changed: set[str] = field(default_factory=set)

    def of(self, slug: str) -> "Plan":
        """The part of one paper, without what is made for all of them."""
        mine = {rule: {path for path in paths if paper_of(path) == slug} for rule, paths in self.outputs.items()}
        changed = {rule for rule in self.params_changed if mine.get(rule)}
        return Plan({rule: paths for rule, paths in mine.items() if paths}, changed)

    @property
    def papers(self) -> set[str]:
        return {paper_of(path) for path in self.files} - {""}

    @property
    def rules(self) -> set[str]:
        return {rule.removeprefix(f"{paper_of(rule)}_") for rule in self.outputs if rule != "all"}

    @property
    def changed(self) -> set[str]:
        """Rules of jobs whose inputs or code have changed, as opposed to those that only depend on such jobs."""
        return {rule.removeprefix(f"{paper_of(rule)}_") for rule in self.params_changed}

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
        rules = ("figure", "default_figure", "table", "default_table")
        return {Path(path).stem for rule in rules for path in self.outputs.get(rule, ())}


@dataclass
class Tree:
    """A copy of the project in which Snakemake runs."""

    folder: Path
    config: list[str] = field(default_factory=lambda: ["size=smoke", "chunks=3"])

    def path(self, name: str) -> Path:
        return self.folder / name

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a text that occurs exactly once in a file."""
        text = self.path(name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name} holds {old!r} {text.count(old)} times"
        self.path(name).write_text(text.replace(old, new), encoding="utf-8")

    def set_inputs(self, reading: str, *, paper: str = "powered_descent", **values: str) -> None:
        """Set inputs (texts of YAML) of a reading that does not set them itself yet."""
        config = self.path(f"configs/{paper}.yaml")
        text = config.read_text(encoding="utf-8")
        entry = '      {}: {{value: {}, source: "assumed: test"}}\n'
        lines = "".join(entry.format(name, value) for name, value in values.items())
        changed, number = re.subn(rf"(?ms)^(  {reading}:\n.*?    inputs:\n)", rf"\g<1>{lines}", text, count=1)
        assert number == 1, f"there is no reading {reading}"
        config.write_text(changed, encoding="utf-8")

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
        done = self.run(*arguments, "--dry-run", "--quiet", "host", configfile=configfile)
        assert done.returncode == 0, done.stdout[-3000:]
        outputs = {}
        for block in re.split(r"\n\[[^\n]*\]\n", done.stdout):
            rule = re.match(r"(?:local)?(?:rule|checkpoint) (\w+):\n", block)
            if rule:
                listed = re.search(r"\n    output: ([^\n]*)", block)
                paths = [path.removesuffix(" (temp)") for path in listed.group(1).split(", ")] if listed else []
                outputs.setdefault(rule.group(1), set()).update(paths)
        assert bool(outputs) != ("Nothing to be done" in done.stdout), done.stdout[-3000:]
        listed = re.search(r"\n    params have changed since last execution:\n((?: {8}[^\n]*\n)+)", done.stdout)
        names = listed.group(1).replace("\n", ",").split(",") if listed else []
        return Plan(outputs, {name.strip() for name in names if name.strip()})

    def digests(self) -> dict[str, str]:
        """Digests of all products; a file of a time and size that was seen before is not read again."""
        files = {name: (name, *state) for name, state in self.state().items()}
        for name, key in files.items():
            if key not in _DIGESTS:
                _DIGESTS[key] = digest(self.folder / name)
        return {name: _DIGESTS[key] for name, key in files.items()}

    def state(self) -> dict[str, tuple[int, int]]:
        """Time and size of every product: unchanged exactly if nothing was written."""
        paths = [path for pattern in PRODUCTS for path in self.folder.glob(pattern) if path.is_file()]
        return {str(p.relative_to(self.folder)): (p.stat().st_mtime_ns, p.stat().st_size) for p in sorted(paths)}

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
        own = ["--configfile", str(configfile)] if configfile else []
        config = ["--config", *self.config] if self.config else []
        return [*arguments, "--cores", "2", *own, *config]


@dataclass
class Built:
    """Two smoke builds, what was said of them, and a spare copy of the second one."""

    agree: bool
    said: str
    first: Tree
    second: Tree
    spare: Path

    def restore(self) -> None:
        """Put the second build back as it was, in its own place: compiled kernels are bound to their path."""
        shutil.rmtree(self.second.folder, ignore_errors=True)
        shutil.copytree(self.spare, self.second.folder)  # keeps file times, on which the compiled kernels depend


@pytest.fixture(scope="session")
def built(tmp_path_factory) -> Built:
    """Build the smoke size twice, as `marsedl verify` does; about six minutes on two cores."""
    import contextlib
    import io

    root = copy_tree(ROOT, tmp_path_factory.mktemp("pipeline") / "project")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        agree = build_twice(root)
    first, second = (Tree(root / "build" / "verify" / str(number)) for number in range(2))
    spare = root / "spare"
    shutil.copytree(second.folder, spare)
    return Built(agree, said.getvalue(), first, second, spare)


@pytest.fixture
def tree(built) -> Tree:
    """The second build as it was built."""
    built.restore()
    return Tree(built.second.folder)
