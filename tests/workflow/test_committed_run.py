"""Where a run of universes is committed, a build computes a sample of it again, and refuses another one."""

from dataclasses import replace

import pytest

from marsedl.replication.records import store
from marsedl.replication.universes.table import Universes

pytestmark = pytest.mark.workflow

HOP = "short_hop"


def test_a_build_computes_a_sample_of_the_committed_run_and_refuses_one_that_differs(small):
    whole, sample = f"report/universes/whole/{HOP}.h5", f"report/universes/{HOP}.h5"
    small.works(whole)
    run, table = (
        small.folder / f"data/reference/universes/{HOP}.h5",
        store.load(small.path(whole), Universes, paper=HOP),
    )

    def commit(committed):
        own = {key: store.provenance(small.path(whole))[key] for key in ("size", "world")}
        store.save(run, committed, paper=HOP, reading="universes", provenance=own)

    commit(table)
    small.works(sample)
    computed = store.load(small.path(sample), Universes, paper=HOP).number
    assert 0 < len(computed) < len(table.number) and set(computed) <= set(table.number)
    assert small.plan(sample).rules == set()

    commit(replace(table, value=table.value + 1.0))
    assert "is not what this project computes" in small.fails(sample)
