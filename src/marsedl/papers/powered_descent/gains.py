"""Feedback gains, mean control and predicted covariance of both segments (Sec. III in closed form)."""

import numpy as np

from marsedl.methods.covariance_steering.closed_form import predicted_covariance
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.papers.powered_descent.records import Gains, Linearization
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs, linearization: Linearization) -> Gains:
    """Steer both segments and predict the covariance that the plant's noise gives.

    The second segment is designed from the target covariance at the switch, and predicted from the one really reached.
    """
    divert = segments.divert_of(given)
    problems = segments.problems_of(divert, linearization)
    steerings = segments.steered(problems)
    noise_density = segments.plant_noise_density(given.noise)
    covariances, reached = [], given.entry.initial_covariance
    for problem, steering in zip(problems, steerings, strict=True):
        covariances.append(predicted_covariance(problem, steering.riccati[0], noise_density, reached))
        reached = covariances[-1][-1]

    def joined(name):
        return np.concatenate([getattr(steering, name) for steering in steerings])

    def by_segment(name):
        return np.array([getattr(steering, name) for steering in steerings])

    return Gains(
        time=linearization.time,
        segment=linearization.segment,
        gain=joined("gain"),
        feedforward=joined("feedforward"),
        mean=joined("mean"),
        covariance=np.concatenate(covariances),
        riccati=joined("riccati"),
        escape_margin=joined("escape_margin"),
        riccati_initial=np.array([steering.riccati[0] for steering in steerings]),
        mean_costate=by_segment("mean_costate"),
        mean_cost=by_segment("mean_cost"),
        covariance_cost=by_segment("covariance_cost"),
        noise_density_design=float(divert.noise_density),
        noise_density_plant=float(noise_density),
    )
