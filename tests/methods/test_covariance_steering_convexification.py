import numpy as np
import pytest
from scipy.optimize import minimize

from marsedl.methods.covariance_steering.convexification import Step, classify, successive_convexification

# ---- how a sequence ends ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0], ("stopped", 0)),
        ([1.0, 2.0], ("stopped", 0)),
        ([1.0, 1.05], ("converged", 1)),
        ([1.0, 2.0, 1.0], ("stopped", 0)),  # one period and a half
        ([1.0, 2.0, 1.0, 2.0], ("cycling", 2)),
        ([5.0, 1.0, 2.0, 1.05, 1.95], ("cycling", 2)),
        ([1.0, 2.0, 1.0, 2.2], ("stopped", 0)),  # only one of both repeats
        ([1.0, 2.0, 3.0, 1.0, 2.0, 3.0], ("cycling", 3)),
        ([1.0, 2.0, 3.0, 1.0, 2.0], ("stopped", 0)),
        ([1.0, 2.0, 1.0, 2.0, 2.0], ("converged", 1)),  # what it did before does not count
        ([2.0, 2.0, 2.0, 2.0], ("converged", 1)),  # and no cycle of any period
        ([1.0, np.inf], ("stopped", 0)),
    ],
)
def test_classification(values, expected):
    assert classify(np.array(values)[:, np.newaxis], [0.1]) == expected


def test_every_quantity_has_its_tolerance():
    values = np.array([[1.0, 100.0], [1.05, 101.0]])
    assert classify(values, [0.1, 2.0]) == ("converged", 1)
    assert classify(values, [0.1, 0.5]) == classify(values, [0.01, 2.0]) == ("stopped", 0)


def test_a_drift_below_the_tolerance_is_judged_by_neighbours():
    """Each value is compared with the one a period before, not with the first."""
    drifting = np.arange(8)[:, np.newaxis] * 0.09
    assert classify(drifting, [0.1]) == ("converged", 1)
    drifting += np.tile([0.0, 1.0], 4)[:, np.newaxis]
    assert classify(drifting, [0.1]) == ("stopped", 0)
    assert classify(drifting, [0.2]) == ("cycling", 2)


# ---- the driver ------------------------------------------------------------------------------------------------------


def rotation(period):
    """A step that turns a plane vector by a fraction of a circle and monitors its first component."""
    angle = 2 * np.pi / period
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def step(control):
        following = turn @ control
        return Step(following, following[:1], {"from": control})

    return step


@pytest.mark.parametrize("period", [2, 3, 5])
def test_cycles_are_found_after_two_periods(period):
    run = successive_convexification(rotation(period), [1.0, 0.3], iterations=50, tolerances=[1e-9])
    assert (run.outcome, run.period) == ("cycling", period)
    assert len(run.results) == len(run.monitored) == 2 * period and len(run.control) == 2 * period + 1


def overshooting(branches):
    """Minimize |x - 1| + 0.1 x^2 by steps of at most 0.3, with the value of one or of both branches of the modulus."""

    def step(x):
        side = np.sign(x[0] - 1.0) or 1.0
        signs = (side,) if branches == 1 else (1.0, -1.0)
        candidates = x[0] + np.linspace(-0.3, 0.3, 6001)
        bound = np.max([sign * (candidates - 1.0) for sign in signs], axis=0) + 0.1 * candidates**2
        best = candidates[[np.argmin(bound)]]
        return Step(best, best, abs(best[0] - 1.0) + 0.1 * best[0] ** 2)

    return step


def test_one_branch_of_a_modulus_cycles_and_both_converge():
    one = successive_convexification(overshooting(1), [0.25], iterations=40, tolerances=[1e-6])
    assert (one.outcome, one.period) == ("cycling", 2)
    assert np.ptp(one.control[-3:, 0]) == pytest.approx(0.3, abs=1e-3)
    both = successive_convexification(overshooting(2), [0.25], iterations=40, tolerances=[1e-6])
    assert both.outcome == "converged"
    assert both.control[-1, 0] == pytest.approx(1.0, abs=1e-3)
    assert both.results[-1] < min(one.results[-2:])


def test_sequential_programs_reach_the_optimum_of_a_curved_problem():
    """Rosenbrock's valley by trust-region steps on Gauss-Newton models, against a general-purpose optimizer."""

    def residual(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def step(x):
        jacobian = np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])
        move = np.linalg.solve(jacobian, -residual(x))
        move /= max(1.0, np.abs(move).max() / 0.2)
        return Step(x + move, residual(x + move), None)

    run = successive_convexification(step, [-1.2, 1.0], iterations=200, tolerances=[1e-10, 1e-10])
    assert run.outcome == "converged" and len(run.results) < 60
    expected = minimize(lambda x: residual(x) @ residual(x), [-1.2, 1.0], tol=1e-12).x
    np.testing.assert_allclose(run.control[-1], expected, atol=1e-5)
    assert np.abs(np.diff(run.control, axis=0)).max() <= 0.2 + 1e-12


# ---- refusals --------------------------------------------------------------------------------------------------------
