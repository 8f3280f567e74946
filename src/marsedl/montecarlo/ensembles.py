"""Ensembles of trials: what a block of them flew, and the reduction of any number of blocks.

A paper writes a function `simulate_block(first_trial, last_trial) -> Trajectories`, around `flights.Flight.fly` or in
numpy. `run_blocks` simulates a chunk of trials block by block and reduces each block at once, so memory does not grow
with the histories; `merge` joins all chunks. Blocks have a fixed size and are merged in their order: the result is
bitwise the same for every number of chunks. Both keep every final state.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from marsedl.compiling import compiled_when_called
from marsedl.montecarlo import LANES
from marsedl.montecarlo.outcomes import NON_FINITE
from marsedl.montecarlo.statistics import central_moments, merge_moments
from marsedl.summaries import summary

BLOCK_SIZE = 1000


# ---- trajectories of a block -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Everything of some consecutive trials; the trial is the last dimension.

    history: (times, n, trials), state. observed: (times, n_observed, trials). observed_maximum: (n_observed, trials),
    largest value over all steps. final_state: (n_final, trials), the state at the trial's own end, with or without the
    components of the history and others such as the time. outcome: (trials,), int8, see the codes of this module.
    length: (trials,), int64, number of outputs up to the trial's end, 1 to times: what history and observed hold
    beyond is ignored. ended: (trials,), int8, of flights of the engine: the number of the end that was reached,
    NOTHING, or MET_AT_THE_START for a trial that began behind one.
    """

    history: np.ndarray
    observed: np.ndarray
    observed_maximum: np.ndarray
    final_state: np.ndarray
    outcome: np.ndarray
    length: np.ndarray
    ended: np.ndarray | None = None

    __repr__ = summary

    @property
    def after_end(self):
        """(times, trials) bool: the trial has ended before the output."""
        return np.arange(len(self.history))[:, np.newaxis] >= self.length

    @property
    def finite(self):
        """(trials,) bool: the final state and what was observed at most are finite."""
        return np.isfinite(self.final_state).all(axis=0) & np.isfinite(self.observed_maximum).all(axis=0)

    def cleared(self):
        """Itself, with NaN in place of what history and observed hold beyond a trial's end."""
        for stored in (self.history, self.observed):
            np.copyto(stored, np.nan, where=self.after_end[:, np.newaxis])
        return self

    def with_ends(self):
        """As `cleared`, but with the end of a trial that ended between two outputs in the row of the later one.

        For flights of the engine, whose last row is each trial's own end.
        """
        ends, early = self.history[-1].T.copy(), np.flatnonzero(self.length < len(self.history))
        self.cleared().history[self.length[early], :, early] = ends[early]
        return self

    def first(self, trials):
        """The first `trials` trials, as views: drops the lanes that only fill up the last group."""
        given = (field.name for field in fields(self) if getattr(self, field.name) is not None)
        return Trajectories(**{name: getattr(self, name)[..., :trials] for name in given})


def pad_to_groups(array):
    """Repeat the last trial up to a whole number of groups: (..., trials) -> (..., groups * LANES)."""
    array = np.asarray(array, dtype=float)
    missing = -array.shape[-1] % LANES
    return np.ascontiguousarray(np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)], mode="edge"))


SimulateBlock = Callable[[int, int], Trajectories]


# ---- reduction of blocks and chunks ----------------------------------------------------------------------------------


@compiled_when_called
def _count_in_bins(values, edges, counts):
    """Add values (times, n_observed, trials) to counts (times, n_counted, bins + 2); bins are closed on the left."""
    bins = edges.shape[1] - 1
    for time in range(values.shape[0]):
        for quantity in range(counts.shape[1]):
            grid = edges[quantity]
            per_bin = bins / (grid[bins] - grid[0])
            for trial in range(values.shape[2]):
                value = values[time, quantity, trial]
                if value < grid[0]:
                    counts[time, quantity, 0] += 1
                elif value >= grid[bins]:
                    counts[time, quantity, bins + 1] += 1
                else:
                    # The guess is right for uniform edges up to rounding; the two loops make it exact for any edges.
                    guess = min(int((value - grid[0]) * per_bin), bins - 1)
                    while value < grid[guess]:
                        guess -= 1
                    while value >= grid[guess + 1]:
                        guess += 1
                    counts[time, quantity, guess + 1] += 1


def _finite_trials(block):
    """(trials,) bool: every number of the trial is finite, up to its end."""
    finite = block.finite
    for array in (block.history, block.observed):
        finite &= (np.isfinite(array).all(axis=1) | block.after_end).all(axis=0)
    return finite


def _flying(length, times):
    """Runs of outputs between which no trial ends: yields (outputs, trials that fly there), two indices of arrays.

    length: (trials,), outputs of each trial, 0 for a trial that is to be left out.
    """
    for start, end in pairwise(np.unique(np.concatenate([[0, times], length]))):
        flying = length > start
        # A slice copies nothing.
        yield slice(start, end), slice(None) if flying.all() else flying


