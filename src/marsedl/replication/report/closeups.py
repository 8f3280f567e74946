"""Interactive plots of the report: the data that the page's script draws."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class CloseUp:
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
    decimals = np.broadcast_to(digits - np.floor(np.log10(span)).astype(int), values.shape)
    return _nested(
        [
            round(v, int(d)) + 0.0 if math.isfinite(v) else None
            for v, d in zip(values.ravel().tolist(), decimals.flat, strict=True)
        ],
        values.shape,
    )


def _nested(flat: list, shape: tuple[int, ...]) -> list:
    """Fold a flat list into lists of this shape."""
    for extent in reversed(shape[1:]):
        flat = [flat[i : i + extent] for i in range(0, len(flat), extent)]
    return flat
