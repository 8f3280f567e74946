import numpy as np
import pytest

from marsedl.models.heating import sutton_graves_heat_rate
from three_ways import check_three_ways


def test_heat_rate_of_a_case_computed_by_hand():
    # sqrt(4.5e-4 / 1.125) = 0.02, times 5000^3 = 1.25e11 and 1.9027e-4
    assert sutton_graves_heat_rate(4.5e-4, 5000.0, 1.125, 1.9027e-4) == pytest.approx(475675.0, rel=1e-14)


def test_numba_casadi_and_numpy_agree():
    points = np.array([[1e-6, 1e-3, 0.02], [5800.0, 4000.0, 300.0], [1.125] * 3, [1.9027e-4] * 3])
    check_three_ways(
        lambda *arguments: (sutton_graves_heat_rate(*arguments),), points, rtol=1e-15, atol=0, scaled=False
    )
