"""The figures of the desensitized-landing paper hold the right curves; nothing here looks at pixels.

What they are drawn from is mostly invented: artifacts of the right shapes in which no two numbers are equal, so that
a curve that is drawn from the wrong place is found out.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color

from marsedl.papers.desensitized import figures
from marsedl.papers.desensitized.inputs import Ensemble, Simulation, Vehicle
from marsedl.papers.desensitized.records import (
    LAWS,
    FlightEnsemble,
    Gains,
    Responses,
    Tradeoff,
)
from marsedl.plotting.style import BLACK, BLUE, GREY, SKY, VERMILION
from marsedl.replication.records.fields import quantities

DEGREE = np.pi / 180
ERRORS = Simulation.from_plain({"tabulated_error": 1000.0})
RADIUS, CROSSRANGE, DOWNRANGE = range(3)
CHANNELS = ("radius", "crossrange", "downrange")
SWEEPS = {
    "fig03a": (RADIUS, "wide", 2),
    "fig03b": (RADIUS, "narrow", 2),
    "fig06a": (DOWNRANGE, "wide", 1),
    "fig06b": (DOWNRANGE, "narrow", 1),
    "fig09": (CROSSRANGE, "wide", 1),
}
HISTORIES = {"fig04": (RADIUS, 2), "fig08": (DOWNRANGE, 1), "fig11": (CROSSRANGE, 1)}
RATES = {"fig05a": RADIUS, "fig07a": DOWNRANGE, "fig10a": CROSSRANGE}
ANGLES = {"fig05b": RADIUS, "fig07b": DOWNRANGE, "fig10b": CROSSRANGE}


def invented(kind, extents=None, **known):
    """An artifact of a type, of random numbers between 1 and 2 but for what is known; its names are numbered."""
    random, sizes = (
        np.random.default_rng(7),
        {"time": 12, "node": 12, "intervals": 11} | (extents or {}),
    )
    fields = {}
    for name, declared in quantities(kind).items():
        shape = tuple(sizes.get(extent, 3) if isinstance(extent, str) else extent for extent in declared.dims)
        if declared.dtype == "str":
            values = np.array([f"{name} {k}" for k in range(int(np.prod(shape)))]).reshape(shape)
        elif declared.dtype == "bool":
            values = np.ones(shape, bool)
        elif declared.dtype == "float64":
            values = 1.0 + random.random(shape)
        else:
            values = np.zeros(shape, np.dtype(declared.dtype))
        fields[name] = known.get(name, values if shape else values.item())
    return kind(**fields)


@pytest.fixture(scope="module")
def gains():
    return invented(Gains, {"law": 6}, law=np.array(LAWS))


@pytest.fixture(scope="module")
def responses():
    time = np.linspace(0.0, 200.0, 12) + np.arange(6)[:, np.newaxis]
    sweep = np.array([np.linspace(-size, size, 9) for size in (2000.0, 1000.0, 500.0)])
    record = invented(Responses, {"law": 6, "points": 9}, law=np.array(LAWS), time=time, wide=sweep, narrow=0.1 * sweep)
    bank = record.nominal.copy()
    bank[:, :, 6] = np.linspace(-1.0, 1.0, 12) + 0.1 * np.arange(6)[:, np.newaxis]
    return replace(record, nominal=bank, drawn_error=np.array([200.0, 1000.0, 300.0]))


@pytest.fixture(scope="module")
def tradeoff():
    return invented(
        Tradeoff,
        {"rows": 7, "steps": 8, "branch": 2, "folds": 1},
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


@pytest.fixture
def pareto(printed):
    """Draw the figure of that name, from a changed design on demand."""

    def drawn(tradeoff, **changes):
        design, published = printed
        return figures.pareto(design.model_copy(update=changes), ERRORS, published, tradeoff)

    return drawn


@pytest.fixture
def draw(gains, responses, tradeoff):
    """Draw a figure of the laws, from changed artifacts on demand."""

    def figures_of(stem, changed_gains=None, changed_responses=None):
        return getattr(figures, stem)(changed_gains or gains, changed_responses or responses)

    return figures_of


def curves(axes, color=None, style=None, least=3):
    """Lines with data (those of a legend have none), of a colour and a style if given."""
    lines = [line for line in axes.lines if len(line.get_xdata()) >= least]
    return [
        line
        for line in lines
        if (color is None or same_color(line.get_color(), color)) and style in (None, line.get_linestyle())
    ]


def labels(figure):
    """All labels of a figure's legends."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def law(name):
    """Number of a law."""
    return LAWS.index(name)


def drawn_laws(channel, compared):
    """Names of the laws in a figure of a channel: so many without feedback, and its own."""
    return (*("no_doc", "reshaped")[:compared], CHANNELS[channel])


# --- the nominal, and reshaping ---------------------------------------------------------------------------------------


