"""Counterexamples: what has to be changed, and by how much, until a verdict is another one.

A claim names one field of its records, one input or one measured cost, and how it is changed:

    @claim(counterexample=shifted("closed_loop.final_state", component="mass"))
    @claim(counterexample=scaled("gains.gain", at=-1))
    @claim(counterexample=replaced("certificates.solver_status", "infeasible"))
    @claim(counterexample=in_reading("newton_noise"))

The change grows until the verdict is another one. Amounts are bounded, and a change that only breaks the claim (no
finite number, nothing there to judge) does not count.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from marsedl.replication.claims.claim import Claim, Counterexample
from marsedl.replication.claims.names import BY_CONSTRUCTION
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.injection import LARGE, Arguments, Missing
from marsedl.replication.records.fields import layout, quantities

AMOUNTS = np.geomspace(1e-4, 9.0, 12)  # tried one after the other, in both directions
BISECTIONS = 7  # of the step in which the verdict changes


@dataclass(frozen=True)
class Perturbation:
    """One change.

    `target` is "record.field" (of the large ensemble too), "section.input" or "measured.quantity"; of `in_reading` a
    reading. `component` or `at` choose entries of a field.
    """

    change: str
    target: str
    component: str = ""
    at: Any = ...
    value: Any = None  # that is put in

    def turning_point(self, judge: Callable[[Arguments], tuple], given: Arguments) -> Counterexample | None:
        """Return the least change, of those that are tried, which turns a verdict; None if none does.

        judge: returns the verdict, and what else may turn; it may fail where nothing can be judged. Raises InputError
        if there is no such field, component or measurement.
        """

        def judged(amount: float) -> tuple | None:
            try:
                return judge(self.applied(given, amount) if amount else given)
            except (Missing, ValueError, ArithmeticError):
                return None  # nothing to judge

        def turned(amount: float) -> tuple | None:
            after = judged(amount)
            return after if after != before else None

        before = judged(0.0)
        if before is None:
            return None
        if self.change == "replaced":
            return self._result(f"{self.value}", turned(1.0))
        for low, high in itertools.pairwise([0.0, *AMOUNTS]):
            for sign in (1.0, -1.0):
                if not (after := turned(sign * high)):
                    continue
                for _ in range(BISECTIONS):
                    middle = np.sqrt(low * high) if low else high / 2
                    if nearer := turned(sign * middle):
                        high, after = middle, nearer
                    else:
                        low = middle
                amount = sign * high if self.change == "shifted" else _factor(sign * high)
                return self._result(float(amount), after)
        return None

    def elsewhere(self, row: Claim) -> Counterexample | None:
        """Return that the reading `target` gives another verdict; None if it does not."""
        verdict = row.readings[self.target].verdict
        same = verdict in (None, BY_CONSTRUCTION, row.verdict)
        return None if same else Counterexample(change="in_reading", of=self.target, amount=None, to=verdict)

    def _result(self, amount: float | str, after: tuple | None) -> Counterexample | None:
        place = f"{self.target} ({self.component.replace('_', ' ')})" if self.component else self.target
        return after and Counterexample(change=self.change, of=place, amount=amount, to=after[0])

    def applied(self, given: Arguments, amount: float) -> Arguments:
        """Return what claims can ask for after the change."""
        first, _, name = self.target.partition(".")
        values, artifact, further = given.values, given.artifact, given.further
        if self.target in values:
            values = {**values, self.target: self._changed(values[self.target], amount)}
        elif first == "measured":
            costs = further.get("measured") or {}
            if name not in costs:
                raise InputError(f"counterexample of '{name}': there is no such measurement; {nearest(name, costs)}")
            further = {**further, "measured": {**costs, name: self._changed(costs[name], amount)}}
        else:

            def artifact(case: str, kind: type) -> object:
                record = given.artifact(case, kind)
                if record is None or case.removesuffix(LARGE) != first:
                    return record
                of = type(record)
                if name not in quantities(of):
                    raise InputError(f"{of.__name__} has no field '{name}'; {nearest(name, quantities(of))}")
                axes = [layout(of).axes[dimension] for dimension in layout(of).dims[name]]
                return replace(record, **{name: self._changed(getattr(record, name), amount, axes)})

        return Arguments(values, artifact, further, given.providers)

    def _changed(self, value: Any, amount: float, axes: Any = ()) -> Any:
        """A value after the change; of the same type and shape."""
        array = np.array(value)  # a copy
        array = array.astype(object) if array.dtype.kind == "U" else array
        place = self._place(axes) if self.component else self.at
        old = array[place]
        match self.change:
            case "replaced":
                new = self.value
            case "scaled":
                new = old * _factor(amount)
            case "shifted":
                size = float(np.nanstd(old)) if np.size(old) > 1 else 0.0
                new = old + amount * (size or float(np.nanmean(np.abs(old))) or 1.0)
            case _:
                mean = np.nanmean(old, axis=0, keepdims=True)
                new = mean + (old - mean) * _factor(amount)
        array[place] = np.rint(new) if array.dtype.kind in "iu" and self.change != "replaced" else new
        if isinstance(value, np.ndarray):
            return array
        return type(value)(array.tolist()) if isinstance(value, list | tuple) else array.tolist()

    def _place(self, axes: Any) -> tuple:
        """Index of the entries of a component."""
        along = [axis is not None and self.component in axis.names for axis in axes]
        if not any(along):
            raise InputError(f"counterexample of '{self.target}': no component '{self.component}'")
        return tuple(axis.index(self.component) if has else slice(None) for axis, has in zip(axes, along, strict=True))


scaled = partial(Perturbation, "scaled")  # by a factor of a tenth to ten
shifted = partial(Perturbation, "shifted")  # by up to nine standard deviations, or mean sizes if all values are equal
spread = partial(Perturbation, "spread")  # deviations from the mean over the first dimension, by a tenth to ten
in_reading = partial(Perturbation, "in_reading")  # a reading of the paper in which the verdict is another one


def replaced(target: str, value: object, at: Any = ...) -> Perturbation:
    """Put another value in the place of values: of a status, a flag, a whole number."""
    return Perturbation("replaced", target, at=at, value=value)


def _factor(amount: float) -> float:
    return 1.0 + amount if amount >= 0 else 1.0 / (1.0 - amount)


def in_words(turned: Counterexample) -> str:
    """Say a counterexample in a sentence."""
    changed = {
        "scaled": "With `{0.of}` times {0.amount:.4g}",
        "shifted": "With `{0.of}` shifted by {0.amount:+.3g} standard deviations",
        "spread": "With `{0.of}` {0.amount:.4g} times as far from its mean",
        "replaced": "With {0.amount} as `{0.of}`",
        "in_reading": "In the reading `{0.of}`",
    }[turned.change]
    return f"{changed.format(turned)} the verdict is {turned.to.replace('_', ' ')}."
