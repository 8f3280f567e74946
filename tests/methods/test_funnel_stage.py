import numpy as np
import pytest

from generators import generator
from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.linear import slice_jacobians, whitened_step
from marsedl.methods.funnels.stage import FunnelStage, lyapunov_rate

P, NEXT = np.diag([2.0, 3.0, 1.5]) + 0.4, np.array([[1.8, 0.3, -0.2], [0.3, 2.5, 0.5], [-0.2, 0.5, 1.2]])


def spheres(count, seed=1, disturbances=2):
    """Points on the spheres of three states and of the disturbances."""
    blocks = [generator(seed + size).standard_normal((count, size)) for size in (3, disturbances)]
    return np.hstack([block / np.linalg.norm(block, axis=1, keepdims=True) for block in blocks])


def turning_loop(steps=40, duration=0.8):
    """A car in uncertain wind with an uncertain turn rate, about an arbitrary reference."""

    def rates(half_index, state, control, disturbance):
        return (
            np.cos(state[2]) + 0.1 * disturbance[0] * np.exp(0.5 * state[1]),
            np.sin(state[2]) - 0.2 * disturbance[1],
            control[0] * (1 + 0.3 * disturbance[0]) + 0.2 * state[0] * disturbance[1],
        )

    half = np.linspace(0, duration, 2 * steps + 1)
    return ClosedLoop(
        rates,
        half[::2],
        np.stack([half, 0.3 * half**2, 0.6 * half], axis=1),
        np.cos(half)[:, None],
        np.stack([-0.2 + 0 * half, -0.5 + half, -1.1 - half], axis=1)[:, None, :],
        2,
    )


def linear_loop(state_matrix, disturbance_matrix, duration=0.5, steps=10):
    """x' = A x + W w about rest, with a control that does nothing."""

    rows = np.hstack([state_matrix, disturbance_matrix]).tolist()

    def rates(half_index, state, control, disturbance):
        return tuple(sum(a * x for a, x in zip(row, [*state, *disturbance], strict=True)) for row in rows)

    size, points = len(state_matrix), 2 * steps + 1
    reference = np.zeros((points, size)), np.zeros((points, 1)), np.zeros((points, 1, size))
    return ClosedLoop(rates, np.linspace(0, duration, steps + 1), *reference, disturbance_matrix.shape[1])


@pytest.fixture
def loop():
    return turning_loop()


def test_points_on_the_sphere_are_on_the_boundary_of_the_slice(loop):
    deviations = FunnelStage(loop, 4, 12, P, NEXT, 0.3).deviations(spheres(300))
    np.testing.assert_allclose(np.einsum("mi,ij,mj->m", deviations, P, deviations) / 2, 0.3, rtol=1e-12)


def test_literal_samples_know_neither_shape_nor_level(loop):
    units = np.array([1000.0, 1.0, 0.1])
    stages = [FunnelStage(loop, 4, 12, shape, NEXT, rho, raw_scale=units) for shape, rho in ((P, 0.3), (NEXT, 2.0))]
    deviations = stages[0].deviations(spheres(300))
    np.testing.assert_allclose(np.sum((deviations / units) ** 2, axis=1), 2, rtol=1e-12)
    np.testing.assert_array_equal(deviations, stages[1].deviations(spheres(300)))
    ratios = np.einsum("mi,ij,mj->m", deviations, P, deviations) / 2 / 0.3
    assert ratios.min() > 10
    assert ratios.max() > 1e5


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_flow_polynomial_is_the_taylor_polynomial_of_the_true_value(loop, order):
    """The coefficients of V along a ray by Cauchy's integral over a complex circle."""
    points = 1.3 * spheres(5)
    stage = FunnelStage(loop, 4, 12, P, NEXT, 0.04, order)
    turns, radius = 64, 0.8
    circle = radius * np.exp(2j * np.pi * np.arange(turns) / turns)[:, None]
    deviations, disturbances = stage.deviations(points), points[:, 3:]
    moved = np.array(loop.flow(4, 12, list(circle * deviations.T[:, None]), list(circle * disturbances.T[:, None])))
    value = np.einsum("ism,ij,jsm->sm", moved, NEXT, moved) / 2 / 0.04
    coefficients = np.real(np.fft.fft(value, axis=0) / turns) / radius ** np.arange(turns)[:, None]
    np.testing.assert_allclose(coefficients[:2], 0, atol=1e-12)
    np.testing.assert_allclose(stage.values(points), coefficients[2 : order + 2].sum(axis=0), rtol=1e-10)
    assert stage.degree == order + 1
    # All of the coefficients is the true value.
    np.testing.assert_allclose(stage.true_values(points), coefficients[:40].sum(axis=0), rtol=1e-9)


@pytest.mark.parametrize("condition", ["flow", "euler"])
def test_values_are_a_polynomial_of_degree_four_that_starts_with_degree_two(loop, condition):
    """Points off the spheres: on every ray, no constant, no linear term, and nothing above degree four."""
    stage = FunnelStage(loop, 4, 12, P, NEXT, 0.04, condition=condition)
    lengths = np.array([-1.7, -1.1, -0.4, 0.3, 0.9, 1.6])
    for point in spheres(4):
        values = stage.values(lengths[:, None] * point)
        fit = np.linalg.solve(lengths[:, None] ** np.array([0, 1, 2, 3, 4, 5]), values)
        np.testing.assert_allclose(fit[[0, 1, 5]], 0, atol=1e-12)
        assert np.abs(fit[2:5]).min() > 1e-7


