"""Where the results of a build are: its folder, its readings, and the files of its artifacts."""

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.readings import Reading, Study, load_study
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.fingerprints import SOURCE_ROOT
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder

COMPARISON = "comparison"  # of the papers: its tables stand beside theirs, and have no readings


@dataclass(frozen=True)
class Build:
    """A folder that holds results, and the project whose configuration they come from.

    Its methods raise InputError, which names what exists, for a paper, reading, artifact or table that does not.
    """

    folder: Path
    project: Path
    size: str

    def study(self, paper: str) -> Study:
        """Return a paper's readings."""
        if paper not in SLUGS:
            raise _unknown("there is no paper", paper, SLUGS)
        with contextlib.chdir(self.project):  # from where files named by inputs are read
            return load_study(paper, input_model(paper), Path("configs") / f"{paper}.yaml", size=self.size)

    def reading(self, paper: str, name: str) -> Reading:
        """Return a configured reading."""
        return _reading(self.study(paper), name)

    def artifact(self, paper: str, stage: str, reading: str, case: str | None) -> Path:
        """Return the file of an artifact: that of the reading which shares it, where it is shared."""
        name, study = stage if case is None else f"{stage}.{case}", self.study(paper)
        own_file = self.folder / "data" / "cache" / paper / reading / f"{name}.h5"
        if reading not in study.readings and own_file.parent.is_dir():  # of a configuration that is not available
            return self._existing(own_file)
        cases = [f"{FLIGHTS}.{case}" for case in _reading(study, reading).trial_counts()]
        shared = Shared(catalogue(paper), study)
        if not shared.has(reading, name) or name == FLIGHTS:
            stages = [stage for stage in catalogue(paper).stages if not stage.startswith(FLIGHTS)]
            raise _unknown(f"reading {reading} of {paper} has no artifact", name, [*stages, *cases])
        path = self.folder / shared.file(reading, name)
        return own_file if own_file.exists() and not path.exists() else self._existing(path)

    def _existing(self, path: Path) -> Path:
        """The path if there is such a file; InputError naming the others beside it if not."""
        if path.exists():
            return path
        size = "" if self.size == FULL else f" --config size={self.size}"
        beside = ", ".join(sorted(other.stem for other in path.parent.glob("*.h5"))) or "nothing"
        target = path.relative_to(self.folder)
        raise InputError(f"{path} is not built; run 'snakemake {target}{size}'. Built beside it: {beside}")

    def table(self, paper: str, name: str, reading: str) -> Path:
        """Return the CSV file of a table; paper: its slug, or "comparison"."""
        if paper not in (*SLUGS, COMPARISON):
            raise _unknown("there is no paper", paper, SLUGS)
        place = "" if reading == CORRECTED or paper == COMPARISON else reading
        path = self.folder / "figures" / paper / place / f"{name}.csv"
        if not path.exists():
            if tables := [other.stem for other in path.parent.glob("*.csv")]:
                raise _unknown(f"{path.parent} has no table", name, tables)
            target = path.relative_to(self.folder).as_posix()
            raise InputError(f"{path.parent} holds no tables; run 'snakemake {target}'")
        return path


def find(build: str | Path | None = None) -> Build:
    """Return the build in a folder; by default in the current one if that holds a build, else the project's.

    Its configuration is in the folder, or in the project that it is a build of (build/<size>), or else that of the
    clone which this package is imported from.

    Raises InputError if the folder does not exist, or if no project or configuration is found.
    """
    folder, clone = Path.cwd() if build is None else Path(build).absolute(), SOURCE_ROOT.parent
    if not folder.is_dir():
        raise InputError(f"{build}: there is no such folder; name one in which report/ or data/cache/ was built")
    if build is None and not (folder / "report" / "claims.json").exists() and not (folder / "data" / "cache").is_dir():
        projects = (other for other in (folder, *folder.parents, clone) if (other / "Snakefile").exists())
        project = next(filter(_has_configuration, projects), None)
        if project is None:
            raise InputError(f"{folder} is not inside a marsedl project; change to one, or pass a folder as build=")
        folder = project
    project, size = folder, FULL
    if not _has_configuration(folder):
        project = folder.parent.parent
        is_size = _has_configuration(project) and build_folder(project, folder.name) == folder
        project, size = (project, folder.name) if is_size else (clone, FULL)
    if not _has_configuration(project):
        raise InputError(f"{folder} has no configs/; copy the ones that it was built with into it")
    return Build(folder, project, size)


def _reading(study: Study, name: str) -> Reading:
    if name not in study.readings:
        raise _unknown(f"{study.paper} has no reading", name, study.readings)
    return study.readings[name]


def _has_configuration(folder: Path) -> bool:
    return (folder / "configs").is_dir()


def _unknown(what: str, name: str, names: Iterable[str]) -> InputError:
    """The error for a name that does not exist, with the nearest one and all of them."""
    names = sorted(names)
    hint = nearest(name, names)
    more = f" There are: {', '.join(names)}" if hint.startswith("did you mean") else ""
    return InputError(f"{what} {name!r}; {hint}{more}")
