"""Cone programs by Clarabel, or by SCS for a second opinion: what a solver says of its solution is kept as it is."""

from typing import NamedTuple

from marsedl.methods.checks import require_one_of
from marsedl.summaries import summary

__all__ = ["SOLVERS", "Accuracy", "Outcome", "optimum", "solve"]

SOLVERS = ("CLARABEL", "SCS")
# Why a solution is accepted.
BY_STATUS = "status"  # the solver reached what it was asked for
BY_ACCURACY = "accuracy"  # it did not, but gap and residuals are as small as the caller needs them
BY_LEAVE = "leave"  # the caller takes a solution that the solver calls inaccurate


class Accuracy(NamedTuple):
    """Largest duality gap, relative to the objective, and largest residual of a solution, of the program as posed."""

    gap: float
    residual: float


CLARABELS_OWN = Accuracy(1e-8, 1e-8)


class Outcome(NamedTuple):
    """How a solver ended, and how accurate its solution is by its own account."""

    status: str  # of CVXPY: "optimal", "optimal_inaccurate", "infeasible", "solver_error", ...
    said: str  # the solver's own word for it
    accepted_by: str  # why the solution counts: "status", "accuracy" or "leave"; empty: it does not
    attempt: int  # number of the settings that ended so, from 1
    iterations: int
    solver: str
    duality_gap: float
    primal_residual: float
    dual_residual: float

    __repr__ = summary

    @property
    def sentence(self):
        """Solver, status, iterations and residuals in words."""
        return (
            f"{self.solver} ended with the status {self.status!r} ({self.said}) after {self.iterations} iterations, "
            f"with residuals {self.primal_residual:.2g} (primal) and {self.dual_residual:.2g} (dual)"
        )


def solve(problem, *, solver="CLARABEL", asked=CLARABELS_OWN, settings=({},), enough=None, accept_inaccurate=False):
    """Solve a cvxpy problem from a cold start, with one settings of the solver after the other.

    Settings are tried until a solution is accepted or the program is proven infeasible; else the last outcome counts.

    Args:
        problem: of cvxpy; its variables, dual values and value are set, the variables to None if there is no solution.
        solver: "CLARABEL" or "SCS".
        asked: `Accuracy` that the solver is asked for; SCS knows the gap only.
        settings: further settings of the solver, for every attempt.
        enough: `Accuracy` with which a solution is accepted that the solver calls inaccurate; None: with none.
        accept_inaccurate: accept such a solution whatever its accuracy.

    Returns:
        `Outcome`.

    Raises:
        ValueError: for an unknown solver.
    """
    import warnings

    import cvxpy

    require_one_of("solver", solver, SOLVERS)
    for attempt, further in enumerate(settings, 1):
        options = _accuracy_options(solver, asked) | further
        for variable in problem.variables():
            variable.value = None  # a failure must not leave the last solution
        # Not problem.solve, which hides gap and residuals.
        data, chain, inverse = problem.get_problem_data(solver, solver_opts=options)
        raw = chain.solve_via_data(problem, data, warm_start=False, verbose=False, solver_opts=options)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")  # the status says it
            try:
                problem.unpack_results(raw, chain, inverse)
                status = problem.status
            except cvxpy.error.SolverError:
                status = "solver_error"
        outcome = _outcome(solver, raw, status, attempt)
        outcome = outcome._replace(accepted_by=_accepted_by(outcome, enough, accept_inaccurate))
        if outcome.accepted_by or status == "infeasible":
            break
    return outcome


def optimum(problem, what, **options):
    """Solve a problem that has to have an optimum.

    Args:
        problem: of cvxpy.
        what: the program in words, for the message.
        options: of `solve`.

    Returns:
        `Outcome` of an accepted solution.

    Raises:
        RuntimeError: if no solution is accepted, with status, iterations and residuals.
        ValueError: as `solve`.
    """
    outcome = solve(problem, **options)
    if not outcome.accepted_by:
        raise RuntimeError(f"{what}: {outcome.sentence}")
    return outcome


def _accuracy_options(solver, asked):
    """Settings that ask for an accuracy."""
    if solver == "SCS":
        return {"eps_abs": asked.gap, "eps_rel": asked.gap}
    shared = {"direct_solve_method": "qdldl"}  # whose pivots do not depend on the machine
    return shared | {"tol_gap_abs": asked.gap, "tol_gap_rel": asked.gap, "tol_feas": asked.residual}


def _accepted_by(outcome, enough, accept_inaccurate):
    """The rule that accepts an outcome, or an empty text."""
    if outcome.status == "optimal":
        return BY_STATUS
    if outcome.status != "optimal_inaccurate":
        return ""
    residual = max(outcome.primal_residual, outcome.dual_residual)
    if enough is not None and outcome.duality_gap <= enough.gap and residual <= enough.residual:
        return BY_ACCURACY
    return BY_LEAVE if accept_inaccurate else ""


def _outcome(solver, raw, status, attempt):
    """What the solver's own result says."""
    if solver == "CLARABEL":
        said, iterations = str(raw.status), raw.iterations
        primal, dual, primal_residual, dual_residual = raw.obj_val, raw.obj_val_dual, raw.r_prim, raw.r_dual
    else:
        info = raw["info"]
        said, iterations = info["status"], info["iter"]
        primal, dual, primal_residual, dual_residual = (info[k] for k in ("pobj", "dobj", "res_pri", "res_dual"))
    return Outcome(
        status=status,
        said=said,
        accepted_by="",
        attempt=attempt,
        iterations=int(iterations),
        solver=solver,
        duality_gap=float(abs(primal - dual) / max(1.0, min(abs(primal), abs(dual)))),
        primal_residual=float(primal_residual),
        dual_residual=float(dual_residual),
    )
