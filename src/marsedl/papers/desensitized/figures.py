"""Figures of the paper, and those beyond it. Each function draws one file from artifacts."""

import dataclasses

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from marsedl.papers.desensitized.claims.measures import own_c1, printed_rows
from marsedl.papers.desensitized.entry_problem import BANK
from marsedl.papers.desensitized.inputs import Design, Ensemble, Simulation, Vehicle
from marsedl.papers.desensitized.nominal import zero_crossings
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    NO_DOC,
    RESHAPED,
    FlightEnsemble,
    Gains,
    MinimumFuel,
    Nominal,
    Responses,
    Tradeoff,
)
from marsedl.plotting.curves import PRINTED_CROSS, legend_below, legend_entry, mark, name_axes, plot, printed_mark, zero
from marsedl.plotting.ellipses import probability_inside
from marsedl.plotting.fields import field, printed_unit
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from marsedl.replication.units import converted

RADIUS, CROSSRANGE, DOWNRANGE = CHANNELS
BANK_ANGLE = {"unit": "deg", "name": "bank angle"}
FINAL_ERROR = "final position error"
# How the flights of a channel are drawn: without feedback, reshaped, and under the law of the channel.
CURVE = ((BLACK, "--"), (BLUE, "-."), (VERMILION, "-"))
LAW_NAME = {NO_DOC: "no DOC", RESHAPED: "DOC without feedback"}
LAW_TITLE = LAW_NAME | {name: f"gains against {name} errors" for name in CHANNELS} | {ALL_COLUMNS: "one set of gains"}
ROW_COLOR = (BLACK, SKY, BLUE, GREEN, ORANGE, VERMILION, PURPLE)
BRANCH_COLOR = (BLACK, BLUE, PURPLE, ORANGE)
FUEL_CURVE = (
    (BLACK, "--", "least energy (nominal)"),
    (VERMILION, "-", "least fuel"),
    (BLUE, "-.", "least energy on the branch of least fuel"),
)
FUEL = 1  # the solution of least fuel
CROWDED = 0.04  # of the axes, under which rows of Table 3 share a label
ROW_UNIT = {"c_1": "", "J_0": f" {printed_unit('deg^2/s^3')}"}  # of what names a row of Table 3
ELLIPSE_SIGMA = 3
LEVEL, ROOM = 0.995, 1.15  # of the flights' errors, either way; times those, how far the axes of the dispersion reach
DRAWN = 2000  # flights of a law at most, in the dispersion
EARLY = 1.0  # s, by which the flights of a law end before those of another, from which the figure says so
PRINTED_AT = 1000.0  # m of error at entry, of which Table 3 and the text print what is left at the end
FAR = 1.6  # times what flights without feedback reach, beyond which others may leave the axes


# ---- the nominal, and reshaping it -----------------------------------------------------------------------------------


def fig01a(vehicle: Vehicle, nominal: Nominal) -> Figure:
    """Bank rate and bank acceleration of the nominal."""
    figure, (rate, acceleration) = new_figure(6.4, 4.4, nrows=2, sharex=True)
    plot(rate, nominal, "state.bank_rate", unit="deg/s", color=BLUE)
    control, time = field(nominal, "bank_acceleration", unit="deg/s^2"), field(nominal, "time")
    _steps(acceleration, control, time, color=BLUE)
    _limits(rate, vehicle.bank_rate_bound, nominal.largest_bank_rate, "rad/s", "deg/s")
    _limits(acceleration, vehicle.bank_acceleration_bound, nominal.largest_bank_acceleration, "rad/s^2", "deg/s^2")
    acceleration.set_xlim(nominal.time[[0, -1]])
    return figure


def fig01b(nominal: Nominal) -> Figure:
    """Bank angle of the nominal, and when it passes zero."""
    figure, axes = new_figure(6.4, 3.4)
    zero(axes)
    plot(axes, nominal, "state.bank", **BANK_ANGLE, color=BLUE)
    rate = field(nominal, "state.bank_rate")
    for time in nominal.reversal_times:
        rising = np.interp(time, nominal.time, rate.values) > 0.0
        axes.plot(time, 0.0, "o", color=VERMILION, markersize=4)
        axes.annotate(f"{time:.0f} s", (time, 0.0), (6, -12 if rising else 5), textcoords="offset points")
    axes.set(xlim=nominal.time[[0, -1]], title=nominal.branch)
    return figure


