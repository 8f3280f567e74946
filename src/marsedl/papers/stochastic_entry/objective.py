"""What the stochastic law minimises: the final downrange error, at a time or at the velocity trigger (Sec. V)."""

import numpy as np

from marsedl.papers.stochastic_entry.inputs import Design
from marsedl.papers.stochastic_entry.records import DOWNRANGE

TRIGGER_NORMAL = np.array([0.0, 1.0, 0.0, 0.0, 0.0])  # of the velocity trigger (Eq. 76)


def final_weights(design: Design, linearization):
    """Weights of the final state for both triggers, per metre of downrange error (Eqs. 72, 78), (2, 5)."""
    weight = design.final_weight * np.array([1.0 / design.weight_length, 1.0, 1.0, 1.0 / design.weight_length, 1.0])
    weight = weight / per_metre(design)
    return np.array([weight, linearization.trigger_projection.T @ weight])


def per_metre(design: Design):
    """The weight of downrange: the objective is stated in metres of downrange error."""
    weight = design.final_weight[DOWNRANGE]
    return (weight if weight != 0.0 else 1.0) / design.weight_length
