"""Run a paper in one process and compare with a build: `python in_memory.py project size paper`.

Prints what differs, as JSON: artifacts whose bits are not those of the build, and the artifacts that were compared.
"""

import json
import os
import sys
from pathlib import Path

from marsedl.replication.pipeline.numerics import pin_numerics


def main(root: Path, size: str, slug: str) -> dict:
    pin_numerics(root)
    os.chdir(root)
    from marsedl.papers import catalogue, input_model  # only now, as they bring numpy
    from marsedl.replication.claims.printed import load_published
    from marsedl.replication.claims.writing import claims_of
    from marsedl.replication.inputs.readings import load_study
    from marsedl.replication.pipeline.runner import Memory, Run
    from marsedl.replication.pipeline.sharing import Shared
    from marsedl.replication.records import store
    from marsedl.replication.sizes import build_folder

    paper, model = catalogue(slug), input_model(slug)
    study = load_study(slug, model, root, size)
    shared, run = Shared(paper, study), Run.of(paper, study.readings["corrected"].inputs, Memory())
    names = [stage for stage in paper.stages if not stage.startswith("montecarlo")]
    names += list(run.flown)
    unequal = []
    for name in names:
        record = run.record(name)
        path = build_folder(root, size) / shared.file("corrected", name)
        built = store.load(path, type(record), paper=slug, reading="corrected")
        if store.content_digest(record) != store.content_digest(built):
            unequal.append(name)
    published = {claim.id: claim for claim in load_published(Path("data/published") / f"{slug}.yaml")}
    found = claims_of(slug).evaluate(run.given(), published)
    values = {name: evaluation and evaluation.value for name, evaluation in found.items()}
    return {"compared": names, "unequal": unequal, "values": values}


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), *sys.argv[2:]), default=lambda value: value.tolist()))
