"""Estimates from samples with their standard errors, and tests of covariance matrices.

Samples come first in every array: (count,) or (count, ...). Variances and covariances are unbiased (divided by count
- 1). What so few samples do not determine is NaN: the error of the mean of one, the error of an extreme percentile.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

TAIL = 10  # samples that have to lie beyond a percentile for its interval and its standard error
NORMAL_TAIL = 50  # from which on the normal distribution of a percentile's error holds
_THREE_ERRORS = 0.9973002039367398  # the chance that a normal number lies within three standard deviations


def central_moments(samples):
    """Count, mean and sums of products about the mean.

    samples: (count, ..., n). Returns (count, mean (..., n), second_moment (..., n, n)); zeros when count is 0.
    """
    # Samples last, so that numpy sums pairwise along contiguous memory.
    values = np.ascontiguousarray(np.moveaxis(samples, 0, -1))
    n, count = values.shape[-2:]
    second_moment = np.zeros((*values.shape[:-2], n, n))
    if count == 0:
        return 0, np.zeros(values.shape[:-1]), second_moment
    mean = values.mean(axis=-1)
    centred = values - mean[..., np.newaxis]
    for i in range(n):
        for j in range(i + 1):
            # A plain sum and not a matrix product, whose order of summation is the BLAS library's.
            second_moment[..., i, j] = second_moment[..., j, i] = (centred[..., i, :] * centred[..., j, :]).sum(axis=-1)
    return count, mean, second_moment


def merge_moments(a, b):
    """Moments of the union of two disjoint samples (Chan, Golub, LeVeque 1979):

    M = M_a + M_b + d d' n_a n_b / n,   mean = mean_a + d n_b / n,   d = mean_b - mean_a,   n = n_a + n_b.

    a, b: (count, mean (..., n), second_moment (..., n, n)) as from `central_moments`; the counts are numbers or arrays
    (...). Returns the same triple. A sample without members leaves the other as it is.
    """
    count_a, mean_a, second_a = a
    count_b, mean_b, second_b = b
    count_a, count_b = np.asarray(count_a), np.asarray(count_b)
    count = count_a + count_b
    share = count_b / np.maximum(count, 1)
    difference = mean_b - mean_a
    product = difference[..., :, np.newaxis] * difference[..., np.newaxis, :]
    mean = mean_a + difference * share[..., np.newaxis]
    second = second_a + second_b + product * (count_a * share)[..., np.newaxis, np.newaxis]

    def unless_empty(both, only_a, only_b, axes):
        empty_a, empty_b = (np.expand_dims(c == 0, axes) for c in (count_a, count_b))
        return np.where(empty_b, only_a, np.where(empty_a, only_b, both))

    return count, unless_empty(mean, mean_a, mean_b, -1), unless_empty(second, second_a, second_b, (-1, -2))


def covariance(samples):
    """Unbiased covariance of samples (count, n), (n, n); NaN of one."""
    n = samples.shape[1]
    return np.cov(samples, rowvar=False).reshape(n, n) if len(samples) > 1 else np.full((n, n), np.nan)


def variance(samples):
    """Unbiased variance of samples (count, ...), (...); NaN of one."""
    return samples.var(axis=0, ddof=1) if len(samples) > 1 else np.full(samples.shape[1:], np.nan)[()]


def mean_standard_error(variance, count):
    """Standard error of a mean: sqrt(variance / count)."""
    return np.sqrt(np.asarray(variance) / _at_least(2, count))


def _at_least(least, count):
    """The count, or NaN if it is smaller."""
    return np.where(np.asarray(count) >= least, count, np.nan)


def variance_standard_error(variance, fourth_moment, count):
    """Standard error of an unbiased sample variance, sqrt((mu4 - (N - 3) / (N - 1) sigma^4) / N), any distribution.

    variance: sigma^2. fourth_moment: mu4, fourth central moment (3 sigma^4 for a normal distribution). count: N.
    """
    variance, count = np.asarray(variance), _at_least(2, count)
    return np.sqrt((fourth_moment - (count - 3) / (count - 1) * variance**2) / count)


def covariance_standard_errors(samples):
    """Standard errors of all entries of the unbiased sample covariance, without assuming a normal distribution:

    Var s_ij = (mu_iijj - (N - 2) / (N - 1) s_ij^2 + s_ii s_jj / (N - 1)) / N,   mu_iijj = E[(x_i - m_i)^2 (x_j -
    m_j)^2].

    samples: (count, n). Returns (n, n); its diagonal holds the standard errors of the variances.
    """
    samples = np.asarray(samples, dtype=float)
    count, n = samples.shape
    if count < 2:
        return np.full((n, n), np.nan)
    centred = samples - samples.mean(axis=0)
    covariance = centred.T @ centred / (count - 1)
    squares = centred**2
    fourth = squares.T @ squares / count
    variances = np.diag(covariance)
    variance_of_covariance = (
        fourth - (count - 2) / (count - 1) * covariance**2 + np.outer(variances, variances) / (count - 1)
    ) / count
    return np.sqrt(variance_of_covariance)


def order_interval(samples, level, confidence=0.95):
    """Distribution-free confidence interval of a quantile, between two order statistics (David, Nagaraja 2003, 7.1).

    The number of samples below the quantile is binomial, so that the ranks are quantiles of it.

    Args:
        samples: (count,). level: within (0, 1). confidence: least probability that the interval holds the quantile.

    Returns:
        Tuple of both ends; NaN where fewer than `TAIL` samples lie beyond the level on either side.
    """
    from scipy.stats import binom

    ordered = np.sort(np.asarray(samples, float))
    count, tail = ordered.size, 0.5 * (1.0 - confidence)
    if not _enough(count, level):
        return np.nan, np.nan
    low, high = int(binom.ppf(tail, count, level)), int(binom.ppf(1.0 - tail, count, level)) + 1
    return (ordered[low - 1], ordered[high - 1]) if low >= 1 and high <= count else (np.nan, np.nan)


def _enough(count, level, tail=TAIL):
    """Whether so many samples lie beyond a percentile; 10 of 100 lie beyond 90 %, though 0.1 is no binary number."""
    return count * min(level, 1.0 - level) >= tail * (1.0 - 1e-12)


def percentile(samples, level):
    """Sample percentile (linear interpolation) and its Maritz-Jarrett standard error (Maritz, Jarrett 1978).

    The error is the standard deviation of the order statistics weighted by Beta(m, N - m + 1), m = floor(level N +
    1/2): exactly that of a bootstrap of the m-th order statistic with infinitely many resamples.

    Where fewer than `NORMAL_TAIL` samples lie beyond the percentile, this error is too small, as the percentile is far
    from normal. There the error is a third of the way to the farther end of the exact interval that holds the
    percentile as often as three standard errors do (`order_interval`, 99.73 %). It is NaN if fewer than `TAIL` samples
    lie beyond: a 99th percentile has an error from a thousand samples on. Without any sample the value is NaN too.

    samples: (count,). level: within (0, 1). Returns (value, standard_error). Raises ValueError for other levels, and
    for samples that are NaN.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie within (0, 1), got {level}")
    ordered = np.sort(np.asarray(samples, dtype=float))
    count = ordered.size
    if missing := int(np.isnan(ordered).sum()):
        raise ValueError(f"{missing} of {count} samples are NaN: leave them out, or say on which side they count")
    value = float(np.quantile(ordered, level)) if count else np.nan
    if not _enough(count, level, NORMAL_TAIL):
        low, high = order_interval(ordered, level, _THREE_ERRORS)
        return value, float(max(high - value, value - low) / 3.0)
    rank = min(max(int(level * count + 0.5), 1), count)
    weights = _order_weights(rank, count)
    # About the middle, or the difference of two large squares would lose digits.
    deviation = ordered - ordered[rank - 1]
    spread = weights @ deviation**2 - (weights @ deviation) ** 2
    return value, float(np.sqrt(max(spread, 0.0)))


