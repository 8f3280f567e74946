import numpy as np
import pytest

from marsedl.methods.guidance.bank_profile import ramped_bank_cosine, ramped_bank_cosine_slope
from three_ways import check_three_ways

FAST, SLOW = np.cos(np.radians(75)), np.cos(np.radians(45))
PROFILE = (5500.0, 2500.0, FAST, SLOW)


def profile(velocity):
    return ramped_bank_cosine(velocity, *PROFILE), ramped_bank_cosine_slope(velocity, *PROFILE)


def test_values_of_the_printed_profile():
    velocity = np.array([500.0, 2500.0, 4000.0, 5500.0, 6000.0])
    expected = [SLOW, SLOW, (SLOW + FAST) / 2, FAST, FAST]
    np.testing.assert_allclose(ramped_bank_cosine(velocity, *PROFILE), expected, rtol=2e-16)
    slopes = ramped_bank_cosine_slope(velocity, *PROFILE)
    np.testing.assert_allclose(slopes, [0, 0, -(SLOW - FAST) / 3000, 0, 0], rtol=2e-16)


def test_ends_are_met_exactly():
    assert ramped_bank_cosine(2500.0, *PROFILE) == ramped_bank_cosine(0.0, *PROFILE) == SLOW
    assert ramped_bank_cosine(5500.0, *PROFILE) == ramped_bank_cosine(1e4, *PROFILE) == FAST


@pytest.mark.parametrize("velocity", [600.0, 2499.0, 2501.0, 4000.0, 5499.0, 5501.0])
def test_slope_is_the_difference_quotient(velocity):
    quotient = (ramped_bank_cosine(velocity + 0.5, *PROFILE) - ramped_bank_cosine(velocity - 0.5, *PROFILE)) / 1.0
    assert ramped_bank_cosine_slope(velocity, *PROFILE) == pytest.approx(quotient, rel=1e-10, abs=1e-15)


def test_numba_casadi_and_numpy_agree():
    check_three_ways(profile, np.linspace(500, 6000, 111)[np.newaxis], rtol=1e-15, atol=0, scaled=False)
