"""One look for all figures, and files that are the same bytes whenever they are drawn from the same numbers."""

import json
from collections.abc import Mapping
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

# A colour-blind safe set (Okabe and Ito 2008).
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, GREY, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#8A8A8A",
    "#000000",
)

PRINTED = "printed"  # the group of lines and crosses that mark what a paper prints; the key of their places in a PNG

_SETTINGS = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.35,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.2,
    "pdf.fonttype": 42,
    "svg.hashsalt": "marsedl",
    "path.simplify": True,
}


def new_figure(width: float = 6.4, height: float = 4.0, *, mosaic: Any = None, **grid) -> tuple[Figure, Any]:
    """Return a figure (inches) in the common style and its axes.

    They are laid out by `Figure.subplots(**grid)`, or by name in the `mosaic` of `Figure.subplot_mosaic`. Settings of
    the user's own, such as those of a matplotlibrc, are dropped.
    """
    mpl.rcdefaults()
    mpl.rcParams.update(_SETTINGS)
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(**grid) if mosaic is None else figure.subplot_mosaic(mosaic, **grid)


def save_figure(figure: Figure, *paths: str | Path) -> None:
    """Write a figure as PNG or PDF, by the paths' endings, without dates; several panels get letters.

    A PNG holds as the text `PRINTED` where the paper's numbers are marked, as `printed_places` returns them.
    """
    from matplotlib.backends import backend_agg, backend_pdf

    _letter_panels(figure)
    # Laid out once, for the pixels of the PNG, and drawn once for each file: `savefig` does both twice for each.
    figure.set_dpi(mpl.rcParams["savefig.dpi"])
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    places = printed_places(figure)
    texts = {"Software": None} | ({PRINTED: json.dumps(places)} if places else {})
    for path in map(Path, paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".pdf":
            backend_pdf.FigureCanvasPdf(figure).print_pdf(path, metadata={"CreationDate": None})
        else:
            backend_agg.FigureCanvasAgg(figure).print_png(path, metadata=texts)


def printed_places(figure: Figure) -> list[tuple[float, float]]:
    """Return each number that marks what a paper prints, with the span of its axis.

    A logarithmic axis is as long as a linear one on which a small change of the number moves it as far.
    """
    found = []
    for line in figure.findobj(lambda artist: artist.get_gid() == PRINTED):
        # A line across the axes has one coordinate in units of the data, a cross has two.
        of_data = line.get_transform().contains_branch_seperately(line.axes.transData)
        for axis, values, is_data in zip((line.axes.xaxis, line.axes.yaxis), line.get_data(), of_data, strict=True):
            ends = axis.get_view_interval()
            for value in np.unique(values) if is_data else ():
                span = value * np.log(ends[1] / ends[0]) if axis.get_scale() == "log" else ends[1] - ends[0]
                found.append((float(f"{value:.9g}"), float(f"{abs(span):.6g}")))
    return found


def _letter_panels(figure: Figure) -> None:
    """Begin the titles of several panels with (a), (b) and so on; twins, colour bars and insets are no panels."""
    panels = {axes.get_subplotspec(): axes for axes in reversed(figure.axes) if axes.axison and axes.get_visible()}
    panels.pop(None, None)
    for letter, axes in zip(ascii_lowercase, reversed(panels.values()), strict=False):
        title = axes.get_title()
        if len(panels) > 1 and not axes.get_title("left") and not title.startswith(f"({letter})"):
            axes.set_title(f"({letter}) {title}".strip(), loc="center" if title else "left")


def save_side_by_side(figures: Mapping[str, Figure], path: str | Path) -> None:
    """Write figures beside each other as one PNG, each below its title."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    images = []
    for title, figure in figures.items():
        figure.suptitle(title)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        images.append(np.asarray(canvas.buffer_rgba())[..., :3])
    height = max(image.shape[0] for image in images)
    padded = [np.pad(i, ((0, height - len(i)), (0, 0), (0, 0)), constant_values=255) for i in images]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    mpl.image.imsave(path, np.hstack(padded))
