"""Density of the air: its mean, and how much it varies."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, model_validator

from marsedl.models.density_table import physical_table, table_or_file
from marsedl.replication.sections import ARRAY, Number, Positive, Section, given, vector

DensityTable = Annotated[
    tuple[tuple[Number, Number], ...], BeforeValidator(table_or_file), AfterValidator(physical_table), *ARRAY
]


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
            raise ValueError("density_profile is 'table', but density_table names none: write its file")
        return self


class DensityVariance(Section):
    """Variance of the relative density, which grows exponentially with altitude up to a largest one."""

    variance_at_top: Positive = given("1", "largest variance of the relative density")
    variance_top_altitude: Positive = given("m", "altitude above which the variance is constant")
    variance_growth_length: Positive = given("m", "altitude over which the variance changes by e")
