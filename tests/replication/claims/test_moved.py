"""One comparison of two sets of numbers, by three rules; and the unit of one of several numbers."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication.claims.moved import Entry, exact, moved, relative, standard_errors
from marsedl.replication.claims.numbers import unit_of


@pytest.mark.parametrize(
    ("rule", "before", "after", "size"),
    [
        (exact, Entry(math.nan, verdict="holds"), Entry(math.nan, verdict="holds"), 0.0),
        (exact, Entry(1.0), Entry(np.nextafter(1.0, 2.0)), math.inf),
        (exact, Entry(verdict="holds"), Entry(verdict="fails"), math.inf),
        (relative, Entry(np.array([1.0, 2.0]), rounding=0.1), Entry(np.array([1.05, 2.2])), 2.0),
        (relative, Entry(np.array([])), Entry(np.array([])), 0.0),
        (standard_errors(3.0), Entry(1.0, 0.3), Entry(2.5, 0.4), 1.0),
        (standard_errors(3.0), Entry(1.0, 0.3, half=0.5), Entry(3.0, 0.4), 1.0),
        (standard_errors(3.0), Entry(1.0, rounding=0.5), Entry(2.0), 2.0),
        (standard_errors(3.0), Entry(1.0, limit=3.0), Entry(2.0), 0.5),  # of its distance from its limit
        (standard_errors(3.0), Entry(0.0), Entry(1e-300), math.inf),
        (standard_errors(3.0), Entry(), Entry(1.0), math.nan),
    ],
)
def test_a_rule_says_how_far_is_too_far(rule, before, after, size):
    (one,) = moved({"a": before}, {"a": after}, rule)
    assert one.size == pytest.approx(size, nan_ok=True)


def test_what_only_one_side_has_or_has_in_another_unit_moves_infinitely_and_of_two_tests_nothing_can_be_said():
    before = {"gone": Entry(1.0), "unit": Entry(1.0, unit="m"), "test": Entry(1.0, unit="m", test="test 1")}
    after = {"unit": Entry(1.0, unit="s"), "test": Entry(2.0, unit="%", test="test 2"), "new": Entry(1.0)}
    sizes = {one.name: one.size for one in moved(before, after, relative)}
    assert sizes == pytest.approx({"gone": math.inf, "unit": math.inf, "test": math.nan, "new": math.inf}, nan_ok=True)


@pytest.mark.parametrize(
    ("printed", "unit", "index", "expected"),
    [
        (1.0, "m", (), "m"),
        ([1.0, 2.0], "m", (1,), "m"),
        ([1.0, 2.0], "km/s, m/s", (1,), "m/s"),
        ([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], "km, deg", (2, 0), "km"),  # a row for each case, a unit for each column
        ([[1.0, 2.0], [3.0, 4.0]], "km, deg", (1, 0), "km"),
        ([1.0, 2.0, 3.0], "h, cores", (2,), "h, cores"),  # not one for each
    ],
)
def test_the_unit_of_a_component_is_that_of_its_column(printed, unit, index, expected):
    assert unit_of(SimpleNamespace(printed=printed, unit=unit), index) == expected