@lru_cache(maxsize=16)  # they take longer than all the rest, and ensembles have few sizes
def _order_weights(rank, count):
    """Weights of the order statistics in the bootstrap of one of them, (count,)."""
    from scipy import special

    weights = np.diff(special.betainc(rank, count - rank + 1, np.arange(count + 1) / count))
    weights.setflags(write=False)
    return weights


def percentile_spread(samples, level, size):
    """Percentiles of disjoint groups of consecutive samples, and how far they scatter from group to group.

    samples: (count,); those that do not fill a last group are left out. level: within [0, 1]. size: samples in a group.
    Returns (values (groups,), their standard deviation). Raises ValueError for fewer than two groups.
    """
    samples = np.asarray(samples, dtype=float)
    groups = samples.size // size if size > 0 else 0
    if groups < 2:
        raise ValueError(f"{samples.size} samples hold fewer than two groups of {size}; take smaller groups")
    values = np.quantile(samples[: groups * size].reshape(groups, size), level, axis=1)
    return values, float(values.std(ddof=1))


def histogram_percentile(counts, edges, level):
    """Percentile from a histogram, interpolated within its bin, and a bound of its error: the width of that bin.

    The bound is strict against the smallest sample with at least `level` of all samples at or below it.

    counts: (..., bins + 2), the first and last entries counting what lies below and above the edges. edges: (bins +
    1,).
    level: within (0, 1]. Returns (value (...), bound (...)). Raises ValueError when the histogram is empty or the
    percentile lies outside of the edges.
    """
    counts, edges = np.asarray(counts), np.asarray(edges)
    cumulative = np.cumsum(counts, axis=-1)
    total = cumulative[..., -1:]
    if (total == 0).any():
        raise ValueError("the histogram is empty")
    # Rounding must not push an exact multiple to the next sample; half a sample is too small a correction to matter.
    rank = np.ceil(level * total * (1.0 - 4e-16))
    index = (cumulative < rank).sum(axis=-1)
    if (index == 0).any() or (index == counts.shape[-1] - 1).any():
        raise ValueError(f"the {level} percentile lies outside of the histogram's edges [{edges[0]}, {edges[-1]})")
    below = np.take_along_axis(cumulative, index[..., np.newaxis] - 1, -1)[..., 0]
    inside = np.take_along_axis(counts, index[..., np.newaxis], -1)[..., 0]
    width = edges[index] - edges[index - 1]
    return edges[index - 1] + width * (rank[..., 0] - below) / inside, width


