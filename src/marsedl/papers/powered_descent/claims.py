"""Evaluation of every printed claim from the artifacts of one reading, and what is known about those that differ."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.covariance_steering.closed_form import predicted_covariance
from marsedl.models.dynamics.powered_descent import mass_flow_constant
from marsedl.montecarlo.outcomes import CRASHED
from marsedl.montecarlo.statistics import mean_standard_error
from marsedl.montecarlo.streaming import FinalMoments, observed_maxima, outcome_count
from marsedl.papers.powered_descent import segments
from marsedl.papers.powered_descent.inputs import PoweredDescentInputs
from marsedl.papers.powered_descent.records import (
    THRUST,
    Certificates,
    FixedPointStudy,
    FlightEnsemble,
    Gains,
    IntegratorError,
    Linearization,
    Nominal,
)
from marsedl.plotting.ellipses import probability_inside
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.claims import Declaration, Evaluation

STATE, MASS = slice(4), 4  # components of the final state
UPPER = ((0, 0, 0, 1, 1, 2), (1, 2, 3, 2, 3, 3))

# "Steered to the target": what a mission designer would call met, beyond sampling error. Stated before any run.
MEAN_TOLERANCE = 0.1  # of the target's standard deviation
COVARIANCE_TOLERANCE = 0.1  # of the target's variances and of their geometric means
SIGMAS = 3.0
JUMP = 0.01  # of the largest gain, or of the maximum thrust; less than this would not be called a jump
MINOR = 0.15  # a deviation of a variance by less than this is called minor
ROUNDING = 1e-6  # relative; two expressions closer than this are called equal


@dataclass(frozen=True)
class Records(Artifacts):
    """What the claims are measured from."""

    nominal: Nominal
    linearization: Linearization
    gains: Gains
    closed_loop: FlightEnsemble
    open_loop: FlightEnsemble
    fixed_point: FixedPointStudy | None = None
    certificates: Certificates | None = None
    integrator_error: IntegratorError | None = None
    closed_loop_large: FlightEnsemble | None = None
    open_loop_large: FlightEnsemble | None = None


def evaluate(inputs: PoweredDescentInputs, records: Records) -> dict[str, Evaluation | None]:
    """Evaluate every claim in one reading.

    Numbers come from the reading's largest ensembles, Fig. 7 from those of the paper's size. Claims that rest on a
    study which is not done for the reading are None.
    """
    large = records.closed_loop_large or records.closed_loop
    return {
        "alpha_from_isp": Evaluation(
            mass_flow_constant(inputs.vehicle.specific_impulse, inputs.vehicle.standard_gravity),
            evidence=f"1 / ({inputs.vehicle.specific_impulse:g} s x {inputs.vehicle.standard_gravity:g} m/s^2)",
        ),
        "fig3_ellipse_confidence": Evaluation(
            100 * probability_inside(inputs.drawing.ellipse_sigma),
            evidence=f"probability inside the {inputs.drawing.ellipse_sigma:g}-sigma ellipse of a Gaussian in the "
            "plane",
            numbers={"sigma_of_95": float(np.sqrt(-2 * np.log(0.05)))},
        ),
        "compute_effort": Evaluation(evidence="depends on the computer; the benchmark table states ours per trial"),
        **_mass_claims(records.nominal, large, records.open_loop),
        **_moment_claims(large, records.integrator_error),
        **_target_claims(inputs, records.nominal, records.linearization, records.gains, large),
        **_loop_claims(inputs, records.gains, large, records.open_loop_large or records.open_loop, records.closed_loop),
        **_variance_claims(inputs, records.gains, records.closed_loop, records.closed_loop_large),
        **_algorithm_claims(records.gains, records.fixed_point),
        **_theory_claims(records.certificates),
    }


def _mass_claims(nominal, ensemble, open_loop):
    mass = FinalMoments(ensemble, MASS)
    error = mean_standard_error(mass.variance, mass.count)
    prior = float(nominal.mass[-1])
    contraction = nominal.integrated_change[1:] / nominal.integrated_change[:-1]
    spread, deviation = FinalMoments(open_loop, MASS).population_deviation, np.sqrt(mass.variance)
    return {
        "prior_final_mass": Evaluation(
            prior,
            evidence=f"{prior:.4f} kg after {len(nominal.integrated_change)} passes; the first pass ends at "
            f"{nominal.mass_of_pass[1, -1]:.2f} kg",
        ),
        "mc_mean_final_mass": Evaluation(
            mass.mean, error, mass.count, f"standard deviation {deviation:.3f} kg", {"spread": deviation}
        ),
        "mc_mass_above_prior": Evaluation(
            bool(mass.mean - prior > SIGMAS * error),
            trials=mass.count,
            evidence=f"mean minus prior {mass.mean - prior:+.4f} kg, standard error {error:.4f} kg",
            numbers={"difference": mass.mean - prior},
        ),
        "mass_iteration_converges": Evaluation(
            bool((contraction < 1).all()),
            evidence=f"largest contraction factor {contraction.max():.3g} over {len(contraction) + 1} passes",
        ),
        "mass_variation_from_feedback_only": Evaluation(
            bool(spread < 1e-9 * mass.mean and mass.population_deviation > 1e-6 * mass.mean),
            evidence=f"standard deviation of the final mass {spread:.1e} kg open loop, "
            f"{mass.population_deviation:.2f} kg closed loop",
        ),
    }


def _moment_claims(ensemble, integrator_error):
    state = FinalMoments(ensemble, STATE)
    covariance, errors, trials = state.covariance, state.covariance_errors, state.count
    mean_numbers = {}
    if integrator_error is not None:
        euler = [str(name) for name in integrator_error.scheme].index("euler_maruyama")
        mean_numbers = {"euler_step": integrator_error.step[1], "euler_bias": integrator_error.bias[euler, 1, :4]}
    evidence = f"{ensemble.excluded} trials not finite, {outcome_count(ensemble, CRASHED)} below the ground"
    return {
        "mc_final_mean": Evaluation(
            state.mean,
            mean_standard_error(state.variance, trials),
            trials,
            evidence,
            mean_numbers,
        ),
        "mc_final_cov_diag": Evaluation(np.diag(covariance), np.diag(errors), trials, evidence),
        "mc_final_cov_upper": Evaluation(covariance[UPPER], errors[UPPER], trials, evidence),
        "mc_final_cov_lower": Evaluation(covariance[UPPER], errors[UPPER], trials, evidence),
    }


def _met(ensemble, index, mean, covariance):
    """Largest errors of mean and covariance in units of the target's standard deviations, and whether both are met."""
    scale = np.sqrt(np.diag(covariance))
    product = np.outer(scale, scale)
    measured = ensemble.covariance[index, :4, :4]
    sampling = np.sqrt((measured**2 + np.outer(np.diag(measured), np.diag(measured))) / (ensemble.count - 1))
    mean_error = np.abs(ensemble.mean[index, :4] - mean) / scale
    mean_limit = MEAN_TOLERANCE + SIGMAS * np.sqrt(np.diag(measured) / ensemble.count) / scale
    covariance_error = np.abs(measured - covariance) / product
    covariance_limit = COVARIANCE_TOLERANCE + SIGMAS * sampling / product
    return (
        (mean_error.max(), bool((mean_error <= mean_limit).all())),
        (covariance_error.max(), bool((covariance_error <= covariance_limit).all())),
    )


