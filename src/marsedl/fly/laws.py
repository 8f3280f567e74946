"""Guidance laws and triggers as users write them, made into the functions that a flight is compiled from."""

import inspect
import warnings
from collections import namedtuple
from collections.abc import Mapping
from copy import copy
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from marsedl.elementary import arc_cosine
from marsedl.fly.actuators import actuated
from marsedl.fly.declared import SUFFIXES, Above, Below, is_number, numbers_of, resolve
from marsedl.fly.generated import generated, with_fields
from marsedl.fly.senses import navigation
from marsedl.fly.vehicles import parts_of
from marsedl.models.density_table import number_of, read_table
from marsedl.montecarlo.flights import Flight, Nothing
from marsedl.montecarlo.flights.binding import LOCAL, chains, hints, returned
from marsedl.words import described, remedy, require

__all__ = ["GainTable"]


class GainTable:
    r"""A law as a table, say a CSV file, over time or a quantity that guidance is told.

    The columns are named: `velocity` (or whatever it is against), each command, such as `bank`, and for every quantity
    that is fed back its reference, such as `range`, and its gain, such as `bank_per_range`:

        $\sigma = \sigma(V) + k(V) \left( R - R(V) \right)$

    with the columns sigma (`bank`), k (`bank_per_range`) and R (`range`), and the range R now.

    All are in SI units and radians, or have a suffix: `range_km`, `bank_deg`; gains are in SI units. They are linear
    between rows and constant beyond them. Columns `bank_cosine` and `bank_cosine_per_range`
    give the cosine instead, cut to -1 and 1.

    Args:
        source: path of a CSV file, or a mapping from names to columns (a data frame is one).
        against: name of the column that the others depend on, which strictly rises or falls.
    """

    def __init__(self, source, against="velocity"):
        """Read the table and check it. Raises ValueError for a column that is missing, not finite or not monotone."""
        name = str(source) if isinstance(source, str | Path) else "the gain table"
        if isinstance(source, str | Path):
            header, lines, rows = read_table(name, "gain table")
            source = {
                column: [
                    number_of(cells[place], column, f"{name}, line {n}") for n, cells in zip(lines, rows, strict=True)
                ]
                for place, column in enumerate(header)
            }
        columns = {str(key): numbers_of(source[key], f"{name}: column {str(key)!r} is") for key in source}
        require(against in columns, f"{name}: column {against!r} is missing; {remedy(against, columns)}")
        for column, values in columns.items():
            require(
                values.shape == columns[against].shape and values.size >= 2 and np.isfinite(values).all(),
                f"{name}: column {column!r} must hold finite numbers, as many as {against!r}, at least 2",
            )
        steps = np.diff(columns[against])
        require(
            (steps > 0.0).all() or (steps < 0.0).all(),
            f"{name}: column {against!r} must strictly rise or fall; sort the rows by it",
        )
        order = np.argsort(columns[against])
        self.name, self.against, self.nodes = name, against, columns.pop(against)[order]
        self.columns = {column: values[order] for column, values in columns.items()}

    def in_si(self, units):
        """The same table in SI units, without suffixes. Raises ValueError for an angle of more than a turn.

        Args:
            units: those of what the law is told and commands, by name.
        """
        table, columns = copy(self), {}
        for column, values in ({self.against: self.nodes} | self.columns).items():
            suffixed = column.endswith((*SUFFIXES,)) and "_per_" not in column
            base, factor = resolve(column, units, f"{self.name}: column") if suffixed else (column, 1.0)
            require(base not in columns, f"{self.name}: column {base!r} is given twice; give it once")
            columns[base] = factor * values
            largest = np.abs(columns[base]).max()
            require(
                units.get(base) != "rad" or largest <= 2.0 * np.pi,
                f"{self.name}: column {column!r} holds {largest:g} rad, more than a turn; for degrees name it "
                f"'{base}_deg'",
            )
        (table.against, table.nodes), *others = columns.items()
        table.columns = dict(others)
        return table

    def commanded(self, told, commands):
        """Columns that hold the commands, or their cosines. Raises ValueError for columns that fit neither."""
        require(
            self.against in ("time", *told),
            f"{self.name}: the law is not told {self.against!r}; {remedy(self.against, told)}",
        )
        cosines = [name for name in commands if f"{name}_cosine" in self.columns]
        columns = [f"{name}_cosine" if name in cosines else name for name in commands]
        gains = {f"{column}_per_{quantity}": quantity for column in columns for quantity in told}
        for column in self.columns:
            known = (*columns, *told, *gains)
            require(column in known, f"{self.name}: column {column!r} is unknown; {remedy(column, known)}")
        for column in (*columns, *(quantity for gain, quantity in gains.items() if gain in self.columns)):
            require(
                column in self.columns,
                f"{self.name}: column {column!r} is missing, a command or the reference of a gain",
            )
        return tuple(columns)


