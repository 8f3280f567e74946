"""A user's own reading in a file of theirs: every target exists, and nothing of other readings is touched."""

import h5py
import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.papers.powered_descent.records import FlightEnsemble, Gains
from marsedl.papers.stochastic_entry import records as entry_records
from marsedl.replication.artifacts import load
from marsedl.replication.claims import read_claims

pytestmark = pytest.mark.workflow

COVARIANCE = [[6.0, 0.4, -0.3, 0.05], [0.4, 0.5, 0.02, -0.1], [-0.3, 0.02, 0.3, 0.03], [0.05, -0.1, 0.03, 0.2]]
MINE = f"""
powered_descent:
  readings:
    mine:
      based_on: corrected
      summary: Durations that are no multiple of any step, a full covariance, numbers of trials that are no blocks.
      noise: {{noise_coefficient: {{value: 0.03, source: "assumed: test"}}}}
      mission:
        source: "assumed: test"
        final_covariance: {{value: {COVARIANCE}}}
        segment_durations: {{value: [24.7, 16.13], unit: s}}
      ensemble:
        trials: {{value: 7, source: "assumed: test"}}
        large_trials: {{value: 1500, source: "assumed: test"}}
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(MINE, encoding="utf-8")
    return path


def artifact(tree, name, kind, paper="powered_descent"):
    return load(tree.path(f"data/cache/{paper}/mine/{name}.h5"), kind, paper=paper, reading="mine")


def test_an_own_reading_is_built_beside_the_others(tree, mine):
    before, digests = tree.state(), tree.digests()
    figure, large = (
        "figures/powered_descent/mine/fig07.png",
        "data/cache/powered_descent/mine/montecarlo.closed_loop_large",
    )
    process = tree.run(figure, f"{large}.h5", configfile=mine)
    assert process.returncode == 0, process.stdout[-3000:]
    assert tree.path(figure).read_bytes().startswith(b"\x89PNG")

    # Its own numbers,
    gains = artifact(tree, "gains", Gains)
    assert gains.noise_density_plant == pytest.approx(0.03 * 18000.0)
    assert gains.time[-1] == pytest.approx(24.7 + 16.13, abs=1e-12)
    np.testing.assert_allclose(gains.covariance[-1], COVARIANCE, rtol=1e-6, atol=1e-8)
    ensemble = artifact(tree, "montecarlo.closed_loop_large", FlightEnsemble)
    assert ensemble.count == len(ensemble.final_state) == 1500
    assert ensemble.time[-1] == pytest.approx(24.7 + 16.13, abs=1e-12)
    assert np.sum(ensemble.time == 24.7) == 2, "the switch stands twice"
    # with a sampled covariance within five standard errors of the target,
    sampled, scale = ensemble.covariance[-1, :4, :4], np.sqrt(np.diag(COVARIANCE))
    assert np.all(np.abs(sampled - COVARIANCE) < 5 * np.sqrt(2 / 1500) * np.outer(scale, scale))
    # where fewer trials are the first of more.
    few = artifact(tree, "montecarlo.closed_loop", FlightEnsemble)
    assert few.count == 7
    np.testing.assert_array_equal(few.final_state, ensemble.final_state[:7])

    # The other readings are as they were,
    after = tree.state()
    own_files = {name for name in after if "/mine/" in name}
    assert {name: after[name] for name in after.keys() - own_files} == before
    assert {name: digest for name, digest in tree.digests().items() if name not in own_files} == digests
    assert tree.plan("all").rules == set(), "a plain run has nothing to do"

    # and the claims get a column for it, which goes again with the file.
    process = tree.run("claims", configfile=mine)
    assert process.returncode == 0, process.stdout[-3000:]
    rows = read_claims(tree.path("report/claims.json"))
    for row in rows:
        if row["kind"] == "monte_carlo":
            assert "corrected" in row["readings"]
            assert ("mine" in row["readings"]) == (row["paper"] == "powered_descent")
    assert "mine" in tree.path("figures/powered_descent/readings.csv").read_text(encoding="utf-8")
    plan = tree.plan("all")
    assert plan.rules == {"claims", "counterexamples", "all_claims", "digests", "site"}


def test_a_density_table_of_ones_own(tree, own_reading, tmp_path):
    """An exponential atmosphere, of which every interpolation of ln density gives the exact density in between."""
    density, scale_height = 0.0158, 9354.5
    table = tmp_path / "thin air.csv"
    rows = [f"{altitude},{density * np.exp(-altitude / scale_height):.17g}" for altitude in range(0, 130_001, 5000)]
    table.write_text("\n".join(["altitude_m,density_kg_m3", *rows]) + "\n", encoding="utf-8")
    config = tmp_path / "mine.yaml"
    text = own_reading("stochastic_entry", "mine", density_profile="table", density_table=f"'{table}'")
    config.write_text(text, encoding="utf-8")
    before, figure = tree.state(), "figures/stochastic_entry/mine/fig07.png"
    flights = "data/cache/stochastic_entry/mine/montecarlo.stochastic_velocity.h5"
    process = tree.run(figure, flights, configfile=config)
    assert process.returncode == 0, process.stdout[-3000:]
    nominal = artifact(tree, "nominal", entry_records.Nominal, "stochastic_entry")
    np.testing.assert_allclose(nominal.density, density * np.exp(-nominal.altitude / scale_height), rtol=1e-9)
    ensemble = artifact(tree, "montecarlo.stochastic_velocity", entry_records.FlightEnsemble, "stochastic_entry")
    assert ensemble.count == 200
    np.testing.assert_allclose(ensemble.final_state[:, 1], 500.0, atol=1e-6)
    after = tree.state()
    assert {name: state for name, state in after.items() if "/mine/" not in name} == before


@pytest.mark.parametrize("slug", SLUGS)
def test_every_target_exists_for_an_own_reading(copied, own_reading, tmp_path, slug):
    """With a seed of its own, it shares nothing that is drawn; what it shares is the other reading's file."""
    path = tmp_path / "mine.yaml"
    path.write_text(own_reading(slug, "mine", seed="77"), encoding="utf-8")
    paper = catalogue(slug)
    targets = {f"figures/{slug}/mine/{stem}.{ext}" for stem in paper.figures for ext in ("png", "pdf")}
    targets |= {f"figures/{slug}/mine/{stem}.{ext}" for stem in paper.tables for ext in ("csv", "md")}
    stages = [name for name in paper.stages if not name.startswith("montecarlo")]
    stages += [f"montecarlo.{case}" for case in input_model(slug).CASES]
    plan = copied.plan(*sorted(targets), *(f"data/cache/{slug}/mine/{name}.h5" for name in stages), configfile=path)
    assert plan.files >= targets
    assert plan.papers == {slug}
    assert plan.readings == {"mine"}
    assert plan.artifacts >= {f"mine/montecarlo.{case}" for case in input_model(slug).CASES}