def _target_claims(inputs: PoweredDescentInputs, nominal, linearization, gains, ensemble):
    switch = np.flatnonzero(ensemble.segment == 0)[-1]
    (mean_error, mean_met), (covariance_error, covariance_met) = _met(
        ensemble, -1, inputs.mission.final_mean, inputs.mission.final_covariance
    )
    _, (switch_error, switch_met) = _met(
        ensemble, switch, inputs.mission.intermediate_mean, inputs.mission.intermediate_covariance
    )
    position = ensemble.covariance[: switch + 1, :2, :2]
    spread = np.sqrt(np.trace(position, axis1=1, axis2=2) / 2)
    divert = segments.divert_of(inputs.entry, inputs.mission, inputs.noise, inputs.design)
    second = segments.problems_of(divert, linearization)[1]
    wider = predicted_covariance(
        second, gains.riccati_initial[1], gains.noise_density_plant, 1.5 * inputs.mission.intermediate_covariance
    )[-1]
    scale = np.sqrt(np.diag(inputs.mission.final_covariance))
    excess = np.linalg.eigvalsh((wider - gains.covariance[-1]) / np.outer(scale, scale))
    trials = ensemble.count
    limits = f"limit {MEAN_TOLERANCE:g} for the mean, {COVARIANCE_TOLERANCE:g} for the covariance"
    rule = f"{limits}, plus {SIGMAS:g} standard errors"
    return {
        "final_mean_steered": Evaluation(
            mean_met, None, trials, f"largest error of the mean {mean_error:.4f} target standard deviations; {rule}"
        ),
        "final_cov_steered": Evaluation(
            covariance_met, None, trials, f"largest error of the covariance {covariance_error:.4f}, relative; {rule}"
        ),
        "intermediate_cov_met": Evaluation(
            switch_met, None, trials, f"largest error of the covariance at the switch {switch_error:.4f}; {rule}"
        ),
        "prior_mass_sufficient": Evaluation(
            mean_met and covariance_met,
            None,
            trials,
            f"errors of mean {mean_error:.4f} and covariance {covariance_error:.4f} with the plant's own mass; {rule}",
        ),
        "disperse_then_contract": Evaluation(
            bool(spread.max() > 1.1 * spread[0] and spread[-1] < spread[0]),
            None,
            trials,
            f"position standard deviation {spread[0]:.2f} m, then {spread.max():.2f} m at "
            f"{ensemble.time[spread.argmax()]:.1f} s, {spread[-1]:.2f} m at the switch",
        ),
        "segment2_depends_on_intermediate": Evaluation(
            bool(excess.min() > 0),
            evidence=f"with 1.5 times the covariance at the switch the final covariance exceeds the target by "
            f"{100 * excess.min():.3g} to {100 * excess.max():.3g} %",
        ),
    }


