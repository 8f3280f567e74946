"""Figures of the paper, and one beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure

from marsedl.montecarlo.statistics import histogram_percentile
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Drawing, Inputs, Mission, Studies, Vehicle
from marsedl.papers.powered_descent.records import (
    MOTION,
    THRUST,
    FixedPointStudy,
    FlightEnsemble,
    Gains,
    Nominal,
)
from marsedl.plotting.curves import legend_below, legend_entry, mark, plot, printed_mark, trials, zero
from marsedl.plotting.ellipses import ellipse, probability_inside
from marsedl.plotting.fields import field
from marsedl.plotting.forms import covariance_ellipse, predicted_against_sampled
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, new_figure

PLANE = ("downrange", "altitude")
MEAN = {"color": BLACK, "linewidth": 0.9}
BY_SEGMENT = {"pieces": "segment"}  # of what jumps at the switch
SEGMENT_STYLES = ("-", "--")
VELOCITY_TIME = 2.0  # s, for which the mean velocity is drawn in Fig. 2


def fig01(vehicle: Vehicle, mission: Mission, nominal: Nominal) -> Figure:
    """Change of the mass profile in each pass of Algorithm 3."""
    figure, axes = new_figure()
    mass = field(nominal, "mass_of_pass")
    changes = np.abs(np.diff(mass.values, axis=0))
    for number, (change, shade) in enumerate(zip(changes, np.linspace(1.0, 0.25, len(changes)), strict=True), start=1):
        change_of_mass = mass.of(np.where(change > 0, change, np.nan), "|change of mass|")
        plot(axes, change_of_mass, color=BLUE, alpha=shade, label=f"{number}: {change.max():.1e} kg")
    mark(axes, y=np.spacing(vehicle.wet_mass))
    axes.annotate(
        "spacing of double precision", (0.02, np.spacing(vehicle.wet_mass)), (0, 3), textcoords="offset points",
        xycoords=("axes fraction", "data"), fontsize=8, color=GREY,
    )  # fmt: skip
    mark(axes, x=mission.segment_durations[0])
    axes.set(xlim=(0, nominal.time[-1]), yscale="log", ylim=(1e-14, 1e3))
    axes.legend(title="pass: largest change", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def fig02(given: Inputs, nominal: Nominal) -> Figure:
    """Divert geometry: steered mean path, ballistic path, covariance ellipses and divert radius."""
    figure, axes = new_figure(6.4, 4.8)
    start, final = segments.initial_mean(given.entry), given.mission.final_mean
    # The ballistic arc ends at ground level, which is where the divert radius is measured.
    fall = (start[3] + np.sqrt(start[3] ** 2 + 2 * given.planet.gravity * max(start[1], 0.0))) / given.planet.gravity
    time, impact = np.linspace(0.0, fall, 200), start[0] + start[2] * fall
    arc = start[:2, np.newaxis] + np.outer(start[2:], time) - np.outer([0.0, given.planet.gravity / 2], time**2)
    axes.plot(*arc, color=ORANGE, linestyle="--", label="uncontrolled path")
    plot(axes, nominal, "mean.altitude", x="mean.downrange", color=BLUE, label="steered mean path")
    zero(axes, linewidth=0.8)
    ends = {
        r"$\bar r_0,\ \Sigma_0$": (-9, 9, "right"),
        "intermediate\ntarget": (-9, 0, "right"),
        r"$\bar r_T,\ \Sigma_T$": (9, 0, "left"),
    }
    for mean, covariance, (text, (*offset, side)) in zip(
        *segments.end_conditions(given.entry, given.mission), ends.items(), strict=True
    ):
        axes.plot(*ellipse(mean[:2], covariance[:2, :2], given.drawing.ellipse_sigma).T, color=BLACK, linewidth=0.9)
        axes.annotate(text, mean[:2], offset, textcoords="offset points", ha=side, va="center", fontsize=8)
    arrow = {"arrowstyle": "->", "color": BLACK, "linewidth": 1.2}
    axes.annotate("", start[:2] + VELOCITY_TIME * start[2:], start[:2], arrowprops=arrow)
    axes.annotate(r"$\tilde r(T)$", (impact, 0), (5, 8), textcoords="offset points")
    below_ground = axes.get_xaxis_transform()
    across = {"xycoords": below_ground, "textcoords": below_ground, "color": GREEN}
    axes.annotate("", (impact, 0.09), (final[0], 0.09), arrowprops={"arrowstyle": "<->", "color": GREEN}, **across)
    middle = (impact + final[0]) / 2
    axes.annotate(f"$r_d$ = {abs(impact - final[0]):.0f} m", (middle, 0.09), (middle, 0.02), ha="center", **across)
    legend_entry(axes, f"mean velocity ({VELOCITY_TIME:g} s of it)", color=BLACK, marker=">", markersize=4)
    axes.set_aspect("equal")
    axes.margins(x=0.2)
    axes.set_ylim(bottom=-0.18 * axes.get_ylim()[1])
    legend_below(figure, [axes])
    return figure


def fig03(drawing: Drawing, gains: Gains, closed_loop: FlightEnsemble, open_loop: FlightEnsemble) -> Figure:
    """Trajectories in the plane, closed and open loop, with covariance ellipses along the mean path."""
    panels = [["both", "closed", "switch"], ["both", "closed", "end"]]
    figure, panels = new_figure(8.4, 4.6, mosaic=panels, width_ratios=(1.25, 1, 0.85))
    right, up = (f"kept_history.{component}" for component in PLANE)
    nodes = _ellipse_nodes(drawing, gains)
    opened = trials(panels["both"], open_loop, up, x=right, color=ORANGE, linewidth=0.5, alpha=0.7, label=None)
    for axes in panels.values():
        closed = trials(axes, closed_loop, up, x=right, label=None)
        plot(axes, gains, "mean.altitude", x="mean.downrange", **MEAN)
        for node, at_target in nodes:
            color, width = (BLACK, 1.2) if at_target else (VERMILION, 0.8)
            ellipse_at = {"sigma": drawing.ellipse_sigma, "at": {"time": node}}
            covariance_ellipse(axes, gains, PLANE, **ellipse_at, color=color, linewidth=width, zorder=4)
            positions = _positions_at(closed_loop, gains.time[node])
            axes.plot(*positions.T, ".", color=color, markersize=1.6, zorder=3)
    for name, segment in (("switch", 0), ("end", 1)):
        node = np.flatnonzero(gains.segment == segment)[-1]
        reach = 1.6 * drawing.ellipse_sigma * np.sqrt(np.diag(gains.covariance[node])[:2])
        lower, upper = gains.mean[node, :2] - reach, gains.mean[node, :2] + reach
        panels[name].set(
            xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), title=f"target at {gains.time[node]:g} s"
        )
    for name, title in (("both", "closed and open loop"), ("closed", "closed loop")):
        panels[name].set_aspect("equal", adjustable="datalim")
        panels[name].set_title(title)
    panels["closed"].set_ylabel("")
    panels["switch"].set_xlabel("")
    zero(panels["both"], linewidth=0.8)
    sigma = drawing.ellipse_sigma
    size = f"{sigma:g}-sigma ellipses ({100 * probability_inside(sigma):.1f} %)"
    for color, label, marker in (
        (BLUE, f"closed loop ({closed} flights)", ""),
        (ORANGE, f"open loop ({opened} flights)", ""),
        (BLACK, f"mean path; {size} and flights at the targets", "."),
        (VERMILION, "the same in between", "."),
    ):
        legend_entry(panels["both"], label, color=color, marker=marker)
    legend_below(figure, [panels["both"]], columns=2)
    return figure


def fig04(mission: Mission, closed_loop: FlightEnsemble, gains: Gains, published=None) -> Figure:
    """State components of a selection of closed-loop trials over time; published: to mark the final means of Eq. 54."""
    figure, panels = new_figure(7.2, 4.8, nrows=2, ncols=2, sharex=True)
    for component, axes in zip(MOTION.names, panels.flat, strict=True):
        trials(axes, closed_loop, f"kept_history.{component}")
        plot(axes, gains, f"mean.{component}", label="mean of the design", **MEAN)
    for axes, value in zip(panels.flat, published["mc_final_mean"].printed if published else (), strict=False):
        printed_mark(axes, x=gains.time[-1], y=value, label="final mean, printed")
    mark(*panels.flat, x=mission.segment_durations[0])
    panels[0, 0].set_xlim(0, gains.time[-1])
    legend_below(figure, panels[0, :1])
    return figure


def fig05(mission: Mission, closed_loop: FlightEnsemble, nominal: Nominal, published=None) -> Figure:
    """Mass of the same trials over time, with the prior profile.

    published: the printed claims by id, to mark the printed final masses as well.
    """
    figure, (masses, difference) = new_figure(7.2, 3.4, ncols=2)
    prior = field(nominal, "mass")
    mass, mean = field(closed_loop, "kept_history.mass"), field(closed_loop, "mean.mass")
    trials(masses, mass)
    plot(masses, prior, label="prior profile", **MEAN)
    trials(difference, mass.minus(prior, "mass minus prior profile"), label=None)
    plot(difference, mean.minus(prior), color=VERMILION, label=f"mean of {closed_loop.count:,} flights")
    plot(masses, mean, color=VERMILION)
    zero(difference, linewidth=0.9)
    mark(masses, difference, x=mission.segment_durations[0])
    if published:
        printed_mean, printed_prior = (published[id].printed for id in ("mc_mean_final_mass", "prior_final_mass"))
        end = nominal.time[-1]
        printed_mark(masses, x=end, y=printed_mean, label=f"mean, printed: {printed_mean:,} kg")
        printed_mark(masses, x=end, y=printed_prior, label=f"prior, printed: {printed_prior:,} kg", marker="+")
        printed_mark(difference, x=end, y=printed_mean - printed_prior, label=None)
    for axes in (masses, difference):
        axes.set(xlim=(0, nominal.time[-1]))
    legend_below(figure, (masses, difference))
    return figure


def fig06a(mission: Mission, gains: Gains) -> Figure:
    """Feedback gains over time, both axes."""
    figure, panels = new_figure(7.2, 3.4, ncols=2)
    for axes, name, pair in (
        (panels[0], "position gain", ("downrange.downrange", "vertical.altitude")),
        (panels[1], "velocity gain", ("downrange.downrange_velocity", "vertical.vertical_velocity")),
    ):
        for path, color, style, label in zip(pair, (BLUE, ORANGE), SEGMENT_STYLES, PLANE, strict=True):
            plot(axes, gains, f"gain.{path}", name=name, **BY_SEGMENT, color=color, linestyle=style, label=label)
        axes.set(xlim=(0, gains.time[-1]))
        axes.legend()
    zero(*panels)
    mark(*panels, x=mission.segment_durations[0])
    return figure


def fig06b(given: Inputs, closed_loop: FlightEnsemble) -> Figure:
    """Control magnitude as a fraction of the maximum thrust: mean, upper percentile and maximum over the trials."""
    figure, axes = new_figure()
    level, name = given.drawing.thrust_percentile, f"control magnitude / {given.vehicle.maximum_thrust:,.0f} N"
    mean, largest = (
        field(closed_loop, f"{name}.thrust", **BY_SEGMENT) for name in ("observed_mean", "maximum_over_trials")
    )
    percentile, _ = histogram_percentile(closed_loop.histogram[:, THRUST], closed_loop.histogram_edges[THRUST], level)
    for thrust, color, label in (
        (mean, BLACK, "mean"),
        (mean.of(percentile), BLUE, f"{100 * level:g} % of the flights below"),
        (largest, VERMILION, "maximum"),
    ):
        plot(axes, thrust.of(thrust.values / given.vehicle.maximum_thrust, name, "1"), color=color, label=label)
    mark(axes, y=1.0, linewidth=1.2, label="maximum thrust")
    mark(axes, x=given.mission.segment_durations[0])
    axes.set(xlim=(0, closed_loop.time[-1]), title=f"{closed_loop.count:,} flights")
    axes.set_ylim(bottom=0)
    axes.legend()
    return figure


def fig07(
    mission: Mission,
    gains: Gains,
    closed_loop: FlightEnsemble,
    closed_loop_large: FlightEnsemble | None = None,
    published=None,
) -> Figure:
    """Predicted and measured variances of downrange and altitude, with the sampling band of the prediction.

    published: to mark the final variances of Eq. 54.
    """
    printed = published["mc_final_cov_diag"].printed[:2] if published else ()
    flights = closed_loop_large or closed_loop
    figure, panels = new_figure(7.2, 5.0, nrows=2, ncols=2, sharex=True, height_ratios=(2, 1))
    for component, color, (variance, ratio) in zip(PLANE, (BLUE, ORANGE), panels.T, strict=True):
        predicted, sampled = (
            field(record, f"covariance.{component}", name=f"variance of {component}") for record in (gains, flights)
        )
        predicted_against_sampled(
            variance, ratio, predicted, sampled, flights.count, color=color, label="predicted (Eq. 40)"
        )
    for variance, value in zip(panels[0], printed, strict=False):
        printed_mark(variance, x=gains.time[-1], y=value, label=f"final, printed: {value:g} m²")
    for variance in panels[0]:
        variance.legend()
    mark(*panels.flat, x=mission.segment_durations[0])
    panels[0, 0].set_xlim(0, gains.time[-1])
    return figure


def fixed_point(studies: Studies, fixed_point: FixedPointStudy, gains: Gains) -> Figure:
    """Iterations of Algorithm 1 against the noise density, beside the closed form that needs none."""
    figure, (iterations, errors) = new_figure(7.6, 3.6, ncols=2)
    orders = {"gauss_seidel": (BLUE, "o", "Gauss-Seidel order"), "jacobi": (ORANGE, "s", "Jacobi order, as printed")}
    tolerance = f"iterations to a relative {studies.fixed_point_tolerance:.0e}"
    for number, order in enumerate(fixed_point.order):
        color, marker, name = orders[str(order)]
        for segment, style in enumerate(SEGMENT_STYLES):
            run = {"at": {"order": number, "segments": segment}}
            curve = {"color": color, "marker": marker, "linestyle": style, "markersize": 3}
            count = field(fixed_point, "sweep_iterations", name=tolerance, **run)
            converged = count.of(np.where(field(fixed_point, "sweep_converged", **run).values, count.values, np.nan))
            plot(iterations, converged, **curve, label=f"{name}, segment {segment + 1}")
            plot(
                errors,
                fixed_point,
                "sweep_error",
                name="error of the Riccati solution\nagainst the closed form",
                **run,
                **curve,
            )
    both = iterations, errors
    for segment, style in enumerate(SEGMENT_STYLES):
        mark(*both, x=fixed_point.critical_density[segment], linestyle=style)
    if fixed_point.density[0] < gains.noise_density_plant < fixed_point.density[-1]:
        mark(*both, x=gains.noise_density_plant, color=GREEN, linewidth=0.9, linestyle="-")
    for axes in both:
        axes.set(xscale="log", yscale="log")
    legend_entry(
        iterations, "largest density at which the Riccati solution is singular at the start", color=GREY, linewidth=0.8
    )
    legend_entry(iterations, "this reading", color=GREEN, linewidth=0.9)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


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
