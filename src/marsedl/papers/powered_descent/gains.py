"""Feedback gains, mean control and predicted covariance of both segments (Sec. III in closed form)."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.covariance_steering.closed_form import (
    SteeringProblem,
    escape_margin,
    predicted_covariance,
    riccati_initial,
)
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.linearization import Linearization
from marsedl.replication.artifacts import quantity


@dataclass(frozen=True)
class Gains:
    """Scheduled control u = feedforward - gain (x - mean), and the covariance that the linear model predicts."""

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight; the switch stands twice")
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    gain: np.ndarray = quantity("N/m, N/m, N s/m, N s/m", ("time", 2, 4), "feedback gain")
    feedforward: np.ndarray = quantity("N", ("time", 2), "mean control")
    mean: np.ndarray = quantity("m, m, m/s, m/s", ("time", 4), "mean state")
    covariance: np.ndarray = quantity("SI", ("time", 4, 4), "predicted covariance under the plant's noise")
    riccati: np.ndarray = quantity("SI", ("time", 4, 4), "solution of the Riccati equation")
    escape_margin: np.ndarray = quantity("1", ("time",), "smallest eigenvalue of R(t); positive: the solution exists")
    riccati_initial: np.ndarray = quantity("SI", ("segments", 4, 4), "Riccati solution at each segment's start")
    mean_costate: np.ndarray = quantity("SI", ("segments", 4), "costate of the mean at each segment's start")
    mean_cost: np.ndarray = quantity("N^2 s", ("segments",), "integral of the squared mean control")
    covariance_cost: np.ndarray = quantity("N^2 s", ("segments",), "expected integral of the squared feedback control")
    noise_density_design: float = quantity("N sqrt(s)", (), "noise density that the boundary condition designs for")
    noise_density_plant: float = quantity("N sqrt(s)", (), "noise density of the plant")
    plus_root_margin: np.ndarray = quantity("1", ("segments",), "smallest eigenvalue of R(t) for the other root")


def problems_of(inputs, linearization: Linearization):
    """The segments' steering problems from the stored linear model; a list of `SteeringProblem`."""
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    means, covariances = segments.end_conditions(inputs)
    names = ("transition", "gramian", "affine_response", "control_matrix")
    parts = segments.split(linearization.segment, *(getattr(linearization, name) for name in names))
    return [
        SteeringProblem(
            times[number],
            *part,
            initial_mean=means[number],
            final_mean=means[number + 1],
            initial_covariance=covariances[number],
            final_covariance=covariances[number + 1],
            noise_density=segments.design_noise_density(inputs),
        )
        for number, part in enumerate(parts)
    ]


def compute(inputs, linearization: Linearization) -> Gains:
    """Steer both segments and predict the covariance that the plant's noise gives.

    The second segment is designed from the target covariance at the switch, and predicted from the one really reached.
    """
    problems = problems_of(inputs, linearization)
    steerings = segments.steered(problems)
    noise_density = segments.plant_noise_density(inputs)
    covariances, reached = [], inputs.initial_covariance
    for problem, steering in zip(problems, steerings, strict=True):
        covariances.append(predicted_covariance(problem, steering.riccati[0], noise_density, reached))
        reached = covariances[-1][-1]

    def joined(name):
        return np.concatenate([getattr(steering, name) for steering in steerings])

    def each(name):
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
        mean_costate=each("mean_costate"),
        mean_cost=each("mean_cost"),
        covariance_cost=each("covariance_cost"),
        noise_density_design=float(segments.design_noise_density(inputs)),
        noise_density_plant=float(noise_density),
        plus_root_margin=np.array([escape_margin(p, riccati_initial(p, +1)).min() for p in problems]),
    )
