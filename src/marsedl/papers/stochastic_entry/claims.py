"""Evaluation of every printed claim from the artifacts of one reading, and what is known about those that differ."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.covariance_steering.chance import chance_factor
from marsedl.methods.state_trigger import trigger_time_variance
from marsedl.models import density_variation
from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, ESCAPED, NON_FINITE
from marsedl.montecarlo.statistics import percentile, wishart_deviance
from marsedl.montecarlo.streaming import (
    FinalMoments,
    final_extremes,
    final_percentile,
    is_streamed,
    observed_maxima,
    outcome_count,
)
from marsedl.papers.stochastic_entry import dispersions, environment
from marsedl.papers.stochastic_entry.inputs import Mission, Planet, StochasticEntryInputs
from marsedl.papers.stochastic_entry.objective import TRIGGER_NORMAL, final_weights, per_metre
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    BANK_CHANGE,
    CASES,
    CROSSRANGE,
    DOWNRANGE,
    END_TIME,
    FLIGHT_PATH_ANGLE,
    REVERSALS,
    STATES,
    TRIGGERS,
    VELOCITY,
    Certificates,
    ErrorBudget,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    Tradeoff,
    errors,
)
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.claims import Close, Declaration, Evaluation

LAWS = ("apollo", "stochastic")
# Rows of Table 4: index in the state, name, factor to the printed unit, that unit.
ROWS = (
    (DOWNRANGE, "downrange", 1e-3, "km"),
    (ALTITUDE, "altitude", 1e-3, "km"),
    (VELOCITY, "velocity", 1.0, "m/s"),
    (FLIGHT_PATH_ANGLE, "gamma", 180.0 / np.pi, "deg"),
)
LEVELS = (0.01, 0.99)  # of the percentiles in Table 4
DENSITY_SIGMAS = 2.0  # at which Figs. 2 and 4 draw their limits
MOST_REVERSALS = 3  # of the nominal flight; where there are more, trials are told apart
EXAMPLE_LIMIT, EXAMPLE_PROBABILITY = 5e3, 0.01  # of Sec. III.C, which nothing uses

# What the tests of statements call so. Fixed before the first evaluation, but for SEARCHED; that of trigger_covariance
# then compared the mean with the nominal, which also counts how far flights are from it at t_f, whatever the trigger.
SIGMAS = 3.0  # beyond sampling error
ROUNDING = 1e-6  # relative; closer than this is equal
FEASIBLE = 1e-3  # relative excess over a limit that a solver may leave
REASONABLE = 0.25  # a deviation predicted to within a quarter is what "approximately" and "reasonably" promise here
GAUSSIAN = 0.05  # largest distance of a distribution function from the normal one, still "nearly Gaussian"
PROFILE = 0.1  # relative, of a standard deviation: closer "approximates" it
SINK_RATE = 0.05  # of the exponent 1/2
HALVED = 0.15  # "about half" is 0.35 to 0.65; the printed percentiles give 0.55 and 0.39
VISIBLE = 0.1  # a change of a plotted width by less is not "apparent"
LARGER = 1.1  # factor from which a dispersion is called larger than the other law's
SAME_BOUND = 0.2  # relative mean distance of two bounds of the control: closer are "similar", further "differ"
SILENT, SILENT_TIME = 0.01, 15.0  # three sigma of the cosine in the first seconds: a correction of half a degree
NEGLIGIBLE = 0.1  # of the control limit
HALF_PEAK = 0.5  # of the dynamic pressure: while it is higher, its "increase" has taken place
PANEL = 0.1  # of the largest bound: curves closer than this in the root mean square look close in a figure
NULLED = 0.1  # of the largest dispersion in flight
UNCORRELATED, STRONG = 0.3, 0.9  # absolute correlation: less than a tenth, more than four fifths of a variance
MORE_NEGATIVE = 0.05  # change of a correlation that an ellipse shows
UNLIKE = 2.0  # ratio of the standard deviations of two ellipses in some direction
SEARCHED = 0.01  # excess over the optimum at which a search has still found it
TRADED = 0.01  # relative fall of the range deviation from one altitude limit to the next
ALL_FLYING = 0.999  # share of the trials that must fly where flights are carried on by the linear model


@dataclass(frozen=True)
class Records(Artifacts):
    """What the claims are measured from."""

    nominal: Nominal
    linearization: Linearization
    gains: Gains
    apollo_time: FlightEnsemble
    apollo_velocity: FlightEnsemble
    stochastic_time: FlightEnsemble
    stochastic_velocity: FlightEnsemble
    certificates: Certificates | None = None
    tradeoff: Tradeoff | None = None
    error_budget: ErrorBudget | None = None

    def flights(self) -> dict[str, FlightEnsemble]:
        """Return the four Monte Carlo ensembles by the name of their case."""
        return {case: getattr(self, case) for case in CASES}


def evaluate(inputs: StochasticEntryInputs, records: Records) -> dict[str, Evaluation | None]:
    """Evaluate every claim in one reading.

    Numbers come from all trials of the reading. Claims that rest on a study which is not done for the reading are None.
    Trials that are not finite are counted in the evidence and left out of percentiles; without any finite trial or
    gain a number is NaN and a statement is not met.
    """
    nominal, linearization, gains = records.nominal, records.linearization, records.gains
    flights = records.flights()
    tails = {case: final_percentiles(ensemble) for case, ensemble in flights.items()}
    return {
        **_stated_inputs(inputs, gains),
        **_density_claims(inputs, nominal, linearization, records.apollo_time),
        **_design_claims(inputs, linearization, gains, records.certificates, records.tradeoff),
        **_control_claims(inputs, linearization, gains),
        **_dispersion_claims(inputs, nominal, linearization, gains, flights),
        **_correlation_claims(gains, flights),
        **_trigger_claims(inputs, nominal, linearization, gains, flights),
        **_table_4(inputs, flights, tails),
        **_headline_claims(inputs, flights, tails, records.error_budget),
    }


# ---- shared measures -------------------------------------------------------------------------------------------------


def finite(ensemble):
    """Which trials are finite, (trials,) bool; of a streamed ensemble those of the first."""
    return ensemble.outcome != NON_FINITE


def finite_count(ensemble):
    """How many of all trials are finite."""
    return ensemble.count if is_streamed(ensemble) else int(finite(ensemble).sum())


def final_percentiles(ensemble, trials=None, index=None):
    """1st and 99th percentile of the final errors with standard errors, SI: {state index: ((2,), (2,))}.

    trials: the first of all trials, or all. index: states, or the rows of Table 4. NaN where fewer than two trials are
    finite.
    """
    states, found = [row[0] for row in ROWS] if index is None else index, {}
    if is_streamed(ensemble) and trials is None:
        for state in states:
            reference = ensemble.nominal_final[state]
            pairs = [final_percentile(ensemble, state, level, reference) for level in LEVELS]
            found[state] = tuple(map(np.array, zip(*pairs, strict=True)))
        return found
    error = errors(ensemble, trials)[finite(ensemble)[:trials]]
    for state in states:
        if len(error) < 2:
            found[state] = np.full(2, np.nan), np.full(2, np.nan)
        else:
            values, deviations = zip(*(percentile(error[:, state], level) for level in LEVELS), strict=True)
            found[state] = np.array(values), np.array(deviations)
    return found


def width(tail):
    """Distance from the 1st to the 99th percentile and its standard error, both taken as independent."""
    values, deviations = tail
    return values[1] - values[0], float(np.hypot(*deviations))


def reduction(narrow, wide):
    """How much narrower one interval of percentiles is than another, relative, with its standard error."""
    (small, small_error), (large, large_error) = width(narrow), width(wide)
    ratio = small / large
    return 1.0 - ratio, abs(ratio) * float(np.hypot(small_error / small, large_error / large))


def halving(stochastic, apollo, side):
    """Ratio of one percentile (side 0 or 1) of two laws, its standard error, and whether it is about one half."""
    (values, deviations), (others, other_deviations) = stochastic, apollo
    ratio = values[side] / others[side]
    error = abs(ratio) * float(np.hypot(deviations[side] / values[side], other_deviations[side] / others[side]))
    return ratio, error, bool(abs(ratio - 0.5) <= HALVED + SIGMAS * error)


def outcomes(ensemble):
    """How many trials ended otherwise than they should, in words; empty if none did."""
    names = {CRASHED: "below the ground", ESCAPED: "trigger not reached", NON_FINITE: "not finite"}
    counts = {text: outcome_count(ensemble, code) for code, text in names.items()}
    return ", ".join(f"{count:,} {text}" for text, count in counts.items() if count)


def _predicted(gains, law):
    return gains.apollo_covariance if law == "apollo" else gains.stochastic_covariance


def _correlation(covariance, i, j):
    return float(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j]))


def _dynamic_pressure(linearization):
    return 0.5 * linearization.state[:, 4] * linearization.state[:, 1] ** 2


def _bounds(gains):
    """Three sigma of the control correction by case, (intervals,), of the flown Apollo law."""
    variances = (*gains.apollo_control_variance, *gains.stochastic_control_variance)
    return {case: SIGMAS * np.sqrt(variance) for case, variance in zip(CASES, variances, strict=True)}


# ---- stated inputs ---------------------------------------------------------------------------------------------------


def crossrange_of_azimuth(planet: Planet, mission: Mission):
    """Arc from entry to target (rad), and the crossrange (m) of the azimuth's offset from it over that arc."""
    step = mission.target_longitude - mission.entry_longitude
    sines = np.sin(mission.entry_latitude), np.sin(mission.target_latitude)
    cosines = np.cos(mission.entry_latitude), np.cos(mission.target_latitude)
    east, north = np.sin(step) * cosines[1], cosines[0] * sines[1] - sines[0] * cosines[1] * np.cos(step)
    arc = np.arctan2(np.hypot(east, north), sines[0] * sines[1] + cosines[0] * cosines[1] * np.cos(step))
    return float(arc), float(planet.planet_radius * arc * (mission.entry_azimuth - np.arctan2(east, north)))