def _loop_claims(inputs: PoweredDescentInputs, gains, ensemble, open_loop, paper_size):
    without = FinalMoments(open_loop, STATE)
    difference, spread = without.mean - FinalMoments(ensemble, STATE).mean, without.population_deviation
    before, after = np.flatnonzero(gains.segment == 0)[-1], np.flatnonzero(gains.segment == 1)[0]
    gain_jump = np.abs(gains.gain[after] - gains.gain[before]).max() / np.abs(gains.gain).max()
    thrust = np.linalg.norm(gains.feedforward[[before, after]], axis=1) / inputs.vehicle.maximum_thrust
    largest = observed_maxima(ensemble, THRUST) / inputs.vehicle.maximum_thrust
    at_paper_size = observed_maxima(paper_size, THRUST).max() / inputs.vehicle.maximum_thrust
    trials = ensemble.count + ensemble.excluded
    return {
        "open_loop_mean_equals_closed_loop_mean": Evaluation(
            bool((np.abs(difference) < MEAN_TOLERANCE * spread).all()),
            None,
            open_loop.count,
            f"difference of the final means at most {np.abs(difference / spread).max():.4f} open-loop standard "
            f"deviations",
        ),
        "gain_jump_26s": Evaluation(
            bool(gain_jump > JUMP), evidence=f"largest jump of a gain {100 * gain_jump:.1f} % of the largest gain"
        ),
        "control_jump_26s": Evaluation(
            bool(abs(thrust[1] - thrust[0]) > JUMP),
            evidence=f"mean control jumps from {thrust[0]:.4f} to {thrust[1]:.4f} of the maximum thrust",
        ),
        "max_thrust_not_exceeded": Evaluation(
            bool(largest.max() < 1),
            None,
            trials,
            f"largest control {at_paper_size:.4f} of the maximum thrust in {paper_size.count:,} trials, "
            f"{largest.max():.4f} in {trials:,}",
            {"largest": at_paper_size},
        ),
    }


def _deviations(gains, ensemble):
    """Measured over predicted variance minus one of downrange and altitude at the outputs, (time, 2)."""
    deviations = np.empty((len(ensemble.time), 2))
    for number in (0, 1):
        known, wanted = gains.segment == number, ensemble.segment == number
        for axis in (0, 1):
            at = np.interp(ensemble.time[wanted], gains.time[known], gains.covariance[known, axis, axis])
            deviations[wanted, axis] = ensemble.covariance[wanted, axis, axis] / at - 1
    return deviations