def without_infinities(value):
    """Replace infinite numbers, which only non-finite trials have, by NaN, which artifacts can hold.

    value: anything; all but floating-point arrays is returned as it is.
    """
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.where(np.isinf(value), np.nan, value)
    return value


def _checked_edges(edges, n_observed):
    if edges is None:
        edges = np.tile([0.0, 1.0], (n_observed, 1))
    edges = np.ascontiguousarray(edges, dtype=float)
    if edges.ndim != 2 or not min(1, n_observed) <= edges.shape[0] <= n_observed or edges.shape[1] < 2:
        raise ValueError(f"histogram_edges must have shape (up to {n_observed}, bins + 1), got {edges.shape}")
    if not np.isfinite(edges).all() or (np.diff(edges, axis=1) <= 0).any():
        raise ValueError("histogram_edges must be finite and increase")
    return edges


def run_blocks(
    simulate_block: SimulateBlock,
    first_trial,
    last_trial,
    *,
    block_size=BLOCK_SIZE,
    histogram_edges=None,
    kept=0,
):
    """Simulate the trials [first_trial, last_trial) block by block, reducing each block at once.

    simulate_block: `simulate_block(first, last) -> Trajectories` of exactly last - first trials (see
    `Trajectories.first`).
    first_trial: a multiple of block_size. last_trial: a multiple too, unless it is the end of the ensemble.
    histogram_edges: (n_counted, bins + 1), increasing, of the first n_counted observed quantities, which alone are
    counted; uniform ones are fastest. Without them everything of no interest is in one bin [0, 1). kept: trials
    0 .. kept - 1 of the ensemble keep their full histories, in whatever chunks they are.

    Returns a chunk, arrays by name, which `merge` joins to others:

    - first_trial and block_size, int; histogram_edges;
    - of every block: block_counts (blocks, times), trials in its moments; block_excluded (blocks,), its non-finite
      trials; block_mean (blocks, times, n); block_second_moment (blocks, times, n, n), sums of products about that
      mean; block_observed_mean (blocks, times, n_observed);
    - histogram (times, n_counted, bins + 2), whose first and last entries count what lies outside the edges;
      maximum_over_trials (times, n_observed), NaN when no finite trial is flying;
    - of every trial: final_state (trials, n_final), observed_maximum (trials, n_observed), outcome (trials,), int8;
      of the kept ones: kept_history (kept, times, n), kept_observed (kept, times, n_observed), NaN beyond their end.

    Moments, histogram and maximum at a time are those of the trials still flying, which have not ended before it. A
    non-finite trial (code NON_FINITE) is left out of them at all times, and counted; it stays in the per-trial arrays
    and among the kept histories as it is. All other outcomes are included.

    Raises ValueError for bounds off the blocks, wrong edges, a block with another number of trials, or a trial without
    outputs or with more than there are.
    """
    if first_trial < 0 or first_trial % block_size:
        raise ValueError(f"first_trial ({first_trial}) must be a multiple of block_size ({block_size})")
    if last_trial <= first_trial:
        raise ValueError(f"last_trial ({last_trial}) must exceed first_trial ({first_trial})")
    blocks, trials_of_blocks = [], []
    histogram = edges = maximum_over_trials = None
    for first in range(first_trial, last_trial, block_size):
        last = min(first + block_size, last_trial)
        block = simulate_block(first, last)
        if block.outcome.shape != (last - first,):
            raise ValueError(f"block of trials [{first}, {last}) came back with {block.outcome.size} outcomes")
        times, n, _ = block.history.shape
        n_observed = block.observed.shape[1]
        if block.length.shape != (last - first,) or not ((block.length >= 1) & (block.length <= times)).all():
            raise ValueError(f"length of trials [{first}, {last}) must be within 1 and {times} outputs for each trial")
        if histogram is None:
            edges = _checked_edges(histogram_edges, n_observed)
            histogram = np.zeros((times, len(edges), edges.shape[1] + 1), np.int64)
            maximum_over_trials = np.full((times, n_observed), np.nan)

        finite = _finite_trials(block)
        counts, mean, second_moment = np.zeros(times, np.int64), np.zeros((times, n)), np.zeros((times, n, n))
        observed_mean = np.zeros((times, n_observed))
        for outputs, trials in _flying(np.where(finite, block.length, 0), times):
            history, observed = block.history[outputs][..., trials], block.observed[outputs][..., trials]
            count, mean[outputs], second_moment[outputs] = central_moments(np.moveaxis(history, -1, 0))
            counts[outputs] = count
            if count:
                observed_mean[outputs] = observed.mean(axis=-1)
                largest = maximum_over_trials[outputs]
                np.fmax(largest, observed.max(axis=-1), out=largest)
                _count_in_bins(observed, edges, histogram[outputs])
        blocks.append(
            {
                "block_counts": counts,
                "block_excluded": last - first - np.count_nonzero(finite),
                "block_mean": mean,
                "block_second_moment": second_moment,
                "block_observed_mean": observed_mean,
            }
        )
        keep = max(0, min(kept, last) - first)
        after_end = block.after_end[:, :keep].T[..., np.newaxis]
        kept_history, kept_observed = (
            np.where(after_end, np.nan, np.moveaxis(array[..., :keep], -1, 0))
            for array in (block.history, block.observed)
        )
        trials_of_blocks.append(
            {
                "final_state": block.final_state.T.copy(),
                "observed_maximum": block.observed_maximum.T.copy(),
                "outcome": np.where(finite, block.outcome, NON_FINITE).astype(np.int8),
                "kept_history": kept_history,
                "kept_observed": kept_observed,
            }
        )
    return {
        "first_trial": first_trial,
        "block_size": block_size,
        **{name: np.stack([block[name] for block in blocks]) for name in blocks[0]},
        "histogram": histogram,
        "histogram_edges": edges,
        "maximum_over_trials": maximum_over_trials,
        **{name: np.concatenate([trials[name] for trials in trials_of_blocks]) for name in trials_of_blocks[0]},
    }


