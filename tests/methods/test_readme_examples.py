"""The examples of the README as they stand there: they run, and what they say of their results is so."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods.covariance_steering.block_program import closed_loop
from marsedl.models import random_field
from marsedl.montecarlo.streams import normals

README = Path(__file__).parents[2] / "README.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
TRIALS = 4000


def run(containing):
    """The names that the one example with this text defines."""
    (example,) = (text for text in EXAMPLES if containing in text)
    names = {}
    exec(compile(example, f"{README.name}, example with {containing!r}", "exec"), names)
    return names


@pytest.fixture(scope="module")
def field_example():
    return run("HalfPlane")


def test_every_example_is_tested():
    assert len(EXAMPLES) == 3


def test_closed_form_example_meets_its_targets():
    steering = run("SteeringProblem")["steering"]
    np.testing.assert_allclose(steering.mean[-1], 0.0, atol=1e-6)
    np.testing.assert_allclose(steering.covariance[-1], np.diag([1.0, 0.25]), atol=1e-6)


@pytest.fixture(scope="module")
def fields(field_example):
    """Positions and samples of the example's field there."""
    grid = np.linspace(-3.0, 12.0, 151)
    root = random_field.root(random_field.covariance_matrix(field_example["kernel"], grid))
    return grid, normals(1, 0, range(TRIALS), len(grid)) @ root.T


def fly(example, fields, gain):
    """States (trials, 9, 2) of carts that a sampled field in space pushes: in no way linearised."""
    (grid, values), trials = fields, np.arange(TRIALS)

    def rates(state, control):
        place = (state[:, 0] - grid[0]) / (grid[1] - grid[0])
        node = place.astype(int)
        push = values[trials, node] + (place - node) * (values[trials, node + 1] - values[trials, node])
        return np.column_stack([state[:, 1], control + push])

    law, system = example["law"], example["program"].system
    state = system.initial_mean + normals(1, 1, range(TRIALS), 2) * np.sqrt(np.diag(system.initial_covariance))
    states, step = [state], 0.05
    for k, control in enumerate(law.control[:, 0]):
        command = control + sum((x - law.mean[node]) @ gain[k, node, 0] for node, x in enumerate(states))
        for _ in range(20):
            middle = state + step / 2 * rates(state, command)
            state = state + step * rates(middle, command)
        states.append(state)
    return np.stack(states, axis=1)


def test_field_example_keeps_its_chance_constraint_in_sampled_fields(field_example, fields):
    law = field_example["law"]
    flown = fly(field_example, fields, law.gain)
    too_fast = np.mean(flown[:, :, 1] > 1.1, axis=0)
    assert (too_fast[1:] <= 0.01 + 3 * np.sqrt(0.01 * 0.99 / TRIALS)).all()
    assert too_fast[-1] >= 0.01 - 4 * np.sqrt(0.01 * 0.99 / TRIALS)  # the constraint is active there: 1 % it is
    free = fly(field_example, fields, np.zeros_like(law.gain))
    assert 0.2 < np.mean(free[:, -1, 1] > 1.1) < 0.3


def test_field_example_predicts_its_deviations(field_example, fields):
    law, system = field_example["law"], field_example["program"].system
    # The flights have no navigation errors, which only the design has.
    covariance, _ = closed_loop(system, law.gain, field_example["covariance"])
    predicted = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    flown = fly(field_example, fields, law.gain)
    np.testing.assert_allclose(flown.std(axis=0, ddof=1), predicted, rtol=4 / np.sqrt(2 * TRIALS))
    assert (np.abs(flown[:, -1].mean(axis=0) - [8.0, 1.0]) < 4 * predicted[-1] / np.sqrt(TRIALS)).all()
    assert (law.covariance[-1].diagonal() <= 0.05**2 * (1 + 1e-6)).all()


def fly_sled(solution, gain, drag):
    """Where the sled ends with another drag, m: the nominal's thrust, and feedback of the difference in speed."""
    state = np.zeros(4)  # position and speed, then those of the nominal

    def rates(_, state, held):
        _, speed, _, nominal = state
        return [speed, held + gain * (speed - nominal) - drag * speed**2, nominal, held - 0.02 * nominal**2]

    for held, *span in zip(solution.controls[:, 0], solution.time[:-1], solution.time[1:], strict=True):
        state = solve_ivp(rates, span, state, args=(held,), rtol=1e-9, atol=1e-9).y[:, -1]
    return state[0]


def test_desensitized_example_does_what_the_readme_says():
    names = run("Desensitized")
    plain, robust = names["least_thrust"], names["robust"]
    (gain,) = robust.free.values()
    short = [100.0 - fly_sled(plain, 0.0, 0.022), 100.0 - fly_sled(robust, gain, 0.022)]
    np.testing.assert_allclose(short, [3.9, 0.65], rtol=0.03)
    assert 1.0 < robust.running_cost / plain.running_cost < 1.001
    # What the sensitivity says of the miss, and what is flown, to first order.
    slope = robust.state(names["miss"])[-1]
    np.testing.assert_allclose(fly_sled(robust, gain, 0.0202) - fly_sled(robust, gain, 0.02), 2e-4 * slope, rtol=0.02)
