"""The best trajectory of one's own vehicle: from its equations to commands that are held, flown again as they fly.

    best = optimal(rates, Lander(), start=State(...), goal=State(...), time=(30.0, 90.0),
                   objective=lambda command: norm(command), limits=[Below(lambda command: norm(command), 16e3)],
                   guess=(0.0, 0.0, 7e3))
    best.states.mass[-1], best.commands, best.miss

`rates` is that of flights (`montecarlo.flights`), and so is whatever it asks for; `noise` is zero here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from marsedl.design.common import Limit, answer, asked, declared
from marsedl.design.pictures import Curve, over_time
from marsedl.fly.declared import is_number
from marsedl.methods.collocation import Condition, Guess, Problem, Program, Solution, Variable
from marsedl.methods.linearization import symbol_kind, symbols_in_numpy
from marsedl.methods.step_map import VectorRates, in_vectors
from marsedl.stepping import runge_kutta_4
from marsedl.summaries import summary
from marsedl.words import described, remedy, require

__all__ = ["Reference", "Task", "fly_held", "optimal"]

ROUNDING = 1e-9  # relative, by which an end may violate a limit


def optimal(
    rates,
    p,
    start,
    goal,
    time,
    objective,
    limits=(),
    guess=None,
    *,
    intervals=50,
    scheme="hermite_simpson",
    scales=None,
    substeps=4,
    **parts,
) -> "Reference":
    """The trajectory of the least objective from a start to a goal within limits, by direct collocation.

    Args:
        rates: `rates(state, command, noise, vehicle, p, ...) -> State` of a flight, which asks by name and which CasADi
            can trace; its annotations tell the NamedTuples of state and command.
        p: parameters, or None for `rates` that ask for none.
        start: numbers of the state, in its order. goal: likewise; what is NaN is free.
        time: at which the goal is reached, s; or (lowest, highest), between which it is chosen.
        objective: function of `state`, `command` or the parts of the model, as it asks by name, whose integral over the
            time is to be least; or of `end`, the state at the end; or "time".
        limits: `Below` and `Above` of `marsedl.fly`, of a state's or command's name or of a function of `state` or
            `command`. They hold at all nodes.
        guess: where the search starts: commands, held throughout (numbers, in their order) or for each interval (N, m),
            under which states are flown that the goal leaves free; or a `Reference` of the same vehicle.
        intervals: N, of equal length, over which commands are held. scheme: one of `methods.collocation.SCHEMES`.
        scales: typical sizes of states and commands by name, where those of start, goal and guess are none. A command
            that has the name of a state is `command.x` here and in limits.
        substeps: the integrator's steps in an interval, when the commands are flown again.
        parts: what else `rates` asks for: `vehicle=...`, `look_up=...`, `noise=Gusts` where it is not annotated.

    Returns:
        `Reference`.

    Raises:
        ValueError: for a name, a shape, a number or a limit that is wrong, or an end that violates a limit.
        NotConvergedError: if no solution is found, with the constraint that is violated most.
        TypeError: for a branch that cannot be traced, with file and line.
    """
    require(
        isinstance(intervals, int | np.integer) and intervals >= 1,
        f"intervals is {intervals!r}; give a whole number from 1 on",
    )
    parts |= {} if p is None else {"p": p}
    task = _declared(in_vectors(rates, **parts), start, goal, time, objective, limits)
    commands = task.commands(guess, intervals)
    task = task._replace(scales=task.scaled(commands, scales or {}))
    middle = float(np.sqrt(task.time[0] * task.time[1]))
    program = Program(task.problem(), intervals, scheme)
    if isinstance(guess, Reference):
        return task.reference(program.solve(guess.solution.guess(intervals)), substeps)
    # What the goal leaves free goes where the guess leads, all else straight to the goal.
    flown = fly_held(task.vectors, task.start, commands, np.linspace(0.0, middle, intervals + 1), substeps)
    led = np.isnan(task.goal) & np.isfinite(flown).all(axis=0)
    line = np.linspace(task.start, np.where(np.isnan(task.goal), task.start, task.goal), intervals + 1)
    return task.reference(program.solve(Guess(np.where(led, flown, line), commands, middle)), substeps)


class Task(NamedTuple):
    """What is asked of a trajectory, checked."""

    vectors: VectorRates
    start: Any  # NamedTuple of the state
    goal: Any  # likewise, NaN where it is free
    time: tuple[float, float]
    objective: Callable
    limits: tuple[Limit, ...]
    scales: Mapping[str, float]

    @property
    def names(self):
        """Names of states and commands; of a command that is called like a state, "command.x"."""
        states, commands = self.vectors.names["state"], self.vectors.names["command"]
        return (*states, *(f"command.{name}" if name in states else name for name in commands))

    def part_with(self, name) -> str:
        """The part of the model, such as p, that has a number of this name. Raises ValueError if none has."""
        parts = self.vectors.fixed.items()
        holders = {member: part for part, value in parts for member in getattr(value, "_fields", ())}
        require(name in holders, f"{name!r} is no number of the model's parts; {remedy(name, holders)}")
        return holders[name]

    def number(self, name) -> float:
        """A number of the model's parts by name."""
        return float(getattr(self.vectors.fixed[self.part_with(name)], name))

    def with_numbers(self, names, values) -> VectorRates:
        """The rates with other values of these numbers of the model's parts."""
        fixed = dict(self.vectors.fixed)
        for name, value in zip(names, values, strict=True):
            part = self.part_with(name)
            fixed[part] = fixed[part]._replace(**{name: value})
        return self.vectors._replace(fixed=fixed)

    def commands(self, guess, intervals):
        """Commands of a guess, (N, m), those of no guess being zero. Raises ValueError for other shapes."""
        names = self.vectors.names["command"]
        given = guess.solution.guess(intervals).controls if isinstance(guess, Reference) else guess
        given = np.zeros(len(names)) if given is None else np.asarray(given, float)
        shape = (intervals, len(names))
        require(
            given.shape in (shape[1:], shape) and np.isfinite(given).all(),
            f"guess must be finite commands, {', '.join(names)}, of shape {shape[1:]} or {shape}",
        )
        return np.broadcast_to(given, shape)

    def scaled(self, commands, scales):
        """Typical sizes by name: those that are given; of commands those of the guess, or its largest for zeros; of
        states those of start and goal, or for zeros what their rates at the start come to; else 1.
        """
        for name in scales:
            require(name in self.names, f"scales: {name!r} is neither state nor command; {remedy(name, self.names)}")
        calm = [0.0] * len(self.vectors.names.get("noise", ()))
        come_to = self.time[1] * np.abs(self.vectors(*self.start, *commands[0], *calm))
        of_states, of_commands = np.fmax(np.abs(self.start), np.abs(self.goal)), np.abs(commands).max(axis=0)
        sizes = np.append(
            np.where(of_states > 0.0, of_states, come_to), np.where(of_commands > 0.0, of_commands, of_commands.max())
        )
        found = {name: float(size) or 1.0 for name, size in zip(self.names, sizes, strict=True)}
        return found | scales

    def problem(self, uncertain=(), unused=()) -> Problem:
        """The problem as `methods.collocation` takes it.

        uncertain: numbers of the model's parts that are given to each solve. unused: what is given for other purposes.
        Raises ValueError for an uncertain one that is no number of the parts.
        """
        count, calm = len(self.names), [0.0] * len(self.vectors.names.get("noise", ()))

        def model(numbers):
            return self.with_numbers(uncertain, numbers[count : count + len(uncertain)])

        def offered(numbers):
            state, command = numbers[: len(self.start)], numbers[len(self.start) : count]
            named = {"state": type(self.start)(*state), "command": self.vectors.kinds["command"](*command)}
            return model(numbers).fixed | named

        def rates(*numbers):
            return model(numbers)(*numbers[:count], *calm)

        def running_cost(*numbers):
            return answer(self.objective, offered(numbers))

        def end_cost(start, end, given):
            state = type(self.start)(*(end[name] for name in self.start._fields))
            return answer(self.objective, self.vectors.fixed | {"end": state})

        def condition(limit):
            bounds = (-np.inf, limit.value) if limit.sign > 0.0 else (limit.value, np.inf)
            return Condition(limit.text, lambda *numbers: limit.of(offered(numbers)), *bounds, abs(limit.value) or 1.0)

        at_end = "end" in asked(self.objective)
        variables = [Variable(name, self.scales[name]) for name in self.names]
        return Problem(
            rates=rates,
            states=tuple(variables[: len(self.start)]),
            controls=tuple(variables[len(self.start) :]),
            final_time=Variable("final_time", self.time[1], *self.time),
            initial=self.start._asdict(),
            final={name: value for name, value in self.goal._asdict().items() if not np.isnan(value)},
            running_cost=None if at_end else running_cost,
            end_cost=end_cost if at_end else None,
            path=tuple(map(condition, self.limits)),
            given=(*uncertain, *unused),
        )

    def reference(self, solution: Solution, substeps) -> "Reference":
        """What was found, flown again."""
        state, command = type(self.start), self.vectors.kinds["command"]
        flown = fly_held(self.vectors, self.start, solution.controls, solution.time, substeps)
        return Reference(
            time=solution.time,
            states=state(*solution.states.T[: len(self.start)]),
            commands=command(*solution.controls.T),
            objective=solution.objective,
            status=solution.status,
            iterations=solution.iterations,
            flown=state(*flown.T),
            miss=state(*(flown[-1] - np.array(self.goal))),
            solution=solution,
            task=self,
            substeps=substeps,
        )


