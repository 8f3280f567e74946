"""Guidance laws and triggers as users write them, made into the functions that a flight is compiled from."""

import inspect
from collections import namedtuple
from functools import lru_cache, partial, wraps
from pathlib import Path
from typing import NamedTuple, get_args, get_type_hints

import numpy as np

from marsedl.fly.declared import nearest, resolve
from marsedl.fly.vehicles import parts_of

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
            cells = np.genfromtxt(source, delimiter=",", names=True, dtype=float, comments="#", ndmin=1)
            source = {column: cells[column] for column in cells.dtype.names}
        columns = {str(key): np.asarray(source[key], float) for key in source}
        if against not in columns:
            raise ValueError(f"{name}: column {against!r} is missing; {nearest(against, columns)}")
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
            raise ValueError(f"{self.name}: the law is not told {self.against!r}; {nearest(self.against, told)}")
        cosines = [name for name in commands if f"{name}_cosine" in self.columns]
        columns = [f"{name}_cosine" if name in cosines else name for name in commands]
        gains = {f"{column}_per_{quantity}": quantity for column in columns for quantity in told}
        for column in self.columns:
            if column not in (*columns, *told, *gains):
                raise ValueError(
                    f"{self.name}: column {column!r} is unknown; {nearest(column, (*columns, *told, *gains))}"
                )
        needed = [*columns, *(quantity for gain, quantity in gains.items() if gain in self.columns)]
        if missing := [column for column in needed if column not in self.columns]:
            raise ValueError(f"{self.name}: column {missing[0]!r} is missing, a command or the reference of a gain")
        return tuple(columns)


class LawError(ValueError):
    """A law that does not return what it should."""


class Bound(NamedTuple):
    """A law ready for a flight: its functions (compiled form, and as it is written), and its parameters."""

    kind: tuple  # hashable: what `functions` is made from
    parameters: tuple


class Gains(NamedTuple):
    """Parameters of a gain table."""

    nodes: np.ndarray
    values: np.ndarray  # (columns, nodes)


def bind(law, flight) -> Bound:
    """Make of a law what a flight needs, and its parameters.

    Args:
        law: None; a number or a tuple of numbers, the constant command; a `GainTable`; a function; a
            `functools.partial` of one with its argument `law`; or the parameters of the flight's own guidance.
        flight: `Flight` that it shall steer.

    Raises:
        ValueError: for a law that is none of these, or asks for what it is not told.
    """
    if flight.guides:
        if law is not None and not hasattr(law, "_fields"):
            raise ValueError(
                "the model has guidance of its own: law takes its parameters, a NamedTuple, or is left out"
            )
        return Bound(("own",), () if law is None else law)
    if law is None and "command" not in inspect.signature(flight.functions["rates"]).parameters:
        return Bound(("none",), ())
    told, command = told_by(flight), _command_of(flight)
    if law is None:
        law = (0.0,) * len(command._fields)
    if isinstance(law, GainTable):
        commanded = law.commanded(told._fields, command._fields)
        values = np.array([law.columns[column] for column in law.columns])
        return Bound(("table", law.against, tuple(law.columns), commanded), Gains(law.nodes, values))
    if isinstance(law, int | float | tuple) and not isinstance(law, bool):
        numbers = law if isinstance(law, tuple) else (law,)
        if len(numbers) != len(command._fields) or not all(np.isfinite(number) for number in numbers):
            raise ValueError(
                f"law {law!r}: a constant command is {len(command._fields)} numbers: {', '.join(command._fields)}"
            )
        return Bound(("constant",), command(*map(float, numbers)))
    function, given = (law.func, law.keywords) if isinstance(law, partial) else (law, {})
    function = getattr(function, "py_func", function)
    if not inspect.isfunction(function) or set(given) - {"law"}:
        raise ValueError(
            f"law {law!r} is none: give a function, partial(function, law=parameters), a GainTable or a constant"
        )
    asked = inspect.signature(function).parameters
    parameters = given.get("law", asked["law"].default if "law" in asked else ())
    if parameters is inspect.Parameter.empty:
        raise ValueError(
            f"{_where(function)} asks for 'law', its parameters: give them as partial({function.__name__}, law=...) or "
            f"as the argument's default"
        )
    kinds = get_args(get_type_hints(function).get("return"))
    if len(kinds) == 2 and all(hasattr(kind, "_fields") for kind in kinds):
        return Bound(("guide", function), parameters)
    offered = ("time", "law", "vehicle", "sensed", *told._fields)
    for name in asked:
        if name not in offered:
            raise ValueError(f"{_where(function)} asks for {name!r}, of which it is not told; {nearest(name, offered)}")
    return Bound(("simple", function, tuple(asked)), parameters)


