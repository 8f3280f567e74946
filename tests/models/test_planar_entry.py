import casadi
import numpy as np
from scipy.integrate import solve_ivp

from marsedl.models.dynamics.longitudinal_entry import longitudinal_entry_rates
from marsedl.models.dynamics.planar_entry import planar_entry_rates
from three_ways import check_three_ways

BALLISTIC_COEFFICIENT, LIFT_TO_DRAG, MU = 150.0, 0.2, 4.2828e13
DRAG_FACTOR = 1 / (2 * BALLISTIC_COEFFICIENT)
LIFT_FACTOR = LIFT_TO_DRAG / (2 * BALLISTIC_COEFFICIENT)


def random_arguments(count):
    """Arguments of `planar_entry_rates`, (8, count)."""
    random = np.random.default_rng(5)
    low = [3.42e6, 3000, -0.4, -1, 1e-9, 1e-3, 1e-4, 4e13]
    high = [3.55e6, 7000, 0.4, 1, 1e-3, 5e-3, 2e-3, 5e13]
    return random.uniform(low, high, (count, 8)).T


def test_numba_casadi_and_numpy_agree():
    check_three_ways(planar_entry_rates, random_arguments(200))


def test_longitudinal_entry_has_the_same_rates_to_the_last_bit():
    for point in random_arguments(50).T:
        radius, velocity, path, cosine, density, *constants = point
        longitudinal = longitudinal_entry_rates(
            (radius, velocity, path, 1e5, density), cosine, 2e-4, 1e-4, 2e-4, *constants
        )
        assert longitudinal[:3] == planar_entry_rates(*point)


def test_rates_are_those_of_a_point_mass_in_cartesian_coordinates():
    for point in random_arguments(50).T:
        radius, speed, path, cosine, density, drag, lift, mu = point
        # radially outwards, and along the local horizontal
        forward, upward = np.array([np.sin(path), np.cos(path)]), np.array([np.cos(path), -np.sin(path)])
        acceleration = np.array([-mu / radius**2, 0.0]) + density * speed**2 * (lift * cosine * upward - drag * forward)
        # The path angle turns with the velocity vector, and with the local horizontal that it is measured from.
        turn = acceleration @ upward / speed + speed * np.cos(path) / radius
        expected = (speed * forward[0], acceleration @ forward, turn)
        np.testing.assert_allclose(planar_entry_rates(*point), expected, rtol=1e-12, atol=1e-16)


def test_vacuum_flight_keeps_energy_and_angular_momentum():
    def rates(_, state):
        return planar_entry_rates(*state, 0.7, 0.0, DRAG_FACTOR, LIFT_FACTOR, MU)

    start = (3.522e6, 4600.0, 0.2)
    flight = solve_ivp(rates, (0.0, 20e3), start, method="DOP853", rtol=1e-12, atol=1e-9)
    radius, velocity, path = flight.y
    assert radius.max() > 3 * radius.min()
    energy, momentum = velocity**2 / 2 - MU / radius, radius * velocity * np.cos(path)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-10)


def test_jacobian_is_that_of_the_linearisation():
    """The density changes with the radius, and by a relative variation."""
    casadi.GlobalOptions.setNumpyMode(-1)
    scale_height, ground = 9e3, 3397e3

    def density(radius):
        return 0.0158 * np.exp(-(radius - ground) / scale_height)

    state, control, variation = casadi.SX.sym("x", 3), casadi.SX.sym("u"), casadi.SX.sym("v")
    radius, velocity, path = casadi.vertsplit(state)
    rates = planar_entry_rates(
        radius, velocity, path, control, density(radius) * (1 + variation), DRAG_FACTOR, LIFT_FACTOR, MU
    )
    inputs = [state, control, variation]
    jacobians = casadi.Function("J", inputs, [casadi.jacobian(casadi.vertcat(*rates), x) for x in inputs])
    k, ratio = DRAG_FACTOR, LIFT_TO_DRAG
    for r, v, gamma, u, *_ in random_arguments(50).T:
        rho, sine, cosine = density(r), np.sin(gamma), np.cos(gamma)
        slope = -rho / scale_height
        a = [
            [0, sine, v * cosine],
            [-k * slope * v**2 + 2 * MU * sine / r**3, -2 * k * rho * v, -MU * cosine / r**2],
            [
                k * slope * v * ratio * u + (2 * MU / r**3 - v**2 / r**2) * cosine / v,
                k * rho * ratio * u + MU * cosine / (r**2 * v**2) + cosine / r,
                (MU / r**2 - v**2 / r) * sine / v,
            ],
        ]
        b, g = [0, 0, k * rho * v * ratio], [0, -k * rho * v**2, k * rho * v * ratio * u]
        for jacobian, expected in zip(jacobians([r, v, gamma], u, 0), (a, b, g), strict=True):
            expected = np.reshape(expected, jacobian.shape)
            np.testing.assert_allclose(jacobian.full(), expected, rtol=1e-11, atol=1e-20)