def _stated_inputs(inputs: StochasticEntryInputs, gains):
    degrees = np.degrees
    planet, vehicle, mission = inputs.planet, inputs.vehicle, inputs.mission
    guidance, design = inputs.guidance, inputs.design
    arc, crossrange = crossrange_of_azimuth(planet, mission)
    example = EXAMPLE_LIMIT / chance_factor(1.0 - EXAMPLE_PROBABILITY)
    unit = np.eye(STATES)
    values = {
        "ou_lambda": inputs.air.decay_factor,
        "ou_phi_factor": inputs.air.diffusion_factor,
        "fig2_limits": DENSITY_SIGMAS,
        "decision_dimension_gains": gains.stochastic_gain.shape[-1],
        "mu": planet.gravitational_parameter,
        "omega": planet.rotation_rate,
        "h_atm": planet.atmosphere_altitude / 1e3,
        "end_velocity": mission.end_velocity,
        "trigger_nu": TRIGGER_NORMAL,
        "ha_velocity": guidance.heading_alignment_velocity / 1e3,
        "ha_gain": guidance.heading_alignment_gain,
        "ha_limit_high": degrees(guidance.heading_alignment_limits[0]),
        "ha_limit_low": degrees(guidance.heading_alignment_limits[1]),
        "ha_limit_velocity": guidance.heading_alignment_limit_velocity / 1e3,
        "target_position": [degrees(mission.target_longitude), degrees(mission.target_latitude)],
        "ei_position": [degrees(mission.entry_longitude), degrees(mission.entry_latitude)],
        "trim_alpha_interval": degrees(vehicle.trim_interval),
        "guidance_period": guidance.guidance_period,
        "bank_rate_limit": degrees(guidance.bank_rate_limit),
        "nominal_bank_fast": degrees(guidance.nominal_bank_fast),
        "nominal_bank_slow": degrees(guidance.nominal_bank_slow),
        "nominal_ramp_velocities": guidance.ramp_velocities / 1e3,
        "apollo_overcontrol": design.overcontrol,
        "mc_trials": inputs.simulation.paper_trials,
        "fig9_plotted_trials": inputs.simulation.drawn_trials,
        "tab1_mass": vehicle.mass,
        "tab1_area": vehicle.reference_diameter,
        "tab1_alpha": degrees(vehicle.trim_angle_of_attack),
        "tab1_ld": vehicle.lift_to_drag,
        "tab1_bc": vehicle.ballistic_coefficient,
        "tab2_altitude": [
            planet.atmosphere_altitude / 1e3,
            SIGMAS * dispersions.entry_deviations(planet, mission)[dispersions.RADIUS],
        ],
        "tab2_velocity": [mission.entry_velocity / 1e3, mission.entry_velocity_three_sigma],
        "tab2_gamma": degrees([mission.entry_flight_path_angle, mission.entry_flight_path_angle_three_sigma]),
        "tab2_azimuth": degrees([mission.entry_azimuth, mission.entry_azimuth_three_sigma]),
        "tab2_downrange": [0.0, mission.entry_downrange_three_sigma / 1e3],
        "tab3_aero": [abs(vehicle.lift_dispersion), abs(vehicle.drag_dispersion)],
        "af_time": design.final_weight,
        "rk": design.control_weight,
        "u_limit": design.control_limit,
        "chance_level": design.chance_level,
        "altitude_limit": design.altitude_limit / 1e3,
        "gamma_limit": degrees(design.flight_path_angle_limit),
        "altitude_direction": unit[ALTITUDE],
        "gamma_direction": unit[FLIGHT_PATH_ANGLE],
        "fig13_probability": 100.0 * design.chance_level,
    }
    return {
        **{name: Evaluation(value) for name, value in values.items()},
        "example_constraint": Evaluation(
            [EXAMPLE_LIMIT / 1e3, EXAMPLE_PROBABILITY],
            evidence=f"an illustration that no result uses: a standard deviation of {example / 1e3:.2f} km",
        ),
        "tab2_crossrange": Evaluation(
            [round(crossrange / 1e3, 2), mission.entry_crossrange_three_sigma / 1e3],
            evidence=f"the azimuth's offset over the arc of {degrees(arc):.3f} deg makes {crossrange / 1e3:.4f} km "
            "relative to the planet, rounded as printed; the mean latitude is an input of its own",
        ),
        "chance_sigmas": Evaluation(
            float(chance_factor(design.chance_level)),
            evidence=f"sqrt(2) times the inverse error function of {design.chance_level:g}",
        ),
    }


# ---- density (Sec. II) -----------------------------------------------------------------------------------------------


