"""Figures of the paper, and those beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from marsedl.papers.desensitized.claims import printed_rows
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE
from marsedl.papers.desensitized.inputs import Ensemble, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.nominal import zero_crossings
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    DENSITY,
    NO_DOC,
    RESHAPED,
    Branches,
    Certificates,
    FlightEnsemble,
    FurtherPerturbations,
    Gains,
    GainStudy,
    MinimumFuel,
    Nominal,
    Responses,
    Tradeoff,
)
from marsedl.plotting.ellipses import probability_inside
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure

KM = 1e3
DEGREE = np.pi / 180
TIME_LABEL = "time from entry (s)"
BANK_LABEL, RATE_LABEL, ACCELERATION_LABEL = "bank angle (deg)", "bank rate (deg/s)", "bank acceleration (deg/s$^2$)"
RADIUS, CROSSRANGE, DOWNRANGE = range(len(CHANNELS))
# How the flights of a channel are drawn: without feedback, reshaped, and under the law of the channel.
CURVE = ((BLACK, "--"), (BLUE, "-."), (VERMILION, "-"))
LAW_NAME = {NO_DOC: "no DOC", RESHAPED: "DOC without feedback"}
LAW_TITLE = LAW_NAME | {name: f"gains against {name} errors" for name in CHANNELS} | {ALL_COLUMNS: "one set of gains"}
ROW_COLOR = (BLACK, SKY, BLUE, GREEN, ORANGE, VERMILION, PURPLE)
BRANCH_COLOR = (BLACK, BLUE, PURPLE, ORANGE)
SOLUTION_COLOR = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
SCHEME_COLOR = (BLUE, ORANGE, GREEN)
SCHEME_NAME = {"hermite_simpson": "Hermite-Simpson"}
CANDIDATE_COLOR = (VERMILION, BLUE, GREEN, ORANGE, PURPLE, SKY, GREY)
PERTURBATION_COLOR = (BLUE, GREEN, PURPLE, VERMILION, ORANGE, GREY)
FEEDBACK_COLOR = (BLACK, BLUE, SKY, VERMILION, ORANGE)
FUEL_CURVE = (
    (BLACK, "--", "least energy (nominal)"),
    (VERMILION, "-", "least fuel"),
    (BLUE, "-.", "least energy on the branch of least fuel"),
)
FUEL = 1  # the solution of least fuel
CROWDED = 0.04  # of the axes, under which rows of Table 3 share a label
ELLIPSE_SIGMA = 3
LEVEL = 0.995  # of the flights' errors, either way, that the axes of the dispersion reach
DRAWN = 2000  # flights of a law at most, in the dispersion
FAR = 1.6  # times what flights without feedback reach, beyond which others may leave the axes


# ---- the nominal, and reshaping it -----------------------------------------------------------------------------------


def fig01a(vehicle: Vehicle, nominal: Nominal) -> Figure:
    """Bank rate and bank acceleration of the nominal."""
    figure, (rate, acceleration) = new_figure(6.4, 4.4, nrows=2, sharex=True)
    rate.plot(nominal.time, nominal.state[:, BANK_RATE] / DEGREE, color=BLUE)
    acceleration.stairs(nominal.bank_acceleration / DEGREE, nominal.time, baseline=None, color=BLUE, linewidth=1.2)
    _bounds(rate, vehicle.bank_rate_bound / DEGREE, nominal.largest_bank_rate / DEGREE, "deg/s")
    _bounds(
        acceleration, vehicle.bank_acceleration_bound / DEGREE, nominal.largest_bank_acceleration / DEGREE, "deg/s$^2$"
    )
    rate.set_ylabel(RATE_LABEL)
    acceleration.set(xlabel=TIME_LABEL, ylabel=ACCELERATION_LABEL, xlim=nominal.time[[0, -1]])
    return figure


def fig01b(nominal: Nominal) -> Figure:
    """Bank angle of the nominal, and when it passes zero."""
    figure, axes = new_figure(6.4, 3.4)
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    axes.plot(nominal.time, nominal.state[:, BANK] / DEGREE, color=BLUE)
    for time in nominal.reversal_times:
        rising = np.interp(time, nominal.time, nominal.state[:, BANK_RATE]) > 0.0
        axes.plot(time, 0.0, "o", color=VERMILION, markersize=4)
        axes.annotate(f"{time:.0f} s", (time, 0.0), (6, -12 if rising else 5), textcoords="offset points")
    axes.set(xlabel=TIME_LABEL, ylabel=BANK_LABEL, xlim=nominal.time[[0, -1]], title=nominal.branch)
    return figure


def fig02(tradeoff: Tradeoff) -> Figure:
    """Bank angle of the rows of Table 3."""
    figure, axes = new_figure(7.2, 4.2)
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    infinite = iter(("--", ":"))
    for number, color in enumerate(ROW_COLOR):
        style = next(infinite) if np.isnan(tradeoff.printed_weight[number]) else "-"
        bank = tradeoff.state[number, :, BANK] / DEGREE
        label = f"{_row(tradeoff, number)}: {_counted(tradeoff.reversals[number], 'reversal')}"
        axes.plot(tradeoff.time[number], bank, color=color, linestyle=style, label=label)
    axes.set(xlabel=TIME_LABEL, ylabel=BANK_LABEL, xlim=(0, tradeoff.time.max()))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


# ---- errors at entry: sweeps, histories, and how the bank answers ----------------------------------------------------


def fig03a(gains: Gains, responses: Responses) -> Figure:
    """Final position error against the radius error at entry."""
    return _sweep(gains, responses, RADIUS, (NO_DOC, RESHAPED), responses.wide, responses.wide_error)


def fig03b(gains: Gains, responses: Responses) -> Figure:
    """The same for small errors."""
    return _sweep(gains, responses, RADIUS, (NO_DOC, RESHAPED), responses.narrow, responses.narrow_error)


def fig04(gains: Gains, responses: Responses) -> Figure:
    """Position errors over time after a radius error at entry."""
    return _histories(gains, responses, RADIUS, (NO_DOC, RESHAPED))


def fig05a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the radius error."""
    return _bank_rates(gains, responses, RADIUS)


