"""What every job of the workflow does around its science: pin the numerics, load, save, and report failures."""

import contextlib
import errno
import functools
import inspect
import os
import platform
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
# Variables beside these that choose instruction sets or the way kernels are compiled: a shell's do not reach jobs.
_OF_A_SHELL = ("NPY_ENABLE_CPU_FEATURES", "GLIBC_TUNABLES")
_OF_THIS_PROJECT = ("PYTHONHASHSEED", "NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES")
# Errors of the system that the code does not cause, with the remedy.
OUTSIDE = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space and run again"),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "change its permissions and run again"),
}


def pin_numerics(root: Path) -> None:
    """Set the numeric environment of this process and its children; call it before numpy is imported.

    root: the project's folder, which also holds the cache of compiled kernels.

    Raises MarsedlError if this processor cannot run the pinned instruction set, or if a file has settings of numba.
    """
    from marsedl.replication import kernels
    from marsedl.replication.fingerprints import fingerprints_of

    _check_processor()
    if Path(".numba_config.yaml").exists():
        raise MarsedlError(f"{Path('.numba_config.yaml').absolute()}: numba would read it in every job; move it away")
    for name in [name for name in os.environ if name.startswith("NUMBA_") or name in _OF_A_SHELL]:
        del os.environ[name]
    os.environ.update(NUMERIC_ENVIRONMENT)
    os.environ.setdefault("PYTHONHASHSEED", "0")
    if features := kernels.vector_features():
        os.environ["NUMBA_CPU_FEATURES"] = features
    os.environ["NUMBA_CACHE_DIR"] = str(kernels.cache_folder(root, fingerprints_of(root).kernels()))
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = kernels.LOCATOR
    os.environ["MPLCONFIGDIR"] = str(root / ".cache" / "matplotlib")


def _check_processor() -> None:
    """Raise MarsedlError if this processor lacks what OpenBLAS's pinned kernels use: it would end with SIGILL."""
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    if platform.machine() == "x86_64" and not (features.get("avx2") and features.get("fma")):
        raise MarsedlError(
            "this processor, or the virtual machine's, has no AVX2 and FMA, which linear algebra is pinned to: run on "
            "one that has, or let the virtual machine pass on its host's processor"
        )


def assert_numerics() -> None:
    """Raise MarsedlError if this process was started without the pinned numeric environment."""
    unset = [name for name, value in NUMERIC_ENVIRONMENT.items() if os.environ.get(name) != value]
    unset += [name for name in _OF_THIS_PROJECT if name not in os.environ]
    if unset:
        raise MarsedlError(f"the numeric environment is not pinned ({', '.join(unset)}); start jobs through snakemake")


def arguments_of(
    function: typing.Callable, inputs: Mapping[str, object], artifact: typing.Callable, **further_arguments
) -> dict:
    """Return the arguments that a stage, figure, table or claim has in its signature.

    Args:
        function: which is asked.
        inputs: plain values by "section.name"; a section has no others.
        artifact: function of an artifact's name and type, that returns it, or None for one that there is not; then the
            function's own default is used.
        further_arguments: used if the function has parameters of these names.

    Returns:
        Its arguments by name, without keyword-only ones.

    """
    from marsedl.replication.sections import Inputs, Section, by_section

    sections, hints, arguments = by_section(inputs), typing.get_type_hints(function), {}
    for name, parameter in inspect.signature(function).parameters.items():
        kind = hints.get(name)
        if parameter.kind is parameter.KEYWORD_ONLY:
            continue
        if name in further_arguments:
            arguments[name] = further_arguments[name]
        elif _is(kind, Section):
            arguments[name] = kind.given(sections.get(name, {}))
        elif _is(kind, Inputs) or _is(kind, Artifacts):
            arguments[name] = _argument(kind, inputs, artifact)
        elif (record := artifact(name, _kind(kind))) is not None:
            arguments[name] = record
    return arguments


