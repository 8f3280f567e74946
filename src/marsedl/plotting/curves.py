"""Curves of fields: what is drawn, the labels of the axes and their units come from the records.

    figure, panels = new_figure(7.2, 4.8, nrows=2, ncols=2, sharex=True)
    for component, axes in zip(MOTION.names, panels.flat, strict=True):
        trials(axes, closed_loop, f"kept_history.{component}")
        plot(axes, gains, f"mean.{component}", color=BLACK, label="mean of the design")
    mark(*panels.flat, x=mission.segment_durations[0])

The first of two or three arguments is a record and the path of a field in it, as `fields.field` takes them, or a
`Field` alone, which a figure has computed from others. The first curve of axes says what stands beside them; axes whose
tick labels are hidden, as `sharex` hides them, get no label.
"""

import textwrap
from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from marsedl.plotting.fields import Field, field
from marsedl.plotting.style import BLACK, BLUE, GREY, PRINTED, PURPLE

TRIAL = {"color": BLUE, "linewidth": 0.4, "alpha": 0.6}
OPAQUE = {"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.85}  # behind text
SHADE = 0.22  # opacity of a band
OF_FIELD = ("unit", "name", "at", "x", "pieces")  # arguments of `field`; all others are matplotlib's
_UNITS: WeakKeyDictionary = WeakKeyDictionary()  # by axis: the unit of the values that are drawn along it

# What the paper prints is purple wherever it is drawn, and `save_figure` finds it by its group.
PRINTED_LINE = {"gid": PRINTED, "color": PURPLE, "linewidth": 1.3, "linestyle": "-."}
PRINTED_CROSS = {
    "gid": PRINTED,
    "color": PURPLE,
    "marker": "x",
    "markersize": 7,
    "markeredgewidth": 2,
    "linestyle": "none",
}


def plot(axes: Axes, source: Any, path: str = "", *, label: str | None = None, **how: Any) -> list[Line2D]:
    """Draw a field as a curve; returns the lines: one, or one for each piece.

    source: a record, or a `Field`; path: of the field in the record; label: for the legend; how: `unit`, `name`, `at`,
    `x` and `pieces` as `fields.field` takes them, and any style of a line.

    Raises ValueError as `field` does, if the field is not a curve, or if the axes show another unit.
    """
    curve, style = _field_and_style(source, path, how)
    return _lines(axes, curve, label, style)


def trials(axes: Axes, source: Any, path: str = "", *, label: str | None = "{count} flights", **how: Any) -> int:
    """Draw a field of (trials, ...) as one thin curve for each trial; returns how many are drawn.

    source, path and how: as for `plot`, which also says what is raised; label: for the legend, with `{count}` for the
    number of trials drawn; None for none.
    """
    curves, style = _field_and_style(source, path, how)
    if curves.values.ndim != 2:
        raise ValueError(f"'{curves.name}' of {curves.values.shape} holds no trials: take (trials, places)")
    style = TRIAL | style
    for number, values in enumerate(curves.values):
        x = curves.x if curves.x is None or curves.x.values.ndim == 1 else curves.x.of(curves.x.values[number])
        _lines(axes, Field(values, curves.name, curves.unit, x, curves.pieces), None, style)
    if label is not None:
        legend_entry(axes, label.format(count=len(curves.values)), **style | {"linewidth": 0.8, "alpha": 1.0})
    return len(curves.values)


def bounds(axes: Axes, lower: Field, upper: Field, *, filled: bool = False, label: str | None = None, **style) -> None:
    """Draw two bounds as lines with one entry in the legend, or, if `filled`, shade what lies between them.

    lower, upper: fields at the same places, such as those of `fields.sigma_bounds`; style: of the lines, or the band.

    Raises ValueError if the axes show another unit.
    """
    if filled:
        name_axes(axes, lower)
        x = np.arange(len(lower.values)) if lower.x is None else lower.x.values
        axes.fill_between(x, lower.values, upper.values, **{"alpha": SHADE, "linewidth": 0, "label": label} | style)
        return
    for bound, text in ((lower, None), (upper, label)):
        _lines(axes, bound, text, style)


def mark(*panels: Axes, x: Any = (), y: Any = (), label: str | None = None, **style: Any) -> None:
    """Draw a thin dotted line across each of the axes at places x and at values y, such as a switch or a limit.

    label: for the legend of the first axes.
    """
    style = {"color": GREY, "linewidth": 0.8, "linestyle": ":"} | style
    for axes in panels:
        for place in np.atleast_1d(x):
            axes.axvline(place, label=label, **style)
            label = None
        for value in np.atleast_1d(y):
            axes.axhline(value, label=label, **style)
            label = None


def printed_mark(axes: Axes, *, x: Any = (), y: Any = (), label: str | None = "printed", **style: Any) -> None:
    """Mark what the paper prints: a line across the axes for one coordinate, crosses for two."""
    places, values = np.atleast_1d(x), np.atleast_1d(y)
    if places.size and values.size:
        cross = PRINTED_CROSS | {"clip_on": False, "zorder": 5} | style
        axes.plot(*np.broadcast_arrays(places, values), label=label, **cross)
    else:
        mark(axes, x=places, y=values, label=label, **PRINTED_LINE | style)


def zero(*panels: Axes, **style: Any) -> None:
    """Draw the line of zero across each of the axes."""
    mark(*panels, y=0.0, **{"color": BLACK, "linewidth": 0.6, "linestyle": "-"} | style)


def legend_entry(axes: Axes, label: str, **style: Any) -> Line2D:
    """Add an entry to the legend of axes for what is drawn in several parts; returns its line, which has no points."""
    return axes.plot([], [], label=label, **style)[0]


def legend_below(figure: Any, panels: Iterable[Axes], columns: int = 3) -> None:
    """Put one legend below a figure, with what the axes have labels of, each label once."""
    handles = [handle for axes in panels for handle in axes.get_legend_handles_labels()[0]]
    handle_of_label = {handle.get_label(): handle for handle in handles}
    figure.legend(
        handles=list(handle_of_label.values()), loc="outside lower center", ncols=min(columns, len(handle_of_label))
    )


def note(axes: Axes, text: str, height: float, width: int = 44) -> None:
    """Write a remark into the middle of axes, such as why there is nothing to show.

    height: its top, as a share of the axes. width: characters of a line.
    """
    text = "\n".join(textwrap.fill(line, width) for line in text.splitlines())
    place = {"ha": "center", "va": "top", "transform": axes.transAxes}
    axes.text(0.5, height, text, color=GREY, fontsize=8, bbox=OPAQUE, zorder=6, **place)


def _field_and_style(source: Any, path: str, how: dict[str, Any]) -> tuple[Field, dict[str, Any]]:
    """The field that is drawn, and the style of its lines."""
    of_field = {key: value for key, value in how.items() if key in OF_FIELD}
    style = {key: value for key, value in how.items() if key not in OF_FIELD}
    if not isinstance(source, Field):
        return field(source, path, **of_field), style
    if path or of_field:
        names = ", ".join(of_field) or "a path"
        raise ValueError(f"'{source.name}' is a Field already: give {names} where it is taken from its record")
    return source, style


def _lines(axes: Axes, curve: Field, label: str | None, style: dict[str, Any]) -> list[Line2D]:
    """Draw a curve, or its pieces."""
    if curve.values.ndim != 1:
        raise ValueError(f"'{curve.name}' of {curve.values.shape} is no curve: choose components, or give `at`")
    name_axes(axes, curve)
    x = np.arange(len(curve.values)) if curve.x is None else curve.x.values
    parts = [slice(None)] if curve.pieces is None else [curve.pieces == piece for piece in np.unique(curve.pieces)]
    return [
        axes.plot(x[part], curve.values[part], label=None if number else label, **style)[0]
        for number, part in enumerate(parts)
    ]


def name_axes(axes: Axes, curve: Field) -> None:
    """Label the axes unless they have labels; ValueError if they show another unit."""
    for axis, quantity in ((axes.yaxis, curve), (axes.xaxis, curve.x)):
        if quantity is None:
            continue
        if _UNITS.setdefault(axis, quantity.unit) != quantity.unit:
            raise ValueError(
                f"axes in {_UNITS[axis]} cannot show '{quantity.name}' in {quantity.unit}: give the same unit"
            )
        if not axis.get_label_text() and axis.get_tick_params().get(
            "labelleft" if axis is axes.yaxis else "labelbottom", True
        ):
            axis.set_label_text(quantity.label)