def chunk_bounds(trials, chunks, block_size=BLOCK_SIZE):
    """Split [0, trials) into at most `chunks` chunks of whole blocks, as even as possible.

    Returns [(first, last), ...]; fewer than `chunks` when there are fewer blocks. Raises ValueError for sizes below 1.
    """
    if min(trials, chunks, block_size) < 1:
        raise ValueError(f"trials ({trials}), chunks ({chunks}) and block_size ({block_size}) must be at least 1")
    blocks = -(-trials // block_size)
    chunks = min(chunks, blocks)
    starts = [block_size * (blocks * chunk // chunks) for chunk in range(chunks)]
    return list(zip(starts, [*starts[1:], trials], strict=True))


def merge(chunks: Sequence[Mapping]):
    """Join all chunks of an ensemble, given in any order, in the order of their blocks.

    Returns the ensemble, arrays by name: histogram, maxima and what is kept of every trial as in a chunk, see
    `run_blocks`, and

    - count and excluded, int: trials inside the moments at the start and outside of them at all times, together all;
    - flying (times,), int64: trials in the moments at each time;
    - mean (times, n); covariance (times, n, n), divided by flying - 1; observed_mean (times, n_observed): NaN only
      where no trial (of a covariance: fewer than two) is flying; who wants more for an estimate masks by `flying`.

    Raises ValueError when trials are missing or doubled, or when chunks do not match.
    """
    chunks = sorted(chunks, key=lambda chunk: chunk["first_trial"])
    if not chunks:
        raise ValueError("no chunks to merge")
    expected = 0
    for chunk in chunks:
        if chunk["first_trial"] != expected:
            raise ValueError(f"chunk starts at trial {chunk['first_trial']}, expected {expected}")
        if chunk["block_size"] != chunks[0]["block_size"] or expected % chunk["block_size"]:
            raise ValueError(f"chunk at trial {expected} has another block size or follows a short block")
        if not np.array_equal(chunk["histogram_edges"], chunks[0]["histogram_edges"]):
            raise ValueError(f"chunk at trial {expected} has other histogram edges")
        expected += len(chunk["outcome"])

    def joined(name):
        return np.concatenate([chunk[name] for chunk in chunks])

    counts = joined("block_counts")
    moments = counts, joined("block_mean"), joined("block_second_moment")
    flying, mean, second_moment = functools.reduce(merge_moments, zip(*moments, strict=True))
    at_time = flying[:, np.newaxis]
    observed_sum = (counts[:, :, np.newaxis] * joined("block_observed_mean")).sum(axis=0)
    covariance = second_moment / np.maximum(at_time - 1, 1)[:, np.newaxis]
    of_trials = ("final_state", "observed_maximum", "outcome", "kept_history", "kept_observed")
    return {
        "count": int(flying[0]),
        "excluded": int(joined("block_excluded").sum()),
        "flying": flying,
        "mean": np.where(at_time > 0, mean, np.nan),
        "covariance": np.where(at_time[:, np.newaxis] > 1, covariance, np.nan),
        "observed_mean": np.where(at_time > 0, observed_sum / np.maximum(at_time, 1), np.nan),
        "histogram": sum(chunk["histogram"] for chunk in chunks),
        "histogram_edges": chunks[0]["histogram_edges"],
        "maximum_over_trials": np.fmax.reduce([chunk["maximum_over_trials"] for chunk in chunks]),
        **{name: joined(name) for name in of_trials},
    }
