"""What functions of a model may ask for and return, and the kernel that is cached for exactly these functions."""

import dis
import enum
import hashlib
import inspect
import sys
import types as python_types
from collections import ChainMap
from functools import cache
from typing import NamedTuple, get_args, get_type_hints

import numpy as np

from marsedl.compiling import renew
from marsedl.words import described, remedy, require

_PLACE = ("half_index", "time", "cycle", "state", "found")
_SCENE = (*_PLACE, "guided", "sensed", "nav", "command", "memory", "vehicle", "p")
OFFERED = {
    "rates": ("half_index", "time", "before", "step", "state", "found", "command", "flown", "vehicle", "noise", "p"),
    "actuate": ("half_index", "time", "command", "vehicle", "p"),
    "look_up": ("half_index", "time", "state", "air", "p"),
    "sense": ("half_index", "time", "state", "found", "command", "vehicle", "p"),
    "interrupts": ("time", "state", "memory", "vehicle", "law", "p"),
    "navigate": ("cycle", "time", "sensed", "nav", "draws", "vehicle", "p"),
    "consult": ("cycle", "time", "sensed", "nav", "memory", "vehicle", "law", "p"),
    "phase": ("cycle", "time", "sensed", "nav", "memory", "vehicle", "law", "p"),
    "guide": (*_PLACE, "share", "sensed", "nav", "advice", "memory", "past", "vehicle", "law", "p", "command"),
    "ended": ("time", "state", "found", "sensed", "vehicle", "p"),
    "vary": ("node", "normal", "drawn", "p"),
    "store": _SCENE,
    "observe": _SCENE,
    "watch": ("watched", "ending", *_SCENE),
    "finish": ("time", "state", "found", "sensed", "nav", "command", "memory", "vehicle", "drawn", "watched", "p"),
}
"""Names that a function of each role may ask for; `flights` says what they are."""


PARTS = {
    "rates": ("state",),
    "actuate": ("flown",),
    "look_up": ("found",),
    "sense": ("sensed",),
    "navigate": ("nav",),
    "consult": ("advice",),
    "guide": ("command", "memory"),
    "store": ("stored",),
    "observe": ("observed",),
    "watch": ("watched",),
    "finish": ("final",),
}
"""Parts of the flight, NamedTuples, that a function of each role returns; other roles return a number."""

NUMBERS = {"interrupts": "is_due", "phase": "in_phase", "ended": "excess"}
WRITTEN = PARTS | {"rates": ("slope",)} | {role: (name,) for role, name in NUMBERS.items()}
"""Lane arrays to which the numbers go that a function of each role returns."""

_FOREIGN = ("numpy", "numba", "llvmlite")
_HIDDEN = ("random", "numpy.random", "secrets", "time", "datetime")  # modules whose answers no trial owns
_FORMAT = "2"  # of kernels on disk; those of the first may hold other numbers than their names say
_FOLLOWED = (
    *(int, float, complex, str, bytes, type(None), np.generic, np.ndarray, tuple, type, enum.Enum),
    *(python_types.FunctionType, python_types.BuiltinFunctionType, python_types.ModuleType),
)
_LARGEST = 10**6  # bytes of an array beyond which numba reads it where it lies


class Nothing(NamedTuple):
    """What a part of a flight holds that its model does not have."""


# ---- functions -------------------------------------------------------------------------------------------------------


def asked(function, role):
    """Names of a function's arguments. Raises ValueError unless all are offered to its role."""
    names = list(inspect.signature(function).parameters)
    for name in names:
        if name not in OFFERED[role]:
            others = remedy(name, OFFERED[role], "It may ask for")
            raise ValueError(f"{described(function)} asks for {name!r}, which {role} is not offered; {others}")
    return names


def hints(function):
    """Annotations of a function by name, without those whose names are nowhere, as those for a type checker alone are.

    Names in strings, which all annotations are under `from __future__ import annotations`, may be local to the
    functions around it, as long as these run or the function itself uses the names. Raises ValueError if the annotation
    of what it returns is such a string of unknown names.
    """
    around = {name.rpartition(".")[2] for name in function.__qualname__.split(".<locals>.")[:-1]}
    frames = (frame.frame for frame in inspect.stack(0))
    running = [
        frame.f_locals for frame in frames if frame.f_code.co_name in around and frame.f_globals is function.__globals__
    ]
    places = ChainMap(_space(function).maps[0], *running)
    found = {}
    for name, annotation in getattr(function, "__annotations__", {}).items():
        alone = python_types.SimpleNamespace(__annotations__={name: annotation})
        try:
            found |= get_type_hints(alone, function.__globals__, places)
        except (NameError, AttributeError, TypeError, SyntaxError) as error:
            require(
                name != "return",
                f"{described(function)}: {annotation!r}, which it is annotated to return, cannot be read ({error}): "
                f"define its classes at the top of the file",
            )
    return found


