"""Evaluation of every printed claim from the artifacts of one reading, and what is known about those that differ."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from marsedl.methods.covariance_steering.steering_program import upper_quantile
from marsedl.models import orbits, random_field
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field import environment
from marsedl.papers.random_field.components import BANK_COSINE, DENSITY_VARIATION, DYNAMIC_PRESSURE, FLIGHT_PATH_ANGLE
from marsedl.papers.random_field.double_integrator import ellipse_radius, normals_and_bounds, tail
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.flight_statistics import LEVEL, delta_v_percentile, lost, step_violations
from marsedl.papers.random_field.inputs import RandomFieldInputs
from marsedl.papers.random_field.records import (
    BRANCHES,
    CAPTURED,
    CLOSED,
    LOW_ALTITUDE,
    OUTCOMES,
    VARIANTS,
    Certificates,
    Convergence,
    DoubleIntegrator,
    DoubleIntegratorFlights,
    FieldStudy,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    Regularization,
)
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.claims import Declaration, Evaluation

OPEN = 0  # the law without control; the last one is that of the last iteration
STATED_TAIL = 0.1  # p_f of the sentence behind Eq. 76, whatever the reading takes

# What the tests of statements call so, and why. Fixed before the first evaluation, when percentiles, deviations and
# mean controls of the laws were known; HIT and what lost trials decide came after it.
SIGMAS = 3.0  # beyond sampling error
CONFIDENCE = 0.9973  # the same, of binomial intervals
ROUNDING = 1e-6  # relative; closer than this is equal
EXACT = 1e-9  # of an identity between matrices whose entries are of order one to hundred
SAME_OPTIMUM = 1e-6  # relative, of the costs that two solvers or two formulations find
LARGEST_SCORE = 5.0  # standard errors: dozens of comparisons are made, and the largest of them judged
DEPENDENT = 0.1  # correlation from which disturbances are called dependent
UNLIKE = 2.0  # ratio of standard deviations from which distributions are called different
INFORMATIVE = 0.1  # share of the remaining variance that earlier states must explain, or history is not "needed"
NEAR = 0.25  # of the field's deviation: samples pass near a value
CONSTANT = 0.01  # of the field's deviation: an edge is constant
EDGE_POINTS = 20  # intervals between the points at which an edge is held
HIT = 2.5e-3  # planet radii; the last digit of the printed entry angle moves the apoapsis by about as much
BENEFIT = 0.01  # relative fall of the percentile from which shorter steps are a benefit
APPROXIMATE = 0.05  # relative: two percentiles closer than this are "approximately equal"
KEPT = 0.5  # share of the predicted reduction that flights must keep for the prediction to serve
SOURCE = 0.5  # share of the error that must vanish with the absolute value
MISFIT = 0.25  # distance of distribution functions: a quarter of the trials lie elsewhere than predicted
ALMOST_ZERO = 0.1  # mean control: no more than one iteration may change it
HALF_WINDOW = 12.5  # s about the peak of dynamic pressure: a window as long as the intervals there
UNLIKELY = 0.01  # probability; the sentence names none, that of Eq. 77 is told in the evidence
SLIGHTLY = 0.1  # of the control, beyond its limits
LARGER = 1.1  # factor from which a deviation is called larger
AGREES = 0.1  # relative, of a standard deviation


@dataclass(frozen=True)
class Records(Artifacts):
    """What the claims are measured from."""

    nominal: Nominal
    linearization: Linearization
    gains: Gains
    aerocapture: FlightEnsemble
    certificates: Certificates | None = None
    convergence: Convergence | None = None
    regularization: Regularization | None = None
    field_study: FieldStudy | None = None
    double_integrator: DoubleIntegrator | None = None
    double_integrator_flights: DoubleIntegratorFlights | None = None


def evaluate(inputs: RandomFieldInputs, records: Records) -> dict[str, Evaluation | None]:
    """Evaluate every claim in one reading.

    Numbers come from all trials of the reading; lost trials count as worse than any other. Claims that rest on a study
    which is not done for the reading are None. Where a reading has no law but the open loop, numbers of the closed loop
    are NaN and statements about it are not met.
    """
    flown = _Flown(records.gains, records.aerocapture)
    return {
        **_stated_inputs(inputs),
        **_example_claims(inputs),
        **_theory_claims(records.certificates),
        **_double_integrator_claims(inputs, records.double_integrator, records.double_integrator_flights),
        **_nominal_claims(inputs, records.nominal, records.convergence),
        **_delta_v_claims(inputs, flown, records.convergence, records.regularization, records.field_study),
        **_control_claims(inputs, records.nominal, flown),
        **_prediction_claims(inputs, flown),
    }


# ---- shared measures -------------------------------------------------------------------------------------------------


def chance_of_more(count, trials, probability):
    """Probability of `count` or more of `trials` if each has the given one: p-value of a one-sided binomial test."""
    from scipy.special import betainc

    count = np.asarray(count, dtype=float)
    at_least_one = np.maximum(count, 1.0)
    return np.where(count > 0, betainc(at_least_one, trials - at_least_one + 1.0, probability), 1.0)


def exceeds(count, trials, probability, level=CONFIDENCE):
    """Whether so many trials show, by a one-sided binomial test, that the probability is larger than the given one."""
    return chance_of_more(count, trials, probability) < (1.0 - level) / 2.0


def normal_violation(mean, deviation, limits):
    """Probability that a normal variable lies beyond either of two limits."""
    from scipy.special import ndtr

    with np.errstate(divide="ignore", invalid="ignore"):  # without any deviation it lies where its mean is
        scaled = (np.asarray(mean) - limits[0]) / deviation, (limits[1] - np.asarray(mean)) / deviation
    certain = np.where((np.asarray(mean) < limits[0]) | (np.asarray(mean) > limits[1]), 1.0, 0.0)
    return np.where(np.asarray(deviation) > 0.0, sum(ndtr(-distance) for distance in scaled), certain)


def distribution_distance(sample, mean, deviation):
    """Largest difference of the distribution function of a sample from a normal one (Kolmogorov)."""
    from scipy.special import ndtr

    ordered = np.sort(sample)
    if not len(ordered) or not np.isfinite(mean) or not deviation > 0.0:
        return np.nan
    expected = ndtr((ordered - mean) / deviation)
    rank = np.arange(len(ordered) + 1) / len(ordered)
    return float(max((rank[1:] - expected).max(), (expected - rank[:-1]).max()))


def node_rows(ensemble, partition):
    """Rows of the stored times that are the nodes of a partition."""
    return np.abs(ensemble.time - np.asarray(partition)[:, np.newaxis]).argmin(axis=1)


def node_deviations(gains, ensemble, law):
    """Deviations of radius, velocity and path angle at the nodes, flown and predicted: two arrays (nodes, 3)."""
    rows = node_rows(ensemble, gains.partition)
    states = slice(0, FLIGHT_PATH_ANGLE + 1)
    flown = np.diagonal(ensemble.covariance[law, rows, states, states], axis1=1, axis2=2)
    return np.sqrt(flown), np.sqrt(np.diagonal(gains.covariance[law], axis1=1, axis2=2))


def commanded(gains, ensemble, law):
    """Mean and standard deviation of the commanded control in every interval, over the trials, two arrays."""
    rows = node_rows(ensemble, gains.partition[:-1])
    variance = ensemble.covariance[law, rows, BANK_COSINE, BANK_COSINE]
    return ensemble.mean[law, rows, BANK_COSINE], np.sqrt(np.maximum(variance, 0.0))


def outcomes(ensemble, law):
    """How many trials of a law were lost and how, in words; empty if none was."""
    found = ensemble.outcome[law]
    return ", ".join(
        f"{(found == code).sum():,} {text}" for code, text in OUTCOMES.items() if code != CAPTURED and code in found
    )


class _Flown:
    """What the flights of all laws give."""

    def __init__(self, gains, ensemble):
        self.gains, self.ensemble = gains, ensemble
        self.trials = ensemble.outcome.shape[1]
        self.laws = range(len(gains.control))
        self.last = self.laws[-1]
        self.designed = self.last > OPEN
        percentiles = [delta_v_percentile(ensemble, law, LEVEL) for law in self.laws]
        self.percentile, self.error = (np.array(values) for values in zip(*percentiles, strict=True))
        self.lost = lost(ensemble)
        self.complete = bool((self.lost <= (1.0 - LEVEL) * self.trials).all())
        captured = [found[np.isfinite(found)] for found in ensemble.delta_v]
        self.delta_v = captured
        self.mean = np.array([found.mean() if len(found) else np.nan for found in captured])
        self.deviation = np.array([found.std(ddof=1) if len(found) > 1 else np.nan for found in captured])
        self.violations, self.any_violations = step_violations(ensemble, gains.partition)
        self.distance = np.array(
            [
                distribution_distance(captured[law], gains.delta_v_mean[law], gains.delta_v_deviation[law])
                for law in self.laws
            ]
        )
        self.offset = self.mean - gains.delta_v_mean

    @property
    def why_not(self):
        """Why statements about the closed loop are not met, in words; empty where there is one."""
        return "" if self.designed else f"no law but the open loop: {self.gains.refused}"

    @property
    def lost_trials(self):
        """Lost trials of all laws in words, to be added to a sentence."""
        if not self.lost.any():
            return ""
        return f"; of {self.trials:,} trials are lost " + ", ".join(f"{count:,}" for count in self.lost)

    def percentiles(self):
        """The percentile of every law in words."""
        return ", ".join(
            f"{value:.1f} ± {error:.1f}" if np.isfinite(value) else f"none ({count:,} lost)"
            for value, error, count in zip(self.percentile, self.error, self.lost, strict=True)
        )


def _statement(flown, met, evidence, numbers=None, distribution=False):
    """A statement about the closed loop: not met where there is none.

    distribution: whether it is about the distribution of the trials, of which those captured tell little if many are
    lost; then it is not met either.
    """
    if not flown.designed:
        return Evaluation(False, None, flown.trials, flown.why_not, dict.fromkeys(numbers or {}, np.nan))
    met = met and (flown.complete or not distribution)
    return Evaluation(bool(met), None, flown.trials, evidence + flown.lost_trials, numbers or {})


def _listed(values, form=".3f"):
    return ", ".join(f"{value:{form}}" if np.isfinite(value) else "none" for value in values)


# ---- stated inputs ---------------------------------------------------------------------------------------------------


def _stated_inputs(inputs: RandomFieldInputs):
    partition = [float(node) for node in inputs.mission.partition]
    normals, bounds = normals_and_bounds(inputs.point_mass)
    apex = np.linalg.solve(normals, bounds)
    percentile_weight = float(inputs.guidance.percentile_weight)
    values = {
        "dint_x0_mean": inputs.point_mass.double_integrator_initial_mean,
        "dint_x0_three_sigma": inputs.point_mass.double_integrator_initial_three_sigma,
        "dint_field_parameters": [
            inputs.point_mass.double_integrator_variance,
            inputs.point_mass.double_integrator_period,
            inputs.point_mass.double_integrator_periodic_length,
            inputs.point_mass.double_integrator_length,
        ],
        "dint_partition": inputs.point_mass.double_integrator_partition,
        "dint_n": len(inputs.point_mass.double_integrator_partition) - 1,
        "dint_xf_mean": inputs.point_mass.double_integrator_final_mean,
        "dint_pf_equals_p0": bool(
            np.array_equal(
                inputs.point_mass.double_integrator_final_three_sigma,
                inputs.point_mass.double_integrator_initial_three_sigma,
            )
        ),
        "dint_constraint_probability": inputs.point_mass.double_integrator_probability,
        "dint_a1": inputs.point_mass.double_integrator_first_normal,
        "dint_a2": inputs.point_mass.double_integrator_second_normal,
        "dint_alpha": inputs.point_mass.double_integrator_bounds,
        "dint_p_x": tail(inputs.point_mass),
        "dint_weights": [*inputs.point_mass.double_integrator_weights, 0.0, 0.0],  # neither state weight nor percentile
        "dint_iterations": 1,  # with linear dynamics a second one would change nothing
        "dint_initial_guess": 0,
        "dint_trials": inputs.point_mass.double_integrator_trials,
        "dint_ellipse_level": 100.0 * inputs.point_mass.ellipse_probability,
        "acap_ballistic_coefficient": inputs.vehicle.ballistic_coefficient,
        "acap_lift_to_drag": inputs.vehicle.lift_to_drag,
        "acap_planet_radius": inputs.planet.planet_radius / 1e3,
        "acap_gravitational_parameter": inputs.planet.gravitational_parameter,
        "acap_entry_altitude": inputs.vehicle.entry_altitude / 1e3,
        "acap_entry_speed": inputs.vehicle.entry_velocity / 1e3,
        "acap_initial_covariance": float((inputs.vehicle.initial_deviations**2).sum()),
        "acap_h_scale": inputs.air.correlation_length / 1e3,
        "acap_sigma2_max": inputs.air.variance_at_top,
        "acap_h_trans": inputs.air.variance_top_altitude / 1e3,
        "acap_c_scale": inputs.air.variance_growth_length / 1e3,
        "acap_final_time": inputs.mission.final_time,
        "acap_target_radii": [inputs.mission.target_apoapsis, inputs.mission.target_periapsis],
        "acap_p_f": inputs.guidance.percentile_tail,
        "acap_control_bounds": inputs.vehicle.control_limits,
        "acap_control_probability": inputs.guidance.control_probability,
        "acap_weights": [
            inputs.guidance.control_variance_weight,
            inputs.guidance.mean_control_weight,
            percentile_weight,
        ],
        "acap_trust_control": [inputs.guidance.control_trust, 1.0],
        "acap_trust_apoapsis": inputs.guidance.apoapsis_trust,
        "acap_trust_state_intermediate": 0.0,
        "acap_iterations": inputs.guidance.iterations,
        "acap_initial_guess": 0.0,
        "acap_trials": inputs.simulation.trials,
        "acap_fig12_window": inputs.drawing.delta_v_window,
    }
    return {
        **{name: Evaluation(value) for name, value in values.items()},
        "dint_constraint_apex": Evaluation(
            np.round(apex, 4),
            evidence=f"the lines of the two normal vectors meet at ({apex[0]:.6f}, {apex[1]:.6f}), rounded here",
        ),
        "acap_partition": Evaluation([*partition[:3], *partition[-3:]], evidence=f"{len(partition)} nodes"),
        "acap_cost_percentile": Evaluation(
            100.0 * LEVEL,
            evidence=f"reported; the percentile that the design makes small is the "
            f"{100 * (1 - inputs.guidance.percentile_tail):g}th, see acap_p_f",
        ),
    }


# ---- illustrations (Sec. II) -----------------------------------------------------------------------------------------


def _example_claims(inputs: RandomFieldInputs):
    """Figs. 1 and 2, by the exact mean and covariance of the conditioned fields."""
    line = partial(random_field.squared_exponential, variance=1.0, length=inputs.drawing.example_length)
    places, values = inputs.drawing.example_positions, inputs.drawing.example_values
    mean, covariance = random_field.condition(line, places, places, values, inputs.drawing.example_noise**2)
    distance = np.sqrt((mean - values) ** 2 + np.maximum(np.diag(covariance), 0.0)).max()
    before = np.sqrt(values**2 + 1.0).min()

    plane = partial(random_field.squared_exponential, variance=1.0, length=np.full(2, inputs.drawing.example_length))
    extent = inputs.drawing.example_extent
    held, shown = (_edges(extent, EDGE_POINTS * finer) for finer in (1, 4))
    opposite = np.array([[0.0, extent]])
    mean, covariance = random_field.condition(
        plane, np.concatenate([shown, opposite]), held, np.full(len(held), inputs.drawing.example_edge), 0.0
    )
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    off = (np.abs(mean - inputs.drawing.example_edge) + SIGMAS * spread)[:-1].max()
    return {
        "conditioned_1d_samples": Evaluation(
            bool(distance < NEAR),
            evidence=f"root mean square distance of conditioned samples from the {len(places)} measured values at most "
            f"{distance:.3f} deviations of the field, before conditioning at least {before:.2f}; near is {NEAR:g}",
        ),
        "conditioned_2d_right_edges": Evaluation(
            bool(off < CONSTANT),
            evidence=f"held at {len(held)} points of two adjacent edges, the field departs from the constant on these "
            f"edges by at most {off:.1e} of its deviation (mean and three sigma); in the opposite corner it keeps "
            f"{spread[-1]:.3f} of it",
        ),
    }


def _edges(extent, count):
    """Points on two edges of a square that meet in a corner, (2 count + 1, 2)."""
    steps = np.linspace(0.0, extent, count + 1)
    full, none = np.full(count + 1, extent), np.zeros(count + 1)
    return np.concatenate([np.column_stack([full, steps]), np.column_stack([steps, none])[:-1]])


# ---- method (Secs. III and IV) ---------------------------------------------------------------------------------------

_THEORY = (
    *("psi_hat_statistics", "w_joint_gaussian", "w_correlated", "history_feedback_needed"),
    *("mean_from_v_covariance_from_gains", "l_variable_identities", "subproblem_convex"),
)


def _theory_claims(certificates):
    if certificates is None:
        return dict.fromkeys(_THEORY)
    found = certificates
    scores = found.disturbance_score, found.normality_score
    identity = max(found.identity_residual, found.triangular_residual)

    def apart(other):
        return abs(other - found.objective) / max(abs(other), abs(found.objective))

    forms, solvers = apart(found.history_objective), apart(found.other_objective)
    return {
        "psi_hat_statistics": Evaluation(
            bool(found.process_score < LARGEST_SCORE),
            None,
            found.samples,
            f"covariance of {found.samples:,} sampled fields along the nominal: no entry is further than "
            f"{found.process_score:.1f} standard errors from Eq. 16c; limit {LARGEST_SCORE:g}",
        ),
        "w_joint_gaussian": Evaluation(
            bool(max(scores) < LARGEST_SCORE),
            None,
            found.samples,
            f"disturbances integrated along {found.samples:,} sampled fields: covariance within {scores[0]:.1f}, "
            f"skewness and excess kurtosis within {scores[1]:.1f} standard errors of Eq. 26 and of a normal "
            f"distribution; limit {LARGEST_SCORE:g}",
        ),
        "w_correlated": Evaluation(
            bool(found.largest_correlation > DEPENDENT and found.deviation_ratio > UNLIKE),
            evidence=f"disturbances of different intervals correlate by up to {found.largest_correlation:.3f}, their "
            f"deviations differ by a factor of up to {found.deviation_ratio:.1f}; limits {DEPENDENT:g} and {UNLIKE:g}",
        ),
        "history_feedback_needed": Evaluation(
            bool(found.history_information > INFORMATIVE),
            evidence=f"the state before the last explains up to {100 * found.history_information:.0f} % of the "
            f"variance that remains of the next state when the last is known; a Markov process has none, needed is "
            f"{100 * INFORMATIVE:g} %",
        ),
        "mean_from_v_covariance_from_gains": Evaluation(
            bool(max(found.mean_shift, found.gain_shift) < EXACT),
            evidence=f"another mean control moves the deviations by {found.mean_shift:.1e} of the largest, feedback "
            f"moves the undisturbed states by {found.gain_shift:.1e}",
        ),
        "l_variable_identities": Evaluation(
            bool(identity < EXACT and found.control_covariance_residual < EXACT),
            evidence=f"(I + B L)(I - B K) is the identity to {found.identity_residual:.1e}, entries of L above its "
            f"block diagonal are at most {found.triangular_residual:.1e}, Cov(U) from L and from the innovations "
            f"differ by {found.control_covariance_residual:.1e}",
        ),
        "subproblem_convex": Evaluation(
            bool(found.convexity > -ROUNDING and max(forms, solvers) < SAME_OPTIMUM),
            evidence=f"along random segments the cost exceeds its chords by at most {max(0.0, -found.convexity):.1e}; "
            f"the printed form and the innovations form find the same least cost to {forms:.1e}, Clarabel and "
            f"{found.other_solver} to {solvers:.1e}",
        ),
    }


# ---- double integrator (Sec. V.A) ------------------------------------------------------------------------------------


def _double_integrator_claims(inputs: RandomFieldInputs, design, flights):
    normals, _ = normals_and_bounds(inputs.point_mass)
    slopes = -normals[:, 0] / normals[:, 1]
    slope = {
        "dint_constraint_slopes": Evaluation(
            slopes,
            evidence=f"the lines of the two normal vectors have slopes {slopes[0]:.5f} and {slopes[1]:.5f}",
        )
    }
    if design is None or flights is None:
        return {**slope, "dint_chance_constraints_satisfied": None, "dint_ellipses_protrude": None}
    first, everything = flights.paper_trials, int(flights.count[CLOSED] + flights.excluded[CLOSED])
    allotted = 1.0 - inputs.point_mass.double_integrator_probability
    paper, whole = flights.paper_any_violations[CLOSED], flights.any_violations[CLOSED]
    significant = exceeds(paper, first, allotted).any()
    significant |= exceeds(flights.paper_violations[CLOSED], first, tail(inputs.point_mass)).any()
    worst = int(np.argmax(whole))
    share, all_share = 100 * paper[worst] / first, 100 * whole[worst] / everything
    low, high = (100 * bound for bound in binomial_interval(paper[worst], first, CONFIDENCE))
    all_low, all_high = (100 * bound for bound in binomial_interval(whole[worst], everything, CONFIDENCE))
    chance = float(chance_of_more(whole[worst], everything, allotted))
    told = (
        f"; of all {everything:,} trials {all_share:.3f} % ({all_low:.3f} to {all_high:.3f} %), and as many or more "
        f"would lie outside with a probability of {chance:.2g} if it were what is allotted"
    )
    protrusion = design.support[CLOSED].max()
    sampled = _flown_support(inputs, flights)
    return {
        **slope,
        "dint_chance_constraints_satisfied": Evaluation(
            bool(not significant),
            None,
            first,
            f"of the first {first:,} trials {paper[worst]:,} lie outside at the worst node, t = "
            f"{design.partition[worst]:g}: {share:.2f} % ({low:.2f} to {high:.2f} % with {100 * CONFIDENCE:g} % "
            f"confidence), allotted {100 * allotted:.2f} %; without feedback "
            f"{100 * flights.any_violations[OPEN].max() / everything:.0f} %" + (told if everything > first else ""),
            {
                "share": share,
                "upper": high,
                "all_trials": everything,
                "all_share": all_share,
                "all_low": all_low,
                "all_high": all_high,
                "chance": chance,
            },
        ),
        "dint_ellipses_protrude": Evaluation(
            bool(protrusion > 0.0 and sampled > 0.0),
            None,
            everything,
            f"over the ellipses a'x exceeds its bound by up to {protrusion:+.4f} (linear covariance) and "
            f"{sampled:+.4f} (trials); an ellipse that holds {100 * inputs.point_mass.ellipse_probability:g} % of the "
            f"plane reaches {ellipse_radius(inputs.point_mass):.2f} deviations far, the constraint "
            f"{upper_quantile(tail(inputs.point_mass)):.2f}",
        ),
    }


def _flown_support(inputs: RandomFieldInputs, flights):
    """Largest value of a'x over the ellipses of the trials under feedback, less the bound."""
    normals, bounds = normals_and_bounds(inputs.point_mass)
    mean = flights.mean[CLOSED, flights.node, :2]
    covariance = flights.covariance[CLOSED, flights.node, :2, :2]
    spread = np.sqrt(np.einsum("ci,kij,cj->kc", normals, covariance, normals))
    return float((mean @ normals.T + ellipse_radius(inputs.point_mass) * spread - bounds).max())


