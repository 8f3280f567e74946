"""The figures of the random-field paper hold the right curves; nothing here looks at pixels."""

import inspect
from functools import cache
from math import erf

import numpy as np
import pytest
from matplotlib.axes import Axes

from drawn import curves
from marsedl.models import random_field as fields
from marsedl.montecarlo.streams import normals
from marsedl.papers import catalogue
from marsedl.papers.random_field import figures
from marsedl.papers.random_field.flight_statistics import delta_v_percentile
from marsedl.papers.random_field.records import CLOSED, OPEN
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY


@pytest.fixture(scope="module")
def draw(random_field):
    return cache(random_field.figure)


@pytest.fixture
def inputs_of(random_field):
    """The inputs that the catalogue gives a figure."""

    def inputs(stem, reading="corrected", **changes):
        return random_field.inputs(reading, random_field.paper.figures[stem].inputs, **changes)

    return inputs


def band(axes, along=0):
    """Lower and upper edge of the filled band against its coordinate: three arrays."""
    points = axes.collections[0].get_paths()[0].vertices
    places = np.unique(points[:, along])
    edges = [points[points[:, along] == place, 1 - along] for place in places]
    return places, np.array([edge.min() for edge in edges]), np.array([edge.max() for edge in edges])


@pytest.mark.parametrize("stem", sorted(catalogue("random_field").figures))
def test_every_figure_draws_with_few_flights_and_without_laws(draw, random_field, stem):
    """One flight and one sample; the printed reading, whose partition gives no law and whose flights are all lost."""
    flown = "aerocapture" in inspect.signature(getattr(figures, stem)).parameters
    one = {"aerocapture": random_field.ensemble(trials=1)} if flown else {}
    few = {"drawn_samples": 1, "example_positions": np.ones(1), "example_values": np.zeros(1)}
    random_field.figure(stem, artifacts=one, inputs=few)
    figure = draw(stem, "printed")
    figure.draw_without_rendering()
    for labelled in (Axes.get_xlabel, Axes.get_ylabel):
        assert stem in ("fig06", "fig07", "fig08") or any(labelled(axes) for axes in figure.axes)


# --- examples of fields -----------------------------------------------------------------------------------------------


def test_fig01_bands_are_two_deviations_of_prior_and_posterior(draw, inputs_of):
    prior, posterior = draw("fig01").axes
    _, lower, upper = band(prior)
    np.testing.assert_allclose([lower.min(), lower.max(), upper.min(), upper.max()], [-2, -2, 2, 2])
    inputs = inputs_of("fig01")
    # With the inverse and in one dimension, as textbooks write it.
    place, lower, upper = band(posterior)
    measured = inputs.example_positions

    def kernel(a, b):
        return np.exp(-((a[:, None] - b) ** 2) / 2)

    inverse = np.linalg.inv(kernel(measured, measured) + 0.1**2 * np.eye(len(measured)))
    cross = kernel(place, measured)
    mean = cross @ inverse @ inputs.example_values
    deviation = np.sqrt(1 - np.einsum("ki,ij,kj->k", cross, inverse, cross))
    np.testing.assert_allclose(lower, mean - 2 * deviation, atol=1e-9)
    np.testing.assert_allclose(upper, mean + 2 * deviation, atol=1e-9)
    assert deviation[[np.abs(place - m).argmin() for m in measured]].max() < 0.1


def test_fig02_edges_on_the_right_are_constant_only_when_held(draw, inputs_of):
    inputs = inputs_of("fig02")
    before, after = draw("fig02").axes
    for axes, is_conditioned in ((before, False), (after, True)):
        for line in axes.lines:
            x, y, z = line.get_data_3d()
            assert (x == inputs.example_extent).all() or (y == inputs.example_extent).all()
            assert (np.ptp(z) < 1e-3) == is_conditioned
            if is_conditioned:
                np.testing.assert_allclose(z, inputs.example_edge, atol=1e-4)


def test_fig02_root_of_the_product_is_that_of_the_whole_plane(inputs_of, monkeypatch):
    monkeypatch.setattr(figures, "PLANE_POINTS", 7)
    inputs = inputs_of("fig02")
    coordinate, before, _ = inputs.call(figures.plane_samples)
    points = np.array([(x, y) for x in coordinate for y in coordinate])
    covariance = np.exp(-((points[:, None] - points) ** 2).sum(axis=-1) / 2)
    normal_numbers = normals(inputs.seed, figures.PLANE_STREAM, range(7), 7)
    np.testing.assert_allclose(before.ravel(), fields.root(covariance) @ normal_numbers.ravel(), atol=1e-9)


# --- double integrator ------------------------------------------------------------------------------------------------


def test_fig04_band_is_constant_and_samples_repeat_with_the_period(random_field):
    (axes,) = random_field.figure("fig04", inputs={"drawn_samples": 500}).axes
    position, lower, upper = band(axes)
    np.testing.assert_allclose(upper, 2 * np.sqrt(2e-6))
    np.testing.assert_allclose(lower, -2 * np.sqrt(2e-6))
    np.testing.assert_allclose(position[[0, -1]], [0.0, 1.05])
    samples = np.array([line.get_ydata() for line in curves(axes, BLUE)])
    assert samples.shape[0] == 500
    for distance in (0.175, 0.35):
        moved = np.array([np.interp(0.2 + distance, position, sample) for sample in samples])
        start = np.array([np.interp(0.2, position, sample) for sample in samples])
        correlation = np.exp(-2 * (np.sin(np.pi * distance / 0.35) / 0.8) ** 2 - distance**2 / 2)
        assert abs(np.mean(start * moved) / 2e-6 - correlation) < 5 * np.sqrt((1 + correlation**2) / 500)


