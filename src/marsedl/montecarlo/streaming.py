"""What is stored of ensembles that are too large to store every trial: moments, histograms, and the first trials.

Up to `EXACT_TRIALS` trials an ensemble holds all of their final states. Of a larger one it holds those of the first
`EXACT_TRIALS`, and of all its trials

- the moments of the final state, joined over blocks pairwise by halves of the ensemble, as in a knock-out: which blocks
  meet follows from their numbers alone, so a chunk may join what it has of them, and holds few at any time;
- how many trials end in which outcome, and the lowest and highest values;
- how many values fall into which bin of a DDSketch (Masson, Rim, Lee 2019), from which percentiles follow. With the
  relative accuracy `a` and `x` the order statistic of the level, `|percentile - x| <= a |x - centre|`, where the centre
  is subtracted beforehand: errors count from there, and bins are finest there. Counts add up, so sketches of chunks
  merge into that of the whole in any order, exactly. Bins and their bound are those of the library `ddsketch`, its
  cubic mapping, which is arithmetic on mantissa and exponent and thus the same on every machine; they are found for
  whole arrays here.

The functions at the end answer for both kinds of ensembles, so that claims, tables and figures need not know the kind.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from marsedl.montecarlo.statistics import covariance, covariance_standard_errors, merge_moments, percentile
from marsedl.summaries import summary

__all__ = [
    "EXACT_TRIALS",
    "OUTCOMES",
    "RELATIVE_ACCURACY",
    "FinalMoments",
    "Sketch",
    "final_extremes",
    "final_percentile",
    "is_streamed",
    "observed_maxima",
    "outcome_count",
    "sketched_percentile",
]

EXACT_TRIALS = 200_000  # their final states are some 10 MB; sampling errors of errors are a fifth of a per cent then
RELATIVE_ACCURACY = 1e-4  # at 1e7 normal trials a fifth of the standard error of the 1st percentile
OUTCOMES = 16  # codes that are counted
_PENDING = 2**20  # codes of values between two countings: 8 MB
_KEY_BITS, _KEY_ZERO = 32, 2**31  # a code is quantity, sign and key; keys of finite numbers are below 2^22


# ---- moments, joined by halves ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Joined:
    """Moments of consecutive blocks: those with the numbers first .. first + blocks - 1.

    counts: (times,), int64. mean: (times, n). second_moment: (times, n, n). observed_mean: (times, n_observed).
    final_mean: (n_final,). final_second_moment: (n_final, n_final), of the trials that fly at the start, counts[0].
    excluded: non-finite trials.
    """

    first: int
    blocks: int
    excluded: int
    counts: np.ndarray
    mean: np.ndarray
    second_moment: np.ndarray
    observed_mean: np.ndarray
    final_mean: np.ndarray
    final_second_moment: np.ndarray

    __repr__ = summary


def join(a: Joined, b: Joined) -> Joined:
    """Moments of the blocks of both; b begins where a ends."""
    counts, mean, second_moment = merge_moments(
        (a.counts, a.mean, a.second_moment), (b.counts, b.mean, b.second_moment)
    )
    _, final_mean, final_second_moment = merge_moments(
        (a.counts[0], a.final_mean, a.final_second_moment), (b.counts[0], b.final_mean, b.final_second_moment)
    )
    share = (b.counts / np.maximum(counts, 1))[:, np.newaxis]
    return Joined(
        first=a.first,
        blocks=a.blocks + b.blocks,
        excluded=a.excluded + b.excluded,
        counts=counts,
        mean=mean,
        second_moment=second_moment,
        observed_mean=a.observed_mean + (b.observed_mean - a.observed_mean) * share,
        final_mean=final_mean,
        final_second_moment=final_second_moment,
    )


def append(joined: list[Joined], following: Joined) -> None:
    """Append to a list of consecutive moments, and join neighbours for as long as they are the halves of one whole.

    Wholes have 2^k blocks and begin at a multiple of that. So a list holds at most two entries of each size, and a pair
    is joined the same way wherever it meets.
    """
    joined.append(following)
    while len(joined) > 1:
        a, b = joined[-2:]
        if a.blocks != b.blocks or a.first % (2 * a.blocks):
            break
        joined[-2:] = [join(a, b)]


# ---- counts by value -------------------------------------------------------------------------------------------------


@cache
def _mapping():
    from ddsketch.mapping import CubicallyInterpolatedMapping

    return CubicallyInterpolatedMapping(RELATIVE_ACCURACY)


def _keys(magnitude):
    """The mapping's keys of positive numbers, any shape, as its `key` finds them one by one."""
    mapping = _mapping()
    mantissa, exponent = np.frexp(magnitude)
    s = 2.0 * mantissa - 1.0
    logarithm = ((mapping.A * s + mapping.B) * s + mapping.C) * s + (exponent - 1)
    # The number of keys per unit of that logarithm, as the library has it but does not tell.
    per_unit = 1.0 / np.log1p(2.0 * RELATIVE_ACCURACY / (1.0 - RELATIVE_ACCURACY)) / mapping.C
    return np.ceil(logarithm * per_unit).astype(np.int64)


