r"""Covariance steering of one's own vehicle: from its equations to a gain table that meets limits and a goal.

    law = steering.solve(rates, Vehicle(), np.linspace(0, 45, 16), start=(x0, P0), goal=(xf, Pf), limits=[...],
                         guess=u0)
    flown = law.flown(trials=20_000)     # what was asked of each limit and of the goal, predicted, and flown
    fly(law.model, ..., law=law.table)   # the law as `marsedl.fly` takes it

The mean command is held over each period, and the feedback is of the state where the period begins:

    $u_k = \bar{u}_k + K_k \left( x_k - \bar{x}_k \right)$

About the mean flight the integrator's own step is linearised (`methods.step_map`); the cone program of
`methods.covariance_steering.block_program` steers mean and covariance at once; both are repeated until commands and
their deviations stay. Its feedback is of all past states. As `noise` is white, the gain on the present state alone,
$K_k = \text{Cov}(u_k, x_k) P_k^{-1}$, does as well, and that is the law.

`noise` is white and of unit density here, as in flights: over a step of h seconds each of its components is normal with
the variance 1/h, so that a coefficient of it in `rates` has the unit of what it disturbs times s^(1/2).
"""

import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from marsedl.design.common import Limit, asked, declared, gain_table
from marsedl.design.pictures import Curve, over_time
from marsedl.fly import Flights, GainTable, Model, MultivariateNormal, fly
from marsedl.methods.covariance_steering import block_program
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.convexification import Step, successive_convexification
from marsedl.methods.covariance_steering.steering_program import (
    BlockSystem,
    HalfPlane,
    Percentile,
    SteeringProgram,
    margins,
    present_gains,
)
from marsedl.methods.lincov import propagate
from marsedl.methods.linear_system import LinearSystem
from marsedl.methods.step_map import VectorRates, in_vectors, linear_flight
from marsedl.methods.taylor import Series
from marsedl.models.correlations import correlations
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.summaries import summary
from marsedl.words import described, remedy, require

__all__ = ["Flown", "Iteration", "Law", "Unmet", "UnmetError", "solve"]

COSTS = ("effort", "fuel", "covariance")
ASKED = ("state", "command", "noise", "p", "time")  # what rates may ask for
NORMALS = 15  # 2^15 points stand for a normal distribution
ACTIVE = 1e-5  # excess of a constraint, over its size, above which it decides
NEAR_ACTIVE = 1e-3  # likewise, of a solution that violates constraints
NEAR = 0.9  # share of its bound that a norm's percentile reaches towards a side of the polytope before that counts
TRACE = 1e-10  # variance, of the largest one of a period's noise, that the design leaves out
LEAST = 1e-4  # share of the largest command by which fuel weighs one; weight of effort where covariance is the cost
SHOWN = 3.0  # deviations, in pictures
ROUNDING = 1e-7  # excess over a limit, of its value, that is the solver's
SAME = 1e-9  # difference, relative, that is rounding
ONE_SIGMA = 0.15865525393145707  # probability beyond one standard deviation
LINEAR = 0.03  # difference of flown and predicted deviations, relative, that counts as none


class Unmet(NamedTuple):
    """A limit or a part of the goal that cannot be met, where, and by how much at least."""

    what: str
    time: float  # s
    by: float  # in the unit of the quantity; of a deviation, relative to the one that is asked


class UnmetError(ValueError):
    """Goal and limits cannot be met together.

    `unmet` holds what fails, the worst first, if all may be violated, by as little as possible in sum.
    """

    unmet: tuple[Unmet, ...] = ()
    against: tuple[str, ...] = ()  # limits that decide where it fails, though they are met


class Iteration(NamedTuple):
    """How one cone program ended."""

    status: str  # of the solver, "infeasible" where the next nominal is the one that violates least
    iterations: int  # of the solver
    duality_gap: float
    primal_residual: float
    dual_residual: float
    change: float  # largest change of a command by it, in the command's unit
    cost: float  # of the flight that it designs


class Flown(NamedTuple):
    """What was asked, predicted and flown."""

    limits: Any  # data frame: limit, time of the node where it is violated most, asked, predicted, flown, lower, upper
    goal: Any  # data frame: quantity, mean and deviation at the end, each asked, predicted and flown
    flights: Flights

    def __repr__(self):
        """Both tables."""
        return f"{self.limits.to_string(index=False)}\n\n{self.goal.to_string(index=False)}"


