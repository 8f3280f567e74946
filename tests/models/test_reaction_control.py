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


def test_no_other_share_of_roll_and_yaw_fits_as_well():
    """Roll and yaw thrusters have one ratio of inertia and arm here, so that only the sum of the shares counts."""
    low = ((FUEL - 5e-4) / (CUMULATIVE + 5e-5)).max()
    high = ((FUEL + 5e-4) / (CUMULATIVE - 5e-5)).min()
    assert low < high < 1.0002 * low  # one constant explains the whole column
    per_share = 5000.0 / 1.25 * np.radians(1) / (GRAVITY * 215.0)
    sine, cosine = np.sin(ALPHA), np.cos(ALPHA)
    assert bank_propellant(np.radians(1.0), **VEHICLE) == pytest.approx((1 + sine) * per_share, rel=1e-14)
    assert (1 + sine) * per_share / low - 1 == pytest.approx(-0.0001, abs=2e-5)
    assert (cosine + sine) * per_share / low - 1 == pytest.approx(-0.0155, abs=5e-5)
    assert (1 + sine / cosine) * per_share / high - 1 == pytest.approx(0.0028, abs=5e-5)
    assert per_share / low - 1 == pytest.approx(-0.1603, abs=5e-5)  # roll alone


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


@pytest.mark.parametrize(
    "name", ["roll_inertia", "yaw_inertia", "roll_arm", "yaw_arm", "specific_impulse", "standard_gravity"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_what_must_be_positive(name, value):
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value}"):
        bank_propellant(1.0, **{**VEHICLE, name: value})


def test_a_cumulative_acceleration_is_not_negative():
    with pytest.raises(ValueError, match=r"cumulative_bank_acceleration must not be negative, got -0\.5"):
        bank_propellant([1.0, -0.5], **VEHICLE)
