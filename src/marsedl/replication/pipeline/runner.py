"""A paper in one process: inputs in; records and tables out.

The functions are those that the workflow runs as jobs, and so are the numbers, bit for bit. A stage is remembered by
the digest of what it was given: its function, its slice of the inputs, its options and the content of the records that
it needs. So a changed input computes only the stages that read it, and a stage that gives an equal record stops the
chain.

    memory = Memory()
    nominal = Run.of(paper, inputs, memory).record("nominal")
    changed = Run(paper, {**inputs.plain(), "ensemble.seed": 7}, memory, trials).record("gains")

Nothing is global but the imported modules, and no file is written; any number of runs can share a memory.
"""

import hashlib
import json
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.catalogue import (
    FLIGHTS,
    Flown,
    Paper,
    Stage,
    Trial,
    entry_of,
    function_of,
    whole_case,
)
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.records import store

if typing.TYPE_CHECKING:
    from marsedl.replication.inputs.readings import Study
    from marsedl.replication.inputs.sections import Inputs


class Memory:
    """Records by the digest of what they were computed from."""

    def __init__(self):
        """Start empty."""
        self._records: dict[str, tuple[object, str] | Exception] = {}
        self._used: set[str] = set()
        self._kept: set[str] | None = None

    def record(self, run: "Run", name: str) -> object:
        """Return a record of a run, computed if it is not remembered."""
        return self._remembered(run, name)[0]

    def __len__(self) -> int:
        """Return how many records, and failures, are remembered."""
        return len(self._records)

    def let_go(self) -> None:
        """Let go of what was not asked for since the last call; what was there at the first call stays."""
        self._kept = set(self._records) if self._kept is None else self._kept
        self._records = {key: one for key, one in self._records.items() if key in self._used | self._kept}
        self._used = set()

    def _remembered(self, run: "Run", name: str) -> tuple[object, str]:
        """A record with the digest of its content."""
        stage = run.stage(name)
        made_from = {
            "functions": stage.entries,
            "inputs": {name: run.values[name] for name in stage.inputs},
            "options": run.flown.get(name, {}),
            "records": {need: self._remembered(run, need)[1] for need in stage.needs},
        }
        key = hashlib.sha256(json.dumps(made_from, sort_keys=True).encode()).hexdigest()
        self._used.add(key)
        if key not in self._records:
            try:
                record = computed(stage.entries, run.given(stage.inputs), run.flown.get(name))
                record = store.as_loaded(record)
                self._records[key] = record, store.content_digest(record)
            except (OSError, MemoryError):  # of the machine, which another run may not meet
                raise
            except Exception as error:  # which another run would meet again
                self._records[key] = error
        if isinstance(remembered := self._records[key], Exception):
            raise remembered
        return remembered


