from pathlib import Path

import casadi
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from marsedl.models.atmosphere import (
    TEMPERATURE_PRESSURE_FIT,
    casadi_log_density,
    log_quadratic,
    named_log_density,
    named_profile,
    tabulated,
    temperature_pressure,
    two_exponential,
    uniform_cells,
    uniform_nodes,
)
from marsedl.models.density_table import read_density_table
from three_ways import check_three_ways

SHIPPED = Path(__file__).parents[2] / "data" / "atmosphere" / "mars_density.csv"
CALIBRATED = (-0.0343295, -0.8737816, -4.2342822, 60e3)


def calibrated(altitude):
    return log_quadratic(altitude, *CALIBRATED)


def temperature_pressure_fit(altitude):
    fit = TEMPERATURE_PRESSURE_FIT
    return temperature_pressure(altitude, fit[0], fit[1], fit[2], fit[3])


FITS = [
    pytest.param(calibrated, [60e3], id="log_quadratic"),
    pytest.param(temperature_pressure_fit, [], id="temperature_pressure_fit"),
    pytest.param(two_exponential, [25e3], id="two_exponential"),
]


@pytest.fixture
def table():
    return read_density_table(SHIPPED, "jezero_2021")


# ---- closed fits ----


@pytest.mark.parametrize(("fit", "changes"), FITS)
def test_numpy_numba_and_casadi_agree(fit, changes):
    altitudes = np.concatenate([np.linspace(-10e3, 140e3, 173), changes])
    check_three_ways(fit, altitudes[np.newaxis], rtol=5e-15, atol=1e-25, scaled=False, to_the_bit=False)


@pytest.mark.parametrize(("fit", "changes"), FITS)
def test_derivatives_of_the_fits(fit, changes):
    step = 10.0
    altitudes = np.arange(-9.9e3, 130e3, 777.0)
    altitudes = altitudes[[all(abs(h - change) > step for change in changes) for h in altitudes]]
    (low, low_slope, _), (high, high_slope, _) = fit(altitudes - step), fit(altitudes + step)
    _, slope, curvature = fit(altitudes)
    np.testing.assert_allclose((high - low) / (2 * step), slope, rtol=1e-6)
    np.testing.assert_allclose((high_slope - low_slope) / (2 * step), curvature, rtol=1e-6, atol=1e-16)


def test_log_quadratic_is_smooth_at_the_last_altitude_of_the_parabola():
    below, above = calibrated(np.nextafter(60e3, 0)), calibrated(np.nextafter(60e3, 1e9))
    assert below[:2] == pytest.approx(above[:2], rel=1e-12)
    assert below[2] == pytest.approx(2 * CALIBRATED[0] / 1e8, rel=1e-15)
    assert above[2] == 0
    h = np.array([70e3, 120e3])
    # above: along the tangent
    np.testing.assert_allclose(calibrated(h)[0], calibrated(60e3)[0] + calibrated(60e3)[1] * (h - 60e3), rtol=1e-14)


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


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 1], [1, 0.5], [1, 0.4]], "table, row 2: non-monotone density table"),
        ([0, 1, 2], "shape \\(n, 2\\), got \\(3,\\)"),
    ],
)
@pytest.mark.parametrize("curve", [tabulated, casadi_log_density])
def test_curves_refuse_bad_tables(curve, rows, message):
    with pytest.raises(ValueError, match=message):
        curve(rows)


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


def test_cells_of_smooth_fits_are_as_good_as_exact_and_of_order_four():
    altitude = np.linspace(-10e3, 200e3, 4001)
    exact = temperature_pressure_fit(altitude)[0]
    error = [
        np.abs(curve_of_cells(uniform_nodes(temperature_pressure_fit, spacing=spacing))(altitude) - exact).max()
        for spacing in (4e3, 2e3, 1e3)
    ]
    assert error[-1] < 1e-8
    np.testing.assert_allclose(np.log2(np.divide(error[:-1], error[1:])), 4.0, atol=0.1)


@pytest.mark.parametrize(
    ("log_density", "slope", "spacing"),
    [
        (np.zeros(3), np.zeros(2), 1.0),
        (np.zeros(2), np.array([0.0, np.nan]), 1.0),
        (np.zeros(2), np.zeros(2), 0.0),
    ],
)
def test_cells_refuse_what_is_no_table(log_density, slope, spacing):
    with pytest.raises(ValueError, match="one finite value per node and a positive spacing"):
        uniform_cells(log_density, slope, spacing)


# ---- by name ----

NAMES = ("log_quadratic", "temperature_pressure_fit", "two_exponential", "table")  # a table takes no SX


@pytest.mark.parametrize(
    ("name", "symbol"), [*((name, casadi.MX) for name in NAMES), *((name, casadi.SX) for name in NAMES[:3])]
)
def test_log_density_by_name_is_the_curve_of_the_profile(name, symbol, table):
    casadi.GlobalOptions.setNumpyMode(-1)
    arguments = {"coefficients": CALIBRATED[:3], "upper_altitude": CALIBRATED[3], "table": table}
    altitude = symbol.sym("altitude")
    traced = named_log_density(name, **arguments)(altitude)
    assert traced.shape == (1, 1)
    function = casadi.Function("both", [altitude], [traced, casadi.jacobian(traced, altitude)])
    altitudes = np.linspace(-10e3, 150e3, 641)  # the ends of the parabola, the layers and the table among them
    expected, slope, _ = named_profile(name, **arguments)(altitudes)
    actual = [value.full()[0] for value in function.map(altitudes.size)(altitudes[np.newaxis])]
    np.testing.assert_allclose(actual[0], expected, rtol=1e-12)
    np.testing.assert_allclose(actual[1], slope, rtol=1e-11)
