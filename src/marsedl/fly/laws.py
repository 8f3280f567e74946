"""Guidance laws and triggers as users write them, made into the functions that a flight is compiled from."""

import inspect
import warnings
from collections import namedtuple
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple, get_args, get_type_hints

import numpy as np

from marsedl.compiling import jitable
from marsedl.fly.declared import resolve
from marsedl.fly.vehicles import parts_of
from marsedl.words import described, remedy

__all__ = ["Above", "Below", "GainTable"]


class Below(NamedTuple):
    """Trigger: ends a flight where a quantity of its state falls to a value."""

    quantity: str
    value: float


class Above(NamedTuple):
    """Trigger: ends a flight where a quantity of its state rises to a value."""

    quantity: str
    value: float


class GainTable:
    r"""A law as a table, say a CSV file, over time or a quantity that guidance is told.

    The columns are named: `velocity` (or whatever it is against), each command, such as `bank`, and for every quantity
    that is fed back its reference, such as `range`, and its gain, such as `bank_per_range`:

        $\sigma = \sigma(V) + k(V) \left( R - R(V) \right)$

    with the columns sigma (`bank`), k (`bank_per_range`) and R (`range`), and the range R now.

    All are in SI units, linear between rows and constant beyond them. Columns `bank_cosine` and `bank_cosine_per_range`
    give the cosine instead, cut to -1 and 1.

    Args:
        source: path of a CSV file, or a mapping from names to columns (a data frame is one).
        against: name of the column that the others depend on, which strictly rises or falls.
    """

    def __init__(self, source, against="velocity"):
        """Read the table and check it. Raises ValueError for a column that is missing, not finite or not monotone."""
        name = str(source) if isinstance(source, str | Path) else "the gain table"
        if isinstance(source, str | Path):
            if not Path(source).is_file():
                raise ValueError(f"{name}: there is no such gain table; check the path")
            try:
                cells = np.genfromtxt(source, delimiter=",", names=True, dtype=float, comments="#", ndmin=1)
            except ValueError:
                raise ValueError(f"{name}: write numbers under a line of names, separated by commas") from None
            source = {column: cells[column] for column in cells.dtype.names}
        columns = {str(key): np.asarray(source[key], float) for key in source}
        if against not in columns:
            raise ValueError(f"{name}: column {against!r} is missing; {remedy(against, columns)}")
        for column, values in columns.items():
            if values.shape != columns[against].shape or values.size < 2 or not np.isfinite(values).all():
                raise ValueError(
                    f"{name}: column {column!r} must hold finite numbers, as many as {against!r}, at least 2"
                )
        steps = np.diff(columns[against])
        if not ((steps > 0.0).all() or (steps < 0.0).all()):
            raise ValueError(f"{name}: column {against!r} must strictly rise or fall; sort the rows by it")
        order = np.argsort(columns[against])
        self.name, self.against, self.nodes = name, against, columns.pop(against)[order]
        self.columns = {column: values[order] for column, values in columns.items()}

    def commanded(self, told, commands):
        """Columns that hold the commands, or their cosines. Raises ValueError for columns that fit neither."""
        if self.against != "time" and self.against not in told:
            raise ValueError(f"{self.name}: the law is not told {self.against!r}; {remedy(self.against, told)}")
        cosines = [name for name in commands if f"{name}_cosine" in self.columns]
        columns = [f"{name}_cosine" if name in cosines else name for name in commands]
        gains = {f"{column}_per_{quantity}": quantity for column in columns for quantity in told}
        for column in self.columns:
            if column not in (*columns, *told, *gains):
                raise ValueError(
                    f"{self.name}: column {column!r} is unknown; {remedy(column, (*columns, *told, *gains))}"
                )
        needed = [*columns, *(quantity for gain, quantity in gains.items() if gain in self.columns)]
        if missing := [column for column in needed if column not in self.columns]:
            raise ValueError(f"{self.name}: column {missing[0]!r} is missing, a command or the reference of a gain")
        return tuple(columns)


