import numpy as np
import pytest

from generators import generator
from starts import maximize_from_random_starts as maximize


def quadratic(seed, size):
    matrix = generator(seed).standard_normal((size, size))
    matrix = matrix + matrix.T
    return matrix, lambda points: np.einsum("mi,ij,mj->m", points, matrix, points)


@pytest.mark.parametrize("seed", range(2))
def test_a_quadratic_form_is_largest_at_the_eigenvector_of_its_largest_eigenvalue(seed):
    matrix, function = quadratic(seed, 6)
    eigenvalues, vectors = np.linalg.eigh(matrix)
    value, point = maximize(function, (6,), seed)
    assert value == pytest.approx(eigenvalues[-1], rel=1e-12)
    assert abs(point @ vectors[:, -1]) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("seed", range(2))
def test_a_bilinear_form_of_two_spheres_is_largest_at_its_first_singular_value(seed):
    matrix = generator(seed).standard_normal((6, 2))
    value, _ = maximize(lambda x: np.einsum("mi,ij,mj->m", x[:, :6], matrix, x[:, 6:]), (6, 2), seed)
    assert value == pytest.approx(np.linalg.norm(matrix, 2), rel=1e-12)


def test_every_random_start_may_lose_and_the_highest_of_many_maxima_is_found():
    # sum a_i x_i^4 has a local maximum at every +-e_i, the highest of them a_6.
    weights = np.array([1.0, 1.02, 1.04, 1.06, 1.08, 1.1])
    value, point = maximize(lambda x: x**4 @ weights, (6,), 3, polished=60)
    assert value == pytest.approx(1.1, rel=1e-12)
    np.testing.assert_allclose(np.abs(point), np.eye(6)[5], atol=1e-8)


def test_the_value_is_that_at_the_point_and_the_point_is_in_the_set():
    _, function = quadratic(7, 8)
    value, point = maximize(function, (6, 2), 1, full_ball=(False, True))
    assert value == function(point[None])[0]
    assert np.linalg.norm(point[:6]) == pytest.approx(1.0, abs=1e-14)
    assert np.linalg.norm(point[6:]) <= 1 + 1e-14


def test_a_maximum_inside_a_ball_is_found_there_and_one_beyond_it_on_the_boundary():
    def peak(center):
        return lambda x: x[:, 0] - np.sum((x[:, 3:] - center) ** 2, axis=1)

    inside, beyond = np.array([0.3, -0.2]), np.array([1.2, -0.9])
    value, point = maximize(peak(inside), (3, 2), 1, full_ball=(False, True))
    assert value == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(point, [1, 0, 0, *inside], atol=1e-7)
    value, point = maximize(peak(beyond), (3, 2), 1, full_ball=(False, True))
    assert value == pytest.approx(1 - 0.5**2, abs=1e-12)  # the centre is 1.5 away from the origin
    np.testing.assert_allclose(point[3:], beyond / 1.5, atol=1e-7)
    on_the_circle, _ = maximize(peak(inside), (3, 2), 1)
    assert on_the_circle == pytest.approx(1 - (1 - np.hypot(0.3, 0.2)) ** 2, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_every_ascent_of_a_wavy_function_ends_where_nothing_rises(seed):
    phases = generator(9).standard_normal(3)
    _, point = maximize(
        lambda x: np.cos(5 * x + phases).sum(axis=1), (3,), seed, (True,), starts=1, polished=1, iterations=60
    )
    gradient = -5 * np.sin(5 * point + phases)
    if np.linalg.norm(point) > 1 - 1e-9:
        assert gradient @ point >= 0
        gradient -= (gradient @ point) * point
    np.testing.assert_allclose(gradient, 0, atol=2e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_long_step_to_the_boundary_is_taken_back(seed):
    # The first step sees a slope without curvature; the boundary is higher than the start, and the maximum before it.
    value, point = maximize(
        lambda x: x[:, 0] - np.exp(60 * (x[:, 0] - 0.97)) / 60, (1,), seed, (True,), starts=1, polished=1, iterations=60
    )
    assert value == pytest.approx(0.97 - 1 / 60, abs=1e-8)
    assert point[0] == pytest.approx(0.97, abs=1e-4)


def test_newton_steps_converge_quadratically():
    matrix, function = quadratic(2, 6)
    largest = np.linalg.eigvalsh(matrix)[-1]
    errors = [largest - maximize(function, (6,), 2, iterations=count, polished=1)[0] for count in range(4)]
    # The error of the value is the square of that of the point, and that is cubed by each step on a quadratic form.
    assert errors[0] > 1e-3 * largest
    assert errors[1] < 0.3 * errors[0]
    assert errors[3] < 1e-12 * largest
