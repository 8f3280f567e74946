"""Altitude against velocity of every paper's flights."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from marsedl.comparison.records import COLORS, NAMES
from marsedl.papers.desensitized.records import FlightEnsemble as DesensitizedFlights
from marsedl.papers.desensitized.records import Nominal as DesensitizedNominal
from marsedl.papers.funnels.linearization import Linearization as FunnelsLinearization
from marsedl.papers.funnels.montecarlo import FlightEnsemble as FunnelsFlights
from marsedl.papers.powered_descent.gains import Gains as PoweredDescentGains
from marsedl.papers.powered_descent.montecarlo import FlightEnsemble as PoweredDescentFlights
from marsedl.papers.random_field import components as random_field_components
from marsedl.papers.random_field.records import FlightEnsemble as RandomFieldFlights
from marsedl.papers.random_field.records import Nominal as RandomFieldNominal
from marsedl.papers.stochastic_entry import records as stochastic_entry_records
from marsedl.papers.stochastic_entry.records import FlightEnsemble as StochasticEntryFlights
from marsedl.papers.stochastic_entry.records import Nominal as StochasticEntryNominal
from marsedl.plotting.style import GREY, new_figure
from marsedl.replication.records.tables import Column
from marsedl.replication.records.tables import table as table_of
from marsedl.replication.units import KM

if TYPE_CHECKING:
    from pandas import DataFrame

DRAWN = 20  # flights of each paper
LEAST = 1.0  # m and m/s, of the logarithmic axes


class Trajectory(NamedTuple):
    """Nominal and flights: altitude (m) and velocity (m/s), flights with one row each."""

    time: np.ndarray  # s, of the nominal
    altitude: np.ndarray
    velocity: np.ndarray
    flown_altitude: np.ndarray
    flown_velocity: np.ndarray
    flights: str


def powered_descent(gains: PoweredDescentGains, closed_loop: PoweredDescentFlights) -> Trajectory:
    """The mean of the design, and closed-loop flights."""
    mean, history = gains.mean, closed_loop.kept_history[:DRAWN]
    speed = np.hypot(mean[:, 2], mean[:, 3])
    return Trajectory(
        gains.time, mean[:, 1], speed, history[..., 1], np.hypot(history[..., 2], history[..., 3]), "closed loop"
    )


def random_field(nominal: RandomFieldNominal, aerocapture: RandomFieldFlights) -> Trajectory:
    """The aerocapture with zero control, and flights of the last law."""
    history = aerocapture.kept_history[-1, :DRAWN]
    return Trajectory(
        nominal.time,
        nominal.altitude,
        nominal.velocity,
        history[..., random_field_components.ALTITUDE],
        history[..., random_field_components.VELOCITY],
        "last iteration" if len(aerocapture.count) > 1 else "open loop",
    )


def desensitized(nominal: DesensitizedNominal, entry_errors: DesensitizedFlights) -> Trajectory:
    """The nominal without desensitization, and flights of it without feedback."""
    history = entry_errors.kept_history[0, :DRAWN]

    def speed(state):
        return np.linalg.norm(state[..., 3:6], axis=-1)  # of radial, north and east velocity

    return Trajectory(
        nominal.time, nominal.state[:, 0], speed(nominal.state), history[..., 0], speed(history), "without feedback"
    )


def funnels(linearization: FunnelsLinearization, constant: FunnelsFlights) -> Trajectory:
    """The reference, and flights with a constant disturbance; their deviations are stored."""
    reference = linearization.state[::2]  # without the points half-way between nodes
    history = reference + constant.kept_history[:DRAWN]
    return Trajectory(
        linearization.time, reference[:, 0], reference[:, 3], history[..., 0], history[..., 3], "constant disturbance"
    )


def stochastic_entry(nominal: StochasticEntryNominal, stochastic_velocity: StochasticEntryFlights) -> Trajectory:
    """The nominal with its bank reversals, and flights of the stochastic law to the velocity trigger."""
    history = stochastic_velocity.kept_history[:DRAWN]
    return Trajectory(
        nominal.time,
        nominal.altitude,
        nominal.velocity,
        history[..., stochastic_entry_records.ALTITUDE],
        history[..., stochastic_entry_records.VELOCITY],
        "stochastic law, velocity trigger",
    )


def figure(records: dict[str, Trajectory]) -> Figure:
    """Altitude against velocity: the entries, and all papers on logarithmic axes."""
    chart, (entries, all_papers) = new_figure(8.4, 4.4, ncols=2)
    for slug, trajectory in records.items():
        look = {"color": COLORS[slug]}
        for axes, unit in ((entries, KM), (all_papers, 1.0)):
            if unit == KM and trajectory.altitude.max() < KM:
                continue  # it would not be visible there
            points = trajectory.flown_velocity.ravel(), trajectory.flown_altitude.ravel()
            axes.plot(
                *(values / unit for values in points), **look, linestyle="none", marker=".", markersize=1.0, alpha=0.5
            )
            axes.plot(trajectory.velocity / unit, trajectory.altitude / unit, **look, linewidth=1.0)
        all_papers.plot([], [], **look, label=f"{NAMES[slug]} ({trajectory.flights})")
    entries.set(xlabel="velocity (km/s)", ylabel="altitude (km)", xlim=(0, None), ylim=(0, None))
    highest = max(trajectory.altitude.max() for trajectory in records.values())
    fastest = max(trajectory.velocity.max() for trajectory in records.values())
    all_papers.set(xscale="log", yscale="log", xlabel="velocity (m/s)", ylabel="altitude (m)")
    all_papers.set(xlim=(LEAST, 2 * fastest), ylim=(_floor(records), 2 * highest))
    all_papers.plot([], [], ".", color=GREY, markersize=2.0, label=f"up to {DRAWN} flights, at stored times")
    all_papers.annotate("flown by no paper", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY, fontsize=7)
    chart.legend(loc="outside lower center", ncols=2)
    return chart


def table(records: dict[str, Trajectory]) -> "DataFrame":
    """Both ends of every nominal."""
    rows = []
    for slug, trajectory in records.items():
        ends = (number for node in (0, -1) for number in (trajectory.altitude[node] / KM, trajectory.velocity[node]))
        rows.append((NAMES[slug], *ends, trajectory.altitude.min() / KM, trajectory.time[-1] - trajectory.time[0]))
    return table_of(
        rows,
        {
            "paper": Column(),
            "start: altitude": Column("km", ".2f"),
            "start: velocity": Column("m/s", ".1f"),
            "end: altitude": Column("km", ".2f"),
            "end: velocity": Column("m/s", ".1f"),
            "lowest altitude": Column("km", ".2f"),
            "duration": Column("s", ".1f"),
        },
    )


def _floor(records):
    """Half of the lowest altitude flown by a nominal, on axes that show no zero."""
    return max(LEAST, min(trajectory.altitude.min() for trajectory in records.values()) / 2)
