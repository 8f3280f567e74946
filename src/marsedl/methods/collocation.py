r"""Optimal control by direct collocation: a problem as a declaration, transcribed once, solved from many guesses.

    $\text{minimise} \quad \int \text{running_cost} \, dt + \text{end_cost}$
    $\text{subject to} \quad \dot{x} = \text{rates}(x, u, \text{parameters}), \quad \text{bounds and conditions}$

Controls are constant on each interval, so that a solution can be flown as it is. The transcriptions differ in how the
rates enter an interval of length $h$ from $x_0$ to $x_1$ ($f_0$, $f_\text{m}$, $f_1$: rates at its start, middle and
end); the integral of the running cost is approximated in the same way:

    $\text{midpoint:} \quad x_1 - x_0 = h f\left( \frac{x_0 + x_1}{2} \right) \quad \text{(order 2)}$
    $\text{trapezoid:} \quad x_1 - x_0 = \frac{h}{2} (f_0 + f_1) \quad \text{(order 2)}$
    $\text{hermite_simpson:} \quad x_1 - x_0 = \frac{h}{6} (f_0 + 4 f_\text{m} + f_1), \quad x_\text{m} =
      \frac{x_0 + x_1}{2} + \frac{h}{8} (f_0 - f_1) \quad \text{(order 4)}$
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import count
from math import inf
from typing import NamedTuple

import numpy as np

from marsedl.methods.checks import require_one_of
from marsedl.methods.linearization import symbols_in_numpy
from marsedl.summaries import summary

_MOST_EVALUATIONS = 100_000  # of the rates in one interval of a simulation, some hundred times what a smooth one takes
SCHEMES = ("midpoint", "trapezoid", "hermite_simpson")
HESSIANS = ("exact", "limited-memory")
SOLVED, ACCEPTABLE = "Solve_Succeeded", "Solved_To_Acceptable_Level"


# ---- the declaration -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Variable:
    """A state, a control, a free parameter or the final time: its name, its typical size, its bounds."""

    name: str
    scale: float = 1.0
    lower: float = -inf
    upper: float = inf


@dataclass(frozen=True)
class Condition:
    """An expression that must stay between bounds; equal bounds demand a value. The scale is its typical size.

    As a boundary condition it is `expression(start, end)`, each a mapping of states by name; as a path condition
    `expression(*states, *controls, *parameters)`, held at every node with the controls of the interval that begins
    there (at the last node of the one that ends there).
    """

    name: str
    expression: Callable
    lower: float = 0.0
    upper: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Problem:
    """An optimal control problem. Its equations are plain functions that CasADi can trace: arithmetic and `np.*`.

    rates: `rates(*states, *controls, *parameters)`, one rate per state. running_cost: a number, of the same arguments.
    end_cost: `end_cost(start, end, parameters)`, each a mapping by name. Parameters are the `free` ones, which the
    solver chooses, then the `given` ones, whose values come with each solve. initial, final: values of states by name
    that are fixed there. Equal bounds of the final time fix it.

    Raises ValueError, naming the variable or condition, for bounds the wrong way round, a scale that is not positive,
    a name that stands twice or is unknown, and a fixed value outside of its bounds.
    """

    rates: Callable
    states: tuple[Variable, ...]
    controls: tuple[Variable, ...]
    final_time: Variable
    initial: Mapping[str, float] = field(default_factory=dict)
    final: Mapping[str, float] = field(default_factory=dict)
    running_cost: Callable | None = None
    end_cost: Callable | None = None
    boundary: tuple[Condition, ...] = ()
    path: tuple[Condition, ...] = ()
    free: tuple[Variable, ...] = ()
    given: tuple[str, ...] = ()

    def __post_init__(self):
        """Refuse a declaration that cannot be meant."""
        variables = (*self.states, *self.controls, *self.free, self.final_time)
        for item in (*variables, *self.boundary, *self.path):
            if not item.lower <= item.upper:
                raise ValueError(f"{item.name}: bounds are the wrong way round, {item.lower:g} to {item.upper:g}")
            if item.lower == inf or item.upper == -inf:
                raise ValueError(f"{item.name}: no number lies in its bounds, {item.lower:g} to {item.upper:g}")
            if not (item.scale > 0.0 and np.isfinite(item.scale)):
                raise ValueError(f"{item.name}: the scale must be positive and finite, got {item.scale:g}")
        if not self.final_time.lower > 0.0:
            raise ValueError(f"{self.final_time.name}: must be bounded from below by a positive number")
        for what, names in (
            ("variable and parameter", [*(item.name for item in variables), *self.given]),
            ("condition", [item.name for item in (*self.boundary, *self.path)]),
        ):
            repeated = sorted({name for name in names if names.count(name) > 1})
            if repeated:
                raise ValueError(f"{', '.join(repeated)}: each {what} needs a name of its own")
        states = {state.name: state for state in self.states}
        for end, fixed in (("initial", self.initial), ("final", self.final)):
            for name, value in fixed.items():
                if name not in states:
                    raise ValueError(f"{end} value of '{name}': there is no such state; states: {', '.join(states)}")
                if not states[name].lower <= value <= states[name].upper:
                    raise ValueError(
                        f"{end} value of {name}, {value:g}, lies outside of its bounds, "
                        f"{states[name].lower:g} to {states[name].upper:g}"
                    )


class Guess(NamedTuple):
    """Where a solve starts: states (N + 1, n) at the nodes, controls (N, m), final time, free parameters."""

    states: np.ndarray
    controls: np.ndarray
    final_time: float
    free: Mapping[str, float] = {}

    __repr__ = summary


class Residual(NamedTuple):
    """The constraint that a point violates most: its name, where, and by how much in its own unit."""

    name: str
    where: str
    value: float

    def __str__(self):
        """Say it in words."""
        place = f"{self.name} {self.where}".strip()
        return f"{place}, not finite" if np.isnan(self.value) else f"{place}, off by {self.value:.3g}"


@dataclass(frozen=True)
class Solution:
    """What a solve came to.

    Bounds and conditions hold up to about 1e-8 of their scale, by which the solver widens them.

    Every multiplier is the derivative of the optimal objective with respect to what its constraint demands, in the
    units of the problem. A costate is d(objective)/d(addition to the change of the state over the interval), which is
    d(objective)/d(state in its middle) up to second order in its length. The multiplier of a condition is
    d(objective)/d(its active bound): negative at an upper bound, positive at a lower one, zero in between.
    """

    problem: Problem
    scheme: str
    time: np.ndarray  # (N + 1,)
    states: np.ndarray  # (N + 1, n)
    controls: np.ndarray  # (N, m)
    free: Mapping[str, float]
    given: Mapping[str, float]
    objective: float
    running_cost: float  # its integral
    status: str
    iterations: int
    residual: Residual
    costates: np.ndarray  # (N, n), multipliers of the intervals' equations
    boundary_multipliers: Mapping[str, float]

    __repr__ = summary

    @property
    def final_time(self) -> float:
        """End of the trajectory."""
        return float(self.time[-1])

    def state(self, name):
        """History of a state at the nodes, (N + 1,)."""
        return self.states[:, [variable.name for variable in self.problem.states].index(name)]

    def guess(self, intervals=None) -> Guess:
        """This solution as a guess, on the intervals of another `Program` (by default its own mesh)."""
        if intervals is None:
            return Guess(self.states, self.controls, self.final_time, self.free)
        time = _mesh(intervals) * self.final_time
        states = np.column_stack([np.interp(time, self.time, history) for history in self.states.T])
        within = np.searchsorted(self.time, (time[1:] + time[:-1]) / 2.0) - 1
        return Guess(states, self.controls[within], self.final_time, self.free)


class NotConvergedError(RuntimeError):
    """A solve that came to no solution; `solution` is its last iterate."""

    def __init__(self, solution):
        """Take the last iterate."""
        super().__init__(
            f"the solver ended with {solution.status} after {solution.iterations} iterations, at objective "
            f"{solution.objective:.6g}; the worst constraint is {solution.residual}"
        )
        self.solution = solution


class BranchEndError(RuntimeError):
    """A continuation that could not go on: `reached` is the last value on the branch, `solution` the solution there.

    `beyond` is what the solver found next, on another branch, or None if it found nothing.
    """

    def __init__(self, name, reached, target, solution, beyond):
        """Take what happened."""
        super().__init__(f"the branch ends between {name} = {reached:.6g} and {target:.6g}")
        self.reached, self.target, self.solution, self.beyond = reached, target, solution, beyond


# ---- transcription ---------------------------------------------------------------------------------------------------


def _mesh(intervals):
    """Nodes as fractions from 0 to 1, of how many equal intervals or of such fractions."""
    if np.ndim(intervals) == 0:
        if not (intervals >= 1 and intervals == int(intervals)):
            raise ValueError(f"intervals: their number must be whole and positive, got {intervals}")
        return np.linspace(0.0, 1.0, int(intervals) + 1)
    mesh = np.array(intervals, dtype=float)
    if mesh.ndim != 1 or len(mesh) < 2 or mesh[0] != 0.0 or mesh[-1] != 1.0 or not (np.diff(mesh) > 0.0).all():
        raise ValueError("intervals: as a mesh they must increase from 0 to 1")
    return mesh


def _midpoint(rates, x0, x1, h):
    return h * rates((x0 + x1) / 2.0)


def _trapezoid(rates, x0, x1, h):
    return h * (rates(x0) + rates(x1)) / 2.0


def _hermite_simpson(rates, x0, x1, h):
    f0, f1 = rates(x0), rates(x1)
    middle = (x0 + x1) / 2.0 + h * (f0 - f1)[: x0.shape[0]] / 8.0
    return h * (f0 + 4.0 * rates(middle) + f1) / 6.0


_STEPS = dict(zip(SCHEMES, (_midpoint, _trapezoid, _hermite_simpson), strict=True))


class Program:
    """A problem transcribed on a mesh, ready to be solved for any given parameters from any guess.

    problem: the declaration. intervals: how many equal ones, or the mesh as increasing fractions from 0 to 1.
    scheme: one of `SCHEMES`. hessian: one of `HESSIANS`, the latter the solver's own approximation. expand: trace the
    equations of an interval into scalar operations, which solves several times faster; equations that CasADi can trace
    only as a whole need expand=False.
    """

    def __init__(self, problem, intervals, scheme="midpoint", *, hessian="exact", expand=True):
        """Transcribe; see the class.

        Raises ValueError for an unknown scheme or hessian, a mesh that does not increase, equations that use an unknown
        name, rates that are not one per state, and a condition or cost that is not one number.
        """
        for option, word, choices in (("scheme", scheme, SCHEMES), ("hessian", hessian, HESSIANS)):
            require_one_of(option, word, choices)
        self.problem, self.mesh, self.scheme, self.hessian = problem, _mesh(intervals), scheme, hessian
        self._equations = _Equations(problem, scheme, expand)
        self._solvers = {}
        self._layout()

    def _layout(self):
        """Lay out variables and constraints of the nonlinear program."""
        import casadi

        problem, eq = self.problem, self._equations
        n, m, intervals = len(problem.states), len(problem.controls), len(self.mesh) - 1
        self._scales = {
            name: np.array([v.scale for v in group])
            for name, group in (("state", problem.states), ("control", problem.controls), ("free", problem.free))
        }
        states = casadi.MX.sym("states", n, intervals + 1)
        controls = casadi.MX.sym("controls", m, intervals)
        free = casadi.MX.sym("free", len(problem.free))
        duration = casadi.MX.sym("duration")
        given = casadi.MX.sym("given", len(problem.given))
        x = states * self._scales["state"]
        u = controls * self._scales["control"]
        parameters = casadi.vertcat(free * self._scales["free"], given)
        total = duration * problem.final_time.scale
        lengths = total * np.diff(self.mesh)[np.newaxis]

        steps = eq.interval.map(intervals)(x[:, :-1], x[:, 1:], u, lengths, casadi.repmat(parameters, 1, intervals))
        defects, running_costs = steps
        objective = casadi.sum2(running_costs)
        constraints = [casadi.vec(defects / self._scales["state"])]
        if problem.boundary:
            scale = np.array([c.scale for c in problem.boundary])
            constraints.append(eq.boundary(x[:, 0], x[:, -1]) / scale)
        if problem.path:
            scale = np.array([c.scale for c in problem.path])
            at_nodes = casadi.horzcat(u, u[:, -1])
            values = eq.path.map(intervals + 1)(x, at_nodes, casadi.repmat(parameters, 1, intervals + 1))
            constraints.append(casadi.vec(values / scale))
        if problem.end_cost is not None:
            objective += eq.end_cost(x[:, 0], x[:, -1], parameters)
        self._sizes = (n * (intervals + 1), m * intervals, len(problem.free))
        variables = casadi.vertcat(casadi.vec(states), casadi.vec(controls), free, duration)
        self._program = {"x": variables, "p": given, "f": objective, "g": casadi.vertcat(*constraints)}
        self._values = casadi.Function(
            "values", [variables, given], [objective, casadi.sum2(running_costs), self._program["g"]]
        )
        self._bounds()

    def _bounds(self):
        problem, intervals = self.problem, len(self.mesh) - 1
        limits = []
        for side in ("lower", "upper"):
            states = np.tile([[getattr(v, side) / v.scale] for v in problem.states], intervals + 1)
            for node, fixed in ((0, problem.initial), (-1, problem.final)):
                for row, variable in enumerate(problem.states):
                    if variable.name in fixed:
                        states[row, node] = fixed[variable.name] / variable.scale
            control_limits = [getattr(v, side) / v.scale for v in (*problem.controls * intervals, *problem.free)]
            last = getattr(problem.final_time, side) / problem.final_time.scale
            limits.append(np.concatenate([states.ravel(order="F"), control_limits, [last]]))
        self._lower, self._upper = limits
        bounds = [
            np.concatenate(
                [
                    np.zeros(len(problem.states) * intervals),
                    [getattr(c, side) / c.scale for c in problem.boundary],
                    np.tile([getattr(c, side) / c.scale for c in problem.path], intervals + 1),
                ]
            )
            for side in ("lower", "upper")
        ]
        self._least, self._most = bounds

    def _solver(self, options):
        """The solver for these options, made once."""
        import casadi

        key = tuple(sorted(options.items()))
        if key not in self._solvers:
            settings = {f"ipopt.{name}": value for name, value in options.items()}
            quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "error_on_fail": False}
            # NaN in a trial point is the line search's business; it steps back from it.
            quiet |= {"show_eval_warnings": False, "ipopt.hessian_approximation": self.hessian}
            # The solver's own acceptable level would let equations be violated by a percent.
            quiet |= {"ipopt.acceptable_constr_viol_tol": 1e-6, "ipopt.acceptable_dual_inf_tol": 1e-2}
            self._solvers[key] = casadi.nlpsol("collocation", "ipopt", self._program, quiet | settings)
        return self._solvers[key]

    def solve(
        self,
        guess,
        given: Mapping[str, float] | None = None,
        *,
        barrier=None,
        tolerance=1e-8,
        iterations=500,
        accept=(SOLVED,),
    ) -> Solution:
        """Solve from a guess.

        Args:
            guess: a `Guess` on this program's mesh, or a `Solution` of it.
            given: values of the given parameters, by name.
            barrier: initial barrier parameter, decreased monotonically, for starts near a solution; the solver's
                adaptive rule, which may leave the guess's neighbourhood, if not given.
            tolerance, iterations: of the solver.
            accept: the solver's words for an end that is accepted.

        Returns:
            `Solution`.

        Raises:
            NotConvergedError: if the solver ends otherwise; it holds the last iterate.
            ValueError: for a guess of another size or with values that are not finite or missing, and given parameters
                that are not those of the problem or not finite.
        """
        given = dict(given or {})
        if set(given) != set(self.problem.given):
            raise ValueError(
                f"given parameters must be {', '.join(self.problem.given) or 'none'}; got {', '.join(given) or 'none'}"
            )
        for name, value in given.items():
            if not np.isfinite(value):
                raise ValueError(f"given parameter {name}: must be finite, got {value:g}")
        options = {"tol": float(tolerance), "max_iter": int(iterations)}
        if barrier is None:
            options["mu_strategy"] = "adaptive"
        else:
            options |= {"mu_strategy": "monotone", "mu_init": float(barrier)}
        solver = self._solver(options)
        result = solver(
            x0=self._packed(guess),
            p=[given[name] for name in self.problem.given],
            lbx=self._lower,
            ubx=self._upper,
            lbg=self._least,
            ubg=self._most,
        )
        solution = self._solution(result, given, solver.stats())
        if solution.status not in accept:
            raise NotConvergedError(solution)
        return solution

    def _packed(self, guess):
        """The solver's variables for a guess."""
        if isinstance(guess, Solution):
            guess = guess.guess()
        expected = (len(self.mesh), len(self.problem.states)), (len(self.mesh) - 1, len(self.problem.controls))
        shapes = np.shape(guess.states), np.shape(guess.controls)
        if shapes != expected:
            raise ValueError(f"the guess's states and controls must have shapes {expected}, got {shapes}")
        missing = [v.name for v in self.problem.free if v.name not in guess.free]
        if missing:
            raise ValueError(f"the guess has no value of the free parameter {', '.join(missing)}")
        parts = {
            "states": np.asarray(guess.states, dtype=float) / self._scales["state"],
            "controls": np.asarray(guess.controls, dtype=float) / self._scales["control"],
            "free parameters": np.array([guess.free[v.name] / v.scale for v in self.problem.free]),
            "final time": np.array([guess.final_time / self.problem.final_time.scale]),
        }
        for name, part in parts.items():
            if not np.isfinite(part).all():
                raise ValueError(f"the guess's {name}: not all finite")
        return np.concatenate([part.ravel() for part in parts.values()])

    def _unpacked(self, values):
        """States (N + 1, n), controls (N, m), free parameters and duration of the solver's variables."""
        problem, ends = self.problem, np.cumsum(self._sizes)
        states, controls, free, duration = np.split(values, ends)
        return (
            states.reshape(len(self.mesh), len(problem.states)) * self._scales["state"],
            controls.reshape(len(self.mesh) - 1, len(problem.controls)) * self._scales["control"],
            free * self._scales["free"],
            duration[0] * problem.final_time.scale,
        )

    def _solution(self, result, given, stats):
        problem = self.problem
        values, multipliers = (result[name].full().ravel() for name in ("x", "lam_g"))
        # The solver's own values are those of the last point that it could evaluate, if any.
        objective, running, constraints = self._values(values, [given[name] for name in problem.given])
        states, controls, free, duration = self._unpacked(values)
        count = len(self.mesh) - 1
        split = count * len(problem.states)
        # The Lagrangian is objective + multipliers (constraints - demanded): raising a demand by one costs -multiplier.
        of_intervals, at_ends, _ = np.split(-multipliers, [split, split + len(problem.boundary)])
        return Solution(
            problem=problem,
            scheme=self.scheme,
            time=duration * self.mesh,
            states=states,
            controls=controls,
            free={v.name: float(value) for v, value in zip(problem.free, free, strict=True)},
            given=given,
            objective=float(objective),
            running_cost=float(running),
            status=stats["return_status"],
            iterations=int(stats["iter_count"]),
            residual=self._worst(values, constraints.full().ravel(), duration),
            costates=of_intervals.reshape(count, len(problem.states)) / self._scales["state"],
            boundary_multipliers={
                c.name: float(value / c.scale) for c, value in zip(problem.boundary, at_ends, strict=True)
            },
        )

    def _worst(self, values, constraints, duration) -> Residual:
        """The constraint or bound that is violated most, relative to its scale."""
        problem = self.problem
        constraints = np.where(np.isfinite(constraints), constraints, np.nan)
        excess = np.concatenate(
            [
                np.maximum(self._least - constraints, constraints - self._most),
                np.maximum(self._lower - values, values - self._upper),
            ]
        )
        worst = int(np.argmax(np.where(np.isnan(excess), inf, excess)))
        count = len(self.mesh) - 1

        def labelled():
            for k in range(count):
                for v in problem.states:
                    yield f"the equation of {v.name}", f"on interval {k} at {duration * self.mesh[k]:.4g} s", v.scale
            for c in problem.boundary:
                yield c.name, "at the boundary", c.scale
            for k in range(count + 1 if problem.path else 0):
                for c in problem.path:
                    yield c.name, f"at {duration * self.mesh[k]:.4g} s", c.scale
            for k in range(count + 1):
                for v in problem.states:
                    yield f"the bound of {v.name}", f"at {duration * self.mesh[k]:.4g} s", v.scale
            for k in range(count):
                for v in problem.controls:
                    yield f"the bound of {v.name}", f"at {duration * self.mesh[k]:.4g} s", v.scale
            for v in (*problem.free, problem.final_time):
                yield f"the bound of {v.name}", "", v.scale

        name, where, scale = next(label for index, label in enumerate(labelled()) if index == worst)
        return Residual(name, where, float(max(excess[worst], 0.0) * scale))

    def follow(
        self,
        start: Solution,
        name: str,
        values: Iterable[float],
        *,
        same_branch: Callable[[Solution, Solution], bool] = lambda before, after: True,
        smallest_step=1e-3,
        retries=True,
        on_step: Callable[[Solution], None] = lambda solution: None,
        **options,
    ) -> list[Solution]:
        """Continue a solution in one given parameter, with shorter steps where the solver loses the branch.

        Args:
            start: where to begin; its other given parameters are kept.
            name: the parameter. values: its target values, in order.
            same_branch: whether a solution belongs to the branch of the one before it.
            smallest_step: share of the step between two target values at which the branch is taken to end.
            retries: whether a value at which another branch was found is tried again from nearer, before the last step.
            on_step: called with every solution on the branch, those in between included.
            options: of `solve`; barrier 1e-4 unless given.

        Returns:
            One `Solution` for each target value.

        Raises:
            BranchEndError: if the branch ends, with the last solution on it and the first beyond.
            ValueError: if the parameter is not one of the given ones.
        """
        if name not in self.problem.given:
            raise ValueError(f"'{name}' is not a given parameter; these are {', '.join(self.problem.given) or 'none'}")
        options = {"barrier": 1e-4} | options
        solutions, last = [], start
        for target in values:
            position = origin = last.given[name]
            step, beyond, jumped = target - origin, None, np.inf
            while position != target:
                trial = target if abs(target - position) <= abs(step) else position + step
                can_halve = abs(trial - position) > smallest_step * abs(target - origin)
                if can_halve and abs(trial - origin) >= jumped:  # a step to there has left the branch
                    step = (trial - position) / 2.0
                    continue
                try:
                    beyond = self.solve(last, {**start.given, name: trial}, **options)
                except NotConvergedError:
                    beyond = None
                if beyond is not None and same_branch(last, beyond):
                    last, position, step = beyond, trial, 2.0 * step
                    jumped = jumped if abs(trial - origin) < jumped else np.inf
                    on_step(last)
                elif can_halve:
                    step = (trial - position) / 2.0
                    jumped = jumped if retries or beyond is None else abs(trial - origin)
                else:
                    raise BranchEndError(name, position, trial, last, beyond)
            solutions.append(last)
        return solutions


