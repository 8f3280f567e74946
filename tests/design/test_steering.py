"""Steering of vehicles that no paper has: what is predicted against flights, closed forms and other programs."""

import sys
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import linprog, minimize_scalar
from scipy.stats import norm

from marsedl.design import steering
from marsedl.fly import Above, Below
from marsedl.methods.covariance_steering.closed_form import SteeringProblem, steer
from marsedl.methods.step_map import in_vectors, linear_flight
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.powered_descent.beyond.held_control import covariance_certificate, mean_certificate
from marsedl.stepping import runge_kutta_4

sys.path.insert(0, __file__.rpartition("/")[0])
from vehicles import CASES, Gust, Line, Push

TRIALS = 20_000


def designed(case, **changes):
    return steering.solve(case.rates, case.p, changes.pop("times", case.times), **(case.asked() | changes))


@cache
def law_of(name):
    return designed(CASES[name])


@cache
def flown_by_arrays(name):
    """States (N + 1, n, trials) and commands (N, m, trials) of flights that know neither engine nor linear model."""
    case, law, rng = CASES[name], law_of(name), np.random.default_rng(3)
    vectors = in_vectors(case.rates, p=case.p)
    step, noises = case.times[1] / 4, len(vectors.names["noise"])
    mean, deviations = case.start
    state = rng.multivariate_normal(mean, np.diag(deviations) ** 2, size=TRIALS).T
    states, commands = [state], []
    for command, gain, mean in zip(law.command, law.gain, law.state[:-1], strict=True):
        commands.append(command[:, None] + gain @ (state - mean[:, None]))
        for _ in range(4):
            noise = rng.standard_normal((noises, TRIALS)) / np.sqrt(step)
            held = (*commands[-1], *noise)
            state = np.array(runge_kutta_4(lambda _, at, held=held: vectors(*at, *held), state, step))
        states.append(state)
    return {"state": np.array(states), "command": np.array(commands)}


@pytest.mark.parametrize("name", CASES)
def test_deviations_are_those_of_flights(name):
    law, flown = law_of(name), flown_by_arrays(name)
    assert law.outcome == "converged"
    assert {one.status for one in law.iterations[-2:]} == {"optimal"}
    for predicted, numbers in ((law.covariance, flown["state"]), (law.command_covariance, flown["command"])):
        deviation = np.sqrt(np.diagonal(predicted, axis1=1, axis2=2))
        varies = deviation > 1e-3 * deviation.max(axis=0)
        np.testing.assert_allclose(numbers.std(axis=2)[varies], deviation[varies], rtol=0.03)
    miss = (law.state[-1] - CASES[name].goal[0]) / law.deviation[-1]
    assert np.nanmax(np.abs(miss)) < 0.02
    bound = np.diag(CASES[name].goal[1]) ** 2
    assert np.linalg.eigvals(np.linalg.solve(bound, law.covariance[-1])).real.max() < 1.01


@pytest.mark.parametrize("name", CASES)
def test_limits_are_violated_as_rarely_as_is_asked(name):
    flown = flown_by_arrays(name)
    for limit in law_of(name).task.limits:
        counts = np.count_nonzero(limit.excess(np.moveaxis(flown[limit.part], 1, 0)) > 0.0, axis=1)
        lower, _ = binomial_interval(counts[limit.part == "state" :].max(), TRIALS, 0.999)  # the worst of many nodes
        assert lower <= limit.probability


def test_flights_of_the_engine_say_what_was_asked_predicted_and_flown():
    law = law_of("line")
    flown = law.flown(TRIALS, seed=2)
    np.testing.assert_allclose(flown.goal["deviation flown"], flown.goal["deviation predicted"], rtol=0.03)
    np.testing.assert_allclose(flown.goal["deviation asked"], [0.2, 0.1])
    np.testing.assert_allclose(flown.goal["mean flown"], [0.0, 0.0], atol=0.01)
    assert (flown.limits["lower"] <= flown.limits["asked"]).all()
    active = flown.limits.iloc[0]
    assert active["predicted"] == pytest.approx(0.01, rel=0.02)
    assert active["lower"] < active["predicted"] < active["upper"]
    assert "limits[0]" in repr(flown)
    assert list(law.active) == ["limits[0], a function of the command below 0.6", "goal, covariance"]


def test_a_command_that_stays_at_its_limit_does_not_violate_it():
    """Without a goal for the covariance there is no feedback, and the solver's rounding is no violation."""
    law = on_line(limits=[Below("push", 0.5, 0.01), Above("push", -0.5, 0.01)])
    most = 0.5 * (1.0 + 5e-8)
    law = replace(law, command=np.clip(law.command * (1.0 + 1e-6), -most, most))
    assert np.abs(law.command).max() == most
    assert not law.flown(20, compiled=False).limits[["predicted", "flown"]].any(axis=None)


