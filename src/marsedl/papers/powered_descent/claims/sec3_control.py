"""Sec. III: the closed-form control, its theory and Algorithm 1."""

import numpy as np

from marsedl.papers.powered_descent.inputs import Studies
from marsedl.papers.powered_descent.records import Certificates, FixedPointStudy, Gains
from marsedl.replication.claims.counterexamples import replaced, scaled
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.claims.writing import check, claim, holds, measure


@claim(counterexample=scaled("certificates.mean_cost_ratio"))
def control_is_optimal(certificates: Certificates):
    mean, covariance = certificates.mean_cost_ratio, certificates.covariance_cost_ratio
    intervals = f"with {certificates.intervals[1]} held intervals"
    return holds(
        check("independent convex programs are solved", certificates.solver_status == "optimal"),
        measure("cost of the mean over the closed form's", mean) > 1 - ROUNDING,
        measure("cost of the covariance over the closed form's", covariance) > 1 - ROUNDING,
        measure(f"cost of the mean {intervals}", mean[:, 1]) < mean[:, 0],
        measure(f"cost of the covariance {intervals}", covariance[:, 1]) < covariance[:, 0],
        # Extrapolated to infinitely many intervals: second order for the mean, first order for the covariance.
        measure("extrapolated cost of the mean less one", np.abs((4 * mean[:, 1] - mean[:, 0]) / 3 - 1)) < 1e-3,
        measure("extrapolated cost of the covariance less one", np.abs(2 * covariance[:, 1] - covariance[:, 0] - 1))
        < 0.05,
    )


@claim(
    "Eq. 23 drops a term of Eq. 20 that is the same for every control.",
    errata="E12 E13",
    counterexample=replaced("certificates.dropped_term", 0.0),
)
def eq23_equality(certificates: Certificates):
    full, dropped = certificates.index_eq20, certificates.dropped_term
    difference = (np.abs(full - certificates.index_eq23) / np.abs(full)).max()
    remainder = np.abs((full - certificates.index_eq23 - dropped) / full).max()
    spread = (np.ptp(dropped, axis=1) / np.maximum(np.abs(dropped[:, 0]), 1e-300)).max()
    return holds(
        measure("term that completing the square leaves and Eq. 23 drops, of Eq. 20", np.abs(dropped / full))
        < ROUNDING,
        f"relative difference of Eqs. 20 and 23 up to {difference:.4g}, less the term {remainder:.1e}",
        f"from control to control the term changes by {spread:.1e}",
    )


@claim(counterexample=replaced("certificates.costate_error_eq37", 1e-3))
def eq37_equals_eq39(certificates: Certificates):
    return holds(measure("relative difference of Eqs. 37 and 39", certificates.costate_error_eq37) < ROUNDING)


@claim(
    "Eq. 46 has the noise coefficient on the wrong side.",
    errata="E1",
    counterexample=replaced("certificates.eq46_residual", 0.0),
)
def eq46_boundary_conditions(certificates: Certificates):
    return holds(
        measure("relative residual of Eq. 46", certificates.eq46_residual) < ROUNDING,
        f"Eq. 43 holds to {certificates.h_identity_error.max():.1e}",
    )


@claim(
    "Lines 7 and 9 have the wrong power of the noise coefficient.",
    errata="E2 E3 E4",
    counterexample=replaced("fixed_point.covariance_error", 0.0),
)
def alg1_meets_boundary_conditions(studies: Studies, fixed_point: FixedPointStudy):
    run = (0, list(fixed_point.boundary).index("algorithm_1"))
    order = list(fixed_point.order).index("jacobi")
    error, iterations = 100 * fixed_point.covariance_error[run], fixed_point.iterations[run][order]
    return holds(
        measure("error of the final variances", error, "%") < 0.1,
        check("Algorithm 1 converges in both segments", fixed_point.converged[run][order]),
        f"{iterations[0]:,} and {iterations[1]:,} iterations in units of {fixed_point.unit[0]:g} N",
        error=error.max(),
        iterations=iterations,
        loose=studies.fixed_point_loose_tolerance,
        loose_iterations=fixed_point.loose_iterations[0],
        loose_variance=fixed_point.loose_variance[0, 0, 0],
    )


@claim(
    "It holds wherever Q(0) exists.",
    errata="E16",
    by_construction="a Riccati solution that escapes on the way is an error of the design",
)
def q_invertible_all_t(gains: Gains, fixed_point: FixedPointStudy | None = None):
    scale = np.sqrt(np.abs(np.diagonal(gains.riccati_initial, axis1=1, axis2=2)))
    scaled = gains.riccati_initial / (scale[:, :, np.newaxis] * scale[:, np.newaxis])
    return holds(
        measure("eigenvalues of R(t)", gains.escape_margin) > 0,
        measure("eigenvalues of the scaled Riccati solution at the start", np.abs(np.linalg.eigvalsh(scaled)))
        > ROUNDING,
        critical=np.full(2, np.nan) if fixed_point is None else fixed_point.critical_density,
    )
