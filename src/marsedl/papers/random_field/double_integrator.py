"""Covariance steering of the double integrator in a locally periodic random force (Sec. V.A)."""

from functools import partial
from itertools import pairwise

import numpy as np

from marsedl.methods import field_disturbance
from marsedl.methods.covariance_steering import block_program
from marsedl.models import random_field
from marsedl.papers.random_field.inputs import PointMass
from marsedl.papers.random_field.records import DoubleIntegrator
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage


def kernel(point_mass: PointMass):
    """Covariance of the force at two positions (Eq. 59)."""
    if point_mass.double_integrator_kernel == "squared_exponential":
        return partial(
            random_field.squared_exponential,
            variance=point_mass.double_integrator_variance,
            length=point_mass.double_integrator_length,
        )
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


def covariance_root(three_sigma, correlation):
    """A root of the covariance of position and velocity, (2, 2)."""
    first, second = np.array(three_sigma) / 3.0
    return np.array([[first, 0.0], [second * correlation, second * np.sqrt(1.0 - correlation**2)]])


def covariance_of(three_sigma, correlation):
    """Covariance of position and velocity, (2, 2)."""
    deviations = np.array(three_sigma) / 3.0
    return np.outer(deviations, deviations) * np.array([[1.0, correlation], [correlation, 1.0]])


def nominal_states(point_mass: PointMass, control, time):
    """Position and velocity of the nominal, in the mean force, under a control that is held over the intervals."""
    position, velocity = point_mass.double_integrator_initial_mean
    nodes = np.array(point_mass.double_integrator_partition)
    held_time = np.clip(np.asarray(time)[:, np.newaxis] - nodes[:-1], 0.0, np.diff(nodes))
    coast_time = np.asarray(time)[:, np.newaxis] - np.minimum(nodes[:-1] + held_time, np.asarray(time)[:, np.newaxis])
    acceleration = np.asarray(control) + point_mass.double_integrator_force_mean
    moved = (held_time * (0.5 * held_time + coast_time)) @ acceleration
    return position + velocity * np.asarray(time) + moved, velocity + held_time @ acceleration


def guess(point_mass: PointMass):
    """Mean control of the first nominal trajectory, (N,)."""
    return np.full(len(point_mass.double_integrator_partition) - 1, point_mass.double_integrator_initial_control)


def system(point_mass: PointMass, control=None):
    """The linear system along the nominal of a control, (N,), the guess unless given.

    Its dynamics are linear, only the force is approximated.
    """
    partition = np.array(point_mass.double_integrator_partition)
    steps = np.diff(partition)
    control = guess(point_mass) if control is None else control
    effects, weights, places = [], [], []
    for start, end in pairwise(partition):
        nodes, weight = field_disturbance.gauss_legendre(point_mass.double_integrator_quadrature, start, end)
        effects.append(np.column_stack([end - nodes, np.ones_like(nodes)]))
        weights.append(weight)
        places.append(nominal_states(point_mass, control, nodes)[0])
    means = [np.full(len(nodes), point_mass.double_integrator_force_mean) for nodes in places]
    places = np.concatenate(places)
    covariance = kernel(point_mass)(places[:, np.newaxis], places[np.newaxis, :])
    transition = np.tile(np.eye(2), (len(steps), 1, 1))
    transition[:, 0, 1] = steps
    return block_program.BlockSystem(
        transition=transition,
        control=np.stack([steps**2 / 2.0, steps], axis=1)[:, :, np.newaxis],
        affine=field_disturbance.disturbance_mean(effects, weights, means),
        initial_mean=np.array(point_mass.double_integrator_initial_mean),
        initial_covariance=covariance_of(
            point_mass.double_integrator_initial_three_sigma, point_mass.double_integrator_initial_correlation
        ),
        disturbance_covariance=field_disturbance.disturbance_covariance(effects, weights, covariance),
    )


def program(point_mass: PointMass, constrained=True, control=None):
    """The program of Eq. 56 for this example, along the nominal of a control, the guess unless given."""
    model = system(point_mass, control)
    intervals = len(model.transition)
    normals, bounds = normals_and_bounds(point_mass)
    last = intervals if point_mass.double_integrator_constrained == "all" else intervals - 1
    variance_weight, mean_weight = point_mass.double_integrator_weights
    return block_program.SteeringProgram(
        system=model,
        state_weight=np.tile(np.diag(point_mass.double_integrator_state_weights), (intervals, 1, 1)),
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
        final_covariance=covariance_of(
            point_mass.double_integrator_final_three_sigma, point_mass.double_integrator_final_correlation
        ),
        percentiles=(
            block_program.Percentile(
                np.array(point_mass.double_integrator_percentile_direction),
                0.0,
                point_mass.double_integrator_percentile_tail,
            ),
        )
        if point_mass.double_integrator_percentile_weight > 0.0
        else (),
        percentile_weight=point_mass.double_integrator_percentile_weight,
    )


def solved(point_mass: PointMass, constrained=True):
    """The last program of the iterations and its solution (Algorithm 1)."""
    control = guess(point_mass)
    for _ in range(point_mass.double_integrator_iterations):
        posed = program(point_mass, constrained, control)
        solution = block_program.solve(posed)
        control = solution.control[:, 0]
    return posed, solution


@stage()
def compute(point_mass: PointMass) -> DoubleIntegrator:
    """Run the iterations.

    Raises MarsedlError if the constraints cannot be met, saying which and how far.
    """
    try:
        posed, solution = solved(point_mass)
        _, free = solved(point_mass, constrained=False)
    except (ValueError, RuntimeError) as error:
        raise MarsedlError(f"double integrator: {error}") from None
    model = posed.system
    nodes = np.array(point_mass.double_integrator_partition)
    intervals = len(nodes) - 1
    silent = np.zeros((intervals, intervals + 1, 1, 2))
    first = guess(point_mass)
    open_covariance, _ = block_program.closed_loop(system(point_mass, first), silent)
    mean = np.array([np.column_stack(nominal_states(point_mass, first, nodes)), solution.mean])
    covariance = np.array([open_covariance, solution.covariance])
    normals, bounds = normals_and_bounds(point_mass)
    spread = np.sqrt(np.einsum("ci,lkij,cj->lkc", normals, covariance, normals))
    return DoubleIntegrator(
        partition=nodes,
        transition=model.transition,
        input=model.control[:, :, 0],
        disturbance_covariance=model.disturbance_covariance.reshape(intervals, 2, intervals, 2),
        control=np.array([first, solution.control[:, 0]]),
        gain=np.array([silent[:, :, 0], solution.gain[:, :, 0]]),
        mean=mean,
        covariance=covariance,
        control_deviation=np.array([np.zeros(intervals), np.sqrt(solution.control_covariance[:, 0, 0])]),
        objective=solution.objective,
        unconstrained_objective=free.objective,
        support=mean @ normals.T + ellipse_radius(point_mass) * spread - bounds,
        status=solution.status,
        accepted_by=solution.accepted_by,
        solver_attempt=solution.attempt,
        solver_iterations=solution.iterations,
        solver_gap=solution.duality_gap,
        solver_residual=max(solution.primal_residual, solution.dual_residual),
    )