def _codes(deviations):
    """One integer for quantity, sign and key of each deviation: (quantities, trials) -> the same shape, int64."""
    magnitude = np.abs(deviations)
    nothing = magnitude <= _mapping().min_possible
    side = np.where(nothing, 0, np.sign(deviations)).astype(np.int64)
    keys = np.where(nothing, 0, _keys(np.where(nothing, 1.0, magnitude)))
    quantity = np.arange(len(deviations))[:, np.newaxis]
    return ((3 * quantity + side + 1) << _KEY_BITS) + (keys + _KEY_ZERO)


def _joined_counts(codes, counts):
    """Each code once, in order, with the sum of its counts."""
    order = np.argsort(codes, kind="stable")  # fast where parts are in order already
    codes, counts = codes[order], counts[order]
    starts = np.flatnonzero(np.diff(codes, prepend=-1))
    return codes[starts], np.add.reduceat(counts, starts) if len(starts) else counts


class Sketch:
    """Counts by value of several quantities, to which values are added and from which cells are taken.

    centre: (quantities,), what is subtracted from the values. Only finite values may be added.
    """

    def __init__(self, centre):
        """Begin without values. Raises ValueError for a centre that is not finite."""
        self.centre = np.asarray(centre, dtype=float)
        if self.centre.ndim != 1 or not np.isfinite(self.centre).all():
            raise ValueError(f"centre must be finite numbers, one for each quantity, got {self.centre}")
        self.lowest, self.highest = np.full(len(self.centre), np.inf), np.full(len(self.centre), -np.inf)
        self._codes, self._counts = np.empty(0, np.int64), np.empty(0, np.int64)
        self._pending, self._waiting = [], 0

    def add(self, values):
        """Add values (quantities, trials)."""
        if values.shape[1]:
            self.lowest = np.minimum(self.lowest, values.min(axis=1))
            self.highest = np.maximum(self.highest, values.max(axis=1))
            self._pending.append(_codes(values - self.centre[:, np.newaxis]).ravel())
            self._waiting += values.size
        if self._waiting >= _PENDING:
            self._count()

    def merge(self, cells):
        """Add what another sketch of the same centre counted; cells: anything with the names that `cells` returns."""
        if not np.array_equal(cells.centre, self.centre):
            raise ValueError("the sketches have different centres, so their bins differ")
        self.lowest, self.highest = np.fmin(self.lowest, cells.lowest), np.fmax(self.highest, cells.highest)
        codes = (3 * cells.cell_quantity + cells.cell_side + 1) << _KEY_BITS
        codes += cells.cell_key + _KEY_ZERO
        self._codes, self._counts = _joined_counts(
            np.concatenate([self._codes, codes]), np.concatenate([self._counts, cells.cell_count])
        )

    def cells(self):
        """The sketch as arrays: centre, lowest, highest (quantities,) and what the occupied bins are and hold.

        lowest and highest are NaN without any value. cell_quantity: (cells,), int64. cell_side: (cells,), int8, sign of
        the deviation from the centre. cell_key: (cells,), int64, key of its magnitude. cell_count: (cells,), int64.
        """
        self._count()
        kind = self._codes >> _KEY_BITS
        return {
            "centre": self.centre,
            "lowest": np.where(np.isfinite(self.lowest), self.lowest, np.nan),
            "highest": np.where(np.isfinite(self.highest), self.highest, np.nan),
            "cell_quantity": kind // 3,
            "cell_side": (kind % 3 - 1).astype(np.int8),
            "cell_key": (self._codes & (2**_KEY_BITS - 1)) - _KEY_ZERO,
            "cell_count": self._counts,
        }

    def _count(self):
        if self._pending:
            codes, counts = np.unique(np.concatenate(self._pending), return_counts=True)
            self._pending, self._waiting = [], 0
            self._codes, self._counts = _joined_counts(
                np.concatenate([self._codes, codes]), np.concatenate([self._counts, counts])
            )