def binomial_interval(count, trials, level=0.95):
    """Confidence interval of a probability behind `count` of `trials` independent trials (Clopper, Pearson 1934).

    count: any shape. Returns the lower and the upper bounds, of that shape; it holds the probability at least as often
    as the level says, for any probability.
    """
    from scipy.special import betaincinv

    count = np.asarray(count, dtype=float)
    half = (1.0 - level) / 2.0
    none, every = count == 0, count == trials
    lower = betaincinv(np.where(none, 1.0, count), trials - count + 1.0, half)
    upper = betaincinv(count + 1.0, np.where(every, 1.0, trials - count), 1.0 - half)
    return np.where(none, 0.0, lower), np.where(every, 1.0, upper)


def variance_sampling_band(variance, count, level=0.95):
    """Chi-square interval that holds the sample variance of `count` normal samples whose true variance is `variance`.

    The band to draw about a predicted variance. variance: any shape. level: probability. Returns (lower, upper).
    """
    from scipy import special

    tail, degrees = (1.0 - level) / 2.0, _at_least(2, count) - 1
    variance = np.asarray(variance)
    return variance * special.chdtri(degrees, 1.0 - tail) / degrees, variance * special.chdtri(degrees, tail) / degrees


def paired_percentile_interval(first, second, level, confidence=0.95):
    """Confidence interval of the difference of a percentile between two samples in pairs, whatever their distribution.

    The numbers of samples below the true percentiles, A and B, are binomial each, and jointly normal with the
    correlation (P - p^2) / (p (1 - p)), where P is the chance that both members of a pair lie below theirs (Babu, Rao
    1988: joint distribution of marginal quantiles). P is counted beyond the percentile, on its side of the smaller
    tail, with one pair more that lies there together as often as independent ones do. The difference lies between
    X_(A) - Y_(B + 1) and X_(A + 1) - Y_(B), order statistics; the interval is between quantiles of these two. If one
    sample is constant, it is that of `order_interval`.

    In simulations of normal, lognormal and Student samples (2 degrees of freedom) with correlations from -0.8 to 0.99
    it holds the difference at least as often as the confidence says, and more often where the pairs agree well or only
    a few tens of samples lie beyond the percentile.

    Args:
        first, second: (count,), pair by pair. level: within (0, 1). confidence: of the interval.

    Returns:
        Tuple of both ends of first minus second; NaN where fewer than `TAIL` samples lie beyond the level, or too few
        for this confidence.
    """
    from scipy.optimize import bisect
    from scipy.special import ndtr, ndtri
    from scipy.stats import binom

    x, y = (np.sort(np.asarray(samples, float)) for samples in (first, second))
    count, tail = x.size, 0.5 * (1.0 - confidence)
    if not _enough(count, level):
        return np.nan, np.nan
    correlation = _correlation_of_ranks(first, second, x, y, level)
    lowest, highest = (int(binom.ppf(chance, count, level)) for chance in (1e-12, 1.0 - 1e-12))
    ranks = np.arange(lowest, highest + 1)
    below = binom.cdf(np.arange(lowest - 1, highest + 1), count, level)
    chances = np.diff(below)  # of A
    place_of_first = ndtri(0.5 * (below[1:] + below[:-1]))  # of A in a standard normal distribution
    edge_of_second = np.append(ndtri(below[:-1]), np.inf)  # from where on B is at least such a rank
    spread = np.sqrt(1.0 - correlation**2)
    x, y = (np.concatenate([[-np.inf], ordered, [np.inf]]) for ordered in (x, y))  # by rank

    def excess(difference, later, chance):
        """The chance that X_(A + later) - Y_(B + 1 - later) is at most the difference, less the one that is wanted."""
        least = np.searchsorted(y, x[ranks + later] - difference) - (1 - later)  # B for which it is
        edge = edge_of_second[np.clip(least - lowest, 0, ranks.size)]
        return chances @ ndtr((correlation * place_of_first - edge) / spread) - chance

    first_rank, last_rank = max(lowest, 1), min(highest + 1, count)
    bracket = x[first_rank] - y[last_rank], x[last_rank] - y[first_rank]
    bracket = np.nextafter(bracket, (-np.inf, np.inf))
    within, ends = 1e-12 * np.ptp(bracket) + 5e-324, []
    for later, chance, outwards in ((0, tail, -within), (1, 1.0 - tail, within)):
        if not excess(bracket[0], later, chance) <= 0.0 <= excess(bracket[1], later, chance):
            return np.nan, np.nan
        ends.append(bisect(excess, *bracket, (later, chance), xtol=within) + outwards)
    return tuple(ends)


