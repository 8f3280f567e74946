"""Closed form of covariance steering; numbers of the descent at the fixed point of its mass iteration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from marsedl.methods.covariance_steering.closed_form import (
    SteeringError,
    SteeringProblem,
    escape_margin,
    predicted_covariance,
    riccati_initial,
    steer,
)

NOISE_DENSITIES = [0.0, 0.02, 1.0, 50.0, 360.0, 2500.0, 1e5]


# --- what any solution must satisfy -----------------------------------------------------------------------------------


@pytest.mark.parametrize("segment", [0, 1])
@pytest.mark.parametrize("noise_density", NOISE_DENSITIES)
def test_both_ends_are_met_at_any_noise_density(descent, segment, noise_density):
    problem = descent.problem(segment, noise_density=noise_density)
    steering = steer(problem)
    scale = np.sqrt(np.diag(problem.final_covariance))
    miss = (steering.covariance[-1] - problem.final_covariance) / np.outer(scale, scale)
    assert np.abs(miss).max() < 1e-8  # cancellation at the largest density; 1e-11 elsewhere
    np.testing.assert_allclose(steering.covariance[0], problem.initial_covariance, rtol=1e-13)
    np.testing.assert_allclose(steering.mean[[0, -1]], [problem.initial_mean, problem.final_mean], atol=1e-8)
    assert np.linalg.eigvalsh(steering.covariance).min() > 0
    assert steering.escape_margin.min() > 0


def test_riccati_is_indefinite_at_low_noise_but_steering_still_exists(descent):
    signs = [np.sign(np.linalg.eigvalsh(riccati_initial(descent.axis(0, 0, noise_density=g)))) for g in (360.0, 0.02)]
    assert signs[0].tolist() == [1, 1]
    assert signs[1].tolist() == [-1, 1]


@pytest.mark.parametrize("segment", [0, 1])
def test_the_other_root_meets_the_ends_but_escapes(descent, segment):
    problem = descent.problem(segment)
    other = riccati_initial(problem, root=+1)
    end = predicted_covariance(problem, other, problem.noise_density, problem.initial_covariance)[-1]
    np.testing.assert_allclose(end, problem.final_covariance, rtol=0, atol=1e-9)
    margin = escape_margin(problem, other)
    assert margin[0] == 1
    assert margin.min() < 0
    with pytest.raises(SteeringError, match="escapes before t ="):
        steer(problem, root=+1)


def test_the_unit_of_control_does_not_matter(descent):
    base = descent.problem(1)
    expected = steer(base)
    for unit in (1000.0, 18000.0):
        scaled = replace(
            base,
            control_matrix=base.control_matrix * unit,
            gramian=base.gramian * unit**2,
            noise_density=base.noise_density / unit,
        )
        steering = steer(scaled)
        np.testing.assert_allclose(steering.gain * unit, expected.gain, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(steering.feedforward * unit, expected.feedforward, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(steering.mean, expected.mean, atol=1e-10)
        np.testing.assert_allclose(steering.covariance, expected.covariance, atol=1e-10)


def test_costs_are_the_integrals_that_they_stand_for(steerings):
    for steering in steerings:
        feedback = np.einsum("kij,kjl,kil->k", steering.gain, steering.covariance, steering.gain)
        effort = np.einsum("ki,ki->k", steering.feedforward, steering.feedforward)
        for density, cost in ((feedback, steering.covariance_cost), (effort, steering.mean_cost)):
            assert CubicSpline(steering.time, density).integrate(0, steering.time[-1]) == pytest.approx(cost, rel=1e-10)


def test_larger_start_covariance_gives_larger_end_covariance(descent):
    problem = descent.problem(1)
    lambda_0, target = riccati_initial(problem), problem.final_covariance
    random = np.random.default_rng(4)
    for _ in range(20):
        extra = np.diag([3.0, 3, 0.5, 0.5]) @ random.standard_normal((4, 4))
        start = problem.initial_covariance + extra @ extra.T
        end = predicted_covariance(problem, lambda_0, problem.noise_density, start)[-1]
        assert np.linalg.eigvalsh(end - target).min() > 0


# --- quadrature -------------------------------------------------------------------------------------------------------


def linear_mass_gramian(t, mass, flow):
    """int_0^t s^k / (mass - flow s)^2 ds for k = 0, 1, 2."""
    mass_at = mass - flow * t
    zero = t / (mass * mass_at)
    one = (flow * t / mass_at + np.log(mass_at / mass)) / flow**2
    two = (mass * (mass / mass_at - 1) + flow * t + 2 * mass * np.log(mass_at / mass)) / flow**3
    return np.array([[two, -one], [-one, zero]])


def test_gramian_converges_with_order_four():
    mass, flow, duration = 1500.0, 60.0, 20.0
    exact = linear_mass_gramian(duration, mass, flow)
    errors = []
    for cells in (20, 40, 80):
        time = np.linspace(0, duration, cells + 1)
        control_matrix = np.array([[0.0], [1.0]]) / (mass - flow * time)[:, None, None]
        problem = SteeringProblem.from_linear_model(
            time,
            (np.eye(2, k=1), control_matrix, np.array([0, -3.71])),
            initial_mean=np.zeros(2),
            final_mean=np.zeros(2),
            initial_covariance=np.eye(2),
            final_covariance=np.eye(2),
            noise_density=1.0,
        )
        errors.append(np.abs(problem.gramian[-1] / exact - 1).max())
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 3.7).all()
    np.testing.assert_allclose(  # constant A and c: exact
        problem.affine_response, np.outer(time**2, [-3.71 / 2, 0]) + np.outer(time, [0, -3.71]), atol=1e-10
    )


def test_varying_state_matrix_converges_with_order_four():
    # A(t) = exp(St) A0 exp(-St) has Phi(t,0) = exp(St) exp((A0 - S)t); neither commutes with the other.
    spin, a_0 = np.array([[0.0, 1], [-1, 0]]), np.array([[-0.3, 0.5], [0.1, 0.2]])
    affine_0, duration = np.array([1.0, -2.0]), 2.0

    def final(cells):
        time = np.linspace(0, duration, cells + 1)
        turn = expm(spin * time[:, None, None])
        problem = SteeringProblem.from_linear_model(
            time,
            (turn @ a_0 @ np.linalg.inv(turn), turn @ np.array([[0.0], [1.0]]), turn @ affine_0),
            initial_mean=np.zeros(2),
            final_mean=np.zeros(2),
            initial_covariance=np.eye(2),
            final_covariance=np.eye(2),
            noise_density=1.0,
        )
        return problem.transition[-1], problem.affine_response[-1]

    turn, step = expm(spin * duration), expm((a_0 - spin) * duration)
    exact = turn @ step, turn @ np.linalg.solve(a_0 - spin, (step - np.eye(2)) @ affine_0)
    errors = np.array([[np.abs(x - y).max() for x, y in zip(final(n), exact, strict=True)] for n in (40, 80, 160)])
    assert (np.log2(errors[:-1] / errors[1:]) > 3.7).all()
    assert errors[-1].max() < 1e-8


def test_ten_millisecond_cells_suffice(descent):
    fine = CubicSpline(descent.grids[1], descent.masses[1])
    problem = descent.problem(1)
    time = np.linspace(0, 15, 15001)
    control_matrix = np.eye(4, 2, k=-2) / fine(time)[:, None, None]
    finer = SteeringProblem.from_linear_model(
        time,
        (descent.state_matrix, control_matrix, descent.affine),
        initial_mean=problem.initial_mean,
        final_mean=problem.final_mean,
        initial_covariance=problem.initial_covariance,
        final_covariance=problem.final_covariance,
        noise_density=problem.noise_density,
        transition=np.eye(4) + descent.state_matrix * time[:, None, None],
    )
    end = predicted_covariance(finer, riccati_initial(problem), problem.noise_density, problem.initial_covariance)[-1]
    np.testing.assert_allclose(np.diag(end), descent.variances[2], rtol=1e-8)


# --- bad input --------------------------------------------------------------------------------------------------------

BAD = {
    "time": lambda p: p.time[::-1],
    "transition": lambda p: p.transition[:, :3],
    "gramian": lambda p: np.where(np.arange(4) == 1, np.nan, p.gramian),
    "affine_response": lambda p: p.affine_response + 1,
    "control_matrix": lambda p: p.control_matrix[0],
    "initial_mean": lambda p: p.initial_mean[:3],
    "final_mean": lambda p: p.final_mean * np.inf,
    "initial_covariance": lambda p: np.diag([1.0, 1, 1, -1]),
    "final_covariance": lambda p: np.triu(np.ones((4, 4))) + np.eye(4),
    "noise_density": lambda p: -1.0,
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # 0 * inf in the bad values themselves
@pytest.mark.parametrize("field", BAD)
def test_bad_fields_are_named(descent, field):
    problem = descent.problem(1)
    with pytest.raises(SteeringError, match=field):
        replace(problem, **{field: BAD[field](problem)})


def test_uncontrollable_model_is_refused(descent):
    problem = descent.problem(1)
    with pytest.raises(SteeringError, match="not controllable"):
        replace(problem, gramian=problem.gramian * [1, 0, 1, 0])
