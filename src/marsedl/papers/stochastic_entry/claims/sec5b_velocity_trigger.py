"""Sec. V.B, the Abstract and Sec. VI: the velocity trigger, Table 4, Fig. 13 and the headline."""

from typing import NamedTuple

import numpy as np

from marsedl.papers.stochastic_entry.claims.measures import (
    DEADBAND,
    LAW_NAMES,
    LAWS,
    ROWS,
    Flights,
    Predicted,
    Tails,
    correlation_of,
    finite_count,
    half_tolerance,
    outcomes,
    ratio_of,
    reduction,
    velocity_errors,
    width,
)
from marsedl.papers.stochastic_entry.inputs import Air, Design, Mission
from marsedl.papers.stochastic_entry.objective import TRIGGER_NORMAL, final_weights, per_metre
from marsedl.papers.stochastic_entry.records import (
    CASES,
    DOWNRANGE,
    STATES,
    TRIGGERS,
    VELOCITY,
    Gains,
    Linearization,
)
from marsedl.replication.claims.claim import Tolerance
from marsedl.replication.claims.counterexamples import in_reading, scaled, shifted, spread
from marsedl.replication.claims.thresholds import ROUNDING, STRONG, VISIBLE, WEAK
from marsedl.replication.claims.writing import Fails, claim, holds, measure, measured


@claim()
def trigger_nu():
    return measured(TRIGGER_NORMAL)


@claim(
    "The density of `corrected` is fitted to these numbers, that of `desensitized_density` is not.",
    choices="mean_density",
    close=Tolerance(
        reason="they follow from the mean density, which Mars-GRAM gives to some per cent by version, place and season",
        relative=0.05,
    ),
    counterexample=scaled("linearization.trigger_projection", at=(slice(None), VELOCITY)),
)
def zf_column_velocity(air: Air, mission: Mission, linearization: Linearization):
    return measured(
        linearization.trigger_projection[:, VELOCITY],
        by_construction="the density is fitted to these numbers" if air.density_profile == "log_quadratic" else "",
        late=-mission.end_velocity / linearization.final_rates[VELOCITY],
    )


@claim(by_construction="an identity of Eq. 65 with the normal of Eq. 76")
def zf_structure(linearization: Linearization):
    other_columns = np.delete(linearization.trigger_projection - np.eye(STATES), VELOCITY, axis=1)
    return holds(measure("difference of the other columns from those of the identity", np.abs(other_columns)) <= 0)


def _preimage(projection, vector):
    """The least vector that the transpose of Z_f turns into a given one; Z_f' loses the trigger's normal only."""
    return np.linalg.lstsq(projection.T, vector, rcond=1e-10)[0]


@claim(by_construction="an identity: the weights are made by Eq. 78")
def af_velocity(design: Design, linearization: Linearization):
    units = np.array([design.weight_length, 1.0, 1.0, design.weight_length, 1.0])
    weight = final_weights(design, linearization)[1] * per_metre(design)
    return measured(_preimage(linearization.trigger_projection, weight) * units)


@claim(by_construction="an identity: the adjoint is made by Eq. 79")
def adjoint_velocity(linearization: Linearization, gains: Gains):
    return measured(_preimage(linearization.trigger_projection, gains.adjoint[1, -1]))


_STATES = {"downrange": "downrange", "altitude": "altitude", "velocity": "velocity", "gamma": "flight_path_angle"}


def _cell(row, case, reading="", errata="", choices=""):
    """A cell of Table 4: its claim with the reading that moves it most, and what is changed until its verdict turns."""
    unit, digits = {"velocity": ("m/s", 1), "gamma": ("deg", 2)}.get(row, ("km", 2))
    low, high = (f"{{{reading}.value[{side}]:.{digits}f}}" for side in (0, 1))
    return claim(
        f"With `{reading}` they are {low} / {high} {unit}." if reading else "",
        errata=errata,
        choices=choices,
        counterexample=spread(f"{case}.final_state", component=_STATES[row]),
        name=f"tab4_{row}_{case}",
        row=row,
        case=case,
    )


