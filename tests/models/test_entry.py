import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.elementary import sine_cosine
from marsedl.models.dynamics.entry import entry_rates
from three_ways import check_three_ways

GRAVITATIONAL_PARAMETER, ROTATION_RATE, PLANET_RADIUS = 4.2828e13, 7.0882e-5, 3.397e6


def broadcast_rates(*arguments):
    bank = sine_cosine(arguments[6])
    return entry_rates(arguments[:6], bank, arguments[7], arguments[8:10], arguments[10:12], arguments[12])


def random_arguments(count):
    """Arguments of `entry_rates` away from the poles and from vertical flight, (13, count)."""
    random = np.random.default_rng(3)
    low = [3.4e6, -3, -1.2, 400, -1.2, -3, -3, 0, 1e-3, 1e-4, 4e13, -1e-4, 1]
    high = [3.6e6, 3, 1.2, 6000, 1.2, 3, 3, 0.02, 5e-3, 2e-3, 5e13, 1e-4, 1]
    return random.uniform(low, high, (count, 13)).T


def frame(longitude, latitude):
    """Up, east and north in planet-fixed axes (columns of Eq. 92)."""
    sin_l, cos_l, sin_p, cos_p = np.sin(longitude), np.cos(longitude), np.sin(latitude), np.cos(latitude)
    up = [cos_p * cos_l, cos_p * sin_l, sin_p]
    return np.array([up, [-sin_l, cos_l, 0 * sin_l], [-sin_p * cos_l, -sin_p * sin_l, cos_p]]).T


def inertial(time, state, rotation_rate):
    """Inertial position and velocity of an entry state, planet-fixed and inertial axes agreeing at time 0."""
    radius, longitude, latitude, velocity, path, azimuth = state
    axes = frame(longitude + rotation_rate * time, latitude)
    position = axes @ np.array([radius, 0, 0])
    relative = velocity * np.array([np.sin(path), np.cos(path) * np.sin(azimuth), np.cos(path) * np.cos(azimuth)])
    return position, axes @ relative + np.cross([0, 0, rotation_rate], position)


def test_numba_casadi_and_numpy_agree():
    check_three_ways(broadcast_rates, random_arguments(200))


def test_rates_give_the_inertial_acceleration_of_gravity_lift_and_drag():
    for point in random_arguments(50).T:
        state, (bank, density, drag, lift, mu, rotation, _) = point[:6], point[6:]
        rates = np.array(broadcast_rates(*point))
        # The complex step differentiates position and velocity along the flight.
        step = 1e-30
        position, velocity = inertial(1j * step, state + 1j * step * rates, rotation)
        _, _, latitude, speed, path, azimuth = state
        axes = frame(state[1], latitude)
        forward = np.array([np.sin(path), np.cos(path) * np.sin(azimuth), np.cos(path) * np.cos(azimuth)])
        right = np.array([0, np.cos(azimuth), -np.sin(azimuth)])
        above = np.cross(right, forward)
        assert above[0] > 0
        force = -drag * forward + lift * (np.cos(bank) * above + np.sin(bank) * right)
        expected = axes @ (density * speed**2 * force - mu / state[0] ** 2 * np.array([1, 0, 0]))
        # Rounding: of the aerodynamic acceleration (up to thousands of m/s^2), and of inertial terms of tens of m/s^2.
        np.testing.assert_allclose(position.imag / step, velocity.real, rtol=0, atol=1e-15 * 6000 * 4)
        rounding = 1e-15 * (np.linalg.norm(expected) + 100)
        np.testing.assert_allclose(velocity.imag / step, expected, rtol=0, atol=rounding)


def vacuum_drift(heading_sign, azimuth):
    """Relative change of inertial energy and angular momentum vector in 80 s without atmosphere, from 17 deg north."""
    state = [PLANET_RADIUS + 125e3, 2.2, np.radians(17), 5800.0, np.radians(-15.5), azimuth]

    def rates(t, y):
        planet = GRAVITATIONAL_PARAMETER, ROTATION_RATE
        return entry_rates(y, sine_cosine(0.3), 0.0, (3.7e-3, 8.9e-4), planet, heading_sign)

    flight = solve_ivp(rates, (0, 80), state, method="DOP853", rtol=1e-13, atol=1e-13)
    assert flight.success
    energies, momenta = [], []
    for time, point in ((0, flight.y[:, 0]), (80, flight.y[:, -1])):
        position, velocity = inertial(time, point, ROTATION_RATE)
        energies.append(velocity @ velocity / 2 - GRAVITATIONAL_PARAMETER / np.linalg.norm(position))
        momenta.append(np.cross(position, velocity))
    return (
        abs(energies[1] / energies[0] - 1),
        np.linalg.norm(momenta[1] - momenta[0]) / np.linalg.norm(momenta[0]),
    )


@pytest.mark.parametrize("azimuth", np.radians([0, 40, 90, 135, 200, 270, 330]))
def test_vacuum_flight_keeps_inertial_energy_and_angular_momentum(azimuth):
    assert max(vacuum_drift(+1.0, azimuth)) < 1e-12


def test_a_positive_bank_turns_clockwise_and_lowers_the_vertical_lift():
    point = [3.42e6, 0.0, 0.3, 3000.0, -0.1, 1.0, 0.0, 5e-3, 3.7e-3, 8.9e-4, GRAVITATIONAL_PARAMETER, 0.0, 1.0]
    level, banked = broadcast_rates(*point), broadcast_rates(*point[:6], 0.5, *point[7:])
    assert banked[5] > level[5]
    assert banked[4] < level[4]
    assert banked[:4] == level[:4]
