"""Density models: what is drawn is what the papers' inputs say."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.comparison import densities
from marsedl.comparison.records import NAMES
from marsedl.papers import input_model
from marsedl.papers.funnels.environment import density, log_density
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.injection import Arguments

ROOT = Path(__file__).parents[2]
FLOWN = np.array([20e3, 120e3])  # m, of nominals that are not looked at otherwise
ARTIFACTS = {
    "powered_descent": {
        "nominal": SimpleNamespace(mean=np.array([[0.0, 500.0], [0.0, 50.0]])),
        "gains": SimpleNamespace(noise_density_plant=360.0),
    },
    "random_field": {"nominal": SimpleNamespace(altitude=FLOWN)},
    "desensitized": {"nominal": SimpleNamespace(state=FLOWN[:, np.newaxis])},
    "funnels": {"linearization": SimpleNamespace(state=FLOWN[:, np.newaxis])},
    "stochastic_entry": {"nominal": SimpleNamespace(altitude=FLOWN)},
}


@pytest.fixture(scope="module")
def values():
    """All inputs of the corrected readings, "section.name", by paper."""
    studies = {slug: load_study(slug, input_model(slug), ROOT) for slug in NAMES}
    return {slug: study.readings["corrected"].inputs.plain() for slug, study in studies.items()}


@pytest.fixture(scope="module")
def inputs(values):
    """The same by their names alone."""
    return {
        slug: SimpleNamespace(**{name.partition(".")[2]: value for name, value in plain.items()})
        for slug, plain in values.items()
    }


@pytest.fixture(scope="module")
def records(values):
    results = {}
    for slug in NAMES:
        given = Arguments(values[slug], lambda name, _, slug=slug: ARTIFACTS[slug][name])
        results[slug] = given.call(getattr(densities, slug))
    return results


def test_one_standard_deviation_above_the_top_altitude_is_that_of_the_inputs(inputs, records):
    for slug in ("random_field", "stochastic_entry"):
        top = inputs[slug].variance_top_altitude <= densities.ALTITUDE
        assert records[slug].factors[1][top] == pytest.approx(1 + np.sqrt(inputs[slug].variance_at_top))
        assert records[slug].factors[0] + records[slug].factors[1] == pytest.approx(2.0)
        below = np.interp(inputs[slug].variance_top_altitude - inputs[slug].variance_growth_length,
                          densities.ALTITUDE, records[slug].factors[1] - 1)  # fmt: skip
        assert below == pytest.approx(np.sqrt(inputs[slug].variance_at_top / np.e))


def test_the_largest_density_of_the_funnels_is_the_largest_over_the_disc(inputs, records):
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    for node in (20, 100, 240):
        altitude = densities.ALTITUDE[node]
        values = np.log(density(inputs["funnels"], altitude, (np.cos(angle), np.sin(angle))))
        excess = values - log_density(inputs["funnels"], altitude)
        assert records["funnels"].factors[1][node] == pytest.approx(np.exp(excess.max()), rel=1e-6)
        assert records["funnels"].factors[0][node] == pytest.approx(np.exp(excess.min()), rel=1e-6)


def test_the_reference_is_one_and_the_powered_descent_has_no_atmosphere(records):
    table = densities.table(records).set_index("paper")
    assert set(table.loc["random field", "mean density over the reference"]) == {1.0}
    bare = table.loc["powered descent"]
    assert bare[["altitude (km)", "mean density over the reference", "dispersion (%)"]].isna().all()
    assert "360 N sqrt(s)" in bare["what the dispersion is"]
    in_flight = table.loc["funnels"].set_index("altitude (km)")["flown"]
    assert (in_flight[10.0], in_flight[50.0]) == (False, True)


def test_the_figure_names_all_five(records):
    (legend,) = densities.figure(records).legends
    assert len(legend.get_texts()) == len(NAMES) and "no atmosphere" in legend.get_texts()[0].get_text()
