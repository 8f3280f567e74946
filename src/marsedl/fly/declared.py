"""What a user declares of flights: dispersions, planet and air, each with its checks; and quantities by name."""

from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.models.atmosphere import tabulated
from marsedl.models.correlations import correlations
from marsedl.models.density_table import physical_table, read_density_table
from marsedl.words import remedy, require

__all__ = [
    "MARS",
    "Above",
    "Below",
    "Exponential",
    "Markov",
    "MultivariateNormal",
    "Normal",
    "Planet",
    "Table",
    "Uniform",
]

LEAST_SHARE = 1e-6  # of a normal distribution that lies within its bounds
SUFFIXES = {"_km": ("m", 1e3), "_deg": ("rad", np.pi / 180.0)}


# ---- quantities by name ----------------------------------------------------------------------------------------------


def resolve(name: str, units: Mapping[str, str], what: str) -> tuple[str, float]:
    """Name and SI factor of a quantity, which may have a suffix of unit: `altitude_km`, `flight_path_angle_deg`.

    Args:
        name: as the user writes it. units: known quantities and their units. what: kind of quantity, for messages.

    Returns:
        Tuple of the known name and the factor from the unit of the suffix to SI.

    Raises:
        ValueError: for an unknown name, or a suffix that does not fit the unit.
    """
    if name in units:
        return name, 1.0
    for suffix, (unit, factor) in SUFFIXES.items():
        base = name.removesuffix(suffix)
        if base != name and base in units:
            if units[base] != unit:
                fitting = [f"{base}{other}" for other, (of, _) in SUFFIXES.items() if of == units[base]]
                raise ValueError(
                    f"{what} {name!r}: {base} is in {units[base] or 'a unit that is not declared'}, not in a unit of "
                    f"{suffix}; write {' or '.join([repr(base), *map(repr, fitting)])}"
                )
            return base, factor
    raise ValueError(f"{what} {name!r} is unknown; {remedy(name, units)}")


# ---- dispersions -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, init=False, repr=False)
class Normal:
    """A normally distributed number, or one that is kept within bounds: `Normal(115.0, 80.0, above=0.0)`.

    Args:
        mean, deviation: of the whole distribution. The attributes `mean` and `deviation` are those within the bounds.
        above, below: bounds; the distribution is cut off there and its density within them scaled.
    """

    centre: float
    spread: float
    above: float
    below: float

    def __init__(self, mean, deviation, above=-np.inf, below=np.inf):
        """Take the numbers, which are checked where they are used."""
        for name, value in (("centre", mean), ("spread", deviation), ("above", above), ("below", below)):
            object.__setattr__(self, name, value)

    def __repr__(self):
        """As it is written."""
        above = "" if self.above == -np.inf else f", above={self.above!r}"
        below = "" if self.below == np.inf else f", below={self.below!r}"
        return f"Normal(mean={self.centre!r}, deviation={self.spread!r}{above}{below})"

    @property
    def is_bounded(self) -> bool:
        """Whether it has a bound."""
        return self.above > -np.inf or self.below < np.inf

    @property
    def mean(self):
        """Mean within the bounds."""
        return self.centre + self.spread * self._scaled_moments()[0]

    @property
    def deviation(self):
        """Standard deviation within the bounds."""
        return self.spread * self._scaled_moments()[1]

    def _scaled_moments(self):
        """Mean from the centre, and deviation, in units of the spread."""
        if not self.is_bounded:
            return 0.0, 1.0
        from scipy.stats import truncnorm

        return tuple(map(float, (truncnorm.mean(*self._scaled_bounds()), truncnorm.std(*self._scaled_bounds()))))

    def _scaled_bounds(self):
        """Bounds from the centre, in units of the spread."""
        return (self.above - self.centre) / self.spread, (self.below - self.centre) / self.spread

    def share_within(self):
        """Probability of the whole distribution that lies within the bounds; not positive if nothing does."""
        from scipy.special import ndtr

        low, high = self._scaled_bounds()
        return ndtr(high) - ndtr(low) if low < 0.0 else ndtr(-low) - ndtr(-high)

    def of_normals(self, z):
        """Numbers made of standard normals: those within bounds by their quantiles."""
        if not self.is_bounded:
            return self.centre + self.spread * z
        from scipy.special import ndtr, ndtri

        low, high = self._scaled_bounds()
        # Both tails are sums of positive numbers, so that neither loses digits.
        lower_tail = ndtr(low) * ndtr(-z) + ndtr(high) * ndtr(z)
        upper_tail = ndtr(-low) * ndtr(-z) + ndtr(-high) * ndtr(z)
        scaled = np.where(lower_tail < 0.5, ndtri(lower_tail), -ndtri(upper_tail))
        return np.clip(self.centre + self.spread * scaled, self.above, self.below)


