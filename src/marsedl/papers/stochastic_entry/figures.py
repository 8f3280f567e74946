"""Figures of the paper, and two beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from marsedl.models import density_variation
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import variance_standard_error
from marsedl.papers.stochastic_entry import environment
from marsedl.papers.stochastic_entry.claims.measures import ROWS, final_percentiles
from marsedl.papers.stochastic_entry.dispersions import DENSITY_STREAM, PROCESS_STREAM
from marsedl.papers.stochastic_entry.inputs import Drawing, Inputs
from marsedl.papers.stochastic_entry.records import (
    DOWNRANGE,
    END_TIME,
    LINEAR_STATE,
    REVERSALS,
    STATES,
    TRIGGERS,
    VELOCITY,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    by_case,
    errors,
)
from marsedl.papers.stochastic_entry.sketches import fig01, fig03  # noqa: F401 -- figures, too
from marsedl.plotting.curves import (
    PRINTED_CROSS,
    PRINTED_LINE,
    bounds,
    legend_below,
    legend_entry,
    mark,
    note,
    plot,
    printed_mark,
    trials,
    zero,
)
from marsedl.plotting.ellipses import ellipse
from marsedl.plotting.fields import Field, field, sigma_bounds
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from marsedl.replication.units import KM, converted

LAWS = ("apollo", "stochastic")
LAW_COLOR = {"apollo": BLUE, "stochastic": VERMILION}
LAW_NAME = {"apollo": "Apollo", "stochastic": "stochastic"}
CASE_COLOR = {"apollo_time": BLUE, "apollo_velocity": SKY, "stochastic_time": VERMILION, "stochastic_velocity": ORANGE}
UNITS = {"altitude": "km", "velocity": "m/s", "flight_path_angle": "deg", "downrange": "km", "crossrange": "km"}
IN_LINEAR_MODEL = {"altitude": "radius", **{name: name for name in ("velocity", "flight_path_angle", "downrange")}}
TABULATED = {"flight_path_angle": "gamma", **{name: name for name in ("altitude", "velocity", "downrange")}}  # Table 4
ELLIPSE_PROBABILITY = 0.9973  # of Fig. 13
LEVELS = (0.001, 0.999)  # of the range errors that the histograms show
LEAST_SHARE = 0.005  # of the trials, for a number of reversals to have its own histogram
BANK_COSINES = (-1.6, 2.1)  # shown in Fig. 8; near the velocity's peak the law flown against velocity leaves any axis
ALIGNMENT = "heading alignment begins"
PERCENTILES = {"color": BLACK, "marker": "o", "markerfacecolor": "none", "linestyle": "none"}  # ours, beside Table 4's
STILL_FLYING = {"linewidth": 1.4, "linestyle": (0, (1, 1))}  # bounds of those, once some trials have ended
BEFORE_END = 15.0  # s that Fig. 12 shows before the first trial ends


def fig02(given: Inputs) -> Figure:
    """Density variation against altitude: the process of the design beside that of the flights."""
    figure, both = new_figure(7.2, 4.2, ncols=2, sharex=True, sharey=True)
    atmosphere = environment.atmosphere(given.air)
    count, nodes = given.drawing.drawn_densities, len(atmosphere.altitude)
    from marsedl.montecarlo.streams import normals  # here, as it imports numba

    normal_numbers = normals(given.simulation.seed, PROCESS_STREAM, np.arange(2 * count), nodes)[:, ::-1]
    decay = environment.decay_rate(given.air, atmosphere.altitude)
    intensity = environment.diffusion(given.air, atmosphere.altitude)
    innovation = np.sqrt(density_variation.innovation_variance(atmosphere.altitude, decay, intensity))
    top = atmosphere.deviation[-1]
    process = density_variation.sample_process(normal_numbers[:count], atmosphere.retention, innovation, top)
    process_deviation = np.sqrt(density_variation.process_variance(atmosphere.altitude, decay, intensity, top**2))
    surrogate = density_variation.sample_exact(normal_numbers[count:], atmosphere.retention, atmosphere.deviation)
    _densities(both[0], given.planet.atmosphere_altitude, atmosphere, process, BLUE)
    for sign in (-1, 1):
        both[0].plot(sign * 2 * process_deviation, atmosphere.altitude / KM, color=BLACK, linewidth=0.8, linestyle=":")
    _densities(both[1], given.planet.atmosphere_altitude, atmosphere, surrogate, VERMILION)
    both[0].set(title="process of Eq. 8, diffusion of Eq. 11", ylabel="altitude (km)")
    both[1].set_title("surrogate of Mars-GRAM samples (not Mars-GRAM)")
    both[0].plot([], [], color=BLUE, linewidth=0.6, label=f"{count} samples")
    both[0].plot([], [], color=BLACK, linestyle="--", label=r"$\pm 2 \sigma$ aimed at")
    both[0].plot([], [], color=BLACK, linewidth=0.8, linestyle=":", label=r"$\pm 2 \sigma$ of the process")
    both[1].plot([], [], color=VERMILION, linewidth=0.6, label=f"{count} samples")
    both[1].plot([], [], color=BLACK, linestyle="--", label=r"$\pm 2 \sigma$")
    for axes in both:
        axes.legend(loc="lower right")
    return figure


def fig04(given: Inputs) -> Figure:
    """Density variations that the first Monte Carlo trials fly through."""
    figure, axes = new_figure(4.8, 4.4)
    atmosphere = environment.atmosphere(given.air)
    variations = flown_variations(given.simulation.seed, atmosphere, np.arange(given.drawing.drawn_densities))
    _densities(axes, given.planet.atmosphere_altitude, atmosphere, variations, BLUE)
    axes.set(ylabel="altitude (km)", title="surrogate of Mars-GRAM samples (not Mars-GRAM)")
    axes.plot([], [], color=BLUE, linewidth=0.6, label=f"flights 0 to {given.drawing.drawn_densities - 1}")
    axes.plot([], [], color=BLACK, linestyle="--", label=r"$\pm 2 \sigma$")
    axes.legend(loc="lower right")
    return figure


def fig05(nominal: Nominal) -> Figure:
    """Crossrange of the nominal flight in its deadband, with the bank reversals."""
    figure, axes = new_figure(6.4, 3.6)
    # The deadband rules range control only.
    deadband = field(nominal, "deadband", unit="km", name="crossrange")
    deadband = deadband.where(nominal.guidance_time <= nominal.alignment_time)
    bounds(axes, deadband.of(-deadband.values), deadband, color=GREY, linestyle="--", label="deadband")
    crossrange = field(nominal, "crossrange", unit="km")
    commands = crossrange.at(field(nominal, "reversal_time", x="reversal_time"))
    plot(axes, crossrange, color=BLUE, label="nominal crossrange")
    dots = {"marker": "o", "linestyle": "none", "markersize": 5}
    plot(axes, commands, color=VERMILION, **dots, label="bank reversal commanded")
    mark(axes, x=nominal.alignment_time, label=ALIGNMENT)
    axes.set_xlim(0, nominal.end_time)
    legend_below(figure, [axes], columns=2)
    return figure


def fig06(nominal: Nominal) -> Figure:
    """Bank angle and dynamic pressure of the nominal flight."""
    figure, axes = new_figure(6.8, 3.6)
    pressure_axes = axes.twinx()
    pressure_axes.spines.right.set_visible(True)
    pressure_axes.grid(False)
    density, velocity = field(nominal, "density"), field(nominal, "velocity")
    pascals = 0.5 * density.values * velocity.values**2
    pressure = density.of(converted(pascals, "Pa", "kPa"), "dynamic pressure", "kPa")
    plot(axes, nominal, "bank", unit="deg", name="bank angle, 0: lift up", color=BLUE, label="bank angle")
    plot(pressure_axes, pressure, color=ORANGE)
    pressure_axes.set_ylabel(pressure.label)
    legend_entry(axes, "dynamic pressure (right)", color=ORANGE)
    zero(axes)
    reversal = {"color": VERMILION, "linewidth": 0.7, "linestyle": "--"}
    mark(axes, x=nominal.reversal_time, **reversal, label="bank reversal commanded")
    mark(axes, x=nominal.alignment_time, label=ALIGNMENT)
    axes.set(xlim=(0, nominal.end_time), ylim=(-100, 100))
    # Zero of the pressure at the axis of the bank angle.
    top = 1.15 * pressure.values.max()
    pressure_axes.set_ylim(-top, top)
    pressure_axes.set_yticks([tick for tick in pressure_axes.get_yticks() if 0 <= tick <= top])
    legend_below(figure, [axes], columns=2)
    return figure


def fig07(nominal: Nominal, published=None) -> Figure:
    """Altitude, velocity, flight path angle and downrange of the nominal flight; published: to mark where it ends."""
    figure, panels = new_figure(7.2, 4.8, nrows=2, ncols=2, sharex=True)
    units = UNITS | {"velocity": "km/s"}
    names = {"downrange": "downrange, 0 at the target"}
    for component, axes in zip(IN_LINEAR_MODEL, panels.flat, strict=True):
        plot(axes, nominal, component, unit=units[component], name=names.get(component, ""), color=BLUE)
    mark(*panels.flat, x=nominal.alignment_time, label=ALIGNMENT)
    zero(*panels[1])
    if published:
        printed_mark(panels[1, 1], x=nominal.end_time, y=-published["nominal_uprange"].printed)
    panels[0, 0].set_xlim(0, nominal.end_time)
    legend_below(figure, panels.flat)
    return figure


def fig08(linearization: Linearization, gains: Gains, nominal: Nominal) -> Figure:
    """Bank cosine in range control, each law apart: nominal, and three standard deviations by the linear model."""
    figure, panels = new_figure(7.6, 4.0, ncols=2, sharex=True, sharey=True)
    ruled = np.flatnonzero(gains.time[:-1] < nominal.alignment_time)
    name = r"cosine of the bank angle, $\pm 3 \sigma$"
    mean = field(linearization, "bank_cosine", name=name, x="time").where(ruled)
    designs = {
        "apollo": (
            ("apollo_control_variance", 0, BLUE, "-", "as flown, gain against velocity (time)"),
            ("timed_control_variance", 0, SKY, "--", "gain against time (time)"),
        ),
        "stochastic": (
            ("stochastic_control_variance", 0, VERMILION, "-", "fixed time"),
            ("stochastic_control_variance", 1, ORANGE, "--", "velocity trigger"),
        ),
    }
    for axes, (law, of_law) in zip(panels, designs.items(), strict=True):
        for variance, trigger, color, style, label in of_law:
            spread = 3 * np.sqrt(field(gains, variance, at={"trigger": trigger}).values[ruled])
            if not np.isfinite(spread).all():
                label = f"{label}: no finite gain"
            lower, upper = mean.values - spread, mean.values + spread
            outside = (lower < BANK_COSINES[0]) | (upper > BANK_COSINES[1])
            if outside.any():
                label = f"{label};\noff the axes at {_stretches(mean.x.values, outside)} s"
            lower, upper = (mean.of(np.where(outside, np.nan, bound)) for bound in (lower, upper))
            bounds(axes, lower, upper, color=color, linestyle=style, linewidth=1.6, label=label)
        plot(axes, mean, color=BLACK, label="nominal")
        mark(axes, y=(-1, 1), color=BLACK, linewidth=0.9, linestyle="--", label="limits of a cosine")
        # Where the nominal's velocity peaks, it is no clock against which to fly a law.
        mark(axes, x=nominal.time[nominal.velocity.argmax()], label="velocity peaks")
        axes.set(xlim=(0, nominal.alignment_time), ylim=BANK_COSINES, title=f"{LAW_NAME[law]} law")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18))
    return figure


def fig09(
    drawing: Drawing,
    nominal: Nominal,
    gains: Gains,
    apollo_time: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    published=None,
) -> Figure:
    """Errors over time with the fixed final time: trials, and three standard deviations measured and predicted.

    published: to mark the final percentiles of Table 4.
    """
    return _errors_over_time(drawing, nominal, gains, "time", (apollo_time, stochastic_time), published)


def fig10(nominal: Nominal, apollo_time: FlightEnsemble, stochastic_time: FlightEnsemble) -> Figure:
    """Bank angle of the same trials."""
    figure, panels = new_figure(7.2, 5.0, nrows=2, sharex=True, sharey=True)
    for axes, law, ensemble in zip(panels, LAWS, (apollo_time, stochastic_time), strict=True):
        bank = field(ensemble, "kept_observed.bank", unit="deg", name="bank angle")
        finite = bank.of(bank.values[np.isfinite(bank.values).any(axis=1)])
        trials(axes, finite, color=LAW_COLOR[law], linewidth=0.5, drawstyle="steps-post")
        plot(axes, nominal, "bank", unit="deg", color=BLACK, linewidth=1.0, label="nominal")
        axes.set(title=LAW_NAME[law], xlim=(0, nominal.end_time))
        axes.yaxis.set_major_locator(MultipleLocator(45))
        _note_if_empty(axes, bank.values)
        mark(axes, x=nominal.alignment_time, label=ALIGNMENT)
        axes.legend(loc="lower right")
    return figure


def fig11(
    drawing: Drawing,
    nominal: Nominal,
    gains: Gains,
    apollo_velocity: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
    published=None,
) -> Figure:
    """Errors over time until the velocity trigger, as long as enough trials fly; published: as of `fig09`."""
    return _errors_over_time(drawing, nominal, gains, "velocity", (apollo_velocity, stochastic_velocity), published)


def fig12(
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    apollo_velocity: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
    published=None,
) -> Figure:
    """The last seconds before the velocity trigger, relative to the nominal's end, with each trial's own end.

    published: as of `fig09`.
    """
    figure, panels = new_figure(7.4, 8.0, nrows=len(IN_LINEAR_MODEL), ncols=2, sharex=True, sharey="row")
    ensembles = (apollo_velocity, stochastic_velocity)
    completed_trials = [np.flatnonzero(e.outcome[: len(e.kept_history)] == COMPLETED) for e in ensembles]
    ends = [e.final_state[numbers, END_TIME] for e, numbers in zip(ensembles, completed_trials, strict=True)]
    ends = np.concatenate([*ends, [nominal.end_time]])
    window = ends.min() - BEFORE_END, ends.max() + 2
    projection = linearization.trigger_projection
    for column, law, ensemble, numbers in zip(panels.T, LAWS, ensembles, completed_trials, strict=True):
        predicted = projection @ getattr(gains, f"{law}_covariance")[1, -1] @ projection.T
        ended = ensemble.outcome == COMPLETED
        color = LAW_COLOR[law]
        dots = {"marker": "o", "markersize": 3.5, "markeredgecolor": BLACK, "markeredgewidth": 0.4, "zorder": 4}
        for axes, (component, state) in zip(column, IN_LINEAR_MODEL.items(), strict=True):
            unit = UNITS[component]
            reference = field(ensemble, f"nominal_final.{component}", unit=unit)
            name = f"{reference.name},\nnominal's end = 0"
            flights = _until_the_end(ensemble, component, window[0] - 1).minus(reference, name)
            trials(axes, flights, color=color, linewidth=0.6, label=None)
            nominal_curve = field(nominal, component, unit=unit).where(nominal.time >= window[0] - 1)
            plot(axes, nominal_curve.minus(reference), color=BLACK, linewidth=1.0)
            errors_at_end = _final_error(ensemble, component, unit)
            plot(axes, errors_at_end.where(numbers), color=color, linestyle="none", **dots)
            measured = errors_at_end.values[ended]
            if component != "velocity" and measured.size > 1:
                spread = 3 * measured.std(ddof=1)
                mark(axes, y=measured.mean() + spread * np.array([-1, 1]), color=color, linewidth=1.6, linestyle="-")
                variance = predicted[LINEAR_STATE.index(state), LINEAR_STATE.index(state)]
                spread = converted(3 * np.sqrt(variance), LINEAR_STATE.units[state], unit)
                mark(axes, y=spread * np.array([-1, 1]), color=BLACK, linewidth=1.0, linestyle="--")
            axes.set_xlim(window)
            _note_if_empty(axes, measured)
            if published:
                _final_percentiles(axes, window[1], ensemble, component, published, f"{law}_velocity")
        column[0].set_title(f"{LAW_NAME[law]}, {ended.sum():,} flights at the trigger")
    for color, style, width, marker, label in (
        (GREY, "-", 0.6, ".", "flights with their ends"),
        (BLACK, "-", 1.0, "", "nominal"),
        (GREY, "-", 1.6, "", r"mean $\pm 3 \sigma$ at the trigger, all flights"),
        (BLACK, "--", 1.0, "", r"$\pm 3 \sigma$ at the trigger, linear covariance"),
    ):
        legend_entry(panels[0, 0], label, color=color, linestyle=style, linewidth=width, marker=marker)
    if published:
        _name_percentiles(panels[0, 0])
    legend_below(figure, [panels[0, 0]], columns=2)
    return figure


def fig13(linearization: Linearization, gains: Gains) -> Figure:
    """Ellipses of range and velocity error at the nominal final time, by linear covariance."""
    figure, axes = new_figure(6.4, 4.6)
    radius = np.sqrt(-2 * np.log(1 - ELLIPSE_PROBABILITY))
    pair = np.ix_([VELOCITY, DOWNRANGE], [VELOCITY, DOWNRANGE])
    curves = [
        (getattr(gains, f"{law}_covariance")[number, -1], CASE_COLOR[f"{law}_{trigger}"], "-", f"{name} ({trigger})")
        for law, name in (("apollo", "Apollo"), ("stochastic", "stochastic"))
        for number, trigger in enumerate(TRIGGERS)
    ]
    curves += [
        (gains.timed_covariance[number, -1], CASE_COLOR[f"apollo_{trigger}"], ":", f"Apollo, gain in time ({trigger})")
        for number, trigger in enumerate(TRIGGERS)
    ]
    velocity = Field(np.array([]), "velocity error", LINEAR_STATE.units["velocity"])
    downrange = Field(np.array([]), "range error", UNITS["downrange"])

    def errors_of(velocities, downranges):
        metres = LINEAR_STATE.units["downrange"]
        return Field(
            converted(downranges, metres, downrange.unit), downrange.name, downrange.unit, velocity.of(velocities)
        )

    reach = 0.0
    for covariance, color, style, label in curves:
        block = covariance[pair]
        if not np.isfinite(block).all():
            legend_entry(axes, f"{label}: no finite gain", color=color, linestyle=style)
            continue
        curve = ellipse(np.zeros(2), block, radius)
        reach = max(reach, np.abs(curve[:, 0]).max())
        correlation = block[0, 1] / np.sqrt(block[0, 0] * block[1, 1])
        plot(axes, errors_of(*curve.T), color=color, linestyle=style, label=f"{label}: correlation {correlation:.2f}")
    # Deviations that pass the trigger surface without range error: Z_f of Eq. 77, range row.
    ends = np.array([-reach, reach])
    slope = linearization.trigger_projection[DOWNRANGE, VELOCITY]
    line = errors_of(ends, -slope * ends)
    plot(axes, line, color=GREY, linewidth=0.8, label="no range error at the velocity trigger")
    axes.set_title(f"{100 * ELLIPSE_PROBABILITY:.2f} % ellipses at $t_f$ ({radius:.2f} sigma)")
    legend_below(figure, [axes], columns=2)
    return figure


def floor(
    linearization: Linearization,
    gains: Gains,
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
) -> Figure:
    """Standard deviation of the final range error: the least possible, predicted, and measured."""
    figure, axes = new_figure(7.0, 3.8)
    downrange = np.eye(STATES)[DOWNRANGE]
    objectives = downrange, linearization.trigger_projection.T @ downrange
    cases = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    width, names = 0.26, []
    for place, (case, ensemble) in enumerate(cases.items()):
        law, trigger = case.split("_")
        number = TRIGGERS.index(trigger)
        objective = objectives[number]
        predicted = np.sqrt(objective @ getattr(gains, f"{law}_covariance")[number, -1] @ objective)
        measured, error = _deviation(errors(ensemble)[:, DOWNRANGE])
        bars = (
            (np.sqrt(gains.noise_floor[number]), "none", {"edgecolor": BLACK}),
            (predicted, LAW_COLOR[law], {"alpha": 0.45}),
            (measured, LAW_COLOR[law], {"yerr": 3 * error, "ecolor": BLACK, "capsize": 2}),
        )
        for row, (value, color, style) in enumerate(bars):
            at = place + (row - 1) * width
            if np.isfinite(value):
                axes.bar(at, value, width, color=color, **style)
            label, high = "not finite", 0.0
            if np.isfinite(value):
                label, high = f"{value:,.0f}", value + style.get("yerr", 0.0)
            axes.annotate(
                label,
                (at, high),
                (0, 3),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=8,
                rotation=0 if np.isfinite(value) else 90,
            )
        lost = np.count_nonzero(~np.isfinite(errors(ensemble)[:, DOWNRANGE]))
        name = f"{LAW_NAME[law]}, {trigger}\n{ensemble.count + ensemble.excluded:,} flights"
        names.append(name + (f",\n{lost:,} not finite" if lost else ""))
    for label, style in (
        ("floor: density noise after the last control", {"color": "none", "edgecolor": BLACK}),
        ("linear covariance", {"color": GREY, "alpha": 0.45}),
        ("Monte Carlo", {"color": GREY}),
    ):
        axes.bar(0, 0, label=label, **style)
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set(xlabel="law and trigger", ylabel="standard deviation of\nthe final range error (m)")
    axes.margins(y=0.12)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def reversals(
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
) -> Figure:
    """Final range error, split by the number of bank reversals."""
    figure, panels = new_figure(7.4, 5.4, nrows=2, ncols=2)
    cases = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    colors = (GREEN, BLUE, VERMILION, PURPLE, ORANGE, SKY, GREY)
    for axes, (case, ensemble) in zip(panels.flat, cases.items(), strict=True):
        law, trigger = case.split("_")
        range_error = _final_error(ensemble, "downrange", "km", "final range error")
        error = range_error.values
        finite = np.isfinite(error)
        title = f"{LAW_NAME[law]}, {trigger}: {finite.sum():,} flights"
        if not finite.all():
            title += f", {np.count_nonzero(~finite):,} not finite"
        axes.set(title=title, xlabel=range_error.label)
        _note_if_empty(axes, error)
        if not finite.any():
            continue
        error, number = error[finite], ensemble.final_state[finite, REVERSALS].astype(int)
        edges = np.linspace(*np.quantile(error, LEVELS), 61 if len(error) > 5000 else 21)
        weight = 1.0 / (len(error) * (edges[1] - edges[0]))
        counts = [n for n in np.unique(number) if (number == n).mean() >= LEAST_SHARE]
        for n in counts:
            of_n = error[number == n]
            inside, color = np.histogram(of_n, edges)[0] * weight, colors[n % len(colors)]
            share = f"{100 * len(of_n) / len(error):.1f} %: mean {of_n.mean():+.2f}"
            axes.stairs(inside, edges, color=color, fill=True, alpha=0.25)
            name = f"{n} reversal{'' if n == 1 else 's'}, {share}"
            axes.stairs(inside, edges, color=color, linewidth=1.2, label=name)
        axes.stairs(np.histogram(error, edges)[0] * weight, edges, color=BLACK, linewidth=0.8, label="all")
        mark(axes, x=0.0, linestyle="-")
        axes.margins(y=0.0)
        axes.set_ylim(0, 1.55 * axes.get_ylim()[1])  # room for the legend
        axes.legend(loc="upper left")
    for axes in panels[:, 0]:
        axes.set_ylabel("density (1/km)")
    return figure


def flown_variations(seed, atmosphere, trials):
    """Density variations of Monte Carlo trials at the nodes of the flight's atmosphere, (trials, nodes)."""
    from marsedl.montecarlo.streams import normals  # here, as it imports numba

    normal_numbers = normals(seed, DENSITY_STREAM, trials, len(atmosphere.altitude))[:, ::-1]
    variation = density_variation.sample_exact(normal_numbers, atmosphere.retention, atmosphere.deviation)
    return density_variation.density_factor(variation) - 1.0


