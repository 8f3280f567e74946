import numpy as np
import pytest
from scipy import stats
from scipy.special import xlogy

from marsedl.montecarlo.statistics import (
    binomial_interval,
    central_moments,
    covariance,
    covariance_standard_errors,
    histogram_percentile,
    mean_standard_error,
    merge_moments,
    order_interval,
    paired_percentile_interval,
    paired_share_interval,
    percentile,
    percentile_spread,
    two_sample_covariance_deviance,
    variance_sampling_band,
    variance_standard_error,
    wishart_deviance,
)

FACTOR = np.array([[2.0, 0.0, 0.0], [0.5, 1.0, 0.0], [-0.3, 0.2, 0.7]])
COVARIANCE = FACTOR @ FACTOR.T


def test_central_moments_and_their_merge_equal_numpy():
    rng = np.random.default_rng(1)
    samples = 1e6 + rng.exponential(size=(700, 5, 3)) @ FACTOR.T
    total = central_moments(samples[:0])
    for part in np.split(samples, [1, 2, 300, 301]):
        total = merge_moments(total, central_moments(part))
    total = merge_moments(total, central_moments(samples[:0]))
    for count, mean, second in (total, central_moments(samples)):
        assert count == 700
        np.testing.assert_allclose(mean, samples.mean(axis=0), rtol=1e-14)
        np.testing.assert_allclose(second / 699, [np.cov(samples[:, i].T) for i in range(5)], rtol=1e-7, atol=1e-8)


def test_moments_merge_with_counts_of_their_own_at_every_time():
    rng = np.random.default_rng(9)
    samples, other = rng.standard_normal((40, 6, 3)) @ FACTOR.T, rng.standard_normal((7, 6, 3))
    counts = np.array([40, 40, 12, 1, 0, 0]), np.array([7, 0, 7, 3, 2, 0])

    def moments(values, numbers):
        parts = [central_moments(values[:number, time]) for time, number in enumerate(numbers)]
        return numbers, np.stack([mean for _, mean, _ in parts]), np.stack([second for _, _, second in parts])

    count, mean, second = merge_moments(moments(samples, counts[0]), moments(other, counts[1]))
    np.testing.assert_array_equal(count, counts[0] + counts[1])
    for time, (a, b) in enumerate(zip(*counts, strict=True)):
        single = merge_moments(central_moments(samples[:a, time]), central_moments(other[:b, time]))
        np.testing.assert_array_equal(mean[time], single[1])
        np.testing.assert_array_equal(second[time], single[2])
        expected = central_moments(np.concatenate([samples[:a, time], other[:b, time]]))
        np.testing.assert_allclose(mean[time], expected[1], rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(second[time], expected[2], rtol=1e-12, atol=1e-13)


def test_standard_errors_are_the_spread_of_repeated_estimates():
    # a skewed, heavy-tailed distribution, for which the normal formula is wrong by far
    rng = np.random.default_rng(2)
    repeats, count = 4000, 100
    samples = rng.exponential(size=(repeats, count, 3)) @ FACTOR.T
    first = samples[..., 0] / 2.0  # unit exponential: variance 1, fourth central moment 9
    tolerance = 4.0 / np.sqrt(repeats)
    assert mean_standard_error(1.0, count) == pytest.approx(first.mean(axis=1).std(), rel=tolerance)
    spread = first.var(axis=1, ddof=1).std()
    assert variance_standard_error(1.0, 9.0, count) == pytest.approx(spread, rel=3 * tolerance)
    assert variance_standard_error(1.0, 3.0, count) < 0.6 * spread
    assert variance_standard_error(1.0, 3.0, count) == pytest.approx(np.sqrt(2.0 / (count - 1)), rel=1e-12)
    covariances = np.array([np.cov(sample.T) for sample in samples])
    errors = covariance_standard_errors(samples.reshape(-1, 3)) * np.sqrt(repeats)
    np.testing.assert_allclose(errors, covariances.std(axis=0), rtol=4 * tolerance)
    np.testing.assert_allclose(errors, errors.T, rtol=1e-14)


@pytest.mark.parametrize("level", [0.05, 0.5, 0.95, 0.99])
def test_percentile_and_its_standard_error(level):
    rng = np.random.default_rng(3)
    repeats, count = 800, 5000 if level == 0.99 else 1000
    samples = rng.standard_normal((repeats, count))
    values, errors = np.array([percentile(sample, level) for sample in samples]).T
    np.testing.assert_array_equal(values, np.quantile(samples, level, axis=1))
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.1)
    # scipy shifts both parameters of the distribution by one, which matters at the end of the sample
    if level < 0.99:
        assert errors[0] == pytest.approx(stats.mstats.mjci(samples[0], [level])[0], rel=0.1)


