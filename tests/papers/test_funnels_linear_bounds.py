"""Linear comparisons of the entry funnel: against closed forms, other recursions and flights."""

import numpy as np
import pytest

from generators import generator
from marsedl.methods.funnels.linear import slice_jacobians
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.sos.variety import Spheres
from marsedl.papers.funnels import environment, gains
from marsedl.papers.funnels.beyond import linear_bounds


@pytest.fixture(scope="module")
def inputs(funnels):
    return funnels.inputs("corrected")


@pytest.fixture(scope="module")
def loop(inputs, reference, design):
    air = environment.disturbed_air(inputs.planet, inputs.uncertainty)
    return environment.closed_loop(inputs.planet, inputs.vehicle, air, reference, design.half_gain)


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


def test_linear_flights_from_the_boundary_stay_below_the_exact_level(inputs, design, bounds, jacobians, loop):
    """With a disturbance that is drawn again in every slice, which the level allows."""
    steps, draw = environment.slices(loop, inputs.steps_per_slice), generator(3)
    across, pushed = linear_bounds.between_slices(*jacobians, steps)
    deviation = (Spheres((6,)).random_points(2000, draw) @ spread_of(design.shape[0], design.initial_level).T).T
    for k in range(len(across)):
        deviation = across[k] @ deviation + pushed[k] @ Spheres((2,)).random_points(2000, draw).T
        values = 0.5 * np.einsum("im,ij,jm->m", deviation, design.shape[steps[k + 1]], deviation)
        assert values.max() < bounds.exact_level[k + 1]


def test_own_shape_starts_and_stays_at_level_one(reference, funnels):
    inputs_with_shape = funnels.inputs("minkowski_shape")
    laws = inputs_with_shape.call(gains.compute, reference)
    bounds = inputs_with_shape.call(linear_bounds.compute, reference, laws)
    assert bounds.exact_level[0] == pytest.approx(1.0, rel=1e-12) and bounds.exact_level.max() <= 1 + 1e-9
