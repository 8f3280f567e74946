import numpy as np
import pytest

from marsedl.elementary import sine_cosine
from marsedl.methods.guidance.targeting import require_target_ahead
from marsedl.methods.guidance.targeting import targeting as targeting_of
from three_ways import check_three_ways

PLANET_RADIUS, ROTATION_RATE = 3.397e6, 7.0882e-5


def targeting(
    longitude,
    latitude,
    radius,
    velocity,
    flight_path_angle,
    azimuth,
    rotation_rate,
    target_longitude,
    target_latitude,
):
    """Of the target's latitude itself."""
    vehicle = longitude, latitude, radius, velocity, flight_path_angle, azimuth
    return targeting_of(*vehicle, rotation_rate, target_longitude, sine_cosine(target_latitude))


def rotation(angle):
    """T^IF of Eq. 91."""
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def appendix_d(
    longitude, latitude, radius, velocity, path, azimuth, rate, target_longitude, target_latitude, time=0, phase=0
):
    """Eqs. 91 to 99 as they stand, in inertial axes, with the target where it is now."""
    to_inertial = rotation(phase + time * rate)
    sin_l, cos_l, sin_p, cos_p = np.sin(longitude), np.cos(longitude), np.sin(latitude), np.cos(latitude)
    to_fixed = np.array(
        [[cos_l * cos_p, -sin_l, -cos_l * sin_p], [cos_p * sin_l, cos_l, -sin_l * sin_p], [sin_p, 0, cos_p]]
    )
    position = to_inertial @ to_fixed @ np.array([radius, 0, 0])
    relative = velocity * np.array([np.sin(path), np.cos(path) * np.sin(azimuth), np.cos(path) * np.cos(azimuth)])
    inertial_velocity = to_inertial @ to_fixed @ relative + np.cross([0, 0, rate], position)
    target = to_inertial @ np.array(
        [
            np.cos(target_latitude) * np.cos(target_longitude),
            np.cos(target_latitude) * np.sin(target_longitude),
            np.sin(target_latitude),
        ]
    )
    momentum = np.cross(position, inertial_velocity)
    momentum /= np.linalg.norm(momentum)
    return np.arccos(target @ position / radius), np.pi / 2 - np.arccos(target @ momentum), target, position, momentum


def random_arguments(count):
    random = np.random.default_rng(5)
    low = [-3, -1.4, 3.4e6, 400, -1.2, -3, -1e-4, -3, -1.4]
    high = [3, 1.4, 3.6e6, 6000, 1.2, 3, 1e-4, 3, 1.4]
    return random.uniform(low, high, (count, 9)).T


def at_entry(**changes):
    """Arguments of the nominal entry state (Table 2, Eqs. 69 and 70)."""
    arguments = {
        "longitude": np.radians(125.973),
        "latitude": 0.0,
        "radius": PLANET_RADIUS + 125e3,
        "velocity": 5800.0,
        "flight_path_angle": np.radians(-15.5),
        "azimuth": np.radians(90.05),
        "rotation_rate": ROTATION_RATE,
        "target_longitude": np.radians(137.0),
        "target_latitude": 0.0,
    }
    return arguments | changes


def test_agrees_with_appendix_d_whatever_the_phase_and_time():
    random = np.random.default_rng(6)
    for point in random_arguments(300).T:
        time, phase = random.uniform([0, -3], [300, 3])
        distance, crossrange, target, position, momentum = appendix_d(*point, time=time, phase=phase)
        ahead = np.cross(position, target) @ momentum > 0
        # Arccosines lose digits near 0 and pi; random angles come no closer than about 1e-2.
        np.testing.assert_allclose(
            targeting(*point), (distance if ahead else -distance, crossrange), rtol=0, atol=1e-12
        )


def test_numba_casadi_and_numpy_agree():
    check_three_ways(targeting, random_arguments(200), atol=2e-15, scaled=False)


def test_nominal_entry_state():
    downrange, crossrange = targeting(**at_entry())
    assert PLANET_RADIUS * downrange == pytest.approx(653.8e3, abs=50)
    assert PLANET_RADIUS * crossrange == pytest.approx(543, abs=0.5)
    # The printed 0.57 km is that of the planet-relative velocity: 653.8 km times 0.05 degrees.
    _, relative = targeting(**at_entry(rotation_rate=0.0))
    assert PLANET_RADIUS * relative == pytest.approx(0.57e3, abs=5)


def test_sign_of_the_crossrange():
    assert targeting(**at_entry(azimuth=np.radians(90), target_latitude=+0.01))[1] > 0  # north of an eastward flight
    assert targeting(**at_entry(azimuth=np.radians(90), target_latitude=-0.01))[1] < 0
    assert targeting(**at_entry(azimuth=np.radians(270), target_longitude=2.0, target_latitude=0.01))[1] < 0


def test_downrange_passes_through_zero_without_loss_of_digits():
    for angle in (1e-3, 1e-7, 1e-11, -1e-11, -1e-7, -1e-3):
        downrange, _ = targeting(**at_entry(longitude=0.0, azimuth=np.pi / 2, target_longitude=angle))
        assert downrange == pytest.approx(angle, rel=1e-14)
    assert targeting(**at_entry(longitude=0.0, azimuth=np.pi / 2, target_longitude=0.0)) == (0.0, pytest.approx(0.0))


def test_target_behind_is_refused():
    require_target_ahead(targeting(**at_entry())[0])
    require_target_ahead(0.0)
    with pytest.raises(ValueError, match=r"lies 2 degrees behind the entry point; .*azimuth"):
        require_target_ahead(targeting(**at_entry(target_longitude=np.radians(123.973)))[0])