TRUTH = ("state", "vehicle", "found")  # of a trial, which laws may ask for by leave
NAMES_OF_TOLD = ("sensed", "nav")  # by which a law asks for all that it is told
_TELLS = {"navigate": "nav", "sense": "sensed", "rates": "state"}


class Bound(NamedTuple):
    """A law ready for a flight: what its functions are made from, hashable, and its parameters."""

    kind: tuple
    parameters: tuple


class Gains(NamedTuple):
    """Parameters of a gain table."""

    nodes: np.ndarray
    values: np.ndarray  # (columns, nodes)


def bind(law, flight, nominal, units, truth=False) -> Bound:
    """Make of a law what a flight needs.

    Args:
        law: None; a number or a tuple of numbers, the constant command; a `GainTable`; a function; a
            `functools.partial` of one with its argument `law`; or the parameters of the flight's own guidance.
        flight: `Flight` that it shall steer. nominal: start by name. units: function from names to units by name.
        truth: whether a law may ask for the trial's true state and vehicle.

    Raises:
        ValueError: for a law that is none of these, asks for what it is not told, or returns no command.
    """
    if flight.guides:
        require(
            law is None or hasattr(law, "_fields"),
            "the model has guidance of its own: law takes its parameters, a NamedTuple, or nothing",
        )
        return Bound(("own",), () if law is None else law)
    if law is None and "command" not in inspect.signature(flight.functions["rates"]).parameters:
        return Bound(("none",), ())
    told, command = told_by(flight), command_of(flight)
    if isinstance(law, GainTable):
        law = law.in_si(units([*told._fields, *command._fields]) | {"time": "s"})
        commanded, values = law.commanded(told._fields, command._fields), np.array([*law.columns.values()])
        first, last, begins = law.nodes[0], law.nodes[-1], nominal.get(law.against, law.nodes[0])
        if not first <= begins <= last:
            held = "whose nearest row is held until then"
            warnings.warn(f"flights start at {law.against} {begins:g}, beyond {law.name}, {held}", stacklevel=4)
        return Bound(("table", law.against, tuple(law.columns), commanded), Gains(law.nodes, values))
    if law is None or isinstance(law, int | float | np.number | tuple):
        constant = law if isinstance(law, tuple) else (law,)
        numbers = (0.0,) * len(command._fields) if law is None else constant
        require(
            len(numbers) == len(command._fields) and all(map(is_number, numbers)),
            f"law {law!r}: a constant command is {len(command._fields)} numbers: {', '.join(command._fields)}; they "
            f"are finite",
        )
        check_angles(f"law {law!r}", command._fields, numbers, units)
        return Bound(("constant",), command(*map(float, numbers)))
    function, given = (law.func, law.keywords) if isinstance(law, partial) else (law, {})
    function = getattr(function, "py_func", function)
    require(
        inspect.isfunction(function) and {*given} <= {"law"} and not getattr(law, "args", ()),
        f"law {law!r} is none: give a function, partial(function, law=parameters), a GainTable or a constant",
    )
    asked = inspect.signature(function).parameters
    parameters = given.get("law", asked["law"].default if "law" in asked else ())
    require(
        parameters is not inspect.Parameter.empty,
        f"{described(function)} asks for 'law', its parameters: give them as partial({function.__name__}, law=...) "
        f"or as the argument's default",
    )
    kinds = get_args(hints(function).get("return"))
    remembers = len(kinds) == 2 and all(hasattr(kind, "_fields") for kind in kinds)
    offered = ("time", "law", "nav", "sensed", *told._fields, *TRUTH[:2])
    offered += ("memory", "past", "cycle", "half_index", "found", "p") if remembers else ()
    for name in asked:
        require(
            truth or name not in TRUTH,
            f"{described(function)} asks for {name!r}, the truth of its trial, which no guidance knows: ask for what "
            f"it is told, {', '.join(told._fields)}, or give fly truth=True, and the result says so",
        )
        require(
            remembers or name != "memory",
            f"{described(function)} asks for 'memory': annotate it, `-> tuple[Command, Memory]`",
        )
        require(
            name in offered,
            f"{described(function)} asks for {name!r}, of which it is not told; {remedy(name, offered)}",
        )
    told_whole = {*NAMES_OF_TOLD} & {*asked}
    for of, read in [read[:2] for read in chains(function.__code__, LOCAL) if read[0] in told_whole and read[1:]]:
        require(
            hasattr(told, read),
            f"{described(function)} asks for {of}.{read}, of which it is not told; {remedy(read, told._fields)}",
        )
    return Bound(("guide" if remembers else "simple", function, tuple(asked)), parameters)