def fig02(design: Design, published, tradeoff: Tradeoff) -> Figure:
    """Bank angle of the rows of Table 3, those of an infinite weight apart."""
    figure, panels = new_figure(7.2, 5.2, nrows=2, sharex=True, height_ratios=(1.5, 1))
    zero(*panels)
    names = _row_names(design, published, tradeoff)
    last = len(names) - 1
    for number, finite in enumerate(np.isfinite(tradeoff.printed_weight)):
        axes, style, color = panels[0], {}, ROW_COLOR[number % len(ROW_COLOR)]
        if not finite:
            # The infinite rows come close to each other: the last is drawn thin, over the others.
            axes, style = panels[1], {"linestyle": "--"} if number == last else {"linewidth": 3.0, "alpha": 0.6}
        label = f"{_row(tradeoff, names, number)}: {_counted(tradeoff.reversals[number], 'reversal')}"
        bank = field(tradeoff, "state.bank", **BANK_ANGLE, at={"rows": number}, x="time")
        plot(axes, bank, color=color, label=label, **style)
    panels[0].set_xlim(0, tradeoff.time.max())
    for axes in panels:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


# ---- errors at entry: sweeps, histories, and how the bank answers ----------------------------------------------------


def fig03a(gains: Gains, responses: Responses, published=None) -> Figure:
    """Final position error against the radius error at entry; published: to mark those of Table 3."""
    printed = [published[name].printed[-1] for name in ("tab03_c0", "tab03_c1")] if published else ()
    return _sweep(gains, responses, RADIUS, (NO_DOC, RESHAPED), "wide", printed)


def fig03b(gains: Gains, responses: Responses) -> Figure:
    """The same for small errors."""
    return _sweep(gains, responses, RADIUS, (NO_DOC, RESHAPED), "narrow")


def fig04(gains: Gains, responses: Responses, published=None) -> Figure:
    """Position errors over time after a radius error at entry."""
    printed = {DOWNRANGE: published["fig04_nodoc_downrange_200m"].printed} if published else {}
    return _histories(gains, responses, RADIUS, (NO_DOC, RESHAPED), printed)


def fig05a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the radius error."""
    return _bank_rates(gains, responses, RADIUS)


def fig05b(gains: Gains, responses: Responses, published=None) -> Figure:
    """Bank angle with feedback, with and without the radius error."""
    return _bank_angles(gains, responses, RADIUS, published["fig05b_phase_times"].printed if published else ())


def fig06a(gains: Gains, responses: Responses, published=None) -> Figure:
    """Final position error against the downrange error at entry."""
    printed = [PRINTED_AT * published["dr_sensitivity_nodoc"].printed] if published else ()
    return _sweep(gains, responses, DOWNRANGE, (NO_DOC,), "wide", printed)


def fig06b(gains: Gains, responses: Responses, published=None) -> Figure:
    """The same for small errors."""
    printed = [PRINTED_AT * published["dr_sensitivity_nodoc"].printed] if published else ()
    return _sweep(gains, responses, DOWNRANGE, (NO_DOC,), "narrow", printed)


def fig07a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the downrange error."""
    return _bank_rates(gains, responses, DOWNRANGE)


def fig07b(gains: Gains, responses: Responses, published=None) -> Figure:
    """Bank angle with feedback, with and without the downrange error."""
    return _bank_angles(gains, responses, DOWNRANGE, published["fig07b_phase_times"].printed if published else ())


def fig08(gains: Gains, responses: Responses, published=None) -> Figure:
    """Position errors over time after a downrange error at entry."""
    values = published["fig08_nofeedback_final_errors"].printed if published else ()
    return _histories(gains, responses, DOWNRANGE, (NO_DOC,), dict(zip(CHANNELS, values, strict=False)))


def fig09(gains: Gains, responses: Responses, published=None) -> Figure:
    """Final position error against the crossrange error at entry."""
    without = published and PRINTED_AT * published["cr_sensitivity_nodoc"].printed
    printed = (without, without / published["fig09_reduction_factor_1000m"].printed) if published else ()
    return _sweep(gains, responses, CROSSRANGE, (NO_DOC,), "wide", printed)