class _Equations:
    """The problem's equations as CasADi functions: of an interval, of the ends, of a node."""

    def __init__(self, problem, scheme, expand):
        import casadi

        kind = casadi.SX if expand else casadi.MX
        n, m = len(problem.states), len(problem.controls)
        names = [v.name for v in problem.states]
        parameter_names = [*(v.name for v in problem.free), *problem.given]
        x0, x1 = kind.sym("x0", n), kind.sym("x1", n)
        u, p, h = kind.sym("u", m), kind.sym("p", len(parameter_names)), kind.sym("h")
        controls_and_parameters = casadi.vertsplit(u) + (casadi.vertsplit(p) if parameter_names else [])

        def number(name, value):
            if not kind(value).is_scalar():
                raise ValueError(f"{name}: must be one number, got {kind(value).numel()}")
            return value

        def with_cost(state):
            arguments = [*casadi.vertsplit(state), *controls_and_parameters]
            cost = problem.running_cost(*arguments) if problem.running_cost else 0.0
            return casadi.vertcat(_rates(problem, arguments), number("running_cost", cost))

        with symbols_in_numpy(casadi):
            change = _STEPS[scheme](with_cost, x0, x1, h)
            self.interval = casadi.Function("interval", [x0, x1, u, h, p], [x1 - x0 - change[:n], change[n]])
            ends = [_Named(zip(names, casadi.vertsplit(x), strict=True)) for x in (x0, x1)]
            if problem.boundary:
                values = [number(c.name, c.expression(*ends)) for c in problem.boundary]
                self.boundary = casadi.Function("boundary", [x0, x1], [casadi.vertcat(*values)])
            if problem.path:
                values = [
                    number(c.name, c.expression(*casadi.vertsplit(x0), *controls_and_parameters)) for c in problem.path
                ]
                self.path = casadi.Function("path", [x0, u, p], [casadi.vertcat(*values)])
            if problem.end_cost is not None:
                parameters = _Named(zip(parameter_names, casadi.vertsplit(p) if parameter_names else [], strict=True))
                cost = number("end_cost", problem.end_cost(*ends, parameters))
                self.end_cost = casadi.Function("end_cost", [x0, x1, p], [cost])


