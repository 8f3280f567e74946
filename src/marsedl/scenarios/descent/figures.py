"""Figures of the descent."""

import numpy as np

from marsedl.plotting.style import BLACK
from marsedl.scenarios import figures
from marsedl.scenarios.figures import banded, colors, grid, words

__all__ = ["FIGURES"]


def footprint(shown):
    """Touchdowns about the box."""
    radius = shown.scenario.given.box.miss
    across, along = ("crossrange_miss", "to the right"), ("downrange_miss", "beyond")
    return figures.footprint(shown, across, along, radius, "m", 1.0)


def speeds(shown, condition="dispersed"):
    """Speeds at touchdown with their limits."""
    scores, box = shown.by_condition[condition], shown.scenario.given.box
    figure, panels = grid(len(scores))
    for panel, (law, one) in zip(panels, scores.items(), strict=True):
        panel.plot(
            one["horizontal_speed"], one["vertical_speed"], ".", markersize=1.5, color=colors(scores)[law]["color"]
        )
        limits = [0.0, box.horizontal_speed, box.horizontal_speed], [box.vertical_speed, box.vertical_speed, 0.0]
        panel.plot(*limits, color=BLACK, linewidth=0.8)
        panel.set(xlim=(0.0, 4.0 * box.horizontal_speed), ylim=(0.0, 3.0 * box.vertical_speed), box_aspect=1)
        panel.set_title(words(law), fontsize=8)
    figure.supxlabel("horizontal speed (m/s)", fontsize=9)
    figure.supylabel("vertical speed (m/s)", fontsize=9)
    return figure


def corridor(shown):
    """Altitude against downrange with bands."""
    _, states = shown.scenario.onboard.reference
    altitude = np.linspace(2.0, states[0, 2] - 5.0, 80)
    figure, drawn = banded(shown, "downrange", "altitude", altitude)
    for panel, color, low, high in drawn:
        panel.fill_betweenx(altitude, low, high, color=color, alpha=0.35, linewidth=0.0)
        panel.plot(states[:, 0], states[:, 2], color=BLACK, linewidth=0.8)
    figure.supxlabel("downrange (m)", fontsize=9)
    figure.supylabel("altitude (m)", fontsize=9)
    return figure


FIGURES = {
    "ranks": figures.ranks,
    "footprint": footprint,
    "speeds": speeds,
    "corridor": corridor,
    "fronts": figures.fronts,
    "sources": figures.sources,
}
