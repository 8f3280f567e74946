"""Figures of the paper, and those beyond it. Each function draws one file from artifacts."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.models import density_variation, orbits, random_field
from marsedl.papers.random_field import double_integrator as linear_example
from marsedl.papers.random_field import environment, flight_statistics
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.flight_statistics import LEVEL
from marsedl.papers.random_field.inputs import Air, Drawing, Inputs, Mission, Planet, PointMass, Simulation, Vehicle
from marsedl.papers.random_field.records import (
    BRANCHES,
    DoubleIntegrator,
    DoubleIntegratorFlights,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
)
from marsedl.papers.random_field.sketches import fig06, fig07, fig08  # noqa: F401 -- figures, too
from marsedl.plotting.curves import (
    OPAQUE,
    PRINTED_LINE,
    SHADE,
    bounds,
    legend_below,
    legend_entry,
    mark,
    note,
    plot,
    printed_mark,
    trials,
)
from marsedl.plotting.fields import field, sigma_bounds, standard_deviation
from marsedl.plotting.forms import covariance_ellipse, distribution
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from marsedl.replication.units import KM, converted

ALTITUDE_LABEL = "altitude (km)"  # of what is drawn upwards, against the altitude
# Streams of what is only drawn, apart from those of the flights and of the certificates.
LINE_STREAM, NOISE_STREAM, PLANE_STREAM, VARIATION_STREAM, FORCE_STREAM = range(6, 11)
LINE_POINTS = 251
PLANE_POINTS = 41  # along each coordinate
SHOWN_PERIODS = 3  # of the double integrator's force, in Fig. 4
ALTITUDE_STEP = 100.0  # m, of the profiles over altitude
SCHEMATIC_SAMPLES = 3  # at most, in Fig. 3
MARK_INTERVAL = 50.0  # s, between the marked points of Fig. 3
LAW_TITLE = ("open loop", "closed loop")
ITERATION_COLOR = (SKY, ORANGE, VERMILION, PURPLE)
MOST_ITERATIONS = len(ITERATION_COLOR)  # drawn side by side; of more, some are left out, never first and last
OPEN_LOOP_LEVELS = (0.0, 0.999)  # of the open loop's delta-v and apoapsis that are shown
REMARKS_FROM = 0.6  # of the height of a panel of Fig. 12: where the remarks on the right end
CONTROLS = (-1.6, 1.6)  # shown; commands of an ill-conditioned law leave any axis
# Component of the flights and of the nominal, component of the design, unit, name of its error.
ERRORS = (
    ("altitude", "radius", "km", "radius"),
    ("velocity", "velocity", "m/s", "velocity"),
    ("flight_path_angle", "flight_path_angle", "deg", "path angle"),
)
BAND = {"color": BLUE, "alpha": SHADE, "linewidth": 0}
INITIAL_GUESS = {"color": BLACK, "linestyle": "--"}
TRIAL = {"color": GREY, "linewidth": 0.5, "alpha": 0.5}
SAMPLED = {"color": BLUE, "linestyle": "--", "label": r"mean $\pm 3 \sigma$ of all flights"}
FAR = 2.5  # times the spread of the flights, beyond which a prediction may leave the axes
PRESSURE_MARGIN = 1.5  # of the nominal's largest dynamic pressure, where the axis ends
APOAPSIS_MARGIN = 0.2  # planet radii about target and nominals, in the closed-loop half of the map
LARGEST_APOAPSIS = 3.0  # times the target, in the open-loop half
MOST_POINTS = 3000  # of each law, in the map


def fig01(simulation: Simulation, drawing: Drawing) -> Figure:
    """Samples of a field on a line, before and after measurements of it."""
    figure, (prior, posterior) = new_figure(7.2, 3.4, ncols=2, sharex=True, sharey=True)
    position, before, after, mean, deviation = line_samples(simulation, drawing)
    one = np.ones_like(position)
    for axes, samples, centre, spread in ((prior, before, 0.0 * one, one), (posterior, after, mean, deviation)):
        axes.fill_between(position, centre - 2 * spread, centre + 2 * spread, label=r"mean $\pm 2 \sigma$", **BAND)
        axes.plot(position, centre, color=BLACK, linestyle="--", label="mean")
        axes.plot(position, samples.T, color=BLUE, linewidth=0.7, alpha=0.8)
        axes.plot([], [], color=BLUE, linewidth=0.7, label=f"{len(samples)} samples")
        axes.set(xlabel="position $z$", xlim=(0, drawing.example_extent))
    posterior.errorbar(
        drawing.example_positions,
        drawing.example_values,
        2 * drawing.example_noise,
        fmt="o",
        color=VERMILION,
        markersize=4,
        capsize=2,
        zorder=5,
        label=r"measurements $\pm 2 \sigma$",
    )
    prior.set(title="without measurements", ylabel=r"field $\Psi(z)$")
    posterior.set_title("conditioned on measurements")
    handles, labels = posterior.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def fig02(simulation: Simulation, drawing: Drawing) -> Figure:
    """A sample of a field on a plane, before and after its two right-most edges are held constant."""
    figure, panels = new_figure(7.6, 3.5, ncols=2, subplot_kw={"projection": "3d"})
    # The layout of the other figures leaves wide margins about these axes.
    figure.set_layout_engine(None)
    figure.subplots_adjust(left=-0.02, right=0.93, bottom=0.05, top=1.0, wspace=0.1)
    coordinate, before, after = plane_samples(simulation, drawing)
    first, second = np.meshgrid(coordinate, coordinate, indexing="ij")
    lowest, highest = min(before.min(), after.min()), max(before.max(), after.max())
    titles = ("without a condition", f"both edges on the right held at {drawing.example_edge:g}")
    for axes, values, title in zip(panels, (before, after), titles, strict=True):
        axes.computed_zorder = False  # the edges, which lie in the surface, are drawn over it
        axes.plot_surface(
            first,
            second,
            values,
            cmap="viridis",
            vmin=lowest,
            vmax=highest,
            rcount=PLANE_POINTS,
            ccount=PLANE_POINTS,
            edgecolor=BLACK,
            linewidth=0.1,
            zorder=1,
        )
        for edge in (np.s_[-1, :], np.s_[:, -1]):
            axes.plot(first[edge], second[edge], values[edge], color=VERMILION, linewidth=2.2, zorder=2)
        # Seen along the diagonal, the corner where both coordinates are largest is the right-most one.
        axes.view_init(elev=32, azim=-45)
        axes.set_box_aspect((1, 1, 0.6), zoom=0.98)
        axes.set(zlim=(lowest, highest))
        axes.set_title(title, y=0.97)
        axes.set_xlabel("$z_1$", labelpad=-2)
        axes.set_ylabel("$z_2$", labelpad=-2)
        axes.set_zlabel(r"field $\Psi$", labelpad=-5)
        for axis in ("x", "y", "z"):
            axes.tick_params(axis, pad=-1, labelsize=8)
    return figure


def fig03(given: Inputs, nominal: Nominal) -> Figure:
    """Samples of the field over altitude and, seen through the nominal path, of the process over time."""
    figure, panels = new_figure(7.2, 5.4, nrows=2, ncols=2, width_ratios=(1, 1.6), sharex="col", sharey="row")
    (over_altitude, path), (corner, process) = panels
    orders = ("first sample", "second sample", "third sample")
    count = min(given.drawing.drawn_samples, SCHEMATIC_SAMPLES)
    # Down to the lowest altitude and up to the end, so that the samples of the field are those that the path meets.
    altitude = _altitudes(nominal.altitude.min(), nominal.altitude.max())
    samples = variation_samples(given.air, given.simulation, altitude, count)
    met = random_field.interpolate(nominal.altitude, altitude, samples)
    marks = np.searchsorted(nominal.time, np.arange(0.0, nominal.time[-1], MARK_INTERVAL))
    variation = field(nominal, "variation_deviation")
    height = field(nominal, "altitude", unit="km", name="altitude $z$")
    for sample, along_path, color, order in zip(samples, met, (BLUE, ORANGE, GREEN), orders, strict=False):
        dots = {"color": color, "markersize": 4, "markeredgecolor": BLACK, "markeredgewidth": 0.5, "zorder": 4}
        over_time = variation.of(along_path)
        over_altitude.plot(sample, altitude / KM, color=color, linewidth=0.9)
        over_altitude.plot(along_path[marks], height.values[marks], "o", **dots)
        plot(process, over_time, color=color, linewidth=0.9)
        legend_entry(corner, order, color=color, linewidth=0.9)
        plot(process, over_time.where(marks), marker="o", linestyle="none", **dots)
    plot(path, height, color=BLACK)
    plot(path, height.where(marks), marker="o", linestyle="none", color=BLACK, markersize=4)
    mark(path, process, x=nominal.time[marks], linewidth=0.5)
    mark(path, over_altitude, y=height.values[marks], linewidth=0.5)
    over_altitude.set(title=r"field $\Psi(z)$", ylabel=height.label, xlabel=variation.label)
    over_altitude.tick_params(labelbottom=True)
    path.set_title(r"nominal path $z = \phi(\hat x(t))$")
    process.set(title=r"process $\hat\Psi(t) = \Psi(\phi(\hat x(t)))$", ylabel=variation.label)
    process.set_xlim(0, nominal.time[-1])
    process.tick_params(labelleft=True)
    corner.set_axis_off()
    legend_entry(corner, "nominal path", color=BLACK)
    dots = {"color": GREY, "linestyle": "none", "markeredgecolor": BLACK, "markersize": 4}
    legend_entry(corner, f"every {MARK_INTERVAL:g} s of the path", marker="o", **dots)
    corner.legend(loc="center")
    return figure


def fig04(given: Inputs) -> Figure:
    """Samples of the locally periodic force on the double integrator."""
    figure, axes = new_figure(6.4, 3.4)
    kernel = linear_example.kernel(given.point_mass)
    position = np.linspace(0.0, SHOWN_PERIODS * given.point_mass.double_integrator_period, LINE_POINTS)
    root = random_field.root(random_field.covariance_matrix(kernel, position))
    normal_numbers = _normals(given.simulation.seed, FORCE_STREAM, np.arange(given.drawing.drawn_samples), LINE_POINTS)
    samples = random_field.sample(normal_numbers, root)
    deviation = np.sqrt(kernel(position, position))
    axes.fill_between(position, -2 * deviation, 2 * deviation, label=r"$\pm 2 \sigma$", **BAND)
    axes.plot(position, samples.T, color=BLUE, linewidth=0.8, alpha=0.8)
    axes.plot([], [], color=BLUE, linewidth=0.8, label=f"{len(samples)} samples")
    axes.set(xlabel="position $r$", ylabel=r"force $\Psi(r)$", xlim=position[[0, -1]])
    axes.ticklabel_format(axis="y", scilimits=(-2, 3), useMathText=True)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def fig05(
    point_mass: PointMass, double_integrator: DoubleIntegrator, double_integrator_flights: DoubleIntegratorFlights
) -> Figure:
    """Double integrator in the plane of position and velocity, without feedback and with the law."""
    figure, panels = new_figure(6.6, 6.8, nrows=2, sharex=True, sharey=True)
    flights, design = double_integrator_flights, double_integrator
    radius, plane = linear_example.ellipse_radius(point_mass), ("position", "velocity")
    reach = []
    for law, axes in enumerate(panels):
        right, up = (f"kept_history.{component}" for component in plane)
        trials(axes, flights, up, x=right, at={"laws": law}, color=SKY, alpha=0.7, zorder=1, label=None)
        for number, node in enumerate(flights.node):
            for record, at, style in (
                (flights, {"time": node}, {"color": GREY, "linewidth": 1.8, "zorder": 3}),
                (design, {"nodes": number}, {"color": BLACK, "linewidth": 1.0, "linestyle": "--", "zorder": 4}),
            ):
                reach.append(covariance_ellipse(axes, record, plane, radius, at={"laws": law} | at, **style))
        reach.append(flights.kept_history[law, :, :, :2].reshape(-1, 2))
        not_finite = f", {flights.excluded[law]:,} not finite" if flights.excluded[law] else ""
        axes.set(title=LAW_TITLE[law] + not_finite, ylabel="velocity $v$")
    reach = np.concatenate(reach)
    for line in constraint_lines(point_mass, reach):
        reach = np.concatenate([reach, line])
        for axes in panels:
            axes.plot(*line.T, color=VERMILION, linewidth=1.2, linestyle="--", zorder=2)
    lowest, highest = reach.min(axis=0), reach.max(axis=0)
    margin = 0.04 * (highest - lowest)
    panels[0].set(xlim=(lowest[0] - margin[0], highest[0] + margin[0]))
    panels[0].set(ylim=(lowest[1] - margin[1], highest[1] + margin[1]))
    panels[-1].set_xlabel("position $r$")
    for color, width, style, label in (
        (GREY, 1.8, "-", f"{100 * point_mass.ellipse_probability:g} % ellipse, {flights.count[0]:,} flights"),
        (BLACK, 1.0, "--", "the same by linear covariance"),
        (SKY, 0.8, "-", f"{flights.kept_history.shape[1]} of the flights"),
        (VERMILION, 1.2, "--", "state constraints"),
    ):
        legend_entry(panels[0], label, color=color, linewidth=width, linestyle=style)
    legend_below(figure, [panels[0]], columns=2)
    return figure


def fig09(air: Air, vehicle: Vehicle) -> Figure:
    """Mean density against altitude."""
    figure, axes = new_figure(4.8, 4.2)
    altitude = _altitudes(0.0, _ceiling(air, vehicle))
    density = np.exp(environment.profile(air)(altitude)[0])
    axes.semilogx(density, altitude / KM, color=BLUE, label="nominal density", zorder=3)
    if air.density_profile == "table":
        table = np.asarray(air.density_table)
        in_range = (table[:, 0] >= altitude[0]) & (table[:, 0] <= altitude[-1])
        axes.plot(
            table[in_range, 1],
            table[in_range, 0] / KM,
            "o",
            color=ORANGE,
            markersize=5,
            fillstyle="none",
            label="table",
        )
    axes.set(xlabel="density (kg/m$^3$)", ylabel=ALTITUDE_LABEL, ylim=(0, altitude[-1] / KM))
    axes.legend(loc="upper right")
    return figure


def fig10(given: Inputs) -> Figure:
    """Samples of the density variation against altitude."""
    figure, (axes, apart) = new_figure(7.4, 4.2, ncols=2, sharey=True)
    altitude = _altitudes(0.0, _ceiling(given.air, given.vehicle))
    samples = variation_samples(given.air, given.simulation, altitude, given.drawing.drawn_samples)
    deviation = environment.deviation(given.air, altitude)
    axes.fill_betweenx(
        altitude / KM, -2 * deviation, 2 * deviation, color=BLUE, alpha=0.22, linewidth=0, label=r"$\pm 2 \sigma$"
    )
    distance = 1.2 * np.abs(samples).max()
    for number, sample in enumerate(samples):
        axes.plot(sample, altitude / KM, color=BLUE, linewidth=0.6, alpha=0.8)
        apart.plot(number + 1 + sample / distance, altitude / KM, color=BLUE, linewidth=0.6)
    axes.plot([], [], color=BLUE, linewidth=0.6, label=f"{len(samples)} samples")
    least, largest = axes.get_xlim()
    if least < -1.0:
        axes.axvline(-1.0, color=VERMILION, linewidth=0.9, linestyle="--", label="no density left")
        axes.set_xlim(least, largest)
    axes.set(xlabel="density variation, relative to the mean (1)", ylabel=ALTITUDE_LABEL, ylim=(0, altitude[-1] / KM))
    apart.set(
        title="side by side",
        xlabel=f"samples, density variations of {distance:.2g} apart",
        xticks=range(1, len(samples) + 1),
    )
    legend_below(figure, [axes])
    return figure


# ---- samples ---------------------------------------------------------------------------------------------------------


def _normals(seed, stream, trials, count):
    """Standard normals, (trials, count), imported here: figures that draw no samples need no compiled code."""
    from marsedl.montecarlo.streams import normals

    return normals(seed, stream, trials, count)


def line_samples(simulation: Simulation, drawing: Drawing):
    """The example of Fig. 1: positions (k,), samples without and with measurements from the same numbers (n, k), and
    mean and standard deviation given the measurements (k,); the variance without them is one."""
    kernel = partial(random_field.squared_exponential, variance=1.0, length=drawing.example_length)
    position = np.linspace(0.0, drawing.example_extent, LINE_POINTS)
    measured = drawing.example_positions
    everywhere = np.concatenate([position, measured])
    trials = np.arange(drawing.drawn_samples)
    root = random_field.root(random_field.covariance_matrix(kernel, everywhere))
    before = random_field.sample(_normals(simulation.seed, LINE_STREAM, trials, len(everywhere)), root)
    conditions = (kernel, position, measured, drawing.example_values, drawing.example_noise**2)
    errors = _normals(simulation.seed, NOISE_STREAM, trials, len(measured))
    after = random_field.condition_samples(*conditions, before, errors)
    mean, covariance = random_field.condition(*conditions)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))  # rounding can make a vanishing variance negative
    return position, before[:, : len(position)], after, mean, deviation


def plane_samples(simulation: Simulation, drawing: Drawing):
    """The example of Fig. 2: coordinates (k,) along both axes, and one sample over them (k, k) without a condition and
    held at `example_edge` where either coordinate is largest."""
    coordinate = np.linspace(0.0, drawing.example_extent, PLANE_POINTS)
    along = partial(random_field.squared_exponential, variance=1.0, length=drawing.example_length)
    kernel = partial(random_field.squared_exponential, variance=1.0, length=np.full(2, drawing.example_length))
    # The kernel is a product over the coordinates, and so is the root of its covariance matrix on a grid.
    root = random_field.root(random_field.covariance_matrix(along, coordinate))
    normal_numbers = _normals(simulation.seed, PLANE_STREAM, np.arange(PLANE_POINTS), PLANE_POINTS)
    before = random_field.sample(random_field.sample(normal_numbers, root).T, root).T
    points = np.stack(np.meshgrid(coordinate, coordinate, indexing="ij"), axis=-1).reshape(-1, 2)
    on_edge = (points == coordinate[-1]).any(axis=1)
    flat = before.reshape(1, -1)
    after = random_field.condition_samples(
        kernel,
        points,
        points[on_edge],
        np.full(on_edge.sum(), drawing.example_edge),
        0.0,
        np.concatenate([flat, flat[:, on_edge]], axis=1),
    )
    return coordinate, before, after.reshape(before.shape)


def variation_samples(air: Air, simulation: Simulation, altitude, count):
    """Exact samples of the density variation at ascending altitudes, (count, n)."""
    normal_numbers = _normals(simulation.seed, VARIATION_STREAM, np.arange(count), len(altitude))[:, ::-1]
    return density_variation.sample_process(normal_numbers, *random_field.markov(environment.kernel(air), altitude))


def _ceiling(air: Air, vehicle: Vehicle):
    """Altitude up to which profiles are drawn, m."""
    return max(vehicle.entry_altitude, air.variance_top_altitude)


def _altitudes(lowest, highest):
    return np.linspace(lowest, highest, max(2, int(np.ceil((highest - lowest) / ALTITUDE_STEP)) + 1))


# ---- geometry --------------------------------------------------------------------------------------------------------


def constraint_lines(point_mass: PointMass, reach):
    """The lines a'x = alpha of Eq. 61 across the reach (n, 2) of what is drawn, only as far as the other line allows.

    Returns two curves (2, 2) that start at the lines' common point, or cross the reach if the lines are parallel.
    """
    lines, bounds = linear_example.normals_and_bounds(point_mass)
    meet = abs(np.linalg.det(lines)) > 1e-9 * np.prod(np.linalg.norm(lines, axis=1))
    apex = np.linalg.solve(lines, bounds) if meet else None
    lowest, highest = reach.min(axis=0), reach.max(axis=0)
    if meet:
        lowest, highest = np.minimum(lowest, apex), np.maximum(highest, apex)
    curves = []
    for normal, bound, other in zip(lines, bounds, lines[::-1], strict=True):
        # The coordinate that runs along the line, and the other one as a function of it.
        run = int(abs(normal[0]) * (highest - lowest)[0] > abs(normal[1]) * (highest - lowest)[1])
        ends = np.array([lowest[run], highest[run]])
        curve = np.empty((2, 2))
        curve[:, run] = ends
        curve[:, 1 - run] = (bound - normal[run] * ends) / normal[1 - run]
        if meet:
            allowed = curve[np.argmin((curve - apex) @ other)]
            curve = np.array([apex, allowed])
        curves.append(curve)
    return curves


def fig11(gains: Gains) -> Figure:
    """Nominal flight of the initial guess and of the iterations, and how they differ."""
    figure, panels = new_figure(7.2, 5.4, nrows=2, ncols=2)
    last = len(gains.control) - 1
    laws = [(last, _iteration(last), {"color": VERMILION})] if last else []
    for law, name, style in [*laws, (0, "initial guess", INITIAL_GUESS)]:
        at = {"laws": law}
        for axes, x in ((panels[0, 0], "time"), (panels[0, 1], field(gains, "velocity", unit="km/s", at=at))):
            altitude = field(gains, "altitude", unit="km", at=at, x=x)
            plot(axes, altitude, **style, label=f"{name}, lowest {altitude.values.min():.2f} km")
    panels[0, 0].set_xlim(0, gains.time[-1])
    for axes, name, unit in zip(panels[1], ("altitude", "velocity"), ("km", "m/s"), strict=True):
        initial = field(gains, name, unit=unit, at={"laws": 0})
        plot(axes, initial.minus(initial, f"{name} difference"), label="initial guess", **INITIAL_GUESS)
        for law, color in _iterations(gains):
            difference = field(gains, name, unit=unit, at={"laws": law}).minus(initial)
            plot(axes, difference, color=color, label=_iteration(law))
        axes.set_xlim(0, gains.time[-1])
        _note_if_refused(axes, gains)
    for axes in panels[:, 0]:
        axes.legend(loc="best")
    return figure


def fig12(drawing: Drawing, gains: Gains, aerocapture: FlightEnsemble, published=None) -> Figure:
    """Delta-v of the open loop and of every iteration: flights, and the normal density of linear covariance.

    published: to mark the printed 99th percentiles, without feedback and of the last iteration.
    """
    printed = {0: "acap_dv_p99_open", len(gains.control) - 1: "acap_dv_p99_closed"} if published else {}
    numbers = [0, *(number for number, _ in _iterations(gains))]
    figure, panels = _grid(len(numbers), 7.4, 2.5)
    window = drawing.delta_v_window
    for axes, number in zip(panels, numbers, strict=True):
        delta_v = field(aerocapture, "delta_v", at={"laws": number})
        captured = delta_v.values[np.isfinite(delta_v.values)]
        limits = window
        if number == 0:
            reach = np.quantile(captured, OPEN_LOOP_LEVELS) if captured.size else window
            limits = min(reach[0], 0.95 * window[0]), max(reach[1], 1.05 * window[1])
        if number in printed:
            value = published[printed[number]].printed
            limits = min(limits[0], value - 5.0), max(limits[1], value + 5.0)
        _densities_of_delta_v(axes, gains, number, delta_v, limits)
        if number in printed:
            _mark_below_remarks(axes, value, limits, **PRINTED_LINE)
        axes.set_title(_law(number))
        if number == 0:
            _mark_below_remarks(axes, window, limits, color=BLACK, linestyle="--")
    for axes in panels[:: 2 if len(panels) > 1 else 1]:
        axes.set_ylabel("density (s/m)")
    entries = (
        (SKY, 5.0, "-", "flights"),
        (BLUE, 1.4, "-", "their 99th percentile"),
        (BLACK, 1.2, "-", "linear covariance"),
        (BLACK, 1.4, ":", "its 99th percentile"),
        *([(PRINTED_LINE["color"], 1.3, "-.", "printed 99th percentile")] if printed else []),
        *([(BLACK, 0.8, "--", "range of the other panels")] if len(panels) > 1 else []),
    )
    for color, width, style, label in entries:
        legend_entry(panels[0], label, color=color, linewidth=width, linestyle=style)
    legend_below(figure, [panels[0]], columns=3)
    return figure


def fig13(vehicle: Vehicle, nominal: Nominal, gains: Gains, published=None) -> Figure:
    """Mean control of every iteration, with three standard deviations that the design allots to the feedback."""
    figure, axes = new_figure(7.2, 4.0)
    _limits_of_control(axes, vehicle, label="limits")
    peak = nominal.time_of_largest_dynamic_pressure
    mark(axes, x=peak, linewidth=1.2, label=f"largest dynamic pressure, {peak:.1f} s")
    if published:
        time = published["acap_time_max_q"].printed
        printed_mark(axes, x=time, label=f"the same, printed: {time} s")
    iterations = _iterations(gains)
    starts, lengths = gains.partition[:-1], np.diff(gains.partition)
    for place, (number, color) in enumerate(iterations):
        control = gains.control[number]
        axes.stairs(control, gains.partition, baseline=None, color=color, linewidth=1.4, label=_iteration(number))
        axes.errorbar(
            starts + lengths * (place + 1) / (len(iterations) + 1),
            control,
            3 * gains.design_control_deviation[number],
            fmt="none",
            ecolor=color,
            elinewidth=1.2,
            capsize=2.5,
        )
    axes.plot(gains.partition[[0, -1]], [0, 0], color=BLACK, linewidth=0.8, label="initial guess")
    _note_if_refused(axes, gains)
    axes.set(
        xlabel=field(gains, "partition").label,
        ylabel=r"bank cosine, mean $\pm 3 \sigma$",
        xlim=gains.partition[[0, -1]],
        ylim=(1.15 * np.array(vehicle.control_limits)),
    )
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def fig14(planet: Planet, vehicle: Vehicle, gains: Gains, aerocapture: FlightEnsemble) -> Figure:
    """State errors and control of the open loop: flights, and linear covariance."""
    return _errors_over_time(planet, vehicle, gains, aerocapture, 0)


def fig15(planet: Planet, vehicle: Vehicle, gains: Gains, aerocapture: FlightEnsemble) -> Figure:
    """The same under the law of the last iteration, if there is one."""
    return _errors_over_time(planet, vehicle, gains, aerocapture, len(gains.control) - 1)


def fig16(gains: Gains, aerocapture: FlightEnsemble) -> Figure:
    """Dynamic pressure of the first trials under both laws, with the nominal on top."""
    laws = _ends(gains)
    figure, panels = new_figure(7.0, 0.6 + 2.4 * len(laws), nrows=len(laws), sharex=True, sharey=True, squeeze=False)
    top, reach = PRESSURE_MARGIN * field(gains, "dynamic_pressure", unit="kPa").values.max(), 0.0
    for axes, (number, name) in zip(panels[:, 0], laws, strict=True):
        law = {"unit": "kPa", "at": {"laws": number}}
        pressure = field(aerocapture, "kept_history.dynamic_pressure", **law)
        trials(axes, pressure, **TRIAL | {"alpha": 0.6})
        lower, upper = sigma_bounds(aerocapture, "dynamic_pressure", 3.0, **law)
        bounds(axes, lower, upper, **SAMPLED)
        largest = np.nan_to_num(pressure.values).max(axis=1)
        reach = max(reach, np.nan_to_num(upper.values).max(), largest.max())
        plot(axes, gains, "dynamic_pressure", **law, color=BLACK, label="nominal")
        beyond = int((largest > top).sum())
        remark = f", {beyond} of {len(largest)} beyond the axis" if beyond else ""
        axes.set(title=f"{name}, {_trials(aerocapture, number)}{remark}", xlim=(0, gains.time[-1]))
        axes.legend(loc="upper right", frameon=True, edgecolor="none")
    panels[-1, 0].set_ylim(0, min(top, 1.03 * reach))
    return figure


def fig17(gains: Gains, aerocapture: FlightEnsemble) -> Figure:
    """Density variation met in flight, and its deviation as measured and along the nominal."""
    number, name = _ends(gains)[-1]
    figure, axes = new_figure(7.0, 3.8)
    law = {"at": {"laws": number}}
    trials(axes, aerocapture, "kept_history.density_variation", **law, **TRIAL)
    bounds(axes, *sigma_bounds(aerocapture, "density_variation", 3.0, **law), **SAMPLED)
    along_nominal = field(gains, "variation_deviation", **law)
    lower, upper = (along_nominal.of(sign * 3 * along_nominal.values) for sign in (-1, 1))
    label = r"$\pm 3 \sigma$ along the nominal, $\hat\Sigma(t, t)$"
    bounds(axes, lower, upper, color=BLACK, linestyle=":", linewidth=1.6, label=label)
    axes.set(
        title=f"{name}, {_trials(aerocapture, number)}",
        ylabel="density variation, relative to the mean",
        xlim=(0, gains.time[-1]),
    )
    legend_below(figure, [axes])
    return figure


def delta_v_map(
    planet: Planet, mission: Mission, linearization: Linearization, gains: Gains, aerocapture: FlightEnsemble
) -> Figure:
    """Delta-v against the exit apoapsis: exact, the linear branches, the flights, and what the design predicts."""
    figure, panels = new_figure(7.6, 4.4, ncols=2)
    iterations = _iterations(gains)
    apoapsis, delta_v, slopes, at = _delta_v_curve(planet, mission, linearization, gains)
    captured = aerocapture.apoapsis[0][np.isfinite(aerocapture.apoapsis[0])]
    reach = np.quantile(captured, OPEN_LOOP_LEVELS) if captured.size else at[0] + np.array([-1.0, 1.0])
    # About the nominal, however few flights there are.
    reach = min(reach[0], at[0] - APOAPSIS_MARGIN), max(reach[1], at[0] + APOAPSIS_MARGIN)
    reach = reach[0], min(reach[1], LARGEST_APOAPSIS * mission.target_apoapsis)
    nominals = np.append(gains.apoapsis[np.isfinite(gains.apoapsis)], mission.target_apoapsis)
    near = nominals.min() - APOAPSIS_MARGIN, nominals.max() + APOAPSIS_MARGIN
    for axes, (low, high), laws in zip(panels, (reach, near), ([(0, GREY)], iterations), strict=True):
        for number, color in laws:
            _map_points(axes, aerocapture, number, color, (low, high))
        label = "exact, along the open loop's scatter"
        inside = (apoapsis >= low) & (apoapsis <= high)
        axes.plot(apoapsis[inside], delta_v[inside], color=BLACK, linewidth=0.8, label=label)
        bottom, top = delta_v[inside].min(), delta_v[inside].max()
        for (branch, slope), style in zip(slopes.items(), ("--", ":", "-."), strict=True):
            line = at[1] + slope * (np.array([low, high]) - at[0])
            axes.plot([low, high], line, color=GREEN, linewidth=1.0, linestyle=style, label=f"linear, {branch}")
        margin = 0.5 * (top - bottom)  # room for what the design extrapolates, and for the histograms
        axes.set(
            xlabel=field(aerocapture, "apoapsis", unit="planet radii").label,
            ylabel=field(aerocapture, "delta_v").label,
            xlim=(low, high),
            ylim=(bottom - margin, top + 0.1 * margin),
        )
        axes.axvline(mission.target_apoapsis, color=GREY, linewidth=0.7)
    for number, color in iterations:
        exit_state = gains.reference[number, -1]
        place = orbits.apoapsis_radius(*exit_state, planet.gravitational_parameter) / planet.planet_radius
        point = {"color": color, "markersize": 6, "markeredgecolor": BLACK, "zorder": 5, "linestyle": "none"}
        panels[1].plot(gains.apoapsis[number], gains.nominal_delta_v[number], marker="o", **point)
        panels[1].plot(place, gains.delta_v_mean[number], marker="v", **point)
        panels[1].annotate(
            str(number), (place, gains.delta_v_mean[number]), (5, -9), textcoords="offset points", fontsize=8
        )
    panels[0].set_title(f"open loop, {_trials(aerocapture, 0)}")
    panels[1].set_title("laws of the iterations" if iterations else "no law was designed")
    panels[1].plot([], [], "o", color="white", markeredgecolor=BLACK, label="nominal of an iteration")
    panels[1].plot([], [], "v", color="white", markeredgecolor=BLACK, label="mean that its design predicts")
    for number, color in [(0, GREY), *iterations]:
        panels[1].plot([], [], ".-", color=color, label=f"flights, {_law(number)}, and their histogram")
    legend_below(figure, panels, columns=2)
    return figure


def _iterations(gains):
    """Numbers and colours of the laws that are drawn: all, or the first ones and the last."""
    last = len(gains.control) - 1
    numbers = list(range(1, last + 1))
    if last > MOST_ITERATIONS:
        numbers = [*range(1, MOST_ITERATIONS), last]
    return list(zip(numbers, ITERATION_COLOR, strict=False))


def _ends(gains):
    """The open loop, and the last law if there is one, with their names."""
    last = len(gains.control) - 1
    return [(0, "open loop")] + ([(last, f"closed loop, {_iteration(last)}")] if last else [])


def _iteration(number):
    return f"iteration {number}"


def _law(number):
    return _iteration(number) if number else "open loop"


def _trials(ensemble, number):
    lost = int(flight_statistics.lost(ensemble)[number])
    return f"{ensemble.outcome.shape[1]:,} flights" + (f", {lost:,} lost" if lost else "")


def _grid(count, width, height, **shared):
    """A figure of `count` panels, two in a row, and these panels."""
    columns = min(count, 2)
    rows = -(-count // columns)
    figure, panels = new_figure(width, 0.9 + height * rows, nrows=rows, ncols=columns, squeeze=False, **shared)
    for empty in panels.flat[count:]:
        empty.set_axis_off()
    return figure, list(panels.flat[:count])


def _densities_of_delta_v(axes, gains, number, delta_v, limits):
    """Histogram of all trials, lost ones counted, with the normal density of linear covariance, and percentiles."""
    mean, deviation = gains.delta_v_mean[number], gains.delta_v_deviation[number]
    heights, edges = distribution(axes, delta_v, limits, (mean, deviation))
    percentile, error = flight_statistics.percentile_with_lost(delta_v.values, LEVEL)
    if np.isfinite(percentile):
        _mark_below_remarks(axes, percentile, limits, color=BLUE, linewidth=1.4, linestyle="-")
    _mark_below_remarks(axes, mean + upper_quantile(1.0 - LEVEL) * deviation, limits, color=BLACK, linewidth=1.4)
    trial_count, captured = len(delta_v.values), delta_v.values[np.isfinite(delta_v.values)]
    lost, outside = trial_count - len(captured), int(((captured < limits[0]) | (captured > limits[1])).sum())
    lines = [f"{trial_count:,} flights"]
    lines += [f"{lost:,} lost"] if lost else []
    lines += [f"{outside:,} outside"] if outside else []
    reached = f"99 %: {percentile:.1f} $\\pm$ {error:.1f} m/s"
    lines.append(reached if np.isfinite(percentile) else "99 %: none, too many lost")
    right = limits[0] + 0.5 * (limits[1] - limits[0])  # where the text stands
    highest = max(heights.max(), 1 / (np.sqrt(2 * np.pi) * deviation) if deviation > 0 else 0.0)
    crowded = heights[edges[1:] > right].max() > 0.5 * highest
    if highest > 0.0:
        axes.set_ylim(0.0, (1.6 if crowded else 1.06) * highest)
    axes.text(0.98, 0.95, "\n".join(lines), transform=axes.transAxes, ha="right", va="top", fontsize=9, bbox=OPAQUE)


def _mark_below_remarks(axes, places, limits, **style):
    """Mark delta-v, on the right only as high as the remarks that stand there leave free."""
    for place in np.atleast_1d(places):
        mark(axes, x=place, ymax=REMARKS_FROM if place > limits[0] + 0.5 * (limits[1] - limits[0]) else 1.0, **style)


def _errors_over_time(planet: Planet, vehicle: Vehicle, gains, ensemble, number):
    """Three rows of errors against the law's nominal flight, and the control."""
    figure, panels = new_figure(7.2, 8.4, nrows=len(ERRORS) + 1, sharex=True)
    nodes = np.searchsorted(gains.time, gains.partition - 1e-6)
    law, offset = {"laws": number}, {"radius": planet.planet_radius}
    for axes, (component, designed, unit, name) in zip(panels, ERRORS, strict=False):
        nominal = field(gains, component, unit=unit, at=law)
        trials(
            axes,
            field(ensemble, f"kept_history.{component}", unit=unit, at=law).minus(nominal, f"error in\n{name}"),
            label=None,
            **TRIAL,
        )
        lower, upper = (bound.minus(nominal) for bound in sigma_bounds(ensemble, component, 3.0, unit=unit, at=law))
        bounds(axes, lower, upper, **SAMPLED)
        reference = field(gains, f"reference.{designed}", at=law)
        expected = converted(reference.values - offset.get(designed, 0.0), reference.unit, unit) - nominal.values[nodes]
        bars = 3 * standard_deviation(gains, f"covariance.{designed}", unit=unit, at=law).values
        _predicted_bars(axes, gains.partition, expected, bars)
        _limit_to_flights(axes, np.array([lower.values, upper.values]), np.abs(expected) + bars)
    control = panels[-1]
    starts = nodes[:-1]
    command = field(ensemble, "kept_history.bank_cosine", name="bank cosine\ncommanded", at=law)
    trials(control, command, label=None, drawstyle="steps-post", **TRIAL)
    _limits_of_control(control, vehicle)
    _predicted_bars(control, gains.partition[:-1], gains.control[number], 3 * gains.control_deviation[number])
    mean = field(ensemble, "mean.bank_cosine", at=law).where(starts).values
    sampled = standard_deviation(ensemble, "covariance.bank_cosine", at=law).where(starts).values
    for sign in (-1, 0, 1):
        control.plot(gains.partition[:-1], mean + sign * 3 * sampled, "*", color=BLUE, markersize=6, zorder=4)
    control.set(xlim=(-0.01 * gains.time[-1], 1.01 * gains.time[-1]), ylim=CONTROLS)
    reach = np.nan_to_num(np.abs(mean) + 3 * sampled).max()
    if reach > CONTROLS[1]:
        note(control, f"stars beyond the axis: up to {reach:.2g}", 0.95)
    refused = f"no law was designed: {gains.refused}\n" if gains.refused else ""
    panels[0].set_title(f"{refused}{_law(number)}, {_trials(ensemble, number)}")
    drawn_flights = ensemble.kept_history.shape[1]
    handles = [
        legend_entry(panels[0], label, color=color, linestyle=style, linewidth=width, marker=marker)
        for color, style, width, marker, label in (
            (GREY, "-", 0.8, "", f"{drawn_flights} flights"),
            (BLUE, "--", 1.2, "", SAMPLED["label"]),
            (BLUE, "none", 0.0, "*", r"mean $\pm 3 \sigma$ of the command, before its limits"),
            (BLACK, "-", 1.0, "", r"mean $\pm 3 \sigma$, linear covariance (bars)"),
            (BLACK, "--", 0.9, "", "limits of the control"),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _predicted_bars(axes, time, centre, bars):
    axes.errorbar(time, centre, bars, fmt="_", color=BLACK, markersize=4, elinewidth=1.0, capsize=2.5, zorder=3)


def _limit_to_flights(axes, bounds, predicted):
    """Limits that show the flights, and the prediction as well unless it is far larger."""
    largest = np.nanmax(np.abs(bounds)) if np.isfinite(bounds).any() else 0.0
    expected = predicted.max()
    if expected > FAR * largest > 0.0:
        note(axes, f"linear covariance up to {expected:.3g}", 0.95)
        expected = 0.0
    reach = 1.08 * max(largest, expected)
    if reach > 0.0:
        axes.set_ylim(-reach, reach)


def _limits_of_control(axes, vehicle: Vehicle, label=None):
    for limit in vehicle.control_limits:
        axes.axhline(limit, color=BLACK, linewidth=0.9, linestyle="--", label=label if limit > 0 else None)


def _delta_v_curve(planet: Planet, mission: Mission, linearization, gains):
    """Delta-v and its linear branches along the exit states that the open loop scatters to.

    Returns apoapsis (planet radii), delta-v (m/s), the slope of every branch (m/s per planet radius) and the point
    where they meet the nominal.
    """
    radius, gravity = planet.planet_radius, planet.gravitational_parameter
    end = linearization.state[-1]
    direction = gains.covariance[0, -1] @ linearization.apoapsis_gradient
    direction = direction / (linearization.apoapsis_gradient @ direction) * radius  # one planet radius of apoapsis
    at = float(orbits.apoapsis_radius(*end, gravity)) / radius
    states = end + np.linspace(-4.0, 4.0, 4001)[:, np.newaxis] * direction
    apoapsis = orbits.apoapsis_radius(*states.T, gravity) / radius
    bound = np.isfinite(apoapsis)
    delta_v = orbits.total_delta_v(*states[bound].T, *targets(planet, mission))
    slopes = dict(zip(BRANCHES, linearization.delta_v_gradient @ direction, strict=True))
    return apoapsis[bound], delta_v, slopes, (at, linearization.delta_v)


def _map_points(axes, ensemble, number, color, limits):
    """Flights of a law, and below them the histogram of their apoapses."""
    first = slice(0, MOST_POINTS)
    points = {"color": color, "markersize": 5, "markeredgewidth": 0, "alpha": 0.4, "linestyle": "none"}
    axes.plot(ensemble.apoapsis[number, first], ensemble.delta_v[number, first], ".", **points)
    counts, edges = np.histogram(ensemble.apoapsis[number][np.isfinite(ensemble.apoapsis[number])], 60, range=limits)
    if counts.any():
        height = 0.2 * counts / counts.max()
        axes.stairs(height, edges, color=color, linewidth=1.0, transform=axes.get_xaxis_transform())


def _note_if_refused(axes, gains):
    if gains.refused:
        note(axes, f"no law was designed:\n{gains.refused}", 0.8)
