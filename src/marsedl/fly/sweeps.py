"""Several cases of the same trials beside each other: one table, with paired differences to the first."""

from collections.abc import Mapping

import numpy as np

from marsedl.fly.flights import Flights, mean_interval
from marsedl.words import require

__all__ = ["compare"]

COLUMNS = [
    *("case", "quantity", "statistic", "unit", "value", "lower", "upper"),
    *("difference", "difference_lower", "difference_upper", "flights", "note"),
]


def compare(flights, names, percentiles=(1, 50, 99), confidence=0.95):
    """One table of several flights of the same seed and number: what they reach, and how it differs from the first.

    Args:
        flights: mapping from the name of each case to its `Flights`.
        names: quantities, of which the mean and the percentiles are told, and conditions, of which the share is.
        percentiles: per cent. confidence: of each interval by itself; of twenty intervals of 95 % one is to miss.

    Returns:
        Data frame with a row for each case, quantity and statistic ("mean", "p99", "share"), and the columns case,
        quantity, statistic, unit, value, lower, upper, difference (to the first case, trial by trial, over the flights
        that count in both, see `Flights.against`), difference_lower, difference_upper, flights (that count), note.

    Raises:
        ValueError: for flights that are no pairs, an unknown quantity, or a level that is no percentage.
    """
    import pandas as pd

    require(
        isinstance(flights, Mapping) and flights and all(isinstance(one, Flights) for one in flights.values()),
        "compare takes a mapping from names to Flights, at least one",
    )
    names, rows = [names] if isinstance(names, str) else [*names], []
    first = next(iter(flights.values()))
    for case, one in flights.items():
        count = int(one._counted()[0].sum())
        for name in names:
            for statistic, percentile, *own, note in _statistics(one, name, percentiles, confidence):
                paired = one.against(first, name, confidence, percentile).iloc[0]
                difference = (np.nan,) * 3 if one is first else paired[["difference", "lower", "upper"]]
                rows.append((case, name, statistic, paired["unit"], *own, *difference, count, note))
    return pd.DataFrame(rows, columns=COLUMNS)


def _statistics(flights, name, percentiles, confidence):
    """What is told of a quantity or a condition: name, percentile, value, both ends of its interval, and note of each.

    Only percentiles have a percentile.
    """
    counted, note = flights._counted()
    if flights.is_condition(name):
        return [("share", None, *flights.probability(name, confidence)[["value", "lower", "upper"]], note)]
    mean, ends = mean_interval(flights.values(name)[counted], confidence)
    rows = flights.percentiles(name, percentiles, confidence)[["percentile", "value", "lower", "upper", "note"]]
    return [("mean", None, mean, *ends, note), *((f"p{row[0]:g}", *row) for row in rows.itertuples(index=False))]
