from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import block_diag

from generators import generator
from marsedl.methods.sos.design import random_design, well_chosen_design
from marsedl.methods.sos.sampled_program import absorb_residual, rank_one
from marsedl.methods.sos.variety import Spheres


@pytest.fixture(scope="module")
def entry_design():
    """S^5 x S^1, 406 samples, 43 polynomials."""
    return well_chosen_design(Spheres((6, 2)), seed=1)


def gram_values(certificate_gram, basis):
    return np.einsum("ij,jk,ik->i", basis, certificate_gram, basis)


def step_map(points, seed=3):
    """|A y + B w + quadratic terms|^2: what a stage of a funnel bounds, with numbers that mean nothing."""
    draw = generator(seed)
    state = np.eye(6) + 0.1 * draw.standard_normal((6, 6))
    disturbance, curvature = 0.3 * draw.standard_normal((6, 2)), 0.05 * draw.standard_normal((6, 8, 8))
    linear = points[:, :6] @ state.T + points[:, 6:] @ disturbance.T
    return np.sum((linear + np.einsum("ij,kjl,il->ik", points, curvature, points)) ** 2, axis=1)


def falling_quartic(design, seed):
    """-n'G n, G psd with a null vector n(x): its maximum 0 is attained at x, and its bound is exact."""
    draw = generator(seed)
    top = design.evaluate(design.spheres.random_points(1, draw))[0]
    root = draw.standard_normal((len(top), len(top)))
    root -= np.outer(root @ top, top) / (top @ top)
    return lambda points: -np.sum((design.evaluate(points) @ root.T) ** 2, axis=1)


def assert_attains(certificate, optimum, values, tolerance=1e-7):
    """Optimal, from above, and within the tolerance of the range of the values."""
    assert certificate.status == "optimal"
    error = (certificate.bound - optimum) / np.ptp(values)
    assert -1e-12 < error < tolerance
    assert certificate.bound <= certificate.safe_bound < certificate.bound + 1e-8 * np.ptp(values)
    assert 0 <= certificate.gap < 2 * tolerance * np.ptp(values)


def test_quadratic_form_gives_the_largest_eigenvalue(entry_design):
    matrix = generator(0).standard_normal((6, 6))
    matrix = matrix + matrix.T
    values = np.einsum("ij,jk,ik->i", entry_design.points[:, :6], matrix, entry_design.points[:, :6])
    assert_attains(rank_one(values, entry_design.basis), np.linalg.eigvalsh(matrix)[-1], values)


def test_bilinear_form_gives_the_spectral_norm(entry_design):
    matrix = generator(0).standard_normal((6, 2))
    values = np.einsum("ij,jk,ik->i", entry_design.points[:, :6], matrix, entry_design.points[:, 6:])
    assert_attains(rank_one(values, entry_design.basis), np.linalg.norm(matrix, 2), values)


def test_quartic_with_a_known_maximum(entry_design):
    values = 3.0 + falling_quartic(entry_design, 1)(entry_design.points)
    assert_attains(rank_one(values, entry_design.basis), 3.0, values)


@pytest.mark.parametrize("seed", range(2))
def test_quartics_on_the_circle_and_the_sphere_are_bounded_by_their_maximum(seed):
    """Nonnegative forms of two variables, and quartic ones of three, are sums of squares (Hilbert)."""
    draw = generator(seed)
    angles = np.linspace(0, 2 * np.pi, 4001)
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 301), np.linspace(0, np.pi, 301))
    grids = {
        2: np.stack([np.cos(angles), np.sin(angles)], axis=1),
        3: np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1).reshape(
            -1, 3
        ),
    }
    for dimension, grid in grids.items():
        spheres = Spheres((dimension,))
        exponents = spheres.monomials(4)
        exponents = exponents[exponents.sum(axis=1) == 4]
        coefficients = draw.standard_normal(len(exponents))
        design = well_chosen_design(spheres, seed)
        certificate = rank_one(spheres.evaluate(exponents, design.points) @ coefficients, design.basis, tolerance=1e-9)
        assert certificate.status == "optimal"
        largest = (spheres.evaluate(exponents, grid) @ coefficients).max()
        spacing = np.pi / 300  # a maximum between grid points is higher by at most curvature spacing^2 / 4
        curvature = 16 * np.abs(coefficients).sum()
        assert 0 <= certificate.safe_bound - largest < curvature * spacing**2 / 4


def test_nonnegative_form_that_is_no_sum_of_squares_is_bounded_strictly():
    """Choi and Lam's form of four variables: least value 0, attained at (1, 1, 1, 1)."""
    design = well_chosen_design(Spheres((4,)), seed=1)
    x, y, z, w = design.points.T
    values = -((x * y) ** 2 + (y * z) ** 2 + (z * x) ** 2 + w**4 - 4 * x * y * z * w)
    assert 1e-4 < rank_one(values, design.basis).bound < 0.05


def test_certificate_holds_away_from_the_samples(entry_design):
    values = step_map(entry_design.points)
    certificate = rank_one(values, entry_design.basis)
    assert certificate.status == "optimal" and certificate.iterations <= 12
    assert np.linalg.eigvalsh(certificate.gram)[0] > 0
    assert certificate.residual < 1e-12
    fresh = entry_design.spheres.random_points(4000, generator(0))
    difference = certificate.bound - step_map(fresh)
    np.testing.assert_allclose(gram_values(certificate.gram, entry_design.evaluate(fresh)), difference, atol=1e-11)
    assert 0 < difference.min() < 0.2 * certificate.bound