def _density_claims(inputs: StochasticEntryInputs, nominal, linearization, ensemble):
    # Constant coefficients: twenty scale heights below the top nothing is left of the start.
    depth, scale_height = np.linspace(0.0, 20.0, 2001), 1.0
    decay = density_variation.decay_rate(1.0 / scale_height, inputs.air.decay_factor)
    marched = density_variation.process_variance(depth, decay, 1.0, 0.0)[0]

    altitude = np.arange(nominal.altitude.min(), inputs.planet.atmosphere_altitude, inputs.air.density_grid_interval)
    wanted, decay = environment.variance(inputs.air, altitude), environment.decay_rate(inputs.air, altitude)
    noise = environment.diffusion(inputs.air, altitude)
    bias = np.sqrt(density_variation.process_variance(altitude, decay, noise, wanted[-1]) / wanted) - 1.0

    slope, spread = _sink_rate_exponent(inputs, linearization)
    entry = ensemble.covariance[0, :STATES, :STATES]
    stated = linearization.initial_covariance[4, 4]
    trials = ensemble.count
    ratio = entry[4, 4] / stated
    sampling = np.sqrt(2.0 / (trials - 1))
    correlations = [_correlation(entry, i, 4) for i in (VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE)]
    vehicle = np.ix_([VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE], [VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE])
    deviance = wishart_deviance(entry[vehicle], trials, linearization.initial_covariance[vehicle])
    mean = linearization.state[0].copy()
    mean[0] -= inputs.planet.planet_radius
    miss = np.abs(ensemble.mean[0, 1:4] - mean[1:4]) / np.sqrt(np.diag(entry)[1:4] / trials)
    middle = environment.variance(inputs.air, np.array([40e3, 80e3]))
    gram = density_variation.mars_gram_2010_deviation(np.array([40e3, 80e3]))
    samples = (
        f"our samples have deviations of {100 * np.sqrt(middle[0]):.1f} and {100 * np.sqrt(middle[1]):.1f} % at 40 and "
        f"80 km; Mars-GRAM 2010 states {100 * gram[0]:.1f} and {100 * gram[1]:.1f} %"
    )
    return {
        "ou_limit_variance": Evaluation(
            float(marched),
            evidence=f"variance 20 scale heights below the top {marched:.6f}, Eq. 10 in closed form "
            f"{density_variation.stationary_variance(1.0, inputs.air.decay_factor):.6f}",
        ),
        "ou_variance_matches_profile": Evaluation(
            bool(np.abs(bias).max() < PROFILE),
            evidence=f"standard deviation of the process {100 * bias.min():+.1f} to {100 * bias.max():+.1f} % off the "
            f"profile from {altitude[0] / 1e3:.0f} to {altitude[-1] / 1e3:.0f} km; limit {100 * PROFILE:g} %",
        ),
        "ou_resembles_marsgram": Evaluation(evidence=f"no Mars-GRAM samples; {samples}"),
        "sde_diffusion_sink_rate": Evaluation(
            bool(abs(slope - 0.5) < SINK_RATE and spread < SINK_RATE),
            evidence=f"noise of the linear model grows as the sink rate to the power {slope:.3f}, and differs from the "
            f"process in altitude by at most {100 * spread:.2f} % of the deviation; limits {SINK_RATE:g} and "
            f"{100 * SINK_RATE:g} %",
        ),
        "initial_density_variance": Evaluation(
            bool(
                abs(ratio - 1.0) < PROFILE + SIGMAS * sampling
                and np.abs(correlations).max() < SIGMAS / np.sqrt(trials)
                and not linearization.initial_covariance[4, :4].any()
            ),
            None,
            trials,
            f"variance of the density at entry {ratio:.4f} of zeta rho^2 in {trials:,} trials; largest correlation "
            f"with the vehicle's state {np.abs(correlations).max():.4f}, sampling error {1 / np.sqrt(trials):.4f}",
        ),
        "tab3_state": Evaluation(
            bool(deviance.p_value > 0.0027 and miss.max() < SIGMAS),
            None,
            trials,
            f"entry covariance of velocity, path angle and downrange against Table 2: deviance "
            f"{deviance.statistic:.1f} on {deviance.degrees_of_freedom}, p = {deviance.p_value:.2g}; means off by at "
            f"most {miss.max():.1f} standard errors",
        ),
        "tab3_density": Evaluation(
            evidence=f"no Mars-GRAM samples; trials fly through an Ornstein-Uhlenbeck surrogate: {samples}"
        ),
    }


def _sink_rate_exponent(inputs: StochasticEntryInputs, linearization):
    """Exponent of the sink rate in the density noise, and its distance from the process of Eq. 8 in altitude.

    The noise of a second is scaled by density, profile and scale height, and by what the process forgets in that
    second, so that Eq. 24 leaves the sink rate's root. The second figure is the largest relative difference of the
    deviations that a second of descent adds.
    """
    altitude = linearization.state[:, 0] - inputs.planet.planet_radius
    steps = np.flatnonzero(np.diff(altitude) < -1.0)  # m; the slope of less is rounding
    noise = linearization.noise[steps, 4, 4] / linearization.state[steps + 1, 4] ** 2
    decay = environment.decay_rate(inputs.air, altitude)
    diffusion = environment.diffusion(inputs.air, altitude)
    added = np.array(
        [
            density_variation.innovation_variance(altitude[[k + 1, k]], decay[[k + 1, k]], diffusion[[k + 1, k]])[0]
            for k in steps
        ]
    )
    duration = np.diff(linearization.time)[steps]
    middle = (diffusion[steps] + diffusion[steps + 1]) / 2
    sink_rate = -np.diff(altitude)[steps] / duration
    forgotten = (decay[steps] + decay[steps + 1]) * sink_rate * duration
    remains = -np.expm1(-forgotten) / forgotten
    slope = np.polyfit(np.log(sink_rate), 0.5 * np.log(noise / (duration * middle * remains)), 1)[0]
    return float(slope), float(np.abs(np.sqrt(noise / added) - 1.0).max())


# ---- design (Secs. III.C, IV, V.A) -----------------------------------------------------------------------------------


def _design_claims(inputs: StochasticEntryInputs, linearization, gains, certificates, tradeoff):
    system_size = STATES * (STATES + 1) // 2 + len(gains.partition_start)
    free = len(np.triu_indices(STATES)[0]) + gains.control_multiplier.shape[1]
    entries = STATES * len(gains.partition_start)
    projection = linearization.trigger_projection
    identity = np.delete(projection - np.eye(STATES), VELOCITY, axis=1)
    units = np.array([inputs.design.weight_length, 1.0, 1.0, inputs.design.weight_length, 1.0])
    weight = final_weights(inputs.design, linearization)[1] * per_metre(inputs.design)
    limits = SIGMAS * np.sqrt(np.diagonal(gains.stochastic_covariance[:, -1], axis1=1, axis2=2))
    altitude = limits[0, ALTITUDE] / 1e3
    return {
        **_theory_claims(gains, certificates),
        "decision_dimension_weights": Evaluation(
            bool(free == system_size and free < entries),
            evidence=f"{free} numbers, {system_size} by the formula with {STATES} states, instead of {entries} gains "
            f"on {len(gains.partition_start)} intervals",
        ),
        "zf_column_velocity": Evaluation(
            projection[:, VELOCITY],
            evidence="minus the nominal's final rates over its final rate of velocity, "
            f"{linearization.final_rates[VELOCITY]:.4f} m/s^2",
            numbers={"rate": linearization.final_rates[VELOCITY]},
        ),
        "zf_structure": Evaluation(
            bool(not identity.any()), evidence=f"largest difference of the other columns {np.abs(identity).max():.1e}"
        ),
        "af_velocity": Evaluation(
            _preimage(projection, weight) * units,
            evidence="least vector whose transform is the final weight of the velocity case, in the reading's unit of "
            "length",
        ),
        "adjoint_velocity": Evaluation(
            _preimage(projection, gains.adjoint[1, -1]),
            evidence="least vector whose transform is the final adjoint of the velocity case",
        ),
        "fig9_altitude_active": Evaluation(
            float(altitude),
            evidence=f"{altitude:.6f} km, multiplier of the limit {gains.final_multiplier[0, 0]:.3g}; with the "
            f"velocity trigger {limits[1, ALTITUDE] / 1e3:.6f} km",
            numbers={"multiplier": gains.final_multiplier[0, 0]},
        ),
        "fig9_altitude_range_tradeoff": tradeoff and _tradeoff_claim(tradeoff),
    }


def _preimage(projection, vector):
    """The least vector that the transpose of Z_f turns into a given one; Z_f' loses the trigger's normal only."""
    return np.linalg.lstsq(projection.T, vector, rcond=1e-10)[0]


def _theory_claims(gains, certificates):
    if certificates is None:
        return {"theorem_lqg": None, "corollary_lqg": None}
    excess = max(np.max(gains.control_ratio), np.max(gains.final_ratio)) - 1.0
    gap, difference = np.abs(gains.gap).max(), certificates.weights_gain_error.max()
    perturbed = certificates.perturbed_cost.min()
    cone = np.abs(certificates.cone_ratio - 1.0).max()
    # The paper's own route: of the searches that keep the limits, the best for each trigger.
    kept = certificates.search_worst <= 1.0 + FEASIBLE
    best = np.where(kept, certificates.search_ratio, np.inf).min(axis=1)
    astray = int((~kept | (certificates.search_ratio > 1.0 + SEARCHED)).sum())
    optimal = gap < ROUNDING and excess < FEASIBLE
    return {
        "theorem_lqg": Evaluation(
            bool(optimal and difference < ROUNDING and perturbed > -ROUNDING),
            evidence=f"with the multipliers as weights Eq. 55 gives the law's gains to {difference:.1e}; they keep "
            f"every limit within {max(excess, 0.0):.1e} and cost {gap:.1e} more than the lower bound; perturbed gains "
            f"change the Lagrangian by at least {perturbed:+.1e}",
        ),
        "corollary_lqg": Evaluation(
            bool(optimal and difference < ROUNDING and cone < FEASIBLE and (best < 1.0 + SEARCHED).all()),
            evidence="ascent of the dual is a search over final and control weights with the gains of Eq. 55; it ends "
            f"{gap:.1e} above its lower bound. On intervals of 10 s a cone program agrees to {cone:.1e}, and quadratic "
            f"programming over all weights comes to {best[0]:.5f} (time) and {best[1]:.5f} (velocity) times the "
            f"optimum from the best of {kept.shape[1]} starts; {astray} of its {kept.size} runs go astray",
            numbers={"astray": astray, "runs": kept.size},
        ),
    }


