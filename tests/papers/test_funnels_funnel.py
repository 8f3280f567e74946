"""The funnel of the entry: its levels, its checks, what lies inside it, and how it fails.

Expected numbers are those of an independent study of the paper with another nominal transcription: 0.1 %, unless said
otherwise.
"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import kstest

from marsedl.methods.funnels.stage import lyapunov_rate
from marsedl.montecarlo.streams import normals, uniforms
from marsedl.papers.funnels import environment, funnel
from marsedl.replication.records import store

DEGREE = np.pi / 180.0
RADIUS = 3389.5e3


def air_of(inputs):
    """The air and its disturbances."""
    return environment.disturbed_air(inputs.planet, inputs.uncertainty)


@pytest.fixture(scope="module")
def corrected(funnels):
    return funnels.funnel("corrected")


@pytest.fixture(scope="module")
def loop(funnels):
    inputs = funnels.stage_inputs("corrected", "funnel")
    reference, gain = funnels.linearization(), funnels.gains().half_gain
    return environment.closed_loop(inputs.planet, inputs.vehicle, air_of(inputs), reference, gain)


def shape_rate(funnels, step):
    gains = funnels.gains()
    return np.gradient(gains.shape, gains.time, axis=0)[step]


def deviations_of(slices, k, points):
    """Deviations (m, 6) of whitened points of slice k, counted from 0."""
    return np.sqrt(2.0 * slices.level[k]) * np.linalg.solve(np.linalg.cholesky(slices.shape[k]).T, points.T).T


def on_sphere(stream, count, dimension):
    normal_numbers = normals(1, stream, np.arange(count), dimension)
    return normal_numbers / np.linalg.norm(normal_numbers, axis=1, keepdims=True)


# --- levels -----------------------------------------------------------------------------------------------------------


def test_levels_at_every_fifth_slice(corrected):
    reference = [0.1793, 0.1812, 0.2039, 0.3877, 1.3711, 3.6290, 6.2814, 8.4394, 9.6400, 10.085, 10.216, 10.178, 10.047]
    np.testing.assert_allclose(corrected.level[::5], reference, rtol=1e-3)
    assert corrected.outcome == "complete" and corrected.sound
    rising = np.diff(corrected.level) > 0.0
    assert np.flatnonzero(rising[:-1] & ~rising[1:]).tolist() == [49] and corrected.level.argmax() == 50
    assert corrected.time[50] == pytest.approx(201.0, abs=0.6)


def test_half_widths_and_volumes(corrected):
    kilometres = corrected.half_width * [1e-3, RADIUS / 1e3, RADIUS / 1e3, 1.0, 1.0 / DEGREE, 1.0 / DEGREE]
    for k, widths in (
        (0, [0.69, 1.08, 1.21, 15.3, 0.09, 0.14]),
        (50, [3.40, 7.70, 7.15, 153, 3.4, 2.5]),
        (60, [4.48, 8.97, 8.97, 134, 2.7, 2.7]),
    ):
        np.testing.assert_allclose(kilometres[k], widths, rtol=5e-3, atol=0.051 if k else 0.0051)
    expected = np.sqrt(2.0 * corrected.level[:, None] * np.diagonal(np.linalg.inv(corrected.shape), axis1=1, axis2=2))
    np.testing.assert_allclose(corrected.half_width, expected, rtol=1e-9)
    volume = np.log(np.pi**3 / 6.0 * 8.0 * corrected.level**3) - 0.5 * np.linalg.slogdet(corrected.shape)[1]
    np.testing.assert_allclose(corrected.log_volume, volume, rtol=0, atol=1e-9)


# --- checks of the stages ---------------------------------------------------------------------------------------------


def test_every_stage_is_checked(corrected):
    assert corrected.stage_sound.all() and (corrected.status == "optimal").all()
    assert (corrected.identity_error < 1e-10).all() and (corrected.least_value > 0.0).all()
    assert (corrected.least_eigenvalue >= -corrected.rounding_margin).all()
    assert (np.abs(corrected.gap) < 1e-6).all() and (corrected.residual < 1e-9).all()
    assert (corrected.iterations >= 5).all() and (corrected.iterations < 20).all()


def test_bounds_are_tight_for_the_polynomial(corrected):
    """None is below a value that is reached; a search that ends at a lesser maximum leaves up to a thousandth."""
    assert (corrected.tightness > -1e-9).all() and (corrected.tightness < 1e-3).all()
    assert np.median(corrected.tightness) < 1e-7
    assert corrected.tightness_stage.tolist() == [1, 11, 21, 31, 40, 50, 60]


def test_the_motion_exceeds_the_polynomial(corrected):
    """In almost every stage, by up to a quarter of a per cent near the end; values at points that can be shown."""
    assert corrected.violation.max() == pytest.approx(0.0026, abs=5e-5) and corrected.violation.argmax() == 58
    assert 50 <= np.count_nonzero(corrected.violation > 0.0) < 60
    np.testing.assert_allclose(corrected.true_maximum, corrected.bound * (1.0 + corrected.violation), rtol=1e-12)
    # A search that stays below what is reached elsewhere.
    assert corrected.violation.min() > -0.15


def test_additive_disturbances_come_on_top(coarse_funnel):
    slices = coarse_funnel("additive")
    expected = np.sqrt(slices.growth * slices.level[:-1]) + np.sqrt(slices.additive_growth)
    np.testing.assert_allclose(np.sqrt(slices.level[1:]), expected, rtol=1e-12)
    assert (slices.additive_growth > 1e-6).all()
    np.testing.assert_array_equal(slices.growth, slices.bound)


# --- what lies inside -------------------------------------------------------------------------------------------------


def test_the_largest_feedback_is_reached(corrected, funnels):
    assert corrected.feedback.max() / DEGREE == pytest.approx(19.6, abs=0.051)
    gains, k = funnels.gains(), int(corrected.feedback.argmax())
    row = gains.half_gain[2 * corrected.step[k]]
    whitened = np.linalg.solve(np.linalg.cholesky(corrected.shape[k]), row)
    reached = deviations_of(corrected, k, whitened[None] / np.linalg.norm(whitened)) @ row
    assert reached[0] == pytest.approx(corrected.feedback[k], rel=1e-12)
    assert np.abs(deviations_of(corrected, k, on_sphere(0, 1000, 6)) @ row).max() < corrected.feedback[k]


def test_the_largest_heat_rate_is_that_of_a_search_over_states_and_disturbances(corrected, funnels):
    """By sequential quadratic programming over the slice and the disc; the other study has 68.4 W/cm^2 by samples."""
    inputs, k = funnels.stage_inputs("corrected", "funnel"), int(corrected.heat_rate.argmax())
    heat_rate = partial(environment.heat_rate, inputs.vehicle, air_of(inputs))
    state = funnels.linearization().state[2 * corrected.step[k]]

    def negative(point):
        deviation = deviations_of(corrected, k, point[None, :6])[0]
        return -heat_rate(state[0] + deviation[0], state[3] + deviation[3], point[6:]) / 1e4

    inside = [
        {"type": "ineq", "fun": lambda point, b=block: 1.0 - point[b] @ point[b]} for block in (slice(6), slice(6, 8))
    ]
    least_values = [
        minimize(negative, 0.5 * start, method="SLSQP", constraints=inside, options={"ftol": 1e-12, "maxiter": 200}).fun
        for start in np.hstack([on_sphere(1, 4, 6), on_sphere(2, 4, 2)])
    ]
    assert -min(least_values) == pytest.approx(corrected.heat_rate[k] / 1e4, rel=1e-5)
    assert 68.4 < corrected.heat_rate.max() / 1e4 < 69.0


def test_the_worst_disturbance_of_the_density_is_at_an_end_of_its_diameter(corrected, funnels, loop):
    """Against all points of a fine net over the disc, none of which is better, and some of which are nearly as good."""
    inputs = funnels.stage_inputs("corrected", "funnel")
    radius, angle = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0 * np.pi, 721))
    net = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2)
    for k in (6, 55):
        points = on_sphere(3, 8, 6) * uniforms(1, 4, np.arange(8), 1)
        step, rate = corrected.step[k], shape_rate(funnels, corrected.step[k])
        arguments = (corrected.shape[k], rate)
        rates = funnel.lyapunov_rates(air_of(inputs), loop, step, *arguments, corrected.level[k], points)
        for point, (still, worst) in zip(deviations_of(corrected, k, points), rates.T, strict=True):
            values = lyapunov_rate(loop, 2 * step, *arguments, np.tile(point, (len(net), 1)), net)
            scale = np.ptp(values)
            assert -1e-12 * scale < worst - values.max() < 1e-4 * scale
            undisturbed = lyapunov_rate(loop, 2 * step, *arguments, point[None], np.zeros((1, 2)))
            assert still == pytest.approx(undisturbed[0], rel=1e-9)


def test_rates_are_those_of_the_flown_level(corrected, funnels, loop):
    """V at a later node, less V, over the time between: an error of first order, which two of them extrapolate away."""
    inputs, k = funnels.stage_inputs("corrected", "funnel"), 30
    step, gains = corrected.step[k], funnels.gains()
    points = on_sphere(5, 30, 6)
    still, _ = funnel.lyapunov_rates(
        air_of(inputs), loop, step, corrected.shape[k], shape_rate(funnels, step), corrected.level[k], points
    )
    deviation = deviations_of(corrected, k, points).T

    def slope(later):
        moved = np.array(loop.flow(step, step + later, deviation, np.zeros((2, 30))))
        value = 0.5 * np.sum(moved * (gains.shape[step + later] @ moved), axis=0)
        return (value - corrected.level[k]) / (gains.time[step + later] - gains.time[step])

    one, two, four = slope(1), slope(2), slope(4)
    largest = np.abs(still).max()
    assert np.abs(one - still).max() > 0.03 * largest
    errors = [np.abs(extrapolated - still).max() / largest for extrapolated in (2.0 * two - four, 2.0 * one - two)]
    assert errors[1] < 0.01 and 2.5 < errors[0] / errors[1] < 5.0


def test_the_search_for_the_largest_motion_starts_from_the_packages_random_numbers(funnels, monkeypatch):
    """Uniform on the slice and in the disc, whatever numpy's own generators do."""
    searches = []
    monkeypatch.setattr(funnel, "maximize", lambda function, dimensions, starts, **_: (searches.append(starts), None))
    recursion = funnels.inputs("corrected", ascent_starts=2000).of(funnel.true_maximum)["recursion"]
    funnel.true_maximum(recursion)(SimpleNamespace(true_values=None), None)
    seed, slice_points, disc = recursion.design_seed, *np.split(searches[0], [6], axis=1)
    drawn = normals(seed, funnel.TRUE_MAXIMUM, np.arange(2000), 8)[:, :6]
    np.testing.assert_array_equal(slice_points, drawn / np.linalg.norm(drawn, axis=1, keepdims=True))
    assert kstest(np.sum(disc**2, axis=1), "uniform").pvalue > 0.01
    assert kstest(np.arctan2(*disc.T), "uniform", args=(-np.pi, 2.0 * np.pi)).pvalue > 0.01