def test_multipliers_are_optimal(entry_design):
    values = step_map(entry_design.points)
    certificate = rank_one(values, entry_design.basis, tolerance=1e-8)
    slack = entry_design.basis.T @ (certificate.multipliers[:, None] * entry_design.basis)
    assert certificate.multipliers.sum() == pytest.approx(1, abs=1e-12)
    assert np.linalg.eigvalsh(slack)[0] > -1e-12
    assert values @ certificate.multipliers == pytest.approx(certificate.bound - certificate.gap, rel=1e-14)
    assert np.vdot(slack, certificate.gram) == pytest.approx(certificate.gap, abs=1e-11)
    assert certificate.gap < 1e-8 * np.ptp(values)


def test_bound_does_not_depend_on_design_basis_or_rotation(entry_design):
    spheres = entry_design.spheres
    reference = rank_one(step_map(entry_design.points), entry_design.basis).bound
    monomials = spheres.evaluate(spheres.quotient_monomials(2), entry_design.points)
    mixed = entry_design.basis @ (np.eye(43) + 0.3 * generator(0).standard_normal((43, 43)))
    for basis in (monomials, mixed):
        assert rank_one(step_map(entry_design.points), basis).bound == pytest.approx(reference, rel=2e-7)
    for other in (well_chosen_design(spheres, 2), random_design(spheres, 406, 2)):
        assert rank_one(step_map(other.points), other.basis).bound == pytest.approx(reference, rel=5e-7)
    rotation = block_diag(*(np.linalg.qr(generator(0).standard_normal((n, n)))[0] for n in spheres.dimensions))
    rotated = entry_design.points @ rotation
    assert rank_one(step_map(rotated), entry_design.evaluate(rotated)).bound == pytest.approx(reference, rel=2e-7)


def exact_semidefinite(matrix):
    """Whether a rational matrix is positive semidefinite: all pivots of its exact elimination positive."""
    matrix = [row[:] for row in matrix]
    for k in range(len(matrix)):
        if matrix[k][k] <= 0:
            return False
        for i in range(k + 1, len(matrix)):
            factor = matrix[i][k] / matrix[k][k]
            matrix[i] = [a - factor * b for a, b in zip(matrix[i], matrix[k], strict=True)]
    return True


def exact_solution(matrix, right):
    """Gauss-Jordan in rational numbers."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = next(i for i in range(k, len(rows)) if rows[i][k] != 0)
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [a / rows[k][k] for a in rows[k]]
        for i in range(len(rows)):
            if i != k and rows[i][k] != 0:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


def exactly_proves(values, basis, bound, gram):
    """Whether s - b_i = n_i'(Q + F) n_i has a solution F among the n_i n_i' with Q + F psd, in rational arithmetic."""
    basis = [[Fraction(x) for x in row] for row in basis.tolist()]
    gram, size = [[Fraction(x) for x in row] for row in gram.tolist()], len(basis[0])

    def form(matrix, row):
        return sum(row[i] * matrix[i][j] * row[j] for i in range(size) for j in range(size))

    products = [[sum(a * b for a, b in zip(one, two, strict=True)) ** 2 for two in basis] for one in basis]
    missed = [Fraction(bound) - Fraction(b) - form(gram, row) for b, row in zip(values.tolist(), basis, strict=True)]
    weights = exact_solution(products, missed)
    total = [
        [gram[i][j] + sum(c * row[i] * row[j] for c, row in zip(weights, basis, strict=True)) for j in range(size)]
        for i in range(size)
    ]
    return exact_semidefinite(total)


@pytest.mark.parametrize(("dimensions", "tolerance"), [((2,), 1e-9), ((2, 1), 1e-7)])
def test_safe_bound_is_proved_in_rational_arithmetic(dimensions, tolerance):
    design = well_chosen_design(Spheres(dimensions), seed=4)
    exponents = design.spheres.monomials(4)
    values = design.spheres.evaluate(exponents, design.points) @ generator(1).standard_normal(len(exponents))
    certificate = rank_one(values, design.basis, tolerance)
    # What another solver might return: shifted down, with a residual and an indefinite matrix.
    for bound, gram in (
        (certificate.bound, certificate.gram),
        (certificate.bound - 1e-4, certificate.gram - 1e-5 * np.eye(len(certificate.gram))),
        (certificate.bound - 1e-6, certificate.gram),
    ):
        safe, matrix = absorb_residual(values, design.basis, bound, gram)
        assert exactly_proves(values, design.basis, safe, matrix)
    optimum = certificate.bound - certificate.gap
    assert not exactly_proves(values, design.basis, optimum - 1e-6, certificate.gram)


def test_safe_bound_undoes_a_tampered_solution(entry_design):
    values = step_map(entry_design.points)
    certificate = rank_one(values, entry_design.basis)
    draw = generator(0).standard_normal((43, 43))
    for size in (1e-9, 1e-6, 1e-3):
        noise = size * (draw + draw.T) / 43
        bound, gram = absorb_residual(values, entry_design.basis, certificate.bound - size, certificate.gram + noise)
        assert certificate.bound - certificate.gap < bound < certificate.bound + 20 * size + 1e-8
        fresh = entry_design.spheres.random_points(500, generator(1))
        np.testing.assert_allclose(
            gram_values(gram, entry_design.evaluate(fresh)), bound - step_map(fresh), atol=1e-11 * bound
        )
        assert np.linalg.eigvalsh(gram)[0] > -1e-15
