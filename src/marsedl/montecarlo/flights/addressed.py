"""A guidance law apart from the flight's kernel: compiled and cached alone, and called by its address once a period.

So all laws share the kernel of a vehicle, which takes much longer to compile than a law.
"""

from collections import namedtuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from marsedl.montecarlo.flights.binding import Nothing, asked, compiled
from marsedl.montecarlo.flights.columns import borrowed, dresser, getter, putter, reader, types_of
from marsedl.montecarlo.lanes import LANES, inline_called_njit, lane_array

PARTS_TOLD = ("state", "found", "sensed", "nav", "memory", "vehicle")
_LANES, _WORDS = types.Array(types.float64, 2, "C"), types.Array(types.int64, 1, "C")
SIGNATURE = types.Tuple(
    # half_index, cycle, time, share; PARTS_TOLD, past, command, chosen; law, p
    (*(types.int64, types.int64, types.float64, types.float64), *[_LANES] * (len(PARTS_TOLD) + 3), _WORDS, _WORDS)
)
"""What the kernel tells a law, as one argument: laws of all memories and parameters have this signature."""


def guide_group(told):
    """Guide a group of trials; this function is compiled and cached under the name of the law that is bound to it."""
    _bound(told)  # noqa: F821


def parameters_of(flight, p, law):
    """Parameters by name, empty where neither a law nor its `consult` asks for them."""
    needed = _needed(flight)
    return {name: value if name in needed else () for name, value in (("law", law), ("p", p))}


def is_addressed(flight, p, law):
    """Whether a law is compiled alone: it has no phases, and asks for numbers and arrays only.

    Interrupts that ask for the law's parameters need it compiled with the flight.
    """
    interrupts = flight.functions["interrupts"]
    if len(flight.guides) != 1 or (interrupts and "law" in asked(interrupts, "interrupts")):
        return False
    kinds = [kind for value in parameters_of(flight, p, law).values() for kind in types_of(value)]
    plain = types.Integer | types.Float | types.Boolean
    return all(isinstance(kind.dtype if isinstance(kind, types.Array) else kind, plain) for kind in kinds)


def _needed(flight):
    """Names of what a law asks for, or its `consult`."""
    consult = flight.functions["consult"]
    return {*asked(flight.guides[0], "guide"), *(asked(consult, "consult") if consult else ())}


def kinds_of_law(flight, vehicle_class):
    """Named tuples that a law is compiled with, by part: of what it is not told, an empty one."""
    needed, parts = _needed(flight), {**flight.parts, "vehicle": vehicle_class}
    needed |= {"advice", "command", "memory"}
    return {name: parts[name] if name in needed else Nothing for name in (*PARTS_TOLD, "advice", "command")}


def kinds_of_kernel(flight):
    """Named tuples, by part, that a kernel is compiled with for all laws of these commands."""
    functions = ((role, function) for role, function in flight.functions.items() if function and role != "consult")
    remembers = any("memory" in asked(function, role) for role, function in functions)
    return {
        "advice": Nothing,
        "command": namedtuple("Command", flight.parts["command"]._fields),  # whatever a law calls it
        "memory": flight.parts["memory"] if remembers else Nothing,
    }


def law_of_lanes(flight, kinds, shapes, leaves):
    """Compile (lazily) the guidance of a group, `consult` before `guide`.

    All that it reads and writes is copied: of such arrays the compiler knows that they do not overlap.

    kinds: see `kinds_of_law`. shapes, leaves: of its parameters by name, see `shape_of` and `types_of`.
    """

    @inline_called_njit
    def absent(*unused):
        pass

    def copier(kind):
        """Function that copies a lane array of a kind; a plain loop over rows and lanes does not become vector code."""
        get, put = getter(kind), putter(kind, flight.guides[0])

        @inline_called_njit
        def copy(source, target):
            for lane in range(LANES):
                put(get(source, lane), target, lane, None)
            return target

        return copy

    copied = (*(kinds[name] for name in (*PARTS_TOLD, "command")), namedtuple("Chosen", ["chosen"]))
    copy_state, copy_found, copy_sensed, copy_nav, copy_memory, copy_vehicle, copy_command, copy_chosen = map(
        copier, copied
    )
    guide, consult = compiled(flight.guides[0], "guide", kinds, masked=True), flight.functions["consult"]
    consult = compiled(consult, "consult", kinds) if consult else absent
    read_law, dress_law = reader(leaves["law"]), dresser(shapes["law"])
    read_p, dress_p = reader(leaves["p"]), dresser(shapes["p"])
    STATES, FOUND, SENSED, NAV, MEMORY, VEHICLE, ADVICE, COMMANDS = (
        len(kinds[name]._fields) for name in (*PARTS_TOLD, "advice", "command")
    )

    @inline_called_njit
    def guide_lanes(told):
        half_index, cycle, time, share = told[:4]
        states, founds, senses, navs, memories, vehicles, pasts, commands, choices, law_words, p_words = told[4:]
        law, p, past = dress_law(read_law(law_words)), dress_p(read_p(p_words)), borrowed(pasts)
        state, found = copy_state(states, lane_array(STATES)), copy_found(founds, lane_array(FOUND))
        sensed, nav = copy_sensed(senses, lane_array(SENSED)), copy_nav(navs, lane_array(NAV))
        memory, vehicle = copy_memory(memories, lane_array(MEMORY)), copy_vehicle(vehicles, lane_array(VEHICLE))
        command, chosen = copy_command(commands, lane_array(COMMANDS)), copy_chosen(choices, lane_array(1))
        advice = lane_array(ADVICE)
        consult(cycle, time, sensed, nav, memory, vehicle, law, p, advice)
        scene = (half_index, time, cycle, state, found, share, sensed, nav, advice, memory, past, vehicle, law, p)
        guide(*scene, command, chosen)
        copy_command(command, commands)
        copy_memory(memory, memories)

    return guide_lanes


def words_of(leaves):
    """Numbers and arrays as words of 8 bytes: a number, or the address and the lengths of an array.

    leaves: what `flat` returned; who calls keeps its arrays.
    """
    words = []
    for leaf in leaves:
        if isinstance(leaf, np.ndarray):
            words += [leaf.ctypes.data, *leaf.shape]
        elif isinstance(leaf, float | np.floating):
            words.append(np.float64(leaf).view(np.int64))
        else:
            words.append(np.asarray(leaf).astype(np.int64))
    return np.array(words, np.int64)


def address_of(law_function):
    """Address of a compiled law, valid as long as the function is."""
    made = law_function.overloads[(SIGNATURE,)]
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


@intrinsic
def call_at(typing_context, address, told):
    """Call a law at its address as numba calls its own functions, so that what it raises is passed on."""

    def generate(context, builder, signature, arguments):
        convention = context.call_conv
        kind = convention.get_function_type(types.void, (SIGNATURE,))
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        status, _ = convention.call_function(builder, function, types.void, (SIGNATURE,), arguments[1:])
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.void(types.int64, SIGNATURE), generate