def test_picture_shows_states_commands_and_limits_with_their_percentiles():
    law = law_of("line")
    panels = {panel.get_title(loc="left"): panel for panel in law.picture({"position": "m"}).axes}
    assert list(panels)[:3] == ["position (m)", "velocity", "push"]
    mean, percentile, limit = (curve.get_ydata() for curve in panels["limits[1], velocity above -1.7"].lines)
    np.testing.assert_allclose(mean, law.state[:, 1], atol=1e-12)
    np.testing.assert_allclose(percentile, mean - norm.isf(0.02) * law.deviation[:, 1], atol=1e-3)
    assert (limit == -1.7).all() and (percentile > limit).all(), "it is not active"


def curved(state, command: Push, noise: Gust) -> Line:
    return Line(state.velocity + 2.0 * state.velocity * state.velocity, command.push + 0.05 * noise.gust)


def test_flights_that_are_not_linear_are_told():
    free = ([np.nan, np.nan], None)
    start = ([0.0, 0.0], np.diag([0.1, 1.0]) ** 2)
    law = steering.solve(curved, (), np.linspace(0.0, 1.0, 3), start=start, goal=free, guess=[0.0], substeps=1)
    with pytest.warns(
        UserWarning, match=r"the deviation of position at \S+ s is .* predicted are .*: the vehicle is not"
    ):
        law.flown(200, compiled=False)


def test_norms_are_bounded_by_a_polytope():
    law = law_of("satellite")
    (limit,) = law.task.limits
    assert len(limit.normals) == 8
    corners = limit.normals @ np.array([[1.0, 0.6], [0.0, 0.8]])
    np.testing.assert_allclose(corners.max(axis=0), [1.0, 0.9899], atol=1e-3)  # at most 1 / cos(pi / 8) too small
    np.testing.assert_allclose(np.linalg.norm(limit.normals, axis=1), 1.0)
    assert law.task.limits[0].text in law.active


# ---- the paper's problem ---------------------------------------------------------------------------------------------


class Flat(NamedTuple):
    x: float
    z: float
    vx: float
    vz: float


class Force(NamedTuple):
    fx: float
    fz: float


MASS, GRAVITY, DENSITY = 1500.0, 3.71, 360.0


def descent_rates(state, command: Force, noise: Force) -> Flat:
    force = (command.fx + DENSITY * noise.fx) / MASS, (command.fz + DENSITY * noise.fz) / MASS
    return Flat(state.vx, state.vz, force[0], force[1] - GRAVITY)


def test_powered_descent_is_steered_as_by_the_paper():
    """Its second segment, with the mass of the first pass: held commands as of the certificates, which bound it."""
    start, end = [50.0, 150.0, 0.0, -5.0], [100.0, 50.0, 0.0, 0.0]
    start_covariance, end_covariance = np.diag([10.0, 10.0, 1.0, 1.0]), np.diag([5.0, 0.25, 0.25, 0.25])
    time = np.linspace(0.0, 15.0, 1501)
    problem = SteeringProblem.from_linear_model(
        time,
        (np.eye(4, k=2), np.eye(4, 2, k=-2) / MASS, np.array([0.0, 0.0, 0.0, -GRAVITY])),
        initial_mean=start,
        final_mean=end,
        initial_covariance=start_covariance,
        final_covariance=end_covariance,
        noise_density=DENSITY,
    )
    law = steering.solve(
        descent_rates,
        (),
        np.linspace(0.0, 15.0, 26),
        start=(start, start_covariance),
        goal=(end, end_covariance),
        guess=[0.0, 5000.0],
        substeps=16,
        tolerance=1e-7,
    )
    held = mean_certificate(problem, 25)
    np.testing.assert_allclose(law.command, held.control, atol=1e-6 * np.abs(held.control).max())
    np.testing.assert_allclose(law.state, held.mean, atol=1e-5)
    period = law.time[1]
    assert period * np.sum(law.command**2) == pytest.approx(held.cost, rel=1e-8)
    assert period * np.sum(law.command**2) == pytest.approx(steer(problem).mean_cost, rel=2e-4)  # of order two
    spread = period * np.trace(law.command_covariance, axis1=1, axis2=2).sum()
    # White noise is held over integration steps, of which there are 16 in a period.
    assert spread == pytest.approx(covariance_certificate(problem, 25).cost, rel=2e-3)
    np.testing.assert_allclose(law.covariance[-1], end_covariance, atol=2e-3)


