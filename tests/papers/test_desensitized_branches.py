"""Other solutions of the entry problem, and least fuel: local minima, folds, conditions, thrust."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import null_space
from scipy.optimize import linprog

from marsedl.methods.collocation import SOLVED, Guess
from marsedl.methods.linearization import linearize
from marsedl.methods.sensitivity import adjoint_rows, midpoint_responses, midpoint_transitions
from marsedl.papers.desensitized import branches as stage
from marsedl.papers.desensitized import entry_problem, minimum_fuel, tradeoff
from marsedl.papers.desensitized.entry_problem import BANK, BANK_RATE, WARM
from marsedl.replication.records import store
from marsedl.replication.units import DEGREE

# A coarse mesh and few weights: the same branches and fold, in seconds.
SMALL = {
    "intervals": 40,
    "weight_rule": "proportional",
    "weight_factor": 1.0,
    "printed_weights": np.array([0.02, 0.589, 5.0, 40.0]),
    "infinite_weights": np.array([50.0, 60.0]),
    "weight_path": np.array([0.04, 0.06, 0.2, 1.5, 15.0]),
}


@pytest.fixture(scope="module")
def inputs(desensitized):
    return desensitized.inputs("corrected", **SMALL)


@pytest.fixture(scope="module")
def nominal(desensitized):
    return desensitized.nominal("corrected", **SMALL)


@pytest.fixture(scope="module")
def path(desensitized):
    return desensitized.tradeoff("corrected", **SMALL)


@pytest.fixture(scope="module")
def branches(desensitized):
    return desensitized.branches("corrected", **SMALL)


@pytest.fixture(scope="module")
def minima(inputs, nominal, path):
    return inputs.call(stage.local_minima, nominal, path)


@pytest.fixture(scope="module")
def error_problem(inputs):
    return inputs.call(stage.error_program)


def stationarity(program, guess, given):
    """Norm of the gradient that multipliers cannot balance, and the least curvature where constraints do not bind."""
    import casadi

    nlp, values = program._program, program._packed(guess)
    multipliers = casadi.MX.sym("multipliers", nlp["g"].numel())
    lagrangian = nlp["f"] + casadi.dot(multipliers, nlp["g"])
    derivatives = casadi.Function(
        "derivatives",
        [nlp["x"], nlp["p"], multipliers],
        [
            casadi.gradient(nlp["f"], nlp["x"]),
            casadi.jacobian(nlp["g"], nlp["x"]),
            casadi.hessian(lagrangian, nlp["x"])[0],
        ],
    )
    parameters = [given[name] for name in program.problem.given]
    gradient, jacobian, _ = (m.full() for m in derivatives(values, parameters, np.zeros(multipliers.numel())))
    loose = (values > program._lower + 1e-5) & (values < program._upper - 1e-5)
    balance, *_ = np.linalg.lstsq(jacobian[:, loose].T, -gradient[loose, 0], rcond=None)
    residual = gradient[loose, 0] + jacobian[:, loose].T @ balance
    hessian = derivatives(values, parameters, balance)[2].full()[np.ix_(loose, loose)]
    directions = null_space(jacobian[:, loose])
    return np.linalg.norm(residual), np.linalg.eigvalsh(directions.T @ hessian @ directions)[0]


# ---- local minima ----------------------------------------------------------------------------------------------------


def test_the_rows_lead_to_a_cheaper_solution(branches, nominal, minima):
    assert branches.name.tolist() == ["2 reversals", "1 reversal"] and len(minima) == 2
    assert branches.effort[0] == pytest.approx(nominal.effort, rel=1e-7)
    assert branches.effort[1] < 0.5 * nominal.effort


def test_every_solution_is_stationary_and_a_minimum(inputs, minima):
    program = inputs.call(entry_problem.program, inputs.call(entry_problem.problem))
    for solution in minima:
        residual, curvature = stationarity(program, solution.guess(), entry_problem.given())
        assert residual < 1e-5
        assert curvature > 0.0


# ---- conditions on the bank ------------------------------------------------------------------------------------------


def test_a_further_condition_costs(branches, nominal):
    printed_set = branches.set_fixed.tolist().index([False, True, False, False])
    assert branches.set_effort[printed_set] == pytest.approx(nominal.effort, rel=1e-7)
    assert branches.set_cumulative[printed_set] == pytest.approx(nominal.cumulative, rel=1e-5)
    assert len({tuple(choice) for choice in branches.set_fixed.tolist()}) == 16
    compared = 0
    for a, looser in enumerate(branches.set_fixed):
        for b, tighter in enumerate(branches.set_fixed):
            if (looser <= tighter).all() and a != b and branches.set_reversals[a] == branches.set_reversals[b]:
                assert branches.set_effort[a] <= branches.set_effort[b] * (1.0 + 1e-7)
                compared += 1
    assert compared > 20


def test_conditions_are_at_the_values_given(inputs, nominal):
    fixed = inputs.changed(initial_bank=float(nominal.state[0, BANK]))
    fields = fixed.call(stage.bank_conditions, nominal)
    same = fields["set_fixed"].tolist().index([True, True, False, False])
    assert fields["set_effort"][same] == pytest.approx(nominal.effort, rel=1e-6)


# ---- through the fold ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def beside_the_fold(inputs, minima, path):
    """Points of the curve well before its fold and at its end."""
    curve, _ = inputs.call(stage.nominal_curve, minima[0], path)
    return curve[5], curve[-1]


def test_the_fold_lies_where_the_path_over_the_weight_loses_the_branch(branches, path):
    before, beyond = path.fold_weight[0]
    assert before <= branches.fold_weight <= beyond
    assert branches.curve_weight.max() == branches.fold_weight
    # The top of a parabola through points around it.
    near = np.abs(branches.curve_error - branches.fold_error) < 15.0
    a, b, c = np.polyfit(branches.curve_error[near] - branches.fold_error, branches.curve_weight[near], 2)
    assert np.count_nonzero(near) >= 5
    assert -b / (2.0 * a) == pytest.approx(0.0, abs=2.0)
    assert c - b * b / (4.0 * a) == pytest.approx(branches.fold_weight, rel=2e-4)
    assert branches.curve_error[-1] < branches.fold_error - 10.0  # it goes on beyond
    assert branches.curve_weight[-1] < 0.95 * branches.fold_weight


def test_the_weight_is_the_slope_of_the_curve(branches, inputs):
    norm = branches.curve_error / inputs.tabulated_error
    assert (np.diff(norm) < 0.0).all()
    mean = (branches.curve_weight[1:] + branches.curve_weight[:-1]) / 2.0
    np.testing.assert_allclose(np.diff(branches.curve_effort)[:9], -(mean * np.diff(norm))[:9], rtol=0.02)
    assert branches.curve_weight[0] == pytest.approx(0.0, abs=1e-6)


def test_the_path_over_the_weight_lies_on_the_curve(branches, path, inputs):
    errors, order = np.linalg.norm(path.path_error, axis=1), np.argsort(branches.curve_error)
    curve = CubicHermiteSpline(
        branches.curve_error[order],
        branches.curve_effort[order],
        -branches.curve_weight[order] / inputs.tabulated_error,
    )
    there = path.path_branch == 0
    assert np.count_nonzero(there) > 4
    np.testing.assert_allclose(curve(errors[there]), path.path_effort[there], rtol=2e-5)


def test_beyond_the_fold_no_weighted_sum_is_least(inputs, beside_the_fold, branches):
    """Each point is stationary for its weight; before the fold it is a minimum of that sum, beyond it a saddle."""
    _, weighted = inputs.call(tradeoff.prepared)
    width = len(weighted.problem.states)
    signs = []
    for point in beside_the_fold:
        guess = Guess(point.states[:, :width], point.controls, point.final_time)
        given = entry_problem.given(stage.weight_at_error(point))
        residual, curvature = stationarity(weighted, guess, given)
        assert residual < 1e-5
        signs.append(np.sign(curvature))
    before, beyond = (inputs.call(stage.given_error, point) for point in beside_the_fold)
    assert before > branches.fold_error + 10.0 > branches.fold_error - 10.0 > beyond
    assert signs == [1.0, -1.0]


def test_a_curve_without_a_fold_has_none(inputs, error_problem):
    points = [
        SimpleNamespace(given={"norm": norm}, boundary_multipliers={"norm of the radius column": norm - 8.0})
        for norm in (8.0, 7.9, 7.8)
    ]
    curve, top = inputs.call(stage.with_fold, error_problem, points)
    assert np.isnan(top).all()
    assert len(curve) == 3


# ---- least fuel ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fuel_inputs(desensitized):
    return desensitized.inputs("corrected", intervals=60)


@pytest.fixture(scope="module")
def fuel_nominal(desensitized):
    return desensitized.nominal("corrected", intervals=60)


@pytest.fixture(scope="module")
def way(fuel_inputs, fuel_nominal):
    """From energy to fuel under the smaller bound, at which thrust lasts longer than an interval."""
    bound = fuel_inputs.fuel_bounds[1]
    program = fuel_inputs.call(minimum_fuel.fuel_program, fuel_nominal, bound)
    guess = minimum_fuel.split(fuel_nominal)
    first = fuel_inputs.call(stage.attempt, program, guess, minimum_fuel.share(0.0), barrier=WARM)
    return fuel_inputs.call(minimum_fuel.to_fuel, program, first)


def fuel_fields(inputs, solution):
    return inputs.call(minimum_fuel.described, inputs.fuel_bounds[1], solution, True)


def test_least_fuel_is_bang_coast_bang(fuel_inputs, way):
    bound, solution = fuel_inputs.fuel_bounds[1], way.last
    assert solution.status == SOLVED
    assert solution.given["weight"] == 1.0
    fields = fuel_fields(fuel_inputs, solution)
    between = 1.0 - fields["coasting"] - fields["at_bound"]
    assert fields["bursts"] == 2
    assert fields["at_bound"] > 0.05
    assert between * fuel_inputs.intervals <= 2 * fields["bursts"] + 1e-9  # the intervals at the ends of bursts
    function = -solution.costates[:, BANK_RATE] * DEGREE
    assert minimum_fuel.violation(function, minimum_fuel.thrust(solution), bound) < 1e-6
    # Not both signs at once, so that the objective is the integral of |u|.
    assert solution.controls.min(axis=1).max() < 1e-6 * bound
    assert solution.objective == pytest.approx(fields["cumulative"] / DEGREE, rel=1e-5)


def test_the_nominals_branch_ends_on_the_way_to_least_fuel(fuel_inputs, fuel_nominal, way):
    before, after = fuel_fields(fuel_inputs, way.on_branch), fuel_fields(fuel_inputs, way.last)
    assert 0.8 < way.on_branch.given["weight"] < 1.0
    assert before["reversals"] == fuel_nominal.reversals == 2
    assert after["reversals"] == 1
    assert after["cumulative"] < 0.7 * before["cumulative"] < before["cumulative"] < fuel_nominal.cumulative


def test_the_switching_function_obeys_the_adjoint_equations(fuel_inputs, way):
    """Between intervals, L_k (I - h/2 A_k) = L_k+1 (I + h/2 A_k+1), and nothing holds bank and its rate at the end."""
    solution = way.last
    matrix, step = linear_model(fuel_inputs, solution)[0], np.diff(solution.time)[0]
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


def test_a_linear_program_finds_no_less_fuel(fuel_inputs, way):
    """Least integral of |u| with the end conditions linearised, in controls, initial bank and final time."""
    solution, bound = way.last, fuel_inputs.fuel_bounds[1]
    matrix, control_matrix = linear_model(fuel_inputs, solution)
    steps, count = np.diff(solution.time), len(solution.controls)
    end = solution.states[-1]
    rows = np.zeros((4, 8))
    rows[:3, :3] = np.diag([1.0 / 1e5, 10.0, 10.0])
    rows[3, 3:6] = 2.0 * end[3:6] / fuel_inputs.final_velocity**2
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
