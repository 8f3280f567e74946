"""Covariances, and matrices of quadratic costs, looked at in units that do not matter."""

import numpy as np

__all__ = ["correlations"]

_ROUNDING = 1e-9  # difference of mirror images, and eigenvalue below zero, that counts as rounding among correlations


def correlations(name, matrix, definite=False):
    """Scale a positive semidefinite matrix so that its diagonal is one, and refuse what is none.

    Entries of different units, m^2 and rad^2, cannot be compared before.

    Args:
        name: of the matrix, for messages.
        matrix: (n, n), finite.
        definite: refuse also what is semidefinite only.

    Returns:
        Roots of the diagonal, one for zero, (n,); the matrix divided by them on both sides, (n, n).

    Raises:
        ValueError: if the matrix is not symmetric, or not positive semidefinite, up to rounding.
    """
    diagonal = matrix.diagonal()
    units = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = matrix / (units[:, np.newaxis] * units)
    if np.abs(scaled - scaled.T).max() > _ROUNDING:
        raise ValueError(f"{name} must be symmetric")
    kind = "definite" if definite else "semidefinite"
    if diagonal.min() <= 0 and matrix[diagonal <= 0].any():
        raise ValueError(f"{name} must be positive {kind}, but has {diagonal.min():.3g} on its diagonal")
    eigenvalues = np.linalg.eigvalsh(scaled)
    least = eigenvalues[0]
    if least < -_ROUNDING * eigenvalues[-1] or (definite and least <= 0):
        raise ValueError(
            f"{name} must be positive {kind}, but with its diagonal scaled to one it has the eigenvalue {least:.3g}"
        )
    return units, scaled
