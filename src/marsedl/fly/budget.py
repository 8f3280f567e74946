"""Which deviation each source of error gives a result: linear covariance analysis by perturbed flights.

Every flight is made of independent standard normal numbers. Those that move one of them alone give the slope of the
result along it, through law, memory, limits, air and trigger; the squares of the slopes add up to the variance.
"""

from dataclasses import dataclass
from itertools import product
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np

from marsedl.fly.declared import Uniform
from marsedl.words import missing, require

__all__ = ["Budget"]

STEPS = (0.25, 1.0)  # deviations, to both sides: slopes are those of the first, the second tells whether they hold
FEWEST = 100  # flights whose deviation is compared
ROUNDING = 1e-12  # of the result, by which ends of flights differ without a reason
WIDTH = 30  # characters of a line of a source in pictures
SURE = 3.0  # standard errors of what is flown, beyond which it counts


class Source(NamedTuple):
    """One independent normal number, and what it belongs to."""

    kind: str  # start, vehicle, senses, air, navigation or noise
    name: str
    stream: int
    number: int
    uniform: bool  # whether a uniform number is made of it


@dataclass(frozen=True, eq=False, repr=False)
class Budget:
    """Deviation of a quantity by linear covariance, and its sources; see `Flights.budget`."""

    quantity: str
    unit: str
    deviation: float  # by the perturbed flights
    flown: float  # of the flights that were flown, NaN of fewer than 100
    flown_error: float  # its standard error
    shares: Any  # data frame: kind, source, share (of the variance), deviation (that it gives by itself)
    flights: int  # that were perturbed
    notes: tuple[str, ...]  # where it is not linear, in sentences; none if it is

    @property
    def linear(self) -> bool:
        """Whether linear covariance holds within the tolerance."""
        return not self.notes

    def __repr__(self):
        """Deviation, shares and notes."""
        return "\n".join(
            [
                f"{self.quantity}: {self.deviation:.4g} {self.unit} by {self.flights:,} perturbed flights; flown "
                f"{self.flown:.4g} +- {self.flown_error:.2g} {self.unit}",
                self.shares.to_string(index=False, float_format="{:.4g}".format),
                *(f"not linear: {note}" for note in self.notes),
            ]
        )

    def plot(self, axes=None):
        """Bars of the shares, the largest on top, on these axes of matplotlib or new ones; returns the axes."""
        try:
            import matplotlib.pyplot as plt
        except ModuleNotFoundError as error:
            raise missing(error, "figures") from None
        axes = axes or plt.figure(layout="constrained").add_subplot()
        rows = self.shares[::-1]
        bars = axes.barh([fill(source, WIDTH) for source in rows["source"]], 100.0 * rows["share"])
        axes.bar_label(bars, [f"{deviation:.3g} {self.unit}" for deviation in rows["deviation"]], padding=3)
        title = f"{self.quantity}: standard deviation {self.deviation:.4g} {self.unit}"
        axes.set_title(title + ("" if self.linear else ", not linear"))
        axes.set_xlabel("share of the variance (%), and the deviation by this source alone")
        axes.set(xlim=(0.0, 120.0), xticks=range(0, 101, 20))
        return axes