@dataclass(frozen=True, eq=False)
class Law:
    """A designed law: mean command and gain of each period, and what they are predicted to make of the state."""

    time: np.ndarray  # bounds of the periods, (N + 1,), s
    command: np.ndarray  # mean, (N, m)
    gain: np.ndarray  # (N, m, n)
    state: np.ndarray  # mean, (N + 1, n)
    covariance: np.ndarray  # of the state, (N + 1, n, n)
    command_covariance: np.ndarray  # (N, m, m)
    cost: float  # the one that was minimized
    outcome: str  # "converged", "cycling" or "stopped" after the largest number of iterations
    iterations: tuple[Iteration, ...]
    active: dict[str, tuple[float, ...]]  # limits that decide, and when, s
    task: "_Task"

    __repr__ = summary

    @cached_property
    def table(self) -> GainTable:
        """The law for `marsedl.fly`: a table against the time, read where a period begins."""
        return gain_table(self.task.vectors.names, self.time[:-1], self.state[:-1], self.command, self.gain)

    @cached_property
    def model(self) -> Model:
        """The vehicle for `marsedl.fly`: the same `rates`."""
        from marsedl.montecarlo.flights import Flight

        vectors = self.task.vectors
        noise = {"noise": vectors.kinds["noise"]} if "noise" in vectors.kinds else {}
        return Model(Flight(vectors.rates, **noise), p=vectors.fixed.get("p", ()))

    def flown(self, trials=20_000, seed=0, **options) -> Flown:
        """Fly the law from dispersed starts under noise, without any linearisation.

        Args:
            trials, seed: of the flights. options: further ones of `fly`, such as processes or compiled=False.

        Returns:
            `Flown`. A flight that is not finite violates all limits. The probability of a limit is that at a node, and
            the node is shown at which most flights violate it, with their exact 95 % interval.

        Warns:
            UserWarning: where a deviation is another one than predicted, so that the flights are not linear enough.
        """
        import pandas as pd

        task, period = self.task, float(self.time[1])
        start = {task.vectors.names["state"]: MultivariateNormal(task.start[0], task.start[1])}
        given = {"end_time": float(self.time[-1]), "period": period, "substeps": task.substeps, "history": period}
        flights = fly(self.model, start, law=self.table, trials=trials, seed=seed, **given, **options)
        n, names = self.state.shape[1], task.vectors.names["state"]
        parts = {"state": flights.histories[:, :n], "command": flights.histories[:-1, n:]}
        limits = [self._violated(limit, parts[limit.part], trials) for limit in task.limits]
        columns = ["limit", "time", "asked", "predicted", "flown", "lower", "upper"]
        finite = np.isfinite(parts["state"]).all(axis=(0, 1))
        deviations = parts["state"][..., finite].std(axis=2, ddof=1)
        goal = {
            "quantity": names,
            "mean asked": task.goal[0],
            "mean predicted": self.state[-1],
            "mean flown": parts["state"][-1][:, finite].mean(axis=1),
            "deviation asked": np.full(n, np.nan) if task.goal[1] is None else np.sqrt(np.diag(task.goal[1])),
            "deviation predicted": self.deviation[-1],
            "deviation flown": deviations[-1],
        }
        allowed = (LINEAR + 3.0 / np.sqrt(2.0 * trials)) * self.deviation + 1e-9 * task.units[0]
        beyond = np.abs(deviations - self.deviation) / allowed
        node, worst = np.unravel_index(np.argmax(beyond), beyond.shape)
        if not beyond[node, worst] <= 1.0:
            warnings.warn(
                f"the deviation of {names[worst]} at {self.time[node]:g} s is {deviations[node, worst]:.4g} flown, "
                f"predicted are {self.deviation[node, worst]:.4g}: the vehicle is not linear over these dispersions",
                stacklevel=2,
            )
        return Flown(pd.DataFrame(limits, columns=columns), pd.DataFrame(goal), flights)

    def picture(self, units=None) -> Any:
        """Figure of matplotlib: states, commands and what limits are of over time, as predicted. units: by name."""
        names, band = self.task.vectors.names, f"mean $\\pm$ {SHOWN:g} deviations"
        commands = np.sqrt(np.diagonal(self.command_covariance, axis1=1, axis2=2))
        columns = [*zip(names["state"], self.state.T, self.deviation.T, strict=True)]
        columns += zip(names["command"], self.command.T, commands.T, strict=True)
        curves = [
            curve
            for name, mean, deviation in columns
            for curve in (Curve(name, "mean", self.time, mean), Curve(name, band, self.time, mean, SHOWN * deviation))
        ]
        for limit in self.task.limits:
            means, covariances = self._normal(limit)
            excess = [limit.excess(_normals(*of_node)) for of_node in zip(means, covariances, strict=True)]
            percentile = np.quantile(excess, 1.0 - limit.probability, axis=1)
            rows = ("mean", limit.excess(means.T), "-"), ("percentile asked for", percentile, "-.")
            for label, beyond, style in (*rows, ("limit", np.zeros(len(means)), "k--")):
                curves.append(Curve(limit.text, label, self.time, limit.value + limit.sign * beyond, style=style))
        return over_time(curves, units or {})

    @property
    def deviation(self) -> np.ndarray:
        """Predicted standard deviations of the state, (N + 1, n)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def _violated(self, limit, numbers, trials):
        """A row of the table of limits; numbers: flown, (nodes, numbers, trials)."""
        first = 1 if limit.part == "state" else 0
        counts = [int(np.count_nonzero(~limit.keeps(at))) for at in numbers[first:]]
        node = first + int(np.argmax(counts))
        means, covariances = self._normal(limit)
        predicted = np.mean(~limit.keeps(_normals(means[node], covariances[node])))
        lower, upper = binomial_interval(max(counts), trials)
        shown = (limit.probability, float(predicted), max(counts) / trials, float(lower), float(upper))
        return (limit.text, float(self.time[node]), *shown)

    def _normal(self, limit):
        """Means and covariances of what a limit is of, at all nodes."""
        of_state = (self.state, self.covariance)
        return of_state if limit.part == "state" else (self.command, self.command_covariance)


def solve(
    rates: Callable,
    p,
    times,
    *,
    start,
    goal,
    guess,
    limits=(),
    cost="effort",
    weights=None,
    end_time=None,
    substeps=4,
    iterations=30,
    tolerance=3e-3,
) -> Law:
    r"""Design mean command and feedback that bring a vehicle to a goal within limits on probabilities.

    Costs, with the period h and the weights R of the command:

        $\text{effort:} \quad \sum_k h \, \text{E} \, u_k^\top R u_k$
        $\text{fuel:} \quad \sum_k h \left( \text{E} \, u_k^\top R u_k \right)^{1/2} \ge \text{E} \sum_k h \left|
          u_k \right|_R$
        $\text{covariance:} \quad \max_i \sigma_i(t_N) / \sigma_i^\text{goal}$

    (the last over the components whose mean at the end is given, with a trace of effort that decides among equals).
    A limit holds for the linear model at the mean, and its bound is moved by what the quantity's percentile differs
    from that of its tangent over the predicted normal distribution. Norms, which a limit recognizes as such, have
    tangents in all directions: a polytope.

    Args:
        rates: `rates(state, command, noise, p, time) -> State`, which asks by name for what it needs, annotated with
            the NamedTuples of command and noise, as flights have it. Names of state and command differ.
        p: parameters, a NamedTuple, or () if rates asks for none.
        times: bounds of the periods, equally spaced from 0, (N + 1,), s; N is at least 2.
        start: mean (n,) and covariance (n, n) of the state, or its standard deviations (n,).
        goal: mean (n,), NaN where it is free, and the covariance (n, n) that the final one must not exceed, or its
            standard deviations (n,), or None.
        guess: mean command to begin with, (m,) or (N, m).
        limits: `Below` and `Above` of `marsedl.fly`: a function of `state` or of `command` by its argument's name, or
            the name of a number of either; a value; the probability of violation at any one node, within (0, 0.5).
            A limit of states holds at the ends of all periods.
        cost: "effort", "fuel" or "covariance".
        weights: R, (m, m), or its diagonal; by default the identity.
        end_time: (earliest, latest), s: times are stretched so that the end is the one of least cost between them.
        substeps: integration steps in a period. iterations: largest number of cone programs.
        tolerance: change of commands and their deviations that counts as none, in units of the command that, held,
            moves the state by one of its deviations without feedback.

    Returns:
        `Law`. It warns if the iteration has not converged.

    Raises:
        UnmetError: if goal and limits cannot be met together, with what fails, when, and by how much.
        ValueError: for a shape, a name, a number or a covariance that does not fit.
        RuntimeError: if the solver fails.
    """
    task, flight = _task(rates, p, times, start, goal, guess, limits, cost, weights, substeps)
    if end_time is None:
        return _solved(task, flight, iterations, tolerance)
    from scipy.optimize import minimize_scalar

    bounds = np.asarray(end_time, float)
    require(
        bounds.shape == (2,) and 0.0 < bounds[0] < bounds[1] < np.inf,
        f"end_time is {end_time!r}; give the earliest and the latest time of the end, s",
    )
    laws, unmet = {}, {}

    def cost_of(end):
        try:
            stretched = task._replace(times=task.times * (end / task.times[-1]))
            laws[end] = _solved(stretched, _flight(stretched, task.guess), iterations, tolerance)
        except UnmetError as error:
            unmet[end] = error
        return laws[end].cost if end in laws else np.inf

    options = {"xatol": 1e-3 * (bounds[1] - bounds[0])}
    with np.errstate(invalid="ignore"):  # differences of two that cannot be met
        minimize_scalar(cost_of, bounds=bounds, method="bounded", options=options)
    if not laws:
        raise unmet[max(unmet)]
    return min(laws.values(), key=lambda law: law.cost)


# ---- what is asked ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Limit(Limit):
    """A limit as a function that must not be positive."""

    kind: type  # NamedTuple of what it is of
    probability: float
    normals: np.ndarray  # of the sides of a norm's polytope, (sides, n)

    @property
    def part(self):
        """What it is of: "state" or "command"."""
        return self.asks[0]

    def excess(self, numbers):
        """Sign times quantity minus value; numbers: (n, ...)."""
        return self.sign * (_value(self, numbers) - self.value)

    def keeps(self, numbers):
        """Whether they are within the limit, or beyond it by the solver's rounding; not, if they are not finite."""
        return self.excess(numbers) <= ROUNDING * abs(self.value)


