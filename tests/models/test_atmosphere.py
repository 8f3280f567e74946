from pathlib import Path

import casadi
import numpy as np
import pytest
from numba import njit
from scipy.interpolate import CubicHermiteSpline

from marsedl.models.atmosphere import (
    log_quadratic,
    tabulated,
    temperature_pressure_fit,
    two_exponential,
    uniform_cells,
    uniform_nodes,
)
from marsedl.models.density_table import read_density_table

SHIPPED = Path(__file__).parents[2] / "data" / "atmosphere" / "mars_density.csv"
CALIBRATED = (-0.0343295, -0.8737816, -4.2342822, 60e3)


def calibrated(altitude):
    return log_quadratic(altitude, *CALIBRATED)


@njit
def compiled_calibrated(altitude):
    return log_quadratic(altitude, -0.0343295, -0.8737816, -4.2342822, 60e3)


@njit
def compiled_fit(altitude):
    return temperature_pressure_fit(altitude)


@njit
def compiled_two_exponential(altitude):
    return two_exponential(altitude)


FITS = [
    pytest.param(calibrated, compiled_calibrated, [60e3], id="log_quadratic"),
    pytest.param(temperature_pressure_fit, compiled_fit, [], id="temperature_pressure_fit"),
    pytest.param(two_exponential, compiled_two_exponential, [25e3], id="two_exponential"),
]


@pytest.fixture
def table():
    return read_density_table(SHIPPED, "jezero_2021")


# ---- closed fits ----


@pytest.mark.parametrize(("fit", "compiled", "changes"), FITS)
def test_numpy_numba_and_casadi_agree(fit, compiled, changes):
    casadi.GlobalOptions.setNumpyMode(-1)
    altitudes = np.concatenate([np.linspace(-10e3, 140e3, 173), changes])
    expected = np.array(fit(altitudes))
    assert expected.shape == (3, altitudes.size)
    symbol = casadi.SX.sym("altitude")
    traced = casadi.Function("fit", [symbol], [casadi.vertcat(*fit(symbol))]).map(altitudes.size)
    np.testing.assert_allclose([fit(float(h)) for h in altitudes], expected.T, rtol=5e-15, atol=1e-25)
    np.testing.assert_allclose([compiled(h) for h in altitudes], expected.T, rtol=5e-15, atol=1e-25)
    np.testing.assert_allclose(traced(altitudes[np.newaxis]).full(), expected, rtol=5e-15, atol=1e-25)


@pytest.mark.parametrize(("fit", "compiled", "changes"), FITS)
def test_derivatives_of_the_fits(fit, compiled, changes):
    step = 10.0
    altitudes = np.arange(-9.9e3, 130e3, 777.0)
    altitudes = altitudes[[all(abs(h - change) > step for change in changes) for h in altitudes]]
    (low, low_slope, _), (high, high_slope, _) = fit(altitudes - step), fit(altitudes + step)
    _, slope, curvature = fit(altitudes)
    np.testing.assert_allclose((high - low) / (2 * step), slope, rtol=1e-6)
    np.testing.assert_allclose((high_slope - low_slope) / (2 * step), curvature, rtol=1e-6, atol=1e-16)


@pytest.mark.parametrize(("fit", "compiled", "changes"), FITS[:2])
def test_casadi_differentiates_the_smooth_fits(fit, compiled, changes):
    casadi.GlobalOptions.setNumpyMode(-1)
    symbol = casadi.SX.sym("altitude")
    derivative = casadi.Function("slope", [symbol], [casadi.jacobian(fit(symbol)[0], symbol)])
    for altitude in (-5e3, 12e3, 60e3, 61e3, 125e3):
        assert float(derivative(altitude)) == pytest.approx(fit(altitude)[1], rel=1e-13)


def test_temperature_pressure_fit_is_pressure_over_gas_constant_and_temperature():
    h = 30e3
    temperature = 1.4e-13 * h**3 - 8.85e-9 * h**2 - 1.245e-3 * h + 205.3645
    density = 559.351005946503 * np.exp(-0.000105 * h) / (188.95110711075 * temperature)
    assert np.exp(temperature_pressure_fit(h)[0]) == pytest.approx(density, rel=1e-14)


def test_temperature_pressure_fit_against_mars_gram(table):
    ratio = np.exp(temperature_pressure_fit(table[:, 0])[0]) / table[:, 1]
    assert abs(ratio[table[:, 0] < 40e3] - 1).max() == pytest.approx(0.1635, abs=5e-5)  # at 20 km
    np.testing.assert_allclose(ratio[np.isin(table[:, 0], [50e3, 100e3])], [1.64, 9.75], rtol=0.005)


