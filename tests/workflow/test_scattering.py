"""Monte Carlo cases in chunks: jobs of their own, gathered to the same bytes. (The smoke size has one block a case.)"""

import pytest

from marsedl.replication.digests import digest

pytestmark = pytest.mark.workflow


@pytest.mark.parametrize(("slug", "case"), [("random_field", "aerocapture"), ("stochastic_entry", "apollo_velocity")])
def test_scattered_flights_are_those_of_one_job(tree, own_reading, tmp_path, slug, case):
    config = tmp_path / "scattered.yaml"
    config.write_text(own_reading(slug, "scattered", trials="2500", paper_trials="1000"), encoding="utf-8")
    target = f"data/cache/{slug}/scattered/montecarlo.{case}.h5"
    found = []
    for chunks in (3, 1):
        tree.config = [f"chunks={chunks}"]
        done = tree.run(target, configfile=config)
        assert done.returncode == 0, done.stdout[-3000:]
        found.append(digest(tree.path(target)))
    logs = {path.name for path in tree.path(f"logs/{slug}/scattered").glob("montecarlo.*")}
    assert logs == {f"montecarlo.{case}.{k}of3.log" for k in range(3)} | {f"montecarlo.{case}.log"}
    assert found[0] == found[1]
