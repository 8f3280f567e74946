"""Counter-based random numbers: every normal is a pure function of (seed, stream, trial, number).

Nothing is ever "drawn next", so trial i of a million can be re-run alone, and no result depends on threads, chunks or
order. Streams keep purposes apart: by convention stream 0 is the initial state, stream 1 the process noise, and a paper
names further ones. The same (seed, trial) gives independent numbers in different streams.

Compiled Monte Carlo code works on groups of `LANES` consecutive trials. Every elementwise operation is an inner loop
over the lanes without calls or branches, which the compiler turns into vector instructions; IEEE arithmetic without
contraction makes a lane's result the same in every lane and at every vector width.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numba.np import arrayobj

# Trials per group: a multiple of every vector width, and enough to keep the cost per loop small.
LANES = 64

# Decorator of everything that runs inside a kernel's loops. Inlining is forced: a call would prevent vectorisation.
inline_njit = njit(error_model="numpy", forceinline=True)

NORMALS_PER_BLOCK = 4

_PHILOX_ROUNDS = 10
_MULTIPLIER_0 = np.uint64(0xD2E7470EE14C6C93)
_MULTIPLIER_1 = np.uint64(0xCA5A826395121157)
_WEYL_0 = np.uint64(0x9E3779B97F4A7C15)
_WEYL_1 = np.uint64(0xBB67AE8584CAA73B)


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


@intrinsic
def _multiply_high_low(typing_context, a, b):
    """128-bit product of two uint64 as (high, low) words: one machine instruction."""
    signature = types.UniTuple(types.uint64, 2)(types.uint64, types.uint64)

    def generate(context, builder, signature, arguments):
        word, double_word = ir.IntType(64), ir.IntType(128)
        product = builder.mul(builder.zext(arguments[0], double_word), builder.zext(arguments[1], double_word))
        high = builder.trunc(builder.lshr(product, ir.Constant(double_word, 64)), word)
        return context.make_tuple(builder, signature.return_type, [high, builder.trunc(product, word)])

    return signature, generate


@inline_njit
def philox4x64(counter0, counter1, counter2, counter3, key0, key1):
    """Philox4x64-10 block cipher (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3").

    counter0..counter3, key0, key1: uint64. Returns four uint64, uniform over all values.
    """
    for _ in range(_PHILOX_ROUNDS):
        high0, low0 = _multiply_high_low(_MULTIPLIER_0, counter0)
        high1, low1 = _multiply_high_low(_MULTIPLIER_1, counter2)
        counter0, counter1, counter2, counter3 = high1 ^ counter1 ^ key0, low1, high0 ^ counter3 ^ key1, low0
        key0 = np.uint64(key0 + _WEYL_0)
        key1 = np.uint64(key1 + _WEYL_1)
    return counter0, counter1, counter2, counter3


@inline_njit
def logarithm(x):
    """Natural logarithm of a normal positive double, free of branches and calls so that a loop over it vectorises.

    x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)); polynomial of the FreeBSD msun library (error below 1 ulp).
    Zero, subnormal, infinite and NaN arguments are not treated.
    """
    bits = np.float64(x).view(np.int64)
    exponent = (bits - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    f = np.int64(bits - (exponent << np.int64(52))).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half_square = 0.5 * f * f
    k = np.float64(exponent)
    low = s * (half_square + even + odd) + k * 1.90821492927058770002e-10
    return k * 6.93147180369123816490e-01 - ((half_square - low) - f)


@inline_njit
def sine_cosine_of_turn(bits):
    """(sine, cosine) of the angle 2 pi bits / 2^64, bits: uint64; free of branches and calls.

    The nearest quarter turn is removed exactly in integers; polynomials of the FreeBSD msun library on [-pi/4, pi/4].
    The angle keeps its 53 leading bits.
    """
    quarter = np.int64((bits + np.uint64(1 << 61)) >> np.uint64(62))
    remainder = np.int64(bits - (np.uint64(quarter) << np.uint64(62))) >> np.int64(11)
    x = np.float64(remainder) * (2.0**-53 * 6.283185307179586)
    z = x * x
    sine_tail = -1.98412698298579493134e-04 + z * (
        2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    )
    sine = x + x * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * sine_tail))
    cosine_tail = 2.48015872894767294178e-05 + z * (
        -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    tail = z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * cosine_tail))
    leading = 1.0 - 0.5 * z
    cosine = leading + (((1.0 - leading) - 0.5 * z) + tail)
    swap = (quarter & 1) != 0
    first = cosine if swap else sine
    second = sine if swap else cosine
    first = -first if (quarter & 2) != 0 else first
    second = -second if ((quarter + 1) & 2) != 0 else second
    return first, second


@inline_njit
def _box_muller(radius_bits, angle_bits):
    """Two independent standard normals from two uint64 (Box, Muller 1958)."""
    # In (0, 1] with steps of 2^-53: the logarithm never sees zero, and the largest normal is 8.57.
    uniform = (np.float64(np.int64(radius_bits >> np.uint64(11))) + 1.0) * 2.0**-53
    radius = np.sqrt(-2.0 * logarithm(uniform))
    sine, cosine = sine_cosine_of_turn(angle_bits)
    return radius * cosine, radius * sine


@inline_njit
def _random_block(seed, stream, trial, block):
    zero = np.uint64(0)
    return philox4x64(np.uint64(block), np.uint64(stream), np.uint64(trial), zero, np.uint64(seed), zero)


@inline_njit
def fill_normals(seed, stream, first_trial, block, bits, out):
    """Normals 4 block .. 4 block + 3 of the trials first_trial .. first_trial + LANES - 1.

    seed, stream, first_trial, block: non-negative integers. bits: scratch, uint64 (4, LANES). out: (4, LANES), filled.
    """
    # The 128-bit products do not vectorise, hence a loop of their own.
    for lane in range(LANES):
        bits[0, lane], bits[1, lane], bits[2, lane], bits[3, lane] = _random_block(
            seed, stream, first_trial + lane, block
        )
    for lane in range(LANES):
        out[0, lane], out[1, lane] = _box_muller(bits[0, lane], bits[1, lane])
        out[2, lane], out[3, lane] = _box_muller(bits[2, lane], bits[3, lane])


@njit(error_model="numpy", cache=True)
def _normals(seed, stream, trials, count):
    out = np.empty((trials.size, count))
    block_of_normals = np.empty(NORMALS_PER_BLOCK)
    for row in range(trials.size):
        for number in range(count):
            position = number % NORMALS_PER_BLOCK
            if position == 0:
                raw = _random_block(seed, stream, trials[row], number // NORMALS_PER_BLOCK)
                block_of_normals[0], block_of_normals[1] = _box_muller(raw[0], raw[1])
                block_of_normals[2], block_of_normals[3] = _box_muller(raw[2], raw[3])
            out[row, number] = block_of_normals[position]
    return out


def normals(seed, stream, trials, count):
    """Standard normals number 0 .. count - 1 of the given trials: those that compiled code uses, bit for bit.

    seed, stream: non-negative integers. trials: trial numbers, a range or 1-D integer array, in any order. count:
    normals per trial. Returns (len(trials), count). Raises ValueError on a negative or fractional argument.
    """
    trials = np.asarray(trials)
    if trials.size == 0:
        trials = trials.astype(np.int64)
    if trials.ndim != 1 or trials.dtype.kind not in "iu" or (trials < 0).any():
        raise ValueError(f"trials must be a 1-D array of non-negative integers, got {trials!r}")
    for name, value in (("seed", seed), ("stream", stream), ("count", count)):
        if value != int(value) or value < 0:
            raise ValueError(f"{name} must be a non-negative integer, got {value!r}")
    return _normals(np.uint64(seed), np.uint64(stream), trials.astype(np.uint64), int(count))
