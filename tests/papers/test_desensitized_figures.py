"""The figures of the desensitized-landing paper hold the right curves; nothing here looks at pixels.

What they are drawn from is invented: artifacts of the right shapes.
"""

import inspect
import warnings
from dataclasses import replace

import numpy as np
import pytest

from drawn import curves, labels
from invented import invented
from marsedl.papers import catalogue
from marsedl.papers.desensitized import figures
from marsedl.papers.desensitized.inputs import Ensemble
from marsedl.papers.desensitized.records import (
    LAWS,
    FlightEnsemble,
    Gains,
    MinimumFuel,
    Nominal,
    Responses,
    Tradeoff,
)
from marsedl.plotting.style import GREY, SKY, VERMILION

FIGURES = catalogue("desensitized").figures
# Sizes of dimensions that must fit together.
EXTENTS = {"time": 12, "node": 12, "intervals": 11, "law": 6}
CROSSRANGE, DOWNRANGE = 1, 2
OTHERS = {"nominal": Nominal, "entry_errors": FlightEnsemble, "minimum_fuel": MinimumFuel}


@pytest.fixture(scope="module")
def gains():
    return invented(Gains, EXTENTS, law=np.array(LAWS))


@pytest.fixture(scope="module")
def responses():
    time = np.linspace(0.0, 200.0, 12) + np.arange(6)[:, np.newaxis]
    sweep = np.array([np.linspace(-size, size, 9) for size in (2000.0, 1000.0, 500.0)])
    record = invented(Responses, EXTENTS | {"points": 9}, law=np.array(LAWS), time=time, wide=sweep, narrow=0.1 * sweep)
    bank = record.nominal.copy()
    bank[:, :, 6] = np.linspace(-1.0, 1.0, 12) + 0.1 * np.arange(6)[:, np.newaxis]
    return replace(record, nominal=bank, drawn_error=np.array([200.0, 1000.0, 300.0]))


@pytest.fixture(scope="module")
def tradeoff():
    return invented(
        Tradeoff,
        EXTENTS | {"rows": 7, "steps": 8, "branch": 2, "folds": 1},
        printed_weight=np.array([0.0, 1e-3, 1e-2, 0.1, 1.0, np.nan, np.nan]),
        weight=np.array([0.0, 0.03, 0.6, 5.3, 45.0, 1e6, 2.5e7]),
        path_branch=np.array([0, 0, 0, 1, 1, 1, 1, 1]),
        reversals=np.array([2, 2, 2, 3, 1, 2, 0]),
        branch=np.array(["2 reversals", "1 reversal"]),
    )


@pytest.fixture
def printed(desensitized, desensitized_published):
    """A design whose rows are the paper's, and the printed claims."""
    return desensitized.inputs("corrected").design, desensitized_published


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("stem", FIGURES)
def test_every_figure_draws(desensitized, desensitized_published, gains, responses, tradeoff, stem, lost):
    """Also from flights that are lost, gains that were not found and a path without jumps."""
    records = {"gains": gains, "responses": responses, "tradeoff": tradeoff}
    records |= {name: invented(kind, EXTENTS) for name, kind in OTHERS.items()}
    if lost:
        fields = ("state", "acceleration", "error", "wide_error", "narrow_error")
        holes = {name: np.full_like(getattr(responses, name), np.nan) for name in fields}
        records["responses"] = replace(responses, **holes)
        records["gains"] = replace(gains, converged=np.array([True, True, False, False, False, True]))
        folds = {name: np.empty((0, 2)) for name in ("fold_weight", "fold_effort", "fold_error")}
        records["tradeoff"] = replace(tradeoff, path_branch=np.zeros(8, int), branch=tradeoff.branch[:1], **folds)
    with warnings.catch_warnings():
        warnings.simplefilter("error" if lost else "default")
        figure = desensitized.product("figures", stem, "corrected", records, published=desensitized_published)
        figure.draw_without_rendering()
    if lost and "gains" in inspect.signature(getattr(figures, stem)).parameters and stem != "dispersion":
        assert any("gains not converged" in label for label in labels(figure))
        if figure.axes[0].get_ylabel() == "final position error (m)":
            assert any("9 of 9 flights lost" in label for label in labels(figure))


def test_fig02_draws_any_number_of_rows(tradeoff, printed):
    """Before, it took seven for granted; a row whose control energy lies below the least is left out."""
    rows = ("printed_weight", "weight", "time", "state", "reversals", "effort")
    fewer = replace(tradeoff, **{name: np.delete(getattr(tradeoff, name), 1, axis=0) for name in rows})
    assert [len(curves(axes)) for axes in figures.fig02(*printed, fewer).axes] == [4, 2]


def test_dispersion_ellipse_is_that_of_the_sampled_linear_model(gains):
    deviations, trials = np.array([200.0, 1000.0, 300.0]), 4000
    errors = np.random.default_rng(3).standard_normal((trials, 3)) * deviations
    final = np.einsum("lij,nj->lni", gains.final, errors)
    final[2, :7], final[3] = np.nan, np.nan
    ensemble = invented(FlightEnsemble, EXTENTS, final_error=final)
    figure = figures.dispersion(Ensemble.from_plain({"initial_deviations": deviations}), gains, ensemble)
    for number, axes in enumerate(figure.axes):
        (dots,) = curves(axes, SKY, least=100)
        np.testing.assert_allclose(dots.get_xdata(), final[number, :2000, DOWNRANGE] / 1e3)
        np.testing.assert_allclose(dots.get_ydata(), final[number, :2000, CROSSRANGE] / 1e3)
        assert len(curves(axes, GREY, ":")) == (number > 0)  # the square of the first axes
        assert axes.get_xlim() == axes.get_ylim()
        (curve,) = curves(axes, VERMILION)
        sampled = np.cov(final[number, 7:][:, [DOWNRANGE, CROSSRANGE]].T / 1e3)
        if number != 3:
            distance = np.einsum("ki,ij,kj->k", curve.get_xydata(), np.linalg.inv(sampled), curve.get_xydata())
            np.testing.assert_allclose(distance, 9.0, rtol=0.25)  # three standard deviations, twice squared
            assert "linear" in axes.get_title()
    assert "7 lost" in figure.axes[2].get_title() and "4,000 lost" in figure.axes[3].get_title()
    limits = [axes.get_xlim()[1] for axes in figure.axes]
    assert len(set(limits)) > 1
    np.testing.assert_allclose(np.abs(curves(figure.axes[1], GREY, ":")[0].get_xydata()), limits[0])
    assert "2,000 of 4,000 flights" in labels(figure)
