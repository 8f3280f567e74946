import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from marsedl.methods.covariance_steering.steering_program import BlockSystem, closed_loop
from marsedl.methods.lincov import compose, discretize, propagate
from marsedl.methods.state_trigger import trigger_projection, trigger_time_variance, velocity_indexed_gain


def state_matrix(t):
    return np.array([[-0.3, 1.0 + 0.5 * np.sin(t), 0.0], [-1.2, -0.1 * t, 0.4], [0.2 * np.cos(2 * t), 0.0, -0.5]])


def control_matrix(t):
    return np.array([[0.2, 0.1], [np.cos(t), 0.0], [0.3 * t, np.sin(t)]])


def noise_intensity(t):
    vector = np.array([0.3, 0.1 * t, np.exp(-t)])
    return np.outer(vector, vector)


def discretized(intervals, substeps, duration=2.0):
    """The system above over equal intervals; sampled in the middle of the sub-steps."""
    length = duration / intervals
    middles = length * (np.arange(intervals)[:, None] + (np.arange(substeps) + 0.5) / substeps)
    return discretize(
        *(
            np.array([[function(t) for t in row] for row in middles])
            for function in (state_matrix, control_matrix, noise_intensity)
        ),
        np.full(intervals, length),
    )


@pytest.fixture(scope="module")
def integrated():
    """Transition, control effect and noise of [0, 2] by an adaptive integrator of Eqs. 37 to 39."""

    def rates(t, flat):
        transition, control, noise = flat[:9].reshape(3, 3), flat[9:15].reshape(3, 2), flat[15:].reshape(3, 3)
        a = state_matrix(t)
        return np.concatenate(
            [
                (a @ transition).ravel(),
                (a @ control + control_matrix(t)).ravel(),
                (a @ noise + noise @ a.T + noise_intensity(t)).ravel(),
            ]
        )

    start = np.concatenate([np.eye(3).ravel(), np.zeros(15)])
    end = solve_ivp(rates, (0, 2), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return end[:9].reshape(3, 3), end[9:15].reshape(3, 2), end[15:].reshape(3, 3)


def test_discretization_is_of_second_order(integrated):
    errors = np.array(
        [
            [np.abs(field[0] - exact).max() for field, exact in zip(discretized(1, s)[:3], integrated, strict=True)]
            for s in (40, 80, 160)
        ]
    )
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(2, abs=0.06)
    assert errors[-1].max() < 1e-4


def test_transition_and_control_of_a_constant_system_are_of_third_order():
    a, b = state_matrix(0.7), control_matrix(0.7)
    whole = expm(2 * np.block([[a, b], [np.zeros((2, 5))]]))
    errors = []
    for s in (8, 16, 32):
        system = discretize(np.tile(a, (1, s, 1, 1)), np.tile(b, (1, s, 1, 1)), np.zeros((1, s, 3, 3)), [2.0])
        errors.append(
            [np.abs(system.transition[0] - whole[:3, :3]).max(), np.abs(system.control[0] - whole[:3, 3:]).max()]
        )
    errors = np.array(errors)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(3, abs=0.15)


def test_one_sub_step_of_a_chain_of_integrators_is_exact():
    """Where (Ah)^4 is zero, the series end: they are the exponentials that they stand for."""
    h, a, b, root = 1.5, np.diag([1.3, -0.7, 0.9], 1), np.array([0.4, 1.1, -0.8, 0.0]), np.diag([0.3, 0.5, 0.2, 0.7])
    root[3, :3] = 0.6, -0.4, 0.1
    intensity = root @ root.T
    system = discretize(a[None, None], b[None, None, :, None], intensity[None, None], [h])
    whole, middle = expm(h * np.block([[a, b[:, None]], [np.zeros((1, 5))]])), expm(h / 2 * a)
    expected = whole[:4, :4], whole[:4, 4:], h * middle @ intensity @ middle.T
    for field, exact in zip(system[:3], expected, strict=True):
        np.testing.assert_allclose(field[0], exact, rtol=0, atol=1e-14)


def test_noise_is_symmetric_to_the_last_bit_and_positive():
    noise = discretized(7, 3).noise
    assert np.array_equal(noise, noise.swapaxes(1, 2))
    assert np.linalg.eigvalsh(noise).min() > 0


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"state_matrix": np.zeros((4, 2, 3, 2))}, "state_matrix must have shape"),
        ({"control_matrix": np.zeros((4, 2, 3))}, "control_matrix must have shape"),
        ({"step": np.array([1, 1, 0, 1])}, "step must be positive; entry 2"),
    ],
)
def test_bad_models_are_refused(changes, message):
    good = {
        "state_matrix": np.zeros((4, 2, 3, 3)),
        "control_matrix": np.zeros((4, 2, 3, 1)),
        "noise_intensity": np.zeros((4, 2, 3, 3)),
        "step": np.ones(4),
    }
    with pytest.raises(ValueError, match=message):
        discretize(**(good | changes))


def test_composition_equals_the_same_flight_in_one_piece():
    fine, coarse = discretized(12, 4), compose(discretized(12, 4), [0, 4, 7])
    one = discretized(1, 48)
    for field, expected in zip(compose(fine, [0]), one, strict=True):
        assert np.allclose(field, expected, rtol=0, atol=1e-14)
    for field, again in zip(compose(coarse, [0]), one, strict=True):
        assert np.allclose(field, again, rtol=0, atol=1e-14)
    assert all(np.array_equal(a, b) for a, b in zip(compose(fine, np.arange(12)), fine, strict=True))


