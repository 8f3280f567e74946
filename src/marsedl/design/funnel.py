"""The funnel of one's own vehicle: where feedback keeps it about a reference, whatever a bounded disturbance does.

    tube = funnel(rates, p, time, command, start, semi_axes, weights=(Q, R, Qf), disturbances=Wind(0.3), proven=True)
    tube.half_widths  # of every state, at every node
    tube.table  # the law, a GainTable of marsedl.fly
    tube.holds(20_000)  # whether flights of the same `rates` stay in it, and how many do not
    print(tube.covers)  # what is proven, and what is not

`noise` of `rates` is bounded here, and constant from slice to slice; elsewhere it is white.
"""

from collections import namedtuple
from dataclasses import dataclass
from functools import cached_property
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from marsedl.design.common import gain_table
from marsedl.design.pictures import Curve, over_time
from marsedl.fly.declared import is_number
from marsedl.fly.generated import generated
from marsedl.fly.laws import GainTable
from marsedl.methods.funnels.closed_loop import ClosedLoop, reference_on_half_steps
from marsedl.methods.funnels.linear import slice_jacobians
from marsedl.methods.funnels.monte_carlo import quadratic_values
from marsedl.methods.funnels.recursion import StageRule, forward, initial_level, largest_feedback
from marsedl.methods.funnels.remainder import covering_spheres, proven_stages
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.linearization import linearize
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.step_map import VectorRates, in_vectors
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.montecarlo.streams import normals
from marsedl.summaries import summary
from marsedl.words import described, require

__all__ = ["FlownFunnel", "Funnel", "funnel"]

DIVERGED = 1e9  # times the first level
CHUNK = 4096  # flights whose histories are held at once
START, DISTURBANCE = range(2)  # streams of random numbers
STEADY, WORST = 0, 1  # remainders of trials by 3 whose disturbance is so; the third is drawn anew in each stage


def funnel(
    rates, p, time, command, start, semi_axes, *, weights, disturbances=None, vehicle=(), every=5, proven=False, seed=1
) -> "Funnel":
    r"""Levels within which feedback keeps a vehicle about a reference under bounded disturbances.

    The reference is flown from `start` under `command`, without disturbance. The feedback is the linear-quadratic
    regulator along it (`methods.tvlqr`), whose matrices P give the funnel its shape, at every node t_k the ellipsoid

        $\frac{1}{2} \bar{x}^\top P_k \bar{x} \le \rho_k, \quad \bar{x} = x - x^*$

    The levels come from sums of squares, stage by stage (robust entry funnels, Algorithm 1). `noise` of `rates`, white
    in flights and in steering, is bounded here: it is constant over each stage, anywhere in the ellipsoid with the
    semi-axes `disturbances`, in the unit in which `rates` takes it (not times s^(1/2)).

    Args:
        rates: `rates(state, command, noise, vehicle, p) -> State`, that of flights, which asks by name; its annotations
            tell the NamedTuples. Limits are written by `select` and `clip` of `marsedl.elementary`.
        p: parameters, a NamedTuple, or ().
        time: of the nodes, (n + 1,), s, from 0; a step of Runge and Kutta lies between two nodes.
        command: function of times (k,), s, that returns commands (k, m); or commands that do not change, (m,).
        start: state where the reference starts, (nx,).
        semi_axes: of the ellipsoid of deviations at the start, (nx,), in the units of the states.
        weights: Q (nx, nx), R (m, m), both per second, and Qf (nx, nx) of the regulator's cost, or their diagonals.
        disturbances: NamedTuple of the noise with the largest magnitude of each of its numbers; None for `rates` that
            ask for none.
        vehicle: NamedTuple of numbers, where `rates` asks for it.
        every: nodes from one slice to the next; a stage lies between two slices.
        proven: whether what the polynomials leave out and what rounding does is bounded, by Taylor models. Then the
            levels hold at every node; otherwise at the slices, but for what terms above the third order do.
        seed: of the samples of the programs.

    Returns:
        `Funnel`.

    Raises:
        ValueError: with one sentence on what is wrong: a shape, a name, a number that must be positive, a weight that
            is not definite; `FunnelError` if the funnel diverges, or a stage cannot be proven, with its slice.
        TypeError: for a branch that cannot be traced, with its file and line.
    """
    time, semi_axes = np.asarray(time, float), np.asarray(semi_axes, float)
    require(
        time.ndim == 1 and len(time) > 1 and time[0] == 0.0 and (np.diff(time) > 0.0).all(),
        "time must be a vector of nodes that rises from 0 s, such as np.linspace(0.0, 4.0, 201)",
    )
    require(
        isinstance(every, int | np.integer) and 1 <= every < len(time),
        f"every is {every!r}; give the nodes from one slice to the next, from 1 to {len(time) - 1}",
    )
    require(len(weights) == 3, f"weights are {len(weights)}; give Q, R and Qf: of the states, the commands, the end")
    dynamics = _dynamics(rates, p, vehicle, disturbances)
    n, m, q = (len(dynamics.names.get(part, ())) for part in ("state", "command", "noise"))
    bounds = np.array(disturbances if q else (), float)
    require(m > 0, f"{described(rates)} takes no command: let it ask for 'command', which the feedback sets")
    for name, value, size in (("start", start, n), ("semi_axes", semi_axes, n), ("disturbances", bounds, q)):
        shape, good = np.shape(value), np.isfinite(value).all() and (name == "start" or np.greater(value, 0.0).all())
        words = "finite" if name == "start" else "positive"
        require(shape == (size,) and good, f"{name} must be {size} {words} numbers, got {np.array(value).tolist()}")

    require(
        callable(command) or (np.shape(command) == (m,) and all(map(is_number, command))),
        f"command must be a function of times (k,) that returns commands (k, {m}), or {m} finite numbers",
    )
    if not callable(command):
        steady = np.array(command, float)
        command = lambda at: np.broadcast_to(steady, (len(at), m))  # noqa: E731
    weights = [np.diag(weight) if np.ndim(weight) == 1 else weight for weight in weights]
    shape = np.shape(command(time))
    require(shape == (len(time), m), f"command must return shape (times, {m}), got {shape} of {len(time)} times")
    calm = [0.0] * q
    states, commands = reference_on_half_steps(lambda x, u: dynamics(*x, *u, *calm), time, command, start)
    model = linearize(lambda *numbers: dynamics(*numbers, *calm), states, commands)
    regulator = tvlqr(model.state_matrix[1::2], model.control_matrix[1::2], np.diff(time), *weights)
    loop = ClosedLoop(
        lambda _, x, u, w: dynamics(*x, *u, *(bound * number for bound, number in zip(bounds, w, strict=True))),
        *(time, states, commands, at_half_steps(regulator.gains), q),
    )
    slices = np.append(np.arange(0, len(time) - 1, every), len(time) - 1)
    first = initial_level(regulator.values[0], np.diag(2.0 / semi_axes**2))
    if proven:
        design = well_chosen_design(covering_spheres(loop), seed)
        stages = proven_stages(loop, regulator.values, slices, first, design)
        nodes, levels = np.arange(len(time)), np.concatenate([[first], *(stage.levels for stage in stages)])
    else:
        design = well_chosen_design(Spheres((n, q) if q else (n,)), seed)
        limits = {"rule": StageRule(), "limit": DIVERGED * first}
        nodes, levels = slices, forward(loop, regulator.values[slices], slices, first, design, **limits).rho
    return Funnel(dynamics, loop, bounds, regulator.values, slices, nodes, levels, bool(proven))


