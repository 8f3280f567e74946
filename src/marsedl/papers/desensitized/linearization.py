"""Sensitivity of the flight to its start by the scheme of the transcription (Eqs. 5 and 7, Sec. 4.2)."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.linearization import linearize_intervals
from marsedl.methods.sensitivity import propagate_columns, scheme_transitions
from marsedl.papers.desensitized import entry_problem, records
from marsedl.papers.desensitized.entry_problem import STATES, Trajectory
from marsedl.papers.desensitized.inputs import Inputs, Planet, Vehicle
from marsedl.papers.desensitized.records import Linearization, Nominal, Tradeoff
from marsedl.replication.pipeline.catalogue import stage


class Model(NamedTuple):
    """Linear model of a trajectory where the scheme evaluates the equations, the first fields as in `Linearization`."""

    scheme: str
    time: np.ndarray  # (N + 1,)
    state_matrix: np.ndarray  # (N, points, 8, 8)
    control_matrix: np.ndarray  # (N, points, 8)


def model(planet: Planet, vehicle: Vehicle, scheme, along: Trajectory) -> Model:
    """Linearise about a trajectory."""
    parameters = np.tile(list(entry_problem.given().values()), (len(along.bank_acceleration), 1))
    controls = np.column_stack([along.bank_acceleration, parameters])
    linear = linearize_intervals(
        entry_problem.rates(planet, vehicle), along.state, controls, np.diff(along.time), scheme
    )
    return Model(scheme, along.time, linear.state_matrix, linear.control_matrix[..., 0])


def transitions(of: Model | Linearization, gain=0.0):
    """Sensitivity of the end of every interval to its start under constant gains (8,), (N, 8, 8)."""
    matrices = of.state_matrix + of.control_matrix[..., np.newaxis] * gain
    return scheme_transitions(str(of.scheme), matrices, np.diff(of.time))


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
def compute(given: Inputs, nominal: Nominal, tradeoff: Tradeoff) -> Linearization:
    """Linearise about the nominal, and propagate the position columns along it and along the rows of Table 3."""
    columns, rows = position_columns(given.planet), position_rows(given.planet)
    linear = model(given.planet, given.vehicle, given.solver.scheme, entry_problem.of_nominal(nominal))
    steps = transitions(linear)
    final = []
    for row in entry_problem.of_rows(tradeoff):
        of_row = transitions(model(given.planet, given.vehicle, given.solver.scheme, row))
        final.append(rows @ propagate_columns(of_row, columns)[-1])
    return Linearization(
        scheme=given.solver.scheme,
        time=nominal.time,
        state_matrix=linear.state_matrix,
        control_matrix=linear.control_matrix,
        sensitivity=propagate_columns(steps, columns),
        final=np.array(final),
        printed_weight=tradeoff.printed_weight,
    )