def fig10a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the crossrange error."""
    return _bank_rates(gains, responses, CROSSRANGE)


def fig10b(gains: Gains, responses: Responses) -> Figure:
    """Bank angle with feedback, with and without the crossrange error."""
    return _bank_angles(gains, responses, CROSSRANGE)


def fig11(gains: Gains, responses: Responses, published=None) -> Figure:
    """Position errors over time after a crossrange error at entry."""
    printed = {CROSSRANGE: published["fig11_nofeedback_crossrange_1000m"].printed} if published else {}
    return _histories(gains, responses, CROSSRANGE, (NO_DOC,), printed)


def _sweep(gains, responses, channel, compared, sweep, printed=()):
    """Norm of the final error against the error at entry of a channel, of laws and of the channel's own.

    Small errors are also drawn on a logarithmic axis, on which what remains with feedback is seen.
    printed: final errors that the paper prints for the error at entry of `PRINTED_AT`.
    """
    panels = 2 if sweep == "narrow" else 1
    figure, panels = new_figure((6.4, 8.4)[panels - 1], 3.8, ncols=panels, squeeze=False)
    axes, initial = panels[0, 0], field(responses, f"{sweep}.{channel}", name=f"{channel} error at entry")
    norms = {
        name: _norm(responses, f"{sweep}_error.{channel}", at={"law": _number(gains, name)}, x=initial)
        for name in (*compared, channel)
    }
    for name, (color, style) in _law_styles(channel, compared):
        label, marker = _label(gains, name), None
        if lost := int(np.isnan(norms[name].values).sum()):
            # Of flights among lost ones no line is left.
            label, marker = f"{label},\n{lost} of {len(initial.values)} flights lost", "."
        line = {"color": color, "linestyle": style, "marker": marker}
        plot(axes, norms[name], **line, label=label)
        for logarithmic in panels[0, 1:]:
            plot(logarithmic, _either_side(norms[name].where(initial.values != 0.0)), **line)
            logarithmic.set_yscale("log")
    largest = np.nanmax(np.array([norms[name].values for name in compared]), initial=0.0)
    if largest > 0.0:
        reached = np.nanmax(norms[channel].values, initial=largest)
        axes.set_ylim(-0.03 * largest, min(1.05 * reached, FAR * largest))
    for axes in panels.flat:
        axes.set_xlim(initial.values[[0, -1]])
    if len(printed):  # in proportion, where that error is off the axes
        place = min(PRINTED_AT, initial.values.max())
        printed_mark(panels[0, 0], x=place, y=np.array(printed) * place / PRINTED_AT)
    legend_below(figure, panels[0, :1])
    return figure


def _histories(gains, responses, channel, compared, printed):
    """Position errors over time of laws and of the channel's own, for the error at entry that the figures have.

    printed: final errors without feedback by component, as far as the paper prints them.
    """
    figure, panels = new_figure(6.4, 6.2, nrows=3, sharex=True)
    curves = {
        (component, name): field(
            responses, f"error.{channel}.{component}", name=f"{component} error", x="time",
            at={"law": _number(gains, name)},
        )
        for component in CHANNELS
        for name in (*compared, channel)
    }  # fmt: skip
    largest = np.nanmax(np.abs([curves[component, NO_DOC].values for component in CHANNELS]), initial=0.0)
    latest = max(curve.x.values[-1] for curve in curves.values())
    for component, axes in zip(CHANNELS, panels, strict=True):
        zero(axes, color=GREY)
        _mark_reversals(axes, responses, _number(gains, channel))
        for name, (color, style) in _law_styles(channel, compared):
            curve, label = curves[component, name], _label(gains, name)
            end = curve.x.values[-1]
            if latest - end > EARLY:
                label += f", ends at {end:.0f} s"
                plot(axes, curve.where(slice(-1, None)), color=color, marker="o", markersize=4)
            plot(axes, curve, color=color, linestyle=style, label=label)
        if component in printed:
            end = curves[component, NO_DOC].x.values[-1]
            printed_mark(axes, x=end, y=printed[component], label=None)
        _hold(axes, 3.0 * largest)
    if printed:
        legend_entry(panels[0], "printed, without feedback", **PRINTED_CROSS)
    panels[0].set_title(_perturbation(responses, channel))
    panels[-1].set_xlim(0, responses.time.max())
    legend_below(figure, panels[:1])
    return figure


def _bank_rates(gains, responses, channel):
    """Bank rate and acceleration under the law of a channel, without and with the error at entry, and differences."""
    figure, panels = new_figure(8.4, 4.6, nrows=2, ncols=2, sharex=True, width_ratios=(1.3, 1))
    number, label = _number(gains, channel), _perturbed(gains, responses, channel)
    for (axes, difference), paths, unit, steps in (
        (panels[0], ("nominal.bank_rate", f"state.{channel}.bank_rate"), "deg/s", {}),
        # The nominal's control is constant on each interval; both are stored where an interval begins.
        (panels[1], ("nominal_acceleration", f"acceleration.{channel}"), "deg/s^2", {"drawstyle": "steps-post"}),
    ):
        nominal, perturbed = (field(responses, path, unit=unit, at={"law": number}, x="time") for path in paths)
        zero(axes, difference, color=GREY)
        plot(axes, nominal, **steps, color=BLACK, linestyle="--", label="nominal")
        plot(axes, perturbed, **steps, color=VERMILION, label=label)
        plot(difference, perturbed.minus(nominal, "difference"), color=VERMILION)
    panels[0, 0].set_title(_perturbation(responses, channel))
    panels[0, 1].set_title("perturbed minus nominal")
    panels[0, 0].set_xlim(responses.time[number, [0, -1]])
    legend_below(figure, panels[0, :1])
    return figure


def _bank_angles(gains, responses, channel, phases=()):
    """Bank angle under the law of a channel, without and with the error at entry, and the difference.

    phases: times at which the paper divides the response.
    """
    figure, (angle, difference) = new_figure(6.4, 4.8, nrows=2, sharex=True, height_ratios=(1.6, 1))
    number = _number(gains, channel)
    nominal, perturbed = (
        field(responses, path, **BANK_ANGLE, at={"law": number}, x="time")
        for path in ("nominal.bank", f"state.{channel}.bank")
    )
    plot(angle, nominal, color=BLACK, linestyle="--", label="nominal")
    plot(angle, perturbed, color=VERMILION, label=_perturbed(gains, responses, channel))
    plot(difference, perturbed.minus(nominal, "difference"), color=VERMILION)
    for axes in (angle, difference):
        zero(axes, color=GREY)
        _mark_reversals(axes, responses, number)
        if len(phases):
            printed_mark(axes, x=phases, label="phases, printed" if axes is angle else None)
    angle.set_title(_perturbation(responses, channel))
    difference.set_xlim(responses.time[number, [0, -1]])
    legend_below(figure, [angle])
    return figure


# ---- beyond the paper ------------------------------------------------------------------------------------------------


def pareto(design: Design, simulation: Simulation, published, tradeoff: Tradeoff) -> Figure:
    """Control energy against final position error."""
    figure, axes = new_figure(5.6, 5.8)
    label = f"{FINAL_ERROR} for {simulation.tabulated_error:g} m of radius"
    _energies(axes, tradeoff, published, label)
    axes.set_yscale("log")
    rows, names = np.linalg.norm(tradeoff.error, axis=1), _row_names(design, published, tradeoff)
    enlarged = np.zeros(len(rows), bool)
    if len(tradeoff.fold_error):
        (lowest_error, largest_error), (low, high) = _about_folds(tradeoff)
        enlarged = (rows > lowest_error) & (rows < largest_error) & (tradeoff.effort > low) & (tradeoff.effort < high)
        inset = axes.inset_axes((0.42, 0.5, 0.57, 0.48))
        _energies(inset, tradeoff, published, label)
        inset.set(yscale="log", xlim=(lowest_error, largest_error), ylim=(low, high), xlabel="", ylabel="")
        inset.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        inset.yaxis.set_major_formatter("{x:g}")
        inset.yaxis.set_minor_formatter(NullFormatter())
        inset.locator_params(axis="x", nbins=4)
        inset.tick_params(labelsize=8)
        axes.indicate_inset_zoom(inset, edgecolor=GREY)
        for number in np.flatnonzero(enlarged):
            spot = rows[number], tradeoff.effort[number]
            inset.annotate(_joined([names[number]]), spot, (0, 7), textcoords="offset points", fontsize=8, ha="center")
    for place, group in enumerate(_crowds(tradeoff, rows, names)):
        if enlarged[group].all():
            continue
        # Beside the curve, and inwards at its right end.
        at_end = rows[group[0]] > rows.max() - 0.03 * np.ptp(rows)
        below, end, beside = ((-6, -11), "right"), ((10, 6), "right"), ((6, 4), "left")
        along_curve = beside if place % 2 == 0 or group[-1] == len(rows) - 1 else below
        offset, side = end if at_end else along_curve
        text, spot = _joined([names[number] for number in group]), (rows[group[0]], tradeoff.effort[group[0]])
        axes.annotate(text, spot, offset, textcoords="offset points", fontsize=8, ha=side)
    legend_below(figure, [axes], columns=2)
    return figure


def _energies(axes, tradeoff, published, label):
    """Draw control energy against final position error, which is called `label`."""
    path = field(tradeoff, "path_effort", x=_norm(tradeoff, "path_error", name=label))
    for number, name in enumerate(tradeoff.branch):
        color = BRANCH_COLOR[number % len(BRANCH_COLOR)]
        plot(axes, path.where(tradeoff.path_branch == number), color=color, label=f"over the weight, from {name}")
    for number in range(len(tradeoff.fold_weight)):
        jump = field(tradeoff, "fold_effort", x="fold_error", at={"folds": number})
        text = None if number else "jump at the end of a branch"
        plot(axes, jump, color=GREY, linestyle=":", label=text)
    rows = field(tradeoff, "effort", x=_norm(tradeoff, "error"))
    circles = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markersize": 6}
    plot(axes, rows, **circles, color=BLACK, label="rows of Table 3")
    efforts, _, _, errors = np.transpose(list(printed_rows(published).values()))
    printed_mark(axes, x=errors, y=efforts, label="the same, printed", clip_on=True)


def _about_folds(tradeoff):
    """Limits of error and control energy about the jumps at folds and the nominal's branch."""
    first = tradeoff.path_branch == 0
    errors = np.append(tradeoff.fold_error, np.linalg.norm(tradeoff.path_error[first], axis=1))
    efforts = np.append(tradeoff.fold_effort, tradeoff.path_effort[first])
    margin, factor = 0.25 * np.ptp(errors), (efforts.max() / efforts.min()) ** 0.25
    return (errors.min() - margin, errors.max() + margin), (efforts.min() / factor, efforts.max() * factor)