def _correlation_of_ranks(first, second, x, y, level):
    """Correlation of how many samples lie below their true percentiles; x, y: the samples in order."""
    rank = min(max(int(level * x.size + 0.5), 1), x.size) - 1
    tail = min(level, 1.0 - level)
    beyond, beyond_too = (
        samples > ordered[rank] if level > 0.5 else samples <= ordered[rank]
        for samples, ordered in ((np.asarray(first), x), (np.asarray(second), y))
    )
    both = np.count_nonzero(beyond & beyond_too)
    alone = np.sqrt(np.count_nonzero(beyond) * np.count_nonzero(beyond_too))
    return ((both + tail) / (alone + 1.0) - tail) / (1.0 - tail)


def paired_share_interval(first, second, confidence=0.95):
    """Confidence interval of the difference of two shares of the same trials: Tango's score interval (1998).

    With b trials where the first alone holds, c where the second alone does, and n in all, a difference d is within it
    if |b - c - n d| <= z sqrt(n (2 q + d (1 - d))), where q is the likeliest chance of the second alone, given d. Also
    with few trials and with shares of 0 or 1 it holds the difference about as often as the confidence says.

    Args:
        first, second: (count,), bool, trial by trial. confidence: of the interval.

    Returns:
        Tuple of both ends of first minus second; NaN without trials.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtri

    first, second = np.asarray(first, bool), np.asarray(second, bool)
    n, b, c = first.size, np.count_nonzero(first & ~second), np.count_nonzero(second & ~first)
    if n == 0:
        return np.nan, np.nan
    z = ndtri(0.5 + 0.5 * confidence)

    def excess(d, score):
        linear = (2 * n - b + c) * d - b - c
        q = (np.sqrt(linear**2 + 8 * n * c * d * (1.0 - d)) - linear) / (4 * n)
        return b - c - n * d - score * np.sqrt(n * max(2.0 * q + d * (1.0 - d), 0.0))

    estimate, nearly = (b - c) / n, 1e-9 / n  # where no trial or every one differs, the estimate solves it too
    lower = -1.0 if c == n else brentq(excess, -1.0, estimate - nearly, z)
    upper = 1.0 if b == n else brentq(excess, estimate + nearly, 1.0, -z)
    return lower, upper


class Deviance(NamedTuple):
    """Likelihood-ratio statistic, its chi-square degrees of freedom, and the probability of a larger one by chance."""

    statistic: float
    degrees_of_freedom: int
    p_value: float


def _log_determinant(covariance, name):
    try:
        return 2.0 * np.log(np.diag(np.linalg.cholesky(covariance))).sum()
    except np.linalg.LinAlgError:
        raise ValueError(f"{name} is not positive definite") from None


def _checked_covariances(first, second):
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if first.ndim != 2 or first.shape[0] != first.shape[1] or first.shape != second.shape:
        raise ValueError(f"covariances must be square and of equal size, got {first.shape} and {second.shape}")
    return first, second


def _deviance(statistic, n):
    from scipy import special

    degrees = n * (n + 1) // 2
    if np.isnan(statistic):
        return Deviance(np.nan, degrees, np.nan)
    statistic = max(float(statistic), 0.0)  # rounding can make it negative when both matrices agree
    return Deviance(statistic, degrees, float(special.chdtrc(degrees, statistic)))


def wishart_deviance(sample_covariance, count, reference_covariance):
    """Does a sample covariance S of `count` normal samples agree with a known covariance C?

    D = N [tr(C^-1 S) - log det(C^-1 S) - n], asymptotically chi-square with n (n + 1) / 2 degrees of freedom.

    sample_covariance: S, (n, n), symmetric. count: N. reference_covariance: C, (n, n). Returns a `Deviance`, of NaN for
    n samples or fewer, whose covariance is singular. Raises ValueError for unequal shapes and for matrices that are not
    positive definite.
    """
    sample, reference = _checked_covariances(sample_covariance, reference_covariance)
    n = sample.shape[0]
    if count <= n:
        return _deviance(np.nan, n)
    log_ratio = _log_determinant(sample, "sample_covariance") - _log_determinant(reference, "reference_covariance")
    return _deviance(count * (np.trace(np.linalg.solve(reference, sample)) - log_ratio - n), n)


def two_sample_covariance_deviance(first_covariance, first_count, second_covariance, second_count):
    """Do two sample covariances of normal samples come from the same covariance? (Box's M without its correction)

    D = (N1 + N2) log det P - N1 log det S1 - N2 log det S2,   P = (N1 S1 + N2 S2) / (N1 + N2),

    asymptotically chi-square with n (n + 1) / 2 degrees of freedom; tends to `wishart_deviance` as N2 grows.

    first_covariance, second_covariance: S1, S2, (n, n), symmetric. first_count, second_count: N1, N2. Returns a
    `Deviance`, of NaN if either sample has n members or fewer, whose covariance is singular. Raises ValueError for
    unequal shapes and for matrices that are not positive definite.
    """
    first, second = _checked_covariances(first_covariance, second_covariance)
    if min(first_count, second_count) <= len(first):
        return _deviance(np.nan, len(first))
    total = first_count + second_count
    pooled = first * (first_count / total) + second * (second_count / total)
    log_pooled = _log_determinant(pooled, "the pooled covariance")
    statistic = first_count * (log_pooled - _log_determinant(first, "first_covariance"))
    statistic += second_count * (log_pooled - _log_determinant(second, "second_covariance"))
    return _deviance(statistic, first.shape[0])
