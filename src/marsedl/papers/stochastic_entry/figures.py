"""Figures of the paper, and five beyond it. Each function draws one file from artifacts."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, NullLocator

from marsedl.methods.guidance.targeting import targeting
from marsedl.models import density_variation
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import variance_standard_error
from marsedl.montecarlo.streaming import FinalMoments, is_streamed
from marsedl.papers.stochastic_entry import environment
from marsedl.papers.stochastic_entry.dispersions import DENSITY_STREAM, PROCESS_STREAM
from marsedl.papers.stochastic_entry.inputs import Air, Design, Drawing, Planet, Simulation
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    BANK,
    CROSSRANGE,
    DOWNRANGE,
    END_TIME,
    FLIGHT_PATH_ANGLE,
    REVERSALS,
    STATES,
    TRIGGERS,
    VELOCITY,
    ErrorBudget,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    Tradeoff,
    by_case,
    errors,
)
from marsedl.plotting.ellipses import ellipse
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure

KM = 1e3
DEGREE = np.pi / 180
TIME_LABEL = "time from entry (s)"
LAWS = ("apollo", "stochastic")
LAW_COLOR = {"apollo": BLUE, "stochastic": VERMILION, "nominal": GREY}
LAW_NAME = {"apollo": "Apollo", "stochastic": "stochastic", "nominal": "no corrections"}
CASE_COLOR = {
    "apollo_time": BLUE,
    "apollo_velocity": SKY,
    "stochastic_time": VERMILION,
    "stochastic_velocity": ORANGE,
}
# Component of the history, unit, label; the first four are states of the linear model in the same order.
COMPONENTS = (
    (ALTITUDE, KM, "altitude (km)"),
    (VELOCITY, 1.0, "velocity (m/s)"),
    (FLIGHT_PATH_ANGLE, DEGREE, "flight path angle (deg)"),
    (DOWNRANGE, KM, "downrange (km)"),
    (CROSSRANGE, KM, "crossrange (km)"),
)
LINEAR = 4  # components that the linear model has
ELLIPSE_PROBABILITY = 0.9973  # of Fig. 13
LEVELS = (0.001, 0.999)  # of the range errors that the histograms show
LEAST_SHARE = 0.005  # of the trials, for a number of reversals to have its own histogram
BANK_COSINES = (-1.6, 2.1)  # shown in Fig. 8; at the velocity's peak the law flown against velocity leaves any axis
BEFORE_END = 15.0  # s that Fig. 12 shows before the first trial ends


def fig01() -> Figure:
    """Rear view of the vehicle with its lift vector, rolled by the bank angle."""
    figure, axes = new_figure(4.2, 4.2)
    bank, length, corner = 40 * DEGREE, 1.0, np.array([0.0, 0.0])
    tip = length * np.array([np.sin(bank), np.cos(bank)])
    turn = np.linspace(0.0, 2 * np.pi, 200)
    for radius, width in ((0.42, 1.2), (0.16, 0.8)):
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=GREY, linewidth=width)
    axes.plot([0, 0], [-0.62, 1.22], color=GREY, linestyle="--", linewidth=0.8)
    axes.plot([-0.75, 1.0], [0, 0], color=GREY, linestyle="--", linewidth=0.8)
    for end, color, width in (
        ((tip[0], 0.0), ORANGE, 1.6),
        ((0.0, tip[1]), GREEN, 1.6),
        (tip, BLUE, 2.0),
    ):
        axes.annotate("", end, corner, arrowprops=_arrow(color, width))
    axes.plot([tip[0], tip[0], 0.0], [0.0, tip[1], tip[1]], color=GREY, linestyle=":", linewidth=0.8)
    arc = np.linspace(0.0, bank, 40)
    axes.plot(0.58 * np.sin(arc), 0.58 * np.cos(arc), color=BLACK, linewidth=1.0)
    axes.text(0.66 * np.sin(bank / 2), 0.66 * np.cos(bank / 2), r"$\sigma$", ha="center", va="center")
    axes.text(tip[0] + 0.03, tip[1] + 0.03, r"$L$", color=BLUE, fontsize=11)
    axes.text(-0.03, tip[1], r"$L\,\cos\sigma$", color=GREEN, ha="right", va="center")
    axes.text(tip[0], -0.05, r"$L\,\sin\sigma$", color=ORANGE, ha="center", va="top")
    axes.text(0.0, 1.25, "local vertical", color=GREY, ha="center", va="bottom")
    axes.text(1.02, 0.0, "right", color=GREY, ha="left", va="center")
    axes.text(-0.36, -0.36, "vehicle, seen\nfrom behind", color=GREY, ha="right", va="top", fontsize=8)
    axes.set(aspect="equal", xlim=(-1.05, 1.25), ylim=(-0.75, 1.4))
    axes.set_axis_off()
    return figure


def fig02(planet: Planet, air: Air, simulation: Simulation, drawing: Drawing) -> Figure:
    """Density variation against altitude: the process of the design beside that of the flights."""
    figure, both = new_figure(7.2, 4.2, ncols=2, sharex=True, sharey=True)
    atmosphere = environment.atmosphere(air)
    count, nodes = drawing.drawn_densities, len(atmosphere.altitude)
    from marsedl.montecarlo.streams import normals  # here, as it imports numba

    drawn = normals(simulation.seed, PROCESS_STREAM, np.arange(2 * count), nodes)[:, ::-1]
    decay = environment.decay_rate(air, atmosphere.altitude)
    intensity = environment.diffusion(air, atmosphere.altitude)
    innovation = np.sqrt(density_variation.innovation_variance(atmosphere.altitude, decay, intensity))
    top = atmosphere.deviation[-1]
    process = density_variation.sample_process(drawn[:count], atmosphere.retention, innovation, top)
    process_deviation = np.sqrt(density_variation.process_variance(atmosphere.altitude, decay, intensity, top**2))
    surrogate = density_variation.sample_exact(drawn[count:], atmosphere.retention, atmosphere.deviation)
    _densities(both[0], planet.atmosphere_altitude, atmosphere, process, BLUE)
    for sign in (-1, 1):
        both[0].plot(sign * 2 * process_deviation, atmosphere.altitude / KM, color=BLACK, linewidth=0.8, linestyle=":")
    _densities(both[1], planet.atmosphere_altitude, atmosphere, surrogate, VERMILION)
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


def fig03() -> Figure:
    """Downrange-to-go and crossrange angle of a target, and the frames in which they are found."""
    figure, axes = new_figure(5.6, 5.4)
    # Exaggerated: in the flight, the crossrange is a thousandth of the range to go.
    longitude, latitude, azimuth, rotation = -28 * DEGREE, 4 * DEGREE, 68 * DEGREE, 35 * DEGREE
    target_longitude, target_latitude, height = 38 * DEGREE, 50 * DEGREE, 1.12
    downrange, crossrange = targeting(
        longitude, latitude, height, 1.0, 0.0, azimuth, 0.0, target_longitude, target_latitude
    )
    up, east, north = _vehicle_frame(longitude, latitude)
    heading = np.sin(azimuth) * east + np.cos(azimuth) * north
    momentum = np.cross(up, heading)
    target, _, _ = _vehicle_frame(target_longitude, target_latitude)
    foot = target - (target @ momentum) * momentum
    foot = foot / np.linalg.norm(foot)
    project = _projection(18 * DEGREE, 24 * DEGREE)

    turn = np.linspace(0.0, 2 * np.pi, 361)
    axes.fill(np.cos(turn), np.sin(turn), color=SKY, alpha=0.12, linewidth=0)
    axes.plot(np.cos(turn), np.sin(turn), color=GREY, linewidth=0.8)
    equator = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    orbit = np.outer(np.cos(turn), up) + np.outer(np.sin(turn), heading)
    for circle, color, width in ((equator, GREY, 0.7), (orbit, GREEN, 1.2)):
        _on_sphere(axes, project, circle, color, width)
    for points, color in (
        (_great_circle(up, target), BLUE),
        (_great_circle(foot, target), VERMILION),
    ):
        axes.plot(*project(points).T, color=color, linewidth=2.2)
    for end, color in ((height * up, BLACK), (target, BLACK), (foot, GREEN)):
        axes.plot(*project(np.stack([0 * end, end])).T, color=color, linewidth=0.8, linestyle="--")
        axes.plot(*project(end), "o", color=color, markersize=4)
    _arrow_3d(axes, project, np.zeros(3), 0.62 * momentum, GREEN, r"$\hat h$", (-12, 2))
    vehicle = height * up
    _arrow_3d(axes, project, vehicle, vehicle + 0.42 * heading, PURPLE, r"$\vec V_I$", (4, -12))
    for direction, name, offset in (
        (up, r"$\hat\imath^R$ (up)", (-30, -10)),
        (east, r"$\hat\jmath^R$ (east)", (2, -10)),
        (north, r"$\hat k^R$ (north)", (-4, 4)),
    ):
        _arrow_3d(axes, project, vehicle, vehicle + 0.3 * direction, BLACK, name, offset)
    cosine, sine = np.cos(rotation), np.sin(rotation)
    frames = (
        (np.array([0.0, -1.0, 0.0]), r"$\hat\imath^I$", (-10, -8), GREY),
        (np.array([1.0, 0.0, 0.0]), r"$\hat\jmath^I$", (2, -10), GREY),
        (np.array([sine, -cosine, 0.0]), r"$\hat\imath^F$", (-2, -12), ORANGE),
        (np.array([cosine, sine, 0.0]), r"$\hat\jmath^F$", (4, -4), ORANGE),
        (np.array([0.0, 0.0, 1.0]), r"$\hat k^I = \hat k^F$", (-46, -12), ORANGE),
    )
    for direction, name, offset, color in frames:
        _arrow_3d(axes, project, np.zeros(3), 0.42 * direction, color, name, offset)
    turned = np.linspace(0.0, rotation, 30)
    arc = 0.3 * np.stack([np.sin(turned), -np.cos(turned), 0 * turned], axis=-1)
    axes.plot(*project(arc).T, color=ORANGE, linewidth=0.9)
    axes.annotate(r"$\eta$", project(arc[15]), (0, -10), textcoords="offset points", color=ORANGE, ha="center")

    def name(point, text, color, offset, **style):
        axes.annotate(text, project(point), offset, textcoords="offset points", color=color, **style)

    name(_great_circle(up, target)[45], r"$\delta_{go}$", BLUE, (-6, 6), ha="right", fontsize=11)
    name(_great_circle(foot, target)[50], r"$\varepsilon$", VERMILION, (7, -3), fontsize=11)
    name(target, r"target $\hat r_{targ}$", BLACK, (4, 6))
    name(vehicle, r"$\vec r$", BLACK, (-12, -2))
    name(orbit[np.searchsorted(turn, 1.5)], "orbit plane", GREEN, (4, -12))
    axes.set(aspect="equal", xlim=(-1.15, 1.05), ylim=(-1.02, 1.02))
    axes.set_axis_off()
    axes.set_title(
        rf"not to scale: drawn with $\delta_{{go}}$ = {downrange / DEGREE:.0f} deg and "
        rf"$\varepsilon$ = {crossrange / DEGREE:.0f} deg"
    )
    return figure


def fig04(planet: Planet, air: Air, simulation: Simulation, drawing: Drawing) -> Figure:
    """Density variations that the first Monte Carlo trials fly through."""
    figure, axes = new_figure(4.8, 4.4)
    atmosphere = environment.atmosphere(air)
    variations = flown_variations(simulation.seed, atmosphere, np.arange(drawing.drawn_densities))
    _densities(axes, planet.atmosphere_altitude, atmosphere, variations, BLUE)
    axes.set(ylabel="altitude (km)", title="surrogate of Mars-GRAM samples (not Mars-GRAM)")
    axes.plot([], [], color=BLUE, linewidth=0.6, label=f"trials 0 to {drawing.drawn_densities - 1}")
    axes.plot([], [], color=BLACK, linestyle="--", label=r"$\pm 2 \sigma$")
    axes.legend(loc="lower right")
    return figure


def fig05(nominal: Nominal) -> Figure:
    """Crossrange of the nominal flight in its deadband, with the bank reversals."""
    figure, axes = new_figure(6.4, 3.6)
    ruled = nominal.guidance_time <= nominal.alignment_time  # the deadband rules range control only
    for sign in (-1, 1):
        axes.plot(
            nominal.guidance_time[ruled],
            sign * nominal.deadband[ruled] / KM,
            color=GREY,
            linestyle="--",
            label="deadband" if sign > 0 else None,
        )
    axes.plot(nominal.time, nominal.crossrange / KM, color=BLUE, label="nominal crossrange")
    at = np.interp(nominal.reversal_time, nominal.time, nominal.crossrange)
    axes.plot(nominal.reversal_time, at / KM, "o", color=VERMILION, markersize=5, label="bank reversal commanded")
    _mark_alignment(axes, nominal)
    axes.set(xlabel=TIME_LABEL, ylabel="crossrange (km)", xlim=(0, nominal.end_time))
    _legends_below(figure, [axes])
    return figure


def fig06(nominal: Nominal) -> Figure:
    """Bank angle and dynamic pressure of the nominal flight."""
    figure, axes = new_figure(6.8, 3.6)
    pressure = axes.twinx()
    pressure.spines.right.set_visible(True)
    pressure.grid(False)
    values = 0.5 * nominal.density * nominal.velocity**2 / 1e3
    (bank_line,) = axes.plot(nominal.time, nominal.bank / DEGREE, color=BLUE, label="bank angle")
    (pressure_line,) = pressure.plot(nominal.time, values, color=ORANGE, label="dynamic pressure (right)")
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    for time in nominal.reversal_time:
        axes.axvline(time, color=VERMILION, linewidth=0.7, linestyle="--")
    (reversal,) = axes.plot([], [], color=VERMILION, linewidth=0.7, linestyle="--", label="bank reversal commanded")
    _mark_alignment(axes, nominal)
    axes.set(xlabel=TIME_LABEL, ylabel="bank angle (deg); 0: lift up", xlim=(0, nominal.end_time), ylim=(-100, 100))
    # Zero of the pressure at the axis of the bank angle, so that neither curve runs through the legend.
    pressure.set(ylabel="dynamic pressure (kPa)", ylim=(-1.15 * values.max(), 1.15 * values.max()))
    pressure.set_yticks([tick for tick in pressure.get_yticks() if 0 <= tick <= 1.15 * values.max()])
    axes.legend(handles=[bank_line, pressure_line, reversal], loc="lower right")
    return figure


def fig07(nominal: Nominal) -> Figure:
    """Altitude, velocity, flight path angle and downrange of the nominal flight."""
    figure, panels = new_figure(7.2, 4.8, nrows=2, ncols=2, sharex=True)
    curves = (
        (nominal.altitude / KM, "altitude (km)"),
        (nominal.velocity / KM, "velocity (km/s)"),
        (nominal.flight_path_angle / DEGREE, "flight path angle (deg)"),
        (nominal.downrange / KM, "downrange (km), 0 at the target"),
    )
    for axes, (values, label) in zip(panels.flat, curves, strict=True):
        axes.plot(nominal.time, values, color=BLUE)
        _mark_alignment(axes, nominal)
        axes.set(ylabel=label, xlim=(0, nominal.end_time))
    panels[1, 0].axhline(0.0, color=BLACK, linewidth=0.6)
    for axes in panels[-1]:
        axes.set_xlabel(TIME_LABEL)
    return figure


def fig08(linearization: Linearization, gains: Gains, nominal: Nominal) -> Figure:
    """Bank cosine in range control: nominal, and three standard deviations that the linear model predicts."""
    figure, axes = new_figure(7.2, 4.2)
    time, mean = gains.time[:-1], linearization.bank_cosine[:-1]
    ruled = time < nominal.alignment_time
    curves = (
        (gains.apollo_control_variance[0], BLUE, "-", "Apollo, as flown against velocity (time)"),
        (gains.timed_control_variance[0], BLUE, ":", "Apollo, gain against time (time)"),
        (gains.stochastic_control_variance[0], VERMILION, "-", "stochastic (time)"),
        (gains.stochastic_control_variance[1], ORANGE, "-", "stochastic (velocity)"),
    )
    for limit in (-1, 1):
        axes.axhline(limit, color=BLACK, linewidth=0.9, linestyle="--")
    for variance, color, style, label in curves:
        # Rounding can make a vanishing variance negative.
        spread = 3 * np.sqrt(variance[ruled])
        if not np.isfinite(spread).all():
            label = f"{label}: no finite gain"
        elif (mean[ruled] + spread).max() > BANK_COSINES[1]:
            label = f"{label}, up to {spread.max():.0f} at {time[spread.argmax()]:.0f} s"
        for sign in (-1, 1):
            bound = mean[ruled] + sign * spread
            axes.plot(time[ruled], bound, color=color, linestyle=style, label=label if sign > 0 else None)
    axes.plot(time[ruled], mean[ruled], color=BLACK, label="nominal")
    axes.plot([], [], color=BLACK, linewidth=0.9, linestyle="--", label="limits of a cosine")
    axes.set(
        xlabel=TIME_LABEL,
        ylabel=r"cosine of the bank angle, $\pm 3 \sigma$",
        xlim=(0, nominal.alignment_time),
        ylim=BANK_COSINES,
    )
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def fig09(
    drawing: Drawing, nominal: Nominal, gains: Gains, apollo_time: FlightEnsemble, stochastic_time: FlightEnsemble
):
    """Errors over time with the fixed final time: trials, and three standard deviations measured and predicted."""
    return _errors_over_time(drawing, nominal, gains, 0, (apollo_time, stochastic_time))


def fig10(nominal: Nominal, apollo_time: FlightEnsemble, stochastic_time: FlightEnsemble) -> Figure:
    """Bank angle of the same trials."""
    figure, panels = new_figure(7.2, 5.0, nrows=2, sharex=True, sharey=True)
    for axes, law, ensemble in zip(panels, LAWS, (apollo_time, stochastic_time), strict=True):
        bank = ensemble.kept_observed[:, :, BANK] / DEGREE
        for trial in bank:
            axes.plot(ensemble.time, trial, color=LAW_COLOR[law], linewidth=0.5, alpha=0.6, drawstyle="steps-post")
        axes.plot(nominal.time, nominal.bank / DEGREE, color=BLACK, linewidth=1.0)
        finite = np.isfinite(bank).any(axis=1).sum()
        axes.plot([], [], color=LAW_COLOR[law], linewidth=0.8, label=f"{finite} trials")
        axes.plot([], [], color=BLACK, label="nominal")
        _mark_alignment(axes, nominal)
        axes.set(ylabel="bank angle (deg)", title=LAW_NAME[law], xlim=(0, nominal.end_time))
        axes.yaxis.set_major_locator(MultipleLocator(45))
        axes.legend(loc="lower right")
        _say_if_empty(axes, bank)
    panels[-1].set_xlabel(TIME_LABEL)
    return figure


def fig11(
    drawing: Drawing,
    nominal: Nominal,
    gains: Gains,
    apollo_velocity: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
):
    """Errors over time until the velocity trigger, as long as enough trials fly."""
    return _errors_over_time(drawing, nominal, gains, 1, (apollo_velocity, stochastic_velocity))


def fig12(
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    apollo_velocity: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
) -> Figure:
    """The last seconds before the velocity trigger, relative to the nominal's end, with each trial's own end."""
    figure, panels = new_figure(7.4, 8.0, nrows=LINEAR, ncols=2, sharex=True, sharey="row")
    ensembles = (apollo_velocity, stochastic_velocity)
    drawn = [np.flatnonzero(e.outcome[: len(e.kept_history)] == COMPLETED) for e in ensembles]
    ends = [e.final_state[kept, END_TIME] for e, kept in zip(ensembles, drawn, strict=True)]
    ends = np.concatenate([*ends, [nominal.end_time]])
    window = ends.min() - BEFORE_END, ends.max() + 2
    projection = linearization.trigger_projection
    for column, law, ensemble, kept in zip(panels.T, LAWS, ensembles, drawn, strict=True):
        predicted = projection @ getattr(gains, f"{law}_covariance")[1, -1] @ projection.T
        final = ensemble.final_state
        ended = ensemble.outcome == COMPLETED
        for axes, (component, unit, _) in zip(column, COMPONENTS[:LINEAR], strict=True):
            reference = ensemble.nominal_final[component]
            for number, trial in enumerate(ensemble.kept_history):
                flying = np.isfinite(trial[:, component])
                time = np.append(ensemble.time[flying], final[number, END_TIME])
                values = np.append(trial[flying, component], final[number, component])
                shown = time >= window[0] - 1
                line = {"color": LAW_COLOR[law], "linewidth": 0.6, "alpha": 0.6}
                axes.plot(time[shown], (values[shown] - reference) / unit, **line)
            shown = nominal.time >= window[0] - 1
            own = (nominal.altitude, nominal.velocity, nominal.flight_path_angle, nominal.downrange)[component]
            axes.plot(nominal.time[shown], (own[shown] - reference) / unit, color=BLACK, linewidth=1.0)
            axes.plot(
                final[kept, END_TIME],
                (final[kept, component] - reference) / unit,
                "o",
                color=LAW_COLOR[law],
                markersize=3.5,
                markeredgecolor=BLACK,
                markeredgewidth=0.4,
                zorder=4,
            )
            measured = final[ended, component] - reference
            if component != VELOCITY and measured.size > 1:
                for sign in (-1, 1):
                    bound = measured.mean() + sign * 3 * measured.std(ddof=1)
                    axes.axhline(bound / unit, color=LAW_COLOR[law], linewidth=1.6)
                    spread = np.sqrt(predicted[component, component])
                    axes.axhline(sign * 3 * spread / unit, color=BLACK, linewidth=1.0, linestyle="--")
            axes.set_xlim(window)
            _say_if_empty(axes, measured)
        column[0].set_title(f"{LAW_NAME[law]}, {ended.sum():,} trials at the trigger")
    for axes, (_, _, label) in zip(panels[:, 0], COMPONENTS[:LINEAR], strict=True):
        axes.set_ylabel(f"{label},\nnominal's end = 0")
    for axes in panels[-1]:
        axes.set_xlabel(TIME_LABEL)
    handles = [
        panels[0, 0].plot([], [], color=color, linestyle=style, linewidth=width, marker=marker, label=label)[0]
        for color, style, width, marker, label in (
            (GREY, "-", 0.6, ".", "trials with their ends"),
            (BLACK, "-", 1.0, "", "nominal"),
            (GREY, "-", 1.6, "", r"mean $\pm 3 \sigma$ at the trigger, all trials"),
            (BLACK, "--", 1.0, "", r"$\pm 3 \sigma$ at the trigger, linear covariance"),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
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
    reach = 0.0
    for covariance, color, style, label in curves:
        block = covariance[pair]
        if not np.isfinite(block).all():
            axes.plot([], [], color=color, linestyle=style, label=f"{label}: no finite gain")
            continue
        curve = ellipse(np.zeros(2), block, radius)
        reach = max(reach, np.abs(curve[:, 0]).max())
        correlation = block[0, 1] / np.sqrt(block[0, 0] * block[1, 1])
        axes.plot(
            curve[:, 0], curve[:, 1] / KM, color=color, linestyle=style, label=f"{label}: correlation {correlation:.2f}"
        )
    # Deviations that pass the trigger surface without range error: Z_f of Eq. 77, range row.
    velocity = np.array([-reach, reach])
    slope = linearization.trigger_projection[DOWNRANGE, VELOCITY]
    label = "no range error at the velocity trigger"
    axes.plot(velocity, -slope * velocity / KM, color=GREY, linewidth=0.8, label=label)
    axes.set(
        xlabel="velocity error (m/s)",
        ylabel="range error (km)",
        title=f"{100 * ELLIPSE_PROBABILITY:.2f} % ellipses at $t_f$ ({radius:.2f} sigma)",
    )
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def partition(design: Design, tradeoff: Tradeoff) -> Figure:
    """Range deviation and early control of the stochastic law against the interval of its partition."""
    figure, (axes, early) = new_figure(7.2, 3.6, ncols=2)
    for number, trigger in enumerate(TRIGGERS):
        curve = {"color": CASE_COLOR[f"stochastic_{trigger}"], "marker": "o", "markersize": 3.5}
        axes.loglog(tradeoff.interval, tradeoff.range_deviation[number], **curve, label=f"{trigger} trigger")
        axes.axhline(tradeoff.floor[number], color=curve["color"], linewidth=0.9, linestyle=":")
        early.loglog(tradeoff.interval, tradeoff.early_control[number], **curve)
    axes.plot([], [], color=GREY, linestyle=":", label="floor: noise after the last control")
    early.axhline(design.control_limit, color=BLACK, linewidth=0.9, linestyle="--", label="limit of the control")
    for panel in (axes, early):
        panel.axvline(design.partition_interval, color=GREY, linewidth=0.8, label="this reading's partition")
        panel.set_xticks(tradeoff.interval, [f"{interval:g}" for interval in tradeoff.interval], fontsize=7)
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xlabel("interval of the partition (s)")
    axes.set_ylabel("standard deviation of the range error (m)")
    early.set_ylabel(r"$3 \sigma$ of the bank cosine, first interval")
    _legends_below(figure, (axes, early))
    return figure


def altitude_tradeoff(design: Design, tradeoff: Tradeoff) -> Figure:
    """Range deviation of the stochastic law against the limit of the final altitude error."""
    figure, axes = new_figure(6.4, 3.8)
    for row, (interval, style, marker) in enumerate(
        zip(tradeoff.limited_interval, ("-", "--"), ("o", "s"), strict=True)
    ):
        for number, trigger in enumerate(TRIGGERS):
            axes.semilogy(
                tradeoff.altitude_limit / KM,
                tradeoff.limited_deviation[row, number],
                color=CASE_COLOR[f"stochastic_{trigger}"],
                linestyle=style,
                marker=marker,
                markersize=3.5,
                label=f"{trigger} trigger, intervals of {interval:g} s",
            )
    for number, trigger in enumerate(TRIGGERS):
        axes.axhline(tradeoff.floor[number], color=CASE_COLOR[f"stochastic_{trigger}"], linewidth=0.9, linestyle=":")
    axes.plot([], [], color=GREY, linestyle=":", label="floor: noise after the last control")
    axes.axvline(design.altitude_limit / KM, color=GREY, linewidth=0.8, label="limit of this reading")
    missing = np.isnan(tradeoff.limited_deviation).sum()
    axes.set(
        xlabel="limit of the final altitude error (km), held with three standard deviations",
        ylabel="standard deviation of the range error (m)",
        title=f"{missing} of {tradeoff.limited_deviation.size} designs are infeasible" if missing else "",
    )
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def error_budget(error_budget: ErrorBudget) -> Figure:
    """Share of every source of uncertainty in the variance of the final range error."""
    figure, panels = new_figure(7.4, 6.2, nrows=2, sharex=True, sharey=True)
    sources = [str(source) for source in error_budget.source]
    single = [k for k, source in enumerate(sources) if source != "all"]
    every = sources.index("all")
    places, width = np.arange(len(single) + 1), 0.26
    names = [*(sources[k].replace("flight ", "flight\n") for k in single), "sum of\nthese"]
    for number, axes in enumerate(panels):
        for row, law in enumerate(str(law) for law in error_budget.law):
            total = error_budget.deviation[row, number, every] ** 2
            shares = error_budget.deviation[row, number, single] ** 2 / total
            values = 100 * np.append(shares, shares.sum())
            at = places + (row - 1) * width
            axes.bar(
                at,
                np.nan_to_num(values),
                width,
                color=LAW_COLOR[law],
                label=f"{LAW_NAME[law]}: " + (f"all {np.sqrt(total):,.0f} m" if total > 0 else "no finite trial"),
            )
            least = 100 * error_budget.floor[number] ** 2 / total
            edges = at[sources.index("density")] + np.array([-0.5, 0.5]) * width
            axes.plot(edges, [least, least], color=BLACK, zorder=4)
        axes.axhline(100.0, color=GREY, linewidth=0.8, linestyle="--")
        axes.plot([], [], color=BLACK, label=f"floor of the density's part ({error_budget.floor[number]:,.0f} m)")
        axes.set(ylabel="share of the range variance (%)", title=f"{TRIGGERS[number]} trigger")
        axes.legend(loc="upper left", ncols=2)
    panels[0].set_ylim(0, 1.5 * panels[0].get_ylim()[1])  # room for the legends
    panels[-1].set_xticks(places, names, fontsize=8)
    panels[-1].set_xlabel(f"only source of uncertainty ({error_budget.trials:,} trials each)")
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
        if is_streamed(ensemble):
            range_error = FinalMoments(ensemble, slice(DOWNRANGE, DOWNRANGE + 1))
            measured = float(np.sqrt(range_error.variance[0]))
            error = float(range_error.covariance_errors[0, 0]) / (2 * measured)
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
                fontsize=7,
                rotation=0 if np.isfinite(value) else 90,
            )
        lost = np.count_nonzero(~np.isfinite(errors(ensemble)[:, DOWNRANGE]))
        if is_streamed(ensemble):
            lost = ensemble.excluded
        name = f"{LAW_NAME[law]}, {trigger}\n{ensemble.count + ensemble.excluded:,} trials"
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
    """Final range error, split by the number of bank reversals; of a streamed ensemble in its first trials."""
    figure, panels = new_figure(7.4, 5.4, nrows=2, ncols=2)
    cases = (
        ("Apollo, time", apollo_time),
        ("Apollo, velocity", apollo_velocity),
        ("stochastic, time", stochastic_time),
        ("stochastic, velocity", stochastic_velocity),
    )
    colors = (GREEN, BLUE, VERMILION, PURPLE, ORANGE, SKY, GREY)
    for axes, (case, ensemble) in zip(panels.flat, cases, strict=True):
        error = errors(ensemble)[:, DOWNRANGE] / KM
        finite = np.isfinite(error)
        title = f"{case}: {finite.sum():,} trials"
        if not finite.all():
            title += f", {np.count_nonzero(~finite):,} not finite"
        axes.set(title=title, xlabel="final range error (km)")
        _say_if_empty(axes, error)
        if not finite.any():
            continue
        error, number = error[finite], ensemble.final_state[finite, REVERSALS].astype(int)
        edges = np.linspace(*np.quantile(error, LEVELS), 61 if len(error) > 5000 else 21)
        weight = 1.0 / (len(error) * (edges[1] - edges[0]))
        counts = [n for n in np.unique(number) if (number == n).mean() >= LEAST_SHARE]
        for n in counts:
            of_n = error[number == n]
            inside = np.histogram(of_n, edges)[0] * weight
            color = colors[n % len(colors)]
            name = "reversal" if n == 1 else "reversals"
            axes.stairs(inside, edges, color=color, fill=True, alpha=0.25)
            axes.stairs(
                inside,
                edges,
                color=color,
                linewidth=1.2,
                label=f"{n} {name}, {100 * len(of_n) / len(error):.1f} %: mean {of_n.mean():+.2f}",
            )
        axes.stairs(np.histogram(error, edges)[0] * weight, edges, color=BLACK, linewidth=0.8, label="all")
        axes.axvline(0.0, color=GREY, linewidth=0.8)
        axes.margins(y=0.0)
        axes.set_ylim(0, 1.55 * axes.get_ylim()[1])  # room for the legend
        axes.legend(loc="upper left", fontsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("density (1/km)")
    return figure


def flown_variations(seed, atmosphere, trials):
    """Density variations of Monte Carlo trials at the nodes of the flight's atmosphere, (trials, nodes)."""
    from marsedl.montecarlo.streams import normals  # here, as it imports numba

    drawn = normals(seed, DENSITY_STREAM, trials, len(atmosphere.altitude))[:, ::-1]
    variation = density_variation.sample_exact(drawn, atmosphere.retention, atmosphere.deviation)
    return density_variation.density_factor(variation) - 1.0