@_cell(
    "downrange",
    "apollo_time",
    "velocity_adjoint",
    "E14 E21",
    f"apollo_time_adjoint apollo_feedback range_sign {DEADBAND}",
)
@_cell(
    "downrange",
    "apollo_velocity",
    "density_blind",
    "E8 E14 E21",
    f"apollo_feedback aerodynamic_signs range_sign mean_density {DEADBAND}",
)
@_cell("downrange", "stochastic_time", "partition_24", "E12", "partition mean_density range_sign")
@_cell(
    "downrange",
    "stochastic_velocity",
    "same_sign",
    "E8 E21 E22",
    f"aerodynamic_signs range_sign {DEADBAND} mean_density",
)
@_cell("altitude", "apollo_time", "velocity_adjoint", "E14", "apollo_time_adjoint mean_density apollo_feedback")
@_cell("altitude", "apollo_velocity", "density_blind", "E14", "apollo_feedback mean_density")
@_cell("altitude", "stochastic_time")
@_cell("altitude", "stochastic_velocity", "same_sign", "E8", "aerodynamic_signs mean_density")
@_cell("velocity", "apollo_time", "density_blind", "E14", "apollo_feedback mean_density")
@_cell("velocity", "stochastic_time", "partition_20", "E12", "partition mean_density")
@_cell("gamma", "apollo_time", "velocity_adjoint", "E14", "apollo_feedback apollo_time_adjoint mean_density")
@_cell("gamma", "apollo_velocity", "density_blind", "E14", "apollo_feedback mean_density")
@_cell("gamma", "stochastic_time", "partition_24", "E12", "partition mean_density")
@_cell("gamma", "stochastic_velocity", "same_sign", "E8 E22", f"aerodynamic_signs mean_density {DEADBAND}")
def table_4(published, flights: Flights, tails: Tails, *, row, case):
    state, name, factor, _ = ROWS[[of[1] for of in ROWS].index(row)]
    ensemble, (values, errors_of_values) = flights[case], tails[case][state]
    return measured(
        values * factor,
        errors_of_values * factor,
        finite_count(ensemble),
        outcomes(ensemble),
        printed_width=float(np.ptp(published[f"tab4_{name}_{case}"].printed)),
    )


@claim(name="tab4_velocity_apollo_velocity", case="apollo_velocity")
@claim(name="tab4_velocity_stochastic_velocity", case="stochastic_velocity")
def table_4_velocity_at_the_trigger(mission: Mission, flights: Flights, *, case):
    ensemble = flights[case]
    trials = finite_count(ensemble)
    largest = float(velocity_errors(mission, ensemble).max()) if trials else np.nan
    evidence = f"largest distance from the trigger's velocity {largest:.1e} m/s"
    evidence = [evidence, outcomes(ensemble)]
    return measured([-largest, largest], None, trials, evidence, by_construction="the flight ends at this velocity")


class TriggerTails(NamedTuple):
    """Percentiles of the range error with the velocity trigger."""

    apollo: tuple  # as of `final_percentiles`
    stochastic: tuple
    trials: int  # finite ones, of the law that has fewer


def trigger_tails(flights: Flights, tails: Tails) -> TriggerTails:
    """Those of both laws."""
    trials = _fewest(flights)
    if trials < 2:
        raise Fails("fewer than two finite trials of one of the laws", trials)
    return TriggerTails(*(tails[f"{law}_velocity"][DOWNRANGE] for law in LAWS), trials)


def _fewest(flights, trigger="velocity"):
    """Finite trials with a trigger, of the law that has fewer."""
    return min(finite_count(flights[f"{law}_{trigger}"]) for law in LAWS)


@claim(
    "It depends on what the Apollo law feeds back: {density_blind.value:.0f} % with `density_blind`.",
    errata="E8 E14",
    choices=f"apollo_feedback aerodynamic_signs mean_density {DEADBAND}",
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
    trigger="velocity",
)
@claim(
    "Table 4 prints about as much for the fixed time as for the trigger.",
    errata="E12 E14",
    choices=f"apollo_feedback apollo_time_adjoint partition mean_density {DEADBAND}",
    counterexample=spread("stochastic_time.final_state", component="downrange"),
    name="headline_range_reduction_time",
    trigger="time",
)
def headline_range_reduction(flights: Flights, tails: Tails, *, trigger):
    saved, error = reduction(*(tails[f"{law}_{trigger}"][DOWNRANGE] for law in ("stochastic", "apollo")))
    return measured(
        100 * saved,
        100 * error,
        _fewest(flights, trigger),
        remaining=100 * (1 - saved),
        **{f"{case}_width": width(tails[case][DOWNRANGE])[0] / 1e3 for case in CASES},
    )


