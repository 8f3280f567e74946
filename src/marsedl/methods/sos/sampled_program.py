"""Bound of a polynomial on a variety by a sum of squares that is matched at samples (robust entry funnels, Eq. 24).

Primal: minimise s, with s - b_i = n_i' Q n_i at the samples i = 1 ... M and Q positive semidefinite.
Dual: maximise b'mu, with sum mu_i = 1 and S = sum mu_i n_i n_i' positive semidefinite.

The samples must determine the products of the basis polynomials (`design.rank_of_products`); then equality at the
samples is equality on the variety, and s bounds b there. Without it every result below holds at the samples only.
Both problems are strictly feasible then, so every finite b has a bound, attained and equal to the dual optimum.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack, qr, solve_triangular
from scipy.linalg.blas import dsyrk

from marsedl.methods.checks import require_array
from marsedl.summaries import summary

__all__ = ["Certificate", "absorb_residual", "certify", "rank_one"]

_STEP = 0.97  # part of the way to the boundary of the cone
# Relative rise of the diagonal of H, tried in turn: none leaves its factorisation to chance before the gap is closed,
# a larger one slows the convergence.
_RELAXATIONS = (1e-15, 1e-14, 1e-13)
_DEPENDENT = 1e-13  # ratio of the squares of the pivots below which samples are redundant
_ROUNDING = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Certificate:
    """Upper bound of a polynomial on a variety, with the sum of squares that shows it."""

    bound: float  # s, as the solver left it
    gram: np.ndarray  # Q, (p, p)
    multipliers: np.ndarray  # mu, (M,)
    gap: float  # s - b'mu, units of b: how far s may be above the optimum
    residual: float  # largest |s - b_i - n_i'Q n_i|, units of b
    iterations: int
    solver: str
    status: str  # "optimal", or a sentence that says what was not reached
    safe_bound: float = np.inf  # at least s, with a sum of squares in spite of residual and rounding; inf: none found

    __repr__ = summary


def certify(values, basis, bound, gram, multipliers, *, iterations, solver, status):
    """Certificate of what a solver returned: gap, residual and safe bound are computed here, not believed.

    Args:
        values: b at the samples, (M,).
        basis: n at the samples, (M, p).
        bound: s.
        gram: Q, (p, p).
        multipliers: mu, (M,), divided by their sum here.
        iterations: of the solver.
        solver: its name.
        status: "optimal" or a sentence.

    Returns:
        `Certificate`.
    """
    gram, multipliers = _symmetrised(gram), multipliers / np.sum(multipliers)
    return Certificate(
        bound=float(bound),
        gram=gram,
        multipliers=multipliers,
        gap=float(bound - values @ multipliers),
        residual=float(np.abs(_residual(values, basis, bound, gram)).max()),
        iterations=int(iterations),
        solver=solver,
        status=status,
        safe_bound=absorb_residual(values, basis, bound, gram)[0],
    )


def absorb_residual(values, basis, bound, gram):
    """A bound with a sum of squares, near a numerical one that has a residual and small negative eigenvalues.

    Samples that determine the products also determine the polynomial r of the residuals r_i = s - b_i - n_i'Q n_i, and
    E = sum c_i n_i n_i' with (n_j'n_i)^2 c = r writes it as n'E n: then s - b = n'(Q + E) n on the whole variety. In
    the same way K is found with n'K n = 1. If K is positive definite, raising s by the least t >= 0 that makes
    Q + E + t K positive semidefinite gives a sum of squares, s + t - b.

    Rounding counts as one more residual: what the last matrix may still miss at the samples, with bounds of the errors
    of the inner products, is n'F n with |F| at most its length over the square root of the least eigenvalue of
    (n_j'n_i)^2. A further rise t covers |F| and the error of the least eigenvalue. The polynomial b is the one through
    the given values; errors of these are not covered.

    Args:
        values: b at the samples, (M,).
        basis: n at the samples, (M, p); no redundant samples.
        bound: s.
        gram: Q, (p, p).

    Returns:
        (safe bound, its Gram matrix); (inf, Q) if samples are redundant or K is not positive definite.
    """
    orthonormal, triangle = _orthonormalised(basis)
    size = len(triangle)
    factor = _product_factor(orthonormal)
    if factor is None:
        return np.inf, gram

    unit = _interpolant(orthonormal, factor, np.ones(len(values)))
    unit_least = np.linalg.eigvalsh(unit)[0]
    if unit_least <= size * _ROUNDING:
        return np.inf, gram
    inner = triangle @ gram @ triangle.T
    inner = inner + _interpolant(orthonormal, factor, _residual(values, orthonormal, bound, inner))
    rise = max(0.0, -np.linalg.eigvalsh(_congruent(inner, np.linalg.cholesky(unit)))[0])
    bound, inner = bound + rise, inner + rise * unit

    # Inner products of length p err by at most p eps times the sum of the magnitudes.
    magnitudes = abs(bound) + np.abs(values) - _residual(0.0, np.abs(orthonormal), 0.0, np.abs(inner))
    missed = np.abs(_residual(values, orthonormal, bound, inner)) + 4 * size * _ROUNDING * magnitudes
    inverse_root_norm = np.linalg.norm(lapack.dtrtri(factor, lower=1)[0])
    margin = np.linalg.norm(missed) * inverse_root_norm + 4 * size * _ROUNDING * np.linalg.norm(inner)
    rise = 1.001 * margin / unit_least  # the thousandth covers the rounding of K
    inner = solve_triangular(triangle, solve_triangular(triangle, inner + rise * unit).T)
    return float(bound + rise), _symmetrised(inner)


def rank_one(values, basis, tolerance=1e-7, iterations=60):
    """Solve the sampled program by a primal-dual interior-point method that exploits its rank-one constraints.

    The matrix of the Newton equations for mu (direction of Helmberg, Kojima and Monteiro) is an elementwise product,
    H = (N Q N') o (N S^-1 N'): neither the Gram matrix as a vector nor the M equations as a dense block appears.
    Predictor and corrector share one Cholesky factor of H. The start meets all equations and rounding is removed from
    every step, so s is a bound all the way and decreases to the optimum.

    Args:
        values: b at the samples, (M,).
        basis: n at the samples, (M, p).
        tolerance: of gap and residual, relative to the range of the values.
        iterations: largest number of Newton steps.

    Returns:
        `Certificate`; its status says whether the tolerance was reached.

    Raises:
        ValueError: for shapes that do not fit, values or basis that are not finite, a dependent basis or redundant
            samples.
    """
    values, basis = _checked(values, basis)
    orthonormal, triangle = _orthonormalised(basis)
    products = _product_factor(orthonormal)
    if products is None:
        raise ValueError(f"some of the {len(values)} samples are redundant: use the reduced design")
    shift, scale = values.mean(), np.ptp(values) or abs(values[0]) or 1.0
    bound, gram, multipliers, steps, status = _interior_point(
        (values - shift) / scale, orthonormal, products, tolerance, iterations
    )
    gram = scale * solve_triangular(triangle, solve_triangular(triangle, gram).T)
    bound = shift + scale * bound
    return certify(
        values, basis, bound, gram, multipliers, iterations=steps, solver="rank-one interior point", status=status
    )


def _interior_point(values, basis, products, tolerance, iterations):
    """(s, Q, mu, steps, status) of the best iterate, for values of range one and a basis with basis'basis = M I."""
    samples, size = basis.shape
    bound, gram = _start(values, basis, products)
    multipliers = np.full(samples, 1.0 / samples)
    best_error, best, steps = np.inf, None, 0
    while True:
        slack = _weighted_product(basis, multipliers)
        primal, dual = _residual(values, basis, bound, gram), 1.0 - multipliers.sum()
        error = max(abs(bound - values @ multipliers), 10 * np.abs(primal).max(), 10 * abs(dual))
        if error < best_error:
            best_error, best = error, (bound, gram, multipliers)
        if error < tolerance:
            return *best, steps, "optimal"
        accuracy = f"gap and residual {best_error:.1e} of the range of the values"
        if steps == iterations:
            return *best, steps, f"not converged in {iterations} iterations: {accuracy}"
        try:
            gram_root, slack_root = np.linalg.cholesky(gram), np.linalg.cholesky(slack)
            newton = _newton(basis, products, gram, gram_root, slack_root)
        except np.linalg.LinAlgError:
            return *best, steps, f"stopped by rounding: {accuracy}"
        _, gram_step, _, slack_step = _direction(newton, -gram, primal, dual)
        gram_length, slack_length = _longest(gram_step, gram_root), _longest(slack_step, slack_root)
        complementarity = np.vdot(gram, slack)
        ahead = np.vdot(gram + gram_length * gram_step, slack + slack_length * slack_step)
        centring = max(0.0, ahead / complementarity) ** 3 * complementarity / size
        correction = _symmetrised(gram_step @ slack_step @ newton.slack_inverse)
        target = centring * newton.slack_inverse - gram - correction
        bound_step, gram_step, multiplier_step, slack_step = _direction(newton, target, primal, dual)
        gram_length, slack_length = _longest(gram_step, gram_root), _longest(slack_step, slack_root)
        bound, gram = bound + gram_length * bound_step, gram + gram_length * gram_step
        multipliers = multipliers + slack_length * multiplier_step
        steps += 1


def _start(values, basis, products):
    """(s, Q) inside the cone without residual, so that every iterate bounds the values: Q = s K - B.

    B and K are the matrices whose n'B n and n'K n are b and 1. Where K is not definite (samples that determine less
    than the products) s and Q start with a residual.
    """
    unit, values_matrix = _interpolant(basis, products, np.ones_like(values)), _interpolant(basis, products, values)
    try:
        least, *_, largest = np.linalg.eigvalsh(_congruent(values_matrix, np.linalg.cholesky(unit)))
    except np.linalg.LinAlgError:
        return 1.0, 2.0 / len(unit) * np.eye(len(unit))
    bound = 2 * largest - least + 1e-3  # the thousandth is for constant values
    return bound, bound * unit - values_matrix


class _Newton(NamedTuple):
    """Factored Newton equations: H dmu + ds 1 = ..., 1'dmu = ..."""

    basis: np.ndarray
    products: np.ndarray  # Cholesky factor of (n_j'n_i)^2
    gram: np.ndarray  # Q
    slack_inverse: np.ndarray  # S^-1
    factor: tuple  # Cholesky factor of H
    ones_solution: np.ndarray  # H^-1 1


def _newton(basis, products, gram, gram_root, slack_root):
    samples, size = basis.shape
    inverse_root = solve_triangular(slack_root, np.eye(size), lower=True)
    schur = _symmetric_product(basis @ gram_root) * _symmetric_product(basis @ inverse_root.T)
    factor = _factored(schur)
    return _Newton(basis, products, gram, inverse_root.T @ inverse_root, factor, _solve(factor, np.ones(samples)))


def _factored(schur):
    """Cholesky factor of H with the least relaxation that gives one."""
    for relaxation in _RELAXATIONS:
        relaxed = schur.copy(order="F")
        relaxed[np.diag_indices_from(relaxed)] += relaxation * np.diag(schur)
        try:
            # What is not finite has no factor either.
            return cho_factor(relaxed, lower=True, overwrite_a=True, check_finite=False)
        except np.linalg.LinAlgError:
            continue
    raise np.linalg.LinAlgError("Newton equations are singular to working precision")


def _direction(newton, target, primal, dual):
    """(ds, dQ, dmu, dS) with dQ + sym(Q dS S^-1) = target that removes the primal and dual residuals."""
    right_side = np.einsum("ij,ij->i", newton.basis @ target, newton.basis) - primal
    particular = _solve(newton.factor, right_side)
    bound_step = (particular.sum() - dual) / newton.ones_solution.sum()
    multiplier_step = particular - bound_step * newton.ones_solution
    slack_step = _weighted_product(newton.basis, multiplier_step)
    gram_step = target - _symmetrised(newton.gram @ slack_step @ newton.slack_inverse)
    # H is ill-conditioned near the optimum: what dQ misses at the samples is interpolated, so that the residual goes.
    missed = _residual(-primal, newton.basis, bound_step, gram_step)
    gram_step = gram_step + _interpolant(newton.basis, newton.products, missed)
    return bound_step, gram_step, multiplier_step, slack_step


def _longest(step, root):
    """Step length: _STEP of the way to the boundary of the cone, at most 1."""
    least = np.linalg.eigvalsh(_congruent(step, root))[0]
    return min(1.0, -_STEP / least) if least < 0 else 1.0


def _congruent(matrix, root):
    """root^-1 matrix root^-T."""
    return solve_triangular(root, solve_triangular(root, matrix, lower=True).T, lower=True)


def _residual(values, basis, bound, gram):
    """s - b_i - n_i'Q n_i."""
    return bound - values - np.einsum("ij,ij->i", basis @ gram, basis)


def _symmetrised(matrix):
    return (matrix + matrix.T) / 2


def _weighted_product(basis, weights):
    """sum w_i n_i n_i'."""
    return _symmetrised(basis.T @ (weights[:, None] * basis))


def _interpolant(basis, products, samples):
    """The combination E of the matrices n_i n_i' with given n_i'E n_i."""
    return _weighted_product(basis, _solve((products, True), samples))


def _solve(factor, right_side):
    """Solution with a Cholesky factor; looking for numbers that are not finite would take as long again."""
    return cho_solve(factor, right_side, check_finite=False)


def _symmetric_product(matrix):
    """matrix matrix', lower triangle (the upper one is zero)."""
    return dsyrk(1.0, matrix, lower=True)


def _product_factor(basis):
    """Cholesky factor of (n_j'n_i)^2, the Gram matrix of the matrices n_i n_i'; None if these are dependent."""
    try:
        factor = np.linalg.cholesky(_symmetric_product(basis) ** 2)
    except np.linalg.LinAlgError:
        return None
    pivots = np.diag(factor) ** 2
    # In the order of LAPACK, which copies any other one whenever it solves.
    return np.asfortranarray(factor) if pivots.min() > _DEPENDENT * pivots.max() else None


def _orthonormalised(basis):
    """(N, R), basis = N R, N'N = M I."""
    orthonormal, triangle = qr(basis, mode="economic")
    diagonal = np.abs(np.diag(triangle))
    if diagonal.min() <= len(basis) * _ROUNDING * diagonal.max():
        raise ValueError("the basis polynomials are dependent at the samples: use a basis of the quotient")
    root = np.sqrt(len(basis))
    return np.asfortranarray(orthonormal * root), triangle / root


def _checked(values, basis):
    values, basis = np.asarray(values, dtype=float), np.asarray(basis, dtype=float)
    require_array("values", values, ("M",))
    require_array("basis", basis, (len(values), "p"))
    if len(basis) < basis.shape[1]:
        raise ValueError(f"a basis of {basis.shape[1]} polynomials needs as many samples, not {len(basis)}")
    return values, basis
