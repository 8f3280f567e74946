"""Monte Carlo cases in chunks: jobs of their own, gathered to the same bytes. (The smoke size has one block a case.)"""

import pytest

from marsedl.replication.digests import digest

pytestmark = pytest.mark.workflow


@pytest.mark.parametrize(("slug", "case"), [("random_field", "aerocapture"), ("stochastic_entry", "apollo_velocity")])
def test_scattered_flights_are_those_of_one_job(tree, own_reading, tmp_path, slug, case):
    config = tmp_path / "scattered.yaml"
    config.write_text(own_reading(slug, "scattered", trials="2500", paper_trials="1000"), encoding="utf-8")
    target = f"data/cache/{slug}/scattered/montecarlo.{case}.h5"
    contents = []
    for chunks in (3, 1):
        tree.config = [f"chunks={chunks}"]
        process = tree.run(target, configfile=config)
        assert process.returncode == 0, process.stdout[-3000:]
        contents.append(digest(tree.path(target)))
    logs = {path.name for path in tree.path(f"logs/{slug}/scattered").glob("montecarlo.*")}
    assert logs == {f"montecarlo.{case}.{k}of3.log" for k in range(3)} | {f"montecarlo.{case}.log"}
    assert contents[0] == contents[1]
