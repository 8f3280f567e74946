"""Where the results of a build are: its folder, its readings, and the files of its artifacts."""

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.catalogue import FLIGHTS
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.fingerprints import SOURCE_ROOT
from marsedl.replication.inputs import Reading, Study, load_study
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder

CORRECTED = "corrected"


@dataclass(frozen=True)
class Build:
    """A folder that holds results, and the project whose configuration they come from."""

    folder: Path
    project: Path
    size: str

    def of_paper(self, paper: str) -> "PaperResults":
        """Return what the build holds of a paper. Raises InputError if there is no such paper."""
        if paper not in SLUGS:
            raise unknown("there is no paper", paper, SLUGS)
        return PaperResults(self, paper)


@dataclass(frozen=True)
class PaperResults:
    """What a build holds of a paper."""

    build: Build
    paper: str

    @cached_property
    def study(self) -> Study:
        """The paper's readings. Raises InputError if the configuration is wrong."""
        with contextlib.chdir(self.build.project):  # from where files named by inputs are read
            path = Path("configs") / f"{self.paper}.yaml"
            return load_study(self.paper, input_model(self.paper), path, size=self.build.size)

    @property
    def _cache(self) -> Path:
        return self.build.folder / "data" / "cache" / self.paper

    def reading(self, name: str) -> Reading:
        """Return a configured reading. Raises InputError if there is none of this name."""
        if name not in self.study.readings:
            raise unknown(f"{self.paper} has no reading", name, self.study.readings)
        return self.study.readings[name]

    def file(self, stage: str, reading: str, case: str | None) -> Path:
        """Return the file of an artifact: that of the reading which shares it, where it is shared.

        Raises InputError naming what exists if there is no such stage, case or reading, or if it is not built.
        """
        name = stage if case is None else f"{stage}.{case}"
        own_file = self._cache / reading / f"{name}.h5"
        if reading not in self.study.readings and own_file.parent.is_dir():  # of a configuration that is not available
            return self._existing(own_file)
        self.reading(reading)
        shared = Shared(catalogue(self.paper), self.study)
        if not shared.has(reading, name) or name == FLIGHTS:
            raise unknown(f"reading {reading} of {self.paper} has no artifact", name, self._artifacts(shared, reading))
        path = self.build.folder / shared.file(reading, name)
        return own_file if own_file.exists() and not path.exists() else self._existing(path)

    def _artifacts(self, shared: Shared, reading: str) -> list[str]:
        """Names of all artifacts of a reading."""
        stages = [name for name in catalogue(self.paper).stages if not name.startswith(FLIGHTS)]
        cases = self.study.readings[reading].trial_counts() if reading in self.study.readings else ()
        return [name for name in (*stages, *(f"{FLIGHTS}.{case}" for case in cases)) if shared.has(reading, name)]

    def _existing(self, path: Path) -> Path:
        """The path if there is such a file; InputError naming the others beside it if not."""
        if path.exists():
            return path
        size = "" if self.build.size == FULL else f" --config size={self.build.size}"
        beside = ", ".join(sorted(other.stem for other in path.parent.glob("*.h5"))) or "nothing"
        target = path.relative_to(self.build.folder)
        raise InputError(f"{path} is not built; run 'snakemake {target}{size}'. Built beside it: {beside}")

    def table_file(self, name: str, reading: str) -> Path:
        """Return the CSV file of a table. Raises InputError naming those that exist if it is not built."""
        return table_file(self.build, self.paper, name, "" if reading == CORRECTED else reading)


def table_file(build: Build, folder: str, name: str, reading: str = "") -> Path:
    """Return a CSV file of a folder of figures. Raises InputError naming those that exist."""
    path = build.folder / "figures" / folder / reading / f"{name}.csv"
    if not path.exists():
        tables = sorted(other.stem for other in path.parent.glob("*.csv"))
        if not tables:
            target = path.relative_to(build.folder).as_posix()
            raise InputError(f"{path.parent} holds no tables; run 'snakemake {target}'")
        raise unknown(f"{path.parent} has no table", name, tables)
    return path


def find(build: str | Path | None = None) -> Build:
    """Return the build in a folder; by default in the current one if that holds a build, else the project's.

    Raises InputError if the folder does not exist, or if no project is found.
    """
    current = Path.cwd()
    if build is not None:
        folder = Path(build).absolute()
        if not folder.is_dir():
            raise InputError(f"{build}: there is no such folder; name one in which report/ or data/cache/ was built")
    elif _holds_results(current):
        folder = current
    else:
        folder = next((f for f in (current, *current.parents, SOURCE_ROOT.parent) if _is_project(f)), None)
        if folder is None:
            raise InputError(f"{current} is not inside a marsedl project; change to one, or pass a folder as build=")
    if _has_configuration(folder):
        return Build(folder, folder, FULL)
    parents = (other for other in folder.parents if _has_configuration(other))
    project = next((other for other in parents if build_folder(other, folder.name) == folder), None)
    if project is not None:
        return Build(folder, project, folder.name)
    if not _has_configuration(SOURCE_ROOT.parent):
        raise InputError(f"{folder} has no configs/; copy the ones that it was built with into it")
    return Build(folder, SOURCE_ROOT.parent, FULL)


def unknown(what: str, name: str, names: Iterable[str]) -> InputError:
    """Return the error for a name that does not exist, with the nearest one and all of them."""
    names = sorted(names)
    hint = nearest(name, names)
    more = f" There are: {', '.join(names)}" if hint.startswith("did you mean") else ""
    return InputError(f"{what} {name!r}; {hint}{more}")


def _holds_results(folder: Path) -> bool:
    return (folder / "report" / "claims.json").exists() or (folder / "data" / "cache").is_dir()


def _has_configuration(folder: Path) -> bool:
    return (folder / "configs").is_dir()


def _is_project(folder: Path) -> bool:
    return _has_configuration(folder) and (folder / "Snakefile").exists()
