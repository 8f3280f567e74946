"""The figures hold the right curves; nothing here looks at pixels."""

from functools import cache

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from drawn import curves
from marsedl.montecarlo.statistics import variance_sampling_band
from marsedl.papers import catalogue
from marsedl.plotting.style import BLACK, BLUE, ORANGE, VERMILION


@pytest.fixture(scope="module")
def draw(pipeline):
    return cache(pipeline.figure)


@pytest.mark.parametrize("stem", catalogue("powered_descent").figures)
def test_every_figure_draws(draw, stem):
    for axes in draw(stem).axes:
        assert axes.has_data()
        assert axes.get_xlabel() or axes not in draw(stem).axes[-1:]


def test_fig02_shows_the_ballistic_arc_and_the_divert_radius(draw):
    (axes,) = draw("fig02").axes
    (arc,), (path,) = curves(axes, ORANGE), curves(axes, BLUE)
    assert (arc.get_xdata()[0], arc.get_ydata()[0]) == (250.0, 500.0)
    # It reaches the ground after 12.4 s, at 835 m.
    assert arc.get_xdata()[-1] == pytest.approx(835, abs=0.5)
    assert arc.get_ydata()[-1] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(arc.get_ydata()) < 0).all()
    np.testing.assert_allclose(path.get_xydata()[[0, -1]], [[250, 500], [100, 50]], atol=1e-6)


def test_fig06b_is_ordered_and_below_the_limit(draw, pipeline):
    (axes,) = draw("fig06b").axes
    mean, percentile, largest = (
        np.concatenate([line.get_ydata() for line in curves(axes, color)]) for color in (BLACK, BLUE, VERMILION)
    )
    assert (mean < percentile).all() and (percentile < largest).all() and largest.max() < 1
    np.testing.assert_allclose(mean, pipeline.ensemble().observed_mean[:, 0] / 18_000.0, rtol=1e-12)


def test_fig07_shows_prediction_measurement_and_band(draw, pipeline, node):
    ensemble, gains = pipeline.ensemble(), pipeline.gains()
    panels = draw("fig07").axes
    assert len(panels) == 4
    for component in (0, 1):
        axes, ratio = panels[component], panels[component + 2]
        (filled,) = (c for c in axes.collections if isinstance(c, PolyCollection))
        corners = filled.get_paths()[0].vertices
        for time in (0.0, 13.0, 33.0, 41.0):
            at = corners[np.isclose(corners[:, 0], time), 1]
            lower, upper = variance_sampling_band(gains.covariance[node(gains, time), component, component], 2000)
            np.testing.assert_allclose([at.min(), at.max()], [lower, upper], rtol=1e-9)
            assert upper / lower == pytest.approx(1 + 4 * 1.96 / np.sqrt(2 * 2000), rel=0.01)
        # in percent, and about zero
        (measured,) = curves(ratio, BLACK)
        k = node(ensemble, 13.0)
        expected = (
            ensemble.covariance[k, component, component] / gains.covariance[node(gains, 13.0), component, component]
        )
        assert measured.get_ydata()[k] == pytest.approx(100 * (expected - 1), abs=1e-6)
        (filled,) = (c for c in ratio.collections if isinstance(c, PolyCollection))
        assert filled.get_paths()[0].vertices[:, 1].max() == pytest.approx(100 * 1.96 * np.sqrt(2 / 2000), rel=0.02)