def fig05b(gains: Gains, responses: Responses) -> Figure:
    """Bank angle with feedback, with and without the radius error."""
    return _bank_angles(gains, responses, RADIUS)


def fig06a(gains: Gains, responses: Responses) -> Figure:
    """Final position error against the downrange error at entry."""
    return _sweep(gains, responses, DOWNRANGE, (NO_DOC,), responses.wide, responses.wide_error)


def fig06b(gains: Gains, responses: Responses) -> Figure:
    """The same for small errors."""
    return _sweep(gains, responses, DOWNRANGE, (NO_DOC,), responses.narrow, responses.narrow_error)


def fig07a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the downrange error."""
    return _bank_rates(gains, responses, DOWNRANGE)


def fig07b(gains: Gains, responses: Responses) -> Figure:
    """Bank angle with feedback, with and without the downrange error."""
    return _bank_angles(gains, responses, DOWNRANGE)


def fig08(gains: Gains, responses: Responses) -> Figure:
    """Position errors over time after a downrange error at entry."""
    return _histories(gains, responses, DOWNRANGE, (NO_DOC,))


def fig09(gains: Gains, responses: Responses) -> Figure:
    """Final position error against the crossrange error at entry."""
    return _sweep(gains, responses, CROSSRANGE, (NO_DOC,), responses.wide, responses.wide_error)


def fig10a(gains: Gains, responses: Responses) -> Figure:
    """Bank rate and acceleration with feedback, with and without the crossrange error."""
    return _bank_rates(gains, responses, CROSSRANGE)


def fig10b(gains: Gains, responses: Responses) -> Figure:
    """Bank angle with feedback, with and without the crossrange error."""
    return _bank_angles(gains, responses, CROSSRANGE)


def fig11(gains: Gains, responses: Responses) -> Figure:
    """Position errors over time after a crossrange error at entry."""
    return _histories(gains, responses, CROSSRANGE, (NO_DOC,))


def _sweep(gains, responses, channel, compared, initial, final):
    """Norm of the final error against the error at entry of a channel, of laws and of the channel's own."""
    figure, axes = new_figure(6.4, 3.8)
    norms = np.linalg.norm(final[:, channel], axis=-1)
    for name, (color, style) in _drawn(channel, compared):
        number = _number(gains, name)
        label, marker = _label(gains, name), None
        if lost := int(np.isnan(norms[number]).sum()):
            # Of flights among lost ones no line is left.
            label, marker = f"{label},\n{lost} of {len(norms[number])} flights lost", "."
        axes.plot(initial[channel], norms[number], color=color, linestyle=style, marker=marker, label=label)
    plain = np.nanmax(norms[[_number(gains, name) for name in compared]], initial=0.0)
    if plain > 0.0:
        reached = np.nanmax(norms[_number(gains, CHANNELS[channel])], initial=plain)
        axes.set_ylim(-0.03 * plain, min(1.05 * reached, FAR * plain))
    axes.set(xlabel=f"{CHANNELS[channel]} error at entry (m)", ylabel="final position error (m)")
    axes.set_xlim(initial[channel, [0, -1]])
    figure.legend(loc="outside lower center", ncols=len(compared) + 1)
    return figure


