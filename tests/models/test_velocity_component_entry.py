import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.elementary import sine_cosine
from marsedl.models.dynamics.entry import entry_rates
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from three_ways import check_three_ways

BALLISTIC_COEFFICIENT, LIFT_TO_DRAG, MU, PLANET_RADIUS = 115.0, 0.18, 4.282837e13, 3.397e6
ENTRY = np.array([126.1e3, 0, 0, 6750 * np.sin(np.radians(-15.2)), 0, 6750 * np.cos(np.radians(-15.2))])


def broadcast_rates(*arguments):
    return velocity_component_entry_rates(arguments[:8], arguments[8], arguments[9], arguments[10:12], arguments[12:14])


def random_arguments(count):
    """Arguments of `velocity_component_entry_rates` away from the poles and from vertical flight, (14, count)."""
    random = np.random.default_rng(8)
    low = [0, -1.2, -3, -4000, -4000, -4000, -3, -0.3, -0.1, 0, 80, 0.1, 4e13, 3.3e6]
    high = [150e3, 1.2, 3, 4000, 4000, 4000, 3, 0.3, 0.1, 0.02, 160, 0.3, 5e13, 3.5e6]
    arguments = random.uniform(low, high, (2 * count, 14)).T
    return arguments[:, np.hypot(arguments[4], arguments[5]) > 300][:, :count]


def density(altitude):
    return 0.016 * np.exp(-altitude / 9.5e3)


def frame(longitude, latitude):
    """Up, north and east in inertial axes, as columns."""
    sin_l, cos_l, sin_p, cos_p = np.sin(longitude), np.cos(longitude), np.sin(latitude), np.cos(latitude)
    return np.array(
        [[cos_p * cos_l, cos_p * sin_l, sin_p], [-sin_p * cos_l, -sin_p * sin_l, cos_p], [-sin_l, cos_l, 0]]
    ).T


def inertial(state):
    """Position and velocity of altitude, latitude, longitude and the three velocities."""
    axes = frame(state[2], state[1])
    return axes[:, 0] * (PLANET_RADIUS + state[0]), axes @ state[3:6]


def inertial_acceleration(position, velocity, bank, density, ballistic_coefficient, lift_to_drag, mu):
    """Gravity, drag and lift as vectors: the lift is the vertical one, turned about the velocity by the bank angle."""
    distance, speed = np.linalg.norm(position), np.linalg.norm(velocity)
    forward = velocity / speed
    upwards = position - (position @ forward) * forward
    upwards /= np.linalg.norm(upwards)
    turned = np.cos(bank) * upwards + np.sin(bank) * np.cross(forward, upwards)  # Rodrigues' formula
    drag = density * speed**2 / (2 * ballistic_coefficient)
    return -mu * position / distance**3 + drag * (lift_to_drag * turned - forward)


def test_numba_casadi_and_numpy_agree():
    check_three_ways(broadcast_rates, random_arguments(200))


def test_rates_are_those_of_speed_path_angle_and_azimuth_on_a_planet_at_rest():
    for point in random_arguments(50).T:
        altitude, latitude, longitude, *velocity, bank, _, _, rho, ballistic_coefficient, ratio, mu, planet_radius = (
            point
        )
        radial, north, east = velocity
        horizontal, speed = np.hypot(north, east), np.linalg.norm(velocity)
        path, azimuth = np.arcsin(radial / speed), np.arctan2(east, north)
        radius, drag_factor = planet_radius + altitude, 1 / (2 * ballistic_coefficient)
        constants = (rho, (drag_factor, ratio * drag_factor), (mu, 0.0), 1.0)
        polar = np.array(
            entry_rates((radius, longitude, latitude, speed, path, azimuth), sine_cosine(bank), *constants)
        )
        actual = np.array(broadcast_rates(*point))
        rounding = 1e-14 * (rho * speed**2 * drag_factor + 20)  # of the accelerations
        np.testing.assert_allclose(actual[[0, 2, 1]], polar[:3], rtol=1e-13, atol=1e-18)

        # forth: the components move as speed and angles do
        sin_g, cos_g, sin_a, cos_a = np.sin(path), np.cos(path), np.sin(azimuth), np.cos(azimuth)
        derivative = np.array(
            [
                [sin_g, speed * cos_g, 0],
                [cos_g * cos_a, -speed * sin_g * cos_a, -speed * cos_g * sin_a],
                [cos_g * sin_a, -speed * sin_g * sin_a, speed * cos_g * cos_a],
            ]
        )
        np.testing.assert_allclose(actual[3:6], derivative @ polar[3:], rtol=0, atol=rounding)

        # back: speed and angles move as the components do
        speed_rate = actual[3:6] @ velocity / speed
        path_rate = (actual[3] - sin_g * speed_rate) / horizontal
        azimuth_rate = (north * actual[5] - east * actual[4]) / horizontal**2
        scale = np.array([1, 1 / horizontal, speed / horizontal**2])
        np.testing.assert_array_less(np.abs([speed_rate, path_rate, azimuth_rate] - polar[3:]), rounding * scale)


