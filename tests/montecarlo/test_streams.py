import numpy as np
import pytest
from numba import njit
from scipy import stats

from marsedl.montecarlo import streams
from marsedl.montecarlo.lanes import LANES
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, _box_muller, fill_normals, normals, philox4x64, uniforms


@njit(error_model="numpy")
def raw_blocks(counters, keys):
    out = np.empty_like(counters)
    for i in range(counters.shape[0]):
        c, k = counters[i], keys[i]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = philox4x64(c[0], c[1], c[2], c[3], k[0], k[1])
    return out


@njit(error_model="numpy")
def pair(radius_bits, angle_bits):
    return _box_muller(radius_bits, angle_bits)


@njit(error_model="numpy")
def group_of_normals(seed, stream, first_trial, blocks):
    bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
    out = np.empty((blocks, NORMALS_PER_BLOCK, LANES))
    for block in range(blocks):
        fill_normals(seed, stream, first_trial, block, bits, out[block])
    return out.reshape(-1, LANES).T


def test_raw_blocks_are_those_of_numpy():
    rng = np.random.default_rng(1)
    counters = rng.integers(0, 2**64, (50, 4), dtype=np.uint64)
    keys = rng.integers(0, 2**64, (50, 2), dtype=np.uint64)
    counters[0], keys[0] = 0, 0
    counters[1, 0] = 2**64 - 1
    for counter, key, ours in zip(counters, keys, raw_blocks(counters, keys), strict=True):
        # numpy increments its counter (least significant word first) before the first block
        number = sum(int(word) << (64 * i) for i, word in enumerate(counter)) - 1
        generator = np.random.Philox(counter=number % 2**256, key=int(key[0]) + (int(key[1]) << 64))
        np.testing.assert_array_equal(ours, generator.random_raw(4))


def test_extreme_bits_give_finite_normals():
    top = np.uint64(2**64 - 1)
    assert pair(np.uint64(0), np.uint64(0)) == (pytest.approx(np.sqrt(106 * np.log(2.0)), rel=1e-15), 0.0)
    assert pair(top, top) == (0.0, 0.0)
    assert np.isfinite(pair(np.uint64(0), top)).all()


def test_group_equals_the_oracle_bit_for_bit():
    group = group_of_normals(9, 1, 1234, 25)
    np.testing.assert_array_equal(group, normals(9, 1, range(1234, 1234 + LANES), 100))


def test_every_normal_is_a_pure_function():
    table = normals(5, 1, range(200), 37)
    np.testing.assert_array_equal(normals(5, 1, [150, 3, 150], 10), table[[150, 3, 150], :10])
    distinct = np.concatenate(
        [table.ravel(), normals(5, 0, range(200), 37).ravel(), normals(6, 1, range(200), 37).ravel()]
    )
    assert np.unique(distinct).size == distinct.size


def test_normals_are_normal_in_the_middle_and_in_the_tails():
    z = normals(2024, 1, range(20_000), 100)
    count = z.size
    assert abs(z.mean()) < 4.0 / np.sqrt(count)
    assert abs(z.var() - 1.0) < 4.0 * np.sqrt(2.0 / count)
    assert abs((z**3).mean()) < 4.0 * np.sqrt(15.0 / count)
    assert abs((z**4).mean() - 3.0) < 4.0 * np.sqrt(96.0 / count)
    for position in range(NORMALS_PER_BLOCK):
        assert stats.kstest(z[:, position::NORMALS_PER_BLOCK].ravel()[:200_000], "norm").pvalue > 1e-3
    many = normals(2025, 1, range(100_000), 100)
    for threshold in (3.0, 4.0, 4.75):
        for beyond in (many > threshold, many < -threshold):
            expected = stats.poisson(many.size * stats.norm.sf(threshold))
            assert 5e-4 < expected.cdf(beyond.sum()) < 1.0 - 5e-4


def test_normals_are_independent_within_a_block_and_across_trials_streams_and_seeds():
    z = normals(7, 1, range(100_000), 8)
    other_normals = [z[:, i] for i in range(1, 8)]
    other_normals += [
        np.roll(z[:, 0], 1),
        normals(7, 0, range(100_000), 1)[:, 0],
        normals(8, 1, range(100_000), 1)[:, 0],
    ]
    first = z[:, 0]
    for other in other_normals:
        for a, b in ((first, other), (first**2, other**2), (np.abs(first), other)):
            assert abs(np.corrcoef(a, b)[0, 1]) < 4.5 / np.sqrt(first.size)
    # sums over a whole path have the right spread only if all its numbers are independent
    sums = normals(11, 1, range(5_000), 400).sum(axis=1) / 20.0
    assert stats.kstest(sums, "norm").pvalue > 1e-3


def test_uniforms_are_uniform_and_never_at_an_end():
    values = uniforms(7, 2, np.arange(20_000), 3)
    assert values.min() > 0.0
    assert values.max() < 1.0
    for column in values.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 4 / np.sqrt(len(values))


def test_plain_python_draws_the_bits_of_compiled_code():
    arguments = (2**64 - 5, 3, [0, 5, 2**40], 101)
    with np.errstate(over="ignore"):
        plain = [
            function.__wrapped__(*streams._checked(*arguments)) for function in (streams._normals, streams._uniforms)
        ]
    for drawn, own in zip(plain, (normals(*arguments), uniforms(*arguments)), strict=True):
        np.testing.assert_array_equal(drawn, own)
