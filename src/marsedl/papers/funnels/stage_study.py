"""One stage of the funnel in every form: counts, programs, samples, bases, exponents and stationary disturbances.

The stage is studied at a level of its own, that of the configuration, with points on the slice and the integrated
motion, whatever the reading's funnel takes.
"""

from dataclasses import replace
from functools import partial
from math import comb

import numpy as np

from marsedl.methods.funnels.ascent import maximize
from marsedl.methods.funnels.linear import linear_exact, slice_jacobians, whitened_step
from marsedl.methods.funnels.stage import lyapunov_rate
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
from marsedl.methods.taylor import Series
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, SLICE, SPHERES, STATES_IN_KILOMETRES, finite
from marsedl.papers.funnels.environment import Air
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import fitted, samples, solver, stage_at
from marsedl.papers.funnels.records import Gains, Linearization, StageStudy
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
MAXIMA, SAMPLES, ROTATION, DISTURBANCES = range(14, 18)
MORE = 2  # times as many ascents as for a stage of the funnel: few of them end in a local maximum
FEW_DESIGNS = 2  # random ones
LEVEL_FACTOR = 7.0  # of shapes and level at once, which changes nothing
ANGLES, RADII = 36, (0.0, 0.25, 0.5, 0.75)  # where disturbances are compared
NEWTON_STEPS, NEWTON_FRACTIONS = 12, 2.0 ** -np.arange(8)
CONVERGED = 1e-9  # of the gradient at no disturbance
DIFFERENCE = 1e-4  # of disturbances


@stage(claimed_in=("corrected",))
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
    stage = stage_at(recursion, loop, gains, studies.benchmark_slice, studies.benchmark_level, spacing)
    return StageStudy(
        **counts(recursion),
        **forms(recursion, stage, design),
        **linear_stages(recursion, studies, loop, gains, design),
        **undersampled(recursion, studies.studied_samples, stage, design),
        **exponents(recursion, stage, design, scale),
        **conditions(recursion, stage, design, scale),
        **invariances(recursion, stage, design),
        **stationary(recursion, studies, air, loop, gains),
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
    found = list(certificates.values())
    check = verify(design, found[0], stage.values, (recursion.design_seed, CHECKS), recursion.check_points)
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
        "form_bound": finite([c.bound for c in found]),
        "form_safe_bound": finite([c.safe_bound for c in found]),
        "form_gap": finite([c.gap for c in found]),
        "form_residual": finite([c.residual for c in found]),
        "form_iterations": np.array([c.iterations for c in found]),
        "form_status": np.array([c.status for c in found]),
        "fit_error": fit_error,
        "polynomial_maximum": polynomial_maximum,
        "disc_maximum": max(polynomial_maximum, search(stage.values, full_ball=(False, True))[0]),
        "true_maximum": search(stage.true_values, full_ball=(False, True))[0],
        "identity_error": check.identity_error,
        "least_value": check.least_value,
        "least_eigenvalue": check.least_eigenvalue,
        "rounding_margin": check.rounding_margin,
    }