@pytest.mark.parametrize(("count", "level"), [(20, 0.5), (100, 0.9), (200, 0.05), (1000, 0.99), (1000, 0.01)])
@pytest.mark.parametrize("distribution", [stats.norm, stats.expon])
def test_three_errors_hold_the_percentile_from_the_least_count_on(distribution, count, level):
    """As often as three errors of a normal number do, though the percentile of so few samples is far from normal."""
    samples = distribution.rvs(size=(1000, count), random_state=12)
    values, errors = np.array([percentile(sample, level) for sample in samples]).T
    assert np.mean(np.abs(values - distribution.ppf(level)) <= 3 * errors) > 0.9973 - 3 * np.sqrt(0.0027 / 1000)


@pytest.mark.parametrize(("count", "level"), [(1, 0.5), (18, 0.5), (20, 0.99), (940, 0.99), (940, 0.01)])
def test_few_samples_give_a_percentile_without_an_error(count, level):
    samples = np.random.default_rng(13).standard_normal(count)
    value, error = percentile(samples, level)
    assert value == np.quantile(samples, level)
    assert np.isnan(error)


def test_a_percentile_of_nothing_is_none_and_missing_samples_are_refused():
    assert np.isnan(percentile([], 0.5)).all()
    with pytest.raises(ValueError, match="2 of 40 samples are NaN: leave them out, or say on which side they count"):
        percentile([np.nan, np.nan, *range(38)], 0.5)


def test_what_one_sample_does_not_determine_is_nan():
    assert np.isnan(covariance(np.ones((1, 3)))).all()
    assert np.isnan(covariance_standard_errors(np.ones((1, 3)))).all()
    assert np.isnan(mean_standard_error(1.0, 1))
    assert np.isnan(variance_standard_error(1.0, 3.0, 1))
    assert np.isnan(variance_sampling_band(np.ones(2), 1)).all()
    for result in (
        wishart_deviance(COVARIANCE, 3, COVARIANCE),
        two_sample_covariance_deviance(COVARIANCE, 9, COVARIANCE, 3),
    ):
        assert np.isnan([result.statistic, result.p_value]).all()
        assert result.degrees_of_freedom == 6


def test_percentile_of_many_samples_and_of_bad_levels():
    value, error = percentile(np.random.default_rng(4).standard_normal(1_000_000), 0.95)
    asymptotic = np.sqrt(0.95 * 0.05 / 1e6) / stats.norm.pdf(stats.norm.ppf(0.95))
    assert error == pytest.approx(asymptotic, rel=0.2)
    assert abs(value - stats.norm.ppf(0.95)) < 4 * asymptotic
    for level in (0.0, 1.0, 95):
        with pytest.raises(ValueError, match="level"):
            percentile([1.0, 2.0], level)


@pytest.mark.parametrize(("count", "level"), [(5000, 0.01), (5000, 0.99), (1000, 0.5), (521, 0.9)])
def test_the_error_of_a_percentile_is_that_of_a_bootstrap(count, level):
    rng = np.random.default_rng(10)
    samples, resamples = np.sort(rng.exponential(size=count)), 4000
    rank = int(level * count + 0.5)
    percentiles = np.array([np.partition(rng.choice(samples, count), rank - 1)[rank - 1] for _ in range(resamples)])
    variance, fourth = percentiles.var(ddof=1), ((percentiles - percentiles.mean()) ** 4).mean()
    tolerance = 4.0 * variance_standard_error(variance, fourth, resamples)
    assert tolerance < 0.2 * variance
    assert abs(percentile(samples, level)[1] ** 2 - variance) < tolerance


def test_percentile_spread_is_the_standard_error_of_one_group():
    rng = np.random.default_rng(11)
    samples = rng.standard_normal(200 * 500 + 499)
    values, spread = percentile_spread(samples, 0.9, 500)
    assert values.shape == (200,)
    np.testing.assert_array_equal(values[3], np.quantile(samples[1500:2000], 0.9))
    assert spread == pytest.approx(np.std(values, ddof=1), rel=1e-14)
    asymptotic = np.sqrt(0.9 * 0.1 / 500) / stats.norm.pdf(stats.norm.ppf(0.9))
    assert spread == pytest.approx(asymptotic, rel=4.0 / np.sqrt(2 * 200))
    for size in (50_250, 0, -5):
        with pytest.raises(ValueError, match="two groups"):
            percentile_spread(samples, 0.9, size)
    assert percentile_spread(samples, 0.9, 50_249)[0].shape == (2,)


