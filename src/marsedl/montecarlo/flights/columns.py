"""Numbers of one trial in the lane arrays of a group: compiled reads and writes, and parameters with their names.

A lane array (numbers, LANES) holds a named tuple of numbers of every trial of a group, a row a field. The functions of
a model take and return the tuples; what stands here moves them to and from the arrays without loops and copies, so that
a loop over the lanes becomes vector code.

Everything here rests on numba's intrinsics and on `numba.np.arrayobj`: docs/compiled_flights.md lists what is touched.
"""

from itertools import count

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.ir import Loc
from numba.extending import intrinsic
from numba.np import arrayobj

from marsedl.montecarlo.flights.binding import float_fields
from marsedl.montecarlo.lanes import LANES


def _address(context, builder, array_type, array, row, lane):
    """Address of a number of a lane array; `row` is known when it is compiled."""
    data = arrayobj.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [builder.add(ir.Constant(lane.type, row * LANES), lane)], inbounds=True)


def tuple_type(kind):
    """Numba's type of a named tuple of numbers; of a class without fields the empty tuple."""
    count = len(kind._fields)
    return types.BaseTuple.from_types((types.float64,) * count, kind) if count else types.Tuple(())


def getter(kind):
    """Compiled `get(array, lane)`: a column of a lane array as the named tuple `kind`."""
    result = tuple_type(kind)

    @intrinsic
    def get(typing_context, array, lane):
        def generate(context, builder, signature, arguments):
            values = [
                builder.load(_address(context, builder, signature.args[0], arguments[0], row, arguments[1]))
                for row in range(len(kind._fields))
            ]
            return context.make_tuple(builder, result, values)

        return result(array, types.intp), generate

    return get


def putter(kind, function):
    """Compiled `put(values, array, lane, chosen)`: writes what `function` returned where `chosen` is true or None.

    Of a class with one field the number alone will do. Raises numba's TypingError for other values than numbers, or of
    another number than `kind` has fields.
    """
    count, name = len(kind._fields), function.__name__
    place = Loc(function.__code__.co_filename, function.__code__.co_firstlineno)

    @intrinsic
    def put(typing_context, values, array, lane, chosen):
        alone = isinstance(values, types.Number | types.Boolean)
        members = (values,) if alone else values if isinstance(values, types.BaseTuple) else ()
        if len(members) != count or not all(isinstance(member, types.Number | types.Boolean) for member in members):
            if isinstance(values, types.Optional | types.NoneType):
                raise TypingError(f"{name} returns nothing on one of its paths: end each of them with `return`", place)
            raise TypingError(f"{name} must return the {count} numbers of {kind.__name__}, got {values}", place)

        def generate(context, builder, signature, arguments):
            array_type = signature.args[1]
            for row, member in enumerate(members):
                value = arguments[0] if alone else builder.extract_value(arguments[0], row)
                number = context.cast(builder, value, member, types.float64)
                place = _address(context, builder, array_type, arguments[1], row, arguments[2])
                if chosen is not types.none:
                    number = builder.select(arguments[3], number, builder.load(place))
                builder.store(number, place)
            return context.get_dummy_value()

        return types.void(values, array, types.intp, chosen), generate

    return put


@intrinsic
def only(typing_context, value):
    """The number of a tuple of one, or the number itself, as a float."""
    alone = isinstance(value, types.Number | types.Boolean)
    member = value if alone else value[0] if isinstance(value, types.BaseTuple) and len(value) == 1 else None
    if member is None:
        raise TypingError(f"a law whose command is one number must return it, got {value}")

    def generate(context, builder, signature, arguments):
        number = arguments[0] if alone else builder.extract_value(arguments[0], 0)
        return context.cast(builder, number, member, types.float64)

    return types.float64(value), generate


@intrinsic
def column(typing_context, table, lane):
    """table[:, lane] of a contiguous table (nodes, LANES), without a copy."""
    kind = types.Array(types.float64, 1, "A")

    def generate(context, builder, signature, arguments):
        whole = arrayobj.make_array(signature.args[0])(context, builder, arguments[0])
        part = arrayobj.make_array(kind)(context, builder)
        word = context.get_value_type(types.intp)
        arrayobj.populate_array(
            part,
            data=builder.gep(whole.data, [arguments[1]], inbounds=True),
            shape=[cgutils.unpack_tuple(builder, whole.shape, 2)[0]],
            strides=[ir.Constant(word, 8 * LANES)],
            itemsize=ir.Constant(word, 8),
            meminfo=None,
        )
        return part._getvalue()

    return kind(table, types.intp), generate


