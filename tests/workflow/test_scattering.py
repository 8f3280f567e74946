"""Monte Carlo cases in chunks: jobs of their own, gathered to the same bytes. (The smoke size has one block a case.)"""

import pytest

from marsedl.replication.digests import digest

pytestmark = pytest.mark.workflow

READING = """
stochastic_entry:
  readings:
    scattered:
      based_on: corrected
      inputs:
        trials: {value: 2500, source: "assumed: test"}
"""


def test_scattered_flights_of_the_entry_are_those_of_one_job(tree, tmp_path):
    config = tmp_path / "scattered.yaml"
    config.write_text(READING, encoding="utf-8")
    target = "data/cache/stochastic_entry/scattered/montecarlo.apollo_velocity.h5"
    found = []
    for chunks in (3, 1):
        tree.config = [f"chunks={chunks}"]
        done = tree.run(target, configfile=config)
        assert done.returncode == 0, done.stdout[-3000:]
        found.append(digest(tree.path(target)))
    logs = {path.name for path in tree.path("logs/stochastic_entry/scattered").glob("montecarlo.*")}
    assert logs == {f"montecarlo.apollo_velocity.{k}of3.log" for k in range(3)} | {"montecarlo.apollo_velocity.log"}
    assert found[0] == found[1]