@pytest.mark.parametrize("count", [1, 137, 5000])
@pytest.mark.parametrize("level", [0.05, 0.95, 1.0])
def test_histogram_percentile_is_within_its_bound(count, level):
    samples = np.random.default_rng(count).gamma(3.0, size=(6, count))
    edges = np.linspace(0.0, 30.0, 301)
    counts = np.zeros((6, 302), int)
    counts[:, 1:-1] = [np.histogram(row, edges)[0] for row in samples]
    values, bounds = histogram_percentile(counts, edges, level)
    exact = np.quantile(samples, level, axis=1, method="inverted_cdf")
    np.testing.assert_allclose(bounds, 0.1, rtol=1e-12)
    assert (np.abs(values - exact) <= bounds).all()
    if count == 5000 and level < 1.0:
        assert (np.abs(values - np.quantile(samples, level, axis=1)) < 0.3 * bounds).all()


def test_histogram_percentile_outside_of_the_edges_is_refused():
    edges = np.linspace(0.0, 1.0, 11)
    counts = np.ones(12, int)
    assert histogram_percentile(counts, edges, 0.5)[0] == pytest.approx(0.5)
    for level in (0.05, 0.95):
        with pytest.raises(ValueError, match="outside"):
            histogram_percentile(counts, edges, level)
    with pytest.raises(ValueError, match="empty"):
        histogram_percentile(0 * counts, edges, 0.5)


def test_the_chi_square_band_covers_with_its_level():
    rng = np.random.default_rng(5)
    variance, count, level = 3.0, 12, 0.9
    sample_variances = (rng.standard_normal((20_000, count)) * np.sqrt(variance)).var(axis=1, ddof=1)
    tolerance = 4 * np.sqrt(0.09 / 20_000)
    lower, upper = variance_sampling_band(variance, count, level)
    assert lower < variance < upper
    assert np.mean((lower < sample_variances) & (sample_variances < upper)) == pytest.approx(level, abs=tolerance)
    # 95 % points of the chi-square distribution with 10 degrees of freedom, from printed tables
    assert variance_sampling_band(10.0, 11, 0.95) == (pytest.approx(3.247, abs=5e-4), pytest.approx(20.483, abs=5e-4))


def test_wishart_deviance_has_uniform_p_values_under_the_null_and_power_against_others():
    rng = np.random.default_rng(6)
    count = 2000
    samples = [rng.standard_normal((count, 3)) @ FACTOR.T for _ in range(400)]
    results = [wishart_deviance(np.cov(sample.T), count, COVARIANCE) for sample in samples]
    assert all(result.degrees_of_freedom == 6 for result in results)
    assert stats.kstest([result.p_value for result in results], "uniform").pvalue > 0.01
    assert wishart_deviance(np.cov(samples[0].T), count, 1.2 * COVARIANCE).p_value < 1e-6


def test_wishart_deviance_by_hand():
    result = wishart_deviance(np.diag([2.0, 1.0]), 50, np.eye(2))
    assert result.statistic == pytest.approx(50 * (1.0 - np.log(2.0)), rel=1e-14)
    assert result.p_value == pytest.approx(stats.chi2.sf(result.statistic, 3), rel=1e-12)
    same = wishart_deviance(COVARIANCE, 2000, COVARIANCE)
    assert same.statistic == pytest.approx(0.0, abs=1e-10)
    assert same.p_value == pytest.approx(1.0, abs=1e-10)
    mixing = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [0.3, 0.0, 1.0]])
    other = COVARIANCE + 0.1 * np.eye(3)
    before = wishart_deviance(other, 100, COVARIANCE).statistic
    after = wishart_deviance(mixing @ other @ mixing.T, 100, mixing @ COVARIANCE @ mixing.T).statistic
    assert after == pytest.approx(before, rel=1e-10)