@pytest.mark.parametrize("order", [1, 2, 3])
def test_truncation_error_has_its_order(loop, order):
    """The first products left out have degree order + 2."""
    stage = FunnelStage(loop, 4, 24, P, NEXT, 0.05, order)
    points = spheres(50)
    errors = [np.abs(stage.values(size * points) - stage.true_values(size * points)).max() for size in (0.2, 0.1, 0.05)]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), order + 2, atol=0.15)


def test_first_order_is_the_linear_step(loop):
    stage = FunnelStage(loop, 4, 12, P, NEXT, 0.3, order=1)
    across, response, _ = slice_jacobians(loop, [4, 12])
    a, b = whitened_step(across[0], response[0], P, NEXT)
    points = spheres(100)
    linear = np.sum((np.sqrt(0.3) * points[:, :3] @ a.T + points[:, 3:] @ b.T) ** 2, axis=1) / 0.3
    np.testing.assert_allclose(stage.values(points), linear, rtol=1e-12)


def test_euler_condition_of_a_cubic_rate():
    """x' = -x^3 + w x about rest: P_2 x^2 / 2 + h P_1 x (-x^3 + w x), exact at order three and cut at order one."""

    def rates(half_index, state, control, disturbance):
        return (-(state[0] ** 3) + disturbance[0] * state[0],)

    loop = ClosedLoop(rates, np.array([0.0, 0.1, 0.3]), np.zeros((5, 1)), np.zeros((5, 1)), np.zeros((5, 1, 1)), 1)
    points = generator(1).standard_normal((20, 2))
    x, w = np.sqrt(2 * 0.6 / 4.0) * points[:, 0], points[:, 1]
    for order, rate in ((3, -(x**3) + w * x), (2, w * x), (1, 0 * x)):
        stage = FunnelStage(loop, 0, 2, [[4.0]], [[5.0]], 0.6, order, condition="euler")
        np.testing.assert_allclose(stage.values(points), (5 * x**2 / 2 + 0.3 * rate * 4 * x) / 0.6, rtol=1e-12)


def test_euler_condition_is_the_level_moved_by_the_lyapunov_rate(loop):
    """V_{k+1}(xb) + h f'P_k xb = V_k + h V' with the divided difference of P, up to what order nine leaves out."""
    stage = FunnelStage(loop, 4, 12, P, NEXT, 0.01, order=9, condition="euler")
    points = 0.5 * spheres(50)
    deviations, step = stage.deviations(points), loop.time[12] - loop.time[4]
    rate = lyapunov_rate(loop, 8, P, (NEXT - P) / step, deviations, points[:, 3:])
    before = np.einsum("mi,ij,mj->m", deviations, P, deviations) / 2
    np.testing.assert_allclose(0.01 * stage.values(points), before + step * rate, rtol=1e-9)


def test_lyapunov_rate_is_the_slope_of_the_value_along_the_motion():
    """Of a system that does not depend on time, whose flow over two short steps about the middle is exact enough."""
    a = np.array([[-0.3, 1.0], [-1.2, -0.1]])
    w_matrix, shape_rate = np.array([[0.2], [0.5]]), np.array([[0.3, -0.1], [-0.1, 0.7]])
    deviations, disturbances = generator(3).standard_normal((20, 2)), generator(4).standard_normal((20, 1))
    loop = linear_loop(a, w_matrix)
    rate = lyapunov_rate(loop, 0, P[:2, :2], shape_rate, deviations, disturbances)
    exact = np.einsum("mi,ij,mj->m", deviations, P[:2, :2] @ a + shape_rate / 2, deviations)
    exact += np.einsum("mi,ij,mj->m", deviations, P[:2, :2] @ w_matrix, disturbances)
    np.testing.assert_allclose(rate, exact, rtol=1e-12, atol=1e-13)

    turning = turning_loop(steps=4000)
    points = 0.4 * spheres(20)
    slopes = []
    for last in (12, 16):
        moved = np.array(turning.flow(10, last, list(points[:, :3].T), list(points[:, 3:].T))).T
        step = turning.time[last] - turning.time[10]
        after = np.einsum("mi,ij,mj->m", moved, P + step * NEXT, moved)
        slopes.append((after - np.einsum("mi,ij,mj->m", points[:, :3], P, points[:, :3])) / 2 / step)
    # The error of the one-sided slope is proportional to the step, which the second one has three times.
    slope = slopes[0] + (slopes[0] - slopes[1]) / 2
    np.testing.assert_allclose(
        lyapunov_rate(turning, 20, P, NEXT, points[:, :3], points[:, 3:]), slope, rtol=1e-5, atol=1e-6
    )


def test_flow_and_euler_differ_by_the_square_of_the_step():
    """Over one short stage from the same slice; P changes along, as it does between slices."""
    points, differences = spheres(200), []
    for steps in (1, 2, 4):
        loop = turning_loop(steps=40, duration=0.2)
        shape = P + (NEXT - P) * steps / 4
        flow, euler = (FunnelStage(loop, 0, steps, P, shape, 0.05, condition=name) for name in ("flow", "euler"))
        differences.append(np.abs(flow.values(points) - euler.values(points)).max())
    np.testing.assert_allclose(np.log2(np.divide(differences[1:], differences[:-1])), 2, atol=0.1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shape": np.diag([1.0, 2.0, -3.0])}, "P at fine step 4 is not positive definite: its least eigenvalue is -3"),
        ({"last": 41}, "from fine step 4 to 41 does not fit"),
    ],
)
def test_stage_refuses_what_makes_no_sense(loop, changes, message):
    arguments = {"first": 4, "last": 12, "shape": P, "next_shape": NEXT, "rho": 0.3} | changes
    with pytest.raises(ValueError, match=message):
        FunnelStage(loop, **arguments)