def dispersion(ensemble: Ensemble, gains: Gains, entry_errors: FlightEnsemble) -> Figure:
    """Final crossrange and downrange errors for random position errors at entry, under every law.

    Each law has axes of its own size; a square as large as those of the first one tells their scale.
    """
    figure, panels = new_figure(7.6, 6.6, nrows=2, ncols=3)
    trials = entry_errors.final_error.shape[1]
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = ELLIPSE_SIGMA * np.array([np.cos(angle), np.sin(angle)])
    plane = [CHANNELS.index(component) for component in (DOWNRANGE, CROSSRANGE)]
    first, scale = panels[0, 0], None
    for number, axes in enumerate(panels.flat):
        right, up = (
            field(entry_errors, f"final_error.{name}", unit="km", name=f"{name} error", at={"law": number})
            for name in (DOWNRANGE, CROSSRANGE)
        )
        up = dataclasses.replace(up, x=right)
        flights = {"linestyle": "none", "marker": ".", "markersize": 1.5, "alpha": 0.6, "rasterized": True}
        plot(axes, up.where(slice(DRAWN)), **flights, color=SKY)
        # The root of the covariance by singular values, as it may be singular.
        factor = converted(gains.final[number][plane] * ensemble.initial_deviations, "m", "km")
        directions, lengths, _ = np.linalg.svd(factor, full_matrices=False)
        ellipse = directions * lengths @ circle
        plot(axes, dataclasses.replace(up.of(ellipse[1]), x=right.of(ellipse[0])), color=VERMILION)
        errors = np.transpose([right.values, up.values])
        ended = errors[np.isfinite(errors).all(axis=1)]
        remarks = [] if gains.converged[number] else ["not converged"]
        if lost := trials - len(ended):
            remarks.append(f"{lost:,} lost")
        notes = [LAW_TITLE[str(gains.law[number])], *([", ".join(remarks)] if remarks else [])]
        limit = 1e-3
        if len(ended):
            limit = max(limit, np.quantile(np.abs(ended), LEVEL, axis=0).max())
            deviations = zip(("down", "cross"), ended.std(axis=0), np.linalg.norm(factor, axis=1), strict=True)
            notes += [rf"$\sigma$ {name} {_length(a)}, linear {_length(b)}" for name, a, b in deviations]
        limit *= ROOM
        scale = scale or limit
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit))
        if axes is not first:
            axes.plot(*(scale * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])), color=GREY, linestyle=":")
        axes.set_title("\n".join(notes), fontsize=8)
    for axes in panels[:, 1:].flat:
        axes.set_ylabel("")
    for axes in panels[0]:
        axes.set_xlabel("")
    level = 100 * probability_inside(ELLIPSE_SIGMA)
    ellipse = f"{ELLIPSE_SIGMA}-sigma ellipse of linear covariance ({level:.1f} %)"
    legend_entry(first, f"{min(DRAWN, trials):,} of {trials:,} flights", color=SKY, marker=".", linestyle="none")
    legend_entry(first, ellipse, color=VERMILION)
    legend_entry(first, f"axes of {LAW_TITLE[str(gains.law[0])]}", color=GREY, linestyle=":")
    legend_below(figure, [first])
    return figure


