"""Funnels and desensitized trajectories of vehicles that are steered too: against flights by SciPy."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import interp1d

from marsedl.design import Gain, Sensitivity, desensitize, optimal
from marsedl.design.funnel import funnel
from marsedl.fly import Above, Below

sys.path.insert(0, __file__.rpartition("/")[0])
import vehicles as v

ANGLE = np.radians(0.05)
CAPSULE_SIZES = np.array([400.0, 10.0, ANGLE, 1000.0])


# Rates, p with noise in its own unit, time, command, start, semi-axes, weights, disturbances.
FUNNELS = {
    "line": (
        *(v.line_rates, v.Pushed(1.0), np.linspace(0.0, 4.0, 81), [0.1]),
        *([0.0, 0.0], [0.5, 0.1], ([1.0, 1.0], [1.0], [1.0, 1.0]), v.Gust(0.05)),
    ),
    "satellite": (
        *(v.satellite_rates, v.Orbit(noise=1.0), np.linspace(0.0, 600.0, 61), [0.0, 0.0]),
        *([-400.0, -2000.0, 0.0, 0.7], [20.0, 20.0, 0.05, 0.05]),
        ([1e-4, 1e-4, 1.0, 1.0], [100.0, 100.0], [0.06, 0.06, 600.0, 600.0]),
        v.Jets(1e-4, 1e-4),
    ),
    "car": (
        *(v.car_rates, v.Road(1.0, 1.0), np.linspace(0.0, 4.0, 81), [0.02, 0.2]),
        *([0.0, 0.0, 0.0, 8.0], [0.3, 0.3, 0.05, 0.2]),
        ([1.0, 1.0, 10.0, 1.0], [100.0, 1.0], [1.0, 1.0, 10.0, 1.0]),
        v.Wheels(0.02, 0.1),
    ),
    "capsule": (
        *(v.capsule_rates, v.Capsule(density_noise=1.0), np.linspace(0.0, 60.0, 61), [0.14]),
        *([60e3, 5300.0, np.radians(-10.0), 0.0], CAPSULE_SIZES),
        (CAPSULE_SIZES**-2 / 150.0, [1.0 / 1.5], CAPSULE_SIZES**-2),
        v.Density(0.02),
    ),
}


@pytest.mark.parametrize("name", FUNNELS)
def test_flights_by_another_integrator_stay_in_proven_funnels(name):
    rates, p, time, command, start, semi_axes, weights, bounds = FUNNELS[name]
    tube = funnel(rates, p, time, command, start, semi_axes, weights=weights, disturbances=bounds, proven=True)
    assert tube.holds(3, compiled=False)
    random, loop = np.random.default_rng(0), tube.loop
    halves = np.interp(np.arange(2 * len(time) - 1) / 2.0, np.arange(len(time)), time)
    tables = np.hstack([loop.states, loop.controls, loop.gains.reshape(len(halves), -1)])
    about = interp1d(halves, tables, axis=0)
    n, m = len(start), loop.controls.shape[1]

    def slope(at, state, push):
        reference, commands, gains = np.split(about(at), [n, n + m])
        return tube.dynamics(*state, *(commands + gains.reshape(m, n) @ (state - reference)), *push)

    def drawn(size):
        direction = random.standard_normal(size)
        return direction / np.linalg.norm(direction)

    edge = np.linalg.cholesky(np.linalg.inv(tube.shapes[0])) * np.sqrt(2.0 * tube.levels[0])
    state, push = loop.states[0] + edge @ drawn(n), np.array(bounds) * drawn(len(bounds))
    tolerance = {"rtol": 1e-6, "atol": 1e-6 * np.array(semi_axes), "max_step": time[-1] / 20.0}
    found = solve_ivp(slope, (0.0, time[-1]), state, args=(push,), t_eval=time, **tolerance).y.T - loop.states[::2]
    values = 0.5 * np.einsum("ki,kij,kj->k", found, tube.shapes, found)
    assert values[0] == pytest.approx(tube.levels[0]) and (values[1:] < tube.levels[1:] * (1.0 + 1e-3)).all()


def flown(reference, p):
    """States at the end under the commands of a reference, by SciPy."""
    vectors = reference.task.vectors._replace(fixed={"p": p})
    state, calm = np.array(reference.task.start), [0.0] * len(vectors.names.get("noise", ()))
    spans = zip(pairwise(reference.time), np.transpose(reference.commands), strict=True)
    for span, commands in spans:
        numbers = [*commands, *calm]
        state = solve_ivp(lambda _, at, held: vectors(*at, *held), span, state, args=(numbers,), rtol=1e-9).y[:, -1]
    return state


def test_a_capsule_whose_end_is_mostly_free_is_desensitized_to_its_air():
    """The search begins on the flight of the guess: a straight line at entry speed ends nowhere."""
    start, goal = (60e3, 5300.0, np.radians(-10.0), 0.0), (np.nan, np.nan, np.nan, 400e3)
    limits = [Below("lift_to_drag", 0.3), Above("lift_to_drag", -0.05)]
    best = optimal(v.capsule_rates, v.Capsule(), start, goal, 150.0, lambda command: command.lift_to_drag**2, limits,
                   (0.14,), scales={"flight_path_angle": 0.2})  # fmt: skip
    np.testing.assert_allclose(flown(best, v.Capsule()), [column[-1] for column in best.flown], rtol=1e-4)
    denser, feedback = 0.05 * 0.0159, Gain("lift_to_drag", "velocity", lower=-1e-3, upper=1e-3)
    robust = desensitize(best, 1e-6, Sensitivity("downrange", "surface_density", denser), gains=[feedback])
    moved = flown(best, v.Capsule(surface_density=0.0159 + denser))[3] - best.flown.downrange[-1]
    np.testing.assert_allclose(robust.table["flown"][0], moved, rtol=1e-3)
    np.testing.assert_allclose(robust.table["predicted"][0], moved, rtol=0.05)
    assert abs(robust.table["flown"][1]) < 0.01 * abs(moved)


def test_a_car_is_desensitized_to_its_heading_and_its_speed():
    errors = [Sensitivity("north", "heading", 0.02), Sensitivity("east", "speed", 0.2)]
    gains = [Gain("curvature", "heading", lower=-0.5, upper=0.0), Gain("acceleration", "speed", lower=-1.0, upper=0.0)]
    best = optimal(v.car_rates, v.Road(), *(v.CAR.start[0], v.CAR.goal[0]), 10.0,
                   lambda command: 1e3 * command.curvature**2 + command.acceleration**2, [Below("north", 21.0)],
                   (0.0, 0.2))  # fmt: skip
    table = desensitize(best, 1.0, errors, gains=gains).table
    np.testing.assert_allclose(table["predicted"][:2], table["flown"][:2], rtol=0.01)
    # Two turns cancel but for what lies between them: the end is moved by the way times the sine of the error.
    assert table["flown"][0] == pytest.approx(80.0 * np.sin(0.02) + 20.0 * (np.cos(0.02) - 1.0), rel=1e-6)
    assert (table["flown"][2:].abs().to_numpy() < 0.15 * table["flown"][:2].abs().to_numpy()).all()


def test_a_vehicle_is_written_and_steered_in_25_lines():
    _, *vehicles = Path(v.__file__).read_text(encoding="utf-8").split("\n# ---- ")
    assert len(vehicles) == len(v.CASES)
    lines = {text.split(" -")[0]: len([line for line in text.splitlines()[1:] if line.strip()]) for text in vehicles}
    assert max(lines.values()) <= 25, lines
