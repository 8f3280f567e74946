"""Flights around a reference under its feedback, from the boundary of the first slice of a funnel.

All flights of a block advance together in numpy (`methods.funnels.monte_carlo.fly`): there is no compiled kernel, which
would take longer to compile than all flights of a case take to fly.
"""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.funnels.monte_carlo import fly, greedy_additive, greedy_disturbance
from marsedl.montecarlo import ensembles
from marsedl.montecarlo.streams import normals
from marsedl.papers.funnels import dubins as car
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import OBSERVED

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


def entry_setting(inputs, linearization, gains, funnel):
    """Flights of the entry, held against its funnel."""
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    amplitudes = environment.additive_amplitudes(inputs) if inputs.additive else None
    return Setting(loop, gains.shape, *_at_nodes(loop, funnel.step, funnel.level), OBSERVED, amplitudes)


def car_setting(inputs, dubins, name):
    """Runs of the Dubins car, held against the funnel of this name."""
    loop = car.closed_loop(inputs, dubins, wind=car.FUNNELS[name][1])
    level = dubins.level[list(dubins.funnel).index(name)]
    return Setting(loop, dubins.shape, *_at_nodes(loop, dubins.slice_step, level), OBSERVED[:2])


def _at_nodes(loop, steps, level):
    """Level at all nodes, linear between slices, and whether a node is one of a slice."""
    nodes = np.arange(loop.steps + 1)
    return np.interp(nodes, steps, level), np.isin(nodes, steps)


def simulator(inputs, setting, case):
    """Return the function `simulate_block(first, last)` of a case: all trials of a block, flown together."""
    loop = setting.loop
    spread = np.sqrt(2.0 * setting.level[0]) * np.linalg.inv(np.linalg.cholesky(setting.shape[0])).T

    def simulate_block(first, last):
        trials = np.arange(first, last)
        directions = _directions(inputs.seed, START_STREAM, trials, 1, loop.dimension)[0]
        history = np.empty((len(setting.level), loop.dimension, len(trials)))
        observed = np.empty((len(setting.level), len(setting.observed), len(trials)))

        def observe(node, deviation, disturbance):
            history[node] = deviation
            observed[node, 1] = np.abs(loop.control_deviation(2 * node, deviation)[0])
            if len(setting.observed) > 2:
                state = loop.states[2 * node][:, np.newaxis] + deviation
                observed[node, 2] = environment.heat_rate(inputs, state[0], state[3], disturbance)

        observed[:, 0] = fly(
            loop,
            setting.shape,
            _combined(spread, directions.T).T,
            disturbances(inputs, loop, case, trials),
            additive(inputs, setting, case, trials),
            observe,
        )
        return ensembles.Trajectories(
            history=history,
            observed=observed,
            observed_maximum=observed.max(axis=0),
            final_state=np.vstack([history[-1], *_largest_ratios(setting, observed[:, 0])]),
            outcome=np.full(len(trials), ensembles.COMPLETED, np.int8),
            length=np.full(len(trials), len(history), np.int64),
        )

    return simulate_block


def _directions(seed, stream, trials, segments, components):
    """Points uniform on a unit sphere for every trial, (segments, trials, components)."""
    drawn = normals(seed, stream, trials, segments * components).reshape(len(trials), segments, components)
    return (drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)).swapaxes(0, 1)


def disturbances(inputs, loop, case, trials):
    """Disturbance w of a case, as `fly` takes it."""
    if case == "adversarial":
        angle = 2.0 * np.pi * np.arange(inputs.adversarial_directions) / inputs.adversarial_directions
        return greedy_disturbance(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    if loop.disturbances == 0:
        return np.empty((len(trials), 0))
    return _directions(inputs.seed, DISTURBANCE_STREAM, trials, _segments(inputs, loop, case), loop.disturbances)


def additive(inputs, setting, case, trials):
    """What is added to the rates, from the boundary of its set, where a reading has such disturbances."""
    if setting.additive is None:
        return None
    if case == "adversarial":
        return greedy_additive(setting.additive)
    loop = setting.loop
    drawn = _directions(inputs.seed, ADDITIVE_STREAM, trials, _segments(inputs, loop, case), loop.dimension)
    return drawn * setting.additive


def _segments(inputs, loop, case):
    """Parts of the flight with a disturbance of their own."""
    return loop.steps // inputs.redraw_steps if case == "redrawn" else 1


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
