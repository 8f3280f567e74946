"""One stage of the funnel in every form: counts, programs, samples, bases and exponents.

The stage is studied at a level of its own, that of the configuration, with points on the slice and the integrated
motion, whatever the reading's funnel takes.
"""

from dataclasses import replace
from functools import partial
from math import comb

import numpy as np

from marsedl.methods.funnels.ascent import maximize
from marsedl.methods.sos.conic_program import conic
from marsedl.methods.sos.design import (
    condition_number,
    hermite_values,
    random_design,
    rank_of_products,
    well_chosen_design,
)
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.sos.verification import verify
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, SLICE, SPHERES, STATES_IN_KILOMETRES
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import fitted, samples, solver, stage_at
from marsedl.papers.funnels.records import Gains, Linearization, StageStudy
from marsedl.replication.artifacts import finite
from marsedl.replication.catalogue import stage

# Slice, slice with disturbances of the density, the Dubins car without and with wind, a circle; last, additive
# disturbances of all states beside those of the density, which are counted only.
VARIETIES = ((6,), (6, 2), (3,), (3, 2), (2,), (6, 8))
LARGEST_RANK = 1000  # samples up to which ranks are computed
FURTHER_POINTS = 20  # beyond those needed, which must not raise a rank
EXPONENTS = (0, 1, 2)
CONIC_TOLERANCE = {"CLARABEL": 1e-8, "SCS": 1e-6}  # of the sampled program, on which SCS stalls when asked for more
# Streams of random numbers, all keyed by that of the design.
CHECKS, RANKS = 11, 12
MAXIMA, SAMPLES, ROTATION = range(14, 17)
MORE = 2  # times as many ascents as for a stage of the funnel: few of them end in a local maximum
FEW_DESIGNS = 2  # random ones
LEVEL_FACTOR = 7.0  # of shapes and level at once, which changes nothing


@stage(claimed_in=("printed", "corrected", "euler", "inflated", "additive"))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
    gains: Gains,
) -> StageStudy:
    """Study the stage of the configuration."""
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    design, scale = samples(recursion), environment.state_scale(planet, guidance)
    spacing = recursion.steps_per_slice
    number = environment.slice_at(loop, spacing, studies.benchmark_slice)
    stage = stage_at(recursion, loop, gains, number, studies.benchmark_level, spacing)
    return StageStudy(
        **counts(recursion),
        **forms(recursion, stage, design),
        **undersampled(recursion, studies.studied_samples, stage, design),
        **exponents(recursion, stage, design, scale),
        **conditions(recursion, stage, design, scale),
        **invariances(recursion, stage, design),
    )


def random(recursion: Recursion, stream):
    """Generator of one of the streams of this study."""
    return np.random.Generator(np.random.Philox((recursion.design_seed, stream)))


def solved(recursion: Recursion, values, basis):
    """Certificate as the funnel takes it."""
    return solver(recursion)(values, basis)


# ---- counts ----------------------------------------------------------------------------------------------------------


def counts(recursion: Recursion):
    """Dimensions by formula, and ranks by numbers (robust entry funnels, Eqs. 2 and 24)."""
    varieties = [Spheres(dimensions) for dimensions in VARIETIES]
    generator = random(recursion, RANKS)
    ranks = [_ranks(spheres, generator) for spheres in varieties]
    basis = np.array([spheres.basis_dimension(BASIS_DEGREE) for spheres in varieties])
    return {
        "variety": np.array([" x ".join(f"S^{n - 1}" for n in spheres.dimensions) for spheres in varieties]),
        "variables": np.array([spheres.variables for spheres in varieties]),
        "monomials": np.array([comb(spheres.variables + BASIS_DEGREE, BASIS_DEGREE) for spheres in varieties]),
        "basis_size": basis,
        "coefficients": np.array([comb(s.variables + 2 * BASIS_DEGREE, 2 * BASIS_DEGREE) for s in varieties]),
        "gram_unknowns": basis * (basis + 1) // 2,
        "samples": np.array([spheres.sample_count(BASIS_DEGREE) for spheres in varieties]),
        "basis_rank": np.array([of_basis for of_basis, _ in ranks]),
        "product_rank": np.array([of_products for _, of_products in ranks]),
        "exponent": np.array(EXPONENTS),
        "exponent_degree": 2 * np.array(EXPONENTS) + int(recursion.taylor_order) + 1,
        "gram_degree": 2 * BASIS_DEGREE,
    }


