import numpy as np
import pytest
from numba import njit

from marsedl.elementary import sine_cosine
from marsedl.methods.guidance.lateral import (
    CORRECTED,
    PRINTED,
    bank_direction,
    deadband,
    heading_alignment_limit,
    heading_alignment_ratio,
    limited_heading_alignment,
    rate_limited_bank,
    rate_limited_bank_as_printed,
)
from marsedl.methods.guidance.targeting import targeting
from marsedl.models.dynamics.entry import entry_rates

DEADBAND = (105.0, 6e3, 125.0, 1.2e3)
GAIN = 50.0
PLANET_RADIUS, ROTATION_RATE, TARGET = 3.397e6, 7.0882e-5, (np.radians(137.0), 0.0)
RADIUS, LONGITUDE, LATITUDE, VELOCITY, PATH_ANGLE, AZIMUTH = range(6)


@njit
def compiled_deadband(time):
    return deadband(time, *DEADBAND)


@njit
def compiled_direction(direction, crossrange, width):
    return bank_direction(direction, crossrange, width)


def heading_alignment(downrange_angle, crossrange_angle, gain, limit, form):
    """The command of Eq. 58."""
    angle = np.arctan2(*heading_alignment_ratio(downrange_angle, crossrange_angle, form))
    return limited_heading_alignment(angle, gain, limit, form)


@njit
def compiled_alignment(downrange_angle, crossrange_angle, limit, form):
    numerator, denominator = heading_alignment_ratio(downrange_angle, crossrange_angle, form)
    return limited_heading_alignment(np.arctan2(numerator, denominator), GAIN, limit, form)


@njit
def compiled_banks(command, before, largest_change):
    return (
        rate_limited_bank(command, before, largest_change),
        rate_limited_bank_as_printed(command, before, largest_change),
    )


def fly(state, seconds, guidance, rotation_rate=ROTATION_RATE, substeps=4):
    """Fly with a bank of `guidance(state, downrange_angle, crossrange_angle)` each second, until 500 m/s at the latest.

    Returns crossranges (m) at the start of each second and at the end. The density is exponential.
    """
    state, crossranges = np.array(state), []

    def rates(state, bank):
        density = 1.45e-2 * np.exp(-(state[RADIUS] - PLANET_RADIUS) / 10.8e3)
        direction = sine_cosine(bank)
        return np.array(entry_rates(state, direction, density, (1 / 270, 0.24 / 270), (4.2828e13, rotation_rate), 1.0))

    def target(state):
        arguments = (state[i] for i in (LONGITUDE, LATITUDE, RADIUS, VELOCITY, PATH_ANGLE, AZIMUTH))
        return targeting(*arguments, rotation_rate, TARGET[0], sine_cosine(TARGET[1]))

    step = 1.0 / substeps
    for _ in range(seconds):
        downrange_angle, crossrange_angle = target(state)
        crossranges.append(PLANET_RADIUS * crossrange_angle)
        bank = guidance(state, downrange_angle, crossrange_angle)
        for _ in range(substeps):
            first = rates(state, bank)
            second = rates(state + step / 2 * first, bank)
            third = rates(state + step / 2 * second, bank)
            state = state + step / 6 * (first + 2 * second + 2 * third + rates(state + step * third, bank))
        if state[VELOCITY] <= 500:
            break
    return np.array([*crossranges, PLANET_RADIUS * target(state)[1]])


def start_of_heading_alignment(crossrange):
    """A state 77 km uprange of the target at 1.1 km/s."""
    longitude = TARGET[0] - 77e3 / PLANET_RADIUS
    return [PLANET_RADIUS + 16.65e3, longitude, -crossrange / PLANET_RADIUS, 1098.0, 0.016, np.pi / 2]


# ---- deadband and reversals ------------------------------------------------------------------------------------------


def test_deadband_is_constant_linear_constant():
    times = np.array([0.0, 105.0, 110.0, 115.0, 125.0, 300.0])
    widths = deadband(times, *DEADBAND)
    np.testing.assert_allclose(widths, [6e3, 6e3, 4.8e3, 3.6e3, 1.2e3, 1.2e3], rtol=1e-15)
    assert (widths[[0, 1]] == 6e3).all()
    assert (widths[[4, 5]] == 1.2e3).all()
    np.testing.assert_allclose([compiled_deadband(time) for time in times], widths, rtol=1e-15)


def printed_direction(direction, crossrange, width):
    """The three cases of Eq. 57."""
    if direction == -1 and crossrange < -width:
        return +1
    if direction == +1 and crossrange > +width:
        return -1
    return direction


