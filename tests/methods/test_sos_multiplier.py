import cvxpy
import numpy as np
import pytest

from generators import generator
from marsedl.methods.sos import conic_program
from marsedl.methods.sos.conic_program import ConicProgram
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.multiplier_program import MultiplierProgram, polynomial_coefficients
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.methods.sos.variety import Spheres
from starts import maximize_from_random_starts as maximize


def random_quartic(dimensions, seed):
    """Coefficients of a quartic, and the quartic."""
    spheres = Spheres(dimensions)
    exponents = spheres.monomials(4)
    coefficients = generator(seed).standard_normal(len(exponents))
    return coefficients, lambda points: spheres.evaluate(exponents, points) @ coefficients


@pytest.mark.parametrize("dimensions", [(3,), (3, 2)])
def test_samples_and_multipliers_give_one_bound(dimensions):
    coefficients, function = random_quartic(dimensions, 1)
    design = well_chosen_design(Spheres(dimensions), 1)
    values = function(design.points)
    sampled = rank_one(values, design.basis, tolerance=1e-8)
    for solver in ("CLARABEL", "SCS"):
        matched = MultiplierProgram(dimensions, solver=solver).solve(coefficients)
        assert matched.status == "optimal"
        assert matched.bound == pytest.approx(sampled.bound, abs=1e-6 * np.ptp(values))
        # And it is not below what the polynomial reaches.
        assert matched.safe_bound >= maximize(function, dimensions, 1)[0]


def test_samples_and_multipliers_give_one_bound_in_the_size_of_the_entry_funnel():
    coefficients, function = random_quartic((6, 2), 3)
    design = well_chosen_design(Spheres((6, 2)), 1)
    sampled = rank_one(function(design.points), design.basis)
    matched = MultiplierProgram((6, 2), solver="SCS").solve(coefficients)
    assert matched.bound == pytest.approx(sampled.bound, rel=1e-7)
    # This quartic has a tight bound.
    assert 0 <= matched.safe_bound / maximize(function, (6, 2), 1)[0] - 1 < 1e-6


def test_both_solvers_agree_on_the_sampled_form():
    _, function = random_quartic((3, 2), 5)
    design = well_chosen_design(Spheres((3, 2)), 1)
    values = function(design.points)
    first, second = (ConicProgram(design.basis, solver).solve(values) for solver in ("CLARABEL", "SCS"))
    expected = rank_one(values, design.basis, tolerance=1e-9)
    for certificate in (first, second):
        assert certificate.status == "optimal"
        assert certificate.bound == pytest.approx(expected.bound, abs=1e-6 * np.ptp(values))
        assert abs(certificate.gap) < 1e-6 * np.ptp(values)
        assert certificate.residual < 1e-6 * np.ptp(values)
        assert certificate.safe_bound >= expected.bound - expected.gap - 1e-12
        assert np.linalg.eigvalsh(certificate.gram)[0] > -1e-12
        # The multipliers are a dual solution: moments of a measure, as it were.
        assert certificate.multipliers.sum() == pytest.approx(1.0, abs=1e-12)
        moments = design.basis.T @ (certificate.multipliers[:, None] * design.basis)
        assert np.linalg.eigvalsh(moments)[0] > -1e-5 * np.linalg.norm(moments)


def test_the_largest_eigenvalue_is_the_bound_of_a_quadratic_form():
    matrix = generator(2).standard_normal((6, 6))
    matrix = matrix + matrix.T

    def function(points):
        return np.einsum("mi,ij,mj->m", points, matrix, points)

    coefficients, error = polynomial_coefficients(function, 6, 4, 1)
    assert error < 1e-12
    certificate = MultiplierProgram((6,), solver="SCS").solve(coefficients)
    assert certificate.bound == pytest.approx(np.linalg.eigvalsh(matrix)[-1], rel=1e-7)


@pytest.mark.parametrize("full_ball", [False, True])
def test_the_identity_holds_away_from_the_spheres_too(full_ball):
    coefficients, function = random_quartic((3, 2), 1)
    program = MultiplierProgram((3, 2), full_ball)
    certificate = program.solve(coefficients)
    anywhere = generator(8).standard_normal((200, 5))
    # Squares, and multipliers times what vanishes or is positive.
    n = program.spheres
    z = n.evaluate(n.monomials(2), anywhere)
    expected = np.einsum("mi,ij,mj->m", z, certificate.gram, z)
    free = z @ certificate.multipliers.T  # of degree 2, as z
    expected += free[:, 0] * (np.sum(anywhere[:, :3] ** 2, axis=1) - 1)
    excess = np.sum(anywhere[:, 3:] ** 2, axis=1) - 1
    if full_ball:
        linear = n.evaluate(n.monomials(1), anywhere)
        expected -= np.einsum("mi,ij,mj->m", linear, certificate.ball_grams[0], linear) * excess
        assert np.linalg.eigvalsh(certificate.ball_grams[0])[0] > -1e-12
    else:
        expected += free[:, 1] * excess
    np.testing.assert_allclose(certificate.bound - function(anywhere), expected, atol=1e-5)
    assert np.abs(expected).max() > 10  # so that the tolerance means something


