"""Functions of a flight that are written as text, such as those of names that only a declaration knows."""

from collections import namedtuple
from inspect import signature

from marsedl.montecarlo.flights.binding import hints

__all__ = ["generated", "with_fields"]


def generated(asked, lines, returns, like=None, **names):
    """The function of these lines, annotated with what it returns.

    Args:
        asked: names of its arguments, all checked; any may come several times. lines: of its body. returns: annotation.
        like: function that messages name in its place. names: what its lines read.
    """
    body = "".join(f"    {line}\n" for line in lines)
    exec(f"def made({', '.join(dict.fromkeys(asked))}):\n{body}", names)
    made = names["made"]
    made.__annotations__["return"], made.__module__ = returns, __name__
    if like:
        code = like.__code__
        place = {"co_filename": code.co_filename, "co_firstlineno": code.co_firstlineno}
        made.__name__, made.__code__ = like.__name__, made.__code__.replace(co_name=code.co_name, **place)
    return made


def with_fields(function, fields, asks, *lines, **names):
    """The function with what it returns, a NamedTuple, and further fields unless it has them.

    Args:
        function: of a flight. fields: expressions by name. asks, lines, names: what these ask for, what is computed
            before, and what that reads.
    """
    known, asked = hints(function)["return"]._fields, [*signature(function).parameters]
    fields = {name: value for name, value in fields.items() if name not in known}
    kind = namedtuple("WithFields", (*known, *fields))
    values = ", ".join([*(f"whole.{name}" for name in known), *fields.values()])
    body = [f"whole = function({', '.join(asked)})", *lines, f"return Kind({values})"]
    return generated([*asked, *asks], body, kind, function, function=function, Kind=kind, **names)
