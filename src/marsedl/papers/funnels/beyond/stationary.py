"""Disturbances in which the rate of V is stationary (robust entry funnels, Eqs. 31 to 35 and App. B)."""

import numpy as np

from marsedl.methods.funnels.stage import lyapunov_rate
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.taylor import Series
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import SLICE, SPHERES, random_points
from marsedl.papers.funnels.beyond.programs import stage_at
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Gains, Linearization, Stationary
from marsedl.replication.pipeline.catalogue import stage

DISTURBANCES = 17  # stream of random numbers, keyed by that of the design
ANGLES, RADII = 36, (0.0, 0.25, 0.5, 0.75)  # where disturbances are compared
NEWTON_STEPS, NEWTON_FRACTIONS = 12, 2.0 ** -np.arange(8)
CONVERGED = 1e-9  # of the gradient at no disturbance
DIFFERENCE = 1e-4  # of disturbances


@stage()
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> Stationary:
    """Seek them in the polynomial of the stage of the configuration, whatever the reading's funnel takes.

    The rates themselves have none: w acts through the density alone, in which they are affine, so that the gradient of
    V' by w is that of the density times a number, and a Hessian of rank one comes with it.
    """
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    spacing = given.recursion.steps_per_slice
    number = environment.slice_at(loop, spacing, given.studies.stationary_slice)
    euler_stage = stage_at(
        given.recursion, loop, gains, number, given.studies.stationary_level, spacing, condition="euler"
    )
    points = random_points(SPHERES, given.recursion.design_seed, DISTURBANCES, int(given.studies.stationary_points))
    polynomial = in_disturbances(euler_stage, points[:, : SLICE.variables])
    w, gradient, start = newton(polynomial)
    converged = np.linalg.norm(gradient, axis=1) < CONVERGED * np.linalg.norm(start, axis=1)
    norm = np.linalg.norm(w[converged], axis=1)
    angle = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    boundary = np.array([polynomial(direction)[0] for direction in circle])
    interior = np.array([polynomial(radius * direction)[0] for radius in RADII for direction in circle])
    return Stationary(
        stationary_converged=float(converged.mean()),
        stationary_norm=np.quantile(norm, (0.0, 0.5, 1.0)) if len(norm) else np.full(3, np.nan),
        stationary_inside=int(np.count_nonzero(norm <= 1.0)),
        stationary_value=float(polynomial(w)[0][converged].max()) if len(norm) else np.nan,
        boundary_value=float(boundary.max()),
        interior_better=int(np.count_nonzero(interior.max(axis=0) > boundary.max(axis=0))),
        gradient_deviation=gradient_deviation(loop, euler_stage, points),
    )


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
        # A Hessian that vanishes, as that of an affine function, gives no step.
        regular, step = np.linalg.det(hessian) != 0.0, np.zeros_like(w)
        step[regular] = np.linalg.solve(hessian[regular], -gradient[regular, :, np.newaxis])[..., 0]
        trials = np.array([w, *(w + fraction * step for fraction in NEWTON_FRACTIONS)])
        sizes = np.array([np.linalg.norm(polynomial(trial)[1], axis=1) for trial in trials])
        w = trials[sizes.argmin(axis=0), np.arange(len(w))]
        _, gradient, hessian = polynomial(w)
    return w, gradient, start


def gradient_deviation(loop, stage, points):
    """Largest relative deviation of the gradient by w of Eq. 35 from differences of V', at random points (m, 8)."""
    deviations, w = stage.deviations(points), points[:, SLICE.variables :]
    weights, still = deviations @ stage.shape, np.zeros_like(stage.shape)
    gradient, differences = [], []
    for unit in np.eye(environment.DISTURBANCES):
        ray = [Series.along(w[:, j], np.full(len(w), unit[j]), 1) for j in range(environment.DISTURBANCES)]
        rates = loop.error_rates(2 * stage.first, list(deviations.T), ray)
        gradient.append(sum(weight * rate for weight, rate in zip(weights.T, rates, strict=True)).coefficients[1])
        ahead, behind = (
            lyapunov_rate(loop, 2 * stage.first, stage.shape, still, deviations, w + sign * DIFFERENCE * unit)
            for sign in (1.0, -1.0)
        )
        differences.append((ahead - behind) / (2.0 * DIFFERENCE))
    return float(np.abs(np.subtract(differences, gradient)).max() / np.abs(gradient).max())
