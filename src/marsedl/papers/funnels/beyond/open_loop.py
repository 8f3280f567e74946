"""Where the entry ends without feedback: what the landing accuracy of the funnel is compared with (Abstract)."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.funnels import environment, flight
from marsedl.papers.funnels.basics import OBSERVED
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Gains, Linearization, OpenLoop
from marsedl.replication.pipeline.catalogue import stage

REPEATS = 10
COMPLEX_STEP = 1e-30
ON_GROUND = slice(1, 3)  # longitude and latitude among the states


@stage()
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> OpenLoop:
    """Fly the starts and disturbances of the case "constant" without feedback, and take linear motion both ways."""
    loops = [
        environment.disturbed_loop(given, linearization, half_gain)
        for half_gain in (np.zeros_like(gains.half_gain), gains.half_gain)
    ]
    setting = flight.Setting(
        loop=loops[0],
        shape=gains.shape,
        level=np.full(len(gains.time), gains.initial_level),
        at_slice=np.zeros(len(gains.time), bool),
        observed=OBSERVED[:2],
        additive=environment.additive_amplitudes(given.planet, given.uncertainty),
    )
    simulate_block = flight.simulator(setting, flight.Draws(given.ensemble.seed))
    deviations = np.hstack(
        [
            simulate_block(first, min(first + ensembles.BLOCK_SIZE, given.ensemble.trials)).final_state[ON_GROUND]
            for first in range(0, given.ensemble.trials, ensembles.BLOCK_SIZE)
        ]
    )
    finite = np.isfinite(deviations).all(axis=0)
    on_ground = np.abs(deviations[:, finite]) * given.planet.planet_radius
    parts = [on_ground[:, np.flatnonzero(finite) % REPEATS == repeat] for repeat in range(REPEATS)]
    return OpenLoop(
        trials=given.ensemble.trials,
        lost=int(np.count_nonzero(~finite)),
        flown_half_width=_farthest(on_ground),
        repeat_half_width=np.array([_farthest(part) for part in parts]),
        linear_half_width=np.array([linear_reach(loop, gains) * given.planet.planet_radius for loop in loops]),
    )


def _farthest(deviations):
    """Largest deviation of some flights in each direction, not a number without any."""
    return np.fmax.reduce(deviations, axis=1, initial=np.nan)


def linear_reach(loop, gains: Gains) -> np.ndarray:
    """Largest final downrange and crossrange deviation of linear motion from the first slice, (2,), in radii.

    Under all constant disturbances.
    """
    spread = np.sqrt(2.0 * gains.initial_level) * np.linalg.inv(np.linalg.cholesky(gains.shape[0])).T
    corner = np.zeros((len(spread), loop.disturbances))
    directions = np.block([[spread, corner], [corner.T, np.eye(loop.disturbances)]])
    states, disturbances = np.split(1j * COMPLEX_STEP * directions, [len(spread)])
    final = np.array(loop.flow(0, loop.steps, states, disturbances)).imag / COMPLEX_STEP
    by_start, by_disturbance = np.split(final, [len(spread)], axis=1)
    return (np.linalg.norm(by_start, axis=1) + np.linalg.norm(by_disturbance, axis=1))[ON_GROUND]
