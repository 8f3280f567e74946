"""Air of a trial's own: profiles of density that are given, and wind."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marsedl.fly.declared import Markov, Table, is_number, numbers_of
from marsedl.models.density_table import physical_table
from marsedl.words import require

__all__ = ["Profiles", "Wind"]

AIR, ZONAL, MERIDIONAL = 2, 6, 7  # streams of random numbers; `campaign` has the others
WIND_SPACING, WIND_BOTTOM, WIND_TOP = 250.0, -5e3, 150e3  # of the nodes of a mean wind, m, where it asks for no others
MOST_NODES = 10_000


class OwnAir(NamedTuple):
    """Nodes over altitude, and what a trial has there."""

    bottom: float  # m
    spacing: float  # m
    nodes: int
    sample: Callable  # (seed, trials, the phase's first stream, only) -> (nodes, trials); only: see `streams.normals`
    normals: tuple[tuple[str, int, int], ...] | None = ()  # name, stream and count of what it is made of; None: given


# ---- density ---------------------------------------------------------------------------------------------------------


class Profiles:
    """Air whose density is given trial by trial: trial i flies profile i.

    Between the altitudes the logarithm of the geometric mean of all profiles is a monotone cubic, and the ratio to it
    is linear; beyond them the ratio stays as it is, and the mean goes on as that of a `Table`.
    """

    def __init__(self, source):
        """Take the profiles.

        Args:
            source: CSV file with a row of names, of which the first is altitude_km or altitude_m; or an array. The
                first column is the altitude (m in arrays), every further one the density of a trial (kg/m^3).

        Raises:
            ValueError: for altitudes that do not rise, a density that is not positive or rises with the altitude.
        """
        import pandas as pd

        if isinstance(source, str | Path):
            frame = pd.read_csv(source, skipinitialspace=True)
            units = {"altitude_km": 1e3, "altitude_m": 1.0}
            require(
                frame.columns[0] in units,
                f"{source}: the first column is {frame.columns[0]!r}; it must be altitude_km or altitude_m",
            )
            columns = frame.apply(pd.to_numeric, errors="coerce").to_numpy(float, copy=True)
            columns[:, 0] *= units[frame.columns[0]]
        else:
            columns = numbers_of(source, "the profiles of air are")
        require(
            columns.ndim == 2 and columns.shape[1] > 1,
            f"profiles have rows of altitude (m) and a density (kg/m^3) for each trial, not shape {columns.shape}",
        )
        for trial in range(columns.shape[1] - 1):
            try:
                physical_table(columns[:, [0, trial + 1]])
            except ValueError as error:
                raise ValueError(f"profile {trial}: {error}") from None
        self.columns = columns

    def mean(self) -> Table:
        """Geometric mean of all."""
        return Table(np.column_stack([self.columns[:, 0], np.exp(np.log(self.columns[:, 1:]).mean(axis=1))]))

    def profile(self):
        """The profile of the mean, see `models.atmosphere`."""
        return self.mean().profile()

    def own(self) -> OwnAir:
        """Their relative variations from the mean at nodes as near as the nearest altitudes."""
        altitude, mean = self.columns[:, 0], self.mean().source[:, 1:]
        spacing = float(np.diff(altitude).min())
        nodes = int(np.ceil((altitude[-1] - altitude[0]) / spacing - 1e-9)) + 1
        require(nodes <= MOST_NODES, f"profiles: two altitudes are {spacing:g} m apart; leave one out")
        at_nodes = altitude[0] + spacing * np.arange(nodes)
        variations = self.columns[:, 1:] / mean - 1.0

        def sample(seed, trials, first_stream=0, only=None):
            require(
                trials[-1] < variations.shape[1],
                f"there are {variations.shape[1]:,} profiles of air, and trial {trials[-1]:,} is asked for: fly fewer "
                f"trials or give more profiles",
            )
            return np.column_stack([np.interp(at_nodes, altitude, variations[:, trial]) for trial in trials])

        return OwnAir(float(altitude[0]), spacing, nodes, sample, None)


def varied(markov) -> OwnAir:
    """Relative variations of the density, or none, as a flight's own `vary` makes them of the same random numbers."""
    if markov is None:
        return OwnAir(0.0, 1.0, 2, lambda seed, trials, *_: np.zeros((2, len(trials))))
    count = markov.nodes().size
    return OwnAir(
        float(markov.bottom),
        float(markov.spacing),
        count,
        lambda seed, trials, first_stream=0, only=None: process(markov, first_stream + AIR, seed, trials, only),
        (("air", AIR, count),),
    )