# ---- nominal flight and density (Sec. V.B.2) -------------------------------------------------------------------------


def _nominal_claims(inputs: RandomFieldInputs, nominal, convergence):
    angle = float(np.degrees(nominal.entry_flight_path_angle))
    given = " (given, not solved)" if inputs.vehicle.entry_angle == "given" else ""
    altitude = np.linspace(0.0, inputs.air.variance_top_altitude + 1e5, 2001)
    deviation = environment.deviation(inputs.air, altitude)
    low = 100 * float(environment.deviation(inputs.air, np.array(LOW_ALTITUDE)))
    above = deviation[altitude >= inputs.air.variance_top_altitude]
    largest = int(np.argmax(deviation))
    steps = np.diff(inputs.mission.partition)
    miss = abs(nominal.apoapsis - inputs.mission.target_apoapsis)
    return {
        "acap_entry_fpa": Evaluation(
            angle,
            evidence=f"exit apoapsis {nominal.apoapsis:.5f} r_p, lowest altitude {nominal.lowest_altitude / 1e3:.2f} km"
            + given,
            numbers={"lowest": nominal.lowest_altitude / 1e3},
        ),
        "acap_guess_hits_target": Evaluation(
            bool(miss < HIT),
            evidence=f"without control the exit apoapsis is {nominal.apoapsis:.5f} r_p, target "
            f"{inputs.mission.target_apoapsis:g} r_p, from an entry angle of {angle:.4f} deg{given}",
            numbers={"apoapsis": nominal.apoapsis},
        ),
        "acap_time_max_q": Evaluation(
            nominal.time_of_largest_dynamic_pressure,
            evidence=f"{nominal.largest_dynamic_pressure:.0f} Pa at "
            f"{nominal.time_of_largest_dynamic_pressure:.2f} s, without control",
        ),
        "acap_max_variance_above_h_trans": Evaluation(
            bool(deviation.max() <= above.min() * (1.0 + ROUNDING)),
            evidence=f"standard deviation {100 * above.min():.2f} % at and above "
            f"{inputs.air.variance_top_altitude / 1e3:g} km, elsewhere up to {100 * deviation.max():.4g} % at "
            f"{altitude[largest] / 1e3:.0f} km; {low:.4g} % at {LOW_ALTITUDE / 1e3:.0f} km",
            numbers={"low": low},
        ),
        "acap_end_steps_longer": Evaluation(
            bool(len(steps) > 2 and min(steps[0], steps[-1]) > steps[1:-1].max()),
            evidence=f"first and last step {steps[0]:g} and {steps[-1]:g} s, those between at most "
            f"{steps[1:-1].max() if len(steps) > 2 else np.nan:g} s",
        ),
        "acap_short_end_steps_no_benefit": convergence and _short_steps_claim(inputs, convergence),
    }