def _tradeoff_claim(tradeoff):
    """Every relaxation of the altitude limit that still costs range, and whether there is one on both partitions."""
    deviation = tradeoff.limited_deviation[:, 0]
    falls = [row[np.isfinite(row)] for row in deviation]
    met = all(
        len(row) > 1 and (np.diff(row) <= ROUNDING * row[:-1]).all() and row[-1] < (1.0 - TRADED) * row[0]
        for row in falls
    )
    text = "; ".join(
        f"{interval:g} s: " + ", ".join(f"{value:.0f}" for value in row)
        for interval, row in zip(tradeoff.limited_interval, deviation, strict=True)
    )
    limits = ", ".join(f"{limit / 1e3:g}" for limit in tradeoff.altitude_limit)
    return Evaluation(
        bool(met),
        evidence=f"range deviation (m) for altitude limits of {limits} km on intervals of {text}; noise alone makes "
        f"{tradeoff.floor[0]:.0f} m",
    )


# ---- control (Fig. 8) ------------------------------------------------------------------------------------------------


def _control_claims(inputs: StochasticEntryInputs, linearization, gains):
    guided = linearization.control.any(axis=1)
    guided[: np.flatnonzero(guided)[-1]] = True  # from entry on
    time, cosine = linearization.time[:-1][guided], linearization.bank_cosine[:-1][guided]
    bounds = {case: bound[guided] for case, bound in _bounds(gains).items()}
    pressure = _dynamic_pressure(linearization)[:-1][guided]
    drag = linearization.drag[:-1][guided]
    stochastic = np.array([bounds["stochastic_time"], bounds["stochastic_velocity"]])
    apollo = bounds["apollo_time"]

    def distance(law):
        # A cosine has no room for more than one; without this, Apollo's last gains, which diverge, would decide.
        one, other = (np.minimum(bounds[f"{law}_{trigger}"], 1.0) for trigger in TRIGGERS)
        return np.abs(one - other).sum() / ((one + other).sum() / 2)

    timed = np.minimum(SIGMAS * np.sqrt(gains.timed_control_variance[:, guided]), 1.0)
    timed_distance = 100 * np.abs(timed[0] - timed[1]).sum() / timed.mean(axis=0).sum()

    def excess(bound):
        return np.max(np.abs(cosine) + bound) - 1.0

    outside = (np.abs(cosine) + apollo > 1.0).sum() / len(time)
    early = stochastic[:, time < SILENT_TIME].max()
    thin = drag < inputs.guidance.apollo_least_drag
    thin &= np.arange(len(thin)) < np.argmax(pressure)
    faint = stochastic[:, thin].max() / inputs.design.control_limit if thin.any() else np.nan
    high = pressure > HALF_PEAK * pressure.max()
    stronger = (stochastic > apollo)[:, high].mean(axis=1)
    stronger_timed = 100 * (stochastic > timed[0])[:, high].mean(axis=1)
    failed = "" if np.isfinite(stochastic).all() else "; no finite stochastic gain"
    return {
        "lqg_no_feedback_low_q": Evaluation(
            bool(faint < NEGLIGIBLE),
            evidence=f"before the drag exceeds {inputs.guidance.apollo_least_drag:g} m/s^2, three sigma of the "
            f"correction is at most {100 * faint:.1f} % of the control limit; negligible is {100 * NEGLIGIBLE:g} %"
            f"{failed}",
        ),
        "fig8_apollo_similar": Evaluation(
            bool(distance("apollo") < SAME_BOUND),
            evidence=f"mean distance of the two bounds {100 * distance('apollo'):.1f} % of their mean over the range "
            f"control (for gains against time {timed_distance:.1f} %); similar is below {100 * SAME_BOUND:g} %",
            numbers={"distance": 100 * distance("apollo"), "timed": timed_distance},
        ),
        "fig8_stochastic_differs": Evaluation(
            bool(distance("stochastic") > SAME_BOUND),
            evidence=f"mean distance of the two bounds {100 * distance('stochastic'):.1f} % of their mean over the "
            f"range control; they differ above {100 * SAME_BOUND:g} %{failed}",
        ),
        "fig8_stochastic_inside": Evaluation(
            bool(max(excess(stochastic[0]), excess(stochastic[1])) < FEASIBLE),
            evidence=f"largest nominal cosine plus three sigma {1 + excess(stochastic[0]):.4f} (time), "
            f"{1 + excess(stochastic[1]):.4f} (velocity){failed}",
        ),
        "fig8_apollo_leaves": Evaluation(
            bool(outside > 0),
            evidence=f"nominal cosine plus three sigma up to {1 + excess(apollo):.3f}, above 1 for "
            f"{100 * outside:.0f} % of the range control",
        ),
        "fig8_silent_after_ei": Evaluation(
            bool(early < SILENT),
            evidence=f"three sigma of the correction at most {early:.2g} in the first {SILENT_TIME:g} s; silent is "
            f"below {SILENT:g}{failed}",
            numbers={"early": early},
        ),
        "fig8_more_aggressive": Evaluation(
            bool((stronger > 0.5).all()),
            evidence=f"with the dynamic pressure above half its peak ({time[high][0]:.0f} to {time[high][-1]:.0f} s), "
            f"the stochastic bounds exceed Apollo's for {100 * stronger[0]:.0f} % (time) and {100 * stronger[1]:.0f} % "
            f"(velocity) of the time; those of its gains against time for {stronger_timed[0]:.0f} and "
            f"{stronger_timed[1]:.0f} %{failed}",
            numbers={
                "peak_share": 100 * stronger[0],
                "peak_share_velocity": 100 * stronger[1],
                "timed_share": stronger_timed[1],
            },
        ),
    }


# ---- dispersion over time (Figs. 6, 9, 10) ---------------------------------------------------------------------------

_STATES = ("altitude", "velocity", "flight path angle", "range")  # in the order of history and linear model