def test_two_sample_deviance_has_uniform_p_values_under_the_null():
    rng = np.random.default_rng(8)
    p_values = []
    for _ in range(500):
        first, second = (rng.standard_normal((count, 3)) @ FACTOR.T for count in (500, 1300))
        p_values.append(two_sample_covariance_deviance(np.cov(first.T), 500, np.cov(second.T), 1300).p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


def test_two_sample_deviance_tends_to_the_wishart_deviance():
    sample = COVARIANCE + np.diag([0.3, -0.1, 0.05])
    limit = wishart_deviance(sample, 2000, COVARIANCE)
    differences = []
    for count in (10**6, 10**7, 10**8):
        result = two_sample_covariance_deviance(sample, 2000, COVARIANCE, count)
        assert result.degrees_of_freedom == limit.degrees_of_freedom
        differences.append(abs(result.statistic / limit.statistic - 1.0))
    assert differences[0] < 0.01
    np.testing.assert_allclose(np.divide(differences[:-1], differences[1:]), 10.0, rtol=0.05)
    swapped = two_sample_covariance_deviance(COVARIANCE, 10**6, sample, 2000)
    assert swapped.statistic == pytest.approx(
        two_sample_covariance_deviance(sample, 2000, COVARIANCE, 10**6).statistic, rel=1e-9
    )


@pytest.mark.parametrize(("count", "trials"), [(0, 200), (1, 200), (7, 5000), (199, 200), (200, 200)])
def test_binomial_interval_leaves_half_of_the_rest_on_either_side(count, trials):
    lower, upper = binomial_interval(count, trials)
    assert (lower == 0) == (count == 0) and (upper == 1) == (count == trials)
    if count:  # this many or more, if the probability were the lower end
        assert stats.binom.sf(count - 1, trials, lower) == pytest.approx(0.025)
    if count < trials:
        assert stats.binom.cdf(count, trials, upper) == pytest.approx(0.025)


# ---- differences of pairs --------------------------------------------------------------------------------------------


def pairs_of(count, correlation, seed):
    rng = np.random.Generator(np.random.Philox(seed))
    a, b = rng.standard_normal((2, count))
    return a, correlation * a + np.sqrt(1.0 - correlation**2) * b


HEAVY, SKEWED = (lambda z: stats.t.ppf(stats.norm.cdf(z), 2)), (lambda z: np.exp(1.5 * z))


@pytest.mark.parametrize(
    ("first", "second", "correlation"),
    [(np.asarray, np.asarray, 0.9), (SKEWED, np.asarray, 0.7), (HEAVY, HEAVY, -0.8), (HEAVY, SKEWED, 0.99)],
)
@pytest.mark.parametrize(("count", "level"), [(40, 0.5), (400, 0.95), (1000, 0.01)])
def test_intervals_of_differences_of_percentiles_hold_them(first, second, correlation, count, level):
    true, repeats, held = first(stats.norm.ppf(level)) - second(stats.norm.ppf(level)), 200, 0
    for seed in range(repeats):
        a, b = pairs_of(count, correlation, seed)
        low, high = paired_percentile_interval(first(a), second(b), level)
        held += low <= true <= high
    assert held / repeats > 0.95 - 3 * np.sqrt(0.95 * 0.05 / repeats)


def test_pairs_that_agree_have_narrow_intervals_and_a_constant_leaves_that_of_one_sample():
    a, b = pairs_of(10_000, 0.99, 1)
    low, high = paired_percentile_interval(a + 0.3, b, 0.9)
    alone = np.ptp(order_interval(a, 0.9))
    assert low < 0.3 < high and high - low < 0.6 * alone, "two samples apart have 1.4 times that of one"
    expected = order_interval(a, 0.9)
    np.testing.assert_allclose(paired_percentile_interval(a, np.ones(a.size), 0.9), np.array(expected) - 1, rtol=1e-9)
    low, high = paired_percentile_interval(a, a, 0.9)
    assert low <= 0.0 <= high < 0.1 * alone
    assert np.isnan(paired_percentile_interval(a[:99], b[:99], 0.9)).all()
    assert np.isnan(paired_percentile_interval(a[:100], b[:100], 0.9, 1.0 - 1e-9)).all()


@pytest.mark.parametrize(
    ("chances", "trials"), [((0.1, 0.05, 0.8), 30), ((0.02, 0.0, 0.97), 100), ((0.3, 0.3, 0.1), 60)]
)
def test_intervals_of_differences_of_shares_hold_them_about_as_often_as_they_say(chances, trials):
    """chances: that the first alone holds, the second alone, both."""
    rng, held = np.random.Generator(np.random.Philox(8)), 0
    for b, c, both, _ in rng.multinomial(trials, [*chances, 1.0 - sum(chances)], 1500):
        low, high = paired_share_interval(*of_counts(b, c, trials, both))
        held += low <= chances[0] - chances[1] <= high
    assert 0.93 < held / 1500 < 0.99


def of_counts(b, c, trials, both=0):
    first, second = np.zeros((2, trials), bool)
    first[: b + both] = True
    second[b : b + both + c] = True
    return first, second


@pytest.mark.parametrize(("b", "c"), [(0, 0), (3, 0), (7, 25), (12, 9), (40, 0), (0, 40)])
def test_ends_of_intervals_of_shares_have_the_score_that_the_likeliest_chances_give(b, c):
    n, z = 40, stats.norm.ppf(0.95)
    for end, score in zip(paired_share_interval(*of_counts(b, c, n), 0.9), (z, -z), strict=True):
        if abs(end) == 1.0:
            assert abs(b - c) == n
            continue
        q = np.linspace(max(0.0, -end), 0.5 * (1.0 - end), 200_002)[1:-1]
        likelihood = xlogy(b, q + end) + xlogy(c, q) + xlogy(n - b - c, 1.0 - 2.0 * q - end)
        likeliest = q[np.argmax(likelihood)]
        found = (b - c - n * end) / np.sqrt(n * (2.0 * likeliest + end * (1.0 - end)))
        np.testing.assert_allclose(found, score, rtol=1e-3)
