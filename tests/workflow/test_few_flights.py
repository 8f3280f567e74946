"""Ensembles of one, two and three flights: cells are empty where a number needs more, and nothing crashes."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import artifacts, claims
from marsedl.replication.claiming import claims_of
from marsedl.replication.graph import Memory, Run
from marsedl.replication.inputs import load_study
from marsedl.replication.jobs import record_type
from marsedl.replication.sharing import Shared

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]


class Flights(Run):
    """A run that flies anew, and takes from a build every record that no number of trials changes."""

    def __init__(self, paper, values, trials, counts, built):
        super().__init__(paper, values, Memory(), trials)
        self.counts, self.built = set(counts), built

    def _remembered(self, name):
        if name.startswith("montecarlo.") or not self.counts.isdisjoint(self._read(name)):
            return super()._remembered(name)
        record = artifacts.load(self.built(name), record_type(self.paper.stages[name].entries))
        return record, artifacts.content_digest(record)

    def _read(self, name):
        declared = self.paper.stages[name]
        return set(declared.inputs).union(*(self._read(need) for need in declared.needs))


@pytest.mark.parametrize("slug", SLUGS)
@pytest.mark.filterwarnings("default::RuntimeWarning")  # a job may warn, but not end
def test_claims_and_tables_cope_with_few_flights(copied, slug, monkeypatch):
    monkeypatch.chdir(ROOT)
    paper, own = catalogue(slug), claims_of(slug)
    study = load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml", size="smoke")
    inputs, shared = study.readings["corrected"].inputs, Shared(paper, study)
    published = {claim.id: claim for claim in claims.load_published(ROOT / "data" / "published" / f"{slug}.yaml")}
    counts = [name for name, value in inputs.plain().items() if name.endswith("trials") and value]
    for trials in (1, 2, 3):
        values = inputs.plain() | dict.fromkeys(counts, trials)
        cases = {case: trials for case, name in inputs.CASES.items() if values[name]}
        run = Flights(paper, values, cases, counts, lambda name: copied.build / shared.file("corrected", name))
        evaluations = run.evaluations(published)
        rows = claims.collect(
            list(published.values()),
            own.declarations,
            {"printed": evaluations, "corrected": evaluations},
            {},
            require_reasons=False,
            left_out=study.readings.keys() - {"printed", "corrected"},
        )
        assert {row["id"] for row in rows} >= set(evaluations)
        for stem in paper.tables:
            run.table(stem, published)