def _dispersion_claims(inputs: StochasticEntryInputs, nominal, linearization, gains, flights):
    time = gains.time
    law = {name: _LawDispersion(gains, name, flights[f"{name}_time"]) for name in LAWS}
    apollo, stochastic = law["apollo"], law["stochastic"]
    pressure = _dynamic_pressure(linearization)
    aligned = time >= nominal.alignment_time
    after_peak = (np.arange(len(time)) >= np.argmax(pressure)) & ~aligned
    climbing = linearization.state[:, FLIGHT_PATH_ANGLE] > 0.0
    # The measure of Fig. 9: root mean square of the difference of the curves, over the height of the panel.
    apart = {name: law[name].apart for name in LAWS}
    close = {name: int((apart[name] < PANEL).sum()) for name in LAWS}
    worst = {name: _STATES[int(np.argmax(apart[name]))] for name in LAWS}
    captured = {name: law[name].ratio(climbing)[:, [0, 1, 3]] for name in LAWS}
    off = {name: float(np.abs(captured[name] - 1.0).max(initial=0.0)) for name in LAWS}

    def rms(dispersion, state):
        return np.sqrt((dispersion.flown[after_peak, state] ** 2).mean())

    larger = [rms(stochastic, state) / rms(apollo, state) for state in (ALTITUDE, FLIGHT_PATH_ANGLE)]
    turn = time[np.argmax(stochastic.predicted[:, DOWNRANGE])]
    flown_turn = time[np.argmax(stochastic.flown[:, DOWNRANGE])]
    path_peak = time[np.argmax(stochastic.predicted[:, FLIGHT_PATH_ANGLE])]
    lateral = [dispersion.crossrange.max() for dispersion in (apollo, stochastic)]
    nulled = {
        name: _crossrange_interval(flights[f"{name}_time"]) / (2 * 2.326 * law[name].crossrange.max()) for name in LAWS
    }
    ends = " and ".join(
        f"{_crossrange_interval(flights[f'{name}_time']):.0f} m ({100 * nulled[name]:.1f} %, {name})" for name in LAWS
    )
    changes = [np.nanmax(observed_maxima(ensemble, BANK_CHANGE), initial=0.0) for ensemble in flights.values()]
    steps = np.abs(np.diff(nominal.bank)).max()
    allowed = inputs.guidance.bank_rate_limit * inputs.guidance.guidance_period
    excluded = flights["stochastic_time"].excluded
    failed = f"; {excluded:,} stochastic trials are not finite" if excluded else ""

    def described(name):
        return ", ".join(f"{state} {100 * value:.1f} %" for state, value in zip(_STATES, apart[name], strict=True))

    return {
        "nominal_uprange": Evaluation(
            float(-nominal.downrange[-1] / 1e3),
            evidence=f"after {nominal.end_time:.2f} s at {nominal.altitude[-1] / 1e3:.2f} km with "
            f"{len(nominal.reversal_time)} bank reversals; each was decided at least {nominal.deadband_margin:.0f} m "
            "from the deadband",
        ),
        "bank_rate_respected": Evaluation(
            bool(max(*changes, steps) <= allowed * (1.0 + ROUNDING)),
            None,
            sum(ensemble.count for ensemble in flights.values()),
            f"largest change from one command to the next {np.degrees(max(changes)):.4f} deg in all flights, "
            f"{np.degrees(steps):.4f} deg in the nominal; limit {np.degrees(allowed):g} deg{failed}",
        ),
        "lofting_captured": Evaluation(
            bool(climbing.any() and max(off.values()) < REASONABLE),
            None,
            flights["apollo_time"].count,
            f"while the nominal climbs ({time[climbing][0]:.0f} to {time[climbing][-1]:.0f} s) the deviations of "
            f"altitude, velocity and range are predicted to within {100 * off['apollo']:.0f} % (Apollo) and "
            f"{100 * off['stochastic']:.0f} % (stochastic); reasonable is {100 * REASONABLE:g} %{failed}"
            if climbing.any()
            else "the nominal never climbs",
            {"apollo_off": 100 * off["apollo"], "stochastic_off": 100 * off["stochastic"]},
        ),
        "fig9_large_deviations": Evaluation(
            bool(min(larger) > LARGER),
            None,
            flights["stochastic_time"].count,
            f"from peak dynamic pressure to heading alignment the deviations of altitude and path angle are "
            f"{larger[0]:.2f} and {larger[1]:.2f} times Apollo's; larger means {LARGER:g}{failed}",
        ),
        "fig9_range_error_turns": Evaluation(
            float(turn),
            evidence="largest range deviation of the linear model "
            f"{stochastic.predicted[:, DOWNRANGE].max() / 1e3:.2f} km; of the trials at {flown_turn:.0f} s; the path "
            f"angle's is largest at {path_peak:.0f} s{failed}",
            numbers={"flown": flown_turn, "path_angle": path_peak},
        ),
        "fig9_lc_close": Evaluation(
            bool(min(close.values()) > len(_STATES) / 2),
            None,
            flights["stochastic_time"].count,
            f"root mean square distance of the curves over the largest bound: Apollo {described('apollo')}; stochastic "
            f"{described('stochastic')}; close is {100 * PANEL:g} %{failed}",
        ),
        "fig9_lc_worst_gamma": Evaluation(
            all(name == _STATES[FLIGHT_PATH_ANGLE] for name in worst.values()),
            None,
            flights["stochastic_time"].count,
            f"furthest apart as drawn: {worst['apollo']} (Apollo, {100 * apart['apollo'].max():.1f} %), "
            f"{worst['stochastic']} (stochastic, {100 * apart['stochastic'].max():.1f} %); at the end the trials' "
            f"range deviation is {apollo.end_ratio[DOWNRANGE]:.2f} and {stochastic.end_ratio[DOWNRANGE]:.2f} times the "
            f"predicted one{failed}",
            {"end_ratio": stochastic.end_ratio[DOWNRANGE]},
        ),
        "lateral_dispersion_increases": Evaluation(
            bool(lateral[1] > LARGER * lateral[0]),
            None,
            flights["stochastic_time"].count,
            f"largest standard deviation of the crossrange {lateral[0] / 1e3:.2f} km (Apollo), {lateral[1] / 1e3:.2f} "
            f"km (stochastic); larger means {LARGER:g} times{failed}",
        ),
        "crossrange_nulled": Evaluation(
            bool(max(nulled.values()) < NULLED),
            None,
            flights["stochastic_time"].count,
            f"98 % of the final crossranges lie within {ends} of what the largest deviation in flight makes; nulled is "
            f"{100 * NULLED:g} %{failed}",
            {"interval": _crossrange_interval(flights["apollo_time"]) / 1e3},
        ),
    }


class _LawDispersion:
    """Standard deviations over time with the fixed final time: of the trials and of the linear model, (nodes, 4)."""

    def __init__(self, gains, name, ensemble):
        diagonal = np.diagonal(ensemble.covariance, axis1=1, axis2=2)
        self.flown = np.sqrt(diagonal[:, :4])
        self.crossrange = np.sqrt(diagonal[:, CROSSRANGE])
        self.predicted = np.sqrt(np.diagonal(_predicted(gains, name)[0], axis1=1, axis2=2)[:, :4])
        difference = self.flown - self.predicted
        self.apart = np.sqrt((difference**2).mean(axis=0)) / self.flown.max(axis=0)
        self.end_ratio = self.flown[-1] / self.predicted[-1]

    def ratio(self, nodes):
        return self.flown[nodes] / self.predicted[nodes]


def _crossrange_interval(ensemble):
    """Distance between the 1st and 99th percentile of the final crossrange, m."""
    if is_streamed(ensemble):
        return float(np.ptp([final_percentile(ensemble, CROSSRANGE, level)[0] for level in LEVELS]))
    crossrange = ensemble.final_state[finite(ensemble), CROSSRANGE]
    return float(np.ptp(np.quantile(crossrange, LEVELS))) if len(crossrange) else np.nan


# ---- correlation at the final time (Fig. 13) -------------------------------------------------------------------------


def _correlation_claims(gains, flights):
    predicted = {
        f"{law}_{trigger}": _predicted(gains, law)[number, -1]
        for law in LAWS
        for number, trigger in enumerate(TRIGGERS)
    }
    correlation = {case: _correlation(covariance, DOWNRANGE, VELOCITY) for case, covariance in predicted.items()}
    flown = {law: _correlation(flights[f"{law}_time"].covariance[-1], DOWNRANGE, VELOCITY) for law in LAWS}
    timed = _correlation(gains.timed_covariance[0, -1], DOWNRANGE, VELOCITY)
    deviation = {case: np.sqrt(covariance[DOWNRANGE, DOWNRANGE]) / 1e3 for case, covariance in predicted.items()}
    ellipses = [predicted[case][np.ix_([DOWNRANGE, VELOCITY], [DOWNRANGE, VELOCITY])] for case in CASES[2:]]
    unlike = np.nan
    if np.isfinite(ellipses).all():
        eigenvalues = np.linalg.eigvals(np.linalg.solve(ellipses[0], ellipses[1])).real
        unlike = np.sqrt(max(eigenvalues.max(), 1.0 / eigenvalues.min()))
    apollo, stochastic = (f"linear model {correlation[f'{law}_time']:+.3f}" for law in LAWS)
    return {
        "fig13_apollo_negative": Evaluation(
            bool(correlation["apollo_time"] < 0 and flown["apollo"] < 0),
            None,
            flights["apollo_time"].count,
            f"correlation of range and velocity at the final time: {apollo}, trials {flown['apollo']:+.3f}; for gains "
            f"against time, which nobody flies, {timed:+.3f}",
        ),
        "fig13_apollo_more_negative": Evaluation(
            bool(correlation["apollo_velocity"] < correlation["apollo_time"] - MORE_NEGATIVE),
            evidence=f"linear model {correlation['apollo_velocity']:+.3f} instead of {correlation['apollo_time']:+.3f}",
        ),
        "fig13_stochastic_time_uncorrelated": Evaluation(
            bool(
                abs(correlation["stochastic_time"]) < UNCORRELATED
                and deviation["stochastic_time"] < deviation["apollo_time"]
            ),
            evidence=f"{stochastic}, trials {flown['stochastic']:+.3f}; range deviation "
            f"{deviation['stochastic_time']:.3f} km, Apollo {deviation['apollo_time']:.3f} km; uncorrelated is below "
            f"{UNCORRELATED:g}",
        ),
        "fig13_stochastic_velocity_correlated": Evaluation(
            bool(abs(correlation["stochastic_velocity"]) > STRONG),
            evidence=f"linear model {correlation['stochastic_velocity']:+.3f}; strong is above {STRONG:g}",
        ),
        "fig13_clear_difference": Evaluation(
            bool(unlike > UNLIKE),
            evidence=f"in some direction the two ellipses differ by a factor of {unlike:.2f}; plainly unlike is "
            f"{UNLIKE:g}",
        ),
    }


