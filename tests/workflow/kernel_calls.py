"""What compiled kernels are given and store: `python kernel_calls.py record|replay file [project papers...]`.

`record` flies the Monte Carlo cases of papers with the artifacts of a smoke build, and keeps the first call of each
kernel under each case: its arguments and what it left in them. `replay` calls the kernels again with these arguments in
this process, whatever its instruction sets, and prints as JSON how many calls there were and which of them left other
bits.
"""

import json
import os
import pickle
import sys
from copy import deepcopy
from importlib import import_module
from pathlib import Path

from marsedl.replication.pipeline.numerics import pin_numerics

SIZE = "smoke"


def flights(root, slug):
    """Functions that fly each case of a paper's corrected reading, and the stages that are flights by another name."""
    from marsedl.papers import catalogue, input_model
    from marsedl.replication.inputs.readings import load_study
    from marsedl.replication.pipeline.catalogue import FLIGHTS, whole_case
    from marsedl.replication.pipeline.injection import Arguments
    from marsedl.replication.pipeline.runner import computed
    from marsedl.replication.pipeline.sharing import Shared
    from marsedl.replication.records import store
    from marsedl.replication.sizes import build_folder

    paper = catalogue(slug)
    study = load_study(slug, input_model(slug), root, SIZE)
    shared, inputs = Shared(paper, study), study.readings["corrected"].inputs

    def record(name, kind):
        path = build_folder(root, SIZE) / shared.file("corrected", name)
        return store.load(path, kind, paper=slug, reading="corrected") if path.exists() else None

    def fly(stage, options):
        declared = paper.stages[stage]
        values = {name: inputs.plain()[name] for name in declared.inputs}
        computed(declared.entries, Arguments(values, record), options)

    for case, name in inputs.CASES.items():
        if trials := inputs.get(name):
            yield lambda case=case, trials=trials: fly(FLIGHTS, whole_case(case, trials, paper))
    for stage in paper.stages:
        if stage.endswith("_flights"):
            yield lambda stage=stage: fly(stage, {})


def recorded(root, slugs):
    """Kernel, arguments and what it left, of the first call of each kernel under each case."""
    from marsedl.replication.pipeline.fingerprints import fingerprints_of

    calls, seen = [], set()

    def watched(name, kernel):
        def call(*arguments):
            if name in seen:
                return kernel(*arguments)
            seen.add(name)
            before = deepcopy(arguments)
            result = kernel(*arguments)
            calls.append((name, before, deepcopy((arguments, result))))
            return result

        return call

    for name in fingerprints_of(root).compiled():
        module, function = name.split(":")
        setattr(import_module(module), function, watched(name, getattr(import_module(module), function)))
    for slug in slugs:
        for fly in flights(root, slug):
            seen.clear()
            fly()
    return calls


def bits(value):
    """The bits of arrays and numbers in nested tuples."""
    import numpy as np

    if isinstance(value, tuple):
        return [bits(part) for part in value]
    return None if value is None else np.asarray(value).tobytes()


def replayed(calls):
    """What calling the kernels again changes."""
    different = []
    for name, before, after in calls:
        module, function = name.split(":")
        result = getattr(import_module(module), function)(*before)
        if bits((before, result)) != bits(after):
            different.append(name)
    return {"calls": [name for name, *_ in calls], "changed": different}


if __name__ == "__main__":
    action, file = sys.argv[1], Path(sys.argv[2])
    if action == "record":
        project = Path(sys.argv[3])
        pin_numerics(project)
        os.chdir(project)
        file.write_bytes(pickle.dumps(recorded(project, sys.argv[4:])))
    else:
        print(json.dumps(replayed(pickle.loads(file.read_bytes()))))
