"""One stage of the funnel in every form: counts, programs, too few samples and bases.

The stage is studied at a level of its own, that of the configuration, with points on the slice and the integrated
motion, whatever the reading's funnel takes.
"""

from math import comb

import numpy as np

from marsedl.methods.sos.conic_program import ConicProgram
from marsedl.methods.sos.design import condition_number, hermite_values, random_design, rank_of_products
from marsedl.methods.sos.multiplier_program import MultiplierProgram
from marsedl.methods.sos.variety import Spheres
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, SLICE, SPHERES, STATES_IN_KILOMETRES, random_points
from marsedl.papers.funnels.beyond.programs import fitted, samples, solver, stage_at
from marsedl.papers.funnels.inputs import Inputs, Recursion
from marsedl.papers.funnels.records import Gains, Linearization, StageStudy
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.records.fields import finite

# Slice, slice with disturbances of the density, the Dubins car without and with wind, a circle; last, additive
# disturbances of all states beside those of the density, which are counted only.
VARIETIES = ((6,), (6, 2), (3,), (3, 2), (2,), (6, 8))
LARGEST_RANK = 1000  # samples up to which ranks are computed
FURTHER_POINTS = 20  # beyond those needed, which must not raise a rank
CONIC_TOLERANCE = {"CLARABEL": 1e-8, "SCS": 1e-6}  # of the sampled program, on which SCS stalls when asked for more
# Streams of random numbers, all keyed by that of the design.
CHECKS, RANKS, SAMPLES = 11, 12, 15


@stage(claimed_in=("printed", "corrected"))
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> StageStudy:
    """Study the stage of the configuration."""
    recursion = given.recursion
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    design = samples(recursion)
    spacing = recursion.steps_per_slice
    number = environment.slice_at(loop, spacing, given.studies.benchmark_slice)
    stage = stage_at(recursion, loop, gains, number, given.studies.benchmark_level, spacing)
    return StageStudy(
        **counts(recursion),
        **forms(recursion, stage, design),
        **undersampled(recursion, given.studies.studied_samples, stage),
        **conditions(stage, design, environment.state_scale(given.planet, given.guidance)),
    )


def solved(recursion: Recursion, values, basis):
    """Certificate as the funnel takes it."""
    return solver(recursion)(values, basis)


# ---- counts ----------------------------------------------------------------------------------------------------------


def counts(recursion: Recursion):
    """Dimensions by formula, and ranks by numbers (robust entry funnels, Eqs. 2 and 24)."""
    varieties = [Spheres(dimensions) for dimensions in VARIETIES]
    ranks = [_ranks(recursion, spheres) for spheres in varieties]
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
    }


def _ranks(recursion: Recursion, spheres):
    """Ranks of all monomials and of the products of the basis at random points, more than are needed."""
    needed = spheres.sample_count(BASIS_DEGREE)
    if needed > LARGEST_RANK:
        return 0, 0
    points = random_points(spheres, recursion.design_seed, RANKS, needed + FURTHER_POINTS)
    everything = spheres.evaluate(spheres.monomials(BASIS_DEGREE), points)
    quotient = spheres.evaluate(spheres.quotient_monomials(BASIS_DEGREE), points)
    return int(np.linalg.matrix_rank(everything)), rank_of_products(quotient)


# ---- forms of the program --------------------------------------------------------------------------------------------


def forms(recursion: Recursion, stage, design):
    """The bound by samples and by multipliers, on the boundary of the disturbances and in their whole disc."""
    values = stage.values(design.points)
    coefficients = fitted(recursion, stage)
    certificates = {"samples, rank one": solved(recursion, values, design.basis)}
    for name, tolerance in CONIC_TOLERANCE.items():
        certificates[f"samples, {name}"] = ConicProgram(design.basis, name, tolerance).solve(values)
    for form, full in (("multipliers", False), ("multipliers for the disc", True)):
        for name in CONIC_TOLERANCE:
            program = MultiplierProgram(SPHERES.dimensions, full, solver=name)
            certificates[f"{form}, {name}"] = program.solve(coefficients)
    solutions = list(certificates.values())
    return {
        "form": np.array([name.replace("CLARABEL", "Clarabel") for name in certificates]),
        "form_bound": finite([c.bound for c in solutions]),
        "form_safe_bound": finite([c.safe_bound for c in solutions]),
        "form_gap": finite([c.gap for c in solutions]),
        "form_residual": finite([c.residual for c in solutions]),
        "form_iterations": np.array([c.iterations for c in solutions]),
        "form_status": np.array([c.status for c in solutions]),
    }


# ---- samples and bases -----------------------------------------------------------------------------------------------


def undersampled(recursion: Recursion, numbers, stage):
    """Bounds from fewer samples than needed, which solve as well and are too small."""
    fresh = random_points(SPHERES, recursion.design_seed, CHECKS, recursion.check_points)
    fresh_values, rows = stage.values(fresh), []
    for count in numbers.astype(int):
        few = random_design(SPHERES, count, (recursion.design_seed, SAMPLES), BASIS_DEGREE, allow_deficient=True)
        bound = solved(recursion, stage.values(few.points), few.basis).bound
        rows.append((few.rank, bound, (bound - fresh_values).min()))
    rank, bound, least = np.transpose(rows)
    return {
        "few_samples": numbers.astype(int),
        "few_rank": rank.astype(int),
        "few_bound": bound,
        "few_least_value": least,
    }


def conditions(stage, design, scale):
    """Condition numbers of bases in several coordinates."""
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
    return {
        "basis": np.array(list(bases)),
        "basis_condition": np.array([condition_number(values, rank) for values in bases.values()]),
    }
