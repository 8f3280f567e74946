import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are

from marsedl.methods.tvlqr import at_half_steps, tvlqr


def random_problem(count=12, nx=3, nu=2):
    random = np.random.default_rng(4)
    weights = [factor @ factor.T + 0.1 * np.eye(len(factor)) for factor in random.standard_normal((2, nx, nx))]
    factor = random.standard_normal((nu, nu))
    return (
        random.standard_normal((count, nx, nx)),
        random.standard_normal((count, nx, nu)),
        random.uniform(0.1, 0.3, count),
        weights[0],
        factor @ factor.T + 0.2 * np.eye(nu),
        weights[1],
    )


def simulated_cost(problem, gains, state):
    """Cost of the discrete loop: the state moved by matrix exponentials, the sums as they stand."""
    state_matrices, control_matrices, steps, state_weight, control_weight, terminal_weight = problem
    cost = 0.0
    for a, b, h, gain in zip(state_matrices, control_matrices, steps, gains, strict=True):
        control = gain @ state
        cost += h * (state @ state_weight @ state + control @ control_weight @ control) / 2
        # Held control as further constant states.
        size = len(control)
        joint = np.block([[a, b], [np.zeros((size, a.shape[0] + size))]])
        state = (expm(h * joint) @ np.concatenate([state, control]))[: len(state)]
    return cost + state @ terminal_weight @ state / 2


def test_value_is_the_cost_of_the_simulated_loop():
    problem = random_problem()
    regulator = tvlqr(*problem)
    assert regulator.gains.shape == (12, 2, 3)
    assert regulator.values.shape == (13, 3, 3)
    np.testing.assert_array_equal(regulator.values, regulator.values.swapaxes(1, 2))
    for state in np.random.default_rng(1).standard_normal((5, 3)):
        expected = simulated_cost(problem, regulator.gains, state)
        assert state @ regulator.values[0] @ state / 2 == pytest.approx(expected, rel=1e-12)


def test_gains_are_a_minimum_of_the_cost():
    problem = random_problem()
    gains = tvlqr(*problem).gains
    random = np.random.default_rng(2)
    states = random.standard_normal((3, 3))

    def cost(change):
        return sum(simulated_cost(problem, gains + change, state) for state in states)

    for change in random.standard_normal((6, *gains.shape)):
        slope = (cost(1e-4 * change) - cost(-1e-4 * change)) / 2e-4
        curvature = (cost(1e-3 * change) + cost(-1e-3 * change) - 2 * cost(0.0)) / 1e-6
        # A slope that was no minimum's would be of the order of the curvature.
        assert curvature > 0.1
        assert abs(slope) < 1e-5 * curvature


def test_held_double_integrator_over_one_step():
    h, r = 0.5, 2.0
    regulator = tvlqr([[[0, 1], [0, 0]]], [[[0], [1]]], [h], np.zeros((2, 2)), [[r]], np.diag([3.0, 5.0]))
    effect = np.array([h**2 / 2, h])
    weight = h * r + 3.0 * effect[0] ** 2 + 5.0 * effect[1] ** 2
    expected = -np.array([3.0 * effect[0], 3.0 * effect[0] * h + 5.0 * effect[1]]) / weight
    np.testing.assert_allclose(regulator.gains[0, 0], expected, rtol=1e-14)


def test_long_horizon_reaches_the_algebraic_riccati_equation():
    a, b, h = np.array([[0.0, 1.0], [0.4, -0.1]]), np.array([[0.0], [1.0]]), 0.1
    state_weight, control_weight = np.diag([2.0, 1.0]), np.array([[0.5]])
    count = 400
    regulator = tvlqr([a] * count, [b] * count, [h] * count, state_weight, control_weight, np.eye(2))
    across = expm(h * np.block([[a, b], [np.zeros((1, 3))]]))
    expected = solve_discrete_are(across[:2, :2], across[:2, 2:], h * state_weight, h * control_weight)
    np.testing.assert_allclose(regulator.values[0], expected, rtol=1e-11)


def test_first_order_convergence_to_the_continuous_riccati_equation():
    state_weight, control_weight, terminal = np.diag([1.0, 2.0]), np.array([[0.7]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    b = np.array([[0.0], [1.0]])

    def a(time):
        return np.array([[0.0, 1.0], [np.sin(2 * time), -0.3 * time]])

    def backward(time, flat):
        value = flat.reshape(2, 2)
        gain = np.linalg.solve(control_weight, b.T @ value)
        rate = state_weight + a(2 - time).T @ value + value @ a(2 - time) - gain.T @ control_weight @ gain
        return rate.ravel()

    truth = solve_ivp(backward, (0, 2), terminal.ravel(), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    errors = []
    for count in (40, 80, 160):
        middles = (np.arange(count) + 0.5) * 2 / count
        regulator = tvlqr(
            [a(t) for t in middles], [b] * count, [2 / count] * count, state_weight, control_weight, terminal
        )
        errors.append(np.abs(regulator.values[0].ravel() - truth).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


def test_gains_at_half_steps():
    gains = np.array([1.0, 3.0, 7.0]).reshape(3, 1, 1)
    np.testing.assert_array_equal(at_half_steps(gains).ravel(), [1, 2, 3, 5, 7, 7, 7])
    assert at_half_steps(np.zeros((5, 2, 3))).shape == (11, 2, 3)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (0, np.full((12, 3, 3), np.nan), "state_matrices must be finite"),
        (1, np.zeros((11, 3, 2)), r"control_matrices \(11, 3, 2\)"),
        (4, np.diag([1.0, 0.0]), "control_weight must be positive definite; .* 0$"),
    ],
)
def test_bad_input_is_named(place, value, message):
    problem = list(random_problem())
    problem[place] = value
    with pytest.raises(ValueError, match=message):
        tvlqr(*problem)