class Bound(NamedTuple):
    """A law ready for a flight: what its functions are made from, hashable, and its parameters."""

    kind: tuple
    parameters: tuple


class Gains(NamedTuple):
    """Parameters of a gain table."""

    nodes: np.ndarray
    values: np.ndarray  # (columns, nodes)


def bind(law, flight, nominal, units) -> Bound:
    """Make of a law what a flight needs.

    Args:
        law: None; a number or a tuple of numbers, the constant command; a `GainTable`; a function; a
            `functools.partial` of one with its argument `law`; or the parameters of the flight's own guidance.
        flight: `Flight` that it shall steer. nominal: start by name. units: function from names to units by name.

    Raises:
        ValueError: for a law that is none of these, asks for what it is not told, or returns no command.
    """
    if flight.guides:
        if law is not None and not hasattr(law, "_fields"):
            raise ValueError("the model has guidance of its own: law takes its parameters, a NamedTuple, or nothing")
        return Bound(("own",), () if law is None else law)
    if law is None and "command" not in inspect.signature(flight.functions["rates"]).parameters:
        return Bound(("none",), ())
    told, command = told_by(flight), _command_of(flight)
    if isinstance(law, GainTable):
        commanded, values = law.commanded(told._fields, command._fields), np.array([*law.columns.values()])
        first, last, begins = law.nodes[0], law.nodes[-1], nominal.get(law.against, law.nodes[0])
        if not first <= begins <= last:
            held = "whose nearest row is held until then"
            warnings.warn(f"flights start at {law.against} {begins:g}, beyond {law.name}, {held}", stacklevel=4)
        return Bound(("table", law.against, tuple(law.columns), commanded), Gains(law.nodes, values))
    if law is None or isinstance(law, int | float | tuple):
        numbers = (0.0,) * len(command._fields) if law is None else law if isinstance(law, tuple) else (law,)
        if len(numbers) != len(command._fields) or not np.isfinite(numbers).all():
            names = ", ".join(command._fields)
            raise ValueError(f"law {law!r}: a constant command is {len(command._fields)} numbers: {names}")
        for (name, unit), number in zip(units(command._fields).items(), numbers, strict=True):
            if unit == "rad" and abs(number) > 2.0 * np.pi:
                raise ValueError(f"law {law!r}: {name} is {number:g} rad, more than a turn; give it in radians")
        return Bound(("constant",), command(*map(float, numbers)))
    function, given = (law.func, law.keywords) if isinstance(law, partial) else (law, {})
    function = getattr(function, "py_func", function)
    if not inspect.isfunction(function) or {*given} - {"law"}:
        raise ValueError(
            f"law {law!r} is none: give a function, partial(function, law=parameters), a GainTable or a constant"
        )
    asked = inspect.signature(function).parameters
    parameters = given.get("law", asked["law"].default if "law" in asked else ())
    if parameters is inspect.Parameter.empty:
        raise ValueError(
            f"{described(function)} asks for 'law', its parameters: give them as partial({function.__name__}, law=...) "
            f"or as the argument's default"
        )
    kinds = get_args(get_type_hints(function).get("return"))
    remembers = len(kinds) == 2 and all(hasattr(kind, "_fields") for kind in kinds)
    offered = ("time", "law", "vehicle", "sensed", *told._fields)
    for name in () if remembers else asked:
        if name not in offered:
            raise ValueError(
                f"{described(function)} asks for {name!r}, of which it is not told; {remedy(name, offered)}"
            )
    result = _try_once(function, asked, kinds if remembers else (command,), told, nominal, parameters)
    several = len(command._fields) > 1 or isinstance(result, tuple)
    return Bound(("guide", function) if remembers else ("simple", function, tuple(asked), several), parameters)