def _dynamics(rates, p, vehicle, disturbances) -> VectorRates:
    """Rates as a function of numbers, of which state, command and noise vary."""
    for name, value in (("p", p), ("vehicle", vehicle)):
        require(isinstance(value, tuple), f"{name} is {value!r}; give a NamedTuple of numbers, or () for none")
    parts = {name: value for name, value in (("p", p), ("vehicle", vehicle)) if value != ()}
    if disturbances is not None:
        require(
            hasattr(disturbances, "_fields") and not isinstance(disturbances, type),
            f"disturbances is {disturbances!r}; give the NamedTuple of the noise with its largest magnitudes",
        )
        parts["noise"] = type(disturbances)
    dynamics = in_vectors(rates, **parts)
    require(
        ("noise" in dynamics.kinds) == (disturbances is not None),
        f"{described(rates)} asks for 'noise', which is not bounded: give disturbances, its largest magnitudes",
    )
    require(
        not dynamics.changes_with_time, f"{described(rates)} asks for the time: make the time a number of its state"
    )
    return dynamics


class FlownFunnel(NamedTuple):
    """How flights kept to a funnel."""

    trials: int
    left: int  # flights that were outside of their level at one of the nodes
    interval: np.ndarray  # that holds the share of such flights with 95 % confidence, (2,)
    highest: np.ndarray  # largest V / level of all flights, at the nodes of the funnel after the first, (nodes - 1,)

    __repr__ = summary

    def __bool__(self):
        """Whether no flight left the funnel."""
        return self.left == 0


