"""Laws compared by what they miss in the same trials, and how sure the comparison is.

Every law flies the same trials, so that differences are taken trial by trial. All intervals of one table hold together
with the confidence that is asked for: each has a share of what may go wrong (Bonferroni). Laws that differ by less than
their interval are a tie.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from marsedl.montecarlo.statistics import binomial_interval, order_interval
from marsedl.words import require

__all__ = ["LEVELS", "Estimate", "paired", "percentile", "places", "summary_of", "tail_mean", "trials_needed"]

LEVELS = (0.5, 0.95, 0.99, 0.999)  # of the misses that a table shows
TAIL_LEVEL = 0.999  # beyond which the tail mean is taken


class Estimate(NamedTuple):
    """A number and its interval."""

    value: float
    lower: float
    upper: float


def summary_of(misses, inside, confidence=0.95) -> dict[str, Estimate]:
    """What a law's trials say of it.

    Args:
        misses: distance from the target of every trial that ended as it should, (count,), m.
        inside: of all trials, whether it ended inside of the box; a lost one did not, (trials,), bool.
        confidence: of each interval.

    Returns:
        Mapping: mean, p50, p95, p99, p99.9 (intervals between order statistics), tail (mean beyond the last of these),
        inside (share of all trials). A number with too few trials behind it has an interval of NaN.
    """
    misses, inside = np.asarray(misses, float), np.asarray(inside, bool)
    found = {"mean": _mean(misses, confidence)}
    for level in LEVELS:
        found[f"p{100.0 * level:g}"] = percentile(misses, level, confidence)
    found["tail"] = tail_mean(misses, TAIL_LEVEL, confidence)
    bounds = binomial_interval(int(inside.sum()), inside.size, confidence)
    found["inside"] = Estimate(float(inside.mean()), *map(float, bounds))
    return found


def percentile(values, level, confidence=0.95) -> Estimate:
    """The value that a share of them does not exceed, with its interval between order statistics."""
    value = float(np.quantile(values, level)) if values.size else np.nan
    return Estimate(value, *order_interval(values, level, confidence))


def _mean(values, confidence) -> Estimate:
    """Mean with its interval by Student's t."""
    from scipy.special import stdtrit

    count = values.size
    if count < 2:
        return Estimate(float(values.mean()) if count else np.nan, np.nan, np.nan)
    mean = float(values.mean())
    half = float(stdtrit(count - 1, 0.5 + 0.5 * confidence) * values.std(ddof=1) / np.sqrt(count))
    return Estimate(mean, mean - half, mean + half)


def tail_mean(values, level, confidence=0.95) -> Estimate:
    r"""Mean beyond a percentile, with its interval by Student's t on the values of the tail.

        $\text{Var} \approx \left( s^2 + \ell (m - q)^2 \right) / k$

    with the mean m and the variance s^2 of the k values beyond the percentile q of level l: the percentile is
    estimated, too (Manistre, Hancock 2005). In heavy tails, whose variance is hardly seen in k values, it holds less
    often than it says.

    Args:
        values: (count,). level: within (0, 1). confidence: of the interval.

    Returns:
        `Estimate`; its interval is NaN of fewer than 10 values beyond.
    """
    from scipy.special import stdtrit

    ordered = np.sort(np.asarray(values, float))
    beyond = round(ordered.size * (1.0 - level))
    if beyond < 1:
        return Estimate(np.nan, np.nan, np.nan)
    tail = ordered[-beyond:]
    mean = float(tail.mean())
    if beyond < 10:
        return Estimate(mean, np.nan, np.nan)
    half = stdtrit(beyond - 1, 0.5 + 0.5 * confidence)
    half *= np.sqrt((tail.var(ddof=1) + level * (mean - tail[0]) ** 2) / beyond)
    return Estimate(mean, mean - float(half), mean + float(half))


class Pair(NamedTuple):
    """Two laws in the same trials: the first minus the second."""

    first: str
    second: str
    mean: Estimate  # difference of the mean misses, m, over the trials that both ended as they should
    inside: Estimate  # difference of the shares inside of the box, over all trials
    correlation: float  # of the misses: what the pairing wins


def paired(misses: Mapping[str, np.ndarray], inside: Mapping[str, np.ndarray], confidence=0.95) -> list[Pair]:
    """Differences of all pairs of laws; all intervals hold at once with the confidence.

    Args:
        misses: by law, distance from the target of every trial, NaN of a lost one, (trials,), m.
        inside: by law, whether it ended inside of the box, (trials,).
        confidence: that all intervals of both kinds hold.

    Returns:
        A `Pair` for every two laws, in their order.

    Raises:
        ValueError: if laws have other numbers of trials.
    """
    require(
        len({len(flown) for flown in (*misses.values(), *inside.values())}) == 1,
        "laws are compared trial by trial: fly all of them with as many trials",
    )
    pairs = list(combinations(misses, 2))
    each = 1.0 - (1.0 - confidence) / max(2 * len(pairs), 1)
    found = []
    for first, second in pairs:
        both = np.isfinite(misses[first]) & np.isfinite(misses[second])
        a, b = misses[first][both], misses[second][both]
        varies = both.sum() > 1 and a.std() > 0.0 and b.std() > 0.0
        correlation = float(np.corrcoef(a, b)[0, 1]) if varies else np.nan
        share = _share_difference(np.asarray(inside[first], bool), np.asarray(inside[second], bool), each)
        found.append(Pair(first, second, _mean(a - b, each), share, correlation))
    return found


def _share_difference(first, second, confidence) -> Estimate:
    """Difference of two shares of the same trials, with half a trial more of each kind (Agresti, Min 2005)."""
    from scipy.special import ndtri

    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    count = first.size + 2
    mean = (only_first - only_second) / count
    variance = (only_first + only_second + 1.0 - (only_first - only_second) ** 2 / count) / count**2
    half = ndtri(0.5 + 0.5 * confidence) * np.sqrt(variance)
    return Estimate((only_first - only_second) / first.size, float(mean - half), float(mean + half))


def places(pairs: list[Pair], what="mean") -> dict[str, tuple[int, int]]:
    """Best and worst place of every law that the intervals of all pairs leave open; 1 is best.

    what: "mean", of which the smaller is the better, or "inside", of which the larger is.
    """
    names = list(dict.fromkeys(name for pair in pairs for name in (pair.first, pair.second)))
    better = {name: set() for name in names}  # laws that are surely better than it
    for pair in pairs:
        difference = getattr(pair, what)
        low, high = (difference.lower, difference.upper) if what == "mean" else (-difference.upper, -difference.lower)
        if high < 0.0:
            better[pair.second].add(pair.first)
        elif low > 0.0:
            better[pair.first].add(pair.second)
    worse = {name: sum(name in others for others in better.values()) for name in names}
    return {name: (1 + len(better[name]), len(names) - worse[name]) for name in names}


def trials_needed(value: float, half_width: float, trials: int, share=0.1) -> float:
    """Trials with which the interval of a number would be no wider, on one side, than a share of the number.

    Widths shrink with the root of the number of trials. NaN if the interval is not known.
    """
    return float(np.ceil(trials * (half_width / (share * abs(value))) ** 2)) if value else np.nan