def test_bank_direction_is_eq_57():
    for direction in (-1, 1):
        for crossrange in (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0):
            expected = printed_direction(direction, crossrange, 2.0)
            assert bank_direction(direction, crossrange, 2.0) == expected
            assert compiled_direction(float(direction), crossrange, 2.0) == expected


def test_reversals_keep_the_crossrange_near_the_deadband():
    directions = [1.0]

    def guidance(state, downrange_angle, crossrange_angle):
        directions.append(bank_direction(directions[-1], PLANET_RADIUS * crossrange_angle, 2e3))
        return directions[-1] * np.radians(60.0)

    state = [PLANET_RADIUS + 30e3, TARGET[0] - 240e3 / PLANET_RADIUS, 0.0, 5000.0, -0.15, np.pi / 2]
    crossrange = fly(state, 60, guidance)
    without_reversals = fly(state, 60, lambda *_: np.radians(60.0))
    assert len(set(directions)) == 2  # it did reverse
    assert np.abs(crossrange).max() < 0.5 * np.abs(without_reversals).max()


# ---- heading alignment -----------------------------------------------------------------------------------------------


def test_forms_of_the_heading_alignment():
    downrange, limit = 0.02, np.radians(35)
    for crossrange in (-1e-3, -3e-6, 2e-6, 5e-5, 2e-2):
        corrected = -GAIN * np.arctan(crossrange / downrange)
        printed = GAIN * np.arctan(downrange / crossrange)
        for form, command in ((CORRECTED, corrected), (PRINTED, printed)):
            expected = np.clip(command, -limit, limit)
            assert heading_alignment(downrange, crossrange, GAIN, limit, form) == pytest.approx(expected, rel=1e-14)
            assert compiled_alignment(downrange, crossrange, limit, form) == pytest.approx(expected, rel=1e-14)


def aligned(form, gain=GAIN):
    def guidance(state, downrange_angle, crossrange_angle):
        limit = heading_alignment_limit(state[VELOCITY], 900.0, np.radians(45), np.radians(35))
        return heading_alignment(downrange_angle, crossrange_angle, gain, limit, form)

    return guidance


@pytest.mark.parametrize("crossrange", [-1.1e3, 1.1e3])
def test_heading_alignment_nulls_the_crossrange_over_a_planet_at_rest(crossrange):
    flight = fly(start_of_heading_alignment(crossrange), 120, aligned(CORRECTED), rotation_rate=0.0)
    assert len(flight) < 120  # 500 m/s are reached
    assert flight[0] == pytest.approx(crossrange, abs=1)
    assert abs(flight[-1]) < 0.1


def test_rotation_of_the_planet_leaves_a_crossrange_inversely_proportional_to_the_gain():
    # Drag slows the planet-relative velocity, which turns the inertial one and with it the orbit plane.
    final = [fly(start_of_heading_alignment(1.1e3), 120, aligned(CORRECTED, gain))[-1] for gain in (50.0, 100.0, 200.0)]
    assert abs(final[0]) < 0.03 * 1.1e3
    np.testing.assert_allclose(np.divide(final[:-1], final[1:]), 2, rtol=0.2)


def test_printed_heading_alignment_drives_the_crossrange_away():
    flight = fly(start_of_heading_alignment(1.1e3), 120, aligned(PRINTED))
    assert flight[-1] > 2 * flight[0] > 0
    assert (np.diff(flight) > 0).all()


# ---- limit of the bank rate ------------------------------------------------------------------------------------------


def printed_bank(command, previous, largest_change):
    """The three cases of Eq. 71, the second as printed."""
    if command - previous >= +largest_change:
        return previous + largest_change
    if previous - command <= -largest_change:
        return previous - largest_change
    return command


def test_bank_changes_by_no_more_than_the_limit():
    for flight in (-1.0, 0.0, 0.5):
        for command in (-1.3, -0.6, 0.0, 0.1, 1.3):
            bank = rate_limited_bank(command, flight, 0.25)
            assert bank == pytest.approx(flight + np.clip(command - flight, -0.25, 0.25), rel=1e-15)
            assert bank == command or abs(bank - flight) == pytest.approx(0.25, rel=1e-15)
            printed = rate_limited_bank_as_printed(command, flight, 0.25)
            assert printed == pytest.approx(printed_bank(command, flight, 0.25), rel=1e-15)
            assert compiled_banks(command, flight, 0.25) == (bank, printed)
