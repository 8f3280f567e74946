"""Sec. V: the example, its Monte Carlo trials and Figs. 3 to 7."""

from typing import NamedTuple

import numpy as np

from marsedl.models.dynamics.powered_descent import mass_flow_constant
from marsedl.montecarlo.outcomes import CRASHED
from marsedl.montecarlo.statistics import covariance, covariance_standard_errors, mean_standard_error, variance
from marsedl.papers.powered_descent.claims.measures import (
    MASS,
    MOTION_PART,
    UPPER,
    FinalMass,
    FinalMisses,
    freedom,
    misses,
    misses_at_the_end,
    printed_covariance,
)
from marsedl.papers.powered_descent.inputs import Drawing, Ensemble, Mission, Vehicle
from marsedl.papers.powered_descent.records import (
    THRUST,
    FlightEnsemble,
    Gains,
    Nominal,
)
from marsedl.plotting.ellipses import probability_inside
from marsedl.replication.claims.claim import Doubt
from marsedl.replication.claims.counterexamples import scaled, shifted, spread
from marsedl.replication.claims.thresholds import ABOUT, CLOSE, MOST, MUCH, NEARLY_EXACT, SIGMAS, SMALL
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.claims.writing import claim, holds, measure, measured
from marsedl.replication.pipeline.injection import Largest

DIAGONAL = np.diag_indices(4)


@claim(counterexample=scaled("vehicle.standard_gravity"))
def alpha_from_isp(vehicle: Vehicle):
    return measured(
        mass_flow_constant(vehicle.specific_impulse, vehicle.standard_gravity),
        evidence=f"1 / ({vehicle.specific_impulse:g} s x {vehicle.standard_gravity:g} m/s^2)",
    )


# ------------------------------------------------------------------------------------------------ Eq. 54 and the masses


@claim("It says nothing about the method. The benchmark table states our cost per flight.")
def compute_effort():
    return Evaluation(evidence="it depends on the computer; the benchmark table states our cost per flight")


@claim(
    "A correct simulation is unbiased, and the printed mean misses its target.",
    errata="E11",
    choices="scheme euler_step command mass_profile",
    counterexample=shifted("closed_loop.final_state", component="altitude"),
)
def mc_final_mean(closed_loop: Largest[FlightEnsemble]):
    state = closed_loop.final_state[:, MOTION_PART]
    error = mean_standard_error(variance(state), len(state))
    return measured(state.mean(axis=0), error, len(state), _lost(closed_loop))


@claim(
    "The printed downrange variance fits a target of 4 m^2, not the printed one.",
    errata="E7",
    name="mc_final_cov_diag",
    entries=DIAGONAL,
    counterexample=spread("closed_loop.final_state", component="downrange"),
)
@claim(
    name="mc_final_cov_upper",
    entries=UPPER,
    counterexample=spread("closed_loop.final_state", component="vertical_velocity"),
)
@claim(
    "A covariance is symmetric, but entry (2,1) is ten times entry (1,2). The latter reproduces.",
    errata="E8 E9",
    name="mc_final_cov_lower",
    entries=UPPER,
    counterexample=spread("closed_loop.final_state", component="downrange"),
)
def final_covariance(closed_loop: Largest[FlightEnsemble], *, entries):
    state = closed_loop.final_state[:, MOTION_PART]
    value, error = covariance(state)[entries], covariance_standard_errors(state)[entries]
    return measured(value, error, len(state), _lost(closed_loop))


def _lost(ensemble):
    return f"{ensemble.excluded} trials not finite, {np.count_nonzero(ensemble.outcome == CRASHED)} below the ground"


@claim(
    "The converged profile ends at {value:.2f} kg.",
    errata="E10",
    choices="initial_descent mass_flow_constant mass_profile",
    counterexample=scaled("nominal.mass"),
)
def prior_final_mass(nominal: Nominal):
    passes, first = len(nominal.integrated_change), nominal.mass_of_pass[1, -1]
    return measured(nominal.mass[-1], evidence=f"{passes} passes; the first ends at {first:.2f} kg")


@claim(counterexample=shifted("closed_loop.final_state", component="mass"))
def mc_mean_final_mass(mass: FinalMass):
    error, spread = mean_standard_error(mass.variance, mass.trials), np.sqrt(mass.variance)
    return measured(mass.mean, error, mass.trials, f"standard deviation {spread:.3f} kg", spread=spread)


