import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.models.dynamics.powered_descent import mass_flow_constant, powered_descent_rates, thrust_magnitude
from three_ways import check_three_ways

GRAVITY, ALPHA = 3.71, 4.85e-4


def broadcast_rates(*arguments):
    return powered_descent_rates(arguments[:5], arguments[5:7], arguments[7:9], arguments[9], arguments[10])


def fly(state, thrust, duration):
    def rates(t, y):
        return powered_descent_rates(y, thrust, (0.0, 0.0), GRAVITY, ALPHA)

    return solve_ivp(rates, (0, duration), state, method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]


def test_mass_flow_constant_is_the_printed_one():
    assert mass_flow_constant(210.0, 9.81) == pytest.approx(4.8541e-4, abs=5e-9)  # printed 4.85e-4


def test_numba_casadi_and_numpy_agree():
    random = np.random.default_rng(1)
    low = np.array([-500, -500, -90, -90, 900, -2e4, -2e4, -2e3, -2e3, 1, 1e-4])
    high = np.array([500, 500, 90, 90, 1500, 2e4, 2e4, 2e3, 2e3, 10, 1e-3])
    arguments = random.uniform(low, high, (200, 11)).T
    # Rounding only: a few units in the last place (multiply-add may be fused, or a division made a multiplication).
    check_three_ways(broadcast_rates, arguments, rtol=5e-15, atol=1e-14, scaled=False, to_the_bit=False)


def test_rates_at_one_point_by_hand():
    rates = powered_descent_rates((10.0, 20.0, 3.0, -4.0, 1000.0), (3000.0, 4000.0), (100.0, -50.0), 3.71, 5e-4)
    # |(3000, 4000)| = 5000: the disturbance accelerates, but burns nothing
    assert rates == pytest.approx((3.0, -4.0, 3.1, 3.95 - 3.71, -2.5), rel=1e-15)


def test_ballistic_arc():
    t = 12.4
    end = fly([250.0, 500.0, 46.985, -17.101, 1500.0], (0.0, 0.0), t)
    expected = [250 + 46.985 * t, 500 - 17.101 * t - GRAVITY * t**2 / 2, 46.985, -17.101 - GRAVITY * t, 1500]
    np.testing.assert_allclose(end, expected, rtol=1e-13, atol=1e-10)  # quadratic in time: rounding only


def test_constant_thrust_is_the_rocket_equation():
    thrust, t, mass = 12000.0, 20.0, 1500.0
    flow = ALPHA * thrust
    end_mass = mass - flow * t
    velocity = np.log(mass / end_mass) / ALPHA - GRAVITY * t
    height = (t - end_mass / flow * np.log(mass / end_mass)) / ALPHA - GRAVITY * t**2 / 2
    end = fly([0.0, 0.0, 0.0, 0.0, mass], (0.0, thrust), t)
    np.testing.assert_allclose(end, [0, height, 0, velocity, end_mass], rtol=1e-11)  # of the integrator


def test_zero_thrust_has_a_finite_derivative():
    casadi.GlobalOptions.setNumpyMode(-1)
    thrust = casadi.SX.sym("thrust", 2)
    magnitude = thrust_magnitude(thrust[0], thrust[1])
    gradient = casadi.Function("gradient", [thrust], [casadi.gradient(magnitude, thrust)])
    assert gradient([0, 0]).full().ravel().tolist() == [0, 0]
    np.testing.assert_allclose(gradient([3, -4]).full().ravel(), [0.6, -0.8], rtol=1e-15)
    assert thrust_magnitude(0.0, 0.0) < 1e-100