def minimum_fuel(minimum_fuel: MinimumFuel) -> Figure:
    """Bank acceleration and bank angle of least energy and of least fuel, and the switching function, by bound."""
    columns = len(minimum_fuel.bound)
    figure, panels = new_figure(8.0, 6.6, nrows=3, ncols=columns, sharex=True, sharey="row", squeeze=False)
    for number, (acceleration, angle, switching) in enumerate(panels.T):
        for place, (color, style, name) in enumerate(FUEL_CURVE):
            solution = {"at": {"bound": number, "solution": place}}
            control = field(minimum_fuel, "bank_acceleration", unit="deg/s^2", **solution)
            mass = _mass(minimum_fuel.propellant[number, place])
            _steps(acceleration, control, field(minimum_fuel, "time", **solution), color=color, linestyle=style)
            legend_entry(acceleration, mass, color=color, linestyle=style)
            curve = {"color": color, "linestyle": style, "label": name}
            plot(angle, minimum_fuel, "bank", unit="deg", x="time", **solution, **curve)
        nodes = field(minimum_fuel, "time", at={"bound": number, "solution": FUEL})
        middle = nodes.of((nodes.values[1:] + nodes.values[:-1]) / 2.0)
        function = {"name": "switching function\nof least fuel", "at": {"bound": number}, "x": middle}
        plot(switching, minimum_fuel, "switching", **function, color=FUEL_CURVE[FUEL][0])
        mark(switching, y=(-1.0, 1.0))
        bound = converted(minimum_fuel.bound[number], "rad/s^2", "deg/s^2")
        acceleration.set_title(f"bound {bound:g} deg/s$^2$")
        acceleration.legend(title="propellant", title_fontsize=8, loc="upper right")
    panels[0, 0].set_xlim(0.0, np.nanmax(minimum_fuel.time, initial=1.0))
    # Linear as far as the nominals reach, so that both they and bursts are seen.
    nominals = field(minimum_fuel, "bank_acceleration", unit="deg/s^2", at={"solution": 0})
    panels[0, 0].set_yscale("symlog", linthresh=np.nanmax(np.abs(nominals.values), initial=1e-6))
    legend_below(figure, panels[1, :1])
    return figure


