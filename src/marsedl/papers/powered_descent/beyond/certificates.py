"""Independent checks of the design: the paper's equations integrated forward, and convex upper bounds of the cost."""

import numpy as np
from scipy.interpolate import CubicSpline

from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.beyond.algorithm_2 import LinearMotion, integrate_forward, modified_index
from marsedl.papers.powered_descent.beyond.held_control import covariance_certificate, mean_certificate
from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.papers.powered_descent.records import Certificates, Gains, Linearization
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage


@stage(claimed_in=("printed", "corrected"))
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> Certificates:
    """Check both segments' designs.

    The second segment is checked as designed, from the target covariance at the switch; noise is that of the design.
    """
    problems = segments.problems_of(segments.divert_of(given), linearization)
    models = segments.split(
        linearization.segment, linearization.state_matrix, linearization.control_matrix, linearization.affine
    )
    sizes = [int(number) for number in given.studies.certificate_intervals]
    rows = []
    for number, (problem, model) in enumerate(zip(problems, models, strict=True)):
        row = _forward(problem, model, gains.riccati_initial[number], gains.mean_costate[number])
        try:
            mean_bounds = [mean_certificate(problem, size) for size in sizes]
            covariance_bounds = [covariance_certificate(problem, size) for size in sizes]
        except (ValueError, RuntimeError) as error:
            raise MarsedlError(f"segment {number + 1}: {error}; raise certificate_intervals") from None
        row["mean_cost_ratio"] = [bound.cost / gains.mean_cost[number] for bound in mean_bounds]
        row["covariance_cost_ratio"] = [bound.cost / gains.covariance_cost[number] for bound in covariance_bounds]
        row["lossless_gap"] = [bound.lossless_gap for bound in covariance_bounds]
        row["solver_status"] = [bound.status for bound in covariance_bounds]
        row["solver_iterations"] = [bound.iterations for bound in covariance_bounds]
        rows.append(row)
    return Certificates(
        intervals=np.array(sizes, np.int64), **{name: np.array([row[name] for row in rows]) for name in rows[0]}
    )


def _forward(problem, model, riccati, costate_of_mean):
    """Compare a segment's design with Eqs. 20-43 integrated forward."""
    state_matrix, control_matrix, affine = (CubicSpline(problem.time, part) for part in model)
    density = problem.noise_density
    times = np.linspace(0.0, problem.time[-1], 5)
    motion = LinearMotion(
        state_matrix,
        control_matrix,
        affine,
        problem.time[-1],
        problem.initial_mean,
        problem.initial_covariance,
        density,
    )
    forward = integrate_forward(motion, riccati, problem.final_mean, times=times)
    r = np.eye(len(riccati)) - problem.gramian[-1] @ riccati
    backward = np.linalg.inv(problem.transition[-1])
    riccati_end = backward.T @ riccati @ np.linalg.inv(r) @ backward
    costate = costate_of_mean + riccati @ problem.initial_mean
    identities = density**2 * np.linalg.inv(forward.covariance), forward.h_matrix + forward.riccati
    # Eq. 46 takes gamma^2 on the other side: Sigma^-1 = gamma^2 (P^-1 + Q^-1), with P = H^-1 and Q = Lambda^-1.
    inverse = np.linalg.inv(forward.covariance[[0, -1]])
    printed = density**2 * (forward.h_matrix + forward.riccati)[[0, -1]]
    controls = (
        (lambda t: np.zeros((2, 4)), lambda t: np.zeros(2)),
        (lambda t: control_matrix(t).T @ riccati, lambda t: 1000.0 * np.array([np.sin(t), np.cos(t)])),
    )
    indices = [
        modified_index(motion, riccati, costate, feedback=feedback, feedforward=feedforward)
        for feedback, feedforward in controls
    ]
    return {
        "covariance_error": _relative(forward.covariance[-1], problem.final_covariance, problem.final_covariance),
        "riccati_error": _relative(forward.riccati[-1], riccati_end, riccati_end),
        "h_identity_error": max(_relative(a, b, a) for a, b in zip(*identities, strict=True)),
        "mean_error": forward.mean[-1] - problem.final_mean,
        "costate_error_eq39": np.abs(forward.costate_initial_eq39 / costate - 1).max(),
        "costate_error_eq37": np.abs(forward.costate_initial_eq37 / forward.costate_initial_eq39 - 1).max(),
        "eq46_residual": max(_relative(a, b, a) for a, b in zip(printed, inverse, strict=True)),
        "index_eq20": [index.expanded for index in indices],
        "index_eq23": [index.completed_square for index in indices],
        "dropped_term": [index.dropped_term for index in indices],
    }


def _relative(matrix, other, scale):
    """Largest difference of two symmetric matrices, in units of the scale's standard deviations."""
    unit = np.sqrt(np.abs(np.diag(scale)))
    return np.abs((matrix - other) / np.outer(unit, unit)).max()