@claim(
    "Feedback adds thrust on average, because |u| is convex.",
    errata="E10",
    choices="mass_profile",
    counterexample=shifted("closed_loop.final_state", component="mass"),
)
def mc_mass_above_prior(nominal: Nominal, mass: FinalMass):
    error = mean_standard_error(mass.variance, mass.trials)
    difference = mass.mean - nominal.mass[-1]
    return holds(
        measure("mean over the flights minus the mass of the design", difference, "kg", error=error) > 0,
        trials=mass.trials,
    )


@claim(counterexample=shifted("closed_loop.final_state", component="altitude"))
def final_mean_steered(misses: FinalMisses, mission: Mission, published: object):
    printed = np.abs(np.array(published["mc_final_mean"].printed) - mission.final_mean)
    printed = (printed / np.sqrt(np.diag(mission.final_covariance))).max()
    return holds(
        measure("error of the mean", misses.mean, "target standard deviations", error=misses.mean_error) <= ABOUT,
        f"the mean that Eq. 54 prints is off by up to {printed:.3g}",
        trials=misses.trials,
    )


@claim(counterexample=spread("closed_loop.final_state", component="vertical_velocity"))
def final_cov_steered(misses: FinalMisses, mission: Mission, published: object):
    target = mission.final_covariance
    scale = np.sqrt(np.diag(target))
    printed = (np.abs(printed_covariance(published) - target) / np.outer(scale, scale)).max()
    return holds(
        measure("relative error of the covariance", misses.covariance, error=misses.covariance_error) <= ABOUT,
        f"the covariance that Eq. 54 prints is off by up to {printed:.3g}",
        trials=misses.trials,
    )


# -------------------------------------------------------------------------------------------------------------- Fig. 3


@claim(
    "The text's 3-sigma ellipses hold {value:.1f} % of a Gaussian in the plane.",
    errata="E14",
)
def fig3_ellipse_confidence(drawing: Drawing):
    return measured(
        100 * probability_inside(drawing.ellipse_sigma),
        evidence=f"probability inside the {drawing.ellipse_sigma:g}-sigma ellipse of a Gaussian in the plane",
        sigma_of_95=np.sqrt(-2 * np.log(0.05)),
    )


@claim(counterexample=scaled("closed_loop.covariance"))
def intermediate_cov_met(mission: Mission, closed_loop: Largest[FlightEnsemble]):
    switch = _switch(closed_loop)
    moments = (
        closed_loop.mean[switch, MOTION_PART],
        closed_loop.covariance[switch, MOTION_PART, MOTION_PART],
        closed_loop.count,
    )
    at_switch = misses(moments, mission.intermediate_mean, mission.intermediate_covariance)
    subject = "relative error of the covariance at the switch"
    return holds(
        measure(subject, at_switch.covariance, error=at_switch.covariance_error) <= ABOUT,
        trials=at_switch.trials,
    )


@claim(counterexample=scaled("closed_loop.covariance", at=0))
def disperse_then_contract(closed_loop: Largest[FlightEnsemble]):
    switch = _switch(closed_loop)
    position = closed_loop.covariance[: switch + 1, :2, :2]
    scatter = np.sqrt(np.trace(position, axis1=1, axis2=2) / 2)
    errors = scatter / np.sqrt(4 * freedom(closed_loop.count))  # of two independent axes
    peak = scatter.argmax()
    widest, last = (
        measure(name, scatter[at], "m", error=np.hypot(errors[at], errors[0]))
        for name, at in (
            ("largest standard deviation of the position", peak),
            ("standard deviation of the position at the switch", -1),
        )
    )
    return holds(
        widest > scatter[0],
        f"it is reached at {closed_loop.time[peak]:.1f} s",
        last < scatter[0],
        f"at the start it is {scatter[0]:.2f} m",
        trials=closed_loop.count,
    )


@claim(counterexample=spread("wide_switch.final_state"))
def segment2_depends_on_intermediate(
    mission: Mission, ensemble: Ensemble, misses: FinalMisses, wide_switch: Largest[FlightEnsemble]
):
    wide = misses_at_the_end(wide_switch, mission)
    worst = np.unravel_index(wide.covariance.argmax(), wide.covariance.shape)
    subject = f"the largest with {ensemble.wide_switch_factor:g} times the covariance at the switch"
    return holds(
        measure("relative error of the final covariance", misses.covariance, error=misses.covariance_error) <= ABOUT,
        measure(subject, wide.covariance[worst], error=wide.covariance_error[worst]) > ABOUT,
        trials=wide.trials,
    )