# ---- triggers (Sec. IV) ----------------------------------------------------------------------------------------------


def _carried(inputs: StochasticEntryInputs, linearization, ensemble):
    """Mean deviation and covariance at t_f of flights that end earlier or later, and the time from which they are made.

    Flights to a trigger do not all pass t_f. Their moments at the last command at which all but a thousandth still fly
    are carried on to t_f by the linear model, which has no control there.
    """
    nodes = np.arange(len(linearization.transition))
    flying = ensemble.flying[nodes] >= ALL_FLYING * max(ensemble.count, 1)
    last = int(nodes[flying].max()) if ensemble.count > 1 else 0
    reference = linearization.state[last].copy()
    reference[0] -= inputs.planet.planet_radius
    mean, covariance = ensemble.mean[last, :STATES] - reference, ensemble.covariance[last, :STATES, :STATES]
    for transition, noise in zip(linearization.transition[last:], linearization.noise[last:], strict=True):
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
    return mean, covariance, linearization.time[last]


def _trigger_claims(inputs: StochasticEntryInputs, nominal, linearization, gains, flights):
    from scipy.special import ndtr

    projection, rates = linearization.trigger_projection, linearization.final_rates
    texts, states, met, numbers = [], [], [True, True], {}
    for law in LAWS:
        ensemble = flights[f"{law}_velocity"]
        ended = ensemble.outcome == COMPLETED
        if ended.sum() < 2:
            met = [False, False]
            texts.append(f"{law}: no finite trial")
            states.append(texts[-1])
            continue
        mean, covariance, since = _carried(inputs, linearization, ensemble)
        time = ensemble.final_state[ended, END_TIME]
        predicted = np.sqrt(trigger_time_variance(rates, TRIGGER_NORMAL, covariance))
        ordered = np.sort((time - time.mean()) / time.std(ddof=1))
        ranks = np.arange(1, len(ordered) + 1) / len(ordered)
        distance = np.abs(ndtr(ordered) - ranks + 0.5 / len(ordered)).max()
        late, ratio = (time.mean() - nominal.end_time) / predicted, time.std(ddof=1) / predicted
        met[0] &= bool(abs(late) < REASONABLE and abs(ratio - 1.0) < REASONABLE and distance < GAUSSIAN)
        texts.append(
            f"{law}: mean {time.mean() - nominal.end_time:+.2f} s from t_f, deviation {time.std(ddof=1):.2f} s, "
            f"predicted {predicted:.2f} s, distribution {100 * distance:.1f} % from normal"
        )

        at = [ALTITUDE, FLIGHT_PATH_ANGLE, DOWNRANGE]
        error = errors(ensemble)[ended][:, at]
        expected = np.sqrt(np.diag(projection @ covariance @ projection.T))[at]
        spread, offset = error.std(axis=0, ddof=1), error.mean(axis=0)
        shift = (projection @ mean)[at]
        designed = np.sqrt(np.diag(projection @ _predicted(gains, law)[1, -1] @ projection.T))[at]
        met[1] &= bool((np.abs(spread / expected - 1.0) < REASONABLE).all())
        met[1] &= bool((np.abs(offset - shift) < REASONABLE * spread).all())
        numbers |= {f"{law}_offset": offset[2] / 1e3, f"{law}_deviation": spread[2] / 1e3}
        numbers |= {f"{law}_expected": expected[2] / 1e3, f"{law}_shift": shift[2] / 1e3}
        numbers |= {f"{law}_designed": designed[2] / 1e3}
        states.append(
            f"{law}: trials over predicted deviation {spread[0] / expected[0]:.2f} (altitude), "
            f"{spread[1] / expected[1]:.2f} (path angle), {spread[2] / expected[2]:.2f} (range, {spread[2] / 1e3:.2f} "
            f"km), means off the nominal by "
            + ", ".join(f"{o:+.2f}" for o in offset / spread)
            + " deviations, predicted "
            + ", ".join(f"{o:+.2f}" for o in shift / spread)
            + f" from the moments of the flights at {since:.0f} s"
        )
    rule = f"approximately is {100 * REASONABLE:g} %"
    if is_streamed(flights["apollo_velocity"]):
        rule += f"; ends are those of the first {len(flights['apollo_velocity'].outcome):,} trials"
    return {
        "trigger_time_statistics": Evaluation(
            met[0],
            None,
            flights["apollo_velocity"].count,
            f"{'; '.join(texts)}; {rule}, nearly normal {100 * GAUSSIAN:g} %",
        ),
        "trigger_covariance": Evaluation(
            met[1], None, flights["apollo_velocity"].count, f"{'; '.join(states)}; {rule}", numbers
        ),
    }


# ---- Table 4 and the headline ----------------------------------------------------------------------------------------


def _table_4(inputs: StochasticEntryInputs, flights, tails):
    found = {}
    for case in CASES:
        ensemble = flights[case]
        known, ended = finite_count(ensemble), outcomes(ensemble)
        for state, name, factor, unit in ROWS:
            row = f"tab4_{name}_{case}"
            if name == "velocity" and case.endswith("velocity"):
                off = _velocity_errors(inputs, ensemble)
                largest = float(off.max()) if known else np.nan
                found[row] = Evaluation(
                    [-largest, largest],
                    None,
                    known,
                    f"largest distance from the trigger's velocity {largest:.1e} m/s" + (ended and f"; {ended}"),
                )
                continue
            values, deviations = tails[case][state]
            mean, deviation = _middle(ensemble, state, factor)
            found[row] = Evaluation(
                values * factor,
                deviations * factor,
                known,
                (f"mean {mean:+.3f}, standard deviation {deviation:.3f} {unit}" if known else "no finite trial")
                + (ended and f"; {ended}"),
                _by_number_of_reversals(ensemble) if name == "downrange" else {},
            )
    return found


def _velocity_errors(inputs: StochasticEntryInputs, ensemble):
    """Distances from the velocity of the trigger of all finite trials, or the largest; empty without any."""
    if is_streamed(ensemble):
        ends = final_extremes(ensemble, VELOCITY)
        return np.abs(ends[np.isfinite(ends)] - inputs.mission.end_velocity)
    return np.abs(ensemble.final_state[finite(ensemble), VELOCITY] - inputs.mission.end_velocity)


def _middle(ensemble, state, factor):
    """Mean and standard deviation of a final error over the finite trials, times a factor; NaN without any."""
    if is_streamed(ensemble):
        moments = FinalMoments(ensemble, state)
        return (moments.mean - ensemble.nominal_final[state]) * factor, moments.population_deviation * factor
    error = errors(ensemble)[finite(ensemble), state] * factor
    return (error.mean(), error.std()) if len(error) else (np.nan, np.nan)


def _by_number_of_reversals(ensemble):
    """Mean range error, km, of the trials with up to three bank reversals, and with more; NaN where there is none.

    Of a streamed ensemble it is that of its first trials.
    """
    known = finite(ensemble)
    more = ensemble.final_state[known, REVERSALS] > MOST_REVERSALS
    error = errors(ensemble)[known, DOWNRANGE] / 1e3
    means = [float(error[some].mean()) if some.any() else np.nan for some in (~more, more)]
    return dict(zip(("few_reversals", "more_reversals"), means, strict=True))


def _alone(error_budget):
    """Range deviation with the velocity trigger, km, from aerodynamics alone and from all sources; NaN if not done."""
    found = {f"{law}_{source}": np.nan for law in LAWS for source in ("aerodynamics", "all")}
    if error_budget is not None:
        laws, sources = list(error_budget.law), list(error_budget.source)
        for name in found:
            law, source = name.split("_")
            found[name] = error_budget.deviation[laws.index(law), 1, sources.index(source)] / 1e3
    return found


