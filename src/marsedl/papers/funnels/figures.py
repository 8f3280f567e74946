"""Figures of the paper, and those beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import SymmetricalLogLocator

from marsedl.papers.funnels.basics import COMPLETE, LEVEL
from marsedl.papers.funnels.inputs import Mission, Planet, Studies
from marsedl.papers.funnels.records import (
    STATE,
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Linearization,
    Nominal,
    Proven,
)
from marsedl.plotting.curves import SHADE, bounds, legend_below, legend_entry, mark, plot, trials, zero
from marsedl.plotting.ellipses import ellipse
from marsedl.plotting.fields import Field, field
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from marsedl.replication.units import DEGREE, KM, converted

LARGEST_LEVEL = "largest $V$"
HEAT = "W/cm^2"
ON_GROUND = {"longitude": "downrange", "latitude": "crossrange"}  # angles that are shown as distances
SHOWN_UNIT = {"altitude": "km", "flight_path_angle": "deg", "heading": "deg"}
FLIGHT = {"color": VERMILION, "linewidth": 0.4, "alpha": 0.6}
END = {"color": VERMILION, "marker": "_", "linestyle": "none", "markersize": 9}
LIMIT = {"linewidth": 1.2, "linestyle": "--"}
DRAWN_FLIGHTS = 40
DRAWN_SLICES = 10  # of the Dubins car
FAR = 2.5  # times what else is drawn, beyond which a funnel leaves the axes
END_SHARE = 0.2  # of the flight, in the enlarged part of Fig. 1
LARGEST_DRAWN = 20.0  # km: slices that are larger leave the axes of Fig. 1
FALLING = "#cfe6f5"  # where V falls, in Fig. 4


# ---- figures of the paper --------------------------------------------------------------------------------------------


def fig01(planet: Planet, mission: Mission, linearization: Linearization, funnel: Funnel) -> Figure:
    """Slices of the funnel in downrange and altitude, the end of it enlarged, and how high the slices are."""
    panels = [["whole", "end"], ["height", "end"]]
    figure, panels = new_figure(7.8, 4.4, mosaic=panels, width_ratios=(1.9, 1), height_ratios=(2, 1))
    whole, end, height = (panels[name] for name in ("whole", "end", "height"))
    angle = field(linearization, "state.longitude").values - mission.entry_longitude
    path = field(linearization, "state.altitude", unit="km", x=_deviation(planet, "longitude", angle))
    points = np.stack([path.x.values, path.values], axis=1)
    ellipses = _in_plane(planet, funnel)
    late = int((1.0 - END_SHARE) * len(funnel.step))
    for axes, first in ((whole, 0), (end, late)):
        largest = np.zeros(2)
        for step, matrix in zip(funnel.step[first:], ellipses[first:], strict=True):
            # A funnel may end early; its slices may be of any size.
            if np.isfinite(matrix).all():
                outline = ellipse(points[2 * step], matrix, 1.0)
                axes.add_patch(Polygon(outline, facecolor=SKY, edgecolor=BLUE, linewidth=0.4, alpha=0.3))
                largest = np.maximum(largest, np.minimum(np.sqrt(np.diag(matrix)), LARGEST_DRAWN))
        start = 2 * funnel.step[first]
        plot(axes, path.where(slice(start, None)), color=BLACK, linewidth=1.0, label="nominal")
        if not first:
            axes.plot(*points[0], "o", color=VERMILION, markersize=5, zorder=5, label="entry")
        axes.plot(*points[-1], "s", color=VERMILION, markersize=5, zorder=5, label="deployment of the parachute")
        lower, upper = points[start:].min(axis=0) - 1.3 * largest, points[start:].max(axis=0) + 1.3 * largest
        axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))
    whole.add_patch(Polygon(np.empty((1, 2)), facecolor=SKY, edgecolor=BLUE, linewidth=0.4, alpha=0.5, label="slices"))
    at_slices = path.where(2 * funnel.step)
    half_height = at_slices.of(np.sqrt(ellipses[:, 1, 1]), "altitude less\nthat of the nominal")
    bounds(height, *_about_zero(half_height), filled=True, color=SKY, alpha=0.3)
    bounds(height, *_about_zero(half_height), color=BLUE, marker=".", markersize=2, linewidth=0.4)
    zero(height, linewidth=1.0)
    reach = 1.1 * min(np.nanmax(half_height.values, initial=0.0) or 1.0, LARGEST_DRAWN)
    height.set(xlim=whole.get_xlim(), ylim=(-reach, reach))
    whole.set_xlabel("")
    widest = np.sqrt(np.nanmax(np.diagonal(ellipses, axis1=1, axis2=2), initial=0.0))
    remarks = [_end_of_funnel(funnel), f"slices of up to $\\pm${widest:.2g} km" if widest > LARGEST_DRAWN else ""]
    whole.set_title("; ".join(filter(None, remarks)), loc="left")
    end.set_title(f"the last {100 * END_SHARE:.0f} % of the flight")
    legend_below(figure, [whole], columns=4)
    return figure


def fig02(dubins: Dubins, dubins_calm: FlightEnsemble) -> Figure:
    """Slices of the funnel of the Dubins car in x, y and heading, with flights inside."""
    figure, axes = new_figure(5.6, 4.4, subplot_kw={"projection": "3d", "computed_zorder": False})
    unit = np.array([1.0, 1.0, DEGREE])
    path = dubins.state[::2]
    number = list(dubins.funnel).index("flow")
    places = np.linspace(0, len(dubins.slice_step) - 1, DRAWN_SLICES + 1).round().astype(int)
    slice_steps = dubins.slice_step[np.unique(places)]  # the first and the last always
    latitude, longitude = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 15), np.linspace(0.0, 2.0 * np.pi, 25))
    sphere = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    for step in slice_steps:
        level = dubins.level[number, list(dubins.slice_step).index(step)]
        half_axes = np.sqrt(2.0 * level) * np.linalg.inv(np.linalg.cholesky(dubins.shape[step])).T
        surface = path[step][:, np.newaxis] + half_axes @ sphere.reshape(3, -1)
        surface = (surface / unit[:, np.newaxis]).reshape(sphere.shape)
        axes.plot_surface(*surface, color=SKY, alpha=0.12, linewidth=0, rstride=1, cstride=1, rasterized=True)
        axes.plot_wireframe(*surface, color=BLUE, alpha=0.25, linewidth=0.3, rstride=6, cstride=7)
    for flight in path + dubins_calm.kept_history[:DRAWN_FLIGHTS]:
        axes.plot(*(flight / unit).T, color=ORANGE, linewidth=0.5)
    axes.plot(*(path / unit).T, color=BLACK, linewidth=1.6, label="nominal")
    legend_entry(axes, _kept(dubins_calm), color=ORANGE, linewidth=0.8)
    legend_entry(axes, f"{len(slice_steps)} of {len(dubins.slice_step)} slices", color=SKY, linewidth=6, alpha=0.5)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="heading (deg)")
    axes.view_init(elev=24, azim=-62)
    axes.set_box_aspect((4, 3, 2.6), zoom=0.92)
    legend_below(figure, [axes])
    return figure


def fig03(funnel: Funnel, constant: FlightEnsemble) -> Figure:
    """Level of the funnel and largest V of the flights, over the steps of the funnel."""
    figure, panels = new_figure(7.6, 3.8, ncols=2)
    step = funnel.time[1]
    number = Field(np.arange(len(funnel.step)) + 1.0, "time step $k$", "1")
    level = field(funnel, "level", name=r"funnel boundary $\rho$", x=number)
    largest = Field(_largest_observed(constant, "level"), LARGEST_LEVEL, "1", number.of(1.0 + constant.time / step))
    tenths = [largest.of(values) for values in _extremes(constant.repeat_maximum[:, :, LEVEL])]
    panels[1].set_yscale("log")
    for axes in panels:
        plot(axes, level, marker=".", color=BLUE, markersize=3, label="SOS-sampling")
        plot(axes, largest, color=VERMILION, label=f"Monte Carlo, largest of {_flights(constant)}")
        bounds(axes, *tenths, filled=True, color=VERMILION, label="largest of each tenth of them")
        axes.set_xlim(number.values[[0, -1]])
        # Slices are evenly spaced, so that both axes are linear.
        times = axes.secondary_xaxis("top", functions=(lambda k: (k - 1.0) * step, lambda time: 1.0 + time / step))
        times.set_xlabel(field(funnel, "time").label)
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_formatter("{x:g}")
    legend_below(figure, panels[:1])
    if remark := _end_of_funnel(funnel):
        panels[0].text(0.02, 0.96, remark, transform=panels[0].transAxes, va="top")
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
    panels[0].add_patch(Polygon(np.empty((1, 2)), facecolor=FALLING, label="$V$ falls"))
    legend_entry(panels[0], f"slice $B_{{{studies.fig4_slice}}}$ in the plane", color=BLACK)
    dots = {"linestyle": "none", "markersize": 3}
    for label, color, marker in (
        ("its points, $V$ falls", BLUE, "o"),
        ("its points, $V$ does not fall", VERMILION, "o"),
        (f"{len(projected)} samples, projected", GREY, "."),
    ):
        legend_entry(panels[0], label, color=color, marker=marker, **dots)
    legend_below(figure, panels[:1])
    return figure


# ---- beyond the paper ------------------------------------------------------------------------------------------------


def nominal(mission: Mission, linearization: Linearization, nominal: Nominal) -> Figure:
    """The nominal over time."""
    figure, panels = new_figure(6.4, 4.6, nrows=2, ncols=2)
    altitude, velocity, bank, heat = panels.flat
    last = linearization.half_time[-1]
    for axes, path, unit in (
        (altitude, "state.altitude", "km"),
        (velocity, "state.velocity", "m/s"),
        (bank, "bank", "deg"),
        (heat, "heat_rate", HEAT),
    ):
        plot(axes, linearization, path, unit=unit, x="half_time", color=BLUE)
        axes.set_xlim(0.0, last)
    mark(bank, y=mission.bank_bounds / DEGREE, **LIMIT)
    limit = float(converted(nominal.heat_rate_limit, "W/m^2", HEAT))
    mark(heat, y=limit, **LIMIT)
    at_nodes = field(nominal, "heat_rate", unit=HEAT).values.max()
    heat.set_title(f"at the nodes at most {at_nodes:.3f}, limit {limit:g}")
    return figure


def bands(planet: Planet, funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble) -> Figure:
    """Half widths of the funnel in every state, with flights inside and what linear dynamics say."""
    figure, panels = new_figure(8.4, 5.4, nrows=2, ncols=3, sharex=True)
    beyond = False
    places = {
        "half_width": field(funnel, "time"),
        "exact_half_width": field(linear_bounds, "slice_time"),
    }
    for number, (component, axes) in enumerate(zip(STATE.names, panels.flat, strict=True)):
        width, linear = (
            _deviation(planet, component, getattr(record, name)[:, number], places[name])
            for record, name in zip((funnel, linear_bounds), places, strict=True)
        )
        bounds(axes, *_about_zero(width), filled=True, color=BLUE)
        bounds(axes, *_about_zero(width), color=BLUE, linewidth=0.8)
        bounds(axes, *_about_zero(linear), color=BLACK, linestyle="--", linewidth=0.8)
        histories = constant.kept_history[:DRAWN_FLIGHTS, :, number]
        trials(axes, _deviation(planet, component, histories, field(constant, "time")), label=None, **FLIGHT)
        ends = _deviation(planet, component, constant.final_state[:, number]).values
        if np.isfinite(ends).any():
            axes.plot(np.full(2, constant.time[-1]), _extremes(ends), clip_on=False, **END)
        # A funnel that fails may have slices of any size.
        widest, most = np.nanmax(width.values, initial=0.0), FAR * linear.values.max()
        beyond = beyond or widest > most
        reach = 1.08 * min(widest or most, most)
        axes.set(xlim=(0.0, funnel.time[-1]), ylim=(-reach, reach))
    axes = panels[0, 0]
    axes.fill_between([], [], [], color=BLUE, alpha=SHADE, label="funnel" + (", beyond the axes" if beyond else ""))
    legend_entry(axes, "the same for linear dynamics", color=BLACK, linestyle="--", linewidth=0.8)
    legend_entry(axes, f"{_kept(constant)}, from all of the first slice", color=VERMILION, linewidth=0.8)
    legend_entry(axes, "extremes of all flights at the end", **END)
    legend_below(figure, [axes], columns=2)
    return figure


def heating(nominal: Nominal, linearization: Linearization, funnel: Funnel, constant: FlightEnsemble) -> Figure:
    """Heat rate of the nominal, of the flights, and the largest on the funnel."""
    figure, axes = new_figure(6.4, 3.8)
    limit = float(converted(nominal.heat_rate_limit, "W/m^2", HEAT))
    reference = field(linearization, "heat_rate", unit=HEAT, x="half_time")
    on_funnel = field(funnel, "heat_rate", unit=HEAT, x="time")
    peak = field(nominal, "peak_heat_rate", unit=HEAT).values  # between the points that are drawn, too
    largest = converted(_largest_observed(constant, "heat_rate"), "W/m^2", HEAT)
    flights = Field(largest, reference.name, HEAT, field(constant, "time"))
    mark(axes, y=limit, label=f"limit of the nominal, {limit:g}", **LIMIT)
    plot(axes, reference, color=BLACK, label=f"nominal, up to {peak:.2f}")
    plot(axes, flights, color=VERMILION, label=f"{_flights(constant)}, up to {_largest(largest)}")
    dots = {"marker": ".", "color": BLUE, "markersize": 3}
    plot(axes, on_funnel, **dots, label=f"funnel, up to {_largest(on_funnel.values)}")
    axes.set_xlim(0.0, funnel.time[-1])
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
    flights = _largest_level(constant)
    at_slices = {"x": "slice_time"}
    for level, color, style, label in (
        (field(funnel, "level", x="time"), BLUE, "-", "funnel by sums of squares"),
        (field(proven, "level", x="time"), SKY, "-", "proven"),
        (field(linear_bounds, "triangle_level", **at_slices), GREEN, "-.", "linear, triangle inequality"),
        (field(linear_bounds, "exact_level", **at_slices), BLACK, "--", "linear, exact"),
        (field(linear_bounds, "undisturbed_level", **at_slices), GREY, ":", "linear, without disturbance"),
        (_largest_level(adversarial), ORANGE, "-", _flights(adversarial, "adversary")),
        (flights, VERMILION, "--", _flights(constant, "constant disturbance")),
        (_largest_level(redrawn), PURPLE, "-", _flights(redrawn, "redrawn")),
    ):
        style = {"color": color, "linestyle": style}
        relative = level.of(level.values / flights.at(level).values, "relative to flights with constant disturbance")
        plot(levels, level, **style, label=label)
        plot(ratio, relative, **style)
    for axes in (levels, ratio):
        axes.set(yscale="log", xlim=(0.0, funnel.time[-1]))
    legend_below(figure, [levels], columns=2)
    return figure


def proven(funnel: Funnel, proven: Proven) -> Figure:
    """Proven level over that of the funnel, and what the proof adds to the bound of every stage."""
    figure, (levels, parts) = new_figure(7.6, 3.8, ncols=2)
    level, name = field(funnel, "level", x="time"), "proven level over that of the funnel"
    nodes, slices = field(proven, "node_level", x="node_time"), field(proven, "level", x="time")
    ratio = nodes.of(nodes.values / level.at(nodes).values, name)
    if np.nanmin(ratio.values, initial=1.0) < 1.0 / FAR:  # of a funnel that is far off
        levels.set_yscale("log")
    plot(levels, ratio, color=BLUE, label="at all nodes")
    dots = {"color": VERMILION, "marker": ".", "linestyle": "none"}
    plot(levels, slices.of(slices.values / level.values, name), **dots, label="at the slices")
    mark(levels, y=1.0, linestyle="-")
    levels.legend()
    starts, nothing = field(proven, "time").where(slice(-1)), []
    for path, color, label in (
        ("truncation", BLUE, "known terms of higher degree"),
        ("remainder", VERMILION, "remainder"),
        ("rise", GREEN, "inside of the slice"),
    ):
        part = field(proven, path, name=r"added to the bound of a stage, over $\rho$", x=starts)
        # What is zero has no place on a logarithmic axis.
        positive = part.of(np.where(part.values > 0.0, part.values, np.nan))
        if np.isfinite(positive.values).any():
            plot(parts, positive, marker=".", color=color, label=label)
        else:
            nothing.append(label)
    parts.set_yscale("log")
    if nothing:
        parts.set_title("nothing for: " + ", ".join(nothing), loc="left")
    if len(nothing) < 3:
        legend_below(figure, [parts])
    for axes in (levels, parts):
        axes.set_xlim(0.0, proven.time[-1])
    if not proven.proven:
        count = np.count_nonzero(np.isfinite(proven.bound))
        levels.set_title(f"proven for {count} of {len(proven.bound)} stages", loc="left")
    return figure


def dubins_rho(
    dubins: Dubins, dubins_study: DubinsStudy, dubins_calm: FlightEnsemble, dubins_wind: FlightEnsemble
) -> Figure:
    """Levels of the Dubins car without and with wind: funnels, linear dynamics, flights, and proven."""
    figure, panels = new_figure(7.6, 5.4, nrows=2, ncols=2, sharex=True, sharey="row", height_ratios=(1, 1.2))
    at_slices = {"x": field(dubins, "slice_time")}
    funnels = list(dubins.funnel)
    for column, (base, flights, title) in enumerate(
        (("flow", dubins_calm, "without wind"), ("wind", dubins_wind, "with wind"))
    ):
        number = {"funnel": funnels.index(base)}
        reference = field(dubins, "level", at=number, **at_slices)
        curves = [(reference, "funnel", {"color": BLUE})]
        if base == "flow":
            euler = field(dubins, "level", at={"funnel": funnels.index("euler")}, **at_slices)
            backwards = field(dubins_study, "backward_level", **at_slices)
            # Broad, as it lies below the funnel.
            curves.append((backwards, "backwards from its end", {"color": SKY, "linewidth": 4.0, "zorder": 1.5}))
            curves.append((euler, "Euler step", {"color": ORANGE}))
        if base in dubins_study.proven_funnel:
            place = {"proven": list(dubins_study.proven_funnel).index(base)}
            level = field(dubins_study, "proven_level", at=place, **at_slices)
            curves.append((level, "proven", {"color": GREEN, "linestyle": "-."}))
        linear = field(dubins_study, "linear_level", at=number, **at_slices)
        curves.append((linear, "linear, exact", {"color": BLACK, "linestyle": "--"}))
        curves.append((_largest_level(flights), "largest of the flights", {"color": VERMILION}))
        levels, ratios = panels[:, column]
        for level, label, style in curves:
            percent = 100 * (level.values / reference.at(level).values - 1.0)
            plot(levels, level, **style, label=label)
            plot(ratios, level.of(percent, "relative to the funnel,\nlogarithmic beyond 1 %", "%"), **style)
        levels.set_title(f"{title}; {_flights(flights)}")
        ratios.set_xlim(dubins.slice_time[[0, -1]])
    panels[0, 0].set_ylim(bottom=0.0)
    # Turns from linear to logarithmic smoothly, so that no curve has a kink that is not its own.
    panels[1, 0].set_yscale("asinh", linear_width=1.0)
    panels[1, 0].yaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=1.0))
    panels[1, 0].yaxis.set_major_formatter("{x:g}")
    legend_below(figure, panels[0, :1])
    return figure


# ---- parts of figures ------------------------------------------------------------------------------------------------


def _in_plane(planet: Planet, funnel):
    """Matrices E of the slices {x'E^-1 x <= 1} projected on downrange and altitude, km^2, (slices, 2, 2)."""
    components = [STATE.index("longitude"), STATE.index("altitude")]
    inverse = np.linalg.inv(funnel.shape)[:, components][:, :, components]
    scale = np.array([planet.planet_radius / KM, 1.0 / KM])
    return 2.0 * funnel.level[:, np.newaxis, np.newaxis] * inverse * np.outer(scale, scale)


def _deviation(planet: Planet, component, values, x=None):
    """Deviations of a state of the entry in the unit that is shown, those of angles on the ground as distances."""
    stored_unit = STATE.units[component]
    if component in ON_GROUND:
        return Field(values * (planet.planet_radius / KM), ON_GROUND[component], "km", x)
    unit = SHOWN_UNIT.get(component, stored_unit)
    return Field(converted(values, stored_unit, unit), STATE.label(component), unit, x)


def _about_zero(width):
    """Minus and plus a half width."""
    return width.of(-width.values), width


def _largest_level(ensemble):
    """Largest V of the flights over time."""
    return Field(_largest_observed(ensemble, "level"), LARGEST_LEVEL, "1", field(ensemble, "time"))


def _largest_observed(ensemble, name):
    """The largest value over the trials of what is observed under a name, over time."""
    return ensemble.maximum_over_trials[:, ensemble.observed_name.tolist().index(name)]


def _largest(values):
    """The largest of some values as text, if there is one."""
    return f"{np.nanmax(values):.4g}" if np.isfinite(values).any() else "nothing"


def _extremes(values):
    """Least and largest of some curves (curves, time), which may all be without a number somewhere."""
    return np.fmin.reduce(values), np.fmax.reduce(values)


def _kept(ensemble):
    """How many flights are drawn, of how many."""
    return f"{min(DRAWN_FLIGHTS, len(ensemble.kept_history))} of {_flights(ensemble)}"


def _end_of_funnel(funnel):
    """Why a funnel is not complete, shortly; nothing if it is."""
    return "" if funnel.outcome == COMPLETE else f"the funnel ends at slice {np.isfinite(funnel.level).sum()}"


def _flights(ensemble, kind=""):
    """How many flights there are, and how many are lost."""
    lost = f" ({ensemble.excluded:,} lost)" if ensemble.excluded else ""
    return f"{len(ensemble.outcome):,} flights{lost}" + (f", {kind}" if kind else "")