def returned(function, role):
    """Named tuples, or float or bool, that a function is annotated to return: one, or those of a tuple.

    Raises ValueError without such an annotation.
    """
    kind = hints(function).get("return")
    if role == "ended" and hasattr(kind, "_fields"):
        return (kind,)
    kinds = get_args(kind) or (kind,)
    wanted = {"guide": 2, "vary": 2}.get(role, 1)
    numbers = {"ended": 1, "vary": 1, "interrupts": 1, "phase": 1}.get(role, 0)
    good = len(kinds) == wanted and all(hasattr(part, "_fields") for part in kinds[numbers:])
    if not good or not all(part in (float, bool, int) for part in kinds[:numbers]):
        example = {
            "guide": "tuple[Command, Memory]",
            "vary": "tuple[float, Drawn]",
            "ended": "float (its zero is found), a named tuple of them, or bool",
            "interrupts": "bool",
            "phase": "int",
        }.get(role, "a named tuple of numbers")
        raise ValueError(f"annotate what {described(function)} returns: {example}, where classes are NamedTuples")
    return kinds


@cache
def float_fields(kind):
    """Of the fields of a NamedTuple class, which are annotated as floats."""
    written = {name: hint for base in kind.__mro__[::-1] for name, hint in inspect.get_annotations(base).items()}
    hinted = (written.get(name) for name in kind._fields)
    return tuple(getattr(hint, "__forward_arg__", hint) in (float, "float") for hint in hinted)


def compiled(function, role, kinds, *, masked=False, single=False):
    """Compiled loop over the lanes of a group that calls one function of a model: its body is one generated line.

    Args:
        function, role: what is called, and as what. kinds: named tuples of the parts of the flight, by name.
        masked: whether the loop takes a lane array `chosen`, and only writes where it is positive.
        single: whether a single lane is treated, in place of all.

    Returns:
        `loop(*offered, *written)`, with `lane` first if single, and `chosen` last if masked: names that are offered to
        the role, parts of the flight and `guided` being lane arrays, then the lane arrays that it writes, see
        `WRITTEN`. Of `vary` the function itself, as of what is offered.

    """
    from marsedl.montecarlo.flights.columns import column, getter, putter
    from marsedl.montecarlo.lanes import LANES, inline_called_njit

    space = {"function": inline_called_njit(function), "column": column, "LANES": LANES}
    space["function"]._compiler.pipeline_class = _compiler()
    names, reads = asked(function, role), {"air": "column(air, lane)", "past": "column(past, lane)"}
    reads["guided"] = "guided[0, lane]"
    if role in ("store", "observe", "finish"):  # each its own, as flights end at different times
        reads |= {name: f"{name}[0, lane]" for name in ("half_index", "time", "cycle")}
    for name in () if role == "vary" else kinds:
        space[f"get_{name}"], reads[name] = getter(kinds[name]), f"get_{name}({name}, lane)"
    call = f"function({', '.join(reads.get(name, name) for name in names)})"
    if role == "vary":
        exec(f"def call({', '.join(OFFERED[role])}):\n    return {call}", space)
        return inline_called_njit(space["call"])
    written = WRITTEN[role]
    if role == "ended" and hasattr(ends := returned(function, role)[0], "_fields"):
        body = [f"ends = {call}", "least, which = ends[0], 0.0"]
        for row in range(1, len(ends._fields)):
            body.append(f"which = {row}.0 if ends[{row}] < least else which")
            body.append(f"least = ends[{row}] if ends[{row}] < least else least")
        body.append("excess[0, lane], excess[1, lane] = least, which")
    elif role in NUMBERS:
        body = [f"{written[0]}[0, lane] = {call}"]
    else:
        where = "chosen[0, lane] > 0.0" if masked else "None"
        body = [f"{', '.join(f'new_{name}' for name in written)} = {call}"]
        for name in written:
            space[f"put_{name}"] = putter(kinds["state" if name == "slope" else name], function)
            body.append(f"put_{name}(new_{name}, {name}, lane, {where})")
    takes = ["lane"] * single + [*OFFERED[role], *(name for name in written if name not in OFFERED[role])]
    lines = [f"def loop({', '.join(takes + ['chosen'] * masked)}):"]
    lines += [] if single else ["    for lane in range(LANES):"]
    exec("\n".join(lines + [f"        {line}" for line in body]), space)
    return inline_called_njit(space["loop"])