def _histories(gains, responses, channel, compared):
    """Position errors over time of laws and of the channel's own, for the error at entry that the figures have."""
    figure, panels = new_figure(6.4, 6.2, nrows=3, sharex=True)
    plain = np.nanmax(np.abs(responses.error[_number(gains, NO_DOC), channel]), initial=0.0)
    own = _number(gains, CHANNELS[channel])
    for component, axes in enumerate(panels):
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        _mark_reversals(axes, responses, own)
        for name, (color, style) in _drawn(channel, compared):
            number = _number(gains, name)
            error = responses.error[number, channel, :, component]
            axes.plot(responses.time[number], error, color=color, linestyle=style, label=_label(gains, name))
        _hold(axes, 3.0 * plain)
        axes.set_ylabel(f"{CHANNELS[component]} error (m)")
    panels[0].set_title(_perturbation(responses, channel))
    panels[-1].set(xlabel=TIME_LABEL, xlim=(0, responses.time.max()))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(compared) + 1)
    return figure


def _bank_rates(gains, responses, channel):
    """Bank rate and acceleration under the law of a channel, without and with the error at entry."""
    figure, panels = new_figure(6.4, 4.6, nrows=2, sharex=True)
    number = _number(gains, CHANNELS[channel])
    time = responses.time[number]
    for axes, nominal, perturbed, label in (
        (
            panels[0],
            responses.nominal[number, :, BANK_RATE],
            responses.state[number, channel, :, BANK_RATE],
            RATE_LABEL,
        ),
        (
            panels[1],
            responses.nominal_acceleration[number],
            responses.acceleration[number, channel],
            ACCELERATION_LABEL,
        ),
    ):
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.plot(time, nominal / DEGREE, color=BLACK, linestyle="--", label="nominal")
        axes.plot(time, perturbed / DEGREE, color=VERMILION, label=_perturbed(gains, responses, channel))
        axes.set_ylabel(label)
    panels[0].set_title(_perturbation(responses, channel))
    panels[-1].set(xlabel=TIME_LABEL, xlim=time[[0, -1]])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _bank_angles(gains, responses, channel):
    """Bank angle under the law of a channel, without and with the error at entry, and the difference."""
    figure, (angle, difference) = new_figure(6.4, 4.8, nrows=2, sharex=True, height_ratios=(1.6, 1))
    number = _number(gains, CHANNELS[channel])
    time, nominal = responses.time[number], responses.nominal[number, :, BANK] / DEGREE
    perturbed = responses.state[number, channel, :, BANK] / DEGREE
    angle.plot(time, nominal, color=BLACK, linestyle="--", label="nominal")
    angle.plot(time, perturbed, color=VERMILION, label=_perturbed(gains, responses, channel))
    difference.plot(time, perturbed - nominal, color=VERMILION)
    for axes in (angle, difference):
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        _mark_reversals(axes, responses, number)
    angle.set(ylabel=BANK_LABEL, title=_perturbation(responses, channel))
    difference.set(xlabel=TIME_LABEL, ylabel="difference (deg)", xlim=time[[0, -1]])
    figure.legend(*angle.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# ---- beyond the paper ------------------------------------------------------------------------------------------------


def pareto(simulation: Simulation, tradeoff: Tradeoff, branches: Branches, published=None) -> Figure:
    """Control energy against final position error, on every branch, and the weight along the nominal's.

    published: the printed claims by id, to draw the printed rows as well.
    """
    columns = 2 if len(branches.curve_error) else 1
    figure, panels = new_figure(4.6 * columns, 5.6, ncols=columns, width_ratios=(1.6, 1)[:columns], squeeze=False)
    axes = panels[0, 0]
    error = np.linalg.norm(tradeoff.path_error, axis=1)
    for number, name in enumerate(tradeoff.branch):
        on = tradeoff.path_branch == number
        color = BRANCH_COLOR[number % len(BRANCH_COLOR)]
        axes.plot(error[on], tradeoff.path_effort[on], color=color, label=f"over the weight, from {name}")
    for number, (errors, efforts) in enumerate(zip(tradeoff.fold_error, tradeoff.fold_effort, strict=True)):
        label = None if number else "jump at the end of a branch"
        axes.plot(errors, efforts, color=GREY, linestyle=":", label=label)
    axes.plot(
        branches.curve_error, branches.curve_effort, ".", color=ORANGE, markersize=7, zorder=1,
        label="the nominal's branch, error given",
    )  # fmt: skip
    for number in np.unique(branches.continued_solution):
        on = branches.continued_solution == number
        axes.plot(
            np.linalg.norm(branches.continued_error[on], axis=1), branches.continued_effort[on], ".", markersize=5,
            color=_solution_color(number), label=f"at the weights of the rows, from {branches.name[number]}",
        )  # fmt: skip
    rows = np.linalg.norm(tradeoff.error, axis=1)
    axes.plot(rows, tradeoff.effort, "o", color=BLACK, markersize=6, markerfacecolor="none", label="rows of Table 3")
    for place, group in enumerate(_crowds(tradeoff, rows)):
        # Beside the curve, and inwards at its right end.
        at_end = rows[group[0]] > rows.max() - 0.03 * np.ptp(rows)
        below, end, beside = ((-6, -11), "right"), ((10, 6), "right"), ((6, 4), "left")
        offset, side = end if at_end else beside if place % 2 == 0 or group[-1] == len(rows) - 1 else below
        names = ", ".join(dict.fromkeys(_printed_weight(tradeoff, number) for number in group))
        spot = rows[group[0]], tradeoff.effort[group[0]]
        axes.annotate(f"$c_1$ = {names}", spot, offset, textcoords="offset points", fontsize=7, ha=side)
    if published:
        efforts, _, _, errors = np.transpose(list(printed_rows(published).values()))
        axes.plot(errors, efforts, "x", color=VERMILION, markersize=6, label="the same as printed")
    label = f"final position error for {simulation.tabulated_error:g} m of radius (m)"
    axes.set(yscale="log", xlabel=label, ylabel="control energy $J_0$ (deg$^2$/s$^3$)")
    if columns == 2:
        weight, folded = panels[0, 1], np.isfinite(branches.fold_weight)
        # Without a fold the weight rises over decades, from what is zero but for rounding.
        clear = branches.curve_weight > (-np.inf if folded else 1e-6 * branches.curve_weight.max())
        weight.plot(branches.curve_error[clear], branches.curve_weight[clear], ".--", color=ORANGE)
        weight.plot(branches.fold_error, branches.fold_weight, "o", color=VERMILION, markersize=5)
        fold = f"fold: {branches.fold_weight:.4g} at {branches.fold_error:.0f} m" if folded else "no fold"
        weight.set(xlabel=label, ylabel="weight $c$ (deg$^2$/s$^3$)", title=f"the nominal's branch\n{fold}")
        weight.set_yscale("linear" if folded else "log")
        weight.locator_params(axis="x", nbins=4)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns)
    return figure


