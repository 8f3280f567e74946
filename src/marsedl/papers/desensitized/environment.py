"""What flights of this paper know: constants, the table of the density, and the nominals they fly beside."""

import numpy as np

from marsedl.models import atmosphere
from marsedl.papers.desensitized import components, entry_problem, flight, mean_density, records
from marsedl.papers.desensitized.inputs import Planet, Simulation, Vehicle


def surroundings(planet: Planet, vehicle: Vehicle):
    """Constants of the flights and the cells of their density table, as `flight.fly` takes them first."""
    nodes = atmosphere.uniform_nodes(mean_density.profile(planet))
    cells = atmosphere.uniform_cells(nodes.log_density, nodes.slope, nodes.spacing)
    return flight.settings(planet, vehicle, nodes), cells


def displaced(planet: Planet, state, errors):
    """States at entry with position errors (trials, 3) of radius, crossrange and downrange, m: (trials, 8)."""
    states = np.tile(np.asarray(state, dtype=float), (len(errors), 1))
    states[:, :3] += np.asarray(errors) / entry_problem.lengths(planet)
    return states


def along_channel(channel, errors):
    """Errors of one channel, by its number, as position errors (errors, 3)."""
    positions = np.zeros((len(errors), len(records.CHANNELS)))
    positions[:, channel] = errors
    return positions


def final_errors(planet: Planet, simulation: Simulation, air, reference, gain, errors, **options):
    """Flown final radius, crossrange and downrange errors, m, of position errors at entry: both (trials, 3).

    air: see `surroundings`. reference, gain, options: as of `flight.fly`. Trials that crash or are not finite have NaN.
    """
    states = displaced(planet, reference.initial_state, np.vstack([np.zeros(3), errors]))
    trajectories = flight.fly(*air, reference, gain, states, substeps=simulation.substeps, **options)
    final = np.where(trajectories.outcome == 0, trajectories.final_state[: components.STATES], np.nan).T
    return entry_problem.position_errors(final[1:], final[:1], planet.planet_radius)