def _declared(vectors, start, goal, time, objective, limits) -> Task:
    """Check what is asked; arguments and errors as of `optimal`."""
    rates, kinds = described(vectors.rates), vectors.kinds
    require("command" in kinds, f"{rates} takes no command: let it ask for 'command', which is chosen")
    require(not vectors.changes_with_time, f"{rates} or its look_up asks for the time: make it a state whose rate is 1")
    start, goal = _named(kinds["state"], start, "start"), _named(kinds["state"], goal, "goal")
    require(np.isfinite(start).all(), f"start is {start}; all of its numbers must be given, and finite")
    require(not np.isinf(goal).any(), f"goal is {goal}; give finite numbers, or NaN for what is free")
    low, high = time if np.ndim(time) == 1 and len(time) == 2 else (time, time)
    require(
        is_number(low) and is_number(high) and 0.0 < low <= high,
        f"time is {time!r}; give the seconds until the goal, or (lowest, highest), both positive",
    )
    objective = (lambda: 1.0) if objective == "time" else objective
    require(callable(objective), f"objective is {objective!r}; give a function, or 'time'")
    offered = ("state", "command", *vectors.fixed)
    for name in asked(objective):
        valid = ("end", *vectors.fixed) if "end" in asked(objective) else (*offered, "end")
        require(name in valid, f"{described(objective)} asks for {name!r}; {remedy(name, valid)}")
    task = Task(vectors, start, goal, (float(low), float(high)), objective, (), {})
    members = {name: "state" if name in start._fields else "command" for name in task.names}
    bounds = tuple(declared(number, given, members, offered) for number, given in enumerate(limits))
    for limit, (what, state) in product(bounds, (("start", start), ("goal", goal))):
        if "command" not in limit.asks and np.isfinite(state).all():
            value = float(limit.of(vectors.fixed | {"state": state}))
            holds = limit.sign * (value - limit.value) <= ROUNDING * max(1.0, abs(value))
            require(holds, f"{what} violates {limit.text}, and it is {value:.6g} there")
    return task._replace(limits=bounds)


