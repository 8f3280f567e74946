"""Mean densities of all papers relative to one of them, and how far densities may be from them."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from marsedl.comparison.records import COLORS, NAMES
from marsedl.papers.density import profile
from marsedl.papers.desensitized import inputs as desensitized_inputs
from marsedl.papers.desensitized.records import Nominal as DesensitizedNominal
from marsedl.papers.funnels import inputs as funnels_inputs
from marsedl.papers.funnels.environment import disturbed_air, log_density
from marsedl.papers.funnels.linearization import Linearization as FunnelsLinearization
from marsedl.papers.powered_descent.gains import Gains as PoweredDescentGains
from marsedl.papers.powered_descent.nominal import Nominal as PoweredDescentNominal
from marsedl.papers.random_field import environment as random_field_environment
from marsedl.papers.random_field import inputs as random_field_inputs
from marsedl.papers.random_field.records import Nominal as RandomFieldNominal
from marsedl.papers.stochastic_entry import environment as stochastic_entry_environment
from marsedl.papers.stochastic_entry import inputs as stochastic_entry_inputs
from marsedl.papers.stochastic_entry.records import Nominal as StochasticEntryNominal
from marsedl.plotting.style import new_figure
from marsedl.replication.records.tables import Column
from marsedl.replication.records.tables import table as table_of
from marsedl.replication.units import KM

if TYPE_CHECKING:
    from pandas import DataFrame

REFERENCE = "random_field"  # its mean density is a table that Mars-GRAM computed, in the corrected reading
ALTITUDE = np.arange(0.0, 125.0 * KM + 1.0, 500.0)  # m, of the figure
TABULATED = np.array([10.0, 30.0, 50.0, 80.0, 120.0]) * KM
PROFILES = {
    "log_quadratic": "quadratic of ln density",
    "temperature_pressure_fit": "fit of temperature and pressure",
    "two_exponential": "two exponentials",
    "table": "table",
}


class Density(NamedTuple):
    """A density model over `ALTITUDE`; None where a paper has no atmosphere."""

    altitude_range: tuple  # lowest and highest altitude of the nominal, m
    mean: str
    dispersion: str
    curve: str  # what `spread` is, in few words
    log_density: np.ndarray | None = None  # of kg/m^3
    factors: tuple | None = None  # between which the density is spread about the mean: least, largest; None: known
    style: str = "-"


def powered_descent(nominal: PoweredDescentNominal, gains: PoweredDescentGains) -> Density:
    """No atmosphere, but noise on the thrust."""
    noise = f"no atmosphere; white noise of {gains.noise_density_plant:g} N sqrt(s) on the thrust"
    return Density(_range(nominal.mean[:, 1]), "none", noise, "")


def random_field(air: random_field_inputs.Air, nominal: RandomFieldNominal) -> Density:
    """A Gaussian random field of altitude."""
    return Density(
        _range(nominal.altitude),
        PROFILES[air.density_profile],
        f"Gaussian field of altitude, correlation length {air.correlation_length / KM:g} km",
        "one standard deviation",
        profile(air)(ALTITUDE)[0],
        _about_one(random_field_environment.deviation(air, ALTITUDE)),
    )


def desensitized(planet: desensitized_inputs.Planet, nominal: DesensitizedNominal) -> Density:
    """A known density."""
    return Density(
        _range(nominal.state[:, 0]),
        PROFILES[planet.density_profile],
        "none",
        "",
        profile(planet)(ALTITUDE)[0],
        style=":",
    )


def funnels(
    planet: funnels_inputs.Planet, uncertainty: funnels_inputs.Uncertainty, linearization: FunnelsLinearization
) -> Density:
    """An exponential whose level and slope lie in a disc, constant in a flight."""
    air = disturbed_air(planet, uncertainty)
    mean = log_density(air, ALTITUDE)
    # The largest of a_1 w_1 + b_1 w_2 h over the unit disc.
    largest = np.hypot(air.density_amplitude, air.density_slope_amplitude * ALTITUDE)
    parametric = air.density_disturbance == "parametric"
    return Density(
        _range(linearization.state[:, 0]),
        "exponential",
        "level and slope of ln density within a disc, constant in a flight",
        "largest error, upwards",
        mean,
        (np.exp(-largest), np.exp(largest)) if parametric else (1.0 - largest, 1.0 + largest),
        "-.",
    )


def stochastic_entry(air: stochastic_entry_inputs.Air, nominal: StochasticEntryNominal) -> Density:
    """A Markov process of altitude."""
    return Density(
        _range(nominal.altitude),
        PROFILES[air.density_profile],
        f"Gaussian Markov process of altitude, decay {air.decay_factor:g} in a scale height",
        "one standard deviation",
        profile(air)(ALTITUDE)[0],
        _about_one(np.sqrt(stochastic_entry_environment.variance(air, ALTITUDE))),
        "--",
    )


def figure(records: dict[str, Density]) -> Figure:
    """Mean densities relative to the reference's, and their dispersions, over altitude."""
    chart, (means, spreads) = new_figure(7.8, 5.6, ncols=2, sharey=True)
    altitude, handles = ALTITUDE / KM, []
    for slug, model in records.items():
        if model.log_density is None:
            name = f"{NAMES[slug]}: no atmosphere, below {model.altitude_range[1]:.0f} m"
            handles += means.plot([], [], linestyle="none", label=name)
            continue
        ratio = np.exp(model.log_density - records[REFERENCE].log_density)
        in_flight = (model.altitude_range[0] <= ALTITUDE) & (model.altitude_range[1] >= ALTITUDE)
        look = {"color": COLORS[slug], "linestyle": model.style}
        means.plot(ratio, altitude, **look, linewidth=0.6)
        means.plot(np.where(in_flight, ratio, np.nan), altitude, **look, linewidth=1.8)
        if model.factors is None:
            handles += means.plot([], [], **look, linewidth=1.6, label=f"{NAMES[slug]}: known")
            continue
        sides = [ratio * factor for factor in model.factors]
        means.fill_betweenx(altitude, *sides, where=in_flight, color=COLORS[slug], alpha=0.15, linewidth=0)
        label = f"{NAMES[slug]}: {model.curve}"
        handles += spreads.plot(100 * (model.factors[1] - 1), altitude, **look, linewidth=1.6, label=label)
    means.set(xscale="log", xlabel=f"density over the mean of the {NAMES[REFERENCE]} paper", ylabel="altitude (km)")
    means.set_ylim(altitude[[0, -1]])
    spreads.set(xscale="log", xlabel="from its mean (%)")
    for axes in (means, spreads):
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
    chart.legend(handles=handles, loc="outside lower center", ncols=2)
    return chart