@claim(counterexample=shifted("open_loop.final_state", component="altitude"))
def open_loop_mean_equals_closed_loop_mean(closed_loop: Largest[FlightEnsemble], open_loop: Largest[FlightEnsemble]):
    closed, without = closed_loop.final_state[:, MOTION_PART], open_loop.final_state[:, MOTION_PART]
    deviation = without.std(axis=0) if len(without) > 1 else np.nan
    difference = np.abs(without.mean(axis=0) - closed.mean(axis=0)) / deviation
    error = np.sqrt(1 / len(without) + variance(closed) / variance(without) / len(closed))
    subject = "difference of the final means"
    return holds(
        measure(subject, difference, "open-loop standard deviations", error=error) < CLOSE, trials=open_loop.count
    )


def _switch(ensemble):
    """The last output of the first segment."""
    return np.flatnonzero(ensemble.segment == 0)[-1]


# ----------------------------------------------------------------------------------------------------- Figs. 5 and 6


@claim(by_construction="the mass flows with the command alone, which is one for all flights without feedback")
def mass_variation_from_feedback_only(closed_loop: Largest[FlightEnsemble], open_loop: FlightEnsemble):
    closed, without = closed_loop.final_state[:, MASS], open_loop.final_state[:, MASS]
    if not np.isfinite(closed.mean() + without.mean()):
        return Evaluation(
            True, evidence=_lost(closed_loop), doubts=[Doubt(why="flights that are not finite have no mass")]
        )
    return holds(
        measure("standard deviation of the final mass open loop", without.std(), "kg") < 1e-9 * abs(closed.mean()),
        measure("the same in closed loop", closed.std(), "kg") > 1e-6 * abs(closed.mean()),
    )


# Of the design: the second segment has 1501 nodes. Where its last value is changed, the jump moves into the segment.
LAST_OF_FIRST_SEGMENT = -1502


@claim(counterexample=scaled("gains.gain", at=LAST_OF_FIRST_SEGMENT))
def gain_jump_26s(gains: Gains):
    tests = []
    for kind, part, unit in (("position", slice(2), "N/m"), ("velocity", slice(2, 4), "N s/m")):
        within, jump = _largest_change_and_jump(gains, gains.gain[..., part])
        subject = f"largest change of the {kind} gains from node to node within a segment"
        tests += [measure(subject, within, unit) < MUCH * jump, f"at the switch they change by {jump:.4g} {unit}"]
    return holds(*tests)


@claim(counterexample=scaled("gains.feedforward", at=LAST_OF_FIRST_SEGMENT))
def control_jump_26s(vehicle: Vehicle, gains: Gains):
    fraction = 100 * gains.feedforward / vehicle.maximum_thrust
    within, jump = _largest_change_and_jump(gains, fraction)
    before, after = np.linalg.norm(fraction[[*_around_switch(gains)]], axis=1)
    subject = "largest change of the mean control from node to node within a segment, of the maximum thrust"
    return holds(
        measure(subject, within, "%") < MUCH * jump,
        f"at the switch it changes by {jump:.2f} %, its magnitude from {before:.2f} to {after:.2f} %",
    )


def _largest_change_and_jump(gains, values):
    """Largest change of values (nodes, ...) from node to node within a segment, and their change at the switch."""
    before, _ = _around_switch(gains)
    changes = np.linalg.norm(np.diff(values, axis=0).reshape(len(values) - 1, -1), axis=1)
    return np.delete(changes, before).max(), changes[before]


@claim(counterexample=spread("closed_loop.observed_maximum", component="thrust"))
def max_thrust_not_exceeded(
    vehicle: Vehicle, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None
):
    all_trials = closed_loop_large or closed_loop
    trials = all_trials.count + all_trials.excluded
    largest = closed_loop.observed_maximum[:, THRUST].max() / vehicle.maximum_thrust
    over_all = all_trials.observed_maximum[:, THRUST].max() / vehicle.maximum_thrust
    return holds(
        measure(f"largest control of {trials:,} flights, of the maximum thrust", over_all) < 1,
        f"{largest:.4f} in {closed_loop.count:,} flights",
        trials=trials,
        largest=largest,
    )


def _around_switch(gains):
    """The last node of the first segment and the first node of the second."""
    return np.flatnonzero(gains.segment == 0)[-1], np.flatnonzero(gains.segment == 1)[0]