@dataclass(frozen=True, eq=False)
class Reference:
    """An optimal trajectory, and what its commands came to when they were flown again."""

    time: np.ndarray  # bounds of the intervals, (N + 1,), s
    states: Any  # NamedTuple of the state, each (N + 1,)
    commands: Any  # NamedTuple of the command, each (N,), held from one bound to the next
    objective: float
    status: str  # of the solver
    iterations: int  # of the solver
    flown: Any  # states when the commands are flown by the integrator of flights, each (N + 1,)
    miss: Any  # flown less asked at the end, by name, NaN where the goal is free
    solution: Solution  # of `methods.collocation`
    task: Task
    substeps: int

    __repr__ = summary

    def picture(self, units=None) -> Any:
        """Figure of matplotlib: states as planned and as flown again, and commands, over time. units: by name."""
        planned = zip(self.task.names, [*self.states, *self.commands], strict=True)
        flown = zip(self.states._fields, self.flown, strict=True)
        curves = [Curve(name, "planned", self.time, values) for name, values in planned]
        curves += [Curve(name, "flown again", self.time, values, style="--") for name, values in flown]
        return over_time(curves, units or {})


def fly_held(rates: VectorRates, start, commands, time, substeps=4, gains=None, states=None) -> np.ndarray:
    """Fly held commands without noise by the integrator of flights, with feedback where an interval begins or without.

    Args:
        rates: `in_vectors`, not of the time. start: (n,). commands: (N, m). time: bounds of the intervals, (N + 1,), s.
        substeps: the integrator's steps in each. gains: (m, n), on deviations from `states`, (N + 1, n).

    Returns:
        States at the bounds, (N + 1, n).
    """
    import casadi

    n, m, calm = len(start), commands.shape[1], [0.0] * len(rates.names.get("noise", ()))
    kind = symbol_kind(lambda *numbers: rates(*numbers, *calm), n + m)
    x, u, nominal, h = kind.sym("x", n), kind.sym("u", m), kind.sym("nominal", n), kind.sym("h")
    with symbols_in_numpy(casadi):
        after = runge_kutta_4(lambda _, at: rates(*at, *casadi.vertsplit(u), *calm), casadi.vertsplit(x), h)
    step = casadi.Function("step", [x, u, h], [casadi.vertcat(*after)])
    state, held = x, u if gains is None else u + casadi.mtimes(casadi.DM(gains), x - nominal)
    for _ in range(substeps):
        state = step(state, held, h)
    interval = casadi.Function("interval", [x, u, nominal, h], [state])
    about = np.zeros((len(commands), n)) if states is None else states[:-1]
    flown = interval.mapaccum(len(commands))(start, commands.T, about.T, np.diff(time) / substeps)
    return np.vstack([start, flown.full().T])


def _named(kind, given, what):
    """Numbers as a NamedTuple of the state. Raises ValueError for another number of them."""
    names = kind._fields
    require(
        np.shape(given) == (len(names),),
        f"{what} must be {len(names)} numbers, {', '.join(names)}, not of shape {np.shape(given)}",
    )
    return kind(*map(float, given))