def test_a_linear_vehicle_without_limits_takes_one_program(monkeypatch):
    programs, plain = [], steering.block_program.solve

    def counted(*arguments, **options):
        programs.append(arguments)
        return plain(*arguments, **options)

    monkeypatch.setattr(steering.block_program, "solve", counted)
    law = on_line()
    assert len(programs) == 1 and law.outcome == "converged"
    assert law.iterations[-1].change == 0.0
    np.testing.assert_allclose(law.state[-1], [0.0, 0.0], atol=1e-6)
    on_line(times=np.linspace(0.0, 10.0, 6), limits=[Above("velocity", -2.0, 0.1)])
    assert len(programs) > 2  # a limit's bound is that of the iteration before


# ---- costs -----------------------------------------------------------------------------------------------------------


def along_line(state, command: Push, noise: Gust) -> Line:
    return Line(state.velocity, command.push + 0.05 * noise.gust)


TIMES = np.linspace(0.0, 10.0, 11)


def on_line(goal=((0.0, 0.0), None), **changes):
    given = {"start": ([10.0, 0.0], np.diag([0.5, 0.1]) ** 2), "goal": goal, "guess": [0.0]} | changes
    return steering.solve(along_line, (), given.pop("times", TIMES), **given)


def test_least_covariance_is_what_the_last_period_cannot_take_back():
    law = on_line(goal=([0.0, np.nan], np.eye(2)), cost="covariance")
    _, system = linear_flight(in_vectors(along_line), [0.0, 0.0], np.zeros((1, 1)), 1.0, 4)
    least = np.sqrt(system.noise[0, 0, 0])
    assert least <= law.deviation[-1, 0] * (1.0 + 1e-6)
    assert law.deviation[-1, 0] == pytest.approx(least, rel=0.02)
    assert law.cost == pytest.approx(law.deviation[-1, 0])


def test_least_fuel_is_that_of_a_linear_program():
    """Without a goal for the covariance no feedback costs fuel."""
    law = on_line(cost="fuel", limits=[Below(lambda command: np.abs(command.push), 0.6, 0.01)], iterations=60)
    _, system = linear_flight(in_vectors(along_line), [10.0, 0.0], np.zeros((10, 1)), 1.0, 4)
    effect, free = np.zeros((2, 10)), np.array([10.0, 0.0])
    for k, (across, push) in enumerate(zip(system.transition, system.control, strict=True)):
        effect, free = across @ effect, across @ free
        effect[:, k] = push[:, 0]
    program = linprog(np.ones(20), A_eq=np.hstack([effect, -effect]), b_eq=-free, bounds=(0.0, 0.6))
    assert law.cost == pytest.approx(program.fun, rel=2e-3)


def falling(state, command: Push, noise: Gust) -> Line:
    return Line(state.velocity, command.push - 3.71 + 0.05 * noise.gust)


def test_the_end_time_is_the_best_one():
    start, periods = np.array([100.0, -10.0]), 5

    def effort(end):
        h = end / periods
        ages = h * np.arange(periods - 0.5, 0.0, -1.0)  # from the middles of the periods to the end
        miss = [start[0] + start[1] * end - 0.5 * 3.71 * end**2, start[1] - 3.71 * end]
        push = np.linalg.lstsq(np.array([h * ages, np.full(periods, h)]), -np.array(miss), rcond=None)[0]
        return h * push @ push

    best = minimize_scalar(effort, bounds=(4.0, 20.0), method="bounded")
    law = steering.solve(
        falling,
        (),
        np.linspace(0.0, 10.0, periods + 1),
        start=(start, np.eye(2)),
        goal=([0.0, 0.0], None),
        guess=[3.71],
        end_time=(4.0, 20.0),
    )
    assert law.cost == pytest.approx(best.fun, rel=1e-5)
    assert law.time[-1] == pytest.approx(best.x, rel=0.01)


# ---- what cannot be met, and misuses ---------------------------------------------------------------------------------


def test_what_cannot_be_met_is_named_with_how_much():
    _, system = linear_flight(in_vectors(along_line), [0.0, 0.0], np.zeros((1, 1)), 1.0, 4)
    asked = np.diag([system.noise[0, 0, 0] / 4.0, 1.0])  # half of the least deviation of the position
    with pytest.raises(
        steering.UnmetError, match=r"goal, covariance at 10 s fails by 1(\.\d+)? of the deviation"
    ) as error:
        on_line(goal=([0.0, 0.0], asked))
    assert error.value.unmet[0].by == pytest.approx(1.0, rel=0.02)
    with pytest.raises(
        steering.UnmetError, match=r"goal, mean of position at 10 s fails by 6.55, against limits"
    ) as error:
        on_line(limits=[Above("velocity", -0.5, 0.01), Below(lambda command: np.abs(command.push), 9.0, 0.01)])
    assert error.value.against == ("limits[0], velocity above -0.5",)
    with pytest.raises(
        steering.UnmetError, match=r"limits\[0\], position below 8 at 1 s fails by 1.\d+, against"
    ) as error:
        on_line(limits=[Below("position", 8.0, 0.5 - 1e-6), Below(lambda command: np.abs(command.push), 1.0, 0.01)])
    fails = {one.time: one.by for one in error.value.unmet}
    assert fails[1.0] == pytest.approx(10.0 - 0.5 - 8.0, abs=0.05)  # at full push from rest, of the mean


