"""The reading's atmosphere: mean density, its variance, and the tables from which flights look densities up."""

from typing import NamedTuple

import numpy as np

from marsedl.models import density_variation
from marsedl.papers.density import profile
from marsedl.papers.stochastic_entry.inputs import Air


class Atmosphere(NamedTuple):
    """What a flight knows of the atmosphere, on a uniform grid of altitudes."""

    altitude: np.ndarray  # (nodes,), m, ascending
    log_density: np.ndarray  # (nodes,), of kg/m^3, mean
    deviation: np.ndarray  # (nodes,), standard deviation of the relative density variation
    log_retention: np.ndarray  # (nodes - 1,), logarithm of the variation's correlation between neighbouring nodes

    @property
    def retention(self):
        """Correlation of the variation between neighbouring nodes, (nodes - 1,)."""
        return np.exp(self.log_retention)


def variance(air: Air, altitude):
    """Variance of the relative density variation."""
    if air.variance_profile == "mars_gram_2010":
        return density_variation.mars_gram_2010_deviation(altitude) ** 2
    growth = air.variance_at_top, air.variance_top_altitude, air.variance_growth_length
    return density_variation.exponential_variance(altitude, *growth)[0]


def decay_rate(air: Air, altitude):
    """Decay rate of the density variation per metre of descent (Remark II.1)."""
    return density_variation.decay_rate(-profile(air)(altitude)[1], air.decay_factor)


def diffusion(air: Air, altitude):
    """Diffusion of the density variation per metre of descent, phi = c zeta / H with c = 4 (Eq. 11)."""
    return air.diffusion_factor * variance(air, altitude) * -profile(air)(altitude)[1]


def undisturbed(atmosphere: Atmosphere) -> Atmosphere:
    """The same atmosphere with the mean density alone."""
    return atmosphere._replace(deviation=np.zeros_like(atmosphere.deviation))


def atmosphere(air: Air) -> Atmosphere:
    """The tables of a flight."""
    lowest, highest = air.lowest_tabulated_altitude, air.highest_tabulated_altitude
    altitude = np.linspace(lowest, highest, round((highest - lowest) / air.density_grid_interval) + 1)
    log_density, slope, _ = profile(air)(altitude)
    return Atmosphere(
        altitude=altitude,
        log_density=np.ascontiguousarray(log_density),
        deviation=np.sqrt(variance(air, altitude)),
        log_retention=density_variation.log_retention(altitude, density_variation.decay_rate(-slope, air.decay_factor)),
    )