def _short_steps_claim(inputs: RandomFieldInputs, convergence):
    """Shorter steps at both ends after the paper's number of iterations, and the best of all iterations."""
    rows = [VARIANTS.index(name) for name in ("one_branch", "short_end_steps")]
    percentile, error = convergence.percentile[rows], convergence.percentile_error[rows]
    iterations = percentile.shape[1] - 1
    chosen = min(int(inputs.guidance.iterations), iterations)
    (own, short), noise = percentile[:, chosen], float(np.hypot(*error[:, chosen]))
    best = [row[np.isfinite(row)].min(initial=np.inf) for row in percentile[:, 1:]]
    return Evaluation(
        bool(own - short < BENEFIT * own + SIGMAS * noise),
        evidence=f"after {chosen} iterations the {100 * LEVEL:g}th percentile of delta-v is {own:.1f} m/s, with steps "
        f"of {np.diff(inputs.studies.fine_partition).max():g} s everywhere {short:.1f} m/s (standard error of the "
        f"difference {noise:.1f} m/s); the best of {iterations} iterations {best[0]:.1f} and {best[1]:.1f} m/s; a "
        f"benefit is {100 * BENEFIT:g} %",
    )


# ---- delta-v (Fig. 12) -----------------------------------------------------------------------------------------------