def branches(branches: Branches) -> Figure:
    """Bank angle of the local minima of the problem without weight, those with full rolls apart."""
    turning = branches.rolls > 0
    groups = [group for group in (np.flatnonzero(~turning), np.flatnonzero(turning)) if len(group)]
    figure, panels = new_figure(7.6, 4.4, ncols=len(groups), squeeze=False)
    for axes, group in zip(panels[0], groups, strict=True):
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        for number in group:
            label = (
                f"{branches.name[number]}: $J_0$ = {branches.effort[number]:.4g} deg$^2$/s$^3$,\n"
                f"{np.linalg.norm(branches.error[number]):.0f} m, {_starts(branches, number)}"
            )
            style = "-" if number == branches.nominal else "--"
            bank = branches.bank[number] / DEGREE
            axes.plot(branches.time[number], bank, color=_solution_color(number), linestyle=style, label=label)
        if turning[group].all():
            axes.yaxis.set_major_locator(MultipleLocator(180.0))
        axes.set(xlabel=TIME_LABEL, ylabel=BANK_LABEL, xlim=(0, branches.time.max()))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize=7)
    return figure


def gain_candidates(gains: Gains, gain_study: GainStudy) -> Figure:
    """Flown errors under all gains found for a channel, and under one set of gains for all channels."""
    figure, panels = new_figure(8.0, 7.2, nrows=2, ncols=2, sharey=True)
    sizes = gain_study.tuning_error
    order = np.argsort(sizes)
    plain = np.linalg.norm(gains.final[_number(gains, NO_DOC)], axis=0)
    for channel, axes in enumerate(panels.flat[: len(CHANNELS)]):
        axes.plot(sizes[order], plain[channel] * np.abs(sizes[order]), ".--", color=BLACK, label="no feedback, linear")
        mine = np.flatnonzero(gain_study.channel == channel)
        for place, number in enumerate(mine[np.argsort(gain_study.rank[mine])]):
            norm = np.linalg.norm(gain_study.scaled_gain[number])
            label = f"{gain_study.method[number]}, |k| = {norm:.3g}"
            color = CANDIDATE_COLOR[place % len(CANDIDATE_COLOR)]
            axes.plot(sizes[order], gain_study.flown_error[number, order], ".-", color=color, label=label)
        axes.set_title(f"{CHANNELS[channel]} error at entry")
    together = panels.flat[-1]
    # Errors as solved for, then tuned.
    for flown, style, kind in zip(gain_study.all_flown_error, ("-", "--"), ("as solved for", "tuned"), strict=True):
        for channel, color in enumerate((VERMILION, GREEN, BLUE)):
            label = f"{CHANNELS[channel]}, {kind}"
            together.plot(gain_study.all_sizes, flown[channel], style, marker=".", color=color, label=label)
    together.set_title("one set of gains for all channels")
    for axes in panels.flat:
        axes.set(yscale="log", xlabel="error at entry (m)")
        axes.locator_params(axis="x", nbins=5)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize=7, ncols=2 if axes is together else 1)
    for axes in panels[:, 0]:
        axes.set_ylabel("final position error (m)")
    return figure


