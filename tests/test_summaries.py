"""What objects that hold arrays show of themselves: few characters, whatever they hold."""

import dataclasses
import inspect
from importlib import import_module
from pkgutil import walk_packages
from typing import Any, NamedTuple

import numpy as np
import pytest

from marsedl.summaries import SHORT, WIDTH, summary, value_range


def annotations(kind):
    """The types of all fields of a named tuple or dataclass, as text; empty for other classes."""
    if dataclasses.is_dataclass(kind):
        return {field.name: str(field.type) for field in dataclasses.fields(kind)}
    return {name: str(kind.__annotations__[name]) for name in getattr(kind, "_fields", ())}


def holders():
    """The public classes of the libraries that hold arrays."""
    for package in ("methods", "models", "montecarlo"):
        library = import_module(f"marsedl.{package}")
        for found in walk_packages(library.__path__, f"{library.__name__}."):
            for name, kind in inspect.getmembers(import_module(found.name), inspect.isclass):
                own = kind.__module__ == found.name and not name.startswith("_")
                if own and any("ndarray" in text for text in annotations(kind).values()):
                    yield kind


def test_objects_that_hold_large_arrays_show_shapes():
    kinds = list(holders())
    assert len(kinds) > 20
    array = np.linspace(-1.0, 2.0, 900).reshape(100, 3, 3)
    for kind in kinds:
        values = {name: array if "ndarray" in text else 3 for name, text in annotations(kind).items()}
        if issubclass(kind, tuple):
            holder = kind(**values)
        else:
            holder = object.__new__(kind)  # no check of a class is about what it shows
            vars(holder).update(values)
        text = repr(holder)
        assert "(100, 3, 3) -1 to 2" in text
        assert len(text) <= WIDTH + 70 * len(values)


class Holder(NamedTuple):
    """Of anything."""

    held: Any

    __repr__ = summary


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "None"),
        (True, "True"),
        (np.float64(1 / 3), "0.333333"),
        (np.array(2.5), "2.5"),
        (np.zeros((0, 2)), "(0, 2) empty"),
        (np.zeros(9), "(9,) 0"),
        (np.array([[np.nan, 1.0], [2.0, np.inf]]), "(2, 2) 1 to inf, 1 nan"),
        (np.full(5, np.nan), "(5,) nan"),
        (np.array(["a", "b"]), "(2,) 'a', 'b'"),
        ("x" * 99, repr("x" * (SHORT - 3) + "...")),
        ({"a": np.zeros(99)}, "dict of 1"),
        ((Holder(1), Holder(2)), "tuple of 2"),
        (Holder(np.zeros(99)), "Holder"),
        (len, "builtin_function_or_method"),
    ],
)
def test_what_a_field_shows(value, text):
    assert repr(Holder(value)) == f"Holder(held={text})"


def test_the_range_of_truths_and_texts():
    assert value_range(np.array([True, False, True])) == "2 of 3 true"
    assert value_range(np.array(list("abcdb"))) == "'a', 'b', 'c' and 1 more"
