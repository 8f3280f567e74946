"""Car of constant speed that steers by its turn rate (robust entry funnels, Fig. 2)."""

import numpy as np

from marsedl.compiling import jitable

__all__ = ["dubins_car_rates"]


@jitable
def dubins_car_rates(x, y, heading, turn_rate, speed):
    r"""Time derivatives of position and heading of a Dubins car (robust entry funnels, Fig. 2).

        $\dot{x} = v \, \cos\theta, \quad \dot{y} = v \, \sin\theta, \quad \dot{\theta} = u$

    Args:
        x, y: position, m; the rates do not depend on it.
        heading: theta, counter-clockwise from the x axis, rad.
        turn_rate: u, rad/s.
        speed: v, m/s.

    Returns:
        Tuple of the rates of x, y (m/s) and heading (rad/s).
    """
    return speed * np.cos(heading), speed * np.sin(heading), turn_rate