def test_two_exponential_layers_and_jump():
    assert np.exp(two_exponential(0.0)[0]) == pytest.approx(1.59e-2, rel=1e-14)
    assert np.exp(two_exponential(50e3)[0]) == pytest.approx(5.25e-2 * np.exp(-50 / 7.295), rel=1e-13)
    below, above = two_exponential(np.nextafter(25e3, 0))[0], two_exponential(25e3)[0]
    assert np.exp(above - below) == pytest.approx(1.031, abs=5e-4)


# ---- the curve through a table ----


def test_tabulated_meets_the_table_and_never_overshoots(table):
    profile = tabulated(table)
    np.testing.assert_allclose(np.exp(profile(table[:, 0])[0]), table[:, 1], rtol=1e-13)
    assert (profile(np.linspace(-5e3, 140e3, 5000))[1] < 0).all()


def test_derivatives_of_tabulated(table):
    profile, step = tabulated(table), 1.0
    altitudes = np.arange(-8e3, 140e3, 333.0)
    altitudes = altitudes[np.abs(altitudes[:, np.newaxis] - table[:, 0]).min(axis=1) > step]
    (low, low_slope, _), (high, high_slope, _) = profile(altitudes - step), profile(altitudes + step)
    _, slope, curvature = profile(altitudes)
    np.testing.assert_allclose((high - low) / (2 * step), slope, rtol=1e-7)
    np.testing.assert_allclose((high_slope - low_slope) / (2 * step), curvature, rtol=1e-6, atol=1e-15)


def test_tabulated_continues_along_the_end_slopes(table):
    profile = tabulated(table)
    for end, beyond in ((0.0, -7e3), (130e3, 160e3)):
        value, slope, _ = profile(end)
        continued = profile(beyond)
        assert continued[0] == pytest.approx(value + slope * (beyond - end), rel=1e-14)
        assert continued[1:] == (slope, 0.0)


def test_pchip_of_a_coarser_table_predicts_the_omitted_nodes():
    full = read_density_table(SHIPPED, "marsgram_2021a_sample")
    profile = tabulated(full[::2])
    omitted = full[5:-5:2]
    assert np.abs(np.exp(profile(omitted[:, 0])[0]) / omitted[:, 1] - 1).max() < 0.02


# ---- uniform nodes ----


def curve_of_cells(nodes):
    """ln rho of the cells, looked up as flights do."""
    cells = uniform_cells(nodes.log_density, nodes.slope, nodes.spacing)

    def log_density(altitude):
        position = (np.asarray(altitude) - nodes.bottom) / nodes.spacing + 1.0
        cell = np.clip(position, 0, len(cells) - 1).astype(int)
        return np.polynomial.polynomial.polyval(position - cell, cells[cell].T, tensor=False)

    return log_density


def test_cells_are_the_hermite_cubics_between_the_nodes_and_lines_beyond():
    random = np.random.default_rng(4)
    altitude = 3e3 + 700.0 * np.arange(6)
    value, slope = random.normal(size=6), random.normal(size=6) / 700.0
    nodes = uniform_nodes(lambda h: (value, slope), altitude[0], altitude[-1], 700.0)
    spline = CubicHermiteSpline(altitude, value, slope)
    inside = np.linspace(altitude[0], altitude[-1], 300)
    actual = curve_of_cells(nodes)
    np.testing.assert_allclose(actual(inside), spline(inside), rtol=0, atol=1e-13)
    for end, beyond in (
        (0, altitude[0] - np.array([1.0, 699.0, 5e3])),
        (-1, altitude[-1] + np.array([1.0, 701.0, 5e3])),
    ):
        line = value[end] + slope[end] * (beyond - altitude[end])
        np.testing.assert_allclose(actual(beyond), line, rtol=0, atol=1e-13)


def test_cells_are_the_curve_of_a_table_whose_altitudes_are_nodes(table):
    assert (table[:, 0] % 1e3 == 0).all()
    profile, altitude = tabulated(table), np.linspace(-15e3, 320e3, 33517)
    np.testing.assert_allclose(
        curve_of_cells(uniform_nodes(profile))(altitude), profile(altitude)[0], rtol=0, atol=1e-12
    )


def test_cells_spread_the_jump_of_two_exponential_over_one_cell():
    altitude = np.linspace(-10e3, 200e3, 21001)
    error = np.abs(curve_of_cells(uniform_nodes(two_exponential))(altitude) - two_exponential(altitude)[0])
    jump = (altitude > 24e3) & (altitude < 25e3)
    assert error[~jump].max() < 1e-13
    assert 0.02 < error[jump].max() < 0.04


# ---- by name ----