def _densities(axes, edge, atmosphere, variations, color):
    """Samples against altitude up to the edge of the atmosphere (m), with twice the deviation that is aimed at."""
    in_atmosphere = (atmosphere.altitude >= 0) & (atmosphere.altitude <= edge)
    for sample in variations:
        axes.plot(sample[in_atmosphere], atmosphere.altitude[in_atmosphere] / KM, color=color, linewidth=0.5, alpha=0.6)
    for sign in (-1, 1):
        axes.plot(
            sign * 2 * atmosphere.deviation[in_atmosphere],
            atmosphere.altitude[in_atmosphere] / KM,
            color=BLACK,
            linestyle="--",
        )
    axes.set(xlabel="density variation, relative to the mean", ylim=(0, edge / KM))


def _stretches(values, chosen):
    """Ranges of values over which something holds, in words: "39 to 44, 60 and 62"."""
    places = np.flatnonzero(chosen)
    ranges = [values[run[[0, -1]]] for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)]
    *first_ranges, last = (f"{start:g}" if start == end else f"{start:g} to {end:g}" for start, end in ranges)
    return f"{', '.join(first_ranges)} and {last}" if first_ranges else last


def _errors_over_time(drawing: Drawing, nominal: Nominal, gains: Gains, trigger, ensembles, published) -> Figure:
    """Five rows of errors against time, a column for each law."""
    figure, panels = new_figure(7.4, 9.2, nrows=len(UNITS), ncols=2, sharex=True, sharey="row")
    some_ended = False
    for column, law, ensemble in zip(panels.T, LAWS, ensembles, strict=True):
        color = LAW_COLOR[law]
        # The nominal has no state after its end, and so no error has a meaning there.
        before_end = ensemble.time <= nominal.time[-1]
        enough = before_end & (ensemble.flying >= drawing.fewest_flying)
        # The moments are those of the trials still flying: of all of them only until the first trial ends.
        complete = np.count_nonzero(ensemble.flying[enough] == ensemble.count)
        some_ended |= complete < np.count_nonzero(enough)
        for axes, (component, unit) in zip(column, UNITS.items(), strict=True):
            reference = field(nominal, component, unit=unit)
            history = field(ensemble, f"kept_history.{component}", unit=unit).where(before_end)
            trials(axes, history.minus(reference, f"{history.name}\nerror"), color=color, alpha=0.5, label=None)
            measured = [
                bound.where(enough).minus(reference) for bound in sigma_bounds(ensemble, component, 3.0, unit=unit)
            ]
            bounds(axes, *(bound.where(slice(complete)) for bound in measured), color=color, linewidth=1.4)
            remainder = [bound.where(slice(max(complete - 1, 0), None)) for bound in measured]
            bounds(axes, *remainder, color=color, **STILL_FLYING)
            if component in IN_LINEAR_MODEL:
                spread = _predicted_deviation(gains, law, trigger, component)
                predicted = spread.of(-3 * spread.values), spread.of(3 * spread.values)
                bounds(axes, *predicted, color=BLACK, linewidth=1.1, linestyle="--")
            if published and component in TABULATED:
                _final_percentiles(axes, nominal.end_time, ensemble, component, published, f"{law}_{trigger}")
            if published and (law, trigger) == ("stochastic", "time") and component in ("altitude", "downrange"):
                limit, turn = (published[f"fig9_{of}"].printed for of in ("altitude_active", "range_error_turns"))
                place = {"y": (-limit, limit)} if component == "altitude" else {"x": turn}
                printed_mark(axes, **place, label=None)
            axes.set_xlim(0, nominal.end_time)
            _note_if_empty(axes, measured[0].values)
        lost = f", {ensemble.excluded:,} not finite" if ensemble.excluded else ""
        column[0].set_title(f"{LAW_NAME[law]}, {ensemble.count + ensemble.excluded:,} flights{lost}")
    mark(*panels.flat[1:], x=nominal.alignment_time)
    first = panels[0, 0]
    legend_entry(first, f"{len(ensembles[0].kept_history)} flights", color=GREY, linewidth=0.6)
    legend_entry(first, r"mean $\pm 3 \sigma$ of all flights", color=GREY, linewidth=1.8)
    if some_ended:
        legend_entry(first, "the same of those still flying", color=GREY, **STILL_FLYING)
    legend_entry(first, r"$\pm 3 \sigma$, linear covariance", color=BLACK, linewidth=1.1, linestyle="--")
    mark(first, x=nominal.alignment_time, label=ALIGNMENT)
    if published:
        _name_percentiles(first)
    if published and trigger == "time":
        legend_entry(first, r"printed: $3 \sigma$ of altitude, and when range turns", **PRINTED_LINE)
    legend_below(figure, [first], columns=2)
    return figure


