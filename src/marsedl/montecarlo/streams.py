"""Counter-based random numbers: every normal is a pure function of (seed, stream, trial, number).

Nothing is ever "drawn next", so trial i of a million can be re-run alone, and no result depends on threads, chunks or
order. Streams keep purposes apart: by convention stream 0 is the initial state, stream 1 the process noise, and a paper
names further ones. The same (seed, trial) gives independent numbers in different streams.
"""

import hashlib
import sys
from functools import cache, wraps

import numpy as np

from marsedl.compiling import compiled_when_called, inlined
from marsedl.elementary import logarithm, sine_cosine_of_turn
from marsedl.montecarlo import LANES

NORMALS_PER_BLOCK = 4
_FEW = 10_000  # numbers that Python draws sooner than numba is imported

_PHILOX_ROUNDS = 10
_MULTIPLIER_0 = np.uint64(0xD2E7470EE14C6C93)
_MULTIPLIER_1 = np.uint64(0xCA5A826395121157)
_WEYL_0 = np.uint64(0x9E3779B97F4A7C15)
_WEYL_1 = np.uint64(0xBB67AE8584CAA73B)


@cache
def _product_in_kernels():
    """The product of two words by one machine instruction."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def product_of_words(typing_context, a, b):
        signature = types.UniTuple(types.uint64, 2)(types.uint64, types.uint64)

        def generate(context, builder, signature, arguments):
            word, double_word = ir.IntType(64), ir.IntType(128)
            product = builder.mul(builder.zext(arguments[0], double_word), builder.zext(arguments[1], double_word))
            high = builder.trunc(builder.lshr(product, ir.Constant(double_word, 64)), word)
            return context.make_tuple(builder, signature.return_type, [high, builder.trunc(product, word)])

        return signature, generate

    return lambda a, b: product_of_words(a, b)


def _multiply_high_low(a, b):
    """128-bit product of two uint64 as (high, low) words."""
    product = int(a) * int(b)
    return np.uint64(product >> 64), np.uint64(product & (2**64 - 1))


inlined(_multiply_high_low, _product_in_kernels)


@inlined
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


@inlined
def _box_muller(radius_bits, angle_bits):
    """Two independent standard normals from two uint64 (Box, Muller 1958)."""
    # In (0, 1] with steps of 2^-53: the logarithm never sees zero, and the largest normal is 8.57.
    uniform = (np.float64(np.int64(radius_bits >> np.uint64(11))) + 1.0) * 2.0**-53
    radius = np.sqrt(-2.0 * logarithm(uniform))
    sine, cosine = sine_cosine_of_turn(angle_bits)
    return radius * cosine, radius * sine


@inlined
def _random_block(seed, stream, trial, block):
    zero = np.uint64(0)
    return philox4x64(np.uint64(block), np.uint64(stream), np.uint64(trial), zero, np.uint64(seed), zero)


@inlined
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


@inlined
def fill_one_normal(stream, block, only, first, out):
    """As `fill_normals`, of trials of which each has one normal alone that is not zero.

    only: stream, number and value of that one, (3, trials). first: trial in the first lane.
    """
    for row in range(NORMALS_PER_BLOCK):
        for lane in range(LANES):
            out[row, lane] = 0.0
    for lane in range(LANES):
        number = int(only[1, first + lane])
        if only[0, first + lane] == stream and number // NORMALS_PER_BLOCK == block:
            out[number % NORMALS_PER_BLOCK, lane] = only[2, first + lane]


def one_normal(stream, only, count):
    """Normals number 0 .. count - 1 of these trials, (trials, count), as `fill_one_normal` has them."""
    out = np.zeros((only.shape[1], count))
    mine = np.flatnonzero((only[0] == stream) & (only[1] < count))
    out[mine, only[1, mine].astype(int)] = only[2, mine]
    return out


def _compiled_for_many(function):
    """Compile a function of seed, stream, trials and count, unless few numbers are wanted and numba is not there."""
    compiled = compiled_when_called(function)

    @wraps(function)
    def run(seed, stream, trials, count):
        if "numba" in sys.modules or trials.size * count > _FEW:
            return compiled(seed, stream, trials, count)
        with np.errstate(over="ignore"):  # words wrap
            return function(seed, stream, trials, count)

    return run


@_compiled_for_many
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


@_compiled_for_many
def _uniforms(seed, stream, trials, count):
    out = np.empty((trials.size, count))
    for row in range(trials.size):
        for number in range(count):
            position = number % NORMALS_PER_BLOCK
            if position == 0:
                raw = _random_block(seed, stream, trials[row], number // NORMALS_PER_BLOCK)
            # In the middle of each of 2^52 cells: neither end occurs, and both halves mirror each other.
            out[row, number] = (np.float64(np.int64(raw[position] >> np.uint64(12))) + 0.5) * 2.0**-52
    return out


def key_of(seed):
    """The key that stands for a seed of any size: itself below 2**63, else 63 bits of its hash (SHA-256).

    Two seeds beyond have the same key with a probability of 2**-63.
    """
    if seed < 2**63:
        return int(seed)
    digest = hashlib.sha256(str(int(seed)).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


def normals(seed, stream, trials, count, only=None):
    """Standard normals number 0 .. count - 1 of the given trials: those that compiled code uses, bit for bit.

    seed, stream: non-negative integers. trials: trial numbers, a range or 1-D integer array, in any order. count:
    normals per trial. only: stream, number and value of the one normal of each trial that is not zero, (3, trials), in
    place of those that are drawn. Returns (len(trials), count). Raises ValueError on a negative or fractional argument.
    """
    if only is not None:
        return one_normal(stream, only, count)
    return _normals(*_checked(seed, stream, trials, count))


def uniforms(seed, stream, trials, count):
    """Uniform numbers 0 .. count - 1 within (0, 1) of the given trials; arguments and errors as of `normals`."""
    return _uniforms(*_checked(seed, stream, trials, count))


def _checked(seed, stream, trials, count):
    trials = np.asarray(trials)
    if trials.size == 0:
        trials = trials.astype(np.int64)
    if trials.ndim != 1 or trials.dtype.kind not in "iu" or (trials < 0).any():
        raise ValueError(f"trials must be a 1-D array of non-negative integers, got {trials!r}")
    for name, value in (("seed", seed), ("stream", stream), ("count", count)):
        if value != int(value) or value < 0:
            raise ValueError(f"{name} must be a non-negative integer, got {value!r}")
    return np.uint64(seed), np.uint64(stream), trials.astype(np.uint64), int(count)
