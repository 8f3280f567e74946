"""The figures of the funnels paper hold the right curves; nothing here looks at pixels.

What they are drawn from is invented: artifacts of the right shapes.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import Polygon

from drawn import labels
from invented import invented
from marsedl.papers import catalogue
from marsedl.papers.funnels import figures
from marsedl.papers.funnels.basics import OBSERVED
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
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.units import KM

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


def shapes(count, size, seed=1):
    """Positive definite matrices."""
    factor = np.random.default_rng(seed).standard_normal((count, size, size))
    return factor @ factor.swapaxes(1, 2) + size * np.eye(size)


def study(empty=False):
    """One artifact of every stage, and every Monte Carlo case; `empty` ones have no number where they need none."""

    def stand_in(kind, extents=None, **known):
        return invented(kind, EXTENTS | (extents or {}), empty=empty, **known)

    def flights(seed, time=TIME, states=6):
        extents = {"states": states, "time": len(time)}
        ensemble = stand_in(FlightEnsemble, extents, time=time, observed_name=np.array(OBSERVED))
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


# --- all figures ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("empty", [False, True])
@pytest.mark.parametrize("stem", catalogue("funnels").figures)
def test_every_figure_draws_also_without_any_number(draw, stem, empty):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(stem, **study(empty)).draw_without_rendering()


# --- figures of the paper ---------------------------------------------------------------------------------------------


def test_fig01_shows_the_projections_of_the_slices(draw, records):
    funnel, linearization = records["funnel"], records["linearization"]
    small = replace(funnel, shape=1e6 * funnel.shape)
    figure = draw("fig01", funnel=small)
    whole, end, _ = figure.axes
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
    assert labels(figure) == ["nominal", "entry", "deployment of the parachute", "slices"]


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
    share = 100 * np.mean(first < 0.45)
    assert left.get_title() == f"$w = 0$: $V$ falls in {share:.3g} % of the plane"