def _variance_claims(inputs: PoweredDescentInputs, gains, ensemble, large):
    deviations = _deviations(gains, ensemble)
    sampling = np.sqrt(2 / (ensemble.count - 1))
    ends = np.abs(deviations[[0, -1]]).max()
    # The middle half of each segment.
    local = ensemble.time - np.where(ensemble.segment == 0, 0.0, inputs.mission.segment_durations[0])
    fraction = local / inputs.mission.segment_durations[ensemble.segment]
    middle = np.abs(deviations[(fraction > 0.25) & (fraction < 0.75)]).max()
    by_sampling = middle < SIGMAS * sampling
    cause = f"largest mid-segment deviation {100 * middle:.2f} %, {middle / sampling:.2f} sampling errors"
    remains = 0.0
    if large is not None:
        resolved = np.abs(_deviations(gains, large)).max()
        remains = resolved / np.sqrt(2 / (large.count - 1))
        cause += f"; {100 * resolved:.2f} % ({remains:.1f} sampling errors) remain with {large.count:,} trials"
    return {
        "var_endpoints_nearly_exact": Evaluation(
            bool(ends < SIGMAS * sampling),
            None,
            ensemble.count,
            f"largest deviation at start and end {100 * ends:.2f} %, sampling error {100 * sampling:.2f} %",
        ),
        "var_midcourse_minor_deviation": Evaluation(
            bool(sampling / 10 < middle < MINOR), None, ensemble.count, f"{cause}; minor is below {100 * MINOR:g} %"
        ),
        "midcourse_deviation_cause": Evaluation(bool(by_sampling or remains > SIGMAS), None, ensemble.count, cause),
    }


def _algorithm_claims(gains, study):
    if study is None:
        return {"alg1_meets_boundary_conditions": None, "q_invertible_all_t": None}
    boundary, order = list(study.boundary).index("algorithm_1"), list(study.order).index("jacobi")
    error = study.covariance_error[0, boundary]
    reached, iterations = study.converged[0, boundary, order], study.iterations[0, boundary, order]
    scale = np.sqrt(np.abs(np.diagonal(gains.riccati_initial, axis1=1, axis2=2)))
    scaled = gains.riccati_initial / (scale[:, :, np.newaxis] * scale[:, np.newaxis])
    smallest = np.abs(np.linalg.eigvalsh(scaled)).min()
    return {
        "alg1_meets_boundary_conditions": Evaluation(
            bool(reached.all() and error.max() < 1e-3),
            evidence=f"final variances off by {100 * error[0]:.3g} and {100 * error[1]:.3g} % after "
            f"{iterations[0]:,} and "
            f"{iterations[1]:,} iterations{'' if reached.all() else ', the limit'}, in units of {study.unit[0]:g} N",
            numbers={
                "error": 100 * error.max(),
                "iterations": iterations,
                "loose_iterations": study.loose_iterations[0],
                "loose_variance": study.loose_variance[0, 0, 0],
            },
        ),
        "q_invertible_all_t": Evaluation(
            bool(gains.escape_margin.min() > 0 and smallest > ROUNDING),
            evidence=f"smallest eigenvalue of R(t) {gains.escape_margin.min():.4f}, of the scaled Riccati solution "
            f"at the "
            f"start {smallest:.3g}",
            numbers={"critical": study.critical_density},
        ),
    }


def _theory_claims(certificates):
    if certificates is None:
        names = ("control_is_optimal", "eq23_equality", "eq37_equals_eq39", "eq46_boundary_conditions")
        return dict.fromkeys(names)
    mean, covariance = certificates.mean_cost_ratio, certificates.covariance_cost_ratio
    # Extrapolated to infinitely many intervals: second order for the mean, first order for the covariance.
    limits = (4 * mean[:, 1] - mean[:, 0]) / 3, 2 * covariance[:, 1] - covariance[:, 0]
    optimal = (certificates.solver_status == "optimal").all() and min(mean.min(), covariance.min()) > 1 - ROUNDING
    falling = (mean[:, 1] < mean[:, 0]).all() and (covariance[:, 1] < covariance[:, 0]).all()
    close = np.abs(limits[0] - 1).max() < 1e-3 and np.abs(limits[1] - 1).max() < 0.05
    gap = np.abs(certificates.index_eq20 - certificates.index_eq23) / np.abs(certificates.index_eq20)
    remainder = certificates.index_eq20 - certificates.index_eq23 - certificates.dropped_term
    spread = np.ptp(certificates.dropped_term, axis=1) / np.abs(certificates.dropped_term[:, 0])
    return {
        "control_is_optimal": Evaluation(
            bool(optimal and falling and close),
            evidence=f"costs of independent convex programs with {certificates.intervals[1]} held intervals over "
            f"closed "
            f"form: mean {mean[:, 1].min():.6f} to {mean[:, 1].max():.6f}, covariance {covariance[:, 1].min():.4f} to "
            f"{covariance[:, 1].max():.4f}; extrapolated {limits[0].max():.6f} and {limits[1].max():.4f}",
        ),
        "eq23_equality": Evaluation(
            bool(gap.max() < ROUNDING),
            evidence=f"the two differ by {100 * gap.min():.2g} to {100 * gap.max():.2g} %",
            numbers={"remainder": np.abs(remainder / certificates.index_eq20).max(), "spread": spread.max()},
        ),
        "eq37_equals_eq39": Evaluation(
            bool(certificates.costate_error_eq37.max() < ROUNDING),
            evidence=f"largest relative difference {certificates.costate_error_eq37.max():.1e}",
        ),
        "eq46_boundary_conditions": Evaluation(
            bool(certificates.eq46_residual.max() < ROUNDING),
            evidence=f"relative residual of Eq. 46 {certificates.eq46_residual.max():.3g} where Eq. 43 holds to "
            f"{certificates.h_identity_error.max():.1e}",
        ),
    }


