"""Least fuel: thrust, switching function, and the branch that is left on the way from least energy."""

import numpy as np
import pytest
from scipy.optimize import linprog

from marsedl.methods.collocation import SOLVED
from marsedl.methods.linearization import linearize
from marsedl.methods.sensitivity import adjoint_rows, midpoint_responses, midpoint_transitions
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.beyond import minimum_fuel
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, WARM
from marsedl.replication.records import store
from marsedl.replication.units import DEGREE


@pytest.fixture(scope="module")
def inputs(desensitized):
    return desensitized.inputs("corrected", intervals=60)


@pytest.fixture(scope="module")
def nominal(desensitized):
    return desensitized.nominal("corrected", intervals=60)


@pytest.fixture(scope="module")
def way(inputs, nominal):
    """From energy to fuel under the smaller bound, at which thrust lasts longer than an interval."""
    bound = inputs.fuel_bounds[1]
    program = inputs.call(minimum_fuel.fuel_program, nominal, bound)
    guess = minimum_fuel.split(nominal)
    first = inputs.call(entry_problem.attempt, program, guess, minimum_fuel.share(0.0), barrier=WARM)
    return inputs.call(minimum_fuel.to_fuel, program, first)


def fuel_fields(inputs, solution):
    return inputs.call(minimum_fuel.described, inputs.fuel_bounds[1], solution, True)


def test_least_fuel_is_bang_coast_bang(inputs, way):
    bound, solution = inputs.fuel_bounds[1], way.last
    assert solution.status == SOLVED
    assert solution.given["weight"] == 1.0
    fields = fuel_fields(inputs, solution)
    between = 1.0 - fields["coasting"] - fields["at_bound"]
    assert fields["bursts"] == 2
    assert fields["at_bound"] > 0.05
    assert between * inputs.intervals <= 2 * fields["bursts"] + 1e-9  # the intervals at the ends of bursts
    function = -solution.costates[:, BANK_RATE] * DEGREE
    assert minimum_fuel.violation(function, minimum_fuel.thrust(solution), bound) < 1e-6
    # Not both signs at once, so that the objective is the integral of |u|.
    assert solution.controls.min(axis=1).max() < 1e-6 * bound
    assert solution.objective == pytest.approx(fields["cumulative"] / DEGREE, rel=1e-5)


def test_the_nominals_branch_ends_on_the_way_to_least_fuel(inputs, nominal, way):
    before, after = fuel_fields(inputs, way.on_branch), fuel_fields(inputs, way.last)
    assert 0.8 < way.on_branch.given["weight"] < 1.0
    assert before["reversals"] == nominal.reversals == 2
    assert after["reversals"] == 1
    assert after["cumulative"] < 0.7 * before["cumulative"] < before["cumulative"] < nominal.cumulative


def test_the_switching_function_obeys_the_adjoint_equations(inputs, way):
    """Between intervals, L_k (I - h/2 A_k) = L_k+1 (I + h/2 A_k+1), and nothing holds bank and its rate at the end."""
    solution = way.last
    matrix, step = linear_model(inputs, solution)[0], np.diff(solution.time)[0]
    costate, eye = solution.costates, np.eye(8)
    for k in range(len(costate) - 1):
        before = costate[k] @ (eye - 0.5 * step * matrix[k])
        after = costate[k + 1] @ (eye + 0.5 * step * matrix[k + 1])
        assert np.abs(before - after).max() < 1e-6 * np.abs(costate).max()
    at_end = costate[-1] @ (eye - 0.5 * step * matrix[-1])
    np.testing.assert_allclose(at_end[[BANK, BANK_RATE]] * DEGREE, 0.0, atol=1e-6)


def linear_model(inputs, solution):
    middle = (solution.states[1:] + solution.states[:-1]) / 2.0
    control = minimum_fuel.thrust(solution)[:, np.newaxis]
    model = linearize(inputs.call(entry_problem.rates), middle, control, list(entry_problem.given().values()))
    return model.state_matrix, model.control_matrix


def test_a_linear_program_finds_no_less_fuel(inputs, way):
    """Least integral of |u| with the end conditions linearised, in controls, initial bank and final time."""
    solution, bound = way.last, inputs.fuel_bounds[1]
    matrix, control_matrix = linear_model(inputs, solution)
    steps, count = np.diff(solution.time), len(solution.controls)
    end = solution.states[-1]
    rows = np.zeros((4, 8))
    rows[:3, :3] = np.diag([1.0 / 1e5, 10.0, 10.0])
    rows[3, 3:6] = 2.0 * end[3:6] / inputs.final_velocity**2
    adjoint = adjoint_rows(midpoint_transitions(matrix, steps), rows)
    of_control = (adjoint[1:] @ midpoint_responses(matrix, control_matrix, steps))[:, :, 0].T
    slope = np.diff(solution.states, axis=0) / steps[:, np.newaxis]
    of_time = (adjoint[1:] @ midpoint_responses(matrix, slope[:, :, np.newaxis], np.ones(count) * steps))[:, :, 0]
    of_time = of_time.sum(axis=0) / solution.final_time
    jacobian = np.column_stack([of_control, -of_control, adjoint[0, :, BANK], of_time])
    now = np.concatenate([solution.controls.T.ravel(), [solution.states[0, BANK], solution.final_time]])
    bank, time = now[-2:]
    fuel = np.concatenate([np.repeat(steps[0], 2 * count), [0.0, now[: 2 * count].sum() / count]])
    limits = [*[(0.0, bound)] * (2 * count), (bank - 0.05, bank + 0.05), (time - 1.0, time + 1.0)]
    best = linprog(fuel, A_eq=jacobian, b_eq=jacobian @ now, bounds=limits)
    assert best.status == 0
    assert best.fun == pytest.approx(fuel @ now, rel=1e-6)


def test_what_is_not_solved_says_so(inputs, nominal, tmp_path):
    hopeless = inputs.changed(solver_iterations=2)
    record = hopeless.call(minimum_fuel.compute, nominal)
    assert set(record.status.ravel()) == {"Maximum_Iterations_Exceeded"}
    assert np.isnan(record.cumulative).all()
    assert (record.bursts == -1).all()
    assert np.isnan(record.branch_share).all()
    store.save(tmp_path / "fuel.h5", record, paper="desensitized", reading="corrected", provenance={})


@pytest.mark.parametrize(
    ("function", "thrust", "expected"),
    [
        ([0.5, -0.9], [0.0, 0.0], 0.0),
        ([1.2, 0.0], [0.0, 0.0], 0.2),
        ([1.5, -1.0], [1.0, -1.0], 0.0),
        ([0.7, -1.0], [1.0, -1.0], 0.3),
        ([1.0, -1.4], [0.5, -0.5], 0.4),
        ([-1.5, 0.0], [1.0, 0.0], 2.5),
    ],
)
def test_thrust_against_its_switching_function(function, thrust, expected):
    assert minimum_fuel.violation(np.array(function), np.array(thrust), 1.0) == pytest.approx(expected)
