"""The figures of the funnels paper hold the right curves; nothing here looks at pixels.

What they are drawn from is invented: artifacts of the right shapes in which no two numbers are equal, so that a curve
that is drawn from the wrong place is found out.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d import Axes3D

from marsedl.papers import catalogue
from marsedl.papers.funnels import figures
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import (
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Linearization,
    Nominal,
    Proven,
)
from marsedl.plotting.style import BLACK, BLUE, VERMILION
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.records.fields import quantities
from marsedl.replication.units import DEGREE, KM

SLICES, FINE, FLIGHTS = 7, 12, 50
INPUTS = {
    "planet_radius": 3.4e6,
    "entry_longitude": 0.5,
    "fig4_slice": 3,
    "fig4_coordinates": np.array([2.0, 5.0]),
    "bank_bounds": np.array([0.2, 1.9]),
}
EXTENTS = {
    "time": FINE + 1,
    "half": 2 * FINE + 1,
    "nodes": FINE + 1,
    "slices": SLICES,
    "stages": SLICES - 1,
    "trials": FLIGHTS,
    "kept": 4,
    "observed": 3,
    "final": 8,
    "states": 6,
    "repeats": 10,
    "funnel": 3,
    "proven": 2,
    "steps": FINE,
    "grid": 9,
    "circle": 8,
    "sample": 20,
}
TIME = np.linspace(0.0, 240.0, FINE + 1)
STEP = np.arange(0, FINE + 1, 2)


def invented(kind, extents=None, empty=False, **known):
    """An artifact of a type, of random numbers between 1 and 2 but for what is known; its names are numbered.

    empty: NaN wherever the type allows for it.
    """
    random, sizes = np.random.default_rng(7), EXTENTS | (extents or {})
    fields = {}
    for name, declared in quantities(kind).items():
        shape = tuple(sizes.get(extent, 3) if isinstance(extent, str) else extent for extent in declared.dims)
        if declared.dtype == "str":
            values = np.array([f"{name} {k}" for k in range(int(np.prod(shape)))]).reshape(shape)
        elif declared.dtype == "bool":
            values = np.ones(shape, bool)
        elif declared.dtype == "float64":
            values = np.full(shape, np.nan) if empty and declared.allow_nan else 1.0 + random.random(shape)
        else:
            values = np.zeros(shape, np.dtype(declared.dtype))
        fields[name] = known.get(name, values if shape else values.item())
    return kind(**fields)


def shapes(count, size, seed=1):
    """Positive definite matrices."""
    factor = np.random.default_rng(seed).standard_normal((count, size, size))
    return factor @ factor.swapaxes(1, 2) + size * np.eye(size)


def study(empty=False):
    """One artifact of every stage, and every Monte Carlo case; `empty` ones have no number where they need none."""

    def stand_in(kind, extents=None, **known):
        return invented(kind, extents, empty, **known)

    def flights(seed, time=TIME, states=6):
        ensemble = stand_in(FlightEnsemble, {"states": states, "time": len(time)}, time=time)
        largest = ensemble.maximum_over_trials * (1.0 + 0.1 * seed)
        return replace(ensemble, maximum_over_trials=largest)

    car_time = np.linspace(0.0, 4.0, FINE + 1)
    return {
        "nominal": stand_in(Nominal),
        "linearization": stand_in(Linearization, time=TIME, half_time=np.linspace(0.0, 240.0, 2 * FINE + 1)),
        "funnel": stand_in(Funnel, step=STEP, time=TIME[STEP], shape=shapes(SLICES, 6), outcome="complete"),
        "linear_bounds": stand_in(LinearBounds, time=TIME, slice_time=TIME[STEP], slice_step=STEP),
        "proven": stand_in(Proven, step=STEP, time=TIME[STEP], node_time=TIME, proven=not empty),
        "dubins": stand_in(
            Dubins,
            time=car_time,
            funnel=np.array(["flow", "euler", "wind"]),
            slice_step=STEP,
            slice_time=car_time[STEP],
            shape=shapes(FINE + 1, 3, seed=2),
        ),
        "dubins_study": stand_in(DubinsStudy, proven_funnel=np.array(["wind", "flow"])),
        "constant": flights(0),
        "redrawn": flights(1),
        "adversarial": flights(2),
        "dubins_calm": flights(3, car_time, 3),
        "dubins_wind": flights(4, car_time, 3),
    }


@pytest.fixture(scope="module")
def records():
    return study()


@pytest.fixture
def draw(records):
    """Draw a figure, from changed artifacts on demand."""

    def figure_of(stem, **replacements):
        values = {name: INPUTS[name.partition(".")[2]] for name in Inputs.names() if name.partition(".")[2] in INPUTS}
        given = Arguments(values, lambda name, kind: replacements.get(name, records[name]))
        return given.call(getattr(figures, stem))

    return figure_of


def curves(axes, color=None, style=None, least=3):
    """Lines with data (those of a legend have none), of a colour and a style if given."""
    return [
        line
        for line in axes.lines
        if len(line.get_xdata()) >= least
        and (color is None or same_color(line.get_color(), color))
        and style in (None, line.get_linestyle())
    ]


def labels(figure):
    """All labels of a figure's legends."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