def _ranks(spheres, generator):
    """Ranks of all monomials and of the products of the basis at random points, more than are needed."""
    needed = spheres.sample_count(BASIS_DEGREE)
    if needed > LARGEST_RANK:
        return 0, 0
    points = spheres.random_points(needed + FURTHER_POINTS, generator)
    everything = spheres.evaluate(spheres.monomials(BASIS_DEGREE), points)
    quotient = spheres.evaluate(spheres.quotient_monomials(BASIS_DEGREE), points)
    return int(np.linalg.matrix_rank(everything)), rank_of_products(quotient)


# ---- forms of the program --------------------------------------------------------------------------------------------


def forms(recursion: Recursion, stage, design):
    """The bound by samples and by multipliers, on the boundary of the disturbances and in their whole disc."""
    values = stage.values(design.points)
    coefficients, fit_error = fitted(recursion, stage)
    certificates = {"samples, rank one": solved(recursion, values, design.basis)}
    for name, tolerance in CONIC_TOLERANCE.items():
        certificates[f"samples, {name}"] = conic(values, design.basis, name, tolerance)
    for form, full in (("multipliers", False), ("multipliers for the disc", True)):
        for name in CONIC_TOLERANCE:
            program = MultiplierProgram(SPHERES.dimensions, full, solver=name)
            certificates[f"{form}, {name}"] = program.solve(coefficients)
    solutions = list(certificates.values())
    check = verify(design, solutions[0], stage.values, (recursion.design_seed, CHECKS), recursion.check_points)
    search = partial(
        maximize,
        dimensions=SPHERES.dimensions,
        seed=(recursion.design_seed, MAXIMA),
        starts=recursion.tightness_starts,
        polished=min(MORE * recursion.tightness_polished, recursion.tightness_starts),
        iterations=recursion.tightness_iterations,
    )
    polynomial_maximum = search(stage.values)[0]
    return {
        "form": np.array([name.replace("CLARABEL", "Clarabel") for name in certificates]),
        "form_bound": finite([c.bound for c in solutions]),
        "form_safe_bound": finite([c.safe_bound for c in solutions]),
        "form_gap": finite([c.gap for c in solutions]),
        "form_residual": finite([c.residual for c in solutions]),
        "form_iterations": np.array([c.iterations for c in solutions]),
        "form_status": np.array([c.status for c in solutions]),
        "fit_error": fit_error,
        "polynomial_maximum": polynomial_maximum,
        "disc_maximum": max(polynomial_maximum, search(stage.values, full_ball=(False, True))[0]),
        "true_maximum": search(stage.true_values, full_ball=(False, True))[0],
        "identity_error": check.identity_error,
        "least_value": check.least_value,
        "least_eigenvalue": check.least_eigenvalue,
        "rounding_margin": check.rounding_margin,
    }


# ---- samples, exponents and bases ------------------------------------------------------------------------------------


def undersampled(recursion: Recursion, numbers, stage, design):
    """Bounds from fewer samples than needed, which solve as well and are too small."""
    fresh = SPHERES.random_points(recursion.check_points, random(recursion, CHECKS))
    fresh_values, rows = stage.values(fresh), []
    for count in numbers.astype(int):
        few = random_design(SPHERES, count, (recursion.design_seed, SAMPLES), BASIS_DEGREE, allow_deficient=True)
        certificate, basis = solved(recursion, stage.values(few.points), few.basis), few.evaluate(fresh)
        excess = certificate.bound - fresh_values
        error = np.abs(excess - np.einsum("mi,mi->m", basis @ certificate.gram, basis)).max()
        rows.append((few.rank, certificate.bound, excess.min(), error))
    rank, bound, least, error = np.transpose(rows)
    return {
        "few_samples": numbers.astype(int),
        "few_rank": rank.astype(int),
        "few_bound": bound,
        "few_least_value": least,
        "few_identity_error": error,
    }


def random_designs(recursion: Recursion):
    """As many random samples as are needed, several times."""
    return [
        random_design(
            SPHERES, SPHERES.sample_count(BASIS_DEGREE), (recursion.design_seed, SAMPLES, number), BASIS_DEGREE
        )
        for number in range(FEW_DESIGNS)
    ]


