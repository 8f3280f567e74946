"""Linear comparisons of the entry funnel: against closed forms, other recursions and flights."""

import numpy as np
import pytest
from scipy.stats import kstest

from marsedl.methods.funnels.linear import slice_jacobians, whitened_step
from marsedl.methods.funnels.monte_carlo import boundary_deviations, uniform_directions
from marsedl.papers.funnels import environment, gains, linear_bounds
from marsedl.replication import artifacts


@pytest.fixture(scope="module")
def inputs_of(funnels):
    """Inputs of a reading, some of them changed."""
    return funnels.inputs


@pytest.fixture(scope="module")
def inputs(inputs_of):
    return inputs_of("corrected")


@pytest.fixture(scope="module")
def loop(inputs, reference, design):
    air = environment.disturbed_air(inputs.planet, inputs.uncertainty)
    return environment.closed_loop(inputs.planet, inputs.vehicle, air, reference, design.half_gain)


@pytest.fixture(scope="module")
def semi_axes(inputs):
    return environment.initial_semi_axes(inputs.planet, inputs.uncertainty)


@pytest.fixture(scope="module")
def reference(funnels):
    return funnels.linearization()


@pytest.fixture(scope="module")
def design(funnels):
    return funnels.gains()


@pytest.fixture(scope="module")
def bounds(inputs, reference, design):
    return inputs.call(linear_bounds.compute, reference, design)


@pytest.fixture(scope="module")
def jacobians(loop):
    """(Phi, Gamma) of every fine step."""
    return slice_jacobians(loop, np.arange(len(loop.time)))[:2]


def generator(seed=3):
    return np.random.Generator(np.random.Philox(seed))


# ---- levels ----------------------------------------------------------------------------------------------------------


def test_levels_at_every_fifth_slice(bounds):
    """An independent computation about a nominal of another transcription; its ascent may end a little below."""
    exact = [0.1793, 0.1810, 0.2025, 0.3747, 1.2661, 3.2405, 5.5006, 7.3095, 8.3701, 8.7291, 8.4703, 7.6294, 6.4790]
    triangle = [0.1793, 0.1831, 0.2199, 0.4915, 2.0047, 5.6604, 9.770, 12.902, 14.801, 15.624, 15.597, 14.837, 13.003]
    assert bounds.exact_level[::5] == pytest.approx(exact, rel=1e-3)
    assert (bounds.exact_level[::5] > np.array(exact) - 6e-5).all()
    assert bounds.triangle_level[::5] == pytest.approx(triangle, rel=5e-4)
    assert bounds.exact_level.max() == pytest.approx(8.729, rel=5e-4)
    assert bounds.triangle_level.max() == pytest.approx(15.70, rel=5e-4)


def test_levels_are_in_order_and_fall_without_disturbance(bounds):
    assert (bounds.undisturbed_level[1:] < bounds.exact_level[1:]).all()
    assert (bounds.exact_level[1:] < bounds.triangle_level[1:]).all()
    assert (np.diff(bounds.undisturbed_level) < 0).all()


def test_jacobians_between_slices_are_those_of_the_flow(inputs, reference, design, jacobians, loop):
    steps = environment.slices(loop, inputs.steps_per_slice)
    across, pushed = linear_bounds.between_slices(*jacobians, steps)
    scale = environment.state_scale(inputs.planet, inputs.guidance)
    for k in (0, 25, 59):
        transition, response, _ = loop.flow_jacobians(steps[k], steps[k + 1])
        assert across[k] * scale / scale[:, None] == pytest.approx(transition * scale / scale[:, None], abs=1e-11)
        assert pushed[k] / scale[:, None] == pytest.approx(response / scale[:, None], abs=1e-11)