# --- all figures ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stem", catalogue("funnels").figures)
def test_figures_without_any_number_are_drawn(draw, stem):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(stem, **study(empty=True)).draw_without_rendering()


# --- figures of the paper ---------------------------------------------------------------------------------------------


def test_fig01_shows_the_projections_of_the_slices(draw, records):
    funnel, linearization = records["funnel"], records["linearization"]
    small = replace(funnel, shape=1e6 * funnel.shape)
    figure = draw("fig01", funnel=small)
    whole, end, height = figure.axes
    outlines = [patch.get_xy() for patch in whole.patches if isinstance(patch, Polygon) and len(patch.get_xy()) > 2]
    assert len(outlines) == SLICES and len([p for p in end.patches if len(p.get_xy()) > 2]) == 2
    unit = np.array([3.4e6 / KM, 1 / KM])
    for k, outline in enumerate(outlines):
        centre = linearization.state[4 * k, [1, 0]] - [0.5, 0.0]
        # The farthest point of an ellipsoid in any direction is that of its projection.
        inverse = np.linalg.inv(small.shape[k])[np.ix_([1, 0], [1, 0])]
        for direction in np.random.default_rng(3).standard_normal((5, 2)):
            reach = np.sqrt(2.0 * small.level[k] * direction @ inverse @ direction)
            assert ((outline / unit - centre) @ direction).max() == pytest.approx(reach, rel=2e-3)
    (path,) = curves(whole, BLACK)
    np.testing.assert_allclose(path.get_xdata(), (linearization.state[:, 1] - 0.5) * 3.4e3)
    np.testing.assert_allclose(path.get_ydata(), linearization.state[:, 0] / KM)
    assert labels(figure) == ["nominal", "entry", "deployment of the parachute", "slices"]
    assert whole.get_title(loc="left") == ""
    lower, upper = curves(height, BLUE)
    reach = np.sqrt(2.0 * small.level * np.linalg.inv(small.shape)[:, 0, 0]) / KM
    np.testing.assert_allclose(upper.get_ydata(), reach)
    np.testing.assert_allclose(lower.get_ydata(), -reach)
    np.testing.assert_allclose(upper.get_xdata(), path.get_xdata()[2 * STEP])
    assert height.get_ylim()[1] > reach.max() and height.get_xlim() == whole.get_xlim()


def test_fig02_draws_surfaces_of_the_slices_and_flights(draw, records, monkeypatch):
    surfaces = []
    monkeypatch.setattr(Axes3D, "plot_surface", lambda self, *surface, **_: surfaces.append(np.array(surface)))
    figure, dubins, flights = draw("fig02"), records["dubins"], records["dubins_calm"]
    assert len(surfaces) == SLICES
    path = dubins.state[::2]
    for k, surface in enumerate(surfaces):
        deviation = surface.reshape(3, -1).T * [1.0, 1.0, DEGREE] - path[STEP[k]]
        values = np.einsum("mi,ij,mj->m", deviation, dubins.shape[STEP[k]], deviation) / 2.0
        np.testing.assert_allclose(values, dubins.level[0, k])
    lines = [line for line in figure.axes[0].lines if len(line.get_data_3d()[0]) == FINE + 1]
    assert len(lines) == 5
    np.testing.assert_allclose(lines[1].get_data_3d()[2], (path + flights.kept_history[1])[:, 2] / DEGREE)
    np.testing.assert_allclose(np.transpose(lines[-1].get_data_3d()), path / [1.0, 1.0, DEGREE])
    assert labels(figure) == ["nominal", "4 of 50 flights", "7 of 7 slices"]


