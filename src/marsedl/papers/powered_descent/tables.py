"""Tables: one reading's final state against Eq. 54, its studies, and what each reading reproduces."""

import numpy as np

from marsedl.montecarlo.statistics import (
    mean_standard_error,
    two_sample_covariance_deviance,
)
from marsedl.montecarlo.streaming import FinalMoments, observed_maxima
from marsedl.papers.powered_descent.claims import MASS, STATE, UPPER
from marsedl.papers.powered_descent.inputs import Mission
from marsedl.papers.powered_descent.records import THRUST, Certificates, FixedPointStudy, FlightEnsemble

NAMES = ("r1", "r2", "v1", "v2")


def printed_covariance(published):
    """Covariance of Eq. 54 (4, 4), made symmetric: entry (1,2) as above the diagonal (E8), others the mean (E9)."""
    upper = np.array(published["mc_final_cov_upper"].printed)
    lower = np.array(published["mc_final_cov_lower"].printed)
    both = (upper + lower) / 2
    both[0] = upper[0]
    covariance = np.diag(np.array(published["mc_final_cov_diag"].printed, dtype=float))
    covariance[UPPER] = both
    covariance[UPPER[::-1]] = both
    return covariance


def agreement(published, ensemble):
    """Likelihood-ratio tests of the printed covariance against an ensemble's: whole, and without downrange position."""
    printed, trials = printed_covariance(published), published["mc_final_cov_diag"].trials
    state = FinalMoments(ensemble, STATE)
    whole = two_sample_covariance_deviance(printed, trials, state.covariance, state.count)
    return whole, two_sample_covariance_deviance(printed[1:, 1:], trials, state.covariance[1:, 1:], state.count)


def eq54(published, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None):
    """Mean and covariance of the final state beside Eq. 54, with standard errors and distances in standard errors."""
    ensemble = closed_loop_large or closed_loop
    state = FinalMoments(ensemble, STATE)
    trials = published["mc_final_mean"].trials
    share = np.sqrt(state.count / trials)  # the paper's sampling error in units of ours
    rows = [("quantity", "in the paper", "here", "standard error", "paper's standard error", "z", "trials")]

    def row(name, printed, value, error):
        z = (printed - value) / (error * np.hypot(1.0, share))
        rows.append(
            (
                name,
                f"{printed:.4f}",
                f"{value:.4f}",
                f"{error:.4f}",
                f"{error * share:.4f}",
                f"{z:+.1f}",
                f"{state.count}",
            )
        )

    means, errors = state.mean, mean_standard_error(state.variance, state.count)
    for i, name in enumerate(NAMES):
        row(f"mean {name}", published["mc_final_mean"].printed[i], means[i], errors[i])
    printed, covariance, errors = printed_covariance(published), state.covariance, state.covariance_errors
    for i in range(4):
        for j in range(i, 4):
            name = f"var {NAMES[i]}" if i == j else f"cov {NAMES[i]}, {NAMES[j]}"
            row(name, printed[i, j], covariance[i, j], errors[i, j])
    for name, test in zip(("whole covariance", "without r1"), agreement(published, ensemble), strict=True):
        statistic = f"deviance {test.statistic:.1f} on {test.degrees_of_freedom}"
        rows.append((name, "", statistic, "", "", f"p = {test.p_value:.2g}", f"{state.count}"))
    return rows


