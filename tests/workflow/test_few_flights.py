"""Ensembles of one, two and three flights: cells are empty where a number needs more, and nothing crashes."""

from functools import cache
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.verdicts import collect
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.runner import Memory, Run, record_type
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.records import store

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]


class Flights(Memory):
    """Remembers from a build every record that no number of trials changes."""

    def __init__(self, counts, built):
        super().__init__()
        self.counts, self.built = set(counts), built

    def _remembered(self, run, name):
        if name.startswith("montecarlo.") or not self.counts.isdisjoint(self._read(run, name)):
            return super()._remembered(run, name)
        return self.built(name, record_type(run.stage(name).entries))

    def _read(self, run, name):
        declared = run.stage(name)
        return set(declared.inputs).union(*(self._read(run, need) for need in declared.needs))


@pytest.mark.parametrize("slug", SLUGS)
@pytest.mark.filterwarnings("default::RuntimeWarning")  # a job may warn, but not end
def test_claims_and_tables_cope_with_few_flights(copied, slug, monkeypatch):
    monkeypatch.chdir(ROOT)
    paper, own = catalogue(slug), claims_of(slug)
    study = load_study(slug, input_model(slug), ROOT, size="smoke")
    inputs, shared = study.readings["corrected"].inputs, Shared(paper, study)
    published = {claim.id: claim for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml")}

    @cache
    def built(name, kind):
        record = store.load(copied.build / shared.file("corrected", name), kind)
        return record, store.content_digest(record)

    counts = [name for name, value in inputs.plain().items() if name.endswith("trials") and value]
    for trials in (1, 2, 3):
        values = inputs.plain() | dict.fromkeys(counts, trials)
        cases = {case: trials for case, name in inputs.CASES.items() if values[name]}
        run = Run(paper, values, Flights(counts, built), cases)
        evaluations = claims_of(slug).evaluate(run.given(), published)
        rows = collect(
            list(published.values()),
            own.declarations,
            {"printed": evaluations, "corrected": evaluations},
            require_reasons=False,
            left_out=study.readings.keys() - {"printed", "corrected"},
        )
        assert {row.id for row in rows} >= set(evaluations)
        for stem in paper.tables:
            run.table(stem, published)