def _try_once(function, asked, kinds, told, nominal, parameters):
    """Ask a law once, so that a wrong one is told before anything is compiled. Returns its answer, None without one.

    It is told the nominal start, and one for all else: what goes wrong with such numbers is left to the flight.
    """
    sensed = told(*(nominal.get(name, 1.0) for name in told._fields))
    offered = sensed._asdict() | {"sensed": sensed, "time": 0.0, "law": parameters}
    if len(kinds[-1]._field_defaults) == len(kinds[-1]._fields):
        offered["memory"] = kinds[-1]()
    if not all(name in offered for name in asked):
        return None
    try:
        result = function(*(offered[name] for name in asked))
    except (ArithmeticError, TypeError, ValueError):
        return None
    except AttributeError as error:
        if error.obj is not sensed:
            raise
        unknown = f"asks for sensed.{error.name}, of which it is not told"
        raise ValueError(f"{described(function)} {unknown}; {remedy(error.name, told._fields)}") from None
    parts = ((*result,) if isinstance(result, tuple) else (result,),) if len(kinds) == 1 else result
    sizes = [len(part) if isinstance(part, tuple) else None for part in parts] if isinstance(parts, tuple) else []
    if sizes != [len(kind._fields) for kind in kinds] or not all(
        isinstance(number, int | float | np.number) for part in parts for number in part
    ):
        wanted = ", ".join(kinds[0]._fields) if len(kinds) == 1 else " and ".join(kind.__name__ for kind in kinds)
        raise ValueError(f"{described(function)} returned {result!r}; it must return {wanted}")
    return result


def told_by(flight):
    """NamedTuple of what laws are told: what `sense` returns, else the state."""
    return flight.parts["sensed" if "sense" in flight.classes else "state"]


def _command_of(flight):
    rates = flight.functions["rates"]
    command = get_type_hints(rates).get("command")
    if not hasattr(command, "_fields"):
        raise ValueError(
            f"{described(rates)} takes no command: let it ask for 'command', annotated with the NamedTuple of a law"
        )
    return command


def _made(text, returns, like=None, **names):
    """The function that a text of checked names defines, annotated; messages name the function that it is like."""
    exec(f"def made{text}", names)
    made = names["made"]
    made.__annotations__["return"], made.__module__ = returns, __name__
    if like:
        code = like.__code__
        place = {"co_filename": code.co_filename, "co_firstlineno": code.co_firstlineno}
        made.__name__, made.__code__ = like.__name__, made.__code__.replace(co_name=code.co_name, **place)
    return made


class End(NamedTuple):
    """Where a trigger ends a flight: the sum of weights x state falls to a value; one kernel serves all."""

    weights: tuple[float, ...]
    value: float


def trigger_of(trigger, flight, nominal, units):
    """Function `ended` of a trigger ("falls" for one that is data), its `End` or None, and what an end is called.

    Args:
        trigger: None, a function, `Below` or `Above`. flight: `Flight`. nominal: start by name. units: of the state.

    Raises:
        ValueError: for a quantity that is not of the state, or is beyond the trigger at the start.
    """
    if trigger is None or callable(trigger):
        if trigger is not None and "ended" in flight.classes:
            raise ValueError("the model ends its flights itself: leave trigger out, or bind the flight without `ended`")
        named = trigger or flight.functions["ended"]
        return trigger, None, f"ended: {named.__name__}" if named else "completed"
    if not isinstance(trigger, Below | Above):
        raise ValueError(f"trigger {trigger!r} is none: give Below(name, value), Above(name, value) or a function")
    name, factor = resolve(trigger.quantity, units, "trigger")
    sign, word = (1.0, "below") if isinstance(trigger, Below) else (-1.0, "above")
    end = End(tuple(sign if other == name else 0.0 for other in units), sign * factor * float(trigger.value))
    text = f"{trigger.quantity} {word} {trigger.value:g}"
    if sign * nominal[name] <= end.value:
        raise ValueError(f"trigger {text} is met at the start, where {name} is {nominal[name]:g}")
    return "falls", end, f"ended: {text}"


@lru_cache(64)
def extended(kind):
    """A NamedTuple class with the fields of another one, and the `End` of a trigger."""
    made = namedtuple(kind.__name__, (*getattr(kind, "_fields", ()), "end"))
    made.__annotations__ = getattr(kind, "__annotations__", {})
    return made