@dataclass(frozen=True)
class Uniform:
    """A number that is uniformly distributed between two bounds."""

    low: float
    high: float

    @property
    def mean(self):
        """The middle."""
        return 0.5 * (self.low + self.high)

    def of_normals(self, z):
        """Numbers made of standard normals, by their distribution function."""
        from scipy.special import ndtr

        return self.low + (self.high - self.low) * ndtr(z)


@dataclass(frozen=True, eq=False)
class MultivariateNormal:
    """Numbers that are normally distributed together: means (n,), covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray

    def root(self):
        """Symmetric root of the covariance, each component in units of its deviation: (n,) deviations, (n, n).

        Raises ValueError for what is no covariance, whatever the units of its components are.
        """
        from marsedl.models.random_field import root

        deviations, scaled = correlations("the covariance", self.covariance)
        return deviations, root(scaled)


class Column(NamedTuple):
    """A number for each trial, given one by one."""

    values: np.ndarray  # (trials,)
    mean: float
    said: str  # of the name, before the number of a row, in messages


def is_number(value) -> bool:
    """Whether it is a finite number, of Python or of numpy."""
    return isinstance(value, int | float | np.number) and bool(np.isfinite(value))


def require_numbers(parts, what):
    """Refuse dispersions, and words among the members of a tuple, at any depth. Raises ValueError."""
    require(
        not isinstance(parts, Normal | Uniform | MultivariateNormal),
        f"{what} is {parts!r}: give a number; start and the vehicle's numbers take dispersions",
    )
    if not isinstance(parts, tuple):
        return
    for name, value in zip(getattr(parts, "_fields", range(len(parts))), parts, strict=True):
        require(not isinstance(value, str | None), f"{what}.{name} is {value!r}: give a number")
        require_numbers(value, f"{what}.{name}")


def numbers_of(given, what):
    """An array of floats. Raises ValueError for what is none, such as one that holds dispersions."""
    try:
        return np.array(given, float)
    except (TypeError, ValueError):
        raise ValueError(f"{what} {' '.join(repr(given).split())}: give numbers") from None


class Declared(NamedTuple):
    """Numbers of a flight by name, some dispersed; normal number i of a trial belongs to name i, dispersed or not.

    So a dispersion that is added leaves all others as they are.
    """

    names: tuple[str, ...]
    means: tuple[float, ...]
    single: tuple[tuple[int, Normal | Uniform, float], ...]  # place, distribution, SI factor
    joint: tuple[tuple[tuple[int, ...], np.ndarray], ...]  # places, root of the covariance
    sampled: tuple[tuple[int, np.ndarray], ...] = ()  # place, a number for each trial

    def dispersed(self) -> list[str]:
        """Names that are dispersed, in order."""
        places = {place for place, *_ in self.single} | {place for places, _ in self.joint for place in places}
        return [self.names[place] for place in sorted(places | {place for place, _ in self.sampled})]

    def sample(self, seed, stream, trials, bounds=None, only=None):
        """Values (names, trials) of these trials; refused if one lies beyond the bounds of its name.

        only: the one normal of each trial that is not zero, see `streams.normals`.
        """
        return self.of_normals(self.normals(seed, stream, trials, only), trials, bounds)

    def normals(self, seed, stream, trials, only=None):
        """Standard normals of these trials, (names, trials), none if nothing is made of them."""
        from marsedl.montecarlo.streams import normals

        return normals(seed, stream, trials, len(self.names), only).T if self.single or self.joint else None

    def of_normals(self, z, trials, bounds=None):
        """As `sample`, made of standard normals."""
        values = np.tile(np.reshape(self.means, (-1, 1)), len(trials))
        for place, distribution, factor in self.single:
            values[place] = factor * distribution.of_normals(z[place])
        for places, root in self.joint:
            # Not a matrix product, whose sums depend on the number of trials.
            values[list(places)] += sum(np.outer(column, z[k]) for column, k in zip(root.T, places, strict=True))
        for place, column in self.sampled:
            require(
                trials[-1] < column.size,
                f"the samples have {column.size:,} rows, for the trials 0 to {column.size - 1:,}, and trial "
                f"{trials[-1]:,} is asked for: fly fewer trials or give more rows",
            )
            values[place] = column[np.asarray(trials)]
        for name in [name for name in self.names if name in (bounds or {})]:
            (low, high), drawn = bounds[name], values[self.names.index(name)]
            beyond = np.flatnonzero(~((low <= drawn) & (drawn <= high)))
            if beyond.size:
                raise ValueError(
                    f"{name} {within(low, high)}, but {beyond.size:,} of the trials {trials[0]:,} to {trials[-1]:,} "
                    f"draw others, such as {drawn[beyond[0]]:.4g} in trial {trials[beyond[0]]:,}: give a smaller "
                    f"deviation, Normal(mean, deviation, above=..., below=...) or Uniform(low, high)"
                )
        return values


def within(low, high):
    """What a number that lies within bounds must do, in words."""
    if high < np.inf:
        return f"must lie between {low:.4g} and {high:.4g}"
    return {0.0: "must not be negative", POSITIVE[0]: "must be positive"}.get(low, f"must be at least {low:g}")


POSITIVE, NOT_NEGATIVE, QUARTER_TURN = (5e-324, np.inf), (0.0, np.inf), (-np.pi / 2, np.pi / 2)


def declare(given, units, defaults, what, bounds) -> Declared:
    """Check numbers and dispersions that a user gives by name.

    Args:
        given: mapping from names, or tuples of names, to numbers and dispersions.
        units: unit of every name. defaults: values of those that need not be given. what: for messages.
        bounds: lowest and highest value of a name, for those that have them.

    Raises:
        ValueError: for an unknown or missing name, a wrong suffix, a number that is not finite or is an angle in
            degrees by its size or lies beyond its bounds, a negative deviation, or a covariance that is none.
    """
    require(
        isinstance(given, Mapping),
        f"{what} is of type {type(given).__name__}: give a mapping from names to numbers; it has {', '.join(units)}",
    )
    names, means, single, joint, sampled, seen = tuple(units), dict(defaults), [], [], [], set()

    def number(value, name):
        require(
            is_number(value), f"{what} {name!r} is {value!r}; give a finite number, Normal(mean, deviation) or Uniform"
        )
        return float(value)

    def accept(written, mean):
        name, factor = resolve(written, units, what)
        require(
            units[name] != "rad" or abs(mean * factor) <= 2.0 * np.pi,
            f"{what} {written!r} is {mean:g} rad, more than a turn; for degrees write '{name}_deg'",
        )
        low, high = bounds.get(name, (-np.inf, np.inf))
        degrees = f"; for degrees write '{name}_deg'" if units[name] == "rad" and name == written else ""
        require(
            low <= mean * factor <= high,
            f"{what} {written!r} is {mean:g}; it {within(low / factor, high / factor)}{degrees}",
        )
        require(name not in seen, f"{what} {name!r} is given twice; give it once")
        seen.add(name)
        means[name] = factor * mean
        return names.index(name), factor

    for key, value in given.items():
        if isinstance(key, tuple):
            require(
                isinstance(value, MultivariateNormal),
                f"{what} {key}: several names take MultivariateNormal(means, covariance)",
            )
            mean = numbers_of(value.mean, f"{what} {key}: the means are")
            covariance = numbers_of(value.covariance, f"{what} {key}: the covariance is")
            require(
                mean.shape == (len(key),) and covariance.shape == (len(key), len(key)),
                f"{what} {key}: means {mean.shape} and covariance {covariance.shape} do not fit them",
            )
            accepted = [accept(name, number(middle, name)) for name, middle in zip(key, mean, strict=True)]
            places, factors = zip(*accepted, strict=True)
            try:
                deviations, root = MultivariateNormal(mean, covariance).root()
            except ValueError:
                raise ValueError(
                    f"{what} {key}: the covariance is not symmetric with eigenvalues of at least zero, or has "
                    f"correlations beyond -1 and 1"
                ) from None
            joint.append((places, np.reshape(np.multiply(factors, deviations), (-1, 1)) * root))
        elif isinstance(value, Normal | Uniform):
            value = _checked(value, f"{what} {key!r}", lambda part, key=key: number(part, key))
            place, factor = accept(key, value.mean)
            single.append((place, value, factor))
        elif isinstance(value, Column):
            place, factor = accept(key, value.mean)
            low, high = bounds.get(names[place], (-np.inf, np.inf))
            for row in np.flatnonzero(~((low <= factor * value.values) & (factor * value.values <= high)))[:1]:
                raise ValueError(
                    f"{value.said.format(key)} {row} is {value.values[row]:g}; it {within(low / factor, high / factor)}"
                )
            sampled.append((place, factor * value.values))
        else:
            accept(key, number(value, key))
    for name in names:
        require(
            name in means, f"{what} {name!r} is missing; it needs {', '.join(n for n in names if n not in defaults)}"
        )
    return Declared(names, tuple(means[name] for name in names), tuple(single), tuple(joint), tuple(sampled))


def _checked(distribution, what, number):
    """A distribution of checked numbers; `number` checks one. Raises ValueError."""
    if isinstance(distribution, Uniform):
        distribution = Uniform(number(distribution.low), number(distribution.high))
        require(
            distribution.low <= distribution.high,
            f"{what} is {distribution}; a deviation is not negative, and low not above high",
        )
        return distribution
    bounds = (
        bound if bound in (-np.inf, np.inf) else number(bound) for bound in (distribution.above, distribution.below)
    )
    normal = Normal(number(distribution.centre), number(distribution.spread), *bounds)
    require(normal.spread >= 0.0, f"{what} is {normal}; a deviation is not negative, and low not above high")
    require(
        not normal.is_bounded or (normal.spread > 0.0 and normal.share_within() >= LEAST_SHARE),
        f"{what} is {normal}, of which nearly nothing lies within the bounds; give wider bounds, a positive deviation",
    )
    return normal


# ---- triggers --------------------------------------------------------------------------------------------------------


class Below(NamedTuple):
    """A quantity below a value: as trigger, which ends a flight where it falls there; as limit of a design.

    A trigger names a number of the state, one that is sensed, or the time. A limit (`marsedl.design`) may be a function
    of `state` or of `command`, and has the probability with which it may be violated.
    """

    quantity: str | Callable
    value: float
    probability: float | None = None


class Above(NamedTuple):
    """A quantity above a value: as trigger, which ends a flight where it rises there; as limit, as `Below`."""

    quantity: str | Callable
    value: float
    probability: float | None = None


# ---- planet and air --------------------------------------------------------------------------------------------------


class Planet(NamedTuple):
    """A rotating sphere."""

    gravitational_parameter: float  # m^3/s^2
    radius: float  # m
    rotation_rate: float  # rad/s


MARS = Planet(4.2828e13, 3389.5e3, 7.0882e-5)


class Exponential(NamedTuple):
    """Air whose density falls exponentially with altitude; by default roughly that of Mars."""

    surface_density: float = 0.0159  # kg/m^3
    scale_height: float = 10.5e3  # m

    def profile(self):
        """The profile, see `models.atmosphere`. Raises ValueError for numbers that are no air's."""
        require_numbers(self, "Exponential")
        require(
            self.surface_density > 0.0 and self.scale_height > 0.0,
            f"{self}: density and scale height must be positive; for no air at all give air=None",
        )
        surface, slope = np.log(self.surface_density), -1.0 / self.scale_height
        return lambda altitude: (surface - altitude / self.scale_height, slope, 0.0)

    def log_density(self, altitude):
        """Logarithm of the density in kg/m^3. Raises ValueError for numbers that are no air's."""
        return self.profile()(altitude)[0]


