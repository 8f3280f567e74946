"""What every job of the workflow does around its science: pin the numerics, load, save, and report failures."""

import contextlib
import errno
import os
import sys
import traceback
import types
import typing
from pathlib import Path

from marsedl.replication.errors import MarsedlError, SolverError

# One thread per job, one instruction set for linear algebra and array code: the same numbers on every run.
NUMERIC_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "SOURCE_DATE_EPOCH": "1502928000",
    "MPLBACKEND": "agg",
}
# What of it, and beside it, says which instructions are used. It is not pinned if UNPINNED is set, so that this machine
# can pretend to be another one, see replication/machines.py; threads, seeds and dates are pinned all the same.
INSTRUCTION_SETS = (
    *("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES"),
    *("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "GLIBC_TUNABLES"),
)
UNPINNED = "MARSEDL_UNPINNED"
_OF_THIS_PROJECT = ("PYTHONHASHSEED", "NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES")
# Errors of the system that are no fault of the code, with what to do.
OUTSIDE = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space and run again"),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "give yourself permission to write there and run again"),
}


def pin_numerics(root: Path) -> None:
    """Set the numeric environment of this process and its children; call it before numpy is imported.

    root: the project's folder, which also holds the cache of compiled kernels.
    """
    from marsedl.replication import kernels
    from marsedl.replication.code_digest import remembered_digests

    if not os.environ.get(UNPINNED):
        for name in INSTRUCTION_SETS:  # what the pinned ones leave open is not for the caller's shell to say
            os.environ.pop(name, None)
    os.environ.update(_pinned())
    os.environ.setdefault("PYTHONHASHSEED", "0")
    source = remembered_digests(root).source(kernels.NO_KERNELS)
    os.environ["NUMBA_CACHE_DIR"] = str(kernels.cache_folder(root, source))
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = kernels.LOCATOR
    os.environ["MPLCONFIGDIR"] = str(root / ".cache" / "matplotlib")


def assert_numerics() -> None:
    """Raise MarsedlError if this process was started without the pinned numeric environment."""
    unset = [name for name, value in _pinned().items() if os.environ.get(name) != value]
    unset += [name for name in _OF_THIS_PROJECT if name not in os.environ]
    if unset:
        raise MarsedlError(f"the numeric environment is not pinned ({', '.join(unset)}); start jobs through snakemake")


def pretended_machine() -> str:
    """Return the instruction sets that this process was given in place of the pinned ones; empty if they are pinned."""
    if not os.environ.get(UNPINNED):
        return ""
    given = [f"{name}={os.environ[name]}" for name in INSTRUCTION_SETS if name in os.environ]
    return "; ".join(given) or "this machine's own"


def _pinned() -> dict[str, str]:
    """The variables that have to have a fixed value."""
    free = INSTRUCTION_SETS if os.environ.get(UNPINNED) else ()
    return {name: value for name, value in NUMERIC_ENVIRONMENT.items() if name not in free}


class Slice(types.SimpleNamespace):
    """The inputs that a stage declared, as numbers, strings and arrays; any other input is an error."""

    def __init__(self, values: dict):
        """Take the plain values of `Reading.slice`."""
        import numpy as np

        super().__init__(**{k: np.array(v, float) if isinstance(v, list | tuple) else v for k, v in values.items()})

    def __getattr__(self, name):
        """Refuse an input that was not declared."""
        raise AttributeError(f"the input '{name}' is not declared for this stage: add it to the paper's catalogue")


class Job:
    """One job of the workflow, from the `snakemake` object that its script is given."""

    def __init__(self, snakemake):
        """Take the job's description."""
        self.params = snakemake.params
        self.input = snakemake.input
        self.output = snakemake.output
        self.paper = snakemake.params.get("paper") or snakemake.wildcards.get("paper")
        self.reading = snakemake.params.get("reading") or snakemake.wildcards.get("reading")

    @property
    def inputs(self):
        """The typed inputs that the job declared."""
        return Slice(self.params.inputs)

    def arguments(self, function: typing.Callable) -> dict:
        """Load the artifacts of the job's input files, by the types that the function's parameters are annotated with.

        A parameter annotated with a list takes several files; one with a default is left out where no file is named.
        """
        from marsedl.replication import artifacts

        hints = typing.get_type_hints(function)
        loaded = {}
        for name, paths in self.input.items():
            kind = hints[name]
            if typing.get_origin(kind) is list:
                paths = [paths] if isinstance(paths, str) else paths
                kind = typing.get_args(kind)[0]
                loaded[name] = [artifacts.load(p, kind, paper=self.paper, reading=self.reading) for p in paths]
            else:
                loaded[name] = artifacts.load(paths, _kind(kind), paper=self.paper, reading=self.reading)
        return loaded

    def readings(self, function: typing.Callable) -> dict[str, tuple]:
        """Load the inputs and artifacts of all readings, for a function over them; both are listed in the params."""
        return {
            reading: (Slice(self.params.inputs[reading]), load_arguments(function, paths, self.paper, reading))
            for reading, paths in self.params.artifacts.items()
        }

    def check_artifacts(self) -> None:
        """Refuse input artifacts that their rules would make otherwise now; the params hold their recipes."""
        if not self._artifacts:
            return
        from marsedl.replication.artifacts import check_recipe

        for path, (paper, reading, recipe) in self._artifacts.items():
            check_recipe(path, recipe, paper, reading)

    def check_libraries(self) -> None:
        """Refuse to run with libraries of other versions than those that Snakemake planned with."""
        from marsedl.replication.libraries import versions_used

        planned = self.params.get("libraries", "")
        names = {item.partition(" ")[0] for item in planned.split(", ")} - {"", "python"}
        if planned and (found := versions_used(frozenset(names))) != planned:
            raise MarsedlError(
                f"the job would run with {found}, but was planned with {planned}: start snakemake in the environment "
                "in which its jobs run"
            )

    def save(self, artifact: object) -> None:
        """Save the job's artifact with its provenance: its recipe, the artifacts it was made from, the build's size."""
        from marsedl.replication import artifacts, digests
        from marsedl.replication.recipes import recipe_digest

        recipe = {
            "inputs": self.params.inputs,
            "options": self.params.get("options", {}),
            "code": self.params.code,
            "libraries": self.params.libraries,
            "needs": {Path(path).name: recipe_digest(recipe) for path, (_, _, recipe) in self._artifacts.items()},
        }
        provenance = {
            **recipe,
            "recipe": recipe_digest(recipe),
            "made_from": {Path(path).name: digests.digest(path) for path in self._artifacts},
            "size": self.params.build["size"],
        }
        artifacts.save(self.output[0], artifact, paper=self.paper, reading=self.reading, provenance=provenance)

    @property
    def _artifacts(self) -> dict[str, tuple]:
        """Paper, reading and recipe of the job's input artifacts, by file."""
        return self.params.get("build", {}).get("artifacts", {})


