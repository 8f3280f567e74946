"""What went wrong or slow when a model was compiled, in terms of the model: its function, file, line and remedy."""

import re
import warnings

import numpy as np
from numba import njit
from numba.core import errors

from marsedl.montecarlo.flights.binding import OFFERED, asked, compiled, describe
from marsedl.montecarlo.flights.columns import column, dresser, flat, getter, putter, shape_of
from marsedl.montecarlo.lanes import LANES, lane_array

COMPILER_ERRORS = (errors.NumbaError, errors.UnsupportedBytecodeError)
_LIBRARY = r"\$(?:sin|cos|tan|asin|acos|atan2?|sinh|cosh|tanh|exp|expm1|log|log1p|pow|hypot|fmod)\b"  # called
_ARITHMETIC = r"\bv?(?:add|sub|mul|div|sqrt|min|max|fn?m\w+)"


def explained(error, flight, arguments, options):
    """TypeError that names the function which numba could not compile, its line and why.

    One guidance period is flown in Python first: what goes wrong there is raised as it is.
    """
    p, schedule, start = arguments
    first = schedule._replace(start=schedule.start[:2], step=schedule.step[:1], steps=schedule.steps[:1])
    flight.fly_in_python(p, first, start, trial=options.get("first_trial", 0), **options)
    message = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    places = re.findall(r'File "([^"]+)", line (\d+)|Raised from (\S+) \((\d+)\)', message)
    places = [(a or b, line or other) for a, line, b, other in places]
    places = [place for place in places if "marsedl/montecarlo/flights" not in place[0] and place[0] != "<string>"]
    file, line = places[-1] if places else ("the model", "?")
    reasons = [
        text.strip() for text in message.splitlines() if text.strip() and not text.startswith((" ", "During", "File"))
    ]
    reason = next(
        (text for text in reasons if not text.startswith("Failed in nopython")), reasons[0] if reasons else ""
    )
    return TypeError(
        f"numba cannot compile {file}, line {line}: {reason}. Write the model with numbers, NamedTuples, arrays and "
        "the functions of numpy that numba knows; what a function calls must be marked by jitable"
    )


def warn_of_scalar_loops(flight, p, law, vehicle_class):
    """Warn of each function whose loop over trials is not vector code, as flights are several times slower then."""
    for function in scalar_loops(flight, p, law, vehicle_class):
        warnings.warn(
            f"{describe(function)}: the loop over trials did not become vector code, so flights are slower; choose by "
            "`a if condition else b`, and leave loops over tables to look_up or consult",
            stacklevel=3,
        )


def scalar_loops(flight, p, law, vehicle_class):
    """Functions among rates, sense and guide whose compiled loop over lanes has more scalar arithmetic than packed."""
    kinds = {**flight.parts, "vehicle": vehicle_class, "noise": flight.options[1]}
    roles = [("rates", flight.functions["rates"], ("state",)), ("sense", flight.functions["sense"], ("sensed",))]
    roles += [("guide", function, ("command", "memory")) for function in flight.guides]
    found = []
    for role, function, results in roles:
        if function and "past" not in asked(function, role):  # loops over its own past
            probe = _loop_alone(role, function, kinds, results, shape_of(p), shape_of(law))
            probe(flat(p) or (0.0,), flat(law) or (0.0,), np.ones((64, LANES)), np.empty((64, LANES)))
            code = next(iter(probe.inspect_asm().values()))
            packed, scalar = (len(re.findall(_ARITHMETIC + kind, code)) for kind in (r"pd\b", r"sd\b"))
            if scalar > packed or re.search(_LIBRARY, code):
                found.append(function)
    return found


def _loop_alone(role, function, kinds, results, p_shape, law_shape):
    """Compiled loop over the lanes of a group that calls one function alone, reading `given` and writing `out`."""
    given = {name: kind for name, kind in kinds.items() if name in OFFERED[role]}
    space = {"call": compiled(function, role), "lane_array": lane_array, "LANES": LANES, "column": column}
    space |= {f"get_{name}": getter(kind) for name, kind in given.items()}
    space |= {f"put_{name}": putter(kinds[name], function) for name in results}
    space |= {"dress_p": dresser(p_shape), "dress_law": dresser(law_shape)}
    values = {"half_index": "2", "cycle": "1", "time": "0.5", "share": "0.0", "past": "column(given, lane)"}
    values |= {name: f"get_{name}({name}, lane)" for name in given}
    arguments = ", ".join(values.get(name, name) for name in OFFERED[role])
    of_kind = {name: len(kinds[name]._fields) for name in kinds}
    lines = ["def loop(p_values, law_values, given, out):", "    p, law = dress_p(p_values), dress_law(law_values)"]
    for name in given:
        lines += [f"    {name} = lane_array({of_kind[name]})", f"    for row in range({of_kind[name]}):"]
        lines += ["        for lane in range(LANES):", f"            {name}[row, lane] = given[row, lane]"]
    lines += [f"    of_{name} = lane_array({of_kind[name]})" for name in results]
    lines += [
        "    for lane in range(LANES):",
        f"        {', '.join(f'new_{name}' for name in results)} = call({arguments})",
    ]
    lines += [f"        put_{name}(new_{name}, of_{name}, lane, None)" for name in results]
    for first, name in zip((0, of_kind[results[0]]), results, strict=False):
        lines += [f"    for row in range({of_kind[name]}):", "        for lane in range(LANES):"]
        lines += [f"            out[{first} + row, lane] = of_{name}[row, lane]"]
    exec("\n".join(lines), space)
    return njit(error_model="numpy")(space["loop"])
