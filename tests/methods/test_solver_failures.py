"""Programs without a solution, with too few iterations, or of numbers that no solver survives, by every wrapper."""

import cvxpy
import numpy as np
import pytest

from marsedl.methods.covariance_steering import block_program, clarabel
from marsedl.methods.sos import conic_program


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
    ("problem", "options", "status"),
    [
        (infeasible, {}, r"'infeasible' \(PrimalInfeasible\)"),
        (unbounded, {}, r"'unbounded' \(DualInfeasible\)"),
        (bounded, {"max_iter": 2}, r"'(user_limit|solver_error)' \(MaxIterations\)"),
        (numerically_failing, {}, r"'\w+' \(\w+\)"),
    ],
)
def test_an_optimum_or_an_error_with_status_iterations_and_residuals(monkeypatch, problem, options, status):
    monkeypatch.setattr(clarabel, "_OPTIONS", clarabel._OPTIONS | options)
    with pytest.raises(
        RuntimeError,
        match=rf"^the case: Clarabel ended with the status {status} after \d+ iterations, with residuals "
        r"[-+.e\dnaif]+ \(primal\) and [-+.e\dnaif]+ \(dual\)$",
    ):
        clarabel.solve_to_optimum(problem(), "the case")


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
@pytest.mark.parametrize(
    ("problem", "words"), [(infeasible, "infeasible"), (unbounded, "unbounded"), (numerically_failing, "")]
)
def test_the_sums_of_squares_have_a_status_in_words_and_no_solution(solver, problem, words):
    posed = problem()
    status, iterations = conic_program.run_solver(posed, solver, 1e-8)
    assert status.startswith((f"{solver} says {words}", f"{solver} failed"))
    assert words in status
    assert iterations >= 0


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
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
def test_the_steering_program_reports_status_iterations_and_residuals(monkeypatch, solver, problem, limit, statuses):
    options = block_program._options(solver, 1e-12)
    monkeypatch.setattr(block_program, "_options", lambda *_: [o | limit.get(solver, {}) for o in options])
    report = block_program._run(problem(), solver, 1e-12)
    assert report["status"] != "optimal"
    assert statuses is None or report["status"] in statuses
    assert report["solver"] == solver
    assert report["iterations"] >= 0
    assert {"duality_gap", "primal_residual", "dual_residual"} <= report.keys()