@lru_cache(64)
def completed(flight, law, trigger):
    """The flight with its law and trigger, which stores what laws are told and command, and the time of its end.

    Args:
        flight: `Flight`. law: `Bound.kind`. trigger: function, "falls" or None.
    """
    from marsedl.montecarlo.flights import Flight, Nothing

    told, parts, (kind, *details) = told_by(flight), parts_of(flight), law
    parts.setdefault("sense", _made("(state):\n    return state", told))
    if kind == "guide":
        parts["guide"] = details[0]
    elif kind not in ("own", "none"):
        command = _command_of(flight)
        returns = tuple[command, Nothing]
        if kind == "constant":
            parts["guide"] = _made("(law):\n    return law, ()", returns)
        elif kind == "table":
            parts |= _of_table(*details, told, command, returns)
        else:
            function, asked, several = details
            arguments = ", ".join(f"sensed.{name}" if name in told._fields else name for name in asked)
            needed = ", ".join(dict.fromkeys("sensed" if name in told._fields else name for name in asked))
            star = "*" if several else ""
            text = f"({needed}):\n    return Command({star}law_of_user({arguments})), ()"
            parts["guide"] = _made(text, returns, function, Command=command, law_of_user=jitable(function))
    if trigger is not None:
        terms = (f"p.end.weights[{row}] * state.{name}" for row, name in enumerate(flight.parts["state"]._fields))
        falls = f"(state, p):\n    return {' + '.join(terms)} - p.end.value"
        parts["ended"] = trigger if callable(trigger) else _made(falls, float)
    guide, sensed = parts["guide"], dict.fromkeys(told._fields, "sensed")
    guide = guide[0] if isinstance(guide, tuple) else guide
    commands = get_args(get_type_hints(guide)["return"])[0]._fields if guide else ()
    parts.setdefault("store", _gathered(sensed | {name: "command" for name in commands if name not in sensed}))
    watched = dict.fromkeys(flight.parts["watched"]._fields, "watched")
    parts.setdefault("finish", _gathered(sensed | watched, "time"))
    return Flight(**parts)


def _of_table(against, columns, commanded, told, command, returns):
    """Functions of a gain table: `consult`, which reads it, and `guide`."""
    from marsedl.montecarlo.elementary import arc_cosine

    advice = namedtuple("Advice", columns)
    rows = (f"low * law.values[{row}, node] + part * law.values[{row}, node + 1]" for row in range(len(columns)))
    consult = (
        f"(time, sensed, law):\n"
        f"    place = {'time' if against == 'time' else f'sensed.{against}'}\n"
        f"    node = min(max(np.searchsorted(law.nodes, place) - 1, 0), len(law.nodes) - 2)\n"
        f"    part = (place - law.nodes[node]) / (law.nodes[node + 1] - law.nodes[node])\n"
        f"    part = min(max(part, 0.0), 1.0)\n"
        f"    low = 1.0 - part\n"
        f"    return Advice({', '.join(rows)})"
    )
    terms = []
    for column in commanded:
        fed_back = [name for name in told._fields if f"{column}_per_{name}" in columns]
        gains = (f"advice.{column}_per_{name} * (sensed.{name} - advice.{name})" for name in fed_back)
        term = " + ".join([f"advice.{column}", *gains])
        terms.append(term if column in command._fields else f"arc_cosine(min(max({term}, -1.0), 1.0))")
    guide = f"(sensed, advice):\n    return Command({', '.join(terms)}), ()"
    return {
        "consult": _made(consult, advice, np=np, Advice=advice),
        "guide": _made(guide, returns, Command=command, arc_cosine=arc_cosine),
    }


def _gathered(fields, *first):
    """The function that returns these fields of these parts, after (first) the time as `end_time`."""
    kind = namedtuple("Gathered", (*("end_time" for _ in first), *fields))
    arguments = ", ".join((*first, *dict.fromkeys(fields.values())))
    values = ", ".join((*first, *(f"{part}.{name}" for name, part in fields.items())))
    return _made(f"({arguments}):\n    return Kind({values})", kind, Kind=kind)
