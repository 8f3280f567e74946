"""Ensembles too large to keep every trial: equal for any chunks, right moments, percentiles within their bound."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from ddsketch.ddsketch import BaseDDSketch
from ddsketch.mapping import CubicallyInterpolatedMapping
from ddsketch.store import DenseStore
from scipy import stats

from marsedl.montecarlo import streaming
from marsedl.montecarlo.ensembles import (
    Ensemble,
    StreamedEnsemble,
    Trajectories,
    chunk_bounds,
    merge,
    run_blocks,
)
from marsedl.montecarlo.outcomes import CRASHED, NON_FINITE
from marsedl.montecarlo.statistics import covariance_standard_errors, percentile
from marsedl.montecarlo.streaming import (
    RELATIVE_ACCURACY,
    FinalMoments,
    Sketch,
    final_extremes,
    final_percentile,
    is_streamed,
    observed_maxima,
    outcome_count,
    sketched_percentile,
)

TRIALS, EXACT, BLOCK, TIMES, KEPT = 2360, 250, 20, 3, 30
CENTRE = np.array([5.0, 0.0, 0.0])
LEVELS = (0.001, 0.01, 0.05, 0.5, 0.9, 0.99, 0.999)


@pytest.fixture(autouse=True)
def few_exact_trials(monkeypatch):
    monkeypatch.setattr(streaming, "EXACT_TRIALS", EXACT)


def made_up_flights():
    """All trials, of which some are not finite, some crash and some end early."""
    rng = np.random.Generator(np.random.Philox(11))
    final = rng.normal(size=(3, TRIALS)) * [[10.0], [1e-3], [2.0]] + [[5.0], [0.0], [1e4]]
    outcome = np.zeros(TRIALS, np.int8)
    outcome[[4, 900]] = CRASHED
    final[1, [17, 2359]] = np.nan, np.inf
    length = np.where(np.arange(TRIALS) % 7 == 0, 2, TIMES)
    history, observed = rng.normal(size=(TIMES, 2, TRIALS)) + 1e3, rng.normal(size=(TIMES, 1, TRIALS))
    return Trajectories(history, observed, observed.max(axis=0), final, outcome, length)


FLIGHTS = made_up_flights()
FINITE = np.isfinite(FLIGHTS.final_state).all(axis=0)


def simulate_block(first, last):
    return Trajectories(*(getattr(FLIGHTS, field.name)[..., first:last] for field in fields(FLIGHTS)))


def chunks_of(number, simulate=simulate_block, trials=TRIALS, **options):
    options = {"block_size": BLOCK, "kept": KEPT, "trials": trials, "centre": CENTRE} | options
    return [run_blocks(simulate, *bounds, **options) for bounds in chunk_bounds(trials, number, BLOCK)]


def assert_identical(first, second):
    assert type(first) is type(second)
    for field in fields(first):
        np.testing.assert_array_equal(
            getattr(first, field.name), getattr(second, field.name), err_msg=field.name, strict=True
        )


# ---- ensembles -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [3, 31])
def test_result_does_not_depend_on_the_number_of_chunks(number):
    assert_identical(merge(chunks_of(1)), merge(chunks_of(number)[::-1]))


def test_moments_and_counts_are_those_of_all_trials():
    ensemble = merge(chunks_of(5))
    assert isinstance(ensemble, StreamedEnsemble) and is_streamed(ensemble)
    final = FLIGHTS.final_state[:, FINITE]
    np.testing.assert_allclose(ensemble.final_mean, final.mean(axis=1), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(ensemble.final_covariance, np.cov(final), rtol=1e-9, atol=1e-12)
    for time in range(TIMES):
        flying = FINITE & (FLIGHTS.length > time)
        assert ensemble.flying[time] == flying.sum()
        np.testing.assert_allclose(ensemble.mean[time], FLIGHTS.history[time][:, flying].mean(axis=1), rtol=1e-13)
        np.testing.assert_allclose(ensemble.covariance[time], np.cov(FLIGHTS.history[time][:, flying]), rtol=1e-9)
        observed = FLIGHTS.observed[time][:, flying]
        np.testing.assert_allclose(ensemble.observed_mean[time], observed.mean(axis=1), rtol=1e-11, atol=1e-13)
    assert (ensemble.count, ensemble.excluded) == (TRIALS - 2, 2)
    assert [outcome_count(ensemble, code) for code in (0, CRASHED, NON_FINITE)] == [TRIALS - 4, 2, 2]
    np.testing.assert_array_equal(ensemble.lowest[:3], final.min(axis=1))
    np.testing.assert_array_equal(final_extremes(ensemble, 0), [final[0].min(), final[0].max()])
    assert observed_maxima(ensemble, 0) == [FLIGHTS.observed_maximum[0, FINITE].max()]


def test_no_finite_trial():
    def simulate(first, last):
        return replace(simulate_block(first, last), final_state=np.full((3, last - first), np.nan))

    ensemble = merge(chunks_of(3, simulate))
    assert (ensemble.count, ensemble.excluded) == (0, TRIALS)
    assert np.isnan(ensemble.final_mean).all() and np.isnan(ensemble.lowest).all() and len(ensemble.cell_key) == 0
    assert np.isnan(final_percentile(ensemble, 0, 0.5)).all()


# ---- percentiles -----------------------------------------------------------------------------------------------------


def sketch_of(*samples, centre=0.0):
    sketch = Sketch(np.full(len(samples), centre))
    for block in np.array_split(np.array(samples), 7, axis=1):
        sketch.add(block)
    return SimpleNamespace(**sketch.cells())


RNG = np.random.Generator(np.random.Philox(5))
SAMPLES = {
    "normal": RNG.normal(size=9001),
    "far_from_zero": RNG.normal(1e3, 1.0, 9001),
    "heavy_tails": RNG.standard_cauchy(9001),
    "lognormal": RNG.lognormal(sigma=4.0, size=9001),
    "numbers": RNG.poisson(2.0, 9001).astype(float),
    "zeros_and_signs": RNG.integers(-1, 2, 9001) * RNG.exponential(size=9001),
    "one": np.full(9001, -3.7),
    "tiny": RNG.normal(size=9001) * 1e-290,
}


@pytest.mark.parametrize("name", SAMPLES)
def test_percentiles_are_those_of_the_librarys_sketch_and_within_its_bound(name):
    samples, cells = SAMPLES[name], sketch_of(SAMPLES[name])
    library = BaseDDSketch(CubicallyInterpolatedMapping(RELATIVE_ACCURACY), DenseStore(4096), DenseStore(4096), 0.0)
    for value in samples.tolist():
        library.add(value)
    ordered = np.sort(samples)
    for level in LEVELS:
        actual, _ = sketched_percentile(cells, 0, level)
        assert actual == library.get_quantile_value(level)
        exact = ordered[int(level * (len(samples) - 1))]
        assert abs(actual - exact) <= RELATIVE_ACCURACY * (1 + 1e-9) * abs(exact)
    assert cells.cell_count.sum() == len(samples)
    assert (cells.lowest[0], cells.highest[0]) == (ordered[0], ordered[-1])


def test_a_centre_makes_the_bound_count_from_there():
    samples = RNG.normal(1e6, 1.0, 9001)
    cells = sketch_of(samples, centre=1e6)
    for level in LEVELS:
        exact = np.sort(samples)[int(level * 9000)]
        assert abs(sketched_percentile(cells, 0, level)[0] - exact) <= RELATIVE_ACCURACY * abs(exact - 1e6) + 1e-9


def test_standard_errors_shrink_with_the_root_of_the_number_of_trials():
    """Over forty ensembles of each size: the mean error is the theoretical one, and so is the percentiles' scatter."""
    levels, sets = np.array([0.01, 0.05, 0.5, 0.99]), 40
    theory = np.sqrt(levels * (1 - levels)) / stats.norm.pdf(stats.norm.ppf(levels))
    for trials in (1_000, 10_000, 100_000):
        generator = np.random.Generator(np.random.Philox(trials))
        sample_sets = [generator.normal(size=trials) for _ in range(sets)]
        actual = np.array([[sketched_percentile(cells, 0, p) for p in levels] for cells in map(sketch_of, sample_sets)])
        np.testing.assert_allclose(actual[..., 1].mean(axis=0), theory / np.sqrt(trials), rtol=0.15)
        np.testing.assert_allclose(actual[..., 0].std(axis=0), theory / np.sqrt(trials), rtol=0.4)
        assert (
            np.abs(actual[..., 0].mean(axis=0) - stats.norm.ppf(levels)) < 4 * theory / np.sqrt(trials * sets)
        ).all()
        exact = np.array([[percentile(samples, level) for level in levels] for samples in sample_sets[:3]])
        np.testing.assert_allclose(actual[:3, :, 0], exact[..., 0], rtol=RELATIVE_ACCURACY, atol=3e-6)
        np.testing.assert_allclose(actual[:3, :, 1], exact[..., 1], rtol=0.02)


