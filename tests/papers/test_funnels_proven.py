"""The proven funnel: nothing that is found lies above it, it is not far above that, and it says where it ends.

A part of the entry stands for all of it: four stages while the level rises fastest.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.methods.funnels.monte_carlo import fly, greedy_disturbance
from marsedl.methods.funnels.stage import FunnelStage, spread_of
from marsedl.methods.sos.variety import Spheres
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.beyond import proven
from marsedl.replication.records import store
from starts import maximize_from_random_starts as maximize

FIRST, STEPS, LEVEL = 76, 16, 1.2


@pytest.fixture(scope="module")
def inputs(funnels):
    return funnels.stage_inputs("corrected", "proven")


@pytest.fixture(scope="module")
def part(funnels):
    """Reference, regulator and shapes of the stages, and their first level."""
    linear_model, designed = funnels.linearization(), funnels.gains()
    nodes, half = slice(FIRST, FIRST + STEPS + 1), slice(2 * FIRST, 2 * (FIRST + STEPS) + 1)
    linearization = SimpleNamespace(
        time=linear_model.time[nodes],
        state=linear_model.state[half],
        bank=linear_model.bank[half],
    )
    gains = SimpleNamespace(half_gain=designed.half_gain[half], shape=designed.shape[nodes], initial_level=LEVEL)
    return linearization, gains


@pytest.fixture(scope="module")
def loop(inputs, part):
    air = environment.disturbed_air(inputs.planet, inputs.uncertainty)
    return environment.closed_loop(inputs.planet, inputs.vehicle, air, part[0], part[1].half_gain)


@pytest.fixture(scope="module")
def proof(inputs, part):
    return inputs.call(proven.compute, *part)


def test_all_stages_are_proven_and_levels_are_products_of_their_bounds(proof):
    assert proof.proven and proof.outcome == "complete"
    np.testing.assert_array_equal(proof.step, np.arange(0, STEPS + 1, 4))
    np.testing.assert_array_equal(proof.time, proof.node_time[proof.step])
    np.testing.assert_array_equal(proof.level, proof.node_level[proof.step])
    np.testing.assert_allclose(proof.level, LEVEL * np.cumprod([1.0, *proof.bound]), rtol=1e-14)
    parts = proof.polynomial_bound + proof.truncation + proof.remainder + proof.rise
    np.testing.assert_allclose(proof.bound, parts, rtol=1e-14)
    assert (proof.truncation > 0).all() and (proof.remainder > 0).all()
    # The polynomial is convex along a direction, so that it is largest on the boundary of the slice.
    np.testing.assert_array_equal(proof.rise, 0.0)
    assert (proof.basis_size, proof.samples) == (53, 606)


def test_motion_stays_below_the_levels_of_all_nodes_and_comes_close(proof, loop, part):
    shape = part[1].shape
    for first, level in ((0, proof.level[0]), (12, proof.level[3])):
        for node in range(first + 1, first + 5):
            stage = FunnelStage(loop, first, node, shape[first], shape[node], level)
            largest, _ = maximize(stage.true_values, (6, 2), 3, full_ball=(True, True), starts=300, polished=5)
            assert largest * level <= proof.node_level[node]
        # What is proven in excess: known terms of higher degrees where the polynomial is largest, and the remainder.
        assert proof.node_level[node] < 1.005 * largest * level


def test_flights_stay_inside_under_disturbances_that_change_between_stages(proof, loop, part):
    random = np.random.Generator(np.random.Philox(7))
    starts = Spheres((6,)).random_points(500, random) @ spread_of(part[1].shape[0], LEVEL).T
    directions = Spheres((2,)).random_points(24, random)
    inside = 0.8 * starts
    redrawn = Spheres((2,)).random_points(4 * 500, random).reshape(4, 500, 2)
    for deviations, disturbance in ((starts, redrawn), (inside, redrawn), (starts, greedy_disturbance(directions))):
        levels = fly(loop, part[1].shape, deviations, disturbance)
        assert (levels <= proof.node_level[:, np.newaxis] * (1 + 1e-12)).all()
    # The last ones use most of the level; their disturbance even changes within stages, of which nothing is proven.
    assert levels[-1].max() > 0.5 * proof.level[-1]
    too_strong = fly(loop, part[1].shape, starts, 3.0 * greedy_constant(loop, part, starts, directions))
    assert too_strong[-1].max() > proof.level[-1]


def greedy_constant(loop, part, starts, directions):
    """For every flight the constant disturbance, of some, that ends highest."""
    ends = [fly(loop, part[1].shape, starts, np.tile(w, (len(starts), 1)))[-1] for w in directions]
    return directions[np.argmax(ends, axis=0)]


def test_half_widths_are_the_largest_in_the_levels(proof, part):
    random = np.random.Generator(np.random.Philox(8))
    for k in (0, 3):
        directions = Spheres((6,)).random_points(20_000, random)
        largest = np.abs(directions @ spread_of(part[1].shape[4 * k], proof.level[k]).T).max(axis=0)
        assert (largest <= proof.half_width[k]).all() and (largest > 0.97 * proof.half_width[k]).all()


def test_a_slice_too_large_is_where_the_proof_ends(inputs, part, tmp_path):
    large = SimpleNamespace(**{**vars(part[1]), "initial_level": 300.0})
    ended = inputs.call(proven.compute, part[0], large)
    assert not ended.proven
    assert ended.outcome.startswith("nothing is proven after slice ")
    reached = int(ended.outcome.split("slice ")[1].split(",")[0])
    assert np.isfinite(ended.level[:reached]).all() and np.isnan(ended.level[reached:]).all()
    assert np.isfinite(ended.bound[: reached - 1]).all() and np.isnan(ended.bound[reached - 1 :]).all()
    path = tmp_path / "proven.h5"
    store.save(path, ended, paper="funnels", reading="corrected", provenance={})
    assert store.load(path, proven.Proven).outcome == ended.outcome


def test_nothing_is_proven_with_disturbances_of_all_rates(funnels, part):
    added = funnels.stage_inputs("additive", "proven").call(proven.compute, *part)
    assert not added.proven and added.outcome == proven.NO_ADDITIVE
    assert added.level[0] == LEVEL
    for name in ("bound", "polynomial_bound", "truncation", "remainder", "rise"):
        assert np.isnan(getattr(added, name)).all()
    assert np.isnan(added.node_level[1:]).all()
