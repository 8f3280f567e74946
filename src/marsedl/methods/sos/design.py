"""Samples and polynomial basis of a sampled sum-of-squares program (robust entry funnels, Eq. 24).

A sampled program equals the polynomial one only if the samples determine every product of two basis polynomials: the
rank of the products at the samples must be the dimension of the polynomials of twice the degree. Fewer samples still
give a program that solves, with a bound that is too small. The design does not depend on the polynomial that is
bounded: in whitened coordinates one design serves every slice of a funnel.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

from marsedl.methods.sos.variety import Spheres
from marsedl.summaries import summary

__all__ = ["Design", "condition_number", "hermite_values", "random_design", "rank_of_products", "well_chosen_design"]

# Random candidates per sample that the pivoted factorisation chooses from.
_CANDIDATES_PER_SAMPLE = 6


@dataclass(frozen=True, eq=False)
class Design:
    """Samples on a product of spheres and a polynomial basis evaluated there."""

    spheres: Spheres
    degree: int  # of the basis; the polynomials that are bounded have twice this degree
    points: np.ndarray  # samples, (M, v)
    basis: np.ndarray  # values of the basis at the samples, orthonormal there: basis'basis = M I, (M, p)
    transform: np.ndarray  # from quotient monomials to the basis, which is their values @ transform

    __repr__ = summary

    def evaluate(self, points):
        """Values of the same basis at other points.

        Args:
            points: (m, v).

        Returns:
            Values (m, p).
        """
        return self.spheres.evaluate(self.spheres.quotient_monomials(self.degree), points) @ self.transform

    @property
    def needed(self):
        """Number of samples that the equivalence needs."""
        return self.spheres.sample_count(self.degree)

    @property
    def rank(self):
        """Number of independent products of basis polynomials at the samples."""
        return rank_of_products(self.basis)


def well_chosen_design(spheres, seed, degree=2):
    """The least number of samples, well placed: approximate Fekete points.

    From six times as many random points, a column-pivoted QR factorisation of the (orthonormalised) polynomials of
    twice the degree picks points one after the other, each the farthest from what those before determine.

    Args:
        spheres: `Spheres`.
        seed: of the random candidates.
        degree: of the basis.

    Returns:
        `Design` with `spheres.sample_count(degree)` samples.

    Raises:
        ValueError: if the samples do not determine the products.
    """
    count = spheres.sample_count(degree)
    candidates = spheres.random_points(_CANDIDATES_PER_SAMPLE * count, _generator(seed))
    indices = _pivots(_highest_values(spheres, degree, candidates))[:count]
    return _design(spheres, degree, candidates[indices], allow_deficient=False)


def random_design(spheres, count, seed, degree=2, allow_deficient=False):
    """Samples uniform on the spheres.

    Args:
        spheres: `Spheres`.
        count: number of samples.
        seed: of the samples.
        degree: of the basis.
        allow_deficient: accept samples that do not determine the products; bounds from them are too small.

    Returns:
        `Design` with `count` samples.

    Raises:
        ValueError: if the samples do not determine the products and that is not allowed.
    """
    points = spheres.random_points(count, _generator(seed))
    return _design(spheres, degree, points, allow_deficient)


def rank_of_products(basis):
    """Rank of the matrices n_i n_i' of basis values over the samples (robust entry funnels, samples of Eq. 24).

    Samples suffice if this rank is the largest that any samples can give.

    Args:
        basis: values of the basis at the samples, (M, p).

    Returns:
        Rank, at most M and p (p + 1) / 2.
    """
    rows, columns = np.triu_indices(basis.shape[1])
    products = basis[:, rows] * basis[:, columns]
    # Rows of unit length: the rank must not depend on the size of the basis at a sample.
    return int(np.linalg.matrix_rank(products / np.linalg.norm(products, axis=1, keepdims=True)))


def condition_number(values, rank=None):
    """Largest over smallest singular value.

    Args:
        values: of a basis at samples, (M, p).
        rank: number of singular values that count; all of them if not given. A full monomial basis is dependent on
            spheres, and its rank smaller than p.

    Returns:
        Condition number.
    """
    singular = np.linalg.svd(values, compute_uv=False)
    return float(singular[0] / singular[(rank or len(singular)) - 1])


def hermite_values(exponents, points, scale=1.0):
    """Values of products of Hermite polynomials He_a(scale x) / sqrt(a!), orthonormal for standard normal arguments.

    Args:
        exponents: degree in every variable, integers (count, variables).
        points: (m, variables).
        scale: factor of the coordinates, scalar or (variables,).

    Returns:
        Values (m, count).
    """
    scaled = np.asarray(points, dtype=float) * scale
    table = [np.ones_like(scaled), scaled]
    for degree in range(1, int(np.max(exponents))):
        table.append(scaled * table[degree] - degree * table[degree - 1])
    factorial = np.cumprod(np.concatenate([[1.0], np.arange(1.0, len(table))]))
    table = np.array(table) / np.sqrt(factorial)[:, None, None]
    return np.prod([table[powers, :, variable] for variable, powers in enumerate(np.asarray(exponents).T)], axis=0).T


def _design(spheres, degree, points, allow_deficient):
    values = spheres.evaluate(spheres.quotient_monomials(degree), points)
    rank = np.linalg.matrix_rank(values)
    if rank < values.shape[1]:
        raise ValueError(f"the {len(points)} samples determine {rank} of {values.shape[1]} basis polynomials")
    triangle = np.linalg.qr(values, mode="r")
    transform = solve_triangular(triangle, np.eye(values.shape[1])) * np.sqrt(len(points))
    design = Design(spheres, degree, points, values @ transform, transform)
    if not allow_deficient and design.rank < design.needed:
        raise ValueError(
            f"the {len(points)} samples determine {design.rank} of {design.needed} products of basis polynomials: "
            "bounds from them would be too small"
        )
    return design


def _highest_values(spheres, degree, points):
    """Orthonormal columns that span the polynomials of twice the degree at the points."""
    return np.linalg.qr(spheres.evaluate(spheres.quotient_monomials(2 * degree), points))[0]


def _pivots(values):
    """Order in which column-pivoted QR of the transpose picks the rows."""
    return qr(values.T, mode="r", pivoting=True)[1]


def _generator(seed):
    return np.random.Generator(np.random.Philox(seed))
