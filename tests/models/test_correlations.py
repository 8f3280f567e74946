"""Covariances are looked at as correlations, whatever units their components have."""

import numpy as np
import pytest

from marsedl.models.correlations import correlations

DEVIATIONS = np.array([1e3, 1e-4])  # of an altitude in m and an angle in rad


@pytest.mark.parametrize(
    ("correlation", "said"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "diagonal scaled to one it has the eigenvalue -1"),
        ([[1.0, 0.9], [0.5, 1.0]], "must be symmetric"),  # by less than a billionth of the largest entry
        ([[1.0, 0.0], [0.0, -1e-6]], "but has -1e-14 on its diagonal"),
        ([[1.0, 1e-3], [1e-3, 0.0]], "but has 0 on its diagonal"),
    ],
)
def test_what_is_no_covariance_is_refused_whatever_its_units(correlation, said):
    for units in (DEVIATIONS, np.ones(2)):
        with pytest.raises(ValueError, match="covariance must be"):
            correlations("covariance", np.array(correlation) * np.outer(units, units))
    with pytest.raises(ValueError, match=said):
        correlations("covariance", np.array(correlation) * np.outer(DEVIATIONS, DEVIATIONS))


@pytest.mark.parametrize("correlation", [-1.0, 0.0, 0.6, 1.0])
def test_deviations_and_correlations_are_taken_apart(correlation):
    scaled = np.array([[1.0, correlation], [correlation, 1.0]])
    units, found = correlations("covariance", scaled * np.outer(DEVIATIONS, DEVIATIONS))
    np.testing.assert_allclose(units, DEVIATIONS, rtol=1e-15)
    np.testing.assert_allclose(found, scaled, rtol=1e-15)


def test_a_component_without_variance_is_kept_and_is_not_definite():
    units, found = correlations("covariance", np.diag([4.0, 0.0]))
    assert units.tolist() == [2.0, 1.0] and found.tolist() == [[1.0, 0.0], [0.0, 0.0]]
    for singular in (np.diag([4.0, 0.0]), np.ones((2, 2)) * np.outer(DEVIATIONS, DEVIATIONS)):
        with pytest.raises(ValueError, match="weight must be positive definite, but with its diagonal"):
            correlations("weight", singular - 1e-12 * np.diag(np.diag(singular)), definite=True)