def algorithm_1(mission: Mission, fixed_point: FixedPointStudy):
    """Runs of Algorithm 1 in both thrust units: iterations, distance from the closed form, final variances."""
    rows = [
        (
            "thrust unit (N)",
            "boundary condition",
            "order",
            "iterations (segments 1, 2)",
            "tolerance reached",
            "error against the closed form of the equivalent noise",
            "largest error of the final variances (%)",
        )
    ]
    study = fixed_point
    for unit, boundary, order in np.ndindex(study.iterations.shape[:3]):
        run = (unit, boundary, order)
        jacobi = study.order[order] == "jacobi"
        rows.append(
            (
                f"{study.unit[unit]:g}",
                str(study.boundary[boundary]),
                str(study.order[order]),
                ", ".join(f"{number:,}" for number in study.iterations[run]),
                ", ".join("yes" if reached else "no" for reached in study.converged[run]),
                ", ".join(f"{error:.1e}" for error in study.riccati_error[run]),
                ", ".join(f"{100 * error:.3g}" for error in study.covariance_error[unit, boundary]) if jacobi else "",
            )
        )
    for unit in range(len(study.unit)):
        target = np.diag(mission.intermediate_covariance), np.diag(mission.final_covariance)
        errors = [np.abs(v / t - 1).max() for v, t in zip(study.loose_variance[unit], target, strict=True)]
        rows.append(
            (
                f"{study.unit[unit]:g}",
                "algorithm_1",
                "jacobi, absolute 1e-3",
                ", ".join(f"{number:,}" for number in study.loose_iterations[unit]),
                "",
                "",
                ", ".join(f"{100 * error:.3g}" for error in errors),
            )
        )
    return rows


def certificates(certificates: Certificates):
    """Distances of the design from its independent checks, by segment."""
    checks = (
        ("final covariance by Eq. 40, forward, against the target", "covariance_error"),
        ("Riccati solution at the end by Eq. 21, forward", "riccati_error"),
        ("G^2 Sigma^-1 = H + Lambda, H by Eq. 42", "h_identity_error"),
        ("initial costate of Eq. 39 against the closed form", "costate_error_eq39"),
        ("initial costate of Eq. 37 against Eq. 39", "costate_error_eq37"),
    )
    rows = [("check (relative errors; costs over closed form)", "segment 1", "segment 2")]
    rows += [(name, *(f"{value:.1e}" for value in getattr(certificates, field))) for name, field in checks]
    rows.append(
        ("final mean by Eq. 31, forward (m, m/s)", *(f"{np.abs(e).max():.1e}" for e in certificates.mean_error))
    )
    for number, intervals in enumerate(certificates.intervals):
        mean, covariance = certificates.mean_cost_ratio[:, number], certificates.covariance_cost_ratio[:, number]
        rows.append((f"cost of the mean, {intervals} held intervals", *(f"{value:.7f}" for value in mean)))
        rows.append((f"cost of the covariance, {intervals} held intervals", *(f"{value:.4f}" for value in covariance)))
        status = (
            f"{s}, {i} iterations"
            for s, i in zip(
                certificates.solver_status[:, number], certificates.solver_iterations[:, number], strict=True
            )
        )
        rows.append((f"semidefinite solver, {intervals} held intervals", *status))
    return rows


def readings(readings, published):
    """What each reading reproduces: its noise and target, the masses, and the tests of the printed covariance.

    readings: inputs and `Records` by reading. published: claims by id. Returns rows of text.
    """
    rows = [
        (
            "reading",
            "design / plant noise (N s^1/2)",
            "target var r1 (m^2)",
            "prior final mass (kg)",
            "mean final mass (kg)",
            "largest error of the predicted final variances (%)",
            "deviance, 10 dof",
            "p",
            "deviance without r1, 6 dof",
            "p (without r1)",
            "largest thrust / maximum",
            "trials",
        )
    ]
    for name, (inputs, records) in readings.items():
        gains, nominal, paper_size = records.gains, records.nominal, records.closed_loop
        ensemble = records.closed_loop_large or paper_size
        target = np.diag(inputs.mission.final_covariance)
        whole, rest = agreement(published, ensemble)
        mass = FinalMoments(ensemble, MASS)
        rows.append(
            (
                name,
                f"{gains.noise_density_design:.4g} / {gains.noise_density_plant:.4g}",
                f"{target[0]:g}",
                f"{nominal.mass[-1]:.3f}",
                f"{mass.mean:.3f} ± {mean_standard_error(mass.variance, mass.count):.3f}",
                f"{100 * np.abs(np.diag(gains.covariance[-1]) / target - 1).max():.3g}",
                f"{whole.statistic:.1f}",
                f"{whole.p_value:.2g}",
                f"{rest.statistic:.1f}",
                f"{rest.p_value:.2g}",
                f"{observed_maxima(paper_size, THRUST).max() / inputs.vehicle.maximum_thrust:.3f}",
                f"{mass.count}",
            )
        )
    return rows
