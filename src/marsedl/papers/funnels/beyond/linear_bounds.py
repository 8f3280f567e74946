"""What linear dynamics say of the same flights: levels.

The paper compares its funnel with linear ellipsoidal ones (robust entry funnels, Sec. 5). None of these is a bound of
the entry: terms beyond the first order are left out. The disturbance is that of the density, in all readings.
"""

from itertools import pairwise

import numpy as np

from marsedl.methods.funnels.linear import linear_exact, linear_triangle, slice_jacobians
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import half_widths
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Gains, LinearBounds, Linearization
from marsedl.replication.pipeline.catalogue import stage


@stage(claimed_in=("corrected",))
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> LinearBounds:
    """Propagate everything that follows from the Jacobians."""
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    steps = environment.slices(loop, given.recursion.steps_per_slice)
    transitions, responses, _ = slice_jacobians(loop, np.arange(len(loop.time)))
    across, pushed = between_slices(transitions, responses, steps)
    shapes, scale = gains.shape[steps], environment.state_scale(given.planet, given.guidance)
    exact = linear_exact(across, pushed, shapes, gains.initial_level)
    return LinearBounds(
        time=loop.time,
        slice_step=steps,
        slice_time=loop.time[steps],
        exact_level=exact,
        triangle_level=linear_triangle(across, pushed, shapes, gains.initial_level),
        undisturbed_level=linear_exact(across, pushed[:, :, :0], shapes, gains.initial_level),
        exact_half_width=half_widths(2.0 * exact[:, np.newaxis, np.newaxis] * _inverse(shapes, 1.0 / scale)),
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


def _inverse(matrices, scale):
    """Inverses of symmetric matrices whose rows have the units of a scale."""
    units = np.outer(scale, scale)
    return np.linalg.inv(matrices / units) / units
