"""Linear model along the prior mass profile and its open-loop quantities (Eqs. 4, 47, 48)."""

import numpy as np

from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.papers.powered_descent.records import Linearization, Nominal
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs, nominal: Nominal) -> Linearization:
    """Linearize the motion about the prior mass profile."""
    divert = segments.divert_of(given)
    masses = segments.split(nominal.segment, nominal.mass)
    models = [segments.linear_model(mass, given.planet.gravity) for (mass,) in masses]
    problems = segments.problems_along(divert, models)

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
