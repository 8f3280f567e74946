"""What objects that hold arrays show of themselves: shapes and ranges instead of thousands of numbers."""

import dataclasses
from collections.abc import Sized
from typing import Any

import numpy as np

WIDTH = 120  # of a line
SHORT = 40  # characters of a text


def summary(holder: Any) -> str:
    """Return what a named tuple or dataclass holds, in one line or in one for each field.

    Of an array it is the shape and the range, or all of it if it is a short row; of a number or text the value; of all
    else the type.

        class Regulator(NamedTuple):
            gains: np.ndarray
            values: np.ndarray

            __repr__ = summary
    """
    names = getattr(holder, "_fields", None) or [field.name for field in dataclasses.fields(holder)]
    texts = {name: _shown(getattr(holder, name)) for name in names}
    title = type(holder).__name__
    line = f"{title}({', '.join(f'{name}={text}' for name, text in texts.items())})"
    if len(line) <= WIDTH:
        return line
    width = max(map(len, texts))
    return "\n".join([title, *(f"  {name.ljust(width)}  {text}" for name, text in texts.items())])


def value_range(array: np.ndarray) -> str:
    """Return the least and largest value of an array, and how many are NaN; the value if there is one alone."""
    if array.dtype.kind not in "iufb":
        texts = list(dict.fromkeys(str(text) for text in array.ravel().tolist()))
        examples = ", ".join(repr(text if len(text) <= 20 else f"{text[:17]}...") for text in texts[:3])
        return examples + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")
    if array.dtype.kind == "b":
        return str(bool(array)) if not array.ndim else f"{np.count_nonzero(array)} of {array.size} true"
    known = array[~np.isnan(array)]
    if not known.size:
        return "nan" if array.size else "empty"
    least, most = (f"{value:.6g}" for value in (known.min(), known.max()))
    gaps = f", {array.size - known.size} nan" if known.size < array.size else ""
    return (least if least == most else f"{least} to {most}") + gaps


def _shown(value: Any) -> str:
    """Return a few words on a field."""
    if isinstance(value, np.ndarray) and value.ndim:
        row = value.ndim == 1 and 0 < value.size <= 4 and value.dtype.kind in "iufb"
        return np.array2string(value, precision=6) if row else f"{value.shape} {value_range(value)}"
    if isinstance(value, str):
        return repr(value if len(value) <= SHORT else f"{value[: SHORT - 3]}...")
    if isinstance(value, float | np.ndarray | np.generic):
        return value_range(np.asarray(value))
    if value is None or isinstance(value, int):
        return str(value)
    counted = isinstance(value, Sized) and not hasattr(value, "_fields")
    return type(value).__name__ + (f" of {len(value)}" if counted else "")