def try_once(law, flight, nominal):
    """Ask a law once, at the nominal start, so that a wrong one is told before anything is compiled.

    What it is told beside the start is one here, so other errors that depend on numbers are left to the flight. Raises
    LawError for a wrong result, AttributeError for what is not told.
    """
    if law.kind[0] not in ("simple", "guide"):
        return
    function, told = law.kind[1], told_by(flight)
    kinds = (_command_of(flight),) if law.kind[0] == "simple" else get_args(get_type_hints(function)["return"])
    sensed = told(*(nominal.get(name, 1.0) for name in told._fields))
    offered = sensed._asdict() if law.kind[0] == "simple" else {}
    offered |= {"time": 0.0, "sensed": sensed, "law": law.parameters}
    if law.kind[0] == "guide":
        offered |= {"memory": kinds[1]()} if len(kinds[1]._field_defaults) == len(kinds[1]._fields) else {}
    asked = inspect.signature(function).parameters
    if all(name in offered for name in asked):
        try:
            _checked(function, kinds)(*(offered[name] for name in asked))
        except LawError:
            raise
        except (ArithmeticError, TypeError, ValueError):
            pass


def told_by(flight):
    """NamedTuple of what laws are told: what `sense` returns, else the state."""
    return flight.parts["sensed"] if "sense" in flight.classes else flight.parts["state"]


def _command_of(flight):
    command = get_type_hints(flight.functions["rates"]).get("command")
    if not hasattr(command, "_fields"):
        raise ValueError(
            f"{_where(flight.functions['rates'])} takes no command: let it ask for 'command', annotated with the "
            f"NamedTuple that a law returns"
        )
    return command


def _where(function):
    code = function.__code__
    return f"{function.__name__} ({code.co_filename}, line {code.co_firstlineno})"


def _made(text, returns, **names):
    """The function that a text defines, annotated with what it returns; texts are made of checked names alone."""
    exec(text, names)
    (function,) = (value for key, value in names.items() if key.startswith("made_"))
    function.__annotations__["return"] = returns
    function.__module__ = __name__
    return function


