"""The reading's atmosphere: mean density, its variance, and the tables from which flights look densities up."""

from typing import NamedTuple

import numpy as np

from marsedl.models import density_variation
from marsedl.papers.density import profile

LOWEST, HIGHEST = -10_000.0, 127_000.0  # m, altitudes of the flight's tables


class Air(NamedTuple):
    """What a flight knows of the atmosphere, on a uniform grid of altitudes."""

    altitude: np.ndarray  # (nodes,), m, ascending
    log_density: np.ndarray  # (nodes,), of kg/m^3, mean
    deviation: np.ndarray  # (nodes,), standard deviation of the relative density variation
    retention: np.ndarray  # (nodes - 1,), correlation of the variation between neighbouring nodes


def variance(inputs, altitude):
    """Variance of the relative density variation."""
    if inputs.variance_profile == "mars_gram_2010":
        return density_variation.mars_gram_2010_deviation(altitude) ** 2
    growth = inputs.variance_at_top, inputs.variance_top_altitude, inputs.variance_growth_length
    return density_variation.exponential_variance(altitude, *growth)[0]


def decay_rate(inputs, altitude):
    """Decay rate of the density variation per metre of descent (Remark II.1)."""
    return density_variation.decay_rate(-profile(inputs)(altitude)[1], inputs.decay_factor)


def diffusion(inputs, altitude):
    """Diffusion of the density variation per metre of descent, phi = c zeta / H with c = 4 (Eq. 11)."""
    return inputs.diffusion_factor * variance(inputs, altitude) * -profile(inputs)(altitude)[1]


def undisturbed(air: Air) -> Air:
    """The same atmosphere with the mean density alone."""
    return air._replace(deviation=np.zeros_like(air.deviation))


def air(inputs) -> Air:
    """The tables of a flight."""
    nodes = round((HIGHEST - LOWEST) / inputs.density_grid_interval) + 1
    altitude = np.linspace(LOWEST, HIGHEST, nodes)
    log_density, slope, _ = profile(inputs)(altitude)
    return Air(
        altitude=altitude,
        log_density=np.ascontiguousarray(log_density),
        deviation=np.sqrt(variance(inputs, altitude)),
        retention=density_variation.retention(altitude, density_variation.decay_rate(-slope, inputs.decay_factor)),
    )