# ---- what is compiled, and with which values -------------------------------------------------------------------------


def _space(function):
    """What the names in a function's code mean: its closure, before its globals."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return ChainMap({name: cell.cell_contents for name, cell in cells}, function.__globals__)


_NOT_LOCAL = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_DEREF", "LOAD_CLASSDEREF")
LOCAL = ("LOAD_FAST", "LOAD_FAST_CHECK", "LOAD_FAST_BORROW")


@cache
def chains(code, kinds=_NOT_LOCAL):
    """Names that code loads so, each with the attributes that follow: ("np", "random", "normal")."""
    found, chain = [], ()
    for part in codes(code):
        for step in dis.get_instructions(part):
            if step.opname in ("LOAD_ATTR", "LOAD_METHOD") and chain:
                chain = (*chain, step.argval)
            elif step.opname != "EXTENDED_ARG":
                found.append(chain)
                chain = (step.argval,) if step.opname in kinds else ()
    return tuple(filter(None, dict.fromkeys(found)))


def _reads(function):
    """Dotted names that a function reads, and their values; of a module alone all that its code names."""
    space, names = _space(function), [name for code in codes(function.__code__) for name in code.co_names]
    for name, *attributes in chains(function.__code__):
        found = [(name, space[name], attributes)] if name in space else []
        for path, value, further in found:
            yield path, value
            if inspect.ismodule(value):
                members = further[:1] or [key for key in names if not is_foreign(value) or _is_hidden(value, key)]
                found += [(f"{path}.{key}", getattr(value, key), further[1:]) for key in members if hasattr(value, key)]


def helpers_of(function):
    """The function and all that it reaches, but for those of numpy and numba, in the order in which they are read."""
    found = [getattr(function, "py_func", function)]
    for one in found:
        read = (getattr(value, "py_func", value) for _, value in _reads(one))
        found += dict.fromkeys(f for f in read if inspect.isfunction(f) and not is_foreign(f) and f not in found)
    return found


def is_foreign(value):
    """Whether a module, or what a value belongs to, is a package whose functions numba knows and nobody edits."""
    module = value.__name__ if inspect.ismodule(value) else getattr(value, "__module__", None)
    return str(module).partition(".")[0] in _FOREIGN


def _is_of_python(value):
    """Whether it is a function of the standard library."""
    return (
        isinstance(value, python_types.FunctionType)
        and str(value.__module__).partition(".")[0] in sys.stdlib_module_names
    )


def renew_helpers(function, done, defaults=()):
    """Let numba compile again all helpers of a function, down to the last one, that read other numbers than before.

    Args:
        function: of a model. done: set of the helpers that were looked at; helpers are added to it.
        defaults: of a helper's arguments, with their names; that of `law` is the parameters.

    Raises ValueError for what a compiled flight cannot follow: random numbers, clocks, lists, objects.
    """
    for path, value in (*_reads(function), *defaults):
        for member in _members(value):
            _check(member, f"{described(function)} reads {path}")
            helper = getattr(member, "py_func", member)
            if inspect.isfunction(helper) and not is_foreign(helper) and helper not in done:
                done.add(helper)
                renew(member, digest(member), _compiler)
                arguments = inspect.signature(helper).parameters.values()
                given = ((part.name, part.default) for part in arguments if part.default is not part.empty)
                renew_helpers(helper, done, [pair for pair in given if pair[0] != "law"])


def _compiler():
    from marsedl.montecarlo.flights.whole_powers import Checked

    return Checked


def _members(value):
    """What nested tuples hold; of anything else itself."""
    if isinstance(value, tuple):
        for member in value:
            yield from _members(member)
    else:
        yield value


def _is_hidden(value, key=None):
    """Whether a value, or an attribute of it, belongs to a module whose answers no trial owns."""
    value = getattr(value, key, None) if key else value
    owner = getattr(value, "__self__", value)
    modules = getattr(value, "__module__", ""), owner.__name__ if inspect.ismodule(owner) else type(owner).__module__
    return any(f"{module}.".startswith(f"{hidden}.") for module in modules for hidden in _HIDDEN)


def check_parameters(parts, what):
    """Raise ValueError for parameters whose numbers change while they fly; what: their name."""
    for member in _members(parts):
        _refuse_hidden(member, f"{what} holds a {type(member).__name__}")
        require(
            not isinstance(member, list | dict | set),
            f"{what} holds a {type(member).__name__}: give numbers, arrays and NamedTuples of them",
        )


def _refuse_hidden(value, reads):
    require(
        not _is_hidden(value),
        f"{reads}, whose answers belong to no trial, so that a replay would be another flight: disperse the start, "
        f"the vehicle or the air, or remember a number in the law's memory",
    )


def _check(value, reads):
    _refuse_hidden(value, reads)
    followed = isinstance(value, _FOLLOWED) or is_foreign(type(value))
    is_large = isinstance(value, np.ndarray) and value.nbytes > _LARGEST
    require(
        followed and not is_large and not hasattr(value, "_dispatcher"),
        f"{reads}, a {type(value).__name__} whose changes a compiled flight does not see: read numbers, arrays of "
        f"at most 1 MB, NamedTuples and functions, and give all else as law=parameters",
    )


def digest(*roots):
    """Digest of the code and constants that functions reach: bytecode, globals, closures, defaults, classes' fields.

    Numba itself compares the file of the outermost function alone. Here an edited helper or constant in any file makes
    another kernel, and so does a value that changes while a program runs; a comment does not. Of functions of numpy,
    numba and the standard library the names count, as the latter read what a program has imported.
    """
    seen, parts = {}, [_FORMAT]

    def visit(value):
        parts.append(repr(getattr(value, "targetoptions", "")))
        value = getattr(value, "py_func", value)
        if isinstance(value, int | float | complex | str | bytes | None | np.generic):
            parts.append(repr(value))  # each time: what two functions share may stand in either's place
            return
        if id(value) in seen:
            parts.append(f"again {seen[id(value)][0]}")
            return
        seen[id(value)] = len(seen), value  # kept, so that no other object gets its id
        if is_foreign(value) or _is_of_python(value):
            parts.append(getattr(value, "__qualname__", type(value).__qualname__))
        elif isinstance(value, python_types.FunctionType):
            for member in (value.__code__, value.__defaults__, value.__kwdefaults__):
                visit(member)
            for path, member in _reads(value):
                parts.append(path)
                if not isinstance(member, python_types.ModuleType):
                    visit(member)
        elif isinstance(value, python_types.MethodType):
            visit(value.__func__)
            visit(value.__self__)
        elif isinstance(value, python_types.CodeType):
            parts.append(value.co_code.hex())
            parts.append(repr(value.co_names))
            for constant in value.co_consts:
                visit(constant)
        elif isinstance(value, np.ndarray):
            parts.append(f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}")
        elif isinstance(value, type):
            parts.append(value.__qualname__ + repr(getattr(value, "_fields", "")))
            visit(getattr(value, "_field_defaults", None))
            visit([(member.name, member.value) for member in value] if issubclass(value, enum.Enum) else None)
        elif isinstance(value, dict):
            for key, member in value.items():
                parts.append(repr(key))
                visit(member)
        elif isinstance(value, tuple | list | set | frozenset):
            parts.append(f"{type(value).__name__}{getattr(value, '_fields', '')} of {len(value)}")
            for member in sorted(value, key=repr) if isinstance(value, set | frozenset) else value:
                visit(member)
        elif isinstance(value, enum.Enum):
            visit(value.value)
        elif hasattr(value, "__wrapped__") or is_foreign(type(value)):
            parts.append(type(value).__qualname__)
            visit(getattr(value, "__dict__", None))

    for root in roots:
        visit(root)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


# ---- the cached kernel -----------------------------------------------------------------------------------------------


def codes(code):
    """Code, and that of the functions that it makes."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, python_types.CodeType):
            yield from codes(constant)


def named_kernel(outer, bound, name, module, **options):
    """Compile `outer` lazily, and cached, under a name, with its global `_bound` bound; options: numba's.

    Only this outermost function is cached. What is bound stands among its globals, which numba's key does not hold, so
    the name must tell all that is compiled: see `digest`. The code says that it lies in this file, as numba drops what
    is cached when the file of a function changes, and the digest knows better.
    """
    from numba import njit

    from marsedl.montecarlo.lanes import LANES

    code = outer.__code__.replace(co_name=name, co_qualname=name, co_filename=__file__, co_firstlineno=1)
    space = {"_bound": bound, "np": np, "LANES": LANES, "__name__": module}
    function = python_types.FunctionType(code, space, name)
    function.__module__, function.__qualname__ = module, name
    return njit(nogil=True, cache=True, error_model="numpy", **options)(function)
