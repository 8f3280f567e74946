"""The reading's mission and atmosphere: targets, mean density, its random variation, and the tables of flights."""

from functools import partial
from typing import NamedTuple

import numpy as np

from marsedl.models import atmosphere, random_field
from marsedl.papers.density import profile
from marsedl.papers.random_field.inputs import Air, Mission, Planet
from marsedl.replication.errors import MarsedlError


class AirTables(NamedTuple):
    """The density: ln of its mean as cubics between uniform nodes, and its random part as a process down a finer grid.

    Beyond its nodes ln of the mean goes on along the end slopes; the random part is held constant.
    """

    bottom: float  # m, altitude of the first node of the mean
    spacing: float  # m, from one to the next
    log_density: np.ndarray  # (m,), of kg/m^3
    log_density_slope: np.ndarray  # (m,), 1/m
    altitude: np.ndarray  # (n,), m, uniform nodes of the random part, ascending
    retention: np.ndarray  # (n - 1,), factor from the node above
    innovation_deviation: np.ndarray  # (n - 1,), standard deviation of what is new at each node but the top one
    top_deviation: float  # standard deviation at the top node
    mean: float = 0.0  # of the random part, at all altitudes


def targets(planet: Planet, mission: Mission):
    """Target apoapsis, target periapsis (m) and gravitational parameter, as the functions of `orbits` want them."""
    radius = planet.planet_radius
    return mission.target_apoapsis * radius, mission.target_periapsis * radius, planet.gravitational_parameter


def kernel(air: Air):
    """Covariance of the density variation at two altitudes (Eqs. 73-74)."""
    return partial(
        random_field.altitude_exponential,
        variance=air.variance_at_top,
        upper_altitude=air.variance_top_altitude,
        growth_length=air.variance_growth_length,
        correlation_length=air.correlation_length,
        growth_sign=air.variance_growth_sign,
        correlation_altitude=air.correlation_altitude,
    )


def field_grid(air: Air):
    """Altitudes at which the variation is sampled, m, ascending."""
    lowest, highest = air.field_altitudes
    return np.linspace(lowest, highest, round((highest - lowest) / air.field_interval) + 1)


def deviation(air: Air, altitude):
    """Standard deviation of the density variation at an altitude."""
    return np.sqrt(kernel(air)(altitude, altitude))


def air_tables(air: Air):
    """The tables of a flight."""
    altitudes = field_grid(air)
    return AirTables(
        *atmosphere.uniform_nodes(profile(air)),
        altitude=altitudes,
        **random_field.markov(kernel(air), altitudes)._asdict(),
        mean=air.variation_mean,
    )


def mean_density(air: Air, altitude):
    """Mean density at an altitude, kg/m^3: that of the profile with the mean of its variation."""
    return np.exp(profile(air)(altitude)[0]) * (1.0 + air.variation_mean)


def require_in_table(air: Air, time, altitude):
    """Refuse a nominal trajectory that leaves the density table, unless the reading continues it."""
    if air.density_profile != "table" or air.density_beyond_table == "continue":
        return
    lowest, highest = air.density_table[0][0], air.density_table[-1][0]
    outside = ~((altitude >= lowest) & (altitude <= highest))
    if outside.any():
        first = int(np.argmax(outside))
        raise MarsedlError(
            f"the nominal trajectory leaves the density table ({lowest / 1e3:g} to {highest / 1e3:g} km) at "
            f"{time[first]:g} s, at {altitude[first] / 1e3:.2f} km: give a density_table that reaches further, or "
            "set density_beyond_table to 'continue'"
        )
