"""The sampled sum-of-squares program by general cone solvers: a second opinion (robust entry funnels, Eqs. 24, 36)."""

import numpy as np

from marsedl.methods.checks import require_array, require_one_of
from marsedl.methods.conic import SOLVERS, Accuracy, solve
from marsedl.methods.sos.sampled_program import Certificate, certify

__all__ = ["ConicProgram", "nearest_semidefinite", "run_solver"]

_MOST_ITERATIONS = 20_000  # of SCS


class ConicProgram:
    r"""The sampled program for one basis, compiled once for any values.

        $\text{minimise} \quad s \quad \text{subject to} \quad s - b_i = n_i^\top Q n_i, \quad i = 1 \ldots M, \quad Q
          \text{ positive semidefinite}$

    Each equation holds all of $Q$: the block of $p (p + 1) / 2$ columns is dense, and that makes this form slow.

    Args:
        basis: $n$ at the samples, (M, p).
        solver: "CLARABEL" or "SCS".
        tolerance: of the solver, relative to the range of the values.

    Raises:
        ValueError: for an unknown solver, or a basis that is not a finite matrix.
    """

    def __init__(self, basis, solver="CLARABEL", tolerance=1e-7):  # noqa: D107
        import cvxpy

        require_one_of("solver", solver, SOLVERS)
        self.basis = np.asarray(basis, dtype=float)
        require_array("basis", self.basis, ("M", "p"))
        self.solver, self.tolerance = solver, tolerance
        samples, size = self.basis.shape
        products = np.einsum("mi,mj->mij", self.basis, self.basis).reshape(samples, -1)
        self._values = cvxpy.Parameter(samples)
        self._bound, self._gram = cvxpy.Variable(), cvxpy.Variable((size, size), PSD=True)
        matching = self._bound - self._values == products @ cvxpy.vec(self._gram, order="C")
        self._problem = cvxpy.Problem(cvxpy.Minimize(self._bound), [matching])

    def solve(self, values):
        """Least bound for values at the samples.

        Args:
            values: b, (M,).

        Returns:
            `Certificate`. Its Gram matrix is the semidefinite one nearest to the solver's; what that changes is in the
            residual. Its status says what the solver says if that is not "optimal"; without any solution the bound is
            infinite.

        Raises:
            ValueError: for values of another shape, or not finite.
        """
        samples, size = self.basis.shape
        values = np.asarray(values, dtype=float)
        require_array("values", values, (samples,))
        shift, scale = values.mean(), np.ptp(values) or 1.0
        self._values.value = (values - shift) / scale
        status, iterations = run_solver(self._problem, self.solver, self.tolerance)
        multipliers = self._problem.constraints[0].dual_value
        if self._gram.value is None or multipliers is None:
            nothing = np.full((size, size), np.nan), np.full(samples, np.nan)
            return Certificate(np.inf, *nothing, np.inf, np.inf, iterations, self.solver, status)
        return certify(
            values,
            self.basis,
            shift + scale * self._bound.value,
            scale * nearest_semidefinite(self._gram.value),
            multipliers,
            iterations=iterations,
            solver=self.solver,
            status=status,
        )


def run_solver(problem, solver, tolerance):
    """Solve a cvxpy problem from a cold start.

    Args:
        problem: of cvxpy; its variables and dual values are set, the variables to None if there is no solution.
        solver: "CLARABEL" or "SCS".
        tolerance: of gap and residuals.

    Returns:
        (status, iterations): "optimal", or a sentence with what the solver says.
    """
    settings = ({"max_iters": _MOST_ITERATIONS} if solver == "SCS" else {},)
    outcome = solve(problem, solver=solver, asked=Accuracy(tolerance, tolerance), settings=settings)
    if outcome.status == "solver_error":
        return f"{solver} failed: {outcome.said}", outcome.iterations
    status = outcome.status if outcome.accepted_by else f"{solver} says {outcome.status.replace('_', ' ')}"
    return status, outcome.iterations


def nearest_semidefinite(matrix):
    """The symmetric matrix without its negative eigenvalues.

    Args:
        matrix: (p, p).

    Returns:
        Matrix (p, p), the nearest positive semidefinite one.
    """
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