def fly(start, bank, density=density, seconds=260.0):
    """State at the end and in between, (6, k), under a bank angle that is a function of time."""

    def rates(time, state):
        constants = (BALLISTIC_COEFFICIENT, LIFT_TO_DRAG), (MU, PLANET_RADIUS)
        return velocity_component_entry_rates((*state, bank(time), 0.0), 0.0, density(state[0]), *constants)[:6]

    scale = np.array([1e5, 1, 1, 1e3, 1e3, 1e3])
    flight = solve_ivp(rates, (0, seconds), start, method="DOP853", rtol=1e-12, atol=1e-13 * scale)
    assert flight.success
    return flight.y


def test_a_flight_is_that_of_newtons_law_in_inertial_coordinates():
    def bank(time):
        return np.radians(100) * np.sin(time / 30) - 0.5

    def rates(time, state):
        position, velocity = state[:3], state[3:]
        air = density(np.linalg.norm(position) - PLANET_RADIUS)
        constants = (BALLISTIC_COEFFICIENT, LIFT_TO_DRAG, MU)
        return np.concatenate([velocity, inertial_acceleration(position, velocity, bank(time), air, *constants)])

    start = ENTRY + np.array([0, 0.3, 1.0, 0, 900, 0])
    end = fly(start, bank)[:, -1]
    flight = solve_ivp(
        rates, (0, 260), np.concatenate(inertial(start)), method="DOP853", rtol=1e-12, atol=np.repeat([1e-7, 1e-10], 3)
    )
    assert flight.success
    assert end[0] < 30e3  # it has flown through the atmosphere
    assert np.linalg.norm(end[3:]) < 1000
    position, velocity = inertial(end)
    np.testing.assert_allclose(position, flight.y[:3, -1], rtol=0, atol=1e-4)
    np.testing.assert_allclose(velocity, flight.y[3:, -1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("azimuth", np.radians([0, 40, 90, 135, 200, 330]))
def test_vacuum_flight_keeps_energy_and_angular_momentum(azimuth):
    start = [126.1e3, 0.3, 1.0, 1500.0, 4300 * np.cos(azimuth), 4300 * np.sin(azimuth)]
    flight = fly(start, lambda time: 1.0, density=lambda altitude: 0.0, seconds=1000.0)
    assert np.ptp(flight[0]) > 300e3
    energies, momenta = [], []
    for state in flight.T:
        position, velocity = inertial(state)
        energies.append(velocity @ velocity / 2 - MU / np.linalg.norm(position))
        momenta.append(np.cross(position, velocity))
    momenta = np.array(momenta)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-11)
    np.testing.assert_allclose(
        momenta, momenta[:1].repeat(len(momenta), 0), rtol=0, atol=1e-11 * np.linalg.norm(momenta[0])
    )


def test_the_mirrored_flight_has_the_mirrored_rates_to_the_last_bit():
    mirror = np.ones(14)
    mirror[[1, 4, 6, 7, 8]] = -1  # latitude, north velocity, bank, its rate and acceleration
    sign = np.array([1, -1, 1, 1, -1, 1, -1, -1])
    arguments = random_arguments(200)
    rates = np.array(broadcast_rates(*arguments))
    mirrored = np.array(broadcast_rates(*(mirror[:, np.newaxis] * arguments)))
    np.testing.assert_array_equal(mirrored, sign[:, np.newaxis] * rates)
