import numpy as np
import pytest

from generators import generator
from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.linear import (
    additive_growth,
    linear_exact,
    linear_triangle,
    minkowski_shape,
    slice_jacobians,
    whitened_step,
)


def unit(draw, *shape):
    vectors = draw.standard_normal(shape)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def definite(draw, size, *, count=None):
    root = draw.standard_normal((count or 1, size, size)) + 2 * np.eye(size)
    matrices = root @ root.swapaxes(1, 2)
    return matrices if count else matrices[0]


@pytest.fixture
def steps():
    """Five linear steps of four states and two disturbances: Phi, Gamma, P, M_1."""
    draw = generator(1)
    across = np.eye(4) + 0.3 * draw.standard_normal((5, 4, 4))
    return across, 0.3 * draw.standard_normal((5, 4, 2)), definite(draw, 4, count=6), definite(draw, 4)


def alternating_maximum(a, b, draw, starts):
    """Largest |A y + B w|^2 found by maximising over y and w in turn; reached by a pair, so never above the truth."""
    best = 0.0
    for _ in range(starts):
        y, w = unit(draw, a.shape[1]), unit(draw, b.shape[1])
        for _ in range(500):
            y = sphere_maximum(a, b @ w, y)
            w = sphere_maximum(b, a @ y, w)
        best = max(best, np.sum((a @ y + b @ w) ** 2))
    return best


def sphere_maximum(matrix, offset, start):
    """An ascent step of |matrix z + offset|^2 on the unit sphere: it is convex, so its gradient's direction is one."""
    step = matrix.T @ (matrix @ start + offset)
    return step / np.linalg.norm(step)


def test_whitened_step_gives_the_value_of_the_moved_deviation(steps):
    across, response, shapes, _ = steps
    draw = generator(2)
    y, w, rho = unit(draw, 50, 4), unit(draw, 50, 2), 0.7
    deviations = np.sqrt(2 * rho) * np.linalg.solve(np.linalg.cholesky(shapes[0]).T, y.T)
    np.testing.assert_allclose(np.sum(deviations * (shapes[0] @ deviations), axis=0) / 2, rho, rtol=1e-12)
    moved = across[0] @ deviations + response[0] @ w.T
    a, b = whitened_step(across[0], response[0], shapes[0], shapes[1])
    np.testing.assert_allclose(
        np.sum((np.sqrt(rho) * a @ y.T + b @ w.T) ** 2, axis=0), np.sum(moved * (shapes[1] @ moved), axis=0) / 2
    )


def test_exact_level_is_reached_by_a_deviation_and_a_disturbance(steps):
    across, response, shapes, _ = steps
    levels = linear_exact(across, response, shapes, 0.7)
    draw = generator(3)
    for k in range(5):
        a, b = whitened_step(across[k], response[k], shapes[k], shapes[k + 1])
        reached = alternating_maximum(np.sqrt(levels[k]) * a, b, draw, starts=4)
        np.testing.assert_allclose(levels[k + 1], reached, rtol=1e-8)
        assert levels[k + 1] >= reached * (1 - 1e-12)


def test_exact_level_of_aligned_and_of_orthogonal_effects():
    across, shapes = np.diag([0.9, 0.2])[None], np.tile(np.eye(2), (2, 1, 1))
    aligned, orthogonal = np.array([[[0.3], [0.0]]]), np.array([[[0.0], [0.3]]])
    b = 0.3 / np.sqrt(2)
    np.testing.assert_allclose(linear_exact(across, aligned, shapes, 0.25)[1], (0.45 + b) ** 2, rtol=1e-8)
    # y = (cos, sin): 0.45^2 cos^2 + (0.1 |sin| + b)^2 has its maximum where 2 (0.45^2 - 0.1^2) sin = 2 0.1 b.
    sine = 0.1 * b / (0.45**2 - 0.1**2)
    expected = 0.45**2 * (1 - sine**2) + (0.1 * sine + b) ** 2
    np.testing.assert_allclose(linear_exact(across, orthogonal, shapes, 0.25)[1], expected, rtol=1e-8)


def test_exact_level_without_disturbance_is_an_eigenvalue(steps):
    across, _, shapes, _ = steps
    inverse = np.linalg.inv(shapes[0])
    largest = np.linalg.eigvals(inverse @ across[0].T @ shapes[1] @ across[0]).real.max()
    levels = linear_exact(across[:1], np.zeros((1, 4, 0)), shapes[:2], 0.7)
    np.testing.assert_allclose(levels[1], 0.7 * largest, rtol=1e-10)
    np.testing.assert_allclose(linear_exact(across[:1], np.zeros((1, 4, 2)), shapes[:2], 0.7), levels, rtol=1e-12)
    np.testing.assert_allclose(linear_triangle(across[:1], np.zeros((1, 4, 0)), shapes[:2], 0.7), levels, rtol=1e-12)


