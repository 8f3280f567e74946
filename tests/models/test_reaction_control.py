import numpy as np
import pytest

from marsedl.models.reaction_control import bank_propellant

ALPHA, GRAVITY = np.radians(11), 9.80665
VEHICLE = {
    "angle_of_attack": ALPHA,
    "roll_inertia": 5000.0,
    "yaw_inertia": 4000.0,
    "roll_arm": 1.25,
    "yaw_arm": 1.0,
    "specific_impulse": 215.0,
    "standard_gravity": GRAVITY,
}
# Desensitized landing, Table 3: cumulative bank rate (deg/s) and fuel (kg).
CUMULATIVE = np.array([5.1784, 5.1233, 6.1277, 12.8236, 20.5832, 166.9280])
FUEL = np.array([0.204, 0.202, 0.242, 0.506, 0.812, 6.583])


def test_the_printed_fuels_follow_from_the_printed_cumulative_rates():
    actual = bank_propellant(np.radians(CUMULATIVE), **VEHICLE)
    np.testing.assert_array_equal(actual.round(3)[:5], FUEL[:5])
    assert actual.round(3)[5] == 6.582  # a unit of the last digit less
    assert bank_propellant(np.radians(1.0), **VEHICLE) == pytest.approx(0.0394294, abs=5e-8)


def test_it_is_the_impulse_of_the_torques_about_both_axes_over_the_exhaust_velocity():
    time = np.linspace(0, 40, 4001)
    bank_acceleration = np.radians(3) * np.sin(time / 3) * np.exp(-time / 25)
    vehicle = {
        "angle_of_attack": np.radians(-16),
        "roll_inertia": 3000.0,
        "yaw_inertia": 4700.0,
        "roll_arm": 1.7,
        "yaw_arm": 2.3,
        "specific_impulse": 220.0,
        "standard_gravity": GRAVITY,
    }
    mass_flow = 0.0
    for share, inertia, arm in ((1.0, 3000.0, 1.7), (np.sin(np.radians(-16)), 4700.0, 2.3)):
        torque = inertia * share * bank_acceleration
        mass_flow += np.abs(torque) / arm / (GRAVITY * 220.0)  # the sum of thrusts over the exhaust velocity
    cumulative = np.trapezoid(np.abs(bank_acceleration), time)
    assert bank_propellant(cumulative, **vehicle) == pytest.approx(np.trapezoid(mass_flow, time), rel=1e-13)


def test_without_angle_of_attack_the_roll_thrusters_work_alone():
    expected = 5000.0 / 1.25 * 0.3 / (GRAVITY * 215.0)
    alone = {**VEHICLE, "angle_of_attack": 0.0}
    assert bank_propellant(0.3, **alone) == pytest.approx(expected, rel=1e-15)
    assert bank_propellant(0.3, **{**alone, "yaw_inertia": 9e9}) == pytest.approx(expected, rel=1e-15)
    assert bank_propellant(0.0, **VEHICLE) == 0.0
