"""Density of the air: its mean, and how much it varies."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict, ValidationInfo, WithJsonSchema, model_validator

from marsedl.models.density_table import physical_table, read_density_table
from marsedl.replication.inputs.sections import ARRAY, Number, Positive, Section, given, vector


def _read(value, info: ValidationInfo):
    """The numbers of a table that is written as the name of its file; a relative path starts at the root."""
    return read_density_table(value, folder=info.context["root"]).tolist() if isinstance(value, str) else value


_ROW = {"type": "array", "minItems": 2, "maxItems": 2, "items": {"type": "number"}}
_WRITTEN = {"anyOf": [{"type": "string", "minLength": 1}, {"type": "array", "minItems": 3, "items": _ROW}]}
DensityTable = Annotated[
    tuple[tuple[Number, Number], ...],
    BeforeValidator(_read),
    AfterValidator(physical_table),
    *ARRAY,
    WithJsonSchema(_WRITTEN),
]


Negative = Annotated[float, Strict(), Field(lt=0, allow_inf_nan=False)]


class MeanDensity(Section):
    """The mean density, in papers whose readings choose among profiles (`models.atmosphere.named_profile`)."""

    density_profile: Literal["log_quadratic", "temperature_pressure_fit", "two_exponential", "table"] = given(
        "1", "mean density: a quadratic of ln density, a fit of temperature and pressure, two exponentials, or a table"
    )
    density_coefficients: vector(3) = given(
        "1", "of log_quadratic: quadratic, linear and constant term of ln(kg/m^3) against altitude in 10 km"
    )
    density_upper_altitude: Positive = given("m", "of log_quadratic: altitude above which the scale height is constant")
    density_table: DensityTable | None = given(
        "m, kg/m^3", "of table: a CSV file, or file#source for one of several in it"
    )

    @model_validator(mode="after")
    def _table_is_named(self):
        if self.density_profile == "table" and self.density_table is None:
            raise ValueError("density_profile is 'table', but density_table is empty: write the name of its file")
        return self


class FittedDensity(MeanDensity):
    """The mean density, with the constants of the fit of temperature and pressure among the inputs.

    T = c_3 h^3 + c_2 h^2 + c_1 h + c_0,   p = p_0 exp(k h),   rho = p / (R T),   h the altitude
    """

    temperature_cubic: Number = given("K/m^3", "of temperature_pressure_fit: c_3, the temperature's cubic term")
    temperature_quadratic: Number = given("K/m^2", "of temperature_pressure_fit: c_2, its quadratic term")
    temperature_linear: Number = given("K/m", "of temperature_pressure_fit: c_1, its linear term")
    temperature_constant: Positive = given("K", "of temperature_pressure_fit: c_0, the temperature at the surface")
    surface_pressure: Positive = given("Pa", "of temperature_pressure_fit: p_0, the pressure at the surface")
    pressure_exponent: Negative = given("1/m", "of temperature_pressure_fit: k, by which its logarithm falls")
    gas_constant: Positive = given("J/(kg K)", "of temperature_pressure_fit: R, specific gas constant of the air")


class DensityVariance(Section):
    """Variance of the relative density, which grows exponentially with altitude up to a largest one."""

    variance_at_top: Positive = given("1", "largest variance of the relative density")
    variance_top_altitude: Positive = given("m", "altitude above which the variance is constant")
    variance_growth_length: Positive = given("m", "altitude over which the variance changes by e")
