"""What the doors share: functions that ask by name, limits as they are declared, the law as a table."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from operator import attrgetter

import numpy as np

from marsedl.fly import Above, Below, GainTable
from marsedl.fly.declared import is_number
from marsedl.words import described, remedy, require

__all__ = ["Limit", "answer", "asked", "declared", "gain_table"]


@dataclass(frozen=True)
class Limit:
    """What must stay below a value, or above it."""

    text: str
    quantity: Callable  # of what it asks for
    asks: tuple[str, ...]
    value: float
    sign: float  # 1: below, -1: above

    def of(self, offered: Mapping):
        """The quantity, of parts of the model by name."""
        return self.quantity(*(offered[name] for name in self.asks))


def declared(number, given, members: Mapping[str, str], offered) -> Limit:
    """A limit of a design, checked.

    Args:
        number: of the limit, from 0. given: `Below` or `Above`. offered: what functions may ask for.
        members: of the numbers that have a name: the part, such as "state", by the name; "command.x" is its x.

    Raises:
        ValueError: for what is none, a value that is not finite, and a name or an argument that is not known.
    """
    what = f"limits[{number}]"
    require(isinstance(given, Below | Above), f"{what} is {given!r}; give Below(...) or Above(...) of marsedl.fly")
    quantity, value, _ = given
    require(is_number(value), f"{what}: its value is {value!r}, not a finite number")
    if callable(quantity):
        asks, function = asked(quantity), quantity
        require(
            asks and {*asks} <= {*offered},
            f"{what}: {described(quantity)} asks for {', '.join(asks) or 'nothing'}; it may ask for "
            f"{', '.join(offered)}",
        )
        shown = f"{quantity.__name__} of the {' and the '.join(asks)}".replace("<lambda>", "a function")
    else:
        require(quantity in members, f"{what}: {quantity!r} is unknown; {remedy(quantity, members)}")
        asks, function, shown = (members[quantity],), attrgetter(quantity.removeprefix("command.")), quantity
    word, sign = ("below", 1.0) if isinstance(given, Below) else ("above", -1.0)
    return Limit(f"{what}, {shown} {word} {value:g}", function, asks, float(value), sign)


def gain_table(names: Mapping, time, states, commands, gains) -> GainTable:
    """The law u = u*(t) + K(t) (x - x*(t)) for `marsedl.fly`.

    Args:
        names: of states and commands, by part. time: s, (k,). states, commands: references, (k, n), (k, m).
        gains: K, (k, m, n).
    """
    columns = {"time": time} | dict(
        zip((*names["state"], *names["command"]), np.hstack([states, commands]).T, strict=True)
    )
    pairs = product(enumerate(names["command"]), enumerate(names["state"]))
    columns |= {f"{command}_per_{state}": gains[:, row, place] for (row, command), (place, state) in pairs}
    return GainTable(columns, against="time")


def asked(function) -> tuple[str, ...]:
    """Names of what a function asks for."""
    return tuple(inspect.signature(function).parameters)


def answer(function, offered):
    """What a function makes of what it asks for."""
    return function(*(offered[name] for name in asked(function)))