class _Task(NamedTuple):
    """What is asked, checked."""

    vectors: VectorRates
    times: np.ndarray
    start: tuple
    goal: tuple
    guess: np.ndarray  # (N, m)
    limits: tuple[_Limit, ...]
    cost: str
    weights: np.ndarray
    substeps: int
    units: tuple = ()  # of state (n,) and command (m,)


def _task(rates, p, times, start, goal, guess, limits, cost, weights, substeps):
    """What is asked, checked, and the flight of the guess. Raises ValueError as `solve`."""
    arguments = asked(rates)
    for name in arguments:
        require(
            name in ASKED,
            f"{described(rates)} asks for {name!r}, of which a design does not know; {remedy(name, ASKED)}; numbers of "
            "the nominal vehicle belong to p",
        )
    require("p" in arguments or p == (), f"{described(rates)} does not ask for p: give () in its place")
    require("command" in arguments, f"{described(rates)} asks for no command, so that nothing can be steered")
    vectors = in_vectors(rates, **({"p": p} if "p" in arguments else {}))
    names = vectors.names
    shared = sorted({*names["state"]} & {*names["command"]})
    require(not shared, f"state and command both have {', '.join(shared)}: give their numbers names that differ")
    n, m = len(names["state"]), len(names["command"])
    times = np.asarray(times, float)
    require(
        times.ndim == 1 and times.size >= 3 and times[0] == 0.0 and np.isfinite(times).all() and times[1] > 0.0,
        "times must increase from 0 s in two periods at least",
    )
    require(
        np.allclose(np.diff(times), times[1], rtol=1e-9, atol=0.0),
        "times must be equally spaced, as the periods of guidance are: give np.linspace(0.0, end, periods + 1)",
    )
    require(cost in COSTS, f"cost {cost!r} is unknown; {remedy(cost, COSTS)}")
    require(cost != "covariance" or goal[1] is not None, "cost 'covariance' needs the goal's covariance, its measure")
    weights = np.ones(m) if weights is None else weights
    weights = _array("weights", np.diag(weights) if np.ndim(weights) == 1 else weights, (m, m))
    correlations("weights", weights)
    ends = []
    for what, (mean, covariance), free in (("start", start, False), ("goal", goal, True)):
        mean = _array(f"{what}: mean", mean, (n,), free)
        if covariance is not None or what == "start":
            if np.ndim(covariance) == 1:
                deviations = _array(f"{what}: deviations", covariance, (n,))
                require((deviations >= 0.0).all(), f"{what}: deviations must not be negative, got {deviations}")
                covariance = np.diag(deviations**2)
            covariance = _array(f"{what}: covariance", covariance, (n, n))
            correlations(f"{what}: covariance", covariance, definite=free)
        ends.append((mean, covariance))
    guess = np.asarray(guess, float)
    require(
        guess.shape in ((m,), (len(times) - 1, m)) and np.isfinite(guess).all(),
        f"guess must be finite commands of shape ({m},) or ({len(times) - 1}, {m}): {', '.join(names['command'])}",
    )
    guess = np.broadcast_to(guess, (len(times) - 1, m))
    checked = tuple(_limit(number, limit, vectors) for number, limit in enumerate(limits))
    task = _Task(vectors, times, *ends, guess, checked, cost, weights, int(substeps))
    flight = _flight(task, guess)
    return task._replace(units=_units(task, flight[1])), flight