def test_fig01_shows_the_nominal_in_degrees(desensitized):
    nominal = desensitized.nominal("one_reversal")
    vehicle = Vehicle.from_plain({"bank_rate_bound": 0.3, "bank_acceleration_bound": 0.09})
    rate, acceleration = figures.fig01a(vehicle, nominal).axes
    np.testing.assert_allclose(curves(rate)[0].get_ydata(), nominal.state[:, 7] * 180 / np.pi)
    np.testing.assert_allclose(acceleration.patches[0].get_data().values, nominal.bank_acceleration * 180 / np.pi)
    assert f"bound {0.3 * 180 / np.pi:g} deg/s" in rate.get_title(loc="right")
    assert not [line for line in rate.lines if line.get_linestyle() == "--"]  # a bound far away is not drawn
    (axes,) = figures.fig01b(nominal).axes
    (angle,) = curves(axes)
    np.testing.assert_allclose(angle.get_ydata(), nominal.state[:, 6] * 180 / np.pi)
    (mark,) = [line for line in axes.lines if line.get_marker() == "o"]
    # The mark is where the curve passes zero.
    assert np.interp(mark.get_xdata()[0], *angle.get_data()) == pytest.approx(0.0, abs=1e-9)
    assert axes.get_title() == "1 reversal"


def test_fig02_has_a_curve_per_row_with_its_weight_and_reversals(tradeoff, printed):
    figure = figures.fig02(*printed, tradeoff)
    finite, infinite = (curves(axes) for axes in figure.axes)
    lines = finite + infinite
    assert (len(finite), len(infinite)) == (5, 2)
    for number, line in enumerate(lines):
        np.testing.assert_array_equal(line.get_xdata(), tradeoff.time[number])
        np.testing.assert_allclose(line.get_ydata(), tradeoff.state[number, :, 6] / DEGREE)
    assert [line.get_linestyle() for line in lines] == ["-"] * 6 + ["--"]
    assert infinite[0].get_linewidth() > infinite[1].get_linewidth()  # one is seen behind the other
    texts = labels(figure)
    assert texts[0] == "$c_1$ = 0: 2 reversals" and texts[4] == "$c_1$ = 1: 1 reversal"
    assert texts[5].endswith("($c$ = $10^{6}$): 2 reversals") and r"2.5 \cdot 10^{7}" in texts[6]


def test_fig02_draws_any_number_of_rows(tradeoff, printed):
    """Before, it took seven for granted; a row whose control energy lies below the least is left out."""
    rows = ("printed_weight", "weight", "time", "state", "reversals", "effort")
    fewer = replace(tradeoff, **{name: np.delete(getattr(tradeoff, name), 1, axis=0) for name in rows})
    assert [len(curves(axes)) for axes in figures.fig02(*printed, fewer).axes] == [4, 2]


# --- errors at entry --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stem", SWEEPS)
def test_sweeps_show_the_norm_of_the_final_error(draw, responses, stem):
    channel, kind, compared = SWEEPS[stem]
    axes, *logarithmic = draw(stem).axes
    names = (
        ("no_doc", "reshaped", CHANNELS[channel])[-compared - 1 :] if compared == 2 else ("no_doc", CHANNELS[channel])
    )
    lines = curves(axes)
    assert len(lines) == compared + 1
    for name, line in zip(names, lines, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), getattr(responses, kind)[channel])
        error = getattr(responses, f"{kind}_error")[law(name), channel]
        np.testing.assert_allclose(line.get_ydata(), np.sqrt((error**2).sum(axis=1)))
    assert same_color(lines[-1].get_color(), VERMILION) and lines[-1].get_linestyle() == "-"
    assert axes.get_xlabel() == f"{CHANNELS[channel]} error at entry (m)"
    assert axes.get_ylabel() == "final position error (m)"
    assert len(logarithmic) == (kind == "narrow")
    for other in logarithmic:
        assert other.get_yscale() == "log" and other.get_xlabel() == axes.get_xlabel()
        sides = curves(other)
        assert len(sides) == 2 * len(lines)  # without the flight without error, at which the logarithm has no end
        for number, line in enumerate(lines):
            pieces = np.concatenate([side.get_ydata() for side in sides[2 * number : 2 * number + 2]])
            np.testing.assert_array_equal(pieces, np.delete(line.get_ydata(), 4))


@pytest.mark.parametrize("stem", HISTORIES)
def test_histories_show_three_errors_of_the_flights(draw, responses, stem):
    channel, compared = HISTORIES[stem]
    figure = draw(stem)
    names = drawn_laws(channel, compared)
    for component, axes in enumerate(figure.axes):
        lines = curves(axes)
        assert len(lines) == len(names)
        ends = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"]
        for name, line in zip(names, lines, strict=True):
            np.testing.assert_array_equal(line.get_xdata(), responses.time[law(name)])
            np.testing.assert_array_equal(line.get_ydata(), responses.error[law(name), channel, :, component])
        # The invented flights of law number n end at 200 + n s.
        early = [line for name, line in zip(names, lines, strict=True) if law(name) < law(names[-1]) - 1]
        np.testing.assert_array_equal(ends, [line.get_xydata()[-1] for line in early])
        assert axes.get_ylabel() == f"{CHANNELS[component]} error (m)"
    assert f"{responses.drawn_error[channel]:+g} m" in figure.axes[0].get_title()
    assert labels(figure) == [*("no DOC, ends at 200 s", "DOC without feedback")[:compared], "DOC with feedback"]


