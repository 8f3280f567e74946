"""Checks of a sum-of-squares bound after the solve, with nothing of the solver (robust entry funnels, Eqs. 23, 24)."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.checks import require_at_least, require_values

__all__ = ["Verification", "verify"]


@dataclass(frozen=True)
class Verification:
    """What fresh points of the variety and the eigenvalues of the Gram matrix say of a bound s."""

    identity_error: float  # largest |s - b - n'Q n| at fresh points, units of b
    least_value: float  # least s - b at fresh points, units of b
    least_eigenvalue: float  # of Q
    rounding_margin: float  # p eps |Q|: what the least eigenvalue may be off
    sound: bool


def verify(design, certificate, polynomial, seed, points=4000, tolerance=1e-6):
    """Test a bound of a polynomial at fresh random points of the spheres.

    Sound are an identity s - b = n'Q n that holds within the tolerance, no value s - b below minus the tolerance, and a
    Gram matrix without an eigenvalue below the rounding margin.

    Proven, up to rounding: at every fresh point s - b is at least the least eigenvalue times n'n, less the identity
    error. Only tested: the identity at other points. Both sides are polynomials, though, and if there are more random
    points than polynomials are independent on the spheres (406 of degree 4 on S^5 x S^1), an identity that held exactly
    at all of them would hold everywhere; so samples too few for their program, which meet their equations and none
    besides, show here, even where no value s - b is negative. A bound that counts the residual and the rounding is the
    certificate's `safe_bound`.

    Args:
        design: `Design` of the certificate.
        certificate: with bound and Gram matrix.
        polynomial: b, maps points (m, v) to values (m,).
        seed: of the points; another than the design's.
        points: their number.
        tolerance: of the identity and of the values, relative to the range of b.

    Returns:
        `Verification`.

    Raises:
        ValueError: if there are no points, or the polynomial is not finite at one.
    """
    require_at_least("points", points, 1)
    fresh = design.spheres.random_points(points, np.random.Generator(np.random.Philox(seed)))
    values = np.asarray(polynomial(fresh), dtype=float)
    require_values("the polynomial", values, points)
    if not (np.isfinite(certificate.bound) and np.isfinite(certificate.gram).all()):
        return Verification(np.inf, -np.inf, -np.inf, 0.0, False)
    basis, excess = design.evaluate(fresh), certificate.bound - values
    identity_error = np.abs(excess - np.einsum("mi,mi->m", basis @ certificate.gram, basis)).max()
    eigenvalues = np.linalg.eigvalsh(certificate.gram)
    margin = len(eigenvalues) * np.finfo(float).eps * np.abs(eigenvalues).max()
    limit = tolerance * (np.ptp(values) or 1.0)
    sound = identity_error <= limit and excess.min() >= -limit and eigenvalues[0] >= -margin
    return Verification(float(identity_error), float(excess.min()), float(eigenvalues[0]), float(margin), bool(sound))
