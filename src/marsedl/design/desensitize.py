"""Trajectories that errors move less: sensitivities join the states of a reference, and their squares its objective.

best = optimal(rates, Sled(), start=..., goal=..., time=30.0, objective=lambda command: command.thrust**2)
robust = desensitize(best, [0.1, 1.0, 10.0], Sensitivity("position", "drag", 1e-3), gains=[Gain("thrust", "speed")])
robust.table        # what each weight costs, and what the error does, flown
robust.references   # the trajectories; robust.gains the feedback of each
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from marsedl.design.pictures import labelled, new_figure
from marsedl.design.reference import Reference, fly_held
from marsedl.fly.declared import is_number
from marsedl.methods.collocation import Program
from marsedl.methods.desensitization import Desensitized, Gain, Perturbation, column
from marsedl.summaries import summary
from marsedl.words import remedy, require

__all__ = ["Gain", "Robust", "Sensitivity", "desensitize"]

WEIGHT = "weight of sensitivities"


class Sensitivity(NamedTuple):
    """How far an error moves a state at the end."""

    of: str  # state
    to: str  # number of p or of another part of the model, or a state at the start
    deviation: float  # of the error


@dataclass(frozen=True, eq=False)
class Robust:
    """Desensitized trajectories, one for each weight, and what they cost."""

    references: tuple[Reference, ...]
    gains: tuple[np.ndarray, ...]  # commands per state, (m, n), for each
    table: Any  # data frame: weight (0: the reference), objective, of, to, predicted and flown, a row a sensitivity

    __repr__ = summary

    def picture(self, units=None) -> Any:
        """Figure of matplotlib: what errors of one deviation do against the objective, with the weights.

        units: of states, and of "objective".
        """
        units, groups = units or {}, self.table.groupby(["of", "to"], sort=False)
        figure, panels = new_figure(len(groups))
        for panel, ((state, error), rows) in zip(panels, groups, strict=True):
            panel.plot(rows["objective"], rows["predicted"].abs(), "o-", label="predicted")
            panel.plot(rows["objective"], rows["flown"].abs(), "x", label="flown")
            for row in rows.itertuples():
                place = row.objective, abs(row.predicted)
                panel.annotate(f"w = {row.weight:g}", place, (4, 4), textcoords="offset points")
            panel.set_title(f"{labelled(state, units)}, moved by {labelled(error, {})}", loc="left", fontsize="medium")
            panel.margins(x=0.1, y=0.15)
        panels[0].legend(frameon=False)
        panels[-1].set_xlabel(labelled("objective", units))
        return figure


def desensitize(reference: Reference, weight, sensitivity, gains: Sequence[Gain] = (), scales=None) -> Robust:
    r"""Trade the objective of a reference against what errors do to its end.

        $\text{minimise} \quad J + w \sum_i \left( \sigma_i \frac{\partial x_i(t_f)}{\partial q_i} \right)^2$

    Sensitivities are states of the problem, the exact derivatives of its transcription, and weights are followed one
    from the other (`methods.desensitization`, `methods.collocation`). A gain feeds the deviation of a state back.

    Args:
        reference: of `optimal`. weight: w, or several, rising from the first, each more robust than the one before.
        sensitivity: `Sensitivity`, or several. gains: constant ones that the solver chooses, each a `Gain` of a command
            (named as in limits of `optimal`) and a state with its bounds; it enters sensitivities alone, as the nominal
            has no deviation.
        scales: typical size of a state's sensitivity to a unit of an error; by default its scale over the deviation.

    Returns:
        `Robust`. Its table has, for each sensitivity, what a deviation of the error moves the state by: `predicted` to
        first order, and `flown` by the integrator of flights with the error, commands and feedback being held over
        intervals.

    Raises:
        ValueError: for an unknown name, a weight or deviation that is not positive, or weights that do not rise.
        NotConvergedError, BranchEndError: if no solution is found, or none at the next weight.
    """
    import pandas as pd

    weights = np.atleast_1d(np.asarray(weight, float))
    require(
        weights.ndim == 1 and (np.diff(weights, prepend=0.0) > 0.0).all() and np.isfinite(weights).all(),
        f"weight is {weight!r}; give a positive number, or several that rise",
    )
    task, solution = reference.task, reference.solution
    asked = (sensitivity,) if isinstance(sensitivity, Sensitivity) else tuple(sensitivity)
    states = task.start._fields
    for one in asked:
        require(isinstance(one, Sensitivity), f"sensitivity {one!r}; give Sensitivity(state, to, deviation)")
        require(one.of in states, f"sensitivity of {one.of!r}: {remedy(one.of, states)}")
        require(
            is_number(one.deviation) and one.deviation > 0.0,
            f"sensitivity of {one.of} to {one.to}: the deviation is {one.deviation!r}; give a positive number",
        )
    errors = {one.to: one.deviation for one in asked}
    nominal = {name: task.number(name) for name in errors if name not in states}
    base = task.problem(tuple(nominal), unused=(WEIGHT,))
    scales = scales or {name: task.scales[name] / min(errors.values()) for name in states}
    perturbations = (
        Perturbation(name, **{"states" if name in states else "parameters": {name: 1.0}}) for name in errors
    )
    more = Desensitized(base, tuple(perturbations), scales=scales, gains=tuple(gains))
    columns, known = {one: column(one.of, one.to) for one in asked}, [v.name for v in more.problem.states]
    for one, name in columns.items():
        require(name in known, f"{one.to} does not move {one.of}: leave this sensitivity out")

    def squares(end):
        return sum((one.deviation * end[name]) ** 2 for one, name in columns.items())

    def end_cost(start, end, given):
        return (base.end_cost(start, end, given) if base.end_cost else 0.0) + given[WEIGHT] * squares(end)

    program = Program(replace(more.problem, end_cost=end_cost), len(reference.time) - 1, solution.scheme)
    given = nominal | {WEIGHT: 0.0}
    guess = more.guess(solution.guess(), given, solution.scheme)
    path = program.follow(program.solve(guess, given), WEIGHT, weights)

    def rows_of(weight, flown, gain, states_at_end):
        end = dict(zip(known, states_at_end, strict=True))
        predicted = {one: one.deviation * end[name] for one, name in columns.items()}
        return [(weight, flown.objective, one.of, one.to, predicted[one], _moved(flown, one, gain)) for one in asked]

    commands, references, feedback = [variable.name for variable in base.controls], [], []
    rows = rows_of(0.0, reference, np.zeros((len(commands), len(states))), guess.states[-1])
    for number, found in zip(weights, path, strict=True):
        gain = np.zeros((len(commands), len(states)))
        for item in gains:
            gain[commands.index(item.control), states.index(item.state)] += item.unit * found.free[item.parameter]
        paid = found.objective - number * squares(dict(zip(known, found.states[-1], strict=True)))
        references.append(replace(task.reference(found, reference.substeps), objective=paid))
        feedback.append(gain)
        rows += rows_of(number, references[-1], gain, found.states[-1])
    table = pd.DataFrame(rows, columns=["weight", "objective", "of", "to", "predicted", "flown"])
    return Robust(tuple(references), tuple(feedback), table)


def _moved(reference, sensitivity, gain):
    """How far an error of one deviation moves a state at the end, flown."""
    task, name, vectors = reference.task, sensitivity.to, reference.task.vectors
    start, end = task.start, task.start._fields.index(sensitivity.of)
    if name in start._fields:
        start = start._replace(**{name: getattr(start, name) + sensitivity.deviation})
    else:
        vectors = task.with_numbers([name], [task.number(name) + sensitivity.deviation])
    nominal, commands = np.transpose(reference.flown), np.transpose(reference.commands)
    flown = fly_held(vectors, start, commands, reference.time, reference.substeps, gain, nominal)
    return float(flown[-1, end] - nominal[-1, end])
