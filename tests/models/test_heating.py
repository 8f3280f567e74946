import casadi
import numpy as np
import pytest
from numba import njit

from marsedl.models.heating import sutton_graves_heat_rate


@njit
def compiled_rate(density, velocity, nose_radius, constant):
    return sutton_graves_heat_rate(density, velocity, nose_radius, constant)


def test_heat_rate_of_a_case_computed_by_hand():
    # sqrt(4.5e-4 / 1.125) = 0.02, times 5000^3 = 1.25e11 and 1.9027e-4
    assert sutton_graves_heat_rate(4.5e-4, 5000.0, 1.125, 1.9027e-4) == pytest.approx(475675.0, rel=1e-14)


def test_numba_casadi_and_numpy_agree():
    density, velocity = np.array([1e-6, 1e-3, 0.02]), np.array([5800.0, 4000.0, 300.0])
    broadcast = sutton_graves_heat_rate(density, velocity, 1.125, 1.9027e-4)
    casadi.GlobalOptions.setNumpyMode(-1)
    symbols = casadi.SX.sym("arguments", 2)
    traced = casadi.Function("rate", [symbols], [sutton_graves_heat_rate(symbols[0], symbols[1], 1.125, 1.9027e-4)])
    compiled = [compiled_rate(rho, v, 1.125, 1.9027e-4) for rho, v in zip(density, velocity, strict=True)]
    np.testing.assert_allclose(compiled, broadcast, rtol=1e-15)
    np.testing.assert_allclose(traced.map(3)(np.array([density, velocity])).full()[0], broadcast, rtol=1e-15)
