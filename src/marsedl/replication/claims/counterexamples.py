"""Counterexamples: what has to be changed, and by how much, until a verdict is another one.

A claim names one field of its records, or one input, and how it is changed:

    @claim(counterexample=shifted("closed_loop.final_state", component="mass"))
    @claim(counterexample=spread("closed_loop.final_state", component="downrange"))
    @claim(counterexample=scaled("gains.gain"))
    @claim(counterexample=blended("closed_loop.covariance", "open_loop"))
    @claim(counterexample=replaced("certificates.solver_status", "infeasible"))
    @claim(counterexample=in_reading("newton_noise"))

`turning_point` changes the records of a reading a little more each time until the verdict changes, and tells by how
much. Amounts are bounded, and a change that only breaks the claim (no finite number, nothing there to judge) does not
count.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from marsedl.replication.claims.claim import Counterexample
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.injection import LARGE

AMOUNTS = np.geomspace(1e-4, 9.0, 12)  # tried one after the other, in both directions
BISECTIONS = 7  # of the step in which the verdict changes

_Judge = Callable[[Mapping[str, object], Callable, Mapping[str, object]], tuple]


@dataclass(frozen=True)
class Perturbation:
    """One change; see the functions of this module.

    `target` is "record.field", "section.input" or "measured.quantity"; of `in_reading` a reading. `component` and `at`
    choose entries of a field.
    """

    change: str
    target: str
    other: Any = None
    component: str = ""
    at: Any = None

    @property
    def place(self) -> str:
        """The target with its component, as it is shown."""
        return f"{self.target} ({self.component.replace('_', ' ')})" if self.component else self.target


def scaled(target: str, component: str = "", at: Any = None) -> Perturbation:
    """Multiply values by a factor of a tenth to ten."""
    return Perturbation("scaled", target, None, component, at)


def shifted(target: str, component: str = "", at: Any = None) -> Perturbation:
    """Shift values by up to nine of their standard deviations, or of their mean size if they are all equal."""
    return Perturbation("shifted", target, None, component, at)


def spread(target: str, component: str = "", at: Any = None) -> Perturbation:
    """Scale the deviations of values from their mean over the first dimension, by a factor of a tenth to ten."""
    return Perturbation("spread", target, None, component, at)


def blended(target: str, other: str, component: str = "", at: Any = None) -> Perturbation:
    """Move values toward those of the same field of another record, in the end onto them."""
    return Perturbation("blended", target, other, component, at)


def replaced(target: str, value: object, at: Any = None) -> Perturbation:
    """Put another value in the place of values: of a status, a flag, a whole number."""
    return Perturbation("replaced", target, value, "", at)


def in_reading(name: str) -> Perturbation:
    """Point to a reading of the paper in which the verdict is another one."""
    return Perturbation("in_reading", name)


def turning_point(
    counterexample: Perturbation,
    judge: _Judge,
    values: Mapping[str, object],
    artifact: Callable,
    further_arguments: Mapping[str, object],
) -> Counterexample | None:
    """Return the least change, of those that are tried, which turns a verdict.

    Args:
        counterexample: what is changed; `in_reading` is not for this function.
        judge: function of inputs, artifacts and further arguments that returns what must change, or raises ValueError
            if nothing can be judged.
        values: the inputs by "section.name".
        artifact: function of an artifact's name and type.
        further_arguments: of claims.

    Returns:
        The change, its amount and the verdict after it; None if none is found.

    Raises:
        InputError: there is no such record, field, component or input.

    """

    def after(amount: float) -> Any:
        try:
            return judge(*_given(counterexample, amount, values, artifact, further_arguments))
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            return None  # nothing left to judge

    before = judge(values, artifact, further_arguments)

    def turned(amount: float) -> bool:
        verdict = after(amount)
        return verdict is not None and verdict != before

    if counterexample.change == "replaced":
        return _result(counterexample, None, after(1.0)) if turned(1.0) else None
    amounts = AMOUNTS / AMOUNTS[-1] if counterexample.change == "blended" else AMOUNTS
    signs = (1.0,) if counterexample.change == "blended" else (1.0, -1.0)
    for number, amount in enumerate(amounts):
        for sign in signs:
            if turned(sign * amount):
                low, high = amounts[number - 1] if number else 0.0, amount
                for _ in range(BISECTIONS):
                    middle = np.sqrt(low * high) if low else high / 2
                    low, high = (low, middle) if turned(sign * middle) else (middle, high)
                return _result(counterexample, sign * high, after(sign * high))
    return None


def _result(counterexample: Perturbation, amount: float | None, verdict: tuple) -> Counterexample:
    if counterexample.change == "replaced":
        amount = f"{counterexample.other}"
    elif counterexample.change in ("scaled", "spread"):
        amount = _factor(amount)
    shown = amount if isinstance(amount, str) else float(amount)
    return Counterexample(change=counterexample.change, of=counterexample.place, amount=shown, to=verdict[0])


def _factor(amount: float) -> float:
    return 1.0 + amount if amount >= 0 else 1.0 / (1.0 - amount)


def _given(counterexample, amount, values, artifact, further_arguments) -> tuple:
    """Inputs, artifacts and further arguments after a change."""
    first, _, name = counterexample.target.partition(".")
    if counterexample.target in values:
        changed_input = _changed(counterexample, amount, values[counterexample.target], None, ())
        return {**values, counterexample.target: changed_input}, artifact, further_arguments
    if first == "measured":
        rows = dict(further_arguments.get("measured") or {})
        if name not in rows:
            raise InputError(f"counterexample of '{name}': there is no such measurement; {nearest(name, rows)}")
        return (
            values,
            artifact,
            {**further_arguments, "measured": {**rows, name: _changed(counterexample, amount, rows[name])}},
        )

    def change(artifact_name: str, kind: type):
        record = artifact(artifact_name, kind)
        if record is None or artifact_name.removesuffix(LARGE) != first:
            return record
        return _with_field(counterexample, amount, record, name, artifact, kind)

    return values, change, further_arguments


def _with_field(counterexample, amount, record, name, artifact, kind):
    from marsedl.replication.records.fields import layout, quantities

    if name not in quantities(type(record)):
        raise InputError(f"{type(record).__name__} has no field '{name}'; {nearest(name, quantities(type(record)))}")
    dimensions = layout(type(record))
    axes = [dimensions.axes[dim] for dim in dimensions.dims[name]]
    other = None
    if counterexample.change == "blended":
        source = artifact(counterexample.other, kind)
        if source is None:
            raise InputError(f"counterexample of '{counterexample.target}': there is no '{counterexample.other}'")
        other = getattr(source, name)
    return dataclasses.replace(
        record, **{name: _changed(counterexample, amount, getattr(record, name), other, tuple(axes))}
    )


def _changed(counterexample, amount, value, other=None, axes=()):
    """A value after a change; of the same type and shape."""
    array = np.array(value)  # a copy
    place = _place(counterexample, axes, array)
    old = array[place]
    match counterexample.change:
        case "replaced":
            if array.dtype.kind == "U":
                array = array.astype(object)
            new = counterexample.other
        case "scaled":
            new = old * _factor(amount)
        case "shifted":
            size = float(np.nanstd(old)) if np.size(old) > 1 else 0.0
            new = old + amount * (size or float(np.nanmean(np.abs(old))) or 1.0)
        case "spread":
            mean = np.nanmean(old, axis=0, keepdims=True)
            new = mean + (old - mean) * _factor(amount)
        case _:
            new = (1.0 - amount) * old + amount * np.asarray(other)[place]
    if array.dtype.kind in "iu" and counterexample.change != "replaced":
        new = np.rint(new)
    array[place] = new
    if isinstance(value, np.ndarray):
        return array
    return type(value)(array.tolist()) if isinstance(value, list | tuple) else array.tolist()


def _place(counterexample, axes, array) -> Any:
    """Index of the entries that are changed."""
    if not counterexample.component:
        return (...,) if counterexample.at is None else counterexample.at
    index: list[Any] = [slice(None)] * array.ndim
    for number, axis in enumerate(axes):
        if axis is not None and counterexample.component in axis.names:
            index[number] = axis.index(counterexample.component)
    if all(part == slice(None) for part in index):
        raise InputError(f"counterexample of '{counterexample.target}': no component '{counterexample.component}'")
    return tuple(index)


def in_words(turned: Counterexample) -> str:
    """Say a counterexample in a sentence."""
    place, amount = f"`{turned.of}`", turned.amount
    text = {
        "scaled": "With {0} times {1:.4g}",
        "shifted": "With {0} shifted by {1:+.3g} standard deviations",
        "spread": "With deviations of {0} from their mean times {1:.4g}",
        "blended": "With {0} moved by {2:.3g} % of the way to the other record",
        "replaced": "With {1} as {0}",
        "in_reading": "In the reading {0}",
    }[turned.change]
    share = None if turned.change != "blended" else 100 * amount
    return f"{text.format(place, amount, share)} the verdict is {turned.to.replace('_', ' ')}."