def _array(what, value, shape, free=False):
    value = np.asarray(value, float)
    require(value.shape == shape, f"{what} must have shape {shape}, not {value.shape}")
    finite = np.isfinite(value) | (np.isnan(value) if free else False)
    require(finite.all(), f"{what} must be finite{', or NaN where it is free' if free else ''}")
    return value


def _limit(number, limit, vectors):
    """A limit, checked."""
    kinds = {part: vectors.kinds[part] for part in ("state", "command")}
    members = {name: part for part, kind in kinds.items() for name in kind._fields}
    found, chance = declared(number, limit, members, kinds), limit.probability
    require(
        isinstance(chance, float) and 0.0 < chance < 0.5,
        f"limits[{number}]: its probability is {chance!r}; give that of its violation at a node, within (0, 0.5)",
    )
    only = f"limits[{number}]: {described(found.quantity)} must ask for `state` or for `command` alone"
    require(len(found.asks) == 1, only)
    kind = kinds[found.asks[0]]
    checked = _Limit(**vars(found), kind=kind, probability=chance, normals=np.zeros((0, len(kind._fields))))
    return replace(checked, normals=_sides(checked)) if found.sign > 0.0 else checked


def _value(limit, numbers):
    """The quantity of a limit; numbers: (n, ...), or Series."""
    try:
        return limit.quantity(limit.kind(*numbers)) + 0.0 * numbers[0]
    except ValueError as error:
        raise ValueError(
            f"{limit.text}: {error}; it is asked for many flights at once, so choose by select of marsedl.elementary"
        ) from None


