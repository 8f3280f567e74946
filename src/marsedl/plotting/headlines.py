"""The picture of a paper's headline claims: what is printed and what is found, on one axis."""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from string import ascii_lowercase
from typing import NamedTuple

import numpy as np

from marsedl.plotting.style import BLACK, BLUE, GREY, SKY, new_figure
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.numbers import format_number, told_apart
from marsedl.replication.errors import InputError, nearest

_WIDTH = 4.6  # inches: as wide as the column of a page in which it stands
_LETTERS = 78  # that fit into a line
_ENDS = 100.0  # a measure further from its limit than this factor stands at the end of the axis


class Bar(NamedTuple):
    """One row of a picture: what is printed and what is found, one value each or the two ends of an interval."""

    label: str
    printed: np.ndarray
    found: np.ndarray
    error: np.ndarray
    unit: str
    verdict: str


class Limit(NamedTuple):
    """One row of a picture: the measure that decides a statement over its limit, and where the statement holds."""

    label: str
    ratio: float
    error: float
    holds_above: bool
    measure: str
    text: str
    verdict: str


def headline_picture(rows: Iterable[Claim], beside: Mapping[str, Mapping[str, str]]):
    """Return a figure of the headline claims of a paper; rows: all of its claims.

    beside: further panels of printed numbers by title, with "claim" or "claim[index]" by the label of its row.

    Raises InputError if a panel names what is no printed number of the paper.
    """
    by_id = {row.id: row for row in rows}
    headline = sorted((row for row in by_id.values() if row.headline), key=lambda row: row.headline)
    panels = {title: [bar_of(label, name, by_id) for label, name in those.items()] for title, those in beside.items()}
    drawn = {name.partition("[")[0] for those in beside.values() for name in those.values()}
    for row in headline:
        if not row.is_statement and row.id not in drawn:
            panels.setdefault(f"Headline numbers, {row.unit}", []).append(bar_of(row.plain, row.id, by_id))
    limits = [limit_of(row) for row in headline if row.is_statement and row.result.margin]
    heights = [0.75 + 0.62 * len(those) for those in panels.values()] + [0.75 + 0.8 * len(limits)] * bool(limits)
    heights = heights or [1.0]
    figure, axes = new_figure(_WIDTH, sum(heights), nrows=len(heights), squeeze=False, height_ratios=heights)
    letters = [f"({letter}) " * (len(heights) > 1) for letter in ascii_lowercase]
    for ax, letter, (title, bars) in zip(axes[:, 0], letters, panels.items(), strict=False):
        _draw_bars(ax, f"{letter}{title}", bars)
    if limits:
        _draw_limits(axes[-1, 0], f"{letters[len(panels)]}Statements, over their limits", limits)
    elif not panels:
        axes[0, 0].axis("off")
    return figure


def bar_of(label: str, name: str, rows: Mapping[str, Claim]) -> Bar:
    """Return the row of a printed number, "claim" or "claim[index]"; raises InputError if there is none."""
    found = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", name)
    row = rows.get(found[1]) if found else None
    if row is None or row.is_statement or int(found[2] or 0) >= np.size(row.printed):
        numbers = [id for id, one in rows.items() if not one.is_statement]
        raise InputError(f"beside: '{name}' is no printed number; {nearest(name, numbers)}")
    result = row.result
    parts = row.printed, result.value, result.standard_error, result.components or result.verdict
    *numbers, verdicts = map(np.ravel, np.broadcast_arrays(*(np.array(of, dtype=object) for of in parts)))
    printed, value, error = (of.astype(float) for of in numbers)  # what there is not is NaN
    unit, verdict = row.unit.split(", ")[0], result.verdict
    if found[2]:
        at = int(found[2])
        printed, value, error = (of[at : at + 1] for of in (printed, value, error))
        unit, verdict = row.unit_of((at,)), verdicts[at]
    return Bar(label, printed, value, np.nan_to_num(error), unit, verdict)


def limit_of(row: Claim) -> Limit:
    """Return the row of a statement."""
    margin = row.result.margin
    above = (margin.value > margin.limit) == bool(row.result.value)
    ratio = margin.value / margin.limit if margin.limit else np.inf if margin.value > 0 else 0.0
    error = (margin.standard_error or 0.0) / abs(margin.limit or np.inf)
    value, limit = told_apart(margin.value, margin.limit)
    value = format_number(margin.value, margin.standard_error) if margin.standard_error else value
    text = f"{value}, limit {limit} {margin.unit}".strip()
    return Limit(row.plain, ratio, error, above, margin.measure, text, row.result.verdict)


