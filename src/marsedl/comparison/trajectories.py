"""Altitude against velocity of every paper's flights."""

from typing import NamedTuple

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

DRAWN = 20  # flights of each paper
KM = 1e3
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
    mean, flown = gains.mean, closed_loop.kept_history[:DRAWN]
    speed = np.hypot(mean[:, 2], mean[:, 3])
    return Trajectory(
        gains.time, mean[:, 1], speed, flown[..., 1], np.hypot(flown[..., 2], flown[..., 3]), "closed loop"
    )


def random_field(nominal: RandomFieldNominal, aerocapture: RandomFieldFlights) -> Trajectory:
    """The aerocapture with zero control, and flights of the last law."""
    flown = aerocapture.kept_history[-1, :DRAWN]
    return Trajectory(
        nominal.time,
        nominal.altitude,
        nominal.velocity,
        flown[..., random_field_components.ALTITUDE],
        flown[..., random_field_components.VELOCITY],
        "last iteration" if len(aerocapture.count) > 1 else "open loop",
    )


def desensitized(nominal: DesensitizedNominal, entry_errors: DesensitizedFlights) -> Trajectory:
    """The nominal without desensitization, and flights of it without feedback."""
    flown = entry_errors.kept_history[0, :DRAWN]

    def speed(state):
        return np.linalg.norm(state[..., 3:6], axis=-1)  # of radial, north and east velocity

    return Trajectory(
        nominal.time, nominal.state[:, 0], speed(nominal.state), flown[..., 0], speed(flown), "without feedback"
    )


def funnels(linearization: FunnelsLinearization, constant: FunnelsFlights) -> Trajectory:
    """The reference, and flights with a constant disturbance; their deviations are stored."""
    reference = linearization.state[::2]  # without the points half-way between nodes
    flown = reference + constant.kept_history[:DRAWN]
    return Trajectory(
        linearization.time, reference[:, 0], reference[:, 3], flown[..., 0], flown[..., 3], "constant disturbance"
    )


def stochastic_entry(nominal: StochasticEntryNominal, stochastic_velocity: StochasticEntryFlights) -> Trajectory:
    """The nominal with its bank reversals, and flights of the stochastic law to the velocity trigger."""
    flown = stochastic_velocity.kept_history[:DRAWN]
    return Trajectory(
        nominal.time,
        nominal.altitude,
        nominal.velocity,
        flown[..., stochastic_entry_records.ALTITUDE],
        flown[..., stochastic_entry_records.VELOCITY],
        "stochastic law, velocity trigger",
    )


def figure(found: dict[str, Trajectory]) -> Figure:
    """Altitude against velocity: the entries, and all papers on logarithmic axes."""
    drawn, (entries, whole) = new_figure(8.4, 4.4, ncols=2)
    for slug, trajectory in found.items():
        look = {"color": COLORS[slug]}
        for axes, unit in ((entries, KM), (whole, 1.0)):
            if unit == KM and trajectory.altitude.max() < KM:
                continue  # nothing to be seen there
            flown = trajectory.flown_velocity.ravel(), trajectory.flown_altitude.ravel()
            axes.plot(
                *(values / unit for values in flown), **look, linestyle="none", marker=".", markersize=1.0, alpha=0.5
            )
            axes.plot(trajectory.velocity / unit, trajectory.altitude / unit, **look, linewidth=1.0)
        whole.plot([], [], **look, label=f"{NAMES[slug]} ({trajectory.flights})")
    entries.set(xlabel="velocity (km/s)", ylabel="altitude (km)", xlim=(0, None), ylim=(0, None))
    highest = max(trajectory.altitude.max() for trajectory in found.values())
    fastest = max(trajectory.velocity.max() for trajectory in found.values())
    whole.set(xscale="log", yscale="log", xlabel="velocity (m/s)", ylabel="altitude (m)")
    whole.set(xlim=(LEAST, 2 * fastest), ylim=(_floor(found), 2 * highest))
    whole.plot([], [], ".", color=GREY, markersize=2.0, label=f"up to {DRAWN} flights, at stored times")
    whole.annotate("flown by no paper", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY, fontsize=7)
    drawn.legend(loc="outside lower center", ncols=2)
    return drawn


def table(found: dict[str, Trajectory]) -> list[tuple[str, ...]]:
    """Both ends of every nominal."""
    rows = [
        (
            *("paper", "start: altitude (km)", "velocity (m/s)", "end: altitude (km)", "velocity (m/s)"),
            *("lowest altitude (km)", "duration (s)"),
        )
    ]
    for slug, trajectory in found.items():
        ends = [(trajectory.altitude[node], trajectory.velocity[node]) for node in (0, -1)]
        shown = [text for altitude, velocity in ends for text in (f"{altitude / KM:.2f}", f"{velocity:.1f}")]
        duration = trajectory.time[-1] - trajectory.time[0]
        rows.append((NAMES[slug], *shown, f"{trajectory.altitude.min() / KM:.2f}", f"{duration:.1f}"))
    return rows


def _floor(found):
    """Half of the lowest altitude flown by a nominal, on axes that show no zero."""
    return max(LEAST, min(trajectory.altitude.min() for trajectory in found.values()) / 2)
