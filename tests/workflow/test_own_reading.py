"""A user's own reading in a file of theirs: every target exists, and nothing of other readings is touched."""

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.powered_descent.gains import Gains
from marsedl.papers.powered_descent.montecarlo import FlightEnsemble
from marsedl.replication.artifacts import load
from marsedl.replication.claims import read_claims

pytestmark = pytest.mark.workflow

COVARIANCE = [[6.0, 0.4, -0.3, 0.05], [0.4, 0.5, 0.02, -0.1], [-0.3, 0.02, 0.3, 0.03], [0.05, -0.1, 0.03, 0.2]]
MINE = f"""
powered_descent:
  readings:
    mine:
      based_on: corrected
      summary: Durations that are no multiple of any step, a full covariance, a number of trials between two blocks.
      inputs:
        noise_coefficient: {{value: 0.03, source: "assumed: test"}}
        final_covariance: {{value: {COVARIANCE}, source: "assumed: test"}}
        segment_durations: {{value: [24.7, 16.13], unit: s, source: "assumed: test"}}
        trials: {{value: 1500, source: "assumed: test"}}
    few:
      based_on: mine
      inputs:
        trials: {{value: 7, source: "assumed: test"}}
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(MINE, encoding="utf-8")
    return path


def artifact(tree, reading, name, kind):
    path = tree.path(f"data/cache/powered_descent/{reading}/{name}.h5")
    return load(path, kind, paper="powered_descent", reading=reading)


def test_own_readings_are_built_beside_the_others(tree, mine):
    smoke, tree.config = tree.config, []  # in full size, so that the trials are those of the file
    before, digests = tree.state(), tree.digests()
    targets = [f"figures/powered_descent/{reading}/fig07.png" for reading in ("mine", "few")]
    done = tree.run(*targets, configfile=mine)
    assert done.returncode == 0, done.stdout[-3000:]
    assert all(tree.path(target).exists() for target in targets)

    gains = artifact(tree, "mine", "gains", Gains)
    assert gains.noise_density_plant == pytest.approx(0.03 * 18000.0)
    assert gains.time[-1] == pytest.approx(24.7 + 16.13, abs=1e-12)
    np.testing.assert_allclose(gains.covariance[-1], COVARIANCE, rtol=1e-6, atol=1e-8)
    flown = artifact(tree, "mine", "montecarlo.closed_loop", FlightEnsemble)
    assert flown.count == len(flown.final_state) == 1500
    assert flown.time[-1] == pytest.approx(24.7 + 16.13, abs=1e-12)
    assert np.sum(flown.time == 24.7) == 2, "the switch stands twice"
    # The sampled covariance agrees with the target within five standard errors of its entries.
    sampled, scale = flown.covariance[-1, :4, :4], np.sqrt(np.diag(COVARIANCE))
    assert np.all(np.abs(sampled - COVARIANCE) < 5 * np.sqrt(2 / 1500) * np.outer(scale, scale))
    few = artifact(tree, "few", "montecarlo.closed_loop", FlightEnsemble)
    assert few.count == 7
    np.testing.assert_array_equal(few.final_state, flown.final_state[:7])  # fewer trials are the same trials

    after = tree.state()
    own = {name for name in after if "/mine/" in name or "/few/" in name}
    assert {name: after[name] for name in after.keys() - own} == before
    assert {name: digest for name, digest in tree.digests().items() if name not in own} == digests
    tree.config = smoke
    assert tree.plan("all").rules == set(), "a plain run has nothing to do"


def test_every_target_exists_for_an_own_reading(tree, mine):
    paper = catalogue("powered_descent")
    targets = {f"figures/powered_descent/mine/{stem}.{ext}" for stem in paper.figures for ext in ("png", "pdf")}
    targets |= {f"figures/powered_descent/mine/{stem}.{ext}" for stem in paper.tables for ext in ("csv", "md")}
    stages = [name for name in paper.stages if not name.startswith("montecarlo")]
    stages += [f"montecarlo.{case}" for case in paper.cases]
    targets |= {f"data/cache/powered_descent/mine/{name}.h5" for name in stages}
    plan = tree.plan(*sorted(targets), configfile=mine)
    assert plan.files >= targets
    assert plan.readings == {"mine"}


def test_the_claims_get_a_column_for_an_own_reading(tree, mine):
    done = tree.run("claims", configfile=mine)
    assert done.returncode == 0, done.stdout[-3000:]
    rows = read_claims(tree.path("report/claims.json"))
    assert all({"mine", "few", "corrected"} <= set(row["readings"]) for row in rows if row["kind"] == "monte_carlo")
    assert "mine" in tree.path("figures/powered_descent/readings.csv").read_text(encoding="utf-8")
    done = tree.run("all")  # without the file: the columns go, and everything else is there
    assert done.returncode == 0, done.stdout[-3000:]
    assert "mine" not in tree.path("report/claims.json").read_text(encoding="utf-8")


def test_an_unknown_reading_in_a_target_is_refused_by_name(tree):
    done = tree.run("figures/powered_descent/minne/fig07.png")
    assert done.returncode != 0
    assert "minne" in done.stdout
    assert "Traceback" not in done.stdout
