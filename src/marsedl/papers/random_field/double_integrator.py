"""Covariance steering of the double integrator in a locally periodic random force (Sec. V.A)."""

from functools import partial
from itertools import pairwise

import numpy as np

from marsedl.methods import field_disturbance
from marsedl.methods.covariance_steering import block_program
from marsedl.models import random_field
from marsedl.papers.random_field.inputs import PointMass
from marsedl.papers.random_field.records import DoubleIntegrator
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError


def kernel(point_mass: PointMass):
    """Covariance of the force at two positions (Eq. 59)."""
    return partial(
        random_field.locally_periodic,
        variance=point_mass.double_integrator_variance,
        period=point_mass.double_integrator_period,
        periodic_length=point_mass.double_integrator_periodic_length,
        length=point_mass.double_integrator_length,
    )


def normals_and_bounds(point_mass: PointMass):
    """Both half planes a'x <= alpha (Eq. 61)."""
    normals = np.array([point_mass.double_integrator_first_normal, point_mass.double_integrator_second_normal])
    return normals, np.array(point_mass.double_integrator_bounds)


def tail(point_mass: PointMass):
    """Probability of violation allotted to each half plane."""
    return (1.0 - point_mass.double_integrator_probability) / 2.0


def ellipse_radius(point_mass: PointMass):
    """Radius, in standard deviations, of the plane ellipse that holds the drawn probability."""
    return float(np.sqrt(-2.0 * np.log(1.0 - point_mass.ellipse_probability)))


def system(point_mass: PointMass):
    """The linear system along the coasting nominal; its dynamics are linear, only the force is approximated."""
    partition = np.array(point_mass.double_integrator_partition)
    steps = np.diff(partition)
    position, velocity = point_mass.double_integrator_initial_mean
    effects, weights, places = [], [], []
    for start, end in pairwise(partition):
        nodes, weight = field_disturbance.gauss_legendre(point_mass.double_integrator_quadrature, start, end)
        effects.append(np.column_stack([end - nodes, np.ones_like(nodes)]))
        weights.append(weight)
        places.append(position + velocity * nodes)  # without control the mean moves at its initial velocity
    places = np.concatenate(places)
    covariance = kernel(point_mass)(places[:, np.newaxis], places[np.newaxis, :])
    deviations = np.array(point_mass.double_integrator_initial_three_sigma) / 3.0
    transition = np.tile(np.eye(2), (len(steps), 1, 1))
    transition[:, 0, 1] = steps
    return block_program.BlockSystem(
        transition=transition,
        control=np.stack([steps**2 / 2.0, steps], axis=1)[:, :, np.newaxis],
        affine=np.zeros((len(steps), 2)),
        initial_mean=np.array(point_mass.double_integrator_initial_mean),
        initial_covariance=np.diag(deviations**2),
        disturbance_covariance=field_disturbance.disturbance_covariance(effects, weights, covariance),
    )


def program(point_mass: PointMass, constrained=True):
    """The program of Eq. 56 for this example."""
    model = system(point_mass)
    intervals = len(model.transition)
    normals, bounds = normals_and_bounds(point_mass)
    last = intervals if point_mass.double_integrator_constrained == "all" else intervals - 1
    variance_weight, mean_weight = point_mass.double_integrator_weights
    return block_program.SteeringProgram(
        system=model,
        state_weight=np.zeros((intervals, 2, 2)),
        control_weight=np.full((intervals, 1, 1), variance_weight),
        mean_control_weight=np.full((intervals, 1, 1), mean_weight),
        state_constraints=tuple(
            block_program.HalfPlane(k, normal, bound, tail(point_mass), f"line {line + 1}")
            for k in range(last + 1)
            for line, (normal, bound) in enumerate(zip(normals, bounds, strict=True))
        )
        if constrained
        else (),
        final_mean=np.array(point_mass.double_integrator_final_mean),
        final_covariance=np.diag((np.array(point_mass.double_integrator_final_three_sigma) / 3.0) ** 2),
    )


@stage(claimed_in=("printed", "corrected", "cc_to_4"))
def compute(point_mass: PointMass) -> DoubleIntegrator:
    """Solve the single iteration.

    Raises MarsedlError if the constraints cannot be met, saying which and how far.
    """
    posed = program(point_mass)
    try:
        solution = block_program.solve(posed)
        free = block_program.solve(program(point_mass, constrained=False))
    except (ValueError, RuntimeError) as error:
        raise MarsedlError(f"double integrator: {error}") from None
    model = posed.system
    nodes = np.array(point_mass.double_integrator_partition)
    intervals = len(nodes) - 1
    silent = np.zeros((intervals, intervals + 1, 1, 2))
    open_covariance, _ = block_program.closed_loop(model, silent)
    position, velocity = point_mass.double_integrator_initial_mean
    coasting = np.column_stack([position + velocity * nodes, np.full(len(nodes), velocity)])
    mean = np.array([coasting, solution.mean])
    covariance = np.array([open_covariance, solution.covariance])
    normals, bounds = normals_and_bounds(point_mass)
    spread = np.sqrt(np.einsum("ci,lkij,cj->lkc", normals, covariance, normals))
    return DoubleIntegrator(
        partition=nodes,
        transition=model.transition,
        input=model.control[:, :, 0],
        disturbance_covariance=model.disturbance_covariance.reshape(intervals, 2, intervals, 2),
        control=np.array([np.zeros(intervals), solution.control[:, 0]]),
        gain=np.array([silent[:, :, 0], solution.gain[:, :, 0]]),
        mean=mean,
        covariance=covariance,
        control_deviation=np.array([np.zeros(intervals), np.sqrt(solution.control_covariance[:, 0, 0])]),
        objective=solution.objective,
        unconstrained_objective=free.objective,
        support=mean @ normals.T + ellipse_radius(point_mass) * spread - bounds,
        status=solution.status,
        solver_iterations=solution.iterations,
    )
