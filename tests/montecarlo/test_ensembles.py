"""A damped oscillator that flies two segments, and what must hold of its ensembles."""

from dataclasses import fields, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from marsedl.montecarlo.ensembles import (
    NON_FINITE,
    Trajectories,
    chunk_bounds,
    merge,
    run_blocks,
    without_infinities,
)
from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.lanes import LANES
from marsedl.montecarlo.streams import normals

SEED, INITIAL_STREAM, PROCESS_STREAM = 31, 0, 1
STEP, STEPS, STEPS_PER_OUTPUT = 0.05, (40, 24), 4
SIGMA, TARGET = 0.3, (0.0, 1.0)
TIMES = sum(steps // STEPS_PER_OUTPUT + 1 for steps in STEPS)
EDGES = np.linspace(0.0, 4.0, 81)[np.newaxis]


class State(NamedTuple):
    x: float
    v: float


class Force(NamedTuple):
    w: float


class Spring(NamedTuple):
    stiffness: np.ndarray  # on the half-step grid
    damping: float
    target: float


class Pull(NamedTuple):
    pull: float = -np.inf


def rates(half_index, state, noise, p) -> State:
    pull = p.stiffness[half_index] * (state.x - p.target)
    return State(state.v, -pull - p.damping * state.v + SIGMA * noise.w)


def observe(half_index, state, p) -> Pull:
    return Pull(np.abs(p.stiffness[half_index] * (state.x - p.target)))


def watch(watched, half_index, state, p) -> Pull:
    return Pull(np.maximum(watched.pull, np.abs(p.stiffness[half_index] * (state.x - p.target))))


FLIGHT = Flight(rates, observe=observe, watch=watch, noise=Force)


def tables(coarsening=1):
    """Stiffness of both segments on the half-step grid."""
    ends = np.cumsum([0.0, *STEPS]) * STEP
    grids = [np.linspace(a, b, 2 * n // coarsening + 1) for a, b, n in zip(ends[:-1], ends[1:], STEPS, strict=True)]
    return [1.0 + 0.5 * np.sin(grid) for grid in grids]


def fly(number, start, coarsening=1, scale=1.0, **options):
    """Segment `number` of the flight."""
    spring, duration = Spring(scale * tables(coarsening)[number], 0.5, TARGET[number]), STEPS[number] * STEP
    schedule = periods(duration, duration, STEPS[number] // coarsening, every=STEPS_PER_OUTPUT // coarsening)
    options |= {"seed": SEED, "increments": coarsening, "first_increment": sum(STEPS[:number])}
    return FLIGHT.fly(spring, schedule, start, streams=(PROCESS_STREAM, 0), **options)


def simulate_block(first, last, coarsening=1):
    start = np.array([[1.0], [0.0]]) + 0.2 * normals(SEED, INITIAL_STREAM, range(first, last), 2).T
    before = fly(0, start, coarsening, first_trial=first)
    after = fly(1, before, coarsening, first_trial=first)
    joined = {name: np.concatenate([getattr(p, name) for p in (before, after)]) for name in ("history", "observed")}
    return replace(after, **joined, length=before.length + after.length)


def assert_identical(a, b):
    assert vars(a).keys() == vars(b).keys()
    for name, value in vars(a).items():
        np.testing.assert_array_equal(value, getattr(b, name), err_msg=name, strict=True)


def oracle(first, last):
    """The same model, plainly, in numpy over all trials; outputs at every step."""
    x = np.array([[1.0], [0.0]]) + 0.2 * normals(SEED, INITIAL_STREAM, range(first, last), 2).T
    noise = normals(SEED, PROCESS_STREAM, range(first, last), sum(STEPS)).T * SIGMA / np.sqrt(STEP)
    states, observations = [], []
    start = 0
    for table, target, steps in zip(tables(), TARGET, STEPS, strict=True):

        def slope(half, x, w, table=table, target=target):
            return np.stack([x[1], -table[half] * (x[0] - target) - 0.5 * x[1] + w])

        for k in range(steps):
            states.append(x)
            observations.append(np.abs(table[2 * k] * (x[0] - target)))
            w = noise[start + k]
            k1 = slope(2 * k, x, w)
            k2 = slope(2 * k + 1, x + STEP / 2 * k1, w)
            k3 = slope(2 * k + 1, x + STEP / 2 * k2, w)
            k4 = slope(2 * k + 2, x + STEP * k3, w)
            x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
        observations.append(np.abs(table[2 * steps] * (x[0] - target)))
        start += steps
    return np.array(states), np.array(observations)


# ---- the flight ------------------------------------------------------------------------------------------------------


def test_a_flight_equals_plain_numpy():
    paths = simulate_block(100, 300)
    states, observations = oracle(100, 300)
    outputs = np.r_[0 : STEPS[0] + 1 : STEPS_PER_OUTPUT, STEPS[0] + 1 : states.shape[0] : STEPS_PER_OUTPUT]
    np.testing.assert_allclose(paths.history, states[outputs], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(paths.observed[:, 0], observations[outputs], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(paths.observed_maximum[0], observations.max(axis=0), rtol=1e-12)
    np.testing.assert_array_equal(paths.final_state, paths.history[-1])
    # the maximum of some trials lies between outputs, or the running maximum would not be tested
    assert (paths.observed_maximum[0] > paths.observed[:, 0].max(axis=0)).any()


def test_coarse_steps_follow_the_brownian_path_of_the_fine_ones():
    fine, coarse, coarser = (simulate_block(0, 500, coarsening).history for coarsening in (1, 2, 4))
    error, larger_error = (np.sqrt(np.mean((history - fine) ** 2)) for history in (coarse, coarser))
    scatter = np.sqrt(fine[-1].var(axis=-1).mean())
    assert 0.0 < error < 0.05 * scatter
    # strong order 1 with errors that are uncorrelated from one refinement to the next: as 1 to sqrt(1 + 2^2)
    assert larger_error / error == pytest.approx(np.sqrt(5.0), rel=0.1)
    # and other paths are as far away as they can be
    assert np.sqrt(np.mean((simulate_block(500, 1000).history[-1] - fine[-1]) ** 2)) > scatter


# ---- reduction -------------------------------------------------------------------------------------------------------


def run_chunks(chunks, trials=1130, block_size=100, simulate=simulate_block, kept=230):
    return [
        run_blocks(simulate, first, last, block_size=block_size, histogram_edges=EDGES, kept=kept)
        for first, last in chunk_bounds(trials, chunks, block_size)
    ]


def merged(chunks):
    return SimpleNamespace(**merge(chunks))


def test_merged_ensemble_equals_numpy_on_all_samples():
    paths = simulate_block(0, 1130)
    ensemble = merged(run_chunks(4))
    assert (ensemble.count, ensemble.excluded) == (1130, 0)
    np.testing.assert_array_equal(ensemble.flying, np.full(TIMES, 1130), strict=True)
    np.testing.assert_allclose(ensemble.mean, paths.history.mean(axis=-1), rtol=1e-12, atol=1e-14)
    covariance = np.array([np.cov(history) for history in paths.history])
    np.testing.assert_allclose(ensemble.covariance, covariance, rtol=1e-11, atol=1e-14)
    np.testing.assert_array_equal(ensemble.maximum_over_trials, paths.observed.max(axis=-1))
    np.testing.assert_array_equal(ensemble.final_state, paths.final_state.T)
    np.testing.assert_array_equal(ensemble.observed_maximum, paths.observed_maximum.T)
    np.testing.assert_array_equal(ensemble.outcome, np.zeros(1130, np.int8), strict=True)
    np.testing.assert_array_equal(ensemble.kept_history, np.moveaxis(paths.history[..., :230], -1, 0))
    np.testing.assert_array_equal(ensemble.kept_observed, np.moveaxis(paths.observed[..., :230], -1, 0))
    for time in range(TIMES):
        expected, _ = np.histogram(paths.observed[time, 0], EDGES[0])
        np.testing.assert_array_equal(ensemble.histogram[time, 0, 1:-1], expected)
    assert (ensemble.histogram.sum(axis=-1) == 1130).all()


@pytest.mark.parametrize("chunks", [3, 12])
def test_result_does_not_depend_on_the_number_of_chunks(chunks):
    assert_identical(merged(run_chunks(1)), merged(run_chunks(chunks)[::-1]))


def test_non_finite_trials_are_counted_and_left_out():
    bad = {17: np.nan, 400: np.inf, 1129: -np.inf}

    def simulate(first, last):
        paths = simulate_block(first, last)
        arrays = {field.name: np.array(getattr(paths, field.name)) for field in fields(paths)}
        for trial, value in bad.items():
            if first <= trial < last:
                arrays["history"][-1, 0, trial - first] = value
                arrays["final_state"][0, trial - first] = value
        if first <= 50 < last:
            arrays["outcome"][50 - first] = 2
        return Trajectories(**arrays)

    ensemble = merged(run_chunks(3, simulate=simulate))
    good = np.setdiff1d(np.arange(1130), list(bad))
    paths = simulate_block(0, 1130)
    assert (ensemble.count, ensemble.excluded) == (1127, 3)
    np.testing.assert_array_equal(np.flatnonzero(ensemble.outcome == NON_FINITE), sorted(bad))
    np.testing.assert_array_equal(np.flatnonzero(ensemble.outcome == 2), [50])
    np.testing.assert_array_equal(ensemble.final_state[list(bad), 0], list(bad.values()))
    np.testing.assert_allclose(ensemble.mean, paths.history[..., good].mean(axis=-1), rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(ensemble.histogram.sum(axis=-1), np.full((TIMES, 1), 1127))


def test_nothing_but_non_finite_trials():
    def simulate(first, last):
        paths = simulate_block(first, last)
        return replace(paths, history=np.full_like(paths.history, np.nan))

    ensemble = merged(run_chunks(2, trials=150, simulate=simulate, kept=0))
    assert (ensemble.count, ensemble.excluded) == (0, 150)
    assert np.isnan(ensemble.mean).all()
    assert np.isnan(ensemble.covariance).all()


def test_a_trial_that_diverges_inside_the_kernel_shows_it():
    paths = fly(0, np.ones((2, LANES)), scale=-1e18)
    assert not np.isfinite(paths.observed_maximum).any()
    chunk = run_blocks(lambda first, last: paths.first(last - first), 0, LANES)
    assert (chunk["outcome"] == NON_FINITE).all()


def test_histogram_counts_what_lies_outside_and_on_the_edges():
    values = np.array([-0.1, 0.0, 0.1, 0.3, 0.7, 0.7999999999999999, 0.8, 5.0])
    uneven = np.array([[0.0, 0.1, 0.3, 0.8]])

    def simulate(first, last):
        empty = np.zeros((1, 1, last - first))
        zeros, ones = np.zeros(last - first, np.int8), np.ones(last - first, np.int64)
        return Trajectories(empty, values[np.newaxis, np.newaxis], empty[0], empty[0], zeros, ones)

    chunk = run_blocks(simulate, 0, values.size, histogram_edges=uneven)
    np.testing.assert_array_equal(chunk["histogram"][0, 0], [1, 1, 1, 3, 2])


# ---- trials that end at their own times ------------------------------------------------------------------------------


def own_lengths(first, last):
    """Outputs of trials: some end at once, many in the last third, trial 8 alone is left at the last output."""
    trials = np.arange(first, last)
    lengths = np.where(trials % 97 == 5, 1, TIMES - 1 - trials * 7 % (TIMES // 3))
    return np.where(trials == 8, TIMES, lengths)


def ending(first, last, beyond=np.nan):
    """The oscillator with trials that end early: their final state stands at their end, with the time below it."""
    paths = simulate_block(first, last)
    lengths = own_lengths(first, last)
    ended = np.arange(TIMES)[:, np.newaxis, np.newaxis] >= lengths
    history, observed = np.where(ended, beyond, paths.history), np.where(ended, beyond, paths.observed)
    final_state = np.vstack([paths.history[lengths - 1, :, np.arange(last - first)].T, 0.2 * lengths])
    return replace(paths, history=history, observed=observed, final_state=final_state, length=lengths)


def test_moments_are_those_of_the_trials_still_flying():
    paths, lengths = simulate_block(0, 1130), own_lengths(0, 1130)
    ensemble = merged(run_chunks(4, simulate=ending))
    assert (ensemble.count, ensemble.excluded) == (1130, 0)
    assert (ensemble.outcome == 0).all()
    assert ensemble.flying[0] == 1130 and ensemble.flying[-1] == 1
    for time in range(TIMES):
        flying = lengths > time
        assert ensemble.flying[time] == flying.sum()
        history, observed = paths.history[time][:, flying], paths.observed[time][:, flying]
        np.testing.assert_allclose(ensemble.mean[time], history.mean(axis=-1), rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(ensemble.observed_mean[time], observed.mean(axis=-1), rtol=1e-12)
        np.testing.assert_array_equal(ensemble.maximum_over_trials[time], observed.max(axis=-1))
        np.testing.assert_array_equal(ensemble.histogram[time, 0, 1:-1], np.histogram(observed[0], EDGES[0])[0])
        if time < TIMES - 1:
            np.testing.assert_allclose(ensemble.covariance[time], np.cov(history), rtol=1e-11, atol=1e-14)
    assert np.isnan(ensemble.covariance[-1]).all()  # of one trial
    np.testing.assert_array_equal(ensemble.final_state[:, 2], 0.2 * lengths)
    for trial in range(230):
        end = lengths[trial]
        np.testing.assert_array_equal(ensemble.kept_history[trial, :end], paths.history[:end, :, trial])
        np.testing.assert_array_equal(ensemble.kept_observed[trial, :end], paths.observed[:end, :, trial])
    has_ended = np.isnan(ensemble.kept_history).all(axis=2)
    np.testing.assert_array_equal(has_ended.sum(axis=1), TIMES - lengths[:230])


def test_a_trial_is_non_finite_by_its_valid_numbers_only():
    def simulate(first, last):
        paths = ending(first, last)
        for trial, output in ((20, -1), (21, 0)):  # the last valid output, and the first invalid one
            if first <= trial < last:
                paths.history[own_lengths(trial, trial + 1)[0] + output, 1, trial - first] = np.inf
        return paths

    ensemble = merged(run_chunks(2, simulate=simulate))
    np.testing.assert_array_equal(np.flatnonzero(ensemble.outcome == NON_FINITE), [20])
    assert (ensemble.count, ensemble.excluded) == (1129, 1)
    finite_trials = np.arange(1130) != 20
    flying = (own_lengths(0, 1130)[finite_trials, np.newaxis] > np.arange(TIMES)).sum(axis=0)
    np.testing.assert_array_equal(ensemble.flying, flying)


def test_infinite_numbers_become_storable():
    np.testing.assert_array_equal(without_infinities(np.array([1.0, np.inf, -np.inf, np.nan])), [1.0, *[np.nan] * 3])
    assert without_infinities(7) == 7
    np.testing.assert_array_equal(without_infinities(np.array([3])), np.array([3]), strict=True)


# ---- bounds and chunks -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trials", [1, 1000, 12_345])
@pytest.mark.parametrize("chunks", [1, 5, 40])
def test_chunk_bounds_cover_all_trials_in_whole_blocks(trials, chunks):
    bounds = chunk_bounds(trials, chunks)
    assert bounds[0][0] == 0
    assert bounds[-1][1] == trials
    assert all(a[1] == b[0] for a, b in pairwise(bounds))
    assert all(first % 1000 == 0 and last > first for first, last in bounds)
    assert len(bounds) == min(chunks, -(-trials // 1000))
    sizes = [-(-(last - first) // 1000) for first, last in bounds]
    assert max(sizes) - min(sizes) <= 1


def test_wrong_bounds_and_chunks_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        chunk_bounds(10, 0)
    with pytest.raises(ValueError, match="multiple of block_size"):
        run_blocks(simulate_block, 10, 200, block_size=100)
    chunks = run_chunks(3)
    for wrong in (chunks[1:], [chunks[0], chunks[2]], [*chunks, chunks[1]], []):
        with pytest.raises(ValueError, match=r"expected|no chunks"):
            merge(wrong)