def test_covariance_recursion_against_plain_matrix_products():
    system, rng = discretized(10, 2), np.random.default_rng(8)
    gain, expected = rng.normal(size=(10, 2, 3)), np.diag([1.0, 0.0, 3.0])
    covariance, control_covariance = propagate(system, gain, expected)
    assert np.array_equal(covariance, covariance.swapaxes(1, 2))
    for k in range(10):
        np.testing.assert_allclose(control_covariance[k], gain[k] @ expected @ gain[k].T, rtol=1e-12)
        across = system.transition[k] + system.control[k] @ gain[k]
        expected = across @ expected @ across.T + system.noise[k]
        assert np.allclose(covariance[k + 1], expected, rtol=1e-12, atol=1e-14)


def test_white_noise_is_a_case_of_the_feedback_of_all_history():
    """`propagate` steps through the intervals, `closed_loop` stacks them."""
    system, initial = discretized(8, 2), np.diag([1.0, 0.5, 3.0])
    gain = np.random.default_rng(10).normal(size=(8, 2, 3))
    history = np.zeros((8, 9, 2, 3))
    history[np.arange(8), np.arange(8)] = gain
    stacked = closed_loop(BlockSystem.of(system, np.zeros(3), initial), history)
    for one, other in zip(propagate(system, gain, initial), stacked, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


def test_covariance_does_not_depend_on_the_units_of_the_states():
    system, rng, unit = discretized(10, 2), np.random.default_rng(9), np.array([1e3, 1e-4, 7.0])
    gain, initial = rng.normal(size=(10, 2, 3)), np.diag([1.0, 0.5, 3.0])
    scaled = system._replace(
        transition=system.transition / unit[:, None] * unit,
        control=system.control / unit[:, None],
        noise=system.noise / np.outer(unit, unit),
    )
    plain, other = propagate(system, gain, initial), propagate(scaled, gain * unit, initial / np.outer(unit, unit))
    assert np.allclose(other.covariance * np.outer(unit, unit), plain.covariance, rtol=1e-12)
    assert np.allclose(other.control_covariance, plain.control_covariance, rtol=1e-12)


RATES = np.array([-117.4, -3.358, -0.005, 486.0, 5.1e-5])
VELOCITY = np.eye(5)[1]


def test_trigger_projection_keeps_the_state_on_the_surface():
    projection = trigger_projection(RATES, VELOCITY)
    assert np.allclose(projection @ projection, projection, rtol=0, atol=1e-12)
    assert np.abs(VELOCITY @ projection).max() == 0
    assert np.abs(projection @ RATES).max() < 1e-12
    not_velocity = [0, 2, 3, 4]
    assert np.array_equal(projection[:, not_velocity], np.eye(5)[:, not_velocity])
    tilted = trigger_projection(RATES, np.array([1e-3, 1.0, 0.0, 2e-4, 0.0]))
    assert np.allclose(tilted @ tilted, tilted, rtol=1e-12, atol=1e-12)


def test_trigger_moves_a_deviation_along_the_flow_until_the_surface():
    # Straight lines x + t f: the stopping time of every one is known exactly.
    deviation, normal = np.array([40.0, 3.0, 0.01, -900.0, 1e-5]), np.array([2e-3, 1.0, 0.0, 0.0, 0.0])
    delay = -(normal @ deviation) / (normal @ RATES)
    assert trigger_projection(RATES, normal) @ deviation == pytest.approx(deviation + delay * RATES, rel=1e-12)
    assert trigger_time_variance(RATES, normal, np.outer(deviation, deviation)) == pytest.approx(delay**2, rel=1e-12)


def test_a_flow_along_the_surface_has_no_trigger():
    with pytest.raises(ValueError, match="does not cross the trigger surface"):
        trigger_projection(np.array([1.0, 0.0]), np.array([0.0, 1.0]))
    with pytest.raises(ValueError, match="vectors of one length"):
        trigger_time_variance(np.ones(3), np.ones(2), np.eye(2))


def test_velocity_indexed_gain_is_the_derivative_of_the_law_as_flown():
    # A reference with known curves against time, inverted numerically for the law against velocity.
    def reference(t):
        return np.array([100 - 3 * t - 0.1 * t**2, 50 - 2 * t - 0.05 * t**2, 0.3 * t**2])

    def law(state):
        time = 20 * (np.sqrt(1 + (50 - state[1]) / 20) - 1)  # 50 - 2t - t^2/20 = V
        gain = np.array([0.02 + 0.001 * time, -0.03, 0.01 * time])
        return 0.5 - 0.004 * state[1] + gain @ (state - reference(time))

    t, h = 4.0, 1e-5
    difference = [(law(reference(t) + h * e) - law(reference(t) - h * e)) / (2 * h) for e in np.eye(3)]
    rates = np.array([-3 - 0.2 * t, -2 - 0.1 * t, 0.6 * t])
    effective = velocity_indexed_gain([[0.02 + 0.001 * t, -0.03, 0.01 * t]], [rates], 1, [-0.004])
    assert effective[0] == pytest.approx(difference, rel=1e-8)


def test_a_law_against_velocity_needs_a_changing_velocity():
    gain, rates = np.array([[1.0, 2.0], [0.0, 0.0]]), np.array([[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(ValueError, match="stationary at point 0"):
        velocity_indexed_gain(gain, rates, 1, np.zeros(2))
    assert np.array_equal(velocity_indexed_gain(gain[1:], rates[1:], 1, [0.25]), [[0.0, 0.25]])
    with pytest.raises(ValueError, match="do not fit"):
        velocity_indexed_gain(gain, rates[:1], 1, np.zeros(2))