def _headline_claims(inputs: StochasticEntryInputs, flights, tails, error_budget):
    ranges = {case: tails[case][DOWNRANGE] for case in CASES}
    widths = {case: width(ranges[case]) for case in CASES}
    saved, error = reduction(ranges["stochastic_velocity"], ranges["apollo_velocity"])
    saved_time, error_time = reduction(ranges["stochastic_time"], ranges["apollo_time"])
    trials = {case: finite_count(flights[case]) for case in CASES}
    count = min(trials["apollo_velocity"], trials["stochastic_velocity"])

    def shown(case):
        values, deviations = ranges[case]
        low, high = (f"{v / 1e3:.3f} ± {e / 1e3:.3f}" for v, e in zip(values, deviations, strict=True))
        return f"{low} / {high} km"

    helped, changes = [], []
    for law in LAWS:
        gain, deviation = reduction(ranges[f"{law}_velocity"], ranges[f"{law}_time"])
        helped.append(bool(gain > SIGMAS * deviation))
        changes.append(f"{law}: width {-100 * gain:+.1f} ± {100 * deviation:.1f} %")
    off = max(_velocity_errors(inputs, flights[case]).max(initial=0.0) for case in CASES if case.endswith("velocity"))
    result = {
        "headline_range_reduction": Evaluation(
            100 * saved,
            100 * error,
            count,
            f"width from the 1st to the 99th percentile with the velocity trigger "
            f"{widths['apollo_velocity'][0] / 1e3:.2f} km (Apollo {shown('apollo_velocity')}), "
            f"{widths['stochastic_velocity'][0] / 1e3:.2f} km (stochastic "
            f"{shown('stochastic_velocity')}); with the fixed time {widths['apollo_time'][0] / 1e3:.2f} km (Apollo "
            f"{shown('apollo_time')}), {widths['stochastic_time'][0] / 1e3:.2f} km (stochastic "
            f"{shown('stochastic_time')}), {100 * saved_time:.1f} ± {100 * error_time:.1f} % less",
            {
                "time": 100 * saved_time,
                "time_error": 100 * error_time,
                **{f"{case}_width": widths[case][0] / 1e3 for case in CASES},
            },
        ),
        "velocity_trigger_helps_both": Evaluation(
            bool(all(helped) and off < 1.0),
            None,
            min(trials.values()),
            f"from the fixed time to the velocity trigger, {', '.join(changes)}; largest final velocity error "
            f"{off:.1e} m/s",
            {law: 100 * (widths[f"{law}_velocity"][0] / widths[f"{law}_time"][0] - 1) for law in LAWS},
        ),
        "improvement_visible_velocity": Evaluation(
            bool(saved > VISIBLE + SIGMAS * error),
            None,
            count,
            f"the stochastic law changes the interval from the 1st to the 99th percentile of the range by "
            f"{-100 * saved:+.1f} ± {100 * error:.1f} %; visible is {-100 * VISIBLE:g} %",
            {"change": -100 * saved, **_alone(error_budget)},
        ),
    }
    for side, name in enumerate(("p1", "p99")):
        ratio, deviation, half = halving(ranges["stochastic_velocity"], ranges["apollo_velocity"], side)
        result[f"halved_velocity_{name}"] = Evaluation(
            half,
            None,
            count,
            f"{ranges['stochastic_velocity'][0][side] / 1e3:.3f} km over "
            f"{ranges['apollo_velocity'][0][side] / 1e3:.3f} km is {ratio:.3f} ± {deviation:.3f}; about half is "
            f"{0.5 - HALVED:g} to {0.5 + HALVED:g}",
            {"ratio": ratio},
        )
    return result


# ---- what is known about them ----------------------------------------------------------------------------------------

DENSITY = "the Mars-GRAM density"
DEADBAND = "the deadband of Fig. 5"
PARTITION = "the partition of the control"
FORM = "the form of the Apollo law"

_HERE = "{value[0]:.2f} / {value[1]:.2f} here"

