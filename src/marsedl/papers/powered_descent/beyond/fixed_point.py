"""Algorithm 1 as printed and repaired, against the closed form: iterations, convergence, and where it fails."""

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from marsedl.methods.covariance_steering.closed_form import (
    equivalent_squared_noise_density,
    predicted_covariance,
    riccati_initial,
)
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.beyond.algorithm_1 import fixed_point
from marsedl.papers.powered_descent.inputs import Inputs, Noise
from marsedl.papers.powered_descent.records import FixedPointStudy, Linearization
from marsedl.replication.pipeline.catalogue import stage

BOUNDARIES = ("corrected", "algorithm_1", "eq_46")
ORDERS = ("gauss_seidel", "jacobi")


@stage(claimed_in=("printed", "corrected"))
def compute(given: Inputs, linearization: Linearization) -> FixedPointStudy:
    """Run Algorithm 1 in the reading's thrust unit and in units of the maximum thrust, and sweep the noise density."""
    noise, studies = given.noise, given.studies
    problems = segments.problems_of(segments.divert_of(given), linearization)
    units = tuple(dict.fromkeys((noise.thrust_unit, given.vehicle.maximum_thrust)))
    tolerance, limit = studies.fixed_point_tolerance, studies.fixed_point_iterations
    plant = segments.plant_noise_density(noise)

    def run(problem, unit, boundary, order, **options):
        return fixed_point(
            problem.transition[-1],
            _gramian(problem),
            (problem.initial_covariance, problem.final_covariance),
            noise.noise_coefficient,
            **{"control_unit": unit, "boundary": boundary, "order": order, "tolerance": tolerance, **options},
        )

    runs = _table((units, BOUNDARIES, ORDERS, problems), lambda u, b, o, p: run(p, u, b, o, maximum_iterations=limit))
    exact = _table((units, BOUNDARIES, problems), lambda u, b, p: riccati_initial(_with(p, noise, u, b)))
    loose = _table(
        (units, problems),
        lambda u, p: run(
            p,
            u,
            "algorithm_1",
            "jacobi",
            tolerance=studies.fixed_point_loose_tolerance,
            tolerance_kind="absolute",
            maximum_iterations=limit,
        ),
    )

    def swept(density, order, problem):
        return fixed_point(
            problem.transition[-1],
            _gramian(problem),
            (problem.initial_covariance, problem.final_covariance),
            density,
            order=order,
            tolerance=tolerance,
            maximum_iterations=min(limit, studies.density_iterations),
        )

    densities = np.geomspace(*studies.density_range, studies.density_points)
    sweep = _table((densities, ORDERS, problems), swept)
    swept_exact = _table((densities, problems), lambda d, p: riccati_initial(replace(p, noise_density=d)))
    searched = np.geomspace(*studies.critical_density_range, studies.critical_density_points)
    return FixedPointStudy(
        unit=np.array(units),
        boundary=np.array(BOUNDARIES),
        order=np.array(ORDERS),
        iterations=_each(runs, lambda r: r.iterations).astype(np.int64),
        converged=_each(runs, lambda r: r.converged).astype(bool),
        riccati_error=_difference(runs, exact[:, :, np.newaxis]),
        covariance_error=np.array(
            [
                [
                    [_variance_error(p, r, plant) for p, r in zip(problems, row[ORDERS.index("jacobi")], strict=True)]
                    for row in block
                ]
                for block in runs
            ]
        ),
        loose_iterations=_each(loose, lambda r: r.iterations).astype(np.int64),
        loose_variance=np.array(
            [[_variances(p, r.riccati_initial, plant) for p, r in zip(problems, row, strict=True)] for row in loose]
        ),
        density=densities,
        sweep_iterations=_each(sweep, lambda r: r.iterations).astype(np.int64),
        sweep_converged=_each(sweep, lambda r: r.converged).astype(bool),
        sweep_error=_difference(sweep, swept_exact[:, np.newaxis]),
        smallest_eigenvalue=_each(swept_exact, _scaled_smallest_eigenvalue),
        critical_density=np.array([_critical_density(problem, searched) for problem in problems]),
    )


def _table(axes, function):
    """Object array of the function's values on the grid of the axes."""
    table = np.empty([len(axis) for axis in axes], dtype=object)
    for index in np.ndindex(table.shape):
        table[index] = function(*(axis[i] for axis, i in zip(axes, index, strict=True)))
    return table


def _each(table, function):
    return np.array([function(entry) for entry in table.flat]).reshape(table.shape)


def _difference(runs, exact):
    exact = np.broadcast_to(exact, runs.shape)
    pairs = zip(runs.flat, exact.flat, strict=True)
    return np.array([np.abs(r.riccati_initial - e).max() / np.abs(e).max() for r, e in pairs]).reshape(runs.shape)


def _with(problem, noise: Noise, unit, boundary):
    squared = equivalent_squared_noise_density(noise.noise_coefficient, unit, boundary)
    return replace(problem, noise_density=np.sqrt(squared))


def _gramian(problem):
    """Open-loop Gramian M(T, 0) of Eq. 48."""
    final = problem.transition[-1]
    return final @ problem.gramian[-1] @ final.T


def _variances(problem, riccati, noise_density):
    return np.diag(predicted_covariance(problem, riccati, noise_density, problem.initial_covariance)[-1]).copy()


def _variance_error(problem, run, noise_density):
    return np.abs(_variances(problem, run.riccati_initial, noise_density) / np.diag(problem.final_covariance) - 1).max()


def _scaled_smallest_eigenvalue(riccati):
    scale = np.sqrt(np.abs(np.diag(riccati)))
    return np.linalg.eigvalsh(riccati / np.outer(scale, scale)).min()


def _critical_density(problem, densities):
    """Largest of the range of noise densities (N sqrt(s)) at which Lambda(0) is singular; 0 if there is none."""

    def smallest_eigenvalue(density):
        return np.linalg.eigvalsh(riccati_initial(replace(problem, noise_density=density))).min()

    below = [k for k, density in enumerate(densities) if smallest_eigenvalue(density) < 0.0]
    # Negative up to the end of the range: the search does not see the change of sign.
    if not below or below[-1] == len(densities) - 1:
        return 0.0
    return brentq(smallest_eigenvalue, *densities[below[-1] : below[-1] + 2], xtol=1e-12)