def load_arguments(function: typing.Callable, files: typing.Mapping[str, str], paper: str, reading: str) -> dict:
    """Load artifacts by the types that a function's parameters are annotated with.

    Args:
        function: what they are for.
        files: artifact files by the name of the parameter.
        paper: the paper that they are of.
        reading: the reading that they are of.

    Returns:
        The function's arguments by name.

    Raises:
        ArtifactError: a file is missing, damaged or of another paper, reading or type.

    """
    from marsedl.replication import artifacts

    hints = typing.get_type_hints(function)
    return {
        name: artifacts.load(path, _kind(hints[name]), paper=paper, reading=reading) for name, path in files.items()
    }


def replay(folder: Path, paper, reading, case: str, number: int, module, options: str = "") -> str:
    """Fly one trial of a Monte Carlo case again and describe it; compares it with the ensemble if that is stored.

    folder: of the build. paper, reading: catalogue and reading. case, number: the case and its trial. module: the
    paper's `montecarlo`, whose `replay` does it. options: those of Snakemake with which a missing artifact is built.
    Raises InputError for a case or trial that the reading does not have, or if an artifact is missing.
    """
    from marsedl.replication import artifacts
    from marsedl.replication.errors import InputError
    from marsedl.replication.inputs import nearest

    trials = {name: getattr(reading.inputs, field) for name, field in reading.inputs.CASES.items()}
    if not trials.get(case):
        raise InputError(
            f"reading {reading.name} has no case '{case}'; {nearest(case, [c for c, n in trials.items() if n])}"
        )
    if not 0 <= number < trials[case]:
        raise InputError(f"trial {number}: case {case} has the trials 0 to {trials[case] - 1}")
    cache = Path("data") / "cache" / paper.slug / reading.name
    needed = paper.stages["montecarlo"].needs
    hints = typing.get_type_hints(module.replay)
    loaded = {}
    for name in needed:
        path = folder / cache / f"{name}.h5"
        if not path.exists():
            raise InputError(f"{path} is not built yet; run 'snakemake {cache / path.name}{options}' first")
        loaded[name] = artifacts.load(path, hints[name], paper=paper.slug, reading=reading.name)
    stored = folder / cache / f"montecarlo.{case}.h5"
    kind = _kind(hints["ensemble"])
    ensemble = artifacts.load(stored, kind, paper=paper.slug, reading=reading.name) if stored.exists() else None
    if ensemble is not None and number >= ensemble.outcome.shape[-1]:  # of fewer trials than the reading now has
        ensemble = None
    inputs = Slice(reading.slice(paper.stages["montecarlo"].inputs))
    return module.replay(inputs, **loaded, case=case, number=number, ensemble=ensemble)


def _kind(annotation):
    """The artifact type of an annotation that may allow None."""
    return next((kind for kind in typing.get_args(annotation) if kind is not type(None)), annotation)


def _described(error: Exception, outputs: typing.Iterable[str]) -> tuple[str, bool]:
    """Return an error in one line, and whether it was foreseen, so that its traceback tells a user nothing more."""
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
        return f" (its last iterate could not be kept: {error.strerror})"
    return f" (its last iterate: {path})"


@contextlib.contextmanager
def guarded(snakemake) -> typing.Iterator[Job]:
    """Run a job's body: warnings and tracebacks go to its log, a failure ends in one message that names job and log."""
    log = Path(snakemake.log[0])
    job = Job(snakemake)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text("")
        assert_numerics()
        job.check_libraries()
        job.check_artifacts()
        yield job
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