@dataclass(frozen=True, eq=False)
class Funnel:
    """A funnel about a reference, and the feedback that keeps to it; see `funnel`.

    Args:
        dynamics: rates as a function of numbers. loop: `ClosedLoop` with reference and gains on the half steps; its
            disturbances are in the unit ball. bounds: semi-axes of the disturbances, (q,).
        shapes: P at all nodes of the time, (n + 1, nx, nx).
        slices: nodes between which the disturbance is constant, (N,).
        nodes: for which there is a level: all if proven, else the slices. levels: rho there.
        proven: whether nothing is left out.
    """

    dynamics: VectorRates
    loop: ClosedLoop
    bounds: np.ndarray
    shapes: np.ndarray
    slices: np.ndarray
    nodes: np.ndarray
    levels: np.ndarray
    proven: bool

    __repr__ = summary

    @property
    def time(self) -> np.ndarray:
        """Times of the levels, s."""
        return self.loop.time[self.nodes]

    @cached_property
    def half_widths(self) -> np.ndarray:
        """Largest deviation of every state within the funnel, (nodes, nx)."""
        inverse = np.linalg.inv(self.shapes[self.nodes])
        return np.sqrt(2.0 * self.levels[:, np.newaxis] * np.diagonal(inverse, axis1=1, axis2=2))

    @cached_property
    def feedback(self) -> np.ndarray:
        """Largest deviation of every command from the reference's within the funnel, (nodes, m)."""
        nodes = zip(self.loop.gains[2 * self.nodes], self.shapes[self.nodes], self.levels, strict=True)
        return np.array([largest_feedback(*of_node) for of_node in nodes])

    @property
    def table(self) -> GainTable:
        """The law over time, with which `marsedl.fly` flies; there commands are held over the guidance period."""
        loop = self.loop
        halves = np.interp(np.arange(2 * loop.steps + 1) / 2, np.arange(loop.steps + 1), loop.time)
        return gain_table(self.dynamics.names, halves, loop.states, loop.controls, loop.gains)

    @property
    def covers(self) -> str:
        """What the levels say, and what they do not cover, in words."""
        names, (places, gaps) = self.dynamics.names, ("node", "nodes") if self.proven else ("slice", "slices")
        most = zip(names["command"], self.feedback.max(axis=0), strict=True)
        within = zip(names.get("noise", ()), self.bounds, strict=True)
        disturbed = "; ".join(f"{name} {bound:.4g}" for name, bound in within)
        where = "They lie in the ellipsoid with these semi-axes, and are constant from slice to slice."
        left_out = "- what terms above the third order and rounding add (proven=True bounds them)"
        return "\n".join(
            [
                f"{'It is proven that a' if self.proven else 'A'} flight that starts within the first slice is within "
                f"its level at every {places}" + (f", under disturbances up to {disturbed}." if disturbed else "."),
                *([where] if disturbed else []),
                "Not covered is:",
                *([] if self.proven else [left_out]),
                f"- what happens between the {gaps}",
                "- the error of a step of Runge and Kutta, which is taken for the motion from node to node",
                "- a command that is late, held or cut: the feedback acts at every instant, and asks for up to "
                + ", ".join(f"{value:.4g} of {name}" for name, value in most)
                + " beyond the reference",
            ]
        )

    def holds(self, trials=3000, *, seed=0, factor=1.0, compiled=True) -> FlownFunnel:
        """Fly from the boundary of the first slice, under disturbances from the boundary of theirs, on the engine.

        The same `rates` fly, with the feedback at every instant. Of three trials in turn one meets a steady
        disturbance, one that which drives the linearised motion farthest in a random direction at the end, from the
        worst start, and one that is drawn anew in every stage.

        Args:
            trials: how many. seed: of their random numbers. factor: times which disturbances are larger than those of
                the funnel. compiled: False flies in Python, many times slower, with nothing compiled.

        Returns:
            `FlownFunnel`.

        Raises:
            ValueError: if trials is no count.
        """
        require(
            isinstance(trials, int | np.integer) and trials >= 1,
            f"trials must be a whole number of at least 1, got {trials!r}",
        )
        size, left, highest = CHUNK if compiled else 1, 0, np.zeros(len(self.nodes) - 1)
        linear = slice_jacobians(self.loop, self.slices)[:2]
        for first in range(0, trials, size):
            numbers = np.arange(first, min(first + size, trials))
            deviations, pushes = self._drawn(seed, numbers, *linear)
            ratios = self._ratios(deviations, factor * self.bounds * pushes, compiled)
            left += int((ratios > 1.0).any(axis=0).sum())
            highest = np.maximum(highest, ratios.max(axis=1))
        return FlownFunnel(int(trials), left, np.array(binomial_interval(left, trials)), highest)

    def _drawn(self, seed, trials, transitions, responses):
        """Deviations at the start, (trials, nx), and disturbances in the unit ball, (stages, trials, q)."""
        stages, q, kind = len(responses), self.loop.disturbances, (trials % 3)[:, np.newaxis]
        spread = spread_of(self.shapes[0], self.levels[0])
        points = _directions(normals(seed, START, trials, self.loop.dimension))
        drawn = normals(seed, DISTURBANCE, trials, stages * q).reshape(len(trials), stages, q)
        pushes = np.moveaxis(_directions(drawn), 0, 1)
        pushes = np.where(kind == STEADY, pushes[0], pushes)
        toward = _times(points, np.linalg.cholesky(self.shapes[-1]).T)
        for stage in reversed(range(stages)):
            pushes[stage] = np.where(kind == WORST, _directions(_times(toward, responses[stage])), pushes[stage])
            toward = _times(toward, transitions[stage])
        points = np.where(kind == WORST, _directions(_times(toward, spread)), points)
        return _times(points, spread.T), pushes

    def _ratios(self, deviations, disturbances, compiled):
        """V / level of flights at the nodes after the first, (nodes - 1, trials)."""
        from marsedl.montecarlo.flights import Schedule

        loop, fixed = self.loop, self.dynamics.fixed
        stages = np.searchsorted(self.slices[1:-1], np.arange(2 * loop.steps + 1) // 2, side="right")
        tables = _Tables(fixed.get("p", ()), loop.states, loop.controls, loop.gains, stages)
        schedule = Schedule(loop.time, np.diff(loop.time), np.ones(loop.steps, int), int(self.nodes[1]))
        air = np.moveaxis(disturbances, 1, 2).reshape(-1, len(deviations))
        flight = _flight(self.dynamics, loop.dimension, loop.controls.shape[1], loop.disturbances)
        fly = flight.fly if compiled else flight.fly_in_python
        flown = fly(tables, schedule, (loop.states[0] + deviations).T, vehicle=fixed.get("vehicle", ()), air=air)
        moved = flown.history - loop.states[2 * self.nodes, :, np.newaxis]
        after = zip(self.nodes[1:], self.levels[1:], moved[1:], strict=True)
        with np.errstate(over="ignore", invalid="ignore"):  # one that diverges is outside
            return np.array(
                [quadratic_values(self.shapes[node], deviation) / level for node, level, deviation in after]
            )

    def picture(self, units=None) -> Any:
        """Figure of matplotlib: every state over time, the reference and the funnel about it. units: of states."""
        states = zip(self.dynamics.names["state"], self.loop.states[::2].T, self.half_widths.T, strict=True)
        curves = [
            curve
            for name, middle, width in states
            for curve in (
                Curve(name, "reference", self.loop.time, middle),
                Curve(name, "funnel", self.time, middle[self.nodes], width),
            )
        ]
        return over_time(curves, units or {})


# Parameters of a flight about a reference, by half steps: those of `rates`, and of the stage the number.
_Tables = namedtuple("_Tables", ["own", "states", "commands", "gains", "stages"])


def _flight(dynamics, n, m, q):
    """The closed loop as a `Flight`: feedback and disturbances are looked up, the command is the disturbance of a step.

    n, m, q: numbers of states, commands and disturbances. Disturbances are the air of a trial, stage by stage.
    """
    from marsedl.montecarlo.flights import Flight, Nothing

    kinds, noise = dynamics.kinds, dynamics.kinds.get("noise", Nothing)
    found = namedtuple("Found", [f"command_{row}" for row in range(m)] + [f"push_{row}" for row in range(q)])
    deviations = [f"(state[{place}] - p.states[half_index, {place}])" for place in range(n)]
    looked_up = [f"air[{q} * p.stages[half_index] + {row}]" for row in range(q)]
    for row in reversed(range(m)):
        fed_back = (f"p.gains[half_index, {row}, {place}] * {deviations[place]}" for place in range(n))
        looked_up.insert(0, " + ".join([f"p.commands[half_index, {row}]", *fed_back]))
    commands = ", ".join(f"found.command_{row}" for row in range(m))
    of_user = {"command": f"Command({commands})", "noise": "command", "p": "p.own"}
    arguments = ", ".join(of_user.get(name, name) for name in signature(dynamics.rates).parameters)
    pushes = "".join(f"found.push_{row}, " for row in range(q))
    return Flight(
        generated(
            ("state", "found", "command", "vehicle", "p"),
            [f"return rates_of_user({arguments})"],
            *(kinds["state"], dynamics.rates),
            rates_of_user=dynamics.rates,
            Command=kinds["command"],
        ),
        look_up=generated(
            ("half_index", "state", "air", "p"), [f"return Found({', '.join(looked_up)})"], found, Found=found
        ),
        guide=generated(["found"], [f"return Noise({pushes}), ()"], tuple[noise, Nothing], Noise=noise) if q else None,
    )


def _directions(vectors):
    """Vectors of length 1, (..., size); those of zero stay."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def _times(rows, matrix):
    """Rows times a matrix by sums: a matrix product may round a row by its place among the others."""
    return sum(column[:, np.newaxis] * of for column, of in zip(rows.T, matrix, strict=True))
