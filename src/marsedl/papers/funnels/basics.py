"""Units, sets and small functions that stages, claims, figures and tables share."""

import numpy as np

from marsedl.methods.sos.variety import Spheres
from marsedl.montecarlo.streams import normals
from marsedl.papers.funnels.environment import DISTURBANCES, STATES
from marsedl.replication.units import KM

# Units of the states in which conditions are stated beside those in scales of the regulator: km and km/s.
STATES_IN_KILOMETRES = np.array([KM, 1.0, 1.0, KM, 1.0, 1.0])

COMPLETE = "complete"  # outcome of a funnel that exists to the end
OBSERVED = ("level", "feedback", "heat_rate")  # of a flight
LEVEL, HEAT_RATE = OBSERVED.index("level"), OBSERVED.index("heat_rate")
BASIS_DEGREE = 2  # of the sums of squares: for the entry 43 polynomials, 406 samples
SLICE = Spheres((len(STATES),))
SPHERES = Spheres((len(STATES), DISTURBANCES))  # slice and boundary of the disturbances


def random_points(spheres: Spheres, seed, stream, count):
    """Points uniform on every sphere, (count, variables), from a stream of the package's random numbers."""
    return spheres.project(normals(seed, stream, range(count), spheres.variables))


def half_widths(ellipsoids):
    """Largest components in {x'E^-1 x <= 1}, for many E (m, n, n); (m, n)."""
    return np.sqrt(np.diagonal(ellipsoids, axis1=1, axis2=2))