class Table(NamedTuple):
    """Air of a table: a CSV file, or altitude and density as arrays.

    Between its rows the logarithm of the density is a monotone cubic; beyond them it goes on along its end slopes, as
    in all papers (`models.atmosphere.tabulated`).


    The file is as `density_table.read_density_table` reads it: columns altitude_km or altitude_m, and density_kg_m3.
    """

    source: str | Path | np.ndarray  # file, or altitude (m) and density (kg/m^3), (n, 2)

    def rows(self):
        """Altitude (m) and density (kg/m^3) of the rows, (n, 2). Raises ValueError for what is no density table."""
        if isinstance(self.source, str | Path):
            return read_density_table(self.source)
        rows = numbers_of(self.source, "the table of air is")
        require(
            rows.ndim == 2 and rows.shape[1] == 2,
            f"a table of air has rows of altitude (m) and density (kg/m^3), not shape {rows.shape}",
        )
        return physical_table(rows)

    def profile(self):
        """The profile, see `models.atmosphere`. Raises ValueError for what is no density table."""
        return tabulated(self.rows())

    def log_density(self, altitude):
        """Logarithm of the density in kg/m^3. Raises ValueError for what is no density table."""
        return self.profile()(altitude)[0]


@dataclass(frozen=True)
class Markov:
    """Relative variation of the density: an Ornstein-Uhlenbeck process over altitude, another one in every trial.

    Its correlation over the difference d of two altitudes is exp(-d / correlation_length). Where 1 + variation is
    negative, the density is zero.

    Args:
        deviation: standard deviation, 1: a number, or a function of the altitude (m) such as
            `models.density_variation.mars_gram_2010_deviation`.
        correlation_length: m.
        bottom, top: altitudes (m) between which it varies; beyond them it stays constant.
        spacing: of the nodes of altitude, m; linear between them.
    """

    deviation: float | Callable
    correlation_length: float
    bottom: float = -5e3
    top: float = 130e3
    spacing: float = 500.0

    def __post_init__(self):
        """Refuse dispersions, and lengths that are not positive."""
        require_numbers(namedtuple("Given", vars(self))(**vars(self)), "Markov")
        for name in ("correlation_length", "spacing"):
            require(getattr(self, name) > 0.0, f"Markov air: {name} is {getattr(self, name)!r} m; it must be positive")
        require(self.top > self.bottom, f"Markov air: top ({self.top} m) must lie above bottom ({self.bottom} m)")

    @property
    def retention(self):
        """Correlation of neighbouring nodes."""
        return float(np.exp(-self.spacing / self.correlation_length))

    def nodes(self):
        """Altitudes, m, from the bottom up."""
        return self.bottom + self.spacing * np.arange(int(np.ceil((self.top - self.bottom) / self.spacing)) + 1)

    def deviations(self):
        """Standard deviation at the nodes. Raises ValueError if one is negative."""
        values = self.deviation(self.nodes()) if callable(self.deviation) else self.deviation
        values = np.broadcast_to(np.asarray(values, float), self.nodes().shape).copy()
        require((values >= 0.0).all(), "Markov air: the deviation must not be negative, at any altitude")
        return values
