"""The closed form against the differential equations of the paper, which share no formula with it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from marsedl.methods.covariance_steering.closed_form import riccati_initial, steer
from marsedl.papers.powered_descent.beyond.algorithm_2 import LinearMotion, integrate_forward, modified_index


def motion(descent, problem, segment):
    start = problem.initial_mean, problem.initial_covariance
    return LinearMotion(*descent.model(segment), descent.durations[segment], *start, problem.noise_density)


def forward(descent, problem, segment, riccati, times, **options):
    moved = motion(descent, problem, segment)
    return integrate_forward(moved, riccati, problem.final_mean, times=times, **options)


@pytest.mark.parametrize("segment", [0, 1])
@pytest.mark.parametrize("noise_density", [0.02, 7.0, 360.0, 1e4])
def test_closed_form_solves_the_differential_equations(descent, segment, noise_density):
    problem = descent.problem(segment, noise_density=noise_density)
    steering = steer(problem)
    every = slice(None, None, 100)
    result = forward(descent, problem, segment, steering.riccati[0], steering.time[every])
    # 1e-8 relative at the largest density, where errors of Lambda(0) are amplified most; 1e-10 elsewhere.
    tolerance = 2e-8 if noise_density > 1e3 else 5e-10
    scale = np.sqrt(np.diagonal(steering.covariance[every], axis1=1, axis2=2))
    miss = (result.covariance - steering.covariance[every]) / (scale[:, :, None] * scale[:, None, :])
    assert np.abs(miss).max() < tolerance
    np.testing.assert_allclose(np.diag(result.covariance[-1]), descent.variances[segment + 1], rtol=tolerance)
    largest = np.abs(steering.riccati).max(axis=(1, 2))[every, None, None]
    assert np.abs((result.riccati - steering.riccati[every]) / largest).max() < tolerance
    np.testing.assert_allclose(result.mean, steering.mean[every], atol=1e-7)
    np.testing.assert_allclose(result.mean[-1], problem.final_mean, atol=1e-8)


@pytest.mark.parametrize("segment", [0, 1])
def test_equations_37_and_39_give_the_costate_of_the_closed_form(descent, steerings, segment):
    problem, steering = descent.problem(segment), steerings[segment]
    result = forward(descent, problem, segment, steering.riccati[0], None)
    np.testing.assert_allclose(result.costate_initial_eq37, result.costate_initial_eq39, rtol=1e-9)
    closed = steering.mean_costate + steering.riccati[0] @ problem.initial_mean
    np.testing.assert_allclose(result.costate_initial_eq39, closed, rtol=1e-9)


@pytest.mark.parametrize("segment", [0, 1])
def test_h_and_the_transition_matrices_obey_their_identities(descent, segment):
    problem = descent.problem(segment)
    times = np.linspace(0, descent.durations[segment], 6)
    result = forward(descent, problem, segment, riccati_initial(problem), times)
    h = problem.noise_density**2 * np.linalg.inv(result.covariance) - result.riccati  # definition before Eq. 41
    np.testing.assert_allclose(result.h_matrix, h, rtol=0, atol=1e-9 * np.abs(h).max())
    product = result.adjoint_transition.swapaxes(1, 2) @ result.closed_loop_transition  # Eq. 29
    np.testing.assert_allclose(product, np.tile(np.eye(4), (6, 1, 1)), atol=1e-8)


def test_rounding_error_in_what_is_not_coupled_sets_no_step(descent):
    """The axes meet in the target covariance alone: what is zero at the start stays far below all else."""
    target = np.array([[6, 0.4, -0.3, 0.05], [0.4, 0.5, 0.02, -0.1], [-0.3, 0.02, 0.3, 0.03], [0.05, -0.1, 0.03, 0.2]])
    problem = replace(descent.problem(1, noise_density=540.0), final_covariance=target)
    moved, times = motion(descent, problem, 1), []

    def state_matrix(t):
        times.append(t)
        return moved.state_matrix(t)

    result = integrate_forward(moved._replace(state_matrix=state_matrix), riccati_initial(problem), problem.final_mean)
    np.testing.assert_allclose(result.covariance[-1], target, atol=1e-9)
    assert len(times) < 10_000


def test_finite_escape_is_an_error(descent):
    problem = descent.problem(1)
    with pytest.raises(RuntimeError, match="stopped at t ="), np.errstate(all="ignore"):
        forward(descent, problem, 1, riccati_initial(problem, root=+1), None)


@pytest.fixture(scope="module")
def indices(descent, steerings):
    """Eqs. 18, 20 and 23 under the optimal control, under none, and under a poor linear feedback."""
    problem, steering = descent.problem(1), steerings[1]
    costate = steering.mean_costate + steering.riccati[0] @ problem.initial_mean

    gain, mean = CubicSpline(steering.time, steering.gain), CubicSpline(steering.time, steering.mean)
    thrust = CubicSpline(steering.time, steering.feedforward)
    controls = {
        "optimal": (gain, lambda t: thrust(t) + gain(t) @ mean(t)),
        "none": (lambda t: np.zeros((2, 4)), lambda t: np.zeros(2)),
        "poor": (lambda t: np.eye(2, 4) * 30 + 200 * np.eye(2, 4, k=1), lambda t: np.array([100 * t, 5000.0])),
    }
    return {
        name: modified_index(
            motion(descent, problem, 1), steering.riccati[0], costate, feedback=feedback, feedforward=feedforward
        )
        for name, (feedback, feedforward) in controls.items()
    }


def test_equation_23_drops_a_term_that_does_not_depend_on_the_control(indices):
    dropped = [index.dropped_term for index in indices.values()]
    size = abs(dropped[0])
    assert size > 1e6
    np.testing.assert_allclose(dropped, dropped[0], rtol=1e-9)
    for index in indices.values():
        scale = max(size, abs(index.completed_square))
        assert index.expanded == pytest.approx(index.boundary_form, abs=1e-9 * scale)
        assert index.expanded - index.completed_square == pytest.approx(index.dropped_term, abs=1e-9 * scale)


def test_the_optimal_control_leaves_only_the_noise_term(descent, steerings, indices):
    problem, steering = descent.problem(1), steerings[1]
    r = np.eye(4) - problem.gramian[-1] @ steering.riccati[0]
    noise_term = -(problem.noise_density**2) * np.linalg.slogdet(r)[1]  # G^2 int tr(Lambda B B') dt
    assert indices["optimal"].completed_square == pytest.approx(noise_term, rel=1e-8)
    assert indices["optimal"].cost == pytest.approx(steering.mean_cost + steering.covariance_cost, rel=1e-9)
    for name in ("none", "poor"):
        assert indices[name].completed_square > indices["optimal"].completed_square * 2