# -------------------------------------------------------------------------------------------------------------- Fig. 7


class Deviations(NamedTuple):
    """Measured over predicted variance minus one of downrange and altitude, in one ensemble."""

    ends: np.ndarray  # size at the start and at the end, (2, 2)
    middle: np.ndarray  # size in the middle half of each segment, (outputs, 2)
    sampling: float  # error of a sampled variance, relative to its true value
    trials: int

    def error_of(self, deviation: np.ndarray) -> np.ndarray:
        """Standard error of a deviation, at most: that of a variance which is larger than predicted by it."""
        return self.sampling * (1.0 + deviation)

    @property
    def systematic(self) -> float:
        """Mean square in the middle beyond what sampling gives."""
        return float((self.middle**2).mean() - self.sampling**2)

    @property
    def systematic_error(self) -> float:
        """Standard error of `systematic` at most: as if all outputs had the same sampling error."""
        return np.sqrt(2) * self.sampling**2 + 2 * np.sqrt(max(self.systematic, 0.0)) * self.sampling


class OwnDeviations(Deviations):
    """Those of the flights whose mass flows."""


class PriorDeviations(Deviations):
    """Those of the flights with the mass that the design assumes."""


def own_deviations(mission: Mission, gains: Gains, closed_loop: Largest[FlightEnsemble]) -> OwnDeviations:
    """Deviations of the variances in Fig. 7."""
    return OwnDeviations(*_deviations(mission, gains, closed_loop))


def prior_deviations(mission: Mission, gains: Gains, prior_mass: Largest[FlightEnsemble]) -> PriorDeviations:
    """The same without the simplification that the paper suspects: the plant has the mass of the design."""
    return PriorDeviations(*_deviations(mission, gains, prior_mass))


def _deviations(mission: Mission, gains, ensemble):
    everywhere = np.empty((len(ensemble.time), 2))
    for number in (0, 1):
        design_nodes, sample_nodes = gains.segment == number, ensemble.segment == number
        for axis in (0, 1):
            at = np.interp(
                ensemble.time[sample_nodes], gains.time[design_nodes], gains.covariance[design_nodes, axis, axis]
            )
            everywhere[sample_nodes, axis] = ensemble.covariance[sample_nodes, axis, axis] / at - 1
    local = ensemble.time - np.where(ensemble.segment == 0, 0.0, mission.segment_durations[0])
    share = local / mission.segment_durations[ensemble.segment]
    middle = np.abs(everywhere[(share > 0.25) & (share < 0.75)])
    return np.abs(everywhere[[0, -1]]), middle, np.sqrt(2 / freedom(ensemble.count)), ensemble.count


@claim(counterexample=scaled("closed_loop.covariance", at=-1))
def var_endpoints_nearly_exact(figure: OwnDeviations):
    error = 100 * figure.error_of(figure.ends)
    ends = measure("deviation at start and end", 100 * figure.ends, "%", error=error)
    return holds(ends < 100 * NEARLY_EXACT, trials=figure.trials)


@claim(counterexample=scaled("closed_loop.covariance"))
def var_midcourse_minor_deviation(figure: OwnDeviations):
    largest = np.array([figure.middle.max(), figure.ends.max()])
    error = 100 * figure.error_of(largest)
    return holds(
        measure("largest mid-segment deviation", 100 * largest[0], "%", error=error[0]) < 100 * SMALL,
        measure(
            "largest mid-segment deviation less the largest at start and end",
            100 * (largest[0] - largest[1]),
            "%",
            error=np.hypot(*error),
        )
        > 0,
        trials=figure.trials,
    )


@claim(counterexample=scaled("prior_mass.covariance"))
def midcourse_deviation_cause(figure: OwnDeviations, prior: PriorDeviations):
    # Either sampling is all that there is; or what is beyond it goes away with the mass profile.
    by_sampling = measure("largest mid-segment deviation", figure.middle.max() / figure.sampling, "sampling errors")
    whole = max(figure.systematic, 1e-300)
    remaining_share = max(prior.systematic, 0.0) / whole
    error = np.hypot(prior.systematic_error, remaining_share * figure.systematic_error) / whole
    subject = "share of its mean square beyond sampling that remains when the plant flies the mass of the design"
    return holds(
        (by_sampling < SIGMAS) | (measure(subject, remaining_share, error=error) < MOST),
        f"the largest deviation is then {prior.middle.max() / prior.sampling:.3g} sampling errors",
        trials=prior.trials,
    )
