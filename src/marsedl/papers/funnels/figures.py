"""Figures of the paper, and those beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from marsedl.papers.funnels.basics import COMPLETE, CONDITIONS, DEGREE, HEAT_RATE, KILOMETRE, LEVEL, WATT_PER_CM2
from marsedl.papers.funnels.inputs import Mission, Planet, Studies
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    Divergence,
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Linearization,
    Nominal,
    Optima,
    Proven,
    StageStudy,
)
from marsedl.plotting.ellipses import band, ellipse
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure

TIME_LABEL = "time from entry (s)"
LEVEL_LABEL = r"level $\rho$"
HEAT_LABEL = "heat rate (W/cm$^2$)"
ALTITUDE, LONGITUDE, _, VELOCITY = range(4)
# Names of the states, and what one of their units is; None: of angles that are distances on the ground.
STATE_LABELS = (
    ("altitude (km)", KILOMETRE),
    ("downrange (km)", None),
    ("crossrange (km)", None),
    ("velocity (m/s)", 1.0),
    ("flight path angle (deg)", DEGREE),
    ("heading (deg)", DEGREE),
)
FLIGHT = {"color": VERMILION, "linewidth": 0.4, "alpha": 0.6}
DRAWN_FLIGHTS = 40
DRAWN_SLICES = 10  # of the Dubins car
FAR = 2.5  # times what else is drawn, beyond which a funnel leaves the axes
END_SHARE = 0.2  # of the flight, in the enlarged part of Fig. 1
LARGEST_DRAWN = 20.0  # km: slices that are larger leave the axes of Fig. 1
FALLING = "#cfe6f5"  # where V falls, in Fig. 4
CURVE_COLOR = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
STEP_COLOR = (SKY, BLUE, BLACK, PURPLE)
CONDITION_NAME = {"flow": "motion", "euler": "Euler"}
RESOLVED = 1e-9  # relative: smaller deviations are on a linear part of their axis


# ---- figures of the paper --------------------------------------------------------------------------------------------


def fig01(planet: Planet, mission: Mission, linearization: Linearization, funnel: Funnel) -> Figure:
    """Slices of the funnel in downrange and altitude, and the end of it enlarged."""
    figure, (whole, end) = new_figure(7.8, 3.6, ncols=2, width_ratios=(1.9, 1))
    scale = np.array([planet.planet_radius / KILOMETRE, 1.0 / KILOMETRE])
    path = (linearization.state[:, [LONGITUDE, ALTITUDE]] - [mission.entry_longitude, 0.0]) * scale
    ellipses = _in_plane(funnel, (LONGITUDE, ALTITUDE)) * np.outer(scale, scale)
    late = int((1.0 - END_SHARE) * len(funnel.step))
    for axes, first in ((whole, 0), (end, late)):
        near = np.zeros(2)
        for step, matrix in zip(funnel.step[first:], ellipses[first:], strict=True):
            # A funnel may end early; its slices may be of any size.
            if np.isfinite(matrix).all():
                outline = ellipse(path[2 * step], matrix, 1.0)
                axes.add_patch(Polygon(outline, facecolor=SKY, edgecolor=BLUE, linewidth=0.4, alpha=0.3))
                near = np.maximum(near, np.minimum(np.sqrt(np.diag(matrix)), LARGEST_DRAWN))
        drawn = path[2 * funnel.step[first] :]
        axes.plot(*drawn.T, color=BLACK, linewidth=1.0, label="nominal")
        if not first:
            axes.plot(*path[0], "o", color=VERMILION, markersize=5, zorder=5, label="entry")
        axes.plot(*path[-1], "s", color=VERMILION, markersize=5, zorder=5, label="deployment of the parachute")
        lower, upper = drawn.min(axis=0) - 1.3 * near, drawn.max(axis=0) + 1.3 * near
        axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), xlabel="downrange (km)")
    whole.add_patch(Polygon(np.empty((1, 2)), facecolor=SKY, edgecolor=BLUE, linewidth=0.4, alpha=0.5, label="slices"))
    whole.set_ylabel("altitude (km)")
    widest = np.sqrt(np.nanmax(np.diagonal(ellipses, axis1=1, axis2=2), initial=0.0))
    remarks = [_said(funnel), f"slices of up to $\\pm${widest:.2g} km" if widest > LARGEST_DRAWN else ""]
    whole.set_title("; ".join(filter(None, remarks)), loc="left")
    end.set_title(f"the last {100 * END_SHARE:.0f} % of the flight")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def fig02(dubins: Dubins, dubins_calm: FlightEnsemble) -> Figure:
    """Slices of the funnel of the Dubins car in x, y and heading, with flights inside."""
    figure, axes = new_figure(5.6, 4.4, subplot_kw={"projection": "3d", "computed_zorder": False})
    unit = np.array([1.0, 1.0, DEGREE])
    path = dubins.state[::2]
    number = list(dubins.funnel).index("flow")
    drawn = dubins.slice_step[:: max(1, len(dubins.slice_step) // DRAWN_SLICES)]
    latitude, longitude = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 15), np.linspace(0.0, 2.0 * np.pi, 25))
    sphere = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    for step in drawn:
        level = dubins.level[number, list(dubins.slice_step).index(step)]
        half_axes = np.sqrt(2.0 * level) * np.linalg.inv(np.linalg.cholesky(dubins.shape[step])).T
        surface = path[step][:, np.newaxis] + half_axes @ sphere.reshape(3, -1)
        surface = (surface / unit[:, np.newaxis]).reshape(sphere.shape)
        axes.plot_surface(*surface, color=SKY, alpha=0.12, linewidth=0, rstride=1, cstride=1, rasterized=True)
        axes.plot_wireframe(*surface, color=BLUE, alpha=0.25, linewidth=0.3, rstride=6, cstride=7)
    for flight in path + dubins_calm.kept_history[:DRAWN_FLIGHTS]:
        axes.plot(*(flight / unit).T, color=ORANGE, linewidth=0.5)
    axes.plot(*(path / unit).T, color=BLACK, linewidth=1.6, label="nominal")
    axes.plot([], [], color=ORANGE, linewidth=0.8, label=_shown(dubins_calm))
    axes.plot([], [], color=SKY, linewidth=6, alpha=0.5, label=f"{len(drawn)} of {len(dubins.slice_step)} slices")
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="heading (deg)")
    axes.view_init(elev=24, azim=-62)
    axes.set_box_aspect((4, 3, 2.6), zoom=0.92)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def fig03(funnel: Funnel, constant: FlightEnsemble) -> Figure:
    """Level of the funnel and largest V of the flights, over the steps of the funnel."""
    figure, panels = new_figure(7.6, 3.8, ncols=2)
    number = np.arange(len(funnel.step)) + 1.0
    step = funnel.time[1]
    at_node = 1.0 + constant.time / step
    flown, repeats = constant.maximum_over_trials[:, LEVEL], constant.repeat_maximum[:, :, LEVEL]
    panels[1].set_yscale("log")
    for axes in panels:
        axes.plot(number, funnel.level, ".-", color=BLUE, markersize=3, label="SOS-sampling")
        axes.plot(at_node, flown, color=VERMILION, label=f"Monte Carlo, largest of {_flights(constant)}")
        band(axes, at_node, *_extremes(repeats), VERMILION, "largest of each tenth of them")
        axes.set(xlabel="time step $k$", xlim=number[[0, -1]])
        # Slices are evenly spaced, so that both axes are linear.
        times = axes.secondary_xaxis("top", functions=(lambda k: (k - 1.0) * step, lambda time: 1.0 + time / step))
        times.set_xlabel(TIME_LABEL)
    panels[0].set_ylabel(r"funnel boundary $\rho$")
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_formatter("{x:g}")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    if said := _said(funnel):
        panels[0].text(0.02, 0.96, said, transform=panels[0].transAxes, va="top")
    return figure


def fig04(studies: Studies, funnel: Funnel) -> Figure:
    """Where V falls in a plane through a slice, without disturbance and under the worst one, and points of it."""
    figure, panels = new_figure(7.4, 4.6, ncols=2, sharex=True, sharey=True)
    first, second = (int(number) for number in studies.fig4_coordinates)
    axis, angle = funnel.fig4_coordinate, np.linspace(0.0, 2.0 * np.pi, 361)
    projected = funnel.samples[:, [first - 1, second - 1]]
    for axes, rate, on_slice, name in (
        (panels[0], funnel.fig4_rate, funnel.fig4_circle_rate, "$w = 0$"),
        (panels[1], funnel.fig4_worst_rate, funnel.fig4_circle_worst_rate, "the worst $w$ of $W$"),
    ):
        falling = rate < 0.0  # NaN where the equations do not hold
        if falling.any():
            axes.contourf(axis, axis, np.ma.masked_invalid(rate), levels=[rate[falling].min(), 0.0], colors=[FALLING])
        axes.plot(*projected.T, ".", color=GREY, markersize=2, alpha=0.6)
        axes.plot(np.cos(angle), np.sin(angle), color=BLACK)
        for there, color in ((on_slice < 0.0, BLUE), (~(on_slice < 0.0), VERMILION)):
            axes.plot(*funnel.fig4_circle[there].T, "o", color=color, markersize=3)
        share = 100.0 * falling.mean()
        axes.set_title(f"{name}: $V$ falls in {share:.3g} % of the plane")
        axes.set(xlabel=f"whitened coordinate $y_{first}$", aspect="equal")
    panels[0].set_ylabel(f"whitened coordinate $y_{second}$")
    handles = [
        Polygon(np.empty((1, 2)), facecolor=FALLING, label="$V$ falls"),
        *panels[0].plot([], [], color=BLACK, label=f"slice $B_{{{studies.fig4_slice}}}$ in the plane"),
        *panels[0].plot([], [], "o", color=BLUE, markersize=3, label="its points, $V$ falls"),
        *panels[0].plot([], [], "o", color=VERMILION, markersize=3, label="its points, $V$ does not fall"),
        *panels[0].plot([], [], ".", color=GREY, markersize=3, label=f"{len(projected)} samples, projected"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


# ---- beyond the paper ------------------------------------------------------------------------------------------------


def nominal(mission: Mission, linearization: Linearization, nominal: Nominal, optima: Optima) -> Figure:
    """The nominal over time, and all optima of the problem with their peaks of the heat rate."""
    figure, panels = new_figure(8.4, 5.0, nrows=2, ncols=3)
    time, last = linearization.half_time, linearization.half_time[-1]
    state = linearization.state
    for axes, values, label in (
        (panels[0, 0], state[:, ALTITUDE] / KILOMETRE, "altitude (km)"),
        (panels[0, 1], state[:, VELOCITY], "velocity (m/s)"),
        (panels[0, 2], linearization.bank / DEGREE, "bank angle (deg)"),
        (panels[1, 0], linearization.heat_rate / WATT_PER_CM2, HEAT_LABEL),
    ):
        axes.plot(time, values, color=BLUE)
        axes.set(xlabel=TIME_LABEL, ylabel=label, xlim=(0.0, last))
    for bound in mission.bank_bounds:
        panels[0, 2].axhline(bound / DEGREE, color=GREY, linestyle="--")
    limit = mission.heat_rate_limit / WATT_PER_CM2
    panels[1, 0].axhline(limit, color=GREY, linestyle="--")
    panels[1, 0].set_title(f"at the nodes at most {nominal.heat_rate.max() / WATT_PER_CM2:.3f}, limit {limit:g}")

    costs, peaks = panels[1, 1:]
    for number, intervals in enumerate(np.unique(optima.intervals)):
        here, color = optima.intervals == intervals, CURVE_COLOR[number % len(CURVE_COLOR)]
        label = f"{intervals} intervals"
        costs.plot(optima.final_time[here], optima.cost[here] / DEGREE**2, "o", color=color, label=label)
        over = optima.peak_heat_rate[here] / WATT_PER_CM2
        peaks.plot(optima.peak_position[here] / intervals, over, "o", color=color)
    costs.plot(last, nominal.cost / DEGREE**2, "s", markersize=9, color="black", fillstyle="none", label="flown")
    costs.set(xlabel="final time (s)", ylabel="integral of the squared\nbank rate (deg$^2$/s)", title="optima")
    costs.legend()
    peaks.axhline(limit, color=GREY, linestyle="--")
    peaks.set(xlabel="its time (share of the flight)", ylabel=f"peak {HEAT_LABEL}", title="peak between the nodes")
    peaks.margins(0.15)
    costs.margins(0.15)
    return figure


def bands(planet: Planet, funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble) -> Figure:
    """Half widths of the funnel in every state, with flights inside and what linear dynamics say."""
    figure, panels = new_figure(8.4, 5.4, nrows=2, ncols=3, sharex=True)
    length, beyond = planet.planet_radius / KILOMETRE, False
    for component, axes in enumerate(panels.flat):
        name, scale = STATE_LABELS[component]
        scale = length if scale is None else 1.0 / scale
        width = funnel.half_width[:, component] * scale
        linear = linear_bounds.exact_half_width[:, component] * scale
        least = linear_bounds.reachable_half_width[:, component] * scale
        band(axes, funnel.time, -width, width, BLUE)
        for sign in (-1.0, 1.0):
            axes.plot(funnel.time, sign * width, color=BLUE, linewidth=0.8)
            axes.plot(linear_bounds.slice_time, sign * linear, color=BLACK, linestyle="--", linewidth=0.8)
            axes.plot(linear_bounds.time, sign * least, color=GREEN, linewidth=0.9)
        axes.plot(constant.time, constant.kept_history[:DRAWN_FLIGHTS, :, component].T * scale, **FLIGHT)
        ends = constant.final_state[:, component] * scale
        if np.isfinite(ends).any():
            axes.plot(np.full(2, constant.time[-1]), _extremes(ends), "_", color=VERMILION, markersize=9, clip_on=False)
        # A funnel that fails may have slices of any size.
        widest, most = np.nanmax(width, initial=0.0), FAR * max(linear.max(), least.max())
        beyond = beyond or widest > most
        reach = 1.08 * min(widest or most, most)
        axes.set(ylabel=name, xlim=(0.0, funnel.time[-1]), ylim=(-reach, reach))
    for axes in panels[1]:
        axes.set_xlabel(TIME_LABEL)
    axes = panels[0, 0]
    handles = [
        axes.fill_between([], [], [], color=BLUE, alpha=0.22, label="funnel" + (", beyond the axes" if beyond else "")),
        *axes.plot([], [], color=BLACK, linestyle="--", linewidth=0.8, label="the same for linear dynamics"),
        *axes.plot([], [], color=GREEN, linewidth=0.9, label="least trace, linear dynamics"),
        *axes.plot([], [], **FLIGHT, label=_shown(constant)),
        *axes.plot([], [], "_", color=VERMILION, markersize=9, label="their extremes at the end"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def heating(mission: Mission, linearization: Linearization, funnel: Funnel, constant: FlightEnsemble) -> Figure:
    """Heat rate of the nominal, of the flights, and the largest on the funnel."""
    figure, axes = new_figure(6.4, 3.8)
    limit = mission.heat_rate_limit / WATT_PER_CM2
    flown = constant.maximum_over_trials[:, HEAT_RATE] / WATT_PER_CM2
    on_funnel = funnel.heat_rate / WATT_PER_CM2
    on_nominal = linearization.heat_rate / WATT_PER_CM2
    axes.axhline(limit, color=GREY, linestyle="--", label=f"limit of the nominal, {limit:g}")
    axes.plot(linearization.half_time, on_nominal, color=BLACK, label=f"nominal, up to {on_nominal.max():.2f}")
    axes.plot(constant.time, flown, color=VERMILION, label=f"{_flights(constant)}, up to {_largest(flown)}")
    axes.plot(funnel.time, on_funnel, ".-", color=BLUE, markersize=3, label=f"funnel, up to {_largest(on_funnel)}")
    axes.set(xlabel=TIME_LABEL, ylabel=HEAT_LABEL, xlim=(0.0, funnel.time[-1]))
    axes.set_ylim(0.0, min(axes.get_ylim()[1], FAR * limit))
    axes.legend()
    return figure


def linear_bounds(
    funnel: Funnel,
    linear_bounds: LinearBounds,
    proven: Proven,
    constant: FlightEnsemble,
    redrawn: FlightEnsemble,
    adversarial: FlightEnsemble,
) -> Figure:
    """Levels by sums of squares and for linear dynamics, and the largest V of all kinds of flights."""
    figure, (levels, ratio) = new_figure(7.8, 4.2, ncols=2)
    flown = constant.maximum_over_trials[:, LEVEL]
    bounds = linear_bounds
    curves = (
        (funnel.time, funnel.level, BLUE, "-", "funnel by sums of squares"),
        (proven.time, proven.level, SKY, "-", "proven"),
        (bounds.slice_time, bounds.triangle_level, GREEN, "-.", "linear, triangle inequality"),
        (bounds.slice_time, bounds.exact_level, BLACK, "--", "linear, exact"),
        (bounds.slice_time, bounds.undisturbed_level, GREY, ":", "linear, without disturbance"),
        (
            adversarial.time,
            adversarial.maximum_over_trials[:, LEVEL],
            ORANGE,
            "-",
            _flights(adversarial, "adversary"),
        ),
        (constant.time, flown, VERMILION, "--", _flights(constant, "constant disturbance")),
        (redrawn.time, redrawn.maximum_over_trials[:, LEVEL], PURPLE, "-", _flights(redrawn, "redrawn")),
    )
    for time, values, color, style, label in curves:
        levels.semilogy(time, values, color=color, linestyle=style, label=label)
        ratio.semilogy(time, values / np.interp(time, constant.time, flown), color=color, linestyle=style)
    for axes in (levels, ratio):
        axes.set(xlabel=TIME_LABEL, xlim=(0.0, funnel.time[-1]))
    levels.set_ylabel(LEVEL_LABEL)
    ratio.set_ylabel("relative to flights with constant disturbance")
    figure.legend(*levels.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def undersampling(stage_study: StageStudy) -> Figure:
    """Bound of a stage from fewer samples than needed, and how far it fails at fresh points."""
    figure, (bound, excess) = new_figure(7.4, 3.6, ncols=2)
    found, needed = stage_study, stage_study.samples[list(stage_study.variety).index("S^5 x S^1")]
    bound.axhline(found.form_bound[0], color=BLACK, linestyle="--", label=f"well chosen, {needed} samples")
    bound.axhline(found.polynomial_maximum, color=GREEN, linestyle=":", label="largest value of the polynomial found")
    bound.plot(found.few_samples, found.few_bound, ".-", color=BLUE, label="random samples")
    bound.set_ylabel(r"bound of $V$ at the next slice, over $\rho$")
    excess.axhline(0.0, color=GREY, linewidth=0.8)
    excess.plot(found.few_samples, found.few_least_value, ".-", color=BLUE)
    below = found.few_least_value < 0.0
    excess.plot(
        found.few_samples[below], found.few_least_value[below], "o", color=VERMILION, label="refuted by fresh points"
    )
    excess.set_ylabel("least distance of polynomial and bound,\nat fresh points")
    for axes in (bound, excess):
        axes.axvline(needed, color=GREY, linewidth=0.8)
        axes.set(xlabel="samples")
    handles = [handle for axes in (bound, excess) for handle in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def conditioning(stage_study: StageStudy) -> Figure:
    """Condition numbers of bases at the samples, and of the samples themselves."""
    figure, (bases, designs) = new_figure(7.4, 3.2, ncols=2, width_ratios=(1.3, 1))
    for axes, names, values, title in (
        (bases, stage_study.basis, stage_study.basis_condition, "basis of degree 2"),
        (designs, stage_study.design, stage_study.design_condition, "samples, degree 4"),
    ):
        _dots(axes, names, values, "{:.3g}")
        axes.set(xscale="log", xlabel="condition number", title=title)
        spread = values.max() / values.min()
        axes.set_xlim(values.min() / spread**0.05, values.max() * spread**0.3)  # room for the numbers
    return figure


def stage_forms(stage_study: StageStudy) -> Figure:
    """Bound of one stage by every form and solver, against the largest value of its polynomial, and iterations."""
    figure, (bounds, iterations) = new_figure(7.6, 3.4, ncols=2, width_ratios=(1.6, 1), sharey=True)
    found, place = stage_study, -np.arange(len(stage_study.form))
    for values, marker, color, label in (
        (found.form_bound, "o", BLUE, "bound"),
        (found.form_safe_bound, "D", VERMILION, "bound that holds in spite of residuals"),
    ):
        deviation = values / found.polynomial_maximum - 1.0
        bounds.plot(deviation, place, marker, color=color, markersize=4, label=label, fillstyle="none")
    bounds.axvline(0.0, color=GREY, linewidth=0.8)
    bounds.set_xscale("symlog", linthresh=RESOLVED)
    bounds.set(
        xlabel="relative to the largest value found of the polynomial", yticks=place, yticklabels=list(found.form)
    )
    _dots(iterations, found.form, found.form_iterations, "{:d}")
    iterations.set(xscale="log", xlabel="iterations")
    iterations.set_xlim(0.5 * max(1, found.form_iterations.min()), 4.0 * found.form_iterations.max())
    for number, status in enumerate(found.form_status):
        if status != "optimal":
            bounds.annotate(
                str(status),
                (0.02, place[number]),
                (0, 5),
                xycoords=("axes fraction", "data"),
                textcoords="offset points",
                fontsize=6,
            )
    figure.legend(*bounds.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def euler(linearization: Linearization, discretization: Discretization) -> Figure:
    """Euler bound against that of the motion, by stage and by step, and the levels of both by the number of slices."""
    figure, (stages, orders, levels) = new_figure(9.0, 3.9, ncols=3)
    found, last = discretization, linearization.time[-1]
    step = found.spacing * linearization.time[1]
    stages.axhline(0.0, color=GREY, linewidth=0.8)
    for number, row in enumerate(found.excess):
        excess = 100 * row[: round(last / step[number])]
        time = step[number] * np.arange(len(excess))
        stages.plot(time, excess, color=STEP_COLOR[number % len(STEP_COLOR)], label=f"{len(excess)} stages")
        below = excess < 0.0
        stages.plot(time[below], excess[below], ".", color=VERMILION, markersize=3)
    stages.plot([], [], ".", color=VERMILION, markersize=4, label="below: not a bound")
    stages.set(xlabel=TIME_LABEL, ylabel="Euler bound over that of the motion,\nless one (%)", xlim=(0.0, last))

    for values, marker, color, label in (
        (found.mean_difference, "o", BLUE, "mean magnitude"),
        (found.mean_excess, "^", GREEN, "mean"),
        (-found.least_excess, "s", VERMILION, "largest shortfall"),
    ):
        # A mean below zero, and a shortfall that there is not, have no place on a logarithmic axis.
        shown = np.where(values > 0.0, 100 * values, np.nan)
        orders.loglog(step, shown, f"{marker}-", color=color, markersize=4, label=label)
    for order, style in ((2, ":"), (3, "--")):
        guide = 150 * found.mean_difference[0] * (step / step[0]) ** order
        orders.loglog(step, guide, color=GREY, linestyle=style, label=f"order {order}")
    orders.set(xlabel="step between slices (s)", ylabel="the same over all stages (%)")
    orders.set_xticks(step, [f"{value:.3g}" for value in step])
    orders.minorticks_off()

    slices = np.round(last / step).astype(int) + 1
    for number, (name, color) in enumerate(zip(CONDITIONS, (BLUE, ORANGE), strict=True)):
        of = CONDITION_NAME[name]
        levels.plot(slices, found.peak_level[number], "o-", color=color, fillstyle="none", label=f"{of}, largest")
        levels.plot(slices, found.final_level[number], "s--", color=color, markersize=3, label=f"{of}, last")
    levels.set(xlabel="slices", ylabel=LEVEL_LABEL)
    levels.set_xticks(slices, [str(number) for number in slices])
    for axes in (stages, orders, levels):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=7)
    return figure


def fragility(linearization: Linearization, coarse_funnels: CoarseFunnels, divergence: Divergence) -> Figure:
    """Levels under cheaper feedback, wider density and larger initial sets, and whether these funnels exist."""
    figure, axes = new_figure(7.2, 3.8)
    time = linearization.time[coarse_funnels.coarse_step]
    base = list(coarse_funnels.variant).index("samples")
    axes.semilogy(time, coarse_funnels.variant_level[base], color=BLACK, linewidth=1.8, label="as it is")
    for number, (name, factor) in enumerate(zip(divergence.change, divergence.change_factor, strict=True)):
        color, values = CURVE_COLOR[number % len(CURVE_COLOR)], divergence.change_level[number]
        flown = divergence.change_flown[number]
        ends = "" if np.isfinite(values).all() else " (ends)"
        axes.semilogy(time, values, ".-", color=color, markersize=3, label=f"{factor:g} x {name}{ends}")
        axes.plot(time[-1], flown, "_", color=color, markersize=10, clip_on=False)
        if ends:
            reached = np.isfinite(values)
            axes.plot(time[reached][-1:], values[reached][-1:], "x", color=color)
    axes.plot([], [], "_", color=BLACK, markersize=10, label="largest $V$ of flights, at any time")
    axes.set(xlabel=TIME_LABEL, ylabel=LEVEL_LABEL, xlim=time[[0, -1]])
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


def proven(funnel: Funnel, proven: Proven) -> Figure:
    """Proven level over that of the funnel, and what the proof adds to the bound of every stage."""
    figure, (levels, parts) = new_figure(7.6, 3.8, ncols=2)
    funnel_level = np.interp(proven.node_time, funnel.time, funnel.level)
    ratio = proven.node_level / funnel_level
    if np.nanmin(ratio, initial=1.0) < 1.0 / FAR:  # of a funnel that is far off
        levels.set_yscale("log")
    levels.plot(proven.node_time, ratio, color=BLUE, label="at all nodes")
    levels.plot(proven.time, proven.level / funnel.level, ".", color=VERMILION, label="at the slices")
    levels.axhline(1.0, color=GREY, linewidth=0.8)
    levels.set(xlabel=TIME_LABEL, ylabel="proven level over that of the funnel")
    levels.legend()
    for name, color, label in (
        ("truncation", BLUE, "known terms of higher degree"),
        ("remainder", VERMILION, "remainder"),
        ("rise", GREEN, "inside of the slice"),
    ):
        values = getattr(proven, name)
        # What is zero has no place on a logarithmic axis.
        shown = np.where(values > 0.0, values, np.nan)
        nothing = "" if np.isfinite(shown).any() else " (none)"
        parts.semilogy(proven.time[:-1], shown, ".-", color=color, label=label + nothing)
    parts.set(xlabel=TIME_LABEL, ylabel=r"added to the bound of a stage, over $\rho$")
    figure.legend(*parts.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    for axes in (levels, parts):
        axes.set_xlim(0.0, proven.time[-1])
    if not proven.proven:
        count = np.count_nonzero(np.isfinite(proven.bound))
        levels.set_title(f"proven for {count} of {len(proven.bound)} stages", loc="left")
    return figure


def dubins_rho(
    dubins: Dubins,
    dubins_study: DubinsStudy,
    dubins_calm: FlightEnsemble,
    dubins_wind: FlightEnsemble,
) -> Figure:
    """Levels of the Dubins car without and with wind: funnels, linear dynamics, flights, and proven."""
    figure, panels = new_figure(7.6, 5.4, nrows=2, ncols=2, sharex=True, sharey="row", height_ratios=(1, 1.2))
    for column, (base, flights, title) in enumerate(
        (("flow", dubins_calm, "without wind"), ("wind", dubins_wind, "with wind"))
    ):
        number = list(dubins.funnel).index(base)
        reference = dubins.level[number]
        curves = [(dubins.slice_time, reference, BLUE, "-", "funnel")]
        if base == "flow":
            euler = dubins.level[list(dubins.funnel).index("euler")]
            curves.append((dubins.slice_time, euler, ORANGE, "-", "Euler step"))
            curves.append((dubins.slice_time, dubins_study.backward_level, SKY, ":", "backwards from its end"))
        if base in dubins_study.proven_funnel:
            proven = dubins_study.proven_level[list(dubins_study.proven_funnel).index(base)]
            curves.append((dubins.slice_time, proven, GREEN, "-.", "proven"))
        curves.append((dubins.slice_time, dubins_study.linear_level[number], BLACK, "--", "linear, exact"))
        curves.append((flights.time, flights.maximum_over_trials[:, LEVEL], VERMILION, "-", "largest of the flights"))
        level, ratio = panels[:, column]
        for time, values, color, style, label in curves:
            level.plot(time, values, color=color, linestyle=style, label=label)
            percent = 100 * (values / np.interp(time, dubins.slice_time, reference) - 1.0)
            ratio.plot(time, percent, color=color, linestyle=style)
        level.set_title(f"{title}; {_flights(flights)}")
        ratio.set(xlabel="time (s)", xlim=dubins.slice_time[[0, -1]])
    panels[0, 0].set_ylabel(LEVEL_LABEL)
    panels[0, 0].set_ylim(bottom=0.0)
    panels[1, 0].set_ylabel("relative to the funnel (%)")
    panels[1, 0].set_yscale("symlog", linthresh=1.0)
    panels[1, 0].yaxis.set_major_formatter("{x:g}")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# ---- parts of figures ------------------------------------------------------------------------------------------------


def _in_plane(funnel, components):
    """Matrices E of the slices {x'E^-1 x <= 1} projected on two components of the state, (slices, 2, 2)."""
    inverse = np.linalg.inv(funnel.shape)
    return 2.0 * funnel.level[:, np.newaxis, np.newaxis] * inverse[:, components][:, :, components]


def _largest(values):
    """The largest of some values as text, if there is one."""
    return f"{np.nanmax(values):.4g}" if np.isfinite(values).any() else "nothing"


def _extremes(values):
    """Least and largest of some curves (curves, time), which may all be without a number somewhere."""
    return np.fmin.reduce(values), np.fmax.reduce(values)


def _shown(ensemble):
    """How many flights are drawn, of how many."""
    return f"{min(DRAWN_FLIGHTS, len(ensemble.kept_history))} of {_flights(ensemble)}"


def _said(funnel):
    """Why a funnel is not complete, shortly; nothing if it is."""
    return "" if funnel.outcome == COMPLETE else f"the funnel ends at slice {np.isfinite(funnel.level).sum()}"


def _dots(axes, names, values, form):
    """One dot a row, from above, with its number."""
    place = -np.arange(len(names))
    axes.plot(values, place, "o", color=BLUE, markersize=4)
    for value, height in zip(values, place, strict=True):
        axes.annotate(form.format(value), (value, height), (6, -3), textcoords="offset points", fontsize=7)
    axes.set_yticks(place, list(names))
    axes.margins(y=0.1)


def _flights(ensemble, kind=""):
    """How many flights there are, and how many are lost."""
    lost = f" ({ensemble.excluded:,} lost)" if ensemble.excluded else ""
    return f"{len(ensemble.outcome):,} flights{lost}" + (f", {kind}" if kind else "")