def test_where_the_level_rises(corrected):
    """Shares of fresh points; three standard errors of both studies, of which the other has many more points."""
    share = np.array([0.008, 0.37, 0.43, 0.11, 0.0004])
    error = np.sqrt(share * (1.0 - share) / 450) + 0.005 / 3.0
    np.testing.assert_array_less(np.abs(corrected.rising[[6, 12, 18, 30, 45]] - share), 3.0 * error)
    assert not corrected.rising_undisturbed.any()


def test_fig4(corrected, funnels, loop):
    axis, k = corrected.fig4_coordinate, 6
    assert corrected.time[k] == pytest.approx(24.17, abs=0.01) and corrected.level[k] == pytest.approx(
        0.18268, rel=1e-3
    )
    middle = len(axis) // 2
    assert corrected.fig4_rate[middle, middle] == 0.0 and axis[middle] == 0.0
    elsewhere = np.ones_like(corrected.fig4_rate, dtype=bool)
    elsewhere[middle, middle] = False
    assert (corrected.fig4_rate[elsewhere] < 0.0).all()
    assert (corrected.fig4_worst_rate >= corrected.fig4_rate).all() and (corrected.fig4_worst_rate > 0.0).any()
    # The circle meets the grid on the axes: first coordinate 1 to the right, second coordinate 4 upwards.
    one = int(np.argmin(np.abs(axis - 1.0)))
    quarter = len(corrected.fig4_circle) // 4
    for rate, circle in (
        (corrected.fig4_rate, corrected.fig4_circle_rate),
        (corrected.fig4_worst_rate, corrected.fig4_circle_worst_rate),
    ):
        np.testing.assert_allclose(rate[middle, one], circle[0], rtol=1e-9)
        np.testing.assert_allclose(rate[one, middle], circle[quarter], rtol=1e-9)
    points = np.zeros((1, 6))
    points[0, 3] = axis[one]
    up = deviations_of(corrected, k, points)
    expected = lyapunov_rate(
        loop, 2 * corrected.step[k], corrected.shape[k], shape_rate(funnels, corrected.step[k]), up, np.zeros((1, 2))
    )
    assert corrected.fig4_rate[one, middle] == pytest.approx(expected[0], rel=1e-12)
    assert corrected.samples.shape == (406, 8)
    np.testing.assert_allclose(np.linalg.norm(corrected.samples[:, :6], axis=1), 1.0, rtol=1e-12)