def _delta_v_claims(inputs: RandomFieldInputs, flown, convergence, regularization, field_study):
    gains, last = flown.gains, flown.last
    predicted = gains.delta_v_mean + upper_quantile(1.0 - LEVEL) * gains.delta_v_deviation
    promised, kept = predicted[OPEN] - predicted[1:], flown.percentile[OPEN] - flown.percentile[1:]
    lower = np.diff(flown.percentile) < -SIGMAS * np.hypot(flown.error[1:], flown.error[:-1])
    stays = ", ".join(str(number) for number in np.flatnonzero(~lower) + 1)
    closed = _percentile(flown, last) if flown.designed else Evaluation(np.nan, np.nan, flown.trials, flown.why_not)
    second = min(2, last)
    return {
        "acap_dv_p99_closed": _with(closed, lost=flown.lost[last], trials=flown.trials, **_regularized(regularization)),
        "acap_dv_p99_open": _with(
            _percentile(flown, OPEN), lost=flown.lost[OPEN], trials=flown.trials, **_needed(inputs, field_study)
        ),
        "acap_j2_is_p99": _stated_tail_claim(flown),
        "acap_lc_approximates_dv": _statement(
            flown,
            ((kept >= KEPT * promised) & (kept > 0.0)).all(),
            f"linear covariance promises a {100 * LEVEL:g}th percentile lower than that of the open loop by "
            f"{_listed(promised, '.0f')} m/s, flights keep {_listed(kept, '.0f')} m/s; means of the trials lie "
            f"{_listed(flown.offset, '.1f')} m/s above the predicted ones, their deviations are "
            f"{_listed(flown.deviation, '.1f')} m/s instead of {_listed(gains.delta_v_deviation, '.1f')} m/s (open "
            "loop first)",
            {"offset": flown.offset[last], "flown": flown.deviation[last], "predicted": gains.delta_v_deviation[last]},
            distribution=True,
        ),
        "acap_abs_value_error_source": _absolute_value_claim(inputs, flown),
        "acap_lc_mismatch_iteration_2": _statement(
            flown,
            flown.distance[second] > MISFIT,
            f"largest difference of the distribution functions in panels (a) to ({'abcdefgh'[min(last, 7)]}) "
            f"{_listed(flown.distance, '.2f')}, a misfit is {MISFIT:g}; the trials' means lie "
            f"{_listed(flown.offset, '.1f')} m/s above the predicted ones",
            {
                "distance": flown.distance[second],
                **{f"offset_{law}": flown.offset[min(law, last)] for law in (1, 2, 3)},
            },
            distribution=True,
        ),
        "acap_p99_decreases_each_iteration": _statement(
            flown,
            lower.all(),
            f"{100 * LEVEL:g}th percentile of the open loop and of every iteration {flown.percentiles()} m/s, nominal "
            f"apoapsis {_listed(gains.apoapsis)} r_p"
            + (f"; not lower, beyond sampling error, after iteration {stays}" if stays else ""),
            {
                **{f"iteration_{law}": flown.percentile[min(law, last)] for law in (1, 2, 3)},
                **_ending(convergence),
            },
            distribution=True,
        ),
    }