class End(NamedTuple):
    """Where a trigger ends a flight: the sum of weights x state falls to a value. Data, so that kernels serve all."""

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
    text, sign = (
        f"{trigger.quantity} {type(trigger).__name__.lower()} {trigger.value:g}",
        isinstance(trigger, Below) * 2 - 1,
    )
    end = End(tuple(float(sign) if other == name else 0.0 for other in units), sign * factor * float(trigger.value))
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
def completed(flight, law, trigger, compiles):
    """The flight with its law and trigger; every step may be stored, and the end is told by name.

    Args:
        flight: `Flight`. law: `Bound.kind`. trigger: function, "falls" or None.
        compiles: whether the flight is to be compiled, or to fly in Python, where laws are checked.
    """
    from marsedl.montecarlo.elementary import arc_cosine
    from marsedl.montecarlo.flights import Flight, Nothing
    from marsedl.montecarlo.lanes import inline_njit

    told = told_by(flight)
    parts = parts_of(flight)
    parts.setdefault("sense", _made("def made_sense(state):\n    return state", told))
    kind, *details = law
    guide = parts.pop("guide")
    if kind in ("constant", "table", "simple"):
        command = _command_of(flight)
        returns = tuple[command, Nothing]
    if kind == "guide":
        guide = details[0]
    elif kind == "constant":
        values = ", ".join(f"law.{name}" for name in command._fields)
        guide = _made(f"def made_guide(law):\n    return Command({values}), ()", returns, Command=command)
    elif kind == "table":
        against, columns, commanded = details
        advice = namedtuple("Advice", columns)
        rows = (f"low * law.values[{row}, node] + part * law.values[{row}, node + 1]" for row in range(len(columns)))
        parts["consult"] = _made(
            f"def made_consult(time, sensed, law):\n"
            f"    place = {'time' if against == 'time' else f'sensed.{against}'}\n"
            f"    node = min(max(np.searchsorted(law.nodes, place) - 1, 0), len(law.nodes) - 2)\n"
            f"    part = (place - law.nodes[node]) / (law.nodes[node + 1] - law.nodes[node])\n"
            f"    part = min(max(part, 0.0), 1.0)\n"
            f"    low = 1.0 - part\n"
            f"    return Advice({', '.join(rows)})",
            advice,
            np=np,
            Advice=advice,
        )
        terms = []
        for column in commanded:
            fed_back = [name for name in told._fields if f"{column}_per_{name}" in columns]
            gains = (f"advice.{column}_per_{name} * (sensed.{name} - advice.{name})" for name in fed_back)
            term = " + ".join([f"advice.{column}", *gains])
            terms.append(term if column in command._fields else f"arc_cosine(min(max({term}, -1.0), 1.0))")
        text = f"def made_guide(sensed, advice):\n    return Command({', '.join(terms)}), ()"
        guide = _made(text, returns, Command=command, arc_cosine=arc_cosine)
    elif kind == "simple":
        function, asked = details
        arguments = ", ".join(f"sensed.{name}" if name in told._fields else name for name in asked)
        needed = ", ".join(dict.fromkeys("sensed" if name in told._fields else name for name in asked))
        star = "" if len(command._fields) == 1 else "*"
        text = f"def made_guide({needed}):\n    return Command({star}law_of_user({arguments})), ()"
        called = inline_njit(function) if compiles else _checked(function, (command,))
        guide = _made(text, returns, Command=command, law_of_user=called)
    if not compiles and kind == "guide":
        guide = _checked(guide, get_args(get_type_hints(guide)["return"]))
    if trigger is not None:
        terms = (f"p.end.weights[{row}] * state.{name}" for row, name in enumerate(flight.parts["state"]._fields))
        text = f"def made_ended(state, p):\n    return {' + '.join(terms)} - p.end.value"
        parts["ended"] = trigger if callable(trigger) else _made(text, float)
    commands = (
        get_args(get_type_hints(guide).get("return"))[0]._fields if guide and not isinstance(guide, tuple) else ()
    )
    if "store" not in parts:
        parts["store"] = _gathered(
            "store",
            {**dict.fromkeys(told._fields, "sensed"), **{n: "command" for n in commands if n not in told._fields}},
        )
    if "finish" not in parts:
        watched = flight.parts["watched"]._fields
        fields = {**dict.fromkeys(told._fields, "sensed"), **dict.fromkeys(watched, "watched")}
        parts["finish"] = _gathered("finish", fields, "time")
    return Flight(**parts, guide=guide)


def _gathered(role, fields, *first):
    """The function that stores these fields of these parts, or (first) the time as `end_time`."""
    kind = namedtuple(role.title(), (*("end_time" for _ in first), *fields))
    arguments = ", ".join((*first, *dict.fromkeys(fields.values())))
    values = ", ".join((*first, *(f"{part}.{name}" for name, part in fields.items())))
    return _made(f"def made_{role}({arguments}):\n    return Kind({values})", kind, Kind=kind)


def _checked(function, kinds):
    """A law as it is written, held to return the numbers of its command, or the parts that it is annotated with."""

    @wraps(function)
    def checked(*arguments):
        result = function(*arguments)
        alone = len(kinds) == 1
        parts = ((result if isinstance(result, tuple) else (result,)),) if alone else result
        if (
            not isinstance(parts, tuple)
            or [len(part) if isinstance(part, tuple) else None for part in parts] != [len(k._fields) for k in kinds]
            or not all(isinstance(number, int | float | np.number) for part in parts for number in part)
        ):
            wanted = ", ".join(kinds[0]._fields) if alone else " and ".join(kind.__name__ for kind in kinds)
            raise LawError(f"{_where(function)} returned {result!r}; it must return {wanted}")
        return result

    return checked