def test_fig03_has_levels_over_steps_and_times(draw, records):
    funnel, ensemble = records["funnel"], records["constant"]
    figure = draw("fig03")
    linear, logarithmic = figure.axes
    assert linear.get_yscale() == "linear" and logarithmic.get_yscale() == "log"
    for axes in (linear, logarithmic):
        (level,), (largest,) = curves(axes, BLUE), curves(axes, VERMILION)
        np.testing.assert_array_equal(level.get_xydata(), np.transpose([np.arange(1, SLICES + 1), funnel.level]))
        # At a slice the node has its number.
        np.testing.assert_allclose(largest.get_xdata()[STEP], np.arange(1, SLICES + 1))
        np.testing.assert_array_equal(largest.get_ydata(), ensemble.maximum_over_trials[:, 0])
        (times,) = axes.child_axes
        figure.draw_without_rendering()
        np.testing.assert_allclose(times.get_xlim(), [0.0, 240.0])
    band = linear.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(ensemble.repeat_maximum[:, :, 0].max())
    assert "Monte Carlo, largest of 50 flights" in labels(figure)
    lost = draw("fig03", constant=replace(ensemble, excluded=3), funnel=replace(funnel, outcome="diverges"))
    assert any("(3 lost)" in label for label in labels(lost))
    assert "ends at slice 7" in lost.axes[0].texts[0].get_text()


def test_fig04_fills_where_v_falls(draw, records):
    axis = np.linspace(-1.6, 1.6, 9)
    first, second = np.meshgrid(axis, axis)
    angle = 2.0 * np.pi * np.arange(8) / 8 + 0.1
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    funnel = replace(
        records["funnel"],
        fig4_coordinate=axis,
        fig4_rate=first - 0.45,
        fig4_worst_rate=second + 0.2,
        fig4_circle=circle,
        fig4_circle_rate=circle[:, 0] - 0.45,
        fig4_circle_worst_rate=np.where(circle[:, 1] > 0.9, np.nan, circle[:, 1] + 0.2),
    )
    left, right = draw("fig04", funnel=funnel).axes
    for axes, side, limit in ((left, 0, 0.45), (right, 1, -0.2)):
        corners = axes.collections[0].get_paths()[0].vertices
        assert corners[:, side].max() == pytest.approx(limit) and corners[:, side].min() == pytest.approx(-1.6)
        (falling,), (not_falling,) = (
            [line for line in axes.lines if line.get_marker() == "o" and same_color(line.get_color(), color)][:1]
            for color in (BLUE, VERMILION)
        )
        in_panel = circle[:, side] < limit
        np.testing.assert_array_equal(falling.get_xydata(), circle[in_panel])
        np.testing.assert_array_equal(not_falling.get_xydata(), circle[~in_panel])
        samples = next(line for line in axes.lines if line.get_marker() == ".")
        np.testing.assert_array_equal(samples.get_xydata(), funnel.samples[:, [1, 4]])
    share = 100 * np.mean(first < 0.45)
    assert left.get_title() == f"$w = 0$: $V$ falls in {share:.3g} % of the plane"
    assert left.get_xlabel().endswith("$y_2$") and left.get_ylabel().endswith("$y_5$")


# --- beyond the paper -------------------------------------------------------------------------------------------------


def test_bands_have_every_state_in_its_unit(draw, records):
    funnel, linear, ensemble = records["funnel"], records["linear_bounds"], records["constant"]
    figure = draw("bands")
    units = (1 / KM, 3.4e3, 3.4e3, 1.0, 1 / DEGREE, 1 / DEGREE)
    for component, (axes, unit) in enumerate(zip(figure.axes, units, strict=True)):
        for color, style, values in (
            (BLUE, "-", funnel.half_width),
            (BLACK, "--", linear.exact_half_width),
        ):
            lower, upper = curves(axes, color, style)
            np.testing.assert_allclose(upper.get_ydata(), values[:, component] * unit)
            np.testing.assert_allclose(lower.get_ydata(), -upper.get_ydata())
        flights = curves(axes, VERMILION)
        assert len(flights) == 4
        np.testing.assert_allclose(flights[2].get_ydata(), ensemble.kept_history[2, :, component] * unit)
        (ends,) = [line for line in axes.lines if line.get_marker() == "_" and len(line.get_xdata()) == 2]
        final = ensemble.final_state[:, component] * unit
        np.testing.assert_allclose(ends.get_ydata(), [final.min(), final.max()])
        assert axes.get_ylim()[1] == pytest.approx(1.08 * funnel.half_width[:, component].max() * unit)
    assert labels(figure)[0] == "funnel"
    wide = draw("bands", funnel=replace(funnel, half_width=1e6 * funnel.half_width))
    assert wide.axes[3].get_ylim()[1] < 6.0 and labels(wide)[0] == "funnel, beyond the axes"