@pytest.mark.parametrize("k", [2, 20, 45])
def test_exact_level_is_reached_by_alternating_ascent(inputs, design, bounds, jacobians, k, loop):
    steps = environment.slices(loop, inputs.steps_per_slice)
    across, pushed = linear_bounds.between_slices(*jacobians, steps)
    a, b = whitened_step(across[k], pushed[k], design.shape[steps[k]], design.shape[steps[k + 1]])
    a = np.sqrt(bounds.exact_level[k]) * a
    y = uniform_directions(generator(k), 50, 6).T
    for _ in range(3000):
        w = b.T @ a @ y
        w /= np.linalg.norm(w, axis=0)
        # The best y for a given w solves a trust-region problem; an ascent step along the gradient needs no solver.
        y = a.T @ (a @ y + b @ w)
        y /= np.linalg.norm(y, axis=0)
    reached = np.sum((a @ y + b @ w) ** 2, axis=0).max()
    assert reached <= bounds.exact_level[k + 1] * (1 + 1e-9)
    assert reached == pytest.approx(bounds.exact_level[k + 1], rel=1e-6)


def test_linear_flights_from_the_boundary_stay_below_the_exact_level(inputs, design, bounds, jacobians, loop):
    """With a disturbance that is drawn again in every slice, which the level allows."""
    steps, draw = environment.slices(loop, inputs.steps_per_slice), generator()
    across, pushed = linear_bounds.between_slices(*jacobians, steps)
    deviation = boundary_deviations(design.shape[0], design.initial_level, uniform_directions(draw, 2000, 6)).T
    for k in range(len(across)):
        deviation = across[k] @ deviation + pushed[k] @ uniform_directions(draw, 2000, 2).T
        values = 0.5 * np.einsum("im,ij,jm->m", deviation, design.shape[steps[k + 1]], deviation)
        assert values.max() < bounds.exact_level[k + 1]


# ---- the joint ellipsoid ---------------------------------------------------------------------------------------------


def test_joint_ellipsoid_is_the_image_of_the_joint_ball(inputs, bounds, jacobians, semi_axes):
    for last in (1, 100, 240):
        transition, response = (one[0] for one in linear_bounds.between_slices(*jacobians, np.array([0, last])))
        spread = np.hstack([transition * semi_axes, response])
        assert bounds.joint_half_width[last] == pytest.approx(np.linalg.norm(spread, axis=1), rel=1e-8)
    assert bounds.joint_half_width[0] == pytest.approx(semi_axes, rel=1e-12)
    downrange = inputs.planet_radius * bounds.joint_half_width[-1, 1]
    assert downrange == pytest.approx(3617.0, abs=2.0)
    assert bounds.joint_condition[0] == pytest.approx(36.0, rel=1e-9)
    assert bounds.joint_condition.max() > 1e4  # far flatter than any slice


def test_starts_are_uniform_in_the_initial_set_under_disturbances_at_their_limit(inputs, semi_axes):
    deviations, disturbances = linear_bounds.starts(inputs.seed, semi_axes)
    assert np.linalg.norm(disturbances, axis=1) == pytest.approx(np.ones(linear_bounds.FLIGHTS), abs=1e-14)
    whitened = deviations / semi_axes
    assert 0.5 * np.einsum("mi,ij,mj->m", deviations, environment.initial_set(semi_axes), deviations).max() < 1
    assert kstest(np.linalg.norm(whitened, axis=1) ** 6, "uniform").pvalue > 0.001
    # A coordinate of a uniform point of the six-ball has variance 1/8.
    assert whitened.T @ whitened / len(whitened) == pytest.approx(np.eye(6) / 8, abs=0.012)
    assert kstest((np.arctan2(*disturbances.T) / np.pi + 1) / 2, "uniform").pvalue > 0.001


def test_flights_leave_the_joint_ellipsoid_and_what_holds_all_linear_ones(bounds):
    assert bounds.lost == 0
    assert bounds.largest_value[0] == bounds.largest_linear_value[0] <= 1
    assert bounds.largest_linear_value.max() <= linear_bounds.BOTH_LIMITS * (1 + 1e-9)
    assert bounds.largest_linear_value.max() > 1.95
    # Nearly all linear flights leave it too: it does not hold starts and disturbances that are at their limits at once.
    assert bounds.linear_share_outside > 0.99 and bounds.share_outside > 0.99
    assert 0.05 < bounds.share_beyond < 0.15
    assert 2.3 < bounds.largest_value.max() < 3.2
    assert bounds.flown_half_width[-1, 1] * 3389.5 == pytest.approx(3.80, abs=0.1)


