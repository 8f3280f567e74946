"""Optimal references against closed forms, flown again, and with what is wrong told in a sentence."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

from marsedl.design import optimal
from marsedl.elementary import sine_cosine
from marsedl.fly import Above, Below
from marsedl.methods.collocation import NotConvergedError


class Cart(NamedTuple):
    x: float
    v: float


class Push(NamedTuple):
    push: float


class Gust(NamedTuple):
    gust: float


class Weight(NamedTuple):
    mass: float = 2.0


def rolls(state, command: Push, noise: Gust, p) -> Cart:
    return Cart(state.v, (command.push + noise.gust) / p.mass)


def square(command):
    return command.push**2


BOTH = [Below("push", 2.0), Above("push", -2.0)]
REST, AHEAD = Cart(0.0, 0.0), Cart(9.0, 0.0)


def best(goal=AHEAD, time=(1.0, 20.0), objective="time", limits=BOTH, guess=(0.5,), start=REST, **options):
    return optimal(rolls, Weight(), start, goal, time, objective, limits, guess, **{"intervals": 40} | options)


def test_least_effort_of_a_double_integrator_is_a_cubic():
    """With commands held over N intervals, least int u^2 of a unit mass is 12 / (1 - 1 / N^2), at 6 - 12 t."""
    n = 40
    found = best(Cart(1.0, 0.0), 1.0, square, limits=())
    cost, mass = 12.0 / (1.0 - 1.0 / n**2), 2.0
    assert found.status == "Solve_Succeeded" and found.iterations > 0
    np.testing.assert_allclose(found.objective, mass**2 * cost, rtol=1e-8)
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    np.testing.assert_allclose(found.commands.push, mass * cost * (0.5 - middle), atol=1e-6)
    np.testing.assert_allclose(found.states.x, found.time**2 * (3.0 - 2.0 * found.time), atol=1e-3)
    np.testing.assert_allclose(found.flown, found.states, atol=1e-7)
    np.testing.assert_allclose(found.miss, 0.0, atol=1e-7)


def test_what_the_goal_leaves_out_is_free():
    n = 40
    found = best((1.0, np.nan), 1.0, square, limits=())
    np.testing.assert_allclose(found.objective, 4.0 / (1.0 / 3.0 - 1.0 / (12.0 * n**2)), rtol=1e-8)
    assert np.isnan(found.miss.v) and abs(found.miss.x) < 1e-7


@pytest.mark.parametrize("of_function", [False, True])
def test_least_time_is_bang_bang(of_function):
    """The switch lies at a bound of intervals, so that the time is 2 sqrt(d / a) itself."""
    limits = [Below(lambda command: command.push**2, 4.0)] if of_function else BOTH
    found = best(limits=limits)
    np.testing.assert_allclose(found.time[-1], 2.0 * np.sqrt(9.0 / 1.0), rtol=1e-6)
    np.testing.assert_allclose(found.commands.push, np.repeat([2.0, -2.0], 20), atol=1e-3)


def test_a_limit_of_the_speed_cuts_the_top():
    """A quarter of the time each for speeding up and slowing down: d / v + v / a."""
    for limit in (Below("v", 2.0), Below(lambda state: state.v, 2.0)):
        found = best(Cart(12.0, 0.0), limits=[*BOTH, limit])
        np.testing.assert_allclose(found.time[-1], 12.0 / 2.0 + 2.0 / 1.0, rtol=1e-6)
        assert found.states.v.max() < 2.0 + 1e-6


class Bead(NamedTuple):
    across: float
    down: float
    speed: float


class Slope(NamedTuple):
    angle: float  # below the horizontal


def slides(state, command: Slope) -> Bead:
    sine, cosine = sine_cosine(command.angle)
    return Bead(state.speed * cosine, state.speed * sine, 9.81 * sine)


def test_the_brachistochrone_is_a_cycloid():
    across, down = 10.0, 5.0
    turn = brentq(lambda t: (t - np.sin(t)) / (1.0 - np.cos(t)) - across / down, 0.1, 6.0)
    expected = turn * np.sqrt(down / (1.0 - np.cos(turn)) / 9.81)
    errors = []
    for intervals in (10, 20):
        found = optimal(slides, None, (0.0, 0.0, 0.0), (across, down, np.nan), (0.5, 5.0), "time", guess=(0.5,),
                        intervals=intervals, scales={"speed": 10.0})  # fmt: skip
        errors.append(found.time[-1] / expected - 1.0)
        assert np.abs(found.miss[:2]).max() < 1e-6
    assert 0.0 < errors[1] < 5e-4 and 3.0 < errors[0] / errors[1] < 5.0, "held commands cost an error of order two"


def test_the_end_may_be_the_objective_and_a_reference_the_guess():
    found = best((np.nan, 0.0), 6.0, lambda end: -end.x)
    np.testing.assert_allclose(found.states.x[-1], 9.0, rtol=1e-6)
    again = best((np.nan, 0.0), 6.0, lambda end: -end.x, guess=found, intervals=20)
    np.testing.assert_allclose(again.states.x[-1], 9.0, rtol=1e-6)


class Shove(NamedTuple):
    x: float


def shoved(state, command: Shove) -> Cart:
    return Cart(state.v, command.x)


def test_a_command_may_be_called_like_a_state():
    limits = [Below("command.x", 1.0), Above("command.x", -1.0)]
    found = optimal(shoved, None, REST, AHEAD, (1.0, 20.0), "time", limits, (0.5,))
    np.testing.assert_allclose(found.time[-1], 6.0, rtol=1e-6)


def of_time(state, command: Push, time) -> Cart:
    return Cart(state.v, command.push + time)


MISUSES = [
    ({"start": (0.0, 0.0, 0.0)}, r"start must be 2 numbers, x, v, not of shape \(3,\)"),
    ({"start": (0.0, np.nan)}, "start is .*all of its numbers must be given"),
    ({"goal": (np.inf, 0.0)}, "goal is .*give finite numbers, or NaN for what is free"),
    ({"time": (5.0, 1.0)}, r"time is \(5.0, 1.0\); give the seconds"),
    ({"objective": "fuel"}, "objective is 'fuel'; give a function, or 'time'"),
    ({"objective": lambda commands: 1.0}, "asks for 'commands'; did you mean 'command'"),
    ({"limits": [Below("pull", 1.0)]}, r"limits\[0\]: 'pull' is unknown; .*There are: x, v, push"),
    ({"limits": [("push", 1.0)]}, "give Below"),
    (
        {"limits": [Below(lambda speed: speed, 1.0)]},
        r"limits\[0\]: .* asks for speed; it may ask for state, command, p",
    ),
    ({"limits": [Below("x", 5.0)]}, r"goal violates limits\[0\], x below 5, and it is 9 there"),
    (
        {"limits": [Above(lambda state: state.x, 1.0)]},
        r"start violates limits\[0\], a function of the state above 1, and it is 0 there",
    ),
    ({"guess": (0.0, 0.0)}, r"guess must be finite commands, push, of shape \(1,\) or \(40, 1\)"),
    ({"guess": np.zeros((7, 1))}, r"guess must be finite commands, push, of shape \(1,\) or \(40, 1\)"),
    ({"scales": {"push": 0.0}}, "push: the scale must be positive and finite, got 0"),
    ({"scales": {"pull": 1.0}}, "scales: 'pull' is neither state nor command; There are: x, v, push"),
]


@pytest.mark.parametrize(("options", "told"), MISUSES)
def test_misuses_are_told_before_anything_is_solved(options, told):
    with pytest.raises(ValueError, match=told):
        best(**options)


def test_rates_of_the_time_and_what_cannot_be_reached_are_told():
    with pytest.raises(ValueError, match="asks for the time: make it a state whose rate is 1"):
        optimal(of_time, None, REST, AHEAD, 1.0, "time")
    with pytest.raises(NotConvergedError, match="the worst constraint is"):
        best(time=5.0, objective=square)
