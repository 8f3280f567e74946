"""Sensitivities as states of an optimal control problem, so that its cost may contain them (desensitized, Eqs. 5-6)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from marsedl.methods.collocation import Guess, Problem, Solution, Variable
from marsedl.methods.linearization import linearize_intervals, symbol_kind, symbols_in_numpy
from marsedl.methods.sensitivity import closed_loop, propagate_columns, scheme_responses, scheme_transitions


@dataclass(frozen=True)
class Perturbation:
    """A direction in which initial states and given parameters are perturbed, per unit of the perturbation."""

    name: str
    states: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Gain:
    """A constant feedback of a state's deviation to a control: control += unit * parameter * deviation.

    The parameter is free, within its bounds, and enters the sensitivities alone: the nominal has no deviation.
    """

    control: str
    state: str
    unit: float = 1.0
    lower: float = -inf
    upper: float = inf

    @property
    def parameter(self) -> str:
        """Name of the free parameter."""
        return f"{self.control}/{self.state}"


def column(state, perturbation) -> str:
    """Name of the state that holds d state / d perturbation."""
    return f"{state}/{perturbation}"


@dataclass(frozen=True)
class Desensitized:
    r"""A problem with sensitivities among its states (Eq. 5).

        $\dot{s} = \left( \frac{\partial f}{\partial y} + \frac{\partial f}{\partial u} K \right) s +
          \frac{\partial f}{\partial p} q, \quad s(0) = \text{direction of the perturbation}$

    They obey the problem's own transcription, which makes them the exact derivatives of the discrete flow; a gain K
    feeds back the deviation wherever the transcription evaluates the rates. Those that are always zero are left out.

    base: the problem; its cost is kept. perturbations: one for each column. scales: typical size of a state's
    sensitivity to a unit of a perturbation, 1 unless given. gains: feedback whose constant gains join the free
    parameters.

    `problem` has the additional states, by the names that `column` gives. Put a cost that uses them there by
    `dataclasses.replace(desensitized.problem, end_cost=...)`. Only CasADi can evaluate its rates.

    Raises ValueError for a perturbation, scale or gain of an unknown state, control or given parameter, for a
    perturbation that perturbs nothing, and for a name that stands twice.
    """

    base: Problem
    perturbations: tuple[Perturbation, ...]
    scales: Mapping[str, float] = field(default_factory=dict)
    gains: tuple[Gain, ...] = ()
    problem: Problem = field(init=False)

    def __post_init__(self):
        """Build the problem."""
        self._check()
        object.__setattr__(self, "problem", self._augmented())

    def _check(self):
        states, given = [v.name for v in self.base.states], self.base.given
        state_names = {name for p in self.perturbations for name in p.states} | {g.state for g in self.gains}
        for what, names, valid_names in (
            ("state", state_names | set(self.scales), states),
            ("given parameter", {name for p in self.perturbations for name in p.parameters}, given),
            ("control", {g.control for g in self.gains}, [v.name for v in self.base.controls]),
        ):
            unknown = sorted(names - set(valid_names))
            if unknown:
                raise ValueError(
                    f"{', '.join(unknown)}: no {what} of the problem, which has {', '.join(valid_names) or 'none'}"
                )
        if not self.perturbations:
            raise ValueError("perturbations: none")
        for perturbation in self.perturbations:
            if not any((*perturbation.states.values(), *perturbation.parameters.values())):
                raise ValueError(f"perturbation {perturbation.name}: perturbs nothing")

    def guess(
        self, guess: Guess | Solution, given: Mapping[str, float] | None = None, scheme: str = "midpoint"
    ) -> Guess:
        """Extend a guess for the base problem: sensitivities are propagated along it.

        Zeros instead would start the solver far from any solution.

        Args:
            guess: a `Guess`, taken to be on equal intervals, or a `Solution`. Gains it has no values for are zero.
            given: values of the given parameters; by default those of the solution.
            scheme: by which they are propagated; for a `Solution` it is its own.

        Returns:
            A guess for `problem`.

        Raises:
            ValueError: if a parameter of the base has no value or shapes do not fit.
        """
        base, steps = self.base, guess.final_time / max(len(guess.controls), 1)
        if isinstance(guess, Solution):
            given, steps, scheme, guess = given or guess.given, np.diff(guess.time), guess.scheme, guess.guess()
        values = {**guess.free, **(given or {})}
        parameter_names = [*(v.name for v in base.free), *base.given]
        missing = [name for name in parameter_names if name not in values]
        if missing:
            raise ValueError(f"{', '.join(missing)}: the guess needs a value")
        free = {v.name: guess.free.get(v.name, 0.0) for v in self.problem.free}
        sensitivity = self._propagated(guess, [values[name] for name in parameter_names], free, steps, scheme)
        histories = [sensitivity[:, row, number] for number, rows in enumerate(self._rows) for row in rows]
        return Guess(np.column_stack([guess.states, *histories]), guess.controls, guess.final_time, free)

    def columns(self, solution: Solution) -> np.ndarray:
        """Sensitivities of a solution of `problem`: nodes, states of the base, perturbations, (N + 1, n, m)."""
        n = len(self.base.states)
        sensitivity = np.zeros((len(solution.time), n, len(self.perturbations)))
        position = n
        for number, rows in enumerate(self._rows):
            sensitivity[:, rows, number] = solution.states[:, position : position + len(rows)]
            position += len(rows)
        return sensitivity

    def _propagated(self, guess, parameters, free, steps, scheme):
        base = self.base
        names, controls = [v.name for v in base.states], [v.name for v in base.controls]
        model = linearize_intervals(base.rates, guess.states, guess.controls, steps, scheme, parameters)
        gain = np.zeros((len(controls), len(names)))
        for item in self.gains:
            gain[controls.index(item.control), names.index(item.state)] += item.unit * free[item.parameter]
        open_loop, control = model.state_matrix, model.control_matrix
        matrix = closed_loop(
            open_loop.reshape(-1, *open_loop.shape[2:]), control.reshape(-1, *control.shape[2:]), gain
        ).reshape(open_loop.shape)
        initial = np.array([[p.states.get(name, 0.0) for p in self.perturbations] for name in names])
        direction = np.array([[p.parameters.get(name, 0.0) for p in self.perturbations] for name in base.given])
        responses = None
        if direction.any():
            fixed = len(parameters) - len(base.given)

            def of_parameters(*arguments):
                state, after_states = arguments[: len(names)], arguments[len(names) :]
                given, inner = after_states[: len(base.given)], after_states[len(base.given) :]
                return base.rates(*state, *inner[: len(controls)], *inner[len(controls) :], *given)

            values = np.broadcast_to(parameters[fixed:], (len(guess.controls), len(base.given)))
            controls_and_free = [*np.transpose(guess.controls), *parameters[:fixed]]
            forced = linearize_intervals(of_parameters, guess.states, values, steps, scheme, controls_and_free)
            responses = scheme_responses(scheme, matrix, forced.control_matrix @ direction, steps).sum(axis=1)
        return propagate_columns(scheme_transitions(scheme, matrix, steps), initial, responses)

    def _augmented(self):
        import casadi

        base, perturbations, gains = self.base, self.perturbations, self.gains
        names, controls = [v.name for v in base.states], [v.name for v in base.controls]
        parameter_names = [*(v.name for v in base.free), *base.given]
        kind = symbol_kind(base.rates, len(names) + len(controls) + len(parameter_names))
        x, u, p, k = (
            kind.sym(name, size)
            for name, size in (("x", len(names)), ("u", len(controls)), ("p", len(parameter_names)), ("k", len(gains)))
        )
        s, q = kind.sym("s", len(names)), kind.sym("q", len(parameter_names))
        with symbols_in_numpy(casadi):
            slopes_of_base = base.rates(*_scalars(x), *_scalars(u), *_scalars(p))
        if len(slopes_of_base) != len(names):
            raise ValueError(f"rates returned {len(slopes_of_base)} values for {len(names)} states")
        f = casadi.vertcat(*slopes_of_base)
        commanded = kind.zeros(len(controls))
        for number, gain in enumerate(gains):
            commanded[controls.index(gain.control)] += gain.unit * k[number] * s[names.index(gain.state)]
        slope = casadi.jtimes(f, casadi.vertcat(x, u, p), casadi.vertcat(s, commanded, q))
        both = casadi.Function("rates_and_slopes", [x, u, p, k, s, q], [f, slope])
        rows = self._nonzero_rows(casadi.jacobian(slope, s), casadi.jacobian(f, p), parameter_names)
        object.__setattr__(self, "_rows", rows)
        n, width, free = len(names), sum(map(len, rows)), len(base.free)

        def parted(arguments):
            """States, columns, controls, parameters of the base, gains."""
            ends = np.cumsum([n, width, len(controls), free, len(gains)])
            state, columns, control, free_parameters, gain, given = (
                arguments[a:b] for a, b in zip([0, *ends], [*ends, None], strict=True)
            )
            return state, columns, control, (*free_parameters, *given), gain

        def rates(*arguments):
            state, columns, control, parameters, gain = parted(arguments)
            remaining, slopes, f = iter(columns), [], None
            for perturbation, nonzero_rows in zip(perturbations, rows, strict=True):
                direction = [0.0] * n
                for row in nonzero_rows:
                    direction[row] = next(remaining)
                forcing = [perturbation.parameters.get(name, 0.0) for name in parameter_names]
                vectors = (casadi.vertcat(*v) for v in (state, control, parameters, gain, direction, forcing))
                f, slope = both(*vectors)
                slopes += [slope[int(row)] for row in nonzero_rows]
            return (*_scalars(f), *slopes)

        def of_base(function):
            """The function of the base's arguments as one of all."""

            def called(*arguments):
                state, _, control, parameters, _ = parted(arguments)
                return function(*state, *control, *parameters)

            return function and called

        added = [
            (
                column(names[row], perturbation.name),
                self.scales.get(names[row], 1.0),
                perturbation.states.get(names[row]),
            )
            for perturbation, nonzero_rows in zip(perturbations, rows, strict=True)
            for row in nonzero_rows
        ]
        return replace(
            base,
            rates=rates,
            states=(*base.states, *(Variable(name, scale) for name, scale, _ in added)),
            initial={**base.initial, **{name: value or 0.0 for name, _, value in added}},
            running_cost=of_base(base.running_cost),
            path=tuple(replace(c, expression=of_base(c.expression)) for c in base.path),
            free=(*base.free, *(Variable(g.parameter, 1.0, g.lower, g.upper) for g in gains)),
        )

    def _nonzero_rows(self, coupling, forcing, parameter_names):
        """Rows of every column that are not always zero: states that the perturbation affects, also through others."""
        import casadi

        coupled, forced = (np.array(casadi.DM(m.sparsity(), 1.0).full(), dtype=bool) for m in (coupling, forcing))
        rows = []
        for perturbation in self.perturbations:
            nonzero = np.array([perturbation.states.get(v.name, 0.0) != 0.0 for v in self.base.states])
            for name in perturbation.parameters:
                nonzero |= forced[:, parameter_names.index(name)]
            for _ in self.base.states:
                nonzero = nonzero | (coupled @ nonzero)
            rows.append(np.flatnonzero(nonzero))
        return tuple(rows)


def _scalars(vector):
    """Components of a CasADi vector, which may be empty."""
    import casadi

    return casadi.vertsplit(vector) if vector.numel() else []
