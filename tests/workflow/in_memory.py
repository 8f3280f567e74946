"""Run a paper in one process and compare with a build: `python in_memory.py project size paper`.

Prints what differs, as JSON: artifacts whose bits are not those of the build, and the artifacts that were compared.
"""

import json
import os
import sys
from pathlib import Path

from marsedl.replication.jobs import pin_numerics


def main(root: Path, size: str, slug: str) -> dict:
    pin_numerics(root)
    os.chdir(root)
    from marsedl.papers import catalogue, input_model  # only now, as they bring numpy
    from marsedl.replication import artifacts
    from marsedl.replication.claims import load_published
    from marsedl.replication.graph import Memory, Run
    from marsedl.replication.inputs import load_study
    from marsedl.replication.sharing import Shared
    from marsedl.replication.sizes import build_folder

    paper, model = catalogue(slug), input_model(slug)
    study = load_study(slug, model, Path("configs") / f"{slug}.yaml", size=size)
    shared, run = Shared(paper, study), Run.of(paper, study.readings["corrected"].inputs, Memory())
    names = [stage for stage in paper.stages if not stage.startswith("montecarlo")]
    names += [f"montecarlo.{case}" for case in run.trials]
    unequal = []
    for name in names:
        record = run.record(name)
        path = build_folder(root, size) / shared.file("corrected", name)
        built = artifacts.load(path, type(record), paper=slug, reading="corrected")
        if artifacts.content_digest(record) != artifacts.content_digest(built):
            unequal.append(name)
    published = {claim.id: claim for claim in load_published(Path("data/published") / f"{slug}.yaml")}
    values = {name: evaluation and evaluation.value for name, evaluation in run.evaluations(published).items()}
    return {"compared": names, "unequal": unequal, "values": values}


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), *sys.argv[2:]), default=lambda value: value.tolist()))
