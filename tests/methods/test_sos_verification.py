from dataclasses import replace

import numpy as np
import pytest

from marsedl.methods.sos.design import random_design, well_chosen_design
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.sos.verification import verify

DIMENSIONS = (6, 2)
SPHERES = Spheres(DIMENSIONS)


def quartic():
    exponents = SPHERES.monomials(4)
    coefficients = np.random.Generator(np.random.Philox(3)).standard_normal(len(exponents))
    return coefficients, lambda points: SPHERES.evaluate(exponents, points) @ coefficients


@pytest.fixture(scope="module")
def solved():
    design, (_, function) = well_chosen_design(SPHERES, 1), quartic()
    return design, rank_one(function(design.points), design.basis), function


def test_a_solved_program_is_sound(solved):
    design, certificate, function = solved
    checked = verify(design, certificate, function, 9)
    assert checked.sound
    assert checked.identity_error < 1e-9
    assert checked.least_value > 0
    assert checked.least_eigenvalue > 0
    assert 0 < checked.rounding_margin < 1e-12


def test_a_solution_with_multipliers_is_sound_by_the_same_test():
    coefficients, function = quartic()
    program = MultiplierProgram(DIMENSIONS, solver="SCS")
    assert verify(program, program.solve(coefficients), function, 9).sound


def test_a_changed_gram_matrix_shows_in_the_identity(solved):
    design, certificate, function = solved
    gram = certificate.gram.copy()
    gram[3, 7] += 1e-3
    gram[7, 3] += 1e-3
    checked = verify(design, replace(certificate, gram=gram), function, 9)
    assert not checked.sound
    assert checked.identity_error > 1e-4


def test_an_indefinite_gram_matrix_shows_in_its_eigenvalue(solved):
    # In the full monomial basis |y|^2 - 1 has a row of its own: subtracting its square leaves the identity alone.
    coefficients, function = quartic()
    program = MultiplierProgram(DIMENSIONS, solver="SCS")
    certificate = program.solve(coefficients)
    half = SPHERES.monomials(2)
    null = np.where(half.sum(axis=1) == 0, -1.0, np.any(half[:, :6] == 2, axis=1))
    vanishing = program.evaluate(SPHERES.random_points(5, np.random.Generator(np.random.Philox(1)))) @ null
    np.testing.assert_allclose(vanishing, 0, atol=1e-14)
    tampered = replace(certificate, gram=certificate.gram - 100 * np.outer(null, null))
    checked = verify(program, tampered, function, 9)
    assert checked.identity_error < 1e-6
    assert checked.least_eigenvalue < -1
    assert not checked.sound


def test_a_bound_that_is_too_small_shows_in_the_identity_and_the_values(solved):
    design, certificate, function = solved
    checked = verify(design, replace(certificate, bound=certificate.bound - 1e-3), function, 9)
    assert not checked.sound
    assert checked.identity_error == pytest.approx(1e-3, rel=1e-6)
    far = verify(design, replace(certificate, bound=0.5 * certificate.bound), function, 9)
    assert far.least_value < 0
    assert not far.sound


@pytest.mark.parametrize("count", [200, 350, 400])
def test_too_few_samples_show_in_the_identity(count, solved):
    _, right, function = solved
    design = random_design(SPHERES, count, 5, allow_deficient=True)
    certificate = rank_one(function(design.points), design.basis)
    # The program solves without complaint, and its bound is too small.
    assert certificate.status == "optimal"
    assert certificate.bound < right.bound
    checked = verify(design, certificate, function, 9)
    assert not checked.sound
    assert checked.identity_error > 1e-3


def test_values_alone_can_miss_too_few_samples(solved):
    _, right, function = solved
    design = random_design(SPHERES, 400, 5, allow_deficient=True)
    certificate = rank_one(function(design.points), design.basis)
    checked = verify(design, certificate, function, 9)
    assert certificate.bound < right.bound - right.gap
    assert checked.least_value > 0
    assert not checked.sound


def test_no_solution_is_not_sound(solved):
    design, certificate, function = solved
    assert not verify(design, replace(certificate, bound=np.inf), function, 9).sound
    assert not verify(design, replace(certificate, gram=np.nan * certificate.gram), function, 9).sound


def test_bad_input_is_refused(solved):
    design, certificate, function = solved
    with pytest.raises(ValueError, match="at least one point"):
        verify(design, certificate, function, 9, points=0)
    with pytest.raises(ValueError, match="4000 finite values"):
        verify(design, certificate, lambda points: points, 9)
