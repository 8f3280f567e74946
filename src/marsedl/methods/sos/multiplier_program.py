r"""Bound of a polynomial on spheres by matching coefficients, with multipliers: the form that samples replace.

On unit spheres, with $x_j$ the coordinates of sphere $j$, $z$ all monomials of half the degree of $b$ and $q_j$ free
polynomials:

    $\text{minimise} \quad s \quad \text{subject to} \quad s - b = z^\top Q z + \sum_j q_j (x_j^\top x_j - 1), \quad Q
      \text{ positive semidefinite}$

an identity between polynomials, one equation for every coefficient (robust entry funnels, before Eq. 24). To bound $b$
in the whole ball of a sphere, its free multiplier gives way to a sum of squares times what is positive there:

    $z_1^\top R_j z_1 (1 - x_j^\top x_j), \quad z_1 \text{ the monomials of a degree less by one}, \quad R_j
      \text{ positive semidefinite}$
"""

from dataclasses import dataclass
from functools import lru_cache
from math import factorial, fsum

import numpy as np

from marsedl.methods.checks import require_array, require_at_least, require_one_of, require_values
from marsedl.methods.conic import SOLVERS
from marsedl.methods.sos.conic_program import nearest_semidefinite, run_solver
from marsedl.methods.sos.variety import Spheres
from marsedl.summaries import summary

__all__ = ["MultiplierCertificate", "MultiplierProgram", "polynomial_coefficients"]


@dataclass(frozen=True, eq=False)
class MultiplierCertificate:
    """Upper bound of a polynomial on spheres and full balls, with the identity that shows it."""

    bound: float  # s, as the solver left it
    gram: np.ndarray  # Q, (p, p), semidefinite
    multipliers: np.ndarray  # coefficients of the free q_j, (spheres without a full ball, monomials)
    ball_grams: np.ndarray  # R_j, (full balls, p_1, p_1), semidefinite
    gap: float  # s - b'mu with the dual moments mu, units of b: how far s may be above the optimum
    residual: float  # largest coefficient of the difference between both sides, units of b
    iterations: int
    solver: str
    status: str  # "optimal", or a sentence that says what was not reached
    safe_bound: float = np.inf  # at least s; proven for the given coefficients in spite of residual and rounding

    __repr__ = summary