def _percentile(flown, law):
    """Percentile of a law with its standard error; NaN if it lies among lost trials."""
    told = [f"mean {flown.mean[law]:.1f}, deviation {flown.deviation[law]:.1f} m/s of captured trials"]
    if flown.lost[law]:
        told.append(f"of {flown.trials:,} trials: {outcomes(flown.ensemble, law)}")
    if not np.isfinite(flown.percentile[law]):
        told.append(f"more than {100 * (1 - LEVEL):g} % are lost, so there is no {100 * LEVEL:g}th percentile")
    return Evaluation(flown.percentile[law], flown.error[law], flown.trials, "; ".join(told))


def _with(evaluation, **numbers):
    """An evaluation with numbers that its reason may quote."""
    return Evaluation(evaluation.value, evaluation.standard_error, evaluation.trials, evaluation.evidence, numbers)


def _ending(study):
    """Percentiles of the last two laws of the long iteration as in the paper, and of the last with both branches."""
    names = ("before_last", "last", "both")
    if study is None:
        return dict.fromkeys(names, np.nan)
    one, both = (study.percentile[VARIANTS.index(name)] for name in ("one_branch", "both_branches"))
    return dict(zip(names, (one[-2], one[-1], both[-1]), strict=True))


def _regularized(study):
    """Percentiles with the next smaller and larger navigation errors, and the least position error (m) with any."""
    names = ("smaller", "larger", "least_error")
    if study is None:
        return dict.fromkeys(names, np.nan)
    found = study.percentile
    own = int(np.abs(np.log(study.factor)).argmin())
    usable = np.flatnonzero(np.isfinite(found))
    least = study.position_error[usable[0]] if usable.size else np.nan
    values = found[max(own - 1, 0)], found[min(own + 1, len(found) - 1)], least
    return dict(zip(names, values, strict=True))


def _needed(inputs: RandomFieldInputs, study):
    """What the open loop gives in other fields: about twice the variance, and full correlation over altitude."""
    names = ("doubled", "doubled_error", "factor", "correlated")
    if study is None:
        return dict.fromkeys(names, np.nan)
    factors = study.variance / inputs.air.variance_at_top
    twice = int(np.abs(factors - 2.0).argmin())
    correlated = study.percentile[list(study.hypothesis).index("fully correlated")]
    values = study.variance_percentile[twice], study.variance_percentile_error[twice], factors[twice], correlated
    return dict(zip(names, values, strict=True))