def process(markov, stream, seed, trials, only=None):
    """An Ornstein-Uhlenbeck process at its nodes, (nodes, trials), from the highest one down."""
    from marsedl.montecarlo.streams import normals

    deviations, retention = markov.deviations(), markov.retention
    fresh = np.sqrt((1.0 - retention) * (1.0 + retention))
    z = normals(seed, stream, trials, deviations.size, only).T
    values, scaled = np.empty(z.shape), z[0]
    for number, node in enumerate(reversed(range(deviations.size))):
        scaled = retention * scaled + fresh * z[number] if number else scaled
        values[node] = deviations[node] * scaled
    return values


# ---- wind ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Wind:
    """Horizontal wind: a mean over altitude, and a variation that is another one in every trial.

    Args:
        zonal, meridional: mean wind to the east and to the north, m/s, in the frame that rotates with the planet: a
            number, a function of the altitude (m), or rows of altitude (m) and wind, (n, 2), constant beyond them.
            Flights have it at nodes 250 m apart, or as near as the rows or the spacing of the variation, and linearly
            between.
        variation: `Markov`, whose deviation is in m/s; each component has its own process of it. Or None.
    """

    zonal: float | Callable | np.ndarray = 0.0
    meridional: float | Callable | np.ndarray = 0.0
    variation: Markov | None = None

    def own(self) -> OwnAir:
        """At its nodes the zonal wind, and after these the meridional one. Raises ValueError for what is no wind."""
        means = [_mean_wind(name, getattr(self, name)) for name in ("zonal", "meridional")]
        require(
            self.variation is None or isinstance(self.variation, Markov),
            f"wind: variation is {self.variation!r}; give Markov(deviation in m/s, correlation_length), or None",
        )
        rows = np.concatenate([np.array([WIND_BOTTOM, WIND_TOP]), *(altitudes for _, altitudes in means)])
        apart = [np.diff(altitudes).min() for _, altitudes in means if altitudes.size > 1]
        spacing, bottom, above = min([WIND_SPACING, *apart]), rows.min(), 0
        if self.variation:
            spacing = float(self.variation.spacing)
            inner = self.variation.nodes()
            below = int(np.ceil(max(inner[0] - rows.min(), 0.0) / spacing))
            above = int(np.ceil(max(rows.max() - inner[-1], 0.0) / spacing))
            bottom, count = inner[0] - spacing * below, below + inner.size + above
        else:
            count = int(np.ceil((rows.max() - bottom) / spacing)) + 1
        require(count <= MOST_NODES, f"wind: nodes {spacing:g} m apart would be {count:,}; give rows farther apart")
        altitudes = bottom + spacing * np.arange(count)
        at_nodes = [np.broadcast_to(np.asarray(mean(altitudes), float), count) for mean, _ in means]
        require(np.isfinite(at_nodes).all(), "wind: its mean is not finite at all altitudes; give m/s")

        def sample(seed, trials, first_stream=0, only=None):
            values = np.repeat(np.reshape(at_nodes, (-1, 1)), len(trials), axis=1)
            for row, stream in enumerate((ZONAL, MERIDIONAL) if self.variation else ()):
                varied = process(self.variation, first_stream + stream, seed, trials, only)
                values[row * count : (row + 1) * count] += np.pad(varied, ((below, above), (0, 0)), mode="edge")
            return values

        each = (("zonal wind", ZONAL), ("meridional wind", MERIDIONAL)) if self.variation else ()
        drawn = tuple((name, stream, self.variation.nodes().size) for name, stream in each)
        return OwnAir(float(bottom), float(spacing), 2 * count, sample, drawn)


def _mean_wind(name, given):
    """A mean wind as a function of the altitude, and the altitudes of its rows. Raises ValueError."""
    if callable(given):
        return given, np.empty(0)
    if is_number(given):
        return (lambda altitude: float(given)), np.empty(0)
    rows = numbers_of(given, f"wind: {name} is")
    require(
        rows.ndim == 2 and rows.shape[1] == 2 and len(rows) > 1 and (np.diff(rows[:, 0]) > 0.0).all(),
        f"wind: {name} is {' '.join(repr(given).split())}; give m/s as a number, a function of the altitude, or rows "
        f"of altitude (m), rising, and wind",
    )
    return (lambda altitude: np.interp(altitude, *rows.T)), rows[:, 0]


def beside(density, wind) -> OwnAir:
    """Variations of the density, and wind after them."""

    def sample(*of):
        return np.concatenate([density.sample(*of), wind.sample(*of)])

    drawn = None if density.normals is None else density.normals + wind.normals
    return OwnAir(density.bottom, density.spacing, density.nodes + wind.nodes, sample, drawn)
