"""Where the results of a build are: its folder, its readings, and the files of its artifacts."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.readings import Reading, Study, load_study
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.fingerprints import SOURCE_ROOT
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.sizes import FULL, build_folder
from marsedl.words import remedy

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
        _check("there is no paper", paper, SLUGS)
        return load_study(paper, input_model(paper), self.project, self.size)

    def reading(self, paper: str, name: str) -> Reading:
        """Return a configured reading."""
        readings = self.study(paper).readings
        _check(f"{paper} has no reading", name, readings)
        return readings[name]

    def artifact(self, paper: str, stage: str, reading: str, case: str | None) -> Path:
        """Return the file of an artifact: that of the reading which shares it, where it is shared."""
        name, study = stage if case is None else f"{stage}.{case}", self.study(paper)
        path = own_file = self.folder / "data" / "cache" / paper / reading / f"{name}.h5"
        if reading in study.readings or not own_file.parent.is_dir():  # else of a configuration that is not available
            cases = [f"{FLIGHTS}.{case}" for case in self.reading(paper, reading).trial_counts()]
            stages = [stage for stage in catalogue(paper).stages if stage != FLIGHTS]
            shared = Shared(catalogue(paper), study)
            if not shared.has(reading, name) or name == FLIGHTS:
                raise _unknown(f"reading {reading} of {paper} has no artifact", name, [*stages, *cases])
            path = self.folder / shared.file(reading, name)
        found = next((file for file in (path, own_file) if file.exists()), None)
        if found is None:
            size = "" if self.size == FULL else f" --config size={self.size}"
            beside = ", ".join(sorted(other.stem for other in path.parent.glob("*.h5"))) or "nothing"
            target = path.relative_to(self.folder)
            raise InputError(f"{path} is not built; run 'snakemake {target}{size}'. Built beside it: {beside}")
        return found

    def table(self, paper: str, name: str, reading: str) -> Path:
        """Return the CSV file of a table; paper: its slug, or "comparison"."""
        if paper != COMPARISON:
            _check("there is no paper", paper, SLUGS)
        place = "" if reading == CORRECTED or paper == COMPARISON else reading
        path = self.folder / "figures" / paper / place / f"{name}.csv"
        if not path.exists():
            if tables := [other.stem for other in path.parent.glob("*.csv")]:
                raise _unknown(f"{path.parent} has no table", name, tables)
            raise InputError(f"{path.parent} holds no tables; run 'snakemake {path.relative_to(self.folder)}'")
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
        for project in (folder, *folder.parents, clone):
            if (project / "Snakefile").exists() and (project / "configs").is_dir():
                return Build(project, project, FULL)
        raise InputError(f"{folder} is not inside a marsedl project; change to one, or pass a folder as build=")
    project = folder.parent.parent
    of_size = [(project, folder.name)] if folder == build_folder(project, folder.name) else []
    for project, size in ((folder, FULL), *of_size, (clone, FULL)):
        if (project / "configs").is_dir():
            return Build(folder, project, size)
    raise InputError(f"{folder} has no configs/; copy the ones that it was built with into it")


def _check(what: str, name: str, names: Iterable[str]) -> None:
    if name not in names:
        raise _unknown(what, name, names)


def _unknown(what: str, name: str, names: Iterable[str]) -> InputError:
    """The error for a name that does not exist, with the nearest one and all of them."""
    return InputError(f"{what} {name!r}; {remedy(name, sorted(names))}")
