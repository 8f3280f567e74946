"""The figures of the entry-guidance paper hold the right curves; nothing here looks at pixels."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from marsedl.montecarlo.streams import normals
from marsedl.papers import catalogue
from marsedl.papers.stochastic_entry import dispersions, environment, figures, records
from marsedl.papers.stochastic_entry.records import errors
from marsedl.plotting.style import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION

DRAWN = 12  # trials, see the fixtures
SKETCHES = ("fig01", "fig03")
FLOWN = ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity")

PAPER = catalogue("stochastic_entry")


@pytest.fixture(scope="module")
def draw(entry):
    """Draw a figure of a reading from the inputs and artifacts that the catalogue gives it; changed ones on demand."""
    figure_of = {}

    def made_of(stem, reading):
        return {
            need.split(".")[-1]: entry.ensemble(reading, need.split(".")[1])
            if need.startswith("montecarlo")
            else entry.stage(need, reading)
            for need in PAPER.figures[stem].needs
        }

    def draw_once(stem, reading="corrected", artifacts=None, **changes):
        if artifacts or changes:
            records_of_figure = made_of(stem, reading) | (artifacts or {})
            return entry.inputs(reading, PAPER.figures[stem].inputs, **changes).call(
                getattr(figures, stem), **records_of_figure
            )
        if (stem, reading) not in figure_of:
            figure_of[stem, reading] = entry.product("figures", stem, reading, made_of(stem, reading))
        return figure_of[stem, reading]

    return draw_once


def curves(axes, color=None, style=None, least=3):
    """Lines with data (those of a legend have none), of a colour and a style if given."""
    lines = [line for line in axes.lines if len(line.get_xdata()) >= least]
    return [
        line
        for line in lines
        if (color is None or same_color(line.get_color(), color)) and style in (None, line.get_linestyle())
    ]


def at_whole_second(nominal, name, second, substeps=20):
    return getattr(nominal, name)[second * substeps]


@pytest.mark.parametrize("reading", ["corrected", "printed"])
@pytest.mark.parametrize("stem", PAPER.figures)
def test_every_figure_draws(draw, stem, reading):
    figure = draw(stem, reading)
    assert isinstance(figure, Figure)
    for axes in figure.axes:
        assert axes.get_title() or axes.lines or axes.patches
    for labelled in (Axes.get_xlabel, Axes.get_ylabel):
        assert stem in SKETCHES or any(labelled(axes) for axes in figure.axes)
    figure.draw_without_rendering()


# --- sketches and densities -------------------------------------------------------------------------------------------


def density_inputs(entry):
    return entry.inputs("corrected", PAPER.figures["fig02"].inputs)


def test_fig02_shows_eq_8_beside_a_labelled_surrogate(draw, entry):
    inputs = density_inputs(entry)
    left, right = draw("fig02").axes
    air = inputs.call(environment.atmosphere)
    in_atmosphere = (air.altitude >= 0) & (air.altitude <= 125e3)
    for axes, color in ((left, BLUE), (right, VERMILION)):
        assert len(curves(axes, color)) == inputs.drawn_densities
        for line, sign in zip(curves(axes, BLACK, "--"), (-1, 1), strict=True):
            np.testing.assert_allclose(line.get_xdata(), sign * 2 * air.deviation[in_atmosphere])
            np.testing.assert_allclose(line.get_ydata(), air.altitude[in_atmosphere] / 1e3)
    # Eq. 8 step by step: decay 2/H, diffusion 4 zeta/H.
    inverse_height = -inputs.call(environment.profile)(air.altitude)[1]
    normal_numbers = normals(inputs.seed, dispersions.PROCESS_STREAM, [3], len(air.altitude))[0]
    variation = air.deviation[-1] * normal_numbers[0]
    expected = [variation]
    for number, node in enumerate(range(len(air.altitude) - 2, -1, -1), start=1):
        decay = inverse_height[node] + inverse_height[node + 1]
        diffusion = 2 * (air.deviation**2 * inverse_height)[node : node + 2].sum()
        keep = np.exp(-decay * 100.0)
        variation = keep * variation + np.sqrt(diffusion * (1 - keep**2) / (2 * decay)) * normal_numbers[number]
        expected.append(variation)
    np.testing.assert_allclose(curves(left, BLUE)[3].get_xdata(), np.array(expected)[::-1][in_atmosphere], rtol=1e-9)


@pytest.mark.parametrize("case", ["stochastic_velocity"])
def test_fig04_samples_are_those_that_the_trials_fly_through(draw, entry, case):
    (axes,) = draw("fig04").axes
    samples = curves(axes, BLUE)
    inputs = density_inputs(entry)
    assert len(samples) == inputs.drawn_densities >= DRAWN
    air = inputs.call(environment.atmosphere)
    for line, trial in zip(samples, entry.ensemble("corrected", case).kept_history, strict=False):
        altitude, density = trial[np.isfinite(trial[:, 0])][:, [records.ALTITUDE, records.DENSITY]].T
        inside = altitude < 125e3  # dispersed entries are all at the edge itself
        mean = np.exp(np.interp(altitude, air.altitude, air.log_density))
        expected = np.interp(altitude / 1e3, line.get_ydata(), line.get_xdata())
        np.testing.assert_allclose((density / mean - 1)[inside], expected[inside], atol=1e-10)
        assert inside.sum() > 200


# --- nominal ----------------------------------------------------------------------------------------------------------


def test_fig05_reversals_stand_beyond_the_deadband(draw, entry):
    (axes,) = draw("fig05").axes
    nominal = entry.nominal()
    (crossrange,) = curves(axes, BLUE)
    np.testing.assert_allclose(crossrange.get_ydata(), nominal.crossrange / 1e3)
    lower, upper = curves(axes, GREY, "--")
    np.testing.assert_array_equal(lower.get_ydata(), -upper.get_ydata())
    assert upper.get_xdata()[-1] == nominal.alignment_time == 145.0
    np.testing.assert_allclose(upper.get_ydata()[[0, 115, -1]], [6.0, 3.6, 1.2])
    (marks,) = [line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert list(marks.get_xdata()) == [71.0, 92.0, 118.0]
    width = np.interp(marks.get_xdata(), upper.get_xdata(), upper.get_ydata())
    assert (marks.get_ydata() * [-1, 1, -1] > width).all()


# --- linear covariance ------------------------------------------------------------------------------------------------


def test_fig08_stochastic_bounds_hold_and_those_of_apollo_leave_the_cosine(draw, entry):
    apollo, stochastic = draw("fig08").axes
    gains, linearization = entry.gains(), entry.linearization()
    time = gains.time[gains.time < 145.0]
    mean = linearization.bank_cosine[: len(time)]
    for axes, color, style, variance in (
        (stochastic, VERMILION, "-", gains.stochastic_control_variance[0]),
        (stochastic, ORANGE, "--", gains.stochastic_control_variance[1]),
        (apollo, BLUE, "-", gains.apollo_control_variance[0]),
        (apollo, SKY, "--", gains.timed_control_variance[0]),
    ):
        lower, upper = (line.get_ydata() for line in curves(axes, color, style))
        is_finite = np.isfinite(upper)
        assert is_finite.all() or color == BLUE
        np.testing.assert_allclose(((upper + lower) / 2)[is_finite], mean[is_finite], atol=1e-12)
        spread = 6 * np.sqrt(np.maximum(variance[: len(time)], 0))
        np.testing.assert_allclose((upper - lower)[is_finite], spread[is_finite], atol=1e-12)
        inside = np.nanmax(upper) < 1.002 and np.nanmin(lower) > -1.002
        assert inside == (axes is stochastic)


def test_fig13_ellipses_hold_the_stated_probability(draw, entry):
    (axes,) = draw("fig13").axes
    gains = entry.gains()
    cases = {
        (BLUE, "-"): gains.apollo_covariance[0],
        (SKY, "-"): gains.apollo_covariance[1],
        (VERMILION, "-"): gains.stochastic_covariance[0],
        (ORANGE, "-"): gains.stochastic_covariance[1],
        (BLUE, ":"): gains.timed_covariance[0],
        (SKY, ":"): gains.timed_covariance[1],
    }
    for (color, style), covariance in cases.items():
        (line,) = curves(axes, color, style)
        block = covariance[-1][np.ix_([1, 3], [1, 3])]
        points = line.get_xydata() * [1.0, 1e3]
        distance = np.einsum("ki,ij,kj->k", points, np.linalg.inv(block), points)
        np.testing.assert_allclose(np.exp(-distance / 2), 0.0027, rtol=1e-5)


# --- flights ----------------------------------------------------------------------------------------------------------

ROWS = (("altitude", 0, 1e3), ("velocity", 1, 1.0), ("flight_path_angle", 2, np.pi / 180), ("downrange", 3, 1e3))
LAWS = (("apollo", BLUE), ("stochastic", VERMILION))


@pytest.mark.parametrize(("stem", "number"), [("fig09", 0), ("fig11", 1)])
def test_errors_over_time_of_trials_ensemble_and_linear_model(draw, entry, stem, number):
    panels = np.array(draw(stem).axes).reshape(5, 2)
    nominal, gains = entry.nominal(), entry.gains()
    trigger = ("time", "velocity")[number]
    for column, (law, color) in zip(panels.T, LAWS, strict=True):
        ensemble = entry.ensemble("corrected", f"{law}_{trigger}")
        for axes, (name, component, unit) in zip(column, (*ROWS, ("crossrange", 5, 1e3)), strict=True):
            lines = curves(axes, color, least=100)
            trials, bounds = lines[:DRAWN], lines[DRAWN:]
            assert len(bounds) == 2
            reference = at_whole_second(nominal, name, 100)
            for line, trial in zip(trials, ensemble.kept_history, strict=True):
                assert line.get_ydata()[100] == pytest.approx((trial[100, component] - reference) / unit, abs=1e-9)
            spread = 3 * np.sqrt(ensemble.covariance[100, component, component])
            expected = (ensemble.mean[100, component] - reference + np.array([-spread, spread])) / unit
            np.testing.assert_allclose([line.get_ydata()[100] for line in bounds], expected, atol=1e-9)
            predicted = curves(axes, BLACK, "--", least=100)
            if name == "crossrange":
                assert not predicted
                continue
            variance = getattr(gains, f"{law}_covariance")[number, :, component, component]
            np.testing.assert_allclose(predicted[1].get_ydata(), 3 * np.sqrt(variance) / unit)
            np.testing.assert_array_equal(predicted[0].get_ydata(), -predicted[1].get_ydata())
            assert axes.get_xlim() == (0, nominal.end_time)
    # Table 2, in the units of the axes; and Eq. 74 at the end.
    entries = [curves(axes, BLACK, "--", least=100)[1].get_ydata()[0] for axes in panels[:4, 1]]
    np.testing.assert_allclose(entries, [0.0, 20.0, 0.5, 5.0], atol=1e-9)
    assert curves(panels[0, 1], BLACK, "--", least=100)[1].get_ydata()[-1] == pytest.approx(2.0, abs=0.01)


def test_fig12_markers_are_the_final_errors(draw, entry):
    panels = np.array(draw("fig12").axes).reshape(4, 2)
    projection = entry.linearization().trigger_projection
    for column, (law, color) in zip(panels.T, LAWS, strict=True):
        ensemble = entry.ensemble("corrected", f"{law}_velocity")
        final = errors(ensemble, DRAWN)
        predicted = projection @ getattr(entry.gains(), f"{law}_covariance")[1, -1] @ projection.T
        for axes, (_, component, unit) in zip(column, ROWS, strict=True):
            (marks,) = [line for line in curves(axes, color) if line.get_marker() == "o"]
            np.testing.assert_allclose(marks.get_xdata(), ensemble.final_state[:DRAWN, records.END_TIME])
            np.testing.assert_allclose(marks.get_ydata(), final[:, component] / unit, atol=1e-9)
            paths = [line for line in curves(axes, color) if line.get_marker() != "o"]
            ends = np.array([line.get_xydata()[np.isfinite(line.get_ydata())][-1] for line in paths])
            np.testing.assert_allclose(ends, marks.get_xydata())
            assert (marks.get_xdata() <= axes.get_xlim()[1]).all()
            if component == records.VELOCITY:
                np.testing.assert_allclose(marks.get_ydata(), 0.0, atol=1e-6)
                continue
            bounds_shown = {round(line.get_ydata()[0], 9) for line in curves(axes, BLACK, "--", least=2)}
            bound = 3 * np.sqrt(predicted[component, component]) / unit
            assert bounds_shown == {round(-bound, 9), round(bound, 9)}


# --- beyond the paper -------------------------------------------------------------------------------------------------


def test_floor_is_below_the_linear_prediction_and_that_below_the_flights(draw, entry):
    (axes,) = draw("floor").axes
    heights = np.array([bar.get_height() for group in axes.containers for bar in getattr(group, "patches", ())])
    heights = heights[heights > 0].reshape(4, 3)
    for case, (least, predicted, measured) in zip(FLOWN, heights, strict=True):
        assert least <= predicted * (1 + 1e-6) <= measured
        samples = errors(entry.ensemble("corrected", case))[:, records.DOWNRANGE]
        assert measured == pytest.approx(samples.std(ddof=1))
    assert heights[0, 0] == heights[2, 0] == pytest.approx(85.4, abs=0.1)
    assert heights[1, 0] == heights[3, 0] == pytest.approx(466.9, abs=0.1)
    # At the trigger, velocity errors count as range errors.
    gains, weight = entry.gains(), entry.linearization().trigger_projection[3]
    assert heights[1, 1] == pytest.approx(np.sqrt(weight @ gains.apollo_covariance[1, -1] @ weight))


def test_reversal_histograms_have_the_areas_of_their_shares(draw, entry):
    for axes, case in zip(draw("reversals").axes, FLOWN, strict=True):
        number = entry.ensemble("corrected", case).final_state[:, records.REVERSALS]
        steps = [patch.get_data() for patch in axes.patches]
        areas = [float((values * np.diff(edges)).sum()) for values, edges, _ in steps]
        assert areas[-1] == pytest.approx(0.998, abs=0.001)  # all but a thousandth on either side
        assert sum(areas[:-1:2]) == pytest.approx(areas[-1], abs=0.01)
        shares = [np.mean(number == count) for count in np.unique(number)]
        assert all(np.abs(np.subtract(shares, area)).min() < 0.003 for area in areas[:-1:2])