def test_triangle_is_never_below_exact_and_equal_for_one_state(steps):
    across, response, shapes, _ = steps
    exact, triangle = linear_exact(across, response, shapes, 0.7), linear_triangle(across, response, shapes, 0.7)
    assert (triangle[1:] > exact[1:] * 1.001).all()
    scalar = across[:, :1, :1], response[:, :1, :1], shapes[:, :1, :1]
    np.testing.assert_allclose(linear_triangle(*scalar, 0.7), linear_exact(*scalar, 0.7), rtol=1e-8)


def test_minkowski_shape_contains_the_reachable_set_and_is_the_least_of_its_kind(steps):
    across, response, _, initial_set = steps
    scales = np.array([1.0, 0.1, 3.0, 0.5])
    shapes = minkowski_shape(across, response, initial_set, scales)
    ellipsoids = 2 * np.linalg.inv(shapes)
    draw = generator(5)
    directions = unit(draw, 500, 4)
    for k in range(5):
        moved, pushed = across[k] @ ellipsoids[k] @ across[k].T, response[k] @ response[k].T
        sets = ellipsoids[k + 1], moved, pushed
        widths = [np.sqrt(np.einsum("mi,ij,mj->m", directions, matrix, directions)) for matrix in sets]
        assert (widths[0] >= (widths[1] + widths[2]) * (1 - 1e-12)).all()
        p = np.geomspace(1e-3, 1e3, 2001)[:, None]
        traces = ((1 + p) * np.diag(moved) + (1 + 1 / p) * np.diag(pushed)) @ scales**-2.0
        trace = np.diag(ellipsoids[k + 1]) @ scales**-2.0
        np.testing.assert_allclose(trace, traces.min(), rtol=1e-5)
        assert trace <= traces.min() * (1 + 1e-12)
    # At p the dual of the exact level is 1 in all directions: the shape is tight in the end.
    np.testing.assert_allclose(linear_exact(across, response, shapes, 1.0), 1, rtol=1e-9)


def test_minkowski_shape_without_disturbance_moves_the_initial_set(steps):
    across, _, _, initial_set = steps
    shapes = minkowski_shape(across, np.zeros((5, 4, 0)), initial_set, np.ones(4))
    total = np.linalg.multi_dot(across[::-1])
    np.testing.assert_allclose(shapes[-1], np.linalg.inv(total).T @ initial_set @ np.linalg.inv(total), rtol=1e-7)
    with pytest.raises(ValueError, match="scales must be positive; entry 1 is 0"):
        minkowski_shape(across, np.zeros((5, 4, 0)), initial_set, np.array([1.0, 0.0, 1.0, 1.0]))


def test_additive_growth_is_the_largest_value_that_the_disturbance_causes(steps):
    _, _, shapes, _ = steps
    draw = generator(6)
    responses, amplitudes = draw.standard_normal((5, 4, 4)), np.array([0.5, 2.0, 0.01, 1.0])
    growth = additive_growth(responses, shapes[1:], amplitudes)
    for k in range(5):
        ends = responses[k] @ (amplitudes * unit(draw, 100_000, 4)).T
        values = np.einsum("im,ij,jm->m", ends, shapes[k + 1], ends) / 2
        assert 0.99 * growth[k] < values.max() <= growth[k] * (1 + 1e-12)
    with pytest.raises(ValueError, match="P of slice 3 is not positive definite"):
        additive_growth(responses, [np.eye(4), -np.eye(4), np.eye(4), np.eye(4), np.eye(4)], amplitudes)


def test_slice_jacobians_are_those_of_the_flow():
    def rates(half_index, state, control, disturbance):
        return np.sin(state[1]) + disturbance[0] * state[0], control[0] * np.cos(state[0])

    count = 12
    draw = generator(7)
    loop = ClosedLoop(
        rates,
        np.linspace(0, 1, count + 1),
        draw.standard_normal((2 * count + 1, 2)),
        draw.standard_normal((2 * count + 1, 1)),
        draw.standard_normal((2 * count + 1, 1, 2)),
        1,
    )
    slices = np.array([0, 5, 12])
    jacobians = slice_jacobians(loop, slices)
    assert [value.shape for value in jacobians] == [(2, 2, 2), (2, 2, 1), (2, 2, 2)]
    step = 1e-30j
    for k, (first, last) in enumerate(((0, 5), (5, 12))):
        for column, direction in enumerate(np.eye(5)):
            moved = loop.flow(
                first, last, list(direction[:2] * step), list(direction[2:3] * step), list(direction[3:] * step)
            )
            derivative = np.imag(moved) / 1e-30
            np.testing.assert_allclose(
                np.concatenate([j[k] for j in jacobians], axis=1)[:, column], derivative, rtol=1e-10
            )