class Run:
    """One paper with one complete set of inputs; every record is computed when it is first asked for."""

    def __init__(
        self,
        paper: Paper,
        values: Mapping[str, object],
        memory: Memory,
        trials: Mapping[str, int],
        without: Iterable[str] = (),
    ):
        """Take a catalogue, plain inputs by "section.name", a memory that runs may share, the trials of each case.

        without: stages that claims, figures and tables of this run do not have.
        """
        self.paper, self.values, self.memory, self.without = paper, values, memory, frozenset(without)
        self.flown = {f"{FLIGHTS}.{case}": whole_case(case, number, paper) for case, number in trials.items()}

    @classmethod
    def of(cls, paper: Paper, inputs: "Inputs", memory: Memory, without: Iterable[str] = ()) -> "Run":
        """Return the run of a paper with typed inputs."""
        trials = {case: number for case, name in inputs.CASES.items() if (number := inputs.get(name))}
        return cls(paper, inputs.plain(), memory, trials, without)

    def record(self, name: str) -> typing.Any:
        """Return an artifact by its name, such as "gains" or "montecarlo.closed_loop"; raises what `stage` does."""
        return self.memory.record(self, name)

    def stage(self, name: str) -> Stage:
        """Return the declared stage of an artifact; raises InputError if there is none, or the case has no trials."""
        stage, _, case = name.partition(".")
        if stage not in self.paper.stages or bool(case) != (stage == FLIGHTS):
            names = [name for name in self.paper.stages if name != FLIGHTS] + list(self.flown)
            raise InputError(f"{self.paper.slug} has no artifact '{name}'; {nearest(name, names)}")
        if case and name not in self.flown:
            raise InputError(f"{self.paper.slug}: case '{case}' has no trials; give it some, or ask for another case")
        return self.paper.stages[stage]

    def given(self, names: Iterable[str] | None = None) -> Arguments:
        """Return what a function can ask for: some inputs, or all, and the records of the run."""

        def artifact(parameter: str, kind: type) -> typing.Any:
            if f"{FLIGHTS}.{parameter}" in self.flown:
                return self.record(f"{FLIGHTS}.{parameter}")
            return self.record(parameter) if parameter in self.paper.stages.keys() - self.without else None

        values = self.values if names is None else {name: self.values[name] for name in names}
        return Arguments(values, artifact)

    def table(self, stem: str, published: Mapping[str, typing.Any]) -> typing.Any:
        """Return a table of this reading; published: the printed claims by id."""
        function = function_of(entry_of(self.paper.slug, "tables", stem))
        return self.given(self.paper.tables[stem].inputs).call(function, published=published)


def computed(entries: Iterable[str], given: Arguments, flown: Mapping[str, object] | None = None) -> typing.Any:
    """Return what a stage computes, in a run and in a job: what one of its functions returns, the next one joins.

    flown: fields of `Flown`, for a stage that flies trials.
    """
    first, *following = map(function_of, entries)
    options = {"flown": Flown(**flown)} if flown else {}
    record = given.call(first, **options)
    for function in following:
        record = given.call(function, chunks=[record], **options)
    return record


def record_type(entries: Sequence[str]) -> type:
    """Return the type of what a stage computes."""
    return typing.get_type_hints(function_of(entries[-1]))["return"]


def replay(folder: Path, paper: Paper, study: "Study", reading: str, trial: tuple[str, int], options: str = "") -> str:
    """Fly one trial (case and number) again and describe it; compares it with the ensemble if the build has that.

    Of a reading of which `all` makes no files, what a trial needs is computed in memory where it is not built.

    options: those of Snakemake with which a missing artifact is built. Raises InputError for a case or trial that the
    reading does not have, or if an artifact is missing.
    """
    (case, number), shared = trial, Shared(paper, study)
    inputs, trials = study.readings[reading].inputs, study.readings[reading].trial_counts()
    in_memory = Run.of(paper, inputs, Memory())
    if not trials.get(case):
        raise InputError(f"reading {reading} has no case '{case}'; {nearest(case, trials)}")
    if not 0 <= number < trials[case]:
        raise InputError(f"trial {number}: case {case} has the trials 0 to {trials[case] - 1}")

    def load(name: str, kind: type, *, required: bool = True) -> typing.Any:
        path = shared.file(reading, name)
        if (folder / path).exists():
            return store.load(folder / path, kind, paper=paper.slug, reading=shared.owner(reading, name))
        if required and reading in study.points:
            return in_memory.record(name)
        if required:
            raise InputError(f"{folder / path} is not built yet; run 'snakemake {path}{options}' first")
        return None

    ensemble = load(f"{FLIGHTS}.{case}", record_type([entry_of(paper.slug, FLIGHTS, "gather")]), required=False)
    if ensemble is not None and number >= ensemble.outcome.shape[-1]:  # of fewer trials than the reading now has
        ensemble = None
    simulate, describe = (function_of(entry_of(paper.slug, FLIGHTS, name)) for name in ("simulate", "replay"))
    given, trial = Arguments(inputs.plain(), load), Trial(case, number, ensemble)
    return given.call(describe, chunk=given.call(simulate, flown=trial.flown), trial=trial)
