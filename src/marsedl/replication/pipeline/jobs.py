"""What every job of the workflow does around its science: load, save, and report failures."""

import contextlib
import errno
import os
import sys
import traceback
import typing
from collections.abc import Mapping
from pathlib import Path

from marsedl.replication.errors import MarsedlError, SolverError
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.numerics import assert_numerics
from marsedl.replication.pipeline.runner import computed

# Errors of the system that the code does not cause, with the remedy.
OUTSIDE = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space and run again"),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "change its permissions and run again"),
}


class Job:
    """One job of the workflow, from the `snakemake` object that its script is given."""

    def __init__(self, snakemake):
        """Take the job's description."""
        self.params = snakemake.params
        self.input = snakemake.input
        self.output = snakemake.output
        self.paper = snakemake.params.get("paper") or snakemake.wildcards.get("paper")
        self.reading = snakemake.params.get("reading") or snakemake.wildcards.get("reading")
        self._loaded: dict[tuple[str, type], object] = {}  # a file that readings share is loaded once

    def given(self, values: Mapping[str, object] | None = None) -> Arguments:
        """Return what the job's function can ask for: inputs, and artifacts from the job's input files.

        values: plain inputs by "section.name"; by default those of the job's params.
        """
        return self._given(self.params.made["inputs"] if values is None else values, dict(self.input.items()))

    def _given(self, values: Mapping[str, object], files: Mapping[str, str | list[str]]) -> Arguments:
        def load(name: str, kind: type) -> object:
            if name not in files:
                return None
            if name != "chunks":
                return self.load(files[name], kind)
            (of,), paths = typing.get_args(kind), files[name]
            return [self.load(path, of) for path in ([paths] if isinstance(paths, str) else paths)]

        return Arguments(values, load)

    def load(self, path: str, kind: type) -> object:
        """Return an artifact from one of the job's input files."""
        from marsedl.replication.records import store

        if (path, kind) not in self._loaded:
            paper, reading, _ = self._artifacts[path]
            self._loaded[path, kind] = store.load(path, kind, paper=paper, reading=reading)
        return self._loaded[path, kind]

    def run(self) -> None:
        """Compute each artifact of the stage, and save it; the params hold their recipes."""
        gathers = "chunks" in self.input.keys()  # noqa: SIM118
        for path, (_, _, recipe) in self._build["made"].items():
            flown = {} if gathers else recipe["options"]
            self.save(path, computed(self.params.entries, self.given(recipe["inputs"]), flown), recipe)

    def readings(self) -> dict[str, Arguments]:
        """Return what claims and tables over readings can ask for, by reading."""
        made = self.params.made
        return {reading: self._given(made["inputs"][reading], files) for reading, files in made["artifacts"].items()}

    def of_readings(self, function: typing.Callable) -> dict[str, tuple]:
        """Return the argument `readings` of a function: inputs and records by reading, of the types that it annotates.

        function: its parameter `readings` is annotated as `dict[str, tuple[Inputs, Records]]`.
        """
        _, pair = typing.get_args(typing.get_type_hints(function)["readings"])
        return {name: tuple(map(given.whole, typing.get_args(pair))) for name, given in self.readings().items()}

    def check_artifacts(self) -> None:
        """Reject input artifacts that their rules would now make differently; the params hold their recipes."""
        if not self._artifacts:
            return
        from marsedl.replication.records.store import check_recipe

        for path, (paper, reading, recipe) in self._artifacts.items():
            check_recipe(path, recipe, paper, reading)

    def check_libraries(self) -> None:
        """Raise MarsedlError if library versions differ from those that Snakemake planned with."""
        from marsedl.replication.pipeline.libraries import versions_used

        recipes = self.params.get("recipes") or [self.params.get("made", {})]
        planned = recipes[0].get("libraries", "")
        names = {item.partition(" ")[0] for item in planned.split(", ")} - {"", "python"}
        if planned and (present := versions_used(frozenset(names))) != planned:
            raise MarsedlError(
                f"the job would run with {present}, but was planned with {planned}: start snakemake in the environment "
                "in which its jobs run"
            )

    def save(self, path: str, artifact: object, recipe: Mapping[str, object]) -> None:
        """Save an artifact with its provenance: its recipe, the artifacts it was made from, the build's size."""
        from marsedl.replication.records import differences, store
        from marsedl.replication.records.recipes import recipe_digest

        provenance = {
            **recipe,
            "recipe": recipe_digest(recipe),
            "made_from": {Path(need).name: differences.digest(need) for need in self._artifacts},
            "size": self._build["size"],
        }
        store.save(path, artifact, paper=self.paper, reading=self.reading, provenance=provenance)

    @property
    def _artifacts(self) -> dict[str, tuple]:
        """Paper, reading and recipe of the job's input artifacts, by file."""
        return self._build.get("artifacts", {})

    @property
    def _build(self) -> dict[str, typing.Any]:
        """What the build knows of the job."""
        return self.params.get("build", {})

    def record(self) -> typing.Callable[[], None]:
        """Take back what the last run recorded of the job's products; returns the function that records this one."""
        if not self._build.get("record"):
            return lambda: None
        path, digest = self._build["record"]
        Path(path).unlink(missing_ok=True)

        def write() -> None:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(f"{digest}\n", encoding="ascii")

        return write


def _described(error: Exception, outputs: typing.Iterable[str]) -> tuple[str, bool]:
    """Return an error in one line, and whether it is an expected one, whose traceback would not help a user."""
    if isinstance(error, MarsedlError):
        return str(error), True
    if isinstance(error, OSError) and error.errno in OUTSIDE:
        where = error.filename or ", ".join(outputs)
        return f"{where}: cannot be written or read ({error.strerror}): {OUTSIDE[error.errno]}", True
    return f"{type(error).__name__}: {error}", False


def _kept_iterate(path: Path, iterate: dict) -> str:
    """Write a solver's last iterate beside the job's log; returns the words that say where."""
    import numpy as np

    try:
        np.savetxt(path, np.column_stack(list(iterate.values())), delimiter=",", header=",".join(iterate), comments="")
    except OSError as error:
        return f" (its last iterate could not be saved: {error.strerror})"
    return f" (its last iterate: {path})"


@contextlib.contextmanager
def guarded(snakemake) -> typing.Iterator[Job]:
    """Run a job's body: warnings and tracebacks go to its log; a failure prints one message that names job and log."""
    log = Path(snakemake.log[0])
    job = Job(snakemake)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text("")
        assert_numerics()
        job.check_libraries()
        job.check_artifacts()
        record = job.record()
        yield job
        record()
    except Exception as error:
        with contextlib.suppress(OSError):  # a full disk must not hide the error itself
            log.write_text(traceback.format_exc())
        root = Path(snakemake.scriptdir).resolve().parents[1]
        folder = os.path.relpath(Path.cwd(), root)  # of a size that is not the full one
        place = {"folder": "" if folder == "." else folder, "paper": job.paper, "reading": job.reading}
        place["job"] = snakemake.rule
        where = ", ".join(f"{what} {value}" for what, value in place.items() if value)
        what, foreseen = _described(error, snakemake.output)
        if not foreseen:
            traceback.print_exc()
        if isinstance(error, SolverError):
            what += _kept_iterate(log.with_suffix(".iterate.csv"), error.iterate)
        print(f"\n{where}: {what}\n(log: {Path(folder) / log})\n", file=sys.stderr)
        sys.exit(1)
