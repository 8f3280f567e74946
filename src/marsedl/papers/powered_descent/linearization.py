"""Linear model along the prior mass profile and its open-loop quantities (Eqs. 4, 47, 48)."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.nominal import Nominal
from marsedl.replication.artifacts import quantity


@dataclass(frozen=True)
class Linearization:
    """Linear model x' = A x + B u + c of both segments; integrals start anew with each segment."""

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight; the switch stands twice")
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    state_matrix: np.ndarray = quantity("1/s", ("time", 4, 4), "A, exact Jacobian of the motion in the state")
    control_matrix: np.ndarray = quantity("1/kg", ("time", 4, 2), "B, exact Jacobian of the motion in the thrust")
    affine: np.ndarray = quantity("m/s, m/s, m/s^2, m/s^2", ("time", 4), "c, rates at zero state and thrust")
    transition: np.ndarray = quantity("SI", ("time", 4, 4), "open-loop transition matrix from the segment's start")
    gramian: np.ndarray = quantity("SI", ("time", 4, 4), "controllability Gramian referred to the segment's start")
    affine_response: np.ndarray = quantity("m, m, m/s, m/s", ("time", 4), "state reached by c alone")


def compute(inputs, nominal: Nominal) -> Linearization:
    """Linearize the motion about the prior mass profile."""
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    masses = segments.split(nominal.segment, nominal.mass)
    models = [segments.linear_model(mass, inputs.gravity) for (mass,) in masses]
    problems = segments.steering_problems(inputs, times, models)

    def joined(name):
        return np.concatenate([getattr(problem, name) for problem in problems])

    return Linearization(
        time=nominal.time,
        segment=nominal.segment,
        state_matrix=np.concatenate([model.state_matrix for model in models]),
        control_matrix=joined("control_matrix"),
        affine=np.concatenate([model.affine for model in models]),
        transition=joined("transition"),
        gramian=joined("gramian"),
        affine_response=joined("affine_response"),
    )
