"""Refuses integers to the power of integers in what users write, as compiled they are other numbers than in Python.

An integer of Python has as many digits as it takes, and 2**-1 is 0.5. Compiled, integers have 64 bits and 2**-1 is 0.
"""

import operator

import numpy as np
from numba.core import types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.errors import TypingError
from numba.core.ir import Expr
from numba.core.ir_utils import find_const, guard
from numba.core.typed_passes import NopythonTypeInference

_POWERS = (operator.pow, operator.ipow, pow, np.power)
_SMALL = range(4)  # exponents that are written as such: squares and cubes of what a law counts have less than 64 bits
_MEANING = (
    "an integer to the power of an integer is another number than in Python, if that is negative or the result has "
    "more than 64 bits: make one of them a float, as in 2.0 ** n"
)


@register_pass(mutates_CFG=False, analysis_only=True)
class RefuseWholePowers(FunctionPass):
    """Pass of numba's compiler, after the types are known. Raises TypingError with the line."""

    _name = "refuse_whole_powers"

    def __init__(self):
        """Make the pass, as numba asks of each."""
        FunctionPass.__init__(self)

    def run_pass(self, state):
        """Look at all calls and operations; changes nothing."""
        for expression, signature in state.calltypes.items():
            if not isinstance(expression, Expr):
                continue
            function, exponent = _called(expression, state.typemap)
            if function not in _POWERS or not all(isinstance(kind, types.Integer) for kind in signature.args[:2]):
                continue
            if guard(find_const, state.func_ir, exponent) not in _SMALL:
                raise TypingError(_MEANING, loc=expression.loc)
        return False


def _called(expression, kinds):
    """The function that an expression calls, or its operator, and the second argument; None where it is not known."""
    if expression.op in ("binop", "inplace_binop"):
        return expression.fn, expression.rhs
    if expression.op == "call" and len(expression.args) > 1:
        return getattr(kinds[expression.func.name], "typing_key", None), expression.args[1]
    return None, None


class Checked(CompilerBase):
    """Numba's compiler with this pass; what it compiles is the same."""

    def define_pipelines(self):
        """Numba's pipeline for compiled code."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.add_pass_after(RefuseWholePowers, NopythonTypeInference)
        pipeline.finalize()
        return [pipeline]
