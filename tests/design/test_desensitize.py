"""Desensitized references: the optimum of the same problem put together by hand, and what errors do in flight."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from marsedl.design import Gain, Sensitivity, desensitize, optimal
from marsedl.fly import Above, Below
from marsedl.methods.collocation import Guess, Problem, Program, Variable
from marsedl.methods.desensitization import Desensitized, Perturbation, column


class State(NamedTuple):
    position: float
    speed: float


class Thrust(NamedTuple):
    thrust: float


class Sled(NamedTuple):
    drag: float = 0.02


def rates(state, command: Thrust, p) -> State:
    return State(state.speed, command.thrust - p.drag * state.speed**2)


DRAG = Sensitivity("position", "drag", 1e-3)


@pytest.fixture(scope="module")
def least():
    return optimal(rates, Sled(), (0.0, 0.0), (100.0, 0.0), 30.0, lambda command: command.thrust**2, guess=(1.0,),
                   intervals=50, scheme="midpoint", scales={"speed": 10.0})  # fmt: skip


@pytest.fixture(scope="module")
def robust(least):
    return desensitize(least, [0.1, 1.0, 10.0], DRAG, gains=[Gain("thrust", "speed", lower=-1.0, upper=0.0)])


def by_hand():
    """The same from its parts: least thrust, the path's last solution, and the name of the sensitivity."""
    problem = Problem(
        rates=lambda position, speed, thrust, drag, weight: (speed, thrust - drag * speed**2),
        states=(Variable("position", 100.0), Variable("speed", 10.0)),
        controls=(Variable("thrust", 1.0, -3.0, 3.0),),
        final_time=Variable("final_time", 30.0, 30.0, 30.0),
        initial={"position": 0.0, "speed": 0.0},
        final={"position": 100.0, "speed": 0.0},
        running_cost=lambda position, speed, thrust, drag, weight: thrust**2,
        given=("drag", "weight"),
    )
    sled = Desensitized(
        problem,
        perturbations=(Perturbation("drag", parameters={"drag": 1.0}),),
        scales={"position": 1e3, "speed": 1e2},
        gains=(Gain("thrust", "speed", lower=-1.0, upper=0.0),),
    )
    miss = column("position", "drag")
    cost = replace(sled.problem, end_cost=lambda start, end, given: given["weight"] * (end[miss] / 1e3) ** 2)
    given = {"drag": 0.02, "weight": 0.0}
    guess = Guess(np.column_stack([np.linspace(0.0, 100.0, 51), np.full(51, 3.0)]), np.zeros((50, 1)), 30.0)
    least = Program(problem, 50).solve(guess, given)
    program = Program(cost, 50)
    return least, program.follow(program.solve(sled.guess(least), given), "weight", [0.1, 1.0, 10.0])[-1], miss


def test_the_optimum_is_the_one_that_is_put_together_by_hand(least, robust):
    plain, theirs, miss = by_hand()
    np.testing.assert_allclose(least.objective, plain.objective, rtol=1e-7)
    mine = robust.references[-1]
    np.testing.assert_allclose(mine.objective, theirs.running_cost, rtol=1e-6)
    np.testing.assert_allclose(robust.gains[-1], [[0.0, theirs.free["thrust/speed"]]], rtol=1e-4)
    np.testing.assert_allclose(np.transpose(mine.states), theirs.states[:, :2], atol=1e-4)
    row = robust.table.iloc[-1]
    np.testing.assert_allclose(row["predicted"], 1e-3 * theirs.state(miss)[-1], rtol=1e-3)


def test_weights_trade_the_objective_for_what_an_error_does_in_flight(least, robust):
    table = robust.table
    assert table["weight"].tolist() == [0.0, 0.1, 1.0, 10.0]
    assert table.loc[0, "objective"] == least.objective
    assert (np.diff(table["objective"]) > 0.0).all() and (np.diff(table["predicted"].abs()) < 0.0).all()
    np.testing.assert_allclose(table["flown"], table["predicted"], atol=0.06, err_msg="of second order in the error")
    assert abs(table.loc[3, "flown"]) < 0.2 * abs(table.loc[0, "flown"])


def test_pictures_show_the_trade_and_the_trajectory(least, robust):
    (panel,) = robust.picture({"position": "m"}).axes
    assert panel.get_title(loc="left") == "position (m), moved by drag"
    np.testing.assert_array_equal(panel.lines[1].get_ydata(), robust.table["flown"].abs())
    panels = least.picture({"thrust": "m/s^2"}).axes
    assert [one.get_title(loc="left") for one in panels] == ["position", "speed", "thrust (m/s^2)"]
    held = panels[2].lines[0]
    np.testing.assert_array_equal(held.get_ydata()[::2], least.commands.thrust)
    np.testing.assert_array_equal(held.get_xdata()[[0, 1, -1]], least.time[[0, 1, -1]])


def test_an_objective_of_the_end_is_told_without_the_sensitivities():
    limits = [Below("thrust", 1.0), Above("thrust", -1.0)]
    far = optimal(rates, Sled(), (0.0, 0.0), (np.nan, 0.0), 20.0, lambda end: -end.position, limits, (0.5,))
    errors = [DRAG, Sensitivity("position", "speed", 0.1)]
    near = desensitize(far, 0.1, errors, gains=[Gain("thrust", "speed", lower=-0.5, upper=0.0)])
    np.testing.assert_allclose(near.references[0].objective, -near.references[0].states.position[-1], rtol=1e-9)
    assert far.objective < near.references[0].objective
    assert near.table["to"].tolist() == ["drag", "speed"] * 2
    np.testing.assert_allclose(near.table["flown"][:2], near.table["predicted"][:2], rtol=0.05)


@pytest.mark.parametrize(
    ("weight", "sensitivity", "told"),
    [
        (-1.0, DRAG, "weight is -1.0; give a positive number, or several that rise"),
        ([1.0, 0.1], DRAG, "weight is .* that rise"),
        (1.0, ("position", "drag"), "sensitivity 'position'; give Sensitivity"),
        (1.0, Sensitivity("place", "drag", 1e-3), "sensitivity of 'place': .*There are: position, speed"),
        (1.0, Sensitivity("position", "mass", 1e-3), "'mass' is no number of the model's parts"),
        (1.0, Sensitivity("position", "drag", 0.0), "the deviation is 0.0; give a positive number"),
        (1.0, Sensitivity("speed", "position", 1.0), "position does not move speed: leave this sensitivity out"),
    ],
)
def test_misuses_are_told(least, weight, sensitivity, told):
    with pytest.raises(ValueError, match=told):
        desensitize(least, weight, sensitivity)
