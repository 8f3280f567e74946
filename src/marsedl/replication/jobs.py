"""What every job of the workflow does around its science: pin the numerics, load, save, and report failures."""

import contextlib
import errno
import functools
import inspect
import os
import sys
import traceback
import typing
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from marsedl.replication.catalogue import FLIGHTS, Artifacts, Flown, Trial
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
    "PYDANTIC_DISABLE_PLUGINS": "__all__",
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
    if not os.environ.get(UNPINNED) and (features := kernels.vector_features()):
        os.environ["NUMBA_CPU_FEATURES"] = features
    os.environ["NUMBA_CACHE_DIR"] = str(kernels.cache_folder(root, remembered_digests(root).kernels()))
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


def given(function: typing.Callable, inputs: Mapping[str, object], artifact: typing.Callable, **others) -> dict:
    """Return what a stage, figure, table or claim asks for by its signature.

    Args:
        function: which is asked.
        inputs: plain values by "section.name"; a section has no others.
        artifact: function of an artifact's name and type, that returns it, or None for one that there is not; then the
            function's own default is used.
        others: further arguments, used if the function has parameters of these names.

    Returns:
        Its arguments by name, without keyword-only ones.

    """
    from marsedl.replication.sections import Inputs, Section, by_section

    sections, hints, arguments = by_section(inputs), typing.get_type_hints(function), {}
    for name, parameter in inspect.signature(function).parameters.items():
        kind = hints.get(name)
        if parameter.kind is parameter.KEYWORD_ONLY:
            continue
        if name in others:
            arguments[name] = others[name]
        elif _is(kind, Section):
            arguments[name] = kind.given(sections.get(name, {}))
        elif _is(kind, Inputs):
            arguments[name] = kind.given(inputs)
        elif _is(kind, Artifacts):
            records = {f: artifact(f, _kind(of)) for f, of in typing.get_type_hints(kind).items()}
            arguments[name] = kind(**{f: record for f, record in records.items() if record is not None})
        elif (record := artifact(name, _kind(kind))) is not None:
            arguments[name] = record
    return arguments


def computed(entries: typing.Iterable[str], give: typing.Callable, options: Mapping[str, object]) -> object:
    """Return what a stage computes.

    Args:
        entries: its functions, "package.module:function"; what one returns, the next one gathers.
        give: function of a function and of further arguments, that returns its arguments, see `given`.
        options: of a stage that flies trials, which ones: fields of `Flown`.

    """
    first, *following = (getattr(import_module(module), name) for module, name in (e.split(":") for e in entries))
    record = first(**give(first), **({"flown": Flown(**options)} if options else {}))
    for function in following:
        record = function(**give(function, chunks=[record]))
    return record


def record_type(entries: typing.Sequence[str]) -> type:
    """Return the type of what a stage computes."""
    module, name = entries[-1].split(":")
    return typing.get_type_hints(getattr(import_module(module), name))["return"]


def whole_case(case: str, trials: int, paper) -> dict[str, object]:
    """Return the options of a stage that flies a whole Monte Carlo case."""
    return {"case": case, "trials": trials, "block_size": paper.trials_per_block}