def _final_percentiles(axes, x, ensemble, component, published, case):
    """1st and 99th percentile of a final error at a place: as printed, and ours with three standard errors."""
    printed_mark(axes, x=x, y=published[f"tab4_{TABULATED[component]}_{case}"].printed, label=None)
    [(state, factor)] = [(row[0], row[2]) for row in ROWS if row[1] == TABULATED[component]]
    values, deviations = (factor * of for of in final_percentiles(ensemble, index=[state])[state])
    ours = axes.errorbar([x, x], values, yerr=3 * np.nan_to_num(deviations), **PERCENTILES, clip_on=False, zorder=6)
    for part in ours.get_children():
        part.set_clip_on(False)


def _name_percentiles(axes):
    legend_entry(axes, "printed: 1st and 99th percentiles of the end", **PRINTED_CROSS)
    legend_entry(axes, "ours", **PERCENTILES)


def _predicted_deviation(gains, law, trigger, component):
    """Standard deviation of a component that the linear model predicts, over time."""
    state = IN_LINEAR_MODEL[component]
    variance = field(gains, f"{law}_covariance.{trigger}.{state}.{state}", x="time")
    deviation = np.sqrt(np.maximum(variance.values, 0.0))  # rounding can make a vanishing variance negative
    unit = UNITS[component]
    return variance.of(converted(deviation, LINEAR_STATE.units[state], unit), component, unit)


