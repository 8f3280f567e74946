"""Sec. II: conditioned random fields, Figs. 1 and 2, by their exact mean and covariance."""

from functools import partial

import numpy as np

from marsedl.models import random_field
from marsedl.papers.random_field.inputs import Drawing
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.claims.writing import claim, holds, measure

NEAR = 0.25  # of the field's deviation: samples pass near a value
CONSTANT = 0.01  # of the field's deviation: an edge is constant
EDGE_POINTS = 20  # intervals between the points at which an edge is held


@claim(by_construction="Measurements and their noise are ours, and say how near conditioned samples pass.")
def conditioned_1d_samples(drawing: Drawing):
    line = partial(random_field.squared_exponential, variance=1.0, length=drawing.example_length)
    places, values = drawing.example_positions, drawing.example_values
    mean, covariance = random_field.condition(line, places, places, values, drawing.example_noise**2)
    distance = np.sqrt((mean - values) ** 2 + np.maximum(np.diag(covariance), 0.0))
    before = np.sqrt(values**2 + 1.0).min()
    subject = f"root mean square distance of conditioned samples from the {len(places)} measured values"
    return holds(
        measure(subject, distance, "deviations of the field") < NEAR,
        f"before conditioning at least {before:.2f}",
    )


@claim(by_construction="A field that is conditioned without noise has the values that it is conditioned to.")
def conditioned_2d_right_edges(drawing: Drawing):
    plane = partial(random_field.squared_exponential, variance=1.0, length=np.full(2, drawing.example_length))
    extent = drawing.example_extent
    coarse, fine = (_edges(extent, EDGE_POINTS * finer) for finer in (1, 4))
    opposite = np.array([[0.0, extent]])
    mean, covariance = random_field.condition(
        plane, np.concatenate([fine, opposite]), coarse, np.full(len(coarse), drawing.example_edge), 0.0
    )
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    departure = (np.abs(mean - drawing.example_edge) + SIGMAS * spread)[:-1]
    subject = f"departure from the constant on two adjacent edges, held at {len(coarse)} points (mean and three sigma)"
    return holds(
        measure(subject, departure, "deviations of the field") < CONSTANT,
        f"in the opposite corner {spread[-1]:.3f} of the deviation is left",
    )


def _edges(extent, count):
    """Points on two edges of a square that meet in a corner, (2 count + 1, 2)."""
    steps = np.linspace(0.0, extent, count + 1)
    full, none = np.full(count + 1, extent), np.zeros(count + 1)
    return np.concatenate([np.column_stack([full, steps]), np.column_stack([steps, none])[:-1]])
