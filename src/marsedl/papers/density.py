"""The mean density that a paper's inputs name."""

from marsedl.models import atmosphere
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