def linear_stages(recursion: Recursion, studies: Studies, loop, gains: Gains, design):
    """Stages with linear motion, whose largest value is known otherwise (robust entry funnels, Eq. 22)."""
    small, still = (samples(recursion, spheres, 1) for spheres in (SPHERES, SLICE))
    rows = []
    for number, level in zip(studies.studied_slices.astype(int), studies.studied_levels, strict=True):
        stage = stage_at(recursion, loop, gains, number, level, recursion.steps_per_slice, order=1)
        shapes = np.array([stage.shape, stage.next_shape])
        transitions, responses, _ = slice_jacobians(loop, [stage.first, stage.last])
        alone = np.hstack([still.points, np.zeros((len(still.points), environment.DISTURBANCES))])
        rows.append(
            (
                solved(recursion, stage.values(small.points), small.basis).safe_bound,
                solved(recursion, stage.values(design.points), design.basis).safe_bound,
                linear_exact(transitions, responses, shapes, level)[1] / level,
                solved(recursion, stage.values(alone), still.basis).safe_bound,
                np.linalg.norm(whitened_step(transitions[0], responses[0], *shapes)[0], 2) ** 2,
            )
        )
    small_bound, large_bound, exact, still_bound, still_exact = np.transpose(rows)
    return {
        "linear_slice": studies.studied_slices.astype(int),
        "linear_level": studies.studied_levels,
        "linear_small_bound": small_bound,
        "linear_large_bound": large_bound,
        "linear_exact": exact,
        "linear_still_bound": still_bound,
        "linear_still_exact": still_exact,
        "linear_gram_size": small.basis.shape[1],
        "linear_samples": len(small.points),
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
    others = [
        well_chosen_design(SPHERES, recursion.design_seed, BASIS_DEGREE, basis=basis)
        for basis in ("monomial", "hermite")
    ]
    bounds = {
        "none": solved(recursion, stage.values(design.points), design.basis),
        "rotation of the slice": solved(recursion, stage.values(rotated), design.basis),
        "shapes and level times seven": solved(recursion, larger.values(design.points), design.basis),
        "monomial basis": solved(recursion, stage.values(others[0].points), others[0].basis),
        "Hermite basis": solved(recursion, stage.values(others[1].points), others[1].basis),
    }
    return {
        "invariance": np.array(list(bounds)),
        "invariance_bound": np.array([certificate.bound for certificate in bounds.values()]),
    }


# ---- stationary disturbances -----------------------------------------------------------------------------------------


def stationary(recursion: Recursion, studies: Studies, air: Air, loop, gains: Gains):
    """Disturbances in which the rate of V is stationary (robust entry funnels, Eqs. 31-35), of the polynomial.

    The rates themselves have none: w acts through the density alone, in which they are affine, so that the gradient of
    V' by w is that of the density times a number, and a Hessian of rank one comes with it.
    """
    stage = stage_at(
        recursion,
        loop,
        gains,
        studies.stationary_slice,
        studies.stationary_level,
        recursion.steps_per_slice,
        condition="euler",
    )
    generator = random(recursion, DISTURBANCES)
    points = SPHERES.random_points(int(studies.stationary_points), generator)
    polynomial = in_disturbances(stage, points[:, : SLICE.variables])
    w, gradient, start = newton(polynomial)
    converged = np.linalg.norm(gradient, axis=1) < CONVERGED * np.linalg.norm(start, axis=1)
    norm = np.linalg.norm(w[converged], axis=1)
    angle = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    boundary = np.array([polynomial(direction)[0] for direction in circle])
    interior = np.array([polynomial(radius * direction)[0] for radius in RADII for direction in circle])
    hessian = polynomial(points[:, SLICE.variables :])[2]
    return {
        "stationary_converged": float(converged.mean()),
        "stationary_norm": np.quantile(norm, (0.0, 0.5, 1.0)) if len(norm) else np.full(3, np.nan),
        "stationary_inside": int(np.count_nonzero(norm <= 1.0)),
        "stationary_saddles": float(np.mean(np.linalg.det(hessian) < 0.0)),
        "stationary_value": float(polynomial(w)[0][converged].max()) if len(norm) else np.nan,
        "boundary_value": float(boundary.max()),
        "interior_better": int(np.count_nonzero(interior.max(axis=0) > boundary.max(axis=0))),
        **_own_derivatives(air, loop, stage, points),
    }


def in_disturbances(stage, whitened):
    """Polynomial of a stage at fixed deviations as a function of the disturbance.

    Args:
        stage: `FunnelStage` with the Euler condition, of whose order the polynomial is in w.
        whitened: y, (m, 6).

    Returns:
        Function of w, (2,) or (m, 2), that returns value (m,), gradient (m, 2) and Hessian (m, 2, 2).
    """
    exponents = Spheres((environment.DISTURBANCES,)).monomials(stage.order)
    nodes = 2.0 * exponents / stage.order - 0.5  # a triangular grid determines polynomials of the order
    values = [stage.values(np.hstack([whitened, np.broadcast_to(node, (len(whitened), 2))])) for node in nodes]
    coefficients = np.linalg.solve(_derivative(exponents, (0, 0), nodes), values)

    def polynomial(w):
        w = np.broadcast_to(w, (len(whitened), 2))

        def part(*orders):
            return np.sum(_derivative(exponents, orders, w) * coefficients.T, axis=1)

        mixed = part(1, 1)
        hessian = np.array([[part(2, 0), mixed], [mixed, part(0, 2)]])
        return part(0, 0), np.stack([part(1, 0), part(0, 1)], axis=1), np.moveaxis(hessian, -1, 0)

    return polynomial


def _derivative(exponents, orders, points):
    """Derivatives of monomials: orders by each variable, (m, count)."""
    result = np.ones((len(points), len(exponents)))
    for powers, order, coordinate in zip(exponents.T, orders, points.T, strict=True):
        factor = np.prod([powers - j for j in range(order)], axis=0)
        result *= factor * coordinate[:, np.newaxis] ** np.maximum(powers - order, 0)
    return result


def newton(polynomial):
    """Newton's method for a vanishing gradient from w = 0, damped: of several fractions of the step the best is taken.

    Returns:
        w (m, 2), the gradient there and that at the start.
    """
    _, gradient, hessian = polynomial(np.zeros(2))
    start, w = gradient, np.zeros_like(gradient)
    for _ in range(NEWTON_STEPS):
        step = np.linalg.solve(hessian, -gradient[..., np.newaxis])[..., 0]
        trials = np.array([w, *(w + fraction * step for fraction in NEWTON_FRACTIONS)])
        sizes = np.array([np.linalg.norm(polynomial(trial)[1], axis=1) for trial in trials])
        w = trials[sizes.argmin(axis=0), np.arange(len(w))]
        _, gradient, hessian = polynomial(w)
    return w, gradient, start


def _own_derivatives(air: Air, loop, stage, points):
    """Gradient and Hessian by w of the rates themselves, not expanded, at random points (m, 8)."""
    deviations, w = stage.deviations(points), points[:, SLICE.variables :]
    weights = deviations @ stage.shape

    def along(direction):
        """First and second derivative of V' along a direction of w."""
        ray = [Series.along(w[:, j], np.full(len(w), direction[j]), 2) for j in range(2)]
        rates = loop.error_rates(2 * stage.first, list(deviations.T), ray)
        series = sum(weight * rate for weight, rate in zip(weights.T, rates, strict=True)).coefficients
        return series[1], 2.0 * series[2]

    (first, first_second), (second, second_second), (_, both) = (along(d) for d in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)))
    gradient = np.stack([first, second], axis=1)
    mixed = (both - first_second - second_second) / 2.0
    determinant, trace = first_second * second_second - mixed**2, first_second + second_second

    still = np.zeros_like(stage.shape)
    moved = [
        lyapunov_rate(loop, 2 * stage.first, stage.shape, still, deviations, w + sign * DIFFERENCE * unit)
        for unit in np.eye(2)
        for sign in (1.0, -1.0)
    ]
    differences = np.stack([moved[0] - moved[1], moved[2] - moved[3]], axis=1) / (2.0 * DIFFERENCE)
    altitude = loop.states[2 * stage.first, 0] + deviations[:, 0]
    density = np.stack([np.full(len(w), air.density_amplitude), air.density_slope_amplitude * altitude], axis=1)
    crossed = gradient[:, 0] * density[:, 1] - gradient[:, 1] * density[:, 0]
    size = np.linalg.norm(gradient, axis=1)
    return {
        "gradient_deviation": float(np.abs(differences - gradient).max() / np.abs(gradient).max()),
        "gradient_angle": float(np.abs(crossed / (size * np.linalg.norm(density, axis=1))).max()),
        "gradient_least": float(size.min() / np.median(size)),
        "hessian_rank_one": float(np.abs(determinant / trace**2).max()),
    }
