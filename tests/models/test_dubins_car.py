import numpy as np
from scipy.integrate import solve_ivp

from marsedl.models.dynamics.dubins_car import dubins_car_rates
from three_ways import check_three_ways


def test_numba_casadi_and_numpy_agree():
    arguments = np.random.default_rng(1).uniform(-3, 3, (5, 100))
    check_three_ways(dubins_car_rates, arguments, scaled=False)


def test_a_constant_turn_rate_drives_a_circle_counter_clockwise():
    speed, turn_rate, time = 2.0, 0.7, 1.9
    drive = solve_ivp(lambda t, y: dubins_car_rates(*y, turn_rate, speed), (0, time), [1.0, -1.0, 0.4], rtol=1e-11)
    radius, turned = speed / turn_rate, 0.4 + turn_rate * time
    x = 1.0 + radius * (np.sin(turned) - np.sin(0.4))
    y = -1.0 - radius * (np.cos(turned) - np.cos(0.4))
    np.testing.assert_allclose(drive.y[:, -1], [x, y, turned], rtol=0, atol=1e-6)