class _Named(dict):
    """Values by name; an unknown name raises an error that lists the valid ones."""

    def __missing__(self, name):
        raise ValueError(f"there is no '{name}'; there are {', '.join(self) or 'none'}")


def _rates(problem, arguments):
    """The rates as a CasADi vector."""
    import casadi

    rates = problem.rates(*arguments)
    if not isinstance(rates, tuple | list) or len(rates) != len(problem.states):
        description = f"{len(rates)} values" if isinstance(rates, tuple | list) else "no tuple"
        raise ValueError(f"rates must return one value per state: {description} for {len(problem.states)} states")
    return casadi.vertcat(*rates)


# ---- simulation ------------------------------------------------------------------------------------------------------


def simulate(problem, initial, controls, time, parameters=(), *, relative_tolerance=1e-11, absolute_tolerance=1e-9):
    """Fly controls that are constant on intervals by an adaptive method of order eight (DOP853).

    Args:
        problem: its rates are used, and the scales of its states.
        initial: states at the start, (n,).
        controls: (N, m). time: nodes, (N + 1,).
        parameters: values of the free, then of the given parameters.
        relative_tolerance, absolute_tolerance: of each step, the latter in units of the states' scales.

    Returns:
        States at the nodes, (N + 1, n).

    Raises:
        RuntimeError: if the integration fails, or does not come on.
        ValueError: if shapes do not fit.
    """
    import casadi
    from scipy.integrate import solve_ivp

    n, m, given = len(problem.states), len(problem.controls), len(problem.free) + len(problem.given)
    shapes = np.shape(initial), np.shape(controls), np.shape(parameters)
    expected = (n,), (len(time) - 1, m), (given,)
    if shapes != expected:
        raise ValueError(f"initial states, controls and parameters must have shapes {expected}, got {shapes}")
    x, u = casadi.MX.sym("x", n), casadi.MX.sym("u", m)
    with symbols_in_numpy(casadi):
        arguments = [*casadi.vertsplit(x), *casadi.vertsplit(u), *parameters]
        rates = casadi.Function("rates", [x, u], [_rates(problem, arguments)])
    scales = np.array([v.scale for v in problem.states])
    states = [np.asarray(initial, dtype=float)]
    for control, start, end in zip(controls, time[:-1], time[1:], strict=True):
        evaluations = count()

        def slopes(_, y, held_control=control, since=start, evaluations=evaluations):
            if next(evaluations) == _MOST_EVALUATIONS:
                raise RuntimeError(f"flying the controls from {since:g} s on failed: the steps become ever shorter")
            return rates(y, held_control).full().ravel()

        if not np.isfinite(rates(states[-1], control).full()).all():  # on which the integrator would not end
            raise RuntimeError(f"flying the controls from {start:g} s on failed: the rates there are not finite")
        integration = solve_ivp(
            slopes,
            (start, end),
            states[-1],
            method="DOP853",
            rtol=relative_tolerance,
            atol=absolute_tolerance * scales,
        )
        if not integration.success:
            raise RuntimeError(f"flying the controls from {start:g} s on failed: {integration.message}")
        states.append(integration.y[:, -1])
    return np.array(states)


def resimulate(solution: Solution, **tolerances) -> np.ndarray:
    """Fly a solution's controls from its initial state, see `simulate`; returns states at the nodes, (N + 1, n)."""
    parameters = [*solution.free.values(), *(solution.given[name] for name in solution.problem.given)]
    return simulate(solution.problem, solution.states[0], solution.controls, solution.time, parameters, **tolerances)
