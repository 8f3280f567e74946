"""Pictures of the doors, by matplotlib: what is designed, over the time or over what it costs."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from marsedl.words import missing

__all__ = ["Curve", "labelled", "new_figure", "over_time"]

IN_A_COLUMN = 4  # panels, of which more stand in two columns


class Curve(NamedTuple):
    """A curve, or a band about it, in the panel of a quantity."""

    quantity: str
    label: str
    time: np.ndarray  # s
    middle: np.ndarray  # at these times, or held from one to the next
    half_width: np.ndarray | None = None  # of the band
    style: str = "-"


def over_time(curves: Sequence[Curve], units: Mapping[str, str]) -> Any:
    """Figure of matplotlib with a panel for each quantity over the time.

    Args:
        curves: of any order. units: by quantity, for the labels.
    """
    names = list(dict.fromkeys(curve.quantity for curve in curves))
    columns = 1 if len(names) <= IN_A_COLUMN else 2
    figure, panels = new_figure(-(-len(names) // columns), columns)
    of_label = {}
    for curve in curves:
        panel, time, middle, width = panels[names.index(curve.quantity)], curve.time, curve.middle, curve.half_width
        if len(middle) < len(time):
            time, middle = np.repeat(time, 2)[1:-1], np.repeat(middle, 2)
            width = None if width is None else np.repeat(width, 2)
        if width is None:
            of_label[curve.label] = panel.plot(time, middle, curve.style)[0]
        else:
            of_label[curve.label] = panel.fill_between(time, middle - width, middle + width, alpha=0.3)
    for name, panel in zip(names, panels, strict=False):
        panel.set_title(labelled(name, units), loc="left", fontsize="medium")
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    for panel in panels[len(names) - columns : len(names)]:
        panel.set_xlabel("time (s)")
        panel.tick_params(labelbottom=True)
    figure.legend(of_label.values(), of_label, loc="outside upper center", ncols=len(of_label), frameon=False)
    return figure


def new_figure(rows, columns=1):
    """Figure of matplotlib and its panels, (rows * columns,), of the same horizontal axis."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise missing(error, "figures") from None
    figure = Figure(figsize=(5.0 * columns + 1.4, 1.7 * rows + 0.7), layout="constrained")
    return figure, figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()


def labelled(name, units):
    """What an axis is called: the name in words, with its unit if that is known."""
    words = name.replace("_", " ")
    return f"{words} ({units[name]})" if name in units else words