# ---- parts of figures ------------------------------------------------------------------------------------------------


def _norm(record, path, subtracted="", *, name=FINAL_ERROR, **how):
    """Norm of an error (places, position), or of its difference from another; `how` as `field` takes it."""
    error = field(record, path, **how)
    values = error.values - field(record, subtracted, **how).values if subtracted else error.values
    return error.of(np.linalg.norm(values, axis=-1), name)


def _steps(axes, control, time, **style):
    """Draw a control (intervals,), constant on each interval, over its nodes; nothing where it was not solved."""
    name_axes(axes, dataclasses.replace(control, x=time))
    # An edge that is not finite makes matplotlib refuse the whole.
    if np.isfinite(time.values).all():
        axes.stairs(control.values, time.values, baseline=None, **{"linewidth": 1.2} | style)


def _either_side(curve):
    """A curve whose two sides of zero are not joined, as for a logarithmic axis."""
    return dataclasses.replace(curve, pieces=np.sign(curve.x.values))


def _law_styles(channel, compared):
    """Laws of a figure and how they are drawn: those without feedback, and that of the channel."""
    styles = dict(zip((NO_DOC, RESHAPED), CURVE, strict=False))
    return [(name, styles[name]) for name in compared] + [(channel, CURVE[-1])]


def _number(artifact, name):
    """Number of a law by its name."""
    return list(artifact.law).index(name)


