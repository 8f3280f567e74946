from dataclasses import replace

import numpy as np
import pytest

from marsedl.methods.sensitivity import POINTS
from marsedl.methods.sensitivity_gains import GainProblem, final_errors, gain_matrix, linearized, minimum_norm
from marsedl.papers.desensitized.gain_search import rank, regularized, tune


def jacobian(problem, k):
    """The derivative of the final errors that the searches use, (p c, m f)."""
    return linearized(problem, k)[1]


def random_problem(seed=3, **changes):
    """A smooth, time-varying system of 5 states and 2 controls; 3 states are measured."""
    random = np.random.default_rng(seed)
    intervals, n, m = 30, 5, 2
    time = np.linspace(0, 1, intervals)[:, None, None]
    constant = random.standard_normal((n, n)) - 0.5 * np.eye(n)
    fields = {
        "state_matrix": constant + np.sin(3 * time) * random.standard_normal((n, n)),
        "control_matrix": random.standard_normal((n, m)) + time * random.standard_normal((n, m)),
        "step": random.uniform(0.03, 0.09, intervals),
        "columns": random.standard_normal((n, 2)),
        "outputs": random.standard_normal((2, n)),
        "fed_back": [3, 0, 4],
        "state_scale": np.array([0.5, 2.0, 1.0]),
        "control_scale": np.array([3.0, 0.2]),
    }
    return GainProblem(**(fields | changes))


def one_column(seed=3):
    """Two errors of one perturbation; six gains."""
    problem = random_problem(seed)
    return replace(problem, columns=problem.columns[:, 1:])


def small_gains():
    return np.random.default_rng(8).uniform(-0.3, 0.3, (2, 3))


def integrator(intervals=20, duration=2.0, **changes):
    """x'' = u, the position perturbed, measured and wanted."""
    fields = {
        "state_matrix": np.tile([[0.0, 1.0], [0.0, 0.0]], (intervals, 1, 1)),
        "control_matrix": np.tile([[0.0], [1.0]], (intervals, 1, 1)),
        "step": duration / intervals,
        "columns": [[1.0], [0.0]],
        "outputs": [[1.0, 0.0]],
        "fed_back": [0],
        "state_scale": [1.0],
    }
    return GainProblem(**(fields | changes))


def beacons(**changes):
    """x'' = u, of which the gains act on two constants, 1 and 2, so that the errors are linear in the gains.

    At the end of T = 2: x = x0 + (k_1 + 2 k_2) T^2/2, v = (k_1 + 2 k_2) T, which the midpoint rule integrates exactly.
    """
    state_matrix = np.zeros((10, 4, 4))
    state_matrix[:, 0, 1] = 1
    fields = {
        "state_matrix": state_matrix,
        "control_matrix": np.tile([[0.0], [1.0], [0.0], [0.0]], (10, 1, 1)),
        "columns": [[5.0], [0.0], [1.0], [2.0]],
        "outputs": [[1.0, 0.0, 0.0, 0.0]],
        "fed_back": [2, 3],
        "state_scale": [1.0, 1.0],
    }
    return integrator(10, **(fields | changes))


def errors_step_by_step(problem, k):
    """The printed recursion with explicit inverses and sums, also for complex gains."""
    intervals, n, m = problem.control_matrix.shape
    gain = np.zeros((m, n), dtype=complex)
    for a in range(m):
        for i, state in enumerate(problem.fed_back):
            gain[a, state] = problem.control_scale[a] * k[a, i] / problem.state_scale[i]
    sensitivity = problem.columns.astype(complex)
    for j in range(intervals):
        half = problem.step[j] / 2 * (problem.state_matrix[j] + problem.control_matrix[j] @ gain)
        sensitivity = np.linalg.inv(np.eye(n) - half) @ ((np.eye(n) + half) @ sensitivity)
    return problem.outputs @ sensitivity


def row_space_defect(problem, k):
    """Part of k outside of the row space of the Jacobian: zero where k is a stationary point of its norm."""
    rows = np.linalg.svd(jacobian(problem, k), full_matrices=False)[2]
    return np.linalg.norm(k.ravel() - rows.T @ (rows @ k.ravel()))


# What a gain does