def _halved(name, side, errata):
    """One of the two percentiles: its claim."""
    return claim(
        "It is {ratio:.2f}, the paper's {printed_ratio:.2f}, with `density_blind` {density_blind.ratio:.2f}.",
        errata=errata,
        choices=f"apollo_feedback aerodynamic_signs mean_density {DEADBAND}",
        counterexample=spread("stochastic_velocity.final_state", component="downrange"),
        name=name,
        side=side,
    )


@_halved("halved_velocity_p1", 0, "E8 E14")
@_halved("halved_velocity_p99", 1, "E8 E14 E22")
def halved_velocity(published, tails: TriggerTails, *, side):
    ratio, error = ratio_of(tails.stochastic, tails.apollo, side)
    printed = [published[f"tab4_downrange_{law}_velocity"].printed[side] for law in LAWS]
    return holds(
        # What the paper calls about half is its own threshold: the further of its two ratios from one half.
        measure("distance of the ratio of the percentiles from one half", abs(ratio - 0.5), error=error)
        <= half_tolerance(published) * (1.0 + ROUNDING),
        trials=tails.trials,
        ratio=ratio,
        printed_ratio=printed[1] / printed[0],
    )


@claim(
    "The interval changes by {change:+.0f} %, with `velocity_adjoint` by {velocity_adjoint.change:+.0f} %.",
    errata="E8 E14",
    choices="apollo_time_adjoint aerodynamic_signs mean_density apollo_feedback",
    counterexample=spread("apollo_velocity.final_state", component="downrange"),
    name="velocity_trigger_helps_apollo",
    law="apollo",
)
@claim(
    "The interval changes by {change:+.0f} %, with `partition_24` by {partition_24.change:+.0f} %.",
    errata="E12",
    choices="partition mean_density",
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
    name="velocity_trigger_helps_stochastic",
    law="stochastic",
)
def velocity_trigger_helps(flights: Flights, tails: Tails, *, law):
    with_trigger, fixed = tails[f"{law}_velocity"][DOWNRANGE], tails[f"{law}_time"][DOWNRANGE]
    saved, error = (100 * part for part in reduction(with_trigger, fixed))
    subject = f"reduction of the {LAW_NAMES[law]} law's interval from the fixed time to the velocity trigger"
    return holds(
        measure(subject, saved, "%", error=error) > 0,
        trials=min(finite_count(flights[f"{law}_{trigger}"]) for trigger in TRIGGERS),
        change=-saved,
    )


@claim(by_construction="the flight ends at this velocity")
def velocity_trigger_ends_at_velocity(mission: Mission, flights: Flights):
    off = max(velocity_errors(mission, flights[f"{law}_velocity"]).max(initial=0.0) for law in LAWS)
    return holds(
        measure("largest final velocity error", off, "m/s") < ROUNDING * mission.end_velocity, trials=_fewest(flights)
    )


@claim(
    "The interval changes by {change:+.0f} %, with `density_blind` by {density_blind.change:+.0f} %.",
    errata="E8 E14",
    choices=f"apollo_feedback aerodynamic_signs mean_density {DEADBAND}",
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
)
def improvement_visible_velocity(tails: TriggerTails):
    saved, error = (100 * part for part in reduction(tails.stochastic, tails.apollo))
    subject = "reduction of the interval between the percentiles of the range by the stochastic law"
    return holds(measure(subject, saved, "%", error=error) > 100 * VISIBLE, trials=tails.trials, change=-saved)


class FinalCovariances(dict):
    """Covariances of range and velocity in the linear model at the final time by case, (2, 2)."""

    def of(self, case: str) -> np.ndarray:
        """Return that of a case, which has to be finite."""
        if not np.isfinite(self[case]).all():
            raise Fails(f"no finite covariance of {case.replace('_', ', ')}")
        return self[case]

    def correlation(self, case: str) -> float:
        """Correlation of range and velocity."""
        return correlation_of(self.of(case), 0, 1)


