"""The picture of a paper's headline claims: what is printed and what is found, on one axis."""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from string import ascii_lowercase
from typing import NamedTuple

import numpy as np

from marsedl.plotting.style import BLACK, BLUE, GREY, SKY, new_figure
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.numbers import format_number, told_apart, unit_of
from marsedl.replication.errors import InputError, nearest

_WIDTH = 3.9  # inches: on a phone as wide as the screen, with letters that can be read
_LETTERS = 62  # that fit into a line
_LINE, _MARKS = 0.16, 0.32  # inches: the height of a line of text, and of what is drawn below it
_MARGIN = 0.85  # inches: what title, legend and axis take of a panel
GREY_TEXT = "#555555"
_ENDS = 10.0  # a measure further from its limit than this factor stands at the end of the axis


class Bar(NamedTuple):
    """One row of a picture: what is printed and what is found, one value each or the two ends of an interval."""

    label: str
    printed: np.ndarray
    found: np.ndarray
    error: np.ndarray
    unit: str
    verdict: str


class Limit(NamedTuple):
    """One row of a picture: its texts, the measure that decides over its limit, and where the statement holds."""

    texts: tuple[str, ...]
    ratio: float
    error: float
    holds_above: bool


class Row(NamedTuple):
    """A row of a panel: its lines of text with their colours, and heights in inches from the panel's top."""

    lines: Sequence[tuple[str, str]]
    top: float
    marks: float
    bottom: float


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
    laid = [_laid_out([(one.label, _of_bar(one)) for one in bars]) for bars in panels.values()]
    if limits:
        laid.append(_laid_out([one.texts for one in limits]))
    heights = [_MARGIN + placed[-1].bottom for placed in laid] or [1.0]
    figure, axes = new_figure(_WIDTH, sum(heights), nrows=len(heights), squeeze=False, height_ratios=heights)
    letters = [f"({letter}) " if len(heights) > 1 else "" for letter in ascii_lowercase]
    for ax, letter, (title, bars), placed in zip(axes[:, 0], letters, panels.items(), laid, strict=False):
        _draw_bars(ax, bars, placed)
        _finish(ax, f"{letter}{title}", placed)
    if limits:
        _draw_limits(axes[-1, 0], limits, laid[-1])
        _finish(axes[-1, 0], f"{letters[len(panels)]}Statements", laid[-1])
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
        unit, verdict = unit_of(row, np.unravel_index(at, np.shape(row.printed))), verdicts[at]
    return Bar(label, printed, value, np.nan_to_num(error), unit, verdict)


def limit_of(row: Claim) -> Limit:
    """Return the row of a statement."""
    margin = row.result.margin
    above = (margin.value > margin.limit) == bool(row.result.value)
    if margin.limit:
        ratio = margin.value / margin.limit
    elif margin.value > 0:
        ratio = np.inf
    else:
        ratio = 0.0
    error = (margin.standard_error or 0.0) / abs(margin.limit or np.inf)
    value, limit = told_apart(margin.value, margin.limit)
    value = format_number(margin.value, margin.standard_error) if margin.standard_error else value
    text = f"{row.result.verdict}: {value}; {'at least' if above else 'at most'} {limit} {margin.unit}".strip()
    return Limit((row.plain, text, f"measure: {margin.measure}"), ratio, error, above)


def _of_bar(one: Bar) -> str:
    """What is printed and what is found, with the unit."""
    ours = [format_number(*of) if of[1] else f"{of[0]:.4g}" for of in zip(one.found, one.error, strict=True)]
    texts = " to ".join(f"{number:.4g}" for number in one.printed), " to ".join(ours)
    unit = "" if one.unit == "1" else f" {one.unit}"
    return f"{one.verdict}: printed {texts[0]}{unit}, ours {texts[1]}{unit}"