def check_angles(said, names, numbers, units):
    """Raise ValueError for an angle of more than a turn among commands: it is given in degrees."""
    for (name, unit), number in zip(units(names).items(), numbers, strict=True):
        require(
            unit != "rad" or not abs(number) > 2.0 * np.pi,
            f"{said}: {name} is {number:g} rad, more than a turn; give it in radians",
        )


def told_by(flight):
    """NamedTuple of what laws are told: what `navigate` returns, else what `sense` does, else the state."""
    return flight.parts[next(part for role, part in _TELLS.items() if role in flight.classes)]


def command_of(flight):
    """NamedTuple of what laws command."""
    rates = flight.functions["rates"]
    command = hints(rates).get("command")
    require(
        hasattr(command, "_fields"),
        f"{described(rates)} takes no command: let it ask for 'command', annotated with the NamedTuple of a law",
    )
    return command


class End(NamedTuple):
    """Where a trigger ends a flight: a quantity, with a sign, falls to a value.

    It is chosen by its place among those of the state and the time, or among those that are sensed, so that one kernel
    serves all that is known of a flight either way.
    """

    sign: float
    place: float
    value: float


class Ends(NamedTuple):
    """What ends the flights of a campaign."""

    kind: tuple  # what `ended` is made from: of each end a function, or the names that its `End` chooses from
    data: tuple[End, ...]  # of the ends that are data, in their order
    names: tuple[str, ...]  # outcomes, in their order
    aims: bool  # whether flights that do not reach the first end count in no statistics


def ends_of(trigger, model, nominal) -> Ends:
    """Ends of a flight: the trigger, or several by name, and those that its model has.

    Args:
        trigger: None, a function, `Below` or `Above`, or a mapping from outcomes to these. model: `Model`. nominal:
            start by name.

    Raises:
        ValueError: for a quantity that is not known of a flight, or is beyond the trigger at the start.
    """
    flight, state = model.flight, model.flight.parts["state"]._fields
    own, sensed = flight.functions["ended"], [name for name in flight.parts["sensed"]._fields if name not in state]
    require(
        trigger is None or own is None,
        "the model ends its flights itself: leave trigger out, or bind the flight without `ended`",
    )
    if own is not None:
        several = getattr(flight.classes["ended"], "_fields", None)
        return Ends(("own",), (), several or (f"ended: {own.__name__}",), aims=True)
    given = trigger if isinstance(trigger, Mapping) else {} if trigger is None else {None: trigger}
    whole, kinds, data, names = {**given, **model.ends, **given}, [], [], []  # the given ones first
    single = [one for one in whole.values() if callable(one) and returned(one, "ended") == (bool,)]
    if single:  # it ends flights after a step, alone
        require(
            not isinstance(trigger, Mapping), f"{described(single[0])} returns a bool; let named triggers be floats"
        )
        whole = {None: single[0]}
    units = model.units([*state, *sensed, "time"]) | {"time": "s"}
    for outcome, one in whole.items():
        require(
            isinstance(one, Below | Above) or callable(one),
            f"trigger {one!r} is none: give Below(name, value), Above(name, value) or a function",
        )
        kind, said = one, getattr(one, "__name__", "")
        if not callable(one):
            advice = "" if outcome in given or outcome is None else "; the model has this end, such as its ground"
            kind, end, said = _crossing(one, (state, sensed), units, nominal, advice)
            data.append(end)
        kinds.append(kind)
        names.append(outcome or f"ended: {said}")
    return Ends(tuple(kinds), tuple(data), tuple(names) or ("completed",), bool(given) or bool(single))