def final_covariances(predicted: Predicted) -> FinalCovariances:
    """Those of both laws and triggers."""
    plane = np.ix_([DOWNRANGE, VELOCITY], [DOWNRANGE, VELOCITY])
    return FinalCovariances(
        {f"{law}_{trigger}": predicted[law][k, -1][plane] for law in LAWS for k, trigger in enumerate(TRIGGERS)}
    )


def _sampled(flights, law):
    """Correlation of range and velocity of the trials at the fixed final time."""
    return correlation_of(flights[f"{law}_time"].covariance[-1], DOWNRANGE, VELOCITY)


@claim(
    "With `timed_covariance` the correlation is {timed:+.2f}; the flights have {sampled:+.2f}.",
    errata="E15",
    choices="apollo_covariance",
    counterexample=in_reading("timed_covariance"),
)
def fig13_apollo_negative(gains: Gains, flights: Flights, final: FinalCovariances):
    timed = correlation_of(gains.timed_covariance[0, -1], DOWNRANGE, VELOCITY)
    sampled, count = _sampled(flights, "apollo"), flights["apollo_time"].count
    subject = "correlation of range and velocity at the final time"
    return holds(
        measure(f"{subject} in the linear model", final.correlation("apollo_time")) < 0,
        measure("correlation over the flights", sampled, error=(1 - sampled**2) / np.sqrt(max(count, 1))) < 0,
        timed=timed,
        sampled=sampled,
        trials=flights["apollo_time"].count,
    )


@claim(
    "With `timed_covariance` the trigger's adjoint changes the correlation by {timed_covariance.change:+.2f}.",
    errata="E15",
    choices="apollo_covariance",
    counterexample=scaled("gains.apollo_covariance", at=(1, -1, DOWNRANGE, VELOCITY)),
)
def fig13_apollo_more_negative(final: FinalCovariances):
    time, velocity = (final.correlation(f"apollo_{trigger}") for trigger in TRIGGERS)
    subject = "correlation of range and velocity with the trigger's adjoint in the linear model"
    return holds(measure(subject, velocity) < time, f"with that of the fixed time {time:+.3f}", change=velocity - time)


@claim(counterexample=in_reading("timed_covariance"))
def fig13_stochastic_time_variance(final: FinalCovariances):
    apollo, stochastic = (np.sqrt(final.of(f"{law}_time")[0, 0]) / 1e3 for law in LAWS)
    # Where no limit is active, an Apollo law with gains against time has the same least variance.
    return holds(measure("predicted range deviation, against Apollo's", stochastic, "km") < apollo * (1.0 - ROUNDING))


@claim(
    "With `partition_24` the correlation is {partition_24.correlation:+.2f}.",
    errata="E12",
    choices="partition",
    counterexample=scaled("gains.stochastic_covariance", at=(0, -1, DOWNRANGE, VELOCITY)),
)
def fig13_stochastic_time_uncorrelated(flights: Flights, final: FinalCovariances):
    correlation, sampled = final.correlation("stochastic_time"), _sampled(flights, "stochastic")
    return holds(
        f"of the trials {sampled:+.3f}",
        measure("magnitude of the correlation of range and velocity in the linear model", abs(correlation)) < WEAK,
        correlation=correlation,
    )


@claim(counterexample=scaled("gains.stochastic_covariance", at=(1, -1, DOWNRANGE, VELOCITY)))
def fig13_stochastic_velocity_correlated(final: FinalCovariances):
    correlation = final.correlation("stochastic_velocity")
    return holds(measure("magnitude of the correlation of range and velocity", abs(correlation)) > 1.0 - STRONG)


@claim(counterexample=shifted("gains.stochastic_covariance", at=(0, -1, DOWNRANGE, VELOCITY)))
def fig13_clear_difference(final: FinalCovariances):
    apart = abs(final.correlation("stochastic_time") - final.correlation("stochastic_velocity"))
    return holds(measure("difference of the correlations of range and velocity under the two designs", apart) > VISIBLE)
