"""Algorithm 1 as printed and repaired, against the closed form: iterations, convergence, and where it fails."""

from dataclasses import dataclass, replace

import numpy as np

from marsedl.methods.covariance_steering.closed_form import (
    equivalent_squared_noise_density,
    predicted_covariance,
    riccati_initial,
)
from marsedl.methods.covariance_steering.fixed_point import fixed_point
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.gains import problems_of
from marsedl.papers.powered_descent.linearization import Linearization
from marsedl.replication.artifacts import quantity

BOUNDARIES = ("corrected", "algorithm_1", "eq_46")
ORDERS = ("gauss_seidel", "jacobi")
LOOSE_TOLERANCE = 1e-3  # absolute, as the printed stopping rule; a plausible "small number"
DENSITIES = np.geomspace(20.0, 1000.0, 18)  # N sqrt(s)


@dataclass(frozen=True)
class FixedPointStudy:
    """Runs of Algorithm 1 with every boundary condition, and its iterations against the noise density."""

    unit: np.ndarray = quantity(
        "N", ("units",), "thrust unit of the run: the reading's, and the maximum thrust if that is another"
    )
    boundary: np.ndarray = quantity("1", ("boundaries",), "boundary condition", "str")
    order: np.ndarray = quantity("1", ("orders",), "gauss_seidel, or jacobi as printed", "str")
    iterations: np.ndarray = quantity("1", ("units", "boundaries", "orders", "segments"), "iterations", "int64")
    converged: np.ndarray = quantity("1", ("units", "boundaries", "orders", "segments"), "tolerance reached", "bool")
    riccati_error: np.ndarray = quantity(
        "1",
        ("units", "boundaries", "orders", "segments"),
        "largest difference from the closed form of the equivalent noise density, relative to its largest entry",
        allow_nan=True,
    )
    covariance_error: np.ndarray = quantity(
        "1",
        ("units", "boundaries", "segments"),
        "largest relative error of the final variances in the linear model with the plant's noise, Jacobi order",
        allow_nan=True,
    )
    loose_iterations: np.ndarray = quantity(
        "1", ("units", "segments"), "iterations of the printed algorithm with an absolute tolerance of 1e-3", "int64"
    )
    loose_variance: np.ndarray = quantity(
        "SI", ("units", "segments", 4), "final variances that this early stop gives", allow_nan=True
    )
    density: np.ndarray = quantity("N sqrt(s)", ("densities",), "noise densities of the sweep")
    sweep_iterations: np.ndarray = quantity(
        "1", ("densities", "orders", "segments"), "iterations, corrected boundary, thrust in newtons", "int64"
    )
    sweep_converged: np.ndarray = quantity("1", ("densities", "orders", "segments"), "tolerance reached", "bool")
    sweep_error: np.ndarray = quantity(
        "1", ("densities", "orders", "segments"), "difference from the closed form as above", allow_nan=True
    )
    smallest_eigenvalue: np.ndarray = quantity(
        "1",
        ("densities", "segments"),
        "smallest eigenvalue of the Riccati solution at the start, scaled by its diagonal",
    )
    critical_density: np.ndarray = quantity(
        "N sqrt(s)", ("segments",), "largest density at which the Riccati solution is singular; 0: none above 1"
    )


def compute(inputs, linearization: Linearization) -> FixedPointStudy:
    """Run Algorithm 1 in the reading's thrust unit and in units of the maximum thrust, and sweep the noise density."""
    problems = problems_of(inputs, linearization)
    units = tuple(dict.fromkeys((inputs.thrust_unit, inputs.maximum_thrust)))
    tolerance, limit = inputs.fixed_point_tolerance, inputs.fixed_point_iterations
    plant = segments.plant_noise_density(inputs)

    def run(problem, unit, boundary, order, **options):
        return fixed_point(
            problem.transition[-1],
            _gramian(problem),
            problem.initial_covariance,
            problem.final_covariance,
            inputs.noise_coefficient,
            **{"control_unit": unit, "boundary": boundary, "order": order, "tolerance": tolerance, **options},
        )

    runs = _table((units, BOUNDARIES, ORDERS, problems), lambda u, b, o, p: run(p, u, b, o, maximum_iterations=limit))
    exact = _table((units, BOUNDARIES, problems), lambda u, b, p: riccati_initial(_with(p, inputs, u, b)))
    loose = _table(
        (units, problems),
        lambda u, p: run(
            p,
            u,
            "algorithm_1",
            "jacobi",
            tolerance=LOOSE_TOLERANCE,
            tolerance_kind="absolute",
            maximum_iterations=limit,
        ),
    )

    def swept(density, order, problem):
        return fixed_point(
            problem.transition[-1],
            _gramian(problem),
            problem.initial_covariance,
            problem.final_covariance,
            density,
            order=order,
            tolerance=tolerance,
            maximum_iterations=min(limit, 100_000),
        )

    sweep = _table((DENSITIES, ORDERS, problems), swept)
    swept_exact = _table((DENSITIES, problems), lambda d, p: riccati_initial(replace(p, noise_density=d)))
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
        density=DENSITIES,
        sweep_iterations=_each(sweep, lambda r: r.iterations).astype(np.int64),
        sweep_converged=_each(sweep, lambda r: r.converged).astype(bool),
        sweep_error=_difference(sweep, swept_exact[:, np.newaxis]),
        smallest_eigenvalue=_each(swept_exact, _scaled_smallest_eigenvalue),
        critical_density=np.array([_critical_density(problem) for problem in problems]),
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


def _with(problem, inputs, unit, boundary):
    squared = equivalent_squared_noise_density(inputs.noise_coefficient, unit, boundary)
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


def _critical_density(problem):
    """Largest noise density (N sqrt(s)) at which Lambda(0) is singular, by bisection on its inertia from 1 to 1000."""

    def indefinite(density):
        return np.linalg.eigvalsh(riccati_initial(replace(problem, noise_density=density))).min() < 0

    densities = np.geomspace(1.0, 1000.0, 400)
    below = [density for density in densities if indefinite(density)]
    if not below:
        return 0.0
    low, high = below[-1], below[-1] * (densities[1] / densities[0])
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if indefinite(middle) else (low, middle)
    return float(low)
