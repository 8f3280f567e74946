"""A paper in one process: inputs in; records, claims and tables out.

The functions are those that the workflow runs as jobs, and so are the numbers, bit for bit. A stage is remembered by
the digest of what it was given: its function, its slice of the inputs, its options and the content of the records that
it needs. So a changed input computes only the stages that read it, and a stage that gives an equal record stops the
chain.

    memory = Memory()
    nominal = Run.of(paper, inputs, memory).record("nominal")
    changed = Run(paper, {**inputs.plain(), "ensemble.seed": 7}, memory, trials).evaluations(published)

Nothing is global but the imported modules, and no file is written unless the memory has a folder: any number of runs
can share a memory, in one process or, by its folder, in several.
"""

import hashlib
import json
import typing
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from marsedl.replication import artifacts
from marsedl.replication.catalogue import FLIGHTS, Paper
from marsedl.replication.claiming import claims_of
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.jobs import arguments_of, compute_record, record_type, whole_case
from marsedl.replication.sections import Inputs


class Memory:
    """Records by the digest of what they were computed from, in this process and, if it has a folder, on disk."""

    def __init__(self, folder: Path | None = None, code: typing.Callable[[str], str] = str):
        """Start empty, or with what a folder holds of earlier runs.

        Args:
            folder: where records are kept; nowhere unless given.
            code: the digest of the code that a function "module:function" can reach. A folder outlives an edit, so give
                it `fingerprints_of(root).code`.

        """
        self.folder, self.code = folder, code
        self.computed = 0  # stages that were not remembered
        self._records: dict[str, tuple[object, str]] = {}

    def get(self, key: str, kind: type, compute: typing.Callable[[], object], paper: str) -> tuple[object, str]:
        """Return the record of this key with the digest of its content; it is computed if it is not remembered.

        Raises ArtifactError if what is computed does not fit its declaration, or a file is damaged.
        """
        if key not in self._records:
            path = self.folder / f"{key}.h5" if self.folder else None
            if path is not None and path.exists():
                record = artifacts.load(path, kind, paper=paper)
            else:
                self.computed += 1
                record = artifacts.as_loaded(compute())
                if path is not None:
                    artifacts.save(path, record, paper=paper, reading=key, provenance={})
            self._records[key] = record, artifacts.content_digest(record)
        return self._records[key]


class Run:
    """One paper with one complete set of inputs; every record is computed when it is first asked for."""

    def __init__(self, paper: Paper, values: Mapping[str, object], memory: Memory, trials: Mapping[str, int]):
        """Define the run.

        Args:
            paper: its catalogue.
            values: all inputs as plain values by "section.name", as `Inputs.plain` gives them.
            memory: what remembers records, shared with other runs.
            trials: the numbers of trials of the Monte Carlo cases, as `Reading.trial_counts` gives them.

        """
        self.paper, self.values, self.memory, self.trials = paper, values, memory, trials

    @classmethod
    def of(cls, paper: Paper, inputs: Inputs, memory: Memory) -> "Run":
        """Return the run of a paper with typed inputs."""
        trials = {case: inputs.get(name) for case, name in inputs.CASES.items()}
        return cls(paper, inputs.plain(), memory, {case: number for case, number in trials.items() if number})

    def record(self, name: str) -> typing.Any:
        """Return an artifact by its name, such as "gains" or "montecarlo.closed_loop".

        Raises InputError if the paper has no such artifact or the case no trials, and what the stages raise.
        """
        return self._remembered(name)[0]

    def evaluations(self, published: Mapping[str, typing.Any], **further_arguments) -> dict[str, typing.Any]:
        """Return the evaluation of each claim of the paper.

        published: the printed claims by id; further_arguments: what claims ask for beside artifacts.
        """
        return claims_of(self.paper.slug).evaluate(self.values, self._artifact, published, **further_arguments)

    def table(self, stem: str, published: Mapping[str, typing.Any]) -> typing.Any:
        """Return a table of this reading; published: the printed claims by id."""
        function = getattr(import_module(f"marsedl.papers.{self.paper.slug}.tables"), stem)
        return function(**self._arguments(function, self.paper.tables[stem].inputs, published=published))

    def _arguments(self, function: typing.Callable, names: typing.Iterable[str], **further_arguments) -> dict:
        return arguments_of(function, {name: self.values[name] for name in names}, self._artifact, **further_arguments)

    def _artifact(self, parameter: str, kind: type) -> typing.Any:
        """The artifact that a parameter takes; None for a case without trials."""
        if parameter in self.trials:
            return self.record(f"{FLIGHTS}.{parameter}")
        return self.record(parameter) if parameter in self.paper.stages else None

    def _remembered(self, name: str) -> tuple[object, str]:
        stage, _, case = name.partition(".")
        if stage not in self.paper.stages or bool(case) != (stage == FLIGHTS):
            stage_names = [stage_names for stage_names in self.paper.stages if not stage_names.startswith(FLIGHTS)]
            stage_names += [f"{FLIGHTS}.{case}" for case in self.trials]
            raise InputError(f"{self.paper.slug} has no artifact '{name}'; {nearest(name, stage_names)}")
        if case and case not in self.trials:
            raise InputError(f"{self.paper.slug}: case '{case}' has no trials; give it some, or ask for another case")
        declared = self.paper.stages[stage]
        options = whole_case(case, self.trials[case], self.paper) if case else {}
        made_from = {
            "code": [self.memory.code(entry) for entry in declared.entries],
            "inputs": {name: self.values[name] for name in declared.inputs},
            "options": options,
            "records": {need: self._remembered(need)[1] for need in declared.needs},
        }
        key = hashlib.sha256(json.dumps(made_from, sort_keys=True).encode()).hexdigest()

        def give(function, **further_arguments):
            return self._arguments(function, declared.inputs, **further_arguments)

        return self.memory.get(
            key, record_type(declared.entries), lambda: compute_record(declared.entries, give, options), self.paper.slug
        )
