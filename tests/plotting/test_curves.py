"""Curves of fields: labels, legends, marks, and that axes hold one unit."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import same_color

from marsedl.plotting.curves import bounds, plot, printed_mark, trials
from marsedl.plotting.fields import Field
from marsedl.plotting.style import BLUE, ORANGE, new_figure

TIME = Field(np.array([0.0, 1.0, 2.0, 3.0]), "time", "s")
ALTITUDE = Field(np.array([4.0, 3.0, 2.0, 1.0]), "altitude", "km", TIME)


def test_the_first_curve_labels_both_axes_and_keeps_labels_that_are_there():
    _, (first, second) = new_figure(ncols=2)
    (line,) = plot(first, ALTITUDE, color=BLUE, label="nominal")
    np.testing.assert_array_equal(line.get_xydata(), np.transpose([TIME.values, ALTITUDE.values]))
    assert (first.get_xlabel(), first.get_ylabel()) == ("time (s)", "altitude (km)")
    assert line.get_label() == "nominal" and same_color(line.get_color(), BLUE)
    second.set_ylabel("height (km)")
    plot(second, ALTITUDE)
    assert (second.get_xlabel(), second.get_ylabel()) == ("time (s)", "height (km)")


def test_axes_refuse_another_unit():
    _, axes = new_figure()
    plot(axes, ALTITUDE)
    with pytest.raises(ValueError, match="axes in km cannot show 'altitude' in m"):
        plot(axes, ALTITUDE.of(ALTITUDE.values, unit="m"))


def test_pieces_are_not_joined_and_have_one_label():
    _, axes = new_figure()
    lines = plot(axes, Field(ALTITUDE.values, "altitude", "km", TIME, np.array([0, 0, 1, 1])), label="gain")
    assert [line.get_xdata().tolist() for line in lines] == [[0.0, 1.0], [2.0, 3.0]]
    assert axes.get_legend_handles_labels()[1] == ["gain"]


def test_trials_are_thin_lines_with_one_entry():
    _, axes = new_figure()
    both = Field(np.array([ALTITUDE.values, 2 * ALTITUDE.values]), "altitude", "km", TIME)
    assert trials(axes, both, color=ORANGE, label="{count} flights") == 2
    lines = [line for line in axes.lines if len(line.get_xdata())]
    np.testing.assert_array_equal([line.get_ydata() for line in lines], both.values)
    assert axes.get_legend_handles_labels()[1] == ["2 flights"]
    _, plane = new_figure()
    trials(plane, Field(both.values, "altitude", "km", both.of(-both.values, "downrange")), label=None)
    np.testing.assert_array_equal([line.get_xdata() for line in plane.lines], -both.values)
    assert plane.get_xlabel() == "downrange (km)" and not plane.get_legend_handles_labels()[1]


def test_bounds_are_two_lines_or_a_band():
    _, (lines, band) = new_figure(ncols=2)
    lower, upper = ALTITUDE, ALTITUDE.of(ALTITUDE.values + 1.0)
    bounds(lines, lower, upper, color=BLUE, label="3 sigma")
    assert [line.get_ydata().tolist() for line in lines.lines] == [lower.values.tolist(), upper.values.tolist()]
    assert lines.get_legend_handles_labels()[1] == ["3 sigma"]
    bounds(band, lower, upper, filled=True, color=BLUE, label="3 sigma")
    (filled,) = (part for part in band.collections if isinstance(part, PolyCollection))
    np.testing.assert_allclose(filled.get_paths()[0].get_extents().get_points(), [[0.0, 1.0], [3.0, 5.0]])
    assert band.get_ylabel() == "altitude (km)"


def test_what_is_no_curve_is_refused():
    _, axes = new_figure()
    both = Field(np.zeros((2, 4)), "altitude", "km", TIME)
    for refused, message in (
        (lambda: plot(axes, both), "is no curve: choose components, or give `at`"),
        (lambda: trials(axes, ALTITUDE), "holds no trials"),
        (lambda: plot(axes, ALTITUDE, unit="m"), "a Field already: give unit where it is taken"),
    ):
        with pytest.raises(ValueError, match=message):
            refused()


def test_what_is_printed_is_a_line_for_one_coordinate_and_crosses_for_two():
    _, axes = new_figure()
    printed_mark(axes, x=[1.0, 2.0])
    printed_mark(axes, x=3.0, y=[4.0, 5.0], label=None)
    assert [list(line.get_xdata()) for line in axes.lines] == [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]
    assert (list(axes.lines[2].get_ydata()), axes.lines[2].get_marker()) == ([4.0, 5.0], "x")
    assert axes.get_legend_handles_labels()[1] == ["printed"]
