"""Numbers as text, and plain values nested in lists."""

import math
from numbers import Integral
from typing import Any

import numpy as np

NOT_EVALUATED = "–"


def format_number(value: Any, standard_error: float | None = None, resolution: float | None = None) -> str:
    """Write one number for a reader, such as `1349.384 ± 0.047`, `4.85e-4`, `true`, or a dash for None.

    Args:
        value: a number, bool, text or None.
        standard_error: if positive, it is shown with two digits and sets the digits of the value.
        resolution: the size of the last digit to show, if there is no standard error; without it six digits are shown.

    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if not is_number(value) or not math.isfinite(value):
        return NOT_EVALUATED if value is None else str(value)
    has_error = standard_error is not None and math.isfinite(standard_error) and standard_error > 0
    if not has_error and resolution is None:
        return f"{value:.6g}"
    last_digit = _decade(standard_error) - 1 if has_error else _decade(resolution)
    size = max(abs(value), standard_error) if has_error else abs(value)
    exponent = _decade(size) if size else 0
    # Powers of ten take as many digits as needed to reach the last one.
    exponent = 0 if -4 < exponent < 7 else exponent
    decimals, scale = max(exponent - last_digit, 0), 10.0**exponent
    number = f"{value / scale:.{decimals}f}"
    if has_error:
        number = f"{number} ± {standard_error / scale:.{decimals}f}"
        number = f"({number})" if exponent else number
    return f"{number}e{exponent}" if exponent else number


def format_lines(value: Any, standard_error: Any = None, resolution: Any = None) -> list[str]:
    """Write a number, vector or matrix as one line per number or matrix row; arguments as in `format_number`."""
    if not isinstance(value, list):
        return [format_number(value, standard_error, resolution)]

    def part(other: Any, index: int) -> Any:
        return other[index] if isinstance(other, list) else other

    inner = [format_lines(item, part(standard_error, i), part(resolution, i)) for i, item in enumerate(value)]
    return [", ".join(lines) for lines in inner]


def told_apart(value: Any, limit: Any) -> tuple[str, str]:
    """Write a number and its limit, with four digits or as many as it takes to tell them apart."""
    if isinstance(value, Integral):
        return f"{value:,}", f"{limit:,}" if float(limit).is_integer() else f"{limit:.4g}"
    for digits in range(4, 18):
        texts = f"{value:.{digits}g}", f"{limit:.{digits}g}"
        if texts[0] != texts[1] or value == limit:
            break
    return texts


def _decade(size: float) -> int:
    return math.floor(math.log10(size) + 1e-9)  # 0.001 has decade -3 although its logarithm is rounded


def plain(value: Any) -> Any:
    """Turn arrays, numpy numbers and tuples into lists and Python numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def finite_values(value: Any, infinity: str | None = None) -> Any:
    """Replace numbers that JSON cannot hold: by None, or by a text where an infinite number is meant."""
    if isinstance(value, list):
        return [finite_values(item, infinity) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if infinity is None or math.isnan(value) else f"{'-' * (value < 0)}{infinity}"
    return value


def flatten(value: Any, index: tuple[int, ...] = ()) -> dict[tuple[int, ...], Any]:
    """Return the numbers of a nested list by their indices; two values have one shape if the indices are the same."""
    if not isinstance(value, list):
        return {index: value}
    return {place: leaf for i, item in enumerate(value) for place, leaf in flatten(item, (*index, i)).items()}


def unit_of(claim: Any, index: tuple[int, ...]) -> str:
    """Return the unit of one number of a printed claim, by its index.

    Units that differ are listed with commas, for the entries of the last dimension that has so many.
    """
    units = claim.unit.split(", ")
    along = [axis for axis, extent in enumerate(np.shape(claim.printed)) if extent == len(units)]
    return units[index[along[-1]]] if index and along and len(units) > 1 else claim.unit


def is_number(value: Any) -> bool:
    """Whether a plain value is one number."""
    return isinstance(value, int | float) and not isinstance(value, bool)
