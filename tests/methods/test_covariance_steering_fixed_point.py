"""Algorithm 1, printed and repaired, against the closed form."""

from dataclasses import replace

import numpy as np
import pytest

from marsedl.methods.covariance_steering.closed_form import (
    equivalent_squared_noise_density,
    predicted_covariance,
    riccati_initial,
)
from marsedl.papers.powered_descent.beyond.algorithm_1 import fixed_point

GAMMA, FULL_THRUST = 0.02, 18000.0


def iterate(problem, gamma=GAMMA, **options):
    phi = problem.transition[-1]
    gramian = phi @ problem.gramian[-1] @ phi.T  # M(T,0) of Eq. 48
    return fixed_point(phi, gramian, (problem.initial_covariance, problem.final_covariance), gamma, **options)


def final_variances(problem, riccati, plant_noise_density):
    return np.diag(predicted_covariance(problem, riccati, plant_noise_density, problem.initial_covariance)[-1])


@pytest.mark.parametrize(
    ("segment", "order", "iterations"),
    [(0, "gauss_seidel", 39), (1, "gauss_seidel", 19), (0, "jacobi", 66), (1, "jacobi", 34)],
)
def test_corrected_iteration_reaches_the_closed_form(descent, segment, order, iterations):
    problem = descent.problem(segment)
    result = iterate(problem, control_unit=FULL_THRUST, order=order)
    assert (result.converged, result.iterations, result.status) == (True, iterations, "converged")
    assert result.last_change < 1e-10
    closed = riccati_initial(problem)
    # The step is not the error: it leaves up to tolerance / (1 - rate).
    np.testing.assert_allclose(result.riccati_initial, closed, rtol=0, atol=1e-9 * np.abs(closed).max())


def slow_fixed_point(phi, gramian, weight_0, weight_t, passes):
    """Corrected Algorithm 1 in plain matrices, Jacobi order: the oracle of the kernel."""
    q = p = np.eye(len(phi))
    back, inverse = np.linalg.inv(phi), np.linalg.inv
    for _ in range(passes):
        p_t = phi @ p @ phi.T + gramian
        q_t = inverse(weight_t - inverse(p_t))
        q, p = back @ (q_t + gramian) @ back.T, inverse(weight_0 - inverse(q))
    return q, p


def test_kernel_agrees_with_plain_matrices(descent):
    problem, scale = descent.problem(1), FULL_THRUST**2
    phi = problem.transition[-1]
    weights = [GAMMA**2 * np.linalg.inv(x) for x in (problem.initial_covariance, problem.final_covariance)]
    for passes in (1, 2, 7):
        q, p = slow_fixed_point(phi, phi @ problem.gramian[-1] @ phi.T * scale, *weights, passes)
        result = iterate(problem, control_unit=FULL_THRUST, order="jacobi", maximum_iterations=passes)
        assert (result.iterations, result.converged) == (passes, False)
        assert "limit" in result.status
        np.testing.assert_allclose(result.q_initial, q, rtol=0, atol=1e-10 * np.abs(q).max())
        np.testing.assert_allclose(result.p_initial, p, rtol=0, atol=1e-10 * np.abs(p).max())


def test_full_matrices_are_inverted_with_row_exchange():
    # A coupled problem whose iterates need pivoting: checked by the boundary conditions themselves.
    random = np.random.default_rng(5)
    phi = np.array([[0.0, 1, 0.2], [1, 0, 0.3], [0.1, -0.2, 1]])
    root = random.standard_normal((3, 3))
    gramian, start, end = root @ root.T + np.eye(3), np.diag([1.0, 2, 3]), np.diag([2.0, 1, 2])
    result = fixed_point(phi, gramian, (start, end), 2.0, tolerance=1e-13)
    assert result.converged
    inverse = np.linalg.inv
    p_t = phi @ result.p_initial @ phi.T + gramian
    q_t = phi @ result.q_initial @ phi.T - gramian
    np.testing.assert_allclose(inverse(result.p_initial) + inverse(result.q_initial), 4 * inverse(start), atol=1e-9)
    np.testing.assert_allclose(inverse(p_t) + inverse(q_t), 4 * inverse(end), atol=1e-9)


@pytest.mark.parametrize("boundary", ["algorithm_1", "eq_46"])
@pytest.mark.parametrize("segment", [0, 1])
def test_printed_boundaries_are_a_design_for_another_noise(descent, segment, boundary):
    problem = descent.problem(segment)
    squared = equivalent_squared_noise_density(GAMMA, FULL_THRUST, boundary)
    assert squared == pytest.approx({"algorithm_1": 50, "eq_46": 2500}[boundary] * FULL_THRUST**2)
    result = iterate(problem, control_unit=FULL_THRUST, boundary=boundary)
    other = riccati_initial(replace(problem, noise_density=np.sqrt(squared)))
    assert result.converged
    np.testing.assert_allclose(result.riccati_initial, other, rtol=0, atol=1e-9 * np.abs(other).max())
    # With the noise of the plant the covariance misses the target by orders of magnitude.
    variances = final_variances(problem, result.riccati_initial, GAMMA * FULL_THRUST)
    assert (variances < 1e-4 * np.diag(problem.final_covariance)).all()


@pytest.mark.parametrize("kind", ["relative", "absolute"])
@pytest.mark.parametrize(
    ("slower", "start", "end"), [("p_initial", [1.0, 2.0], [2.0, 1.0]), ("q_initial", [0.01, 0.01], [2.0, 2.0])]
)
def test_the_iteration_stops_when_the_slower_of_both_matrices_is_within_the_tolerance(slower, start, end, kind):
    def run(**options):
        start_covariance, end_covariance = np.diag(start), np.diag(end)
        return fixed_point(
            np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2), (start_covariance, end_covariance), 2.0, **options
        )

    def change(iteration, name):
        before, after = (
            getattr(run(tolerance=0.0, maximum_iterations=count), name) for count in (iteration - 1, iteration)
        )
        return np.linalg.norm(after - before) / (np.linalg.norm(after) if kind == "relative" else 1.0)

    tolerance, (faster,) = 1e-6, {"p_initial", "q_initial"} - {slower}
    stopped = run(tolerance=tolerance, tolerance_kind=kind)
    last = stopped.iterations
    assert stopped.converged
    assert change(last - 1, slower) > tolerance > change(last, slower) > 5 * change(last, faster)
    assert stopped.last_change == pytest.approx(change(last, slower), rel=1e-6)


def test_corrected_iteration_in_newtons_does_not_converge(descent):
    result = iterate(descent.problem(0), maximum_iterations=20_000)
    assert (result.converged, result.iterations) == (False, 20_000)
    assert "limit" in result.status


def test_singular_start_is_reported():
    # The weight at the end equals P(T)^-1 exactly.
    result = fixed_point(np.eye(2), np.eye(2), (np.eye(2), 2 * np.eye(2)), 1.0)
    assert not result.converged
    assert "singular" in result.status