def _uncounted(context, builder, kind, value):
    """The array without its counter of references: counting in every lane costs a third of a flight."""
    array = arrayobj.make_array(kind)(context, builder, value)
    array.meminfo, array.parent = (cgutils.get_null_value(part.type) for part in (array.meminfo, array.parent))
    return array._getvalue()


@intrinsic
def borrowed(typing_context, array):
    """The array as a view that does not own it; the caller keeps the owner."""

    def generate(context, builder, signature, arguments):
        return _uncounted(context, builder, array, arguments[0])

    return array(array), generate


# ---- parameters: named where functions see them, plain where numba caches --------------------------------------------


def flat(value):
    """The numbers and arrays of nested tuples, in order; numbers that are annotated as floats become floats.

    Numba would pickle a class of a script by value, and never find the kernel again that it compiled for it.
    """
    if isinstance(value, tuple):
        floats = float_fields(type(value)) if hasattr(value, "_fields") else (False,) * len(value)
        members = [float(part) if is_float else part for part, is_float in zip(value, floats, strict=True)]
        return tuple(leaf for member in members for leaf in flat(member))
    # A copy of what is read-only, for which the kernel would be compiled once more.
    plain = not isinstance(value, np.ndarray) or value.flags.carray
    return (value if plain else np.require(value, requirements=["C", "W"]),)


def shape_of(value):
    """The classes of nested tuples: what `dresser` needs to name the plain tuple of `flat` again."""
    return (type(value), tuple(map(shape_of, value))) if isinstance(value, tuple) else None


def reader(kinds):
    """Compiled `read(words)`: the plain tuple of numbers and arrays of these types that `addressed.words_of` wrote."""
    result = types.Tuple(kinds)

    @intrinsic
    def read(typing_context, words):
        def generate(context, builder, signature, arguments):
            data, places = arrayobj.make_array(words)(context, builder, arguments[0]).data, count()

            def word():
                return builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), next(places))]))

            def array_of(kind):
                array, item = arrayobj.make_array(kind)(context, builder), context.get_data_type(kind.dtype)
                start, shape = builder.inttoptr(word(), item.as_pointer()), [word() for _ in range(kind.ndim)]
                itemsize = ir.Constant(ir.IntType(64), context.get_abi_sizeof(item))
                strides = [itemsize] * min(kind.ndim, 1)
                for length in reversed(shape[1:]):
                    strides.insert(0, builder.mul(strides[0], length))
                sizes = {"shape": shape, "strides": strides, "itemsize": itemsize}
                arrayobj.populate_array(array, data=start, meminfo=None, **sizes)
                return array._getvalue()

            def leaf(kind):
                if isinstance(kind, types.Array):
                    return array_of(kind)
                if isinstance(kind, types.Float):
                    return context.cast(builder, builder.bitcast(word(), ir.DoubleType()), types.float64, kind)
                return context.cast(builder, word(), types.int64, kind)

            return context.make_tuple(builder, result, [leaf(kind) for kind in kinds])

        return result(words), generate

    return read


def types_of(value):
    """Numba's types of the numbers and arrays of nested tuples."""
    return tuple(map(typeof, flat(value)))


def dresser(shape):
    """Compiled `dress(values)`: the nested named tuples of a shape, of the plain tuple of their numbers and arrays."""

    def typed(shape, leaves):
        if shape is None:
            return next(leaves)
        kind, members = shape
        members = tuple([typed(member, leaves) for member in members])
        return types.BaseTuple.from_types(members, kind if hasattr(kind, "_fields") else None)

    @intrinsic
    def dress(typing_context, values):
        result = typed(shape, iter(values.types))

        def generate(context, builder, signature, arguments):
            leaves = iter(cgutils.unpack_tuple(builder, arguments[0], len(values.types)))

            def build(kind, shape):
                if shape is None:
                    leaf = next(leaves)
                    return _uncounted(context, builder, kind, leaf) if isinstance(kind, types.Array) else leaf
                return context.make_tuple(builder, kind, [build(k, s) for k, s in zip(kind, shape[1], strict=True)])

            return build(result, shape)

        return result(values), generate

    return dress