def test_final_errors_are_those_of_the_recursion_step_by_step():
    problem, k = random_problem(), small_gains()
    expected = errors_step_by_step(problem, k)
    assert np.abs(expected.imag).max() == 0
    np.testing.assert_allclose(final_errors(problem, k), expected.real, rtol=0, atol=1e-12)
    assert np.abs(final_errors(problem, k) - final_errors(problem, 0.0)).max() > 0.1


def test_the_jacobian_is_that_of_the_complex_step():
    problem, k = random_problem(), small_gains()
    columns = []
    for i in range(k.size):
        shift = np.zeros(k.size, dtype=complex)
        shift[i] = 1e-30j
        columns.append(errors_step_by_step(problem, k + shift.reshape(k.shape)).imag.ravel() / 1e-30)
    np.testing.assert_allclose(jacobian(problem, k), np.transpose(columns), rtol=0, atol=1e-12)


def test_dimensionless_gains_do_not_depend_on_the_units_of_states_and_controls():
    problem, k = random_problem(), small_gains()
    state, control = np.array([1e3, 57.3, 0.01, 3.6, 1e-4]), np.array([1e3, 57.3])
    other = replace(
        problem,
        state_matrix=problem.state_matrix * state[:, None] / state,
        control_matrix=problem.control_matrix * state[:, None] / control,
        columns=problem.columns * state[:, None],
        outputs=problem.outputs / state,
        state_scale=problem.state_scale * state[problem.fed_back],
        control_scale=problem.control_scale * control,
    )
    np.testing.assert_allclose(final_errors(other, k), final_errors(problem, k), rtol=1e-11)
    np.testing.assert_allclose(jacobian(other, k), jacobian(problem, k), rtol=1e-9)
    np.testing.assert_allclose(
        gain_matrix(other, k), gain_matrix(problem, k) * control[:, None] / state, rtol=1e-14, atol=0
    )


def test_without_a_gain_on_a_state_that_enters_no_rate_its_column_stays_to_the_last_bit():
    problem = random_problem()
    state_matrix = problem.state_matrix.copy()
    state_matrix[:, :, 3] = 0
    ignorable = replace(problem, state_matrix=state_matrix, columns=np.eye(5)[:, 3:4], outputs=np.eye(5))
    k = np.array([[0, 0.7, -2], [0, 3, 1.0]])  # the first measured state is the ignorable one
    assert (final_errors(ignorable, k)[:, 0] == np.eye(5)[3]).all()
    slope = jacobian(ignorable, k).reshape(5, 2, 3)
    assert (slope[:, :, 1:] == 0).all()
    assert (np.abs(slope[:, :, 0]).max(axis=0) > 1e-3).all()


# The smallest gains that null the errors


def test_an_oscillator_is_tuned_to_a_quarter_of_its_period():
    # u = k x gives x_j = cos(j theta) with h sqrt(-k) / 2 = tan(theta / 2); null after N intervals if N theta = pi / 2.
    design = minimum_norm(integrator(20, 2.0), step_limit=10.0)
    assert design.converged
    np.testing.assert_allclose(design.k, [[-((2 / 0.1 * np.tan(np.pi / 80)) ** 2)]], rtol=1e-12)


def test_linear_errors_have_the_pseudo_inverse_as_their_solution_after_one_step():
    design = minimum_norm(beacons(), step_limit=10.0)
    # k_1 + 2 k_2 = -5 / 2 with the gains in proportion 1 : 2
    np.testing.assert_allclose(design.k, [[-0.5, -1.0]], rtol=1e-13)
    assert design.converged
    assert design.iterations == 2


def test_the_smallest_gains_null_the_errors_and_lie_in_the_row_space_of_the_jacobian():
    problem = one_column()
    design = minimum_norm(problem)
    assert design.converged
    assert np.abs(errors_step_by_step(problem, design.k)).max() < 1e-12
    assert np.abs(final_errors(problem, 0.0)).max() > 0.1
    assert row_space_defect(problem, design.k) < 1e-9
    # Newton's method without the choice nulls the errors as well, but not with the smallest gains.
    k = np.array([0.5, -0.2, 0.3, 0.1, 0.4, -0.3])
    for _ in range(20):
        k = k - np.linalg.pinv(jacobian(problem, k)) @ final_errors(problem, k).ravel()
    assert np.abs(final_errors(problem, k)).max() < 1e-12
    assert row_space_defect(problem, k) > 0.1
    assert np.linalg.norm(k) > np.linalg.norm(design.k) + 0.1


