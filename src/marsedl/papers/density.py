"""The mean density that a paper's inputs name; they are those of `papers.density_inputs`."""

from marsedl.models import atmosphere


def profile(inputs):
    """The mean density: a function of altitude (m) that returns ln density, its first and second derivative."""
    return atmosphere.named_profile(inputs.density_profile, **_choices(inputs))


def log_density(inputs):
    """The logarithm of the mean density (kg/m^3) as a function of altitude (m) that CasADi can trace."""
    return atmosphere.named_log_density(inputs.density_profile, **_choices(inputs))


def _choices(inputs):
    return {
        "coefficients": inputs.density_coefficients,
        "upper_altitude": inputs.density_upper_altitude,
        "table": inputs.density_table,
    }
