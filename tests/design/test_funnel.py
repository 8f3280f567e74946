"""Funnels of vehicles that no paper has: against closed forms, against flights by the engine, and misused."""

from contextlib import chdir
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigh, expm, solve_discrete_are

from marsedl.design.funnel import funnel
from marsedl.elementary import select, sine_cosine
from marsedl.fly import Model, fly
from marsedl.methods.funnels.recursion import FunnelError
from marsedl.montecarlo.flights import Flight

PAGE = Path(__file__).parents[2] / "docs/examples/funnel.md"
ONE = np.eye(1)


class Place(NamedTuple):
    x: float


class Motion(NamedTuple):
    x: float
    speed: float


class Pull(NamedTuple):
    pull: float


class Push(NamedTuple):
    push: float


class Course(NamedTuple):
    across: float  # m
    heading: float  # rad
    turning: float  # rad/s


class Rudder(NamedTuple):
    rudder: float


class Water(NamedTuple):
    current: float  # m/s
    swell: float  # rad/s^2


class Boat(NamedTuple):
    speed: float  # m/s


class Hull(NamedTuple):
    damping: float  # 1/s
    stops: float  # largest rudder


def dragged(state, command: Pull, noise: Push) -> Place:
    return Place(command.pull + noise.push)


def sled(state, command: Pull) -> Motion:
    return Motion(state.speed, command.pull)


def boat(state, command: Rudder, noise: Water, vehicle, p) -> Course:
    sine, _ = sine_cosine(state.heading)
    rudder = select(command.rudder < p.stops, command.rudder, p.stops)
    drift = vehicle.speed * sine + noise.current
    return Course(drift, state.turning, rudder - p.damping * state.turning + noise.swell)


def still(time):
    return np.zeros((len(time), 1))


def stationary(transition, effect, state_weight, step):
    """Cost of the regulator of a system that does not change, with which its P and gain do not change either."""
    return solve_discrete_are(transition, effect, step * state_weight, step * ONE)


def afloat(**options):
    weight = np.diag([1.0, 4.0, 4.0])
    options = {"weights": (weight, ONE, weight), "disturbances": Water(0.2, 0.05), "vehicle": Boat(2.0)} | options
    time = np.linspace(0.0, 1.5, 31)
    return funnel(boat, Hull(0.5, 3.0), time, still, (0.0, 0.3, 0.0), (0.5, 0.2, 0.2), **options)


@pytest.fixture(scope="module")
def water():
    """Funnels of a boat: with bounds of its polynomials, and proven."""
    return afloat(), afloat(proven=True)


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """The proven funnel of the page of the documentation, whose flights are compiled."""
    code = PAGE.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    names = {}
    with chdir(tmp_path_factory.mktemp("page")):
        exec(compile(code, str(PAGE), "exec"), names)
    return names["proven"]


def test_half_width_of_a_scalar_system_is_that_of_its_largest_motion():
    step, time = 0.05, np.linspace(0.0, 2.0, 41)
    cost = stationary(np.eye(1), step * ONE, 4.0 * ONE, step)
    tube = funnel(dragged, (), time, still, [1.0], [0.5], weights=(4.0 * ONE, ONE, cost), disturbances=Push(0.3))
    rate = -tube.loop.gains[0, 0, 0]
    largest = 0.5 * np.exp(-rate * tube.time) + 0.3 / rate * (1.0 - np.exp(-rate * tube.time))
    np.testing.assert_allclose(tube.half_widths[:, 0], largest, rtol=1e-6)
    np.testing.assert_allclose(tube.feedback[:, 0], rate * largest, rtol=1e-6)
    # No motion is larger, and the pair of worst start and worst push is flown: it reaches the end of the last slice.
    flown = tube.holds(3, compiled=False)
    np.testing.assert_allclose(flown.highest[-1], 1.0, atol=1e-6)


