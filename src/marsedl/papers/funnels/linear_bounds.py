"""What linear dynamics say of the same flights: levels, an ellipsoid of start and disturbance together, and a shape.

The paper compares its funnel with linear ellipsoidal ones (robust entry funnels, Sec. 5). None of these is a bound of
the entry: terms beyond the first order are left out. The disturbance is that of the density, in all readings.
"""

from itertools import pairwise

import numpy as np

from marsedl.methods.funnels.linear import (
    joint_ellipsoid,
    linear_exact,
    linear_triangle,
    minkowski_shape,
    slice_jacobians,
)
from marsedl.methods.funnels.monte_carlo import fly, quadratic_values
from marsedl.montecarlo.streams import normals, uniforms
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import half_widths
from marsedl.papers.funnels.inputs import Ensemble, Guidance, Planet, Recursion, Uncertainty, Vehicle
from marsedl.papers.funnels.records import Gains, LinearBounds, Linearization
from marsedl.replication.artifacts import finite
from marsedl.replication.catalogue import stage

FLIGHTS = 2000  # a share of them is known to about a per cent
DIRECTION_STREAM, RADIUS_STREAM = 8, 9  # of the random numbers; the Monte Carlo flights use others
# Start and disturbance may both be at their limits: then the sum of squares that the joint ellipsoid holds at 1 is 2.
BOTH_LIMITS = 2.0


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    guidance: Guidance,
    recursion: Recursion,
    ensemble: Ensemble,
    linearization: Linearization,
    gains: Gains,
) -> LinearBounds:
    """Propagate everything that follows from the Jacobians, and fly to see what they leave out."""
    air = environment.disturbed_air(planet, uncertainty)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    steps = environment.slices(loop, recursion.steps_per_slice)
    transitions, responses, _ = slice_jacobians(loop, np.arange(len(loop.time)))
    across, pushed = between_slices(transitions, responses, steps)
    shapes, scale = gains.shape[steps], environment.state_scale(planet, guidance)
    exact = linear_exact(across, pushed, shapes, gains.initial_level)
    semi_axes = environment.initial_semi_axes(planet, uncertainty)
    first_set = environment.initial_set(semi_axes)
    ellipsoids = joint_ellipsoid(transitions, responses, first_set)
    reachable = minkowski_shape(transitions, responses, first_set, scale)
    value_matrices = 2.0 * _inverse(ellipsoids, scale)

    deviations, disturbances = starts(ensemble.seed, semi_axes)
    extremes = []
    values = fly(
        loop,
        value_matrices,
        deviations,
        disturbances,
        observer=lambda _, at, __: extremes.append(np.abs(at).max(axis=1)),
    )
    linear_values = linear_flights(transitions, responses, value_matrices, deviations, disturbances)
    return LinearBounds(
        time=loop.time,
        slice_step=steps,
        slice_time=loop.time[steps],
        exact_level=exact,
        triangle_level=linear_triangle(across, pushed, shapes, gains.initial_level),
        undisturbed_level=linear_exact(across, pushed[:, :, :0], shapes, gains.initial_level),
        exact_half_width=half_widths(2.0 * exact[:, np.newaxis, np.newaxis] * _inverse(shapes, 1.0 / scale)),
        joint_half_width=half_widths(ellipsoids),
        joint_condition=np.linalg.cond(ellipsoids / np.outer(scale, scale)),
        flights=FLIGHTS,
        lost=int(np.count_nonzero(~np.isfinite(values).all(axis=0))),
        flown_half_width=finite(np.array(extremes)),
        largest_value=finite(values.max(axis=1)),
        largest_linear_value=linear_values.max(axis=1),
        share_outside=_share(values, 1.0),
        linear_share_outside=_share(linear_values, 1.0),
        share_beyond=_share(values, BOTH_LIMITS),
        reachable_half_width=half_widths(2.0 * _inverse(reachable, 1.0 / scale)),
        reachable_level=linear_exact(across, pushed, reachable[steps], 1.0),
    )


def between_slices(transitions, responses, steps):
    """Jacobians from slice to slice, from those of the fine steps in between, at a constant disturbance."""
    across, pushed = [], []
    for first, last in pairwise(steps):
        transition, response = transitions[first], responses[first]
        for k in range(first + 1, last):
            transition, response = transitions[k] @ transition, transitions[k] @ response + responses[k]
        across.append(transition)
        pushed.append(response)
    return np.array(across), np.array(pushed)


def starts(seed, semi_axes):
    """Deviations uniform in the volume of the initial set (m, 6), and disturbances uniform at their limit (m, 2)."""
    states, trials = len(environment.STATES), np.arange(FLIGHTS)
    numbers = normals(seed, DIRECTION_STREAM, trials, states + environment.DISTURBANCES)
    direction, disturbance = np.split(numbers, [states], axis=1)
    radius = uniforms(seed, RADIUS_STREAM, trials, 1) ** (1.0 / states)
    return radius * _unit(direction) * semi_axes, _unit(disturbance)


def linear_flights(transitions, responses, value_matrices, deviations, disturbances):
    """Values of flights of the linear dynamics at every node, (time, m); the arguments are those of `fly`."""
    deviation, pushed = deviations.T, disturbances.T
    values = [quadratic_values(value_matrices[0], deviation)]
    for transition, response, value_matrix in zip(transitions, responses, value_matrices[1:], strict=True):
        deviation = transition @ deviation + response @ pushed
        values.append(quadratic_values(value_matrix, deviation))
    return np.array(values)


def _unit(rows):
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _inverse(matrices, scale):
    """Inverses of symmetric matrices whose rows have the units of a scale."""
    units = np.outer(scale, scale)
    return np.linalg.inv(matrices / units) / units


def _share(values, limit):
    return float((values.max(axis=0) > limit).mean())