# ---- either kind of ensemble -----------------------------------------------------------------------------------------


def test_what_users_ask_for_agrees_between_both_kinds(monkeypatch):
    streamed = merge(chunks_of(3))
    monkeypatch.setattr(streaming, "EXACT_TRIALS", TRIALS)
    exact = merge(chunks_of(3))
    assert type(exact) is Ensemble
    for level in LEVELS[1:-1]:
        actual, expected = (final_percentile(ensemble, 0, level, reference=5.0) for ensemble in (streamed, exact))
        assert actual[0] == pytest.approx(expected[0], abs=0.2 * expected[1])  # interpolated between samples, or not
        assert actual[1] == pytest.approx(expected[1], rel=1e-3)
    assert outcome_count(exact, CRASHED) == outcome_count(streamed, CRASHED) == 2

    samples = FLIGHTS.final_state[:, FINITE].T
    moments = FinalMoments(streamed, slice(2))
    assert moments.count == len(samples)
    np.testing.assert_allclose(moments.mean, samples[:, :2].mean(axis=0), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(moments.variance, samples[:, :2].var(axis=0, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(moments.population_deviation, samples[:, :2].std(axis=0), rtol=1e-9)
    np.testing.assert_allclose(moments.covariance, np.cov(samples[:, :2], rowvar=False), rtol=1e-9, atol=1e-12)
    errors = covariance_standard_errors(samples[:, :2])
    np.testing.assert_allclose(moments.covariance_errors, errors, rtol=0.4)  # from a tenth of the trials
    mass = FinalMoments(streamed, 2)
    assert mass.mean == pytest.approx(samples[:, 2].mean(), rel=1e-14)
    assert mass.variance == pytest.approx(samples[:, 2].var(ddof=1), rel=1e-9)
