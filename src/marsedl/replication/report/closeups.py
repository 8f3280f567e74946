"""Interactive plots of the report: the data that the page's script draws."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np


class CloseUp(NamedTuple):
    """A plot that the reader can rotate, filter and step through.

    `kind` is the drawing routine of closeups.js: scatter, tube or histories; `data` is what it draws, ready for JSON.
    """

    name: str
    title: str
    text: str
    kind: str
    data: Mapping[str, Any]


def rounded(values: np.ndarray, axis: int | None = None, digits: int = 4) -> list:
    """Round to this many digits of the range, as many as a screen shows; NaN becomes None.

    axis: along which the range is taken, of all values together by default.
    """
    values = np.asarray(values, float)
    with np.errstate(invalid="ignore"):
        least, most = np.nanmin(values, axis=axis, initial=np.inf), np.nanmax(values, axis=axis, initial=-np.inf)
    span = np.where(most > least, most - least, np.where(np.isfinite(most) & (most != 0.0), np.abs(most), 1.0))
    decimals = digits - np.floor(np.log10(span)).astype(int)
    of_value = np.frompyfunc(lambda v, d: round(v, d) + 0.0 if math.isfinite(v) else None, 2, 1)
    return of_value(values, decimals).tolist()