class MultiplierProgram:
    """The program with multipliers for given spheres, its sparse equations built once.

    Args:
        dimensions: number of coordinates of each sphere.
        full_ball: whether the bound shall hold in the whole ball of the last sphere; or a flag for every sphere.
        degree: of z; the polynomials that are bounded have twice this degree.
        solver: "CLARABEL" or "SCS".
        tolerance: of the solver, relative to the largest coefficient but the constant.

    Raises:
        ValueError: for invalid dimensions, a wrong number of flags, an unknown solver or a degree below 1.
    """

    def __init__(self, dimensions, full_ball=False, degree=2, solver="CLARABEL", tolerance=1e-8):  # noqa: D107
        import cvxpy
        from scipy.sparse import hstack

        require_one_of("solver", solver, SOLVERS)
        require_at_least("degree", degree, 1)
        self.spheres, self.degree = Spheres(dimensions), degree
        further_spheres = len(self.spheres.dimensions) - 1
        self.full_ball = tuple(
            map(bool, (*[False] * further_spheres, full_ball) if np.ndim(full_ball) == 0 else full_ball)
        )
        if len(self.full_ball) != further_spheres + 1:
            raise ValueError(
                f"expected one flag of a full ball for each of {further_spheres + 1} spheres, not {full_ball}"
            )
        self.solver, self.tolerance = solver, tolerance
        self.exponents = self.spheres.monomials(2 * degree)  # of b, (n, v), the constant first
        self._half = self.spheres.monomials(degree)
        blocks = list(zip(self.spheres.blocks, self.full_ball, strict=True))
        free, balls = [block for block, full in blocks if not full], [block for block, full in blocks if full]
        multiplier, less = self.spheres.monomials(2 * degree - 2), self.spheres.monomials(degree - 1)
        self._squares = self._monomials(_pair_sums(self._half))
        parts = [-self._monomials(self.exponents[:1]), self._squares]
        parts += [self._sphere_term(multiplier, block) for block in free]
        parts += [-self._sphere_term(_pair_sums(less), block) for block in balls]
        # All entries are 1 or -1: entries times unknowns are exact.
        self._equations = hstack(parts, format="csr")
        self._shapes = [(), (len(self._half),) * 2, (len(free), len(multiplier)), (len(balls), len(less), len(less))]

        bound, gram = cvxpy.Variable(), cvxpy.Variable(self._shapes[1], PSD=True)
        self._variables = [bound, gram]
        self._variables += [cvxpy.Variable(len(multiplier)) for _ in free]
        self._variables += [cvxpy.Variable(self._shapes[3][1:], PSD=True) for _ in balls]
        self._coefficients = cvxpy.Parameter(len(self.exponents))
        unknowns = cvxpy.hstack([cvxpy.vec(variable, order="C") for variable in self._variables])
        self._problem = cvxpy.Problem(cvxpy.Minimize(bound), [self._equations @ unknowns + self._coefficients == 0])

    def solve(self, coefficients):
        """Least bound of a polynomial.

        Args:
            coefficients: of b, in the order of `exponents`, (n,).

        Returns:
            `MultiplierCertificate`. Its Gram matrices are the semidefinite ones nearest to the solver's; what that
            changes is in the residual. Without any solution the bound is infinite.

        Raises:
            ValueError: for coefficients of another number, or not finite.
        """
        coefficients = np.asarray(coefficients, dtype=float)
        require_array("coefficients", coefficients, (len(self.exponents),))
        shift, scale = coefficients[0], np.abs(coefficients[1:]).max() or 1.0
        self._coefficients.value = np.concatenate([[0.0], coefficients[1:] / scale])
        status, iterations = run_solver(self._problem, self.solver, self.tolerance)
        moments = self._problem.constraints[0].dual_value
        if moments is None or any(variable.value is None for variable in self._variables):
            nothing = [np.full(shape, np.nan) for shape in self._shapes[1:]]
            return MultiplierCertificate(np.inf, *nothing, np.inf, np.inf, iterations, self.solver, status)
        bound, gram, *grams = [variable.value for variable in self._variables]
        bound, gram = float(shift + scale * bound), scale * nearest_semidefinite(gram)
        free = self._shapes[2][0]
        multipliers = scale * np.array(grams[:free]).reshape(self._shapes[2])
        ball_grams = scale * np.array([nearest_semidefinite(m) for m in grams[free:]]).reshape(self._shapes[3])
        residual = self._residual(coefficients, bound, gram, multipliers, ball_grams)
        return MultiplierCertificate(
            bound=bound,
            gram=gram,
            multipliers=multipliers,
            ball_grams=ball_grams,
            gap=float(bound - coefficients @ (moments / moments[0])),
            residual=float(np.abs(residual).max()),
            iterations=iterations,
            solver=self.solver,
            status=status,
            safe_bound=self.proven_bound(coefficients, bound, gram, multipliers, ball_grams),
        )

    def proven_bound(self, coefficients, bound, gram, multipliers, ball_grams):
        r"""A bound that holds for the given coefficients, near a numerical one; no rounding error is left out.

        The coefficients $r$ of $s - b - \text{(right-hand side)}$ go into the Gram matrix, each spread over the
        products of monomials that it belongs to. What is left after rounding, $r^\prime$, is summed without error, and
        no monomial exceeds 1 in magnitude on the set. With $c$ the multinomial coefficients,
        $\sum_i c_i z_i^2 = (1 + x^\top x)^d \le (1 + J)^d =: m$ for $J$ spheres, so that, with the same margins $t_j$
        for $R_j$,

            $b \le s + t m + \sum_j t_j (1 + J)^{d-1} + \sum \left| r^\prime \right| \quad \text{if} \quad Q + t \,
              \text{diag}(c) \text{ is positive semidefinite}$

        and that is proven by a Cholesky factorisation in floating point which succeeds after the diagonal was lowered
        by more than its rounding can amount to.

        Args:
            coefficients: of b, (n,).
            bound: s.
            gram: Q, (p, p).
            multipliers: of the free $q_j$.
            ball_grams: $R_j$.

        Returns:
            Bound, at least s.
        """
        residual = self._residual(coefficients, bound, gram, multipliers, ball_grams)
        products = self._squares.sum(axis=1)
        gram = gram + (self._squares.T @ (residual / products)).reshape(gram.shape)
        gram, ball_grams = (gram + gram.T) / 2, (ball_grams + ball_grams.swapaxes(1, 2)) / 2
        remainder = self._residual(coefficients, bound, gram, multipliers, ball_grams, exact=True)
        spheres = len(self.spheres.dimensions)
        rise = (1 + spheres) ** self.degree * _proven_shift(gram, _multinomials(self._half, self.degree))
        for ball_gram in ball_grams:
            rise += (1 + spheres) ** (self.degree - 1) * _proven_shift(ball_gram, np.ones(len(ball_gram)))
        # The last factor covers the rounding of these few sums.
        return float(bound + (rise + fsum(np.abs(remainder))) * (1 + 1e-12) + 4 * np.spacing(abs(bound)))

    def _residual(self, coefficients, bound, gram, multipliers, ball_grams, exact=False):
        """Coefficients of s - b minus the right-hand side, (n,); on demand rounded once only."""
        unknowns = _stacked(bound, gram, multipliers, ball_grams)
        if not exact:
            return -coefficients - self._equations @ unknowns
        terms, starts = self._equations.data * unknowns[self._equations.indices], self._equations.indptr
        return np.array(
            [-fsum([b, *terms[i:j]]) for b, i, j in zip(coefficients, starts[:-1], starts[1:], strict=True)]
        )

    def _monomials(self, exponents):
        """Sparse matrix (n, count) from coefficients of the given monomials to those of the polynomial."""
        from scipy.sparse import csr_array

        place = {tuple(row): i for i, row in enumerate(self.exponents)}
        rows = [place[tuple(row)] for row in exponents]
        return csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(len(place), len(rows)))

    def _sphere_term(self, exponents, block):
        """Sparse matrix (n, count) from coefficients of the given monomials to those of q (x'x - 1)."""
        squares = 2 * np.eye(self.spheres.variables, dtype=int)[block]
        return sum(self._monomials(exponents + square) for square in squares) - self._monomials(exponents)


