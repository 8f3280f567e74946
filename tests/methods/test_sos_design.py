from itertools import product

import numpy as np
import pytest

from generators import generator
from marsedl.methods.sos.design import (
    condition_number,
    hermite_values,
    random_design,
    rank_of_products,
    well_chosen_design,
)
from marsedl.methods.sos.variety import Spheres

VARIETIES = [
    ((6, 2), 43, 406),
    ((6,), 27, 182),
    ((3,), 9, 25),
    ((2,), 5, 9),
    ((3, 2), None, None),
    ((2, 2, 1), None, None),
]


@pytest.fixture(scope="module")
def entry_design():
    return well_chosen_design(Spheres((6, 2)), seed=1)


@pytest.mark.parametrize(("dimensions", "basis", "samples"), VARIETIES)
def test_counts_are_the_ranks_of_the_full_monomials(dimensions, basis, samples):
    spheres = Spheres(dimensions)
    points = spheres.random_points(spheres.sample_count(2) + 20, generator(0))
    values = spheres.evaluate(spheres.monomials(2), points)
    assert np.linalg.matrix_rank(values) == spheres.basis_dimension(2) == len(spheres.quotient_monomials(2))
    assert rank_of_products(values) == spheres.sample_count(2) == len(spheres.quotient_monomials(4))
    if basis:
        assert (spheres.basis_dimension(2), spheres.sample_count(2)) == (basis, samples)


def test_quotient_monomials_are_independent_and_span_the_others_on_the_spheres():
    spheres = Spheres((3, 2))
    points = spheres.random_points(400, generator(0))
    reduced, full = (
        spheres.evaluate(exponents, points) for exponents in (spheres.quotient_monomials(3), spheres.monomials(3))
    )
    coefficients, _, rank, _ = np.linalg.lstsq(reduced, full)
    assert rank == reduced.shape[1]
    np.testing.assert_allclose(reduced @ coefficients, full, atol=1e-13)
    off = 1.5 * points
    mismatch = spheres.evaluate(spheres.quotient_monomials(3), off) @ coefficients - spheres.evaluate(
        spheres.monomials(3), off
    )
    assert np.abs(mismatch).max() > 0.1  # the relations hold on the spheres only


def test_random_points_are_uniform_on_every_sphere():
    spheres, count = Spheres((6, 2)), 40_000
    points = spheres.random_points(count, generator(0))
    for block, n in zip(spheres.blocks, spheres.dimensions, strict=True):
        np.testing.assert_allclose(np.linalg.norm(points[:, block], axis=1), 1, rtol=1e-14)
        fourth = points[:, block] ** 4
        error = fourth.std(axis=0) / np.sqrt(count)
        np.testing.assert_array_less(np.abs(fourth.mean(axis=0) - 3 / (n * (n + 2))), 4 * error)
    covariance = points.T @ points / count
    np.testing.assert_allclose(covariance, np.diag(np.repeat([1 / 6, 1 / 2], [6, 2])), atol=4 / np.sqrt(count))


@pytest.mark.parametrize("dimensions", [(6,), (3, 2), (2, 2, 1)])
def test_well_chosen_samples_are_as_few_as_can_be(dimensions):
    design = well_chosen_design(Spheres(dimensions), seed=3)
    assert len(design.points) == design.rank == design.needed
    np.testing.assert_allclose(design.spheres.project(design.points), design.points, atol=1e-15)
    fewer = np.delete(design.basis, 0, axis=0)
    assert rank_of_products(fewer) == design.needed - 1


def test_well_chosen_samples_interpolate_better_than_random_ones(entry_design):
    spheres = entry_design.spheres
    exponents = spheres.quotient_monomials(4)
    chosen = condition_number(spheres.evaluate(exponents, entry_design.points))
    assert chosen < condition_number(spheres.evaluate(exponents, random_design(spheres, 406, 0).points)) / 4


def test_orthonormal_basis_is_orthonormal_at_the_samples_and_the_same_functions_elsewhere(entry_design):
    count = len(entry_design.points)
    np.testing.assert_allclose(entry_design.basis.T @ entry_design.basis / count, np.eye(43), atol=1e-13)
    np.testing.assert_allclose(entry_design.evaluate(entry_design.points), entry_design.basis, atol=1e-12)
    spheres = Spheres((3, 2))
    fresh = spheres.random_points(300, generator(0))
    reference = spheres.evaluate(spheres.quotient_monomials(2), fresh)
    values = well_chosen_design(spheres, 1).evaluate(fresh)
    coefficients, _, rank, _ = np.linalg.lstsq(reference, values)
    assert rank == 19
    np.testing.assert_allclose(reference @ coefficients, values, atol=1e-11)


def test_hermite_products_are_orthonormal_for_normal_variables():
    nodes, weights = np.polynomial.hermite_e.hermegauss(6)
    points = np.array(list(product(nodes, repeat=2)))
    weight = np.array([a * b for a, b in product(weights, repeat=2)]) / (2 * np.pi)
    values = hermite_values(Spheres((2,)).monomials(5), points / 2.0, scale=2.0)
    np.testing.assert_allclose(values.T @ (weight[:, None] * values), np.eye(values.shape[1]), atol=1e-12)


def test_conditioning_of_the_bases():
    spheres = Spheres((6, 2))
    points, exponents = random_design(spheres, 406, 5).points, spheres.monomials(2)
    monomial = spheres.evaluate(exponents, points)
    hermite = hermite_values(exponents, points)
    scaled = hermite_values(exponents, points, np.repeat(np.sqrt([6, 2]), [6, 2]))
    for values in (monomial, hermite, scaled):
        singular = np.linalg.svd(values, compute_uv=False)
        assert singular[43] < 1e-13 * singular[0] < 1e-3 * singular[42]  # 45 polynomials, two of them dependent
    monomial, hermite, scaled = (condition_number(values, 43) for values in (monomial, hermite, scaled))
    assert hermite > monomial > 4 * scaled  # Hermite polynomials want coordinates of variance one
    assert 1.5 < scaled < 3
    speeds = points * np.array([5e3, 1, 1, 50, 0.02, 0.02, 1, 1])
    assert condition_number(spheres.evaluate(exponents, speeds), 43) > 1e8 * monomial


def test_rank_of_products_is_the_rank_of_the_squared_inner_products():
    spheres = Spheres((3, 2))
    design = random_design(spheres, 60, 4, allow_deficient=True)
    assert design.rank == np.linalg.matrix_rank((design.basis @ design.basis.T) ** 2) == 60
    lengths = 10.0 ** generator(0).uniform(-6, 6, 60)
    assert rank_of_products(lengths[:, None] * design.basis) == 60
    repeated = np.vstack([design.basis, design.basis[:7]])
    assert rank_of_products(repeated) == 60


def test_samples_that_do_not_suffice_are_refused():
    spheres = Spheres((6, 2))
    with pytest.raises(ValueError, match="determine 405 of 406 products"):
        random_design(spheres, 405, 1)
    assert random_design(spheres, 100, 1, allow_deficient=True).rank == 100
    with pytest.raises(ValueError, match="determine 42 of 43 basis polynomials"):
        random_design(spheres, 42, 1, allow_deficient=True)
    for dimensions in [(), (0,), (2.5,), 6]:
        with pytest.raises(ValueError, match="positive whole numbers"):
            Spheres(dimensions)