def _tangents(limit, points):
    """Quantity (k,) and its gradients (k, n) at points (k, n)."""
    values, gradients = np.zeros(len(points)), np.zeros(points.shape)
    with np.errstate(all="ignore"):  # of a norm at zero
        for place in range(points.shape[1]):
            moved = [Series.along(column, float(row == place), 1) for row, column in enumerate(points.T)]
            values, gradients[:, place] = _value(limit, moved).coefficients
    return values, gradients


def _sides(limit):
    """Normals of the polytope that bounds a norm, (sides, n); none for another function.

    A norm is as large for -x as for x, and twice as large for 2 x. Tangents to it pass through the origin.
    """
    n = len(limit.kind._fields)
    points = np.random.default_rng(0).standard_normal((3, n)) * 10.0
    values, gradients = _tangents(limit, points)
    place = np.flatnonzero(gradients.any(axis=0))
    scaled = [_tangents(limit, factor * points)[0] for factor in (2.0, -1.0)]
    with np.errstate(invalid="ignore"):
        is_norm = np.allclose(scaled, [2.0 * values, values], rtol=1e-6, atol=0.0) and (values > 0.0).all()
    if not is_norm or place.size > 3:
        return np.zeros((0, n))
    directions = np.array([signs for signs in itertools.product((-1.0, 0.0, 1.0), repeat=place.size) if any(signs)])
    points = np.zeros((len(directions), n))
    points[:, place] = directions
    return _tangents(limit, 10.0 * points)[1]


# ---- the design ------------------------------------------------------------------------------------------------------


