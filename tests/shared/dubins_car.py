"""The Dubins car of several tests of funnels."""

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop, reference_on_half_steps
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.models.dynamics.dubins_car import dubins_car_rates


def dubins(wind=0.0, every=4, steps=80, duration=4.0):
    """A Dubins car on an S-shaped path, the values of its regulator at `every`-th fine step, and these steps."""
    time = np.linspace(0, duration, steps + 1)
    states, controls = reference_on_half_steps(
        lambda state, control: dubins_car_rates(*state, *control, 1.0),
        time,
        lambda t: 0.8 * np.sin(2 * np.pi * t / duration)[:, None],
        np.zeros(3),
    )
    headings = states[1::2, 2]
    state_matrices = np.zeros((steps, 3, 3))
    state_matrices[:, 0, 2], state_matrices[:, 1, 2] = -np.sin(headings), np.cos(headings)
    control_matrices = np.tile([[0.0], [0.0], [1.0]], (steps, 1, 1))
    regulator = tvlqr(state_matrices, control_matrices, np.diff(time), np.eye(3), np.eye(1), 2 * np.eye(3))

    def rates(half_index, state, control, disturbance):
        x, y, heading = dubins_car_rates(*state, *control, 1.0)
        return (x + wind * disturbance[0], y + wind * disturbance[1], heading) if wind else (x, y, heading)

    loop = ClosedLoop(rates, time, states, controls, at_half_steps(regulator.gains), 2 if wind else 0)
    slices = np.arange(0, steps + 1, every)
    return loop, regulator.values[slices], slices