class Job:
    """One job of the workflow, from the `snakemake` object that its script is given."""

    def __init__(self, snakemake):
        """Take the job's description."""
        self.params = snakemake.params
        self.input = snakemake.input
        self.output = snakemake.output
        self.paper = snakemake.params.get("paper") or snakemake.wildcards.get("paper")
        self.reading = snakemake.params.get("reading") or snakemake.wildcards.get("reading")
        self._loaded: dict[str, object] = {}  # a file that readings share is loaded once

    def given(self, function: typing.Callable, inputs: Mapping[str, object] | None = None, **others) -> dict:
        """Return the function's arguments: sections, and artifacts from the job's input files, see `given`.

        inputs: plain values by "section.name"; by default those of the job's params.
        """
        if chunks := self.input.get("chunks"):
            kind = typing.get_args(typing.get_type_hints(function)["chunks"])[0]
            others["chunks"] = [self.load(path, kind) for path in ([chunks] if isinstance(chunks, str) else chunks)]
        files = dict(self.input.items())
        return given(
            function,
            self.params.inputs if inputs is None else inputs,
            lambda name, kind: self.load(files[name], kind) if name in files else None,
            **others,
        )

    def load(self, path: str, kind: type) -> object:
        """Return an artifact from one of the job's input files."""
        from marsedl.replication import artifacts

        if path not in self._loaded:
            paper, reading, _ = self._artifacts[path]
            self._loaded[path] = artifacts.load(path, kind, paper=paper, reading=reading)
        return self._loaded[path]

    def published(self) -> dict[str, dict]:
        """Return the printed claims by id, as the argument `published`; nothing if the job shows none."""
        from marsedl.replication.claims import load_published

        if not self.params.printed:
            return {}
        return {"published": {claim.id: claim for claim in load_published(self.params.published)}}

    def run(self) -> None:
        """Compute each artifact of the stage, and save it; the params hold their recipes."""
        for path, recipe in zip(self.output, self.params.recipes, strict=True):
            give = functools.partial(self.given, inputs=recipe["inputs"])
            self.save(path, computed(self.params.entries, give, recipe["options"]), recipe)

    def readings(self, function: typing.Callable, **others) -> dict[str, dict]:
        """Return the arguments of a function over all readings, by reading; inputs and files are in the params."""

        def of(reading: str) -> dict:
            files = self.params.artifacts[reading]

            def load(name: str, kind: type) -> object:
                return self.load(files[name], kind) if name in files else None

            return given(function, self.params.inputs[reading], load, **others)

        return {reading: of(reading) for reading in self.params.artifacts}

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

        recipes = self.params.get("recipes", [self.params])
        planned = recipes[0].get("libraries", "")
        names = {item.partition(" ")[0] for item in planned.split(", ")} - {"", "python"}
        if planned and (found := versions_used(frozenset(names))) != planned:
            raise MarsedlError(
                f"the job would run with {found}, but was planned with {planned}: start snakemake in the environment "
                "in which its jobs run"
            )

    def save(self, path: str, artifact: object, recipe: Mapping[str, object]) -> None:
        """Save an artifact with its provenance: its recipe, the artifacts it was made from, the build's size."""
        from marsedl.replication import artifacts, digests
        from marsedl.replication.recipes import recipe_digest

        needs = {Path(need).name: recipe_digest(made) for need, (_, _, made) in self._artifacts.items()}
        recipe = {**recipe, "needs": needs}
        provenance = {
            **recipe,
            "recipe": recipe_digest(recipe),
            "made_from": {Path(need).name: digests.digest(need) for need in self._artifacts},
            "size": self.params.build["size"],
        }
        artifacts.save(path, artifact, paper=self.paper, reading=self.reading, provenance=provenance)

    @property
    def _artifacts(self) -> dict[str, tuple]:
        """Paper, reading and recipe of the job's input artifacts, by file."""
        return self.params.get("build", {}).get("artifacts", {})


def replay(folder: Path, paper, study, reading: str, trial: tuple[str, int], module, options: str = "") -> str:
    """Fly one trial of a Monte Carlo case again and describe it; compares it with the ensemble if that is stored.

    Args:
        folder: of the build.
        paper: the catalogue.
        study: the paper's readings.
        reading: the reading's name.
        trial: the case, and the trial's number in it.
        module: the paper's `montecarlo`, whose `replay` does it.
        options: those of Snakemake with which a missing artifact is built.

    Raises:
        InputError: for a case or trial that the reading does not have, or if an artifact is missing.

    """
    from marsedl.replication import artifacts
    from marsedl.replication.errors import InputError, nearest
    from marsedl.replication.sharing import Shared

    case, number = trial
    inputs, trials, shared = study.readings[reading].inputs, study.readings[reading].flown(), Shared(paper, study)
    if not trials.get(case):
        raise InputError(f"reading {reading} has no case '{case}'; {nearest(case, trials)}")
    if not 0 <= number < trials[case]:
        raise InputError(f"trial {number}: case {case} has the trials 0 to {trials[case] - 1}")

    def load(name: str, kind: type) -> object:
        path = shared.file(reading, name)
        if not (folder / path).exists():
            raise InputError(f"{folder / path} is not built yet; run 'snakemake {path}{options}' first")
        return artifacts.load(folder / path, kind, paper=paper.slug, reading=shared.owner(reading, name))

    arguments = given(module.replay, inputs.plain(), load)
    ensemble, stored = None, f"{FLIGHTS}.{case}"
    if (folder / shared.file(reading, stored)).exists():
        ensemble = load(stored, typing.get_type_hints(module.gather)["return"])
        if number >= ensemble.outcome.shape[-1]:  # of fewer trials than the reading now has
            ensemble = None
    return module.replay(**arguments, trial=Trial(case, number, ensemble))


def _is(kind: object, of: type) -> bool:
    return isinstance(kind, type) and issubclass(kind, of)


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
