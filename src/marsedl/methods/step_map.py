"""The function that flies, as functions of vectors, and the exact derivatives of the step by which it flies.

    capsule = in_vectors(rates, look_up, command=Bank, vehicle=vehicle, air=air, p=p)
    linear_model = linearize(capsule, states, commands)             # of the rates
    states, system = linear_flight(capsule, start, commands, period=1.0, substeps=4)    # of the integrator's steps

`rates` and `look_up` are those of `montecarlo.flights`. CasADi differentiates what it can trace, Taylor series the
rest: tables that are looked up, branches, what depends on time.
"""

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from marsedl.methods.lincov import compose
from marsedl.methods.linear_system import LinearSystem
from marsedl.methods.linearization import symbol_kind, symbols_in_numpy
from marsedl.methods.taylor import Series
from marsedl.stepping import runge_kutta_4
from marsedl.summaries import summary
from marsedl.words import described, require

__all__ = ["StepMap", "VectorRates", "in_vectors", "linear_flight", "step_map"]

VECTORS = ("state", "command", "noise")  # in this order; other parts that vary follow


class VectorRates(NamedTuple):
    """Rates as a function of numbers: those of the state, of the command, of the noise, and of what else varies."""

    rates: Callable
    look_up: Callable | None
    kinds: dict[str, type]  # NamedTuples of the parts that vary, in order
    fixed: dict[str, Any]  # the other arguments

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Names of the numbers, in order, by part."""
        return {part: kind._fields for part, kind in self.kinds.items()}

    @property
    def changes_with_time(self) -> bool:
        """Whether rates or tables ask for the time, or for their place on the half-step grid."""
        asked = {*_asked(self.rates), *(_asked(self.look_up) if self.look_up else ())}
        return bool(asked & {"time", "half_index"})

    def __call__(self, *numbers, time=0.0, half_index=0) -> tuple:
        """Rates of the state, from numbers, arrays, symbols of CasADi or Taylor series.

        Args:
            numbers: of all parts that vary. time: s. half_index: half steps since the start of the flight.

        Returns:
            Tuple of one rate for each number of the state.
        """
        offered, first = self.fixed | {"time": time, "half_index": half_index}, 0
        for part, kind in self.kinds.items():
            offered[part] = kind(*numbers[first : first + len(kind._fields)])
            first += len(kind._fields)
        if self.look_up is not None:
            offered["found"] = self.look_up(*(offered[name] for name in _asked(self.look_up)))
        return tuple(self.rates(*(offered[name] for name in _asked(self.rates))))


def in_vectors(rates, look_up=None, **parts) -> VectorRates:
    """Rates of named parts, as flights have them, as a function of numbers.

    The state's NamedTuple is what `rates` is annotated to return; that of the command is its annotation, unless given.

    Args:
        rates: `rates(state, command, noise, found, ...) -> State`, which asks for its arguments by name.
        look_up: `look_up(state, ...)`, whose result `rates` asks for as `found`.
        parts: of every other argument its value; or its NamedTuple, if it varies: `noise=Gusts`.

    Returns:
        `VectorRates`.

    Raises:
        ValueError: for an argument of which neither value nor NamedTuple is known, or a part that nobody asks for.
    """
    hints, asked = get_type_hints(rates), [*_asked(rates), *(_asked(look_up) if look_up else ())]
    known = {"state": hints.get("return")} | {name: hints[name] for name in ("command", "noise") if name in hints}
    known |= parts
    for name in parts:
        require(name in asked, f"{described(rates)} does not ask for {name!r}: leave it out")
    for name in asked:
        provided = name in ("time", "half_index") or (name == "found" and look_up is not None)
        require(
            provided or known.get(name) is not None,
            f"{described(rates)} asks for {name!r}, which is not known: annotate it, or give {name}=... (a NamedTuple "
            "whose numbers vary, or a value)",
        )
    order = (*VECTORS, *(name for name in parts if name not in VECTORS))
    kinds = {name: known[name] for name in order if name in asked and isinstance(known.get(name), type)}
    kinds = {"state": known["state"]} | kinds
    return VectorRates(rates, look_up, kinds, {name: part for name, part in parts.items() if name not in kinds})


class StepMap(NamedTuple):
    """A step from one point: where it ends, and the derivatives of that by the parts that vary."""

    end: np.ndarray  # (n,)
    by: dict[str, np.ndarray]  # by part: (n, numbers of the part)

    __repr__ = summary


def step_map(rates: VectorRates, step: float) -> Callable[..., StepMap]:
    """The integrator's step with command and noise held, and its exact derivatives.

    It is the Runge-Kutta step of flights (`stepping.runge_kutta_4`). White noise is held, too: over the step it is its
    increment over h, of the variance 1 / h.

    Args:
        rates: `in_vectors`. step: h, s.

    Returns:
        Function (numbers of all parts that vary; half_index=0) -> `StepMap`.

    Raises:
        ValueError: if the step is not positive.
    """
    require(step > 0.0, f"step must be positive, not {step}")
    sizes = {part: len(names) for part, names in rates.names.items()}
    count, n = sum(sizes.values()), sizes["state"]
    columns = np.split(np.arange(count), np.cumsum([*sizes.values()])[:-1])

    def advance(numbers, half_index=0):
        state, held = numbers[:n], numbers[n:]

        def slope(halves, at):
            here = half_index + halves
            return rates(*at, *held, time=0.5 * step * here, half_index=here)

        return runge_kutta_4(slope, state, step)

    traced = None if rates.changes_with_time else _traced(advance, count)

    def at(numbers, half_index=0):
        numbers = [float(number) for number in numbers]
        require(len(numbers) == count, f"{len(numbers)} numbers do not fit the {count} of {', '.join(sizes)}")
        end = np.array(advance(numbers, half_index), float)
        if traced is None:
            matrix = _by_series(lambda moved: advance(moved, half_index), numbers)
        else:
            matrix = traced(numbers).full()
        return StepMap(end, {part: matrix[:, of] for part, of in zip(sizes, columns, strict=True)})

    return at


def linear_flight(rates: VectorRates, start, commands, period, substeps=1):
    """Fly a nominal with held commands and without noise, and linearise each period about it.

    Args:
        rates: `in_vectors`, of which state, command and noise vary; the noise is white and of unit density.
        start: state at the start, (n,). commands: held over the periods, (N, m); m may be 0.
        period: s. substeps: integrator's steps in it.

    Returns:
        States at the bounds of the periods, (N + 1, n), and their `LinearSystem`: x and u are the whole state and
        command, not deviations.

    Raises:
        ValueError: as `step_map`; if shapes do not fit, or a number or derivative is not finite.
    """
    step, commands = period / substeps, np.asarray(commands, float)
    map_at, names = step_map(rates, step), rates.names
    n, m, q = (len(names.get(part, ())) for part in VECTORS)
    require(commands.ndim == 2 and commands.shape[1] == m, f"commands must have shape (N, {m}), not {commands.shape}")
    state, still = np.asarray(start, float), np.zeros(q)
    require(state.shape == (n,), f"start must have shape ({n},), not {state.shape}")
    states, rows = [state], []
    for number, command in enumerate(np.repeat(commands, substeps, axis=0)):
        one = map_at([*state, *command, *still], 2 * number)
        across, effect, pushed = (one.by.get(part, np.zeros((n, 0))) for part in VECTORS)
        rest = one.end - across @ state - effect @ command
        require(
            np.isfinite(across).all() and np.isfinite(rest).all(), f"not finite in step {number}: state or derivative"
        )
        rows.append((across, effect, pushed @ pushed.T / step, rest))
        state = one.end
        states.append(state)
    fine = LinearSystem(*map(np.array, zip(*rows, strict=True)), step * np.arange(len(states)))
    return np.array(states)[::substeps], compose(fine, np.arange(0, len(rows), substeps))


def _asked(function):
    return inspect.signature(function).parameters


def _traced(function, count):
    """The derivatives of a function of numbers as one of CasADi; None if it cannot be traced."""
    import casadi

    try:
        symbols = symbol_kind(lambda *numbers: function(numbers), count).sym("numbers", count)
        with symbols_in_numpy(casadi):
            end = casadi.vertcat(*function(casadi.vertsplit(symbols)))
    except TypeError:  # a branch, or a table
        return None
    return casadi.Function("derivatives", [symbols], [casadi.densify(casadi.jacobian(end, symbols))])


def _by_series(function, numbers):
    """The derivatives of a function of numbers by Taylor series of the first order, (outputs, numbers)."""
    columns = []
    for place, number in enumerate(numbers):
        moved = [*numbers[:place], Series.along(number, 1.0, 1), *numbers[place + 1 :]]
        columns.append([output.coefficients[1] if isinstance(output, Series) else 0.0 for output in function(moved)])
    return np.array(columns, float).T
