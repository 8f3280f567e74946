"""What a law costs, in numbers that are the same on every machine: operations of a command, programs of a design."""

import dis
import inspect
import sys
from collections import Counter
from collections.abc import Callable
from functools import cache

from marsedl.design import reference
from marsedl.methods import collocation, conic, tvlqr
from marsedl.methods.covariance_steering import closed_form, lqg_dual
from marsedl.papers.stochastic_entry import flight

__all__ = ["command_of", "design_of"]

WORK = {  # of a design, by the functions that do it
    "nonlinear programs": (collocation.Program.solve,),
    "cone programs": (conic.solve,),
    "dual programs": (lqg_dual.solve,),
    "closed forms": (closed_form.steer,),
    "Riccati recursions": (lqg_dual.lqg_gains, tvlqr.discrete_regulator),
    "flights": (flight.fly, reference.fly_held),
}

ARITHMETIC = {"BINARY_OP", "COMPARE_OP", "UNARY_NEGATIVE"}
EVERY = 20  # of so many commands one is looked into


@cache
def _counted(code) -> frozenset[int]:
    """Places in a function's code where it adds, multiplies, divides, negates or compares numbers."""
    instructions = dis.get_instructions(code)
    return frozenset(one.offset for one in instructions if one.opname in ARITHMETIC and one.argrepr != "[]")


def design_of(act: Callable) -> str:
    """What is solved and flown while something runs: "2 nonlinear programs, 5 flights"."""
    words = {inspect.unwrap(function).__code__: name for name, of in WORK.items() for function in of}
    counts = Counter()

    def profile(frame, event, _):
        if event == "call" and frame.f_code in words:
            counts[words[frame.f_code]] += 1

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        act()
    finally:
        sys.setprofile(before)
    return ", ".join(f"{counts[name]} {name if counts[name] > 1 else name[:-1]}" for name in WORK if counts[name])


def command_of(campaign) -> float:
    """Operations of a command, and of the actuators that take it: every 20th one of the first trial.

    They are sums, products, quotients, negations and comparisons of numbers in the functions of the law and all that
    these call, flown as they are written.
    """
    flies = campaign.flight()
    functions = [function for function in (*flies.guides, flies.functions["consult"]) if function]
    codes, calls, depth, operations = {one.__code__ for one in functions}, Counter(), 0, 0

    def trace(frame, event, _):
        nonlocal depth, operations
        if event == "call":
            if not depth and frame.f_code in codes:
                calls[frame.f_code] += 1
            if not depth and calls[frame.f_code] % EVERY != 1:
                return None
            depth += 1
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
        elif event == "opcode":
            operations += frame.f_lasti in _counted(frame.f_code)
        elif event == "return":
            depth -= 1
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        campaign.fly_all(0, 1, 1, False, False)
    finally:
        sys.settrace(before)
    return operations / -(-calls[flies.guides[0].__code__] // EVERY)
