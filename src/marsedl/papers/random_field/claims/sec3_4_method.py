"""Secs. III and IV: the steering problem and its convex program."""

from marsedl.papers.random_field.records import Certificates
from marsedl.replication.claims.counterexamples import scaled, shifted
from marsedl.replication.claims.thresholds import ROUNDING, VISIBLE, WEAK
from marsedl.replication.claims.writing import claim, holds, measure

EXACT = 1e-9  # of an identity between matrices whose entries are of order one to hundred
SAME_OPTIMUM = 1e-6  # relative, of the costs that two solvers or two formulations find
LARGEST_SCORE = 5.0  # standard errors: dozens of comparisons are made, and the largest of them judged


@claim(counterexample=scaled("certificates.history_information"))
def history_feedback_needed(certificates: Certificates):
    share = 100 * certificates.history_information
    subject = "variance of the next state that the state before the last explains, when the last is known"
    return holds(measure(subject, share, "%") > 100 * VISIBLE, "a Markov process has none")


@claim(counterexample=scaled("certificates.process_score"))
def psi_hat_statistics(certificates: Certificates):
    subject = f"of {certificates.samples:,} sampled fields along the nominal"
    mean, covariance = certificates.process_mean_score, certificates.process_score
    return holds(
        measure(f"largest distance of the mean {subject} from that of the field", mean, "standard errors")
        < LARGEST_SCORE,
        measure(f"largest distance of the covariance {subject} from Eq. 16c", covariance, "standard errors")
        < LARGEST_SCORE,
        trials=certificates.samples,
    )


@claim(counterexample=scaled("certificates.disturbance_score"))
def w_joint_gaussian(certificates: Certificates):
    subject = f"distance from Eq. 26 of the covariance of disturbances along {certificates.samples:,} sampled fields"
    return holds(
        measure(
            "distance of the mean of the disturbances from Eq. 25",
            certificates.disturbance_mean_score,
            "standard errors",
        )
        < LARGEST_SCORE,
        measure(subject, certificates.disturbance_score, "standard errors") < LARGEST_SCORE,
        measure(
            "distance of their skewness and excess kurtosis from a normal one's",
            certificates.normality_score,
            "standard errors",
        )
        < LARGEST_SCORE,
        trials=certificates.samples,
    )


@claim(counterexample=scaled("certificates.largest_correlation"))
def w_correlated(certificates: Certificates):
    correlation = certificates.largest_correlation
    return holds(measure("largest correlation of disturbances of different intervals", correlation) > WEAK)


@claim(counterexample=shifted("certificates.deviation_ratio"))
def w_not_identical(certificates: Certificates):
    ratio = certificates.deviation_ratio
    return holds(measure("largest ratio of the deviations of two intervals' disturbances", ratio) > 1.0 + VISIBLE)


@claim(
    "With Eqs. 29, 33 and 39 corrected.",
    errata="E14 E15",
    by_construction="An identity of linear systems, of which only rounding is left.",
)
def mean_from_v_covariance_from_gains(certificates: Certificates):
    return holds(
        measure("shift of the deviations by another mean control, of the largest", certificates.mean_shift) < EXACT,
        measure("shift of the undisturbed states by feedback", certificates.gain_shift) < EXACT,
    )


@claim(by_construction="These are identities between matrices. Only rounding is left of them.")
def l_variable_identities(certificates: Certificates):
    return holds(
        measure("departure of (I + B L)(I - B K) from the identity", certificates.identity_residual) < EXACT,
        measure("entries of L above its block diagonal", certificates.triangular_residual) < EXACT,
        measure("difference of Cov(U) from L and from the innovations", certificates.control_covariance_residual)
        < EXACT,
    )


@claim(
    "With navigation errors in the design. Without them its gains are unbounded.",
    errata="E8 E9",
    counterexample=scaled("certificates.history_objective"),
)
def subproblem_convex(certificates: Certificates):
    def apart(other):
        return abs(other - certificates.objective) / max(abs(other), abs(certificates.objective))

    forms, solvers = apart(certificates.history_objective), apart(certificates.other_objective)
    return holds(
        measure("least excess of chords over the cost along random segments", certificates.convexity) > -ROUNDING,
        measure("relative difference of the least costs of the printed and the innovations form", forms) < SAME_OPTIMUM,
        measure(f"relative difference of those by Clarabel and {certificates.other_solver}", solvers) < SAME_OPTIMUM,
    )