def _units(task, system):
    """Units of state and command: deviations without feedback, the commands that make these, and what they reach."""
    intervals, n, m = system.control.shape
    open_loop = propagate(system, np.zeros((intervals, m, n)), task.start[1]).covariance
    deviation = np.sqrt(np.diagonal(open_loop, axis1=1, axis2=2)).max(axis=0)
    reached, largest = np.zeros((n, m)), np.zeros((n, m))  # by commands of one, held throughout
    for across, effect in zip(system.transition, system.control, strict=True):
        reached = across @ reached + effect
        largest = np.maximum(largest, np.abs(reached))
    answered = (largest[deviation > 0.0] / deviation[deviation > 0.0, None]).max(axis=0, initial=0.0)
    require(
        largest.any(axis=0).all(),
        f"{', '.join(np.array(task.vectors.names['command'])[~largest.any(axis=0)])} acts on nothing along the guess",
    )
    command = np.where(answered > 0.0, 1.0 / np.where(answered > 0.0, answered, 1.0), 1.0)
    state = np.maximum(deviation, (largest * command).max(axis=1))
    return np.where(state > 0.0, state, 1.0), command


class _Design(NamedTuple):
    """A program about a nominal, its solution, and what follows from it."""

    program: SteeringProgram
    solution: Any  # `SteeringLaw`, in units
    failed: tuple  # margins of a program that cannot be met, of the solution that violates it least
    labels: tuple  # of its constraints in the order of margins: (what, time, unit)
    change: float


def _solved(task, flight, iterations, tolerance):
    """The law of a task whose times are fixed. flight: of the guess, see `_flight`."""
    period = task.times[1]
    state_unit, command_unit = task.units
    spread = np.zeros((*task.guess.shape, task.guess.shape[1]))  # covariances of the commands
    nodes = len(task.times)
    corrections = [_Correction(np.zeros(nodes), np.zeros((nodes, len(one.normals)), bool)) for one in task.limits]
    repeats = not task.limits and task.cost != "fuel"  # a program about another nominal of the same linear model
    done, solved_about = None, None  # the last step and its linear model

    def step(command):
        nonlocal spread, corrections, flight, done, solved_about
        states, model = flight
        if repeats and done and _agree(solved_about, model, state_unit):
            return done._replace(result=done.result._replace(change=0.0))
        design = _designed(task, states, model, command, spread, corrections)
        law = design.solution
        after, spread = law.control * command_unit, law.control_covariance * np.outer(command_unit, command_unit)
        deviations = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        means = {"state": states + law.mean * state_unit, "command": after}
        covariances = {"state": law.covariance * np.outer(state_unit, state_unit), "command": spread}
        corrections = [
            _corrected(limit, before, means[limit.part], covariances[limit.part])
            for limit, before in zip(task.limits, corrections, strict=True)
        ]
        monitored = np.concatenate([(after / command_unit).ravel(), (deviations / command_unit).ravel()])
        flight, solved_about = _flight(task, after), model
        done = Step(after, monitored, design._replace(change=float(np.abs(after - command).max())))
        return done

    run = successive_convexification(
        step, task.guess, iterations=iterations, tolerances=np.full(2 * task.guess.size, tolerance)
    )
    last = run.results[-1]
    if last.failed:
        raise _unmet(task, last)
    if run.outcome != "converged":
        warnings.warn(
            f"the design is {run.outcome} after {len(run.results)} iterations, of which the last one changed a command "
            f"by {last.change:.3g}: give more iterations, a better guess or a larger tolerance",
            stacklevel=3,
        )
    command, (states, system) = run.control[-1], flight
    gain = present_gains(last.program.system, last.solution) * command_unit[:, None] / state_unit
    predicted = propagate(system, gain, task.start[1])
    effort = _efforts(task, command, predicted.control_covariance)
    log = [
        Iteration(
            "infeasible" if one.failed else one.solution.status,
            one.solution.iterations,
            one.solution.duality_gap,
            one.solution.primal_residual,
            one.solution.dual_residual,
            one.change,
            one.solution.objective,
        )
        for one in run.results
    ]
    active: dict[str, tuple] = {}
    with np.errstate(invalid="ignore"):  # of a command that does not vary
        every = margins(last.program, last.solution)
    for margin, (what, time, _) in zip(every, last.labels, strict=True):
        if margin.excess > -ACTIVE and margin.kind != "final mean" and time not in active.get(what, ()):
            active[what] = (*active.get(what, ()), time)
    total = {
        "effort": period * np.sum(effort),
        "fuel": period * np.sum(np.sqrt(effort)),
        "covariance": last.solution.percentile,
    }[task.cost]
    return Law(task.times, command, gain, states, *predicted, float(total), run.outcome, tuple(log), active, task)


