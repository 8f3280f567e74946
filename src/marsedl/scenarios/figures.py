"""Figures that every scenario has."""

import numpy as np

from marsedl.plotting.curves import legend_below
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure

__all__ = ["banded", "colors", "footprint", "fronts", "grid", "ranks", "sources", "words"]

_COLORS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY, "#882255", "#117733")
_MARKS = "os^Dv<>P*X"


def colors(laws) -> dict[str, dict]:
    """Colour and mark of every law, the same in all figures."""
    return {law: {"color": _COLORS[n % 10], "marker": _MARKS[n % 10]} for n, law in enumerate(laws)}


def words(name: str) -> str:
    """A name as readers see it."""
    return name.replace("_", " ")


def grid(count, width=2.3, height=2.1):
    """A figure with so many panels, in rows of four; and the panels."""
    columns = min(count, 4)
    rows = -(-count // columns)
    figure, panels = new_figure(
        width * columns, height * rows + 0.4, nrows=rows, ncols=columns, squeeze=False, sharex=True, sharey=True
    )
    for panel in panels.flat[count:]:
        panel.set_visible(False)
    return figure, panels.flat[:count]


def ranks(shown):
    """Mean miss of every law in every condition."""
    conditions = [*dict.fromkeys(row["condition"] for row in shown.ranked)]
    style = colors(shown.scores)
    bars = {"markersize": 3.5, "capsize": 1.5, "linewidth": 0.8, "linestyle": "none"}
    figure, axes = new_figure(7.0, 0.55 * len(conditions) + 1.8)
    for place, condition in enumerate(conditions):
        rows = {row["law"]: row for row in shown.ranked if row["condition"] == condition}
        for number, law in enumerate(style):
            row, y = rows[law], place + 0.7 * (number / max(len(style) - 1, 1) - 0.5)
            ends = np.array([[row["mean"] - row["mean_lower"]], [row["mean_upper"] - row["mean"]]])
            axes.errorbar(row["mean"], y, xerr=np.maximum(ends, 0.0), label=words(law), **bars, **style[law])
    axes.set(xscale="log", xlabel="mean miss (m)", yticks=range(len(conditions)), yticklabels=map(words, conditions))
    axes.invert_yaxis()
    legend_below(figure, [axes], 4)
    return figure


def footprint(shown, across, along, radius, unit="km", factor=1e3, condition="dispersed"):
    """Ends of all flights of every law.

    across, along: columns on both axes, with their labels. radius: of the box, m.
    """
    scores = shown.by_condition[condition]
    figure, panels = grid(len(scores))
    turn, style = np.linspace(0.0, 2.0 * np.pi, 100), colors(scores)
    reach = max(2.0 * radius, np.median([np.nanquantile(one["miss"], 0.99) for one in scores.values()])) / factor
    for panel, (law, one) in zip(panels, scores.items(), strict=True):
        panel.plot(one[across[0]] / factor, one[along[0]] / factor, ".", markersize=1.5, color=style[law]["color"])
        panel.plot(radius / factor * np.cos(turn), radius / factor * np.sin(turn), color=BLACK, linewidth=0.8)
        panel.set(xlim=(-reach, reach), ylim=(-reach, reach), box_aspect=1)
        panel.set_title(f"{words(law)}\n{100.0 * one['inside'].mean():.0f} %", fontsize=8)
    figure.supxlabel(f"{across[1]} ({unit})", fontsize=9)
    figure.supylabel(f"{along[1]} ({unit})", fontsize=9)
    return figure


def banded(shown, of, over, nodes):
    """A panel for every law; and what is drawn in each: panel, colour, 5th and 95th percentile of histories at nodes.

    of, over: names of a quantity, and of another one that goes one way. nodes: of this, ascending, (n,).
    """
    figure, panels = grid(len(shown.histories))
    drawn = []
    for panel, (law, flights) in zip(panels, shown.histories.items(), strict=True):
        stored, curves = flights.to_xarray(), []
        for place, values in zip(*(stored[f"{name}_history"].values.T for name in (over, of)), strict=True):
            known = np.flatnonzero(np.isfinite(place))
            known = known[np.argsort(place[known])]
            curves.append(np.interp(nodes, place[known], values[known]))
        drawn.append((panel, colors(shown.scores)[law]["color"], *np.quantile(curves, [0.05, 0.95], axis=0)))
        panel.set_title(words(law), fontsize=8)
    return figure, drawn


def fronts(shown):
    """Mean miss against saturated periods of all tries."""
    figure, axes = new_figure(6.4, 4.2)
    for law, style in colors(shown.tuned).items():
        tries = [one for one in shown.tuned[law] if np.isfinite(one["mean"])]
        if not tries:
            continue
        places = [one["saturated"] for one in tries], [one["mean"] for one in tries]
        axes.plot(*places, **style, linestyle="none", markersize=4, fillstyle="none")
        axes.plot(places[0][0], places[1][0], **style, linestyle="none", markersize=6, label=words(law))
        for own in (one for one in tries if not one["numbers"]):
            axes.plot(own["saturated"], own["mean"], "x", color=style["color"], markersize=7)
    axes.set(yscale="log", xlabel="guidance periods in which limits act", ylabel="mean miss (m)")
    legend_below(figure, [axes], 4)
    return figure


def sources(shown):
    """Bars of the shares of the first budgeted quantity."""
    from marsedl.scenarios.shown import TABLES

    found = TABLES["sources"](shown)
    share = found.columns[3]
    rows = found[(found["quantity"] == shown.scenario.budgeted[0]) & ~found["source"].str.startswith("predicted")]
    whole = rows.pivot_table(index="law", columns="source", values=share, sort=False).reindex([*shown.studied])
    shown_apart = whole.max().sort_values(ascending=False).index[:7]
    figure, axes = new_figure(7.0, 0.35 * len(whole) + 1.6)
    left = np.zeros(len(whole))
    parts = {name: whole[name].to_numpy() for name in shown_apart}
    parts["all else"] = 100.0 - sum(parts.values())
    for color, (name, part) in zip(_COLORS, parts.items(), strict=False):
        axes.barh([*map(words, whole.index)], part, left=left, color=color, label=words(name))
        left = left + part
    axes.set(xlabel=f"share of the variance of the {words(shown.scenario.budgeted[0])} (%)", xlim=(0.0, 100.0))
    axes.invert_yaxis()
    legend_below(figure, [axes], 3)
    return figure
