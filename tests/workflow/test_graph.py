"""A paper in one process gives the bits that its jobs give."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.records import store

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]


# One paper in every run of the suite: the others take minutes.
@pytest.mark.parametrize("slug", [SLUGS[0], *(pytest.param(slug, marks=pytest.mark.long) for slug in SLUGS[1:])])
@pytest.mark.filterwarnings("default::RuntimeWarning")  # a job may warn, but not end
def test_every_stage_at_smoke_size(copied, slug, monkeypatch):
    monkeypatch.chdir(ROOT)
    paper, study = catalogue(slug), load_study(slug, input_model(slug), ROOT, size="smoke")
    shared, run = Shared(paper, study), Run.of(paper, study.readings["corrected"].inputs, Memory())
    unequal = []
    for name in (*(stage for stage in paper.stages if not stage.startswith("montecarlo")), *run.flown):
        record = run.record(name)
        built = store.load(copied.build / shared.file("corrected", name), type(record), paper=slug, reading="corrected")
        if store.content_digest(record) != store.content_digest(built):
            unequal.append(name)
    assert unequal == []
    published = {claim.id: claim for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml")}
    evaluations = claims_of(slug).evaluate(run.given(), published)
    for row in read_claims(copied.path(f"report/claims/{slug}.json")):
        if isinstance(value := row.readings["corrected"].value, float | bool | int):
            assert evaluations[row.id].value == value, row.id