def of_wind(state, command: Push, noise: Gust, wind) -> Line:
    return Line(state.velocity, command.push + wind)


class Clash(NamedTuple):
    position: float


def of_clash(state, command: Clash, noise: Gust) -> Line:
    return Line(state.velocity, command.position + noise.gust)


def adrift(state, noise: Gust) -> Line:
    return Line(state.velocity, noise.gust)


def deaf(state, command: Push, noise: Gust) -> Line:
    return Line(state.velocity, 0.0 * command.push + noise.gust)


def explodes(state, command: Push, noise: Gust) -> Line:
    return Line(state.velocity, command.push / (state.position - 10.0) + noise.gust)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rates": of_wind}, r"asks for 'wind', of which a design does not know; .*belong to p"),
        ({"rates": of_clash}, "state and command both have position"),
        ({"rates": adrift}, "asks for no command"),
        ({"p": CASES["line"].p}, r"does not ask for p: give \(\)"),
        ({"rates": deaf}, "push acts on nothing along the guess"),
        ({"rates": explodes}, "another guess of the command"),
        ({"times": [0.0, 2.0, 1.0]}, "times must be equally spaced"),
        ({"times": [1.0, 2.0, 3.0]}, "times must increase from 0 s"),
        ({"times": [0.0, 1.0]}, "in two periods at least"),
        ({"start": ([10.0], np.eye(2))}, r"start: mean must have shape \(2,\), not \(1,\)"),
        ({"start": ([10.0, np.nan], np.eye(2))}, "start: mean must be finite"),
        ({"start": ([10.0, 0.0], [0.5])}, r"start: deviations must have shape \(2,\), not \(1,\)"),
        ({"start": ([10.0, 0.0], [0.5, -0.1])}, "start: deviations must not be negative"),
        ({"goal": ([0.0, 0.0], [1.0, 0.0])}, "goal: covariance must be positive definite"),
        ({"start": ([10.0, 0.0], np.array([[1.0, 2.0], [2.0, 1.0]]))}, "start: covariance must be positive semidef"),
        ({"start": ([10.0, 0.0], np.array([[1.0, 0.2], [0.0, 1.0]]))}, "start: covariance must be symmetric"),
        ({"goal": ([0.0, 0.0], np.diag([1.0, 0.0]))}, "goal: covariance must be positive definite"),
        ({"goal": ([0.0, 0.0, 0.0], None)}, r"goal: mean must have shape \(2,\)"),
        ({"guess": [0.0, 1.0]}, r"guess must be finite commands of shape \(1,\) or \(10, 1\): push"),
        ({"cost": "feul"}, "cost 'feul' is unknown; did you mean 'fuel'"),
        ({"cost": "covariance"}, "cost 'covariance' needs the goal's covariance"),
        ({"weights": [1.0, 2.0]}, r"weights must have shape \(1, 1\)"),
        ({"end_time": (5.0, 2.0)}, "give the earliest and the latest time"),
        ({"limits": ["velocity"]}, r"limits\[0\] is 'velocity'; give Below"),
        ({"limits": [Below("velocity", 1.0)]}, r"limits\[0\]: its probability is None"),
        ({"limits": [Below("velocity", 1.0, 0.5)]}, r"within \(0, 0.5\)"),
        ({"limits": [Below("velocity", np.nan, 0.1)]}, "not a finite number"),
        ({"limits": [Below("speed", 1.0, 0.1)]}, "'speed' is unknown"),
        ({"limits": [Below(lambda x: x, 1.0, 0.1)]}, r"asks for x; it may ask for state, command"),
        (
            {"limits": [Below(lambda state, command: state.velocity * command.push, 1.0, 0.1)]},
            "must ask for `state` or for `command` alone",
        ),
        (
            {"limits": [Below(lambda state: 1.0 if state.velocity > 0.0 else state.velocity, 1.0, 0.1)]},
            "choose by select",
        ),
    ],
)
def test_misuses_are_told(changes, message):
    rates = changes.get("rates", along_line)
    given = {"start": ([10.0, 0.0], np.eye(2)), "goal": ([0.0, 0.0], None), "guess": [0.0]}
    given |= {name: value for name, value in changes.items() if name not in ("rates", "p", "times")}
    with pytest.raises(ValueError, match=message):
        steering.solve(rates, changes.get("p", ()), changes.get("times", TIMES), **given)
