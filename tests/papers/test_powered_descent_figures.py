"""The figures hold the right curves; nothing here looks at pixels."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import same_color

from marsedl.montecarlo.statistics import variance_sampling_band
from marsedl.papers import catalogue
from marsedl.plotting.style import BLACK, BLUE, ORANGE, VERMILION

DRAWN = 12  # trials, see the fixtures

PAPER = catalogue("powered_descent")


@pytest.fixture(scope="module")
def draw(pipeline):
    """Draw a figure of a reading from the inputs and artifacts that the catalogue gives it, once."""
    figure_of = {}

    def draw_once(stem, reading="corrected"):
        if (stem, reading) not in figure_of:
            product = PAPER.figures[stem]
            records = {
                need.split(".")[-1]: pipeline.ensemble(reading, need.split(".")[1])
                if need.startswith("montecarlo")
                else pipeline.stage(need, reading)
                for need in product.needs
            }
            figure_of[stem, reading] = pipeline.product("figures", stem, reading, records)
        return figure_of[stem, reading]

    return draw_once


def curves(axes, color=None):
    """Lines with data (those of a legend have none), of a colour if given."""
    lines = [line for line in axes.lines if len(line.get_xdata()) > 2]
    return [line for line in lines if color is None or same_color(line.get_color(), color)]


@pytest.mark.parametrize("stem", PAPER.figures)
def test_every_figure_draws(draw, stem):
    for axes in draw(stem).axes:
        assert axes.has_data()
        assert axes.get_xlabel() or axes not in draw(stem).axes[-1:]


@pytest.mark.parametrize("stem", ["fig06a", "fig06b"])
def test_no_curve_joins_both_sides_of_the_switch(draw, stem):
    for axes in draw(stem).axes:
        parts = [np.asarray(line.get_xdata()) for line in curves(axes)]
        assert len(parts) == {"fig06a": 4, "fig06b": 6}[stem]
        for time in parts:
            assert time[-1] <= 26.0 or time[0] >= 26.0
        assert sum(time[-1] == 26.0 for time in parts) == len(parts) / 2


def test_fig02_shows_the_ballistic_arc_and_the_divert_radius(draw):
    (axes,) = draw("fig02").axes
    (arc,), (path,) = curves(axes, ORANGE), curves(axes, BLUE)
    assert (arc.get_xdata()[0], arc.get_ydata()[0]) == (250.0, 500.0)
    # It reaches the ground after 12.4 s, at 835 m.
    assert arc.get_xdata()[-1] == pytest.approx(835, abs=0.5)
    assert arc.get_ydata()[-1] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(arc.get_ydata()) < 0).all()
    np.testing.assert_allclose(path.get_xydata()[[0, -1]], [[250, 500], [100, 50]], atol=1e-6)


def ellipses(axes, color):
    """Closed curves as (centre, half width, half height)."""
    closed = [
        line.get_xydata() for line in curves(axes, color) if np.allclose(line.get_xydata()[0], line.get_xydata()[-1])
    ]
    return [((c.max(axis=0) + c.min(axis=0)) / 2, *np.ptp(c, axis=0) / 2) for c in closed]


def test_fig03_trials_ellipses_and_markers(draw, pipeline, node):
    left, right, *targets = draw("fig03").axes
    closed, opened = pipeline.ensemble(), pipeline.ensemble(case="open_loop")
    gains = pipeline.gains()
    assert len(curves(left, ORANGE)) == len(opened.kept_history) == DRAWN and not curves(right, ORANGE)
    for axes in (left, right, *targets):
        trials = curves(axes, BLUE)
        assert len(trials) == len(closed.kept_history) == DRAWN
        for line, trial in zip(trials, closed.kept_history, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), trial[:, :2])
        black, red = ellipses(axes, BLACK), ellipses(axes, VERMILION)
        # Six increments per segment: both ends of both segments in black, five in between.
        assert (len(black), len(red)) == (4, 10)
        ends = ((250, 500, 40, 40), (50, 150, 10, 10), (50, 150, 10, 10), (100, 50, 5, 0.25))
        for (centre, width, height), (r1, r2, var1, var2) in zip(black, ends, strict=True):
            np.testing.assert_allclose(centre, [r1, r2], atol=0.05)
            # Three standard deviations; a polygon of 100 corners reaches the extremes to 0.1 %.
            assert width == pytest.approx(3 * np.sqrt(var1), rel=2e-3)
            assert height == pytest.approx(3 * np.sqrt(var2), rel=2e-3)
        thirds = [node(gains, round(26 * k / 6, 2)) for k in range(1, 6)]
        for (centre, width, _), k in zip(red[:5], thirds, strict=True):
            np.testing.assert_allclose(centre, gains.mean[k, :2], atol=0.3)
            assert width == pytest.approx(3 * np.sqrt(gains.covariance[k, 0, 0]), rel=0.01)


def test_fig05_shows_mass_and_its_difference_from_the_prior(draw, pipeline, node):
    ensemble, nominal = pipeline.ensemble(), pipeline.nominal()
    axes, difference = draw("fig05").axes
    assert len(curves(axes, BLUE)) == len(curves(difference, BLUE)) == DRAWN
    np.testing.assert_array_equal(curves(axes, BLUE)[3].get_ydata(), ensemble.kept_history[3, :, 4])
    np.testing.assert_array_equal(curves(axes, BLACK)[0].get_ydata(), nominal.mass)
    (mean,) = curves(difference, VERMILION)
    at_20 = node(ensemble, 20.0)
    third = curves(difference, BLUE)[3].get_ydata()
    assert third[0] == 0.0
    expected = ensemble.kept_history[3, at_20, 4] - nominal.mass[node(nominal, 20.0)]
    assert third[at_20] == pytest.approx(expected, abs=1e-9)
    expected = ensemble.mean[at_20, 4] - nominal.mass[node(nominal, 20.0)]
    assert mean.get_ydata()[at_20] == pytest.approx(expected, abs=1e-9)


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
    for component, color in ((0, BLUE), (1, ORANGE)):
        axes, ratio = panels[component], panels[component + 2]
        (predicted,), (measured,) = curves(axes, color), curves(axes, BLACK)
        np.testing.assert_array_equal(predicted.get_ydata(), gains.covariance[:, component, component])
        np.testing.assert_array_equal(measured.get_ydata(), ensemble.covariance[:, component, component])
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