# --- as printed, and how a funnel fails -------------------------------------------------------------------------------


def test_literal_points_lie_on_no_slice(corrected):
    """V/rho of points that Eq. 26 scales would be 1; it is far from it in km and in m."""
    for ratio in (corrected.literal_level, corrected.literal_level_si):
        assert 1e5 < ratio[0, 0] < 1e6 and 3e7 < ratio[0, 1] < 1e8
        assert (ratio[:, 0] > 1e2).all() and (ratio[:, 0] <= ratio[:, 1]).all()
    literal = np.sqrt(2.0) * corrected.samples[:, :6] * [1e3, 1.0, 1.0, 1e3, 1.0, 1.0]
    one = 0.5 * literal[7] @ corrected.shape[20] @ literal[7] / corrected.level[20]
    assert corrected.literal_level[20, 0] <= one <= corrected.literal_level[20, 1]


def test_as_printed_the_levels_have_no_memory(funnels, loop, coarse_funnel, few_slices, corrected):
    slices = coarse_funnel("printed")
    assert slices.outcome == "complete" and np.isnan(slices.true_maximum).all()
    assert (slices.level[1:] > 1e6).all() and (slices.level[1:] < 1e11).all()
    inputs = funnels.stage_inputs("printed", "funnel", **few_slices)
    design = funnel.well_chosen_design(funnel.SPHERES, inputs.design_seed, funnel.BASIS_DEGREE)
    larger, _ = funnel.propagate(inputs.recursion, loop, replace(funnels.gains(), initial_level=1.8), design)
    assert larger.rho[0] == 1.8
    np.testing.assert_allclose(larger.rho[1:], slices.level[1:], rtol=1e-6)
    assert abs(slices.memory) < 1e-6 and 8.9 < corrected.memory < 9.1