def _agree(model, other, unit):
    """Whether two linear models are the same, as those of a linear vehicle are; unit: of states, for rounding."""
    derivatives = all(map(np.array_equal, model[:3], other[:3]))  # of states, commands and noise
    return derivatives and (np.abs(model.affine - other.affine) <= SAME * unit).all()


def _flight(task, command):
    """The mean flight of a mean command, and its linear model."""
    try:
        return linear_flight(task.vectors, task.start[0], command, task.times[1], task.substeps)
    except (ValueError, ArithmeticError) as error:
        raise ValueError(f"{error}; give another guess of the command, or shorter times") from None


def _efforts(task, command, covariance):
    """E u'Ru of each period, (N,)."""
    return np.einsum("ij,kij->k", task.weights, command[:, :, None] * command[:, None, :] + covariance)


def _designed(task, states, system, command, spread, corrections):
    """The program in units about a nominal, solved, or solved with the least violations."""
    state_unit, command_unit = task.units
    n, last = len(state_unit), len(command)
    start, (mean, covariance) = task.start, task.goal
    noise = np.array([_without_traces(part / np.outer(state_unit, state_unit)) for part in system.noise])
    deviating = LinearSystem(
        system.transition * state_unit / state_unit[:, None],
        system.control * command_unit / state_unit[:, None],
        noise,
        -np.einsum("kij,kj->ki", system.control, command) / state_unit,
        system.time,
    )
    states_limited, commands_limited, labels = [], [], {"state": [], "command": []}
    for limit, correction in zip(task.limits, corrections, strict=True):
        unit = task.units[limit.part == "command"]
        points = states if limit.part == "state" else command
        planes = states_limited if limit.part == "state" else commands_limited
        for node, normal, bound in _planes(limit, correction.near, points):
            # About the nominal are deviations of states, but whole commands.
            bound -= correction.moved[node] + (normal @ points[node] if limit.part == "state" else 0.0)
            planes.append(HalfPlane(node, normal * unit, bound, limit.probability))
            labels[limit.part].append((limit.text, float(task.times[node]), 1.0))
    names, end_time = task.vectors.names["state"], float(task.times[-1])
    end = [(f"goal, mean of {names[i]}", end_time, state_unit[i]) for i in np.flatnonzero(~np.isnan(mean))]
    end += [] if covariance is None else [("goal, covariance", end_time, 1.0)]
    effort = np.outer(command_unit, command_unit) * task.weights
    share = np.full(last, task.times[1])
    if task.cost == "fuel":
        # The tangent of the root of the effort from above: the same minimum where the iteration ends.
        size = np.sqrt(_efforts(task, command, spread))
        share = share / (2.0 * np.maximum(size, LEAST * size.max())) if size.any() else share
    share = share * (LEAST / np.trace(effort) / task.times[-1] if task.cost == "covariance" else 1.0)
    percentiles = ()
    if task.cost == "covariance":
        rows = np.eye(n)[~np.isnan(mean)] * (state_unit / np.sqrt(np.diag(covariance)))
        miss = np.nan_to_num(mean - states[-1]) / state_unit
        percentiles = tuple(Percentile(row, -row @ miss, ONE_SIGMA) for row in rows)
    program = SteeringProgram(
        BlockSystem.of(deviating, np.zeros(n), start[1] / np.outer(state_unit, state_unit)),
        np.zeros((last, n, n)),
        share[:, None, None] * effort,
        share[:, None, None] * effort,
        state_constraints=tuple(states_limited),
        control_constraints=tuple(commands_limited),
        final_mean=None if np.isnan(mean).all() else (mean - states[-1]) / state_unit,
        final_covariance=None if covariance is None else covariance / np.outer(state_unit, state_unit),
        percentiles=percentiles,
        percentile_weight=float(bool(percentiles)),
    )
    labels = (*labels["state"], *labels["command"], *end)
    try:
        # What is white cannot be predicted, however unequal its parts are.
        return _Design(program, block_program.solve(program, accept_ill_conditioned=True), (), labels, np.nan)
    except block_program.InfeasibleProgram as error:
        if error.law is None:
            raise
        return _Design(program, error.law, error.margins, labels, np.nan)