def test_every_solution_nearby_has_larger_gains():
    problem = one_column()
    k = minimum_norm(problem).k.ravel()
    null_space = np.linalg.svd(jacobian(problem, k))[2][2:]
    assert len(null_space) == 4
    for direction in [*null_space, *-null_space]:
        solution = k + 0.03 * direction
        for _ in range(5):
            slope, errors = jacobian(problem, solution), final_errors(problem, solution).ravel()
            solution = solution - np.linalg.pinv(slope) @ errors
        assert np.abs(final_errors(problem, solution)).max() < 1e-12
        assert np.linalg.norm(solution) > np.linalg.norm(k) + 1e-5


def test_where_whole_steps_go_back_and_forth_shorter_ones_converge():
    problem = one_column(seed=43)
    k, steps = np.zeros(6), []
    for _ in range(300):
        slope = jacobian(problem, k)
        expected = np.linalg.pinv(slope) @ (slope @ k - final_errors(problem, k).ravel()) - k
        steps.append(expected * min(1, 0.1 / np.linalg.norm(expected)))
        k = k + steps[-1]
    np.testing.assert_allclose(steps[-1], -steps[-2], rtol=0, atol=1e-6)
    assert np.linalg.norm(steps[-1]) == pytest.approx(0.1)

    design = minimum_norm(problem)
    assert design.converged
    assert row_space_defect(problem, design.k) < 1e-9
    assert np.abs(errors_step_by_step(problem, design.k)).max() < 1e-12