def _crossing(trigger, known, units, nominal, advice):
    """Of `Below` or `Above`: the names that its `End` chooses from, that, and what it says. Checked; see `ends_of`.

    known: names of the state, and of what else is sensed. units: of all of them. advice: what else a user may do if it
    is met at the start.
    """
    state, sensed = known
    require(
        isinstance(trigger.quantity, str) and trigger.probability is None,
        f"trigger {trigger} is a limit of a design: give the name of a quantity and a value, or the function alone",
    )
    name, factor = resolve(trigger.quantity, units, "trigger")
    sign, word = (1.0, "below") if isinstance(trigger, Below) else (-1.0, "above")
    require(is_number(trigger.value), f"trigger {trigger}: its value must be a finite number")
    text = f"{trigger.quantity} {word} {trigger.value:g}"
    value = sign * factor * float(trigger.value)
    require(  # of what is sensed, a flight's functions say it
        name not in state or sign * nominal[name] > value,
        f"trigger {text} is met at the start, where {name} is {nominal.get(name, np.nan):g}{advice}",
    )
    of_state = [*(f"state.{other}" for other in state), "time"]
    names = [f"sensed.{other}" for other in sensed] if name in sensed else of_state
    place = [other.rpartition(".")[2] for other in names].index(name)
    return tuple(names), End(sign, float(place), value), text


def _ended_by(kind):
    """Function `ended` of these ends; one that is data reads its number from `p.ends`."""
    if len(kind) == 1 and callable(kind[0]):
        return kind[0]
    asked, terms, functions = {}, [], {}
    for one in kind:
        if callable(one):
            arguments = inspect.signature(one).parameters
            functions[f"end_{len(functions)}"] = one
            terms.append(f"end_{len(functions) - 1}({', '.join(arguments)})")
            asked |= dict.fromkeys(arguments)
        else:
            end = f"p.ends[{len(terms) - len(functions)}]"
            chosen = "".join(f"{name} if {end}.place == {row}.0 else " for row, name in enumerate(one[:-1]))
            terms.append(f"{end}.sign * ({chosen}{one[-1]}) - {end}.value")
            asked |= dict.fromkeys([*(name.partition(".")[0] for name in one), "p"])
    if len(terms) == 1:
        return generated(asked, [f"return {terms[0]}"], float)
    returns = namedtuple("Reached", [f"end_{row}" for row in range(len(terms))])
    return generated(asked, [f"return Reached({', '.join(terms)})"], returns, Reached=returns, **functions)


@lru_cache(64)
def extended(kind, *names):
    """A NamedTuple class with the fields of another one, and further ones."""
    made = namedtuple(kind.__name__, (*getattr(kind, "_fields", ()), *names))
    made.__annotations__ = getattr(kind, "__annotations__", {})
    return made


