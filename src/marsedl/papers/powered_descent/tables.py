"""The final state against Eq. 54, and the studies."""

import numpy as np

from marsedl.montecarlo import statistics
from marsedl.papers.powered_descent.claims.measures import MOTION_PART, printed_covariance
from marsedl.papers.powered_descent.records import (
    Certificates,
    FixedPointStudy,
    FlightEnsemble,
)
from marsedl.replication.records.tables import Column, frame, table

NAMES, UNITS = ("r1", "r2", "v1", "v2"), ("m", "m", "m/s", "m/s")
VARIANCE_ERROR = "largest error of the final variances"


def agreement(published, ensemble):
    """Likelihood-ratio tests of the printed covariance against an ensemble's: whole, and without downrange position."""
    printed, trials = printed_covariance(published), published["mc_final_cov_diag"].trials
    state = ensemble.final_state[:, MOTION_PART]
    covariance, deviance = statistics.covariance(state), statistics.two_sample_covariance_deviance
    whole = deviance(printed, trials, covariance, len(state))
    return whole, deviance(printed[1:, 1:], trials, covariance[1:, 1:], len(state))


def eq54(published, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None):
    """Mean and covariance of the final state beside Eq. 54, with standard errors and distances in standard errors."""
    ensemble = closed_loop_large or closed_loop
    state = ensemble.final_state[:, MOTION_PART]
    trials = published["mc_final_mean"].trials
    share = np.sqrt(len(state) / trials)  # the paper's sampling error in units of ours
    rows = []

    def row(name, unit, printed, value, error):
        z = (printed - value) / (error * np.hypot(1.0, share))
        rows.append((name, unit, printed, value, error, error * share, z, len(state)))

    means, errors = state.mean(axis=0), statistics.mean_standard_error(statistics.variance(state), len(state))
    for i, name in enumerate(NAMES):
        row(f"mean {name}", UNITS[i], published["mc_final_mean"].printed[i], means[i], errors[i])
    printed, covariance = printed_covariance(published), statistics.covariance(state)
    errors = statistics.covariance_standard_errors(state)
    for i in range(4):
        for j in range(i, 4):
            name = f"var {NAMES[i]}" if i == j else f"cov {NAMES[i]}, {NAMES[j]}"
            unit = ("m^2", "m^2/s", "m^2/s^2")[(i > 1) + (j > 1)]
            row(name, unit, printed[i, j], covariance[i, j], errors[i, j])
    return table(
        rows,
        {
            "quantity": Column(
                meaning="of the final state: positions r1 (downrange), r2 (altitude), velocities v1, v2"
            ),
            "unit": Column(meaning="of the four numbers that follow it"),
            "in the paper": Column("", ".4f"),
            "here": Column("", ".4f", "over the trials", error="standard error"),
            "standard error": Column("", ".4f", "of the number here"),
            "paper's standard error": Column("", ".4f", f"of the printed number, from its {trials:,} trials"),
            "z": Column("", "+.1f", "printed minus here, over the combined standard error"),
            "trials": Column(),
        },
    )


def eq54_tests(published, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None):
    """Likelihood-ratio tests of the covariance of Eq. 54 against that of the trials."""
    tests = agreement(published, closed_loop_large or closed_loop)
    trials = (closed_loop_large or closed_loop).count
    rows = [
        (name, test.statistic, test.degrees_of_freedom, test.p_value, trials)
        for name, test in zip(("whole covariance", "without r1"), tests, strict=True)
    ]
    return table(
        rows,
        {
            "part": Column(meaning="of the covariance that is tested"),
            "deviance": Column("", ".1f", "likelihood-ratio statistic"),
            "degrees of freedom": Column(),
            "p": Column("", ".2g", "probability of a larger deviance if both have the same covariance"),
            "trials": Column(),
        },
    )


def algorithm_1(fixed_point: FixedPointStudy):
    """Runs of Algorithm 1 in both thrust units: iterations, distance from the closed form, final variances."""
    runs = frame(
        fixed_point,
        "iterations",
        "converged",
        unit=Column(label="thrust unit", digits="g"),
        riccati_error=Column(digits=".1e", label="error against the closed form of the equivalent noise"),
        covariance_error=Column("%", ".3g", label=VARIANCE_ERROR),
    )
    # The variances are those of the runs in the printed order alone.
    return runs.assign(**{f"{VARIANCE_ERROR} (%)": runs[f"{VARIANCE_ERROR} (%)"].where(runs["order"] == "jacobi")})


def certificates(certificates: Certificates):
    """Distances of the design from its independent checks, by segment."""
    fields = ("covariance_error", "riccati_error", "h_identity_error", "costate_error_eq39", "costate_error_eq37")
    return frame(certificates, **dict.fromkeys((*fields, "mean_error"), ".1e"))


def certified_costs(certificates: Certificates):
    """Costs of convex programs with held controls over those of the closed form, by segment and held intervals."""
    return frame(
        certificates,
        "solver_status",
        "solver_iterations",
        intervals=Column(label="held intervals"),
        mean_cost_ratio=".7f",
        covariance_cost_ratio=".4f",
    )