def polynomial_coefficients(function, variables, degree, seed, points=1500, spread=0.6):
    """Coefficients of a polynomial that is known by its values: linear least squares on random points.

    Args:
        function: maps points (m, v) to values (m,).
        variables: v.
        degree: of the polynomial.
        seed: of the points.
        points: their number.
        spread: their standard deviation, the same for every coordinate.

    Returns:
        (coefficients, in the order of `Spheres.monomials`, (n,); largest difference at the points). A difference beyond
        rounding says that the function is not a polynomial of this degree.

    Raises:
        ValueError: if the points are too few for the coefficients, or a value is not finite.
    """
    locations, orthonormal, triangle = _fit_points(variables, degree, seed, points, spread)
    values = np.asarray(function(locations), dtype=float)
    require_values("the function", values, points)
    projection = orthonormal.T @ values
    return np.linalg.solve(triangle, projection), float(np.abs(values - orthonormal @ projection).max())


@lru_cache(maxsize=4)
def _fit_points(variables, degree, seed, points, spread):
    """Random points and the factors of the values of the monomials there: the same for every polynomial."""
    space = Spheres((variables,))
    exponents = space.monomials(degree)
    if points < len(exponents):
        raise ValueError(f"{points} points do not determine {len(exponents)} coefficients")
    locations = spread * np.random.Generator(np.random.Philox(seed)).standard_normal((points, variables))
    points_and_factors = locations, *np.linalg.qr(space.evaluate(exponents, locations))
    for array in points_and_factors:
        array.flags.writeable = False
    return points_and_factors


def _stacked(bound, gram, multipliers, ball_grams):
    """Unknowns of the equations as one vector."""
    return np.concatenate([[bound], gram.ravel(), multipliers.ravel(), ball_grams.ravel()])


def _pair_sums(exponents):
    """Exponents of the products of all pairs of monomials, (count^2, v)."""
    return (exponents[:, None] + exponents).reshape(-1, exponents.shape[1])


def _multinomials(exponents, degree):
    """Coefficients of the squares of the monomials in (1 + x'x)^degree."""
    return np.array(
        [
            factorial(degree) // (np.prod([factorial(int(e)) for e in row]) * factorial(degree - int(row.sum())))
            for row in exponents
        ],
        dtype=float,
    )


def _proven_shift(matrix, weights):
    """A small t >= 0 for which matrix + t diag(weights) is positive semidefinite beyond doubt; weights of 1 or more.

    If floating-point Cholesky of A - c I succeeds, with c at least about (p + 1) u tr A, then A is positive definite
    (Rump 2006); c is taken eight times larger, which also covers the rounding of the diagonal.
    """
    size, eps = len(matrix), np.finfo(float).eps
    values = np.linalg.eigvalsh(matrix)
    least, extra = max(0.0, -values[0]), size * eps * np.abs(values).max()
    while True:
        raised = matrix + (least + extra) * np.diag(weights)
        margin = 4 * (size + 1) * eps * np.trace(raised)
        try:
            np.linalg.cholesky(raised - margin * np.eye(size))
        except np.linalg.LinAlgError:
            extra = 2 * max(extra, margin, np.finfo(float).tiny)
        else:
            return least + extra