def test_levels_of_a_linear_system_fall_as_the_closed_loop_and_its_lyapunov_function_say():
    step, rates = 0.05, np.array([[0.0, 1.0], [0.0, 0.0]])
    effect = np.array([[step**2 / 2.0], [step]])
    cost = stationary(expm(step * rates), effect, np.eye(2), step)
    tube = funnel(sled, (), np.linspace(0.0, 2.0, 41), still, [0.0, 0.0], [0.3, 0.2], weights=(np.eye(2), ONE, cost))
    loop = rates + np.array([[0.0], [1.0]]) @ tube.loop.gains[0]
    across = expm(5 * step * loop)
    growth = eigh(across.T @ cost @ across, cost, eigvals_only=True)[-1]
    np.testing.assert_allclose(tube.levels[1:] / tube.levels[:-1], growth, rtol=1e-5)
    fall = eigh(-loop.T @ cost - cost @ loop, cost, eigvals_only=True)[0]  # of V, at least, in a second
    assert (tube.levels <= tube.levels[0] * np.exp(-fall * tube.time) * (1.0 + 1e-6)).all()


def test_the_table_flies_and_keeps_to_the_funnel():
    weight, time = np.eye(2), np.linspace(0.0, 2.0, 41)
    tube = funnel(
        sled, (), time, lambda at: 0.1 * at[:, np.newaxis], [0.0, 0.1], [0.3, 0.2], weights=(weight, ONE, weight)
    )
    start, law = {"x": 0.2, "speed": 0.2}, {"law": tube.table, "trials": 1, "compiled": False}
    end = fly(Model(Flight(sled)), start, end_time=2.0, period=0.01, substeps=1, **law).final
    deviation = np.array([end["x"][0], end["speed"][0]]) - tube.loop.states[-1]
    by_feedback = np.array(tube.loop.flow(0, 40, [0.2, 0.1], []))
    np.testing.assert_allclose(deviation, by_feedback, atol=2e-3)  # it is held for a hundredth of a second
    assert (np.abs(deviation) < tube.half_widths[-1]).all()
    assert np.abs(deviation).max() > 0.01


def test_proven_levels_are_above_those_of_polynomials_and_flights_are_below(water):
    bounded, proven = water
    assert bounded.levels.shape == (7,) and proven.levels.shape == (31,)
    excess = proven.levels[bounded.nodes] / bounded.levels
    assert (excess[1:] > 1.0).all() and (excess < 1.05).all()
    flown = proven.holds(9, compiled=False)
    assert flown and flown.left == 0 and flown.interval[0] == 0.0
    assert 0.5 < flown.highest[-1] < 1.0
    assert "current 0.2; swell 0.05" in proven.covers and "It is proven" in proven.covers
    assert "proven=True" in bounded.covers and "It is proven" not in bounded.covers


def test_flights_by_the_engine_stay_in_a_proven_funnel_unless_the_wind_is_larger(pendulum):
    flown = pendulum.holds(3000)
    assert flown and flown.highest.max() < 1.0
    np.testing.assert_array_equal(pendulum.holds(6, compiled=False).highest, pendulum.holds(6).highest)
    beyond = pendulum.holds(3000, factor=3.0)
    assert not beyond and beyond.left > 2900 and beyond.interval[0] > 0.9


@pytest.mark.long
def test_no_flight_of_a_hundred_thousand_leaves_a_proven_funnel(pendulum):
    flown = pendulum.holds(100_000)
    assert flown.left == 0 and 0.98 < flown.highest[-1] < 1.0


def test_picture_shows_every_state(water):
    tube = water[1]
    panels = tube.picture({"across": "m"}).axes
    assert [panel.get_title(loc="left") for panel in panels] == ["across (m)", "heading", "turning"]
    band = panels[0].collections[0].get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose(band.max(), (tube.loop.states[2 * tube.nodes, 0] + tube.half_widths[:, 0]).max())


def with_time(state, command: Pull, time) -> Motion:
    return Motion(state.speed, command.pull + 0.0 * time)


def without_command(state) -> Place:
    return Place(-state.x)