def sources_of(campaign, in_python=False) -> list[Source]:
    """The independent normal numbers of a flight, up to the end of that without errors: later ones move nothing.

    Raises ValueError if there are none.
    """
    from marsedl.fly.campaign import AIR, NAVIGATION, NOISE, SENSES, START, VEHICLE

    senses, flight, model = campaign.senses, campaign.flight(), campaign.model
    own_air = model.air.normals if model.air else (("air", AIR, model.nodes),) if flight.functions["vary"] else ()
    given = {
        "the start is the end of another phase": campaign.before,
        "Samples are given": campaign.start.sampled or campaign.vehicle.sampled,
        "profiles of air are given": own_air is None,
    }
    for what in (what for what, is_so in given.items() if is_so):
        raise ValueError(f"{what}, not made of normal numbers: a budget moves these; see explains(...)")
    sources = [
        *_declared("start", campaign.start, START, campaign.together.blocks),
        *_declared("vehicle", campaign.vehicle, VEHICLE, campaign.together.blocks),
        *(_declared("senses", senses.declared, SENSES) if senses.constants else ()),
    ]
    sources += [Source("air", name, stream, node, False) for name, stream, nodes in own_air for node in range(nodes)]
    calm = campaign.perturbed(np.zeros((3, 1)))
    flown = calm.fly(range(1), calm.period / calm.substeps, in_python)
    steps = min(int(flown.length[0]), int(calm.schedule().steps.sum()))
    drawn = {
        ("navigation", NAVIGATION): (-(-steps // calm.substeps), flight.options["draws"]._fields, ""),
        ("noise", NOISE): (steps, flight.options["noise"]._fields, "noise_"),
    }
    still = {
        f"{name}_{part}"
        for (name, kind), numbers in zip(senses.kinds, senses.numbers, strict=True)
        for part, deviation in zip(("walk", "noise"), numbers, strict=False)
        if kind == "error" and deviation == 0.0
    }
    sources += [
        Source(kind, prefix + name, stream, number, False)
        for (kind, stream), (times, names, prefix) in drawn.items()
        for number, (_, name) in enumerate(product(range(int(times)), names))
        if kind != "navigation" or name not in still
    ]
    require(sources, "nothing is dispersed in these flights: a budget takes Normal(...), Uniform, Markov air or noise")
    return sources


def _declared(kind, declared, stream, blocks=()):
    """Sources among numbers by name; those that are drawn together are one.

    blocks: of `together.Together`, which correlate numbers of the start (0) and of the vehicle (1).
    """
    prefix, part = ("start_", 0) if kind == "start" else ("", 1)
    correlated = {member for members, _ in blocks for member in members}
    for place, distribution, _ in declared.single:
        if (part, place) in correlated:
            yield Source("together", "correlated numbers", stream, place, False)
        else:
            yield Source(kind, prefix + declared.names[place], stream, place, isinstance(distribution, Uniform))
    for places, _ in declared.joint:
        together = " and ".join(prefix + declared.names[place] for place in places)
        for place in places:
            yield Source(kind, together, stream, place, False)


def moves(sources) -> np.ndarray:
    """Stream, number and value of the normal that each flight moves: none, then four flights a source, (3, flights)."""
    from scipy.special import ndtri

    steps = np.outer(STEPS, [1.0, -1.0]).ravel()
    of_uniform = ndtri(0.5 + steps / np.sqrt(12.0))  # which make as many deviations of the uniform number
    moved = [
        (source.stream, source.number, step) for source in sources for step in (of_uniform if source.uniform else steps)
    ]
    return np.transpose([(0.0, 0.0, 0.0), *moved])


def budget_of(quantity, unit, sources, values, flown, tolerance) -> Budget:
    """The budget of a quantity.

    Args:
        quantity, unit: for the result. sources: independent normal numbers.
        values: of the quantity, of the flights of `moves`, NaN of those that did not end as they should.
        flown: values of flights with all errors at once. tolerance: see `Flights.budget`.
    """
    import pandas as pd

    middle, moved = values[0], values[1:].reshape(-1, 4)
    rounding = ROUNDING * abs(middle)
    moved = np.where(np.abs(moved - middle) <= rounding, middle, moved)
    slopes = (moved[:, 0] - moved[:, 1]) / (2.0 * STEPS[0])
    wide = (moved[:, 2] - moved[:, 3]) / (2.0 * STEPS[1])
    bends = (moved[:, 2] + moved[:, 3] - 2.0 * middle) / STEPS[1] ** 2
    variances = pd.DataFrame(
        {"kind": [source.kind for source in sources], "source": [source.name for source in sources]}
    )
    variances["narrow"], variances["wide"], variances["curved"] = slopes**2, wide**2, slopes**2 + 0.5 * bends**2
    variances["lost"] = np.isnan(moved).sum(axis=1)
    variances = variances.groupby(["kind", "source"], sort=False, as_index=False).sum()

    deviation = np.nan if np.isnan(slopes).any() else float(np.sqrt(variances["narrow"].sum()))
    notes = [
        f"of the flights that {row.source} moves, {row.lost} do not end as they should"
        for row in variances.itertuples()
        if row.lost
    ]
    compared = {} if notes else {"moved by whole deviations": "wide", "with its curvature": "curved"}
    for said, column in compared.items():
        other = np.sqrt(variances[column].sum())
        if abs(other - deviation) > tolerance * deviation:
            most = variances["source"][(variances[column] - variances["narrow"]).abs().idxmax()]
            notes.append(f"{said}, it would be {other:.4g} {unit}, most of all by {most}")
    spread, error = _deviation(flown)
    if abs(spread - deviation) > tolerance * deviation + SURE * error + rounding:
        notes.append(f"the {flown.size:,} flights that are flown have {spread:.4g} +- {error:.2g} {unit}")

    share = variances["narrow"] / (deviation**2 if deviation != 0.0 else 1.0)
    shares = variances[["kind", "source"]].assign(share=share, deviation=np.sqrt(variances["narrow"]))
    shares = shares.sort_values("share", ascending=False, kind="stable", ignore_index=True)
    return Budget(quantity, unit, deviation, spread, error, shares, values.size, tuple(notes))


def _deviation(flown):
    """Deviation of what is flown and its standard error, whatever the distribution is; NaN of too few flights."""
    if flown.size < FEWEST:
        return np.nan, np.nan
    squares, spread = (flown - flown.mean()) ** 2, float(flown.std(ddof=1))
    return spread, float(squares.std() / (2.0 * spread * np.sqrt(flown.size))) if spread > 0.0 else 0.0
