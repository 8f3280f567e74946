"""Products of unit spheres and the polynomials on them.

The whitened boundary of a funnel slice is a unit sphere, and so is the boundary of the disturbance set; a sampled
program lives on their product. Polynomials that agree there differ by multiples of |y|^2 - 1, so the monomials of the
full space are dependent on it. Leaving out every multiple of the square of the first variable of each sphere removes
exactly those dependencies (these squares are the leading terms of a Groebner basis, prime to one another).
"""

from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from math import comb

import numpy as np

from marsedl.methods.checks import require_shape

__all__ = ["Spheres"]


@dataclass(frozen=True)
class Spheres:
    """Product of unit spheres; a point is a row that holds their coordinates one sphere after the other.

    Args:
        dimensions: number of coordinates of each sphere: (6, 2) is S^5 x S^1.

    Raises:
        ValueError: if there is no sphere, or one without coordinates.
    """

    dimensions: tuple

    def __post_init__(self):
        """Refuse anything but positive whole numbers."""
        try:
            dimensions = tuple(int(count) for count in self.dimensions)
            exact = dimensions == tuple(self.dimensions)
        except (TypeError, ValueError):
            exact = False
        if not exact or not dimensions or min(dimensions) < 1:
            raise ValueError(f"dimensions of the spheres must be positive whole numbers, got {self.dimensions!r}")
        object.__setattr__(self, "dimensions", dimensions)

    @property
    def variables(self):
        """Number of coordinates of a point."""
        return sum(self.dimensions)

    @property
    def blocks(self):
        """Slice of the coordinates of each sphere."""
        ends = np.cumsum(self.dimensions)
        return tuple(slice(int(end - count), int(end)) for end, count in zip(ends, self.dimensions, strict=True))

    def monomials(self, degree):
        """Exponents of all monomials up to a degree, lower degrees first.

        Args:
            degree: largest total degree, at least 0.

        Returns:
            Exponents, integers (count, variables); the constant comes first.
        """
        if degree != int(degree) or degree < 0:
            raise ValueError(f"the degree of a polynomial must be a whole number from 0, got {degree!r}")
        rows = [
            np.bincount(np.array(variables, dtype=int), minlength=self.variables)
            for total in range(int(degree) + 1)
            for variables in combinations_with_replacement(range(self.variables), total)
        ]
        return np.array(rows)

    def quotient_monomials(self, degree):
        """Exponents of a basis of the polynomials up to a degree as functions on the spheres.

        The monomials without a multiple of the square of the first variable of any sphere.

        Args:
            degree: largest total degree, at least 0.

        Returns:
            Exponents, integers (basis_dimension(degree), variables).
        """
        exponents = self.monomials(degree)
        first = [block.start for block in self.blocks]
        return exponents[np.all(exponents[:, first] < 2, axis=1)]

    def basis_dimension(self, degree):
        """Dimension of the polynomials up to a degree as functions on the spheres (affine Hilbert function).

        sum over sets A of spheres (-1)^|A| C(v + d - 2 |A|, v), v the number of variables, d the degree: every sphere
        is one equation of degree 2, and no equation divides zero modulo the others.
        """
        v, spheres = self.variables, len(self.dimensions)
        return sum(
            (-1) ** size * comb(v + degree - 2 * size, v)
            for size in range(min(spheres, degree // 2) + 1)
            for _ in combinations(range(spheres), size)
        )

    def sample_count(self, degree):
        """Least number of samples for a Gram matrix over the polynomials up to a degree.

        The products of two basis polynomials span all polynomials up to twice the degree, and samples in general
        position determine these if there are as many as their dimension: for degree 2, 406 on S^5 x S^1 and 182 on S^5.
        """
        return self.basis_dimension(2 * degree)

    def evaluate(self, exponents, points):
        """Values of monomials.

        Args:
            exponents: integers (count, variables).
            points: (m, variables), on the spheres or not.

        Returns:
            Values (m, count).
        """
        points = self._rows(points)
        values = np.ones((len(points), len(exponents)))
        for variable, powers in enumerate(np.asarray(exponents).T):
            table = points[:, variable, None] ** np.arange(powers.max() + 1)
            values *= table[:, powers]
        return values

    def random_points(self, count, generator):
        """Points uniform on every sphere.

        Args:
            count: number of points.
            generator: numpy random generator.

        Returns:
            Points (count, variables).
        """
        return self.project(generator.standard_normal((count, self.variables)))

    def project(self, points):
        """Scale the coordinates of each sphere to length one.

        Args:
            points: (m, variables), nowhere zero on a whole sphere.

        Returns:
            Points on the spheres (m, variables).
        """
        points = self._rows(points)
        blocks = [points[:, block] for block in self.blocks]
        return np.concatenate([block / np.linalg.norm(block, axis=1, keepdims=True) for block in blocks], axis=1)

    def _rows(self, points):
        points = np.asarray(points, dtype=float)
        require_shape("points", points, ("m", self.variables))
        return points
