"""Programs without a solution, with too few iterations, or of numbers that no solver survives, by every wrapper."""

import cvxpy
import numpy as np
import pytest

from marsedl.methods import conic
from marsedl.methods.sos.conic_program import run_solver


def bounded():
    x = cvxpy.Variable(3)
    return cvxpy.Problem(cvxpy.Minimize(cvxpy.sum(x)), [cvxpy.norm(x) <= 1, cvxpy.sum_squares(x[:2]) <= 0.5])


def infeasible():
    x = cvxpy.Variable(2)
    return cvxpy.Problem(cvxpy.Minimize(x[0]), [cvxpy.norm(x) <= 1, x[0] >= 2])


def unbounded():
    x = cvxpy.Variable(2)
    return cvxpy.Problem(cvxpy.Minimize(x[0]), [cvxpy.norm(x[:1]) <= x[1]])


def numerically_failing():
    x = cvxpy.Variable(2)
    matrix = np.array([[1e300, 1.0], [1.0, 1e-300]])
    return cvxpy.Problem(cvxpy.Minimize(cvxpy.sum(x)), [cvxpy.norm(matrix @ x) <= 1e150, x >= -1e200])


@pytest.mark.parametrize(
    ("problem", "settings", "status"),
    [
        (infeasible, {}, r"'infeasible' \(PrimalInfeasible\)"),
        (unbounded, {}, r"'unbounded' \(DualInfeasible\)"),
        (bounded, {"max_iter": 2}, r"'(user_limit|solver_error)' \(MaxIterations\)"),
        (numerically_failing, {}, r"'\w+' \(\w+\)"),
    ],
)
def test_an_optimum_or_an_error_with_status_iterations_and_residuals(problem, settings, status):
    with pytest.raises(
        RuntimeError,
        match=rf"^the case: CLARABEL ended with the status {status} after \d+ iterations, with residuals "
        r"[-+.e\dnaif]+ \(primal\) and [-+.e\dnaif]+ \(dual\)$",
    ):
        conic.optimum(problem(), "the case", settings=(settings,))


@pytest.mark.parametrize("solver", conic.SOLVERS)
@pytest.mark.parametrize(
    ("problem", "words"), [(infeasible, "infeasible"), (unbounded, "unbounded"), (numerically_failing, "")]
)
def test_the_sums_of_squares_have_a_status_in_words_and_no_solution(solver, problem, words):
    posed = problem()
    status, iterations = run_solver(posed, solver, 1e-8)
    assert status.startswith((f"{solver} says {words}", f"{solver} failed"))
    assert words in status
    assert iterations >= 0


@pytest.mark.parametrize("solver", conic.SOLVERS)
@pytest.mark.parametrize(
    ("problem", "limit", "statuses"),
    [
        (infeasible, {}, ["infeasible"]),
        (unbounded, {}, ["unbounded"]),
        (bounded, {"CLARABEL": {"max_iter": 2}, "SCS": {"max_iters": 2}},
         ["user_limit", "solver_error", "optimal_inaccurate"]),
        (numerically_failing, {}, None),
    ],
)  # fmt: skip
def test_what_is_not_solved_is_not_accepted_and_leaves_no_solution_of_before(solver, problem, limit, statuses):
    posed = problem()
    for variable in posed.variables():
        variable.value = np.ones(variable.shape)
    settings = [limit.get(solver, {})] * 3
    outcome = conic.solve(posed, solver=solver, asked=conic.Accuracy(1e-12, 1e-12), settings=settings)
    assert statuses is None or outcome.status in statuses
    assert outcome.accepted_by == ""
    assert outcome.solver == solver
    assert outcome.iterations >= 0
    assert outcome.attempt == (1 if outcome.status == "infeasible" else 3)  # which nothing else would change
    if outcome.status in ("infeasible", "unbounded", "solver_error"):
        assert all(variable.value is None for variable in posed.variables())


def test_an_inaccurate_solution_keeps_its_name_and_says_by_which_rule_it_is_accepted():
    out_of_reach = {"asked": conic.Accuracy(1e-17, 1e-17)}
    refused = conic.solve(bounded(), settings=({}, {"max_step_fraction": 0.9}), **out_of_reach)
    by_accuracy = conic.solve(bounded(), enough=conic.Accuracy(1e-8, 1e-7), settings=({}, {}), **out_of_reach)
    by_leave = conic.solve(bounded(), enough=conic.Accuracy(1e-30, 1e-30), accept_inaccurate=True, **out_of_reach)
    assert {each.status for each in (refused, by_accuracy, by_leave)} == {"optimal_inaccurate"}
    assert (refused.accepted_by, refused.attempt) == ("", 2)
    assert (by_accuracy.accepted_by, by_accuracy.attempt) == ("accuracy", 1)
    assert (by_leave.accepted_by, by_leave.attempt) == ("leave", 1)
    assert 0.0 <= by_accuracy.duality_gap <= 1e-8
    assert conic.solve(bounded()).accepted_by == "status"


def test_the_first_settings_with_a_solution_win():
    outcome = conic.solve(bounded(), settings=({"max_iter": 2}, {}, {"max_iter": 3}))
    assert (outcome.status, outcome.attempt, outcome.accepted_by) == ("optimal", 2, "status")


def test_an_unknown_solver_is_refused():
    with pytest.raises(ValueError, match="solver must be one of CLARABEL, SCS, not 'ECOS'"):
        conic.solve(bounded(), solver="ECOS")
