"""Flights around a reference under its feedback, from the boundary of the first slice of a funnel.

All flights of a block advance together in numpy (`methods.funnels.monte_carlo.fly`): there is no compiled kernel, which
would take longer to compile than all flights of a case take to fly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.monte_carlo import fly, greedy_additive, greedy_disturbance
from marsedl.methods.funnels.stage import spread_of
from marsedl.montecarlo import ensembles
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.streams import normals
from marsedl.papers.funnels import dubins as dubins_stage
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import OBSERVED
from marsedl.papers.funnels.inputs import Inputs

START_STREAM, DISTURBANCE_STREAM, ADDITIVE_STREAM = range(3)


@dataclass(frozen=True)
class Setting:
    """What is flown, and the funnel that it is held against."""

    loop: ClosedLoop
    shape: np.ndarray  # P at the nodes
    level: np.ndarray  # rho at the nodes
    at_slice: np.ndarray  # whether a node is one of a slice
    observed: tuple
    additive: np.ndarray | None = None  # semi-axes of what is added to the rates
    heat_rate: Callable | None = None  # of altitude, velocity and disturbance, W/m^2


class Draws(NamedTuple):
    """Under which disturbances flights are."""

    seed: int
    case: str = "constant"
    redraw_steps: int | None = None  # fine steps after which a disturbance is drawn again
    adversarial_directions: int | None = None  # directions of disturbance from which the adversary chooses


def entry_setting(given: Inputs, linearization, gains, funnel):
    """Flights of the entry, held against its funnel."""
    air = environment.disturbed_air(given.planet, given.uncertainty)
    loop = environment.closed_loop(given.planet, given.vehicle, air, linearization, gains.half_gain)
    amplitudes, heat_rate = (
        environment.additive_amplitudes(given.planet, given.uncertainty),
        partial(environment.heat_rate, given.vehicle, air),
    )
    return Setting(loop, gains.shape, *_at_nodes(loop, funnel.step, funnel.level), OBSERVED, amplitudes, heat_rate)


def car_setting(dubins, name, speed, strongest_wind=None):
    """Runs of the Dubins car, held against the funnel of this name; speed and wind in m/s."""
    loop = dubins_stage.closed_loop(dubins, speed, strongest_wind)
    level = dubins.level[list(dubins.funnel).index(name)]
    return Setting(loop, dubins.shape, *_at_nodes(loop, dubins.slice_step, level), OBSERVED[:2])


def _at_nodes(loop, steps, level):
    """Level at all nodes, linear between slices, and whether a node is one of a slice."""
    nodes = np.arange(loop.steps + 1)
    return np.interp(nodes, steps, level), np.isin(nodes, steps)


def simulator(setting: Setting, draws: Draws):
    """Return the function `simulate_block(first, last)` of a case: it flies all trials of a block together."""
    loop = setting.loop
    spread = spread_of(setting.shape[0], setting.level[0])

    def simulate_block(first, last):
        trials = np.arange(first, last)
        directions = _directions(draws.seed, START_STREAM, trials, 1, loop.dimension)[0]
        history = np.empty((len(setting.level), loop.dimension, len(trials)))
        observed = np.empty((len(setting.level), len(setting.observed), len(trials)))

        def observe(node, deviation, disturbance):
            history[node] = deviation
            observed[node, 1] = np.abs(loop.control_deviation(2 * node, deviation)[0])
            if setting.heat_rate is not None:
                state = loop.states[2 * node][:, np.newaxis] + deviation
                observed[node, 2] = setting.heat_rate(state[0], state[3], disturbance)

        observed[:, 0] = fly(
            loop,
            setting.shape,
            _combined(spread, directions.T).T,
            disturbances(draws, loop, trials),
            additive(draws, setting, trials),
            observe,
        )
        return ensembles.Trajectories(
            history=history,
            observed=observed,
            observed_maximum=observed.max(axis=0),
            final_state=np.vstack([history[-1], *_largest_ratios(setting, observed[:, 0])]),
            outcome=np.full(len(trials), COMPLETED, np.int8),
            length=np.full(len(trials), len(history), np.int64),
        )

    return simulate_block


def _directions(seed, stream, trials, segments, components):
    """Points uniform on a unit sphere for every trial, (segments, trials, components)."""
    directions = normals(seed, stream, trials, segments * components).reshape(len(trials), segments, components)
    return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).swapaxes(0, 1)


def disturbances(draws: Draws, loop, trials):
    """Disturbance w of a case, as `fly` takes it."""
    if draws.case == "adversarial":
        angle = 2.0 * np.pi * np.arange(draws.adversarial_directions) / draws.adversarial_directions
        return greedy_disturbance(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    if loop.disturbances == 0:
        return np.empty((len(trials), 0))
    return _directions(draws.seed, DISTURBANCE_STREAM, trials, _segments(draws, loop), loop.disturbances)


def additive(draws: Draws, setting, trials):
    """What is added to the rates, from the boundary of its set, where a reading has such disturbances."""
    if setting.additive is None:
        return None
    if draws.case == "adversarial":
        return greedy_additive(setting.additive)
    loop = setting.loop
    directions = _directions(draws.seed, ADDITIVE_STREAM, trials, _segments(draws, loop), loop.dimension)
    return directions * setting.additive


def _segments(draws, loop):
    """Parts of the flight with a disturbance of their own."""
    if draws.case != "redrawn":
        return 1
    return loop.steps // environment.spacing_of(loop, loop.steps / draws.redraw_steps)


def _combined(matrix, vectors):
    """Matrix times columns by sums: a matrix product may round a column by its place among the others."""
    return np.array([sum(entry * row for entry, row in zip(line, vectors, strict=True)) for line in matrix.tolist()])


def _largest_ratios(setting, values):
    """Largest V/rho of every trial at the slices after the first, and at the nodes between slices, (2, trials).

    Where the funnel has come to its end, nothing is outside of it.
    """
    ratio = values / setting.level[:, np.newaxis]
    at_slice = setting.at_slice.copy()
    at_slice[0] = False
    return [np.fmax.reduce(ratio[nodes], axis=0, initial=0.0) for nodes in (at_slice, ~setting.at_slice)]
