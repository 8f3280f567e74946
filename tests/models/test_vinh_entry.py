import numpy as np
from scipy.integrate import solve_ivp

from marsedl.methods.taylor import Series
from marsedl.models.dynamics.vinh_entry import vinh_entry_rates
from three_ways import check_three_ways

PLANET_RADIUS, GRAVITATIONAL_PARAMETER, ROTATION_RATE = 3.3895e6, 4.2828e13, 7.0882e-5
DRAG_FACTOR, LIFT_FACTOR = 1 / 270, 0.24 / 270


def rates_of(*arguments):
    return vinh_entry_rates(arguments[:6], *arguments[6:])


def random_arguments(count):
    """Arguments of `vinh_entry_rates` away from the poles and from vertical flight, (13, count)."""
    random = np.random.default_rng(5)
    low = [0, -3, -1.2, 400, -1.2, -3, -3, 0, 3.3e6, 1e-3, 1e-4, 4e13, -1e-4]
    high = [1.5e5, 3, 1.2, 6000, 1.2, 3, 3, 0.02, 3.5e6, 5e-3, 2e-3, 5e13, 1e-4]
    return random.uniform(low, high, (count, 13)).T


def cartesian(time, state, rotation_rate):
    """Inertial position and velocity, from east, north and up at the vehicle; axes of planet and stars agree at 0."""
    radius, longitude, latitude, velocity, path, heading = state
    angle = longitude + rotation_rate * time
    sin_l, cos_l, sin_p, cos_p = np.sin(angle), np.cos(angle), np.sin(latitude), np.cos(latitude)
    east = np.array([-sin_l, cos_l, 0 * sin_l])
    north = np.array([-sin_p * cos_l, -sin_p * sin_l, cos_p])
    up = np.array([cos_p * cos_l, cos_p * sin_l, sin_p])
    horizontal = np.cos(heading) * east + np.sin(heading) * north
    relative = velocity * (np.cos(path) * horizontal + np.sin(path) * up)
    return radius * up, relative + np.cross([0, 0, rotation_rate], radius * up)


def cartesian_acceleration(position, velocity, bank, density, drag, lift, mu, rotation_rate):
    """Gravity, drag, and lift turned by the bank from the vertical plane to the right, all from vectors."""
    relative = velocity - np.cross([0, 0, rotation_rate], position)
    speed = np.sqrt(relative @ relative)
    forward = relative / speed
    right = np.cross(forward, position)
    right /= np.sqrt(right @ right)
    above = np.cross(right, forward)
    force = -drag * forward + lift * (np.cos(bank) * above + np.sin(bank) * right)
    return density * speed**2 * force - mu * position / np.sqrt(position @ position) ** 3


def test_numba_casadi_and_numpy_agree():
    check_three_ways(rates_of, random_arguments(200))


def test_rates_give_the_inertial_acceleration_of_gravity_lift_and_drag():
    for point in random_arguments(50).T:
        bank, density, planet_radius, drag, lift, mu, rotation = point[6:]
        rates = np.array(rates_of(*point))
        state = np.array([planet_radius + point[0], *point[1:6]])
        # The complex step differentiates position and velocity along the flight.
        step = 1e-30
        position, velocity = cartesian(1j * step, state + 1j * step * rates, rotation)
        expected = cartesian_acceleration(position.real, velocity.real, bank, density, drag, lift, mu, rotation)
        rounding = 1e-15 * (np.linalg.norm(expected) + 100)
        np.testing.assert_allclose(position.imag / step, velocity.real, rtol=0, atol=1e-15 * 6000 * 4)
        np.testing.assert_allclose(velocity.imag / step, expected, rtol=0, atol=2 * rounding)


def test_an_entry_is_that_of_an_inertial_cartesian_simulation():
    start = np.array([125e3, 0.3, -0.2, 5800.0, np.radians(-15.5), 0.4])
    planet = (GRAVITATIONAL_PARAMETER, ROTATION_RATE)

    def density(altitude):
        return 0.0141371 * np.exp(-altitude / 10332.4)

    def bank(time):
        return 1.1 - 0.003 * time

    def in_angles(time, y):
        return vinh_entry_rates(y, bank(time), density(y[0]), PLANET_RADIUS, DRAG_FACTOR, LIFT_FACTOR, *planet)

    def in_vectors(time, y):
        air = density(np.linalg.norm(y[:3]) - PLANET_RADIUS)
        pull = cartesian_acceleration(y[:3], y[3:], bank(time), air, DRAG_FACTOR, LIFT_FACTOR, *planet)
        return np.concatenate([y[3:], pull])

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-9}
    first = np.concatenate(cartesian(0.0, [PLANET_RADIUS + start[0], *start[1:]], ROTATION_RATE))
    angles = solve_ivp(in_angles, (0, 220), start, **options).y[:, -1]
    vectors = solve_ivp(in_vectors, (0, 220), first, **options).y[:, -1]
    # Through the whole pulse of deceleration.
    assert angles[3] < 1000.0
    position, velocity = cartesian(220.0, [PLANET_RADIUS + angles[0], *angles[1:]], ROTATION_RATE)
    np.testing.assert_allclose(position, vectors[:3], rtol=0, atol=1e-3)
    np.testing.assert_allclose(velocity, vectors[3:], rtol=0, atol=1e-5)


def test_a_positive_bank_turns_right_and_lowers_the_vertical_lift():
    point = [3e4, 0.0, 0.3, 3000.0, -0.1, 1.0, 0.0, 5e-3, PLANET_RADIUS, DRAG_FACTOR, LIFT_FACTOR, 4.3e13, 7e-5]
    level, banked = rates_of(*point), rates_of(*point[:6], 0.5, *point[7:])
    assert banked[5] < level[5]
    assert banked[4] < level[4]
    assert banked[:4] == level[:4]


def test_a_power_series_carries_the_derivative_along_a_ray():
    arguments = random_arguments(20)
    direction = np.random.default_rng(2).standard_normal(arguments.shape) * np.abs(arguments)
    rays = [Series.along(base, way, 2) for base, way in zip(arguments, direction, strict=True)]
    step = 1e-30
    along = np.array(rates_of(*(arguments + 1j * step * direction))).imag / step
    for value, expected in zip(rates_of(*rays), along, strict=True):
        np.testing.assert_allclose(value.coefficients[1], expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