def test_the_full_disc_counts_where_the_worst_disturbance_lies_inside():
    centre = np.array([0.3, -0.1])

    def function(x):
        return (2 + x[:, 0] * x[:, 1]) * (1 - np.sum((x[:, 2:] - centre) ** 2, axis=1)) + 0.2 * x[:, 0]

    coefficients, error = polynomial_coefficients(function, 4, 4, 1)
    assert error < 1e-12
    circle, disc = (MultiplierProgram((2, 2), full).solve(coefficients).safe_bound for full in (False, True))
    angle, radius, direction = np.meshgrid(
        np.linspace(0, 2 * np.pi, 181), np.linspace(0, 1, 41), np.linspace(0, 2 * np.pi, 121), indexing="ij"
    )
    grid = np.stack(
        [np.cos(angle), np.sin(angle), radius * np.cos(direction), radius * np.sin(direction)], axis=-1
    ).reshape(*angle.shape, 4)
    values = function(grid.reshape(-1, 4)).reshape(angle.shape)
    assert values.max() <= disc < values.max() + 1e-3
    assert values[:, -1].max() <= circle < values[:, -1].max() + 1e-3
    assert circle < disc - 0.5


@pytest.mark.parametrize("full_ball", [False, True])
def test_a_coarse_solution_is_corrected_by_its_residual(full_ball):
    below = 0
    for seed in range(8):
        coefficients, function = random_quartic((3, 2), seed)
        coarse = MultiplierProgram((3, 2), full_ball, solver="SCS", tolerance=1e-3).solve(coefficients)
        fine = MultiplierProgram((3, 2), full_ball, tolerance=1e-9).solve(coefficients)
        highest, _ = maximize(function, (3, 2), seed, full_ball=(False, full_ball))
        below += coarse.bound < highest
        assert highest <= fine.safe_bound <= fine.bound + 1e-6
        assert fine.bound - 1e-6 <= coarse.safe_bound
    # Otherwise there was nothing to correct.
    assert below > 0


@pytest.mark.parametrize("full_ball", [(False, False), (False, True), (True, True)])
def test_the_proven_bound_repairs_anything(full_ball):
    random = generator(3)
    program = MultiplierProgram((2, 2), full_ball)
    balls = sum(full_ball)
    for seed in range(5):
        coefficients, function = random_quartic((2, 2), seed)
        gram, ball_grams = random.standard_normal((15, 15)), random.standard_normal((balls, 5, 5))
        multipliers = random.standard_normal((2 - balls, 15))
        proven = program.proven_bound(coefficients, random.standard_normal(), gram, multipliers, ball_grams)
        assert proven >= maximize(function, (2, 2), seed, full_ball=full_ball)[0]


def test_the_proven_bound_repairs_an_indefinite_matrix_of_the_ball():
    # s - b = -(1 - x'x) for b = -x'x and s = -1, an identity that bounds nothing: b is 0 at the centre.
    program = MultiplierProgram((2,), full_ball=True, degree=1)
    coefficients = -1.0 * (program.exponents.max(axis=1) == 2)
    proven = program.proven_bound(coefficients, -1.0, np.zeros((3, 3)), np.zeros((0, 1)), np.array([[[-1.0]]]))
    assert 0 <= proven < 1e-11


def test_the_proven_bound_keeps_what_is_exact():
    # 1 - x_1^2 = x_2^2 on the circle: the bound 1 of x_1^2 needs no repair but for rounding.
    program = MultiplierProgram((2,), degree=1)
    exponents = [tuple(row) for row in program.exponents]
    coefficients = np.zeros(len(exponents))
    coefficients[exponents.index((2, 0))] = 1.0
    gram = np.diag([0.0, 0.0, 1.0])
    proven = program.proven_bound(coefficients, 1.0, gram, np.array([[-1.0]]), np.zeros((0, 1, 1)))
    assert 1.0 <= proven < 1 + 1e-13


def test_coefficients_come_back_from_values():
    coefficients, function = random_quartic((6, 2), 4)
    recovered, error = polynomial_coefficients(function, 8, 4, 1)
    np.testing.assert_allclose(recovered, coefficients, atol=1e-12)
    assert error < 1e-12
    # A term of higher degree shows in the difference.
    _, error = polynomial_coefficients(lambda x: function(x) + 0.01 * x[:, 0] ** 5, 8, 4, 1)
    assert error > 1e-4


def test_a_failed_solver_leaves_no_bound(monkeypatch):
    design = well_chosen_design(Spheres((3,)), 1)
    sampled, matched = ConicProgram(design.basis), MultiplierProgram((3,))
    coefficients, function = random_quartic((3,), 1)
    # Once with success: the old solution must not come back.
    sampled.solve(function(design.points))
    matched.solve(coefficients)

    def fail(*_, **__):
        raise cvxpy.error.SolverError("numerical trouble")

    monkeypatch.setattr(cvxpy.Problem, "unpack_results", fail)
    for certificate in (sampled.solve(function(design.points)), matched.solve(coefficients)):
        assert certificate.bound == certificate.safe_bound == np.inf
        # The solver's own word, and the iterations that it made.
        assert certificate.status == "CLARABEL failed: Solved"
        assert certificate.iterations > 0


def test_an_unfinished_solution_says_so(monkeypatch):
    monkeypatch.setattr(conic_program, "_MOST_ITERATIONS", 3)
    coefficients, function = random_quartic((3,), 1)
    certificate = MultiplierProgram((3,), solver="SCS", tolerance=1e-12).solve(coefficients)
    assert certificate.status.startswith("SCS says ")
    assert certificate.safe_bound >= maximize(function, (3,), 1)[0]