def _label(gains, name):
    return LAW_NAME.get(name, "DOC with feedback") + _unfinished(gains, name)


def _perturbed(gains, responses, channel):
    """What the perturbed flight under a channel's law is called, and whether it comes to its end."""
    final = responses.state[_number(gains, channel), CHANNELS.index(channel), -1]
    return "perturbed" + _unfinished(gains, channel) + (", lost" if np.isnan(final).any() else "")


def _unfinished(gains, name):
    """Remark beside a law whose gains did not converge."""
    return "" if gains.converged[_number(gains, name)] else " (gains not converged)"


def _perturbation(responses, channel):
    return f"{channel} error of {responses.drawn_error[CHANNELS.index(channel)]:+g} m at entry"


def _mark_reversals(axes, responses, number):
    """Dotted lines where the bank angle of the nominal passes zero."""
    mark(axes, x=zero_crossings(responses.time[number], responses.nominal[number, :, BANK]), linewidth=0.9)


def _hold(axes, most):
    """Let curves leave the axes rather than stretch them beyond a value, either way."""
    lower, upper = axes.get_ylim()
    if most > 0.0:
        axes.set_ylim(max(lower, -most), min(upper, most))


def _limits(axes, bound, largest, unit, shown_unit):
    """Lines at a bound either way if a curve comes near it, and else words."""
    bound, largest = (converted(value, unit, shown_unit) for value in (bound, largest))
    if largest > 0.5 * bound:
        mark(axes, y=(-bound, bound), linestyle="--", linewidth=1.2)
    unit = printed_unit(shown_unit)
    axes.set_title(f"largest {largest:.3g} {unit}, bound {bound:g} {unit}", loc="right")


def _row_names(design: Design, published, tradeoff):
    """Symbol and value by which each row of Table 3 is called: its c1, or its J0 where that is the reading's own."""
    printed = printed_rows(published)
    own = [own_c1(design, printed, printed_weight) for printed_weight in tradeoff.printed_weight]
    names = []
    for c1, effort in zip(own, tradeoff.effort, strict=True):
        if c1 is None:
            names.append(("J_0", f"{effort:.4g}"))
        else:
            names.append(("c_1", r"$\infty$" if np.isinf(c1) else f"{c1:g}"))
    return names


def _joined(names):
    """Names of rows as a label, in which each symbol stands once, and each value."""
    values = {symbol: dict.fromkeys(value for other, value in names if other == symbol) for symbol, _ in names}
    return ", ".join(f"${symbol}$ = {', '.join(of_rows)}{ROW_UNIT[symbol]}" for symbol, of_rows in values.items())


def _row(tradeoff, names, number):
    """What a row of Table 3 is called: its name, and the weight that stands for an infinite one."""
    name = _joined([names[number]])
    infinite = np.isnan(tradeoff.printed_weight[number])
    return f"{name} ($c$ = {_power(tradeoff.weight[number])})" if infinite else name


def _crowds(tradeoff, errors, names):
    """Numbers of neighbouring rows that lie too close to each other for labels of their own, in groups."""
    groups, heights = [[0]], np.log(tradeoff.effort)
    for number in range(1, len(errors)):
        first = groups[-1][0]
        apart = max(abs(values[number] - values[first]) / np.ptp(values) for values in (errors, heights))
        if apart < CROWDED or names[number] == names[first]:
            groups[-1].append(number)
        else:
            groups.append([number])
    return groups


def _power(value):
    """A positive number as a power of ten, with a factor unless that is one."""
    factor, exponent = f"{value:.2e}".split("e")
    factor = "" if float(factor) == 1.0 else rf"{float(factor):g} \cdot "
    return f"${factor}10^{{{int(exponent)}}}$"


def _counted(number, what):
    return f"{number} {what}{'' if number == 1 else 's'}"


def _mass(mass):
    return f"{mass:.3g} kg" if np.isfinite(mass) else "not solved"


def _length(kilometres):
    """A length with its unit, metres where it is short."""
    return f"{kilometres:.3g} km" if kilometres >= 1.0 else f"{1e3 * kilometres:.3g} m"