def ellipses(axes, color, style):
    return [line.get_xydata() for line in curves(axes, color, style, least=100)]


@pytest.mark.parametrize("law", [OPEN, CLOSED])
def test_fig05_ellipses_hold_the_stated_probability(draw, random_field, law):
    axes = draw("fig05").axes[law]
    design, flights = (random_field.stage(f"double_integrator{name}", "corrected") for name in ("", "_flights"))
    predicted, sampled = ellipses(axes, BLACK, "--"), ellipses(axes, GREY, "-")
    assert len(predicted) == len(sampled) == 6
    for k in range(6):
        node = flights.node[k]
        for curve, mean, covariance in (
            (predicted[k], design.mean[law, k], design.covariance[law, k]),
            (sampled[k], flights.mean[law, node, :2], flights.covariance[law, node, :2, :2]),
        ):
            away = curve - mean
            distance = np.einsum("pi,ij,pj->p", away, np.linalg.inv(covariance), away)
            np.testing.assert_allclose(np.exp(-distance / 2), 0.0027, rtol=1e-5)
        # What sticks out beyond a line is what the design says.
        normals, bounds = (
            np.array([[0.212766, 8.51064], [0.30303, -12.1212]]),
            np.array([1.0, -1.0]),
        )
        support = (predicted[k] @ normals.T - bounds).max(axis=0)
        np.testing.assert_allclose(support, design.support[law, k], atol=1e-4)
    assert (support > 1e-3).all()  # the last ellipse protrudes, with and without feedback


@pytest.mark.parametrize("normals", [[(0.0, 1.0), (0.0, -1.0)], [(1.0, 0.0), (1.0, 0.0)], [(1.0, 0.0), (0.0, 1.0)]])
def test_fig05_draws_parallel_and_vertical_lines(inputs_of, normals):
    first, second = map(np.array, normals)
    inputs = inputs_of("fig05", double_integrator_first_normal=first, double_integrator_second_normal=second)
    reach = np.array([[-2.0, -2.0], [2.0, 2.0]])
    for line, normal, bound in zip(
        figures.constraint_lines(inputs.point_mass, reach), (first, second), (1.0, -1.0), strict=True
    ):
        np.testing.assert_allclose(line @ normal, bound)
        assert np.ptp(line, axis=0).max() >= 1.0
        if first @ second == 0.0:
            assert ((line @ [first, second]) <= np.array([1.0, -1.0]) + 1e-12).all()


# --- flights of the aerocapture ---------------------------------------------------------------------------------------


def test_fig12_histograms_have_the_area_of_the_flights_inside(draw, random_field):
    for reading, laws in (("corrected", 4), ("printed", 1)):
        ensemble, panels = random_field.ensemble(reading), draw("fig12", reading).axes
        assert len(panels) == laws
        for number, axes in enumerate(panels):
            delta_v = ensemble.delta_v[number]
            (values, edges, _) = axes.patches[0].get_data()
            inside = np.isfinite(delta_v) & (delta_v >= edges[0]) & (delta_v <= edges[-1])
            assert (values * np.diff(edges)).sum() == pytest.approx(inside.mean())


def test_fig12_marks_both_percentiles_and_the_window(draw, random_field):
    ensemble, gains = random_field.ensemble(), random_field.gains()
    for number, axes in enumerate(draw("fig12").axes):
        (density,) = curves(axes, BLACK, "-")
        value, height = density.get_data()
        assert value[height.argmax()] == pytest.approx(gains.delta_v_mean[number], abs=0.2)
        inside = 0.5 * np.diff([erf((edge - gains.delta_v_mean[number]) / gains.delta_v_deviation[number] / np.sqrt(2))
                                for edge in axes.get_xlim()])  # fmt: skip
        assert np.trapezoid(height, value) == pytest.approx(inside, rel=1e-3)
        (sampled,), (predicted,) = curves(axes, BLUE, "-", least=2), curves(axes, BLACK, ":", least=2)
        assert sampled.get_xdata()[0] == delta_v_percentile(ensemble, number)[0]
        # The 99th percentile of a normal distribution, by its own distribution function.
        score = (predicted.get_xdata()[0] - gains.delta_v_mean[number]) / gains.delta_v_deviation[number]
        assert 0.5 * (1 + erf(score / np.sqrt(2))) == pytest.approx(0.99)


# --- beyond the paper -------------------------------------------------------------------------------------------------


def test_delta_v_map_has_a_kink_whose_sides_are_the_linear_branches(draw, random_field):
    _, axes = draw("delta_v_map").axes
    curve = next(line for line in curves(axes, BLACK, "-", least=50))
    apoapsis, delta_v = curve.get_data()
    assert apoapsis[delta_v.argmin()] == pytest.approx(5.0, abs=0.005)
    sides = [(delta_v[part][-1] - delta_v[part][0]) / (apoapsis[part][-1] - apoapsis[part][0]) for part in (
        (apoapsis > 4.985) & (apoapsis < 4.9999), (apoapsis > 5.0001) & (apoapsis < 5.015))]  # fmt: skip
    slopes = {
        line.get_label(): np.divide(*reversed(np.diff(line.get_xydata(), axis=0)[0]))
        for line in curves(axes, GREEN, least=2)
    }
    below, above = slopes["linear, undershoot"], slopes["linear, overshoot"]
    assert below == pytest.approx(sides[0], rel=0.02) and above == pytest.approx(sides[1], rel=0.02)
    assert slopes["linear, mean"] == pytest.approx((below + above) / 2)
    assert below < 0 < above