def table(records: dict[str, Density]) -> "DataFrame":
    """The same at some altitudes."""
    rows = []
    for slug, model in records.items():
        if model.log_density is None:
            rows.append((NAMES[slug], None, False, None, None, model.mean, model.dispersion))
            continue
        explanation = "; ".join(filter(None, (model.dispersion, model.curve)))
        for altitude, node in zip(TABULATED, np.searchsorted(ALTITUDE, TABULATED), strict=True):
            ratio = np.exp(model.log_density[node] - records[REFERENCE].log_density[node])
            in_flight = model.altitude_range[0] <= altitude <= model.altitude_range[1]
            dispersion = None if model.factors is None else 100 * (model.factors[1][node] - 1)
            rows.append((NAMES[slug], altitude / KM, in_flight, ratio, dispersion, model.mean, explanation))
    return table_of(
        rows,
        {
            "paper": Column(),
            "altitude": Column("km", "g"),
            "flown": Column(meaning="whether the nominal comes to this altitude"),
            "mean density over the reference": Column("", ".3f", f"the reference is that of the {NAMES[REFERENCE]}"),
            "dispersion": Column("%", ".2f", "of the mean density"),
            "mean density": Column(),
            "what the dispersion is": Column(),
        },
    )


def _range(altitude):
    return float(altitude.min()), float(altitude.max())


def _about_one(deviation):
    return 1.0 - deviation, 1.0 + deviation
