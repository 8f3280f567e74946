"""What inputs have to fulfil among each other: functions that raise ValueError, with the input's name and a remedy."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise


def require_increase(name: str, values: Sequence[float]) -> None:
    """Refuse bounds, or a list, that do not increase."""
    if not all(earlier < later for earlier, later in pairwise(values)):
        listed = ", ".join(f"{value:g}" for value in values)
        raise ValueError(f"{name} does not increase: {listed}; write the smaller one first")


def require_inside(name: str, value: float, bounds: Sequence[float], bounds_name: str = "its bounds") -> None:
    """Refuse a value outside of bounds."""
    lower, upper = bounds
    if not lower <= value <= upper:
        raise ValueError(f"{name}: {value:g} lies outside of {bounds_name}, {lower:g} to {upper:g}")


def require_multiples(name: str, values: Iterable[float], per_name: str, per: float) -> None:
    """Refuse values that are not whole multiples of another input, but for a billionth of that; 0 is one."""
    for value in values:
        ratio = value / per
        fits = math.isfinite(ratio) and abs(ratio - round(ratio)) <= 1e-9
        if not fits or (value and not round(ratio)):  # a value far below the unit is next to none of it
            remedy = f"give {_nearest_divisors(value, per)}" if isinstance(value, int) else "give a multiple"
            raise ValueError(f"{name} ({value:g}) is not a multiple of {per_name} ({per:g}); {remedy}")


def _nearest_divisors(steps: int, per: int) -> str:
    """The divisors of a number of steps on both sides of a number that is none."""
    divisors = [number for number in range(1, steps + 1) if steps % number == 0]
    below, above = [number for number in divisors if number < per], [number for number in divisors if number > per]
    return " or ".join(map(str, [*below[-1:], *above[:1]]))


def require_at_most(name: str, number: float, what: str, most: int) -> None:
    """Refuse an interval that makes too many of something, such as integration steps."""
    if number > most:
        raise ValueError(f"{name} makes {number:.3g} {what}, more than {most}: raise it")
