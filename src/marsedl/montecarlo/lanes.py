"""Groups of trials: how many trials compiled code carries at once, and what its loops over them are made of.

Compiled Monte Carlo code works on groups of `LANES` consecutive trials. Every elementwise operation is an inner loop
over the lanes without calls or branches, which the compiler turns into vector instructions; IEEE arithmetic without
contraction makes a lane's result the same in every lane and at every vector width.
"""

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numba.np import arrayobj

from marsedl.montecarlo import LANES

# For what compiled code alone calls: without the wrappers for calls from Python and C, which would be compiled, too.
called_njit = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
inline_called_njit = njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


@intrinsic
def lane_array(typing_context, rows):
    """Uninitialised float64 scratch (rows, LANES) on the stack, valid until the calling function returns.

    Of such arrays the compiler knows that they do not overlap, and so it vectorises large models too (`np.empty` does
    not tell it). Never return one.
    """
    array_type = types.Array(types.float64, 2, "C")

    def generate(context, builder, signature, arguments):
        integer = context.get_value_type(types.intp)
        lanes, itemsize = ir.Constant(integer, LANES), ir.Constant(integer, 8)
        data = builder.alloca(ir.DoubleType(), size=builder.mul(arguments[0], lanes))
        data.align = 64
        array = arrayobj.make_array(array_type)(context, builder)
        shape, strides = [arguments[0], lanes], [builder.mul(lanes, itemsize), itemsize]
        arrayobj.populate_array(array, data=data, shape=shape, strides=strides, itemsize=itemsize, meminfo=None)
        return array._getvalue()

    return array_type(types.intp), generate
