"""A paper in one process: inputs in; records, claims and tables out.

The functions are those that the workflow runs as jobs, and so are the numbers, bit for bit. A stage is remembered by
the digest of what it was given: its function, its slice of the inputs, its options and the content of the records that
it needs. So a changed input computes only the stages that read it, and a stage that gives an equal record stops the
chain.

    memory = Memory()
    nominal = Run("powered_descent", values, memory).record("nominal")
    changed = Run("powered_descent", {**values, "seed": 7}, memory).evaluations()

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
from marsedl.replication.catalogue import Paper
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import nearest
from marsedl.replication.jobs import Slice

FLIGHTS = "montecarlo"


class Memory:
    """Records by the digest of what they were computed from, in this process and, if it has a folder, on disk."""

    def __init__(self, folder: Path | None = None, code: typing.Callable[[str], str] = str):
        """Start empty, or with what a folder holds of earlier runs.

        Args:
            folder: where records are kept; nowhere unless given.
            code: the digest of the code that a function "module:function" can reach. A folder outlives an edit, so give
                it `code_digest.remembered_digests(root).code`.

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

    def __init__(self, paper: Paper, cases: Mapping[str, str], values: Mapping[str, object], memory: Memory):
        """Take what is to be run.

        Args:
            paper: its catalogue.
            cases: of its Monte Carlo ensembles, the inputs that hold their numbers of trials.
            values: all inputs as plain values, as `Reading.slice` gives them.
            memory: what remembers records, shared with other runs.

        """
        self.paper, self.cases, self.values, self.memory = paper, cases, values, memory

    def record(self, name: str) -> typing.Any:
        """Return an artifact by its name, such as "gains" or "montecarlo.closed_loop".

        Raises InputError if the paper has none of this name, or the case no trials; what the stages raise.
        """
        return self._remembered(name)[0]

    def evaluations(self) -> dict[str, typing.Any]:
        """Return what the paper's claims are measured to be, by claim."""
        evaluate = import_module(f"marsedl.papers.{self.paper.slug}.claims").evaluate
        hints = typing.get_type_hints(evaluate)
        flown = {case: f"{FLIGHTS}.{case}" for case in self.cases if self.values[self.cases[case]]}
        known = {**{stage: stage for stage in self.paper.stages}, **flown}
        records = {name: self.record(known[name]) for name in hints if name in known}
        return evaluate(Slice(self.values), **records)

    def table(self, stem: str, published: Mapping[str, typing.Any]) -> typing.Any:
        """Return the rows of a table of this reading; published: the printed claims by id."""
        product = self.paper.tables[stem]
        function = getattr(import_module(f"marsedl.papers.{self.paper.slug}.tables"), stem)
        return function(self._slice(product.inputs), published, **self._records(product.needs))

    def _slice(self, names) -> Slice:
        return Slice({name: self.values[name] for name in names})

    def _records(self, needs) -> dict[str, typing.Any]:
        """Records by the name of the parameter that takes them."""
        return {need.split(".")[-1]: self.record(need) for need in needs}

    def _options(self, case: str) -> dict:
        """How a whole case is flown."""
        return {"case": case, "trials": self.values[self.cases[case]], "block_size": self.paper.trials_per_block}

    def _remembered(self, name: str) -> tuple[object, str]:
        stage, _, case = name.partition(".")
        if stage not in self.paper.stages or bool(case) != (stage == FLIGHTS):
            known = [known for known in self.paper.stages if not known.startswith(FLIGHTS)]
            known += [f"{FLIGHTS}.{case}" for case in self.cases]
            raise InputError(f"{self.paper.slug} has no artifact '{name}'; {nearest(name, known)}")
        if case and not self.values.get(self.cases.get(case, ""), 0):
            raise InputError(f"{self.paper.slug}: case '{case}' has no trials; give it some, or ask for another case")
        entry, declared = self.paper.entry(stage), self.paper.stages[stage]
        options = self._options(case) if case else {}
        given = {
            "code": self.memory.code(entry),
            "inputs": {name: self.values[name] for name in sorted(declared.inputs)},
            "options": options,
            "records": {need: self._remembered(need)[1] for need in declared.needs},
        }
        key = hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()
        module, function = entry.split(":")
        function = getattr(import_module(module), function)

        def compute():
            return function(self._slice(declared.inputs), **self._records(declared.needs), **options)

        return self.memory.get(key, typing.get_type_hints(function)["return"], compute, self.paper.slug)