def dispersion(ensemble: Ensemble, gains: Gains, entry_errors: FlightEnsemble) -> Figure:
    """Final crossrange and downrange errors for random position errors at entry, under every law."""
    figure, panels = new_figure(7.6, 6.2, nrows=2, ncols=3, sharex=True, sharey=True)
    trials = entry_errors.final_error.shape[1]
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = ELLIPSE_SIGMA * np.array([np.cos(angle), np.sin(angle)])
    reach = [1e-3]
    for number, axes in enumerate(panels.flat):
        flown = entry_errors.final_error[number][:, [DOWNRANGE, CROSSRANGE]] / KM
        ended = flown[np.isfinite(flown).all(axis=1)]
        shown = flown[:DRAWN]
        axes.plot(*shown.T, ".", color=SKY, markersize=1.5, alpha=0.6, rasterized=True)
        # The root of the covariance by singular values, as it may be singular.
        factor = gains.final[number][[DOWNRANGE, CROSSRANGE]] * ensemble.initial_deviations / KM
        left, values, _ = np.linalg.svd(factor, full_matrices=False)
        axes.plot(*(left * values @ circle), color=VERMILION)
        name, remarks = str(gains.law[number]), []
        if not gains.converged[number]:
            remarks.append("not converged")
        if lost := trials - len(ended):
            remarks.append(f"{lost:,} lost")
        notes = [LAW_TITLE[name], *([", ".join(remarks)] if remarks else [])]
        if len(ended):
            reach.append(np.quantile(np.abs(ended), LEVEL, axis=0).max())
            deviations = zip(("down", "cross"), ended.std(axis=0), np.linalg.norm(factor, axis=1), strict=True)
            notes += [rf"$\sigma$ {name} {_length(a)}, linear {_length(b)}" for name, a, b in deviations]
        axes.set_title("\n".join(notes), fontsize=8)
    panels[0, 0].set(xlim=(-1.05 * max(reach), 1.05 * max(reach)), ylim=(-1.05 * max(reach), 1.05 * max(reach)))
    for axes in panels[:, 0]:
        axes.set_ylabel("crossrange error (km)")
    for axes in panels[-1]:
        axes.set_xlabel("downrange error (km)")
    level = 100 * probability_inside(ELLIPSE_SIGMA)
    ellipse = f"{ELLIPSE_SIGMA}-sigma ellipse of linear covariance ({level:.1f} %)"
    handles = [
        axes.plot([], [], ".", color=SKY, label=f"{min(DRAWN, trials):,} of {trials:,} flights")[0],
        axes.plot([], [], color=VERMILION, label=ellipse)[0],
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def discretisation(solver: Solver, simulation: Simulation, certificates: Certificates) -> Figure:
    """Miss of the flown controls, and error of the sensitivity, against the number of intervals."""
    figure, panels = new_figure(7.6, 4.2, ncols=2)
    wrong = np.linalg.norm(certificates.mesh_error - certificates.mesh_flown_error, axis=-1)
    miss = np.linalg.norm(certificates.mesh_miss, axis=-1)
    intervals = certificates.intervals
    for axes, values, label in (
        (panels[0], miss, "miss of the target (m)"),
        (
            panels[1],
            wrong,
            "error of the sensitivity,\nfor " + f"{_length(simulation.tabulated_error / KM)} of radius (m)",
        ),
    ):
        for case, style in enumerate(("-", "--")):
            for scheme, name in enumerate(certificates.scheme):
                axes.loglog(
                    intervals, values[case, scheme], color=SCHEME_COLOR[scheme % len(SCHEME_COLOR)], linestyle=style,
                    marker="o", markersize=3, label=f"{SCHEME_NAME.get(str(name), name)}, {_case(certificates, case)}",
                )  # fmt: skip
        for order, scheme in ((2, 0), (4, -1)):
            start = np.nanmax(values[:, scheme, 0], initial=0.0)
            axes.loglog(
                intervals, 2.0 * start * (intervals[0] / intervals) ** order, color=GREY, linestyle=":",
                label=f"order {order}" if axes is panels[0] else None,
            )  # fmt: skip
        axes.set_xticks(intervals, [str(number) for number in intervals])
        axes.minorticks_off()
        axes.set(xlabel="intervals", ylabel=label)
        axes.axvline(solver.intervals, color=GREY, linewidth=0.6)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def minimum_fuel(minimum_fuel: MinimumFuel) -> Figure:
    """Bank acceleration and bank angle of least energy and of least fuel, and the switching function, by bound."""
    found = minimum_fuel
    figure, panels = new_figure(8.0, 6.6, nrows=3, ncols=len(found.bound), sharex=True, sharey="row", squeeze=False)
    for number, (acceleration, angle, switching) in enumerate(panels.T):
        for place, (color, style, name) in enumerate(FUEL_CURVE):
            time, control = found.time[number, place], found.bank_acceleration[number, place] / DEGREE
            curve = {"color": color, "linestyle": style, "label": name}
            # An edge that is not finite makes matplotlib refuse the whole.
            if np.isfinite(time).all():
                acceleration.stairs(control, time, baseline=None, linewidth=1.2, **curve)
            angle.plot(time, found.bank[number, place] / DEGREE, **curve)
        time = found.time[number, FUEL]
        switching.plot((time[1:] + time[:-1]) / 2.0, found.switching[number], color=FUEL_CURVE[FUEL][0])
        for level in (-1.0, 1.0):
            switching.axhline(level, color=GREY, linewidth=0.9, linestyle=":")
        masses = ", ".join(f"{mass:.3g}" if np.isfinite(mass) else "not solved" for mass in found.propellant[number])
        acceleration.set_title(f"bound {found.bound[number] / DEGREE:g} deg/s$^2$; propellant (kg)\n{masses}")
        switching.set_xlabel(TIME_LABEL)
    panels[0, 0].set_xlim(0.0, np.nanmax(found.time, initial=1.0))
    # Linear as far as the nominals reach, so that both they and bursts are seen.
    largest = np.nanmax(np.abs(found.bank_acceleration[:, 0]), initial=1e-6) / DEGREE
    panels[0, 0].set_yscale("symlog", linthresh=largest)
    panels[0, 0].set_ylabel(ACCELERATION_LABEL)
    panels[1, 0].set_ylabel(BANK_LABEL)
    panels[2, 0].set_ylabel("switching function\nof least fuel")
    figure.legend(*panels[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def further_perturbations(studies: Studies, tradeoff: Tradeoff, further_perturbations: FurtherPerturbations) -> Figure:
    """Other perturbations of the rows of Table 3, and the density desensitized and fed back against."""
    found = further_perturbations
    figure, ((over_rows, energy), (density, radius)) = new_figure(8.0, 7.0, nrows=2, ncols=2)
    norms = np.linalg.norm(found.row_linear_error, axis=-1)
    place = np.arange(len(norms))
    for number, name in enumerate(found.perturbation):
        style = {"color": PERTURBATION_COLOR[number], "marker": "o", "markersize": 3}
        over_rows.plot(place, norms[:, number] / norms[0, number], label=str(name), **style)
    over_rows.set_xticks(place, [_printed_weight(tradeoff, number) for number in place])
    over_rows.set(xlabel="$c_1$, against radius errors", ylabel="final error, relative to no DOC")
    over_rows.legend(fontsize=7)

    path = np.linalg.norm(found.path_error, axis=1)
    for number, name in enumerate(found.branch):
        on = found.path_branch == number
        color = BRANCH_COLOR[number % len(BRANCH_COLOR)]
        energy.semilogy(path[on], found.path_effort[on], color=color, label=f"against density, from {name}")
    energy.semilogy(
        norms[:, DENSITY], tradeoff.effort, "o", color=VERMILION, markersize=5, markerfacecolor="none",
        label="rows of Table 3, against radius",
    )  # fmt: skip
    percent = 100 * studies.density_error
    energy.set(xlabel=f"final error for {percent:g} % of density (m)", ylabel="control energy $J_0$ (deg$^2$/s$^3$)")
    energy.legend(fontsize=7)

    for axes, initial, flown, unit, label in (
        (density, found.density_error, found.density_flown_error, 0.01, "density error (%)"),
        (radius, found.radius_error, found.radius_flown_error, 1.0, "radius error at entry (m)"),
    ):
        order = np.argsort(initial)
        for number, name in enumerate(found.law):
            label_of = str(name) + ("" if found.converged[number] else " (not converged)")
            errors = np.linalg.norm(flown[number], axis=-1)[order] / KM
            color = FEEDBACK_COLOR[number % len(FEEDBACK_COLOR)]
            axes.semilogy(initial[order] / unit, errors, ".-", color=color, label=label_of)
        axes.set(xlabel=label, ylabel="final position error (km)")
    figure.legend(*density.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# ---- parts of figures ------------------------------------------------------------------------------------------------


def _drawn(channel, compared):
    """Laws of a figure and how they are drawn: those without feedback, and that of the channel."""
    styles = dict(zip((NO_DOC, RESHAPED), CURVE, strict=False))
    return [(name, styles[name]) for name in compared] + [(CHANNELS[channel], CURVE[-1])]


def _number(artifact, name):
    """Number of a law by its name."""
    return list(artifact.law).index(name)


def _label(gains, name):
    return LAW_NAME.get(name, "DOC with feedback") + _unfinished(gains, name)


def _perturbed(gains, responses, channel):
    """What the perturbed flight under a channel's law is called, and whether it comes to its end."""
    lost = np.isnan(responses.state[_number(gains, CHANNELS[channel]), channel, -1]).any()
    return "perturbed" + _unfinished(gains, CHANNELS[channel]) + (", lost" if lost else "")


def _unfinished(gains, name):
    """What is said beside a law whose gains were not found."""
    return "" if gains.converged[_number(gains, name)] else " (gains not converged)"


def _perturbation(responses, channel):
    return f"{CHANNELS[channel]} error of {responses.drawn_error[channel]:+g} m at entry"


def _mark_reversals(axes, responses, number):
    """Dotted lines where the bank angle of the nominal passes zero."""
    for time in zero_crossings(responses.time[number], responses.nominal[number, :, BANK]):
        axes.axvline(time, color=GREY, linewidth=0.9, linestyle=":")


def _hold(axes, most):
    """Let curves leave the axes rather than stretch them beyond a value, either way."""
    lower, upper = axes.get_ylim()
    if most > 0.0:
        axes.set_ylim(max(lower, -most), min(upper, most))


def _bounds(axes, bound, largest, unit):
    """Lines at a bound either way if a curve comes near it, and else words."""
    if largest > 0.5 * bound:
        for level in (-bound, bound):
            axes.axhline(level, color=GREY, linestyle="--")
    axes.set_title(f"largest {largest:.3g} {unit}, bound {bound:g} {unit}", loc="right")


def _row(tradeoff, number):
    """What a row of Table 3 is called: its c1, and the weight that stands for an infinite one."""
    name = f"$c_1$ = {_printed_weight(tradeoff, number)}"
    infinite = np.isnan(tradeoff.printed_weight[number])
    return f"{name} ($c$ = {_power(tradeoff.weight[number])})" if infinite else name


def _crowds(tradeoff, errors):
    """Numbers of neighbouring rows that lie too close to each other for labels of their own, in groups."""
    groups, heights = [[0]], np.log(tradeoff.effort)
    for number in range(1, len(errors)):
        first = groups[-1][0]
        apart = max(abs(values[number] - values[first]) / np.ptp(values) for values in (errors, heights))
        alike = _printed_weight(tradeoff, number) == _printed_weight(tradeoff, first)
        if apart < CROWDED or alike:
            groups[-1].append(number)
        else:
            groups.append([number])
    return groups


def _printed_weight(tradeoff, number):
    printed = tradeoff.printed_weight[number]
    return r"$\infty$" if np.isnan(printed) else f"{printed:g}"


def _power(value):
    """A positive number as a power of ten, with a factor unless that is one."""
    factor, exponent = f"{value:.2e}".split("e")
    factor = "" if float(factor) == 1.0 else rf"{float(factor):g} \cdot "
    return f"${factor}10^{{{int(exponent)}}}$"


def _counted(number, what):
    return f"{number} {what}{'' if number == 1 else 's'}"


def _solution_color(number):
    """Colour of a local minimum, in all figures."""
    return SOLUTION_COLOR[number % len(SOLUTION_COLOR)]


def _starts(branches, number):
    """How a local minimum was found."""
    times = f"found from {branches.found[number]} of {branches.starts} starts"
    return times + (" (nominal)" if number == branches.nominal else "")


def _case(certificates, case):
    weight = certificates.weight[case]
    return f"$c$ = {weight:.3g}" if weight else "nominal"


def _length(kilometres):
    """A length with its unit, metres where it is short."""
    return f"{kilometres:.3g} km" if kilometres >= 1.0 else f"{KM * kilometres:.3g} m"