def _without_traces(covariance):
    """A covariance, without directions whose variance is rounding and would be answered by gains without bound."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.where(values > TRACE * values[-1], values, 0.0) @ vectors.T


class _Correction(NamedTuple):
    """What the last iteration's normal distributions say of a limit."""

    moved: np.ndarray  # by how much its bound is tightened at the nodes, (nodes,)
    near: np.ndarray  # which sides of a norm's polytope count there, as they come near, (nodes, sides)


def _planes(limit, near, points):
    """Half planes of a limit: node, normal and bound in the user's units; tangents, and a norm's sides that are near.

    Raises ValueError where a derivative is not finite.
    """
    values, gradients = _tangents(limit, points)
    for node in range(1 if limit.part == "state" else 0, len(points)):
        value, gradient = values[node], gradients[node]
        finite = np.isfinite(value) and np.isfinite(gradient).all()
        require(finite or len(limit.normals), f"{limit.text}: not finite at node {node}, value or derivative")
        if finite and gradient.any():
            normal = limit.sign * gradient
            yield node, normal, float(limit.sign * (limit.value - value) + normal @ points[node])
        for side in limit.normals[near[node]]:
            yield node, side, limit.value


def _corrected(limit, before, means, covariances):
    """The bound is moved by the percentile of the quantity minus that of its tangents; sides that came near stay."""
    nodes, level = len(means), 1.0 - limit.probability
    spread = np.sqrt(np.maximum(np.einsum("si,kij,sj->ks", limit.normals, covariances, limit.normals), 0.0))
    reach = means @ limit.normals.T + upper_quantile(limit.probability) * spread
    near = before.near.copy()
    near[:nodes] |= reach > NEAR * limit.value
    moved, planes = np.zeros(len(near)), {}
    for node, normal, bound in _planes(limit, near, means):
        planes.setdefault(node, []).append((normal, bound))
    for node, tangents in planes.items():
        numbers = _normals(means[node], covariances[node])
        excess, linear = limit.excess(numbers), [normal @ numbers - bound for normal, bound in tangents]
        if np.abs(excess - linear[0]).max() > SAME * np.ptp(excess) or len(linear) > 1:
            moved[node] = np.quantile(excess, level) - max(np.quantile(side, level) for side in linear)
    return _Correction(moved, near)


def _normals(mean, covariance):
    """Points that stand for a normal distribution, (n, points)."""
    values, vectors = np.linalg.eigh(covariance)
    return mean[:, None] + vectors * np.sqrt(np.maximum(values, 0.0)) @ _standard_normals(len(mean))


@cache
def _standard_normals(n):
    """Points that stand for n independent standard normals, (n, points)."""
    from scipy.special import ndtri
    from scipy.stats.qmc import Sobol

    return ndtri(Sobol(n, rng=np.random.default_rng(0)).random_base2(NORMALS)).T


def _unmet(task, design):
    """The error that says what cannot be met."""
    unmet, against = {}, set()
    for margin, (what, time, unit) in zip(design.failed, design.labels, strict=True):
        by = np.sqrt(margin.value) - 1.0 if margin.kind == "final covariance" else (margin.value - margin.limit) * unit
        if margin.excess > ACTIVE and by > unmet.get((what, time), (0.0, 0.0))[1]:
            unmet[what, time] = margin.excess, float(by)
        elif abs(margin.excess) < NEAR_ACTIVE and what.startswith("limits"):
            against.add(what)
    ordered = sorted(unmet, key=lambda key: -unmet[key][0])
    failed = tuple(Unmet(what, time, unmet[what, time][1]) for what, time in ordered)
    said = [
        f"{one.what} at {one.time:g} s fails by {one.by:.3g}" + " of the deviation" * ("covariance" in one.what)
        for one in failed[:4]
    ]
    rest = f", and {len(ordered) - 4} more" if len(ordered) > 4 else ""
    decide = tuple(sorted(against - {what for what, _ in ordered}))
    reason = f", against {' and '.join(decide)}" if decide else ""
    error = UnmetError(f"goal and limits cannot be met together: {'; '.join(said)}{rest}{reason}")
    error.unmet, error.against = failed, decide
    return error