def test_what_no_gain_can_null_is_reported():
    # Columns of an uncontrollable state: the error stays what it is, whatever the gains.
    problem = beacons(outputs=[[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    design = minimum_norm(problem)
    assert not design.converged
    assert "errors of norm 2 remain" in design.reason
    assert "2 errors has rank 1 of 2" in design.reason
    np.testing.assert_allclose(design.errors, [[0], [2]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(design.k, [[-0.5, -1.0]], rtol=1e-12)


def switched():
    """x'' = u whose control acts one way and the other, so that it moves the final position by nothing in all.

    The position's column is (1, 0) at k = 0, for the position enters no rate: only its own gain acts there, in vain.
    """
    control_matrix = np.zeros((16, 2, 1))
    control_matrix[:, 1, 0] = [1, -1, -1, 1] * 4
    return integrator(16, 2.0, control_matrix=control_matrix, fed_back=[0, 1], state_scale=[1.0, 1.0])


def test_a_start_at_which_no_gain_acts_is_reported_and_another_start_helps():
    problem = switched()
    assert (jacobian(problem, 0.0) == 0).all()
    stuck = minimum_norm(problem)
    assert not stuck.converged
    assert "errors of norm 1 remain" in stuck.reason
    assert "rank 0 of 1" in stuck.reason
    assert (stuck.k == 0).all()
    design = minimum_norm(problem, [-0.3, 0.0])
    assert design.converged
    assert np.abs(errors_step_by_step(problem, design.k)).max() < 1e-12


def test_a_rank_deficient_jacobian_does_not_stop_a_start_from_which_steps_remain():
    # Position, speed and acceleration; the position enters no rate, so that at k = 0 only its gain moves the errors.
    chain = GainProblem(
        state_matrix=np.tile(np.eye(3, k=1), (20, 1, 1)),
        control_matrix=np.tile(np.eye(3)[:, 2:], (20, 1, 1)),
        step=0.1,
        columns=np.eye(3)[:, :1],
        outputs=np.eye(3)[:2],
        fed_back=[0, 1, 2],
        state_scale=np.ones(3),
    )
    assert np.linalg.matrix_rank(jacobian(chain, 0.0)) == 1
    design = minimum_norm(chain, iterations=1000)
    assert np.linalg.matrix_rank(jacobian(chain, design.k)) == 2
    assert design.converged
    assert np.abs(errors_step_by_step(chain, design.k)).max() < 1e-10


def test_too_few_steps_are_reported():
    design = minimum_norm(beacons(), iterations=2)
    assert not design.converged
    assert design.iterations == 2
    assert design.reason.startswith("2 steps did not suffice: the last step wanted is still 1.02 long")
    np.testing.assert_allclose(np.linalg.norm(design.k), 0.2, rtol=1e-12)


def test_gains_that_overflow_are_reported():
    problem = integrator(100, 10.0)
    k = 400 * (1 - 1e-6)  # every interval multiplies the state by four million
    design = minimum_norm(problem, k)
    assert not design.converged
    assert design.reason.startswith("the errors are not finite after 0 steps")
    assert design.iterations == 0
    with pytest.raises(ValueError, match="start: the errors are not finite"):
        regularized(problem, [0.1], k)


# Errors against the size of the gains


def test_linear_errors_have_the_solution_of_ridge_regression():
    for weight, design in zip((1.0, 0.1), regularized(beacons(), [1.0, 0.1]), strict=True):
        row = np.array([2.0, 4.0])  # T^2/2 times the constants
        np.testing.assert_allclose(design.k[0], -5 * row / (row @ row + weight), rtol=1e-7)
        assert design.converged


def test_regularized_gains_are_stationary_for_several_columns_at_once():
    problem = random_problem()
    weights = [1.0, 0.1, 0.01]
    designs = regularized(problem, weights)
    for weight, design in zip(weights, designs, strict=True):
        assert design.converged
        slope, errors = jacobian(problem, design.k), final_errors(problem, design.k).ravel()
        # The gains are found to a relative 1e-10, and the gradient changes with them by |J|^2.
        rounding = 1e-10 * np.linalg.norm(slope, 2) ** 2 * np.linalg.norm(design.k)
        assert np.abs(slope.T @ errors + weight * design.k.ravel()).max() < rounding
        assert np.abs(slope.T @ errors).max() > 100 * rounding
    sizes = [np.linalg.norm(design.k) for design in designs]
    remaining = [np.linalg.norm(design.errors) for design in designs]
    assert sizes[0] < sizes[1] < sizes[2]
    assert remaining[0] > remaining[1] > remaining[2]


def test_regularized_gains_approach_the_smallest_that_null_the_errors():
    problem = one_column()
    smallest = minimum_norm(problem).k
    designs = regularized(problem, [10, 1, 0.1])
    distances = [np.linalg.norm(design.k - smallest) for design in designs]
    # First order in the weight, from the smaller side.
    np.testing.assert_allclose(np.divide(distances[:-1], distances[1:]), 10, rtol=0.01)
    assert all(np.linalg.norm(design.k) < np.linalg.norm(smallest) for design in designs)


# Nonlinear tuning


DURATION, SUBSTEPS = 3.0, 4


def swings(starts, gains, intervals=30):
    """Final angles of pendulums (theta'' = -sin theta + u) under feedback to the nominal; the last is the nominal."""
    state = np.concatenate([starts, [[0.5, 1.0]]]).T
    gain = np.concatenate([gains, [[0.0, 0.0]]]).T
    states, h = [state[:, -1]], DURATION / intervals / SUBSTEPS

    def rates(s):
        return np.array([s[1], -np.sin(s[0]) + np.sum(gain * (s - s[:, -1:]), axis=0)])

    for j in range(intervals * SUBSTEPS):
        k1 = rates(state)
        k2 = rates(state + h / 2 * k1)
        k3 = rates(state + h / 2 * k2)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3))
        if (j + 1) % SUBSTEPS == 0:
            states.append(state[:, -1])
    return state[0], np.array(states)


def pendulum(intervals=30):
    """Angle after a perturbed start, along the nominal swing; the angle alone is measured."""
    nominal = swings(np.zeros((0, 2)), np.zeros((0, 2)), intervals)[1]
    state_matrix = np.zeros((intervals, 2, 2))
    state_matrix[:, 0, 1], state_matrix[:, 1, 0] = 1, -np.cos((nominal[1:, 0] + nominal[:-1, 0]) / 2)
    return integrator(intervals, DURATION, state_matrix=state_matrix)


def batch_of_angle_errors(ks, sizes=(-0.8, -0.2, 0.2, 0.8), intervals=30):
    """Simulated errors of the final angle per perturbation of the first, (b, 4), for gains (b, 1, 1)."""
    gains = np.reshape(ks, (-1, 1)) * [1, 0]
    starts = np.array([0.5, 1.0]) + np.outer(sizes, [1, 0])
    final, _ = swings(np.tile(starts, (len(gains), 1)), np.repeat(gains, len(sizes), axis=0), intervals)
    return (final[:-1] - final[-1]).reshape(len(gains), -1) / np.abs(sizes)


def angle_errors(k):
    return batch_of_angle_errors(k)[0]


def test_the_linear_errors_are_those_of_small_simulated_perturbations():
    k, errors = -0.3, []
    for intervals in (30, 60, 120):
        simulated = batch_of_angle_errors(k, (1e-4, -1e-4), intervals)[0] @ [0.5, -0.5]
        errors.append(final_errors(pendulum(intervals), k)[0, 0] - simulated)
    # What is left is the error of the midpoint rule.
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.05)
    assert abs(errors[-1]) < 1e-3


def test_tuned_gains_are_a_minimum_of_the_simulated_errors_below_the_linear_design():
    linear = minimum_norm(pendulum())
    assert linear.converged
    tuned = tune(angle_errors, linear.k)
    assert tuned.converged
    assert tuned.k.shape == (1, 1)
    assert (tuned.errors == angle_errors(tuned.k)).all()
    around = [np.linalg.norm(angle_errors(tuned.k + shift)) for shift in (-1e-3, 0, 1e-3)]
    assert around[1] < min(around[0], around[2])
    slope = (angle_errors(tuned.k + 1e-4) - angle_errors(tuned.k - 1e-4)) / 2e-4
    assert abs(slope @ tuned.errors) < 1e-7
    assert abs(slope @ angle_errors(linear.k)) > 1e-2

    # What the linear design gains for small perturbations it loses for large ones.
    candidates = [np.zeros((1, 1)), linear.k, tuned.k]
    order = rank(candidates, lambda k: batch_of_angle_errors(k, (-0.01, 0.01))[0])
    assert order.tolist() == [1, 2, 0]
    order = rank(candidates, angle_errors)
    assert order.tolist() == [2, 0, 1]


def test_tuning_finds_the_minimum_of_a_curved_valley():
    tuned = tune(lambda k: [10 * (k[1] - k[0] ** 2), 1 - k[0]], [-1.2, 1.0])
    assert tuned.converged
    np.testing.assert_allclose(tuned.k, [1, 1], rtol=1e-9)


def test_trial_steps_into_failing_simulations_are_shortened():
    # A full first step from 3 would lead to -0.3, beyond the edge.
    def errors(k):
        return np.log(k) if k[0] > 0 else np.array([np.nan])

    tuned = tune(errors, [3.0])
    assert tuned.converged
    np.testing.assert_allclose(tuned.k, [1], rtol=1e-9)


def test_failing_simulations_beside_the_gains_end_the_search():
    tuned = tune(lambda k: k + 1 if k[0] <= 0 else k * np.nan, [0.0])
    assert not tuned.converged
    assert tuned.reason == "errors beside the gains of step 0 are not finite"
    assert tuned.k == [0]
    assert tuned.errors == [1]


def test_candidates_without_finite_errors_rank_last():
    answers = {"crash": [1.0, np.inf], "far": [3.0, 4.0], "lost": [np.nan, 0.0], "near": [0.0, 1.0]}
    order = rank(list(answers), answers.get)
    assert order.tolist() == [3, 1, 0, 2]


# Bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"state_matrix": np.ones((30, 5, 4))}, r"state_matrix .* \(N, n, n\), N = 30, n = 5, not \(30, 5, 4\)"),
        ({"outputs": np.full((2, 5), np.nan)}, "outputs has entries that are not finite"),
        ({"state_scale": np.array([1, 0, 1])}, "state_scale must be positive"),
        ({"fed_back": [0, 1, 5]}, r"different states from 0 to 4, not \[0, 1, 5\]"),
    ],
)
def test_a_problem_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        random_problem(**changes)


@pytest.mark.parametrize("scheme", ["trapezoid", "hermite_simpson"])
def test_the_jacobian_of_another_scheme_is_the_limit_of_its_differences(scheme):
    plain, random = random_problem(), np.random.default_rng(2)
    at_points = {
        name: getattr(plain, name)[:, None] + 0.2 * random.standard_normal((30, POINTS[scheme], 1, 1))
        for name in ("state_matrix", "control_matrix")
    }
    problem, k = replace(plain, scheme=scheme, **at_points), small_gains()
    exact, errors = jacobian(problem, k), []
    for distance in (4e-3, 2e-3):
        shifts = distance * np.eye(k.size).reshape(-1, *k.shape)
        differences = [final_errors(problem, k + s) - final_errors(problem, k - s) for s in shifts]
        errors.append(np.abs(np.reshape(differences, (k.size, -1)).T / (2 * distance) - exact).max())
    assert errors[1] < 1e-4 * np.abs(exact).max()
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)
