"""What went wrong or slow when a model was compiled, in terms of the model: its function, file, line and remedy."""

import re
import warnings
from contextlib import contextmanager
from pathlib import Path

from numba import njit, types
from numba.core import errors

from marsedl.montecarlo.flights.binding import OFFERED, WRITTEN, asked, compiled
from marsedl.montecarlo.flights.columns import dresser, shape_of, types_of
from marsedl.montecarlo.lanes import LANES, lane_array
from marsedl.words import described

COMPILER_ERRORS = (errors.NumbaError, errors.UnsupportedBytecodeError)
_LIBRARY = r"\$(?:sin|cos|tan|asin|acos|atan2?|sinh|cosh|tanh|exp|expm1|log|log1p|pow|hypot|fmod)\b"  # called
_ARITHMETIC = r"\bv?(?:add|sub|mul|div|sqrt|min|max|fn?m\w+)"


@contextmanager
def explaining(flight, arguments, options):
    """Raise what numba cannot compile as `explained` says."""
    try:
        yield
    except COMPILER_ERRORS as error:
        raise explained(error, flight, arguments, options) from None


def explained(error, flight, arguments, options):
    """TypeError that names the function which numba could not compile, its line and why.

    One guidance period is flown in Python first: what goes wrong there is raised as it is.
    """
    p, schedule, start = arguments
    flight.fly_in_python(p, schedule.first_period(), start, trial=options.get("first_trial", 0), **options)
    where, reason = _innermost(re.sub(r"\x1b\[[0-9;]*m", "", str(error)))
    return TypeError(
        f"numba cannot compile {where}: {reason}; write the model with numbers, NamedTuples, arrays and the functions "
        "of numpy that numba knows"
    )


def _innermost(message):
    """Where in the model, helpers included, numba met what it cannot compile, and what it says of that.

    Numba tells an error of a helper indented, before the place that called it.
    """
    places = [
        place
        for place in re.finditer(r'^( *)File "([^"]+)", line (\d+):(?:\n *def (\w+))?', message, re.MULTILINE)
        if not re.search(r"marsedl/(montecarlo/|elementary|compiling)|site-packages/numba/|^<string>$", place[2])
    ]
    if not places:
        raised = re.search(r"Raised from (\S+) \((\d+)\)", message)
        return f"{raised[1]}, line {raised[2]}" if raised else "the model, line ?", _reason(message)
    place = max(places, key=lambda place: len(place[1]))  # the first of those
    name = f", in {place[4]}" if place[4] else ""
    return f"{Path(place[2]).resolve()}, line {place[3]}{name}", _reason(message[: place.start()])


def _reason(message):
    """The last thing that went wrong: what an error says that is no mere consequence of another one."""
    text = re.split(r"Failed in nopython mode pipeline \(step: [^)]*\)", message)[-1]
    if specific := re.findall(r"\w+Error: +(?!Failed)(\S.*\S)", text):
        return specific[-1]
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith(("During", "File"))]
    signature = next((line.removeprefix(">>>") for line in lines if line.startswith(">>>")), "")
    return f"{lines[0]}{signature}" if lines else ""


def warn_of_scalar_loops(flight, roles, p, law, vehicle_class):
    """Warn of each function whose loop over trials is not vector code, as flights are several times slower then."""
    for function in scalar_loops(flight, roles, p, law, vehicle_class):
        warnings.warn(
            f"{described(function)}: the loop over trials did not become vector code, so flights are slower; choose by "
            "`a if condition else b`, and leave loops over tables to look_up or consult",
            stacklevel=3,
        )


def scalar_loops(flight, roles, p, law, vehicle_class):
    """Functions of these roles, rates, sense, navigate or guide, whose compiled loop over lanes is not vector code.

    A loop that is has scalar arithmetic, too, for arrays that overlap, but not more than packed arithmetic.
    """
    kinds = {**flight.parts, "vehicle": vehicle_class, **{name: flight.options[name] for name in ("noise", "draws")}}
    functions = [(role, flight.functions[role]) for role in ("rates", "sense", "navigate")]
    functions += [("guide", function) for function in flight.guides]
    found = []
    for role, function in functions:
        if role in roles and function and "past" not in asked(function, role):  # loops over its own past
            probe = _loop_alone(role, function, kinds, shape_of(p), shape_of(law))
            table = types.Array(types.float64, 2, "C")
            probe.compile((*(types.Tuple(types_of(value) or (types.float64,)) for value in (p, law)), table, table))
            if is_scalar(probe):
                found.append(function)
    return found


def is_scalar(function):
    """Whether what numba just compiled has more scalar arithmetic than vector code has, or calls a library's."""
    code = next(iter(function.inspect_asm().values()))
    packed, scalar = (len(re.findall(_ARITHMETIC + kind, code)) for kind in (r"pd\b", r"sd\b"))
    return scalar > 3 * packed or re.search(_LIBRARY, code) is not None


def _loop_alone(role, function, kinds, p_shape, law_shape):
    """Compiled loop over the lanes of a group that calls one function alone, reading `given` and writing `out`."""
    parts = [name for name in OFFERED[role] if name in kinds]
    written = [name for name in WRITTEN[role] if name not in parts]
    rows = {name: len(kinds["state" if name == "slope" else name]._fields) for name in (*parts, *written)}
    space = {"loop": compiled(function, role, kinds), "lane_array": lane_array, "LANES": LANES}
    space |= {"dress_p": dresser(p_shape), "dress_law": dresser(law_shape)}
    values = {"half_index": "2", "cycle": "1", "time": "0.5", "step": "0.5", "share": "0.0", "past": "given"}
    lines = ["def alone(p_values, law_values, given, out):", "    p, law = dress_p(p_values), dress_law(law_values)"]
    each = ["        for lane in range(LANES):"]
    for name in (*parts, *written):
        lines += [f"    {name} = lane_array({rows[name]})", f"    for row in range({rows[name]}):", *each]
        lines += [f"            {name}[row, lane] = given[row, lane]"]
    lines += [f"    loop({', '.join(values.get(name, name) for name in (*OFFERED[role], *written))})"]
    first = 0
    for name in WRITTEN[role]:
        lines += [
            f"    for row in range({rows[name]}):",
            *each,
            f"            out[{first} + row, lane] = {name}[row, lane]",
        ]
        first += rows[name]
    exec("\n".join(lines), space)
    return njit(error_model="numpy")(space["alone"])