@lru_cache(64)
def completed(flight, law, ends, senses=(), actuators=()):
    """The flight with its law and trigger, which stores what laws are told and command, and the time of its end.

    Args:
        flight: `Flight`. law: `Bound.kind`. ends: `Ends.kind`. senses: `senses.Bound.kinds`.
        actuators: `actuators.Bound.kind`.
    """
    told, parts, (kind, *details) = told_by(flight), parts_of(flight), law
    parts.setdefault("sense", generated(["state"], ["return state"], flight.parts["state"]))
    parts |= navigation(told, senses) if senses else {}
    tells = "nav" if "navigate" in parts else "sensed"
    own = {name: f"{tells}.{name}" for name in told._fields} | dict.fromkeys(NAMES_OF_TOLD, tells)
    if kind in ("guide", "simple"):
        function, asked = details
        arguments = [own.get(name, name) for name in asked]
        needed = [name.partition(".")[0] for name in arguments]
        call, remembers = f"return law_of_user({', '.join(arguments)})", kind == "guide"
        if remembers and arguments == [*asked]:  # no other function stands between it and the flight
            parts["guide"] = function
        else:
            returns = hints(function)["return"] if remembers else tuple[command_of(flight), Nothing]
            lines = [call if remembers else f"{call}, ()"]
            parts["guide"] = generated(needed, lines, returns, function, law_of_user=function)
    elif kind == "constant":
        parts["guide"] = generated(["law"], ["return law, ()"], tuple[command_of(flight), Nothing])
    elif kind == "table":
        parts |= _of_table(*details, tells, told, command_of(flight))
    if ends and ends != ("own",):
        parts["ended"] = _ended_by(ends)
    guide = parts["guide"]
    guide = guide[0] if isinstance(guide, tuple) else guide
    commands = get_args(hints(guide)["return"])[0]._fields if guide else ()
    state = flight.parts["state"]._fields
    held = {name: f"state.{name}" for name in state}  # the truth; what is told of it has names of its own
    if "sense" in flight.classes:
        sensed = flight.parts["sensed"]._fields
        held |= {f"sensed_{name}" if name in state else name: f"sensed.{name}" for name in sensed}
    parts.setdefault("store", _gathered(held | {name: f"command.{name}" for name in commands if name not in held}))
    watched = {name: f"watched.{name}" for name in flight.parts["watched"]._fields}
    parts.setdefault("finish", _gathered(held | watched, "time"))
    if tells == "nav":
        known = [name for name, _ in senses] or told._fields
        known = {f"nav_{name}": f"nav.{name}" for name in known}
        parts |= {role: with_fields(parts[role], known, ["nav"]) for role in ("store", "finish")}
    return Flight(**(actuated(parts, *actuators) if actuators else parts))


def _of_table(against, columns, commanded, tells, told, command):
    """Functions of a gain table: `consult`, which reads it, and `guide`."""
    advice = namedtuple("Advice", columns)
    rows = (f"low * law.values[{row}, node] + part * law.values[{row}, node + 1]" for row in range(len(columns)))
    lines = [
        f"place = {'time' if against == 'time' else f'{tells}.{against}'}",
        "node = min(max(np.searchsorted(law.nodes, place) - 1, 0), len(law.nodes) - 2)",
        "part = (place - law.nodes[node]) / (law.nodes[node + 1] - law.nodes[node])",
        "part = min(max(part, 0.0), 1.0)",
        "low = 1.0 - part",
        f"return Advice({', '.join(rows)})",
    ]
    terms = []
    for column in commanded:
        fed_back = [name for name in told._fields if f"{column}_per_{name}" in columns]
        gains = (f"advice.{column}_per_{name} * ({tells}.{name} - advice.{name})" for name in fed_back)
        term = " + ".join([f"advice.{column}", *gains])
        terms.append(term if column in command._fields else f"arc_cosine(min(max({term}, -1.0), 1.0))")
    commands, read = f"return Command({', '.join(terms)}), ()", {"Command": command, "arc_cosine": arc_cosine}
    return {
        "consult": generated(("time", tells, "law"), lines, advice, np=np, Advice=advice),
        "guide": generated((tells, "advice"), [commands], tuple[command, Nothing], **read),
    }


def _gathered(fields, *first):
    """The function that returns fields of parts, name by name, after (first) the time as `end_time`."""
    kind = namedtuple("Gathered", (*("end_time" for _ in first), *fields))
    asked = (field.partition(".")[0] for field in fields.values())
    return generated((*first, *asked), [f"return Kind({', '.join((*first, *fields.values()))})"], kind, Kind=kind)