def not_annotated(state, command: Pull):
    return Motion(state.speed, command.pull)


def branching(state, command: Pull) -> Motion:
    return Motion(state.speed, command.pull if state.x > 0.0 else 0.0)


def diverging(state, command: Pull, noise: Push) -> Motion:
    return Motion(state.speed, 0.01 * command.pull + 9.0 * state.x**3 + noise.push)


GOOD = {
    "rates": sled,
    "p": (),
    "time": np.linspace(0.0, 1.0, 11),
    "command": still,
    "start": (0.0, 0.0),
    "semi_axes": (0.1, 0.1),
    "weights": (np.eye(2), ONE, np.eye(2)),
}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"time": np.linspace(1.0, 2.0, 11)}, "time must be a vector of nodes that rises from 0 s"),
        ({"time": [0.0, 0.2, 0.1]}, "time must be a vector of nodes that rises from 0 s"),
        ({"every": 0}, "every is 0; give the nodes from one slice to the next, from 1 to 10"),
        ({"every": 11}, "every is 11; give the nodes"),
        ({"weights": (np.eye(2), ONE)}, "weights are 2; give Q, R and Qf"),
        ({"weights": (np.eye(2), -ONE, np.eye(2))}, "control_weight"),
        ({"weights": (np.eye(3), ONE, np.eye(2))}, r"state_weight must have shape \(2, 2\)"),
        ({"command": still(np.zeros(11))}, "command must be a function of times"),
        ({"command": [np.nan]}, "command must be a function of times .* or 1 finite numbers"),
        ({"weights": ([1.0, 1.0], [-1.0], [1.0, 1.0])}, "control_weight"),
        ({"command": lambda at: np.zeros(len(at))}, r"command must return shape \(times, 1\), got \(11,\)"),
        ({"start": (0.0,)}, r"start must be 2 finite numbers, got \[0.0\]"),
        ({"start": (0.0, np.nan)}, "start must be 2 finite numbers"),
        ({"semi_axes": (0.1, 0.0)}, "semi_axes must be 2 positive numbers"),
        ({"disturbances": Push(0.1)}, "does not ask for 'noise'"),
        ({"p": Boat(1.0)}, "does not ask for 'p'"),
        ({"p": 9.81}, "p is 9.81; give a NamedTuple of numbers"),
        ({"rates": dragged}, "asks for 'noise', which is not bounded: give disturbances"),
        ({"rates": dragged, "disturbances": 0.1}, "disturbances is 0.1; give the NamedTuple of the noise"),
        ({"rates": dragged, "disturbances": Push}, "give the NamedTuple of the noise with its largest magnitudes"),
        ({"rates": dragged, "disturbances": Push(-0.1)}, "got"),
        ({"rates": with_time}, "asks for the time: make the time a number of its state"),
        ({"rates": without_command}, "takes no command"),
        ({"rates": not_annotated}, "asks for 'state', which is not known: annotate it"),
        ({"rates": diverging, "disturbances": Push(50.0), "time": np.linspace(0.0, 9.0, 91)}, "slice"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(wrong, sentence):
    with pytest.raises(ValueError, match=sentence) as error:
        funnel(**(GOOD | wrong))
    assert "\n" not in str(error.value)


def test_a_branch_is_told_with_its_remedy():
    with pytest.raises(TypeError, match=r"test_funnel\.py, line \d+, in branching: .*choose by select"):
        funnel(**(GOOD | {"rates": branching}))


def test_a_funnel_that_cannot_be_proven_says_from_where_on():
    wild = {"rates": diverging, "disturbances": Push(50.0), "time": np.linspace(0.0, 9.0, 91), "proven": True}
    with pytest.raises(FunnelError, match="nothing is proven after slice"):
        funnel(**(GOOD | wild))


@pytest.mark.parametrize("trials", [0, 2.5])
def test_a_count_of_flights_is_a_whole_number(water, trials):
    with pytest.raises(ValueError, match="trials must be a whole number of at least 1"):
        water[0].holds(trials)