def compute_record(entries: typing.Iterable[str], give: typing.Callable, options: Mapping[str, object]) -> object:
    """Return what a stage computes.

    Args:
        entries: its functions, "package.module:function"; what one returns, the next one gathers.
        give: function of a function and of further arguments, that returns its arguments, see `arguments_of`.
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


def published_of(params) -> dict[str, dict]:
    """Return the printed claims by id, as the argument `published`; nothing if a job of these params shows none.

    It is no method of a job, so that an edit of how claims are read does not make every stage anew.
    """
    from marsedl.replication.claims import load_published

    if not params.made["printed"]:
        return {}
    return {"published": {claim.id: claim for claim in load_published(params.published)}}


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

    def arguments_of(
        self, function: typing.Callable, inputs: Mapping[str, object] | None = None, **further_arguments
    ) -> dict:
        """Return the function's arguments: sections, and artifacts from the job's input files, see `arguments_of`.

        inputs: plain values by "section.name"; by default those of the job's params.
        """
        if chunks := self.input.get("chunks"):
            kind = typing.get_args(typing.get_type_hints(function)["chunks"])[0]
            further_arguments["chunks"] = [
                self.load(path, kind) for path in ([chunks] if isinstance(chunks, str) else chunks)
            ]
        files = dict(self.input.items())
        return arguments_of(
            function,
            self.params.made["inputs"] if inputs is None else inputs,
            lambda name, kind: self.load(files[name], kind) if name in files else None,
            **further_arguments,
        )

    def load(self, path: str, kind: type) -> object:
        """Return an artifact from one of the job's input files."""
        from marsedl.replication import artifacts

        if (path, kind) not in self._loaded:
            paper, reading, _ = self._artifacts[path]
            self._loaded[path, kind] = artifacts.load(path, kind, paper=paper, reading=reading)
        return self._loaded[path, kind]

    def run(self) -> None:
        """Compute each artifact of the stage, and save it; the params hold their recipes."""
        gathers = "chunks" in self.input.keys()  # noqa: SIM118
        for path, (_, _, recipe) in self._build["made"].items():
            give = functools.partial(self.arguments_of, inputs=recipe["inputs"])
            options = {} if gathers else recipe["options"]
            self.save(path, compute_record(self.params.entries, give, options), recipe)

    def readings(self) -> dict[str, tuple[Mapping[str, object], typing.Callable]]:
        """Return the inputs of each reading, and the function of an artifact's name and type that loads it."""

        def load(files: Mapping[str, str], name: str, kind: type) -> object:
            return self.load(files[name], kind) if name in files else None

        made = self.params.made
        return {
            reading: (made["inputs"][reading], functools.partial(load, files))
            for reading, files in made["artifacts"].items()
        }

    def of_readings(self, function: typing.Callable) -> dict[str, tuple]:
        """Return the argument `readings` of a function: inputs and records by reading, of the types that it annotates.

        function: its parameter `readings` is annotated as `dict[str, tuple[Inputs, Records]]`.
        """
        _, pair = typing.get_args(typing.get_type_hints(function)["readings"])

        def of(values: Mapping[str, object], artifact: typing.Callable) -> tuple:
            return tuple(_argument(kind, values, artifact) for kind in typing.get_args(pair))

        return {reading: of(*inputs_and_records) for reading, inputs_and_records in self.readings().items()}

    def check_artifacts(self) -> None:
        """Reject input artifacts that their rules would now make differently; the params hold their recipes."""
        if not self._artifacts:
            return
        from marsedl.replication.artifacts import check_recipe

        for path, (paper, reading, recipe) in self._artifacts.items():
            check_recipe(path, recipe, paper, reading)

    def check_libraries(self) -> None:
        """Raise MarsedlError if library versions differ from those that Snakemake planned with."""
        from marsedl.replication.libraries import versions_used

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
        from marsedl.replication import artifacts, digests
        from marsedl.replication.recipes import recipe_digest

        provenance = {
            **recipe,
            "recipe": recipe_digest(recipe),
            "made_from": {Path(need).name: digests.digest(need) for need in self._artifacts},
            "size": self._build["size"],
        }
        artifacts.save(path, artifact, paper=self.paper, reading=self.reading, provenance=provenance)

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
    inputs, trials = study.readings[reading].inputs, study.readings[reading].trial_counts()
    shared = Shared(paper, study)
    if not trials.get(case):
        raise InputError(f"reading {reading} has no case '{case}'; {nearest(case, trials)}")
    if not 0 <= number < trials[case]:
        raise InputError(f"trial {number}: case {case} has the trials 0 to {trials[case] - 1}")

    def load(name: str, kind: type) -> object:
        path = shared.file(reading, name)
        if not (folder / path).exists():
            raise InputError(f"{folder / path} is not built yet; run 'snakemake {path}{options}' first")
        return artifacts.load(folder / path, kind, paper=paper.slug, reading=shared.owner(reading, name))

    arguments = arguments_of(module.replay, inputs.plain(), load)
    ensemble, artifact_name = None, f"{FLIGHTS}.{case}"
    if (folder / shared.file(reading, artifact_name)).exists():
        ensemble = load(artifact_name, typing.get_type_hints(module.gather)["return"])
        if number >= ensemble.outcome.shape[-1]:  # of fewer trials than the reading now has
            ensemble = None
    return module.replay(**arguments, trial=Trial(case, number, ensemble))


def _argument(kind: type, inputs: Mapping[str, object], artifact: typing.Callable) -> object:
    """All inputs, or a dataclass of artifacts; arguments as for `arguments_of`."""
    if not issubclass(kind, Artifacts):
        return kind.given(inputs)
    records = {name: artifact(name, _kind(of)) for name, of in typing.get_type_hints(kind).items()}
    return kind(**{name: record for name, record in records.items() if record is not None})


def _is(kind: object, of: type) -> bool:
    return isinstance(kind, type) and issubclass(kind, of)


def _kind(annotation):
    """The artifact type of an annotation that may allow None."""
    return next((kind for kind in typing.get_args(annotation) if kind is not type(None)), annotation)


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