def exponents(recursion: Recursion, stage, design, scale):
    """Bounds with the factor (x'x)^d (robust entry funnels, Eq. 24), whitened and not.

    c (s - b) = n'Q n with c = (x'x)^d at a sample is s - b = m'Q m with m = n / sqrt(c). Without whitening the left
    side has degree 2 d + 4 on the slice and the samples do not determine it: the bound depends on them.
    """

    def certificate(samples, factor, exponent):
        return solved(recursion, stage.values(samples.points), samples.basis / factor[:, np.newaxis] ** (exponent / 2))

    def length(samples):
        return np.sum((stage.deviations(samples.points) / scale) ** 2, axis=1)

    designs = [design, *random_designs(recursion)]
    unit = np.sum(design.points[:, : SLICE.variables] ** 2, axis=1)
    raw = [[certificate(samples, length(samples), d) for samples in designs] for d in EXPONENTS]
    return {
        "exponent_whitened_bound": np.array([certificate(design, unit, d).bound for d in EXPONENTS]),
        "exponent_bound": np.array([[c.bound for c in row] for row in raw]),
        "exponent_status": np.array([[c.status for c in row] for row in raw]),
    }


def conditions(recursion: Recursion, stage, design, scale):
    """Condition numbers of bases in several coordinates, and of samples."""
    exponents, rank = SPHERES.monomials(BASIS_DEGREE), SPHERES.basis_dimension(BASIS_DEGREE)
    points, states = design.points, SLICE.variables

    def monomials(unit):
        coordinates = np.hstack([stage.deviations(points) / unit, points[:, states:]])
        return SPHERES.evaluate(exponents, coordinates)

    spread = np.sqrt(np.repeat(SPHERES.dimensions, SPHERES.dimensions))
    bases = {
        "monomials, m, m/s and rad": monomials(np.ones(states)),
        "monomials, km, km/s and rad": monomials(STATES_IN_KILOMETRES),
        "monomials, scales of the regulator": monomials(scale),
        "monomials, whitened": SPHERES.evaluate(exponents, points),
        "Hermite, whitened": hermite_values(exponents, points),
        "Hermite, whitened with variance one": hermite_values(exponents, points, spread),
        "orthonormal": design.basis,
    }
    highest = SPHERES.quotient_monomials(2 * BASIS_DEGREE)
    designs = [design, *random_designs(recursion)]
    return {
        "basis": np.array(list(bases)),
        "basis_condition": np.array([condition_number(values, rank) for values in bases.values()]),
        "design": np.array(["well chosen", *(f"random {number + 1}" for number in range(FEW_DESIGNS))]),
        "design_condition": np.array([condition_number(SPHERES.evaluate(highest, d.points)) for d in designs]),
        "design_bound": np.array([solved(recursion, stage.values(d.points), d.basis).bound for d in designs]),
    }


def invariances(recursion: Recursion, stage, design):
    """The bound after changes that must not change it."""
    turn = np.linalg.qr(random(recursion, ROTATION).standard_normal((SPHERES.variables, SPHERES.variables)))[0]
    turned = SLICE.variables
    rotation = np.linalg.qr(turn[:turned, :turned])[0]
    rotated = np.hstack([design.points[:, :turned] @ rotation, design.points[:, turned:]])
    larger = replace(
        stage,
        shape=LEVEL_FACTOR * stage.shape,
        next_shape=LEVEL_FACTOR * stage.next_shape,
        rho=LEVEL_FACTOR * stage.rho,
    )
    designs = [
        well_chosen_design(SPHERES, recursion.design_seed, BASIS_DEGREE, basis=basis)
        for basis in ("monomial", "hermite")
    ]
    bounds = {
        "none": solved(recursion, stage.values(design.points), design.basis),
        "rotation of the slice": solved(recursion, stage.values(rotated), design.basis),
        "shapes and level times seven": solved(recursion, larger.values(design.points), design.basis),
        "monomial basis": solved(recursion, stage.values(designs[0].points), designs[0].basis),
        "Hermite basis": solved(recursion, stage.values(designs[1].points), designs[1].basis),
    }
    return {
        "invariance": np.array(list(bounds)),
        "invariance_bound": np.array([certificate.bound for certificate in bounds.values()]),
    }
