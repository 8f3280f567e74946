"""The reading's atmosphere: mean density, the random field of its variation, and the tables that flights look up."""

from functools import partial

import numpy as np

from marsedl.models import atmosphere, random_field
from marsedl.papers.random_field import flight
from marsedl.replication.errors import MarsedlError

COARSE = 1e3  # m; tables are cubic between nodes that are multiples of it, and closed fits are as good as exact
LOWEST, HIGHEST = -10e3, 300e3  # m, altitudes of the density table, beyond which ln density is linear


def profile(inputs):
    """The mean density: a function of altitude (m) that returns ln density, its first and second derivative."""
    return atmosphere.named_profile(
        inputs.density_profile,
        coefficients=inputs.density_coefficients,
        upper_altitude=inputs.density_upper_altitude,
        table=inputs.density_table,
    )


def kernel(inputs, **changes):
    """Covariance of the density variation at two altitudes (Eqs. 73-74); changes: other parameters than the inputs'."""
    parameters = {
        "variance": inputs.variance_at_top,
        "upper_altitude": inputs.variance_top_altitude,
        "growth_length": inputs.variance_growth_length,
        "correlation_length": inputs.correlation_length,
        "growth_sign": inputs.variance_growth_sign,
    }
    return partial(random_field.altitude_exponential, **{**parameters, **changes})


def field_grid(inputs):
    """Altitudes at which the variation is sampled, m, ascending."""
    lowest, highest = inputs.field_altitudes
    return np.linspace(lowest, highest, round((highest - lowest) / inputs.field_interval) + 1)


def deviation(inputs, altitude):
    """Standard deviation of the density variation at an altitude."""
    return np.sqrt(kernel(inputs)(altitude, altitude))


def air(inputs, covariance=None):
    """The tables of a flight; covariance: a kernel of the density variation other than the inputs'."""
    coarse = np.arange(LOWEST, HIGHEST + COARSE / 2, COARSE)
    log_density, slope, _ = profile(inputs)(coarse)
    altitudes = field_grid(inputs)
    return flight.Air(
        bottom=LOWEST,
        spacing=COARSE,
        log_density=np.ascontiguousarray(log_density),
        log_density_slope=np.ascontiguousarray(np.broadcast_to(slope, coarse.shape)),
        altitude=altitudes,
        **random_field.markov(covariance or kernel(inputs), altitudes)._asdict(),
    )


def require_in_table(inputs, time, altitude):
    """Refuse a nominal trajectory that leaves the density table, unless the reading continues it."""
    if inputs.density_profile != "table" or inputs.density_beyond_table == "continue":
        return
    lowest, highest = inputs.density_table[0][0], inputs.density_table[-1][0]
    outside = ~((altitude >= lowest) & (altitude <= highest))
    if outside.any():
        first = int(np.argmax(outside))
        raise MarsedlError(
            f"the nominal trajectory leaves the density table ({lowest / 1e3:g} to {highest / 1e3:g} km) at "
            f"{time[first]:g} s, at {altitude[first] / 1e3:.2f} km: give a density_table that reaches further, or "
            "set density_beyond_table to 'continue'"
        )
