"""Schematic drawings of the paper: the mission, the vehicle and the forces on it; they show no results."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.inputs import Inputs, Mission, Planet
from marsedl.papers.random_field.records import Nominal
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILION, new_figure
from marsedl.replication.units import DEGREE, KM

SURFACE = "#FBEBCB"  # the planet
SHORTFALL = 0.2  # of the climb from exit to target, by which the orbit of Fig. 6 falls short


def fig06(given: Inputs, nominal: Nominal) -> Figure:
    """The mission to scale: approach, flight through the atmosphere, and the orbits between the burns."""
    figure, (whole, close) = new_figure(6.6, 6.8, nrows=2, height_ratios=(4.2, 1))
    plan = mission_plan(given.planet, given.mission, nominal)
    turn = np.linspace(0.0, 2 * np.pi, 721)
    ceiling = 1.0 + given.vehicle.entry_altitude / given.planet.planet_radius
    whole.fill(*_clockwise(turn, ceiling).T, color=SKY, alpha=0.5, linewidth=0, zorder=1.5)
    whole.fill(*_clockwise(turn, 1.0).T, facecolor=SURFACE, edgecolor=GREY, zorder=1.6)
    for curve, color, width, label in (
        (plan.approach, GREY, 1.2, "approach"),
        (plan.flight, VERMILION, 2.4, "atmospheric flight"),
        (plan.coast, ORANGE, 1.2, "coast to the exit apoapsis"),
        (plan.second_coast, BLUE, 1.2, "coast to the target periapsis"),
        (plan.target, GREEN, 1.2, "target orbit"),
    ):
        points = _clockwise(*curve)
        whole.plot(*points.T, color=color, linewidth=width, label=label)
        if curve is not plan.flight:
            start = int(0.62 * len(points))
            whole.annotate("", points[start + 1], points[start], arrowprops={"arrowstyle": "-|>", "color": color})
    line = np.array([-plan.target_apoapsis, plan.target_periapsis])
    whole.plot(line, 0 * line, color=GREY, linewidth=0.6, linestyle=":", zorder=1)
    for place, burn, symbol, aside in (
        # Nothing is stated of the exit's orbit, which is only an example.
        (-plan.exit_apoapsis, "periapsis raise $\\Delta v_1$", "$r_{a,ex}$", 8),
        (
            plan.target_periapsis,
            "apoapsis clean-up $\\Delta v_2$",
            f"$r_{{p,targ}}$ = {plan.target_periapsis:.2f} $r_p$",
            8,
        ),
        (-plan.target_apoapsis, "", f"$r_{{a,targ}}$ = {plan.target_apoapsis:.2f} $r_p$", -8),
    ):
        style = {"textcoords": "offset points", "fontsize": 8, "ha": "left" if aside > 0 else "right"}
        whole.annotate(burn, (place, 0.0), (aside, 5), va="bottom", **style)
        whole.annotate(symbol, (place, 0.0), (aside, -5), va="top", **style)
        whole.plot(place, 0.0, "o" if burn else "|", color=BLACK, markersize=5, zorder=5)
    whole.annotate("planet", (0.0, 0.0), ha="center", va="center", fontsize=8)
    height = 1.06 * np.abs(_clockwise(*plan.target)[:, 1]).max()
    reached = "is not captured"
    if np.isfinite(nominal.apoapsis):
        reached = f"reaches $r_{{a,ex}}$ = {nominal.apoapsis:.2f} $r_p$, which takes {nominal.delta_v:.1f} m/s in all"
    whole.set(
        aspect="equal",
        xlim=(-1.32 * plan.target_apoapsis, plan.target_periapsis + 0.36 * plan.target_apoapsis),
        ylim=(-height, height),
        title=f"to scale, an example of an exit short of the target; the flight without control\n{reached}",
    )
    whole.set_axis_off()

    travelled = (plan.flight[0] - plan.flight[0, 0]) * given.planet.planet_radius / KM
    close.axhspan(0.0, given.vehicle.entry_altitude / KM, color=SKY, alpha=0.3, linewidth=0)
    close.plot(travelled, nominal.altitude / KM, color=VERMILION, linewidth=2.4)
    for name, at in (("entry", 0), ("exit", -1)):
        spot = travelled[at], nominal.altitude[at] / KM
        close.plot(*spot, "o", color=VERMILION, markersize=4, clip_on=False, zorder=5)
        close.annotate(name, spot, (0, 5), textcoords="offset points", ha="center", fontsize=8)
    close.set(xlabel="distance travelled over the ground (km)", ylabel="altitude (km)")
    close.set_ylim(0, 1.2 * max(given.vehicle.entry_altitude, nominal.altitude.max()) / KM)
    figure.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def fig07() -> Figure:
    """Radius, velocity, flight path angle, lift and drag of the vehicle above the planet."""
    figure, axes = new_figure(5.0, 4.6)
    path, vehicle = 24 * DEGREE, np.array([0.0, 1.0])
    turn = np.linspace(50 * DEGREE, 130 * DEGREE, 100)
    surface = 0.62 * np.column_stack([np.cos(turn), np.sin(turn)])
    forward = np.array([np.cos(path), np.sin(path)])
    upward = np.array([-np.sin(path), np.cos(path)])
    axes.fill(*np.vstack([surface, [[0.0, 0.0]]]).T, color=SURFACE, linewidth=0)
    axes.plot(*surface.T, color=GREY)
    axes.plot([0, 0], [0, 1], color=BLACK, linewidth=0.9, linestyle="--")
    axes.plot([-0.42, 0.62], [1, 1], color=GREY, linewidth=0.9, linestyle="--")
    axes.plot(0, 0, "o", color=BLACK, markersize=3)
    for direction, length, color, name, offset in (
        (forward, 0.52, BLUE, "$v$", (6, 2)),
        (upward, 0.36, GREEN, "$L$", (-12, 2)),
        (-forward, 0.36, VERMILION, "$D$", (-14, -10)),
    ):
        _arrow(axes, vehicle, vehicle + length * direction, color, name, offset)
    angle = np.linspace(0.0, path, 30)
    axes.plot(0.33 * np.cos(angle), 1 + 0.33 * np.sin(angle), color=BLACK, linewidth=0.9)
    axes.annotate(r"$\gamma$", (0.36 * np.cos(path / 2), 1 + 0.36 * np.sin(path / 2)), va="center", fontsize=11)
    axes.plot(*vehicle, "o", color=BLACK, markersize=7, zorder=5)
    axes.annotate("$r$", (0.02, 0.82), va="center", fontsize=11)
    axes.annotate("local horizontal", (-0.42, 0.985), color=GREY, fontsize=8, va="top")
    axes.annotate("planet", (-0.2, 0.4), color=GREY, fontsize=8, ha="center")
    axes.set(aspect="equal", xlim=(-0.5, 0.68), ylim=(-0.04, 1.42))
    axes.set_axis_off()
    return figure


def fig08() -> Figure:
    """Angle of attack from the side, and from behind the lift rolled by the bank angle."""
    figure, (side, rear) = new_figure(7.2, 3.0, ncols=2)
    attack, bank, origin = 20 * DEGREE, 40 * DEGREE, np.zeros(2)
    axis = np.array([np.cos(attack), -np.sin(attack)])
    # Most of the force on a blunt body acts along its axis, so that it flies nose down for lift upwards.
    across = np.array([np.sin(attack), np.cos(attack)])
    bow = np.linspace(-1.0, 1.0, 41)
    outline = np.vstack(
        [
            np.outer(0.14 * (1 - bow**2) + 0.12, axis) + np.outer(0.5 * bow, across),
            np.outer([-0.5, -0.5], axis) + np.outer([0.16, -0.16], across),
        ]
    )
    side.fill(*outline.T, facecolor=GREY, alpha=0.3, linewidth=0)
    side.plot(*np.vstack([outline, outline[:1]]).T, color=GREY)
    side.plot(*np.outer([-0.75, 1.15], axis).T, color=BLACK, linewidth=0.9, linestyle="--")
    side.annotate("body axis", 1.15 * axis, (-4, -4), textcoords="offset points", ha="center", va="top", fontsize=8)
    for end, color, name, offset in (
        ((1.2, 0.0), BLUE, "$v$", (4, -3)),
        ((0.0, 0.8), GREEN, "$L$", (4, -4)),
        ((-0.95, 0.0), VERMILION, "$D$", (-4, 5)),
    ):
        _arrow(side, origin, np.array(end), color, name, offset)
    angle = np.linspace(0.0, attack, 30)
    side.plot(0.88 * np.cos(angle), -0.88 * np.sin(angle), color=BLACK, linewidth=0.9)
    side.annotate(r"$\alpha$", (0.93 * np.cos(attack / 2), -0.93 * np.sin(attack / 2)), va="center", fontsize=11)
    side.set(aspect="equal", xlim=(-1.1, 1.4), ylim=(-0.7, 1.1), title="from the side")

    turn = np.linspace(0.0, 2 * np.pi, 200)
    for radius in (0.5, 0.16):
        rear.plot(radius * np.cos(turn), radius * np.sin(turn), color=GREY)
    rear.plot([0, 0], [-0.65, 1.0], color=GREY, linewidth=0.9, linestyle="--")
    lift = 0.95 * np.array([np.sin(bank), np.cos(bank)])
    rear.plot([0.0, lift[0]], [lift[1], lift[1]], color=GREY, linewidth=0.9, linestyle=":")
    _arrow(rear, origin, np.array([0.0, lift[1]]), ORANGE, r"$L\,\cos\sigma = L\,u$", (-76, -6))
    _arrow(rear, origin, lift, GREEN, "$L$", (4, 0))
    angle = np.linspace(0.0, bank, 30)
    rear.plot(0.7 * np.sin(angle), 0.7 * np.cos(angle), color=BLACK, linewidth=0.9)
    rear.annotate(
        r"$\sigma$", (0.63 * np.sin(bank / 2), 0.63 * np.cos(bank / 2)), ha="center", va="center", fontsize=11
    )
    rear.annotate("local vertical plane", (0.0, 1.02), color=GREY, fontsize=8, ha="center")
    rear.set(aspect="equal", xlim=(-1.1, 1.4), ylim=(-0.7, 1.1), title="from behind, along the velocity")
    for axes in (side, rear):
        axes.set_axis_off()
    return figure


class MissionPlan(NamedTuple):
    """The orbits of Fig. 6, angles from the target periapsis in the sense of motion, radii in radii of the planet."""

    approach: np.ndarray  # angle and radius, (2, k)
    flight: np.ndarray  # (2, k)
    coast: np.ndarray  # (2, k), to the exit apoapsis at the angle pi
    second_coast: np.ndarray  # (2, k), from there to the target periapsis
    target: np.ndarray  # (2, k)
    exit_apoapsis: float
    target_periapsis: float
    target_apoapsis: float


def mission_plan(planet: Planet, mission: Mission, nominal) -> MissionPlan:
    """The nominal flight, left at a lower velocity, so that its apoapsis falls short of the target.

    The nominal reaches the target of itself where the entry angle is solved, and then there is no second burn to draw.
    """
    target_apoapsis, target_periapsis, gravity = targets(planet, mission)
    radius = planet.planet_radius + nominal.altitude
    path = nominal.flight_path_angle
    apoapsis = radius[-1] + (1.0 - SHORTFALL) * (target_apoapsis - radius[-1])
    # Energy and angular momentum at the exit are those at the apoapsis.
    tangential = radius[-1] * np.cos(path[-1]) / apoapsis
    velocity = np.sqrt(2.0 * gravity * (1.0 / radius[-1] - 1.0 / apoapsis) / (1.0 - tangential**2))

    exit_anomaly, coast = _conic(radius[-1], velocity, path[-1], gravity)
    coast_anomaly = np.linspace(exit_anomaly, np.pi, 361)
    rate = nominal.velocity * np.cos(path) / radius
    turned = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(nominal.time)))
    angle = exit_anomaly + turned - turned[-1]
    entry_anomaly, approach = _conic(radius[0], nominal.velocity[0], path[0], gravity)
    back = np.linspace(0.0, np.pi, 2001)
    before = approach(entry_anomaly - back)
    # As far as the approach leads outwards, and no further than the target orbit.
    beyond = ~((before > 0.0) & (before < target_apoapsis))
    anomaly = back[: int(np.argmax(beyond)) if beyond.any() else None]
    turn = np.linspace(0.0, 2 * np.pi, 721)
    half, unit = turn[turn >= np.pi], planet.planet_radius
    return MissionPlan(
        approach=np.array([angle[0] - anomaly, approach(entry_anomaly - anomaly) / unit])[:, ::-1],
        flight=np.array([angle, radius / unit]),
        coast=np.array([coast_anomaly, coast(coast_anomaly) / unit]),
        second_coast=np.array([half, _ellipse_radius(half, target_periapsis, apoapsis) / unit]),
        target=np.array([turn, _ellipse_radius(turn, target_periapsis, target_apoapsis) / unit]),
        exit_apoapsis=float(apoapsis / unit),
        target_periapsis=float(target_periapsis / unit),
        target_apoapsis=float(target_apoapsis / unit),
    )


def _conic(radius, velocity, flight_path_angle, gravity):
    """True anomaly at a point of an orbit, and the orbit's radius as a function of the anomaly; infinite beyond it."""
    parameter = (radius * velocity * np.cos(flight_path_angle)) ** 2 / gravity
    radial = np.sqrt(parameter / gravity) * velocity * np.sin(flight_path_angle)  # e sin(anomaly)
    eccentricity = np.hypot(parameter / radius - 1.0, radial)
    anomaly = np.arctan2(radial, parameter / radius - 1.0)

    def radius_at(angle):
        inverse = 1.0 + eccentricity * np.cos(angle)
        return np.where(inverse > 0.0, parameter / np.where(inverse > 0.0, inverse, 1.0), np.inf)

    return anomaly, radius_at


def _ellipse_radius(angle, periapsis, apoapsis):
    """Radius of an orbit whose periapsis lies at the angle zero."""
    return 2.0 * periapsis * apoapsis / (periapsis + apoapsis + (apoapsis - periapsis) * np.cos(angle))


def _clockwise(angle, radius):
    """Points (k, 2) of a motion that is drawn clockwise, so that the flight runs to the right when it is on top."""
    return np.stack([radius * np.cos(angle), -radius * np.sin(angle)], axis=-1)


def _arrow(axes, start, end, color, name, offset):
    style = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style)
    axes.annotate(name, end, offset, textcoords="offset points", color=color, fontsize=11)
