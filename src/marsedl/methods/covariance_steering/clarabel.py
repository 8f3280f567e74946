"""Cone programs that have to be solved: an optimum by Clarabel, or an error that says how far it came."""

_OPTIONS = {"direct_solve_method": "qdldl"}


def solve_to_optimum(problem, what, accept=("optimal",)):
    """Solve a cvxpy problem with Clarabel from a cold start.

    Args:
        problem: of cvxpy; its variables and its value are set.
        what: the program in words, for the message.
        accept: statuses of cvxpy that count as an optimum.

    Returns:
        Iterations.

    Raises:
        RuntimeError: for another status, with iterations and residuals.
    """
    import warnings

    import cvxpy

    # Not problem.solve, which hides the residuals.
    data, chain, inverse = problem.get_problem_data(cvxpy.CLARABEL, solver_opts=_OPTIONS)
    solution = chain.solve_via_data(problem, data, warm_start=False, verbose=False, solver_opts=_OPTIONS)
    try:
        with warnings.catch_warnings():
            # The status says it.
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            problem.unpack_results(solution, chain, inverse)
        status = problem.status
    except cvxpy.error.SolverError:
        status = "solver_error"
    if status not in accept:
        raise RuntimeError(
            f"{what}: Clarabel ended with the status {status!r} ({solution.status}) after {solution.iterations} "
            f"iterations, with residuals {solution.r_prim:.2g} (primal) and {solution.r_dual:.2g} (dual)"
        )
    return int(solution.iterations)