def test_flights_of_small_sets_are_linear(inputs, reference, design, inputs_of):
    tiny = {"density_amplitude": 5e-5, "density_slope_amplitude": 1e-9, "initial_velocity": 1.5e-3}
    tiny |= {
        "initial_lengths": tuple(0.001 * x for x in inputs.initial_lengths),
        "initial_angles": tuple(0.001 * x for x in inputs.initial_angles),
    }
    small = inputs_of("corrected", **tiny).call(linear_bounds.compute, reference, design)
    assert small.largest_value == pytest.approx(small.largest_linear_value, rel=2e-3)
    assert small.share_beyond == 0.0
    assert small.share_outside == pytest.approx(small.linear_share_outside, abs=2 / linear_bounds.FLIGHTS)


# ---- the shape around what is reached --------------------------------------------------------------------------------


def test_reachable_ellipsoids_hold_linear_flights_and_little_more(inputs, bounds, jacobians, semi_axes):
    assert bounds.reachable_half_width[0] == pytest.approx(semi_axes, rel=1e-9)
    assert bounds.reachable_level[0] == 1.0 and bounds.reachable_level.max() <= 1 + 1e-9
    deviation, pushed = (sample.T for sample in linear_bounds.starts(inputs.seed, semi_axes))
    for k, (transition, response) in enumerate(zip(*jacobians, strict=True)):
        deviation = transition @ deviation + response @ pushed
        assert (np.abs(deviation).max(axis=1) <= bounds.reachable_half_width[k + 1] * (1 + 1e-12)).all()
    assert bounds.reachable_half_width[-1, 1] < 1.5 * np.abs(deviation[1]).max()


def test_own_shape_starts_and_stays_at_level_one(reference, inputs_of):
    inputs_with_shape = inputs_of("minkowski_shape")
    laws = inputs_with_shape.call(gains.compute, reference)
    bounds = inputs_with_shape.call(linear_bounds.compute, reference, laws)
    assert bounds.exact_level == pytest.approx(bounds.reachable_level, rel=1e-6)
    steps = bounds.slice_step
    assert bounds.exact_half_width == pytest.approx(
        bounds.reachable_half_width[steps] * np.sqrt(bounds.exact_level)[:, None], rel=1e-6
    )


def test_other_readings_of_the_same_sets_have_the_same_bounds(funnels, inputs):
    """As nothing that the stages may use differs."""
    for stage in ("nominal", "linearization", "gains", "linear_bounds"):
        names = funnels.paper.stages[stage].inputs
        expected = funnels.study.readings["corrected"].slice(names)
        for reading in ("printed", "euler", "inflated", "additive"):
            assert funnels.study.readings[reading].slice(names) == expected, (stage, reading)
        assert (funnels.study.readings["minkowski_shape"].slice(names) == expected) == (stage != "gains")


def test_artifact_survives_its_file(bounds, tmp_path):
    path = tmp_path / "linear_bounds.h5"
    artifacts.save(path, bounds, paper="funnels", reading="corrected", provenance={})
    back = artifacts.load(path, linear_bounds.LinearBounds, paper="funnels", reading="corrected")
    for name in artifacts.quantities(linear_bounds.LinearBounds):
        assert np.array_equal(getattr(back, name), getattr(bounds, name)), name


def test_flights_that_are_lost_are_counted(inputs, reference, design, inputs_of):
    huge = {"initial_lengths": (1.5e6, 2.5e6, 2.5e6), "initial_angles": (1.5, 1.5), "initial_velocity": 5e4}
    bounds = inputs_of("corrected", **huge).call(linear_bounds.compute, reference, design)
    assert 0 < bounds.lost <= bounds.flights
    assert np.isnan(bounds.largest_value[-1]) and np.isfinite(bounds.largest_linear_value).all()