def datasets(path):
    """The values of everything that is stored in an artifact, by its name in the file; not whose it is."""
    with h5py.File(path) as file:
        names = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        return {name: repr(np.asarray(file[name]).tolist()) for name in names}


def test_who_shares_with_an_edited_reading_keeps_its_results(tree, tmp_path):
    """Run for real: the owner is edited, the other builds what it shared with it, and back again."""
    path = tmp_path / "mine.yaml"
    noise = "noise: {noise_coefficient: {value: 0.02, source: 'assumed: as corrected'}}"
    path.write_text(f"powered_descent: {{readings: {{mine: {{based_on: corrected, {noise}}}}}}}", encoding="utf-8")
    cache, figure = "data/cache/powered_descent", "figures/powered_descent/mine/fig03.png"

    def run(*targets):
        process = tree.run(*targets, configfile=path)
        assert process.returncode == 0, process.stdout[-3000:]
        return process.stdout

    # All of it is that of `corrected`,
    assert f"{cache}/mine/gains.h5 is shared: it is {cache}/corrected/gains.h5" in run(f"{cache}/mine/gains.h5", figure)
    assert not tree.path(f"{cache}/mine").exists()
    picture, digests = tree.path(figure).read_bytes(), tree.digests()
    stages = ("nominal", "gains", "montecarlo.closed_loop")
    shared = {name: datasets(tree.path(f"{cache}/corrected/{name}.h5")) for name in stages}
    # until that one changes.
    tree.set_inputs("corrected", noise_coefficient="0.03")
    run(figure, "figures/powered_descent/fig03.png")
    assert tree.path(figure).read_bytes() == picture
    after = tree.digests()
    for name in stages:
        assert datasets(tree.path(f"{cache}/mine/{name}.h5")) == shared[name]
        assert after[f"{cache}/corrected/{name}.h5"] != digests[f"{cache}/corrected/{name}.h5"]
    tree.edit("configs/powered_descent.yaml", '      noise_coefficient: {value: 0.03, source: "assumed: test"}\n', "")
    run(figure, "figures/powered_descent/fig03.png")
    assert tree.path(figure).read_bytes() == picture
    assert {name: digest for name, digest in tree.digests().items() if name in digests} == digests
    assert tree.plan(figure, configfile=path).rules == set()
