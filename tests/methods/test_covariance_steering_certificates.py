"""Convex programs that know nothing of the Riccati equation bound the cost from above and converge to it."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from marsedl.methods.covariance_steering.closed_form import steer
from marsedl.papers.powered_descent.beyond.held_control import covariance_certificate, mean_certificate

INTERVALS = (25, 50, 100)


@pytest.mark.parametrize(
    ("segment", "excess", "largest_distance"),
    [(0, (7.3e-4, 1.8e-4, 4.6e-5), 9.2e-3), (1, (1.3e-4, 3.3e-5, 8.2e-6), 9e-4)],
)
def test_held_mean_control_costs_more_by_order_two(descent, steerings, segment, excess, largest_distance):
    problem, steering = descent.problem(segment), steerings[segment]
    certificates = [mean_certificate(problem, intervals) for intervals in INTERVALS]
    ratios = np.array([program.cost for program in certificates]) / steering.mean_cost - 1
    np.testing.assert_allclose(ratios, excess, rtol=0.02)  # two digits
    np.testing.assert_allclose(np.log2(ratios[:-1] / ratios[1:]), 2, atol=0.02)
    np.testing.assert_allclose(certificates[-1].mean[[0, -1]], [problem.initial_mean, problem.final_mean], atol=1e-9)
    difference = certificates[-1].mean - CubicSpline(steering.time, steering.mean)(certificates[-1].time)
    assert np.linalg.norm(difference[:, :2], axis=1).max() < largest_distance
    step = descent.durations[segment] / 100
    assert certificates[-1].cost == pytest.approx(step * np.sum(certificates[-1].control ** 2), rel=1e-12)


@pytest.mark.parametrize(
    ("segment", "excess", "variance"),
    [(0, (3.3e-2, 1.5e-2, 7.3e-3), 133.51), (1, (0.143, 6.3e-2, 2.95e-2), 11.318)],
)
def test_held_feedback_costs_more_by_order_one(descent, segment, excess, variance):
    problem = descent.axis(segment, 1)
    steering = steer(problem)
    certificates = [covariance_certificate(problem, intervals) for intervals in INTERVALS]
    ratios = np.array([program.cost for program in certificates]) / steering.covariance_cost - 1
    np.testing.assert_allclose(ratios, excess, rtol=0.015)  # two digits
    orders = np.log2(ratios[:-1] / ratios[1:])
    assert ((orders > 0.95) & (orders < 1.25)).all()
    assert max(program.lossless_gap for program in certificates) < 1e-5  # of the solver: the relaxation is tight
    assert {program.status for program in certificates} == {"optimal"}
    finest = certificates[-1]
    assert finest.covariance[50, 0, 0] == pytest.approx(variance, abs=6e-3)
    np.testing.assert_allclose(finest.covariance[0], problem.initial_covariance, rtol=1e-6, atol=1e-6)
    gain = CubicSpline(steering.time, steering.gain)(finest.time[:-1])
    assert np.abs(finest.gain - gain)[:90].max() < 0.06 * np.abs(gain).max()


def test_too_few_intervals_are_an_error(descent):
    with pytest.raises(ValueError, match="cannot steer"):
        mean_certificate(descent.problem(0), 1)
    with pytest.raises(RuntimeError, match=r"with the status 'infeasible' .* after \d+ iterations, with residuals"):
        covariance_certificate(descent.axis(1, 1), 1)
    with pytest.raises(ValueError, match="at least 1"):
        mean_certificate(descent.problem(0), 0)