def _laid_out(texts: Iterable[Sequence[str]]) -> list[Row]:
    """Rows below one another, each with the lines of its texts above what is drawn."""
    rows, top = [], 0.0
    for of_row in texts:
        plain = [text.rstrip(".").replace("_", " ").replace("^2", "²") for text in of_row]
        lines = [(line, GREY_TEXT if k else BLACK) for k, s in enumerate(plain) for line in textwrap.wrap(s, _LETTERS)]
        height = _LINE * len(lines)
        rows.append(Row(lines, top, top + height + 0.4 * _MARKS, top + height + _MARKS))
        top = rows[-1].bottom
    return rows


def _draw_bars(ax, bars: Sequence[Bar], rows: Sequence[Row]) -> None:
    """Draw printed numbers; of several units, all over what is printed."""
    mixed = len({one.unit for one in bars}) > 1
    for one, row in zip(bars, rows, strict=True):
        printed, found, error = (of / (np.abs(one.printed) if mixed else 1.0) for of in one[1:4])
        if len(printed) == 1:
            ax.plot([printed[0], found[0]], [row.marks] * 2, color=GREY, lw=1.0, zorder=1)
            ax.plot(printed, [row.marks], "D", color=BLACK, ms=6, zorder=2, label="printed")
            ax.errorbar(found, [row.marks], xerr=error, fmt="o", color=BLUE, ms=5, capsize=3, zorder=3, label="ours")
        else:
            above, below = [row.marks - 0.05] * len(printed), [row.marks + 0.05] * len(found)
            ax.plot(printed, above, color=BLACK, lw=4, solid_capstyle="butt", label="printed")
            ax.plot(found, below, color=BLUE, lw=4, solid_capstyle="butt", label="ours")
            ax.errorbar(found, below, xerr=error, fmt="none", ecolor=SKY, capsize=3)
    unit = "" if bars[0].unit == "1" else bars[0].unit
    ax.set_xlabel("number over the printed one" if mixed else unit)


def _draw_limits(ax, limits: Sequence[Limit], rows: Sequence[Row]) -> None:
    """Draw measures over their limits, those that are far away as arrows at the ends."""
    for one, row in zip(limits, rows, strict=True):
        place = np.clip(one.ratio, 1.0 / _ENDS, _ENDS)
        left, right = (1.0, 2.0 * _ENDS) if one.holds_above else (0.5 / _ENDS, 1.0)
        ax.barh(row.marks, right - left, left=left, height=0.14, color=SKY, alpha=0.3, label="it holds here")
        marker = "o"
        if place != one.ratio:
            marker = ">" if one.ratio > 1.0 else "<"
        error = [min(one.error, 0.9 * place)] if one.error and place == one.ratio else None
        ax.errorbar([place], [row.marks], xerr=error, fmt=marker, color=BLUE, ms=5, capsize=3, label="ours")
        ax.vlines(1.0, row.marks - 0.1, row.marks + 0.1, color=BLACK, lw=1.5, label="limit", zorder=1)
    ax.set_xscale("log")
    ax.set_xlim(0.5 / _ENDS, 2.0 * _ENDS)
    ax.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
    ax.set_xlabel("measure over its limit; arrows: still further away")


def _finish(ax, title: str, rows: Sequence[Row]) -> None:
    """Write the texts of the rows, a title and a legend."""
    place = {"transform": ax.get_yaxis_transform(), "fontsize": 8, "va": "center", "in_layout": False}
    for row in rows:
        for number, (line, colour) in enumerate(row.lines):
            ax.text(0.0, row.top + _LINE * (number + 0.5), line, color=colour, **place)
    ax.set_yticks([])
    ax.set_ylim(rows[-1].bottom, -0.05)
    ax.grid(visible=False, axis="y")
    ax.spines["left"].set_visible(False)
    ax.set_title(title, loc="left", fontsize=9, fontweight="bold", pad=18)
    handles = {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.0, "borderpad": 0.1}
    ax.legend(handles.values(), handles.keys(), ncols=3, fontsize=8, handlelength=1.2, columnspacing=0.8, **place)
