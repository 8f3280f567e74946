"""Flights that leave their density table are counted and said, in every paper that reads one."""

from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.papers.density import TableExits

HIGHEST = 60e3
TABLE = [[0.0, 1.5e-2], [30e3, 1.0e-3], [HIGHEST, 5.0e-5]]  # kg/m^3; at its top the density falls by e in some 10 km
SHORT = {"density_profile": "table", "density_table": TABLE}
AIR = SimpleNamespace(**SHORT, density_coefficients=None, density_upper_altitude=None)


def test_flights_beyond_a_scale_height_are_counted(caplog):
    ended = np.nan
    exits = TableExits(AIR).count(np.array([[125e3, 60e3, 65e3], [20e3, -5e3, 10e3], [ended, 1e3, -40e3]]))
    exits.say("flights 0 to 2")
    (line,) = caplog.messages
    assert "flights 0 to 2: 2 of 3 beyond the density table by more than a scale height" in line
    assert "from 0 to 60 km" in line and "from -40.0 to 125.0 km" in line
    assert "density_table that reaches further" in line


@pytest.mark.parametrize("altitude", [[0.0, 60e3], [65e3, -3e3]])
def test_flights_within_the_table_are_no_news(caplog, altitude):
    TableExits(AIR).count(np.array(altitude)).say("nominal flight")
    TableExits(SimpleNamespace(density_profile="log_quadratic")).count(np.array([1e9])).say("nominal flight")
    assert caplog.text == ""


def test_nominal_and_flights_of_an_entry_above_its_table_are_said(entry, caplog):
    """Entry at 125 km, the table to 60 km: the air above is an extrapolation."""
    changes = {"density_profile": "table", "density_table": tuple(map(tuple, TABLE))}
    nominal = entry.nominal(**changes)
    assert nominal.altitude[0] == pytest.approx(125e3)
    assert "nominal flight: 1 of 1 beyond the density table" in caplog.text
    gains = entry.gains(**changes)
    caplog.clear()
    entry.fly("corrected", gains, "apollo_time", trials=20, **changes)
    assert "flights 0 to 19: 20 of 20 beyond the density table" in caplog.text