def _densities(axes, edge, atmosphere, variations, color):
    """Samples against altitude up to the edge of the atmosphere (m), with twice the deviation that is aimed at."""
    shown = (atmosphere.altitude >= 0) & (atmosphere.altitude <= edge)
    for sample in variations:
        axes.plot(sample[shown], atmosphere.altitude[shown] / KM, color=color, linewidth=0.5, alpha=0.6)
    for sign in (-1, 1):
        axes.plot(sign * 2 * atmosphere.deviation[shown], atmosphere.altitude[shown] / KM, color=BLACK, linestyle="--")
    axes.set(xlabel="density variation, relative to the mean (1)", ylim=(0, edge / KM))


def _errors_over_time(drawing: Drawing, nominal, gains, number, ensembles):
    """Five rows of errors against time, a column for each law."""
    figure, panels = new_figure(7.4, 9.2, nrows=len(COMPONENTS), ncols=2, sharex=True, sharey="row")
    names = ("altitude", "velocity", "flight_path_angle", "downrange", "crossrange")
    for column, law, ensemble in zip(panels.T, LAWS, ensembles, strict=True):
        color = LAW_COLOR[law]
        enough = ensemble.flying >= drawing.fewest_flying
        predicted = getattr(gains, f"{law}_covariance")[number]
        for row, (axes, name, (component, unit, _)) in enumerate(zip(column, names, COMPONENTS, strict=True)):
            # The nominal has no state after its end, and so no error has a meaning there.
            reference = np.interp(ensemble.time, nominal.time, getattr(nominal, name), right=np.nan)
            for trial in ensemble.kept_history:
                axes.plot(
                    ensemble.time, (trial[:, component] - reference) / unit, color=color, linewidth=0.4, alpha=0.5
                )
            mean = np.where(enough, ensemble.mean[:, component] - reference, np.nan)
            spread = np.sqrt(ensemble.covariance[:, component, component])
            for sign in (-1, 1):
                axes.plot(ensemble.time, (mean + sign * 3 * spread) / unit, color=color, linewidth=1.4)
                if row < LINEAR:
                    bound = sign * 3 * np.sqrt(predicted[:, row, row])
                    axes.plot(gains.time, bound / unit, color=BLACK, linewidth=1.1, linestyle="--")
            _mark_alignment(axes, nominal)
            axes.set_xlim(0, nominal.end_time)
            _say_if_empty(axes, mean)
        lost = f", {ensemble.excluded:,} not finite" if ensemble.excluded else ""
        column[0].set_title(f"{LAW_NAME[law]}, {ensemble.count + ensemble.excluded:,} trials{lost}")
        column[-1].set_xlabel(TIME_LABEL)
    for axes, (_, _, label) in zip(panels[:, 0], COMPONENTS, strict=True):
        axes.set_ylabel(label)
    kept = len(ensembles[0].kept_history)
    handles = [
        panels[0, 0].plot([], [], color=color, linewidth=width, linestyle=style, label=label)[0]
        for color, width, style, label in (
            (GREY, 0.6, "-", f"{kept} trials"),
            (GREY, 1.8, "-", r"mean $\pm 3 \sigma$ of all trials"),
            (BLACK, 1.1, "--", r"$\pm 3 \sigma$, linear covariance"),
            (GREY, 0.8, ":", "heading alignment begins"),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _deviation(samples):
    """Standard deviation of the finite samples and its standard error; NaN of fewer than four."""
    samples = samples[np.isfinite(samples)]
    if samples.size < 4:
        return np.nan, np.nan
    variance = samples.var(ddof=1)
    fourth = ((samples - samples.mean()) ** 4).mean()
    return np.sqrt(variance), variance_standard_error(variance, fourth, samples.size) / (2 * np.sqrt(variance))


def _mark_alignment(axes, nominal):
    """The start of the nominal's heading alignment."""
    axes.axvline(nominal.alignment_time, color=GREY, linewidth=0.8, linestyle=":")


def _say_if_empty(axes, values):
    if not np.isfinite(values).any():
        axes.text(0.5, 0.92, "no finite trial", transform=axes.transAxes, ha="center", va="top", color=GREY)


def _legends_below(figure, panels):
    handles = [handle for axes in panels for handle in axes.get_legend_handles_labels()[0]]
    known = {handle.get_label(): handle for handle in handles}
    figure.legend(handles=list(known.values()), loc="outside lower center", ncols=min(3, len(known)))


def _arrow(color, width):
    return {"arrowstyle": "-|>", "color": color, "linewidth": width, "shrinkA": 0, "shrinkB": 0}


def _vehicle_frame(longitude, latitude):
    """Up, east and north at a place (Eq. 92), unit vectors; the first axis points to the right, the second away."""
    cosine, sine = np.cos(longitude), np.sin(longitude)
    up = np.array([np.cos(latitude) * sine, -np.cos(latitude) * cosine, np.sin(latitude)])
    east = np.array([cosine, sine, 0.0])
    return up, east, np.cross(up, east)


def _projection(turn, tilt):
    """Orthographic view from the front, turned about the polar axis and from above: (..., 3) to (..., 2)."""
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    away = np.array([-np.sin(turn), np.cos(turn), 0.0])
    upwards = np.cos(tilt) * np.array([0.0, 0.0, 1.0]) + np.sin(tilt) * away
    plane = np.stack([right, upwards, np.cross(right, upwards)], axis=-1)

    def project(points, depth=False):
        seen = np.asarray(points) @ plane
        return seen if depth else seen[..., :2]

    return project


def _great_circle(start, end, points=101):
    """The shorter arc of the unit sphere between two of its points, (points, 3)."""
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    share = np.linspace(0.0, 1.0, points)[:, np.newaxis]
    return (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)


def _on_sphere(axes, project, circle, color, width):
    """A circle on the sphere, faint where the sphere hides it."""
    seen = project(circle, depth=True)
    in_front = seen[:, 2] >= 0
    for visible, alpha, style in ((in_front, 1.0, "-"), (~in_front, 0.5, ":")):
        curve = np.where(visible[:, np.newaxis], seen[:, :2], np.nan)
        axes.plot(*curve.T, color=color, linewidth=width, alpha=alpha, linestyle=style)


def _arrow_3d(axes, project, start, end, color, name, offset):
    start, end = project(start), project(end)
    axes.annotate("", end, start, arrowprops=_arrow(color, 1.2))
    axes.annotate(name, end, offset, textcoords="offset points", color=color)