@pytest.mark.parametrize("stem", ANGLES)
def test_bank_angles_their_difference_and_the_reversals_of_the_nominal(draw, responses, stem):
    channel = ANGLES[stem]
    number = law(CHANNELS[channel])
    angle, difference = draw(stem).axes
    (nominal,), (perturbed,) = curves(angle, BLACK, "--"), curves(angle, VERMILION)
    np.testing.assert_allclose(nominal.get_ydata(), responses.nominal[number, :, 6] / DEGREE)
    np.testing.assert_allclose(perturbed.get_ydata(), responses.state[number, channel, :, 6] / DEGREE)
    (apart,) = curves(difference)
    np.testing.assert_allclose(apart.get_ydata(), perturbed.get_ydata() - nominal.get_ydata())
    for axes in (angle, difference):
        (mark,) = [line for line in axes.lines if line.get_linestyle() == ":"]
        # The invented bank angle is a line from -1 + 0.1 n to 1 + 0.1 n over 200 s.
        assert mark.get_xdata()[0] == pytest.approx(number + 200.0 * (1.0 - 0.1 * number) / 2.0)


@pytest.mark.parametrize("stem", ["fig03b", "fig04", "fig05a", "fig05b"])
def test_what_was_lost_or_not_found_is_said(draw, gains, responses, stem):
    lost = replace(
        responses,
        **{
            name: np.full_like(getattr(responses, name), np.nan)
            for name in ("state", "acceleration", "error", "wide_error", "narrow_error")
        },
    )
    unfinished = replace(gains, converged=np.array([True, True, False, False, False, True]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = draw(stem, unfinished, lost)
        figure.draw_without_rendering()
    texts = labels(figure)
    assert any("gains not converged" in label for label in texts)
    if stem in SWEEPS:
        assert any("9 of 9 flights lost" in label for label in texts)
    if stem in RATES or stem in ANGLES:
        assert any(label.endswith(", lost") for label in texts)


# --- beyond the paper -------------------------------------------------------------------------------------------------


def test_pareto_shows_path_jumps_and_rows(tradeoff, pareto):
    (axes,) = pareto(tradeoff).axes
    assert axes.child_axes
    assert axes.get_yscale() == "log" and "1000 m" in axes.get_xlabel()
    error = np.linalg.norm(tradeoff.path_error, axis=1)
    for color, part in ((BLACK, slice(0, 3)), (BLUE, slice(3, 8))):
        (path,) = curves(axes, color, "-")
        np.testing.assert_allclose(path.get_xdata(), error[part])
        np.testing.assert_array_equal(path.get_ydata(), tradeoff.path_effort[part])
    (jump,) = [line for line in axes.lines if line.get_linestyle() == ":"]
    np.testing.assert_array_equal(jump.get_xydata(), np.transpose([tradeoff.fold_error[0], tradeoff.fold_effort[0]]))
    (rows,) = [line for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(rows.get_xdata(), np.linalg.norm(tradeoff.error, axis=1))
    np.testing.assert_array_equal(rows.get_ydata(), tradeoff.effort)
    (printed,) = [line for line in axes.lines if line.get_marker() == "x"]
    np.testing.assert_array_equal(printed.get_xdata(), [8039, 7959, 7372, 6472, 6172, 5939])
    np.testing.assert_array_equal(printed.get_ydata(), [0.1374, 0.14, 0.3078, 1.5603, 5.1812, 586.8673])


def test_pareto_without_folds(tradeoff, pareto):
    plain = replace(
        tradeoff,
        path_branch=np.zeros(8, int),
        branch=np.array(["2 reversals"]),
        **{name: np.empty((0, 2)) for name in ("fold_weight", "fold_effort", "fold_error")},
    )
    (axes,) = pareto(plain).axes
    assert not axes.child_axes
    assert not [line for line in axes.lines if line.get_linestyle() == ":"]


def test_dispersion_ellipse_is_that_of_the_sampled_linear_model(gains):
    deviations, trials = np.array([200.0, 1000.0, 300.0]), 4000
    errors = np.random.default_rng(3).standard_normal((trials, 3)) * deviations
    final = np.einsum("lij,nj->lni", gains.final, errors)
    final[2, :7], final[3] = np.nan, np.nan
    ensemble = invented(FlightEnsemble, {"law": 6}, final_error=final)
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
