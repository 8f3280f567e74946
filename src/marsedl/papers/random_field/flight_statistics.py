"""What an ensemble of flights says: lost trials, percentiles of delta-v and violations of the control limits."""

import numpy as np

from marsedl.montecarlo.statistics import percentile
from marsedl.papers.random_field.records import CAPTURED

LEVEL = 0.99  # of the percentile of delta-v that the paper reports


def lost(ensemble, trials=None):
    """Lost trials of every law, (laws,): all that are not captured."""
    return (ensemble.outcome[:, :trials] != CAPTURED).sum(axis=1)


def percentile_with_lost(delta_v, level=LEVEL):
    """Percentile of delta-v and its standard error, m/s; a lost trial (NaN) counts as larger than any.

    NaN if so many are lost that the percentile lies among them.
    """
    captured = np.sort(delta_v[np.isfinite(delta_v)])
    if len(captured) < 2 or len(captured) < level * len(delta_v) + 1:
        return np.nan, np.nan
    # Lost trials lie above the percentile, so the largest value may stand for them.
    return percentile(np.concatenate([captured, np.full(len(delta_v) - len(captured), captured[-1])]), level)


def delta_v_percentile(ensemble, law, level=LEVEL, trials=None):
    """`percentile_with_lost` of a law's trials, of the first ones or of all."""
    return percentile_with_lost(ensemble.delta_v[law, :trials], level)


def step_violations(ensemble, partition):
    """Flights that command beyond the limits in each interval, (laws, intervals), and in any, (laws,)."""
    rows = np.searchsorted(ensemble.time, partition[:-1] + 1e-9 * partition[-1], side="right") - 1
    beyond = ensemble.histogram[:, rows, 0]  # of the commanded control
    return beyond[..., 0] + beyond[..., -1], (ensemble.observed_maximum[..., 1] > 0.0).sum(axis=1)
