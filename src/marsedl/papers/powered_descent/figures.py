"""Figures of the paper, and two beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure

from marsedl.montecarlo.statistics import histogram_percentile, variance_sampling_band
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Drawing, Entry, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.powered_descent.records import (
    THRUST,
    FixedPointStudy,
    FlightEnsemble,
    Gains,
    IntegratorError,
    Nominal,
)
from marsedl.plotting.ellipses import band, ellipse, probability_inside
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure

TIME_LABEL = "time (s)"
COMPONENTS = ("downrange (m)", "altitude (m)", "downrange velocity (m/s)", "vertical velocity (m/s)", "mass (kg)")
SEGMENT_STYLES = ("-", "--")


def fig01(vehicle: Vehicle, mission: Mission, nominal: Nominal) -> Figure:
    """Change of the mass profile in each pass of Algorithm 3."""
    figure, axes = new_figure()
    changes = np.abs(np.diff(nominal.mass_of_pass, axis=0))
    shades = np.linspace(1.0, 0.25, len(changes))
    for number, (change, shade) in enumerate(zip(changes, shades, strict=True), start=1):
        shown = np.where(change > 0, change, np.nan)
        axes.semilogy(nominal.time, shown, color=BLUE, alpha=shade, label=f"{number}: {change.max():.1e} kg")
    axes.axhline(np.spacing(vehicle.wet_mass), color=GREY, linewidth=0.8, linestyle=":")
    axes.annotate(
        "spacing of double precision", (0.02, np.spacing(vehicle.wet_mass)), (0, 3), textcoords="offset points",
        xycoords=("axes fraction", "data"), fontsize=7, color=GREY,
    )  # fmt: skip
    _mark_switch(axes, mission)
    axes.set(xlabel=TIME_LABEL, ylabel="|change of mass| (kg)", xlim=(0, nominal.time[-1]), ylim=(1e-14, 1e3))
    axes.legend(title="pass: largest change", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def fig02(planet: Planet, entry: Entry, mission: Mission, drawing: Drawing, nominal: Nominal) -> Figure:
    """Divert geometry: steered mean path, ballistic path, covariance ellipses and divert radius."""
    figure, axes = new_figure(6.4, 4.4)
    start, final = segments.initial_mean(entry), mission.final_mean
    # The ballistic arc ends at ground level, which is where the divert radius is measured.
    fall = (start[3] + np.sqrt(start[3] ** 2 + 2 * planet.gravity * max(start[1], 0.0))) / planet.gravity
    time = np.linspace(0.0, fall, 200)
    impact = start[0] + start[2] * fall
    axes.plot(start[0] + start[2] * time, start[1] + start[3] * time - planet.gravity * time**2 / 2, "--", color=ORANGE)
    axes.plot(nominal.mean[:, 0], nominal.mean[:, 1], color=BLUE)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    for mean, covariance in zip(*segments.end_conditions(entry, mission), strict=True):
        axes.plot(*ellipse(mean[:2], covariance[:2, :2], drawing.ellipse_sigma).T, color=BLACK, linewidth=0.9)
    axes.annotate(
        "", start[:2] + 2.0 * start[2:], start[:2], arrowprops={"arrowstyle": "->", "color": BLACK, "linewidth": 1.2}
    )
    axes.annotate("mean velocity (2 s of it)", start[:2] + 2.0 * start[2:], (8, 0), textcoords="offset points")
    axes.annotate(r"$\bar r_0,\ \Sigma_0$", start[:2], (-10, 12), textcoords="offset points", ha="right")
    axes.annotate(r"$\bar r_T,\ \Sigma_T$", final[:2], (-12, 8), textcoords="offset points", ha="right")
    axes.annotate(r"$\tilde r(T)$", (impact, 0), (0, 8), textcoords="offset points", ha="left")
    axes.annotate("", (impact, -28), (final[0], -28), arrowprops={"arrowstyle": "<->", "color": GREEN})
    radius = abs(impact - final[0])
    axes.annotate(rf"$r_d$ = {radius:.0f} m", ((impact + final[0]) / 2, -30), (0, -3), textcoords="offset points",
                  ha="center", va="top", color=GREEN)  # fmt: skip
    axes.annotate("steered mean path", nominal.mean[len(nominal.mean) // 3, :2], (-10, 10), textcoords="offset points",
                  ha="right", color=BLUE)  # fmt: skip
    middle = len(time) * 3 // 5
    arc = start[:2] + np.array([start[2], start[3] - planet.gravity * time[middle] / 2]) * time[middle]
    axes.annotate("uncontrolled path", arc, (10, 4), textcoords="offset points", color=ORANGE)
    axes.set(xlabel=COMPONENTS[0], ylabel=COMPONENTS[1], aspect="equal")
    axes.set_ylim(bottom=-80)
    return figure


def fig03(drawing: Drawing, gains: Gains, closed_loop: FlightEnsemble, open_loop: FlightEnsemble) -> Figure:
    """Trajectories in the plane, closed and open loop, with covariance ellipses along the mean path."""
    figure, both = new_figure(7.6, 5.3, ncols=2)
    path = gains.mean
    nodes = _ellipse_nodes(drawing, gains)
    for axes, show_open in zip(both, (True, False), strict=True):
        if show_open:
            for trial in open_loop.kept_history:
                axes.plot(trial[:, 0], trial[:, 1], color=ORANGE, linewidth=0.5, alpha=0.7)
        for trial in closed_loop.kept_history:
            axes.plot(trial[:, 0], trial[:, 1], color=BLUE, linewidth=0.4, alpha=0.6)
        axes.plot(path[:, 0], path[:, 1], color=BLACK, linewidth=0.9)
        for node, is_end in nodes:
            curve = ellipse(path[node, :2], gains.covariance[node, :2, :2], drawing.ellipse_sigma)
            color = BLACK if is_end else VERMILION
            axes.plot(*curve.T, color=color, linewidth=1.2 if is_end else 0.8, zorder=4)
            at = _positions_at(closed_loop, gains.time[node])
            axes.plot(at[:, 0], at[:, 1], ".", color=color, markersize=1.6, zorder=3)
        axes.set(xlabel=COMPONENTS[0], aspect="equal")
    both[0].set(ylabel=COMPONENTS[1], title="closed and open loop")
    both[0].axhline(0.0, color=BLACK, linewidth=0.8)
    level = probability_inside(drawing.ellipse_sigma)
    both[1].set(title=f"closed loop; {drawing.ellipse_sigma:g}-sigma ellipses ({100 * level:.1f} %)")
    handles = [
        both[1].plot([], [], color=color, label=label, marker=marker)[0]
        for color, label, marker in (
            (BLUE, f"closed loop ({len(closed_loop.kept_history)})", ""),
            (ORANGE, f"open loop ({len(open_loop.kept_history)})", ""),
            (BLACK, "mean path; ellipses at the targets", ""),
            (VERMILION, "ellipses in between, trials at these times", "."),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def fig04(mission: Mission, closed_loop: FlightEnsemble, gains: Gains) -> Figure:
    """State components of a selection of closed-loop trials over time."""
    figure, panels = new_figure(7.2, 4.8, nrows=2, ncols=2, sharex=True)
    for component, axes in enumerate(panels.flat):
        for trial in closed_loop.kept_history:
            axes.plot(closed_loop.time, trial[:, component], color=BLUE, linewidth=0.4, alpha=0.6)
        axes.plot(gains.time, gains.mean[:, component], color=BLACK, linewidth=0.9)
        _mark_switch(axes, mission)
        axes.set(ylabel=COMPONENTS[component], xlim=(0, gains.time[-1]))
    for axes in panels[-1]:
        axes.set_xlabel(TIME_LABEL)
    panels[0, 0].plot([], [], color=BLUE, label=f"{len(closed_loop.kept_history)} trials")
    panels[0, 0].plot([], [], color=BLACK, label="mean of the design")
    panels[0, 0].legend()
    return figure


def fig05(mission: Mission, closed_loop: FlightEnsemble, nominal: Nominal) -> Figure:
    """Mass of the same trials over time, with the prior profile."""
    figure, (axes, difference) = new_figure(7.2, 3.4, ncols=2)
    prior = _at(nominal.time, nominal.segment, nominal.mass, closed_loop.time, closed_loop.segment)
    for trial in closed_loop.kept_history:
        axes.plot(closed_loop.time, trial[:, 4], color=BLUE, linewidth=0.4, alpha=0.6)
        difference.plot(closed_loop.time, trial[:, 4] - prior, color=BLUE, linewidth=0.4, alpha=0.6)
    axes.plot(nominal.time, nominal.mass, color=BLACK, linewidth=0.9)
    mean = closed_loop.mean[:, 4] - prior
    difference.plot(closed_loop.time, mean, color=VERMILION, label=f"mean of {closed_loop.count} trials")
    difference.axhline(0.0, color=BLACK, linewidth=0.9, label="prior profile")
    axes.plot([], [], color=BLUE, label=f"{len(closed_loop.kept_history)} trials")
    axes.plot([], [], color=BLACK, label="prior profile")
    for panel, label in ((axes, COMPONENTS[4]), (difference, "mass minus prior profile (kg)")):
        _mark_switch(panel, mission)
        panel.set(xlabel=TIME_LABEL, ylabel=label, xlim=(0, nominal.time[-1]))
        panel.legend()
    return figure


def fig06a(mission: Mission, gains: Gains) -> Figure:
    """Feedback gains over time, both axes."""
    figure, panels = new_figure(7.2, 3.4, ncols=2)
    for axes, column, label in ((panels[0], 0, "position gain (N/m)"), (panels[1], 2, "velocity gain (N s/m)")):
        for row, color, style, name in ((0, BLUE, "-", "downrange"), (1, ORANGE, "--", "altitude")):
            _by_segment(axes, gains, gains.gain[:, row, column + row], color=color, linestyle=style, label=name)
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        _mark_switch(axes, mission)
        axes.set(xlabel=TIME_LABEL, ylabel=label, xlim=(0, gains.time[-1]))
        axes.legend()
    return figure


def fig06b(vehicle: Vehicle, mission: Mission, drawing: Drawing, closed_loop: FlightEnsemble) -> Figure:
    """Control magnitude as a fraction of the maximum thrust: mean, upper percentile and maximum over the trials."""
    figure, axes = new_figure()
    level = drawing.thrust_percentile
    percentile, _ = histogram_percentile(closed_loop.histogram[:, THRUST], closed_loop.histogram_edges[THRUST], level)
    curves = (
        (closed_loop.observed_mean[:, THRUST], BLACK, "mean"),
        (percentile, BLUE, f"{100 * level:g} % of the trials below"),
        (closed_loop.maximum_over_trials[:, THRUST], VERMILION, "maximum"),
    )
    for values, color, label in curves:
        _by_segment(axes, closed_loop, values / vehicle.maximum_thrust, color=color, label=label)
    axes.axhline(1.0, color=GREY, linestyle=":", label="maximum thrust")
    _mark_switch(axes, mission)
    axes.set(
        xlabel=TIME_LABEL,
        ylabel=f"control magnitude / {vehicle.maximum_thrust:,.0f} N",
        xlim=(0, closed_loop.time[-1]),
        title=f"{closed_loop.count:,} trials",
    )
    axes.set_ylim(bottom=0)
    axes.legend()
    return figure


def fig07(
    mission: Mission, gains: Gains, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None
) -> Figure:
    """Predicted and measured variances of downrange and altitude, with the sampling band of the prediction."""
    closed_loop = closed_loop_large or closed_loop
    figure, panels = new_figure(7.2, 5.0, nrows=2, ncols=2, sharex=True, height_ratios=(2, 1))
    for component, (name, color) in enumerate((("downrange", BLUE), ("altitude", ORANGE))):
        axes, ratio = panels[:, component]
        predicted = gains.covariance[:, component, component]
        measured = closed_loop.covariance[:, component, component]
        lower, upper = variance_sampling_band(predicted, closed_loop.count)
        band(axes, gains.time, lower, upper, color, label="95 % sampling band")
        axes.plot(gains.time, predicted, color=color, label="predicted (Eq. 40)")
        axes.plot(closed_loop.time, measured, ".", color=BLACK, markersize=3, label=f"{closed_loop.count:,} trials")
        at = _at(gains.time, gains.segment, predicted, closed_loop.time, closed_loop.segment)
        lower, upper = variance_sampling_band(np.ones_like(at), closed_loop.count)
        band(ratio, closed_loop.time, 100 * (lower - 1), 100 * (upper - 1), color)
        ratio.plot(closed_loop.time, 100 * (measured / at - 1), ".", color=BLACK, markersize=3)
        ratio.axhline(0.0, color=color)
        for panel in (axes, ratio):
            _mark_switch(panel, mission)
        axes.set(title=name, xlim=(0, gains.time[-1]))
        axes.set_ylim(bottom=0)
        ratio.set_xlabel(TIME_LABEL)
        axes.legend()
    panels[0, 0].set_ylabel("variance (m$^2$)")
    panels[1, 0].set_ylabel("measured against\npredicted (%)")
    return figure


def fixed_point(studies: Studies, fixed_point: FixedPointStudy, gains: Gains) -> Figure:
    """Iterations of Algorithm 1 against the noise density, beside the closed form that needs none."""
    figure, (axes, errors) = new_figure(7.6, 3.6, ncols=2)
    orders = {"gauss_seidel": (BLUE, "o", "Gauss-Seidel order"), "jacobi": (ORANGE, "s", "Jacobi order, as printed")}
    for number, order in enumerate(fixed_point.order):
        color, marker, name = orders[str(order)]
        for segment, style in enumerate(SEGMENT_STYLES):
            curve = {"color": color, "marker": marker, "linestyle": style, "markersize": 3}
            done = fixed_point.sweep_converged[:, number, segment]
            iterations = np.where(done, fixed_point.sweep_iterations[:, number, segment], np.nan)
            axes.loglog(fixed_point.density, iterations, **curve, label=f"{name}, segment {segment + 1}")
            errors.loglog(fixed_point.density, fixed_point.sweep_error[:, number, segment], **curve)
    for panel in (axes, errors):
        for segment, style in enumerate(SEGMENT_STYLES):
            panel.axvline(fixed_point.critical_density[segment], color=GREY, linewidth=0.8, linestyle=style)
        if fixed_point.density[0] < gains.noise_density_plant < fixed_point.density[-1]:
            panel.axvline(gains.noise_density_plant, color=GREEN, linewidth=0.9)
        panel.set_xlabel("noise density (N s$^{1/2}$)")
    axes.plot([], [], color=GREY, linewidth=0.8, label="Riccati solution singular at the start")
    axes.plot([], [], color=GREEN, linewidth=0.9, label="this reading")
    axes.set_ylabel(f"iterations to a relative {studies.fixed_point_tolerance:.0e}")
    errors.set_ylabel("error of the Riccati solution\nagainst the closed form")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def integrator_error(simulation: Simulation, integrator_error: IntegratorError) -> Figure:
    """Strong error and bias of the final state against the step, for both schemes."""
    figure, panels = new_figure(7.6, 4.2, ncols=2, sharey=True)
    colors = (BLUE, ORANGE, GREEN, VERMILION, PURPLE)
    schemes = zip(("Runge-Kutta", "Euler-Maruyama"), ("-", "--"), ("o", "s"), strict=True)
    for number, (scheme, style, marker) in enumerate(schemes):
        for component, color in enumerate(colors):
            curve = {"color": color, "linestyle": style, "marker": marker, "markersize": 3}
            name = COMPONENTS[component]
            strong = integrator_error.strong_error[number, :, component]
            panels[0].loglog(integrator_error.step, strong, **curve, label=name if number == 0 else None)
            bias = np.abs(integrator_error.bias[number, :, component])
            resolved = bias > 3 * integrator_error.bias_standard_error[number, :, component]
            panels[1].loglog(integrator_error.step, np.where(resolved, bias, np.nan), **curve)
        panels[1].plot([], [], color=GREY, linestyle=style, marker=marker, markersize=3, label=scheme)
    largest = integrator_error.bias_standard_error.max(axis=(0, 2))
    panels[1].fill_between(integrator_error.step, 1e-6, largest, color=SKY, alpha=0.2, linewidth=0)
    panels[1].plot([], [], color=SKY, alpha=0.4, linewidth=6, label="below the largest standard error")
    step = integrator_error.step
    panels[0].loglog(step, 0.01 * step / step[0] / 5, color=BLACK, linestyle=":", linewidth=0.8, label="first order")
    for axes, title in zip(panels, ("root mean square difference", "|mean difference|, where resolved"), strict=True):
        axes.axvline(simulation.time_step, color=GREY, linewidth=0.8, linestyle=":")
        axes.set_xticks(step, [f"{number:.2g}" for number in step])
        axes.minorticks_off()
        axes.set(xlabel="step (s); dotted: this reading's", title=f"{title} ({integrator_error.trials:,} trials)")
        axes.legend(fontsize=7)
    panels[0].set(ylabel="final state, in the component's unit", ylim=(1e-4, 3))
    return figure


def _mark_switch(axes, mission: Mission):
    axes.axvline(mission.segment_durations[0], color=GREY, linewidth=0.8, linestyle=":")


def _by_segment(axes, artifact, values, label, **style):
    """Plot each segment by itself, so that no line joins both sides of the switch."""
    for number in range(segments.SEGMENTS):
        inside = artifact.segment == number
        axes.plot(artifact.time[inside], values[inside], label=label if number == 0 else None, **style)


def _at(time, segment, values, wanted_time, wanted_segment):
    """Values at other times, interpolated within each segment."""
    parts = zip(segments.split(segment, time, values), segments.split(wanted_segment, wanted_time), strict=True)
    return np.concatenate([np.interp(wanted, *known) for known, (wanted,) in parts])


def _ellipse_nodes(drawing: Drawing, gains):
    """Nodes at equal increments along each segment, and whether a target stands there."""
    nodes = []
    for number, (time,) in enumerate(segments.split(gains.segment, gains.time)):
        first = np.flatnonzero(gains.segment == number)[0]
        places = np.linspace(0, len(time) - 1, drawing.ellipses_per_segment + 1).round().astype(int)
        nodes += [(first + place, place in (0, len(time) - 1)) for place in places]
    return nodes


def _positions_at(ensemble, time):
    """Positions of the kept trials at a time, (trials, 2)."""
    unique, index = np.unique(ensemble.time, return_index=True)
    history = ensemble.kept_history[:, index, :2]
    right = np.clip(np.searchsorted(unique, time), 1, len(unique) - 1)
    weight = (time - unique[right - 1]) / (unique[right] - unique[right - 1])
    return (1 - weight) * history[:, right - 1] + weight * history[:, right]
