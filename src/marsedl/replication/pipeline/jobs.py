"""What every job of the workflow does around its science: load, save, and report failures."""

import contextlib
import logging
import os
import sys
import traceback
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path

from marsedl.replication.errors import NOTES, MarsedlError, SolverError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.numerics import assert_numerics
from marsedl.replication.pipeline.runner import computed
from marsedl.replication.pipeline.sharing import artifact_of
from marsedl.replication.records.recipes import write_record


class Job:
    """One job, from the `snakemake` object that its script is given.

    `params` are what it is given beside files, as `pipeline/products.py` has them.
    """

    def __init__(self, snakemake):
        """Take the job's description."""
        self.params, self.input, self.output = snakemake.params.given, snakemake.input, snakemake.output
        wildcards = dict(snakemake.wildcards.items())
        if "place" in wildcards:  # of a figure or table
            wildcards["reading"] = wildcards["place"].strip("/") or CORRECTED
        self.paper, self.reading = wildcards.get("paper"), wildcards.get("reading")
        self._loaded: dict[tuple[str, type], object] = {}  # a file that readings share is loaded once

    def given(self, values: Mapping[str, object] | None = None, files: Mapping[str, str] | None = None) -> Arguments:
        """Return what the job's function can ask for: inputs and artifacts.

        Args:
            values: plain inputs by "section.name"; those that the product is made from unless given.
            files: artifacts by the name of the parameter; the job's input unless given.

        """
        paths = {parameter_of(path): path for path in self.input.artifacts} if files is None else files

        def load(name: str, kind: type) -> object:
            if name == "chunks":
                return [self.load(path, *typing.get_args(kind)) for path in self.input.chunks]
            return self.load(paths[name], kind) if name in paths else None

        return Arguments(self.params["inputs"] if values is None else values, load)

    def load(self, path: str, kind: type) -> typing.Any:
        """Return an artifact of a file."""
        from marsedl.replication.records import store

        if (path, kind) not in self._loaded:
            paper, reading, _ = artifact_of(path)
            self._loaded[path, kind] = store.load(path, kind, paper=paper, reading=reading)
        return self._loaded[path, kind]

    def run(self) -> None:
        """Compute each artifact of a stage, and save it with its provenance."""
        from marsedl.replication.records import store
        from marsedl.replication.records.recipes import recipe_digest

        for path, recipe in zip(self.output, self.params["recipes"], strict=True):
            entries, options = self.params["entries"], recipe["options"]
            if "chunk" in options:
                entries = entries[:1]
            elif self.input.get("chunks"):
                entries = entries[1:]
            artifact = computed(entries, self.given(recipe["inputs"]), options)
            provenance = {"recipe": recipe_digest(recipe), "size": self.params["size"]}
            store.save(path, artifact, paper=self.paper, reading=self.reading, provenance=recipe | provenance)

    def readings(self) -> dict[str, Arguments]:
        """Return what claims can ask for, by reading."""
        files, inputs = self.params["artifacts"], self.params["inputs"]
        return {reading: self.given(inputs[reading], files[reading]) for reading in inputs}

    def check_libraries(self) -> None:
        """Raise MarsedlError if library versions differ from those that Snakemake planned with."""
        from marsedl.replication.pipeline.libraries import versions_used

        planned = self.params.get("recipes", [self.params])[0].get("libraries", "")
        names = {item.partition(" ")[0] for item in planned.split(", ")} - {"", "python"}
        if planned and (present := versions_used(frozenset(names))) != planned:
            raise MarsedlError(
                f"the job would run with {present}, but was planned with {planned}: start snakemake in the environment "
                "in which its jobs run"
            )


def parameter_of(path: str) -> str:
    """Return the name of the parameter that takes an artifact: its stage's or Monte Carlo case's."""
    return Path(path).stem.rpartition(".")[2]


@contextlib.contextmanager
def guarded(snakemake) -> Iterator[Job]:
    """Run a job's body: a failure prints one message that names job and log, which gets the traceback and it."""
    log, job = Path(snakemake.log[0]), Job(snakemake)
    notes = logging.getLogger(NOTES)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text("")
        # What a reading of the project does is known, and can be read in the log; a user is told of their own.
        notes.addHandler(logging.StreamHandler() if job.params.get("users") else logging.NullHandler())
        notes.addHandler(logging.FileHandler(log, encoding="utf-8", delay=True))
        assert_numerics()
        job.check_libraries()
        yield job
        # What the products are made from is recorded when the job ends. A killed job leaves files that are not those
        # of the record.
        if "record" in job.params:
            write_record(*job.params["record"], snakemake.output)
    except Exception as error:
        folder = os.path.relpath(Path.cwd(), Path(snakemake.scriptdir).resolve().parents[1])
        place = {"folder": "" if folder == "." else folder, "paper": job.paper, "reading": job.reading, "job": log.stem}
        where = ", ".join(f"{what} {value}" for what, value in place.items() if value)
        message = f"\n{where}: {_described(error, snakemake)}\n(log: {Path(folder) / log})\n"
        with contextlib.suppress(OSError):  # a full disk must not hide the error itself
            log.write_text(f"{traceback.format_exc()}{message}", encoding="utf-8")
        print(message, file=sys.stderr)
        sys.exit(1)
    finally:
        notes.handlers.clear()


def failure(log: Path) -> str:
    """Return the message of a failed job, the last paragraph of its log; empty if it wrote none."""
    return log.read_text(encoding="utf-8").rpartition("\n\n")[2] if log.exists() else ""


def _described(error: Exception, snakemake) -> str:
    """An error in one line; prints the traceback of one that is not expected."""
    if isinstance(error, SolverError) and error.iterate:
        return f"{error}{_kept_iterate(Path(snakemake.log[0]).with_suffix('.iterate.csv'), error.iterate)}"
    if isinstance(error, MarsedlError | OSError):  # a full disk, say, whose message names the file
        return str(error)
    traceback.print_exc()
    return f"{type(error).__name__}: {error}"


def _kept_iterate(path: Path, iterate: dict) -> str:
    """Write a solver's last iterate beside the job's log; returns the words that say where."""
    import numpy as np

    try:
        np.savetxt(path, np.column_stack(list(iterate.values())), delimiter=",", header=",".join(iterate), comments="")
    except OSError as error:
        return f" (its last iterate could not be saved: {error.strerror})"
    return f" (its last iterate: {path})"
