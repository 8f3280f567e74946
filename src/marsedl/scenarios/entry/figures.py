"""Figures of the entry."""

import numpy as np

from marsedl.fly.dynamics import STANDARD_GRAVITY
from marsedl.plotting.curves import legend_below
from marsedl.plotting.style import BLACK, new_figure
from marsedl.scenarios import figures
from marsedl.scenarios.figures import banded, colors, words

__all__ = ["FIGURES"]

FACTORS = {"thin_air": 0.9, "dispersed": 1.0, "thick_air": 1.1, "thicker_air": 1.3}  # of the mean density


def footprint(shown):
    """Ends of all flights about the box."""
    radius = shown.scenario.given.box.largest_miss
    return figures.footprint(shown, ("crossrange_miss", "to the right"), ("downrange_miss", "beyond"), radius)


def density(shown):
    """Miss against the error of the mean density."""
    figure, axes = new_figure(6.4, 4.0)
    known = {name: factor for name, factor in FACTORS.items() if name in shown.by_condition}
    for law, style in colors(shown.scores).items():
        misses = [shown.by_condition[name][law]["miss"] / 1e3 for name in known]
        errors = [100.0 * (factor - 1.0) for factor in known.values()]
        axes.plot(errors, [np.nanmedian(miss) for miss in misses], label=words(law), markersize=4, **style)
        axes.plot(errors, [np.nanquantile(miss, 0.95) for miss in misses], "--", color=style["color"], linewidth=0.8)
    axes.set(yscale="log", xlabel="true mean density over that known on board, less one (%)", ylabel="miss (km)")
    legend_below(figure, [axes], 4)
    return figure


def corridor(shown):
    """Altitude against velocity with bands."""
    velocity = np.linspace(520.0, 5400.0, 80)
    nominal, opens = shown.scenario.onboard.nominal, shown.scenario.given.flown.parachute
    figure, drawn = banded(shown, "altitude", "velocity", velocity)
    for panel, color, low, high in drawn:
        panel.fill_between(velocity, low / 1e3, high / 1e3, color=color, alpha=0.35, linewidth=0.0)
        panel.plot(nominal.velocity, nominal.altitude / 1e3, color=BLACK, linewidth=0.8)
        panel.plot(opens[1], opens[0] / 1e3, "x", color=BLACK, markersize=6)
        panel.set(xlim=(0.0, 5500.0), ylim=(0.0, 60.0))
    figure.supxlabel("velocity (m/s)", fontsize=9)
    figure.supylabel("altitude (km)", fontsize=9)
    return figure


def flown(shown):
    """What flights of every law have in common with the flown entry of the Mars Science Laboratory."""
    facts, alignment = shown.scenario.given.flown, shown.scenario.onboard.given.guidance.heading_alignment_velocity
    known = {
        "altitude after\na minute (km)": (facts.altitude / 1e3,),
        "largest\ndeceleration (g)": facts.loads / STANDARD_GRAVITY,
        "time of the largest\ndeceleration (s)": (facts.load_time,),
        "reversals before the\nheading alignment": (facts.reversals,),
    }
    figure, panels = new_figure(7.2, 0.3 * len(shown.histories) + 1.4, ncols=len(known), sharey=True, squeeze=False)
    for place, (law, flights) in enumerate(shown.histories.items()):
        stored = flights.to_xarray()
        drag, lift, bank, velocity = (
            stored[f"{name}_history"].values for name in ("drag", "lift", "commanded_bank", "velocity")
        )
        load, time = np.sqrt(drag * drag + lift * lift), stored["time"].values
        turns = (bank[1:] * bank[:-1] < 0.0) & (velocity[1:] > alignment)
        told = (
            stored["altitude_history"].values[np.searchsorted(time, 60.0)] / 1e3,
            np.nanmax(load, axis=0) / STANDARD_GRAVITY,
            time[np.nanargmax(load, axis=0)],
            turns.sum(axis=0),
        )
        for panel, values in zip(panels.flat, told, strict=True):
            low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
            bars = [[middle - low], [high - middle]]
            panel.errorbar(middle, place, xerr=bars, capsize=1.5, markersize=3.5, **colors(shown.scores)[law])
    for panel, (title, fact) in zip(panels.flat, known.items(), strict=True):
        panel.axvspan(min(fact), max(fact), color=BLACK, alpha=0.3)
        panel.set_xlabel(title, fontsize=8)
    panels[0, 0].set(yticks=range(len(shown.histories)), yticklabels=map(words, shown.histories))
    panels[0, 0].invert_yaxis()
    return figure


FIGURES = {
    "ranks": figures.ranks,
    "footprint": footprint,
    "density": density,
    "corridor": corridor,
    "flown": flown,
    "fronts": figures.fronts,
    "sources": figures.sources,
}