def _draw_bars(ax, title: str, bars: Sequence[Bar]) -> None:
    """Draw printed numbers; of several units, all over what is printed."""
    mixed = len({one.unit for one in bars}) > 1
    for k, one in enumerate(bars):
        printed, found, error = (of / (np.abs(one.printed) if mixed else 1.0) for of in one[1:4])
        if len(printed) == 1:
            ax.plot([printed[0], found[0]], [k + 0.05] * 2, color=GREY, lw=1.0, zorder=1)
            ax.plot(printed, [k + 0.05], "D", color=BLACK, ms=6, zorder=2, label="printed")
            ax.errorbar(found, [k + 0.05], xerr=error, fmt="o", color=BLUE, ms=5, capsize=3, zorder=3, label="ours")
        else:
            ax.plot(printed, [k - 0.04] * len(printed), color=BLACK, lw=4, solid_capstyle="butt", label="printed")
            ax.plot(found, [k + 0.14] * len(found), color=BLUE, lw=4, solid_capstyle="butt", label="ours")
            ax.errorbar(found, [k + 0.14] * len(found), xerr=error, fmt="none", ecolor=SKY, capsize=3)
        ours = [format_number(*of) if of[1] else f"{of[0]:.4g}" for of in zip(one.found, one.error, strict=True)]
        texts = " to ".join(f"{number:.4g}" for number in one.printed), " to ".join(ours)
        unit = "" if one.unit == "1" else f" {one.unit}"
        _say(ax, k - 0.5, one.label, f"{one.verdict}: printed {texts[0]}{unit}, ours {texts[1]}{unit}")
    _finish(ax, title, len(bars))
    ax.set_xlabel("over what is printed" if mixed else bars[0].unit)


def _draw_limits(ax, title: str, limits: Sequence[Limit]) -> None:
    for k, one in enumerate(limits):
        place = np.clip(one.ratio, 1.0 / _ENDS, _ENDS)
        left, right = (1.0, 2.0 * _ENDS) if one.holds_above else (0.5 / _ENDS, 1.0)
        ax.barh(k + 0.05, right - left, left=left, height=0.3, color=SKY, alpha=0.3, label="it holds here")
        marker = "o" if place == one.ratio else ">" if one.ratio > 1.0 else "<"
        error = [min(one.error, 0.9 * place)] if one.error else None
        ax.errorbar([place], [k + 0.05], xerr=error, fmt=marker, color=BLUE, ms=5, capsize=3, label="ours")
        _say(ax, k - 0.64, one.label, f"{one.verdict}: {one.text}", f"measure: {one.measure}")
    rows = np.arange(len(limits))
    ax.vlines(np.ones(len(limits)), rows - 0.12, rows + 0.22, color=BLACK, lw=1.5, label="limit")
    ax.set_xscale("log")
    ax.set_xlim(0.5 / _ENDS, 2.0 * _ENDS)
    _finish(ax, title, len(limits))


def _say(ax, top: float, label: str, *below: str) -> None:
    """Write what a row is from a height on, and below it its verdict with numbers, and what they measure."""
    place = {"transform": ax.get_yaxis_transform(), "fontsize": 8, "va": "center", "in_layout": False}
    ax.text(0.0, top, label.rstrip("."), **place)
    for line, text in enumerate(below, start=1):
        said = textwrap.shorten(text.replace("_", " ").replace("^2", "²"), _LETTERS, placeholder=" …")
        ax.text(0.0, top + 0.2 * line, said, color="#555555", **place)


def _finish(ax, title: str, count: int) -> None:
    """Set the title, a legend, and room for the texts of all rows."""
    ax.set_yticks([])
    ax.set_ylim(count - 0.62, -0.75)
    ax.grid(visible=False, axis="y")
    ax.spines["left"].set_visible(False)
    ax.set_title(title, loc="left", fontsize=9, fontweight="bold")
    handles = {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
    ax.legend(handles.values(), handles.keys(), ncols=3, fontsize=8, handlelength=1.2, columnspacing=0.8, **place)
