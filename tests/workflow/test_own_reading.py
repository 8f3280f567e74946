"""A user's own reading in a file of theirs: every target exists, and nothing of other readings is touched."""

import h5py
import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.papers.stochastic_entry.records import FlightEnsemble, Nominal
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.records.differences import digest
from marsedl.replication.records.store import load

pytestmark = pytest.mark.workflow

GLIDE = "hypersonic_glide"
CACHE = f"data/cache/{GLIDE}"
MINE = """\
hypersonic_glide:
  readings:
    mine:
      based_on: corrected
      design: {noise_density: {value: %s, source: "assumed: test"}}
      ensemble: {trials: {value: 2500, source: "assumed: no multiple of a block"}}
"""


def datasets(path):
    """The values of everything that is stored in an artifact, by its name in the file; not whose it is."""
    with h5py.File(path) as file:
        names = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        return {name: np.asarray(file[name]).tolist() for name in names}


def test_an_own_reading_is_built_beside_the_others(small, tmp_path):
    path, before = tmp_path / "mine.yaml", small.state()
    path.write_text(MINE % 0.07, encoding="utf-8")
    figure = f"figures/{GLIDE}/mine/fig01.png"
    small.works(figure, configfile=path)
    assert small.path(figure).read_bytes().startswith(b"\x89PNG")
    mine, others = (datasets(small.path(f"{CACHE}/{reading}/gains.h5")) for reading in ("mine", "corrected"))
    assert mine["gain"] != others["gain"], "its own numbers"
    after = small.state()
    assert {name: after[name] for name in after if "/mine/" not in name} == before
    assert small.plan(GLIDE).rules == set(), "a plain run has nothing to do"

    # The claims get a column for it, which goes again with the file.
    small.works(f"report/claims/{GLIDE}.json", configfile=path)
    (row,) = read_claims(small.path(f"report/claims/{GLIDE}.json"))
    assert row.readings.keys() == {"corrected", "printed", "mine"}
    assert small.plan(f"report/claims/{GLIDE}.json").rules == {"paper_claims"}


def test_scattered_flights_are_those_of_one_job(small, tmp_path):
    path, flights = tmp_path / "mine.yaml", f"{CACHE}/mine/montecarlo.closed_loop.h5"
    path.write_text(MINE % 0.07, encoding="utf-8")
    contents = []
    for chunks in (3, 1):
        small.config = [f"chunks={chunks}"]  # of the full size: the smoke size limits trials
        small.works(flights, configfile=path)
        contents.append(digest(small.path(flights)))
    logs = {log.name for log in small.path(f"logs/{GLIDE}/mine").glob("montecarlo.*")}
    assert logs == {f"montecarlo.closed_loop.{k}of3.log" for k in range(3)} | {"montecarlo.closed_loop.log"}
    assert not list(small.build.glob("data/cache/*/*/chunks/*.h5")), "chunks are temporary"
    assert contents[0] == contents[1]


def test_who_shares_with_an_edited_reading_keeps_its_results(small, tmp_path):
    """The owner is edited, the other builds what it shared with it, and back again."""
    path, figure = tmp_path / "mine.yaml", f"figures/{GLIDE}/mine/fig01.png"
    noise = "noise_density: {value: 0.05, source: 'assumed: as corrected'}"
    path.write_text(f"{GLIDE}: {{readings: {{mine: {{based_on: corrected, design: {{{noise}}}}}}}}}", encoding="utf-8")
    refused = small.run(f"{CACHE}/mine/gains.h5", figure, configfile=path)
    assert refused.returncode != 0
    assert f"{CACHE}/mine/gains.h5 is not built: the reading shares {CACHE}/corrected/gains.h5" in refused.stdout
    small.works(f"{CACHE}/corrected/gains.h5", figure, configfile=path)
    assert not small.path(f"{CACHE}/mine").exists()
    picture, digests = small.path(figure).read_bytes(), small.digests()
    stages = ("gains", "montecarlo.closed_loop")
    shared = {name: datasets(small.path(f"{CACHE}/corrected/{name}.h5")) for name in stages}
    base = "    based_on: printed\n"
    own = base + '    design: {noise_density: {value: 0.07, source: "assumed: test"}}\n'
    small.edit(f"configs/{GLIDE}.yaml", base, own)
    said = small.works(figure, f"figures/{GLIDE}/fig01.png", configfile=path)
    assert "not up to date (design.noise_density is 0.05, not 0.07): " in said
    assert small.path(figure).read_bytes() == picture
    after = small.digests()
    for name in stages:
        assert datasets(small.path(f"{CACHE}/mine/{name}.h5")) == shared[name]
        assert after[f"{CACHE}/corrected/{name}.h5"] != digests[f"{CACHE}/corrected/{name}.h5"]
    small.edit(f"configs/{GLIDE}.yaml", own, base)
    small.works(figure, f"figures/{GLIDE}/fig01.png", configfile=path)
    assert small.path(figure).read_bytes() == picture
    assert {name: content for name, content in small.digests().items() if name in digests} == digests
    assert small.plan(figure, configfile=path).rules == set()


def test_a_density_table_of_ones_own(tree, own_reading, tmp_path):
    """An exponential atmosphere, of which every interpolation of ln density gives the exact density in between."""
    density, scale_height = 0.0158, 9354.5
    table = tmp_path / "thin air.csv"
    rows = [f"{altitude},{density * np.exp(-altitude / scale_height):.17g}" for altitude in range(0, 130_001, 5000)]
    table.write_text("\n".join(["altitude_m,density_kg_m3", *rows]) + "\n", encoding="utf-8")
    config = tmp_path / "mine.yaml"
    text = own_reading("stochastic_entry", "mine", density_profile="table", density_table=f"'{table}'")
    config.write_text(text, encoding="utf-8")
    before, cache = tree.state(), "data/cache/stochastic_entry/mine"
    tree.works(f"{cache}/montecarlo.stochastic_velocity.h5", configfile=config)
    nominal = load(tree.path(f"{cache}/nominal.h5"), Nominal, paper="stochastic_entry", reading="mine")
    np.testing.assert_allclose(nominal.density, density * np.exp(-nominal.altitude / scale_height), rtol=1e-9)
    path = tree.path(f"{cache}/montecarlo.stochastic_velocity.h5")
    ensemble = load(path, FlightEnsemble, paper="stochastic_entry", reading="mine")
    assert ensemble.count == 200
    np.testing.assert_allclose(ensemble.final_state[:, 1], 500.0, atol=1e-6)
    after = tree.state()
    assert {name: state for name, state in after.items() if "/mine/" not in name} == before


def test_every_target_exists_for_an_own_reading(copied, own_reading, tmp_path):
    """With a seed of its own, it shares nothing that is drawn; what it shares is the other reading's file."""
    path = tmp_path / "mine.yaml"
    path.write_text("".join(own_reading(slug, "mine", seed="77") for slug in SLUGS), encoding="utf-8")
    targets, cases = set(), set()
    for slug in SLUGS:
        paper = catalogue(slug)
        targets |= {f"figures/{slug}/mine/{stem}.{ext}" for stem in paper.figures for ext in ("png", "pdf")}
        targets |= {f"figures/{slug}/mine/{stem}.{ext}" for stem in paper.tables for ext in ("csv", "md")}
        cases |= {f"data/cache/{slug}/mine/montecarlo.{case}.h5" for case in input_model(slug).CASES}
    plan = copied.plan(*sorted(targets | cases), configfile=path)
    assert plan.files >= targets | cases
    assert {name.partition("/")[0] for name in plan.artifacts} == {"mine"}