def test_a_funnel_ends_where_it_exceeds_its_limit(funnels, coarse_funnel, few_slices, tmp_path):
    whole, slices = coarse_funnel("euler"), funnels.funnel("euler", **few_slices, largest_level=5.0)
    reached = int(np.argmax(whole.level > 5.0))
    assert 2 < reached < 10
    np.testing.assert_array_equal(slices.level[:reached], whole.level[:reached])
    np.testing.assert_array_equal(slices.bound[: reached - 1], whole.bound[: reached - 1])
    assert "diverges" in slices.outcome and f"slice {reached + 1} of 11" in slices.outcome
    for name in ("level", "feedback", "heat_rate", "rising", "log_volume"):
        values = getattr(slices, name)
        assert np.isfinite(values[:reached]).all() and np.isnan(values[reached:]).all(), name
    assert np.isnan(slices.bound[reached - 1 :]).all() and (slices.iterations[reached - 1 :] == 0).all()
    assert (slices.status[reached - 1 :] == "not solved").all() and not slices.sound
    assert slices.stage_sound[: reached - 1].all() and not slices.stage_sound[reached - 1 :].any()
    path = tmp_path / "funnel.h5"
    store.save(path, slices, paper="funnels", reading="corrected", provenance={})
    assert store.load(path, funnel.Funnel).outcome == slices.outcome


@pytest.mark.parametrize(
    ("changes", "fragment"),
    [({"largest_feedback": 1e-9}, "initial set is too large"), ({"largest_level": 0.18}, "slice 2 of 11")],
)
def test_a_funnel_without_a_stage_is_still_described(funnels, few_slices, tmp_path, changes, fragment):
    slices = funnels.funnel("corrected", **few_slices, **changes)
    assert fragment in slices.outcome and not slices.sound
    assert slices.level[0] == funnels.gains().initial_level and np.isnan(slices.level[1:]).all()
    assert np.isnan(slices.bound).all() and np.isfinite(slices.heat_rate[0])
    store.save(tmp_path / "funnel.h5", slices, paper="funnels", reading="corrected", provenance={})


def test_slices_of_least_trace_are_too_thin_for_so_long_a_step(coarse_funnel):
    slices = coarse_funnel("minkowski_shape")
    assert "diverges" in slices.outcome and (slices.level > 0.0).sum() == np.isfinite(slices.level).sum()
