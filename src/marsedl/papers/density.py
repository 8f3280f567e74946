"""The mean density that a paper's inputs name, and which flights leave its table."""

import logging
from collections.abc import Callable

import numpy as np

from marsedl.models import atmosphere
from marsedl.replication.errors import NOTES
from marsedl.sections.air import MeanDensity


def profile(air: MeanDensity):
    """The mean density: a function of altitude (m) that returns ln density, its first and second derivative."""
    return atmosphere.named_profile(air.density_profile, **_choices(air))


def log_density(air: MeanDensity):
    """The logarithm of the mean density (kg/m^3) as a function of altitude (m) that CasADi can trace."""
    return atmosphere.named_log_density(air.density_profile, **_choices(air))


def _choices(air: MeanDensity):
    return {
        "coefficients": air.density_coefficients,
        "upper_altitude": air.density_upper_altitude,
        "table": air.density_table,
    }


class TableExits:
    """Counts flights that leave a reading's density table by more than a scale height, where its end slopes go on."""

    def __init__(self, air: MeanDensity):
        """Take where flights may be; without a table they may be everywhere."""
        self.lowest, self.highest, self.table = -np.inf, np.inf, ()
        self.flights, self.outside, self.furthest = 0, 0, (np.inf, -np.inf)
        if air.density_profile == "table":
            self.table = ends = np.array([air.density_table[0][0], air.density_table[-1][0]])
            scale_heights = np.abs(1.0 / profile(air)(ends)[1])
            self.lowest, self.highest = ends + [-1.0, 1.0] * scale_heights

    def count(self, altitude: np.ndarray) -> "TableExits":
        """Count flights; altitude: (points,) or (points, flights), m, NaN beyond a flight's end. Returns itself."""
        altitude = altitude.reshape(len(altitude), -1)
        low, high = np.fmin.reduce(altitude), np.fmax.reduce(altitude)
        self.flights += altitude.shape[1]
        self.outside += np.count_nonzero((low < self.lowest) | (high > self.highest))
        self.furthest = min(self.furthest[0], *low), max(self.furthest[1], *high)
        return self

    def watching(self, simulate_block: Callable) -> Callable:
        """Return the same function, whose flights are counted; their history begins with the altitude."""

        def watched(first, last):
            flights = simulate_block(first, last)
            self.count(np.where(flights.after_end, np.nan, flights.history[:, 0]))
            return flights

        return watched if len(self.table) else simulate_block

    def say(self, what: str) -> None:
        """Say in one line of the log how many left the table, if any did."""
        if self.outside:
            (bottom, top), (low, high) = (np.array(ends) / 1e3 for ends in (self.table, self.furthest))
            logging.getLogger(NOTES).warning(
                f"{what}: {self.outside:,} of {self.flights:,} beyond the density table by more than a scale height "
                f"(it goes from {bottom:g} to {top:g} km, they from {low:.1f} to {high:.1f} km), where its end slopes "
                "go on: give a density_table that reaches further"
            )
