"""Sensitivity of the flight to its start, without feedback (Eqs. 5 and 7, Sec. 4.2)."""

import numpy as np

from marsedl.methods.linearization import linearize
from marsedl.methods.sensitivity import adjoint_rows, midpoint_transitions, propagate_columns
from marsedl.papers.desensitized import entry_problem, records
from marsedl.papers.desensitized.entry_problem import STATES
from marsedl.papers.desensitized.inputs import Planet, Vehicle
from marsedl.papers.desensitized.records import Linearization, Nominal, Tradeoff
from marsedl.replication.catalogue import stage


def along(planet: Planet, vehicle: Vehicle, time, states, bank_acceleration):
    """Linear model in the middle of the intervals: df/dy (N, 8, 8) and df/du (N, 8, 1)."""
    middle = (states[1:] + states[:-1]) / 2.0
    parameters = list(entry_problem.given().values())
    model = linearize(entry_problem.rates(planet, vehicle), middle, bank_acceleration[:, np.newaxis], parameters)
    return model.state_matrix, model.control_matrix


def position_columns(planet: Planet):
    """Position errors of one metre at entry as columns of the state, (8, 3)."""
    columns = np.zeros((len(STATES), 3))
    for number, channel in enumerate(records.CHANNELS):
        for name, value in entry_problem.position_error(planet, channel).states.items():
            columns[STATES.index(name), number] = value
    return columns


def position_rows(planet: Planet):
    """Rows that make radius, crossrange and downrange in metres of a deviation of the state, (3, 8)."""
    return np.diag(entry_problem.lengths(planet)) @ np.eye(3, len(STATES))


@stage()
def compute(planet: Planet, vehicle: Vehicle, nominal: Nominal, tradeoff: Tradeoff) -> Linearization:
    """Linearise about the nominal, and propagate the position columns along it and along the rows of Table 3."""
    columns, rows = position_columns(planet), position_rows(planet)
    matrix, control = along(planet, vehicle, nominal.time, nominal.state, nominal.bank_acceleration)
    transitions = midpoint_transitions(matrix, np.diff(nominal.time))
    final = []
    for time, state, acceleration in zip(tradeoff.time, tradeoff.state, tradeoff.bank_acceleration, strict=True):
        steps = midpoint_transitions(along(planet, vehicle, time, state, acceleration)[0], np.diff(time))
        final.append(rows @ propagate_columns(steps, columns)[-1])
    return Linearization(
        time=nominal.time,
        state_matrix=matrix,
        control_matrix=control[:, :, 0],
        sensitivity=propagate_columns(transitions, columns),
        adjoint=adjoint_rows(transitions, rows),
        final=np.array(final),
        printed_weight=tradeoff.printed_weight,
    )