def _stated_tail_claim(flown):
    """Whether the percentile that Eq. 13 defines with the stated p_f is about the one that the paper names."""
    level = 1.0 - STATED_TAIL
    beyond = [np.where(np.isfinite(values), values, np.inf) for values in flown.ensemble.delta_v]
    stated = np.array([np.quantile(values, level, method="higher") for values in beyond])
    short = 1.0 - stated / flown.percentile
    apart = (upper_quantile(1.0 - LEVEL) - upper_quantile(1.0 - level)) * flown.gains.delta_v_deviation
    return Evaluation(
        bool((np.abs(short) < APPROXIMATE).all()),
        None,
        flown.trials,
        f"with p_f = {STATED_TAIL:g} Eq. 13 is the {100 * level:g}th percentile. That of the trials is "
        f"{_listed(stated, '.0f')} m/s (open loop first), {_listed(100 * short, '.1f')} % below the {100 * LEVEL:g}th; "
        f"by linear covariance they are {_listed(apart, '.1f')} m/s apart; approximately equal is "
        f"{100 * APPROXIMATE:g} %" + flown.lost_trials,
        {
            "open_short": 100 * short[OPEN],
            "last_short": 100 * short[flown.last],
            "percentile": flown.percentile[flown.last],
        },
    )


def _absolute_value_claim(inputs: RandomFieldInputs, flown):
    """Errors of the predicted means, as they are and with the predicted branch continued beyond the kink."""
    gains, ensemble = flown.gains, flown.ensemble
    smooth = np.full(len(flown.laws), np.nan)
    for law in flown.laws:
        sign, captured = _branch(inputs, gains, law), ensemble.outcome[law] == CAPTURED
        if sign is None or not captured.any():
            continue
        ends = ensemble.final_state[law, captured, : FLIGHT_PATH_ANGLE + 1] + [inputs.planet.planet_radius, 0.0, 0.0]
        values = orbits.total_delta_v(*ends.T, *targets(inputs.planet, inputs.mission), branch=sign)
        smooth[law] = values.mean() - gains.delta_v_mean[law]
    vanishes = np.abs(smooth).sum() < (1.0 - SOURCE) * np.abs(flown.offset).sum()
    return Evaluation(
        bool(vanishes and flown.complete),
        None,
        flown.trials,
        f"the trials' means of delta-v lie {_listed(flown.offset, '.1f')} m/s above the predicted ones (open loop "
        f"first); without the absolute value, the predicted branch of the clean-up burn continued, it is "
        f"{_listed(smooth, '.1f')} m/s; a source makes {100 * SOURCE:g} % of it" + flown.lost_trials,
    )


def _branch(inputs: RandomFieldInputs, gains, law):
    """Sign of the clean-up burn in the prediction of a law; None if its nominal was not captured."""
    both = inputs.guidance.clean_up_branch == "both"
    # A program with both branches predicts the one on which its own mean ends, others that of their nominal.
    apoapsis = gains.apoapsis[law if both else max(law - 1, OPEN)]
    if not np.isfinite(apoapsis):
        return None
    sign = int(orbits.branch_of(apoapsis, inputs.mission.target_apoapsis, inputs.guidance.branch_tolerance))
    return sign or (0 if both else BRANCHES[inputs.guidance.clean_up_branch])


# ---- control (Fig. 13) -----------------------------------------------------------------------------------------------


def _control_claims(inputs: RandomFieldInputs, nominal, flown):
    gains, ensemble, last = flown.gains, flown.ensemble, flown.last
    begins, ends, control = gains.partition[:-1], gains.partition[1:], gains.control
    peak = nominal.time_of_largest_dynamic_pressure
    rising, falling = (_course(control, begins, ends, part) for part in (ends <= peak, begins >= peak))
    overlap = np.maximum(np.minimum(ends, peak + HALF_WINDOW) - np.maximum(begins, peak - HALF_WINDOW), 0.0)
    near = np.flatnonzero(overlap)
    lift = float(overlap @ control[last] / overlap.sum())
    held = ", ".join(f"{control[last, k]:+.3f} from {begins[k]:g} to {ends[k]:g} s" for k in near)
    deviation = gains.control_deviation[last]
    widest = near[np.argmax(deviation[near])]

    worst = int(np.argmax(flown.violations[last]))
    count, any_count = int(flown.violations[last, worst]), int(flown.any_violations[last])
    share, allotted = count / flown.trials, 1.0 - inputs.guidance.control_probability
    low, high = (float(bound) for bound in binomial_interval(count, flown.trials, CONFIDENCE))
    beyond = "more than" if exceeds(count, flown.trials, allotted) else "not shown to be more than"
    shares = {
        "worst": 100 * share,
        "low": 100 * low,
        "high": 100 * high,
        "allotted": 100 * allotted,
        "any_step": 100 * any_count / flown.trials,
    }

    mean, spread = commanded(gains, ensemble, last)
    lower, upper = inputs.vehicle.control_limits
    outside = np.maximum(mean + SIGMAS * spread - upper, lower - mean + SIGMAS * spread)
    furthest = int(np.argmax(outside))
    error = SIGMAS * spread[furthest] / np.sqrt(2.0 * flown.trials)
    return {
        "acap_lift_up_early": _statement(
            flown,
            (np.diff(rising) > ROUNDING).all(),
            f"mean control of the intervals before the peak of dynamic pressure at {peak:.1f} s: {_listed(rising)} "
            "(guess first)",
        ),
        "acap_lift_down_late": _statement(
            flown,
            (np.diff(falling) < -ROUNDING).all(),
            f"mean control of the intervals after the peak of dynamic pressure at {peak:.1f} s: {_listed(falling)} "
            "(guess first)",
        ),
        "acap_zero_lift_at_max_q": _statement(
            flown,
            abs(lift) < ALMOST_ZERO,
            f"mean control of the last iteration within {HALF_WINDOW:g} s of the peak at {peak:.1f} s {lift:+.3f}: "
            f"{held}; almost zero is {ALMOST_ZERO:g}",
            # No sign of zero's.
            {
                "lift": lift,
                "at_peak": control[last, near[0]].round(4) + 0.0,
                "after": control[last, near[-1]].round(4) + 0.0,
            },
        ),
        "acap_control_variance_high_at_max_q": _statement(
            flown,
            deviation[widest] >= (1.0 - AGREES) * deviation.max() > 0.0 and abs(control[last, widest]) < ALMOST_ZERO,
            f"predicted three sigma of the control {SIGMAS * deviation[widest]:.3g} about a mean of "
            f"{control[last, widest]:+.3f} from {begins[widest]:g} to {ends[widest]:g} s, within {HALF_WINDOW:g} s of "
            f"the peak; the largest of all intervals is {SIGMAS * deviation.max():.3g}",
        ),
        "acap_control_within_bounds": _statement(
            flown,
            high < UNLIKELY,
            f"commands beyond the limits: {count:,} of {flown.trials:,} trials in the worst interval, from "
            f"{begins[worst]:g} to {ends[worst]:g} s, {100 * share:.3f} % ({100 * low:.3f} to {100 * high:.3f} % with "
            f"{100 * CONFIDENCE:g} % confidence), {beyond} the {100 * allotted:.2f} % that Eq. 77 allots; "
            f"{any_count:,} in any interval; unlikely is {100 * UNLIKELY:g} %",
            shares,
        ),
        "acap_mc_three_sigma_slightly_outside": _statement(
            flown,
            SIGMAS * error < outside[furthest] < SLIGHTLY,
            f"mean and three standard deviations of the command reach {outside[furthest]:+.3g} ± {error:.2g} beyond a "
            f"limit, from {begins[furthest]:g} to {ends[furthest]:g} s; slightly is up to {SLIGHTLY:g}, and in "
            f"{(outside > 0.0).sum()} of {len(outside)} intervals they lie beyond",
        ),
        "acap_control_saturated": _statement(
            flown,
            any_count > 0,
            f"{any_count:,} of {flown.trials:,} trials command beyond the limits in some interval, and fly the limit; "
            f"at most {np.nanmax(ensemble.observed_maximum[last, :, 1], initial=-np.inf):.3g} beyond",
        ),
    }


