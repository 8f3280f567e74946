from dataclasses import replace

import numpy as np
import pytest

from marsedl.methods.sos.design import random_design, well_chosen_design
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.sos.verification import verify

DIMENSIONS = (6, 2)
SPHERES = Spheres(DIMENSIONS)


@pytest.fixture(scope="module")
def solved():
    design, exponents = well_chosen_design(SPHERES, 1), SPHERES.monomials(4)
    coefficients = np.random.Generator(np.random.Philox(3)).standard_normal(len(exponents))

    def function(points):
        return SPHERES.evaluate(exponents, points) @ coefficients

    return design, rank_one(function(design.points), design.basis), function


def test_a_solved_program_is_sound(solved):
    design, certificate, function = solved
    checked = verify(design, certificate, function, 9)
    assert checked.sound
    assert checked.identity_error < 1e-9
    assert checked.least_value > 0
    assert checked.least_eigenvalue > 0
    assert 0 < checked.rounding_margin < 1e-12


def test_a_changed_gram_matrix_shows_in_the_identity(solved):
    design, certificate, function = solved
    gram = certificate.gram.copy()
    gram[3, 7] += 1e-3
    gram[7, 3] += 1e-3
    checked = verify(design, replace(certificate, gram=gram), function, 9)
    assert not checked.sound
    assert checked.identity_error > 1e-4


def test_a_bound_that_is_too_small_shows_in_the_identity_and_the_values(solved):
    design, certificate, function = solved
    checked = verify(design, replace(certificate, bound=certificate.bound - 1e-3), function, 9)
    assert not checked.sound
    assert checked.identity_error == pytest.approx(1e-3, rel=1e-6)
    far = verify(design, replace(certificate, bound=0.5 * certificate.bound), function, 9)
    assert far.least_value < 0
    assert not far.sound


def test_too_few_samples_show_in_the_identity_even_where_no_value_is_negative(solved):
    _, right, function = solved
    design = random_design(SPHERES, 400, 5, allow_deficient=True)
    certificate = rank_one(function(design.points), design.basis)
    # The program solves without complaint, and its bound is too small.
    assert certificate.status == "optimal"
    assert certificate.bound < right.bound - right.gap
    checked = verify(design, certificate, function, 9)
    assert checked.least_value > 0
    assert not checked.sound
    assert checked.identity_error > 1e-3


def test_no_solution_is_not_sound(solved):
    design, certificate, function = solved
    assert not verify(design, replace(certificate, bound=np.inf), function, 9).sound
    assert not verify(design, replace(certificate, gram=np.nan * certificate.gram), function, 9).sound


def test_bad_input_is_refused(solved):
    design, certificate, function = solved
    with pytest.raises(ValueError, match="points must be at least 1, not 0"):
        verify(design, certificate, function, 9, points=0)
    with pytest.raises(ValueError, match="4000 finite values"):
        verify(design, certificate, lambda points: points, 9)