def _final_error(ensemble, component, unit, name=""):
    """Final errors of a component (trials,), against the end times."""
    final = field(ensemble, f"final_state.{component}", unit=unit, x="final_state.end_time")
    return final.minus(field(ensemble, f"nominal_final.{component}", unit=unit), name)


def _until_the_end(ensemble, component, start):
    """Histories of the kept trials from a time on (s), and the state at the end of each as its last point."""
    history = field(ensemble, f"kept_history.{component}", unit=UNITS[component])
    final = field(ensemble, f"final_state.{component}", unit=history.unit, x="final_state.end_time")
    trial_count = len(history.values)
    values = np.pad(history.values, ((0, 0), (0, 1)), constant_values=np.nan)
    times = np.tile(np.append(history.x.values, np.nan), (trial_count, 1))
    end = np.isfinite(values).sum(axis=1)
    values[np.arange(trial_count), end], times[np.arange(trial_count), end] = (
        final.values[:trial_count],
        final.x.values[:trial_count],
    )
    return Field(np.where(times >= start, values, np.nan), history.name, history.unit, history.x.of(times))


def _deviation(samples):
    """Standard deviation of the finite samples and its standard error; NaN of fewer than four."""
    samples = samples[np.isfinite(samples)]
    if samples.size < 4:
        return np.nan, np.nan
    variance = samples.var(ddof=1)
    fourth = ((samples - samples.mean()) ** 4).mean()
    return np.sqrt(variance), variance_standard_error(variance, fourth, samples.size) / (2 * np.sqrt(variance))


def _note_if_empty(axes, values):
    if not np.isfinite(values).any():
        note(axes, "no finite trial", 0.92)
