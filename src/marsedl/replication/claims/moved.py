"""What moved between two sets of numbers: readings, universes, builds, or tables of anybody.

A side holds entries by their names, `moved` puts two sides beside each other, and a rule says how far is too far:
`exact`, `relative` (beyond rounding) or `standard_errors` (beyond noise and rounding).
"""

import math
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np


class Entry(NamedTuple):
    """A number or several, a verdict, or both.

    `limit` is what is printed, or the limit of a test; `test` names that test of a statement. `half` is half of the
    last printed digit, `rounding` what rounding may change. `said` stands in place of a number where there is none.
    """

    value: Any = math.nan
    error: float = 0.0
    limit: float = math.nan
    verdict: str = ""
    unit: str = ""
    half: float = 0.0
    rounding: Any = 0.0
    test: str = ""
    said: str = ""

    @property
    def is_number(self) -> bool:
        """Whether it is one finite number."""
        return np.ndim(self.value) == 0 and math.isfinite(self.value)


Side = Mapping[Hashable, Entry]
Rule = Callable[[Entry, Entry], float]  # how far two entries are apart: more than 1 is too far


def exact(before: Entry, after: Entry) -> float:
    """Return 0 if two entries have the same bits and words, else infinity; one NaN is as good as another."""
    return 0.0 if differing(before, after) is None else math.inf


def differing(before: Entry, after: Entry) -> str | None:
    """Return the name of the first field in which two entries of one number differ."""
    pairs = zip(Entry._fields, before, after, strict=True)
    return next((name for name, a, b in pairs if not (a == b or (a != a and b != b))), None)


def relative(before: Entry, after: Entry) -> float:
    """Return how far numbers are apart, in what rounding may change; of several the furthest."""
    return float(np.max(np.abs(np.asarray(before.value) - after.value) / before.rounding, initial=0.0))


def standard_errors(count: float) -> Rule:
    """Return the rule that allows so many standard errors of the difference, and rounding.

    To the errors comes half of the last printed digit. What has neither is judged by its distance from its limit.
    """

    def rule(before: Entry, after: Entry) -> float:
        difference = abs(after.value - before.value)
        if not math.isfinite(difference) or difference == 0.0:
            return difference if difference == 0.0 else math.nan
        noise = count * math.hypot(*np.nan_to_num([before.error, after.error])) + before.half
        allowed = max(noise, before.rounding) or abs(before.value - before.limit)
        return difference / allowed if allowed > 0.0 else math.inf

    return rule


class Moved(NamedTuple):
    """An entry on two sides, None where a side has none; `size` is how far they are apart, by the rule.

    It is NaN where no difference means anything: a number is missing, or another test decides.
    """

    name: Any
    before: Entry | None
    after: Entry | None
    size: float

    @property
    def is_on_both(self) -> bool:
        """Whether both sides have it."""
        return None not in (self.before, self.after)

    @property
    def turned(self) -> bool:
        """Whether the verdict changes."""
        return self.is_on_both and self.before.verdict != self.after.verdict

    @property
    def same_unit(self) -> bool:
        """Whether both have one unit, as far as it is known."""
        return len({self.before.unit, self.after.unit} - {""}) < 2

    @property
    def same_test(self) -> bool:
        """Whether one test decides on both sides, as far as it is known."""
        return len({self.before.test, self.after.test} - {""}) < 2

    @property
    def error(self) -> float:
        """The standard error of the difference; 0 without any."""
        return math.hypot(*np.nan_to_num([self.before.error, self.after.error]))

    @property
    def sigmas(self) -> float:
        """How many standard errors the two numbers are apart; NaN without any, or if they are of two tests."""
        if not (self.same_test and self.error > 0.0):
            return math.nan
        return abs(self.after.value - self.before.value) / self.error

    @property
    def counts(self) -> bool:
        """Whether the verdict changes, or the number by more than the rule allows."""
        return self.turned or self.size > 1.0


def moved(before: Side, after: Side, rule: Rule) -> list[Moved]:
    """Return all entries of two sides beside each other.

    An entry that only one has moves infinitely, and so does one whose unit is another.
    """
    found = []
    for name in dict.fromkeys([*before, *after]):
        one = Moved(name, before.get(name), after.get(name), math.inf)
        if one.is_on_both and not one.same_test:
            one = one._replace(size=math.nan)
        elif one.is_on_both and one.same_unit:
            one = one._replace(size=rule(one.before, one.after))
        found.append(one)
    return found


def largest_first(one: Moved) -> tuple[bool, float]:
    """Return the key by which changed verdicts come first, then what has no size, then what moves most."""
    return not one.turned, -math.inf if math.isnan(one.size) else -one.size