DECLARATIONS = {
    "prior_final_mass": Declaration(
        "The converged prior profile ends at {value:.2f} kg, not at 1346 kg, and no choice of signs, mass-flow "
        "constant or "
        "number of passes gives 1346. As |u| is convex, the mean over trials must not lie above the prior, so the "
        "printed "
        "order of the two masses is reversed too.",
        errata=("E10",),
    ),
    "fig3_ellipse_confidence": Declaration(
        "The text's 3-sigma ellipses hold {value:.1f} % of a Gaussian in the plane; 95 % are {sigma_of_95:.3f} sigma.",
        errata=("E14",),
    ),
    "mc_final_mean": Declaration(
        "A correct simulation is unbiased. The printed mean altitude lies many standard errors off its target; an "
        "Euler-Maruyama run with a step of {euler_step:.2f} s is biased in the same direction "
        "({euler_bias[1]:+.3f} m, {euler_bias[2]:+.3f} m/s), but no step fits all four components.",
        errata=("E11",),
        withheld=("the integration scheme and its step",),
    ),
    "mc_final_cov_diag": Declaration(
        "The downrange variance is {value[0]:.3f} m^2 with the printed target of 5 m^2 and {target4[value][0]:.3f} m^2 "
        "with a target of 4 m^2, against 3.889 m^2 in the paper.",
        errata=("E7",),
    ),
    "mc_final_cov_lower": Declaration(
        "A covariance is symmetric; entry (2,1) is ten times entry (1,2), which reproduces.", errata=("E8", "E9")
    ),
    "mc_mass_above_prior": Declaration(
        "The mean over trials lies {difference:+.3f} kg from the prior: convexity of |u| forbids the printed order.",
        errata=("E10",),
    ),
    "eq23_equality": Declaration(
        "Eq. 23 drops a term of Eq. 20. It accounts for the whole difference (remainder {remainder:.1e}) and does "
        "not depend "
        "on the control (spread {spread:.1e}), so the minimiser is the same.",
        errata=("E12", "E13"),
    ),
    "eq46_boundary_conditions": Declaration("Eq. 46 has the noise coefficient on the wrong side.", errata=("E1",)),
    "alg1_meets_boundary_conditions": Declaration(
        "Lines 7 and 9 have the wrong power of the noise coefficient: the final variances are off by up to "
        "{error:.3g} %. "
        "In newtons, by accident of the units, it is {printed[error]:.3g} % after {printed[iterations][0]:,} and "
        "{printed[iterations][1]:,} iterations; with an absolute tolerance of 1e-3 it stops there after "
        "{printed[loose_iterations][0]} and {printed[loose_iterations][1]}, at a downrange variance of "
        "{printed[loose_variance]:.0f} m^2 at the switch.",
        errata=("E2", "E3", "E4"),
    ),
    "q_invertible_all_t": Declaration(
        "True wherever Q(0) exists; at critical noise densities (the largest are {critical[0]:.1f} and "
        "{critical[1]:.1f} "
        "N s^1/2) it does not.",
        errata=("E16",),
    ),
    "compute_effort": Declaration("It says nothing about the method; the benchmark table states our cost per trial."),
}
