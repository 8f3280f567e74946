"""The figures of the entry-guidance paper hold the right curves; nothing here looks at pixels."""

from functools import cache

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drawn import curves
from marsedl.papers import catalogue
from marsedl.papers.stochastic_entry import environment, records
from marsedl.papers.stochastic_entry.records import errors
from marsedl.plotting.style import BLUE, ORANGE, SKY, VERMILION

DRAWN = 12  # trials, see the fixtures
SKETCHES = ("fig01", "fig03")
FLOWN = ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity")

PAPER = catalogue("stochastic_entry")


@pytest.fixture(scope="module")
def draw(entry):
    return cache(entry.figure)


@pytest.mark.parametrize("reading", ["corrected", "printed"])
@pytest.mark.parametrize("stem", PAPER.figures)
def test_every_figure_draws(draw, stem, reading):
    figure = draw(stem, reading)
    assert isinstance(figure, Figure)
    for axes in figure.axes:
        assert axes.get_title() or axes.lines or axes.patches
    for labelled in (Axes.get_xlabel, Axes.get_ylabel):
        assert stem in SKETCHES or any(labelled(axes) for axes in figure.axes)
    figure.draw_without_rendering()


# --- sketches and densities -------------------------------------------------------------------------------------------


def density_inputs(entry):
    return entry.inputs("corrected", PAPER.figures["fig02"].inputs)


@pytest.mark.parametrize("case", ["stochastic_velocity"])
def test_fig04_samples_are_those_that_the_trials_fly_through(draw, entry, case):
    (axes,) = draw("fig04").axes
    samples = curves(axes, BLUE)
    inputs = density_inputs(entry)
    assert len(samples) == inputs.drawn_densities >= DRAWN
    air = inputs.call(environment.atmosphere)
    for line, trial in zip(samples, entry.ensemble("corrected", case).kept_history, strict=False):
        altitude, density = trial[np.isfinite(trial[:, 0])][:, [records.ALTITUDE, records.DENSITY]].T
        inside = altitude < 125e3  # dispersed entries are all at the edge itself
        mean = np.exp(np.interp(altitude, air.altitude, air.log_density))
        expected = np.interp(altitude / 1e3, line.get_ydata(), line.get_xdata())
        np.testing.assert_allclose((density / mean - 1)[inside], expected[inside], atol=1e-10)
        assert inside.sum() > 200


# --- linear covariance ------------------------------------------------------------------------------------------------


def test_fig13_ellipses_hold_the_stated_probability(draw, entry):
    (axes,) = draw("fig13").axes
    gains = entry.gains()
    cases = {
        (BLUE, "-"): gains.apollo_covariance[0],
        (SKY, "-"): gains.apollo_covariance[1],
        (VERMILION, "-"): gains.stochastic_covariance[0],
        (ORANGE, "-"): gains.stochastic_covariance[1],
        (BLUE, ":"): gains.timed_covariance[0],
        (SKY, ":"): gains.timed_covariance[1],
    }
    for (color, style), covariance in cases.items():
        (line,) = curves(axes, color, style)
        block = covariance[-1][np.ix_([1, 3], [1, 3])]
        points = line.get_xydata() * [1.0, 1e3]
        distance = np.einsum("ki,ij,kj->k", points, np.linalg.inv(block), points)
        np.testing.assert_allclose(np.exp(-distance / 2), 0.0027, rtol=1e-5)


# --- beyond the paper -------------------------------------------------------------------------------------------------


def test_floor_is_below_the_linear_prediction_and_that_below_the_flights(draw, entry):
    (axes,) = draw("floor").axes
    heights = np.array([bar.get_height() for group in axes.containers for bar in getattr(group, "patches", ())])
    heights = heights[heights > 0].reshape(4, 3)
    for case, (least, predicted, measured) in zip(FLOWN, heights, strict=True):
        assert least <= predicted * (1 + 1e-6) <= measured
        samples = errors(entry.ensemble("corrected", case))[:, records.DOWNRANGE]
        assert measured == pytest.approx(samples.std(ddof=1))
    assert heights[0, 0] == heights[2, 0] == pytest.approx(85.4, abs=0.1)
    assert heights[1, 0] == heights[3, 0] == pytest.approx(466.9, abs=0.1)
    # At the trigger, velocity errors count as range errors.
    gains, weight = entry.gains(), entry.linearization().trigger_projection[3]
    assert heights[1, 1] == pytest.approx(np.sqrt(weight @ gains.apollo_covariance[1, -1] @ weight))


def test_reversal_histograms_have_the_areas_of_their_shares(draw, entry):
    for axes, case in zip(draw("reversals").axes, FLOWN, strict=True):
        number = entry.ensemble("corrected", case).final_state[:, records.REVERSALS]
        steps = [patch.get_data() for patch in axes.patches]
        areas = [float((values * np.diff(edges)).sum()) for values, edges, _ in steps]
        assert areas[-1] == pytest.approx(0.998, abs=0.001)  # all but a thousandth on either side
        assert sum(areas[:-1:2]) == pytest.approx(areas[-1], abs=0.01)
        shares = [np.mean(number == count) for count in np.unique(number)]
        assert all(np.abs(np.subtract(shares, area)).min() < 0.003 for area in areas[:-1:2])
