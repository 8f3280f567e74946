"""Ensembles of one, two and three flights: cells are empty where a number needs more, and nothing crashes."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import claims
from marsedl.replication.claiming import claims_of
from marsedl.replication.graph import Memory, Run
from marsedl.replication.inputs import load_study

ROOT = Path(__file__).parents[2]


@pytest.mark.stages
@pytest.mark.parametrize("slug", SLUGS)
@pytest.mark.filterwarnings("default::RuntimeWarning")  # a job may warn, but not end
def test_claims_and_tables_cope_with_few_flights(slug):
    paper = catalogue(slug)
    inputs = load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml", size="smoke").readings["corrected"]
    inputs, memory, own = inputs.inputs, Memory(), claims_of(slug)
    published = {claim.id: claim for claim in claims.load_published(ROOT / "data" / "published" / f"{slug}.yaml")}
    counts = [name for name, value in inputs.plain().items() if name.endswith("trials") and value]
    for trials in (1, 2, 3):
        values = inputs.plain() | dict.fromkeys(counts, trials)
        run = Run(paper, values, memory, {case: trials for case, name in inputs.CASES.items() if values[name]})
        evaluations = run.evaluations(published)
        rows = claims.collect(
            list(published.values()),
            own.declarations,
            {"printed": evaluations, "corrected": evaluations},
            {},
            require_reasons=False,
        )
        assert {row["id"] for row in rows} >= set(evaluations)
        for stem in paper.tables:
            run.table(stem, published)
