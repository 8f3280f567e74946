"""The recurring forms of figures against what they are to show."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import same_color

from marsedl.montecarlo.statistics import variance_sampling_band
from marsedl.plotting.ellipses import probability_inside
from marsedl.plotting.fields import Field
from marsedl.plotting.forms import covariance_ellipse, distribution, predicted_against_sampled
from marsedl.plotting.style import BLACK, BLUE, new_figure
from marsedl.replication.records.fields import Axis, quantity, record

PLANE = Axis("plane", downrange="m", altitude="m", velocity="m/s")


@record
class Design:
    """Mean and covariance over time."""

    time: np.ndarray = quantity("s", ("time",), "time")
    mean: np.ndarray = quantity(PLANE.unit, ("time", PLANE), "mean")
    covariance: np.ndarray = quantity("SI", ("time", PLANE, PLANE), "covariance")


def test_every_point_of_the_ellipse_is_that_many_deviations_away():
    covariance = np.array([[4.0, 0.3, 1.2], [0.3, 9.0, 0.0], [1.2, 0.0, 1.0]])
    design = Design(np.arange(2.0), np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]), np.array([np.eye(3), covariance]))
    _, axes = new_figure()
    at, units = {"time": 1}, ("km", "")
    curve = covariance_ellipse(axes, design, ("downrange", "velocity"), 3.0, at=at, units=units, color=BLUE)
    away = curve * [1e3, 1.0] - [1.0, 3.0]
    of_components = covariance[np.ix_([0, 2], [0, 2])]
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, np.linalg.inv(of_components), away), 9.0, rtol=1e-9)
    np.testing.assert_allclose(away[0], away[-1], atol=1e-9)  # closed
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), curve)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("downrange (km)", "velocity (m/s)")


def test_the_probability_inside_is_that_of_samples():
    samples = np.random.default_rng(1).standard_normal((200_000, 2))
    for sigma in (0.5, 1.0, 2.4477, 3.0):
        inside = np.mean(np.sum(samples**2, axis=1) < sigma**2)
        assert probability_inside(sigma) == pytest.approx(inside, abs=4 * np.sqrt(0.25 / len(samples)))
    assert probability_inside(np.sqrt(-2 * np.log(0.05))) == pytest.approx(0.95, rel=1e-12)


def test_a_sample_stands_beside_its_prediction_with_the_sampling_band():
    time = Field(np.array([0.0, 1.0, 2.0]), "time", "s")
    predicted = Field(np.array([4.0, 2.0, 1.0]), "variance", "m^2", time)
    sampled = Field(np.array([4.4, 1.0]), "variance", "m^2", time.where([0, 2]))
    _, (above, below) = new_figure(nrows=2)
    predicted_against_sampled(above, below, predicted, sampled, 1000, color=BLUE)
    assert above.get_legend_handles_labels()[1] == ["95 % sampling band", "predicted", "1,000 flights"]
    (line,) = (line for line in above.lines if same_color(line.get_color(), BLUE))
    np.testing.assert_array_equal(line.get_ydata(), predicted.values)
    (dots,) = (line for line in below.lines if same_color(line.get_color(), BLACK))
    np.testing.assert_allclose(dots.get_ydata(), [10.0, 0.0], atol=1e-9)
    (filled,) = (part for part in below.collections if isinstance(part, PolyCollection))
    lower, upper = variance_sampling_band(1.0, 1000)
    reach = filled.get_paths()[0].get_extents()
    assert (reach.y0, reach.y1) == pytest.approx((100 * (lower - 1), 100 * (upper - 1)))
    assert below.get_ylabel() == "deviation of sampled\nfrom predicted (%)"


def test_the_histogram_of_a_distribution_counts_lost_samples_and_those_outside():
    random = np.random.default_rng(3)
    values = np.append(random.normal(10.0, 2.0, 5000), [np.nan, np.nan, 400.0])
    _, axes = new_figure()
    heights, edges = distribution(axes, Field(values, r"$\Delta v$", "m/s"), (0.0, 20.0), (10.0, 2.0))
    inside = np.count_nonzero((values >= 0.0) & (values <= 20.0))
    assert (heights * np.diff(edges)).sum() == pytest.approx(inside / 5003)
    (normal,) = axes.lines
    assert np.trapezoid(normal.get_ydata(), normal.get_xdata()) == pytest.approx(1.0, abs=1e-4)
    assert heights.max() == pytest.approx(normal.get_ydata().max(), rel=0.15)
    assert axes.get_xlabel() == r"$\Delta v$ (m/s)" and axes.get_xlim() == (0.0, 20.0)