DECLARATIONS = {
    "headline_range_reduction": Declaration(
        "With the velocity trigger the interval from the 1st to the 99th percentile is {apollo_velocity_width:.2f} km "
        "under the Apollo law and {stochastic_velocity_width:.2f} km under the stochastic one: it is not reduced. With "
        "the Mars-GRAM fit it is {desensitized_density[apollo_velocity_width]:.2f} and "
        "{desensitized_density[stochastic_velocity_width]:.2f} km. With the fixed time it is {time:.0f} % narrower, "
        "but both intervals are far narrower than the paper's. Only an Apollo law that is blind to density is worse "
        "than the stochastic one with the trigger, by {density_blind[value]:.0f} %: a hypothesis.",
        errata=("E12", "E14"),
        withheld=(DENSITY, DEADBAND, FORM),
    ),
    "halved_velocity_p1": Declaration(
        "The ratio is {ratio:.2f}, with the Mars-GRAM fit {desensitized_density[ratio]:.2f}; under an Apollo law blind "
        "to density, a hypothesis, it is {density_blind[ratio]:.2f}.",
        errata=("E14",),
        withheld=(DENSITY, DEADBAND, FORM),
    ),
    "halved_velocity_p99": Declaration(
        "The ratio is {ratio:.2f}, with the Mars-GRAM fit {desensitized_density[ratio]:.2f}; under an Apollo law blind "
        "to density, a hypothesis, it is {density_blind[ratio]:.2f}.",
        errata=("E14", "E22"),
        withheld=(DENSITY, DEADBAND, FORM),
    ),
    "velocity_trigger_helps_both": Declaration(
        "From the fixed time to the trigger the interval of the range error changes by {apollo:+.0f} % (Apollo) and "
        "{stochastic:+.0f} % (stochastic). With the Mars-GRAM fit it is {desensitized_density[apollo]:+.0f} and "
        "{desensitized_density[stochastic]:+.0f} %. The trigger helps the stochastic law where its design for the "
        "fixed time is poor: {partition_24[stochastic]:+.0f} % with intervals of 10 s, {partition_20[stochastic]:+.0f} "
        "% with 12 s.",
        errata=("E12", "E14"),
        withheld=(PARTITION, DENSITY, FORM),
    ),
    "improvement_visible_velocity": Declaration(
        "The interval changes by {change:+.0f} %, with the Mars-GRAM fit by {desensitized_density[change]:+.0f} %. "
        "With the trigger, errors of the aerodynamics, which neither design knows of, make a deviation of "
        "{apollo_aerodynamics:.2f} km (Apollo) and {stochastic_aerodynamics:.2f} km (stochastic) alone, of "
        "{apollo_all:.2f} and {stochastic_all:.2f} km in all. Against an Apollo law blind to density, a hypothesis, it "
        "changes by {density_blind[change]:+.0f} %.",
        errata=("E8", "E14"),
        withheld=(DENSITY, DEADBAND, FORM),
    ),
    "ou_resembles_marsgram": Declaration("Mars-GRAM samples are not available.", withheld=(DENSITY,)),
    "ou_variance_matches_profile": Declaration("The bias that remains is that of Eq. 11.", errata=("E10",)),
    "lofting_captured": Declaration("The noise is switched off while climbing.", errata=("E19",)),
    "theorem_lqg": Declaration("With the inverse in Eq. 55a.", errata=("E3",)),
    "corollary_lqg": Declaration(
        "The paper's route, a search over all weights at once, depends on its start: {astray} of {runs} runs go "
        "astray.",
        withheld=("the start of the search",),
    ),
    "trigger_time_statistics": Declaration(
        "With the deviation in Eq. 63. Covariance at t_f from the flights, so that the trigger alone is tested.",
        errata=("E4",),
    ),
    "trigger_covariance": Declaration(
        "Tested with the flights' own moments at t_f; against the nominal itself the mean range is off by "
        "{apollo_offset:+.2f} km (Apollo) and {stochastic_offset:+.2f} km (stochastic). The design's covariance "
        "instead predicts a range deviation of {apollo_designed:.2f} km (Apollo) and {stochastic_designed:.2f} km "
        "(stochastic) where flights have {apollo_deviation:.2f} and {stochastic_deviation:.2f} km: it has neither bank "
        "reversals nor errors of the aerodynamics.",
        errata=("E4", "E22"),
    ),
    "nominal_uprange": Declaration(
        "By construction: density and deadband are chosen for it, so it is no evidence.",
        withheld=(DENSITY, DEADBAND),
    ),
    "bank_rate_respected": Declaration("With Eq. 71 mended.", errata=("E6",)),
    "tab2_crossrange": Declaration("", errata=("E7",)),
    "tab3_aero": Declaration("`corrected` takes a tenth of the error of C_L.", errata=("E8",)),
    "tab3_density": Declaration(
        "Mars-GRAM samples are not available: flights take a surrogate with exact variance, the design that of Eq. 11.",
        withheld=(DENSITY,),
    ),
    "fig8_apollo_similar": Declaration(
        "For the law as it is flown, against velocity, the bounds are {distance:.0f} % apart, for gains against time "
        "{timed:.0f} %. The text does not say which of them it shows. Aimed at the trigger in both cases they are "
        "the same.",
        errata=("E14", "E15"),
        withheld=(FORM,),
    ),
    "fig8_more_aggressive": Declaration(
        "While the dynamic pressure is above half its peak, the law designed for the fixed time corrects more strongly "
        "than the Apollo law for {peak_share:.0f} % of the time, that for the velocity trigger for "
        "{peak_share_velocity:.0f} %: around the peak only. Against Apollo's gains against time it is "
        "{timed_share:.0f} %, with the Mars-GRAM fit {desensitized_density[peak_share_velocity]:.0f} %.",
        errata=("E14", "E15"),
        withheld=(FORM, DENSITY),
    ),
    "fig8_silent_after_ei": Declaration(
        "This rests on the partition: with intervals of 10 s three sigma are {partition_24[early]:.2f} from entry on.",
        errata=("E12",),
    ),
    "fig9_altitude_active": Declaration(
        "At its limit, but for little: the multiplier is {multiplier:.1g} on intervals of 1 s, "
        "{partition_24[multiplier]:.2g} on intervals of 10 s.",
        errata=("E12",),
    ),
    "fig9_range_error_turns": Declaration(
        "The linear model's bound is largest at {value:.0f} s, that of the trials at {flown:.0f} s, the path angle's "
        "at {path_angle:.0f} s; with the Mars-GRAM fit the first is at {desensitized_density[value]:.0f} s.",
        withheld=(DENSITY, DEADBAND),
        close=Close(
            "the text says around 100 s, of a flat maximum in a figure; one more of its rounding unit is no "
            "disagreement",
            absolute=10.0,
        ),
    ),
    "fig9_lc_worst_gamma": Declaration(
        "As the curves are drawn. Relative to the prediction the final range is worse, {end_ratio:.1f} times it: "
        "alignment and reversals are not in the linear model.",
        errata=("E22",),
    ),
    "crossrange_nulled": Declaration(
        "With Eq. 58 mended; as printed, 98 % of the final crossranges spread over "
        "{printed_heading[interval]:.1f} km under the Apollo law, instead of {interval:.2f} km.",
        errata=("E5",),
    ),
    "zf_column_velocity": Declaration(
        "The density of `corrected` is fitted to these numbers, so their agreement is no evidence. That of "
        "`desensitized_density` is: {desensitized_density[value][0]:.2f}, {desensitized_density[value][2]:.5f}, "
        "{desensitized_density[value][3]:.2f} and {desensitized_density[value][4]:.2e}, with a Mars-GRAM fit to which "
        "nothing is fitted here.",
        withheld=(DENSITY,),
        close=Close(
            "the entries follow from the mean density near the end, which the paper withholds and which Mars-GRAM "
            "gives to some per cent only, by version, place and season; rounding alone is 3 % of the two small entries",
            relative=0.05,
        ),
    ),
    "fig13_apollo_negative": Declaration("For the law as it is flown, against velocity.", errata=("E15",)),
    "tab4_downrange_apollo_time": Declaration(
        "No reading of the text comes near the printed 14.9 km between the percentiles. Of the hypotheses "
        "only an adjoint that aims at the velocity trigger does: {velocity_adjoint[value][0]:.2f} / "
        "{velocity_adjoint[value][1]:.2f} km, and {density_blind_velocity_adjoint[value][0]:.2f} / "
        "{density_blind_velocity_adjoint[value][1]:.2f} km blind to density.",
        errata=("E14", "E21"),
        withheld=(FORM, DENSITY, DEADBAND),
    ),
    "tab4_downrange_apollo_velocity": Declaration(
        "An Apollo law that is blind to density, a hypothesis, gives {density_blind[value][0]:.2f} / "
        "{density_blind[value][1]:.2f} km; with the Mars-GRAM fit the law with all states gives "
        "{desensitized_density[value][0]:.2f} / {desensitized_density[value][1]:.2f} km.",
        errata=("E14",),
        withheld=(FORM, DENSITY, DEADBAND),
    ),
    "tab4_downrange_stochastic_time": Declaration(
        "The partition decides it: {partition_24[value][0]:.2f} / {partition_24[value][1]:.2f} km with intervals of 10 "
        "s, {partition_20[value][0]:.2f} / {partition_20[value][1]:.2f} km with 12 s. But with those the law is not "
        "silent after entry, as the text says of Fig. 8.",
        errata=("E12",),
        withheld=(PARTITION, DENSITY),
    ),
    "tab4_downrange_stochastic_velocity": Declaration(
        "Trials with more than three bank reversals land long: {more_reversals:+.2f} km on average, others "
        "{few_reversals:+.2f} km. How many there are depends on the deadband: with the Mars-GRAM fit and its deadband "
        "the percentiles are {desensitized_density[value][0]:.2f} / {desensitized_density[value][1]:.2f} km.",
        errata=("E22",),
        withheld=(DEADBAND, DENSITY),
    ),
    "tab4_altitude_apollo_time": Declaration(
        _HERE
        + ", {desensitized_density[value][0]:.2f} / {desensitized_density[value][1]:.2f} km with the Mars-GRAM fit, "
        "{velocity_adjoint[value][0]:.2f} / {velocity_adjoint[value][1]:.2f} km with the trigger's adjoint.",
        errata=("E14",),
        withheld=(DENSITY, FORM),
    ),
    "tab4_altitude_apollo_velocity": Declaration(
        _HERE
        + ", {desensitized_density[value][0]:.2f} / {desensitized_density[value][1]:.2f} km with the Mars-GRAM fit, "
        "{density_blind[value][0]:.2f} / {density_blind[value][1]:.2f} km with an Apollo law blind to density.",
        errata=("E14",),
        withheld=(DENSITY, FORM),
    ),
    "tab4_velocity_apollo_time": Declaration(
        _HERE + ", {desensitized_density[value][0]:.1f} / {desensitized_density[value][1]:.1f} m/s with the Mars-GRAM "
        "fit, {density_blind[value][0]:.1f} / {density_blind[value][1]:.1f} m/s with an Apollo law blind to density.",
        errata=("E14",),
        withheld=(DENSITY, FORM),
    ),
    "tab4_gamma_apollo_time": Declaration(
        _HERE + ", {velocity_adjoint[value][0]:.2f} / {velocity_adjoint[value][1]:.2f} deg with the trigger's adjoint, "
        "{density_blind[value][0]:.2f} / {density_blind[value][1]:.2f} deg with an Apollo law blind to density.",
        errata=("E14",),
        withheld=(DENSITY, FORM),
    ),
    "tab4_gamma_stochastic_time": Declaration(
        _HERE + ", {partition_24[value][0]:.2f} / {partition_24[value][1]:.2f} deg with intervals of 10 s, "
        "{partition_20[value][0]:.2f} / {partition_20[value][1]:.2f} deg with 12 s.",
        errata=("E12",),
        withheld=(PARTITION, DENSITY),
    ),
    "tab4_gamma_stochastic_velocity": Declaration(
        _HERE + ", {desensitized_density[value][0]:.2f} / {desensitized_density[value][1]:.2f} deg with the Mars-GRAM "
        "fit.",
        errata=("E12", "E22"),
        withheld=(PARTITION, DENSITY, DEADBAND),
    ),
}
