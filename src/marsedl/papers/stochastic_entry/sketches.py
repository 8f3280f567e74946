"""Schematic drawings of the paper; they show no results."""

import numpy as np
from matplotlib.figure import Figure

from marsedl.elementary import sine_cosine
from marsedl.methods.guidance.targeting import targeting
from marsedl.plotting.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure
from marsedl.replication.units import DEGREE


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
    for end, color, width in (((tip[0], 0.0), ORANGE, 1.6), ((0.0, tip[1]), GREEN, 1.6), (tip, BLUE, 2.0)):
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


def fig03() -> Figure:
    """Downrange-to-go and crossrange angle of a target, and the frames in which they are found."""
    figure, axes = new_figure(5.6, 5.4)
    # Exaggerated: in the flight, the crossrange is a thousandth of the range to go.
    longitude, latitude, azimuth, rotation = -28 * DEGREE, 4 * DEGREE, 68 * DEGREE, 35 * DEGREE
    target_longitude, target_latitude, height = 38 * DEGREE, 50 * DEGREE, 1.12
    downrange, crossrange = targeting(
        longitude, latitude, height, 1.0, 0.0, azimuth, 0.0, target_longitude, sine_cosine(target_latitude)
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
    for points, color in ((_great_circle(up, target), BLUE), (_great_circle(foot, target), VERMILION)):
        axes.plot(*project(points).T, color=color, linewidth=2.2)
    for end, color in ((height * up, BLACK), (target, BLACK), (foot, GREEN)):
        axes.plot(*project(np.stack([0 * end, end])).T, color=color, linewidth=0.8, linestyle="--")
        axes.plot(*project(end), "o", color=color, markersize=4)
    _arrow_3d(axes, project, np.zeros(3), 0.62 * momentum, GREEN, r"$\hat h$", (-12, 2))
    vehicle = height * up
    _arrow_3d(axes, project, vehicle, vehicle + 0.42 * heading, PURPLE, r"$\vec V_I$", (4, -12))
    for direction, name, offset in (
        (up, r"$\hat\imath^R$ (up)", (-30, -10)),
        (east, r"$\hat\jmath^R$ (east)", (-10, -19)),
        (north, r"$\hat k^R$ (north)", (-4, 4)),
    ):
        _arrow_3d(axes, project, vehicle, vehicle + 0.3 * direction, BLACK, name, offset)
    cosine, sine = np.cos(rotation), np.sin(rotation)
    frames = (
        (np.array([0.0, -1.0, 0.0]), r"$\hat\imath^I$", (-10, -8), GREY),
        (np.array([1.0, 0.0, 0.0]), r"$\hat\jmath^I$", (2, -10), GREY),
        (np.array([sine, -cosine, 0.0]), r"$\hat\imath^F$", (-2, -12), ORANGE),
        (np.array([cosine, sine, 0.0]), r"$\hat\jmath^F$", (4, -4), ORANGE),
        (np.array([0.0, 0.0, 1.0]), r"$\hat k^I = \hat k^F$", (-12, 8), ORANGE),
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
    name(vehicle, r"$\vec r$", BLACK, (-5, -16))
    name(orbit[np.searchsorted(turn, 1.5)], "orbit plane", GREEN, (4, -12))
    axes.set(aspect="equal", xlim=(-1.15, 1.05), ylim=(-1.02, 1.02))
    axes.set_axis_off()
    axes.set_title(
        rf"not to scale: drawn with $\delta_{{go}}$ = {downrange / DEGREE:.0f} deg and "
        rf"$\varepsilon$ = {crossrange / DEGREE:.0f} deg"
    )
    return figure


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
        in_view = np.asarray(points) @ plane
        return in_view if depth else in_view[..., :2]

    return project


def _great_circle(start, end, points=101):
    """The shorter arc of the unit sphere between two of its points, (points, 3)."""
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    share = np.linspace(0.0, 1.0, points)[:, np.newaxis]
    return (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)


def _on_sphere(axes, project, circle, color, width):
    """A circle on the sphere, faint where the sphere hides it."""
    in_view = project(circle, depth=True)
    in_front = in_view[:, 2] >= 0
    for visible, alpha, style in ((in_front, 1.0, "-"), (~in_front, 0.5, ":")):
        curve = np.where(visible[:, np.newaxis], in_view[:, :2], np.nan)
        axes.plot(*curve.T, color=color, linewidth=width, alpha=alpha, linestyle=style)


def _arrow_3d(axes, project, start, end, color, name, offset):
    start, end = project(start), project(end)
    axes.annotate("", end, start, arrowprops=_arrow(color, 1.2))
    axes.annotate(name, end, offset, textcoords="offset points", color=color)