def _course(control, begins, ends, part):
    """Mean control of every law over some intervals, by their duration; NaN if there is no interval."""
    duration = (ends - begins)[part]
    return control[:, part] @ duration / duration.sum() if part.any() else np.full(len(control), np.nan)


# ---- linear covariance against flights (Figs. 12 and 14 to 17) -------------------------------------------------------


def state_error(gains, ensemble, law):
    """Root mean square relative error of the predicted standard deviations, over nodes after the first and states."""
    flown, predicted = (values[1:] for values in node_deviations(gains, ensemble, law))
    ratio = np.divide(predicted, flown, out=np.ones_like(flown), where=~(flown == 0.0))
    return float(np.sqrt(((ratio - 1.0) ** 2).mean())), ratio


def _prediction_claims(inputs: RandomFieldInputs, flown):
    gains, ensemble, last, trials = flown.gains, flown.ensemble, flown.last, flown.trials
    (guess, guess_ratio), (best, best_ratio) = (state_error(gains, ensemble, law) for law in (OPEN, last))
    sampling = SIGMAS / np.sqrt(2.0 * trials)
    node, state = np.unravel_index(np.argmax(np.abs(best_ratio - 1.0)), best_ratio.shape)
    name = ("radius", "velocity", "flight path angle")[state]
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = gains.delta_v_deviation / flown.deviation
    pressure = np.sqrt(ensemble.covariance[:, :, DYNAMIC_PRESSURE, DYNAMIC_PRESSURE])
    spread = [float(np.sqrt((pressure[law] ** 2).mean())) for law in (OPEN, last)]
    density = np.sqrt(ensemble.covariance[last, :, DENSITY_VARIATION, DENSITY_VARIATION])
    ratio = gains.variation_deviation[last] / density
    furthest = int(np.argmax(np.abs(ratio - 1.0)))
    return {
        "acap_lc_better_for_guess_state": _statement(
            flown,
            best > guess + sampling,
            f"predicted deviations of the states at the nodes are off by {100 * guess:.1f} % for the guess (at most "
            f"{100 * np.abs(guess_ratio - 1).max():.1f} %) and by {100 * best:.1f} % for the last iteration (root mean "
            f"square; most for the {name} at {gains.partition[node + 1]:g} s, {best_ratio[node, state]:.2f} of the "
            f"flown one); sampling {100 * sampling:.1f} %",
            distribution=True,
        ),
        "acap_lc_better_for_guess_dv": _statement(
            flown,
            flown.distance[last] > flown.distance[OPEN] + SIGMAS / np.sqrt(2.0 * trials),
            f"largest difference of the distribution functions of delta-v {flown.distance[OPEN]:.2f} for the guess, "
            f"{flown.distance[last]:.2f} for the last iteration; predicted over flown deviation {shares[OPEN]:.2f} and "
            f"{shares[last]:.2f}",
            {"guess_share": shares[OPEN], "last_share": shares[last]},
            distribution=True,
        ),
        "acap_q_deviation_grows": _statement(
            flown,
            spread[1] > LARGER * spread[0],
            f"standard deviation of the dynamic pressure {spread[0]:.1f} Pa without and {spread[1]:.1f} Pa with "
            f"feedback (root mean square over time), at most {pressure[OPEN].max():.0f} and "
            f"{pressure[last].max():.0f} Pa",
        ),
        "acap_density_lc_agrees": _statement(
            flown,
            np.abs(ratio - 1.0).max() < AGREES,
            f"the deviation of the density variation along the nominal is {ratio.min():.3f} to {ratio.max():.3f} of "
            f"that met by the trials, furthest off at {gains.time[furthest]:g} s; close is {100 * AGREES:g} %",
        ),
    }


# ---- what is known about them ----------------------------------------------------------------------------------------

DENSITY = "the nominal density"
UNIT = "the unit of J_2"
REGULARIZATION = "what keeps the gains finite"

