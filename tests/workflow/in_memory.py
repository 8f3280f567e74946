"""Run a paper in one process and compare with a build: `python in_memory.py project size paper`.

Prints what differs, as JSON: artifacts whose bits are not those of the build, and the artifacts that were compared.
"""

import json
import os
import sys
from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.replication.inputs import load_study
from marsedl.replication.jobs import pin_numerics
from marsedl.replication.sizes import build_folder


def main(root: Path, size: str, slug: str) -> dict:
    pin_numerics(root)
    os.chdir(root)
    from marsedl.replication import artifacts
    from marsedl.replication.graph import Memory, Run

    paper, model = catalogue(slug), input_model(slug)
    values = (
        load_study(slug, model, Path("configs") / f"{slug}.yaml", size=size)
        .readings["corrected"]
        .slice(model.model_fields)
    )
    run = Run(paper, model.CASES, values, Memory())
    names = [stage for stage in paper.stages if not stage.startswith("montecarlo")]
    names += [f"montecarlo.{case}" for case, trials in model.CASES.items() if values[trials]]
    folder = build_folder(root, size) / "data" / "cache" / slug / "corrected"
    unequal = []
    for name in names:
        record = run.record(name)
        built = artifacts.load(folder / f"{name}.h5", type(record), paper=slug, reading="corrected")
        if artifacts.content_digest(record) != artifacts.content_digest(built):
            unequal.append(name)
    values = {name: evaluation and evaluation.value for name, evaluation in run.evaluations().items()}
    return {"compared": names, "unequal": unequal, "values": values}


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), *sys.argv[2:]), default=lambda value: value.tolist()))