def sketched_percentile(cells, quantity, level):
    """Percentile of a sketched quantity with its standard error.

    cells: anything with the names that `Sketch.cells` returns, such as a streamed ensemble. quantity: its number.
    level: within (0, 1). Returns (value, standard_error): interpolated between two order statistics, as in
    `statistics.percentile`, each within the bound of this module; the error joins that of Maritz and Jarrett, taken
    over bins, with that bound. NaN without any value. Raises ValueError for other levels.
    """
    from scipy import special

    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie within (0, 1), got {level}")
    rows = cells.cell_quantity == quantity
    side, key, counts = cells.cell_side[rows].astype(np.int64), cells.cell_key[rows], cells.cell_count[rows]
    if not len(counts):
        return np.nan, np.nan
    order = np.lexsort((side * key, side))
    side, key, cumulative = side[order], key[order], np.cumsum(counts[order])
    total = int(cumulative[-1])

    def deviation(index):
        return 0.0 if side[index] == 0 else float(side[index]) * _mapping().value(int(key[index]))

    position = level * (total - 1)
    below = int(position)
    low, high = (
        deviation(np.searchsorted(cumulative, number, side="right")) for number in (below, min(below + 1, total - 1))
    )
    percentile = low + (high - low) * (position - below)
    rank = min(max(int(level * total + 0.5), 1), total)
    weights = np.diff(special.betainc(rank, total - rank + 1, np.concatenate([[0], cumulative]) / total))
    likely = np.flatnonzero(weights > 0.0)
    apart = np.array([deviation(index) for index in likely]) - percentile
    spread = weights[likely] @ apart**2 - (weights[likely] @ apart) ** 2
    bound = RELATIVE_ACCURACY * max(abs(low), abs(high))
    return float(cells.centre[quantity] + percentile), float(np.hypot(np.sqrt(max(spread, 0.0)), bound))


# ---- of either kind of ensemble --------------------------------------------------------------------------------------


def is_streamed(ensemble) -> bool:
    """Whether an ensemble holds the final states of its first trials alone."""
    return hasattr(ensemble, "cell_count")


def outcome_count(ensemble, code) -> int:
    """How many of all trials ended in an outcome."""
    if is_streamed(ensemble):
        return int(ensemble.outcome_counts[code])
    return int((ensemble.outcome == code).sum())


def final_percentile(ensemble, component, level, reference=0.0):
    """Percentile of a component of the final state, less a reference, over all finite trials; its standard error.

    Returns (value, standard_error), NaN as those of `percentile`.
    """
    if is_streamed(ensemble):
        value, error = sketched_percentile(ensemble, component, level)
        return value - reference, error
    samples = ensemble.final_state[np.isfinite(ensemble.final_state).all(axis=1), component] - reference
    return percentile(samples, level)


def final_extremes(ensemble, component):
    """A component of the final state of all trials, (trials,), or of a streamed ensemble its extremes, (2,)."""
    if is_streamed(ensemble):
        return np.array([ensemble.lowest[component], ensemble.highest[component]])
    return ensemble.final_state[:, component]


def observed_maxima(ensemble, quantity):
    """The maxima that all trials observed, (trials,), or of a streamed ensemble the largest of them, (1,)."""
    if is_streamed(ensemble):
        return ensemble.highest[[ensemble.final_state.shape[1] + quantity]]
    return ensemble.observed_maximum[:, quantity]


class FinalMoments:
    """Moments of some components of the final state, over all trials (of a streamed ensemble: all finite ones).

    The variance of one trial is NaN.

    index: one component, or several as a slice. Those of several have the shapes (n,) and (n, n).
    """

    def __init__(self, ensemble, index):
        """Take the ensemble; everything is computed when asked for."""
        self._ensemble, self._index, self._streamed = ensemble, index, is_streamed(ensemble)
        self._samples = ensemble.final_state[:, index]

    @property
    def count(self) -> int:
        """Trials."""
        return self._ensemble.count if self._streamed else len(self._samples)

    @cached_property
    def mean(self):
        """Their mean."""
        return self._ensemble.final_mean[self._index] if self._streamed else self._samples.mean(axis=0)

    @cached_property
    def variance(self):
        """Their unbiased variance."""
        if self._streamed:
            return np.diag(self._ensemble.final_covariance)[self._index]
        return self._samples.var(axis=0, ddof=1) if self.count > 1 else np.full(self._samples.shape[1:], np.nan)[()]

    @cached_property
    def population_deviation(self):
        """Their standard deviation with the division by the number of trials."""
        if self._streamed:
            return np.sqrt(self.variance * (self.count - 1) / self.count)
        return self._samples.std(axis=0)

    @cached_property
    def covariance(self):
        """Their unbiased covariance, (n, n)."""
        if self._streamed:
            return self._ensemble.final_covariance[self._index, self._index]
        return covariance(self._samples)

    @cached_property
    def covariance_errors(self):
        """Standard errors of the covariance, (n, n); of a streamed ensemble those of its first trials, scaled.

        NaN if fewer than two of these are finite.
        """
        if not self._streamed:
            return covariance_standard_errors(self._samples)
        finite_samples = self._samples[np.isfinite(self._ensemble.final_state).all(axis=1)]
        return covariance_standard_errors(finite_samples) * np.sqrt(len(finite_samples) / self.count)