DECLARATIONS = {
    "acap_dv_p99_closed": Declaration(
        "{value:.1f} m/s. The number follows from choices that are not printed: it is {jezero_2021[value]:.0f} to "
        "{doc_fit[value]:.0f} m/s with other nominal densities, {pf_printed[value]:.0f} m/s with the printed p_f, "
        "{metres[value]:.0f} m/s with delta-v in m/s, {smaller:.0f} and {larger:.0f} m/s with navigation errors about "
        "three times smaller and larger, {both_branches[value]:.0f} m/s where the iteration does not cycle. Without "
        "any navigation errors {literal_gains[lost]:,} of {literal_gains[trials]:,} trials are lost. So even agreement "
        "would be weak evidence.",
        errata=("E4", "E7", "E8"),
        withheld=(DENSITY, UNIT, REGULARIZATION),
    ),
    "acap_dv_p99_open": Declaration(
        "No nominal density comes near: the percentile is {exponential[value]:.0f} to {doc_fit[value]:.0f} m/s with "
        "those tried. Full correlation over altitude, the most there can be, gives {correlated:.0f} m/s. What would "
        "do is more variance where the flights are lowest: {factor:g} times the corrected variance gives "
        "{doubled:.0f} ± {doubled_error:.0f} m/s. That is a hypothesis on what the authors computed. With the "
        "variance as printed {variance_printed[lost]:,}, with the printed sign {sign_printed[lost]:,} of "
        "{sign_printed[trials]:,} trials are lost.",
        errata=("E1", "E2"),
        withheld=(DENSITY,),
    ),
    "acap_p99_decreases_each_iteration": Declaration(
        "{iteration_1:.1f}, {iteration_2:.1f}, {iteration_3:.1f} m/s: all far below the open loop, but the third law "
        "is no better than the second. Linearised on one side of the kink, delta-v promises a gain beyond it, and the "
        "iteration goes back and forth with period two, in the end between {before_last:.1f} and {last:.1f} m/s; after "
        "three iterations it stands on the worse side. With both branches in the program it stays where it arrives, at "
        "{both_branches[iteration_1]:.1f}, {both_branches[iteration_2]:.1f}, {both_branches[iteration_3]:.1f} and in "
        "the end {both:.1f} m/s: better than the worse side, not than the better one.",
        errata=("E7",),
    ),
    "acap_j2_is_p99": Declaration(
        "It is the 90th percentile, {open_short:.0f} % below the 99th in the open loop and {last_short:.1f} % in the "
        "last iteration. A design with p_f = 0.1 makes the 99th percentile {pf_printed[percentile]:.0f} m/s instead of "
        "{percentile:.0f} m/s.",
        errata=("E4",),
    ),
    "acap_entry_fpa": Declaration(
        "{value:.4f} deg, and {marsgram_daily_mean[value]:.4f} deg with the daily mean of the same MarsGRAM output, "
        "between which the printed angle lies. Other atmospheres of Mars give {doc_fit[value]:.4f} to "
        "{jezero_2021[value]:.4f} deg.",
        errata=("E5",),
        withheld=(DENSITY,),
    ),
    "acap_guess_hits_target": Declaration(
        "By construction: the angle is solved for it. The printed angle in the stand-in density leads to "
        "{printed[apoapsis]:.2f} r_p.",
        errata=("E5",),
        withheld=(DENSITY,),
    ),
    "acap_time_max_q": Declaration(
        "Of the nominal density alone; other atmospheres of Mars give {doc_fit[value]:.1f} to "
        "{jezero_2021[value]:.1f} s.",
        errata=("E5",),
        withheld=(DENSITY,),
    ),
    "acap_max_variance_above_h_trans": Declaration(
        "With the sign mended; as printed the deviation at 45 km is {sign_printed[low]:.0f} % instead of {low:.1f} %.",
        errata=("E1",),
    ),
    "acap_sigma2_max": Declaration("`corrected` takes it as per cent squared.", errata=("E2",)),
    "acap_partition": Declaration("No design can be made on a partition that does not increase.", errata=("E3",)),
    "acap_final_time": Declaration("", errata=("E3",)),
    "acap_end_steps_longer": Declaration("In the partition of `corrected`, which is chosen for it.", errata=("E3",)),
    "acap_short_end_steps_no_benefit": Declaration("With steps of 25 s throughout.", errata=("E3",)),
    "acap_p_f": Declaration("`corrected` takes 0.01.", errata=("E4",)),
    "acap_weights": Declaration("`corrected` takes J_2 in km/s.", errata=("E6",), withheld=(UNIT,)),
    "acap_trust_apoapsis": Declaration("", errata=("E13",)),
    "acap_initial_covariance": Declaration("", errata=("E9",)),
    "acap_lc_approximates_dv": Declaration(
        "As a surrogate: flights keep more than is promised. The distribution itself is not predicted: in the last "
        "iteration its mean lies {offset:.0f} m/s higher and its deviation is {flown:.1f} instead of {predicted:.1f} "
        "m/s.",
        errata=("E7",),
    ),
    "acap_abs_value_error_source": Declaration("It is nearly the whole error of the means.", errata=("E7",)),
    "acap_lc_mismatch_iteration_2": Declaration(
        "But here the other two iterations fit worse: the means are {offset_1:.0f}, {offset_2:.0f} and {offset_3:.0f} "
        "m/s too low. Which panel fits best depends on the phase of the cycle; with both branches in the program the "
        "distribution functions differ by {both_branches[distance]:.2f} only.",
        errata=("E7",),
    ),
    "acap_lc_better_for_guess_dv": Declaration(
        "By the distribution functions. The predicted deviation is {guess_share:.2f} of the flown one for the guess, "
        "but {kink_undershoot[guess_share]:.2f} or {kink_overshoot[guess_share]:.2f} with the derivative of either "
        "side of the kink, and {last_share:.2f} for the last iteration.",
        errata=("E7",),
    ),
    "acap_lc_better_for_guess_state": Declaration("", errata=("E12",)),
    "acap_zero_lift_at_max_q": Declaration(
        "{at_peak:+.2f} until 150 s and {after:+.2f} from there on. This depends on choices that are not printed: the "
        "mean control near the peak is {metres[lift]:+.2f} with delta-v in m/s and {pf_printed[lift]:+.2f} with the "
        "printed p_f. That speaks for km/s, and for the 99th percentile.",
        errata=("E4", "E6"),
        withheld=(UNIT,),
    ),
    "acap_control_variance_high_at_max_q": Declaration("", errata=("E6",), withheld=(UNIT,)),
    "acap_control_within_bounds": Declaration(
        "At the worst interval {worst:.2f} % of the trials leave the bounds ({low:.2f} to {high:.2f} %), where Eq. 77 "
        "allots {allotted:.2f} %. With delta-v in m/s they are {metres[worst]:.1f} %.",
        errata=("E6", "E16"),
        withheld=(UNIT, REGULARIZATION),
    ),
    "acap_mc_three_sigma_slightly_outside": Declaration("Of the control before it is cut off.", errata=("E18",)),
    "acap_q_deviation_grows": Declaration("", errata=("E17",)),
    "subproblem_convex": Declaration(
        "With navigation errors in the design, without which its gains are unbounded.", errata=("E8", "E9")
    ),
    "mean_from_v_covariance_from_gains": Declaration("With Eqs. 29, 33 and 39 mended.", errata=("E14", "E15")),
    "dint_constraint_slopes": Declaration(
        "The normal vectors of Eq. 61 do pass through (0.7, 0.1), with slopes a twentieth as steep. With the printed "
        "slopes no ellipse would come near the lines.",
        errata=("E10",),
    ),
    "dint_constraint_apex": Declaration("", errata=("E10",)),
    "dint_chance_constraints_satisfied": Declaration(
        "With the constraint at the last node too; without it {cc_to_4[share]:.0f} % lie outside there. Judged as in "
        "the paper by its own number of trials, which cannot tell 0.27 % from {upper:.2f} %. Of {all_trials:,} trials "
        "{all_share:.3f} % lie outside ({all_low:.3f} to {all_high:.3f} %). As many or more would with a probability "
        "of {chance:.1g} if it were 0.27 %: the linear approximation of the field probably lets slightly too many "
        "through.",
        errata=("E11",),
    ),
    "dint_ellipses_protrude": Declaration("", errata=("E10",)),
}
