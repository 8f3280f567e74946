"""The mean density that this paper's inputs name; the constants of its Eq. 4 are inputs, too."""

from marsedl.models import atmosphere
from marsedl.papers.desensitized.inputs import Planet


def profile(planet: Planet):
    """The mean density: a function of altitude (m) that returns ln density, its first and second derivative."""
    return atmosphere.named_profile(planet.density_profile, **_choices(planet))


def log_density(planet: Planet):
    """The logarithm of the mean density (kg/m^3) as a function of altitude (m) that CasADi can trace."""
    return atmosphere.named_log_density(planet.density_profile, **_choices(planet))


def _choices(planet: Planet):
    temperature = (
        *(planet.temperature_constant, planet.temperature_linear),
        *(planet.temperature_quadratic, planet.temperature_cubic),
    )
    return {
        "coefficients": planet.density_coefficients,
        "upper_altitude": planet.density_upper_altitude,
        "table": planet.density_table,
        "fit": atmosphere.TemperaturePressureFit(
            temperature, planet.surface_pressure, -planet.pressure_exponent, planet.gas_constant
        ),
    }
